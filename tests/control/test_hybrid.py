"""The hybrid law by itself: one definition, the proof's algebra on the linear model, switches without a jump, bad input."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import k1607_pin as k1607
from k1607_pin.arm.reach import UnreachableError
from k1607_pin.compiled.trace import trace
from k1607_pin.control.adaptation import Gains
from k1607_pin.control.cartesian import cartesian_adaptive
from k1607_pin.control.hybrid import (
    HybridAdaptive,
    HybridState,
    Loop,
    Mode,
    hybrid_adaptive,
    hybrid_gains,
)
from k1607_pin.control.hybrid_law import per_stiffness
from k1607_pin.control.practice import OFF, Practice, relative_size
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.report_paths import Line

MODEL = reference_model(2 * np.ones(6), 3 * np.ones(6))
STIFFNESS = np.array([30.0, 20.0, 10.0, 3.0, 2.0, 1.0])
LOOP = Loop(MODEL.P_2, MODEL.P_3, 2.0, 3.0)
EVERY = Practice(sigma=0.1, gain_bound=0.5, dead_zone=1e-3, torque_limit=np.full(7, 20.0))


def sample(seed, selection=(1, 0, 0, 0, 1, 0), before=(1, 0, 0, 0, 1, 0)):
    """Arguments of `hybrid_adaptive` up to the state's entries, all different and none special."""
    rng = np.random.default_rng(seed)
    R, R_d = Rotation.random(2, rng).as_matrix()
    force = 5 * rng.normal(size=6) * selection
    held = 5 * rng.normal(size=6) * before
    pose = [rng.normal(size=3), R, rng.normal(size=(6, 7)), rng.normal(size=7), 5 * rng.normal(size=6)]
    wanted = [rng.normal(size=3), R_d, rng.normal(size=6), np.array(selection, float), force]
    roots = rng.normal(size=(4, 6, 6))
    gains = [root @ root.T + np.eye(6) + 0.1 * root for root in roots]
    gains[2:] = [STIFFNESS[:, None] * k for k in gains[2:]]  # as (H8) has them
    state = [*gains, rng.normal(size=7), np.array(before, float), held, *rng.normal(size=(4, 6))]
    return [*pose, *wanted, *state]


def law(*arguments, compliance=None, practice=OFF, **options):
    *now, K_p, K_d, K_pf, K_df = arguments[:14]
    state = HybridState(Gains(K_p, K_d), Gains(K_pf, K_df), *arguments[14:])
    C = Rotation.from_rotvec([0.3, -0.4, 0.5]).as_matrix() if compliance is None else compliance
    return hybrid_adaptive(
        *now, state, C, STIFFNESS, LOOP, LOOP, 0.1, 0.01, other_torque=0.1, practice=practice, force_practice=practice,
        force_integral=4.0, **options,
    )  # fmt: skip


def flat(step):
    state = step.state
    return (
        step.torque,
        *state.position,
        *state.force,
        *state[2:],
        step.error,
        step.force,
        step.force_error,
        step.share,
    )


@pytest.mark.parametrize("practice", [OFF, EVERY])
@pytest.mark.parametrize("before", [(1, 0, 0, 0, 1, 0), (0, 1, 0, 1, 1, 0)])
def test_traced_and_on_floats_agree(practice, before):
    arguments = sample(1, before=before)
    function = trace(lambda *x: flat(law(*x, practice=practice)), "hybrid", [np.shape(x) for x in arguments])
    for seed in range(5):
        arguments = sample(seed, before=before)
        outputs = function(*(np.ravel(x) for x in arguments))
        for got, expected in zip(outputs, flat(law(*arguments, practice=practice)), strict=True):
            got = np.array(got).reshape(np.shape(expected))
            assert got == pytest.approx(expected, rel=1e-12, abs=1e-11)


def test_with_nothing_selected_it_is_the_cartesian_scheme():
    nothing = np.zeros(6)
    arguments = sample(2, nothing, nothing)
    arguments[-4:] = [np.zeros(6)] * 4
    step = law(*arguments, compliance=np.eye(3))
    position, rotation, J, v, _, p_d, R_d, v_d = arguments[:8]
    gains = Gains(*arguments[10:12])
    same = cartesian_adaptive(position, rotation, J, v, p_d, R_d, v_d, gains, *LOOP, 0.01, other_torque=0.1)
    assert step.torque == pytest.approx(same.torque, rel=1e-12)
    assert np.concatenate(step.state.position) == pytest.approx(np.concatenate(same.gains), rel=1e-12)
    assert np.array_equal(np.concatenate(step.state.force), np.concatenate(arguments[12:14]))


def test_turning_the_world_with_the_compliance_frame_changes_no_torque():
    arguments = sample(3)
    C = Rotation.from_rotvec([0.3, -0.4, 0.5]).as_matrix()
    position, rotation, J, v, wrench, p_d, R_d, v_d = arguments[:8]

    def turn(x):
        return np.concatenate([C.T @ x[:3], C.T @ x[3:]])

    turned = [C.T @ position, C.T @ rotation, turn(J), v, turn(wrench), C.T @ p_d, C.T @ R_d, turn(v_d), *arguments[8:]]
    plain, other = law(*arguments, compliance=C), law(*turned, compliance=np.eye(3))
    for a, b in zip(flat(plain), flat(other), strict=True):
        assert a == pytest.approx(b, rel=1e-11, abs=1e-11)


def test_each_loop_acts_and_learns_in_its_own_directions_only():
    selection = np.array([1.0, 0, 0, 0, 1, 0])
    arguments = sample(4)
    for practice in (OFF, Practice(gain_bound=1.0)):
        state = law(*arguments, practice=practice).state
        moved = np.abs(state.position.K_p - arguments[10]) + np.abs(state.position.K_d - arguments[11]) > 0
        assert np.array_equal(moved, np.outer(1 - selection, 1 - selection) > 0)
        moved = np.abs(state.force.K_p - arguments[12]) + np.abs(state.force.K_d - arguments[13]) > 0
        assert np.array_equal(moved, np.outer(selection, selection) > 0)


def test_the_force_loop_does_not_learn_off_the_wall():
    arguments = sample(5)
    loud = np.abs(arguments[4]).max() * 2
    for wrench, touch in ((np.zeros(6), 0.0), (arguments[4], loud), (arguments[4], np.full(6, loud))):
        arguments[4] = wrench
        state = law(*arguments, touch=touch).state
        assert np.array_equal(state.force.K_p, arguments[12])
        assert np.array_equal(state.integral, arguments[-1])
        assert not np.array_equal(state.position.K_p, arguments[10])


def test_the_integral_adds_up_force_errors_where_they_are_controlled():
    arguments = sample(6)
    arguments[-4] = np.zeros(6)  # no offset left
    step = law(*arguments)
    assert step.state.integral - arguments[-1] == pytest.approx(0.01 * 4.0 * step.force_error, rel=1e-9)
    assert np.array_equal(step.state.integral[arguments[8] == 0], arguments[-1][arguments[8] == 0])
    # and is part of the command there
    without = [*arguments[:-1], np.zeros(6)]
    assert step.command - law(*without).command == pytest.approx(arguments[8] * arguments[-1], abs=1e-10)


def test_the_integral_rests_in_saturation():
    arguments = sample(6)
    step = law(*arguments, practice=Practice(torque_limit=np.full(7, 1e-3)))
    assert step.share < 1
    assert np.array_equal(step.state.integral, arguments[-1])


def test_the_force_loop_s_bound_is_in_shares_of_what_the_contact_feels():
    """I + K_p over the stiffness is what moves, (H6)."""
    arguments = sample(7)
    arguments[8] = arguments[15] = np.ones(6)
    for bound in (0.01, 0.5):
        start = per_stiffness(Gains(*arguments[12:14]), STIFFNESS)
        after = per_stiffness(law(*arguments, practice=Practice(gain_bound=bound)).state.force, STIFFNESS)
        for k, k_0 in zip(after, start, strict=True):
            assert relative_size(k_0, k - k_0) <= bound * (1 + 1e-9)
            assert relative_size(k_0, k - k_0) >= (bound if bound < 0.1 else 0) * (1 - 1e-9)  # and it is called upon


@pytest.mark.parametrize("seed", range(5))
def test_at_a_switch_the_torque_is_what_it_would_have_been_without(seed):
    before, after = (1, 0, 0, 0, 1, 0), (0, 1, 0, 0, 1, 1)
    switching = sample(seed, after, before)
    staying = list(switching)
    staying[8:10] = switching[15:17]  # the selection and the wanted force of the last sample
    assert law(*switching).torque == pytest.approx(law(*staying).torque, rel=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_what_a_switch_leaves_behind_fades_and_starts_from_what_is(seed):
    arguments = sample(seed, (1, 0, 0, 0, 0, 0), np.zeros(6))
    arguments[-4:] = [np.zeros(6)] * 4
    step = law(*arguments)
    reference = arguments[9] + step.state.offset  # of the force, one period after
    jump = np.abs(arguments[9][0] - step.force[0])
    assert abs(reference[0] - step.force[0]) < 0.01 * jump  # (T / transition)^2 / 2
    state = step.state
    for _ in range(300):
        arguments = [*arguments[:10], *state.position, *state.force, *state[2:]]
        state = law(*arguments).state
    assert max(np.abs(state.offset).max(), np.abs(state.transfer).max()) < 1e-8


def linear_loop(rng, selection, ratio, coupled=False):
    """A contact of stiffness K / ratio felt by three masses: rate of (x, x', gains) under the law, and the pieces of its v."""
    S = np.array(selection, float)
    root = rng.normal(size=(3, 3))
    apart = np.ones((3, 3)) if coupled else np.outer(S, S) + np.outer(1 - S, 1 - S)
    Lambda = (root @ root.T) * apart + 10 * np.eye(3)
    Phi = rng.normal(size=(3, 3)) * apart
    K_hat = np.array([2e3, 1e3, 4e3])
    K_e = K_hat / ratio
    C = Rotation.random(rng=rng).as_matrix()
    delta_1, delta_2 = 400.0, 40.0
    model = reference_model(np.full(6, delta_1), np.full(6, delta_2), np.diag([400.0] * 6 + [1.0] * 6))
    p_2, p_3 = model.P_2[0, 0], model.P_3[0, 0]
    position_loop, force_loop = Loop(model.P_2, model.P_3, 5.0, 7.0), Loop(model.P_2, model.P_3, 1e-5, 1e-8)
    f_d = S * np.array([10.0, -5.0, 8.0])

    def rate(x, x_dot, K):
        f = S * K_e * x  # the wall's surface at x = 0, touched all the time
        state = HybridState(Gains(*K[:2]), Gains(*K[2:]), np.zeros(6), np.append(S, np.zeros(3)), 0, *np.zeros((4, 6)))
        step = hybrid_adaptive(
            C @ x, np.eye(3), np.eye(6), np.append(C @ x_dot, np.zeros(3)), np.append(-C @ f, np.zeros(3)),
            np.zeros(3), np.eye(3), np.zeros(6), np.append(S, np.zeros(3)), np.append(f_d, np.zeros(3)),
            state._replace(wanted_force=np.append(f_d, np.zeros(3))), C, np.append(K_hat, np.ones(3)),
            position_loop, force_loop, 0.1, 1.0,
        )  # fmt: skip
        F = C.T @ step.torque[:3]
        gains = np.array([*step.state.position, *step.state.force]) - K
        return x_dot, np.linalg.solve(Lambda, F - f - Phi @ x_dot), gains

    def lyapunov(x, x_dot, K):
        """v, and -E^T Q E, of both loops together."""
        v = claimed = 0.0
        for chosen, force in ((np.flatnonzero(S == 0), False), (np.flatnonzero(S), True)):
            if not len(chosen):
                continue
            block = np.ix_(chosen, chosen)
            k, k_hat, r = np.diag(K_e[chosen]), np.diag(K_hat[chosen]), ratio if force else 1.0
            L, P = Lambda[block], Phi[block]
            K_p, K_d = (K[2][block], K[3][block]) if force else (K[0][block], K[1][block])
            if force:
                e, e_rate = f_d[chosen] - k @ x[chosen], -k @ x_dot[chosen]
                B_1 = k @ np.linalg.solve(L, np.eye(len(chosen)) + K_p)
                B_2 = k @ np.linalg.solve(L, P @ np.linalg.inv(k) + r * K_d)
                scaled = np.linalg.solve(k_hat, L) @ np.linalg.inv(k_hat)
                Psi_1, Psi_2 = r * scaled / force_loop.beta_1, scaled / (r * force_loop.beta_2)
            else:
                e, e_rate = -x[chosen], -x_dot[chosen]
                B_1, B_2 = np.linalg.solve(L, K_p), np.linalg.solve(L, P + K_d)
                Psi_1, Psi_2 = L / position_loop.beta_1, L / position_loop.beta_2
            # The P that belongs to a rate felt r times too large; r = 1 has the reference model's own p_2, p_3.
            p_1 = delta_2 * p_2 + delta_1 * r * p_3
            v += p_1 * e @ e + 2 * p_2 * e @ e_rate + r * p_3 * e_rate @ e_rate
            for X, Psi in (
                (B_1 - delta_1 * np.eye(len(e)), Psi_1),
                (B_2 - delta_2 * np.eye(len(e)), Psi_2),
            ):
                assert np.abs(Psi - Psi.T).max() < 1e-12 * np.abs(Psi).max()
                v += np.trace(X.T @ Psi @ X)
            claimed -= 2 * delta_1 * p_2 * e @ e + 2 * (delta_2 * r * p_3 - p_2) * e_rate @ e_rate
        return v, claimed

    return rate, lyapunov


def measured_and_claimed(seed, selection, ratio, coupled=False):
    rng = np.random.default_rng(seed)
    rate, lyapunov = linear_loop(rng, selection, ratio, coupled)
    x, x_dot = 1e-2 * rng.normal(size=3), 0.1 * rng.normal(size=3)
    K = np.array([500 * np.eye(6), 50 * np.eye(6), 3 * np.eye(6), 0.05 * np.eye(6)]) + 0.01 * rng.normal(size=(4, 6, 6))
    dx, dv, dK = rate(x, x_dot, K)
    h = 1e-3  # v is a quadratic of x, x' and the gains: the central difference has no error but rounding
    ahead, behind = (lyapunov(x + s * dx, x_dot + s * dv, K + s * dK)[0] for s in (h, -h))
    return (ahead - behind) / (2 * h), lyapunov(x, x_dot, K)[1]


@pytest.mark.parametrize("selection", [(1, 0, 0), (1, 0, 1), (1, 1, 1), (0, 0, 0)])
@pytest.mark.parametrize("ratio", [1.0, 3.0, 100.0])
def test_v_falls_as_claimed_on_the_linear_model_with_both_loops(selection, ratio):
    """Stiffness assumed right, 3 and 100 times too large; force directions of unlike stiffness, coupled among themselves."""
    for seed in range(4):
        measured, claimed = measured_and_claimed(seed, selection, ratio)
        assert claimed < 0
        assert measured == pytest.approx(claimed, rel=1e-6)


def test_a_stiffness_assumed_too_small_leaves_the_proof_at_its_bound():
    """Delta_2 r P_3 > P_2: with this model down to r = 1/3 or so; below it Q is not definite any more."""
    model = reference_model(2 * np.ones(1), 3 * np.ones(1))
    bound = model.P_2[0, 0] / (3 * model.P_3[0, 0])
    assert bound == pytest.approx(1 / 3)
    for ratio in (0.9 * bound, 1.1 * bound):
        assert (2 * (3 * ratio * model.P_3[0, 0] - model.P_2[0, 0]) > 0) == (ratio > bound)


def test_coupling_between_the_loops_is_not_covered():
    differences = [np.subtract(*measured_and_claimed(seed, (1, 0, 1), 1.0, coupled=True)) for seed in range(4)]
    assert np.abs(differences).max() > 1


@pytest.mark.parametrize("softer", [1.0, 10.0, 100.0])
def test_initial_gains_make_the_contact_they_say(arm, softer):
    q, K, omega, damping = np.full(arm.n, 0.5), 1e4, 90.0, 0.7
    position, force = hybrid_gains(arm, q, K, 20.0, omega, 1.0, damping)
    Lambda = arm.operational_space(q, np.zeros(arm.n)).Lambda
    k = K / softer
    B_1 = k * np.linalg.solve(Lambda, np.eye(6) + force.K_p)
    B_2 = np.linalg.solve(Lambda, K * force.K_d)
    assert B_1 == pytest.approx(omega**2 / softer * np.eye(6), rel=1e-6, abs=1e-4)
    assert B_2 == pytest.approx(2 * damping * omega * np.eye(6), rel=1e-6, abs=1e-4)
    assert position.K_p == pytest.approx(400 * Lambda, rel=1e-9)


@pytest.mark.parametrize("softer", [1.0, 10.0, 100.0])
def test_the_integral_is_stable_up_to_its_bound_on_any_contact(softer):
    """(H11): a mass on a contact, its rates those of the law, which are linear in penetration, speed and integral."""
    mass, K, omega, damping, push = 3.0, 1e5, 200.0, 0.7, np.eye(6)[0]
    K_p, K_d = omega**2 * mass / K - 1, 2 * damping * omega * mass / K
    gains, still = Gains(K_p * np.eye(6), K_d * np.eye(6)), np.zeros(6)

    def rates(y, k_I):
        x, x_dot, z = (value * push for value in y)
        state = HybridState(gains, gains, still, push, still, still, still, still, z)
        step = hybrid_adaptive(
            x[:3], np.eye(3), np.eye(6), x_dot, -K / softer * x, np.zeros(3), np.eye(3), still, push, still, state,
            np.eye(3), np.full(6, K), LOOP, LOOP, 0.1, 1.0, force_integral=k_I,
        )  # fmt: skip
        return np.array([y[1], (step.command[0] - K / softer * y[0]) / mass, step.state.integral[0] - y[2]])

    for share in (0.99, 1.01):
        k_I = share * 2 * damping * omega * (1 + K_p)
        A = np.column_stack([rates(y, k_I) for y in np.eye(3)])
        assert (np.linalg.eigvals(A).real.max() < 0) == (share < 1)


def controller(arm, **changes):
    tool = arm.forward_kinematics(np.full(arm.n, 0.5))
    gains, force_gains = hybrid_gains(arm, np.full(arm.n, 0.5), 1e4, 5.0, 20.0)
    arguments = {
        "arm": arm,
        "path": Line(tool.translation),
        "rotation": tool.rotation,
        "modes": Mode((0, 0, 1, 0, 0, 0), (0, 0, 10.0, 0, 0, 0)),
        "sensor": lambda t, q, v: np.zeros(6),
        "stiffness": 1e4,
        "gains": gains,
        "force_gains": force_gains,
        "model": MODEL,
        "force_model": MODEL,
        "beta_1": 1.0,
        "beta_2": 1.0,
        "force_beta_1": 1e-9,
        "force_beta_2": 1e-12,
        "period": 0.001,
    }
    return HybridAdaptive(**(arguments | changes))


def test_modes_hold_from_their_times_on(reference):
    push = Mode(np.diag([0, 0, 1, 0, 0, 0]), lambda t: (0, 0, 10 * t, 0, 0, 0), 1.0)
    law = controller(reference, modes=[Mode(np.zeros(6)), push, Mode(np.zeros(6), time=2.0)])
    assert [law.mode(t)[0].tolist() for t in (0, 0.998, 2.0, 9.0)] == [[0] * 6] * 4
    for t in (1.0, 1000 * 0.001, 1.999 - 1e-12):
        selection, force = law.mode(t)
        assert selection.tolist() == [0, 0, 1, 0, 0, 0]
        assert force.tolist() == [0, 0, 10 * t, 0, 0, 0]
    as_function = replace(law, modes=lambda t: push if 1 <= t < 2 else Mode(np.zeros(6)))
    for t in (0.5, 1.5, 2.5):
        assert np.array_equal(as_function.mode(t), law.mode(t))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"modes": Mode((0, 0, 0.5, 0, 0, 0))}, r"modes\[0\]: expected a selection of .* zeros and ones, got .*0\.5"),
        ({"modes": Mode(np.ones((6, 6)))}, "zeros and ones"),
        ({"modes": Mode((1, 0, 0))}, "zeros and ones"),
        ({"modes": Mode((0, 0, 1, 0, 0, 0), (0, 2.5, 1, 0, 0, 0))}, r"position-controlled axes, got 2\.5 on axis 1"),
        ({"modes": Mode((0, 0, 1, 0, 0, 0), (0, 0, np.nan, 0, 0, 0))}, "finite"),
        ({"modes": Mode((0, 0, 1, 0, 0, 0), np.zeros(3))}, r"\(6,\)"),
        ({"modes": []}, "modes: expected times"),
        ({"modes": [Mode(np.zeros(6), time=0.5)]}, "rise from 0"),
        ({"modes": [Mode(np.zeros(6)), Mode(np.ones(6), time=0.0)]}, "rise from 0"),
        ({"modes": [(0, 0, 1, 0, 0, 0)]}, "expected a Mode"),
        ({"compliance": np.diag([1.0, 1.0, -1.0])}, "compliance: expected a .* rotation"),
        ({"compliance": 2 * np.eye(3)}, "compliance"),
        ({"compliance": np.eye(2)}, "compliance"),
        ({"rotation": np.ones((3, 3))}, "rotation"),
        ({"stiffness": -1e4}, r"stiffness: expected .* positive numbers in N/m.*got -10000"),
        ({"stiffness": np.ones(3)}, "stiffness"),
        ({"stiffness": np.inf}, "stiffness"),
        ({"transition": 0.0}, "transition"),
        ({"period": -1.0}, "period"),
        ({"beta_1": -1.0}, "beta_1"),
        ({"force_beta_2": -1.0}, "force_beta_2: expected a number >= 0"),
        (
            {"force_gains": Gains(np.eye(6), np.eye(5))},
            r"force_gains\.K_d: expected \(6, 6\) finite numbers",
        ),
        ({"force_integral": -1.0}, "force_integral: expected a number >= 0 in 1/s, got -1.0"),
        ({"force_integral": np.ones(6)}, "force_integral"),
        ({"touch": "a"}, r"touch: expected one or \(6,\) numbers >= 0"),
        ({"transition": np.nan}, "transition"),
        ({"stiffness": 1e4j}, "stiffness"),
        ({"modes": 3}, "modes: expected a Mode, a sequence of Modes, or a function of time, got 3"),
        ({"modes": Mode("abc")}, "zeros and ones"),
        ({"modes": Mode(np.zeros(6), time=np.inf)}, "time"),
        ({"touch": np.full(6, np.nan)}, "touch"),
        ({"practice": Practice(gain_bound=1.0), "gains": Gains(np.eye(6), np.zeros((6, 6)))}, r"expected .* K_d\(0\)"),
        (
            {"force_practice": Practice(gain_bound=1.0), "force_gains": Gains(-2 * np.eye(6), np.eye(6))},
            "force_practice.gain_bound",
        ),
        ({"force_model": reference_model(np.ones(2), np.ones(2))}, "force_model"),
        ({"practice": Practice(torque_limit=np.ones(3))}, "torque_limit"),
        ({"force_practice": Practice(dead_zone=np.ones(3))}, "dead_zone"),
    ],
)
def test_bad_input_is_refused(reference, changes, words):
    with pytest.raises(ValueError, match=words):
        controller(reference, **changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"modes": lambda t: Mode((0, 0, 1, 0, 0, 2))}, r"modes\(0\)"),
        ({"modes": lambda t: Mode(np.zeros(6), (1, 0, 0, 0, 0, 0))}, "position-controlled axes, got 1 on axis 0"),
        ({"modes": Mode(np.zeros(6), lambda t: (0, 0, 0, 0, 0, 3.0))}, r"force\(0\).*got 3 on axis 5"),
        ({"sensor": lambda t, q, v: np.zeros(3)}, r"sensor: expected \(6,\)"),
    ],
)
def test_bad_functions_are_refused_when_called(reference, changes, words):
    law = controller(reference, **changes)
    with pytest.raises(ValueError, match=words):
        k1607.simulate(reference, law, np.full(7, 0.5), 0.01, control_period=0.001)


def test_a_path_out_of_reach_is_refused_only_where_all_is_position_controlled(reference, caplog):
    """A force may keep the tool from where the path has left the arm's reach; nothing else does."""
    q, far = np.full(7, 0.5), Line(np.array([5.0, 0.0, 0.0]))
    law = controller(reference, path=far)
    law.start(q, np.zeros(7), 1.0)
    assert "cannot bring 'tool' to [5.0, 0.0, 0.0]" in caplog.text
    with pytest.raises(UnreachableError):
        replace(law, modes=Mode(np.zeros(6))).start(q, np.zeros(7), 1.0)


def test_a_path_without_velocities_or_orientation_is_refused(reference):
    tool = reference.forward_kinematics(np.full(7, 0.5))
    for changes, words in (
        ({"path": lambda t: tool}, r"path: expected a finite \(3,\) position at t = 0 s"),
        ({"rotation": None}, r"rotation: expected \(3, 3\), as the path's point at t = 0 s has none"),
    ):
        with pytest.raises(ValueError, match=words):
            controller(reference, **changes).start(np.full(7, 0.5), np.zeros(7), 1.0)
