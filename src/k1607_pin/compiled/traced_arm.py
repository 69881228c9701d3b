"""An arm whose methods take symbols: what a controller or a plant sees of its `Arm` while it is traced."""

from typing import Any, NamedTuple

import numpy as np

from k1607_pin.arm.arm import Arm, frame_id
from k1607_pin.arm.bodies import bodies
from k1607_pin.dynamics.base_parameters import base_parameters
from k1607_pin.dynamics.operational_space import OperationalSpace, operational_space
from k1607_pin.dynamics.rigid_body import (
    Body,
    coriolis_matrix,
    forward_dynamics,
    inverse_dynamics,
    mass_matrix,
    place,
    point_jacobian,
    point_jacobian_rate,
    point_pose,
    second_moments,
)

NEGLIGIBLE = 1e-15
"""Of the largest parameter of its kind: what is less is rounding, left where it should have cancelled."""


class Pose(NamedTuple):
    """Of a frame in the base, as `pinocchio.SE3` has it."""

    translation: Any
    """(3,) m"""
    rotation: Any
    """(3, 3)"""


class TracedArm:
    """Stands in for an `Arm`: the same names, for traced vectors q, v, tau (n,); no batches, no checks.

    Parameters
    ----------
    inertial : (n, 10) of each link in its joint frame, as Pinocchio has it: m, m c, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz about the
        joint frame's origin; armature : (n,) kg m^2; gravity : (3,) m/s^2 in the base. None for the arm's own.
    """

    def __init__(self, arm: Arm, inertial: Any = None, armature: Any = None, gravity: Any = None) -> None:
        model = arm.model
        self.arm = arm
        self.n = arm.n
        self.name, self.tool_frame, self.joint_names = arm.name, arm.tool_frame, arm.joint_names
        self.lower, self.upper = arm.lower, arm.upper
        self.velocity_limit, self.effort_limit = arm.velocity_limit, arm.effort_limit
        self.armature = arm.armature if armature is None else armature
        self.gravity = model.gravity.linear.copy() if gravity is None else gravity
        self.bodies = [
            body._replace(armature=self.armature[i], **({} if inertial is None else _parameters(inertial[i])))
            for i, body in enumerate(bodies(model))
        ]
        self._model = model
        self._base: list[Body] | None = None

    def carrying(self, payload: Any) -> "TracedArm":
        """With a body fixed to the tool: (10,) as ``inertial``, in the axes of the joint frame that carries the tool."""
        last, _, _ = self._place(None)
        carried = TracedArm.__new__(TracedArm)
        carried.__dict__.update(self.__dict__)
        carried._base = None
        carried.bodies = list(self.bodies)
        body, more = self.bodies[last], _parameters(payload)
        carried.bodies[last] = body._replace(**{name: getattr(body, name) + x for name, x in more.items()})
        return carried

    @property
    def base(self) -> list[Body]:
        """The bodies by their base parameters."""
        if self._base is None:
            self._base = _without_rounding(base_parameters(self.bodies))
        return self._base

    # As of `Arm`

    def as_vector(self, x: Any, name: str) -> Any:
        """x: what is traced is not checked."""
        return x

    def forward_kinematics(self, q: Any, frame: str | None = None) -> Pose:
        """T_base_tool."""
        last, offset, rotation = self._place(frame)
        where = place(self.bodies, q)
        R = where.rotations[last]
        return Pose(where.origins[last] + R @ offset, R @ rotation)

    def jacobian(self, q: Any, frame: str | None = None) -> Any:
        """(6, n)"""
        last, offset, _ = self._place(frame)
        return point_jacobian(self.bodies, q, last, offset)

    def jacobian_time_variation(self, q: Any, v: Any) -> Any:
        """(6, n)"""
        last, offset, _ = self._place(None)
        return point_jacobian_rate(self.bodies, q, v, last, offset)

    def mass_matrix(self, q: Any) -> Any:
        """(n, n)"""
        return mass_matrix(self.base, q)

    def gravity_torque(self, q: Any) -> Any:
        """(n,)"""
        still = np.zeros(self.n)
        return inverse_dynamics(self.base, q, still, still, self.gravity)

    def bias_torque(self, q: Any, v: Any) -> Any:
        """(n,)"""
        return inverse_dynamics(self.base, q, v, np.zeros(self.n), self.gravity)

    def coriolis_matrix(self, q: Any, v: Any) -> Any:
        """(n, n)"""
        return coriolis_matrix(self.base, q, v)

    def inverse_dynamics(self, q: Any, v: Any, a: Any) -> Any:
        """(n,)"""
        return inverse_dynamics(self.base, q, v, a, self.gravity)

    def forward_dynamics(self, q: Any, v: Any, tau: Any) -> Any:
        """(n,)"""
        return forward_dynamics(self.base, q, v, tau, self.gravity)

    def operational_space(self, q: Any, v: Any) -> OperationalSpace:
        """Without a look at singularities: ``sigma_min`` is None."""
        last, offset, rotation = self._place(None)
        return operational_space(
            self.mass_matrix(q),
            self.coriolis_matrix(q, v),
            self.gravity_torque(q),
            self.jacobian(q),
            self.jacobian_time_variation(q, v),
            point_pose(self.bodies, q, last, offset, rotation),
            v,
        )

    def _place(self, frame: str | None) -> tuple[int, np.ndarray, np.ndarray]:
        """Index of the body that carries the frame, offset (3,) and rotation (3, 3) there."""
        found = self._model.frames[frame_id(self._model, frame or self.tool_frame)]
        return found.parentJoint - 1, found.placement.translation, found.placement.rotation


def inertial_parameters(arm: Arm) -> np.ndarray:
    """(n, 10), what `TracedArm` takes as ``inertial``."""
    return np.stack([arm.model.inertias[i].toDynamicParameters() for i in range(1, arm.n + 1)])


def _parameters(p: Any) -> dict[str, Any]:
    """Fields of a `Body` from (10,)."""
    xx, xy, yy, xz, yz, zz = (p[k] for k in range(4, 10))
    inertia = np.stack([np.stack([xx, xy, xz]), np.stack([xy, yy, yz]), np.stack([xz, yz, zz])])
    return {"mass": p[0], "moment": np.stack([p[1], p[2], p[3]]), "second": second_moments(inertia)}


def _without_rounding(bodies: list[Body]) -> list[Body]:
    """Numbers freed of what is negligible, so that it folds away; symbols as they are."""
    if any(
        not isinstance(x, int | float | np.ndarray) for body in bodies for x in (body.mass, body.moment, body.second)
    ):
        return bodies
    scales = [max(float(np.abs(getattr(body, name)).max()) for body in bodies) for name in ("mass", "moment", "second")]
    return [
        body._replace(
            mass=_kept(body.mass, scales[0]),
            moment=_kept(body.moment, scales[1]),
            second=_kept(body.second, scales[2]),
        )
        for body in bodies
    ]


def _kept(x: Any, scale: float) -> Any:
    return np.where(np.abs(x) > NEGLIGIBLE * scale, x, 0.0)
