"""The stability map against the theory of the sampled loop."""

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.control.reference_model import reference_model
from k1607_pin.report.stability import figure_stability, stability_map

MODEL = reference_model(2 * np.ones(6), 3 * np.ones(6))


@pytest.mark.parametrize("share", [0.2, 0.9, 0.999, 1.001, 1.5])
def test_a_held_pd_of_critical_damping_is_stable_below_omega_t_of_one(share):
    """x'' = -omega^2 x - 2 omega x', the right side held for T: the spectral radius of its step passes one at omega T = 1."""
    a = share  # omega T, with T = 1
    step = np.array([[1 - a * a / 2, 1 - a], [-a * a, 1 - 2 * a]])
    assert (np.abs(np.linalg.eigvals(step)).max() < 1) == (share < 1)


@pytest.fixture(scope="module")
def result():
    arm = k1607.load_k1607(gravity=(0, 0, 0))
    q0 = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
    shares = []
    out = stability_map(
        arm, q0, MODEL, [0.01, 0.02], [2.0, 5.0, 70.0, 140.0], [0.0, 1e7], duration=0.9, progress=shares.append
    )
    assert shares == sorted(shares)
    return out


def test_the_arm_s_loop_is_lost_where_theory_says(result):
    without = result.sel(beta=0.0)
    stable = np.isfinite(without.rms)
    assert (stable == (without.omega * without.period < 1)).all()
    assert (np.isnan(without.lost_at) == stable).all()


def test_stiffer_is_better_while_it_is_stable(result):
    assert float(result.rms.sel(beta=0.0, period=0.01, omega=70.0)) < 0.05 * float(
        result.rms.sel(beta=0.0, period=0.01, omega=5.0)
    )


def test_too_much_adaptation_is_lost_at_a_long_period_where_the_gains_alone_are_not(result):
    """Both well beyond the edge: what loses them is lost from half that beta on, whatever the start's sixth digit."""
    for soft in (
        result.sel(omega=5.0, period=0.02),
        result.sel(omega=2.0, period=0.01),
    ):  # the latter in docs/study_cases.md
        assert np.isfinite(soft.rms.sel(beta=0.0))
        assert not np.isfinite(soft.rms.sel(beta=1e7))


def test_it_can_be_drawn(result):
    figure = figure_stability(result)
    panels = [axes for axes in figure.axes if "beta" in axes.get_title()]
    assert len(panels) == 2
    crosses = [len(axes.lines[0].get_xdata()) for axes in panels]
    assert crosses == [int((~np.isfinite(result.rms.sel(beta=beta))).sum()) for beta in result.beta]
