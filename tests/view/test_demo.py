"""The motion shown when none is given."""

import numpy as np

from k1607_pin.view.demo import SECONDS_A_JOINT, each_joint_in_turn


def test_each_joint_moves_in_its_turn_alone_and_within_limits(arm):
    t, Q = each_joint_in_turn(arm)
    assert (Q >= arm.lower - 1e-12).all()
    assert (Q <= arm.upper + 1e-12).all()
    moving = np.abs(Q - Q[0]) > 1e-9
    assert (moving.sum(axis=1) <= 1).all()
    for joint in range(arm.n):
        turn = (t > joint * SECONDS_A_JOINT) & (t < (joint + 1) * SECONDS_A_JOINT)
        assert not moving[~turn, joint].any()
        assert np.ptp(Q[:, joint]) > np.deg2rad(20)
