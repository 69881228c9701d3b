"""Wrenches from outside: on the frame and in the axes that they name."""

import numpy as np
import pinocchio as pin
import pytest

from k1607_pin.arm.wrench import Wrench, wrench_torque

FORCE, MOMENT = np.array([3.0, -2.0, 5.0]), np.array([0.4, 0.7, -0.2])


@pytest.mark.parametrize("axes", ["base", "frame"])
def test_pinocchio_s_external_force_gives_the_same_acceleration(arm, axes):
    """On every joint's frame: forward dynamics with J^T f, against ABA with the force itself."""
    rng, model = np.random.default_rng(4), arm.model
    q, v = arm.random_configuration(rng), rng.normal(size=arm.n)
    for i in range(1, model.njoints):
        data = model.createData()
        pin.forwardKinematics(model, data, q)
        R = np.eye(3) if axes == "frame" else data.oMi[i].rotation.T
        forces = pin.StdVec_Force()
        for k in range(model.njoints):
            forces.append(pin.Force(R @ FORCE, R @ MOMENT) if k == i else pin.Force.Zero())
        expected = pin.aba(model, data, q, v, np.zeros(arm.n), forces).copy()
        torque = wrench_torque(arm, q, Wrench(FORCE, MOMENT, _link_of(model, i), axes))
        found = arm.forward_dynamics(q, v, torque)
        assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def _link_of(model, joint):
    """A link whose frame is the joint's own, by its name; the joint's name does as well."""
    frames = [f for f in model.frames if f.parentJoint == joint and f.placement.isIdentity(0)]
    return frames[0].name


def test_tool_is_meant_when_no_frame_is_named(arm):
    q = arm.random_configuration(np.random.default_rng(5))
    assert wrench_torque(arm, q, Wrench(FORCE)) == pytest.approx(arm.jacobian(q)[:3].T @ FORCE, abs=1e-14)
    named = wrench_torque(arm, q, Wrench(FORCE, frame=arm.tool_frame))
    assert np.array_equal(named, wrench_torque(arm, q, Wrench(FORCE)))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"force": np.zeros(2)}, "force"),
        ({"moment": np.full(3, np.inf)}, "moment"),
        ({"axes": "world"}, "axes"),
    ],
)
def test_impossible_wrenches_are_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        Wrench(**arguments)


def test_a_frame_that_is_not_there_is_named(arm):
    with pytest.raises(ValueError, match="frame: no frame 'nowhere'"):
        wrench_torque(arm, np.zeros(arm.n), Wrench(FORCE, frame="nowhere"))
