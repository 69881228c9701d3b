"""What is no number where one is expected is refused by the argument's name, by every public function of paths."""

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.paths.cartesian_plan import plan_poses
from k1607_pin.paths.inverse_path import joint_path
from k1607_pin.paths.joint_plan import plan_joints
from k1607_pin.paths.report_paths import Circle, Line
from k1607_pin.paths.slow_down import slow_down
from k1607_pin.paths.spline import Spline
from k1607_pin.paths.timing import Limits, fastest, progress, straight

ARM = k1607.load_k1607()
Q0 = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
T = ARM.forward_kinematics(Q0).homogeneous
T[0, 3] += 0.01
PLAN = plan_joints(ARM, [Q0 + 0.1], Q0)
LINE = Line(ARM.forward_kinematics(Q0).translation)
THREE, ONE = np.ones(3), Limits(1.0, 1.0, 1.0)

WRONG = [
    np.nan,
    "text",
    1j,
    np.ma.masked_array([1.0, 2.0], [False, True]),
    np.ones((2, 5)),
    -1.0,
    [[1.0], [1.0, 2.0]],
    {},
]
NUMBERS = {  # name -> a call with one argument of that name that should be a positive number, or some
    "velocity": [lambda x: plan_joints(ARM, [Q0 + 0.1], Q0, velocity=x), lambda x: slow_down(ARM, PLAN, velocity=x)],
    "acceleration": [lambda x: plan_joints(ARM, [Q0 + 0.1], Q0, acceleration=x)],
    "jerk": [lambda x: plan_joints(ARM, [Q0 + 0.1], Q0, jerk=x), lambda x: straight(0 * THREE, THREE, Limits(1, 1, x))],
    "effort": [lambda x: slow_down(ARM, PLAN, effort=x)],
    "waypoints": [lambda x: plan_joints(ARM, x, Q0)],
    "q0": [
        lambda x: plan_joints(ARM, [Q0], x),
        lambda x: plan_poses(ARM, [T], x),
        lambda x: joint_path(ARM, LINE, x, 1.0),
    ],
    "poses": [lambda x: plan_poses(ARM, [x], Q0)],
    "linear": [lambda x: plan_poses(ARM, [T], Q0, linear=x)],
    "angular": [lambda x: plan_poses(ARM, [T], Q0, angular=Limits(1.0, x, 1.0))],
    "sigma_min": [
        lambda x: plan_poses(ARM, [T], Q0, sigma_min=x),
        lambda x: joint_path(ARM, LINE, Q0, 1.0, sigma_min=x),
    ],
    "period": [lambda x: plan_poses(ARM, [T], Q0, period=x), lambda x: joint_path(ARM, LINE, Q0, 1.0, period=x)],
    "duration": [lambda x: joint_path(ARM, LINE, Q0, x)],
    "rotation": [lambda x: joint_path(ARM, LINE, Q0, 1.0, x)],
    "factor": [PLAN.slower],
    "rate": [lambda x: Line(THREE, rate=x)],
    "extent": [lambda x: Line(THREE, x)],
    "radius": [lambda x: Circle(1.0, radius=x)],
    "beta": [lambda x: Circle(1.0, beta=x)],
    "distances": [lambda x: progress(x, ONE)],
    "start": [lambda x: straight(x, THREE, ONE), lambda x: fastest(x, THREE, THREE, THREE, ONE), Line],
    "v_end": [lambda x: fastest(0 * THREE, THREE, 0 * THREE, x, ONE)],
    "times": [lambda x: Spline(x, np.zeros((1, 1, 1)))],
    "coefficients": [lambda x: Spline(np.array([0.0, 1.0]), x)],
}


@pytest.mark.parametrize("wrong", WRONG, ids=lambda x: type(x).__name__)
@pytest.mark.parametrize(("name", "call"), [(name, call) for name, calls in NUMBERS.items() for call in calls])
def test_what_is_no_number_is_refused_by_name(name, call, wrong):
    with pytest.raises(ValueError, match=name):
        call(wrong)


@pytest.mark.parametrize("wrong", [0.0, np.inf, None])
@pytest.mark.parametrize(
    ("name", "call"),
    [(name, NUMBERS[name][-1]) for name in ("jerk", "linear", "period", "sigma_min", "factor", "radius", "beta")],
)
def test_limits_of_zero_infinity_or_nothing_are_refused_by_name(name, call, wrong):
    with pytest.raises(ValueError, match=name):
        call(wrong)


@pytest.mark.parametrize("wrong", [np.nan, None, "1", 1j, [0.0, np.nan]])
def test_a_time_that_is_none_is_refused(wrong):
    with pytest.raises(ValueError, match="t: expected times in s"):
        PLAN(wrong)


@pytest.mark.parametrize("wrong", [None, 1.0, (1.0, 2.0), "abc"])
def test_what_are_no_limits_is_refused(wrong):
    with pytest.raises(ValueError, match="limits: expected Limits"):
        straight(0 * THREE, THREE, wrong)


def test_what_is_no_plan_and_no_path_is_refused():
    with pytest.raises(ValueError, match="plan: expected a JointPlan"):
        slow_down(ARM, LINE)
    with pytest.raises(ValueError, match="path: expected a function of time"):
        joint_path(ARM, None, Q0, 1.0)
