"""Compiled rollouts are `simulate`, many at once."""

import signal
import subprocess
import sys
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.compiled.closed_loop import REDUCERS
from k1607_pin.compiled.traced_arm import inertial_parameters
from k1607_pin.control.adaptation import Gains
from k1607_pin.simulation.integrators import runge_kutta_4, semi_implicit_euler
from k1607_pin.simulation.noise import with_noise
from k1607_pin.simulation.simulate import SimulationError

PAYLOADS = [(0.1, k1607.Payload(4.5, np.array([0.02, -0.01, 0.05]))), (0.2, k1607.Payload(0.0))]
LOGGED = ("q", "v", "tau", "tool_position", "error", "K_p", "K_d")


@pytest.mark.parametrize("step", [semi_implicit_euler, runge_kutta_4])
@pytest.mark.parametrize("from_rest", [False, True])
def test_payloads_come_and_go(arm, law, step, from_rest, q0, agrees):
    payloads = [(0.1, PAYLOADS[0][1]), (0.15, k1607.Payload(2.0), 0.05), (0.25, k1607.Payload(0.0), 0.02)]
    settings = {"payloads": payloads, "from_rest": from_rest, "step": step}
    run = k1607.rollout(arm, law, q0, 0.3, log=LOGGED, **settings)
    reference = k1607.simulate(arm, law, q0, 0.3, **settings)
    agrees(run, reference, LOGGED)
    assert abs(run.work[0] - reference.work[-1]) < 1e-12
    np.testing.assert_array_equal(run.q_end[0], run.q[0, -1])
    assert np.isnan(run.failed_at[0])


def test_friction_stops_and_limits(arm, law, q0, agrees):
    upper = arm.upper.copy()
    upper[:] = q0 + 0.01  # all stops are met
    model = arm.model
    model.upperPositionLimit = upper
    close = k1607.Arm(model, arm.tool_frame)
    plant = k1607.Plant(
        close, viscous=np.full(7, 2.0), coulomb=np.full(7, 0.5), torque_limit=np.full(7, 30.0),
        stop_stiffness=np.full(7, 200.0), stop_damping=np.full(7, 1.0),
    )  # fmt: skip
    run = k1607.rollout(plant, law, q0, 0.3, log=LOGGED, physics_step=2.5e-4)
    reference = k1607.simulate(plant, law, q0, 0.3, physics_step=2.5e-4)
    assert (np.abs(reference.tau) == 30).any()
    assert (reference.q.values > upper).any()
    agrees(run, reference, LOGGED)


CASES = {
    "controller.beta_1": lambda rng, arm, law: rng.uniform(0, 1e4, 5),
    "controller.gains.K_p": lambda rng, arm, law: law.gains.K_p * rng.uniform(0.5, 1.5, (5, 1, 1)),
    "controller.path.extent": lambda rng, arm, law: rng.uniform(-0.1, 0.1, (5, 3)),
    "controller.model.P": lambda rng, arm, law: law.model.P * rng.uniform(0.5, 1.5, (5, 1, 1)),
    "plant.viscous": lambda rng, arm, law: rng.uniform(0, 5, (5, 7)),
    "plant.torque_limit": lambda rng, arm, law: rng.uniform(5, 50, (5, 7)),
    "payloads.0.payload.mass": lambda rng, arm, law: rng.uniform(0, 9, 5),
    "payloads.0.payload.cg": lambda rng, arm, law: rng.uniform(-0.1, 0.1, (5, 3)),
    "plant.arm.armature": lambda rng, arm, law: arm.armature * rng.uniform(0.5, 2, (5, 7)),
    "plant.arm.gravity": lambda rng, arm, law: rng.uniform(-9, 9, (5, 3)),
    "plant.arm.inertial": lambda rng, arm, law: inertial_parameters(arm) * rng.uniform(0.7, 1.3, (5, 1, 1)),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_each_number_may_differ_between_rollouts(arm, law, name, q0, agrees):
    values = CASES[name](np.random.default_rng(0), arm, law)
    run = k1607.rollout(arm, law, q0, 0.25, payloads=PAYLOADS, vary={name: values}, log=LOGGED)
    assert len(np.unique(run.q_end, axis=0)) == 5
    for i in (0, 4):
        plant, controller, payloads = changed(name, values[i], k1607.Plant(arm), law)
        agrees(run, k1607.simulate(plant, controller, q0, 0.25, payloads=payloads), LOGGED, i)


def changed(name, value, plant, law):
    """What a rollout with one number changed is a rollout of, by this package's other means."""
    first, payload = PAYLOADS[0]
    match name:
        case "controller.beta_1":
            law = replace(law, beta_1=value)
        case "controller.gains.K_p":
            law = replace(law, gains=Gains(value, law.gains.K_d))
        case "controller.path.extent":
            law = replace(law, path=replace(law.path, extent=value))
        case "controller.model.P":
            law = replace(law, model=replace(law.model, P=value))
        case "plant.viscous":
            plant = replace(plant, viscous=value)
        case "plant.torque_limit":
            plant = replace(plant, torque_limit=value)
        case "payloads.0.payload.mass":
            payload = k1607.Payload(value, payload.cg)
        case "payloads.0.payload.cg":
            payload = k1607.Payload(payload.mass, value)
        case _:
            model = plant.arm.model
            if name.endswith("armature"):
                model.armature = value
            elif name.endswith("gravity"):
                model.gravity.linear = value
            else:
                import pinocchio as pin

                for i, parameters in enumerate(value):
                    model.inertias[i + 1] = pin.Inertia.FromDynamicParameters(parameters)
            plant = k1607.Plant(k1607.Arm(model, plant.arm.tool_frame))
    return plant, law, [(first, payload), PAYLOADS[1]]


def test_starts_may_differ(arm, law, q0, agrees):
    rng = np.random.default_rng(0)
    starts, v0 = q0 + rng.normal(size=(3, 7), scale=0.05), rng.normal(size=(3, 7), scale=0.1)
    run = k1607.rollout(arm, law, starts, 0.2, v0, log=LOGGED)
    for i in range(3):
        agrees(run, k1607.simulate(arm, law, starts[i], 0.2, v0[i]), LOGGED, i)


@pytest.mark.parametrize("name", ["panda", "ur5", "xarm7"])
def test_any_arm(name, agrees, cartesian):
    arm = k1607.load_example(name)
    start = {"ur5": [0.3, -1.2, 1.4, -0.9, -1.2, 0.2]}.get(name, [0.1, -0.9, 0.3, -1.5, 0.2, 1.6, 0.3])
    law = cartesian(arm, np.array(start), 0.001, omega=4.0)
    settings = {
        "q0": np.array(start),
        "duration": 0.3,
        "control_period": 0.001,
        "payloads": [(0.1, k1607.Payload(0.3))],
    }
    agrees(k1607.rollout(arm, law, **settings, log=LOGGED), k1607.simulate(arm, law, **settings), LOGGED)


def test_the_same_bits_whatever_lane_batch_and_threads(arm, law, q0):
    beta = np.linspace(0, 1e4, 37)
    together = k1607.rollout(arm, law, q0, 0.1, vary={"controller.beta_1": beta}, threads=1)
    turned = k1607.rollout(arm, law, q0, 0.1, vary={"controller.beta_1": beta[::-1]}, threads=2)
    alone = k1607.rollout(arm, law, q0, 0.1, vary={"controller.beta_1": beta[[20]]})
    for name in together.data_vars:
        np.testing.assert_array_equal(together[name], turned[name][::-1])
        np.testing.assert_array_equal(together[name][[20]], alone[name])


def test_noise_is_a_function_of_seed_and_time(arm, law, q0, agrees):
    noisy = with_noise(law, 7, 0.01, 1e-4, 1e-2)
    run = k1607.rollout(arm, noisy, q0, 0.2, vary={"controller.noise.seed": [0, 1, 2**53]}, log=LOGGED)
    for i, seed in enumerate((0, 1, 2**53)):
        agrees(run, k1607.simulate(arm, with_noise(law, 7, 0.01, 1e-4, 1e-2, seed), q0, 0.2), LOGGED, i)
    assert len(np.unique(run.q_end, axis=0)) == 3
    shared = k1607.rollout(arm, noisy, q0, 0.2, log=LOGGED)  # of one seed: a table
    agrees(shared, k1607.simulate(arm, noisy, q0, 0.2), LOGGED)


def test_one_that_runs_away_is_flagged_and_the_others_go_on(arm, law, q0):
    K_d = law.gains.K_d * np.array([1.0, 200.0, 1.0])[:, None, None]  # far too much for torques held 10 ms
    vary = {"controller.gains.K_d": K_d}
    run = k1607.rollout(arm, law, q0, 0.3, vary=vary, log=("q", "tau", "t"), metrics={"q": REDUCERS})
    with pytest.raises(SimulationError) as lost:
        k1607.simulate(arm, replace(law, gains=Gains(law.gains.K_p, K_d[1])), q0, 0.3)
    assert run.failed_at[1] == pytest.approx(lost.value.time, abs=1e-9)
    np.testing.assert_allclose(run.q_end[1], lost.value.q, rtol=1e-6)  # the last good state
    np.testing.assert_array_equal(np.isnan(run.q[1, :, 0]), run.t[0] > run.failed_at[1].item())
    seen, tau = (run[name][1].values[~np.isnan(run.q[1, :, 0])] for name in ("q", "tau"))
    moved = np.diff(np.vstack([seen, run.q_end[1]]), axis=0)
    assert float(run.work[1]) == pytest.approx(float(np.sum(tau * moved)), rel=1e-9)  # up to the last good state
    np.testing.assert_allclose(run.q_rms[1], np.sqrt(np.mean(seen**2, axis=0)), rtol=1e-12)
    np.testing.assert_array_equal(run.q_last[1], seen[-1])
    well = k1607.rollout(arm, law, q0, 0.3, vary={"controller.gains.K_d": K_d[[0]]}, metrics={"q": REDUCERS})
    for name in well.data_vars:
        np.testing.assert_array_equal(run[name][[0]], well[name])


def test_a_torque_that_is_no_number_is_a_failure(arm, q0):
    with np.errstate(invalid="ignore"):
        run = k1607.rollout(arm, Drive(lambda q, v: np.sqrt(q - 10.0)), q0, 0.05)
    assert run.failed_at[0] == 0


@pytest.mark.parametrize("reducer", REDUCERS)
def test_metrics_are_those_of_the_log(arm, law, reducer, q0):
    run = k1607.rollout(arm, law, q0, 0.2, metrics={"error": (reducer,), "t": (reducer,)}, log=("error", "t"))
    x, t = run.error.values[0], run.t.values[0]
    by_hand = {
        "max": lambda x: np.abs(x).max(axis=0),
        "min": lambda x: np.abs(x).min(axis=0),
        "rms": lambda x: np.sqrt(np.mean(x**2, axis=0)),
        "mean": lambda x: np.mean(x, axis=0),
        "last": lambda x: x[-1],
    }[reducer]
    np.testing.assert_allclose(run[f"error_{reducer}"][0], by_hand(x), rtol=1e-12, atol=1e-18)
    assert float(run[f"t_{reducer}"][0]) == pytest.approx(by_hand(t))


def test_signals_and_decimated_logs(arm, law, q0):
    signals = {"distance": lambda log: np.sqrt(np.sum(log["error"][:3] ** 2))}
    run = k1607.rollout(
        arm, law, q0, 0.2, signals=signals, metrics={"distance": "max"}, log=("error", "distance"), every=7
    )
    assert run.sizes["time"] == 3
    np.testing.assert_allclose(run.time, [0, 0.07, 0.14])
    np.testing.assert_allclose(run.distance, np.linalg.norm(run.error[..., :3], axis=-1), rtol=1e-12)
    assert run.distance_max.shape == (1,)
    assert float(run.distance_max[0]) >= float(run.distance.max())


# A controller of one's own


class Drive:
    """A state: what v has been summed up to."""

    def __init__(self, torque):
        self.torque = torque

    def start(self, q, v, duration):
        return {"sum": np.zeros(len(q))}

    def update(self, t, q, v, state):
        return self.torque(q, v) - 0.1 * state["sum"], {"sum": state["sum"] + v}, {}


def test_a_controller_of_ones_own(arm, q0, agrees):
    law = Drive(lambda q, v: -5.0 * np.tanh(q) - 2.0 * v)
    run = k1607.rollout(arm, law, q0, 0.3, log=("q", "tau"), metrics={})
    agrees(run, k1607.simulate(arm, law, q0, 0.3), ("q", "tau"))
    both = k1607.rollout(arm, law, np.stack([q0 + 0.1, q0]), 0.3, log=("q", "tau"), metrics={})
    np.testing.assert_array_equal(both.q[1], run.q[0])


def test_a_controller_that_has_changed_is_traced_anew(arm, q0):
    """Whatever changes: an attribute of a controller, an array in place, or a signal."""
    law = Drive(lambda q, v: -5.0 * q)
    before = k1607.rollout(arm, law, q0, 0.05, metrics={}).q_end
    law.torque = lambda q, v: -50.0 * q
    assert (k1607.rollout(arm, law, q0, 0.05, metrics={}).q_end != before).all()


def test_an_array_changed_in_place_is_seen(arm, cartesian, q0):
    law = cartesian(arm)
    before = k1607.rollout(arm, law, q0, 0.05, metrics={}).q_end
    law.model.P[:] *= 1e6
    assert (k1607.rollout(arm, law, q0, 0.05, metrics={}).q_end != before).any()


def test_what_does_not_change_is_kept(arm, law):
    assert k1607.rollouts(arm, law, 0.05) is k1607.rollouts(arm, law, 0.05)


def if_in_python(q, v):
    return q if q[0] > 0 else v


def svd(q, v):
    return np.linalg.svd(np.outer(q, v))[1]


def by_float(q, v):
    return q * float(v[0])


def by_array(q, v):
    return np.array([*q[:6], v[6]])


@pytest.mark.parametrize(
    ("torque", "said"),
    [
        (if_in_python, "q if q[0] > 0 else v.*np.where"),
        (svd, "numpy.linalg.svd"),
        (by_float, "turned into a Python float"),
        (by_array, "use np.stack"),
    ],
)
def test_what_cannot_be_traced_is_named(arm, torque, said, q0):
    with pytest.raises(k1607.TracingError, match=f"(?s){said.replace('[', '.').replace(']', '.')}"):
        k1607.rollout(arm, Drive(torque), q0, 0.1)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"vary": {"controller.bet": [1.0]}}, "vary: expected some of .*controller.beta_1"),
        ({"vary": {"controller.beta_1": [1.0, np.nan]}}, "controller.beta_1: expected finite"),
        ({"vary": {"controller.beta_1": [-1.0]}}, "beta_1: expected a number >= 0"),
        ({"vary": {"controller.beta_1": [1.0, 2.0, -1.0, 3.0]}}, "beta_1: expected a number >= 0"),
        ({"vary": {"plant.viscous": np.ones((4, 7)) - 3 * np.eye(4, 7)}}, "viscous: expected"),
        (
            {"vary": {"payloads.0.payload.mass": [1.0, -1.0]}, "payloads": [(0.01, k1607.Payload(1.0))]},
            "mass: expected",
        ),
        ({"vary": {"controller.period": [0.01, 0.02]}}, "vary: expected no period"),
        ({"vary": {"controller.beta_1": np.ones((2, 2))}}, "expected .* got shape"),
        ({"vary": {"controller.beta_1": np.ones(2), "controller.beta_2": np.ones(3)}}, "as many"),
        ({"q0": np.zeros(6)}, "q0: expected"),
        ({"duration": -1.0}, "duration"),
        ({"control_period": 0.005}, "control_period: expected the controller"),
        ({"metrics": {"nonsense": "max"}}, "nonsense"),
        ({"metrics": {"error": "median"}}, "median"),
        ({"log": ("nonsense",)}, "nonsense"),
        ({"every": 0}, "every"),
        ({"threads": 0}, "threads"),
        ({"vary": {"plant.arm.armature": [np.ones(7), -np.ones(7)]}}, "armature: expected no negative"),
        ({"vary": {"plant.arm.inertial": -np.ones((2, 7, 10))}}, "inertial: expected no negative"),
        ({"signals": {"a/b": lambda log: log["t"]}}, "signals: expected names without /"),
        ({"signals": {"rollout": lambda log: log["t"]}}, "signals: every run logs"),
    ],
)
def test_bad_input(arm, law, change, said, q0):
    with pytest.raises(ValueError, match=said):
        k1607.rollout(**{"plant": arm, "controller": law, "q0": q0, "duration": 0.05} | change)


def test_progress_ends_with_one(arm, law, q0):
    told = []
    k1607.rollout(arm, law, q0, 0.05, vary={"controller.beta_1": np.ones(100)}, progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1
    assert len(told) > 5


@dataclass(frozen=True)
class Pulled:
    """A law with a function of one's own in it."""

    arm: k1607.Arm
    pull: Any

    def start(self, q, v, duration):
        return None

    def update(self, t, q, v, state):
        return self.pull(t, v), state, {}


def test_what_a_function_of_one_s_own_reads_may_change(arm, q0):
    gain = np.array([1.0])
    law = Pulled(arm, lambda t, v: -gain[0] * v)
    ends = []
    for x in (1.0, 50.0):
        gain[0] = x
        run = k1607.rollout(arm, law, q0, 0.1, np.ones(7), metrics={})
        reference = k1607.simulate(arm, law, q0, 0.1, np.ones(7))
        np.testing.assert_allclose(run.q_end.values[0], reference.q.values[-1], atol=1e-9)
        ends.append(run.q_end.values)
    assert np.abs(ends[0] - ends[1]).max() > 1e-3


def test_a_seed_that_is_no_whole_number_is_refused_wherever_it_is(arm, law, q0):
    seeds = np.arange(200.0)
    seeds[100] += 0.5
    with pytest.raises(ValueError, match=r"noise\.seed: expected whole numbers"):
        k1607.rollout(arm, with_noise(law, 7, 0.01, 1e-4, 1e-3), q0, 0.05, vary={"controller.noise.seed": seeds})


def test_numbers_of_numpy_and_one_name_do(arm, law, q0):
    run = k1607.rollout(arm, law, q0, 0.06, log="tau", every=np.int64(2), threads=np.int64(1))
    assert run.tau.shape == (1, 4, 7)


def on_the_tool(t, q, v):
    return k1607.Wrench(force=np.array([20.0, 0.0, 0.0]) * np.sin(30 * t) - 5 * v[:3], moment=np.array([0.0, 1.0, 0.0]))


def on_another_link(t, q, v):
    return k1607.Wrench(force=np.array([0.0, 30.0, 0.0]) * q[1], frame="link4", axes="frame")


@pytest.mark.parametrize("external", [on_the_tool, on_another_link, lambda t, q, v: None])
@pytest.mark.parametrize("step", [semi_implicit_euler, runge_kutta_4])
def test_a_world_that_is_a_function(arm, law, q0, agrees, external, step):
    settings = {"external": external, "step": step}
    run = k1607.rollout(arm, law, q0, 0.3, log=LOGGED, **settings)
    agrees(run, k1607.simulate(arm, law, q0, 0.3, **settings), LOGGED)


@pytest.mark.parametrize("threads", [1, 2])
def test_ctrl_c_is_heard_before_the_end(threads):
    """Of a call that would take minutes: sent when its first piece is done, it stops before its last."""
    code = (
        "import numpy as np, k1607_pin as k1607\n"
        "class Law:\n"
        "    def start(self, q, v, duration): return None\n"
        "    def update(self, t, q, v, state): return -v, None, {}\n"
        "run = k1607.rollouts(k1607.load_k1607(), Law(), 10.0, metrics={})\n"
        "run(np.zeros(7))\n"
        "print('begun', flush=True)\n"
        f"run(np.zeros((400_000, 7)), threads={threads}, progress=lambda share: print(share, flush=True))\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "begun\n"
    assert 0 < float(process.stdout.readline()) < 0.1
    process.send_signal(signal.SIGINT)
    shares, said = process.communicate(timeout=600)
    assert "KeyboardInterrupt" in said
    assert "1.0" not in shares.split()


WILD = np.array([1.0, 200.0])[:, None, None]  # times K_d: as it is, and far too much for torques held 10 ms


def test_what_has_run_away_stays_where_it_was(arm, law, q0):
    """Whatever is gripped afterwards, and whatever the others do."""
    settings = {"payloads": [(0.25, k1607.Payload(8.0))], "from_rest": True}
    vary = {"controller.gains.K_d": law.gains.K_d * WILD}
    run = k1607.rollout(arm, law, q0, 0.3, vary=vary, **settings)
    with pytest.raises(SimulationError) as lost:
        k1607.simulate(
            arm, replace(law, gains=Gains(law.gains.K_p, vary["controller.gains.K_d"][1])), q0, 0.3, **settings
        )
    assert lost.value.time < 0.2
    np.testing.assert_allclose(run.v_end[1], lost.value.v, rtol=1e-5)
    np.testing.assert_allclose(run.q_end[1], lost.value.q, rtol=1e-6)


def test_logs_of_a_block_that_has_run_away_end_in_nothing(arm, law, q0):
    vary = {"controller.gains.K_d": law.gains.K_d * WILD[[1] * 8]}
    run = k1607.rollout(arm, law, q0, 0.3, vary=vary, log=("q", "t"))
    after = run.time.values > run.failed_at.values.max()
    assert after.any()
    assert np.isnan(run.q.values[:, after]).all()
    assert np.isfinite(run.q.values[:, ~after][:, :3]).all()


@dataclass(frozen=True)
class Remembers:
    """A law without ``initial``: what it starts from depends on its own number, and on where it is."""

    k: float

    def start(self, q, v, duration):
        return {"memory": self.k * q}

    def update(self, t, q, v, state):
        return state["memory"] - self.k * q - v, {"memory": 0.9 * state["memory"]}, {}


def test_a_start_that_depends_on_what_varies_is_asked_for_each(arm, q0):
    k = np.array([1.0, 5.0, 20.0, 50.0, 70.0])
    run = k1607.rollout(arm, Remembers(1.0), q0, 0.2, vary={"controller.k": k}, metrics={"tau": "max"})
    for i, x in enumerate(k):
        reference = k1607.simulate(arm, Remembers(x), q0, 0.2)
        np.testing.assert_allclose(run.q_end[i], reference.q[-1], atol=1e-10)


def test_what_a_signal_of_one_s_own_reads_may_change(arm, law, q0):
    gain = np.array([1.0])
    signals = {"pull": lambda log: gain[0] * log["t"]}
    for x in (1.0, 50.0):
        gain[0] = x
        run = k1607.rollout(arm, law, q0, 0.1, signals=signals, metrics={"pull": "last"})
        assert run.pull_last.values[0] == pytest.approx(0.1 * x)


@dataclass(frozen=True)
class Ends:
    """A law whose torque is no number from a time on."""

    since: float

    def start(self, q, v, duration):
        return None

    def update(self, t, q, v, state):
        return -5 * v - np.where(t < self.since, 1.0, np.sqrt(-1 - q * q)), state, {}


@pytest.mark.filterwarnings("ignore:invalid value")
def test_work_ends_with_the_last_torque_that_is_one(arm, q0):
    """Beside a loop that goes on."""
    run = k1607.rollout(arm, Ends(1.0), q0, 0.2, vary={"controller.since": [0.05, 1.0]}, metrics={})
    short = k1607.rollout(arm, Ends(1.0), q0, 0.05, metrics={})
    np.testing.assert_allclose(run.failed_at, [0.05, np.nan])
    assert run.work[0] == pytest.approx(float(short.work[0]), rel=1e-9)
    assert abs(run.work[1]) > 1.5 * abs(run.work[0]) > 0
