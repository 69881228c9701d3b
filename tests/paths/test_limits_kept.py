"""Whatever a plan returns keeps its limits, and whatever is reachable is planned: over twelve orders of magnitude."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import k1607_pin as k1607
from k1607_pin.paths.cartesian_plan import plan_poses
from k1607_pin.paths.joint_plan import plan_joints
from k1607_pin.paths.s_curve import s_curve
from k1607_pin.paths.timing import Limits, NoMotionError, fastest, shares

magnitude = st.floats(-6, 6).map(lambda e: 10.0**e)
URDF = """<robot name="slide"><link name="a"/><joint name="x" type="prismatic"><parent link="a"/><child link="b"/>
<axis xyz="1 0 0"/><limit lower="-1e9" upper="1e9" velocity="1" effort="1"/></joint>
<link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="y" type="prismatic"><parent link="b"/><child link="c"/>
<axis xyz="0 1 0"/><limit lower="-1e9" upper="1e9" velocity="1" effort="1"/></joint>
<link name="c"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>"""


@pytest.fixture(scope="module")
def slide(tmp_path_factory):
    """Two prismatic joints with room for any distance."""
    file = tmp_path_factory.mktemp("slide") / "slide.urdf"
    file.write_text(URDF)
    return k1607.load_urdf(file, tool_frame="c")


@given(magnitude, magnitude, magnitude)
def test_an_s_curve_keeps_its_limits_meets_its_end_and_reaches_a_limit(v, a, j):
    found = s_curve(v, a, j)
    most = shares(found, Limits(*(np.array([x]) for x in (v, a, j))))
    assert max(most) <= 1
    # the fastest cannot be improved: some limit is reached, up to the rounding of times by 2^-48 of the duration
    assert max(most) > 1 - 1e-6
    assert found(found.duration)[0] == pytest.approx(1, abs=1e-14)
    assert found(0.0)[0] == 0


@given(
    st.lists(st.tuples(magnitude, magnitude), min_size=1, max_size=3), magnitude, magnitude, magnitude, st.booleans()
)
def test_plans_keep_their_limits(slide, steps, v, a, j, stop):
    ways = np.cumsum(steps, axis=0)
    plan = plan_joints(slide, ways, np.zeros(2), v, a, j, stop=stop)
    assert max(shares(plan.spline, Limits(*(np.full(2, x) for x in (v, a, j))))) <= 1 + 1e-9
    assert plan(plan.duration).position == pytest.approx(ways[-1], rel=1e-9)


def test_a_short_stretch_after_a_long_one_keeps_its_limits(slide):
    """Times of 3e6 s have last places of 5e-10 s: more than it takes this jerk to reach the acceleration."""
    v, a, j = 5.67e-5, 1e-5, 2e5
    plan = plan_joints(slide, [[-166.4, 0.0], [-166.40000001, 0.0]], np.zeros(2), v, a, j, stop=True)
    assert max(shares(plan.spline, Limits(*(np.full(2, x) for x in (v, a, j))))) <= 1


@given(magnitude, magnitude, st.sampled_from([1.0, 2.0, 0.5, 4.0]), st.sampled_from([1.0, 0.5, 2.0]))
def test_round_ratios_are_planned(slide, a, j, of_distance, of_velocity):
    """At a distance of 2 a^3/j^2, and a velocity of a^2/j, one phase ends just as the next begins."""
    distance, v = of_distance * a**3 / j**2, of_velocity * a**2 / j
    if not 1e-8 < distance < 1e8:
        return
    plan = plan_joints(slide, [[distance, -distance]], np.zeros(2), v, a, j)
    assert max(shares(plan.spline, Limits(*(np.full(2, x) for x in (v, a, j))))) <= 1


@pytest.mark.parametrize(("v", "distance"), [(1.75, 0.07), (1e-6, 0.5), (2.0, 1.5)])
def test_the_default_ratio_takes_the_known_time(slide, v, distance):
    plan = plan_joints(slide, [[distance, 0.0]], np.zeros(2), v)
    a, j = v / 0.5, v / 0.05
    # 0.07 = 2 a^3/j^2: up and down the acceleration, no more: 4 a/j; else a cruise at v: d/v + v/a + a/j
    known = 4 * a / j if distance == 0.07 else distance / v + v / a + a / j
    assert plan.duration == pytest.approx(known, rel=1e-12)


def test_a_jerk_beyond_all_scale_breaks_no_limit(slide):
    plan = plan_joints(slide, [[1.0, 0.0]], np.zeros(2), 2, 5, jerk=1e10)
    v, a, j = shares(plan.spline, Limits(np.full(2, 2.0), np.full(2, 5.0), np.full(2, 1e10)))
    assert max(v, a, j) <= 1
    # 0.4 s up, 0.1 s at 2 m/s, 0.4 s down, and the jerk's 5e-10 s
    assert plan.duration == pytest.approx(0.9, abs=1e-8)


@pytest.mark.parametrize(
    ("name", "q0"),
    [("panda", [0.0, -0.3, 0.0, -1.8, 0.0, 1.6, 0.5]), ("ur5", [0.3, -1.2, 1.4, -0.9, -1.2, 0.2])],
)
def test_ten_millimetres_are_planned_in_every_direction(name, q0):
    arm = k1607.load_example(name)
    T = arm.forward_kinematics(np.array(q0))
    for angle in np.deg2rad(np.arange(0, 360, 30)):
        goal = pin.SE3(T.rotation, T.translation + 0.01 * np.array([np.cos(angle), np.sin(angle), 0.0]))
        plan = plan_poses(arm, [goal], np.array(q0))
        assert plan.duration / plan.factor == pytest.approx(0.4, rel=1e-9)  # 4 a/j


def test_no_motion_says_so_in_a_sentence():
    with pytest.raises(NoMotionError) as caught:
        fastest(np.zeros(2), np.ones(2), np.array([3.0, 0.0]), np.zeros(2), Limits(1.0, 2.0, 20.0))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300
    assert "coordinate, 0, should go from 0 at 3 to 1 at 0" in str(caught.value)


@pytest.mark.parametrize("faster", [1e-6, 1e3, 1e6])
def test_a_plan_from_pose_to_pose_may_take_microseconds_or_days(faster):
    """The way of the joints is the same at any speed; the joints' own limits are what is left of haste."""
    arm, q0 = k1607.load_example("panda"), np.array([0.0, -0.3, 0.0, -1.8, 0.0, 1.6, 0.5])
    T = arm.forward_kinematics(q0)
    goal = pin.SE3(T.rotation, T.translation + np.array([0.01, 0.0, 0.0]))
    linear, angular = (Limits(*(x * faster**k for k, x in enumerate(way, 1))) for way in ((0.25, 0.5, 5), (0.5, 1, 10)))
    plan = plan_poses(arm, [goal], q0, linear, angular, period=0.5)
    assert plan.duration / plan.factor == pytest.approx(0.4 / faster, rel=1e-9)
    assert plan.joints.duration == pytest.approx(plan.duration, rel=1e-12)
    t = np.linspace(0, plan.duration, 13)
    for q, position in zip(plan.joints(t).position, plan(t).position, strict=True):
        assert arm.forward_kinematics(q).translation == pytest.approx(position, abs=1e-6)


@pytest.mark.parametrize("name", ["velocity", "acceleration", "jerk"])
@pytest.mark.parametrize("limit", [1e-300, 1e-80, 1e80, 1e300])
def test_limits_whose_products_are_no_numbers_are_named(slide, name, limit):
    with pytest.raises(ValueError, match=f"^{name}: expected limits from 1e-75 to 1e"):
        plan_joints(
            slide, [[1.0, 0.0]], [0.0, 0.0], **({"velocity": 1.0, "acceleration": 1.0, "jerk": 1.0} | {name: limit})
        )


@pytest.mark.parametrize("factor", [1e-300, 1e300])
def test_a_motion_is_not_slowed_beyond_numbers(slide, factor):
    with pytest.raises(ValueError, match=r"^factor: expected a "):
        plan_joints(slide, [[1.0, 0.0]], [0.0, 0.0], 1, 1, 1).slower(factor)
