"""Joints that do not move: locked by name, without range, beside the chain that carries the tool, or led by another."""

import logging
from collections.abc import Collection, Iterable, Mapping

import numpy as np
import pinocchio as pin

from k1607_pin.arguments import number
from k1607_pin.description.urdf_file import Mimic

logger = logging.getLogger(__name__)
BEYOND = 1e-9
"""rad (m): as far as a locked value may lie beyond its limits, which were rounded when written."""


Locked = str | Iterable[str | tuple[str, float]] | Mapping[str, float]
"""Joints to hold still: names, for as near to zero as the limits allow; with values [rad, m] as pairs or a mapping."""


def locked_values(model: pin.Model, locked: Locked) -> dict[str, float | None]:
    """Joint -> its value [rad, m] as given; None for the one nearest to zero within the limits.

    Raises
    ------
    ValueError
        No such joint; no number, or one beyond the joint's limits.
    """
    try:
        entries = (
            [locked] if isinstance(locked, str) else locked.items() if isinstance(locked, Mapping) else list(locked)
        )
    except TypeError:
        raise ValueError(f"locked: expected names of joints, or name -> value in rad, got {locked!r}") from None
    given: dict[str, float | None] = {}
    for entry in entries:
        joint, *value = entry if isinstance(entry, tuple) and len(entry) == 2 else (entry,)
        if not isinstance(joint, str) or not model.existJointName(joint):
            raise ValueError(
                f"locked: no joint {joint!r} in {model.name!r}, expected among {', '.join(list(model.names)[1:])}"
            )
        given[joint] = _within_limits(model, joint, *value) if value else None
    return given


def _within_limits(model: pin.Model, joint: str, given: object) -> float:
    value = number(f"locked: joint {joint!r}", given, unit="rad (m if it slides)")
    lower, upper = _limits(model, model.getJointId(joint))
    if not lower - BEYOND <= value <= upper + BEYOND:
        raise ValueError(
            f"locked: joint {joint!r}: expected a value within its limits, {lower:g} to {upper:g}, got {value:g}"
        )
    return value


def still_posture(
    model: pin.Model, still: Collection[int], given: Mapping[str, float | None], mimics: Mapping[str, Mimic]
) -> np.ndarray:
    """(nq,) where the joints ``still`` stand: as given, as their drivers lead them, or nearest to zero within their limits."""
    q = np.clip(pin.neutral(model), model.lowerPositionLimit, model.upperPositionLimit)
    q = np.where(np.isfinite(q), q, pin.neutral(model))
    for i in still:
        joint = model.joints[i]
        if joint.nv != 1:
            continue
        there = np.zeros(model.nv)
        there[joint.idx_v] = _value(model, model.names[i], given, mimics, ())
        place = slice(joint.idx_q, joint.idx_q + joint.nq)  # a continuous joint has two coordinates
        q[place] = pin.integrate(model, pin.neutral(model), there)[place]
    return q


def _value(
    model: pin.Model,
    name: str,
    given: Mapping[str, float | None],
    mimics: Mapping[str, Mimic],
    followers: tuple[str, ...],
) -> float:
    """rad (m) of one still joint, or of the driver that a still one follows."""
    angle, mimic = given.get(name), mimics.get(name)
    lower, upper = _limits(model, model.getJointId(name))
    if angle is not None:
        return float(np.clip(angle, lower, upper))
    if mimic is None or mimic.driver == name or mimic.driver in followers or not model.existJointName(mimic.driver):
        return float(np.clip(0.0, lower, upper))
    led = mimic.multiplier * _value(model, mimic.driver, given, mimics, (*followers, name)) + mimic.offset
    held = float(np.clip(led, lower, upper))
    if abs(held - led) > BEYOND:
        logger.warning(
            "%s: joint %r follows %r to %g, beyond its limits: held at %g", model.name, name, mimic.driver, led, held
        )
    return held


def _limits(model: pin.Model, i: int) -> tuple[float, float]:
    """rad (m); infinite where the joint turns without end."""
    joint = model.joints[i]
    if joint.nq != 1:
        return -np.inf, np.inf
    return float(model.lowerPositionLimit[joint.idx_q]), float(model.upperPositionLimit[joint.idx_q])


def reduced(
    model: pin.Model, geometries: list[pin.GeometryModel], still: Collection[int], q: np.ndarray
) -> tuple[pin.Model, list[pin.GeometryModel]]:
    """Without the joints ``still``, whose links are fixed where q (nq,) puts them."""
    if not still:
        return model, geometries
    # Pinocchio looks joints up among all frames by their names alone, and gives up where a link has the same one.
    names = list(model.names)
    frames = [(frame.name, frame.type) for frame in model.frames]
    links = {name for name, kind in frames if kind == pin.BODY}
    double = [i for i, name in enumerate(names) if name in links]
    if double:
        model = pin.Model(model)
        new = {names[i]: _unused(f"{names[i]} (joint)", links | set(names)) for i in double}
        for i in double:
            model.names[i] = new[names[i]]
        for i, (name, kind) in enumerate(frames):
            if kind == pin.JOINT and name in new:
                model.frames[i].name = new[name]
    model, geometries = pin.buildReducedModel(model, geometries, sorted(still), q)
    if double:
        old = {new_name: name for name, new_name in new.items()}
        for i, name in enumerate(list(model.names)):
            model.names[i] = old.get(name, name)
        for i, frame in enumerate(model.frames):
            model.frames[i].name = old.get(frame.name, frame.name)
    return model, list(geometries)


def _unused(name: str, taken: Collection[str]) -> str:
    return name if name not in taken else _unused(f"{name}'", taken)
