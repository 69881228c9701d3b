"""The K-1607's kinematics in closed form: the report's (4)-(11) and (18)-(19), restored.

The transcription lost the g's and h's, two signs and an index. They are restored here from what each of them is: with
x_i, y_i, z_i the axes of frame i in frame 0,

    x3 = (f2, f4, -s2 c3)    x4 = (g1, g3, f5)    x5 = (h2, h4, g6)    x6 = (j1, j2, h5)    x7 = n
    y3 = (f1, f3,  s2 s3)    z5 = (g2, g4, f6)    z6 = (h1, h3, g5)    z7 = a

`k1607 equations` proves each as a polynomial identity in the cosines and sines.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from k1607_pin.description.dh import matrix, table_1
from k1607_pin.kinematics.product import cosines_and_sines, joint_angles


class Parameters(NamedTuple):
    """The entries of Table 1 that are not zero, m."""

    a2: Any
    a3: Any
    a4: Any
    a5: Any
    a6: Any
    d3: Any
    d5: Any


class Terms(NamedTuple):
    """Every named quantity of (5)-(11); each a tuple in the report's order."""

    n: tuple[Any, Any, Any]
    """x axis of frame 7."""
    s: tuple[Any, Any, Any]
    """y axis of frame 7."""
    a: tuple[Any, Any, Any]
    """z axis of frame 7."""
    p: tuple[Any, Any, Any]
    """Origin of frame 7, m."""
    f: tuple[Any, ...]
    """f1..f6"""
    g: tuple[Any, ...]
    """g1..g6"""
    h: tuple[Any, ...]
    """h1..h5"""
    j: tuple[Any, ...]
    """j1..j3; j3 in m."""


@cache
def parameters() -> Parameters:
    """Table 1's parameters in metres."""
    table = table_1()
    return Parameters(*(float(x) for x in (*table.a[2:7], table.d[2], table.d[4])))


def terms(c: Any, s: Any, parameters: Parameters) -> Terms:
    """Equations (5)-(11) from the cosines and sines of the seven joint angles, (...) each."""
    c1, c2, c3, c4, c5, c6, c7 = c
    s1, s2, s3, s4, s5, s6, s7 = s
    a2, a3, a4, a5, a6, d3, d5 = parameters

    c1c2, s1c2, c1s2, s1s2, s2s3, s2c3 = c1 * c2, s1 * c2, c1 * s2, s1 * s2, s2 * s3, s2 * c3

    f1 = -c1c2 * s3 - s1 * c3  # (8)
    f2 = c1c2 * c3 - s1 * s3
    f3 = c1 * c3 - s1c2 * s3
    f4 = s1c2 * c3 + c1 * s3
    f5 = -s2c3 * c4 - c2 * s4
    f6 = c2 * c4 - s2c3 * s4

    g1 = c4 * f2 - c1s2 * s4  # (9)
    g2 = s4 * f2 + c1s2 * c4
    g3 = c4 * f4 - s1s2 * s4
    g4 = s4 * f4 + s1s2 * c4
    g5 = c5 * s2s3 - s5 * f5
    g6 = s5 * s2s3 + c5 * f5

    h1 = c5 * f1 - s5 * g1  # (10)
    h2 = s5 * f1 + c5 * g1
    h3 = c5 * f3 - s5 * g3
    h4 = s5 * f3 + c5 * g3
    h5 = c6 * g6 - s6 * f6

    j1 = c6 * h2 - s6 * g2  # (11)
    j2 = c6 * h4 - s6 * g4
    j3 = d3 * s2 + a2 * c2

    n = (s7 * h1 + c7 * j1, s7 * h3 + c7 * j2, s7 * g5 + c7 * h5)  # (5), (6), (7)
    o = (c7 * h1 - s7 * j1, c7 * h3 - s7 * j2, c7 * g5 - s7 * h5)
    a = (s6 * h2 + c6 * g2, s6 * h4 + c6 * g4, s6 * g6 + c6 * f6)
    p = (
        a6 * j1 + a5 * h2 + d5 * g2 + a4 * g1 + a3 * f2 + c1 * j3,
        a6 * j2 + a5 * h4 + d5 * g4 + a4 * g3 + a3 * f4 + s1 * j3,
        a6 * h5 + a5 * g6 + d5 * f6 + a4 * f5 - a3 * s2c3 - a2 * s2 + d3 * c2,
    )
    return Terms(n, o, a, p, (f1, f2, f3, f4, f5, f6), (g1, g2, g3, g4, g5, g6), (h1, h2, h3, h4, h5), (j1, j2, j3))


def transform(t: Terms, out: np.ndarray | None = None) -> Any:
    """(..., 4, 4), eq. (4); written to ``out`` where given."""
    return matrix([*([t.n[i], t.s[i], t.a[i], t.p[i]] for i in range(3)), [0, 0, 0, 1]], out)


def jacobian_columns(c: Any, s: Any, t: Terms, parameters: Parameters) -> list[list[Any]]:
    """The seven columns of J, six entries (...) each: (18)-(19), and the four that the report left out.

    With p7 - p4 = a4 x4 + d5 z5 + a5 x5 + a6 x6 and so on, the cross products of (13) collapse onto single axes.
    """
    c1, c2, _, _, c5, c6, _ = c
    s1, s2, s3, _, _, s6, _ = s
    a2, _, a4, a5, a6, d3, d5 = parameters
    px, py, pz = t.p
    zero = 0 * px
    x4, z5, z6 = (t.g[0], t.g[2], t.f[4]), (t.g[1], t.g[3], t.f[5]), (t.h[0], t.h[2], t.g[4])

    rx, ry, rz = px - a2 * c1 * c2 - d3 * c1 * s2, py - a2 * s1 * c2 - d3 * s1 * s2, pz + a2 * s2 - d3 * c2
    across, along = d5 - a6 * s6, a4 + (a5 + a6 * c6) * c5
    wrist = a5 + a6 * c6
    return [
        [-py, px, zero, zero, zero, zero + 1],
        [c1 * pz, s1 * pz, -s1 * py - c1 * px, -s1, c1, zero],
        [
            s1 * s2 * rz - c2 * ry,
            -c1 * s2 * rz + c2 * rx,
            c1 * s2 * ry - s1 * s2 * rx,
            c1 * s2,
            s1 * s2,
            c2 + zero,
        ],
        [*(across * x - along * z for x, z in zip(x4, z5, strict=True)), t.f[0], t.f[2], s2 * s3],
        [*(wrist * z for z in z6), *z5],
        [*(-a6 * z for z in t.a), *z6],
        [zero, zero, zero, *t.a],
    ]


def forward_kinematics(q: Any) -> Any:
    """Frame 7 in frame 0, (..., 4, 4) m, for joint angles q (..., 7) rad: (4)-(11).

    A batch of poses costs a few array operations, not a call a pose.

    Raises
    ------
    ValueError
        q is not of shape (..., 7), or not finite.
    """
    return _batched(lambda c, s, out: transform(terms(c, s, parameters()), out), q, (4, 4))


def jacobian(q: Any) -> Any:
    """Jacobian of frame 7, (..., 6, 7), linear rows [m] first, axes of frame 0, for q (..., 7) rad: (12) with (18)-(19).

    Raises
    ------
    ValueError
        q is not of shape (..., 7), or not finite.
    """

    def columns(c: Any, s: Any, out: np.ndarray | None) -> Any:
        rows = zip(*jacobian_columns(c, s, terms(c, s, parameters()), parameters()), strict=True)
        return matrix([list(row) for row in rows], out)

    return _batched(columns, q, (6, 7))


CHUNK = 5000  # poses: many enough to forget the cost of a call, few enough for a core's cache


def _batched(fun: Callable[[Any, Any, np.ndarray | None], Any], q: Any, shape: tuple[int, int]) -> Any:
    """``fun`` of the cosines and sines of q, a chunk of the batch at a time, each written where it belongs."""
    q = joint_angles(q, 7)
    if not isinstance(q, np.ndarray) or q.size <= 7 * CHUNK:
        return fun(*cosines_and_sines(q), None)
    flat = q.reshape(-1, 7)
    out = np.empty((len(flat), *shape))
    for k in range(0, len(flat), CHUNK):
        fun(*cosines_and_sines(flat[k : k + CHUNK]), out[k : k + CHUNK])
    return out.reshape(*q.shape[:-1], *shape)
