"""Equations (1)-(11): forward kinematics."""

import numpy as np
import pinocchio as pin

from k1607_pin.description import dh
from k1607_pin.description.dh import table_1
from k1607_pin.kinematics import closed_form, product
from k1607_pin.report.equations import Equation
from k1607_pin.report.polynomials import exact, is_identity
from k1607_pin.report.sample import PINOCCHIO, ROUNDING, axis, cs, frames, gap, poses, terms


def _row(row: int) -> float:
    """(5), (6), (7): n, s, a, p of one row against Pinocchio's frame {7}."""
    t = terms()
    return gap([t.n[row], t.s[row], t.a[row], t.p[row]], frames()[6][:, row, :].T)


def _row_is_exact(row: int) -> bool:
    t = exact().terms
    return is_identity([t.n[row], t.s[row], t.a[row], t.p[row]], exact().frames[6][row])


def _px_as_printed() -> float:
    (c1, _, _, c4, *_), (_, s2, _, s4, *_) = cs()
    t, p = terms(), closed_form.parameters()
    px = (
        p.a6 * t.j[0]
        + p.a5 * t.h[1]
        + p.d5 * (s4 * t.f[0] + c1 * s2 * c4)
        + p.a4 * t.g[0]
        + p.a3 * t.f[1]
        + c1 * t.j[2]
    )
    return gap(px, frames()[6][:, 0, 3])


def _f() -> float:
    f = terms().f
    y3, x3, x4, z5 = axis(3, 1), axis(3, 0), axis(4, 0), axis(5, 2)
    return gap(f, [y3[0], x3[0], y3[1], x3[1], x4[2], z5[2]])


def _f_is_exact() -> bool:
    f, (_, _, T3, T4, T5, *_) = exact().terms.f, exact().frames
    return is_identity(f, [T3[0, 1], T3[0, 0], T3[1, 1], T3[1, 0], T4[2, 0], T5[2, 2]])


def _f_as_printed() -> float:
    (c1, c2, c3, c4, *_), (s1, _, s3, s4, *_) = cs()
    return max(gap(-s1 * c2 * s3 - c1 * c3, axis(3, 1)[1]), gap(-s1 * c3 * s4 + c2 * c4, axis(5, 2)[2]))


def _g() -> float:
    x4, z5, z6, x5 = axis(4, 0), axis(5, 2), axis(6, 2), axis(5, 0)
    return gap(terms().g, [x4[0], z5[0], x4[1], z5[1], z6[2], x5[2]])


def _g_is_exact() -> bool:
    g, (*_, T4, T5, T6, _) = exact().terms.g, exact().frames
    return is_identity(g, [T4[0, 0], T5[0, 2], T4[1, 0], T5[1, 2], T6[2, 2], T5[2, 0]])


def _h() -> float:
    z6, x5, x6 = axis(6, 2), axis(5, 0), axis(6, 0)
    return gap(terms().h, [z6[0], x5[0], z6[1], x5[1], x6[2]])


def _h_is_exact() -> bool:
    h, (*_, T5, T6, _) = exact().terms.h, exact().frames
    return is_identity(h, [T6[0, 2], T5[0, 0], T6[1, 2], T5[1, 0], T6[2, 0]])


def _j() -> float:
    x6, o3 = axis(6, 0), axis(3, 3)
    (c1, *_), (s1, *_) = cs()
    j = terms().j
    return gap([j[0], j[1], c1 * j[2], s1 * j[2]], [x6[0], x6[1], o3[0], o3[1]])


def _j_is_exact() -> bool:
    e = exact()
    T3, T6, j = e.frames[2], e.frames[5], e.terms.j
    return is_identity([j[0], j[1], e.c[0] * j[2], e.s[0] * j[2]], [T6[0, 0], T6[1, 0], T3[0, 3], T3[1, 3]])


def _link_by_screws() -> float:
    """(2) against the convention it stands for: turn about x by alpha, go a along x, turn about z by theta, go d along z."""
    table, worst = table_1(), 0.0
    for q in poses()[:100]:
        for i in range(7):
            along_x = pin.exp6(pin.Motion(np.array([table.a[i], 0, 0]), np.array([table.alpha[i], 0, 0])))
            along_z = pin.exp6(pin.Motion(np.array([0, 0, table.d[i]]), np.array([0, 0, q[i]])))
            T = dh.link_transform(
                np.cos(q[i]), np.sin(q[i]), table.cos_alpha[i], table.sin_alpha[i], table.a[i], table.d[i]
            )
            worst = max(worst, gap(T, (along_x * along_z).homogeneous))
    return worst


def _rigid(T: np.ndarray) -> float:
    """How far homogeneous matrices (..., 4, 4) are from rigid transforms."""
    R = T[..., :3, :3]
    return max(gap(R @ np.swapaxes(R, -1, -2), np.eye(3)), gap(np.linalg.det(R), 1), gap(T[..., 3, :], [0, 0, 0, 1]))


INFERRED = "The numbers (5)-(10) are lost; inferred from '(5)-(11)' and the grouping of the formulas."

EQUATIONS: list[Equation] = [
    Equation(
        1,
        "A link transform is a rotation and a position, with (0, 0, 0, 1) below.",
        "description.dh.link_transform",
        "rotation orthonormal, last row, all seven links",
        lambda: _rigid(table_1().placements()),
        1e-15,
        definition=True,
        note="The partition is garbled in the transcription.",
    ),
    Equation(
        2,
        "The link transform in terms of alpha, a, d and theta.",
        "description.dh.link_transform",
        "screws along x and z by the exponential map",
        _link_by_screws,
        1e-14,
    ),
    Equation(
        3,
        "Frame 7 in frame 0 is the product of the seven link transforms.",
        "kinematics.product.forward_kinematics",
        PINOCCHIO,
        lambda: gap(product.forward_kinematics(table_1(), poses()), frames()[6]),
        ROUNDING,
    ),
    Equation(
        4,
        "Its columns are named n, s, a and p.",
        "kinematics.closed_form.transform",
        f"axes and origin of frame {{7}}, {PINOCCHIO}",
        lambda: gap(closed_form.forward_kinematics(poses()), frames()[6]),
        ROUNDING,
        definition=True,
    ),
    Equation(
        5,
        "First row: n_x, s_x, a_x, p_x.",
        "kinematics.closed_form.terms",
        PINOCCHIO,
        lambda: _row(0),
        ROUNDING,
        printed=_px_as_printed,
        proof=lambda: _row_is_exact(0),
        note="p_x: printed d5 (s4 f1 + c1 s2 c4), should be d5 (s4 f2 + c1 s2 c4) = d5 g2. " + INFERRED,
    ),
    Equation(
        6,
        "Second row: n_y, s_y, a_y, p_y.",
        "kinematics.closed_form.terms",
        PINOCCHIO,
        lambda: _row(1),
        ROUNDING,
        proof=lambda: _row_is_exact(1),
    ),
    Equation(
        7,
        "Third row: n_z, s_z, a_z, p_z.",
        "kinematics.closed_form.terms",
        PINOCCHIO,
        lambda: _row(2),
        ROUNDING,
        proof=lambda: _row_is_exact(2),
    ),
    Equation(
        8,
        "f1..f6: entries of the axes x3, y3, x4, z5.",
        "kinematics.closed_form.terms",
        PINOCCHIO,
        _f,
        ROUNDING,
        printed=_f_as_printed,
        proof=_f_is_exact,
        note="f3: printed -s1 c2 s3 - c1 c3, should be ... + c1 c3. f6: printed -s1 c3 s4 + c2 c4, should be -s2 c3 s4 + ...",
    ),
    Equation(
        9,
        "g1..g6: entries of the axes x4, z5, z6, x5.",
        "kinematics.closed_form.terms",
        PINOCCHIO,
        _g,
        ROUNDING,
        lost=True,
        proof=_g_is_exact,
        note="Not in the transcription; restored from the way (5)-(7) use them.",
    ),
    Equation(
        10,
        "h1..h5: entries of the axes z6, x5, x6.",
        "kinematics.closed_form.terms",
        PINOCCHIO,
        _h,
        ROUNDING,
        lost=True,
        proof=_h_is_exact,
        note="Not in the transcription; restored from the way (5)-(7) and (11) use them.",
    ),
    Equation(
        11,
        "j1, j2: entries of x6; j3: distance of frame 3's origin from z0.",
        "kinematics.closed_form.terms",
        PINOCCHIO,
        _j,
        ROUNDING,
        proof=_j_is_exact,
    ),
]
