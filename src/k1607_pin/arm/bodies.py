"""A `pinocchio.Model` as constants for our own, traceable rigid-body dynamics."""

import numpy as np
import pinocchio as pin

from k1607_pin.description.dh import exact
from k1607_pin.dynamics.rigid_body import Body, second_moments


def bodies(model: pin.Model) -> list[Body]:
    """The bodies of a model of revolute and prismatic joints with one coordinate each; rotations freed of rounding.

    Raises
    ------
    ValueError
        Another kind of joint; it is named.
    """
    result = []
    for i in range(1, model.njoints):
        axis, revolute = _axis(model, i)
        placement, inertia = model.jointPlacements[i], model.inertias[i]
        result.append(
            Body(
                parent=model.parents[i] - 1,
                rotation=exact(placement.rotation),
                translation=placement.translation.copy(),
                axis=axis,
                revolute=revolute,
                mass=float(inertia.mass),
                moment=inertia.mass * inertia.lever,
                second=second_moments(pin.Symmetric3(inertia.toDynamicParameters()[4:]).matrix()),
                armature=float(model.armature[i - 1]),
            )
        )
    return result


def _axis(model: pin.Model, i: int) -> tuple[np.ndarray, bool]:
    """Joint axis in the joint frame, and whether it turns: read off the joint's own motion subspace."""
    joint = model.joints[i]
    if joint.nq != 1 or joint.nv != 1:
        kind = f"{joint.shortname()} (nq {joint.nq}, nv {joint.nv})"
        raise ValueError(f"joint {model.names[i]!r}: expected one coordinate, got {kind}")
    linear, angular = motion_subspace(model, i)
    if angular.any() and linear.any():
        raise ValueError(f"joint {model.names[i]!r}: expected a revolute or a prismatic joint, got {joint.shortname()}")
    return (angular, True) if angular.any() else (linear, False)


def motion_subspace(model: pin.Model, i: int) -> tuple[np.ndarray, np.ndarray]:
    """Linear and angular velocity (3,) of joint i's frame, in its own axes, at unit joint speed and neutral position."""
    joint = model.joints[i]
    data = joint.createData()
    joint.calc(data, pin.neutral(model))
    S = np.ravel(data.S)
    return S[:3], S[3:]
