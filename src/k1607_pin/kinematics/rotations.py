"""Orientation: rotation matrices, quaternions (eta, beta, gamma, xi) with the scalar first, and small rotations, (24)-(38).

All functions take single values or batches, (..., 3, 3) and (..., 4), and can be traced. They trust their callers;
`k1607_pin.kinematics.orientation` has the same ones with a look at their arguments.
"""

from typing import Any

import numpy as np

from k1607_pin.description.dh import matrix
from k1607_pin.kinematics.vectors import components, cross, dot, entries, vector


def quaternion_by_division(R: Any) -> Any:
    """(..., 4) quaternion of R (..., 3, 3) as the report has it, (26): divides by eta and fails at a half turn.

    Kept for the check of the equation; `quaternion` is sound at every angle.
    """
    r = entries(R)
    eta = np.sqrt(1 + r[0][0] + r[1][1] + r[2][2]) / 2
    return vector(
        [eta, (r[2][1] - r[1][2]) / (4 * eta), (r[0][2] - r[2][0]) / (4 * eta), (r[1][0] - r[0][1]) / (4 * eta)]
    )


def quaternion(R: Any) -> Any:
    """(..., 4) unit quaternion of the rotation R (..., 3, 3), eta >= 0, accurate at every angle, half turns included.

    The four rows below are 4 eta, 4 beta, 4 gamma, 4 xi times the quaternion; the one with the largest multiplier is used
    (Shepperd, J. Guidance and Control 1(3), 1978), so that nothing is divided by a small number.
    """
    r = entries(R)
    x, y, z = r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]
    xy, xz, yz = r[0][1] + r[1][0], r[0][2] + r[2][0], r[1][2] + r[2][1]
    rows = [
        [1 + r[0][0] + r[1][1] + r[2][2], x, y, z],
        [x, 1 + r[0][0] - r[1][1] - r[2][2], xy, xz],
        [y, xy, 1 - r[0][0] + r[1][1] - r[2][2], yz],
        [z, xz, yz, 1 - r[0][0] - r[1][1] + r[2][2]],
    ]
    best, size = rows[0], rows[0][0]
    for k in (1, 2, 3):
        larger = rows[k][k] > size
        best = [np.where(larger, new, old) for new, old in zip(rows[k], best, strict=True)]
        size = np.where(larger, rows[k][k], size)
    norm = np.sqrt(best[0] * best[0] + best[1] * best[1] + best[2] * best[2] + best[3] * best[3])
    scale = np.where(best[0] < 0, -1 / norm, 1 / norm)
    return vector([scale * x for x in best])


def rotation(quaternion: Any) -> Any:
    """(..., 3, 3) of a unit quaternion (..., 4): (28) with the identity of size 3 and the sign that agrees with (26).

    R = (eta^2 - s.s) I + 2 s s^T + 2 eta s^x
    """
    eta, *s = components(quaternion)
    diagonal = eta * eta - dot(s, s)
    X = _cross_rows(s)
    return matrix(
        [[(diagonal if i == j else 0) + 2 * s[i] * s[j] + 2 * eta * X[i][j] for j in range(3)] for i in range(3)]
    )


def cross_matrix(s: Any) -> Any:
    """(..., 3, 3) with s^x v = s x v, (29)."""
    return matrix(_cross_rows(components(s)))


def conjugate(quaternion: Any) -> Any:
    """(..., 4) quaternion of the inverse rotation."""
    eta, *s = components(quaternion)
    return vector([eta, *(-x for x in s)])


def product(first: Any, second: Any) -> Any:
    """(..., 4) quaternion of R_first R_second (Hamilton product)."""
    a, *s = components(first)
    b, *t = components(second)
    c = cross(s, t)
    return vector([a * b - dot(s, t), *(a * t[i] + b * s[i] + c[i] for i in range(3))])


def relative_quaternion_base(first: Any, second: Any) -> Any:
    """(..., 4) quaternion of the rotation about base axes, R_second R_first^T, that takes the first frame to the second.

    (33)-(34) as printed: with the quaternion of (26) they belong to this rotation, the overlined one of (31)-(32).
    """
    return product(second, conjugate(first))


def relative_quaternion_body(first: Any, second: Any) -> Any:
    """(..., 4) quaternion of the second frame in the first, R_first^T R_second: (34) with the sign of its last term turned."""
    return product(conjugate(first), second)


def rotation_vector(R: Any) -> Any:
    """(..., 3) rad: axis times angle of R (..., 3, 3), in the axes R is given in, angle in [0, pi]: the exact logarithm."""
    eta, *s = components(quaternion(R))
    sine = np.sqrt(dot(s, s))  # of half the angle
    small = sine < 1e-12
    scale = np.where(small, 2.0, 2 * np.arctan2(sine, eta) / np.where(small, 1.0, sine))
    return vector([scale * x for x in s])


def differential_rotation(R: Any) -> Any:
    """(..., 3) rad: delta_x, delta_y, delta_z of a small rotation R (..., 3, 3), read off as in (35)-(36), mended."""
    r = entries(R)
    return vector([(r[2][1] - r[1][2]) / 2, (r[0][2] - r[2][0]) / 2, (r[1][0] - r[0][1]) / 2])


def orientation_error(R_desired: Any, R: Any) -> Any:
    """(..., 3) rad: 2 delta s of R_desired R^T, base axes, sign such that eta >= 0: the rotation vector form of (37).

    Equals the rotation vector to third order in the angle and keeps its direction at every angle, a half turn included,
    where its length is 2.
    """
    _, *s = components(quaternion(R_desired @ np.swapaxes(R, -1, -2)))
    return vector([2 * x for x in s])


def _cross_rows(s: list[Any]) -> list[list[Any]]:
    zero = 0 * s[0]
    return [[zero, -s[2], s[1]], [s[2], zero, -s[0]], [-s[1], s[0], zero]]
