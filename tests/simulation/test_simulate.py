"""`simulate`: the energy account closes, payloads come and go, what runs away is kept, bad input is refused."""

import pickle
from dataclasses import dataclass

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.arm.payload import Payload, with_payload
from k1607_pin.arm.wrench import Wrench
from k1607_pin.simulation.account import simpson, trapezoid, work_rule
from k1607_pin.simulation.integrators import runge_kutta_4, semi_implicit_euler
from k1607_pin.simulation.names import RESERVED
from k1607_pin.simulation.plant import Plant
from k1607_pin.simulation.simulate import SimulationError, simulate

BOX = Payload(4.5, np.array([0.0, 0.0, 0.1]), np.diag([0.03, 0.03, 0.02]))


class Hold:
    """PD about the first posture, weighted by the mass matrix, with gravity compensation; counts its updates in the state."""

    def __init__(self, arm, stiffness=100.0, damping=20.0):
        self.arm, self.stiffness, self.damping = arm, stiffness, damping

    def start(self, q, v, duration):
        return q.copy(), 0

    def update(self, t, q, v, state):
        wanted, count = state
        wish = self.stiffness * (wanted - q) - self.damping * v
        tau = self.arm.gravity_torque(q) + self.arm.mass_matrix(q) @ wish
        return tau, (wanted, count + 1), {"error": wanted - q, "count": count}


def posture(arm):
    return 0.5 * (np.maximum(arm.lower, -1) + np.minimum(arm.upper, 1)) + 0.3


def test_log_has_names_units_and_what_the_controller_says(arm):
    log = simulate(arm, Hold(arm), posture(arm), 0.2)
    assert log.sizes["time"] == 21
    assert log.q.dims == ("time", "joint")
    assert list(log.joint.values) == list(arm.joint_names)
    assert all("units" in log[name].attrs for name in ("q", "v", "tau", "energy", "time"))
    assert log["count"].values.tolist() == list(range(21))
    assert log.error.shape == (21, arm.n)
    position = arm.forward_kinematics(log.q.values[7]).translation
    assert log.tool_position.values[7] == pytest.approx(position, abs=1e-15)


@pytest.mark.parametrize(("step", "order", "dt"), [(semi_implicit_euler, 1, 0.005), (runge_kutta_4, 4, 0.01)])
def test_energy_account_closes_to_the_integrator_s_order(step, order, dt):
    """Motors work, a payload comes along moving: what is left over falls with the step as the integrator's error does."""
    arm = k1607.load_k1607()

    def left(dt):
        push = Hold(arm, stiffness=0.0, damping=-2.0)  # drives the motion instead of damping it
        v0 = np.linspace(-0.5, 0.5, 7)
        log = simulate(arm, push, posture(arm), 0.4, v0, 0.02, dt, step, payloads=[(0.2, BOX)])
        assert abs(float(log.work[-1])) > 0.1
        assert float(log.payload_energy[-1]) > 1  # lifted at the height of the hand
        return abs(float(log.energy_residual[-1]))

    residuals = [left(dt / k) for k in (1, 2, 4)]
    orders = np.log2(np.array(residuals[:-1]) / residuals[1:])
    assert orders[-1] == pytest.approx(order, abs=0.4)


def test_friction_takes_what_the_motors_give_at_steady_motion():
    arm = k1607.load_k1607(gravity=(0, 0, 0))
    plant = Plant(arm, viscous=np.full(7, 5.0))
    log = simulate(
        plant, Hold(arm, 0.0, 0.0), posture(arm), 0.5, np.full(7, 0.3), physics_step=0.001, step=runge_kutta_4
    )
    assert float(log.dissipated[-1]) > 0.5
    # the time constants of a light last joint under this friction are a few steps long
    assert abs(float(log.energy_residual[-1])) < 1e-3 * float(log.dissipated[-1])


@pytest.mark.parametrize("outside", [False, True])
def test_the_account_of_friction_and_of_the_world_is_as_good_as_the_integrator(outside):
    """Order 4 with Runge-Kutta's, shown by halving the step; no motor works and all else is smooth."""
    arm = k1607.load_k1607()
    plant = Plant(arm) if outside else Plant(arm, viscous=np.full(7, 0.5))

    def drag(t, q, v):
        return Wrench(force=-20.0 * (arm.jacobian(q) @ v)[:3])

    def left(dt):
        log = simulate(
            plant,
            Hold(arm, 0.0, 0.0),
            posture(arm),
            0.4,
            np.linspace(-0.5, 0.5, 7),
            0.04,
            dt,
            runge_kutta_4,
            external=drag if outside else None,
        )
        assert abs(float(log.external_work[-1] if outside else log.dissipated[-1])) > 0.05
        return abs(float(log.energy_residual[-1]))

    residuals = [left(dt) for dt in (0.02, 0.01, 0.005)]
    orders = np.log2(np.array(residuals[:-1]) / residuals[1:])
    assert orders[-1] > 3.5


def test_only_runge_kutta_s_account_is_by_simpson_s_rule():
    assert work_rule(runge_kutta_4) is simpson
    assert work_rule(semi_implicit_euler) is work_rule(lambda *_: None) is trapezoid
    # q = t^2 (1, 2), a force 3 v: the integral of 3 v^2 is 20 h^3, which the cubic meets exactly
    h, way = 0.1, np.array([1.0, 2.0])
    ends = (np.zeros(2), np.zeros(2)), (h * h * way, 2 * h * way)
    assert simpson(lambda q, v: 3 * v, *ends, h) == pytest.approx(20 * h**3, rel=1e-14)
    assert trapezoid(lambda q, v: 3 * v, *ends, h) == pytest.approx(15 * h**3, rel=1e-14)


def test_no_payload_changes_no_bit(arm):
    plain, nothing = (simulate(arm, Hold(arm), posture(arm), 0.1, payloads=p) for p in ((), [(0.05, Payload(0.0))]))
    assert plain.identical(nothing)


def test_payload_comes_and_goes_at_its_times():
    arm = k1607.load_k1607()
    log = simulate(arm, Hold(arm), posture(arm), 0.3, payloads=[(0.1, BOX), (0.2, Payload(0.0))])
    carrying = (log.time >= 0.1 - 1e-9) & (log.time < 0.2 - 1e-9)
    assert (log.payload == np.where(carrying, BOX.mass, 0.0)).all()
    sag = np.abs(log.error).max(log.error.dims[1])
    assert float(sag.sel(time=0.19, method="nearest")) > 10 * float(sag.sel(time=0.09, method="nearest")) + 1e-4


def test_from_rest_slows_the_arm_at_once_and_moving_along_does_not():
    arm = k1607.load_k1607()
    v0, q0 = np.full(7, 0.4), posture(arm)
    at_once = simulate(arm, Hold(arm), q0, 0.01, v0, payloads=[(0.0, BOX)], from_rest=True).v.values[0]
    along = simulate(arm, Hold(arm), q0, 0.01, v0, payloads=[(0.0, BOX)]).v.values[0]
    assert np.array_equal(along, v0)
    loaded = with_payload(arm, BOX)
    assert loaded.mass_matrix(q0) @ at_once == pytest.approx(arm.mass_matrix(q0) @ v0, rel=1e-12)


def test_a_payload_that_grows_costs_no_more_than_its_lift_and_the_account_closes():
    arm = k1607.load_k1607()
    grown = simulate(arm, Hold(arm), posture(arm), 0.4, payloads=[(0.1, BOX, 0.2)])
    assert (np.diff(grown.payload.values[10:30]) > 0).all()
    assert float(grown.payload[-1]) == BOX.mass
    at_once = simulate(arm, Hold(arm), posture(arm), 0.4, payloads=[(0.1, BOX)])
    assert float(grown.payload_energy[-1]) == pytest.approx(float(at_once.payload_energy[-1]), rel=0.05)
    assert abs(float(grown.energy_residual[-1])) < 0.05 * float(grown.payload_energy[-1])


def test_one_payload_after_another_at_rest_is_let_go_and_gripped():
    """Momentum at the swap: the old payload keeps its own, the new one brings none, whatever their masses."""
    arm, v0 = k1607.load_k1607(gravity=(0, 0, 0)), np.full(7, 0.4)
    for second in (Payload(BOX.mass / 2, BOX.cg), Payload(BOX.mass, -BOX.cg), Payload(2 * BOX.mass)):
        changes = [(0.0, BOX), (0.01, second)]
        log = simulate(arm, Hold(arm, 0, 0), posture(arm), 0.02, v0, payloads=changes, from_rest=True)
        coasting = simulate(arm, Hold(arm, 0, 0), posture(arm), 0.02, v0, payloads=changes[:1], from_rest=True)
        q, before, after = log.q.values[1], coasting.v.values[1], log.v.values[1]
        assert with_payload(arm, second).mass_matrix(q) @ after == pytest.approx(arm.mass_matrix(q) @ before, rel=1e-9)


def test_a_ramp_from_rest_takes_momentum_share_by_share():
    """Little by little or at once: without gravity and torque, the arm's own momentum law gives the same end to first order."""
    arm, v0 = k1607.load_k1607(gravity=(0, 0, 0)), np.full(7, 0.4)
    at_once = simulate(arm, Hold(arm, 0, 0), posture(arm), 0.02, v0, payloads=[(0.01, BOX)], from_rest=True)
    ramp = simulate(arm, Hold(arm, 0, 0), posture(arm), 0.02, v0, payloads=[(0.005, BOX, 0.01)], from_rest=True,
                    control_period=0.001)  # fmt: skip
    lost = 0.4 - at_once.v.values[-1]
    assert np.abs(ramp.v.values[-1] - at_once.v.values[-1]).max() < 0.05 * np.abs(lost).max()


def test_a_motor_at_its_limit_gives_that_and_no_more():
    """Asked for far more than their limit, the motors move the arm as they would when asked for the limit."""
    arm = k1607.load_k1607(gravity=(0, 0, 0))
    plant = Plant(arm, torque_limit=np.full(7, 3.0))

    class Full(Hold):
        def update(self, t, q, v, state):
            return np.full(7, 1e4), state, {}

    log = simulate(plant, Full(arm), posture(arm), 0.05)
    assert (log.tau == 3.0).all()
    free = simulate(arm, Fixed(np.full(7, 3.0)), posture(arm), 0.05)
    assert np.array_equal(log.q, free.q)


class Fixed:
    """A constant torque."""

    def __init__(self, tau):
        self.tau = tau

    def start(self, q, v, duration):
        return None

    def update(self, t, q, v, state):
        return self.tau, None, {}


def test_coulomb_friction_stops_a_turning_joint_where_it_must():
    """Joint 1 alone, weightless, arm held out by nobody: its speed falls by c/M a second, M the inertia about its axis."""
    model = k1607.load_k1607(gravity=(0, 0, 0)).model
    import pinocchio as pin

    locked = pin.buildReducedModel(model, list(range(2, 8)), np.array([0, 1.0, 0, 1.0, 0, 0.5, 0]))
    arm = k1607.Arm(locked, "tool")
    plant = Plant(arm, coulomb=np.array([5.0]))
    M = float(arm.mass_matrix(np.zeros(1))[0, 0])
    log = simulate(plant, Fixed(np.zeros(1)), np.zeros(1), 0.5, np.array([1.0]))
    assert float(log.v[-1, 0]) == pytest.approx(1.0 - 5.0 * 0.5 / M, rel=1e-9)
    assert float(log.dissipated[-1]) == pytest.approx(0.5 * M * (1 - float(log.v[-1, 0]) ** 2), rel=1e-3)


def test_external_is_told_the_physics_step_s_time():
    told = []

    def external(t, q, v):
        told.append(t)

    arm = k1607.load_k1607()
    simulate(arm, Hold(arm), posture(arm), 0.02, external=external)
    assert sorted(set(np.round(told, 9))) == pytest.approx(np.arange(21) * 0.001)


def test_a_payload_comes_at_the_nearest_control_sample():
    arm = k1607.load_k1607()
    for wanted, sample in ((0.104, 10), (0.106, 11)):
        log = simulate(arm, Hold(arm), posture(arm), 0.2, payloads=[(wanted, BOX)])
        assert int(np.argmax(log.payload.values > 0)) == sample


def test_a_push_from_outside_does_its_work_and_no_more():
    arm = k1607.load_k1607(gravity=(0, 0, 0))
    push = Wrench(force=np.array([20.0, 0, 0]), moment=np.array([0, 0, 1.0]))

    def external(t, q, v):
        return push if 0.1 <= t < 0.3 - 1e-9 else None

    log = simulate(arm, Hold(arm, 0.0, 0.0), posture(arm), 0.4, external=external, step=runge_kutta_4)
    outside = log.external_work.values
    assert (outside[:11] == 0).all()
    assert outside[-1] > 0.1
    assert (outside[30:] == outside[30]).all()
    assert float(log.energy[-1]) == pytest.approx(outside[-1] + float(log.work[-1]), rel=1e-5)
    assert abs(float(log.energy_residual[-1])) < 1e-5 * outside[-1]


@pytest.mark.parametrize("axes", ["base", "frame"])
def test_the_wrench_on_the_tool_is_the_world_s_in_base_axes_about_its_origin(arm, axes):
    """At the tool it does to the joints what the world did, whichever frame of the tool's body and whichever axes it came in."""
    model, rng = arm.model, np.random.default_rng(8)
    q0 = posture(arm)
    bodies = {frame.name: frame.parentJoint for frame in model.frames if frame.name != "universe"}
    tool_body = [name for name, joint in bodies.items() if joint == bodies[arm.tool_frame]]
    assert len(tool_body) > 1
    for frame in (None, *tool_body):
        force, moment = rng.normal(size=(2, 3))

        def external(t, q, v, frame=frame, force=force, moment=moment):
            return Wrench(t * force, t * moment, frame, axes)

        log = simulate(arm, Hold(arm), q0, 0.03, np.full(arm.n, 0.2), external=external)
        for k, q in enumerate(log.q.values):
            w = np.concatenate([log.contact_force.values[k], log.contact_moment.values[k]])
            assert arm.jacobian(q).T @ w == pytest.approx(log.passive_torque.values[k], abs=1e-13)
            turned = arm.forward_kinematics(q, frame).rotation if axes == "frame" else np.eye(3)
            assert w[:3] == pytest.approx(turned @ force * log.time.values[k], abs=1e-14)
    assert log.contact_force.dims == log.contact_moment.dims == ("time", "axis")
    assert (log.contact_force.units, log.contact_moment.units) == ("N", "N m")


def test_a_wrench_on_another_link_is_not_the_tool_s(arm):
    name = next(frame.name for frame in arm.model.frames if frame.parentJoint == arm.n - 1)  # the one before it
    log = simulate(arm, Hold(arm), posture(arm), 0.02, external=lambda t, q, v: Wrench(np.ones(3), frame=name))
    assert np.abs(log.passive_torque).max() > 0.01
    assert not log.contact_force.values.any()
    assert not log.contact_moment.values.any()


def test_contact_is_logged_with_a_world_only_and_is_zero_while_that_does_nothing():
    arm = k1607.load_k1607()
    alone = simulate(arm, Hold(arm), posture(arm), 0.02)
    assert not {"contact_force", "contact_moment"} & set(alone)
    idle = simulate(arm, Hold(arm), posture(arm), 0.02, external=lambda t, q, v: None)
    assert idle.drop_vars(["contact_force", "contact_moment"]).identical(alone)
    assert not idle.contact_force.values.any()
    with pytest.raises(ValueError, match="every run logs contact_force already"):
        simulate(arm, Hold(arm), posture(arm), 0.02, observe=lambda arm, q, v: {"contact_force": np.zeros(3)})


def test_an_observer_sees_the_arm_with_its_payload():
    arm = k1607.load_k1607()

    def observe(arm, q, v):
        return {"inertia": arm.mass_matrix(q)[0, 0]}

    log = simulate(arm, Hold(arm), posture(arm), 0.2, payloads=[(0.1, BOX)], observe=observe)
    q = log.q.values[15]
    assert float(log.inertia[15]) == with_payload(arm, BOX).mass_matrix(q)[0, 0]
    assert float(log.inertia[5]) == arm.mass_matrix(log.q.values[5])[0, 0]


def test_what_runs_away_ends_with_an_error_and_keeps_the_log():
    arm = k1607.load_k1607()
    with pytest.raises(SimulationError, match="run away") as caught:
        simulate(arm, Hold(arm, stiffness=-1e4, damping=-1e3), posture(arm) + 0.1, 5.0, np.full(7, 0.1))
    error = caught.value
    assert 0 < error.time < 5
    assert np.isfinite(error.q).all()
    assert error.log.sizes["time"] == int(error.time / 0.01 + 1e-9) + 1
    assert np.isfinite(error.log.q).all()


def test_an_infinite_torque_is_no_torque_even_with_a_limit():
    arm = k1607.load_k1607()
    plant = Plant(arm, torque_limit=np.full(7, 3.0))
    with pytest.raises(SimulationError, match="asks for a torque that is not finite") as caught:
        simulate(plant, Fixed(np.full(7, np.inf)), posture(arm), 0.1)
    assert pickle.loads(pickle.dumps(caught.value)).time == caught.value.time


@dataclass(frozen=True)
class Logs:
    """Damping that logs numbers under names of its own."""

    names: tuple

    def start(self, q, v, duration):
        return None

    def initial(self, q, v):
        return None

    def update(self, t, q, v, state):
        return -v, state, {name: np.sum(v) for name in self.names}


@pytest.mark.parametrize("name", [*sorted(RESERVED), "a/b", "", 3])
def test_names_that_are_taken_are_refused_by_every_door(name):
    """One rule for the logs of controllers, observers and signals, in simulate, rollout and Native."""
    arm = k1607.load_k1607()
    for run in (
        lambda law: simulate(arm, law, posture(arm), 0.02),
        lambda law: k1607.rollouts(arm, law, 0.02, metrics={"q": "max"}),
    ):
        run(Logs(("own",)))
        with pytest.raises(ValueError, match=r"^log: (every run logs|expected names)"):
            run(Logs((name,)))
    with pytest.raises(ValueError, match=r"^log: (every run logs|expected names)"):
        simulate(arm, Logs(()), posture(arm), 0.02, observe=lambda arm, q, v: {name: 0.0})
    with pytest.raises(ValueError, match=r"^signals: (every run logs|expected names)"):
        k1607.rollouts(arm, Logs(()), 0.02, signals={name: lambda log: log["t"]})


def test_two_that_call_theirs_alike_are_refused():
    arm = k1607.load_k1607()
    with pytest.raises(ValueError, match="observe: expected other names than the controller's, got own"):
        simulate(arm, Logs(("own",)), posture(arm), 0.02, observe=lambda arm, q, v: {"own": 0.0})
    with pytest.raises(ValueError, match="signals: expected names other than the controller's, got own"):
        k1607.rollouts(arm, Logs(("own",)), 0.02, signals={"own": lambda log: log["t"]})
    both = {"metrics": {"own": "max"}, "log": ("own_max",)}
    with pytest.raises(ValueError, match="log: expected none that is called as a metric's result is, got own_max"):
        k1607.rollouts(arm, Logs(("own", "own_max")), 0.02, **both)


def test_logs_that_hide_or_change_are_refused():
    arm = k1607.load_k1607()

    class Hiding(Hold):
        def update(self, t, q, v, state):
            return super().update(t, q, v, state)[0], state, {"energy": -1.0}

    class Changing(Hold):
        def update(self, t, q, v, state):
            return super().update(t, q, v, state)[0], state, {"a": 1.0} if t < 0.05 else {"b": 1.0}

    with pytest.raises(ValueError, match="every run logs energy already"):
        simulate(arm, Hiding(arm), posture(arm), 0.1)
    with pytest.raises(ValueError, match="a change of a, b"):
        simulate(arm, Changing(arm), posture(arm), 0.1)


def test_an_error_of_the_controller_s_own_says_when():
    arm = k1607.load_k1607()

    class Broken(Hold):
        def update(self, t, q, v, state):
            if t > 0.045:
                raise KeyError("gone")
            return super().update(t, q, v, state)

    with pytest.raises(KeyError) as caught:
        simulate(arm, Broken(arm), posture(arm), 0.1)
    assert any("t = 0.05 s" in note for note in caught.value.__notes__)


def test_progress_is_told():
    arm, shares = k1607.load_k1607(), []
    simulate(arm, Hold(arm), posture(arm), 3.5, progress=shares.append)
    assert shares[0] == 0
    assert shares[-1] == 1
    assert shares == sorted(shares)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"duration": 0.0}, "duration"),
        ({"duration": 0.105}, "duration"),
        ({"duration": np.nan}, "duration"),
        ({"control_period": -0.01}, "control_period"),
        ({"physics_step": 0.003}, "physics_step"),
        ({"q0": np.zeros(6)}, "q0"),
        ({"v0": np.full(7, np.nan)}, "v0"),
        ({"payloads": [(0.2, BOX), (0.1, BOX)]}, "payloads"),
        ({"payloads": [(-0.1, BOX)]}, "payloads"),
        ({"payloads": [(0.2, BOX)]}, "payloads"),
    ],
)
def test_bad_input_is_refused_before_the_first_step(changes, words):
    arm = k1607.load_k1607()
    arguments = {"q0": posture(arm), "duration": 0.1} | changes
    with pytest.raises(ValueError, match=words):
        simulate(arm, Hold(arm), **arguments)


@pytest.mark.parametrize("torque", [np.zeros(6), np.zeros((7, 1)), 0.0])
def test_a_torque_of_wrong_shape_is_named_and_not_taken_for_a_runaway(torque):
    arm = k1607.load_k1607()

    class Wrong(Hold):
        def update(self, t, q, v, state):
            return torque, state, {}

    with pytest.raises(ValueError, match=r"controller: expected a torque of shape \(7,\)"):
        simulate(arm, Wrong(arm), posture(arm), 0.1)


def test_a_torque_that_is_not_finite_never_reaches_the_arm():
    arm = k1607.load_k1607()

    class Broken(Hold):
        def update(self, t, q, v, state):
            tau, state, log = super().update(t, q, v, state)
            return tau if t < 0.045 else tau * np.nan, state, log

    with pytest.raises(SimulationError, match=r"after t = 0\.05 s") as caught:
        simulate(arm, Broken(arm), posture(arm), 0.1)
    assert np.isfinite(caught.value.log.q).all()
