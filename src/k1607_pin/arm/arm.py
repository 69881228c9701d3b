"""`Arm`: a fixed-base serial arm on Pinocchio, immutable to its user and safe to use from threads."""

import math
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

from k1607_pin.arguments import as_floats, described, shown
from k1607_pin.arm.meshes import Geometry
from k1607_pin.arm.serial import require_serial
from k1607_pin.dynamics.operational_space import OperationalSpace, operational_space, singular_values
from k1607_pin.kinematics.differential import Damping, SingularJacobianError

Vector = np.ndarray
UNITS = {"q": "rad", "q0": "rad", "v": "rad/s", "v0": "rad/s", "a": "rad/s^2", "tau": "N m"}
SQUARED_RANK_TOLERANCE = 1e-4
"""sigma_min / sigma_max below which J counts as singular for Lambda: J M^-1 J^T squares it, and 1e-8 leaves eight digits."""


class Arm:
    """A fixed-base serial arm with n one-degree-of-freedom joints and a tool frame.

    Made by `load_k1607`, `load_urdf` or `load_example`. Joint angles q and velocities v are (n,) in rad (m for a prismatic
    joint) and rad/s; forces are SI; Cartesian quantities are in base axes, linear rows first. Kinematics also take
    batches (..., n). An argument of wrong shape, or that is not finite, raises `ValueError`.
    """

    def __init__(
        self,
        model: pin.Model,
        tool_frame: str,
        visual_model: pin.GeometryModel | None = None,
        collision_model: pin.GeometryModel | None = None,
    ) -> None:
        if not isinstance(model, pin.Model):
            raise ValueError(f"model: expected a pinocchio.Model, got {shown(model)}")
        geometry = [Geometry(g and g.copy()) for g in (visual_model, collision_model)]
        self._set(pin.Model(model), tool_frame, *geometry)

    def _set(self, model: pin.Model, tool_frame: str, visual: Geometry, collision: Geometry) -> None:
        """Every attribute; ``model`` is not copied."""
        require_serial(model)
        self._model = model
        self._n = int(model.nv)
        self._shape = (self._n,)
        self._tool_frame = tool_frame
        self._tool_id = frame_id(model, tool_frame)
        self._frame_ids: dict[str, int] = {}
        self._visual, self._collision = visual, collision
        self._workspace = _Workspace(self._model)
        M = self.mass_matrix(pin.neutral(self._model))
        if not np.isfinite(M).all():
            raise ValueError(f"{self.name!r}: its mass matrix is not finite: masses, lengths or inertias are too large")
        eigenvalues = np.linalg.eigvalsh(M)
        self._has_inertia = bool(eigenvalues[0] > self._n * np.finfo(float).eps * eigenvalues[-1])  # above rounding

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled as the model alone; meshes stay in their files, and the threads' workspaces stay behind."""
        return _remade, (type(self), self._model, self._tool_frame, self._visual, self._collision)

    def with_model(self, model: pin.Model) -> "Arm":
        """This arm's tool frame and looks on another model of the same joints and frames: other masses or limits, say."""
        return _remade(type(self), pin.Model(model), self._tool_frame, self._visual, self._collision)

    # What it is

    @property
    def model(self) -> pin.Model:
        """A copy of the `pinocchio.Model`, armature included: yours to change, this arm stays as it is."""
        return pin.Model(self._model)

    @property
    def visual_model(self) -> pin.GeometryModel | None:
        """A copy of the visual geometry, if the arm has one."""
        return (whole := self._visual.whole) and whole.copy()

    @property
    def collision_model(self) -> pin.GeometryModel | None:
        """A copy of the collision geometry, if the arm has one."""
        return (whole := self._collision.whole) and whole.copy()

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self._model.name

    @property
    def n(self) -> int:
        """Number of joints."""
        return self._n

    @property
    def tool_frame(self) -> str:
        """Name of the frame that Cartesian quantities belong to."""
        return self._tool_frame

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the n joints from base to tool."""
        return tuple(self._model.names)[1:]

    @property
    def lower(self) -> Vector:
        """(n,) lower joint limits, rad; -inf for none."""
        return self._model.lowerPositionLimit.copy()

    @property
    def upper(self) -> Vector:
        """(n,) upper joint limits, rad; inf for none."""
        return self._model.upperPositionLimit.copy()

    @property
    def velocity_limit(self) -> Vector:
        """(n,) rad/s"""
        return self._model.velocityLimit.copy()

    @property
    def effort_limit(self) -> Vector:
        """(n,) N m"""
        return self._model.effortLimit.copy()

    @property
    def armature(self) -> Vector:
        """(n,) kg m^2: reflected rotor inertia, part of the mass matrix."""
        return self._model.armature.copy()

    @property
    def damping(self) -> Vector:
        """(n,) N m s: viscous joint friction of the description. `Plant.from_description` has it; the arm itself moves freely."""
        return self._model.damping.copy()

    @property
    def friction(self) -> Vector:
        """(n,) N m: Coulomb joint friction of the description. `Plant.from_description` has it; the arm itself moves freely."""
        return self._model.upperDryFrictionLimit.copy()

    def __repr__(self) -> str:
        return f"<Arm {self.name!r}: {self.n} joints, tool frame {self.tool_frame!r}>"

    def random_configuration(self, rng: np.random.Generator, size: int | tuple[int, ...] = ()) -> Vector:
        """(*size, n) joint angles, uniform within the limits (within ±180° where there are none)."""
        lower = np.where(np.isfinite(self.lower), self.lower, -np.pi)
        upper = np.where(np.isfinite(self.upper), self.upper, np.pi)
        if not isinstance(rng, np.random.Generator):
            raise ValueError(
                f"rng: expected a numpy.random.Generator, such as numpy.random.default_rng(1), got {rng!r}"
            )
        shape = size if isinstance(size, tuple) else (size,)
        if not all(isinstance(k, int | np.integer) and k >= 0 for k in shape):
            raise ValueError(f"size: expected a whole number >= 0, or a tuple of them, got {size!r}")
        return rng.uniform(lower, upper, (*shape, self.n))

    # Kinematics

    def forward_kinematics(self, q: Vector, frame: str | None = None) -> Any:
        """T_base_tool as `pinocchio.SE3` [m] for q (n,); for a batch q (..., n), homogeneous matrices (..., 4, 4).

        ``frame`` names another frame of the arm in place of the tool.
        """
        q = self._angles(q)
        if q.ndim > 1:
            return self._batch(lambda x: self.forward_kinematics(x, frame).homogeneous, q, (4, 4))
        data, i = self._workspace.data, self._tool_id if frame is None else self._frame_id(frame)
        pin.forwardKinematics(self._model, data, q)
        return pin.updateFramePlacement(self._model, data, i)  # a copy, not a reference into data

    def frames(self, q: Vector) -> list[pin.SE3]:
        """The n joint frames in the base frame for q (n,): frames {1} to {n} of a modified D-H arm."""
        q = self.as_vector(q, "q")
        data = self._workspace.data
        pin.forwardKinematics(self._model, data, q)
        return [pin.SE3(data.oMi[i]) for i in range(1, self.n + 1)]

    def jacobian(self, q: Vector, frame: str | None = None) -> np.ndarray:
        """(..., 6, n) of the tool frame, linear rows [m] first, base axes, for q (..., n).

        ``frame`` names another frame of the arm in place of the tool.
        """
        q = self._angles(q)
        if q.ndim > 1:
            return self._batch(lambda x: self.jacobian(x, frame), q, (6, self.n))
        i = self._tool_id if frame is None else self._frame_id(frame)
        J = pin.computeFrameJacobian(self._model, self._workspace.data, q, i, pin.LOCAL_WORLD_ALIGNED)
        return J.reshape(6, self.n)  # Pinocchio hands back (6,) for one joint

    # Dynamics

    def mass_matrix(self, q: Vector) -> np.ndarray:
        """(n, n) kg m^2, symmetric, armature included."""
        return pin.crba(self._model, self._workspace.data, self.as_vector(q, "q"), pin.Convention.WORLD).copy()

    def gravity_torque(self, q: Vector) -> Vector:
        """(n,) N m: what the actuators must hold at rest."""
        return pin.computeGeneralizedGravity(
            self._model, self._workspace.data, self.as_vector(q, "q")
        )  # a copy already

    def bias_torque(self, q: Vector, v: Vector) -> Vector:
        """(n,) N m: C v + g."""
        return pin.nonLinearEffects(self._model, self._workspace.data, *self._vectors(("q", "v"), q, v)).copy()

    def coriolis_matrix(self, q: Vector, v: Vector) -> np.ndarray:
        """(n, n) N m s: C of C v, Pinocchio's choice, for which M_dot - 2 C is skew."""
        return pin.computeCoriolisMatrix(self._model, self._workspace.data, *self._vectors(("q", "v"), q, v)).copy()

    def forward_dynamics(self, q: Vector, v: Vector, tau: Vector) -> Vector:
        """(n,) rad/s^2: joint accelerations under joint torques tau (n,) N m."""
        q, v, tau = self._vectors(("q", "v", "tau"), q, v, tau)
        if not self._has_inertia:
            self._refuse_dynamics()
        return pin.aba(self._model, self._workspace.data, q, v, tau).copy()

    def inverse_dynamics(self, q: Vector, v: Vector, a: Vector) -> Vector:
        """(n,) N m: joint torques that give joint accelerations a (n,) rad/s^2."""
        q, v, a = self._vectors(("q", "v", "a"), q, v, a)
        return pin.rnea(self._model, self._workspace.data, q, v, a).copy()

    def energy(self, q: Vector, v: Vector) -> float:
        """J: kinetic (rotors included) plus potential energy, the latter zero at the base's height."""
        q, v = self._vectors(("q", "v"), q, v)
        return float(v @ self.mass_matrix(q) @ v / 2 + pin.computePotentialEnergy(self._model, self._workspace.data, q))

    def jacobian_time_variation(self, q: Vector, v: Vector) -> np.ndarray:
        """(6, n) dJ/dt of the tool frame along v, base axes."""
        (q, v), data = self._vectors(("q", "v"), q, v), self._workspace.data
        pin.computeJointJacobiansTimeVariation(self._model, data, q, v)
        pin.updateFramePlacement(self._model, data, self._tool_id)
        J_dot = pin.getFrameJacobianTimeVariation(self._model, data, self._tool_id, pin.LOCAL_WORLD_ALIGNED)
        return J_dot.reshape(6, self.n)

    def operational_space(self, q: Vector, v: Vector, damping: Damping | None = None) -> OperationalSpace:
        """Lambda, Phi, Gamma, J_bar of (39) at the tool, and what the null space adds; q, v (n,).

        x is the tool's position and rotation vector. ``damping`` says when, and how much, to damp near a singularity, by the
        smallest singular value of J; without it a singular posture is refused.

        Raises
        ------
        SingularJacobianError
            J without full row rank (always, for fewer than six joints), and no damping, or too little to act.
        """
        q, v = self._vectors(("q", "v"), q, v)
        if damping is not None and not isinstance(damping, Damping):
            raise ValueError(f"damping: expected a Damping or None, got {damping!r}")
        if not self._has_inertia:
            self._refuse_dynamics()
        model, data, tool = self._model, self._workspace.data, self._tool_id
        M = pin.crba(model, data, q, pin.Convention.WORLD)
        g = pin.computeGeneralizedGravity(model, data, q)
        C = pin.computeCoriolisMatrix(model, data, q, v)  # and on the way what the pose, J and J_dot are read off from
        J = pin.getFrameJacobian(model, data, tool, pin.LOCAL_WORLD_ALIGNED).reshape(6, self.n)
        sigma = singular_values(J)
        sigma_min = float(sigma[-1]) if self.n >= 6 else 0.0
        lam = damping.at(sigma_min) if damping else 0.0
        needed = SQUARED_RANK_TOLERANCE * float(sigma[0])
        if not np.hypot(sigma_min, lam) > needed:  # NaN is refused too
            raise SingularJacobianError(sigma_min, needed)
        J_dot = pin.getFrameJacobianTimeVariation(model, data, tool, pin.LOCAL_WORLD_ALIGNED).reshape(6, self.n)
        T = pin.updateFramePlacement(model, data, tool)
        x = np.concatenate([T.translation, pin.log3(T.rotation)])
        return operational_space(M, C, g, J, J_dot, x, v, sigma_min, lam)

    def _refuse_dynamics(self) -> None:
        raise ValueError(
            f"{self.name!r}: its mass matrix is singular (links without inertia, and no armature), so that forces give no "
            "accelerations; kinematics only"
        )

    # Arguments

    def _frame_id(self, name: str) -> int:
        if not isinstance(name, str) or name not in self._frame_ids:
            self._frame_ids[name] = frame_id(self._model, name, "frame")
        return self._frame_ids[name]

    def as_vector(self, x: Vector, name: str) -> Vector:
        """x as (n,) finite floats; `ValueError` says what `name` should have been."""
        if type(x) is not np.ndarray or x.dtype != float:
            x = as_floats(name, x, described(self._shape, UNITS.get(name, ""), True))
        # A finite sum means finite numbers, at a fifth of the cost of np.isfinite(x).all(); huge ones that overflow it are
        # looked at one by one.
        if x.shape != self._shape or not (math.isfinite(sum(x.tolist())) or all(map(math.isfinite, x.tolist()))):
            raise ValueError(f"{name}: expected {described(self._shape, UNITS.get(name, ''), True)}, got {_seen(x)}")
        return x

    def _vectors(self, names: tuple[str, ...], *vectors: Vector) -> tuple[Vector, ...]:
        """Each as (n,) finite floats; one look at all of them where they are that already."""
        total = 0.0
        for x in vectors:
            if type(x) is not np.ndarray or x.dtype != float or x.shape != self._shape:
                break
            total += sum(x.tolist())
        else:
            if math.isfinite(total):
                return vectors
        return tuple(self.as_vector(x, name) for x, name in zip(vectors, names, strict=True))

    def _angles(self, q: Vector) -> Vector:
        """q as (..., n) finite floats."""
        if type(q) is np.ndarray and q.ndim == 1:
            return self.as_vector(q, "q")
        expected = f"(..., {self.n}) finite numbers in rad"
        q = as_floats("q", q, expected)
        if q.ndim == 1:
            return self.as_vector(q, "q")
        if q.ndim == 0 or q.shape[-1] != self.n or not np.isfinite(q).all():
            raise ValueError(f"q: expected {expected}, got {_seen(q)}")
        return q

    def _batch(self, fun: Callable[[Vector], np.ndarray], q: Vector, shape: tuple[int, ...]) -> np.ndarray:
        out = np.empty((q.size // self.n, *shape))
        for k, one in enumerate(q.reshape(-1, self.n)):
            out[k] = fun(one)
        return out.reshape(*q.shape[:-1], *shape)


def _remade(kind: type[Arm], *parts: Any) -> Arm:
    """An arm from its parts, geometry as it is."""
    arm = kind.__new__(kind)
    arm._set(*parts)
    return arm


class _Workspace(threading.local):
    """Each thread's own `pinocchio.Data`: Pinocchio writes results into it, so no two threads may share one."""

    def __init__(self, model: pin.Model) -> None:
        self.data = model.createData()


def frame_id(model: pin.Model, name: str, argument: str = "tool_frame") -> int:
    """Index of the frame ``name``: the link of that name where a joint has it too.

    Raises
    ------
    ValueError
        No such frame; the message names the argument and lists the links.
    """
    if not isinstance(name, str):
        raise ValueError(f"{argument}: expected the name of a link or joint, got {shown(name)}")
    named = [i for i, frame in enumerate(model.frames) if frame.name == name]
    if not named:
        links = ", ".join(frame.name for frame in model.frames if frame.type == pin.BODY)
        raise ValueError(f"{argument}: no frame {name!r} in {model.name!r}, expected one of {links}")
    return next((i for i in named if model.frames[i].type == pin.BODY), named[0])


def _seen(x: Vector) -> str:
    return f"shape {x.shape}" if x.size > 12 else repr(x.tolist())
