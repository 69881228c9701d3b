"""The inertial parameters that matter: what is symmetric about its joint may as well belong to the parent.

A revolute joint does not move its own axis, so that a body of mass m, with its moment along the axis and an inertia
t (1 - a a^T), a the axis, acts on the rest alike whether it turns with the joint or stays with the parent; a prismatic joint does
not turn what it carries, whose inertia about the joint frame's origin may be the parent's. Moved there, they leave zeros behind
(Gautier and Khalil, IEEE Trans. Robotics and Automation 6(3), 1990): the same joint forces for a sixth fewer operations.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from k1607_pin.dynamics.rigid_body import Body, in_parent


def base_parameters(bodies: Sequence[Body]) -> list[Body]:
    """Bodies with the same inverse dynamics and mass matrix, and zeros in their parameters.

    What reaches the base has no effect on the joints and is dropped. They are no bodies one could build: masses may be zero.
    """
    moved = list(bodies)
    for i in reversed(range(len(bodies))):
        body = moved[i]
        mass, moment, inertia = _movable(body)
        moved[i] = body._replace(mass=body.mass - mass, moment=body.moment - moment, inertia=body.inertia - inertia)
        if body.parent >= 0:
            parent = moved[body.parent]
            m, h, I = in_parent(body, np.eye(3), body.translation, mass, moment, inertia)
            moved[body.parent] = parent._replace(
                mass=parent.mass + m, moment=parent.moment + h, inertia=parent.inertia + I
            )
    return moved


def _movable(body: Body) -> tuple[Any, Any, Any]:
    """Mass, first moment (3,) and inertia (3, 3) about the joint frame that may go to the parent."""
    if not body.revolute:
        return 0.0, np.zeros(3), body.inertia
    a = body.axis
    across = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
    across = across / np.linalg.norm(across)
    return body.mass, a * (a @ body.moment), (across @ body.inertia @ across) * (np.eye(3) - np.outer(a, a))
