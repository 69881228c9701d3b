"""A force and moment from outside on one of the arm's frames."""

from dataclasses import dataclass, field

import numpy as np

from k1607_pin.arm.arm import Arm

AXES = ("base", "frame")


@dataclass(frozen=True)
class Wrench:
    """What the world does to the arm at the origin of one of its frames.

    Raises
    ------
    ValueError
        Wrong shapes, numbers that are not finite, other axes.
    """

    force: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """(3,) N"""
    moment: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """(3,) N m about the frame's origin"""
    frame: str | None = None
    """Name of the frame at whose origin it acts; None for the tool."""
    axes: str = "base"
    """Axes of force and moment: "base", or "frame" for those of the frame itself."""

    def __post_init__(self) -> None:
        for name in ("force", "moment"):
            x = np.array(getattr(self, name), dtype=float)
            if x.shape != (3,) or not np.isfinite(x).all():
                raise ValueError(f"{name}: expected (3,) finite numbers, got {getattr(self, name)!r}")
            object.__setattr__(self, name, x)
        if self.axes not in AXES:
            raise ValueError(f"axes: expected one of {', '.join(AXES)}, got {self.axes!r}")


def wrench_torque(arm: Arm, q: np.ndarray, wrench: Wrench) -> np.ndarray:
    """(n,) N m: what the wrench does to the joints at q (n,), J^T of its frame.

    Raises
    ------
    ValueError
        The arm has no such frame.
    """
    force, moment = wrench.force, wrench.moment
    if wrench.axes == "frame":
        R = arm.forward_kinematics(q, wrench.frame).rotation
        force, moment = R @ force, R @ moment
    return arm.jacobian(q, wrench.frame).T @ np.concatenate([force, moment])
