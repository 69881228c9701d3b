"""Continuous joints as ordinary ones: one angle without limits in place of Pinocchio's cosine and sine."""

import numpy as np
import pinocchio as pin

from k1607_pin.arm.bodies import motion_subspace

_BOUNDED = {"JointModelRUBX": pin.JointModelRX, "JointModelRUBY": pin.JointModelRY, "JointModelRUBZ": pin.JointModelRZ}


def with_one_angle_each(model: pin.Model) -> pin.Model:
    """The same model with every unbounded revolute joint parametrised by its angle, limits infinite; other joints as they are.

    Joint and frame indices stay, so geometry models of ``model`` fit the result too.
    """
    kinds = [joint.shortname() for joint in model.joints]
    if not any(kind in _BOUNDED or kind == "JointModelRevoluteUnboundedUnaligned" for kind in kinds):
        return model
    result = pin.Model()
    result.name, result.gravity = model.name, model.gravity
    for i in range(1, model.njoints):
        joint, q, v = model.joints[i], model.joints[i].idx_q, model.joints[i].idx_v
        dofs = slice(v, v + joint.nv)
        lower, upper = (x[q : q + joint.nq] for x in (model.lowerPositionLimit, model.upperPositionLimit))
        if kinds[i] in _BOUNDED:
            joint, lower, upper = _BOUNDED[kinds[i]](), np.array([-np.inf]), np.array([np.inf])
        elif kinds[i] == "JointModelRevoluteUnboundedUnaligned":
            joint = pin.JointModelRevoluteUnaligned(motion_subspace(model, i)[1])
            lower, upper = np.array([-np.inf]), np.array([np.inf])
        result.addJoint(
            model.parents[i],
            joint,
            model.jointPlacements[i],
            model.names[i],
            model.effortLimit[dofs],
            model.velocityLimit[dofs],
            lower,
            upper,
        )
        result.inertias[i] = model.inertias[i]
    for frame in list(model.frames)[1:]:
        result.addFrame(frame, False)
    result.armature, result.damping = model.armature, model.damping
    result.lowerDryFrictionLimit, result.upperDryFrictionLimit = (
        model.lowerDryFrictionLimit,
        model.upperDryFrictionLimit,
    )
    return result
