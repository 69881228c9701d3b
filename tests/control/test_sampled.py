"""What the linear model of a sampled loop says of it, against closed forms and against the loops as they run, (H12)."""

import pickle

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

import k1607_pin as k1607
from k1607_pin.arm.ready import ready_postures
from k1607_pin.arm.wrench import Wrench
from k1607_pin.control.adaptation import Gains
from k1607_pin.control.hybrid import HybridAdaptive, Mode, UnstableGainsError, hybrid_gains
from k1607_pin.control.hybrid_gains import hybrid_loop
from k1607_pin.control.practice import Practice
from k1607_pin.control.reference_model import reference_model
from k1607_pin.control.sampled import Sampled, growth, pd_growth, transition
from k1607_pin.paths.report_paths import Line
from k1607_pin.simulation.integrators import runge_kutta_4
from k1607_pin.simulation.simulate import simulate

PERIOD = 1e-3
STIFFNESS = np.array([3e4] * 3 + [3e2] * 3)
PUSH = (1, 0, 0, 0, 0, 0)
MODEL = reference_model(2 * np.ones(6), 3 * np.ones(6))


@pytest.mark.parametrize("omega_T", [0.1, 0.5, 0.99, 1.01, 1.5])
def test_critical_damping_holds_while_omega_T_is_below_1(omega_T):
    """z^2 - (2 - a - b) z + 1 - b + a with a = (omega T)^2 / 2, b = 2 omega T: stable for omega T < 1, by Jury."""
    rng = np.random.default_rng(5)
    root = rng.normal(size=(3, 3))
    mass, omega = root @ root.T + np.eye(3), omega_T / PERIOD
    a, b = omega_T**2 / 2, 2 * omega_T
    roots = np.roots([1, -(2 - a - b), 1 - b + a])
    grows = pd_growth(mass, Gains(omega**2 * mass, 2 * omega * mass), PERIOD)
    assert grows == pytest.approx(np.abs(roots).max(), rel=1e-6)
    assert (grows < 1) == (omega_T < 1)


def test_a_period_is_what_its_thousand_parts_make():
    """Contact, filter and integral: the exact transition against small Euler steps of the same loop, of first order."""
    rng = np.random.default_rng(6)
    root, K, D, contact, integral = rng.normal(size=(5, 2, 2))
    loop = Sampled(root @ root.T, K, D, contact @ contact.T, integral, 0.3)
    s, T = rng.normal(size=8), 0.5

    def after(parts):
        x, v, w, z = s.reshape(4, 2)
        w = w + 0.3 * (v - w)
        force, z = z - K @ x - D @ w, z - T * integral @ x
        for _ in range(parts):
            x, v = x + T / parts * v, v + T / parts * loop.mobility @ (force - loop.contact @ x)
        return np.concatenate([x, v, w, z])

    assert transition(loop, T) @ s == pytest.approx(2 * after(4000) - after(2000), rel=1e-5, abs=1e-6)


def test_the_integral_s_bound_is_h11_where_the_period_is_short():
    m, K, omega, damping = 3.0, 1e4, 90.0, 0.7
    K_p, K_d = omega**2 * m / K - 1, 2 * damping * omega * m
    for share in (0.98, 1.02):
        k_I = share * (1 + K_p) * 2 * damping * omega
        one = np.eye(1)
        loop = Sampled(one / m, K_p * K * one, K_d * one, K * one, k_I * K * one)
        assert (growth(loop, 1e-6) < 1) == (share < 1)


@pytest.fixture(scope="module")
def panda():
    return k1607.load_example("panda")


def tilted():
    """Compliance axes (3, 3), x along -(0.2, 0.3, 1)."""
    n = np.array([0.2, 0.3, 1.0]) / np.linalg.norm([0.2, 0.3, 1.0])
    C = np.column_stack([-n, *np.linalg.svd(n[None])[2][1:]])
    C[:, 2] *= np.sign(np.linalg.det(C))
    return C


def mobility(arm, q, C):
    J = block_diag(C, C).T @ arm.jacobian(q)
    return J @ np.linalg.solve(arm.mass_matrix(q), J.T)


def hybrid(arm, q, omega, C, sensor, **more):
    tool = arm.forward_kinematics(q)
    gains = hybrid_gains(arm, q, STIFFNESS, omega, 200.0, 1.0, 0.7, C)
    return HybridAdaptive(
        arm, Line(tool.translation, extent=np.zeros(3)), tool.rotation, Mode(PUSH), sensor, STIFFNESS, *gains, MODEL, MODEL,
        0.0, 0.0, 0.0, 0.0, PERIOD, C, practice=Practice(gravity=True), **more,
    )  # fmt: skip


@pytest.mark.parametrize(("contact", "grows"), [(0.0, 1.11308), (1.0, 1.12352)])
def test_a_panda_with_tilted_axes_runs_away_as_predicted(panda, monkeypatch, contact, grows):
    """From 1e-9 rad/s: what grows is the linear model's fastest motion, until the arm is no longer linear."""
    q, C = ready_postures(panda)[0], tilted()
    start = panda.forward_kinematics(q).translation

    def spring(t, q, v):
        depth = (panda.forward_kinematics(q).translation - start) @ C[:, 0]
        return np.append(-contact * STIFFNESS[0] * depth * C[:, 0], np.zeros(3))

    law = hybrid(panda, q, 60.0, C, spring)
    with pytest.raises(UnstableGainsError):
        law.start(q, np.zeros(7), 1.0)
    monkeypatch.setattr(HybridAdaptive, "_require_stable", lambda law, q: None)
    v0, pushes = 1e-9 * np.random.default_rng(0).normal(size=7), lambda t, q, v: Wrench(spring(t, q, v)[:3])
    log = simulate(panda, law, q, 0.1, v0, PERIOD, PERIOD / 2, runge_kutta_4, external=pushes)
    speed = np.linalg.norm(log.v.values, axis=1)
    predicted = growth(hybrid_loop(mobility(panda, q, C), law.gains, law.force_gains, STIFFNESS, PUSH, contact), PERIOD)
    assert predicted == pytest.approx(grows, abs=1e-5)
    assert (speed[-1] / speed[-21]) ** (1 / 20) - 1 == pytest.approx(predicted - 1, rel=1e-3)


def test_the_limit_is_named_and_is_the_limit(panda):
    q, C = ready_postures(panda)[0], tilted()
    arguments = panda, q, STIFFNESS

    def made(omega, period=PERIOD):
        return hybrid_gains(*arguments, omega, 200.0, 1.0, 0.7, C, period, PUSH)

    with pytest.raises(
        UnstableGainsError, match=r"^gains, force_gains: errors grow 1\.12.* omega of at most 48\.1"
    ) as caught:
        made(60.0)
    assert "a control period of at most 0.000945 s" in str(caught.value)
    assert caught.value.growth == pytest.approx(1.12352, abs=1e-5)
    again = pickle.loads(pickle.dumps(caught.value))
    assert (again.growth, str(again)) == (caught.value.growth, str(caught.value))
    made(48.1)
    made(60.0, 0.000944)
    for omega, period in ((48.2, PERIOD), (60.0, 0.000946)):
        with pytest.raises(UnstableGainsError):
            made(omega, period)
    hybrid(panda, q, 48.1, C, lambda t, q, v: np.zeros(6)).start(q, np.zeros(7), 1.0)


def test_every_listed_selection_is_looked_at(panda):
    q, C, sensor = ready_postures(panda)[0], tilted(), lambda t, q, v: np.zeros(6)
    tool = panda.forward_kinematics(q)
    gains = hybrid_gains(panda, q, STIFFNESS, 60.0, 200.0, 1.0, 0.7, C)

    def law(modes):
        return HybridAdaptive(
            panda, Line(tool.translation), tool.rotation, modes, sensor, STIFFNESS, *gains, MODEL, MODEL, 0.0, 0.0, 0.0, 0.0,
            PERIOD, C,
        )  # fmt: skip

    free = Mode(np.zeros(6))
    law(free).start(q, np.zeros(7), 1.0)
    with pytest.raises(UnstableGainsError, match="force-controlled axes are: 0;"):
        law([free, Mode(PUSH, time=0.5)]).start(q, np.zeros(7), 1.0)


def test_a_period_needs_a_selection_and_the_other_way_round(panda):
    q = ready_postures(panda)[0]
    with pytest.raises(ValueError, match="selection: expected a selection"):
        hybrid_gains(panda, q, 1e4, 20.0, 100.0, period=PERIOD)
    with pytest.raises(ValueError, match="period: expected a positive number in s, got None"):
        hybrid_gains(panda, q, 1e4, 20.0, 100.0, selection=PUSH)


def test_turning_axes_and_arm_alike_changes_no_growth(panda):
    """Only where the axes lie against the arm counts: about the first joint both turn together."""
    q, R, grows = ready_postures(panda)[0], Rotation.from_rotvec([0, 0, 0.7]).as_matrix(), []
    for turned, C in ((q, tilted()), (q + 0.7 * np.eye(7)[0], R @ tilted())):
        gains = hybrid_gains(panda, turned, STIFFNESS, 60.0, 200.0, 1.0, 0.7, C)
        grows.append(growth(hybrid_loop(mobility(panda, turned, C), *gains, STIFFNESS, PUSH), PERIOD))
    assert grows[0] == pytest.approx(grows[1], rel=1e-9)
