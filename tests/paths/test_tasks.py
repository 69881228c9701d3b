"""Plans of tasks that leave part of the pose free, for arms of few joints and of many."""

import pickle
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from k1607_pin.kinematics.task import Task
from k1607_pin.paths.cartesian_plan import plan_poses
from k1607_pin.paths.follower import SingularPathError, TooFewJointsError

sys.path.insert(0, str(Path(__file__).parents[1]))
import few_joints

PLANS = [
    ("scara", Task("position")),
    ("three", Task("position")),
    ("five", Task("position")),
    ("five", Task("axis", (1.0, 0.0, 0.0))),
]


@pytest.mark.parametrize(("kind", "task"), PLANS, ids=str)
def test_few_joints_go_straight_to_their_goals(kind, task, tmp_path):
    arm, q0 = few_joints.load(kind, tmp_path), np.array(few_joints.POSTURES[kind])
    start, goal = (arm.forward_kinematics(q) for q in (q0, q0 + 0.05))
    plan = plan_poses(arm, [goal], q0, task=task)
    for t in np.linspace(0, plan.duration, 12):
        T, point = arm.forward_kinematics(plan.joints(t).position), plan(t)
        np.testing.assert_allclose(T.translation, point.position, atol=2e-7)
        across = np.cross(T.translation - start.translation, goal.translation - start.translation)
        np.testing.assert_allclose(across, 0, atol=1e-7)
        if task.name == "axis":
            np.testing.assert_allclose(T.rotation[:, 0], point.rotation[:, 0], atol=2e-7)
    if task.name == "axis":
        np.testing.assert_allclose(T.rotation[:, 0], goal.rotation[:, 0], atol=2e-7)
    np.testing.assert_allclose(T.translation, goal.translation, atol=2e-7)


@pytest.mark.parametrize("task", [Task("position"), Task("axis")], ids=str)
def test_joints_are_derivatives_of_each_other(arm, q0, task):
    """Along samples: the quintics join velocities and accelerations that the task's rows were solved for."""
    goal = arm.forward_kinematics(q0)
    goal = pin.SE3(
        goal.rotation @ pin.exp3(np.array([0.2, -0.1, 2.0])), goal.translation + np.array([0.03, 0.02, -0.04])
    )
    plan = plan_poses(arm, [goal], q0, task=task)
    h = 1e-5
    for t in np.linspace(0.1, 0.9, 9) * plan.duration:
        after, before, now = (plan.joints(t + s).position for s in (h, -h, 0.0))
        np.testing.assert_allclose((after - before) / (2 * h), plan.joints(t).velocity, atol=1e-6)
        T = arm.forward_kinematics(now)
        assert np.linalg.norm(T.translation - plan(t).position) < 2e-7
    if task.name == "axis":
        end = arm.forward_kinematics(plan.joints(plan.duration).position)
        np.testing.assert_allclose(end.rotation[:, 2], goal.rotation[:, 2], atol=2e-7)


@pytest.mark.parametrize(
    ("kind", "task", "advice"),
    [
        ("scara", "pose", 'pass task="position"'),
        ("scara", "axis", 'pass task="position"'),
        ("five", "pose", 'pass task="position" or task="axis"'),
        ("two", "position", "plan_joints"),
    ],
)
def test_too_few_joints_are_told_which_task_they_can_have(kind, task, advice, tmp_path):
    arm, q0 = few_joints.load(kind, tmp_path), np.array(few_joints.POSTURES[kind])
    with pytest.raises(TooFewJointsError, match=advice) as error:
        plan_poses(arm, [arm.forward_kinematics(q0 + 0.05)], q0, task=task)
    assert "singular" not in str(error.value)
    assert str(pickle.loads(pickle.dumps(error.value))) == str(error.value)


def test_a_task_of_its_own_is_singular_where_its_rows_are(tmp_path):
    """A SCARA stretched out cannot move its tool along the arm."""
    arm, q0 = few_joints.load("scara", tmp_path), np.array([0.3, 0.0, 0.05, 0.0])
    goal = arm.forward_kinematics(q0).translation * [0.9, 0.9, 1.0]
    with pytest.raises(SingularPathError, match="singular"):
        plan_poses(arm, [goal], q0, task="position")


def test_positions_may_stand_alone(arm, q0):
    p = arm.forward_kinematics(q0).translation
    plan = plan_poses(arm, [p + np.array([0.02, 0, 0]), p], q0, task="position")
    np.testing.assert_allclose(arm.forward_kinematics(plan.joints(plan.duration).position).translation, p, atol=2e-7)
