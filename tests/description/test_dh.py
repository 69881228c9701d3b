from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from k1607_pin.description.dh import COLUMNS, DHTable, exact, link_transform, table_1

FINITE = st.floats(-1e6, 1e6)
ANGLE = st.one_of(st.integers(-4, 4).map(lambda k: k * np.pi / 2), st.floats(-np.pi, np.pi))
LENGTH = st.floats(-5, 5)
ROWS = st.lists(st.tuples(ANGLE, LENGTH, LENGTH, ANGLE), min_size=1, max_size=9)


def wrapped(angle):
    """Angles to (-pi, pi]: what an arctan2 can tell apart."""
    return np.arctan2(np.sin(angle), np.cos(angle))


def rotation_x(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


def screw_z(angle, d):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, d], [0, 0, 0, 1]])


class TestFromRows:
    @given(rows=st.lists(st.one_of(st.tuples(*[FINITE] * 3), st.tuples(*[FINITE] * 4)), min_size=1, max_size=9))
    def test_keeps_every_number(self, rows):
        table = DHTable.from_rows(rows)
        assert table.n == len(rows)
        for i, row in enumerate(rows):
            got = (table.alpha[i], table.a[i], table.d[i], table.theta_offset[i])
            assert got == (*row, 0.0)[:4]

    @given(rows=ROWS)
    def test_units(self, rows):
        table, plain = DHTable.from_rows(rows, "in", "deg"), DHTable.from_rows(rows)
        for column in ("a", "d"):
            np.testing.assert_allclose(getattr(table, column), 0.0254 * getattr(plain, column), rtol=1e-15)
        for column in ("alpha", "theta_offset"):
            np.testing.assert_allclose(getattr(table, column), np.deg2rad(getattr(plain, column)), rtol=1e-15)

    BAD = (
        float("nan"), float("inf"), -float("inf"), True, np.True_, "1.0", b"1.0", None, 1j, 10**400, [1.0], (), {},
        np.array([1.0]), Decimal("NaN"),
    )  # fmt: skip

    @pytest.mark.parametrize("value", BAD, ids=lambda x: repr(x)[:12])
    def test_what_is_no_finite_number_is_named_with_row_and_column(self, value):
        for i, column in ((0, 0), (1, 1), (1, 2), (2, 3)):
            rows = [[0.0] * 4 for _ in range(3)]
            rows[i][column] = value
            with pytest.raises(ValueError, match=f"row {i + 1}, column '{COLUMNS[column]}'"):
                DHTable.from_rows(rows)

    @pytest.mark.parametrize(
        "row", [[], [1.0], [1.0, 2.0], [0.0] * 5, "abc", b"abc", {"a": 1, "b": 2, "c": 3}, 1.0, None]
    )
    def test_a_row_of_wrong_length_is_named(self, row):
        with pytest.raises(ValueError, match=r"row 3: expected \(alpha, a, d\)"):
            DHTable.from_rows([[0.0] * 3, [0.0] * 4, row])

    def test_no_rows(self):
        with pytest.raises(ValueError, match="at least one row"):
            DHTable.from_rows([])

    @pytest.mark.parametrize(("length", "angle", "column"), [("inch", "deg", "'a' and 'd'"), ("in", "grad", "'alpha'")])
    def test_an_unknown_unit(self, length, angle, column):
        with pytest.raises(ValueError, match=column):
            DHTable.from_rows([[0.0] * 3], length, angle)


@pytest.mark.parametrize(
    ("table", "missing"),
    [
        ({}, "rows"),
        ({"rows": [[0, 0, 0]]}, "units"),
        ({"rows": [[0, 0, 0]], "units": {"length": "m"}}, "angle"),
        ({"rows": [[0, 0, 0]], "units": {"angle": "rad"}}, "length"),
    ],
)
def test_from_mapping_names_the_missing_key(table, missing):
    with pytest.raises(ValueError, match=missing):
        DHTable.from_mapping(table)


@given(k=st.integers(-8, 8))  # to two turns: further out, the rounding of the angle itself is 4 ulp of 1 and more
def test_multiples_of_90_degrees_are_exact(k):
    table = DHTable.from_rows([[90.0 * k, 0.0, 0.0]], "m", "deg")
    assert (table.cos_alpha[0], table.sin_alpha[0]) == ((1, 0), (0, 1), (-1, 0), (0, -1))[k % 4]


@given(x=st.floats(-2, 2))
def test_exact_touches_rounding_only(x):
    """4 ulp of 1 is 8.9e-16: anything that far from -1, 0 and 1 stays as it is."""
    y = float(exact(np.array(x)))
    assert y == x or (y in (-1.0, 0.0, 1.0) and abs(x - y) <= 4 * np.finfo(float).eps)
    if abs(x - round(x)) > 1e-15:
        assert y == x


def test_exact_gives_no_negative_zero():
    assert not np.signbit(exact(np.array([-1e-16, -0.0]))).any()


@given(theta=ANGLE, row=st.tuples(ANGLE, LENGTH, LENGTH))
def test_link_transform_is_the_product_of_its_four_motions(theta, row):
    """Rx(alpha) Tx(a) Rz(theta) Tz(d): Craig's definition, which eq. (2) multiplies out."""
    alpha, a, d = row
    step = np.eye(4)
    step[0, 3] = a
    expected = rotation_x(alpha) @ step @ screw_z(theta, d)
    T = link_transform(np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha), a, d)
    np.testing.assert_allclose(T, expected, rtol=0, atol=1e-15)


@given(rows=ROWS)
def test_placements_are_read_back(rows):
    """Reading divides nothing: a few ulp of the largest entry, 5 m."""
    table = DHTable.from_rows(rows)
    again = DHTable.from_placements(table.placements())
    np.testing.assert_allclose(wrapped(again.alpha - table.alpha), 0, atol=4e-15)
    np.testing.assert_allclose(wrapped(again.theta_offset - table.theta_offset), 0, atol=4e-15)
    np.testing.assert_allclose(again.a, table.a, rtol=0, atol=4e-15)
    np.testing.assert_allclose(again.d, table.d, rtol=0, atol=1e-14)


@given(rows=st.lists(st.tuples(ANGLE, LENGTH, LENGTH, ANGLE), min_size=2, max_size=4), k=st.integers(0, 1))
def test_a_placement_that_no_row_expresses_names_its_joint(rows, k):
    """A turn about y comes in no D-H row, nor does a step along y at alpha = 0."""
    placements = DHTable.from_rows([(0.0, *row[1:]) for row in rows]).placements()
    turn = np.eye(4)
    turn[:3, :3] = [[np.cos(0.3), 0, np.sin(0.3)], [0, 1, 0], [-np.sin(0.3), 0, np.cos(0.3)]]
    placements[k] = turn @ placements[k]
    with pytest.raises(ValueError, match=f"joint {k + 1}: "):
        DHTable.from_placements(placements)
    placements[k] = np.eye(4)
    placements[k, 1, 3] = 0.1
    with pytest.raises(ValueError, match=f"joint {k + 1}: "):
        DHTable.from_placements(placements)


def test_table_1_in_si():
    table = table_1()
    np.testing.assert_allclose(np.rad2deg(table.alpha), [0, -90, 90, -90, 90, -90, 90], rtol=1e-15)
    np.testing.assert_allclose(table.a, [0, 0, 0.142875, 0.10795, -0.10795, 0.079375, -0.079375], rtol=1e-15)
    np.testing.assert_allclose(table.d, [0, 0, 0.6858, 0, 0.6858, 0, 0], rtol=1e-15)
    assert not table.theta_offset.any()
