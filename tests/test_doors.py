"""Every public function, given what does not fit, answers with an error of ours that names the argument: never a foreign message,
never NaN, never nothing at all."""

import inspect
import types
from typing import Any

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.arm import inverse, reach, ready
from k1607_pin.description.dh import table_1
from k1607_pin.kinematics import closed_form, differential, nullspace, orientation, product, singularities, task
from k1607_pin.paths import cartesian_plan, inverse_path

Q, J, R = np.full(7, 0.3), closed_form.jacobian(np.full(7, 0.3)), np.eye(3)
UNIT = np.array([1.0, 0, 0, 0])


class Unreadable:
    """An object of no kind, whose text is broken too."""

    def __repr__(self) -> str:
        raise RuntimeError("foreign words")


def bad(good: Any) -> dict[str, Any]:
    """Ten kinds of what does not fit where ``good`` does."""
    x = np.asarray(good, dtype=float)
    masked = np.ma.masked_array(x, mask=np.ones(x.shape, dtype=bool))
    return {
        "NaN": np.full(x.shape, np.nan),
        "infinite": np.full(x.shape, -np.inf),
        "complex": x + 1j,
        "masked": masked,
        "shape": np.zeros((*x.shape, 11)),
        "empty": np.zeros(0),
        "text": "text",
        "objects": np.full(x.shape, None),
        "ragged": [[1.0], [2.0, 3.0]],
        "of no kind": Unreadable(),
    }


NO_NUMBERS = {
    "nothing": None,
    "a number": 1j,
    "NaN": np.nan,
    "text": "text",
    "a list": [1.0],
    "of no kind": Unreadable(),
}


def arm() -> k1607.Arm:
    return k1607.load_k1607()


POSE = np.block([[np.eye(3), np.array([[0.5], [0.1], [0.4]])], [np.zeros((1, 3)), np.ones((1, 1))]])

NUMERIC: dict[str, tuple[Any, dict[str, Any]]] = {
    "closed_form.forward_kinematics": (closed_form.forward_kinematics, {"q": Q}),
    "closed_form.jacobian": (closed_form.jacobian, {"q": Q}),
    "product.forward_kinematics": (lambda q: product.forward_kinematics(table_1(), q), {"q": Q}),
    "product.jacobian": (lambda q: product.jacobian(table_1(), q), {"q": Q}),
    "singularities.residuals": (singularities.residuals, {"q": Q}),
    "differential.weighted_pseudo_inverse": (differential.weighted_pseudo_inverse, {"J": J, "W": np.ones(7)}),
    "differential.nullspace_projector": (differential.nullspace_projector, {"J": J, "W": np.eye(7)}),
    "differential.jacobian_derivative": (differential.jacobian_derivative, {"J": J}),
    "differential.joint_velocity": (
        differential.joint_velocity,
        {"J": J, "x_dot": np.ones(6), "z": np.ones(7), "W": np.ones(7)},
    ),
    "differential.Damping": (differential.Damping, {"threshold": 0.1, "maximum": 0.1}),
    "differential.Damping.at": (differential.Damping().at, {"sigma_min": 0.1}),
    "nullspace.limit_centring": (nullspace.limit_centring, {"q": Q, "lower": -Q, "upper": 2 * Q, "gain": 1.0}),
    "nullspace.preferred_posture": (nullspace.preferred_posture, {"q": Q, "posture": -Q, "gain": 1.0}),
    "nullspace.manipulability": (nullspace.manipulability, {"J": J}),
    "nullspace.manipulability_ascent": (nullspace.manipulability_ascent, {"J": J, "gain": 1.0}),
    **{
        f"orientation.{name}": (getattr(orientation, name), {"R": R})
        for name in ("quaternion_by_division", "quaternion", "rotation_vector", "differential_rotation")
    },
    **{f"orientation.{name}": (getattr(orientation, name), {"quaternion": UNIT}) for name in ("rotation", "conjugate")},
    **{
        f"orientation.{name}": (getattr(orientation, name), {"first": UNIT, "second": UNIT})
        for name in ("product", "relative_quaternion_base", "relative_quaternion_body")
    },
    "orientation.cross_matrix": (orientation.cross_matrix, {"s": np.ones(3)}),
    "orientation.orientation_error": (orientation.orientation_error, {"R_desired": R, "R": R}),
    "inverse_kinematics": (
        lambda **x: k1607.inverse_kinematics(arm(), **{"target": POSE, "starts": 1, **x}),
        {"target": POSE, "q0": Q, "position_tolerance": 1e-8, "orientation_tolerance": 1e-8, "starts": 1, "seed": 0},
    ),
    "reach.follow": (
        lambda **x: reach.follow(arm(), lambda t: None, R, **{"q": Q, "duration": 1.0, **x}),
        {"q": Q, "duration": 1.0},
    ),
    "ready.ready_postures": (lambda **x: ready.ready_postures(arm(), **x), {"tries": 2, "seed": 0}),
    "plan_poses": (
        lambda **x: cartesian_plan.plan_poses(arm(), [x.pop("poses", POSE)], **{"q0": Q, **x}),
        {"poses": POSE, "q0": Q},
    ),
    "Arm.forward_kinematics": (lambda q: arm().forward_kinematics(q), {"q": Q}),
    "Arm.jacobian": (lambda q: arm().jacobian(q), {"q": Q}),
    "Arm.mass_matrix": (lambda q: arm().mass_matrix(q), {"q": Q}),
    "Arm.bias_torque": (lambda q=Q, v=Q: arm().bias_torque(q, v), {"q": Q, "v": Q}),
    "Arm.forward_dynamics": (
        lambda q=Q, v=Q, tau=Q: arm().forward_dynamics(q, v, tau),
        {"q": Q, "v": Q, "tau": Q},
    ),
    "Arm.operational_space": (lambda q=Q, v=Q: arm().operational_space(q, v), {"q": Q, "v": Q}),
}
"""Doors and what fits there, by the argument's name."""

WORDS: dict[str, tuple[Any, str]] = {
    "Task": (task.Task, "task"),
    "task_of": (task.task_of, "task"),
    "Task.axis": (lambda x: task.Task("axis", x if x is not None else ""), "axis"),
    "inverse_kinematics.arm": (lambda x: k1607.inverse_kinematics(x, POSE), "arm"),
    "inverse_kinematics.task": (lambda x: k1607.inverse_kinematics(arm(), POSE, task=x), "task"),
    "follow.arm": (lambda x: reach.follow(x, lambda t: None, R, Q, 1.0), "arm"),
    "ready_postures.arm": (ready.ready_postures, "arm"),
    "plan_poses.arm": (lambda x: cartesian_plan.plan_poses(x, [POSE], Q), "arm"),
    "plan_poses.task": (lambda x: cartesian_plan.plan_poses(arm(), [POSE], Q, task=x), "task"),
    "joint_path.task": (lambda x: inverse_path.joint_path(arm(), lambda t: None, Q, 1.0, task=x), "task"),
    "product.table": (lambda x: product.forward_kinematics(x, Q), "table"),
    "weighted_pseudo_inverse.damping": (
        lambda x: differential.weighted_pseudo_inverse(J, damping="" if x is None else x),
        "damping",
    ),
}
"""Doors that want no numbers."""

ELSEWHERE = {
    "CartesianAdaptive", "Drawn", "Entries", "Grid", "Integers", "Listed", "LogUniform", "Normal", "Payload", "Plant",
    "Scaled", "Uniform", "Wrench", "batch", "export", "load_example", "load_k1607", "load_urdf", "rollout",
    "rollouts", "simulate", "sweep", "tune", "with_payload",
}  # fmt: skip
"""Looked at in the tests of their own rooms."""
RESULTS = {"Arm", "InverseKinematics", "NotFiniteError", "SimulationError", "TracingError", "Tuned"}
"""Made by functions, not by users; `Arm`'s methods are doors above."""
FORMULAS = {
    "closed_form": {"parameters", "terms", "transform", "jacobian_columns", "Parameters", "Terms"},
    "differential": {"SingularJacobianError", "PseudoInverse", "JointVelocity"},
    "nullspace": set(),
    "orientation": {"finite", "rotation_matrix", "quaternion_numbers", "small_rotation", "triple"},
    "singularities": {"Family"},
    "product": {
        "Links",
        "cosines_and_sines",
        "frame_transforms",
        "geometric_jacobian",
        "axis_and_lever",
        "joint_angles",
    },
    "inverse": {"InverseKinematics", "newton", "pose_error", "nearest_turn", "sigma_min_of", "require_arm", "rigid"},
    "reach": {"UnreachableError", "Followed", "rotation_of"},
    "ready": set(),
}
"""Inner functions, which trust their callers, and results."""


def is_ours(error: BaseException, *names: str) -> bool:
    """A message that names an argument and then says what was expected."""
    before, _, after = str(error).partition("expected")
    return bool(after) and any(name in before for name in names)


CASES = [(door, name, kind) for door, (_, fits) in NUMERIC.items() for name in fits for kind in bad(0.0)]


@pytest.mark.parametrize(("door", "name", "kind"), CASES)
def test_what_does_not_fit_is_named(door, name, kind):
    function, fits = NUMERIC[door]
    # of vectors that differ in length either may be named
    names = (*fits,) if kind == "empty" else (name,)
    if kind == "infinite" and name in ("lower", "upper"):
        pytest.skip("a joint without limits")
    wrong = bad(fits[name])[kind]
    with pytest.raises(ValueError, match="expected") as error:
        function(**{**fits, name: wrong})
    assert is_ours(error.value, *names), error.value


@pytest.mark.parametrize("door", NUMERIC)
def test_what_fits_passes(door):
    function, fits = NUMERIC[door]
    if door in ("reach.follow", "plan_poses"):
        pytest.skip("a path of its own test")
    function(**fits)
    for name, good in fits.items():
        if np.ndim(good):
            function(**{**fits, name: np.asarray(good).tolist()})


@pytest.mark.parametrize("kind", NO_NUMBERS)
@pytest.mark.parametrize("door", WORDS)
def test_what_is_no_such_thing_is_named(door, kind):
    function, name = WORDS[door]
    with pytest.raises(ValueError, match="expected") as error:
        function(NO_NUMBERS[kind])
    assert is_ours(error.value, name), error.value


def test_nothing_public_is_left_out():
    known = {door.partition(".")[0] for door in (*NUMERIC, *WORDS)} | ELSEWHERE | RESULTS
    assert set(k1607.__all__) <= known
    modules = (closed_form, differential, nullspace, orientation, singularities, product, inverse, reach, ready)
    for module in modules:
        short = module.__name__.rpartition(".")[2]
        for name, x in vars(module).items():
            callable_here = isinstance(x, types.FunctionType | type) and inspect.getmodule(x) is module
            if callable_here and not name.startswith("_") and name not in FORMULAS[short]:
                assert any(door.endswith(name) for door in NUMERIC), f"{short}.{name}"


class TestLapackIsOutOfReach:
    """Of numbers that are not finite it looks for singular values without end."""

    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
    @pytest.mark.parametrize("entry", [(0, 0), (3, 2), (5, 6)])
    def test_one_entry(self, value, entry):
        broken = J.copy()
        broken[entry] = value
        for function in (nullspace.manipulability_ascent, nullspace.manipulability, differential.nullspace_projector):
            with pytest.raises(ValueError, match="J: expected"):
                function(broken)

    @pytest.mark.parametrize("function", [differential.weighted_pseudo_inverse, differential.nullspace_projector])
    def test_a_product_that_overflows(self, function):
        with pytest.raises(ValueError, match=r"J W\^\(1/2\): expected"):
            function(1e200 * J, np.full(7, 1e300))

    def test_singular_values_of_what_is_not_finite(self):
        from k1607_pin.dynamics.operational_space import singular_values

        for value in (np.nan, np.inf):
            broken = J.copy()
            broken[2, 3] = value
            assert np.isnan(singular_values(broken)).all()
        np.testing.assert_allclose(singular_values(1e200 * J), 1e200 * np.linalg.svd(J, compute_uv=False), rtol=1e-13)

    @pytest.mark.parametrize("scale", [2.0**600, 2.0**-600])
    def test_a_pseudo_inverse_of_any_size(self, scale):
        """Of J a condition of 1e3, so that 1e-16 may grow to 1e-13."""
        exact = differential.weighted_pseudo_inverse(J).matrix / scale
        found = differential.weighted_pseudo_inverse(scale * J).matrix
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-12 * np.abs(exact).max())


def test_manipulability_of_fewer_joints_than_rows_is_that_of_a_singular_matrix():
    assert nullspace.manipulability(J[:, :5]) == 0.0
    assert nullspace.manipulability(J[:3, :5]) == pytest.approx(np.sqrt(np.linalg.det(J[:3, :5] @ J[:3, :5].T)))


def test_joints_without_a_range_are_not_centred():
    z = nullspace.limit_centring(np.array([0.3, 0.5]), np.array([0.3, -1.0]), np.array([0.3, 1.0]))
    np.testing.assert_allclose(z, [0.0, -0.5])


BAD_NUMBERS = [np.nan, np.inf, 1j, None, "abc", [], object(), [[1, 2], [3]], {}, np.ma.masked]


@pytest.mark.parametrize("bad", BAD_NUMBERS)
@pytest.mark.parametrize(
    ("distribution", "bounds"),
    [
        (k1607.Uniform, {"lower": 0.0, "upper": 1.0}),
        (k1607.LogUniform, {"lower": 1.0, "upper": 2.0}),
        (k1607.Normal, {"mean": 0.0, "sigma": 1.0}),
        (k1607.Integers, {"lower": 0, "upper": 9}),
    ],
)
def test_distributions(distribution, bounds, bad):
    for name in bounds:
        with pytest.raises(ValueError, match=f"^{name}: expected "):
            distribution(**(bounds | {name: bad}))


def test_distributions_that_are_none():
    with pytest.raises(ValueError, match="lower < upper"):
        k1607.Uniform([0.0, 2.0], 1.0)
    with pytest.raises(ValueError, match="one shape"):
        k1607.Uniform(np.zeros(2), np.ones(3))
    with pytest.raises(ValueError, match="sigma: expected positive"):
        k1607.Normal(0.0, -1.0)
    with pytest.raises(ValueError, match="upper: expected whole"):
        k1607.Integers(0, 2.5)


@pytest.mark.parametrize("bad", BAD_NUMBERS)
def test_whose_payload(bad):
    with pytest.raises(ValueError, match=r"^arm: expected an Arm"):
        k1607.with_payload(bad, k1607.Payload(1.0))


@pytest.mark.parametrize("bad", [5, [], {}, np.zeros(3), ["a"]])
def test_whose_tool(bad):
    with pytest.raises(ValueError, match=r"^tool_frame: expected the name of a link or joint, got"):
        k1607.load_example("ur5", tool_frame=bad)


@pytest.mark.parametrize("size", [1e-320, 1e-200, 1e200, 1e308])
def test_jacobians_whose_products_are_no_numbers(size):
    with pytest.raises(ValueError, match=r"^J: expected"):
        nullspace.manipulability_ascent(size * J / np.abs(J).max())
    if size > 1:
        with pytest.raises(ValueError, match=r"^J: expected entries up to"):
            nullspace.manipulability(size * J / np.abs(J).max())
