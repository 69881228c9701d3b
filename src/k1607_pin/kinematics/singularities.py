"""Every singular configuration of the K-1607: where rank J < 6, in closed form.

Wrenches (f; m) about the origin of frame {4}, in its axes, that do no work on any joint are the directions the end-effector
loses. Axes 3, 4 and 5 leave, for theta4 != 0, the three-parameter family (fx, fy, k h; a4 k g, a4 k h, 0) with
g = sin(theta4/2), h = cos(theta4/2); at theta4 = 0, where axes 3 and 5 are one line, (fx, fy, fz; mx, a4 fz, 0). Against it
stand the other four screws, rows of `_rows` (4, 3) and `_rows_straight` (4, 4). J is singular exactly when

    theta4 = theta6 = 0                                  elbow and wrist straight
    theta4 = 0 and det(rows_straight) = 0                elbow straight
    theta6 = 0 and det(rows of screws 1, 2, 6) = 0       wrist straight (axes 5 and 7 are one line: screw 7 adds nothing)
    rank(rows) <= 2                                      general: no two axes coincide

Joints 1 and 7 never matter. All four have codimension 2: no single angle makes this arm singular. `docs/singularities.md`
has the derivation.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from k1607_pin.arguments import numbers
from k1607_pin.kinematics.closed_form import parameters


class Family(NamedTuple):
    """One set of singular configurations."""

    name: str
    condition: str
    """On the joint angles."""
    dimension: int
    """Free angles among theta2..theta6."""
    rank: int
    """Of J, at almost every member."""
    lost: str
    """What the end-effector cannot do or resist, or what moves without moving it."""
    member: Callable[[np.random.Generator], np.ndarray]
    """A random member, (7,) rad."""


def residuals(q: np.ndarray) -> dict[str, np.ndarray]:
    """For each of the four complete families, conditions that are all zero exactly on it; q (7,) rad."""
    q = numbers("q", q, (7,), "rad")
    rows = _rows(q)
    elbow, wrist = np.sin(q[3] / 2), np.sin(q[5] / 2)
    return {
        "straight": np.array([elbow, wrist]),
        "elbow": np.array([elbow, np.linalg.det(_rows_straight(q))]),
        "wrist": np.array([wrist, np.linalg.det(rows[:3])]),
        "general": np.array([np.linalg.det(np.delete(rows, i, 0)) for i in range(4)]),
    }


def _rows(q: np.ndarray) -> np.ndarray:
    """(4, 3): screws 1 - c2 screw 3, 2, 6 and (7 - 5) / (2 sin(theta6/2)) against (fx, fy, k)."""
    a2, B, _, C, _, L, _ = parameters()
    (_, c2, c3, c4, c5, *_), (_, s2, s3, s4, s5, *_) = np.cos(q), np.sin(q)
    g, h, g6, h6 = np.sin(q[3] / 2), np.cos(q[3] / 2), np.sin(q[5] / 2), np.cos(q[5] / 2)
    N, U, K = a2 * c2 + L * s2, C * g6 + L * h6, L * h + B * g
    return np.array(
        [
            [c4 * s3 * N + B * s2 * s3 * s4, -s4 * s3 * N + B * c4 * s2 * s3, c3 * (N * h + B * s2 * g)],
            [(a2 + B * c3) * s4 + L * c3 * c4, (a2 + B * c3) * c4 - L * c3 * s4, -s3 * K],
            [-L * c5, B * c5 - C, -s5 * K],
            [-s5 * U, B * s5 * h6, c5 * (h * U + B * g * h6)],
        ]
    )


def _rows_straight(q: np.ndarray) -> np.ndarray:
    """(4, 4): the same screws at theta4 = 0 against (fx, fy, fz, mx)."""
    a2, B, _, C, _, L, _ = parameters()
    (_, c2, c3, _, c5, *_), (_, s2, s3, _, s5, *_) = np.cos(q), np.sin(q)
    g6, h6 = np.sin(q[5] / 2), np.cos(q[5] / 2)
    N, U = a2 * c2 + L * s2, C * g6 + L * h6
    return np.array(
        [
            [s3 * N, B * s2 * s3, c3 * N, -c3 * s2],
            [L * c3, a2 + B * c3, -L * s3, s3],
            [-L * c5, B * c5 - C, -L * s5, -s5],
            [-s5 * U, B * s5 * h6, c5 * U, c5 * h6],
        ]
    )


def _anywhere(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-np.pi, np.pi, 7)


def _straight(rng: np.random.Generator) -> np.ndarray:
    q = _anywhere(rng)
    q[3] = q[5] = 0
    return q


def _elbow(rng: np.random.Generator) -> np.ndarray:
    """theta3, 5, 6 free: the first row is (a2 c2 + L s2) u + s2 v, so W = ker of the others gives tan theta2."""
    a2, B, *_, L, _ = parameters()
    q = _anywhere(rng)
    q[3] = 0
    W = np.linalg.svd(_rows_straight(q)[1:])[2][-1]
    s3, c3 = np.sin(q[2]), np.cos(q[2])
    u, v = np.array([s3, 0, c3, 0]), np.array([0, B * s3, 0, -c3])
    q[1] = np.arctan2(-a2 * u @ W, L * u @ W + v @ W)
    return q


def _wrist(rng: np.random.Generator) -> np.ndarray:
    """theta3, 4, 5 free; theta2 as for the elbow."""
    a2, B, *_, L, _ = parameters()
    q = _anywhere(rng)
    q[5] = 0
    rows = _rows(q)
    W = np.cross(rows[1], rows[2])
    s3, c3, s4, c4, g, h = np.sin(q[2]), np.cos(q[2]), np.sin(q[3]), np.cos(q[3]), np.sin(q[3] / 2), np.cos(q[3] / 2)
    u, v = np.array([c4 * s3, -s4 * s3, c3 * h]), B * np.array([s3 * s4, c4 * s3, c3 * g])
    q[1] = np.arctan2(-a2 * u @ W, L * u @ W + v @ W)
    return q


def _general(rng: np.random.Generator) -> np.ndarray:
    """theta2, 3, 4 free: W is orthogonal to the first two rows, the third gives theta5 and the fourth theta6."""
    _, B, _, C, _, L, _ = parameters()
    while True:
        q = _anywhere(rng)
        rows = _rows(q)
        fx, fy, k = W = np.cross(rows[0], rows[1])
        g, h = np.sin(q[3] / 2), np.cos(q[3] / 2)
        P, R, S = B * fy - L * fx, -(L * h + B * g) * k, C * fy  # P c5 + R s5 = S
        if abs(S) > np.hypot(P, R) or not W.any():
            continue
        q[4] = np.arctan2(R, P) + rng.choice([-1, 1]) * np.arccos(S / np.hypot(P, R))
        s5, c5 = np.sin(q[4]), np.cos(q[4])
        above, below = B * (s5 * fy + c5 * g * k), s5 * fx - c5 * h * k  # L + C tan(theta6/2) = above / below
        q[5] = 2 * np.arctan2(above - L * below, C * below)
        return q


def _reach(rng: np.random.Generator) -> np.ndarray:
    a2, B, _, C, _, L, _ = parameters()
    q = _anywhere(rng)
    third, fifth = rng.choice([1, -1], 2)
    q[2], q[4] = (0 if third > 0 else np.pi), (0 if fifth > 0 else np.pi)
    q[3] = np.arctan2(third * a2 + B, L) + np.arctan2(B - fifth * C, L)
    return q


FAMILIES = (
    Family(
        "straight", "theta4 = 0 and theta6 = 0", 3, 5,
        "axes 3, 5 and 7 are one line; joints 3, 5, 7 spin against each other with the tool at rest", _straight,
    ),
    Family(
        "elbow", "theta4 = 0 and det(rows_straight) = 0: one theta2 mod 180 deg for each theta3, theta5, theta6", 3, 5,
        "axes 3 and 5 are one line, and the other axes share a reciprocal screw with it", _elbow,
    ),
    Family(
        "wrist", "theta6 = 0 and det(rows 1, 2, 6) = 0: one theta2 mod 180 deg for each theta3, theta4, theta5", 3, 5,
        "axes 5 and 7 are one line, and joints 1 to 6 are singular as a six-joint arm", _wrist,
    ),
    Family(
        "general", "rank(rows) <= 2: two theta5, theta6 for (almost) each theta2, theta3, theta4", 3, 5,
        "no two axes coincide; one screw is reciprocal to all seven", _general,
    ),
    Family(
        "reach (within general)",
        "theta3, theta5 in {0, 180 deg} and theta4 = atan((a3 ± a2) / d5) + atan((a3 ∓ a5) / d5), upper signs for 0: "
        "22.475 (0, 0), 35.367 (0, 180), 12.362 (180, 180) or -0.529 deg (180, 0)", 2, 5,
        "stretched: the middles of shoulder, elbow and wrist in line; the tool cannot move along that line", _reach,
    ),
)  # fmt: skip
"""The complete families, and one that has a name."""
