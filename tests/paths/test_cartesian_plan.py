"""Plans from pose to pose: straight, turning about one axis, within limits, as the arm can follow, or refused."""

import pickle

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import k1607_pin as k1607
from k1607_pin.arm.reach import UnreachableError
from k1607_pin.kinematics.orientation import rotation_vector
from k1607_pin.paths.cartesian_plan import ANGULAR, LINEAR, PosePath, plan_poses
from k1607_pin.paths.follower import SingularPathError
from k1607_pin.paths.joint_plan import JointLimitError
from k1607_pin.paths.slow_down import OverloadError
from k1607_pin.paths.spline import joined
from k1607_pin.paths.timing import Limits, fastest

Q0 = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])


def near(arm, q0, seed, most=0.3):
    """One to three poses that postures around q0 have."""
    rng = np.random.default_rng(seed)
    return [arm.forward_kinematics(q0 + rng.uniform(-most, most, arm.n)) for _ in range(int(rng.integers(1, 4)))]


def any_path(seed):
    """Anywhere, whole turns of the wrist included; without an arm."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 4))
    turns = rng.normal(size=(m + 1, 3))
    turns *= rng.uniform(0, np.pi, (m + 1, 1)) / np.linalg.norm(turns, axis=1, keepdims=True)
    rotations = np.array([pin.exp3(turn) for turn in turns])
    still = np.zeros(1)
    stretches = [
        fastest(np.array([k]), np.array([k + 1.0]), still, still, Limits(*rng.uniform(1, 3, 3))) for k in range(m)
    ]
    return PosePath(rng.uniform(-1, 1, (m + 1, 3)), rotations, joined(stretches))


def assert_belongs_together(path, clear_of):
    """Velocities and accelerations, linear and angular, by central differences of step 1e-5 s."""
    t, h = clear_of(path.times, path.duration), 1e-5
    here, after, before = path(t), path(t + h), path(t - h)
    turned = rotation_vector(after.rotation @ np.swapaxes(before.rotation, -1, -2))
    # h^2/6 times jerks of up to 20 /s^3, and 2 m or a turn x eps / h
    assert np.abs((after.position - before.position) / (2 * h) - here.velocity).max() < 1e-9
    assert np.abs(turned / (2 * h) - here.angular_velocity).max() < 1e-9
    assert np.abs((after.velocity - before.velocity) / (2 * h) - here.acceleration).max() < 1e-9
    change = (after.angular_velocity - before.angular_velocity) / (2 * h)
    assert np.abs(change - here.angular_acceleration).max() < 1e-9


@given(st.integers(0, 10_000))
def test_rates_are_those_of_the_pose_and_the_rotation_is_one(clear_of, seed):
    path = any_path(seed)
    assert_belongs_together(path, clear_of)
    R = path(np.linspace(-1, path.duration + 1, 100)).rotation
    assert np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max() < 1e-14
    assert (np.linalg.det(R) > 0).all()


@given(st.integers(0, 10_000))
def test_waypoints_are_met_at_rest_on_a_straight_line_about_one_axis(seed):
    path = any_path(seed)
    ends = [t for t in path.times if abs(path.progress(t)[0] - round(path.progress(t)[0])) < 1e-13]
    met = path(np.array(ends))
    k = np.round(path.progress(np.array(ends))[:, 0]).astype(int)
    assert set(k) == set(range(len(path.positions)))
    assert np.abs(met.position - path.positions[k]).max() < 1e-12
    assert np.abs(met.rotation - path.rotations[k]).max() < 1e-12
    assert max(np.abs(met.velocity).max(), np.abs(met.angular_velocity).max()) < 1e-12
    assert max(np.abs(met.acceleration).max(), np.abs(met.angular_acceleration).max()) < 1e-12
    t = np.linspace(0, path.duration, 50)
    for here, share in zip(range(50), path.progress(t)[:, 0], strict=True):
        j = min(int(share), len(path.positions) - 2)
        way = path.positions[j + 1] - path.positions[j]
        assert np.linalg.norm(np.cross(path(t[here]).position - path.positions[j], way)) < 1e-12
        # SLERP: the angle gone is the share of the whole
        total = np.linalg.norm(pin.log3(path.rotations[j + 1] @ path.rotations[j].T))
        gone = np.linalg.norm(pin.log3(path(t[here]).rotation @ path.rotations[j].T))
        assert gone == pytest.approx((share - j) * total, abs=1e-6)  # log3 at half a turn


@given(st.integers(0, 1000))
@settings(max_examples=6)
def test_a_plan_keeps_its_limits_and_the_joints_follow_it(arm, q0, clear_of, seed):
    poses = near(arm, q0, seed)
    plan = plan_poses(arm, poses, q0)
    start, end, T = plan(0.0), plan(plan.duration), arm.forward_kinematics(q0)
    assert (start.position == T.translation).all()
    assert (plan.joints(0.0).position == q0).all()
    assert start.rotation == pytest.approx(T.rotation, abs=1e-15)
    assert end.position == pytest.approx(poses[-1].translation, abs=1e-14)
    assert end.rotation == pytest.approx(poses[-1].rotation, abs=1e-14)
    for point in (start, end):
        assert max(np.abs(x).max() for x in (point.velocity, point.angular_velocity)) < 1e-13
    t = np.linspace(0, plan.duration, 2000)
    points = plan(t)
    for rates, limits in (
        ((points.velocity, points.acceleration), LINEAR),
        ((points.angular_velocity, points.angular_acceleration), ANGULAR),
    ):
        for rate, limit in zip(rates, limits[:2], strict=True):
            assert np.linalg.norm(rate, axis=1).max() <= limit * (1 + 1e-9)
    middles = (plan.times[:-1] + plan.times[1:]) / 2  # the jerk is held from one to the next
    h = 1e-3 * np.diff(plan.times)
    jerk = (plan(middles + h).acceleration - plan(middles - h).acceleration) / (2 * h[:, None])
    assert np.linalg.norm(jerk, axis=1).max() <= LINEAR.jerk * (1 + 1e-6)
    assert_belongs_together(plan, clear_of)
    # the joints' plan is the tool's
    assert plan.joints.duration == pytest.approx(plan.duration, rel=1e-12)
    for s in np.random.default_rng(seed).uniform(0, plan.duration, 30):
        q = plan.joints(s).position
        here, T = plan(s), arm.forward_kinematics(q)
        assert np.abs(T.translation - here.position).max() < 1e-7
        assert np.abs(T.rotation - here.rotation).max() < 1e-7
        assert ((q >= arm.lower) & (q <= arm.upper)).all()


def test_one_limit_at_least_is_reached(reference):
    T = reference.forward_kinematics(Q0)
    for pose, rate, limit in (
        (pin.SE3(T.rotation, T.translation + np.array([0, 0.3, 0])), "velocity", LINEAR.velocity),
        (pin.SE3(T.rotation @ pin.exp3(np.array([0, 0, 0.9])), T.translation), "angular_velocity", ANGULAR.velocity),
    ):
        plan = plan_poses(reference, [pose], Q0)
        assert plan.factor == 1
        rates = getattr(plan(np.linspace(0, plan.duration, 501)), rate)
        assert np.linalg.norm(rates, axis=1).max() == pytest.approx(limit, rel=1e-9)


def test_poses_as_matrices_copied_by_hand_and_twice(reference):
    T = reference.forward_kinematics(Q0)
    pose = pin.SE3(T.rotation @ pin.exp3(np.array([0.1, 0.2, 0.0])), T.translation + np.array([0, 0.1, 0]))
    once = plan_poses(reference, [pose], Q0)
    by_hand = pose.homogeneous.round(6)
    again = plan_poses(reference, [T, by_hand, by_hand], Q0)
    assert again.duration == pytest.approx(once.duration, rel=1e-4)
    R = again(again.duration).rotation
    assert np.abs(R @ R.T - np.eye(3)).max() < 1e-14


def test_what_the_joints_cannot_do_as_fast_takes_longer():
    """A UR5 whose joints may turn at a tenth of their speed: slower, the same way, at the joints' limit."""
    full = k1607.load_example("ur5")
    model = full.model
    model.velocityLimit = model.velocityLimit / 10
    slow = k1607.Arm(model, full.tool_frame)
    q0 = np.array([0.3, -1.2, 1.4, -0.9, -1.2, 0.2])
    T = full.forward_kinematics(q0)
    pose = pin.SE3(T.rotation, T.translation + np.array([0.1, 0.2, 0.0]))
    a, b = plan_poses(full, [pose], q0), plan_poses(slow, [pose], q0)
    assert a.factor == 1
    assert a.reason == ""
    assert b.factor > 1.05
    assert "velocity of joint '" in b.reason
    assert b.duration == pytest.approx(b.factor * a.duration)
    lowest, highest = b.joints.spline.peaks(1)
    assert (np.maximum(-lowest.value, highest.value) / slow.velocity_limit).max() == pytest.approx(1, rel=1e-9)
    share = np.linspace(0, 1, 20)
    assert b(share * b.duration).position == pytest.approx(a(share * a.duration).position, abs=1e-12)


def test_slower_by_hand_takes_tool_and_joints_along(reference):
    plan = plan_poses(reference, near(reference, Q0, 1), Q0)
    slow = plan.slower(2.0)
    assert slow.duration == pytest.approx(2 * plan.duration)
    assert slow.factor == 2 * plan.factor
    assert slow(1.0).velocity == pytest.approx(plan(0.5).velocity / 2)
    assert slow.joints(1.0).acceleration == pytest.approx(plan.joints(0.5).acceleration / 4)
    assert (pickle.loads(pickle.dumps(slow))(1.0).rotation == slow(1.0).rotation).all()


def test_a_pose_out_of_reach_is_refused_with_the_place(arm, q0):
    T = arm.forward_kinematics(q0)
    on_the_way = pin.SE3(T.rotation, T.translation + np.array([0.0, 0.05, 0.0]))
    far = pin.SE3(T.rotation, T.translation + np.array([0.0, 2.0, 0.0]))
    with pytest.raises(UnreachableError, match="cannot bring") as caught:
        plan_poses(arm, [on_the_way, far], q0)
    error = caught.value
    assert error.time > 0.5
    assert T.translation[1] + 0.05 < error.position[1] < T.translation[1] + 2.0
    assert error.position[[0, 2]] == pytest.approx(T.translation[[0, 2]], abs=1e-9)


def test_a_way_through_a_singularity_is_refused():
    """The UR5's wrist from one side of q5 = 0 to the other."""
    arm, q0 = k1607.load_example("ur5"), np.array([0.3, -1.2, 1.4, -0.9, -0.6, 0.2])
    behind = arm.forward_kinematics(q0 * [1, 1, 1, 1, -1, 1])
    with pytest.raises(
        SingularPathError, match=r"t = .*: smallest singular value of J .*, expected at least"
    ) as caught:
        plan_poses(arm, [behind], q0)
    error = caught.value
    assert 0 < error.time
    assert error.sigma_min < error.threshold
    assert str(pickle.loads(pickle.dumps(error))) == str(error)  # as it comes back from a worker


def test_a_stretched_elbow_is_no_place_to_start_from():
    arm, q0 = k1607.load_k1607(), np.zeros(7)
    with pytest.raises(SingularPathError, match="t = 0 s"):
        plan_poses(arm, [arm.forward_kinematics(Q0)], q0)


def test_a_way_out_of_the_joint_limits_is_refused():
    """Over the Panda's own base: each point is within reach, but not from here."""
    arm, q0 = k1607.load_example("panda"), np.array([0.0, -0.3, 0.0, -1.8, 0.0, 1.6, 0.5])
    T = arm.forward_kinematics(q0)
    behind = pin.SE3(T.rotation, T.translation - np.array([0.95, 0.0, 0.0]))
    with pytest.raises(JointLimitError, match=r"joint 'panda_joint6' would be at .* the tool at \[") as caught:
        plan_poses(arm, [behind], q0)
    assert caught.value.value < arm.lower[5]
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)
    q0[0] = 3.0
    with pytest.raises(JointLimitError, match=r"'panda_joint1' .* t = 0 s"):
        plan_poses(arm, [behind], q0)


def test_a_load_that_cannot_be_held_is_refused():
    arm = k1607.with_payload(k1607.load_example("panda"), k1607.Payload(50.0))
    q0 = np.array([0.0, -0.3, 0.0, -1.8, 0.0, 1.6, 0.5])
    T = arm.forward_kinematics(q0)
    with pytest.raises(OverloadError, match=r"would have to hold .* N m at t = .*, expected less than its limit of"):
        plan_poses(arm, [pin.SE3(T.rotation, T.translation + np.array([0, 0.1, 0]))], q0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"poses": []}, "poses: expected one that differs"),
        ({"poses": pin.SE3.Identity()}, "poses: expected a sequence"),
        ({"poses": [np.eye(3)]}, r"poses\[0\]: expected a pinocchio.SE3"),
        ({"poses": [2 * np.eye(4)]}, r"poses\[0\]: expected a rigid transform"),
        ({"poses": [np.full((4, 4), np.nan)]}, r"poses\[0\]"),
        ({"q0": np.zeros(6)}, "q0"),
        ({"linear": Limits(0.0, 1.0, 1.0)}, "linear: expected Limits of positive"),
        ({"angular": (1.0, 1.0)}, "angular"),
        ({"angular": Limits(1.0, 1.0, np.inf)}, "angular"),
        ({"sigma_min": -1.0}, "sigma_min"),
        ({"period": 0.0}, "period"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(reference, change, words):
    T = reference.forward_kinematics(Q0)
    arguments = {"poses": [pin.SE3(T.rotation, T.translation + np.array([0, 0.1, 0]))], "q0": Q0, **change}
    with pytest.raises(ValueError, match=words):
        plan_poses(reference, **arguments)
