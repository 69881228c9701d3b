"""Equations (39)-(47): Cartesian dynamics, the PD law, and the loop that they make."""

import numpy as np
import pinocchio as pin

from k1607_pin.arm.load import load_k1607
from k1607_pin.control import adaptation, error_system, pose
from k1607_pin.report import polynomials_error_system, sample_motion
from k1607_pin.report.equations import Equation
from k1607_pin.report.sample import gap
from k1607_pin.report.sample_loops import LINEAR, ROUNDING, loops, slope, system, z_dot
from k1607_pin.report.sample_motion import motion, space

SMALL = 1e-3  # rad, m


def _force(null_space: bool) -> float:
    """(39) along the motion, from Pinocchio's tool velocity and acceleration, against the force that was applied."""
    arm, m, worst = load_k1607(), motion(), 0.0
    model = arm.model
    data, tool = model.createData(), model.getFrameId(arm.tool_frame)
    for q, v, a, force in zip(m.q, m.v, m.a, m.force, strict=True):
        pin.forwardKinematics(model, data, q, v, a)
        pin.updateFramePlacements(model, data)
        x_dot = pin.getFrameVelocity(model, data, tool, pin.LOCAL_WORLD_ALIGNED).vector
        x_ddot = pin.getFrameClassicalAcceleration(model, data, tool, pin.LOCAL_WORLD_ALIGNED).vector
        s = space(arm, q, v)
        sum_ = s.Lambda @ x_ddot + s.Phi @ x_dot + s.Gamma @ sample_motion.pose(arm, q)
        worst = max(worst, gap(sum_ + s.bias_nullspace if null_space else sum_, force))
    return worst


def _pd() -> float:
    """(40) against the products summed entry by entry."""
    rng = np.random.default_rng(40)
    K_p, K_d, x_e, v_e = rng.normal(size=(6, 6)), rng.normal(size=(6, 6)), rng.normal(size=6), rng.normal(size=6)
    sums = [sum(K_p[i, j] * x_e[j] + K_d[i, j] * v_e[j] for j in range(6)) for i in range(6)]
    return gap(adaptation.proportional_derivative(adaptation.Gains(K_p, K_d), x_e, v_e), sums)


def _pose_error(as_printed: bool) -> float:
    """(41) against the displacement that it should measure: SMALL along each axis and about it, from random poses."""
    rng, worst = np.random.default_rng(41), 0.0
    for _ in range(200):
        R, p, step = pin.exp3(rng.uniform(-1, 1, 3)), rng.normal(size=3), rng.normal(size=6)
        step *= SMALL / np.linalg.norm(step[3:])
        R_d, p_d = pin.exp3(step[3:]) @ R, p + step[:3]
        printed = np.concatenate([p_d - p, pin.log3(R_d) - pin.log3(R)])
        worst = max(worst, gap(printed if as_printed else pose.pose_error(p, R, p_d, R_d), step))
    return worst


def _rate_by_matrices(identity: bool = True) -> float:
    """(44) against z' of (39)-(41) themselves; without the identity it is the printed one."""
    s = loops()
    A, B_u = error_system.system_matrices(system())
    if not identity:
        A = A.copy()
        A[:, :6, 6:] = 0
    ours = np.einsum("kij,kj->ki", A, s.z) + np.einsum("kij,kj->ki", B_u, s.u)
    return gap(ours, z_dot(s.z, s.u, s.Lambda, s.Phi, s.Gamma, s.gains))


def _substituted() -> float:
    """(42): left side less right side, with the error's acceleration of (39)-(41) and the implemented B_1 to B_4."""
    s, B = loops(), system()
    (x_e, v_e), (x_d, v_d, a_d) = np.split(s.z, 2, -1), np.split(s.u, 3, -1)
    a_e = z_dot(s.z, s.u, s.Lambda, s.Phi, s.Gamma, s.gains)[:, 6:]
    products = [(B.B_1, x_e), (B.B_2, v_e), (-B.B_3, x_d), (-B.B_4, v_d)]
    return gap(a_e + sum(np.einsum("kij,kj->ki", M, x) for M, x in products) - a_d, 0)


def _order_of_state() -> float:
    """(43): an error at rest and a rate without error, each seen by (44) where (43) puts it."""
    s, (A, _) = loops(), error_system.system_matrices(system())
    at_rest, moving = (np.concatenate(z, -1) for z in ((s.z[:, :6], 0 * s.z[:, 6:]), (0 * s.z[:, :6], s.z[:, 6:])))
    upper = [np.einsum("kij,kj->ki", A, z)[:, :6] for z in (at_rest, moving)]
    return max(gap(upper[0], 0), gap(upper[1], s.z[:, 6:]))


def _order_of_input() -> float:
    """(47): what each part of u alone does to z', by (44) and by (39)-(41)."""
    s, (_, B_u), worst = loops(), error_system.system_matrices(system()), 0.0
    for part in range(3):
        u = np.zeros_like(s.u)
        u[:, 6 * part : 6 * part + 6] = s.u[:, 6 * part : 6 * part + 6]
        alone = z_dot(0 * s.z, u, s.Lambda, s.Phi, s.Gamma, s.gains)
        worst = max(worst, gap(np.einsum("kij,kj->ki", B_u, u), alone))
    return worst


def _partial_derivatives(ours: tuple[str, str], of: str, sign: float) -> float:
    """(45)-(46): columns of B against derivatives of the error's acceleration with respect to six entries of z or u."""
    s, B = loops(), system()
    worst = 0.0
    for name, block in zip(ours, (0, 6), strict=True):
        columns = []
        for entry in np.eye(s.z.shape[1] if of == "z" else s.u.shape[1])[block : block + 6]:

            def moved(step: complex, entry: np.ndarray = entry) -> np.ndarray:
                z, u = (s.z + step * entry, s.u) if of == "z" else (s.z, s.u + step * entry)
                return z_dot(z, u, s.Lambda, s.Phi, s.Gamma, s.gains)[:, 6:]

            columns.append(slope(moved))
        worst = max(worst, gap(getattr(B, name), sign * np.stack(columns, -1)))
    return worst


EQUATIONS: list[Equation] = [
    Equation(
        39,
        "The Cartesian force moves the Cartesian mass, and carries Coriolis, centrifugal and gravity forces.",
        "dynamics.operational_space.operational_space",
        "Pinocchio's forward dynamics along a simulated motion, force in N and N m",
        lambda: _force(null_space=True),
        ROUNDING,
        printed=lambda: _force(null_space=False),
        note="Holds with (J_bar^T C - Lambda J_dot)(I - J_bar J) q_dot added. Gamma x = J_bar^T g fixes Gamma not uniquely.",
        gap="Seven joints: what they do in the null space adds a force that (39), and all that follows from it, leaves out.",
    ),
    Equation(
        40,
        "The controller: proportional and derivative gains, both varying in time.",
        "control.adaptation.proportional_derivative",
        "sums entry by entry",
        _pd,
        1e-14,
        definition=True,
    ),
    Equation(
        41,
        "The Cartesian error is the wanted less the actual position.",
        "control.pose.pose_error",
        f"exponential map, displacements of {SMALL} rad and about as many m; agrees to third order",
        lambda: _pose_error(as_printed=False),
        SMALL**3 / 24 * 1.01,
        definition=True,
        printed=lambda: _pose_error(as_printed=True),
        note="For the orientation we take 2 delta s of (37). Printed: the difference of two rotation vectors.",
        gap="Orientations have no difference: w_d - w, which (43) takes for x_e', is its rate only in the limit of small errors.",
    ),
    Equation(
        42,
        "(40) put into (39), in terms of the error.",
        "control.error_system.error_system",
        f"{LINEAR}, (39)-(41) solved for the acceleration",
        _substituted,
        ROUNDING,
        note="As (39) has it; the arm's null-space force stands on the right side, with a plus. x_d means x + x_e.",
    ),
    Equation(
        43,
        "The state z is the error and its rate.",
        "control.error_system.system_matrices",
        f"{LINEAR}, either half alone",
        _order_of_state,
        ROUNDING,
        definition=True,
    ),
    Equation(
        44,
        "(42) as a state equation.",
        "control.error_system.system_matrices",
        f"{LINEAR}, (39)-(41) solved for the acceleration",
        _rate_by_matrices,
        ROUNDING,
        printed=lambda: _rate_by_matrices(identity=False),
        proof=polynomials_error_system.state_space_is_exact,
        note="Upper right block: printed 0_6, should be I_6, as in (50).",
    ),
    Equation(
        45,
        "B_1 and B_2: how error and rate brake the error.",
        "control.error_system.error_system",
        f"{LINEAR}, derivatives of the acceleration by complex steps",
        lambda: _partial_derivatives(("B_1", "B_2"), "z", -1.0),
        ROUNDING,
        definition=True,
    ),
    Equation(
        46,
        "B_3 and B_4: how the wanted position and velocity drive the error.",
        "control.error_system.error_system",
        f"{LINEAR}, derivatives of the acceleration by complex steps",
        lambda: _partial_derivatives(("B_3", "B_4"), "u", 1.0),
        ROUNDING,
        definition=True,
    ),
    Equation(
        47,
        "The input u is the wanted position and its two derivatives.",
        "control.error_system.system_matrices",
        f"{LINEAR}, each part alone",
        _order_of_input,
        ROUNDING,
        definition=True,
    ),
]
