"""Inverse kinematics: reaches what the arm can reach, says so when it cannot."""

import numpy as np
import pinocchio as pin
import pytest

import k1607_pin as k1607
from k1607_pin.arm.inverse import inverse_kinematics, pose_error


def test_reaches_every_pose_that_the_arm_can_take(arm):
    rng = np.random.default_rng(3)
    for q in arm.random_configuration(rng, 12):
        target = arm.forward_kinematics(q)
        found = inverse_kinematics(arm, target)
        assert found.converged
        assert np.linalg.norm(pose_error(target, arm.forward_kinematics(found.q))) < 2e-8
        assert (found.q >= arm.lower).all()
        assert (found.q <= arm.upper).all()


def test_stays_near_its_start(arm):
    q = 0.5 * (np.maximum(arm.lower, -np.pi) + np.minimum(arm.upper, np.pi)) + 0.3
    found = inverse_kinematics(arm, arm.forward_kinematics(q + 0.01), q0=q)
    assert found.converged
    assert found.starts == 1
    assert np.abs(found.q - q).max() < 0.1


def test_reports_the_limit_that_keeps_it_from_the_target():
    arm = k1607.load_k1607()
    beyond = arm.upper.copy()
    beyond[1] += 0.3  # joint 2 past its limit: this very posture is not allowed, and the reach leaves no other
    beyond[[0, 2, 4, 6]] = 0
    beyond[3] = beyond[5] = 0.4
    found = inverse_kinematics(arm, arm.forward_kinematics(beyond), q0=np.clip(beyond, arm.lower, arm.upper), starts=1)
    assert not found.converged
    assert "joint2 upper" in found.at_limit


def test_out_of_reach_gives_the_closest_it_came():
    arm = k1607.load_k1607()
    found = inverse_kinematics(arm, pin.SE3(np.eye(3), np.array([4.0, 0, 0])), starts=2)
    assert not found.converged
    assert found.starts == 2
    actual = arm.forward_kinematics(found.q)
    assert found.position_error == pytest.approx(np.linalg.norm(actual.translation - [4.0, 0, 0]), rel=1e-12)
    # two links of 27 in and the offsets reach 1.6 m at the very most
    assert 4.0 - 1.7 < found.position_error < 4.0


@pytest.mark.parametrize(
    ("target", "words"),
    [
        (np.zeros((4, 4)), "rigid transform"),
        (np.diag([1.0, 1, -1, 1]), "rigid transform"),
        (np.full((4, 4), np.nan), "finite"),
        (np.eye(3), r"\(3, 3\)"),
    ],
)
def test_refuses_what_is_no_pose(target, words):
    with pytest.raises(ValueError, match=words):
        inverse_kinematics(k1607.load_k1607(), target)


def test_refuses_a_bad_start():
    arm = k1607.load_k1607()
    with pytest.raises(ValueError, match=r"q0: expected \(7,\)"):
        inverse_kinematics(arm, np.eye(4), q0=np.zeros(6))
    with pytest.raises(ValueError, match="starts"):
        inverse_kinematics(arm, np.eye(4), starts=0)
