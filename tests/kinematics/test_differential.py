import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from k1607_pin import closed_form
from k1607_pin.kinematics.differential import (
    Damping,
    SingularJacobianError,
    jacobian_derivative,
    joint_velocity,
    nullspace_projector,
    weighted_pseudo_inverse,
)

SEED = st.integers(0, 2**32 - 1)
EPS = np.finfo(float).eps


def random_jacobian(arm, rng, sigma_min=0.02):
    """Of a pose some way from singular: the condition number stays below 200."""
    while True:
        J = arm.jacobian(arm.random_configuration(rng))
        if np.linalg.svd(J, compute_uv=False)[-1] > sigma_min:
            return J


def random_weight(rng, n):
    """Symmetric positive definite, condition number at most 100."""
    Q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    W = Q @ np.diag(10.0 ** rng.uniform(-1, 1, n)) @ Q.T
    return (W + W.T) / 2


class TestPseudoInverse:
    # Condition numbers: 200 of J and 10 of W^(1/2). Their product, squared where two factors meet, times eps: 1e-9.
    ATOL = 1e-9

    @given(seed=SEED, weighted=st.booleans())
    def test_weighted_penrose_identities(self, arm, seed, weighted):
        rng = np.random.default_rng(seed)
        J = random_jacobian(arm, rng)
        W = random_weight(rng, arm.n) if weighted else np.eye(arm.n)
        X, sigma_min, damping = weighted_pseudo_inverse(J, W if weighted else None)
        assert damping == 0
        root = np.linalg.cholesky(W)
        assert sigma_min == pytest.approx(np.linalg.svd(J @ root, compute_uv=False)[-1], rel=1e-9)
        np.testing.assert_allclose(J @ X @ J, J, rtol=0, atol=self.ATOL)
        np.testing.assert_allclose(X @ J @ X, X, rtol=0, atol=self.ATOL * np.abs(X).max())
        np.testing.assert_allclose(J @ X, np.eye(6), rtol=0, atol=self.ATOL)
        symmetric = np.linalg.solve(W, X @ J)
        np.testing.assert_allclose(symmetric, symmetric.T, rtol=0, atol=self.ATOL * 10)

    @given(seed=SEED)
    def test_is_the_formula_of_the_report(self, arm, seed):
        """W J^T (J W J^T)^-1, (22), as printed."""
        rng = np.random.default_rng(seed)
        J, W = random_jacobian(arm, rng), random_weight(rng, arm.n)
        printed = W @ J.T @ np.linalg.inv(J @ W @ J.T)
        X = weighted_pseudo_inverse(J, W).matrix
        np.testing.assert_allclose(X, printed, rtol=0, atol=1e-7 * np.abs(X).max())  # J W J^T squares the condition

    @given(seed=SEED)
    def test_a_diagonal_weight_may_be_given_as_a_vector(self, arm, seed):
        rng = np.random.default_rng(seed)
        J, w = random_jacobian(arm, rng), rng.uniform(0.1, 10, arm.n)
        np.testing.assert_array_equal(
            weighted_pseudo_inverse(J, w).matrix, weighted_pseudo_inverse(J, np.diag(w)).matrix
        )

    @given(seed=SEED, scale=st.floats(1e-6, 1e6))
    def test_the_scale_of_the_weight_does_not_matter(self, arm, seed, scale):
        rng = np.random.default_rng(seed)
        J, W = random_jacobian(arm, rng), random_weight(rng, arm.n)
        X = weighted_pseudo_inverse(J, W).matrix
        scaled = weighted_pseudo_inverse(J, scale * W).matrix
        np.testing.assert_allclose(scaled, X, rtol=0, atol=self.ATOL * np.abs(X).max())

    def test_the_argument_is_left_alone(self, arm):
        rng = np.random.default_rng(2)
        J, W = random_jacobian(arm, rng), random_weight(rng, arm.n)
        J0, W0 = J.copy(), W.copy()
        joint_velocity(J, np.ones(6), np.ones(arm.n), W)
        np.testing.assert_array_equal(J, J0)
        np.testing.assert_array_equal(W, W0)


class TestJointVelocity:
    @given(seed=SEED)
    def test_realises_the_cartesian_velocity_at_least_cost(self, arm, seed):
        """(21) against the optimality conditions of min q_dot^T W^-1 q_dot / 2 subject to J q_dot = x_dot."""
        rng = np.random.default_rng(seed)
        J, W, x_dot = random_jacobian(arm, rng), random_weight(rng, arm.n), rng.normal(size=6)
        found = joint_velocity(J, x_dot, W=W)
        np.testing.assert_allclose(J @ found.velocity, x_dot, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.residual, 0, atol=1e-9)
        kkt = np.block([[np.linalg.inv(W), J.T], [J, np.zeros((6, 6))]])
        best = np.linalg.solve(kkt, np.concatenate([np.zeros(arm.n), x_dot]))[: arm.n]
        np.testing.assert_allclose(found.velocity, best, rtol=0, atol=1e-8 * np.abs(best).max())

    @given(seed=SEED)
    def test_every_null_motion_adds_cost(self, arm, seed):
        rng = np.random.default_rng(seed)
        J, W, x_dot = random_jacobian(arm, rng), random_weight(rng, arm.n), rng.normal(size=6)
        found = joint_velocity(J, x_dot, W=W).velocity
        z = rng.normal(size=arm.n)
        other = joint_velocity(J, x_dot, z, W=W).velocity
        np.testing.assert_allclose(J @ other, x_dot, rtol=0, atol=1e-9)
        null = other - found
        inverse = np.linalg.inv(W)
        cost = found @ inverse @ found
        # Pythagoras in the metric W^-1: the cross term vanishes
        assert other @ inverse @ other == pytest.approx(cost + null @ inverse @ null, rel=1e-9)
        if arm.n > 6:
            assert np.abs(null).max() > 1e-6
        else:
            np.testing.assert_allclose(null, 0, atol=1e-9)

    @given(seed=SEED)
    def test_z_is_projected_on_what_the_tool_does_not_see(self, arm, seed):
        rng = np.random.default_rng(seed)
        J, W, z = random_jacobian(arm, rng), random_weight(rng, arm.n), rng.normal(size=arm.n)
        velocity = joint_velocity(J, np.zeros(6), z, W).velocity
        np.testing.assert_allclose(velocity, nullspace_projector(J, W) @ z, rtol=0, atol=1e-12)
        again = joint_velocity(J, np.zeros(6), velocity, W).velocity
        np.testing.assert_allclose(again, velocity, rtol=0, atol=1e-9)

    def test_lists_will_do(self, arm):
        J = random_jacobian(arm, np.random.default_rng(1))
        expected = joint_velocity(J, np.ones(6), np.ones(arm.n)).velocity
        found = joint_velocity(J.tolist(), [1] * 6, [1] * arm.n).velocity
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


class TestNullspaceProjector:
    @given(seed=SEED, weighted=st.booleans())
    def test_projects(self, arm, seed, weighted):
        rng = np.random.default_rng(seed)
        J = random_jacobian(arm, rng)
        W = random_weight(rng, arm.n) if weighted else None
        N = nullspace_projector(J, W)
        np.testing.assert_allclose(J @ N, 0, atol=1e-12)
        np.testing.assert_allclose(N @ N, N, rtol=0, atol=1e-12)
        assert np.trace(N) == pytest.approx(arm.n - 6, abs=1e-12)
        exact = np.eye(arm.n) - weighted_pseudo_inverse(J, W).matrix @ J
        np.testing.assert_allclose(N, exact, rtol=0, atol=1e-9)
        if W is None:
            np.testing.assert_allclose(N, N.T, rtol=0, atol=1e-14)

    @given(seed=SEED, weighted=st.booleans(), rank=st.integers(0, 6))
    def test_is_exact_at_every_rank(self, seed, weighted, rank):
        """Built from integers, so that the lost rank is lost exactly."""
        rng = np.random.default_rng(seed)
        J = rng.integers(-3, 4, (6, rank)).astype(float) @ rng.integers(-3, 4, (rank, 7)).astype(float)
        true_rank = np.linalg.matrix_rank(J) if rank else 0
        W = random_weight(rng, 7) if weighted else None
        N = nullspace_projector(J, W)
        np.testing.assert_allclose(J @ N, 0, atol=1e-11)
        np.testing.assert_allclose(N @ N, N, rtol=0, atol=1e-12)
        assert np.trace(N) == pytest.approx(7 - true_rank, abs=1e-11)

    def test_at_the_k1607s_zero_pose(self):
        """Stretched out, rank 5: two ways to move without moving the tool, not one."""
        J = closed_form.jacobian(np.zeros(7))
        assert np.linalg.matrix_rank(J) == 5
        N = nullspace_projector(J)
        np.testing.assert_allclose(J @ N, 0, atol=1e-14)
        np.testing.assert_allclose(N @ N, N, rtol=0, atol=1e-14)
        assert np.trace(N) == pytest.approx(2, abs=1e-13)


class TestSingularities:
    POSES = (np.zeros(7), np.array([0.3, 0, 0.5, 0, 0.7, 0, 0.2]), np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0]))

    @pytest.mark.parametrize("q", POSES, ids=["zero", "stretched", "stretched too"])
    def test_without_damping_it_is_refused_with_its_singular_value(self, q):
        J = closed_form.jacobian(q)
        for call in (weighted_pseudo_inverse, lambda J: joint_velocity(J, np.ones(6))):
            with pytest.raises(SingularJacobianError, match="smallest singular value") as error:
                call(J)
            assert error.value.sigma_min == pytest.approx(np.linalg.svd(J, compute_uv=False)[-1], abs=1e-15)
            assert error.value.sigma_min <= error.value.threshold < 1e-8
            assert isinstance(error.value, ValueError)

    def test_fewer_joints_than_the_task_has_dimensions(self, arm):
        J = random_jacobian(arm, np.random.default_rng(1))[:, :5]
        with pytest.raises(SingularJacobianError) as error:
            weighted_pseudo_inverse(J)
        assert error.value.sigma_min == 0

    @pytest.mark.parametrize("q", POSES, ids=["zero", "stretched", "stretched too"])
    @given(seed=SEED, maximum=st.floats(1e-3, 1), threshold=st.floats(1e-3, 1))
    def test_damping_bounds_the_velocity_and_is_reported(self, q, seed, maximum, threshold):
        rng = np.random.default_rng(seed)
        J, x_dot, z = closed_form.jacobian(q), rng.normal(size=6), rng.normal(size=7)
        damping = Damping(threshold, maximum)
        inverse = weighted_pseudo_inverse(J, damping=damping)
        assert inverse.damping == pytest.approx(maximum, rel=1e-12)
        assert inverse.sigma_min < 1e-12
        # sigma / (sigma^2 + lambda^2) is at most 1 / (2 lambda)
        assert np.linalg.norm(inverse.matrix, 2) <= 0.5 / maximum * (1 + 1e-12)
        printed = J.T @ np.linalg.inv(J @ J.T + maximum**2 * np.eye(6))
        np.testing.assert_allclose(inverse.matrix, printed, rtol=0, atol=1e-14 * 10 / maximum**3)

        found = joint_velocity(J, x_dot, damping=damping)
        assert (found.damping, found.sigma_min) == (inverse.damping, inverse.sigma_min)
        np.testing.assert_allclose(found.residual, x_dot - J @ found.velocity, rtol=0, atol=1e-12)
        assert np.linalg.norm(found.residual) > 1e-6  # a random velocity does not lie in a range of rank 5
        moved = joint_velocity(J, x_dot, z, damping=damping)
        np.testing.assert_allclose(J @ moved.velocity, J @ found.velocity, rtol=0, atol=1e-10)

    @given(seed=SEED)
    def test_no_damping_above_the_threshold(self, arm, seed):
        rng = np.random.default_rng(seed)
        J, W = random_jacobian(arm, rng), random_weight(rng, arm.n)
        exact = weighted_pseudo_inverse(J, W)
        damped = weighted_pseudo_inverse(J, W, Damping(threshold=exact.sigma_min * 0.999, maximum=1.0))
        assert damped.damping == 0
        np.testing.assert_array_equal(damped.matrix, exact.matrix)
        below = weighted_pseudo_inverse(J, W, Damping(threshold=exact.sigma_min * 1.001, maximum=1.0))
        assert 0 < below.damping < 0.05
        assert below.sigma_min == exact.sigma_min

    @given(threshold=st.floats(1e-4, 1), maximum=st.floats(1e-4, 1), a=st.floats(0, 2), b=st.floats(0, 2))
    def test_damping_is_continuous_and_falls(self, threshold, maximum, a, b):
        damping = Damping(threshold, maximum)
        one, two = damping.at(a), damping.at(b)
        assert 0 <= one <= maximum
        assert (one <= two) == (a >= b) or one == two
        # lambda^2 has a slope of at most 2 maximum^2 / threshold anywhere
        slope = 2 * maximum**2 / threshold
        assert abs(one**2 - two**2) <= slope * abs(a - b) * (1 + 1e-9) + 1e-12 * maximum**2
        assert damping.at(0) == maximum
        assert damping.at(threshold) == 0
        ratio = a / threshold
        assert one**2 == pytest.approx(max(0, maximum**2 * (1 - ratio**2)), abs=1e-12 * maximum**2)

    @pytest.mark.parametrize("name", ["threshold", "maximum"])
    @pytest.mark.parametrize("value", [0.0, -0.1, np.nan, np.inf])
    def test_damping_is_positive(self, name, value):
        with pytest.raises(ValueError, match=f"{name}: expected a positive number"):
            Damping(**{name: value})

    @pytest.mark.parametrize(("lost", "damping"), [(1e-17, Damping(threshold=1e-30))])
    def test_damping_too_small_to_help_is_no_silent_nan(self, lost, damping):
        """A lambda of zero where the rank is lost: neither 0/0 nor 1e17 may come back as a matrix."""
        J = np.hstack([np.diag([1.0, 1, 1, 1, 1, lost]), np.zeros((6, 1))])
        with pytest.raises(SingularJacobianError):
            weighted_pseudo_inverse(J, damping=damping)

    def test_through_a_singularity(self):
        """Along a path through the stretched pose the damped velocity has no jump: it halves when the step does."""
        direction, x_dot = np.array([0.2, 0.1, -0.3, 1.0, 0.2, 0.7, 0.1]), np.array([0.1, 0.2, 0.3, 0.1, 0, 0.2])

        def largest_step(samples):
            path = [joint_velocity(closed_form.jacobian(s * direction), x_dot, damping=Damping(0.2, 0.2)).velocity
                    for s in np.linspace(-0.5, 0.5, samples)]  # fmt: skip
            return np.abs(np.diff(path, axis=0)).max()

        coarse, fine = largest_step(401), largest_step(1601)
        assert fine < 0.5 * coarse  # lambda starts like a square root: steps fall at least as fast as its increments


class TestBadArguments:
    GOOD = np.hstack([np.eye(6), np.ones((6, 1))])

    @pytest.mark.parametrize(
        "J", [np.zeros(6), np.zeros((2, 6, 7)), np.eye(5, 7), np.eye(3, 7), np.eye(7, 8), np.full((6, 7), np.nan), 1.0]
    )
    def test_jacobian(self, J):
        with pytest.raises(ValueError, match=r"J: expected \(6, n\) finite numbers"):
            weighted_pseudo_inverse(J)

    @pytest.mark.parametrize(
        ("W", "message"),
        [
            (np.eye(6), r"\(7, 7\)"),
            (np.ones(6), r"\(7,\)"),
            (np.diag([1.0, 1, 1, 1, 1, 1, np.inf]), "finite"),
            (np.eye(7) + np.eye(7, k=1), "symmetric"),
            (np.diag([1.0, 1, 1, 1, 1, 1, -1]), "positive definite"),
            (np.zeros((7, 7)), "positive definite"),
            (np.zeros(7), "positive definite"),
            (np.ones((7, 7)) - 2 * np.eye(7), "positive definite"),
        ],
    )
    def test_weight(self, W, message):
        for call in (weighted_pseudo_inverse, nullspace_projector, lambda J, W: joint_velocity(J, np.ones(6), W=W)):
            with pytest.raises(ValueError, match=f"W: .*{message}"):
                call(self.GOOD, W)

    @pytest.mark.parametrize(
        "x", [np.ones(5), np.ones((6, 1)), 1.0, np.array([1, 1, 1, 1, 1, np.nan]), np.full(6, np.inf)]
    )
    def test_velocity(self, x):
        with pytest.raises(ValueError, match=r"x_dot: expected \(6,\)"):
            joint_velocity(self.GOOD, x)

    @pytest.mark.parametrize("z", [np.ones(6), np.ones((7, 1)), np.array([np.nan] * 7)])
    def test_null_motion(self, z):
        with pytest.raises(ValueError, match=r"z: expected \(7,\)"):
            joint_velocity(self.GOOD, np.ones(6), z)


class TestJacobianDerivative:
    @given(seed=SEED)
    def test_against_central_differences(self, arm, seed):
        """Columns of J are products of sines and cosines and lengths of at most 2 m: so is their third derivative."""
        q = arm.random_configuration(np.random.default_rng(seed))
        h = 6e-6
        steps = h * np.eye(arm.n)
        numeric = np.stack([(arm.jacobian(q + s) - arm.jacobian(q - s)) / (2 * h) for s in steps], axis=-1)
        tolerance = 2 * (h * h / 6 + 32 * EPS / h)
        np.testing.assert_allclose(jacobian_derivative(arm.jacobian(q)), numeric, rtol=0, atol=tolerance)

    @given(seed=SEED)
    def test_against_pinocchio(self, arm, seed):
        rng = np.random.default_rng(seed)
        q, v = arm.random_configuration(rng), rng.normal(size=arm.n)
        model = arm.model
        workspace = model.createData()
        pin.computeJointJacobiansTimeVariation(model, workspace, q, v)
        pin.updateFramePlacements(model, workspace)
        frame = next(i for i, f in enumerate(model.frames) if f.name == arm.tool_frame and f.type == pin.BODY)
        expected = pin.getFrameJacobianTimeVariation(model, workspace, frame, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(jacobian_derivative(arm.jacobian(q)) @ v, expected, rtol=0, atol=1e-12)

    @given(seed=SEED)
    def test_prismatic_joints_too(self, seed):
        rng = np.random.default_rng(seed)
        model = pin.Model()
        for i in range(6):
            joint = pin.JointModelPZ() if rng.uniform() < 0.5 else pin.JointModelRZ()
            rotation = pin.Quaternion(*rng.normal(size=4)).normalized().matrix()
            model.addJoint(i, joint, pin.SE3(rotation, rng.uniform(-0.5, 0.5, 3)), f"joint{i}")
        workspace = model.createData()

        def jacobian(q):
            pin.computeJointJacobians(model, workspace, q)
            return pin.getJointJacobian(model, workspace, 6, pin.LOCAL_WORLD_ALIGNED).copy()

        q, h = rng.uniform(-1, 1, 6), 6e-6
        numeric = np.stack([(jacobian(q + s) - jacobian(q - s)) / (2 * h) for s in h * np.eye(6)], axis=-1)
        np.testing.assert_allclose(jacobian_derivative(jacobian(q)), numeric, rtol=0, atol=1e-8)

    def test_batches_equal_single_calls(self, arm):
        J = arm.jacobian(arm.random_configuration(np.random.default_rng(4), (2, 3)))
        out = jacobian_derivative(J)
        assert out.shape == (2, 3, 6, arm.n, arm.n)
        for index in np.ndindex(2, 3):
            np.testing.assert_array_equal(out[index], jacobian_derivative(J[index]))
