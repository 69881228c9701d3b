"""Noise from a counter: what it is, that it is the same whoever asks, and what it refuses."""

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.control.baselines import GravityPD
from k1607_pin.control.joint_space import gains_from_mass
from k1607_pin.paths.joint_plan import plan_joints
from k1607_pin.simulation.noise import WhiteNoise, standard_normal, with_noise


def test_it_is_normal_and_independent():
    x = np.array([standard_normal(7, k, 14) for k in range(4000)])
    n = x.size
    assert abs(x.mean()) < 4 / np.sqrt(n)
    assert abs(x.var() - 1) < 4 * np.sqrt(2 / n)
    assert abs((x**4).mean() - 3) < 4 * np.sqrt(96 / n)
    correlation = np.corrcoef(x.T) - np.eye(14)
    assert np.abs(correlation).max() < 5 / np.sqrt(len(x))
    assert abs(np.corrcoef(x[1:, 0], x[:-1, 0])[0, 1]) < 5 / np.sqrt(len(x))
    others = np.array([standard_normal(8, k, 14) for k in range(4000)])
    assert abs(np.corrcoef(x.ravel(), others.ravel())[0, 1]) < 4 / np.sqrt(n)


def test_a_sample_does_not_depend_on_the_others():
    noise = WhiteNoise(3, 5, 0.01)
    late = noise(0.42)
    [noise(t) for t in (0.0, 0.41)]
    np.testing.assert_array_equal(noise(0.42), late)
    np.testing.assert_array_equal(standard_normal(3, 42, 3), late[:3])


def test_a_law_is_told_the_noise_and_no_more():
    """Torque of a PD law: its gains times the noise, exactly."""
    arm = k1607.load_k1607(gravity=(0, 0, 0))
    q0 = np.zeros(7)
    gains = gains_from_mass(arm, q0, 5.0)
    law = GravityPD(arm, plan_joints(arm, [q0 + 0.1], q0), gains)
    noisy, still = with_noise(law, 7, 0.01, 1e-3, 1e-2, seed=5), np.zeros(7)
    plain, told = law.update(0.03, q0, still, None)[0], noisy.update(0.03, q0, still, noisy.start(q0, still, 0.1))[0]
    x = standard_normal(5, 3, 14)
    np.testing.assert_allclose(plain - told, gains.K_p @ x[:7] * 1e-3 + gains.K_d @ x[7:] * 1e-2, rtol=1e-9)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: WhiteNoise(-1, 3, 0.01), "seed: expected a whole number"),
        (lambda: WhiteNoise(1.5, 3, 0.01), "seed: expected a whole number"),
        (lambda: WhiteNoise(1, 0, 0.01), "size, period"),
        (lambda: WhiteNoise(1, 3, 0.0), "size, period"),
        (lambda: with_noise(None, 7, 0.01, -1.0, 0.0), "sigma_q: expected"),
        (lambda: with_noise(None, 7, 0.01, 0.0, np.nan), "sigma_v: expected"),
    ],
)
def test_bad_input(make, said):
    with pytest.raises(ValueError, match=said):
        make()
