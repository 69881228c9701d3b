"""An arm's kinematics, dynamics and operational space as functions to export, known from Pinocchio at random states."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from k1607_pin.arm.arm import Arm
from k1607_pin.compiled.export.function import Argument, Case, Field, Function
from k1607_pin.compiled.export.known import completed
from k1607_pin.compiled.program import program
from k1607_pin.compiled.trace import trace
from k1607_pin.compiled.traced_arm import TracedArm
from k1607_pin.kinematics.differential import SingularJacobianError

CASES = 5
CLEAR = 0.05
"""Smallest singular value of J over the largest, at the states of the cases: near a singularity rounding grows as the inverse
square."""


TRIED = 100  # postures


class _Kind(NamedTuple):
    says: str
    takes: str
    """Names of `_inputs`"""
    gives: tuple[tuple[str, tuple[Any, ...], str, str], ...]
    """Name, shape ("n" for the number of joints), unit, what it is"""
    of: Callable[..., tuple[Any, ...]]
    """Of an `Arm` or a `TracedArm`"""


def _pose(arm: Any, q: Any) -> tuple[Any, ...]:
    T = arm.forward_kinematics(q)
    return T.translation, T.rotation


def _space(arm: Any, q: Any, v: Any) -> tuple[Any, ...]:
    s = arm.operational_space(q, v)
    return s.Lambda, s.Phi, s.Gamma, s.jacobian_bar, s.bias_nullspace, s.gravity


TORQUE = ("n",), "N m (N)"
KINDS = {
    "forward_kinematics": _Kind(
        "Pose of the tool in the base, (3).",
        "q",
        (
            ("position", (3,), "m", "of the tool's origin, base axes"),
            ("rotation", (3, 3), "1", "tool in base: its columns are the tool's axes"),
        ),
        _pose,
    ),
    "jacobian": _Kind(
        "x_dot = J v of the tool, (20).",
        "q",
        (("J", (6, "n"), "m, 1", "linear rows first, base axes"),),
        lambda arm, q: (arm.jacobian(q),),
    ),
    "mass_matrix": _Kind(
        "Joint-space mass matrix, rotor inertia included.",
        "q",
        (("M", ("n", "n"), "kg m^2", "symmetric"),),
        lambda arm, q: (arm.mass_matrix(q),),
    ),
    "gravity_torque": _Kind(
        "What holds the arm at rest.",
        "q",
        (("torque", *TORQUE, "g(q)"),),
        lambda arm, q: (arm.gravity_torque(q),),
    ),
    "bias_torque": _Kind(
        "Coriolis, centrifugal and gravity torque.",
        "q v",
        (("torque", *TORQUE, "C(q, v) v + g(q)"),),
        lambda arm, q, v: (arm.bias_torque(q, v),),
    ),
    "inverse_dynamics": _Kind(
        "The torque for an acceleration.",
        "q v a",
        (("torque", *TORQUE, "M(q) a + C(q, v) v + g(q)"),),
        lambda arm, q, v, a: (arm.inverse_dynamics(q, v, a),),
    ),
    "forward_dynamics": _Kind(
        "The acceleration under a torque.",
        "q v torque",
        (("a", ("n",), "rad/s^2 (m/s^2)", "M^-1 (torque - C v - g)"),),
        lambda arm, q, v, tau: (arm.forward_dynamics(q, v, tau),),
    ),
    "operational_space": _Kind(
        "Dynamics at the tool, F = Lambda x_ddot + Phi x_dot + Gamma x, (39); x is position and rotation vector.\n"
        "Singular postures are not looked for: near one the numbers grow without bound.",
        "q v",
        (
            ("Lambda", (6, 6), "kg, kg m, kg m^2", "Cartesian mass matrix (J M^-1 J^T)^-1"),
            ("Phi", (6, 6), "kg/s, ...", "Coriolis and centrifugal"),
            ("Gamma", (6, 6), "N/m, ...", "with Gamma x = gravity, of least norm"),
            ("J_bar", ("n", 6), "1/m, 1", "M^-1 J^T Lambda, dynamically consistent inverse of J"),
            ("bias_nullspace", (6,), "N, N m", "what motion in the null space adds to F"),
            ("gravity", (6,), "N, N m", "J_bar^T g: what the tool must be held with"),
        ),
        _space,
    ),
}
FUNCTIONS = tuple(KINDS)


def arm_functions(arm: Arm, names: Sequence[str] | None) -> list[Function]:
    """Those asked for; None for all that the arm has.

    Raises
    ------
    ValueError
        A name that there is not, or something that this arm does not have: an operational space with fewer than six joints.
    """
    for name in names or ():
        if name not in KINDS:
            raise ValueError(f"functions: expected some of {', '.join(FUNCTIONS)}, got {name!r}")
    states = _states(arm)
    made = []
    for name in FUNCTIONS if names is None else names:
        try:
            made.append(_function(arm, name, states))
        except (ValueError, SingularJacobianError) as error:
            if names is not None:
                raise ValueError(f"functions: {arm.name!r} has no {name}: {error}") from None
    return made


def inputs_of(arm: Arm) -> dict[str, Field]:
    """q, v and the like."""
    n = (arm.n,)
    return {
        "q": Field("q", n, "rad (m)", "joint positions"),
        "v": Field("v", n, "rad/s (m/s)", "joint velocities"),
        "a": Field("a", n, "rad/s^2 (m/s^2)", "joint accelerations"),
        "torque": Field("torque", n, "N m (N)", "joint torques"),
    }


def clear_posture(arm: Arm, rng: np.random.Generator) -> np.ndarray:
    """(n,) within the limits, and away from singularities, as far as the arm has such postures."""
    tried = arm.random_configuration(rng, TRIED)
    sigma = np.linalg.svd(arm.jacobian(tried), compute_uv=False)
    return tried[np.argmax(sigma[:, -1] > min(CLEAR, 0.5 * np.max(sigma[:, -1] / sigma[:, 0])) * sigma[:, 0])]


def _states(arm: Arm) -> list[dict[str, np.ndarray]]:
    rng = np.random.default_rng(1607)
    scale = {"v": 1.0, "a": 5.0, "torque": 20.0}
    return [
        {"q": clear_posture(arm, rng), **{name: s * rng.normal(size=arm.n) for name, s in scale.items()}}
        for _ in range(CASES)
    ]


def _function(arm: Arm, name: str, states: Sequence[dict[str, np.ndarray]]) -> Function:
    kind, there = KINDS[name], inputs_of(arm)
    takes = kind.takes.split()
    inputs: list[Argument] = [there[key] for key in takes]
    outputs = tuple(
        Field(key, tuple(arm.n if k == "n" else k for k in shape), unit, says) for key, shape, unit, says in kind.gives
    )
    cases = []
    for state in states:
        given = [state[key] for key in takes]
        cases.append(Case(np.concatenate(given), np.concatenate([np.ravel(x) for x in kind.of(arm, *given)])))
    traced = TracedArm(arm)
    f = trace(lambda *x: tuple(np.reshape(out, (-1,)) for out in kind.of(traced, *x)), name, [(arm.n,)] * len(takes))
    return completed(Function(name, kind.says, tuple(inputs), outputs, program(f), cases))
