"""What the equations' residuals are taken on: random poses, and Pinocchio's word on each, the independent source."""

from functools import cache
from typing import Any

import numpy as np

from k1607_pin.arm.load import load_k1607
from k1607_pin.kinematics import closed_form, product

POSES = 1000
ROUNDING = 1e-12  # seven link transforms, entries up to 2 m: a few hundred roundings of 2e-16 at the most


@cache
def poses() -> np.ndarray:
    """(POSES, 7) joint angles over the full circle, rad: the sample that every numeric residual is taken on."""
    return np.random.default_rng(1607).uniform(-np.pi, np.pi, (POSES, 7))


@cache
def cs() -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Cosines and sines of the sample, seven times (POSES,) each."""
    return product.cosines_and_sines(poses())


@cache
def terms() -> closed_form.Terms:
    """(5)-(11) on the sample."""
    return closed_form.terms(*cs(), closed_form.parameters())


@cache
def frames() -> np.ndarray:
    """(7, POSES, 4, 4): Pinocchio's joint frames {1}..{7}, the independent source."""
    arm = load_k1607()
    return np.array([[T.homogeneous for T in arm.frames(q)] for q in poses()]).swapaxes(0, 1)


@cache
def pinocchio_jacobian() -> np.ndarray:
    """(POSES, 6, 7)"""
    return load_k1607().jacobian(poses())


def gap(a: Any, b: Any) -> float:
    """Largest absolute difference."""
    return float(np.abs(np.asarray(a) - np.asarray(b)).max())


def axis(frame: int, axis: int) -> list[np.ndarray]:
    """x, y, z components of an axis (0, 1, 2) of frame {frame} in frame {0}, from Pinocchio, (POSES,) each."""
    return [frames()[frame - 1][:, row, axis] for row in range(3)]


PINOCCHIO = f"Pinocchio, {POSES} random poses"
