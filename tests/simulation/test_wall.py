"""`Wall`: pushes and never pulls, rubs within Coulomb's cone, and takes no energy that it does not account for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from k1607_pin.simulation.simulate import simulate
from k1607_pin.simulation.wall import Wall

NUMBER = st.floats(-1, 1)
VECTOR = st.tuples(NUMBER, NUMBER, NUMBER).map(np.array)
NORMAL = VECTOR.filter(lambda n: np.linalg.norm(n) > 1e-3)
STIFFNESS = st.floats(0, 1e5)


class Free:
    """No torque beyond the arm's weight."""

    def __init__(self, arm):
        self.arm = arm

    def start(self, q, v, duration):
        return None

    def update(self, t, q, v, state):
        return self.arm.gravity_torque(q), None, {}


@given(VECTOR, NORMAL, STIFFNESS, st.floats(0, 1e3), st.floats(0, 2), VECTOR, VECTOR)
def test_pushes_out_never_pulls_and_rubs_against_sliding_within_the_cone(point, normal, k, c, mu, position, velocity):
    wall = Wall(point, normal, k, c, mu)
    force = wall.force(0.0, position, velocity)
    n = normal / np.linalg.norm(normal)
    push, rub = float(n @ force), force - (n @ force) * n
    assert push >= -1e-12 * np.linalg.norm(force)
    if n @ (position - point) > 1e-12:
        assert not force.any()
    sliding = velocity - (n @ velocity) * n
    assert rub @ sliding <= 1e-9
    assert np.linalg.norm(rub) <= mu * push * (1 + 1e-9) + 1e-9
    assert np.linalg.norm(np.cross(rub, sliding)) <= 1e-9 * (1 + np.linalg.norm(rub))


@given(NORMAL, st.floats(1, 1e5), st.floats(1e-6, 1e-2))
def test_at_rest_the_force_is_stiffness_times_penetration_along_the_normal(normal, k, depth):
    wall = Wall(np.zeros(3), normal, k, 100.0, 0.5)
    force = wall.force(0.0, -depth * wall.normal, np.zeros(3))
    assert force == pytest.approx(k * depth * wall.normal, rel=1e-9, abs=1e-12)
    assert wall.energy(0.0, -depth * wall.normal) == pytest.approx(k * depth**2 / 2, rel=1e-9)


def test_friction_reaches_mu_times_the_push_when_sliding_and_has_no_jump_at_rest():
    wall = Wall(np.zeros(3), np.array([0, 0, 2.0]), 1e4, 0.0, 0.3)
    at = np.array([0, 0, -1e-3])
    assert wall.force(0.0, at, np.array([0.1, 0, 0])) == pytest.approx([-3, 0, 10], rel=1e-12)
    speeds = np.array([0.0, 1e-12, 1e-10, 0.999e-9, 1.001e-9, 1e-8, 1e-6])
    drag = np.array([wall.force(0.0, at, np.array([0, s, 0]))[1] for s in speeds])
    assert drag == pytest.approx(-3000 * speeds, rel=1e-5)


def test_a_fast_retreat_is_not_held_back():
    wall = Wall(np.zeros(3), np.array([1.0, 0, 0]), 1e3, 1e3)
    assert wall.force(0.0, np.array([-1e-3, 0, 0]), np.array([0.1, 0, 0])).tolist() == [0, 0, 0]


def test_stiffness_and_damping_step_and_ramp_at_their_times():
    wall = Wall(np.zeros(3), np.array([1.0, 0, 0]), [(0, 1e3), (1, 5e3), (2, 1e3, 2)], [(0, 10), (1, 20, 1)])
    times = [-1, 0, 0.999, 1, 1.999, 2, 3, 4, 9]
    assert [wall.stiffness_at(t) for t in times] == [1e3, 1e3, 1e3, 5e3, 5e3, 5e3, 3e3, 1e3, 1e3]
    inwards = np.array([-0.1, 0, 0])
    assert wall.force(1.5, np.array([-1e-3, 0, 0]), inwards)[0] == pytest.approx(5 + 1.5)


def test_a_free_arm_bounces_off_and_the_wall_gives_back_what_it_took(arm):
    """No friction, no damping: external work over the whole contact vanishes with the step; with damping it is a loss."""
    q0 = 0.5 * (np.maximum(arm.lower, -1) + np.minimum(arm.upper, 1)) + 0.3
    J = arm.jacobian(q0)
    normal = np.array([1.0, -0.5, 0.3])
    wanted = np.concatenate([-0.05 * normal / np.linalg.norm(normal), np.zeros(3)])
    v0 = np.linalg.pinv(J) @ wanted
    point = arm.forward_kinematics(q0).translation - 2e-3 * normal / np.linalg.norm(normal)
    lost = {}
    for c in (0.0, 200.0):
        wall = Wall(point, normal, 1e4, c)
        log = simulate(arm, Free(arm), q0, 0.4, v0, 0.002, 2.5e-4, external=wall.external(arm))
        depth = np.array([wall.depth(x) for x in log.tool_position.values])
        assert depth[0] < 0 < depth.max()
        assert depth[-1] < 0
        measured = [wall.sensor(arm)(*x)[:3] for x in zip(log.time.values, log.q.values, log.v.values, strict=True)]
        assert np.array_equal(log.contact_force, measured)
        speed = float(wall.normal @ (arm.jacobian(log.q.values[-1]) @ log.v.values[-1])[:3])
        assert speed > 0
        lost[c] = -float(log.external_work[-1])
        assert -log.external_work.values.min() > 1e-3
    assert abs(lost[0.0]) < 2e-2 * lost[200.0]
    assert lost[200.0] > 1e-3


def test_external_and_sensor_say_the_same_and_none_off_the_wall(arm):
    q, v = np.full(arm.n, 0.4), np.linspace(-0.1, 0.2, arm.n)
    position = arm.forward_kinematics(q).translation
    normal = np.array([0.2, 0.5, 1.0])
    wall = Wall(position + 1e-3 * normal, normal, 1e4, 10.0, 0.3)
    wrench = wall.external(arm)(0.0, q, v)
    assert wrench.frame is None
    assert wrench.axes == "base"
    assert wall.sensor(arm)(0.0, q, v).tolist() == [*wrench.force, 0, 0, 0]
    off = Wall(position - 1e-3 * normal, normal, 1e4)
    assert off.external(arm)(0.0, q, v) is None
    assert off.sensor(arm)(0.0, q, v).tolist() == [0] * 6


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"stiffness": -1.0}, r"stiffness: expected a number >= 0 in N/m.*got -1"),
        ({"stiffness": np.nan}, "stiffness"),
        ({"stiffness": []}, "stiffness"),
        ({"stiffness": "stiff"}, "stiffness"),
        ({"stiffness": [(0, 1e3), (1, -1e3)]}, "stiffness"),
        ({"stiffness": [(0, 1e3, 2.0), (1, 2e3)]}, "in order of time"),
        ({"stiffness": [(0,), (1,)]}, "stiffness"),
        ({"damping": -1.0}, "damping: expected a number >= 0 in N s/m"),
        ({"friction": -0.1}, "friction"),
        ({"friction": np.inf}, "friction"),
        ({"normal": np.zeros(3)}, "normal: expected a vector that is not zero"),
        ({"normal": np.ones(2)}, "normal"),
        ({"point": np.array([0, 0, np.nan])}, "point"),
    ],
)
def test_bad_input_is_refused(changes, words):
    arguments = {"point": np.zeros(3), "normal": np.array([0, 0, 1.0]), "stiffness": 1e4} | changes
    with pytest.raises(ValueError, match=words):
        Wall(**arguments)
