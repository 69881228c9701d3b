"""Rigid-body dynamics of a tree of revolute and prismatic joints, written once for floats and traced symbols.

Inverse dynamics and mass matrix go from body to body in the bodies' own axes, about their own origins: there the constants are
constants and the zeros zeros, which leaves a third of the operations that base axes take (`base_parameters` lessens them
further). Coriolis matrix and points are expressed in base axes about the base origin: a spatial velocity is (v, w), the linear
velocity of the body's point at the base origin, then the angular velocity; a spatial force (f, m) likewise (Featherstone, Rigid
Body Dynamics Algorithms, 2008, with linear components first, as in Pinocchio).
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from k1607_pin.dynamics.linear import solve_symmetric
from k1607_pin.kinematics.rotations import cross_matrix, rotation_vector


class Body(NamedTuple):
    """One body and the joint that carries it. Bodies come after their parents."""

    parent: int
    """Index of the parent body, -1 for the base."""
    rotation: np.ndarray
    """(3, 3) joint frame in the parent's, at zero."""
    translation: np.ndarray
    """(3,) m"""
    axis: np.ndarray
    """(3,) unit vector in the joint frame."""
    revolute: bool
    """Whether the joint turns about the axis (else it slides along it)."""
    mass: Any
    """kg; this, moment, second and armature may be symbols."""
    moment: Any
    """(3,) kg m, mass times centre of gravity, in the joint frame."""
    second: Any
    """(3, 3) kg m^2 second moments, the integral of r r^T dm over the body, about the joint frame's origin and in its axes; see
    `second_moments`."""
    armature: Any
    """kg m^2 (kg for a prismatic joint): reflected rotor inertia."""


def second_moments(inertia: Any) -> Any:
    """(3, 3) kg m^2 from the inertia (3, 3) about the same point: tr(I)/2 - I.

    Steiner's theorem and the moments of a turning body are shorter in these.
    """
    return np.trace(inertia) / 2 * np.eye(3) - inertia


def inertia_from(second: Any) -> Any:
    """(3, 3) kg m^2, the inverse of `second_moments`: tr(S) - S."""
    S, xy, xz, yz = second, -second[0, 1], -second[0, 2], -second[1, 2]
    return np.stack(
        [
            np.stack([S[1, 1] + S[2, 2], xy, xz]),
            np.stack([xy, S[0, 0] + S[2, 2], yz]),
            np.stack([xz, yz, S[0, 0] + S[1, 1]]),
        ]
    )


class Motion(NamedTuple):
    """Where the bodies are."""

    rotations: list[Any]
    """n times (3, 3), body frame in base."""
    origins: list[Any]
    """n times (3,) m"""
    screws: list[Any]
    """n times (6,): spatial velocity of unit joint speed."""


def place(bodies: Sequence[Body], q: Any) -> Motion:
    """Body frames and joint screws in the base, for joint positions q (n,)."""
    rotations: list[Any] = []
    origins: list[Any] = []
    screws: list[Any] = []
    for i, body in enumerate(bodies):
        R, o = (np.eye(3), np.zeros(3)) if body.parent < 0 else (rotations[body.parent], origins[body.parent])
        o = o + R @ body.translation
        R = R @ body.rotation
        axis = R @ body.axis
        if body.revolute:
            R = R @ _turn(body.axis, q[i])
            screws.append(np.concatenate([np.cross(o, axis), axis]))
        else:
            o = o + axis * q[i]
            screws.append(np.concatenate([axis, 0 * axis]))
        rotations.append(R)
        origins.append(o)
    return Motion(rotations, origins, screws)


def inverse_dynamics(bodies: Sequence[Body], q: Any, v: Any, a: Any, gravity: Any) -> Any:
    """(n,) joint forces for accelerations a (n,), by Newton and Euler; gravity (3,) m/s^2 in the base."""
    turns, offsets = _joints(bodies, q)
    rates: list[Any] = []  # of each body, in its own axes: w (3,) rad/s
    spreads: list[
        Any
    ] = []  # U = dw x + w x w x, (3, 3) 1/s^2: what the body's points accelerate by, a metre from its origin
    accelerations: list[Any] = []  # (3,) m/s^2 of its origin, less gravity
    forces: list[Any] = []  # (3,) N
    moments: list[Any] = []  # (3,) N m about its origin
    turnings: list[Any] = []  # dw (3,) rad/s^2
    for i, body in enumerate(bodies):
        if body.parent < 0:
            w, dw, A = np.zeros(3), np.zeros(3), -gravity
        else:
            w, dw = rates[body.parent], turnings[body.parent]
            A = accelerations[body.parent] + spreads[body.parent] @ offsets[i]
        back = turns[i].T
        w, dw, A = (back @ (body.rotation.T @ x) for x in (w, dw, A))
        joint = body.axis * v[i]
        if body.revolute:
            dw = dw + np.cross(w, joint) + body.axis * a[i]
            w = w + joint
        else:
            A = A + 2 * np.cross(w, joint) + body.axis * a[i]
        rates.append(w)
        turnings.append(dw)
        accelerations.append(A)
        spreads.append(_spread(w, dw))
        forces.append(body.mass * A + spreads[i] @ body.moment)
        moments.append(_moment_of(spreads[i] @ body.second) + np.cross(body.moment, A))
    torques: list[Any] = [None] * len(bodies)
    for i in reversed(range(len(bodies))):
        body = bodies[i]
        torques[i] = body.axis @ (moments[i] if body.revolute else forces[i]) + body.armature * a[i]
        if body.parent >= 0:
            f, m = _handed_down(body, turns[i], offsets[i], forces[i], moments[i])
            forces[body.parent] = forces[body.parent] + f
            moments[body.parent] = moments[body.parent] + m
    return np.stack(torques)


def mass_matrix(bodies: Sequence[Body], q: Any) -> Any:
    """(n, n) kg m^2, armature included, by composite rigid bodies."""
    turns, offsets = _joints(bodies, q)
    composite = [(body.mass, body.moment, body.second) for body in bodies]
    n = len(bodies)
    rows: list[list[Any]] = [[0 * q[0]] * n for _ in range(n)]
    for i in reversed(range(n)):
        body, (mass, moment, second) = bodies[i], composite[i]
        if body.revolute:  # the force that unit acceleration of the joint takes
            f, m = np.cross(body.axis, moment), inertia_from(second) @ body.axis
        else:
            f, m = mass * body.axis, np.cross(moment, body.axis)
        rows[i][i] = body.axis @ (m if body.revolute else f) + body.armature
        j = i
        while bodies[j].parent >= 0:
            f, m = _handed_down(bodies[j], turns[j], offsets[j], f, m)
            j = bodies[j].parent
            rows[i][j] = rows[j][i] = bodies[j].axis @ (m if bodies[j].revolute else f)
        if body.parent >= 0:
            there = in_parent(body, turns[i], offsets[i], *composite[i])
            composite[body.parent] = tuple(x + y for x, y in zip(composite[body.parent], there, strict=True))
    return np.stack([np.stack(row) for row in rows])


def forward_dynamics(bodies: Sequence[Body], q: Any, v: Any, tau: Any, gravity: Any) -> Any:
    """(n,) accelerations under joint forces tau (n,); gravity (3,) m/s^2 in the base."""
    bias = inverse_dynamics(bodies, q, v, np.zeros(len(bodies)), gravity)
    return solve_symmetric(mass_matrix(bodies, q), tau - bias)


def in_parent(body: Body, turn: Any, offset: Any, mass: Any, moment: Any, second: Any) -> tuple[Any, Any, Any]:
    """Mass, first moment (3,) and second moments (3, 3) that ``body`` carries, from its joint frame to its parent's.

    turn : (3, 3) of the joint; offset : (3,) m, the joint frame's origin in the parent.
    """
    R = body.rotation
    return moved(mass, R @ (turn @ moment), R @ _turned(second, turn, body.axis) @ R.T, offset)


def moved(mass: Any, moment: Any, second: Any, offset: Any) -> tuple[Any, Any, Any]:
    """Mass, first moment (3,) and second moments (3, 3) of a body shifted by ``offset`` (3,) m, about where the origin stays.

    Steiner's theorem, from a point that need not be the centre of gravity.
    """
    product, mp = np.outer(offset, moment), mass * offset
    return mass, moment + mp, _symmetric(second + product + product.T + np.outer(mp, offset))


def rigidly_carried(mass: Any, cg: Any, inertia: Any, offset: Any, rotation: Any) -> tuple[Any, Any, Any]:
    """Mass, first moment (3,) and second moments (3, 3) about a joint frame, of a body given in a frame fixed there.

    cg : (3,) m; inertia : (3, 3) kg m^2 about the cg; offset (3,) m and rotation (3, 3) : that frame in the joint's.
    """
    return moved(mass, 0 * cg, rotation @ second_moments(inertia) @ rotation.T, offset + rotation @ cg)


def coriolis_matrix(bodies: Sequence[Body], q: Any, v: Any) -> Any:
    """(n, n) C with C v the velocity forces and M_dot - 2 C skew, the C of Christoffel's symbols.

    C = sum over bodies of J^T (I J_dot + B J). With J_r = [1, -r x] J for the body's point r, whose velocity is r_dot, B is the
    integral of [1, -r x]^T [0, -r_dot x] dm: made of the momentum p = m v + w x h and of P, the integral of r_dot r^T dm. Both
    add up over the bodies that a joint carries.
    """
    _, _, screws = where = place(bodies, q)
    velocities, rates = _velocities(bodies, screws, v)
    composite: list[tuple[Any, ...]] = []
    for (mass, h, S), V in zip(_in_base(bodies, where), velocities, strict=True):
        p, P = mass * V[:3] + np.cross(V[3:], h), np.outer(V[:3], h) + cross_matrix(V[3:]) @ S
        composite.append((mass, h, S, p, P))
    n = len(bodies)
    rows: list[list[Any]] = [[0 * q[0]] * n for _ in range(n)]
    for i in reversed(range(n)):
        mass, h, S, p, P = composite[i]
        I, s, s_dot, spread = inertia_from(S), screws[i], rates[i], np.trace(P) * np.eye(3) - P
        force = _times(mass, h, I, s_dot) + np.concatenate([np.cross(s[3:], p), spread @ s[3:]])  # I s_dot + B s
        momentum, turning = (
            _times(mass, h, I, s),
            np.cross(p, s[:3]) + spread.T @ s[3:],
        )  # I s, and B^T s below its zeros
        rows[i][i] = s @ force
        parent = bodies[i].parent
        for j in _supports(bodies, parent):
            rows[j][i] = screws[j] @ force
            rows[i][j] = rates[j] @ momentum + screws[j][3:] @ turning
        if parent >= 0:
            composite[parent] = tuple(x + y for x, y in zip(composite[parent], composite[i], strict=True))
    return np.stack([np.stack(row) for row in rows])


def point_pose(bodies: Sequence[Body], q: Any, last: int, offset: Any, rotation: Any) -> Any:
    """(6,) position [m] and rotation vector [rad] in the base of a frame fixed in body ``last``.

    offset : (3,) m, its origin; rotation : (3, 3), its axes; both in the body's joint frame.
    """
    where = place(bodies, q)
    R = where.rotations[last]
    return np.concatenate([where.origins[last] + R @ offset, rotation_vector(R @ rotation)])


def point_jacobian(bodies: Sequence[Body], q: Any, last: int, offset: Any) -> Any:
    """(6, n), base axes, linear rows first, of the point ``offset`` (3,) m fixed in body ``last``."""
    where = place(bodies, q)
    p = where.origins[last] + where.rotations[last] @ offset
    columns = [0 * s for s in where.screws]
    for i in _supports(bodies, last):
        v, w = where.screws[i][:3], where.screws[i][3:]
        columns[i] = np.concatenate([v + np.cross(w, p), w])
    return np.stack(columns, axis=1)


def point_jacobian_rate(bodies: Sequence[Body], q: Any, v: Any, last: int, offset: Any) -> Any:
    """(6, n) time derivative of `point_jacobian` at joint velocities v (n,): J_dot v is the point's acceleration for q'' = 0."""
    where = place(bodies, q)
    velocities, rates = _velocities(bodies, where.screws, v)
    p = where.origins[last] + where.rotations[last] @ offset
    p_dot = velocities[last][:3] + np.cross(velocities[last][3:], p)
    columns = [0 * s for s in where.screws]
    for i in _supports(bodies, last):
        w = where.screws[i][3:]
        v_dot, w_dot = rates[i][:3], rates[i][3:]
        columns[i] = np.concatenate([v_dot + np.cross(w_dot, p) + np.cross(w, p_dot), w_dot])
    return np.stack(columns, axis=1)


def _supports(bodies: Sequence[Body], i: int) -> Iterator[int]:
    """Body i and what carries it, down to the base (-1, which is none)."""
    while i >= 0:
        yield i
        i = bodies[i].parent


def _velocities(bodies: Sequence[Body], screws: Sequence[Any], v: Any) -> tuple[list[Any], list[Any]]:
    """n spatial velocities (6,) of the bodies, and n time derivatives (6,) of their joints' screws."""
    velocities: list[Any] = []
    for i, body in enumerate(bodies):
        velocities.append((np.zeros(6) if body.parent < 0 else velocities[body.parent]) + screws[i] * v[i])
    return velocities, [_cross_motion(V, screw) for V, screw in zip(velocities, screws, strict=True)]


def _joints(bodies: Sequence[Body], q: Any) -> tuple[list[Any], list[Any]]:
    """n turns (3, 3) of the joints, and n origins (3,) m of their frames in the parents."""
    turns = [_turn(body.axis, q[i]) if body.revolute else np.eye(3) for i, body in enumerate(bodies)]
    offsets = [
        body.translation if body.revolute else body.translation + body.rotation @ body.axis * q[i]
        for i, body in enumerate(bodies)
    ]
    return turns, offsets


def _handed_down(body: Body, turn: Any, offset: Any, f: Any, m: Any) -> tuple[Any, Any]:
    """Force and moment (3,) about the body's origin, in its axes, as its parent feels them about its own."""
    f, m = body.rotation @ (turn @ f), body.rotation @ (turn @ m)
    return f, m + np.cross(offset, f)


def _symmetric(A: Any) -> Any:
    """(3, 3) A by its upper half alone: traced, the lower half would be computed once more."""
    xx, xy, xz, yy, yz, zz = A[0, 0], A[0, 1], A[0, 2], A[1, 1], A[1, 2], A[2, 2]
    return np.stack([np.stack([xx, xy, xz]), np.stack([xy, yy, yz]), np.stack([xz, yz, zz])])


def _turned(second: Any, turn: Any, axis: np.ndarray) -> Any:
    """(3, 3) second moments after a turn about ``axis``: the trace stays, so that one entry is what the others leave."""
    S = turn @ second @ turn.T
    k = int(np.argmax(np.abs(axis)))
    i, j = (k + 1) % 3, (k + 2) % 3
    left = (second[i, i] + second[j, j] - S[i, i]) + (second[k, k] - S[k, k])
    rows = [[S[a, b] for b in range(3)] for a in range(3)]
    rows[j][j] = left
    return np.stack([np.stack(row) for row in rows])


def _spread(w: Any, dw: Any) -> Any:
    """(3, 3) dw x + w x w x"""
    xx, yy, zz, xy, xz, yz = w[0] * w[0], w[1] * w[1], w[2] * w[2], w[0] * w[1], w[0] * w[2], w[1] * w[2]
    return np.stack(
        [
            np.stack([-yy - zz, xy - dw[2], xz + dw[1]]),
            np.stack([xy + dw[2], -xx - zz, yz - dw[0]]),
            np.stack([xz - dw[1], yz + dw[0], -xx - yy]),
        ]
    )


def _moment_of(P: Any) -> Any:
    """(3,) moment of points that accelerate: twice the axial vector of P, the integral of a r^T dm."""
    return np.stack([P[2, 1] - P[1, 2], P[0, 2] - P[2, 0], P[1, 0] - P[0, 1]])


# In base axes, about the base origin.


def _in_base(bodies: Sequence[Body], where: Motion) -> list[tuple[Any, Any, Any]]:
    """Mass, first moment (3,) and second moments (3, 3) of each body."""
    return [
        moved(body.mass, R @ body.moment, R @ body.second @ R.T, o)
        for body, R, o in zip(bodies, where.rotations, where.origins, strict=True)
    ]


def _times(mass: Any, h: Any, I: Any, motion: Any) -> Any:
    """(6,) momentum of a body with mass, first moment (3,) and inertia (3, 3), for its motion (6,)."""
    v, w = motion[:3], motion[3:]
    return np.concatenate([mass * v + np.cross(w, h), I @ w + np.cross(h, v)])


def _cross_motion(V: Any, m: Any) -> Any:
    v, w = V[:3], V[3:]
    return np.concatenate([np.cross(w, m[:3]) + np.cross(v, m[3:]), np.cross(w, m[3:])])


def _turn(axis: np.ndarray, angle: Any) -> Any:
    """(3, 3) rotation by ``angle`` about a constant unit axis (Rodrigues)."""
    c, s = np.cos(angle), np.sin(angle)
    return c * np.eye(3) + s * cross_matrix(axis) + (1 - c) * np.outer(axis, axis)
