import pytest

from k1607_pin.description import units


def test_factors_are_the_definitions():
    """International inch and pound, exact; the standard gravity that makes a pound a pound-force."""
    expected = {
        units.INCH: 0.0254,
        units.LENGTH["in"]: 0.0254,
        units.LENGTH["ft"]: 12 * 0.0254,
        units.LENGTH["cm"]: 0.01,
        units.LENGTH["mm"]: 0.001,
        units.LENGTH["m"]: 1.0,
        units.POUND: 0.45359237,
        units.DEGREE: 3.141592653589793 / 180,
        units.ANGLE["deg"]: 3.141592653589793 / 180,
        units.ANGLE["rad"]: 1.0,
        units.POUND_INCH_SECOND2: 0.45359237 * 9.80665 * 0.0254,
    }
    for factor, definition in expected.items():
        assert factor == pytest.approx(definition, rel=1e-15)


@pytest.mark.parametrize("unit", ["inch", "", "IN", "deg", None])
def test_an_unknown_unit_is_named_with_those_known(unit):
    with pytest.raises(ValueError, match="column 'a'") as error:
        units.factor(units.LENGTH, unit, "column 'a'")
    assert repr(unit) in str(error.value)
    assert all(known in str(error.value) for known in units.LENGTH)
