"""The textbook's laws: each follows; Slotine and Li's regressor, its V, and what it learns of a payload."""

import pickle

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.arm.payload import Payload, with_payload
from k1607_pin.control.adaptation import Gains
from k1607_pin.control.baselines import (
    ComputedTorque,
    GravityPD,
    OperationalSpaceControl,
    Regressor,
    SlotineLi,
    parameter_rates,
    parameters,
)
from k1607_pin.control.joint_space import gains_from_mass
from k1607_pin.paths.inverse_path import joint_path
from k1607_pin.paths.joint_plan import JointPoint
from k1607_pin.report.cases import study_case
from k1607_pin.simulation.integrators import runge_kutta_4
from k1607_pin.simulation.simulate import simulate

T, OMEGA, DURATION = 0.002, 60.0, 1.2


@pytest.fixture(scope="module", params=["k1607", "panda", "ur5"])
def case(request):
    arm = None if request.param == "k1607" else k1607.load_example(request.param)
    case = study_case(1, "recommended", arm)
    return case, joint_path(case.plant.arm, case.law.path, case.q0, DURATION, case.law.rotation)


def slotine_li(arm, path, q0, omega=OMEGA, rate=20.0, period=T):
    K_D = gains_from_mass(arm, q0, omega).K_d / 2
    return SlotineLi(arm, path, K_D, omega, parameter_rates(arm, q0, K_D, rate), period)


def made(name, case, path):
    arm = case.plant.arm
    return {
        "PD": lambda: GravityPD(arm, path, gains_from_mass(arm, case.q0, OMEGA)),
        "computed torque": lambda: ComputedTorque(arm, path, OMEGA),
        "operational space": lambda: OperationalSpaceControl(
            arm, case.law.path, case.law.rotation, OMEGA, case.law.posture
        ),
        "Slotine-Li": lambda: slotine_li(arm, path, case.q0),
    }[name]()


def run(arm, law, q0, duration=DURATION, period=T):
    return simulate(arm, law, q0, duration, None, period, period, runge_kutta_4)


@pytest.mark.parametrize(
    ("name", "within"), [("PD", 4e-3), ("computed torque", 2e-3), ("operational space", 2e-3), ("Slotine-Li", 2e-3)]
)
def test_each_follows(case, name, within):
    case, path = case
    log = run(case.plant.arm, made(name, case, path), case.q0)
    distance = np.linalg.norm(log.tool_position.values - case.law.path(log.time.values).position, axis=1)
    assert distance.max() < within  # m
    assert np.abs(log.error.values[:, 3:]).max() < 0.01  # rad
    assert np.linalg.norm(log.error.values[:, :3], axis=1) == pytest.approx(distance, abs=1e-6)


@pytest.mark.parametrize("name", ["computed torque", "operational space"])
def test_an_exact_model_leaves_what_the_held_torque_costs(case, name):
    """Half the period, half the error: nothing but the sampling is left."""
    case, path = case
    law = made(name, case, path)
    rms = [
        np.sqrt((run(case.plant.arm, law, case.q0, 0.6, period).error.values[:, :3] ** 2).mean())
        for period in (T, T / 4)
    ]
    assert rms[1] < 0.3 * rms[0]


def test_computed_torque_s_error_dies_out_as_its_double_pole(reference):
    """From 0.01 rad off: e(t) = 0.01 (1 + omega t) exp(-omega t)."""
    q = np.deg2rad([20.0, -30, 10, 80, 0, 60, 0])
    still = k1607.load_k1607().forward_kinematics(q)
    path = joint_path(reference, lambda t: _Rest(still.translation), q, 0.5)
    log = run(reference, ComputedTorque(reference, path, 20.0), q - 0.01, 0.5, 1e-4 * 5)
    expected = 0.01 * (1 + 20 * log.time.values) * np.exp(-20 * log.time.values)
    assert np.abs(log.joint_error.values - expected[:, None]).max() < 1e-4


class _Rest:
    velocity = acceleration = np.zeros(3)

    def __init__(self, position):
        self.position = position


def test_operational_space_is_decoupled_at_the_tool(reference):
    """An error along x alone dies out along x alone, whatever the null space does."""
    q = np.deg2rad([20.0, -30, 10, 80, 0, 60, 0])
    pose = reference.forward_kinematics(q)
    wanted = _Rest(pose.translation + np.array([0.01, 0, 0]))
    law = OperationalSpaceControl(reference, lambda t: wanted, pose.rotation, 20.0)
    error = run(reference, law, q, 0.5, 5e-4).error.values
    assert np.abs(error[-1]).max() < 1e-4
    assert np.abs(error[:, 1:]).max() < 1e-4


def test_regressor_is_that_of_the_bilinear_law(arm):
    rng, regressor = np.random.default_rng(87), Regressor(arm)
    theta, rotors = parameters(arm), arm.armature
    for _ in range(20):
        q = arm.random_configuration(rng)
        v, w, a = rng.normal(size=(3, arm.n))
        C = arm.coriolis_matrix(q, v)
        wanted = arm.mass_matrix(q) @ a + C @ w + arm.gravity_torque(q)
        assert regressor(q, v, w, a) @ theta + rotors * a == pytest.approx(
            wanted, abs=1e-10 * (1 + np.abs(wanted).max())
        )
        # and with one velocity it is inverse dynamics
        assert regressor(q, v, v, a) @ theta + rotors * a == pytest.approx(arm.inverse_dynamics(q, v, a), abs=1e-9)


def test_the_regressor_s_coriolis_matrix_makes_M_dot_less_2C_skew(arm):
    rng, regressor, theta, h = np.random.default_rng(2), Regressor(arm), parameters(arm), 1e-6
    q, still = arm.random_configuration(rng), np.zeros(arm.n)
    v = rng.normal(size=arm.n)
    g = arm.gravity_torque(q)
    C = np.column_stack([regressor(q, v, e, still) @ theta - g for e in np.eye(arm.n)])
    M_dot = (arm.mass_matrix(q + h * v) - arm.mass_matrix(q - h * v)) / (2 * h)
    S = M_dot - 2 * C
    assert np.abs(S + S.T).max() < 1e-7 * (1 + np.abs(M_dot).max())


def lyapunov(loaded, law, q, v, theta, wanted):
    """V at a state; also s."""
    s = wanted.velocity + law.omega * (wanted.position - q) - v
    d = (parameters(loaded) - theta) / np.sqrt(law.rates)
    return s @ loaded.mass_matrix(q) @ s / 2 + d @ d / 2, s


@pytest.mark.parametrize("seed", range(5))
def test_slotine_li_s_v_falls_as_minus_s_K_D_s(reference, seed):
    """Along the flow of the loaded arm from a random state, with a random estimate."""
    rng, h = np.random.default_rng(seed), 1e-6
    loaded = with_payload(reference, Payload(4.5, cg=np.array([0.0, 0.05, 0.1])))
    q0, v0, a0, q, v = np.deg2rad([20.0, -30, 10, 80, 0, 60, 0]) + 0.1 * rng.normal(size=(5, 7))

    def path(t):
        return JointPoint(q0 + t * (v0 + t / 2 * a0), v0 + t * a0, a0)

    law = slotine_li(reference, path, q0, 10.0, 5.0, 0.001)
    theta = parameters(reference) * rng.uniform(0.5, 1.5, 70)
    tau, after, _ = law.update(0.0, q, v, theta)
    a, rate = loaded.forward_dynamics(q, v, tau), (after - theta) / law.period
    V, s = lyapunov(loaded, law, q, v, theta, path(0.0))
    up, down = (
        lyapunov(loaded, law, q + t * v + t * t / 2 * a, v + t * a, theta + t * rate, path(t))[0] for t in (h, -h)
    )
    assert (up - down) / (2 * h) == pytest.approx(-s @ law.K_D @ s, abs=1e-8 * V / h**0.5)


def test_slotine_li_s_v_falls_on_the_way_but_for_the_sampling(reference):
    case = study_case(1, "recommended")
    path = joint_path(reference, case.law.path, case.q0, 0.4, case.law.rotation)
    law = slotine_li(reference, path, case.q0, 20.0, 5.0, 2e-4)
    loaded = with_payload(reference, Payload(4.5))
    log = run(loaded, law, case.q0, 0.4, 2e-4)
    samples = zip(log.time.values, log.q.values, log.v.values, log.parameters.values, strict=True)
    V = np.array([lyapunov(loaded, law, q, v, theta, path(t))[0] for t, q, v, theta in samples])
    lost = np.einsum("ti,ij,tj->t", log.s.values, law.K_D, log.s.values)
    assert (np.diff(V) <= 1e-5 * V[0]).all()
    assert V[0] - V[-1] == pytest.approx(np.trapezoid(lost, log.time.values), rel=0.02)


def test_slotine_li_learns_what_a_fixed_model_gets_wrong(case):
    case, path = case
    arm = case.plant.arm
    loaded = with_payload(arm, case.payload)
    fixed = run(loaded, made("computed torque", case, path), case.q0)
    adaptive = run(loaded, made("Slotine-Li", case, path), case.q0)
    ends = [np.linalg.norm(log.error.values[-200:, :3], axis=1).mean() for log in (fixed, adaptive)]
    assert ends[1] < 0.3 * ends[0]
    # the torque it would predict at the end is the loaded arm's
    q, still = adaptive.q.values[-1], np.zeros(arm.n)
    held = Regressor(arm)(q, still, still, still) @ adaptive.parameters.values[-1]
    before, after = (np.abs(x - loaded.gravity_torque(q)).max() for x in (arm.gravity_torque(q), held))
    assert after < 0.3 * before


def test_parameter_rates_set_the_fastest_of_gravity(reference):
    q, K_D = np.deg2rad([20.0, -30, 10, 80, 0, 60, 0]), 30 * np.eye(7)
    rates, still = parameter_rates(reference, q, K_D, 4.0), np.zeros(7)
    Y = Regressor(reference)(q, still, still, still)
    assert np.linalg.eigvals(np.linalg.solve(K_D, (Y * rates) @ Y.T)).real.max() == pytest.approx(4.0)
    weightless = k1607.load_k1607(gravity=(0, 0, 0))
    assert parameter_rates(weightless, q, K_D, 4.0) == pytest.approx(rates)


def test_a_controller_can_be_pickled(reference):
    path = joint_path(
        reference, lambda t: _Rest(reference.forward_kinematics(np.ones(7) * 0.5).translation), np.ones(7) * 0.5, 1.0
    )
    law = slotine_li(reference, path, np.ones(7) * 0.5)
    again = pickle.loads(pickle.dumps(law))
    state = law.start(np.ones(7) * 0.5, np.zeros(7), 1.0)
    assert (
        again.update(0.0, np.ones(7) * 0.4, np.ones(7), state)[0]
        == law.update(0.0, np.ones(7) * 0.4, np.ones(7), state)[0]
    ).all()


def test_what_makes_no_sense_is_refused(reference):
    with pytest.raises(ValueError, match="K_p"):
        GravityPD(reference, lambda t: None, Gains(np.eye(6), np.eye(7)))
    with pytest.raises(ValueError, match="omega: expected a positive number in 1/s, got 0"):
        ComputedTorque(reference, lambda t: None, 0.0)
    with pytest.raises(ValueError, match="rotation"):
        OperationalSpaceControl(reference, lambda t: None, np.eye(4), 1.0)
    good = (np.eye(7), 1.0, np.ones(70), 0.01)
    for k, bad in enumerate((np.eye(6), np.nan, -np.ones(70), 0.0)):
        with pytest.raises(ValueError, match=("K_D", "omega", "rates", "period")[k]):
            SlotineLi(reference, lambda t: None, *(bad if i == k else x for i, x in enumerate(good)))
