"""The hybrid scheme on arms that press against a compliant wall, 1 kHz: contact, sliding, changing stiffness, switches.

Initial gains, rates and practice are ours; the report publishes none.
"""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import root
from scipy.spatial.transform import Rotation

import k1607_pin as k1607
from k1607_pin.arm.ready import ready_postures
from k1607_pin.control.hybrid import HybridAdaptive, Mode, hybrid_gains
from k1607_pin.control.posture import hold
from k1607_pin.control.practice import Practice
from k1607_pin.control.reference_model import reference_model
from k1607_pin.simulation.wall import Wall

K1607_POSTURE = np.deg2rad([-20, 30, 20, 100, -30, 60, 10])
PUSH = (1, 0, 0, 0, 0, 0)
PERIOD = 0.001


class Target(NamedTuple):
    position: np.ndarray
    velocity: np.ndarray


class Slide:
    """Along a direction (3,) at a speed [m/s] that is reached within 0.2 s, without a jump."""

    def __init__(self, start, direction, speed):
        self.start, self.direction, self.speed = start, direction, speed

    def __call__(self, t):
        share = min(t / 0.2, 1.0)
        way = self.speed * (0.1 * share**2 + max(t - 0.2, 0.0))
        return Target(self.start + way * self.direction, self.speed * share * self.direction)


class Setup(NamedTuple):
    law: HybridAdaptive
    wall: Wall
    q0: np.ndarray

    def run(self, duration, **options):
        options = {"physics_step": 0.0005, "external": self.wall.external(self.law.arm)} | options
        return k1607.simulate(self.law.arm, self.law, self.q0, duration, control_period=PERIOD, **options)


def setup(
    arm, q0, stiffness, assumed=1e5, push=20.0, gap=0.005, friction=0.0, damping=0.0, speed=0.0, normal=(-1.0, 0, 0),
    omega=60.0, force_omega=200.0, adapting=True, dead_zone=0.0, modes=None, **options,
):  # fmt: skip
    """The tool ``gap`` m off a wall that it is to push on, compliance axis x into the wall, y along the slide."""
    tool, n = arm.forward_kinematics(q0), np.array(normal) / np.linalg.norm(normal)
    C = np.column_stack([-n, *np.linalg.svd(n[None])[2][1:]])
    C[:, 2] *= np.sign(np.linalg.det(C))
    wall = Wall(tool.translation - gap * n, n, stiffness, damping, friction)
    K = np.array([assumed] * 3 + [assumed / 100] * 3)
    gains, force_gains = hybrid_gains(arm, q0, K, omega, force_omega, 1.0, 0.7, C)
    target = reference_model(2 * np.ones(6), 3 * np.ones(6))
    W = force_omega
    force_target = reference_model(np.full(6, W**2), np.full(6, 2 * W), np.diag([W**2] * 6 + [0.2] * 6))
    beta = np.array([1e5, 1e5, 1e-5, 1e-10]) * adapting
    law = HybridAdaptive(
        arm, Slide(tool.translation, C[:, 1], speed), tool.rotation, modes or Mode(PUSH, (push, 0, 0, 0, 0, 0)),
        wall.sensor(arm), K, gains, force_gains, target, force_target, *beta, PERIOD, C,
        posture=hold(q0, 10.0), practice=Practice(gravity=True, gain_bound=0.8, dead_zone=0.1 if dead_zone else 0.0),
        force_practice=Practice(gain_bound=0.8, dead_zone=dead_zone), **options,
    )  # fmt: skip
    return Setup(law, wall, q0)


@cache
def k1607_arm():
    return k1607.load_k1607()


def settled_after(log, since, wanted, share=0.02):
    """s from ``since`` on until the force stays within ``share`` of what is wanted."""
    off = log.time.values[np.abs(log.force.values[:, 0] - wanted) > share * wanted]
    return float(off[-1]) - since


def first_touch(log):
    return float(log.time.values[np.argmax(log.force.values[:, 0] > 0)])


def drift(log):
    """m, rad: largest error of what is position-controlled."""
    return np.abs(log.error.values[:, 1:3]).max(), np.abs(log.error.values[:, 3:]).max()


@pytest.mark.parametrize(("stiffness", "settling"), [(1e3, 1.6), (1e4, 0.3), (1e5, 0.06)])
def test_approach_contact_and_pressing_at_any_stiffness_with_one_set_of_gains(stiffness, settling):
    log = setup(k1607_arm(), K1607_POSTURE, stiffness).run(2.5)
    touch = first_touch(log)
    assert 0.1 < touch < 0.3
    force = log.force.values[:, 0]
    assert settled_after(log, touch, 20.0) < settling
    assert force.max() < 1.08 * 20
    assert abs(force[-1] - 20) < (5e-2 if stiffness == 1e3 else 1e-6)
    assert (force[log.time.values > touch] > 0).all()  # no bouncing
    position, orientation = drift(log)
    assert position < 0.2e-3
    assert orientation < 0.4e-3


def test_adaptation_speeds_up_a_soft_contact():
    fixed, adaptive = (setup(k1607_arm(), K1607_POSTURE, 1e3, adapting=a).run(2.5) for a in (False, True))
    after = 1.5
    wrong = [20 - float(log.force.sel(time=after, method="nearest")[0]) for log in (fixed, adaptive)]
    assert 0 < wrong[1] < 0.5 * wrong[0]


@pytest.mark.parametrize("stiffness", [1e3, 1e4, 1e5])
def test_slides_along_the_wall_while_pressing(stiffness):
    log = setup(k1607_arm(), K1607_POSTURE, stiffness, friction=0.3, speed=0.03, normal=(-1, 0.3, 0.2)).run(2.5)
    late = log.sel(time=slice(2.2, None))
    assert np.abs(late.force_error.values[:, 0]).max() < (0.1 if stiffness == 1e3 else 0.02)
    assert late.force.values[:, 1] == pytest.approx(0.3 * late.force.values[:, 0], rel=1e-3)  # the wall rubs backwards
    moved = np.linalg.norm(late.tool_position.values[-1] - late.tool_position.values[0])
    assert moved == pytest.approx(0.03 * 0.3, rel=0.01)
    position, orientation = drift(log)
    assert position < 0.3e-3
    assert orientation < 0.5e-3


def test_stiffness_that_steps_a_hundredfold_up_and_down():
    """Pressed in by 17 mm, the wall turns a hundred times harder: 1.8 kN in an instant, thrown off, and back."""
    log = setup(k1607_arm(), K1607_POSTURE, [(0, 1e3), (1, 1e5), (1.6, 1e3)]).run(3.5, physics_step=0.00025)
    force = log.force.values[:, 0]
    depth = force[999] / 1e3
    assert force.max() == pytest.approx(1e5 * depth, rel=0.02)
    off = (force == 0) & (log.time.values > 1)
    assert 0 < off.sum() * PERIOD < 0.25
    before_second = log.sel(time=slice(1, 1.599))
    assert settled_after(before_second, 1.0, 20.0) < 0.4
    assert 20 - force[-1] < 0.1 * 20
    position, orientation = drift(log)
    assert position < 15e-3
    assert orientation < 30e-3


def test_stiffness_that_ramps_a_hundredfold():
    log = setup(k1607_arm(), K1607_POSTURE, [(0, 1e3), (0.8, 1e5, 0.5)], friction=0.2, speed=0.03).run(
        2.0, physics_step=0.00025
    )
    force = log.force.values[:, 0]
    assert force.max() < 110
    assert (force[log.time.values > 0.8] > 0).all()
    assert np.abs(force[log.time.values > 1.5] - 20).max() < 0.2
    assert drift(log)[0] < 1.5e-3


def test_losing_the_wall_costs_no_more_speed_than_the_damping_allows():
    """The wall vanishes at 0.6 s and stands 10 mm further on: the arm drives there no faster than in its first approach."""
    arm = k1607_arm()
    case = setup(arm, K1607_POSTURE, 1e4)
    further = Wall(case.wall.point - 0.01 * case.wall.normal, case.wall.normal, 1e4)

    def at(t):
        return case.wall if t < 0.6 else further

    case = Setup(
        HybridAdaptive(**{**vars(case.law), "sensor": lambda t, q, v: at(t).wrench(arm, t, q, v)}), case.wall, case.q0
    )
    log = case.run(2.0, external=lambda t, q, v: at(t).external(arm)(t, q, v))
    force, way = log.force.values[:, 0], -log.tool_position.values @ case.wall.normal
    assert (force[620:800] == 0).all()
    speed = np.diff(way) / PERIOD
    law = case.law
    terminal = (1 + law.force_gains.K_p[0, 0]) * 20 / (law.force_gains.K_d[0, 0] * 1e5)
    assert speed.max() < 1.3 * terminal
    assert abs(force[-1] - 20) < 1e-3


def equilibrium(setup, mass, K_p, push, force_K_p=None):
    """(force, penetration, q) at rest, from kinematics, gains, wall and the weight of ``mass`` at the tool's origin.

    Without K_p of the force loop: the push as wanted, whatever command that takes, which is what an integral comes to rest at.
    """
    law, wall = setup.law, setup.wall
    model = law.arm.model
    data, frame = model.createData(), model.getFrameId(law.arm.tool_frame)
    C6, k = np.kron(np.eye(2), law.compliance), wall.stiffness_at(0.0)
    home, turn = law.path(0.0).position, law.rotation
    S, n = np.diag(PUSH), law.arm.n

    def depth(q):
        pin.framesForwardKinematics(model, data, q)
        return wall.normal @ (wall.point - data.oMf[frame].translation)

    def residual(unknown):
        q, added = unknown[:n], unknown[n]
        d = depth(q)
        pose = data.oMf[frame].copy()
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
        M = pin.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        angle = Rotation.from_matrix(turn @ pose.rotation.T).as_rotvec()
        half = np.linalg.norm(angle) / 2
        x_e = C6.T @ np.append(
            home - pose.translation, angle * np.sinc(half / np.pi)
        )  # 2 sin(angle / 2) along the axis
        error = push - k * d
        feedback = added if force_K_p is None else force_K_p[0, 0] * error
        command = (np.eye(6) - S) @ K_p @ (np.eye(6) - S) @ x_e + (push + feedback) * np.eye(6)[0]
        acting = C6 @ command + np.append(k * d * wall.normal + mass * model.gravity.linear, np.zeros(3))
        J_bar = np.linalg.solve(M, J.T) @ np.linalg.inv(J @ np.linalg.solve(M, J.T))
        drawn = M @ (setup.q0 - q)
        torque = J.T @ acting + 100.0 * (drawn - J.T @ (J_bar.T @ drawn))
        return np.append(torque, error if force_K_p is None else added)

    found = root(residual, np.append(setup.q0, 0.0), tol=1e-14)
    assert np.abs(found.fun).max() < 1e-8
    d = depth(found.x[:n])
    return k * d, d, found.x


@pytest.mark.parametrize("stiffness", [1e3, 1e4, 1e5])
@pytest.mark.parametrize("adapting", [False, True])
def test_steady_contact_is_the_static_equilibrium(stiffness, adapting):
    """With a weight that the law does not know, so that neither force nor pose is what is wanted."""
    arm, mass = k1607_arm(), 3.0
    case = setup(
        arm, K1607_POSTURE, stiffness, assumed=2 * stiffness, gap=0.0, normal=(-1, 0.4, 0.5), adapting=adapting,
        force_omega=np.clip(0.6 * np.sqrt(stiffness), 40, 200), dead_zone=10.0,
    )  # fmt: skip
    log = case.run(4.0, payloads=[(0.0, k1607.Payload(mass))])
    last = log.isel(time=-1)
    assert np.array_equal(log.force_K_p.values[-500], last.force_K_p.values)  # the dead zone has let them come to rest
    force, depth, q = equilibrium(case, mass, last.K_p.values, 20.0, last.force_K_p.values)
    assert abs(force - 20) > 0.1
    assert float(last.force[0]) == pytest.approx(force, rel=1e-6)
    assert case.wall.depth(last.tool_position.values) == pytest.approx(depth, rel=1e-6)
    assert last.q.values == pytest.approx(q[:-1], abs=1e-6)


def test_the_integral_takes_the_steady_force_error_away():
    """3 kg that the law does not know: what is left of 20 N without the integral, and with it."""
    mass, payload = 3.0, [(0.0, k1607.Payload(3.0))]

    def case(integral):
        return setup(
            k1607_arm(), K1607_POSTURE, 1e5, assumed=2e5, gap=0.0, normal=(-1, 0.4, 0.5), adapting=False, force_omega=190.0,
            force_integral=integral,
        )  # fmt: skip

    without, held = case(0.0).run(0.5, payloads=payload), case(60.0)
    left = float(without.force_error[-1, 0])
    assert abs(left) > 0.9
    log = held.run(2.5, payloads=payload)
    early, later = (float(log.force_error.sel(time=t, method="nearest")[0]) for t in (0.5, 0.8))
    rate = 60.0 / (1 + held.law.force_gains.K_p[0, 0])
    assert np.log(early / later) / 0.3 == pytest.approx(rate, rel=0.15)  # of a force loop much faster than that
    last = log.isel(time=-1)
    _, depth, unknown = equilibrium(held, mass, last.K_p.values, 20.0)
    assert float(last.force[0]) == pytest.approx(20.0, rel=1e-6)
    assert float(last.integral[0]) == pytest.approx(unknown[-1], rel=1e-5)
    assert held.wall.depth(last.tool_position.values) == pytest.approx(depth, rel=1e-6)
    assert last.q.values == pytest.approx(unknown[:-1], abs=1e-6)


class NoisyAndLate:
    """A force sensor whose reading is a sample old and has noise of a standard deviation in N, N m."""

    def __init__(self, sensor, noise, seed=0):
        self.sensor, self.noise, self.rng, self.last = sensor, noise, np.random.default_rng(seed), np.zeros(6)

    def __call__(self, t, q, v):
        reading, self.last = self.last, self.sensor(t, q, v)
        return reading + self.noise * self.rng.normal(size=6)


@pytest.mark.parametrize("stiffness", [1e4, 1e5])
def test_the_loop_lives_with_a_late_and_noisy_sensor(stiffness):
    """1 ms and 0.5 N, 5 mN m, with integral and adaptation; the true force, not the reading, is what is looked at."""
    noise = np.array([0.5] * 3 + [5e-3] * 3)
    case = setup(k1607_arm(), K1607_POSTURE, stiffness, force_integral=60.0, touch=6 * noise)
    law = replace(case.law, sensor=NoisyAndLate(case.law.sensor, noise))
    log = case._replace(law=law).run(2.0)
    true = stiffness * np.array([max(case.wall.depth(x), 0.0) for x in log.tool_position.values])
    late = true[log.time.values > 1.0]
    assert true.max() < 1.15 * 20
    assert abs(late.mean() - 20) < 0.15  # the integral's start, which is fading still
    assert late.std() < 0.2  # less than half of what the sensor shows
    position, orientation = drift(log)
    assert position < 0.2e-3
    assert orientation < 0.4e-3


@pytest.mark.parametrize(("name", "turned"), [("panda", 20e-3), ("ur5", 20e-3), ("xarm7", 60e-3)])
@pytest.mark.parametrize("stiffness", [1e3, 3e4])
def test_other_arms_slide_along_a_tilted_wall(name, turned, stiffness):
    """Gains in proportion to inertia: of the xArm7's wrist, 0.01 kg m^2 at the tool, K_p is 4 N m/rad."""
    arm = k1607.load_example(name)
    case = setup(
        arm, ready_postures(arm)[0], stiffness, assumed=3e4, push=10.0, friction=0.2, speed=0.02, normal=(0.2, 0.3, 1.0),
        omega=20.0, force_omega=150.0,
    )  # fmt: skip
    log = case.run(2.0)
    force = log.force.values[:, 0]
    assert force.max() < 12
    assert settled_after(log, first_touch(log), 10.0) < (1.1 if stiffness == 1e3 else 0.15)
    position, orientation = drift(log)
    assert position < 6e-3  # 2 N of rubbing against 20^2 Lambda
    assert orientation < turned


def test_switching_makes_no_jump_and_lands_softly():
    """Approach by position 3 mm into the wall, press by force from 0.5 s on, let go at 1.2 s and be held by position again."""
    arm = k1607_arm()
    free, press = Mode(np.zeros(6)), Mode(PUSH, (20.0, 0, 0, 0, 0, 0))
    modes = [free, press._replace(time=0.5), free._replace(time=1.2)]
    case = setup(arm, K1607_POSTURE, 1e4, gap=-0.003, modes=modes)
    log = case.run(2.0)
    jump = np.abs(np.diff(log.tau.values, axis=0)).max(axis=1)
    for time in (0.5, 1.2):
        k = round(time / PERIOD)
        stay = setup(arm, K1607_POSTURE, 1e4, gap=-0.003, modes=[m for m in modes if m.time < time]).run(time)
        # what the torque would have been at that very sample, had nothing been switched
        assert log.tau.values[k] == pytest.approx(stay.tau.values[k], abs=1e-9)
        assert jump[k : k + 50].max() < 1.0
    ramp = log.force.values[500:1200, 0]
    before = log.force.values[499, 0]
    assert np.abs(np.diff(ramp)).max() < 0.5
    assert min(before, 20) - 1.5 < ramp.min() <= ramp.max() < max(before, 20) + 1.5
    assert abs(ramp[-1] - 20) < 0.3
    x_after = log.error.values[1200:, 0]
    assert np.abs(np.diff(x_after)).max() < 2e-5
    # held by position again, where the path is: the push that the mode before left behind has faded
    assert np.abs(log.error.values[-1] - log.error.values[499]).max() < 1e-4


def test_both_loops_rest_while_the_motors_are_at_their_limits():
    arm = k1607_arm()
    _, wall, q0 = made = setup(arm, K1607_POSTURE, 1e4)
    free = np.abs(made.run(0.6).tau.values)
    limit = np.maximum(
        0.8 * free.max(axis=0), 1.05 * np.median(free, axis=0) + 0.1
    )  # less than the jolts, more than it rests with
    low = replace(made.law, practice=replace(made.law.practice, torque_limit=limit))
    log = Setup(low, wall, q0).run(0.6)
    limited = log.torque_share.values < 1
    assert limited.any()
    assert not limited.all()
    changed = {
        name: np.abs(np.diff(log[name].values, axis=0)).max(axis=(1, 2)) > 0
        for name in ("K_p", "K_d", "force_K_p", "force_K_d")
    }
    for name, moves in changed.items():
        assert not moves[limited[:-1]].any(), name
        assert moves[~limited[:-1]].any(), name


def test_the_velocity_is_filtered_in_the_hybrid_scheme_too():
    arm = k1607_arm()
    law, _, q0 = setup(arm, K1607_POSTURE, 1e4)
    cutoff = 1.0 / PERIOD  # cT = 1: an exponential, and not its first term
    slow = replace(law, practice=replace(law.practice, velocity_cutoff=cutoff))
    v, still = np.linspace(-0.1, 0.1, 7), np.zeros(7)
    state = slow.initial(q0, still)
    torque, after, _ = slow.update(0.0, q0, v, state)
    seen = (1 - np.exp(-1.0)) * v
    np.testing.assert_allclose(after.velocity, seen, rtol=1e-12)
    np.testing.assert_allclose(torque, law.update(0.0, q0, seen, law.initial(q0, seen))[0], rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"stiffness": -1e4}, "stiffness: expected one or"),
        ({"stiffness": np.full(3, 1e4)}, "stiffness: expected one or"),
        ({"omega": -60.0}, "omega: expected a positive number"),
        ({"force_omega": 0.0}, "force_omega: expected a positive number"),
        ({"force_damping": -0.1}, "force_damping: expected a number >= 0"),
        ({"compliance": 2 * np.eye(3)}, r"compliance: expected a .* rotation"),
    ],
)
def test_initial_gains_refuse(change, said):
    with pytest.raises(ValueError, match=said):
        hybrid_gains(
            **{"arm": k1607_arm(), "q": K1607_POSTURE, "stiffness": 1e4, "omega": 60.0, "force_omega": 200.0} | change
        )


def test_force_gains_that_push_away_from_the_wanted_force_are_refused():
    law = setup(k1607_arm(), K1607_POSTURE, 1e4).law
    away = law.force_gains._replace(K_p=-2 * np.eye(6))
    with pytest.raises(ValueError, match=r"force_gains: expected .* positive definite"):
        replace(law, force_gains=away, force_practice=Practice())
