"""What this package's formulas hold for: a chain of joints of one degree of freedom, with numbers that mean something."""

import numpy as np
import pinocchio as pin

from k1607_pin.description.bounds import MOST_JOINTS

NO_RANGE = 1e-6
"""rad (m): limits closer to each other leave a joint no room; written digits end here."""


def require_serial(model: pin.Model) -> None:
    """Refuse what this package's formulas do not hold for.

    Raises
    ------
    ValueError
        No joint or too many, joints of several coordinates, branches, limits without a range, numbers that are not finite.
    """
    if model.nv == 0:
        raise ValueError(f"{model.name!r}: no movable joint")
    if model.njoints - 1 > MOST_JOINTS:
        raise ValueError(f"{model.name!r}: expected at most {MOST_JOINTS} joints, got {model.njoints - 1:,}")
    for i in range(1, model.njoints):
        if model.joints[i].nq != 1 or model.joints[i].nv != 1:
            raise ValueError(
                f"{model.name!r}, joint {model.names[i]!r}: expected one degree of freedom and one coordinate, "
                f"got {model.joints[i].shortname()} (nq {model.joints[i].nq}, nv {model.joints[i].nv})"
            )
        if model.parents[i] != i - 1:
            raise ValueError(
                f"{model.name!r}, joint {model.names[i]!r}: expected a serial chain, but its parent is "
                f"{model.names[model.parents[i]]!r}; lock the joints that do not carry the tool frame"
            )
    _require_range(model)
    _require_finite(model)


def without_range(model: pin.Model) -> list[int]:
    """Joints of one coordinate whose limits are one number, or hold one within rounding."""
    joints = (model.joints[i] for i in range(1, model.njoints))
    return [
        j.id
        for j in joints
        if j.nq == 1 and 0 <= model.upperPositionLimit[j.idx_q] - model.lowerPositionLimit[j.idx_q] <= NO_RANGE
    ]


def _require_range(model: pin.Model) -> None:
    lower, upper = model.lowerPositionLimit, model.upperPositionLimit
    good = upper - lower > NO_RANGE
    if not good.all():
        i = int(np.argmin(good))
        hint = "; lock it" if lower[i] <= upper[i] else ""
        raise ValueError(
            f"{model.name!r}, joint {model.names[i + 1]!r}: expected a lower limit below the upper one, got "
            f"{lower[i]:g} and {upper[i]:g}{hint}"
        )


def _require_finite(model: pin.Model) -> None:
    for i in range(model.njoints):
        body, placement = model.inertias[i], model.jointPlacements[i]
        if not (np.isfinite(body.toDynamicParameters()).all() and np.isfinite(placement.homogeneous).all()):
            raise ValueError(
                f"{model.name!r}, joint {model.names[i]!r}: expected finite mass, inertia and placement, got "
                f"{body} at {placement}"
            )
    if not np.isfinite(model.armature).all() or not np.isfinite(model.gravity.linear).all():
        raise ValueError(f"{model.name!r}: expected finite armature and gravity")
