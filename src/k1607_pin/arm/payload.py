"""A payload in the hand: the same arm, carrying it, and what happens at the moment it is picked up."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

from k1607_pin.arguments import number, numbers, shown
from k1607_pin.arm.arm import Arm, frame_id
from k1607_pin.dynamics.linear import solve_symmetric


@dataclass(frozen=True)
class Payload:
    """A rigid body fixed to the tool frame.

    Raises
    ------
    ValueError
        Negative mass, numbers that are not finite, an inertia that no body of that mass has.
    """

    mass: float
    """kg"""
    cg: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """(3,) m in the tool frame"""
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    """(3, 3) kg m^2 about the cg, axes of the tool frame; zero for a point mass"""

    def __post_init__(self) -> None:
        number("mass", self.mass, at_least=0, unit="kg")
        cg = numbers("cg", self.cg, (3,), "m").copy()
        inertia = numbers("inertia", self.inertia, (3, 3), "kg m^2").copy()
        if (inertia != inertia.T).any():
            raise ValueError(f"inertia: expected a symmetric matrix in kg m^2, got {self.inertia!r}")
        moments = np.linalg.eigvalsh(inertia)
        slack = 1e-12 * max(moments[2], 0.0)
        if moments[0] < -slack or moments[0] + moments[1] < moments[2] - slack:
            raise ValueError(f"inertia: no body has principal moments {moments}")
        if self.mass == 0 and moments[2] > 0:
            raise ValueError("inertia: expected none for a payload without mass")
        object.__setattr__(self, "cg", cg)
        object.__setattr__(self, "inertia", inertia)


def with_payload(arm: Arm, payload: Payload) -> Arm:
    """The arm with a payload fixed to its tool frame; ``arm`` itself for a payload without mass.

    Laying it down again is going back to ``arm``, which has not changed.
    """
    if not isinstance(arm, Arm):
        raise ValueError(f"arm: expected an Arm, such as load_k1607() gives, got {shown(arm)}")
    if not isinstance(payload, Payload):
        raise ValueError(f"payload: expected a Payload, got {shown(payload)}")
    if payload.mass == 0:
        return arm
    model = arm.model
    tool = model.frames[frame_id(model, arm.tool_frame)]
    body = pin.Inertia(float(payload.mass), payload.cg, payload.inertia)
    model.inertias[tool.parentJoint] += tool.placement.act(body)
    return arm.with_model(model)


def blend(first: Payload, second: Payload, share: float) -> Payload:
    """(1 - share) of the first and ``share`` of the second, held together: masses, moments and inertias mix as they add."""
    share = number("share", share, at_least=0)
    if share > 1:
        raise ValueError(f"share: expected a number from 0 to 1, got {share!r}")
    if share in (0.0, 1.0):
        return (first, second)[int(share)]
    a, b = (1 - share) * first.mass, share * second.mass
    if a + b == 0:
        return second
    apart = second.cg - first.cg
    # Steiner's part in the bodies' relative position: exactly zero where only one of them has mass
    steiner = a * b / (a + b) * ((apart @ apart) * np.eye(3) - np.outer(apart, apart))
    inertia = (1 - share) * first.inertia + share * second.inertia + steiner
    return Payload(a + b, first.cg + b / (a + b) * apart, inertia)


def velocity_after_gripping(bare: Arm, after: Arm, gripped: Payload, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(n,) rad/s after ``gripped``, at rest until then, has become part of what the arm ``after`` carries.

    M' v' = (M' - M_gripped) v: all but the newcomer brings its momentum. What was let go at the same moment took its own along.
    bare : the arm without any payload; q, v : (n,) at that moment.
    """
    v = bare.as_vector(v, "v")
    newcomer = with_payload(bare, gripped).mass_matrix(q) - bare.mass_matrix(q)
    return velocity_after_gripping_of(after.mass_matrix(q), newcomer, v)


def velocity_after_gripping_of(M: Any, newcomer: Any, v: Any) -> Any:
    """(n,) rad/s from mass matrices (n, n): M with all that is carried, and what of it ``newcomer``, until then at rest, adds."""
    return solve_symmetric(M, (M - newcomer) @ v)
