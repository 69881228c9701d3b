"""Rigid-body dynamics of a tree of revolute and prismatic joints, written once for floats and traced symbols.

Everything is expressed in base axes about the base origin. A spatial velocity is (v, w): the linear velocity of the body's
point at the base origin, then the angular velocity; a spatial force (f, m) likewise (Featherstone, Rigid Body Dynamics
Algorithms, 2008, with linear components first, as in Pinocchio).
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from k1607_pin.kinematics.orientation import cross_matrix, rotation_vector


class Body(NamedTuple):
    """One body and the joint that carries it; constants only. Bodies come after their parents."""

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
    """kg; this, cg and inertia may be symbols."""
    cg: Any
    """(3,) m in the joint frame."""
    inertia: Any
    """(3, 3) kg m^2 about the cg, axes of the joint frame."""
    armature: Any
    """kg m^2 (kg for a prismatic joint): reflected rotor inertia."""


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
    _, _, screws = where = place(bodies, q)
    inertias = _inertias(bodies, where)
    rest = np.concatenate([-gravity, np.zeros(3)])
    velocities: list[Any] = []
    accelerations: list[Any] = []
    forces: list[Any] = []
    for i, body in enumerate(bodies):
        V, A = (np.zeros(6), rest) if body.parent < 0 else (velocities[body.parent], accelerations[body.parent])
        joint = screws[i] * v[i]
        V = V + joint
        A = A + screws[i] * a[i] + _cross_motion(V, joint)
        velocities.append(V)
        accelerations.append(A)
        forces.append(_times(inertias[i], A) + _cross_force(V, _times(inertias[i], V)))
    torques: list[Any] = [None] * len(bodies)
    for i in reversed(range(len(bodies))):
        torques[i] = screws[i] @ forces[i] + bodies[i].armature * a[i]
        if bodies[i].parent >= 0:
            forces[bodies[i].parent] = forces[bodies[i].parent] + forces[i]
    return np.stack(torques)


def mass_matrix(bodies: Sequence[Body], q: Any) -> Any:
    """(n, n) kg m^2, armature included, by composite rigid bodies."""
    where = place(bodies, q)
    composite = _inertias(bodies, where)
    n = len(bodies)
    rows: list[list[Any]] = [[0 * q[0]] * n for _ in range(n)]
    for i in reversed(range(n)):
        force = _times(composite[i], where.screws[i])
        rows[i][i] = where.screws[i] @ force + bodies[i].armature
        parent = bodies[i].parent
        if parent >= 0:
            composite[parent] = tuple(x + y for x, y in zip(composite[parent], composite[i], strict=True))
        for j in _supports(bodies, parent):
            rows[i][j] = rows[j][i] = where.screws[j] @ force
    return np.stack([np.stack(row) for row in rows])


def coriolis_matrix(bodies: Sequence[Body], q: Any, v: Any) -> Any:
    """(n, n) C with C v the velocity forces and M_dot - 2 C skew: sum over bodies of J^T (I J_dot + B J).

    B = (V x* I - I V x + (I V) x-bar) / 2 for a body with spatial velocity V (Echeandia and Wensing, 2021).
    """
    _, _, screws = where = place(bodies, q)
    inertias = _inertias(bodies, where)
    n = len(bodies)
    total = np.zeros((n, n))
    velocities, rates = _velocities(bodies, screws, v)
    for i, V in enumerate(velocities):
        path = list(_supports(bodies, i))
        I = _matrix(inertias[i])
        X = _motion_matrix(V)
        B = (-X.T @ I - I @ X + _bar(I @ V)) / 2
        J = np.stack(
            [screws[j] if j in path else 0 * screws[j] for j in range(i + 1)] + [np.zeros(6)] * (n - i - 1), axis=1
        )
        J_dot = np.stack(
            [rates[j] if j in path else 0 * rates[j] for j in range(i + 1)] + [np.zeros(6)] * (n - i - 1), axis=1
        )
        total = total + J.T @ (I @ J_dot + B @ J)
    return total


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


# Spatial algebra. An inertia is (mass, first moment (3,), rotational inertia (3, 3) about the base origin).


def _inertias(bodies: Sequence[Body], where: Motion) -> list[tuple[Any, Any, Any]]:
    inertias = []
    for body, R, o in zip(bodies, where.rotations, where.origins, strict=True):
        c = o + R @ body.cg
        about_cg = R @ body.inertia @ R.T
        inertias.append((body.mass, body.mass * c, about_cg + body.mass * ((c @ c) * np.eye(3) - np.outer(c, c))))
    return inertias


def _times(inertia: tuple[Any, Any, Any], motion: Any) -> Any:
    mass, h, I = inertia
    v, w = motion[:3], motion[3:]
    return np.concatenate([mass * v + np.cross(w, h), I @ w + np.cross(h, v)])


def _cross_motion(V: Any, m: Any) -> Any:
    v, w = V[:3], V[3:]
    return np.concatenate([np.cross(w, m[:3]) + np.cross(v, m[3:]), np.cross(w, m[3:])])


def _cross_force(V: Any, f: Any) -> Any:
    v, w = V[:3], V[3:]
    return np.concatenate([np.cross(w, f[:3]), np.cross(w, f[3:]) + np.cross(v, f[:3])])


def _blocks(a: Any, b: Any, c: Any, d: Any) -> Any:
    return np.concatenate([np.concatenate([a, b], axis=1), np.concatenate([c, d], axis=1)], axis=0)


def _matrix(inertia: tuple[Any, Any, Any]) -> Any:
    mass, h, I = inertia
    return _blocks(mass * np.eye(3), -cross_matrix(h), cross_matrix(h), I)


def _motion_matrix(V: Any) -> Any:
    """V x as a matrix; V x* is minus its transpose."""
    return _blocks(cross_matrix(V[3:]), cross_matrix(V[:3]), np.zeros((3, 3)), cross_matrix(V[3:]))


def _bar(f: Any) -> Any:
    """The matrix that takes a motion m to m x* f."""
    return _blocks(np.zeros((3, 3)), -cross_matrix(f[:3]), -cross_matrix(f[:3]), -cross_matrix(f[3:]))


def _turn(axis: np.ndarray, angle: Any) -> Any:
    """(3, 3) rotation by ``angle`` about a constant unit axis (Rodrigues)."""
    c, s = np.cos(angle), np.sin(angle)
    return c * np.eye(3) + s * cross_matrix(axis) + (1 - c) * np.outer(axis, axis)
