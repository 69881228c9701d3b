"""From rest to rest by one coordinate, as fast as limits of velocity, acceleration and jerk allow: in closed form.

Velocity rises along an S, is held, and falls along the same S: jerk for t_j, constant acceleration for t_a, jerk back for t_j, a
cruise of t_v, and all in reverse. By symmetry the way is v (2 t_j + t_a + t_v) with v = a (t_j + t_a) and a = j t_j.
"""

import numpy as np

from k1607_pin.paths.spline import Spline, of_jerk

ROUNDING = 1e-14  # of the limits, left to the rounding of what is computed from them
GRID = 2.0**-48  # of the duration: times are whole multiples, so that their sums are exact


def s_curve(velocity: float, acceleration: float, jerk: float, grid: float = 0.0) -> Spline:
    """(1,): from 0 to 1, at rest there, the fastest within positive limits, per s, s^2 and s^3.

    Times are rounded up, which lowers velocity, acceleration and jerk: to whole multiples of ``grid`` [s], a power of two, or of
    the motion's own if that is coarser.
    """
    t_j, t_a, t_v = phases(*((1 - ROUNDING) * x for x in (velocity, acceleration, jerk)))
    grid = max(grid, grid_for(4 * t_j + 2 * t_a + t_v))
    t_j, t_a, t_v = (grid * np.ceil(t / grid) for t in (t_j, t_a, t_v))
    held = np.array([t_j, t_a, t_j, t_v, t_j, t_a, t_j])
    j = 1 / (2 * t_j + t_a + t_v) / (t_j + t_a) / t_j
    lasting = held > 0
    times = np.append(0.0, np.cumsum(held[lasting]))
    signs = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])[lasting]
    return of_jerk(times, j * signs[:, None], np.zeros(1), np.zeros(1))


def duration_of(velocity: float, acceleration: float, jerk: float) -> float:
    """s: of `s_curve`, before times are rounded."""
    t_j, t_a, t_v = phases(velocity, acceleration, jerk)
    return 4 * t_j + 2 * t_a + t_v


def grid_for(duration: float) -> float:
    """s: a power of two, of which sums up to the duration are exact."""
    return float(GRID * 2.0 ** np.ceil(np.log2(duration)))


def phases(velocity: float, acceleration: float, jerk: float) -> tuple[float, float, float]:
    """t_j, t_a, t_v [s] of the fastest motion over a distance of 1."""
    t_j = min(np.cbrt(1 / (2 * jerk)), np.sqrt(velocity / jerk), acceleration / jerk)
    # x = t_j + t_a: where no cruise is left, a x (x + t_j) = 1; at most up to the velocity limit
    x = 2 / acceleration / (t_j + np.sqrt(t_j * t_j + 4 / acceleration))
    reaches_acceleration = t_j == acceleration / jerk
    t_a = max(min(x, velocity / acceleration) - t_j, 0.0) if reaches_acceleration else 0.0
    v = jerk * t_j * (t_j + t_a)
    return float(t_j), float(t_a), float(max(1 / v - 2 * t_j - t_a, 0.0))
