"""Units that the sources use, to SI; exact factors from scipy.constants."""

import scipy.constants as constants

LENGTH = {"m": 1.0, "cm": constants.centi, "mm": constants.milli, "in": constants.inch, "ft": constants.foot}
ANGLE = {"rad": 1.0, "deg": constants.degree}

INCH = constants.inch  # m
POUND = constants.pound  # kg
DEGREE = constants.degree  # rad
POUND_INCH_SECOND2 = constants.pound_force * constants.inch  # kg m^2: 1 lbf in s^2


def factor(kind: dict[str, float], unit: str, what: str) -> float:
    """SI value of one ``unit`` of the given kind (`LENGTH` or `ANGLE`).

    Raises
    ------
    ValueError
        Unknown unit; the message names ``what`` needed it and the units that are known.
    """
    if not isinstance(unit, str) or unit not in kind:
        raise ValueError(f"{what}: unknown unit {unit!r}, expected one of {', '.join(kind)}")
    return kind[unit]
