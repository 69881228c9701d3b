"""Tasks: the rows of a pose that a goal means, by differences, at half turns, on floats and on symbols."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from k1607_pin.compiled.trace import trace
from k1607_pin.kinematics.task import AXIS, POSE, POSITION, Task, as_task, direction_error

TASKS = [POSE, POSITION, *(Task("axis", axis) for axis in "xyz")]
SEED = st.integers(0, 2**32 - 1)
H = 1e-6  # differences of this step are good to H^2 and to 1e-16 / H


@pytest.mark.parametrize("task", TASKS, ids=str)
@given(seed=SEED)
@settings(max_examples=10)
def test_the_jacobian_is_minus_the_error_s_derivative(arm, task, seed):
    rng = np.random.default_rng(seed)
    q, v = arm.random_configuration(rng), rng.uniform(-1, 1, arm.n)
    at = arm.forward_kinematics(q)
    J = task.jacobian(at.rotation, arm.jacobian(q))
    assert J.shape == (task.rows, arm.n)

    def error(step):
        T = arm.forward_kinematics(q + step * v)
        return task.error(T.translation, T.rotation, at.translation, at.rotation)

    np.testing.assert_allclose((error(H) - error(-H)) / (2 * H), -J @ v, atol=2e-9)


@pytest.mark.parametrize("task", TASKS, ids=str)
@given(seed=SEED)
@settings(max_examples=10)
def test_the_jacobian_s_rate_is_its_derivative(arm, task, seed):
    rng = np.random.default_rng(seed)
    q, v = arm.random_configuration(rng), rng.uniform(-1, 1, arm.n)

    def jacobian(q):
        return task.jacobian(arm.forward_kinematics(q).rotation, arm.jacobian(q))

    rate = task.jacobian_rate(arm.forward_kinematics(q).rotation, arm.jacobian(q), arm.jacobian_time_variation(q, v), v)
    np.testing.assert_allclose((jacobian(q + H * v) - jacobian(q - H * v)) / (2 * H), rate, atol=1e-8)


@pytest.mark.parametrize("task", TASKS, ids=str)
def test_the_wrench_is_the_transpose(task):
    rng = np.random.default_rng(1)
    R, J, force = pin.exp3(rng.normal(size=3)), rng.normal(size=(6, 7)), rng.normal(size=task.rows)
    np.testing.assert_allclose(J.T @ task.wrench(R, force), task.jacobian(R, J).T @ force, atol=1e-14)


@pytest.mark.parametrize("axis", "xyz")
@given(seed=SEED, angle=st.one_of(st.floats(1e-9, np.pi), st.floats(1e-12, 1e-3).map(lambda x: np.pi - x)))
@settings(max_examples=30)
def test_an_axis_error_is_the_smallest_turn_to_the_wanted_direction(axis, seed, angle):
    """Its length is 2 sin(angle/2); turning by it brings the axis where it is wanted, and the turn about it does not count."""
    rng, task, k = np.random.default_rng(seed), Task("axis", axis), "xyz".index(axis)
    R = pin.exp3(rng.normal(size=3))
    across = np.cross(R[:, k], rng.normal(size=3))
    turn = pin.exp3(angle * across / np.linalg.norm(across))
    wanted = turn @ R @ pin.exp3(rng.uniform(-3, 3) * np.eye(3)[k])
    error = task.error(np.zeros(3), R, np.zeros(3), wanted)[3:]
    i, j = (k + 1) % 3, (k + 2) % 3
    e = error[0] * R[:, i] + error[1] * R[:, j]  # base axes
    assert np.linalg.norm(e) == pytest.approx(2 * np.sin(angle / 2), rel=1e-6, abs=1e-15)
    turned = pin.exp3(e / np.linalg.norm(e) * 2 * np.arcsin(min(np.linalg.norm(e) / 2, 1.0))) @ R[:, k]
    np.testing.assert_allclose(turned, wanted[:, k], atol=1e-7)


@pytest.mark.parametrize("axis", "xyz")
def test_exact_half_turns_and_no_turn_are_numbers(axis):
    task, k = Task("axis", axis), "xyz".index(axis)
    for wanted, size in ((np.eye(3), 0.0), (2 * np.diag(np.eye(3)[(k + 1) % 3]) - np.eye(3), 2.0)):
        error = task.error(np.zeros(3), np.eye(3), np.zeros(3), wanted)[3:]
        assert np.linalg.norm(error) == size


def test_tiny_turns_keep_their_digits():
    np.testing.assert_allclose(direction_error(1e-200, 2e-9, 1.0), [-2e-9, 1e-200], rtol=1e-15)
    np.testing.assert_allclose(direction_error(1e-200, -1e-160, 1.0), [1e-160, 1e-200], rtol=1e-15)


@pytest.mark.parametrize("task", TASKS, ids=str)
def test_traced_equals_floats(task):
    def everything(p, R, p_d, R_d, J, J_dot, v):
        rows = task.error(p, R, p_d, R_d)
        rate = task.jacobian_rate(R, J, J_dot, v)
        return rows, task.jacobian(R, J), rate, task.rows_of(R, J @ v), task.wrench(R, rows)

    shapes = [(3,), (3, 3), (3,), (3, 3), (6, 5), (6, 5), (5,)]
    traced = trace(everything, "everything", shapes)
    rng = np.random.default_rng(2)
    turns = [np.eye(3), np.diag([1.0, -1, -1]), np.diag([-1.0, -1, 1]), pin.exp3(rng.normal(size=3))]
    for R_d in turns:
        p, p_d, J, J_dot, v = (rng.normal(size=shape) for shape in ((3,), (3,), (6, 5), (6, 5), (5,)))
        values = (p, turns[-1] if R_d is turns[-1] else np.eye(3), p_d, R_d, J, J_dot, v)
        for found, expected in zip(traced(*(x.ravel() for x in values)), everything(*values), strict=True):
            np.testing.assert_allclose(found.full().reshape(expected.shape), expected, atol=1e-14)


def test_names():
    assert as_task("position") == POSITION
    assert as_task("axis") == AXIS == Task("axis", "z")
    assert as_task(POSE) is POSE


@pytest.mark.parametrize("bad", ["", "Pose", 3, None, 1j, np.array(["pose"]), ["pose"], {}, np.nan])
def test_what_is_no_task_is_refused(bad):
    with pytest.raises(ValueError, match=r'task: expected "pose", "position" or "axis", got'):
        as_task(bad)


@pytest.mark.parametrize(
    ("kind", "axis"), [("axis", "w"), ("axis", 2), ("pose", "z"), ("position", ""), ("axis", ["z"])]
)
def test_an_axis_that_is_none_is_refused(kind, axis):
    with pytest.raises(ValueError, match="axis: expected"):
        Task(kind, axis)
