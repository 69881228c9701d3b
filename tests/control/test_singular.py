"""Laws of the tool in and near singular postures: refused with the remedy, or damped, and never a torque without bound."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.arm.ready import ready_postures
from k1607_pin.compiled.trace import trace
from k1607_pin.control.baselines import OperationalSpaceControl
from k1607_pin.control.cartesian import gains_from_inertia
from k1607_pin.control.hybrid import hybrid_gains
from k1607_pin.control.posture import hold, posture_torque
from k1607_pin.control.singular import force_for
from k1607_pin.dynamics.linear import smallest_eigenvalue
from k1607_pin.kinematics.differential import Damping, SingularJacobianError
from k1607_pin.paths.report_paths import Line
from k1607_pin.simulation.simulate import SimulationError, simulate

DAMPING = Damping()


def law_at(arm, q, damping=None, off=0.0, omega=20.0):
    """Holds the tool ``off`` m away, in every direction, from where q puts it."""
    tool = arm.forward_kinematics(q)
    path = Line(tool.translation + off, extent=np.zeros(3))
    return OperationalSpaceControl(arm, path, tool.rotation, omega, hold(q, 5.0) if arm.n > 6 else None, damping)


@pytest.mark.parametrize("near", [0.0, 1e-12, 1e-7])
def test_a_singular_start_is_refused_with_the_remedy(arm, near):
    q = near * np.arange(1.0, arm.n + 1)  # stretched out
    law = law_at(arm, q)
    with pytest.raises(SingularJacobianError, match=r"smallest singular value .*damping=Damping\(\.\.\.\)") as caught:
        simulate(arm, law, q, 0.1)
    again = pickle.loads(pickle.dumps(caught.value))
    assert str(again) == str(caught.value)
    replace(law, damping=DAMPING).start(q, np.zeros(arm.n), 1.0)


@pytest.mark.parametrize("near", [0.0, 1e-12])
def test_a_singular_posture_on_the_way_gives_no_torque_without_bound(arm, near):
    q, v = near * np.arange(1.0, arm.n + 1), np.full(arm.n, 0.1)
    with pytest.raises(SingularJacobianError):
        law_at(arm, q, off=0.01).update(0.1, q, v, None)


@pytest.mark.parametrize("seed", range(5))
def test_a_damped_torque_keeps_its_bound_everywhere(arm, seed):
    """|J^T (mobility + s I)^-1 a| <= |M^(1/2)| |a| / (2 s^(1/2)), as sigma / (sigma^2 + s) <= 1 / (2 s^(1/2)) for J M^(-1/2)."""
    rng = np.random.default_rng(seed)
    q, v = 10.0 ** rng.uniform(-9, 0) * rng.normal(size=arm.n), 0.1 * rng.normal(size=arm.n)
    law = law_at(arm, q, DAMPING, off=0.01)
    tau, _, log = law.update(0.0, q, v, None)
    J, M = arm.jacobian(q), arm.mass_matrix(q)
    a = 40 * log["error_rate"] + 400 * log["error"] - arm.jacobian_time_variation(q, v) @ v
    sigma, mobility = np.linalg.svd(J)[1][-1], np.trace(J @ np.linalg.solve(M, J.T))
    s = DAMPING.at(sigma) ** 2 * mobility / np.trace(J @ J.T)
    by_posture = hold(q, 5.0)[1:] if arm.n > 6 else None
    other = posture_torque(M, J, q, v, q, 0 * q, *by_posture) if by_posture else 0.0
    rest = tau - arm.bias_torque(q, v) - other
    heaviest = np.linalg.eigvalsh(M)[-1]
    if s > 0:
        assert np.linalg.norm(rest) <= np.sqrt(heaviest / s) / 2 * np.linalg.norm(a) * (1 + 1e-9) + 1e-9
    else:  # far from singular the law is what it is without
        assert np.array_equal(tau, replace(law, damping=None).update(0.0, q, v, None)[0])


def test_a_posture_asks_for_no_more_than_its_own_acceleration(arm):
    """|M^(1/2) (I - P) M^(1/2) wish| with 0 <= P <= I: no more than the largest inertia times the wish, singular or not."""
    rng = np.random.default_rng(3)
    for scale in (0.0, 1e-12, 1e-9, 1e-6, 1e-3, 1.0):
        q, v, wanted = scale * rng.normal(size=arm.n), rng.normal(size=arm.n), rng.normal(size=arm.n)
        M = arm.mass_matrix(q)
        tau = posture_torque(M, arm.jacobian(q), q, v, wanted, 0 * v, 5.0)
        wish = 25 * (wanted - q) - 10 * v
        assert np.linalg.norm(tau) <= np.linalg.eigvalsh(M)[-1] * np.linalg.norm(wish) * (1 + 1e-6)


def test_it_drives_out_of_a_singular_posture(reference):
    """From stretched out, 5 cm along what the arm can do: damped it comes, and its torque stays an arm's."""
    q = 1e-3 * np.arange(1.0, 8.0)
    tool = reference.forward_kinematics(q)
    law = OperationalSpaceControl(
        reference,
        Line(tool.translation, extent=np.array([-0.05, 0.0, 0.0])),
        tool.rotation,
        20.0,
        hold(q, 5.0),
        DAMPING,
    )
    log = simulate(reference, law, q, 1.0, control_period=0.002)
    assert np.abs(log.tau.values).max() < 1e3
    assert np.isfinite(log.q.values).all()


def test_a_run_into_a_singular_posture_ends_with_its_log(reference):
    """The law is told of a singular posture at its fifth sample."""
    q = ready_postures(reference)[0]
    law = law_at(reference, q)

    class Told:
        start = law.start

        def update(self, t, q, v, state):
            return law.update(t, 0 * q if t > 0.035 else q, v + 0.1, state)

    with pytest.raises(SimulationError, match="smallest singular value") as caught:
        simulate(reference, Told(), q, 0.1)
    assert caught.value.log.sizes["time"] == 4
    assert isinstance(caught.value.__cause__, SingularJacobianError)


def test_damping_rolls_out_compiled_as_it_is_simulated(reference):
    q = 1e-3 * np.arange(1.0, 8.0)
    law = law_at(reference, q, DAMPING, off=0.003)
    names = ("q", "tau", "error")
    run, wanted = k1607.rollout(reference, law, q, 0.2, log=names), simulate(reference, law, q, 0.2)
    for name in names:
        scale = np.abs(wanted[name].values).max()
        assert run[name].values[0] == pytest.approx(wanted[name].values, abs=1e-9 * scale)


def test_the_smallest_eigenvalue_traced_is_that_of_lapack():
    traced = trace(lambda A: smallest_eigenvalue(A) + np.zeros(1), "least", [(6, 6)])
    rng = np.random.default_rng(4)
    for _ in range(50):
        U = np.linalg.qr(rng.normal(size=(6, 6)))[0]
        sigma = 10.0 ** rng.uniform(-9, 1, 6)
        sigma[rng.integers(6)] = 0.0
        sigma[rng.integers(6)] = sigma[rng.integers(6)]  # twice the same
        A = (U * sigma) @ U.T
        A = (A + A.T) / 2
        assert float(traced(A.ravel())[0]) == pytest.approx(smallest_eigenvalue(A), abs=1e-14 * sigma.max())


def test_lambda_squared_is_the_square_of_lambda():
    for sigma in (0.0, 1e-9, 0.02, 0.049, 0.05, 1.0):
        assert DAMPING.squared(sigma**2) == pytest.approx(DAMPING.at(sigma) ** 2, rel=1e-12, abs=1e-18)


def test_no_wish_is_no_force():
    J = np.eye(6)
    assert (force_for(np.eye(6), np.zeros(6), J) == 0).all()


def test_what_is_no_damping_is_refused(reference):
    for bad in (0.05, True, "much"):
        with pytest.raises(ValueError, match=r"damping: expected a Damping or None, got"):
            law_at(reference, np.full(7, 0.5), bad)


@pytest.mark.parametrize("make", [gains_from_inertia, lambda arm, q, omega: hybrid_gains(arm, q, 1e4, omega, 20.0)])
def test_gains_advise_what_can_be_typed(reference, make):
    with pytest.raises(SingularJacobianError, match=r"ready_postures\(arm\)") as caught:
        make(reference, np.zeros(7), 5.0)
    assert "damping" not in str(caught.value)
    make(reference, ready_postures(reference)[0], 5.0)
