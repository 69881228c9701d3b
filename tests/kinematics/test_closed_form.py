import itertools

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from k1607_pin import closed_form
from k1607_pin.compiled.trace import trace
from k1607_pin.description.dh import table_1
from k1607_pin.kinematics import product

TABLE = table_1()
# Two evaluations of a pose differ by the rounding of some hundred operations on numbers of at most 1.9 m: 1e-14.
# The ladder asks for 1e-12 and gets it everywhere.
TIGHT = 1e-12
# Single calls and batches may take different sine and cosine kernels, 1 ulp apart; the pose is linear in each of the 14
# with a coefficient of at most the arm's reach.
ULPS = 14 * 2 * np.finfo(float).eps

ANGLES = hnp.arrays(
    float,
    7,
    elements=st.one_of(
        st.floats(-np.pi, np.pi), st.integers(-8, 8).map(lambda k: k * np.pi / 2), st.floats(-1e3, 1e3), st.just(0.0)
    ),
)
RIGHT_ANGLES = np.array(list(itertools.product(np.arange(-1, 3) * np.pi / 2, repeat=7)))  # 16384 poses, most singular


@pytest.fixture(scope="module")
def traced():
    """Forward kinematics and Jacobian by CasADi, as functions of (m, 7)."""
    fk = trace(closed_form.forward_kinematics, "fk", [(7,)])
    jacobian = trace(closed_form.jacobian, "jacobian", [(7,)])

    def batched(fun, rows, columns):
        # one call for all poses: CasADi puts the outputs side by side
        return lambda q: fun(q.T).full().reshape(rows, -1, columns).swapaxes(0, 1)

    return batched(fk, 4, 4), batched(jacobian, 6, 7)


class TestTheFourAgree:
    """Closed form = product (3) = Pinocchio = CasADi."""

    def test_on_random_poses(self, reference, traced, postures):
        T = closed_form.forward_kinematics(postures)
        np.testing.assert_allclose(T, product.forward_kinematics(TABLE, postures), rtol=0, atol=TIGHT)
        np.testing.assert_allclose(T, reference.forward_kinematics(postures), rtol=0, atol=TIGHT)
        np.testing.assert_allclose(T, traced[0](postures), rtol=0, atol=TIGHT)

    def test_jacobians_on_random_poses(self, reference, traced, postures):
        q = postures[:20_000]
        J = closed_form.jacobian(q)
        np.testing.assert_allclose(J, product.jacobian(TABLE, q), rtol=0, atol=TIGHT)
        np.testing.assert_allclose(J, reference.jacobian(q), rtol=0, atol=TIGHT)
        np.testing.assert_allclose(J, traced[1](q), rtol=0, atol=TIGHT)

    def test_at_multiples_of_90_degrees(self, reference, traced):
        q = RIGHT_ANGLES
        T, J = closed_form.forward_kinematics(q), closed_form.jacobian(q)
        np.testing.assert_allclose(T, product.forward_kinematics(TABLE, q), rtol=0, atol=TIGHT)
        np.testing.assert_allclose(T, reference.forward_kinematics(q), rtol=0, atol=TIGHT)
        np.testing.assert_allclose(T, traced[0](q), rtol=0, atol=TIGHT)
        np.testing.assert_allclose(J, product.jacobian(TABLE, q), rtol=0, atol=TIGHT)
        np.testing.assert_allclose(J, reference.jacobian(q), rtol=0, atol=TIGHT)
        np.testing.assert_allclose(J, traced[1](q), rtol=0, atol=TIGHT)

    @given(q=ANGLES)
    def test_at_singular_and_extreme_poses(self, reference, traced, q):
        """Many turns cost nothing: all four reduce the same double to its exact angle."""
        T, J = closed_form.forward_kinematics(q), closed_form.jacobian(q)
        np.testing.assert_allclose(T, product.forward_kinematics(TABLE, q), rtol=0, atol=TIGHT)
        np.testing.assert_allclose(T, reference.forward_kinematics(q).homogeneous, rtol=0, atol=TIGHT)
        np.testing.assert_allclose(T, traced[0](q[None])[0], rtol=0, atol=TIGHT)
        np.testing.assert_allclose(J, product.jacobian(TABLE, q), rtol=0, atol=TIGHT)
        np.testing.assert_allclose(J, reference.jacobian(q), rtol=0, atol=TIGHT)
        np.testing.assert_allclose(J, traced[1](q[None])[0], rtol=0, atol=TIGHT)

    @given(q=ANGLES, turns=hnp.arrays(np.int64, 7, elements=st.integers(-100, 100)))
    def test_full_turns_change_nothing(self, q, turns):
        """Adding k turns rounds the angle to an ulp of 1600 rad, 2.3e-13; 7 of them, levered by 1.9 m."""
        T, turned = closed_form.forward_kinematics(q), closed_form.forward_kinematics(q + 2 * np.pi * turns)
        np.testing.assert_allclose(turned, T, rtol=0, atol=7 * 1.9 * 2.3e-13 + 7 * 1.9 * 100 * 2.5e-16)


def test_zero_pose_by_hand():
    """Stretched out along z: the a's add up along x to 5.625 in, the d's along z to 54 in, and no axis is turned."""
    T = closed_form.forward_kinematics(np.zeros(7))
    np.testing.assert_allclose(T[:3, :3], np.eye(3), rtol=0, atol=0)
    np.testing.assert_allclose(T[:3, 3], np.array([5.625, 0.0, 54.0]) * 0.0254, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(T[3], [0, 0, 0, 1])


def test_elbow_at_a_right_angle_by_hand():
    """theta_4 = 90°: what follows the elbow, 4.25 in from the axis of the upper arm, turns about y by 90°."""
    T = closed_form.forward_kinematics(np.array([0, 0, 0, np.pi / 2, 0, 0, 0]))
    # from the elbow at (9.875, 0, 27) in: (-4.25, 0, 27) in turned by -90° or 90° about y; (2) with alpha_3 = -90° has +
    elbow, beyond = np.array([5.625 + 4.25, 0, 27.0]), np.array([-4.25, 0, 27.0])
    R = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    np.testing.assert_allclose(T[:3, :3], R, rtol=0, atol=1e-15)
    np.testing.assert_allclose(T[:3, 3], (elbow + R @ beyond) * 0.0254, rtol=0, atol=1e-15)


@given(q=ANGLES)
def test_the_pose_is_rigid(q):
    T = closed_form.forward_kinematics(q)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), rtol=0, atol=1e-14)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1, abs=1e-14)
    np.testing.assert_array_equal(T[3], [0, 0, 0, 1])


@given(q=ANGLES)
def test_the_named_terms_are_the_axes_of_the_frames(q):
    """What the module says the g's and h's are, against the partial products of (3)."""
    c, s = product.cosines_and_sines(q)
    t = closed_form.terms(c, s, closed_form.parameters())
    frames = product.frame_transforms(TABLE, c, s)
    x, y, z = ([None, *(T[:3, k] for T in frames)] for k in range(3))  # numbered from 1
    f1, f2, f3, f4, f5, f6 = t.f
    g1, g2, g3, g4, g5, g6 = t.g
    h1, h2, h3, h4, h5 = t.h
    j1, j2, j3 = t.j
    named = [
        (x[3], (f2, f4, -s[1] * c[2])), (y[3], (f1, f3, s[1] * s[2])), (x[4], (g1, g3, f5)), (z[5], (g2, g4, f6)),
        (x[5], (h2, h4, g6)), (z[6], (h1, h3, g5)), (x[6], (j1, j2, h5)), (x[7], t.n), (y[7], t.s), (z[7], t.a),
    ]  # fmt: skip
    for axis, term in named:
        np.testing.assert_allclose(axis, term, rtol=0, atol=1e-14)
    shoulder = frames[2][:3, 3]
    np.testing.assert_allclose(np.hypot(*shoulder[:2]), abs(j3), rtol=0, atol=1e-14)


def central_differences(q, h):
    """(6, 7): position differenced in R^3, orientation on SO(3), base axes."""
    columns = []
    for step in h * np.eye(7):
        ahead, behind = closed_form.forward_kinematics(q + step), closed_form.forward_kinematics(q - step)
        turn = pin.log3(ahead[:3, :3] @ behind[:3, :3].T)
        columns.append(np.concatenate([ahead[:3, 3] - behind[:3, 3], turn]) / (2 * h))
    return np.stack(columns, axis=-1)


@given(q=hnp.arrays(float, 7, elements=st.floats(-np.pi, np.pi)))
def test_jacobian_against_central_differences(q):
    """Along one joint the tool moves on a circle of at most 1.9 m: its third derivative bounds the error of the step,
    rounding of the pose and of q + h adds eps / h."""
    h = 6e-6  # near the cube root of eps, where the two are of a size
    tolerance = 1.9 * (h * h / 6 + 16 * np.finfo(float).eps / h)
    assert tolerance < 2e-9
    np.testing.assert_allclose(closed_form.jacobian(q), central_differences(q, h), rtol=0, atol=tolerance)


class TestBatches:
    @pytest.mark.parametrize("shape", [(), (1,), (3,), (2, 3), (4, 1, 2), (0,), (2, 0, 3)])
    @pytest.mark.parametrize(("fun", "size"), [("forward_kinematics", (4, 4)), ("jacobian", (6, 7))])
    def test_any_shape_equals_single_calls(self, shape, fun, size):
        fun = getattr(closed_form, fun)
        q = np.random.default_rng(5).uniform(-np.pi, np.pi, (*shape, 7))
        out = fun(q)
        assert out.shape == (*shape, *size)
        assert out.dtype == float
        for index in np.ndindex(*shape):
            np.testing.assert_allclose(out[index], fun(q[index]), rtol=0, atol=ULPS)

    @pytest.mark.parametrize("poses", [-1, 0, 1, closed_form.CHUNK - 1, closed_form.CHUNK, closed_form.CHUNK + 1])
    @pytest.mark.parametrize("fun", ["forward_kinematics", "jacobian"])
    def test_across_the_border_of_a_chunk(self, postures, poses, fun):
        q = postures[: closed_form.CHUNK + poses]
        fun = getattr(closed_form, fun)
        out = fun(q)
        border = {
            0,
            1,
            closed_form.CHUNK - 1,
            closed_form.CHUNK,
            closed_form.CHUNK + 1,
            2 * closed_form.CHUNK,
            len(q) - 1,
        }
        for k in (k for k in border if k < len(q)):
            np.testing.assert_allclose(out[k], fun(q[k]), rtol=0, atol=ULPS)
        shaped = fun(q.reshape(1, len(q), 7))
        np.testing.assert_array_equal(shaped[0], out)

    @pytest.mark.parametrize("fun", ["forward_kinematics", "jacobian"])
    def test_memory_layout_does_not_matter(self, postures, fun):
        fun = getattr(closed_form, fun)
        for q in (postures[:3000], postures[:50]):
            for same in (np.asfortranarray(q), np.repeat(q, 2, axis=0)[::2], q[::-1][::-1]):
                np.testing.assert_allclose(fun(same), fun(q), rtol=0, atol=ULPS)

    def test_lists_and_whole_numbers(self):
        q = [0, 1, 0, 2, 0, 1, 0]
        for same in (q, tuple(q), np.array(q)):
            T = closed_form.forward_kinematics(same)
            np.testing.assert_allclose(T, closed_form.forward_kinematics(np.array(q, dtype=float)), rtol=0, atol=ULPS)

    def test_the_argument_is_left_alone(self, postures):
        q = postures[:5000].copy()
        out = closed_form.forward_kinematics(q)
        out[:] = 0
        np.testing.assert_array_equal(q, postures[:5000])


@pytest.mark.parametrize(
    "q",
    [0.0, None, [], np.zeros(6), np.zeros(8), np.zeros((7, 6)), [[0.0] * 6] * 7, np.zeros((0, 6)), np.zeros((7, 1))],
)
@pytest.mark.parametrize("fun", [closed_form.forward_kinematics, closed_form.jacobian])
def test_wrong_shapes_are_refused(fun, q):
    with pytest.raises(ValueError, match=r"q: expected joint angles in rad of shape \(..., 7\)"):
        fun(q)
