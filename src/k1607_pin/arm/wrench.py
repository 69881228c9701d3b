"""A force and moment from outside on one of the arm's frames."""

import math
from dataclasses import dataclass, field

import numpy as np

from k1607_pin.arguments import numbers
from k1607_pin.arm.arm import Arm, frame_id

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
        for name, unit in (("force", "N"), ("moment", "N m")):
            x = getattr(self, name)
            if type(x) is np.ndarray and x.dtype == float and x.shape == (3,) and math.isfinite(sum(x.tolist())):
                object.__setattr__(self, name, x.copy())  # every step of a simulation makes one
            elif not hasattr(x, "_v"):  # traced: not to be checked
                object.__setattr__(self, name, numbers(name, x, (3,), unit).copy())
        if self.frame is not None and not isinstance(self.frame, str):
            raise ValueError(f"frame: expected the name of a frame, or None for the tool, got {self.frame!r}")
        if not isinstance(self.axes, str) or self.axes not in AXES:
            raise ValueError(f"axes: expected one of {', '.join(AXES)}, got {self.axes!r}")


def wrench_torque(arm: Arm, q: np.ndarray, wrench: Wrench) -> np.ndarray:
    """(n,) N m: what the wrench does to the joints at q (n,), J^T of its frame.

    Raises
    ------
    ValueError
        The arm has no such frame.
    """
    return arm.jacobian(q, wrench.frame).T @ _in_base_axes(arm, q, wrench)


def wrench_at_tool(arm: Arm, q: np.ndarray, wrench: Wrench) -> np.ndarray:
    """(6,) N, N m: what the wrench does to the tool at q (n,), about the tool's origin, base axes.

    Zero where it acts on another body than the one that carries the tool: that body only feels it through the joints.

    Raises
    ------
    ValueError
        The arm has no such frame.
    """
    w = _in_base_axes(arm, q, wrench)
    if wrench.frame in (None, arm.tool_frame):
        return w
    model = arm.model
    on, tool = (model.frames[frame_id(model, name, "frame")].parentJoint for name in (wrench.frame, arm.tool_frame))
    if on != tool:
        return np.zeros(6)
    arm_of_force = arm.forward_kinematics(q, wrench.frame).translation - arm.forward_kinematics(q).translation
    return np.concatenate([w[:3], w[3:] + np.cross(arm_of_force, w[:3])])


def _in_base_axes(arm: Arm, q: np.ndarray, wrench: Wrench) -> np.ndarray:
    """(6,) N, N m about the origin of the wrench's own frame."""
    force, moment = wrench.force, wrench.moment
    if wrench.axes == "frame":
        R = arm.forward_kinematics(q, wrench.frame).rotation
        force, moment = R @ force, R @ moment
    return np.concatenate([force, moment])
