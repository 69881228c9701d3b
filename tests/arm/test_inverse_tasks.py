"""Inverse kinematics to positions and axes, for arms of any number of joints, in the turn nearest to the start."""

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import k1607_pin as k1607
from k1607_pin.arm.inverse import nearest_turn, pose_error
from k1607_pin.arm.reach import follow
from k1607_pin.kinematics.task import Task

sys.path.insert(0, str(Path(__file__).parents[1]))
import few_joints

GOALS = [
    ("scara", Task("position")),
    ("three", Task("position")),
    ("five", Task("position")),
    ("five", Task("axis", (1.0, 0.0, 0.0))),
]


@pytest.mark.parametrize(("kind", "task"), GOALS, ids=str)
def test_few_joints_reach_what_they_can_take(kind, task, tmp_path):
    arm = few_joints.load(kind, tmp_path)
    for q in arm.random_configuration(np.random.default_rng(4), 8):
        at = arm.forward_kinematics(q)
        turned = at.rotation if task.name == "axis" else np.eye(3)
        found = k1607.inverse_kinematics(arm, pin.SE3(turned, at.translation), task=task)
        assert found.converged
        assert np.abs(pose_error(at, arm.forward_kinematics(found.q), task)).max() < 2e-8
        assert found.sigma_min > 0


@pytest.mark.parametrize("task", ["position", Task("axis", (0.0, 1.0, 0.0))], ids=str)
def test_any_arm_leaves_free_what_the_task_leaves_free(arm, task):
    q = arm.random_configuration(np.random.default_rng(5))
    spin = pin.exp3(np.array([0, 2.0, 0]))
    at = arm.forward_kinematics(q)
    found = k1607.inverse_kinematics(arm, pin.SE3(at.rotation @ spin, at.translation), q, task=task)
    assert found.converged
    assert found.starts == 1
    np.testing.assert_allclose(found.q, q, atol=1e-7)  # nothing that counts has changed
    assert found.orientation_error < 1e-8


def test_a_position_may_stand_alone(reference):
    q = np.full(7, 0.3)
    p = reference.forward_kinematics(q).translation
    found = k1607.inverse_kinematics(reference, p + np.array([0.01, 0, 0]), q, task="position")
    assert found.converged
    np.testing.assert_allclose(reference.forward_kinematics(found.q).translation, p + np.array([0.01, 0, 0]), atol=1e-8)
    with pytest.raises(ValueError, match=r"target: expected .*, got shape \(3,\)"):
        k1607.inverse_kinematics(reference, p, q)


def test_no_joint_ends_a_needless_turn_away():
    """The UR5's limits are a turn either way, half a turn at the elbow: no joint may be nearer to the start by whole turns."""
    arm = k1607.load_example("ur5")
    rng = np.random.default_rng(0)
    for _ in range(60):
        q0, target = rng.uniform(-np.pi, np.pi, 6), arm.forward_kinematics(rng.uniform(-np.pi, np.pi, 6))
        found = k1607.inverse_kinematics(arm, target, q0)
        assert found.converged
        for other in (found.q + 2 * np.pi * k for k in (-2, -1, 1, 2)):
            allowed = (other >= arm.lower) & (other <= arm.upper)
            assert (~allowed | (np.abs(other - q0) >= np.abs(found.q - q0) - 1e-9)).all()
        assert (found.q >= arm.lower).all()
        assert (found.q <= arm.upper).all()


def test_turns_stay_within_limits_and_leave_prismatic_joints_alone(tmp_path):
    arm = few_joints.load("scara", tmp_path)  # +-2.8
    q = np.array([2.7, -2.0, 2.5, 0.1])
    np.testing.assert_array_equal(nearest_turn(arm, q, q - [6.0, 0, 6.3, 0]), q)
    ur5 = k1607.load_example("ur5")
    near = np.array([-3.0, 6.2, 0.0, 3.2, -6.0, 0.0])
    q = np.array([3.0, -0.1, 6.0, -3.1, 0.2, 3.1])
    expected = q + 2 * np.pi * np.array([-1, 1, -1, 1, -1, 0])
    np.testing.assert_allclose(nearest_turn(ur5, q, near), expected, atol=1e-15)


def test_a_path_is_followed_by_position_alone(tmp_path):
    from types import SimpleNamespace

    arm = few_joints.load("scara", tmp_path)
    q = np.array(few_joints.POSTURES["scara"])
    p = arm.forward_kinematics(q).translation
    followed = follow(
        arm, lambda t: SimpleNamespace(position=p + np.array([0, 0.05 * t, 0.02 * t])), None, q, 1.0, "position"
    )
    for t, posture in zip(followed.times, followed.postures, strict=True):
        np.testing.assert_allclose(
            arm.forward_kinematics(posture).translation, p + np.array([0, 0.05 * t, 0.02 * t]), atol=1e-6
        )
    assert followed.sigma_min.min() > 0.01


@pytest.mark.parametrize(
    "bad", [np.full(3, np.nan), np.full((4, 4), 1j), None, "here", np.eye(4) * [1, 1, 1, 1e300], [[1], [1, 2]]]
)
def test_targets_that_are_none(reference, bad):
    with pytest.raises(ValueError, match="target: expected"):
        k1607.inverse_kinematics(reference, bad)
    far = np.eye(4)
    far[0, 3] = 1e300
    with pytest.raises(ValueError, match="target: expected a position within"):
        k1607.inverse_kinematics(reference, far)
