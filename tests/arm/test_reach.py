"""Paths that an arm can follow, and those that it cannot: refused with the place."""

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.arm.reach import UnreachableError, follow
from k1607_pin.paths.report_paths import Line

POSTURES = {
    "k1607": np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10]),
    "panda": np.array([0.0, -0.3, 0.0, -1.8, 0.0, 1.6, 0.5]),
    "ur5": np.array([0.3, -1.2, 1.4, -0.9, -1.2, 0.2]),
}


def test_postures_are_on_the_path_and_within_the_limits(arm):
    q0 = POSTURES[arm.name if arm.name in POSTURES else next(k for k in POSTURES if k in arm.name.lower())]
    start = arm.forward_kinematics(q0)
    path = Line(start.translation, np.array([0.05, 0.1, 0.0]))
    times, Q, jumps, sigma = follow(arm, path, start.rotation, q0, 3.0)
    assert not jumps
    assert sigma.min() > 0.02
    for t, q in zip(times, Q, strict=True):
        T = arm.forward_kinematics(q)
        assert np.abs(T.translation - path(t).position).max() < 2e-6
        assert np.abs(T.rotation - start.rotation).max() < 2e-6
        assert ((q >= arm.lower) & (q <= arm.upper)).all()


def test_a_path_that_leaves_the_workspace_is_refused_with_time_and_place():
    arm, q0 = k1607.load_k1607(), POSTURES["k1607"]
    start = arm.forward_kinematics(q0)
    path = Line(start.translation, np.array([0.0, 3.0, 0.0]))
    with pytest.raises(UnreachableError, match="cannot bring 'tool' to") as caught:
        follow(arm, path, start.rotation, q0, 5.0)
    error = caught.value
    assert 0.5 < error.time < 5
    assert error.position == pytest.approx(path(error.time).position)
    # a person's look at the arm: it is some 1.5 m long, joint 1 is at the base's origin
    assert np.linalg.norm(error.position) > 1.2
    assert error.closest.position_error + error.closest.orientation_error > 1e-6


def test_a_start_out_of_reach_is_refused_before_the_first_step():
    from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
    from k1607_pin.control.reference_model import reference_model

    arm, q0 = k1607.load_k1607(), POSTURES["k1607"]
    law = CartesianAdaptive(
        arm,
        Line(np.array([5.0, 0.0, 0.0])),
        np.eye(3),
        gains_from_inertia(arm, q0, 2.0),
        reference_model(2 * np.ones(6), 3 * np.ones(6)),
        0.0,
        0.0,
        0.01,
    )
    with pytest.raises(ValueError, match=r"path: .*\[5.0, 0.0, 0.0\].*t = 0 s"):
        k1607.simulate(arm, law, q0, 1.0)


def test_a_path_that_needs_another_posture_on_the_way_says_when():
    """Joint 1 of the Panda cannot turn all the way round the base; each point is within reach all the same."""
    from k1607_pin.paths.report_paths import Circle

    arm = k1607.load_example("panda")
    q0 = np.array([0.0, 0.2, 0.0, -2.0, 0.0, 2.2, 0.8])
    x = arm.forward_kinematics(q0)
    path = Circle(float(x.translation[2]), float(x.translation[0]))
    followed = follow(arm, path, x.rotation, q0, 10.0)
    assert followed.jumps
    assert 1 < followed.jumps[0] < 10
