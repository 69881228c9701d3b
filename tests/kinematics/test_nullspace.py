import warnings

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from k1607_pin.kinematics.differential import joint_velocity
from k1607_pin.kinematics.nullspace import limit_centring, manipulability, manipulability_ascent, preferred_posture

SEED = st.integers(0, 2**32 - 1)


def distance_from_middle(q, lower, upper):
    """Liegeois' cost: mean squared distance from mid-range in units of the range."""
    return np.mean(((q - (lower + upper) / 2) / (upper - lower)) ** 2)


class TestLimitCentring:
    @given(seed=SEED, gain=st.floats(0.1, 10))
    def test_goes_straight_down_the_gradient(self, arm, seed, gain):
        q = arm.random_configuration(np.random.default_rng(seed))
        z = limit_centring(q, arm.lower, arm.upper, gain)
        h = 1e-5
        gradient = np.array(
            [distance_from_middle(q + s, arm.lower, arm.upper) - distance_from_middle(q - s, arm.lower, arm.upper)
             for s in h * np.eye(arm.n)]
        ) / (2 * h)  # fmt: skip
        cosine = z @ gradient / np.linalg.norm(z) / np.linalg.norm(gradient)
        assert cosine == pytest.approx(-1, abs=1e-8)  # differences of a quadratic: rounding alone, 1e-16 / h

    @given(seed=SEED)
    def test_decreases_the_cost_in_the_null_space(self, reference, seed):
        """As (21) uses it: the tool stands still, the arm moves towards mid-range."""
        q = reference.random_configuration(np.random.default_rng(seed))
        J = reference.jacobian(q)
        assume(np.linalg.svd(J, compute_uv=False)[-1] > 1e-3)
        z = limit_centring(q, reference.lower, reference.upper)
        null = joint_velocity(J, np.zeros(6), z).velocity
        assume(np.abs(null).max() > 1e-4)
        before = distance_from_middle(q, reference.lower, reference.upper)
        assert distance_from_middle(q + 1e-3 * null, reference.lower, reference.upper) < before

    @given(seed=SEED, gain=st.floats(0.1, 10))
    def test_equal_ranges_give_the_plain_distance(self, seed, gain):
        q = np.random.default_rng(seed).uniform(-2, 2, 7)
        z = limit_centring(q, np.full(7, -2.0), np.full(7, 3.0), gain)
        np.testing.assert_allclose(z, -gain * (q - 0.5), rtol=1e-14)

    def test_rests_in_the_middle(self, arm):
        middle = (arm.lower + arm.upper) / 2
        np.testing.assert_allclose(limit_centring(middle, arm.lower, arm.upper), 0, atol=1e-15)

    @given(seed=SEED, limited=st.lists(st.booleans(), min_size=7, max_size=7))
    def test_joints_without_limits_are_left_alone(self, seed, limited):
        """None, some or all of them, without a warning."""
        rng, limited = np.random.default_rng(seed), np.array(limited)
        lower, upper = rng.uniform(-3, -1, 7), rng.uniform(1, 3, 7)
        q = rng.uniform(lower, upper)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            z = limit_centring(q, np.where(limited, lower, -np.inf), np.where(limited, upper, np.inf))
        assert not z[~limited].any()
        if limited.any():
            alone = limit_centring(q[limited], lower[limited], upper[limited])
            np.testing.assert_allclose(z[limited], alone, rtol=1e-14)
            assert z[limited].all()

    def test_one_sided_limits_have_no_middle(self):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            z = limit_centring(np.ones(2), np.array([-1.0, 0.0]), np.array([np.inf, 4.0]))
        np.testing.assert_allclose(z, [0, 1])

    def test_whole_numbers_are_numbers(self):
        z = limit_centring(np.array([0, 1]), np.array([-1.0, -1.0]), np.array([2.0, 2.0]))
        np.testing.assert_allclose(z, [0.5, -0.5])


@given(seed=SEED, gain=st.floats(0.1, 10))
def test_preferred_posture_pulls_towards_it(seed, gain):
    rng = np.random.default_rng(seed)
    q, posture = rng.normal(size=7), rng.normal(size=7)
    z = preferred_posture(q, posture, gain)
    np.testing.assert_allclose(q + z / gain, posture, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(preferred_posture(q, posture.tolist(), gain), z)


class TestManipulability:
    @given(seed=SEED)
    def test_is_yoshikawas(self, arm, seed):
        J = arm.jacobian(arm.random_configuration(np.random.default_rng(seed)))
        determinant = np.linalg.det(J @ J.T)
        # the determinant loses what lies below eps times the product of the singular values' squares
        assert manipulability(J) ** 2 == pytest.approx(determinant, rel=1e-8, abs=1e-16)

    def test_vanishes_at_a_singularity(self, reference):
        assert manipulability(reference.jacobian(np.zeros(7))) < 1e-16

    @given(seed=SEED, gain=st.floats(0.1, 10))
    def test_ascent_is_the_gradient_of_its_logarithm(self, arm, seed, gain):
        rng = np.random.default_rng(seed)
        q = arm.random_configuration(rng)
        while np.linalg.svd(arm.jacobian(q), compute_uv=False)[-1] < 0.02:
            q = arm.random_configuration(rng)
        # log w varies on the scale of sigma_min: third derivative below 2 (2 / sigma_min)^3 = 2e6, times h^2 / 6;
        # rounding of log w, below 1e-13, over h
        h = 1e-6
        gradient = np.array(
            [np.log(manipulability(arm.jacobian(q + s)) / manipulability(arm.jacobian(q - s))) for s in h * np.eye(arm.n)]
        ) / (2 * h)  # fmt: skip
        np.testing.assert_allclose(manipulability_ascent(arm.jacobian(q), gain), gain * gradient, rtol=1e-6, atol=1e-6)
