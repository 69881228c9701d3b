"""What is not finite is refused by every law, by name; nothing that is not finite leaves one."""

import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from k1607_pin.control.adaptation import Gains
from k1607_pin.control.baselines import (
    ComputedTorque,
    GravityPD,
    OperationalSpaceControl,
    SlotineLi,
    parameter_rates,
)
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.finite import NotFiniteError, not_finite
from k1607_pin.control.hybrid import HybridAdaptive, Mode, hybrid_gains
from k1607_pin.control.joint_space import JointAdaptive, gains_from_mass, model_from_mass
from k1607_pin.control.posture import Posture, hold
from k1607_pin.control.practice import Practice
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.joint_plan import JointPoint
from k1607_pin.paths.report_paths import Line
from k1607_pin.simulation.simulate import SimulationError, simulate

Q, V = np.deg2rad([20.0, -30, 10, 80, 0, 60, 0]), np.full(7, 0.1)
PRACTICE = Practice(0.5, 0.2, 1e-3, np.full(7, 200.0), 200.0, True)
NAMES = (
    "joint", "joint, practice", "Cartesian", "Cartesian, practice", "hybrid", "PD", "computed torque", "operational space",
    "Slotine-Li",
)  # fmt: skip


def still(t):
    return JointPoint(Q, 0 * Q, 0 * Q)


@pytest.fixture(scope="module")
def laws(reference):
    """Name -> law and a state of it."""
    tool = reference.forward_kinematics(Q)
    line, R, model = Line(tool.translation), tool.rotation, reference_model(2 * np.ones(6), 3 * np.ones(6))
    gains, joint_model = gains_from_mass(reference, Q, 20.0), model_from_mass(reference, Q, 20.0)
    at_tool = gains_from_inertia(reference, Q, 20.0)
    push = Mode((1, 0, 0, 0, 0, 0), (10.0, 0, 0, 0, 0, 0))
    both, rates = hybrid_gains(reference, Q, 1e4, 10.0, 30.0), parameter_rates(reference, Q, gains.K_d / 2, 20.0)
    made = {
        "joint": JointAdaptive(reference, still, gains, joint_model, 1e3, 1e3, 0.01),
        "Cartesian": CartesianAdaptive(reference, line, R, at_tool, model, 1e3, 1e3, 0.01, hold(Q, 5.0)),
        "hybrid": HybridAdaptive(
            reference, line, R, push, lambda t, q, v: np.ones(6), 1e4, *both, model, model, 1.0, 1.0, 1e-9, 1e-12, 0.01
        ),
        "PD": GravityPD(reference, still, gains),
        "computed torque": ComputedTorque(reference, still, 20.0),
        "operational space": OperationalSpaceControl(reference, line, R, 20.0, hold(Q, 5.0)),
        "Slotine-Li": SlotineLi(reference, still, gains.K_d / 2, 20.0, rates, 0.01),
    }
    for name in ("joint", "Cartesian"):
        made[f"{name}, practice"] = replace(made[name], practice=PRACTICE)
    return {name: (law, law.start(Q, V, 1.0)) for name, law in made.items()}


def spoilt(x, value):
    """x with its last number replaced."""
    out = np.array(x, dtype=float)
    out.flat[-1] = value
    return out if out.ndim else float(out)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", NAMES)
def test_time_angles_and_velocities(laws, name, value):
    law, state = laws[name]
    for argument, given in (("t", (value, Q, V)), ("q", (0.1, spoilt(Q, value), V)), ("v", (0.1, Q, spoilt(V, value)))):
        with pytest.raises(NotFiniteError, match=f"^{argument}: expected finite numbers, got .*(nan|inf)") as caught:
            law.update(*given, state)
        assert caught.value.name == argument
        again = pickle.loads(pickle.dumps(caught.value))
        assert (again.name, str(again)) == (argument, str(caught.value))


def parts(state, name="state"):
    """Name of each array of a state, and the state with another in its place."""
    if isinstance(state, tuple):
        for field in state._fields:
            for inner, change in parts(getattr(state, field), f"{name}.{field}"):
                yield inner, lambda value, field=field, change=change: state._replace(**{field: change(value)})
    elif state is not None:
        yield name, lambda value: spoilt(state, value)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("name", NAMES)
def test_every_number_of_a_state(laws, name, value):
    law, state = laws[name]
    for part, change in parts(state):
        with pytest.raises(NotFiniteError) as caught:
            law.update(0.1, Q, V, change(value))
        assert caught.value.name == part


@pytest.mark.parametrize("name", NAMES)
def test_shapes(laws, name):
    law, state = laws[name]
    for bad in (Q[:6], np.zeros((7, 1)), 0.5, np.zeros((2, 7)), Q * 1j, ["a"] * 7, np.ma.masked_less(Q, 0.0), None):
        with pytest.raises(ValueError, match=r"^q: expected \(7,\) numbers"):
            law.update(0.1, bad, V, state)
        with pytest.raises(ValueError, match=r"^v: expected \(7,\) numbers"):
            law.update(0.1, Q, bad, state)
    for bad in ("0.1", None, np.zeros(2), 1j):
        with pytest.raises(ValueError, match=r"^t: expected a number in s"):
            law.update(bad, Q, V, state)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_a_number_is_taken_as_it_was(laws, name):
    law, state = laws[name]
    tau, _, _ = law.update(1.0, Q, V, state)
    for t, q in ((1, Q.tolist()), (np.float64(1.0), Q), (np.array(1), tuple(Q))):
        same, then, _ = law.update(t, q, V, state)
        assert np.array_equal(same, tau)
        assert not list(not_finite("", (same, then)))
    law.update(0, np.zeros(7, dtype=int) + 1, V.astype(np.float32), state)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("name", NAMES)
def test_a_path_is_named_with_its_time(laws, name, value):
    law, state = laws[name]
    fields = ["position", "velocity"] + (["acceleration"] if name in NAMES[6:] else [])
    for field in fields:
        point = law.path(0.5)
        wanted = {key: getattr(point, key) for key in ("position", "velocity", "acceleration")}
        bad = SimpleNamespace(**wanted | {field: spoilt(wanted[field], value)})
        with pytest.raises(NotFiniteError, match=rf"^path\(0.5\)\.{field}: "), np.errstate(all="ignore"):
            replace(law, path=lambda t, bad=bad: bad).update(0.5, Q, V, state)


@pytest.mark.parametrize("value", [np.nan, -np.inf])
def test_sensors_and_postures_are_named(laws, value):
    law, state = laws["hybrid"]
    for k in range(6):  # also of directions that are not force-controlled
        reads = np.where(np.arange(6) == k, value, 1.0)
        with pytest.raises(NotFiniteError, match=r"^sensor\(0.5, q, v\): "), np.errstate(all="ignore"):
            replace(law, sensor=lambda t, q, v, reads=reads: reads).update(0.5, Q, V, state)
    law, state = laws["Cartesian"]
    posture = Posture(lambda t: (spoilt(Q, value) if t > 0 else Q, 0 * Q), 5.0)
    with pytest.raises(NotFiniteError, match=r"^posture\.path\(0.5\), angles: "), np.errstate(all="ignore"):
        replace(law, posture=posture).update(0.5, Q, V, state)


def test_a_torque_or_a_state_that_runs_away_does_not_leave(laws):
    law, state = laws["joint"]
    huge = state._replace(gains=Gains(np.full((7, 7), 1e308), state.gains.K_d))
    with (
        pytest.raises(NotFiniteError, match=r"^torque: .* the gains or the errors have run away"),
        np.errstate(all="ignore"),
    ):
        law.update(0.1, Q - 100, V, huge)
    fast = replace(law, beta_1=1e149)
    with pytest.raises(NotFiniteError, match=r"^next state\.gains\.K_p: "), np.errstate(all="ignore"):
        fast.update(0.1, Q - 1e90, V, state)


def test_huge_numbers_whose_squares_overflow_are_finite(laws):
    law, state = laws["joint"]
    calm = replace(law, beta_1=0.0, beta_2=0.0)
    large = state._replace(gains=Gains(state.gains.K_p, np.diag(np.full(7, 1e200))))
    assert np.isfinite(calm.update(0.1, Q, V, large)[0]).all()


def test_other_errors_stay_what_they_are(laws):
    def broken(t):
        raise KeyError("table")

    law, state = laws["PD"]
    with pytest.raises(KeyError, match="table"):
        replace(law, path=broken).update(0.1, Q, V, state)


def test_simulate_keeps_the_log_until_then(reference, laws):
    law, _ = laws["PD"]

    def path(t):
        return still(t) if t < 0.05 else SimpleNamespace(position=Q, velocity=np.full(7, np.nan))

    with pytest.raises(SimulationError, match=r"path\(0\.05\)\.velocity: expected finite numbers") as caught:
        simulate(reference, replace(law, path=lambda t: path(min(t, 0.05) if t < 0.2 else 0.0)), Q, 0.2)
    assert caught.value.log.sizes["time"] == 5
    assert isinstance(caught.value.__cause__, NotFiniteError)
