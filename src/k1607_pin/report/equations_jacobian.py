"""Equations (12)-(23): Jacobian and pseudo-inverse."""

from functools import cache

import casadi as ca
import numpy as np
import pinocchio as pin

from k1607_pin.compiled.trace import trace
from k1607_pin.description.dh import table_1
from k1607_pin.kinematics import closed_form, differential, product
from k1607_pin.report.equations import Equation
from k1607_pin.report.polynomials import exact, is_identity
from k1607_pin.report.sample import PINOCCHIO, POSES, ROUNDING, axis, cs, frames, gap, pinocchio_jacobian, poses


def _axes() -> float:
    """(14): products of rotations applied to b_0, and the axes that we use, against Pinocchio's joint axes."""
    R, b0, worst = np.eye(3), np.array([0, 0, 1.0]), 0.0
    steps = product.frame_transforms(table_1(), *cs())
    for i, T in enumerate(steps):
        link = np.linalg.inv(steps[i - 1]) @ T if i else T
        R = R @ link[..., :3, :3]
        ours, _ = product.axis_and_lever(T, steps[-1])
        worst = max(worst, gap(R @ b0, np.stack(axis(i + 1, 2), -1)), gap(ours, axis(i + 1, 2)))
    return worst


def _levers(fourth: float) -> float:
    """(16) with ``fourth`` below p_i, x0 = (0, 0, 0, 1): ours against Pinocchio's frames, as seen from a base put elsewhere.

    What stands there decides how p_i goes along with the base: with 0 it turns, as a difference of points does; with 1 it is
    moved as well, as if it were a point.
    """
    steps, T, x0 = product.frame_transforms(table_1(), *cs()), frames(), np.array([0, 0, 0, 1.0])
    base = pin.exp6(pin.Motion(np.array([0.3, -0.2, 0.4]), np.array([0.5, 0.1, -0.7]))).homogeneous
    worst = 0.0
    for step, joint in zip(steps, T, strict=True):
        _, lever = product.axis_and_lever(step, steps[-1])
        left = np.stack([*lever, np.full(POSES, fourth)], -1) @ base.T
        worst = max(worst, gap(left[:, :3], (base @ T[-1] @ x0 - base @ joint @ x0)[:, :3]))
    return worst


def _b0_and_x0() -> float:
    """(15), (17): seen from a frame at the origin without rotation, its own axis is b_0, and a point's lever is the point."""
    ours, lever = product.axis_and_lever(np.eye(4), frames()[6, 0])
    return max(gap(ours, [0, 0, 1]), gap(lever, (frames()[6, 0] @ [0, 0, 0, 1])[:3]))


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
    """(21) against the Karush-Kuhn-Tucker system of: minimise (q_dot - z)^T W^-1 (q_dot - z) subject to J q_dot = x_dot.

    That is what the second term does: of all the solutions it takes the one nearest z; with z = 0, the least.
    """
    rng, worst = np.random.default_rng(21), 0.0
    for J in _well_conditioned():
        W, x_dot, z = _weights(rng), rng.normal(size=6), rng.normal(size=7)
        kkt = np.block([[np.linalg.inv(W), J.T], [J, np.zeros((6, 6))]])
        for wanted, ours in (
            (np.zeros(7), differential.joint_velocity(J, x_dot, W=W)),
            (z, differential.joint_velocity(J, x_dot, z, W)),
        ):
            best = np.linalg.solve(kkt, np.concatenate([np.linalg.solve(W, wanted), x_dot]))[:7]
            worst = max(worst, gap(ours.velocity, best), gap(ours.residual, 0))
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


EQUATIONS: list[Equation] = [
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
        note="Printed with 1 below p_i on the left; the right side's fourth entry is 1 - 1 = 0: a free vector, not a point. Seen "
        "from a base elsewhere, the printed one is off by the way there.",
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
        "Karush-Kuhn-Tucker solve: the solution nearest z, random z and z = 0",
        _inverse_solution,
        1e-9,
        note="Minimises q_dot^T W^-1 q_dot only for z = 0; in general it is the solution nearest z. "
        "Tolerance: condition numbers of up to 1e4 of J and W each.",
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
