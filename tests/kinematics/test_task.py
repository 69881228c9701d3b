"""What part of a pose a goal means: error and rows agree with finite differences, at half turns and as symbols."""

import numpy as np
import pinocchio as pin
import pytest

from k1607_pin.compiled.trace import trace
from k1607_pin.kinematics.task import POSE, POSITION, Task, task_of

AXES = [Task("axis"), Task("axis", (1.0, 0.0, 0.0)), Task("axis", (0.3, -2.0, 0.5))]
SHAPES = [(3,), (3, 3), (3,), (3, 3), (6, 5)]
TASKS = [POSE, POSITION, *AXES]


def pose(rng):
    return rng.normal(size=3), pin.exp3(rng.normal(size=3))


@pytest.mark.parametrize("task", TASKS, ids=str)
def test_the_error_s_derivative_is_minus_the_rows_where_it_is_zero(task):
    rng = np.random.default_rng(1)
    h = 1e-5  # rounding / h = 1e-11, h^2 = 1e-10
    for _ in range(5):
        p, R = pose(rng)
        np.testing.assert_allclose(task.error(p, R, p, R), np.zeros(task.size), atol=1e-15)
        x = rng.normal(size=(6, 4))
        for k in range(4):
            ends = [task.error(p, R, p + s * h * x[:3, k], pin.exp3(s * h * x[3:, k]) @ R) for s in (1, -1)]
            np.testing.assert_allclose((ends[0] - ends[1]) / (2 * h), -task.rows(x, R)[:, k], atol=1e-8)


@pytest.mark.parametrize("task", AXES, ids=str)
@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.5, np.pi / 2, 3.0, np.pi - 1e-9, np.pi])
def test_an_axis_s_error_is_twice_the_sine_of_half_the_angle_and_a_turn_by_it_arrives(task, angle):
    rng = np.random.default_rng(2)
    p, R = pose(rng)
    a = np.array(task.axis)
    normal = np.cross(a, rng.normal(size=3))
    normal /= np.linalg.norm(normal)
    wanted = R @ pin.exp3(angle * normal) @ pin.exp3(1.3 * a)  # what it turns about the axis is free
    turn = task.error(p, wanted, p, R)[3:]
    assert np.linalg.norm(turn) == pytest.approx(2 * np.sin(angle / 2), abs=1e-14)
    size = np.linalg.norm(turn)
    if size:
        B = np.array(task._frame[1:])
        reached = R @ pin.exp3(angle * (B.T @ turn) / size)
        np.testing.assert_allclose(reached @ a, wanted @ a, atol=1e-7 if abs(angle - np.pi) < 1e-6 else 1e-12)


def test_a_pose_s_error_is_that_of_eq_37_at_a_half_turn_too():
    R = pin.exp3(np.array([0.0, np.pi, 0.0]))
    np.testing.assert_allclose(
        np.abs(POSE.error(np.zeros(3), R, np.zeros(3), np.eye(3))), [0, 0, 0, 0, 2, 0], atol=1e-15
    )


@pytest.mark.parametrize("task", TASKS, ids=str)
def test_on_symbols_it_is_what_it_is_on_numbers(task):
    rng = np.random.default_rng(3)
    arguments = [*pose(rng), *pose(rng), rng.normal(size=(6, 5))]
    p_d, R_d, p, R, J = arguments
    for wanted, here in (
        (R_d, R),
        (np.eye(3), np.eye(3)),
        (np.diag([1.0, -1.0, -1.0]), np.eye(3)),
    ):  # off, there, opposite
        f = trace(lambda *x: (task.error(*x[:4]), task.rows(x[4], x[3]), task.rows(x[4][:, 0], x[3])), "f", SHAPES)
        e, rows, column = (np.array(x) for x in f(*(np.ravel(x) for x in (p_d, wanted, p, here, J))))
        np.testing.assert_allclose(e.ravel(), task.error(p_d, wanted, p, here), atol=1e-14)
        np.testing.assert_allclose(rows.reshape(task.size, 5), task.rows(J, here), atol=1e-14)
        np.testing.assert_allclose(column.ravel(), task.rows(J[:, 0], here), atol=1e-14)


@pytest.mark.parametrize("task", TASKS, ids=str)
def test_batches_of_poses_are_their_rows(task):
    rng = np.random.default_rng(4)
    many = [[np.array(x) for x in zip(*[pose(rng) for _ in range(3)], strict=True)] for _ in range(2)]
    all_at_once = task.error(*many[0], *many[1])
    for k in range(3):
        one = task.error(*(x[k] for x in many[0]), *(x[k] for x in many[1]))
        np.testing.assert_array_equal(all_at_once[k], one)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("orientation",), "task: expected 'pose', 'position' or 'axis'"),
        ((None,), "task: expected"),
        (("axis", (0, 0, 0)), "axis: expected the direction"),
        (("axis", (0, 0, np.nan)), "axis: expected"),
        (("axis", (0, 1)), "axis: expected"),
        (("pose", (0, 0, 1)), "axis: expected none"),
    ],
)
def test_what_is_no_task_is_refused_by_name(arguments, words):
    with pytest.raises(ValueError, match=words):
        Task(*arguments)


def test_a_name_is_a_task_and_tiny_axes_have_a_direction():
    assert task_of("position") is not None
    assert task_of("position") == POSITION
    assert task_of(POSE) is POSE
    assert Task("axis", (0, 0, 1e-200)) == Task("axis") == task_of("axis")
    assert [task.size for task in (POSE, POSITION, Task("axis"))] == [6, 3, 5]
