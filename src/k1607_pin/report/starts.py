"""Postures at the two study cases' starts, many at once: Newton steps from a known one, little by little."""

import numpy as np

from k1607_pin import data
from k1607_pin.description.units import INCH
from k1607_pin.kinematics.closed_form import forward_kinematics, jacobian

STAGES = 4  # from the known posture to the wanted one
NEWTON = 3  # steps at each
CLOSE = 1e-9  # m, rad: reached
SLOWLY = 40  # steps there: stretched out, each takes off little
SOFT = 1e-9  # of J J^T, on the way to the line's end, which may be out of reach
DAMPING = 1e-9  # of the normal equations: a singular posture must not stop the others


def x_of_starts() -> tuple[float, float]:
    """m: where on the x axis the line and the circle start."""
    facts = data.load("published")
    return facts["case1"]["x0_in"] * INCH, facts["case2"]["radius_in"] * INCH


def rotation(elevation: np.ndarray, azimuth: np.ndarray, roll: np.ndarray) -> np.ndarray:
    """(..., 3, 3) tool in base, Rz(azimuth) Ry(elevation) Rz(roll), of angles (...) in degrees."""
    (a, b), (c, d), (e, f) = ((np.cos(x), np.sin(x)) for x in map(np.deg2rad, (azimuth, elevation, roll)))
    rows = [
        [a * c * e - b * f, -a * c * f - b * e, a * d],
        [b * c * e + a * f, -b * c * f + a * e, b * d],
        [-d * e, d * f, c],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def angles_of(R: np.ndarray) -> tuple[float, float, float]:
    """elevation, azimuth, roll in degrees, of R (3, 3): the inverse of `rotation`."""
    elevation = np.arctan2(np.hypot(R[0, 2], R[1, 2]), R[2, 2])
    azimuth = np.arctan2(R[1, 2], R[0, 2])
    c, s = np.cos(azimuth), np.sin(azimuth)
    roll = np.arctan2(-s * R[0, 0] + c * R[1, 0], -s * R[0, 1] + c * R[1, 1])
    return float(np.rad2deg(elevation)), float(np.rad2deg(azimuth)), float(np.rad2deg(roll))


def starts(known: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Postures at the starts of both cases, and which were found.

    Parameters
    ----------
    known : (7,) rad, a posture of case 1 to begin at.
    start : (N, 6) z0 [in], elevation, azimuth, roll, theta_3 of case 1, of case 2 [deg].

    Returns
    -------
    (N, 2, 7) rad and (N,) booleans. Of the postures with that pose and theta_3, the one that ``known`` turns into continuously;
    case 2's is the one that case 1's turns into while the tool moves along x.
    """
    x_1, x_2 = x_of_starts()
    T = forward_kinematics(known)
    here = np.array([T[2, 3] / INCH, *angles_of(T[:3, :3]), np.rad2deg(known[2])])
    start, second = start[:, :5], start[:, 5]
    here = start - (start - here + 180) % 360 + 180  # the shorter way round
    here[:, 0] = T[2, 3] / INCH
    q = np.tile(known, (len(start), 1))
    for share in np.arange(1, STAGES + 1) / STAGES:
        x = (1 - share) * T[0, 3] + share * x_1
        y = (1 - share) * T[1, 3]
        q, _ = _newton(q, here + share * (start - here), x, y)
    q_1, first = _newton(q, start, x_1, 0.0)
    q, last = q_1, np.column_stack([start[:, :4], start[:, 4] + (second - start[:, 4] + 180) % 360 - 180])
    for share in np.arange(1, STAGES + 1) / STAGES:
        q, _ = _newton(q, start + share * (last - start), (1 - share) * x_1 + share * x_2, 0.0)
    q_2, also = _newton(q, last, x_2, 0.0)
    return np.stack([q_1, q_2], axis=1), first & also


def line_s_end(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the arm comes to on its way from postures q (N, 7) rad along case 1's line, the tool held as it is there.

    Returns
    -------
    (N,) m and rad by which it misses the line's end, and (N, STAGES, 7) rad on the way.
    """
    facts = data.load("published")["case1"]
    extent = np.array([facts["xf_in"] - facts["x0_in"], facts["yf_in"] - facts["y0_in"], 0.0]) * INCH
    T = forward_kinematics(q)
    way = []
    for share in np.arange(1, 2 * STAGES + 1) / (2 * STAGES):
        for _ in range(2 * NEWTON if share < 1 else SLOWLY):
            now = forward_kinematics(q)
            turn = _rotation_vector(T[:, :3, :3] @ now[:, :3, :3].swapaxes(-1, -2))
            error = np.concatenate([T[:, :3, 3] + share * extent - now[:, :3, 3], turn], axis=-1)
            J = jacobian(q)
            Jt = J.swapaxes(-1, -2)
            step = (Jt @ np.linalg.solve(J @ Jt + SOFT * np.eye(6), error[..., None]))[..., 0]
            q = q + step.clip(-0.5, 0.5)
        way.append(q)
    return np.abs(error).max(axis=-1), np.stack(way, axis=1)


def _newton(q: np.ndarray, start: np.ndarray, x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
    R = rotation(*start[:, 1:4].T)
    p = np.stack([np.full(len(q), x), np.full(len(q), y), start[:, 0] * INCH], axis=-1)
    A = np.zeros((len(q), 7, 7))
    A[:, 6, 2] = 1.0
    for k in range(NEWTON + 1):
        T = forward_kinematics(q)
        error = np.concatenate(
            [
                p - T[:, :3, 3],
                _rotation_vector(R @ T[:, :3, :3].swapaxes(-1, -2)),
                np.deg2rad(start[:, 4:]) - q[:, 2:3],
            ],
            axis=-1,
        )
        error[:, 6] = (error[:, 6] + np.pi) % (2 * np.pi) - np.pi
        if k == NEWTON:
            break
        A[:, :6] = jacobian(q)
        At = A.swapaxes(-1, -2)
        q = q + np.linalg.solve(At @ A + DAMPING * np.eye(7), (At @ error[..., None]))[..., 0].clip(-0.5, 0.5)
    return q, np.abs(error).max(axis=-1) < CLOSE


def _rotation_vector(E: np.ndarray) -> np.ndarray:
    """(N, 3) rad of rotations (N, 3, 3) less than half a turn."""
    axis = np.stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]], axis=-1) / 2
    sine = np.linalg.norm(axis, axis=-1)
    angle = np.arctan2(sine, (np.trace(E, axis1=1, axis2=2) - 1) / 2)
    return axis * (angle / np.where(sine > 1e-12, sine, 1.0))[:, None] + axis * (sine <= 1e-12)[:, None]


def posture_somewhere(rng: np.random.Generator, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """(7,) rad: a posture of case 1's start, drawn between bounds (7,) rad."""
    x_1, _ = x_of_starts()
    while True:
        q = rng.uniform(lower, upper)
        for _ in range(20):
            p = forward_kinematics(q)[:2, 3]
            q = q + np.linalg.lstsq(jacobian(q)[:2], np.array([x_1, 0.0]) - p, rcond=1e-3)[0].clip(-0.5, 0.5)
        if np.abs(forward_kinematics(q)[:2, 3] - [x_1, 0.0]).max() < CLOSE and (q > lower).all() and (q < upper).all():
            return q


def start_of(q: np.ndarray) -> np.ndarray:
    """(6,) as `starts` takes it, of a posture (7,) rad: theta_3 the same in both cases."""
    T = forward_kinematics(q)
    return np.array([T[2, 3] / INCH, *angles_of(T[:3, :3]), *np.rad2deg(q[[2, 2]])])
