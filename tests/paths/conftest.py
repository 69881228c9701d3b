"""A posture of each arm with room around it, and times at which differences can be taken."""

from collections.abc import Callable

import numpy as np
import pytest

import k1607_pin as k1607

POSTURES = {
    "k1607": np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10]),
    "panda": np.array([0.0, -0.3, 0.0, -1.8, 0.0, 1.6, 0.5]),
    "ur5": np.array([0.3, -1.2, 1.4, -0.9, -1.2, 0.2]),
}


@pytest.fixture(scope="session")
def q0(arm: k1607.Arm) -> np.ndarray:
    """(n,) rad"""
    return POSTURES[arm.name]


@pytest.fixture(scope="session")
def clear_of() -> Callable[[np.ndarray, float], np.ndarray]:
    """(times, duration) -> (N,) s: random, clear of ``times``, where pieces meet, by more than a difference's step of 1e-5 s."""

    def choose(times: np.ndarray, duration: float) -> np.ndarray:
        t = np.random.default_rng(78).uniform(1e-4, duration - 1e-4, 400)
        return t[np.abs(t[:, None] - times).min(axis=1) > 2e-5][:200]

    return choose
