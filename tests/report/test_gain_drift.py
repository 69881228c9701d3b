"""Ten minutes of holding still: the linear arm stands for the whole one."""

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.control.practice import Practice
from k1607_pin.report.case_figures import POSTURE_DEG
from k1607_pin.report.gain_drift import DRIFT_OPTIONS, figure_drift, gain_drift, outcome

UR5 = k1607.load_example("ur5"), np.array([0.3, -1.2, 1.4, -0.9, -1.2, 0.2])


def test_it_starts_at_one_and_marks_a_lost_loop():
    result = gain_drift(*UR5, {"none": Practice()}, duration=2.0, every=0.1, omega_T=1.5)  # unstable without any drift
    assert (result.K_d.isel(time=0) == 1).all()
    assert np.isnan(result.K_d.isel(time=-1)).all()
    (row,) = outcome(result)
    assert 0 <= row["lost_after_s"] < 2.0
    assert figure_drift(result).axes


def test_the_whole_arm_is_lost_likewise():
    result = gain_drift(*UR5, {"none": Practice()}, duration=2.0, every=0.1, omega_T=1.5, whole_arm=True)
    assert np.isnan(result.K_d.isel(time=-1)).all()


def test_the_linear_arm_stands_for_the_whole_one(reference):
    """Same noise, so sample by sample; without gravity's torque the arm sags first, and its mass matrix with it."""
    names = ("as the report has it", "gravity", "gravity, leak 0.02 /s")
    options = {name: DRIFT_OPTIONS[name] for name in names}
    q, told = np.deg2rad(POSTURE_DEG), []
    linear = gain_drift(reference, q, options, duration=6.0, every=0.5)
    whole = gain_drift(reference, q, options, duration=6.0, every=0.5, whole_arm=True, progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0
    for name, within in zip(names, (0.03, 0.05, 0.05), strict=True):
        for K in ("K_p", "K_d"):
            a, b = (result[K].sel(option=name).values - 1 for result in (linear, whole))
            assert b == pytest.approx(a, rel=within, abs=1e-5), (name, K)
    assert float(linear.K_d.sel(option="gravity")[-1]) > 1.004  # there is a drift to agree on
    assert figure_drift(linear, whole).axes


def test_too_short_a_time_is_refused():
    with pytest.raises(ValueError, match="duration"):
        gain_drift(*UR5, duration=0.5)
