"""Lambda, Phi, Gamma and the null-space part: identities that hold for six joints and for seven."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import k1607_pin as k1607
from k1607_pin.arm.bodies import bodies
from k1607_pin.compiled.trace import trace
from k1607_pin.dynamics.linear import solve_definite
from k1607_pin.dynamics.operational_space import operational_space, operational_space_of_bodies
from k1607_pin.kinematics.differential import Damping, SingularJacobianError, nullspace_projector

ARMS = {
    "k1607": k1607.load_k1607,
    "panda": lambda: k1607.load_example("panda"),
    "ur5": lambda: k1607.load_example("ur5"),
    "xarm7": lambda: k1607.load_example("xarm7"),
}


@pytest.fixture(scope="module", params=list(ARMS))
def arm(request):
    """Three redundant arms and one without a null space."""
    return ARMS[request.param]()


def states(arm, count, seed=39):
    rng = np.random.default_rng(seed)
    while count:
        q, v, a = arm.random_configuration(rng), rng.normal(size=arm.n), rng.normal(size=arm.n)
        if np.linalg.svd(arm.jacobian(q), compute_uv=False)[-1] > 0.1:
            count -= 1
            yield q, v, a


def position(arm, q):
    T = arm.forward_kinematics(q)
    return np.concatenate([T.translation, pin.log3(T.rotation)])


def small(x, *scales, digits=1e-9):
    """x against the largest entries of what it is a difference of, the arms' condition numbers of up to 1e5 allowed for."""
    assert np.abs(x).max() < digits * max(np.abs(s).max() for s in scales)


def test_equation_39_with_its_null_space_part_is_the_applied_force(arm):
    for q, v, a in states(arm, 20):
        space = arm.operational_space(q, v)
        force = space.jacobian_bar.T @ arm.inverse_dynamics(q, v, a)
        x_dot = space.jacobian @ v
        x_ddot = space.jacobian @ a + arm.jacobian_time_variation(q, v) @ v
        sum_ = space.Lambda @ x_ddot + space.Phi @ x_dot + space.Gamma @ position(arm, q) + space.bias_nullspace
        assert np.abs(sum_ - force).max() < 1e-11 * np.abs(space.Lambda).max() * (1 + np.abs(x_ddot).max())


def test_lambda_is_the_inverse_mobility(arm):
    for q, v, _ in states(arm, 20):
        space, M = arm.operational_space(q, v), arm.mass_matrix(q)
        J = space.jacobian
        assert np.abs(space.Lambda @ J @ np.linalg.inv(M) @ J.T - np.eye(6)).max() < 1e-9
        assert np.array_equal(space.Lambda, space.Lambda.T)
        assert np.linalg.eigvalsh(space.Lambda).min() > 0
        assert np.abs(J @ space.jacobian_bar - np.eye(6)).max() < 1e-9
        assert np.abs(space.Gamma @ position(arm, q) - space.gravity).max() < 1e-9
        small(space.gravity - space.jacobian_bar.T @ arm.gravity_torque(q), space.gravity, 1.0)
        assert np.linalg.matrix_rank(space.Gamma) <= 1  # least Frobenius norm


def test_lambda_dot_minus_2_phi_is_skew(arm):
    h = 1e-6
    for q, v, _ in states(arm, 10):
        change = (arm.operational_space(q + h * v, v).Lambda - arm.operational_space(q - h * v, v).Lambda) / (2 * h)
        S = change - 2 * arm.operational_space(q, v).Phi
        # central difference of Lambda: rounding eps |Lambda| cond / h, truncation h^2 times its third derivative
        assert np.abs(S + S.T).max() < 1e-5 * max(1.0, np.abs(S).max())


def test_lambda_dot_is_phi_and_its_transpose(arm):
    """The same without a step: the derivative of the traced Lambda along v is exact."""
    constants, (last, offset, rotation), g = bodies(arm.model), tool(arm), arm.model.gravity.linear
    Lambda = trace(
        lambda q: operational_space_of_bodies(constants, q, np.zeros(arm.n), last, offset, rotation, g).Lambda,
        "Lambda",
        [(arm.n,)],
    )
    q_, v_ = ca.SX.sym("q", arm.n), ca.SX.sym("v", arm.n)
    rate = ca.Function("rate", [q_, v_], [ca.jtimes(Lambda(q_), q_, v_)])
    for q, v, _ in states(arm, 10):
        Phi = arm.operational_space(q, v).Phi
        small(np.array(rate(q, v)) - (Phi + Phi.T), Phi, digits=1e-10)


def test_what_phi_and_the_null_space_s_bias_leave_out_of_velocity_forces_is_nothing(arm):
    for q, v, _ in states(arm, 20):
        space = arm.operational_space(q, v)
        force = space.jacobian_bar.T @ arm.coriolis_matrix(q, v) @ v
        sluggish = space.Lambda @ arm.jacobian_time_variation(q, v) @ v
        found = space.Phi @ space.jacobian @ v + space.bias_nullspace
        small(found - (force - sluggish), force, sluggish)


def test_nullspace_projector(arm):
    for q, v, _ in states(arm, 20):
        space, M = arm.operational_space(q, v), arm.mass_matrix(q)
        N, J = space.nullspace_projector, space.jacobian
        assert N.shape == (arm.n, arm.n)
        small(J @ N, 1.0)
        small(N @ N - N, 1.0)
        small(J @ np.linalg.solve(M, N.T), np.abs(J) @ np.abs(np.linalg.inv(M)))  # dynamically consistent
        small(N - nullspace_projector(J, np.linalg.inv(M)), 1.0)
        assert np.trace(N) == pytest.approx(arm.n - 6, abs=1e-9)
        if arm.n == 6:
            small(N, 1.0)


def test_null_space_motion_matters_only_where_there_is_one(arm):
    (q, v, _), *_ = states(arm, 1)
    bias = np.abs(arm.operational_space(q, v).bias_nullspace).max()
    assert bias < 1e-9 if arm.n == 6 else bias > 1e-3


@given(n=st.integers(6, 9), seed=st.integers(0, 2**32 - 1), condition=st.floats(1, 1e4))
def test_identities_of_any_mass_matrix(n, seed, condition):
    """Algebra alone, whatever the arm: M positive definite, J of full rank."""
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    M = Q * np.geomspace(1, condition, n) @ Q.T
    U, V = np.linalg.qr(rng.normal(size=(6, 6)))[0], np.linalg.qr(rng.normal(size=(n, n)))[0]
    J = U * np.geomspace(0.1, 2, 6) @ V[:6]
    C, J_dot = rng.normal(size=(n, n)), rng.normal(size=(6, n))
    g, x, v = rng.normal(size=n), rng.normal(size=6), rng.normal(size=n)
    space = operational_space((M + M.T) / 2, C, g, J, J_dot, x, v)
    digits = 1e-13 * condition * 400  # eps times what solving with M and with the mobility may cost
    Lambda, Phi, Gamma, _, J_bar, bias, p, *_ = space
    N = space.nullspace_projector
    small(Lambda @ J @ np.linalg.solve(M, J.T) - np.eye(6), 1.0, digits=digits)
    small(J @ J_bar - np.eye(6), 1.0, digits=digits)
    small(N @ N - N, 1.0, np.abs(N).max() ** 2, digits=digits)
    small(J @ np.linalg.solve(M, N.T), 1.0, digits=digits)
    force = J_bar.T @ C @ v - Lambda @ J_dot @ v
    small(Phi @ J @ v + bias - force, np.abs(Phi) @ np.abs(J @ v), bias, force, digits=digits)
    small(Gamma @ x - p, p, digits=1e-14)
    small(p - J_bar.T @ g, np.abs(J_bar.T) @ np.abs(g), digits=1e-14)


def tool(arm):
    frame = arm.model.frames[arm.model.getFrameId(arm.tool_frame)]
    return frame.parentJoint - 1, frame.placement.translation, frame.placement.rotation


def test_rotor_inertia_is_in_lambda():
    q = np.deg2rad([20, -30, 10, 80, 0, 60, 0])
    light = k1607.load_k1607(armature=np.zeros(7)).operational_space(q, np.zeros(7)).Lambda
    heavy = k1607.load_k1607().operational_space(q, np.zeros(7)).Lambda
    assert np.linalg.eigvalsh(heavy - light).min() > 0


def test_a_singular_posture_is_refused_or_damped_as_the_caller_says(reference):
    with pytest.raises(SingularJacobianError):
        reference.operational_space(np.zeros(7), np.zeros(7))
    space = reference.operational_space(np.zeros(7), np.zeros(7), damping=Damping(0.05, 0.05))
    assert space.damping == pytest.approx(0.05)
    assert space.sigma_min < 1e-12
    assert np.isfinite(space.Lambda).all()
    regular = reference.operational_space(
        np.deg2rad([20, -30, 10, 80, 0, 60, 0]), np.zeros(7), damping=Damping(0.05, 0.05)
    )
    assert regular.damping == 0


def test_damping_too_small_to_act_is_refused(reference):
    with pytest.raises(SingularJacobianError):
        reference.operational_space(np.zeros(7), np.zeros(7), damping=Damping(threshold=1e-30))


def test_sigma_min_is_the_jacobian_s(arm):
    for q, v, _ in states(arm, 5):
        space = arm.operational_space(q, v)
        assert space.sigma_min == pytest.approx(np.linalg.svd(arm.jacobian(q), compute_uv=False)[-1], rel=1e-12)
        assert isinstance(space.sigma_min, float)


def test_a_matrix_that_rounding_left_short_of_definite_is_solved_all_the_same():
    """The mobility of a Jacobian of condition 1e8, not refused yet, may come out with a negative eigenvalue of 1e-17."""
    rng = np.random.default_rng(0)
    Q, B = np.linalg.qr(rng.normal(size=(6, 6)))[0], rng.normal(size=(6, 3))
    A = Q * np.array([1, 1, 1, 1, 1, -1e-10]) @ Q.T
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.cholesky(A)
    assert np.array_equal(solve_definite(A, B), np.linalg.solve(A, B))


def test_what_was_handed_out_stays(arm):
    """Pinocchio's own results would change with the next call."""
    (q, v, _), (other, *_) = states(arm, 2)
    space = arm.operational_space(q, v)
    kept = [np.copy(x) for x in space]
    arm.operational_space(other, -v)
    arm.jacobian_time_variation(other, -v)
    for now, before in zip(space, kept, strict=True):
        assert np.array_equal(now, before)


def test_an_argument_that_is_wrong_is_named(reference):
    q = np.deg2rad([20, -30, 10, 80, 0, 60, 0])
    with pytest.raises(ValueError, match="v: expected"):
        reference.operational_space(q, np.zeros(6))
    with pytest.raises(ValueError, match="q: expected"):
        reference.operational_space(np.full(7, np.nan), q)


@pytest.mark.parametrize("a", [1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8])
def test_near_a_singularity_lambda_has_its_digits_or_is_refused(reference, a):
    """Elbow and wrist straightened together: what is handed out inverts the mobility."""
    q, v = np.array([0.3, 0.5, 0.4, a, 0.3, a, 0.2]), np.zeros(7)
    J, M = reference.jacobian(q), reference.mass_matrix(q)
    sigma = np.linalg.svd(J, compute_uv=False)
    if sigma[-1] < 1e-4 * sigma[0]:
        with pytest.raises(SingularJacobianError):
            reference.operational_space(q, v)
        return
    there = reference.operational_space(q, v)
    assert np.abs(there.Lambda @ J @ np.linalg.solve(M, J.T) - np.eye(6)).max() < 1e-7
    assert np.abs(J @ there.jacobian_bar - np.eye(6)).max() < 1e-7
