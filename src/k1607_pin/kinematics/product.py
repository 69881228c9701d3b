"""Forward kinematics as the product of link transforms, eqs (1)-(3), and the Jacobian by cross products, (12)-(17)."""

from typing import Any, Protocol

import numpy as np

from k1607_pin.arguments import as_floats, is_symbolic, shown
from k1607_pin.description.dh import DHTable, link_transform
from k1607_pin.kinematics.vectors import components, cross, entries, vector


class Links(Protocol):
    """What eq. (2) needs of a D-H table: numbers (`DHTable`) or symbols, n of each."""

    @property
    def cos_alpha(self) -> Any: ...
    @property
    def sin_alpha(self) -> Any: ...
    @property
    def a(self) -> Any: ...
    @property
    def d(self) -> Any: ...


def joint_angles(q: Any, n: int) -> Any:
    """q as (..., n) finite floats; symbols as they are."""
    if is_symbolic(q):
        return np.stack(q) if isinstance(q, list | tuple) else q
    q = as_floats("q", q, f"joint angles in rad of shape (..., {n})")
    if not q.ndim or q.shape[-1] != n:
        raise ValueError(f"q: expected joint angles in rad of shape (..., {n}), got shape {q.shape}")
    with np.errstate(over="ignore"):
        total = q.sum()  # one pass: NaN and infinity survive a sum
    if not np.isfinite(total) and not np.isfinite(q).all():
        raise ValueError("q: expected finite joint angles in rad, got NaN or infinity")
    return q


def cosines_and_sines(q: Any) -> tuple[list[Any], list[Any]]:
    """n cosines and n sines, (...) each, of joint angles q (..., n) rad."""
    if isinstance(q, np.ndarray) and q.ndim > 1 and q.dtype == float:
        # A batch: with t = tan(angle/2) and r = 2 / (1 + t^2), cos = r - 1 and sin = t r, to 2e-16. NumPy has vector code for
        # the tangent and none for sine and cosine, which makes this several times faster. Written in place: memory decides.
        t = np.multiply(np.moveaxis(q, -1, 0), 0.5, out=np.empty((q.shape[-1], *q.shape[:-1])))
        np.tan(t, out=t)
        r = t * t
        r += 1
        np.divide(2, r, out=r)
        t *= r
        r -= 1
        return list(r), list(t)
    angles = components(q)
    return [np.cos(x) for x in angles], [np.sin(x) for x in angles]


def frame_transforms(links: Links, c: Any, s: Any) -> list[Any]:
    """Frames 1..n in frame 0, n times (..., 4, 4), from cosines and sines of the joint angles: the partial products of (3)."""
    frames: list[Any] = []
    for i in range(len(links.a)):
        T = link_transform(c[i], s[i], links.cos_alpha[i], links.sin_alpha[i], links.a[i], links.d[i])
        frames.append(frames[-1] @ T if frames else T)
    return frames


def forward_kinematics(table: DHTable, q: Any) -> Any:
    """Frame n in frame 0, (..., 4, 4) m, for joint angles q (..., n) rad: eq. (3)."""
    return frame_transforms(table, *_of_table(table, q))[-1]


def jacobian(table: DHTable, q: Any) -> Any:
    """(..., 6, n) of frame n, linear rows first, axes of frame 0, for joint angles q (..., n) rad: eq. (12)."""
    return geometric_jacobian(frame_transforms(table, *_of_table(table, q)))


def _of_table(table: DHTable, q: Any) -> tuple[list[Any], list[Any]]:
    if not isinstance(table, DHTable):
        raise ValueError(f"table: expected a DHTable, got {shown(table)}")
    return cosines_and_sines(joint_angles(q, len(table.a)) + table.theta_offset)


def geometric_jacobian(frames: list[Any]) -> Any:
    """(..., 6, n) from the joint frames in frame 0, n times (..., 4, 4): the vector cross product method, (12)-(17).

    b_i is the third column of the ith frame's rotation, (14)-(15); p_i points from its origin to the last one's, (16)-(17).
    """
    columns = []
    for T in frames:
        b, p = axis_and_lever(T, frames[-1])
        columns.append(vector(cross(b, p) + b))  # (13)
    return np.stack(columns, axis=-1)


def axis_and_lever(joint: Any, end: Any) -> tuple[list[Any], list[Any]]:
    """b_i and p_i of (14) and (16), three entries each, from the frames of joint i and of the end-effector in frame 0."""
    T, end = entries(joint), entries(end)
    return [T[i][2] for i in range(3)], [end[i][3] - T[i][3] for i in range(3)]
