"""Equations (1)-(23): forward kinematics, Jacobian, pseudo-inverse."""

from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin

from k1607_pin.arm.load import load_k1607
from k1607_pin.compiled.trace import trace
from k1607_pin.description import dh
from k1607_pin.description.dh import table_1
from k1607_pin.kinematics import closed_form, differential, product
from k1607_pin.report.equations import Equation
from k1607_pin.report.polynomials import exact, is_identity

POSES = 1000
ROUNDING = 1e-12  # seven link transforms, entries up to 2 m: a few hundred roundings of 2e-16 at the most


@cache
def poses() -> np.ndarray:
    """(POSES, 7) joint angles over the full circle, rad: the sample that every numeric residual is taken on."""
    return np.random.default_rng(1607).uniform(-np.pi, np.pi, (POSES, 7))


@cache
def cs() -> tuple[list[np.ndarray], list[np.ndarray]]:
    return product.cosines_and_sines(poses())


@cache
def terms() -> closed_form.Terms:
    return closed_form.terms(*cs(), closed_form.parameters())


@cache
def frames() -> np.ndarray:
    """(7, POSES, 4, 4): Pinocchio's joint frames {1}..{7}, the independent source."""
    arm = load_k1607()
    return np.array([[T.homogeneous for T in arm.frames(q)] for q in poses()]).swapaxes(0, 1)


@cache
def pinocchio_jacobian() -> np.ndarray:
    """(POSES, 6, 7)"""
    return load_k1607().jacobian(poses())


def gap(a: Any, b: Any) -> float:
    return float(np.abs(np.asarray(a) - np.asarray(b)).max())


def _axis(frame: int, axis: int) -> list[np.ndarray]:
    """x, y, z components of an axis (0, 1, 2) of frame {frame} in frame {0}, from Pinocchio, (POSES,) each."""
    return [frames()[frame - 1][:, row, axis] for row in range(3)]


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
    y3, x3, x4, z5 = _axis(3, 1), _axis(3, 0), _axis(4, 0), _axis(5, 2)
    return gap(f, [y3[0], x3[0], y3[1], x3[1], x4[2], z5[2]])


def _f_is_exact() -> bool:
    f, (_, _, T3, T4, T5, *_) = exact().terms.f, exact().frames
    return is_identity(f, [T3[0, 1], T3[0, 0], T3[1, 1], T3[1, 0], T4[2, 0], T5[2, 2]])


def _f_as_printed() -> float:
    (c1, c2, c3, c4, *_), (s1, _, s3, s4, *_) = cs()
    return max(gap(-s1 * c2 * s3 - c1 * c3, _axis(3, 1)[1]), gap(-s1 * c3 * s4 + c2 * c4, _axis(5, 2)[2]))


def _g() -> float:
    x4, z5, z6, x5 = _axis(4, 0), _axis(5, 2), _axis(6, 2), _axis(5, 0)
    return gap(terms().g, [x4[0], z5[0], x4[1], z5[1], z6[2], x5[2]])


def _g_is_exact() -> bool:
    g, (*_, T4, T5, T6, _) = exact().terms.g, exact().frames
    return is_identity(g, [T4[0, 0], T5[0, 2], T4[1, 0], T5[1, 2], T6[2, 2], T5[2, 0]])


def _h() -> float:
    z6, x5, x6 = _axis(6, 2), _axis(5, 0), _axis(6, 0)
    return gap(terms().h, [z6[0], x5[0], z6[1], x5[1], x6[2]])


def _h_is_exact() -> bool:
    h, (*_, T5, T6, _) = exact().terms.h, exact().frames
    return is_identity(h, [T6[0, 2], T5[0, 0], T6[1, 2], T5[1, 0], T6[2, 0]])


def _j() -> float:
    x6, o3 = _axis(6, 0), _axis(3, 3)
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


def _axes() -> float:
    """(14): products of rotations applied to b_0, and the axes that we use, against Pinocchio's joint axes."""
    R, b0, worst = np.eye(3), np.array([0, 0, 1.0]), 0.0
    steps = product.frame_transforms(table_1(), *cs())
    for i, T in enumerate(steps):
        link = np.linalg.inv(steps[i - 1]) @ T if i else T
        R = R @ link[..., :3, :3]
        axis, _ = product.axis_and_lever(T, steps[-1])
        worst = max(worst, gap(R @ b0, np.stack(_axis(i + 1, 2), -1)), gap(axis, _axis(i + 1, 2)))
    return worst


def _levers(fourth: float) -> float:
    """(16), the fourth row included, ours against Pinocchio's frames: x0 = (0, 0, 0, 1), ``fourth`` stands below p_i."""
    steps, T, x0 = product.frame_transforms(table_1(), *cs()), frames(), np.array([0, 0, 0, 1.0])
    worst = 0.0
    for step, joint in zip(steps, T, strict=True):
        _, lever = product.axis_and_lever(step, steps[-1])
        left = np.stack([*lever, np.full(POSES, fourth)], -1)
        worst = max(worst, gap(left, T[-1] @ x0 - joint @ x0))
    return worst


def _b0_and_x0() -> float:
    """(15), (17): seen from a frame at the origin without rotation, its own axis is b_0, and a point's lever is the point."""
    axis, lever = product.axis_and_lever(np.eye(4), frames()[6, 0])
    return max(gap(axis, [0, 0, 1]), gap(lever, (frames()[6, 0] @ [0, 0, 0, 1])[:3]))


def _columns(first: int, last: int) -> float:
    return gap(closed_form.jacobian(poses())[:, :, first - 1 : last], pinocchio_jacobian()[:, :, first - 1 : last])


def _columns_are_exact(first: int, last: int) -> bool:
    e = exact()
    return all(is_identity(e.columns[i], e.jacobian[:, i]) for i in range(first - 1, last))


def _first_column_as_printed() -> float:
    column = closed_form.jacobian(poses())[:, :, 0]
    column[:, 1] *= -1
    return gap(column, pinocchio_jacobian()[:, :, 0])


def _velocity() -> float:
    """(20) against automatic differentiation of the product (3): p_dot and the axial vector of R_dot R^T."""
    import casadi as ca

    T = trace(lambda q: product.forward_kinematics(table_1(), q), "T", [(7,)])
    q, v = ca.SX.sym("q", 7), ca.SX.sym("v", 7)
    T_dot = ca.reshape(ca.jtimes(T(q), q, v), 4, 4)
    S = T_dot[:3, :3] @ T(q)[:3, :3].T
    x_dot = ca.Function("x_dot", [q, v], [ca.vertcat(T_dot[:3, 3], S[2, 1], S[0, 2], S[1, 0])])
    rng, worst = np.random.default_rng(20), 0.0
    for pose in poses()[:200]:
        speed = rng.uniform(-1, 1, 7)
        worst = max(worst, gap(closed_form.jacobian(pose) @ speed, np.array(x_dot(pose, speed))[:, 0]))
    return worst


@cache
def _well_conditioned() -> np.ndarray:
    J = closed_form.jacobian(poses())
    return J[np.linalg.svd(J, compute_uv=False)[:, -1] > 0.05][:200]


def _weights(rng: np.random.Generator) -> np.ndarray:
    A = rng.normal(size=(7, 7))
    return A @ A.T + np.eye(7)


def _inverse_solution() -> float:
    """(21) with z = 0 against the Karush-Kuhn-Tucker system of: minimise q_dot^T W^-1 q_dot subject to J q_dot = x_dot."""
    rng, worst = np.random.default_rng(21), 0.0
    for J in _well_conditioned():
        W, x_dot, z = _weights(rng), rng.normal(size=6), rng.normal(size=7)
        kkt = np.block([[np.linalg.inv(W), J.T], [J, np.zeros((6, 6))]])
        best = np.linalg.solve(kkt, np.concatenate([np.zeros(7), x_dot]))[:7]
        with_z = differential.joint_velocity(J, x_dot, z, W)
        worst = max(worst, gap(differential.joint_velocity(J, x_dot, W=W).velocity, best), gap(with_z.residual, 0))
    return worst


def _weighted_penrose() -> float:
    """(22): J X J = J, X J X = X, J X symmetric, W^-1 X J symmetric."""
    rng, worst = np.random.default_rng(22), 0.0
    for J in _well_conditioned():
        W = _weights(rng)
        X = differential.weighted_pseudo_inverse(J, W).matrix
        V = np.linalg.solve(W, X @ J)
        worst = max(worst, gap(J @ X @ J, J), gap(X @ J @ X, X), gap(J @ X, (J @ X).T), gap(V, V.T))
    return worst


def _moore_penrose() -> float:
    return max(gap(differential.weighted_pseudo_inverse(J).matrix, np.linalg.pinv(J)) for J in _well_conditioned())


PINOCCHIO = f"Pinocchio, {POSES} random poses"
INFERRED = "The numbers (5)-(10) are lost; inferred from '(5)-(11)' and the grouping of the formulas."

EQUATIONS = [
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
        "a rigid transform, random poses",
        lambda: _rigid(closed_form.forward_kinematics(poses())),
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
    Equation(
        12,
        "The Jacobian is made of seven columns.",
        "kinematics.product.jacobian",
        PINOCCHIO,
        lambda: gap(product.jacobian(table_1(), poses()), pinocchio_jacobian()),
        ROUNDING,
        definition=True,
    ),
    Equation(
        13,
        "Column i is (b_i x p_i, b_i).",
        "kinematics.product.geometric_jacobian",
        PINOCCHIO,
        lambda: gap(product.geometric_jacobian(list(frames())), pinocchio_jacobian()),
        ROUNDING,
    ),
    Equation(
        14,
        "b_i is b_0 turned by the rotations up to joint i.",
        "kinematics.product.axis_and_lever",
        PINOCCHIO,
        _axes,
        ROUNDING,
    ),
    Equation(
        15,
        "b_0 = (0, 0, 1).",
        "kinematics.product.axis_and_lever",
        "axis of a frame without rotation",
        _b0_and_x0,
        0.0,
        definition=True,
    ),
    Equation(
        16,
        "p_i points from the origin of frame i to that of frame 7.",
        "kinematics.product.axis_and_lever",
        PINOCCHIO,
        lambda: _levers(0.0),
        ROUNDING,
        printed=lambda: _levers(1.0),
        note="Printed with 1 below p_i on the left; the right side's fourth entry is 1 - 1 = 0: a free vector, not a point.",
    ),
    Equation(
        17,
        "x_0 = (0, 0, 0, 1).",
        "kinematics.product.axis_and_lever",
        "lever of a point from the origin",
        _b0_and_x0,
        0.0,
        definition=True,
    ),
    Equation(
        18,
        "Columns 1 and 2 of the Jacobian in closed form.",
        "kinematics.closed_form.jacobian_columns",
        PINOCCHIO,
        lambda: _columns(1, 2),
        ROUNDING,
        printed=_first_column_as_printed,
        proof=lambda: _columns_are_exact(1, 2),
        note="J_1, second row: printed -p_x, should be +p_x.",
    ),
    Equation(
        19,
        "Column 3 of the Jacobian in closed form (and columns 4-7, which the report left out).",
        "kinematics.closed_form.jacobian_columns",
        PINOCCHIO,
        lambda: _columns(3, 7),
        ROUNDING,
        proof=lambda: _columns_are_exact(3, 7),
    ),
    Equation(
        20,
        "x_dot = J q_dot.",
        "kinematics.closed_form.jacobian",
        "automatic differentiation of (3)",
        _velocity,
        ROUNDING,
    ),
    Equation(
        21,
        "The weighted least-norm joint velocity, plus any null-space motion.",
        "kinematics.differential.joint_velocity",
        "Karush-Kuhn-Tucker solve; J q_dot = x_dot for random z",
        _inverse_solution,
        1e-9,
        note="Minimises q_dot^T W^-1 q_dot only for z = 0. Tolerance: condition numbers of up to 1e4 of J and W each.",
    ),
    Equation(
        22,
        "The weighted pseudo-inverse.",
        "kinematics.differential.weighted_pseudo_inverse",
        "the four weighted Penrose conditions",
        _weighted_penrose,
        1e-9,
        note="The text asks W to be symmetric; it must be positive definite too. 'When z = 0, (22) reduces': z stands in (21).",
    ),
    Equation(
        23,
        "The Moore-Penrose pseudo-inverse for W = I.",
        "kinematics.differential.weighted_pseudo_inverse",
        "numpy.linalg.pinv",
        _moore_penrose,
        1e-12,
    ),
]
