"""Equations (24)-(38): quaternions and small rotations."""

from functools import cache

import numpy as np
import pinocchio as pin

from k1607_pin.kinematics import orientation as o
from k1607_pin.report.equations import Equation
from k1607_pin.report.sample import gap

SMALL = 1e-3  # rad, angle of the differential rotations
ROUNDING = 1e-13


@cache
def pairs() -> tuple[np.ndarray, np.ndarray]:
    """Two times (500, 3, 3) random rotations."""
    rng = np.random.default_rng(38)
    return tuple(np.array([pin.exp3(_vector(rng, 3.0)) for _ in range(500)]) for _ in range(2))  # type: ignore[return-value]


@cache
def small() -> tuple[np.ndarray, np.ndarray]:
    """Rotation vectors (500, 3) of length SMALL and their rotations (500, 3, 3)."""
    rng = np.random.default_rng(35)
    vectors = np.array([_vector(rng, SMALL, SMALL) for _ in range(500)])
    return vectors, np.array([pin.exp3(v) for v in vectors])


def _vector(rng: np.random.Generator, longest: float, shortest: float = 0.0) -> np.ndarray:
    """A rotation vector of random direction; up to 3 rad it stays clear of a half turn, where (26) divides by zero."""
    v = rng.normal(size=3)
    return v / np.linalg.norm(v) * rng.uniform(shortest, longest)


def T(R: np.ndarray) -> np.ndarray:
    return np.swapaxes(R, -1, -2)


def up_to_sign(a: np.ndarray, b: np.ndarray) -> float:
    """Largest gap of quaternions (n, 4); q and -q are one rotation."""
    return float(np.minimum(np.abs(a - b).max(-1), np.abs(a + b).max(-1)).max())


def _eigen(R: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4) from Pinocchio's (Eigen's), scalar first, eta >= 0."""
    q = np.array([pin.Quaternion(r).coeffs()[[3, 0, 1, 2]] for r in R])
    return np.where(q[:, :1] < 0, -q, q)


def _round_trip() -> float:
    R = pairs()[0]
    return gap(o.rotation(o.quaternion(R)), R)


def _rotation(sign: float) -> float:
    """(28) with the given sign of its last term, from the quaternion of (26), against the rotation it came from."""
    R = pairs()[0]
    q = o.quaternion_by_division(R)
    eta, s = q[:, 0, None, None], q[:, 1:]
    outer = s[:, :, None] * s[:, None, :]
    square = (s * s).sum(-1)[:, None, None]
    return gap((eta**2 - square) * np.eye(3) + 2 * outer + sign * 2 * eta * o.cross_matrix(s), R)


def _cross_matrix() -> float:
    rng = np.random.default_rng(29)
    s, v = rng.normal(size=(2, 500, 3))
    return gap((o.cross_matrix(s) @ v[..., None])[..., 0], np.cross(s, v))


def _increments() -> tuple[np.ndarray, np.ndarray]:
    """33-34 as printed, (500,) and (500, 3), from the quaternions (26) of both rotations."""
    q1, q2 = (o.quaternion(R) for R in pairs())
    eta1, s1, eta2, s2 = q1[:, 0], q1[:, 1:], q2[:, 0], q2[:, 1:]
    delta_s = eta1[:, None] * s2 - eta2[:, None] * s1 + (o.cross_matrix(s1) @ s2[..., None])[..., 0]
    return eta1 * eta2 + (s1 * s2).sum(-1), delta_s


def _scalar_of_increment() -> float:
    R1, R2 = pairs()
    ours = o.relative_quaternion_base(o.quaternion(R1), o.quaternion(R2))[:, 0]
    return max(gap(np.abs(_increments()[0]), _eigen(R2 @ T(R1))[:, 0]), gap(np.abs(ours), _eigen(R2 @ T(R1))[:, 0]))


def _increment() -> float:
    """(33)-(34), ours and as printed, against the quaternion of R2 R1^T; ours of R1^T R2 against that."""
    R1, R2 = pairs()
    q1, q2 = o.quaternion(R1), o.quaternion(R2)
    eta, s = _increments()
    return max(
        up_to_sign(o.relative_quaternion_base(q1, q2), _eigen(R2 @ T(R1))),
        up_to_sign(np.column_stack([eta, s]), _eigen(R2 @ T(R1))),
        up_to_sign(o.relative_quaternion_body(q1, q2), _eigen(T(R1) @ R2)),
    )


def _turned_by_base_axes() -> float:
    """(31): frame 1 turned about axes fixed in frame 0 by the exponential map; ours must find that turn again."""
    R1, _ = pairs()
    _, turn = small()
    found = o.relative_quaternion_base(o.quaternion(R1), o.quaternion(turn @ R1))
    return gap(o.rotation(found) @ R1, turn @ R1)


def _from_1_to_2() -> float:
    """(32): the rotation of our quaternion against R_2 R_1^T."""
    R1, R2 = pairs()
    return gap(o.rotation(o.relative_quaternion_base(o.quaternion(R1), o.quaternion(R2))), R2 @ T(R1))


def _differential(sign: float) -> np.ndarray:
    """(500, 3, 3): I + differential rotation as in (36), read off small rotations, with the given sign of element (1, 3).

    The exponential's second-order term, which (36) drops, is added: without it a wrong differential rotation would hide in it.
    """
    _, R = small()
    rotation = o.cross_matrix(o.differential_rotation(R))
    rotation[:, 0, 2] *= sign
    return np.eye(3) + rotation + rotation @ rotation / 2


def _differential_of_pair(sign: float) -> float:
    _, R = small()
    R1 = pairs()[0]
    return gap(_differential(sign) @ R1, R @ R1)


def _twice_the_vector() -> float:
    """(37) against the rotation vectors that the small rotations were made of, applied to frame 1."""
    v, R = small()
    R1 = pairs()[0]
    return gap(o.orientation_error(R @ R1, R1), v)


PINOCCHIO = "Pinocchio (Eigen) quaternions, 500 random rotations"
SECOND_ORDER = f"exponential map, {SMALL} rad; agrees to third order, once the second-order term is added"

EQUATIONS: list[Equation] = [
    Equation(
        24,
        "The entries of an orientation matrix are r_ij.",
        "kinematics.orientation.quaternion",
        "round trip of (25) and (27)",
        _round_trip,
        ROUNDING,
        definition=True,
    ),
    Equation(
        25,
        "Q{R} is the quaternion of R.",
        "kinematics.orientation.quaternion",
        PINOCCHIO,
        lambda: up_to_sign(o.quaternion(pairs()[0]), _eigen(pairs()[0])),
        ROUNDING,
        definition=True,
    ),
    Equation(
        26,
        "The quaternion from the entries of R.",
        "kinematics.orientation.quaternion_by_division",
        PINOCCHIO,
        lambda: up_to_sign(o.quaternion_by_division(pairs()[0]), _eigen(pairs()[0])),
        ROUNDING,
        note="Divides by eta: fails at a half turn, where `orientation.quaternion` does not.",
    ),
    Equation(
        27,
        "The inverse operator gives R back.",
        "kinematics.orientation.rotation",
        "round trip",
        _round_trip,
        ROUNDING,
        definition=True,
    ),
    Equation(
        28,
        "R from its quaternion.",
        "kinematics.orientation.rotation",
        "round trip with (26)",
        lambda: max(_rotation(+1.0), _round_trip()),
        ROUNDING,
        printed=lambda: _rotation(-1.0),
        note="Printed with I_6 and -2 eta s^x: the identity is I_3, and with (26) the sign is +. As printed it is R^T. "
        "The printed residual is taken with I_3.",
    ),
    Equation(
        29,
        "s^x is the matrix of the cross product.",
        "kinematics.orientation.cross_matrix",
        "numpy.cross",
        _cross_matrix,
        1e-15,
    ),
    Equation(
        30,
        "Turns about the moving frame multiply from the right.",
        "kinematics.orientation.product",
        PINOCCHIO,
        lambda: up_to_sign(o.product(*(o.quaternion(R) for R in pairs())), _eigen(pairs()[0] @ pairs()[1])),
        ROUNDING,
    ),
    Equation(
        31,
        "Turns about the base frame multiply from the left.",
        "kinematics.orientation.relative_quaternion_base",
        "exponential map about base axes",
        _turned_by_base_axes,
        ROUNDING,
        note="In the text around (31)-(33) the bar over the rotation is lost.",
    ),
    Equation(
        32,
        "The rotation about base axes between two frames is R_2 R_1^T.",
        "kinematics.orientation.relative_quaternion_base",
        "R_2 R_1^T, 500 random pairs",
        _from_1_to_2,
        ROUNDING,
    ),
    Equation(
        33,
        "Scalar part of the quaternion between two frames.",
        "kinematics.orientation.relative_quaternion_base",
        PINOCCHIO,
        _scalar_of_increment,
        ROUNDING,
        note="The same for R_2 R_1^T and R_1^T R_2.",
    ),
    Equation(
        34,
        "Vector part of the quaternion between two frames.",
        "kinematics.orientation.relative_quaternion_base",
        PINOCCHIO,
        _increment,
        ROUNDING,
        note="Right as it stands: with the quaternion of (26) it is that of R_2 R_1^T, which (37) and (38) use. Only the "
        "sentence before (33) has lost the bar. With that of (28) as printed, s -> -s, it would be the one of R_1^T R_2.",
    ),
    Equation(
        35,
        "Frame 2 from frame 1 by a differential rotation about base axes.",
        "kinematics.orientation.differential_rotation",
        SECOND_ORDER,
        lambda: _differential_of_pair(+1.0),
        SMALL**3 / 6,
        printed=lambda: _differential_of_pair(-1.0),
        note="Element (1, 3): printed -delta_y, should be +delta_y.",
    ),
    Equation(
        36,
        "The differential rotation alone.",
        "kinematics.orientation.differential_rotation",
        SECOND_ORDER,
        lambda: gap(_differential(+1.0), small()[1]),
        SMALL**3 / 6,
        printed=lambda: gap(_differential(-1.0), small()[1]),
        note="Element (1, 3): printed -delta_y, should be +delta_y. As printed, (26) would give gamma = 0 whatever delta_y is.",
    ),
    Equation(
        37,
        "Differential rotations are twice the quaternion's vector part.",
        "kinematics.orientation.orientation_error",
        f"rotation vector, {SMALL} rad; agrees to third order",
        _twice_the_vector,
        SMALL**3 / 24 * 1.01,
        note="2 sin(angle/2) for the angle: the error is angle^3/24.",
    ),
    Equation(
        38,
        "The rotation between two samples, R(t_i) R^T(t_i-1).",
        "kinematics.orientation.relative_quaternion_base",
        PINOCCHIO,
        lambda: up_to_sign(
            o.relative_quaternion_base(*(o.quaternion(R) for R in pairs())), _eigen(pairs()[1] @ T(pairs()[0]))
        ),
        ROUNDING,
        definition=True,
    ),
]
