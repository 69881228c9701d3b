import pytest

from k1607_pin.description import units


def test_factors_are_the_definitions():
    """International inch and pound, exact; the standard gravity that makes a pound a pound-force."""
    assert units.INCH == units.LENGTH["in"] == pytest.approx(0.0254, rel=1e-15)
    assert units.LENGTH["ft"] == pytest.approx(12 * 0.0254, rel=1e-15)
    assert units.LENGTH["mm"] * 1000 == units.LENGTH["cm"] * 100 == units.LENGTH["m"] == 1
    assert units.POUND == pytest.approx(0.45359237, rel=1e-15)
    assert units.DEGREE * 180 == pytest.approx(3.141592653589793, rel=1e-15)
    assert units.POUND_INCH_SECOND2 == pytest.approx(0.45359237 * 9.80665 * 0.0254, rel=1e-15)


@pytest.mark.parametrize("unit", ["inch", "", "IN", "deg", None])
def test_an_unknown_unit_is_named_with_those_known(unit):
    with pytest.raises(ValueError, match="column 'a'") as error:
        units.factor(units.LENGTH, unit, "column 'a'")
    assert repr(unit) in str(error.value)
    assert all(known in str(error.value) for known in units.LENGTH)
