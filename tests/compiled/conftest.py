"""Closed loops to compile, with what `simulate` makes of them."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.report_paths import Line

START = np.deg2rad([-20, 30, 20, 100, -30, 60, 10])
ROUNDING = 1e-9  # the issue's; what is seen is a thousandth of it


def cartesian_law(
    arm: k1607.Arm, q0: np.ndarray = START, period: float = 0.01, omega: float = 10.0, **more: Any
) -> CartesianAdaptive:
    """The Cartesian adaptive scheme on the report's line."""
    start = arm.forward_kinematics(q0)
    model = reference_model(2 * np.ones(6), 3 * np.ones(6))
    gains = gains_from_inertia(arm, q0, omega)
    extent = np.array([0.1, 0.2, 0.0])
    path = Line(start.translation, extent)
    return CartesianAdaptive(arm, path, start.rotation, gains, model, 1e3, 1e3, period, **more)


@pytest.fixture(scope="session")
def arm() -> k1607.Arm:
    return k1607.load_k1607()


@pytest.fixture(scope="session")
def law(arm: k1607.Arm) -> CartesianAdaptive:
    return cartesian_law(arm)


def agreement(run: Any, reference: Any, names: tuple[str, ...], i: int = 0, tolerance: float = ROUNDING) -> None:
    """The logged variables of rollout i, each to ``tolerance`` of its largest entry."""
    for name in names:
        expected = reference[name].values
        assert run[name].values[i].shape == expected.shape
        assert np.abs(run[name].values[i] - expected).max() <= tolerance * max(np.abs(expected).max(), 1e-3), name


@pytest.fixture(scope="session")
def q0() -> np.ndarray:
    return START


@pytest.fixture(scope="session")
def cartesian() -> Callable[..., CartesianAdaptive]:
    return cartesian_law


@pytest.fixture(scope="session")
def agrees() -> Callable[..., None]:
    return agreement
