"""Checks of arguments: what is a number passes as one, what is not is named."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from k1607_pin.arguments import is_symbolic, number, numbers, seen_through

REAL = st.floats(allow_nan=False, allow_infinity=False, width=32)


@given(st.lists(REAL, min_size=1, max_size=8))
def test_numbers_come_back_as_they_are(x):
    np.testing.assert_array_equal(numbers("x", x, (len(x),)), x)
    np.testing.assert_array_equal(numbers("x", tuple(x), (None,)), x)
    assert numbers("x", np.array(x, np.float32)).dtype == float


@pytest.mark.parametrize(
    "x",
    [
        [1, np.nan],
        [np.inf, 0],
        [1j, 0],
        ["1", "2"],
        [None, 1],
        [[1, 2], [3]],
        np.ma.array([1.0, 2.0], mask=[True, False]),
        [1, 2, 3],
        5.0,
        "ab",
        object(),
        {1: 2},
    ],
)
def test_what_is_no_vector_of_two_is_refused_by_name(x):
    with pytest.raises(ValueError, match=r"^q: expected \(2,\) finite numbers in rad, got "):
        numbers("q", x, (2,), "rad")


def test_a_masked_array_without_a_mask_is_an_array():
    np.testing.assert_array_equal(numbers("x", np.ma.array([1.0, 2.0])), [1, 2])


def test_infinity_passes_where_it_may():
    assert numbers("upper", [np.inf], (1,), finite=False)[0] == np.inf
    assert number("limit", np.inf, above=0, finite=False) == np.inf


@given(st.floats(min_value=1e-300, max_value=1e149))
def test_a_positive_number(x):
    assert number("x", x, above=0) == x
    with pytest.raises(ValueError, match="x: expected a positive number in s, got "):
        number("x", -x, above=0, unit="s")


@pytest.mark.parametrize("x", [np.nan, np.inf, None, "1", [1.0], 1j, True, np.ma.masked, np.array(["a"])])
def test_what_is_no_number_is_refused_by_name(x):
    with pytest.raises(ValueError, match=r"^gain: expected a number >= 0 in 1/s, got "):
        number("gain", x, at_least=0, unit="1/s")


def test_symbols_are_seen_through():
    symbol = ca.SX.sym("x", 2)
    ca.GlobalOptions.setNumpyMode(1)
    try:
        array = ca.array(symbol)
        assert is_symbolic(array)
        assert seen_through("q", array, numbers, (7,)) is array
    finally:
        ca.GlobalOptions.setNumpyMode(0)
    assert is_symbolic(np.array([object()]))
    assert not any(is_symbolic(x) for x in (1, 1.0, np.float64(1), np.zeros(3), [1, 2], None, "x"))
    with pytest.raises(ValueError, match="q: expected"):
        seen_through("q", np.zeros(6), numbers, (7,))


def test_a_message_stays_short():
    with pytest.raises(ValueError, match="x: expected") as error:
        numbers("x", [*np.linspace(0, 1, 900).tolist(), "no number"])
    assert len(str(error.value)) < 250


@pytest.mark.parametrize("x", [1e150, -1e300, 10**200])
def test_numbers_whose_squares_overflow_are_refused(x):
    with pytest.raises(ValueError, match=r"^omega: expected a number in 1/s, of size below 1e\+150, got "):
        number("omega", x, unit="1/s")
    assert number("limit", x, finite=False) == float(x)
