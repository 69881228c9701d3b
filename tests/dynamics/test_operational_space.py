"""Lambda, Phi, Gamma and the null-space part: identities that hold for six joints and for seven."""

import numpy as np
import pinocchio as pin
import pytest

import k1607_pin as k1607
from k1607_pin.kinematics.differential import Damping, SingularJacobianError


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
        assert np.linalg.eigvalsh(space.Lambda).min() > 0
        assert np.abs(J @ space.jacobian_bar - np.eye(6)).max() < 1e-9
        assert np.abs(space.Gamma @ position(arm, q) - space.gravity).max() < 1e-9
        assert np.linalg.matrix_rank(space.Gamma) <= 1  # least Frobenius norm


def test_lambda_dot_minus_2_phi_is_skew(arm):
    h = 1e-6
    for q, v, _ in states(arm, 10):
        change = (arm.operational_space(q + h * v, v).Lambda - arm.operational_space(q - h * v, v).Lambda) / (2 * h)
        S = change - 2 * arm.operational_space(q, v).Phi
        # central difference of Lambda: rounding eps |Lambda| cond / h, truncation h^2 times its third derivative
        assert np.abs(S + S.T).max() < 1e-5 * max(1.0, np.abs(S).max())


def test_null_space_motion_matters_only_where_there_is_one(arm):
    (q, v, _), *_ = states(arm, 1)
    bias = np.abs(arm.operational_space(q, v).bias_nullspace).max()
    assert bias < 1e-9 if arm.n == 6 else bias > 1e-3


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
