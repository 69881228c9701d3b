import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from k1607_pin import orientation
from k1607_pin.compiled.trace import trace

EPS = np.finfo(float).eps
TINY = 16 * EPS  # a handful of operations on numbers of at most 1

AXIS = st.one_of(
    st.sampled_from([tuple(sign * row) for row in np.eye(3) for sign in (1, -1)]),
    st.sampled_from([(1.0, 1.0, 0.0), (1.0, 0.0, -1.0), (1.0, 1.0, 1.0), (1e-9, 1.0, 0.0), (1.0, 1e-5, -1e-5)]),
    st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda x: np.linalg.norm(x) > 0.1),
).map(lambda x: np.array(x) / np.linalg.norm(x))
SMALL = st.floats(-12, -1).map(lambda e: 10.0**e)
ANGLE = st.one_of(
    st.floats(0, np.pi), SMALL, SMALL.map(lambda x: np.pi - x), st.sampled_from([0.0, np.pi / 2, 2 * np.pi / 3, np.pi])
)
SEED = st.integers(0, 2**32 - 1)


def cross_matrix(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def turn(axis, angle):
    """Rodrigues' formula; 1 - cos by half the angle, and a half turn exactly."""
    if angle == np.pi:
        return 2 * np.outer(axis, axis) - np.eye(3)
    K = cross_matrix(axis)
    return np.eye(3) + np.sin(angle) * K + 2 * np.sin(angle / 2) ** 2 * K @ K


def exact_quaternion(axis, angle):
    return np.array([np.cos(angle / 2) if angle != np.pi else 0.0, *(np.sin(angle / 2) * axis)])


def assert_same_rotation(one, two, atol=TINY):
    """q and -q are the same rotation."""
    assert min(np.abs(one - two).max(), np.abs(one + two).max()) <= atol


ROTATION = st.builds(turn, AXIS, ANGLE)
QUATERNION = st.builds(exact_quaternion, AXIS, ANGLE)
IDENTITY = np.array([1.0, 0, 0, 0])


class TestQuaternion:
    @given(axis=AXIS, angle=ANGLE)
    def test_is_the_half_angle_and_the_axis(self, axis, angle):
        q = orientation.quaternion(turn(axis, angle))
        assert q[0] >= 0
        assert np.linalg.norm(q) == pytest.approx(1, abs=TINY)
        assert_same_rotation(q, exact_quaternion(axis, angle))

    @given(axis=AXIS, angle=SMALL)
    def test_keeps_the_digits_of_a_small_rotation(self, axis, angle):
        """A rotation of 1e-12 rad has its axis to full relative precision in the matrix, so in the quaternion."""
        q = orientation.quaternion(turn(axis, angle))
        np.testing.assert_allclose(q[1:], np.sin(angle / 2) * axis, rtol=0, atol=TINY * angle)

    @given(R=ROTATION)
    def test_round_trip_from_the_matrix(self, R):
        np.testing.assert_allclose(orientation.rotation(orientation.quaternion(R)), R, rtol=0, atol=TINY)

    @given(q=QUATERNION)
    def test_round_trip_from_the_quaternion(self, q):
        assert_same_rotation(orientation.quaternion(orientation.rotation(q)), q)

    @given(R=ROTATION)
    def test_agrees_with_scipy_and_pinocchio(self, R):
        q = orientation.quaternion(R)
        x, y, z, w = Rotation.from_matrix(R).as_quat()
        assert_same_rotation(q, np.array([w, x, y, z]), atol=1e-14)
        theirs = pin.Quaternion(R)  # Eigen's rule divides by the square root of a sum that may be as small as 1e-2
        assert_same_rotation(q, np.array([theirs.w, theirs.x, theirs.y, theirs.z]), atol=1e-13)

    @pytest.mark.parametrize("k", range(3))
    def test_exact_half_turns(self, k):
        q = orientation.quaternion(np.diag(2 * np.eye(3)[k] - 1))
        np.testing.assert_array_equal(np.abs(q), np.eye(4)[k + 1])

    def test_identity(self):
        np.testing.assert_array_equal(orientation.quaternion(np.eye(3)), IDENTITY)


class TestQuaternionByDivision:
    """(26) as printed."""

    @given(axis=AXIS, angle=st.one_of(st.floats(0, 3.0), SMALL))
    def test_equals_the_sound_one_away_from_a_half_turn(self, axis, angle):
        """It divides by eta and takes a root of eta^2: eps / eta^2, with eta >= cos 1.5 = 0.07."""
        R = turn(axis, angle)
        found, expected = orientation.quaternion_by_division(R), orientation.quaternion(R)
        np.testing.assert_allclose(found, expected, rtol=0, atol=8 * EPS / np.cos(angle / 2) ** 2)

    def test_loses_its_digits_near_a_half_turn_and_the_sound_one_does_not(self):
        rng = np.random.default_rng(26)
        axes = rng.normal(size=(200, 3))
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        worst = {"division": 0.0, "sound": 0.0}
        for axis in axes:
            R, expected = turn(axis, np.pi - 1e-7), exact_quaternion(axis, np.pi - 1e-7)
            with np.errstate(all="ignore"):
                bad = orientation.quaternion_by_division(R)
            worst["division"] = max(worst["division"], np.abs(bad - expected).max())
            worst["sound"] = max(worst["sound"], np.abs(orientation.quaternion(R) - expected).max())
        assert worst["division"] > 1e-4 or np.isnan(worst["division"])
        assert worst["sound"] < TINY

    @pytest.mark.parametrize("k", range(3))
    def test_has_no_value_at_a_half_turn(self, k):
        with np.errstate(all="ignore"):
            assert not np.isfinite(orientation.quaternion_by_division(np.diag(2 * np.eye(3)[k] - 1))).all()


class TestGroup:
    @given(a=ROTATION, b=ROTATION)
    def test_product_is_that_of_the_matrices(self, a, b):
        found = orientation.product(orientation.quaternion(a), orientation.quaternion(b))
        np.testing.assert_allclose(orientation.rotation(found), a @ b, rtol=0, atol=2 * TINY)

    @given(a=QUATERNION, b=QUATERNION, c=QUATERNION)
    def test_axioms(self, a, b, c):
        product, conjugate = orientation.product, orientation.conjugate
        np.testing.assert_allclose(product(product(a, b), c), product(a, product(b, c)), rtol=0, atol=TINY)
        np.testing.assert_array_equal(product(a, IDENTITY), a)
        np.testing.assert_array_equal(product(IDENTITY, a), a)
        np.testing.assert_allclose(product(a, conjugate(a)), IDENTITY, rtol=0, atol=TINY)
        np.testing.assert_allclose(product(conjugate(a), a), IDENTITY, rtol=0, atol=TINY)
        np.testing.assert_allclose(conjugate(product(a, b)), product(conjugate(b), conjugate(a)), rtol=0, atol=TINY)
        np.testing.assert_array_equal(conjugate(conjugate(a)), a)

    @given(a=QUATERNION)
    def test_conjugate_is_the_transpose(self, a):
        found = orientation.rotation(orientation.conjugate(a))
        np.testing.assert_allclose(found, orientation.rotation(a).T, rtol=0, atol=TINY)

    @given(a=QUATERNION)
    def test_a_quaternion_and_its_negative_are_the_same_rotation(self, a):
        np.testing.assert_array_equal(orientation.rotation(-a), orientation.rotation(a))

    @given(a=QUATERNION)
    def test_rotations_are_rotations(self, a):
        R = orientation.rotation(a)
        np.testing.assert_allclose(R @ R.T, np.eye(3), rtol=0, atol=TINY)
        assert np.linalg.det(R) == pytest.approx(1, abs=TINY)

    @given(a=ROTATION, b=ROTATION)
    def test_relative_rotation_in_base_and_in_body_axes(self, a, b):
        first, second = orientation.quaternion(a), orientation.quaternion(b)
        base = orientation.relative_quaternion_base(first, second)
        body = orientation.relative_quaternion_body(first, second)
        np.testing.assert_allclose(orientation.rotation(base), b @ a.T, rtol=0, atol=2 * TINY)
        np.testing.assert_allclose(orientation.rotation(body), a.T @ b, rtol=0, atol=2 * TINY)
        np.testing.assert_allclose(base[0], body[0], rtol=0, atol=TINY)  # the same angle
        np.testing.assert_allclose(a @ body[1:], base[1:], rtol=0, atol=2 * TINY)  # and axis, seen from two frames

    @given(a=QUATERNION, b=QUATERNION)
    def test_33_and_34_as_printed(self, a, b):
        """delta eta = eta1 eta2 + s1.s2 and delta s = eta1 s2 - eta2 s1 + s1 x s2: axes of the base."""
        relative = orientation.relative_quaternion_base(a, b)
        assert relative[0] == pytest.approx(a @ b, abs=TINY)
        printed = a[0] * b[1:] - b[0] * a[1:] + np.cross(a[1:], b[1:])
        np.testing.assert_allclose(relative[1:], printed, rtol=0, atol=TINY)

    @given(v=st.tuples(*[st.floats(-10, 10)] * 3).map(np.array), s=st.tuples(*[st.floats(-10, 10)] * 3).map(np.array))
    def test_cross_matrix(self, v, s):
        X = orientation.cross_matrix(s)
        np.testing.assert_array_equal(X, -X.T)
        np.testing.assert_allclose(X @ v, np.cross(s, v), rtol=0, atol=100 * TINY)


class TestRotationVector:
    @given(axis=AXIS, angle=ANGLE)
    def test_is_axis_times_angle(self, axis, angle):
        found = orientation.rotation_vector(turn(axis, angle))
        error = np.abs(found - angle * axis).max()
        if angle > np.pi - 1e-14:  # a half turn has two axes
            error = min(error, np.abs(found + angle * axis).max())
        assert error <= 4 * TINY

    @given(axis=AXIS, angle=SMALL)
    def test_keeps_the_digits_of_a_small_rotation(self, axis, angle):
        found = orientation.rotation_vector(turn(axis, angle))
        np.testing.assert_allclose(found, angle * axis, rtol=0, atol=4 * TINY * angle)

    @given(axis=AXIS, angle=st.one_of(st.floats(0, np.pi - 1e-3), SMALL))
    def test_agrees_with_pinocchio(self, axis, angle):
        """pin.log3 takes the angle from the trace: eps / sin(angle) near a half turn."""
        R = turn(axis, angle)
        np.testing.assert_allclose(orientation.rotation_vector(R), pin.log3(R), rtol=0, atol=1e-11)

    @given(axis=AXIS, gap=SMALL)
    def test_agrees_with_pinocchio_near_a_half_turn(self, axis, gap):
        """There log3 has half of double precision left at worst."""
        R = turn(axis, np.pi - gap)
        found, theirs = orientation.rotation_vector(R), pin.log3(R)
        assert min(np.abs(found - theirs).max(), np.abs(found + theirs).max()) < 1e-6

    @given(R=ROTATION)
    def test_agrees_with_scipy(self, R):
        found, theirs = orientation.rotation_vector(R), Rotation.from_matrix(R).as_rotvec()
        error = np.abs(found - theirs).max()
        if np.linalg.norm(theirs) > np.pi - 1e-14:
            error = min(error, np.abs(found + theirs).max())
        assert error < 1e-13

    @given(R=ROTATION)
    def test_never_longer_than_a_half_turn(self, R):
        assert np.linalg.norm(orientation.rotation_vector(R)) <= np.pi + TINY

    def test_identity(self):
        np.testing.assert_array_equal(orientation.rotation_vector(np.eye(3)), 0)


class TestDifferentialRotation:
    @given(axis=AXIS, angle=SMALL)
    def test_is_right_to_first_order(self, axis, angle):
        """What (35)-(36) read off is sin(angle) axis: the angle to third order."""
        found = orientation.differential_rotation(turn(axis, angle))
        np.testing.assert_allclose(found, np.sin(angle) * axis, rtol=0, atol=TINY * angle)
        assert np.abs(found - angle * axis).max() <= angle**3 / 6 + TINY * angle

    @pytest.mark.parametrize("k", range(3))
    def test_signs(self, k):
        found = orientation.differential_rotation(turn(np.eye(3)[k], 1e-3))
        np.testing.assert_allclose(found, np.sin(1e-3) * np.eye(3)[k], rtol=0, atol=1e-18)


class TestOrientationError:
    @given(R=ROTATION, axis=AXIS, angle=ANGLE)
    def test_is_the_turn_that_is_missing(self, R, axis, angle):
        """2 sin(angle / 2) axis, in base axes: from the actual to the desired orientation."""
        found = orientation.orientation_error(turn(axis, angle) @ R, R)
        expected = 2 * np.sin(angle / 2) * axis
        error = np.abs(found - expected).max()
        if angle > np.pi - 1e-14:
            error = min(error, np.abs(found + expected).max())
        assert error <= 4 * TINY

    @given(R=ROTATION, axis=AXIS, angle=SMALL)
    def test_equals_the_rotation_vector_to_third_order(self, R, axis, angle):
        desired = turn(axis, angle) @ R
        error = orientation.orientation_error(desired, R)
        assert np.abs(error - angle * axis).max() <= angle**3 / 24 + 4 * TINY

    @given(a=ROTATION, b=ROTATION)
    def test_limits_and_sign(self, a, b):
        error = orientation.orientation_error(a, b)
        length = np.linalg.norm(error)
        assert length <= 2 + TINY
        vector = orientation.rotation_vector(a @ b.T)
        np.testing.assert_allclose(length, 2 * np.sin(np.linalg.norm(vector) / 2), rtol=0, atol=4 * TINY)
        assert error @ vector >= 0  # following it shortens the way
        if length < 2 - 1e-9:
            np.testing.assert_allclose(orientation.orientation_error(b, a), -error, rtol=0, atol=1e-14)

    @given(R=ROTATION)
    def test_none_when_there(self, R):
        np.testing.assert_allclose(orientation.orientation_error(R, R), 0, atol=TINY)

    @given(axis=AXIS)
    def test_its_length_is_2_at_a_half_turn(self, axis):
        error = orientation.orientation_error(turn(axis, np.pi), np.eye(3))
        assert np.linalg.norm(error) == pytest.approx(2, abs=TINY)
        np.testing.assert_allclose(np.cross(error, axis), 0, atol=TINY * 2)


MATRIX_FUNCTIONS = ("quaternion", "quaternion_by_division", "rotation_vector", "differential_rotation")
QUATERNION_FUNCTIONS = ("rotation", "conjugate")
PAIR_FUNCTIONS = ("product", "relative_quaternion_base", "relative_quaternion_body")
CALLS = {
    **{name: ((3, 3),) for name in MATRIX_FUNCTIONS},
    **{name: ((4,),) for name in QUATERNION_FUNCTIONS},
    **{name: ((4,), (4,)) for name in PAIR_FUNCTIONS},
    "cross_matrix": ((3,),),
    "orientation_error": ((3, 3), (3, 3)),
}


def rotations(seed, size):
    """Uniform ones, and some near identity and near a half turn."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(size, 3))
    angles = np.concatenate([rng.uniform(0, 3, size - 4), [1e-12, 1e-3, 2.9, 3.0]])
    return np.stack([turn(axis / np.linalg.norm(axis), angle) for axis, angle in zip(axes, angles, strict=True)])


def arguments(shapes, size=12):
    for k, shape in enumerate(shapes):
        R = rotations(k, size)
        yield {(3, 3): R, (4,): orientation.quaternion(R), (3,): orientation.rotation_vector(R)}[shape]


@pytest.mark.parametrize("name", CALLS)
def test_batches_equal_single_calls(name):
    """Bit for bit: square roots and products are rounded alike, one by one or side by side; arctan2 to 1 ulp."""
    fun, batch = getattr(orientation, name), list(arguments(CALLS[name]))
    out = fun(*batch)
    for k, one in enumerate(zip(*batch, strict=True)):
        np.testing.assert_allclose(out[k], fun(*one), rtol=0, atol=0 if name != "rotation_vector" else 2 * EPS)
    shaped = fun(*(x.reshape(3, 4, *x.shape[1:]) for x in batch))
    np.testing.assert_allclose(shaped.reshape(out.shape), out, rtol=0, atol=2 * EPS)
    assert fun(*(x[:0] for x in batch)).shape == (0, *out.shape[1:])


@pytest.mark.parametrize("name", CALLS)
def test_traced_equals_floats(name):
    """Near a half turn, and at the identity, where the branch not taken divides by nothing, as well."""
    fun = getattr(orientation, name)
    traced = trace(fun, name, CALLS[name])
    for one in zip(*arguments(CALLS[name]), strict=True):
        expected = fun(*one)
        found = traced(*(x.ravel() for x in one)).full().reshape(expected.shape)
        tolerance = 1e-13 if name == "quaternion_by_division" else TINY
        np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)


@pytest.mark.parametrize("name", ["quaternion", "rotation_vector"])
@pytest.mark.parametrize("R", [np.eye(3), *(np.diag(2 * row - 1) for row in np.eye(3))], ids=["none", "x", "y", "z"])
def test_traced_at_the_identity_and_at_exact_half_turns(name, R):
    """To the last place but two, of an angle by arctan2, which NumPy and the C library each round their own way."""
    traced = trace(getattr(orientation, name), name, [(3, 3)])
    np.testing.assert_allclose(traced(R.ravel()).full().ravel(), getattr(orientation, name)(R), rtol=4 * EPS, atol=0)
