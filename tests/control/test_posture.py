"""Null-space posture: it moves the joints and not the tool."""

import numpy as np
import pytest

from k1607_pin.compiled.trace import trace
from k1607_pin.control.posture import along, damp, hold, posture_torque


def states(arm, count=20):
    rng = np.random.default_rng(8)
    return [
        (arm.random_configuration(rng), rng.normal(size=arm.n), arm.random_configuration(rng)) for _ in range(count)
    ]


def test_the_tool_is_not_accelerated(arm):
    for q, v, wanted in states(arm):
        M, J = arm.mass_matrix(q), arm.jacobian(q)
        tau = posture_torque(M, J, q, v, wanted, 0 * v, 3.0)
        freely = np.linalg.solve(M, tau)
        unprojected = np.abs(9 * (wanted - q) - 6 * v).max()
        # of the six tool directions, up to the condition of J M^-1 J^T times a rounding
        condition = np.linalg.cond(J @ np.linalg.solve(M, J.T))
        assert np.abs(J @ freely).max() < (1e-9 + 1e-13) * condition * unprojected  # LEAST, and rounding
        if arm.n == 6:
            assert np.abs(freely).max() < 1e-8 * condition * unprojected


def test_joints_are_drawn_towards_the_posture(reference):
    """The power of the torque on the way there is that of the wish's own null-space part: never against it."""
    for q, _, wanted in states(reference):
        M, J = reference.mass_matrix(q), reference.jacobian(q)
        tau = posture_torque(M, J, q, np.zeros(7), wanted, np.zeros(7), 1.0)
        assert tau @ (wanted - q) >= 0


def test_floats_and_symbols_agree(reference):
    q, v, wanted = states(reference)[0]
    M, J = reference.mass_matrix(q), reference.jacobian(q)
    traced = trace(posture_torque, "posture", [(7, 7), (6, 7), (7,), (7,), (7,), (7,), ()])
    found = np.array(traced(*(np.ravel(x) for x in (M, J, q, v, wanted, v, 2.0)))).ravel()
    expected = posture_torque(M, J, q, v, wanted, v, 2.0)
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


def test_the_null_space_gets_its_part_of_the_wish_and_the_tool_none(reference):
    """M^-1 tau = N (omega^2 e + damping e'), N = I - J_bar J: both errors count, and each with its own factor."""
    for q, v, wanted in states(reference):
        M, J, v_wanted = reference.mass_matrix(q), reference.jacobian(q), np.linspace(-1, 1, 7)
        J_bar = np.linalg.solve(M, J.T) @ np.linalg.inv(J @ np.linalg.solve(M, J.T))
        for omega, damping, used in ((3.0, None, 6.0), (3.0, 1.5, 1.5), (0.0, 4.0, 4.0)):
            wish = omega**2 * (wanted - q) + used * (v_wanted - v)
            a = np.linalg.solve(M, posture_torque(M, J, q, v, wanted, v_wanted, omega, damping))
            expected = (np.eye(7) - J_bar @ J) @ wish
            assert np.abs(a - expected).max() < 1e-6 * np.abs(wish).max()  # `LEAST` and the condition
            assert np.abs(J @ a).max() < 1e-6 * np.abs(wish).max()


def test_damping_alone_brings_to_rest_and_draws_nowhere(reference):
    still = damp(7, 4.0)
    q, v, _ = states(reference)[0]
    M, J = reference.mass_matrix(q), reference.jacobian(q)
    assert not posture_torque(M, J, q, np.zeros(7), *still.path(0.3), *still[1:]).any()
    a = np.linalg.solve(M, posture_torque(M, J, q, v, *still.path(0.3), *still[1:]))
    null = np.linalg.svd(J)[2][6]  # the direction in which the tool rests
    assert a @ M @ null == pytest.approx(-4.0 * (v @ M @ null), rel=1e-6)
    with pytest.raises(ValueError, match="rate: expected a positive number"):
        damp(7, 0.0)


def test_postures_along_a_path_are_met_at_their_times_and_at_rest_at_the_ends():
    times, Q = np.linspace(0, 2, 9), np.random.default_rng(1).normal(size=(9, 7)).cumsum(axis=0)
    path = along(times, Q, 5.0).path
    for t, q in zip(times, Q, strict=True):
        assert path(t)[0] == pytest.approx(q, abs=1e-12)
    assert np.abs(path(0.0)[1]).max() < 1e-12
    assert np.abs(path(3.0)[1]).max() < 1e-12
    assert path(3.0)[0] == pytest.approx(Q[-1])
    h, (q, v) = 1e-6, path(0.77)
    assert np.abs((path(0.77 + h)[0] - path(0.77 - h)[0]) / (2 * h) - v).max() < 1e-7
    assert np.array_equal(hold(Q[0], 1.0).path(9.0)[0], Q[0])


def test_a_singular_posture_has_an_answer_and_bad_arguments_are_named(reference):
    q, v = np.zeros(7), np.ones(7)
    assert np.isfinite(posture_torque(reference.mass_matrix(q), reference.jacobian(q), q, v, q + 0.1, v, 3.0)).all()
    with pytest.raises(ValueError, match="omega"):
        hold(q, -1.0)
    with pytest.raises(ValueError, match="omega"):
        along(np.array([0.0, 1.0]), np.zeros((2, 7)), np.nan)
    with pytest.raises(ValueError, match="q: expected"):
        hold(np.full(7, np.nan), 1.0)
