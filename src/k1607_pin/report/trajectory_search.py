"""The search that identified the test joint trajectories: `python -m k1607_pin.report.trajectory_search`, some minutes.

Motions theta_i(t) = c_i + A_i sin(2 pi 0.4 t). Figures 5 and 6 ask for much acceleration along x and hardly any about x:
joint 1, whose axis is vertical, must carry the motion and the others move little. Figure 11's 15 thousandths contradict
figure 6 as an error of delta beta, but not as one of delta xi, about z, where that motion turns; so they are sought there.
Part 2's words are bounds. scipy's differential evolution finds motions that meet everything, but not from every seed: of some
twenty runs one ended below 0.01. The committed set is that one, rounded to whole degrees (`miss` 0.015), and comes from a
run that evaluated whole populations at once on the same measure; a seed here takes some minutes and ends elsewhere.
"""

import sys
from collections.abc import Iterator
from functools import cache

import numpy as np
from scipy.optimize import differential_evolution

from k1607_pin.arm.load import load_k1607
from k1607_pin.description.units import INCH
from k1607_pin.report.studies import TestTrajectory, maximum, part_1, part_2, part_3

FREQUENCY, DURATION = 0.4, 10.0  # Hz, s; assumed: four cycles, and 25 samples a cycle at 100 ms
CENTRES = [(-150, 150), (-80, 80), (-150, 150), (10, 150), (-150, 150), (2, 150), (-1, 1)]  # deg
AMPLITUDES = [(20, 60)] + 5 * [(-8, 8)] + [(-60, 60)]  # deg
GOOD = 0.01  # miss at which the search ends: 10 % in one of the ratios


def trajectory(angles: np.ndarray, duration: float = DURATION) -> TestTrajectory:
    """The motion of seven centres and seven amplitudes, (14,) deg."""
    return TestTrajectory(np.deg2rad(angles[:7]), np.deg2rad(angles[7:]), np.zeros(7), FREQUENCY, duration)


def miss(angles: np.ndarray) -> float:
    """How far a motion (14,) deg is from the published results, as a sum of squared logarithms of ratios; 0 is perfect.

    Evaluated at 100 ms alone: errors of Part 1 fall as T, so that figure 5's two maxima, a ratio of 12 apart, are missed alike by
    aiming at 6 / sqrt(1.2) in/s; and Part 2's error at 10 ms is about a tenth of the one at 100 ms on top of what is left at
    one instant.
    """
    T = 0.1
    motion = trajectory(angles, 1 / FREQUENCY)  # one cycle
    velocities, quaternion = part_1(motion, T), part_3(motion, T)
    ratios = [
        maximum(velocities, "v_x") / (6 / 1.2**0.5 * INCH),
        maximum(velocities, "omega_x") / 5e-3,
        maximum(quaternion, "delta_gamma") / 0.15e-3,
        maximum(quaternion, "delta_xi") / 15e-3,
    ]
    late, at_once = (
        part_2(motion, T, name).attrs["relative_error"] for name in ("late pseudo-inverse", "same instant")
    )
    total = np.sum(np.log(ratios) ** 2)
    total += max(0, np.log((at_once + late / 10) / 0.025)) ** 2 + max(0, np.log(0.12 / late)) ** 2
    return float(total + 20 * _beyond_limits(motion))


def _beyond_limits(motion: TestTrajectory) -> float:
    """How far the motion leaves the arm's (assumed) limits: rad, and shares of the greatest speed."""
    lower, upper, fastest = _limits()
    reach = np.abs(motion.amplitude)
    angle = np.maximum(0, motion.centre + reach - upper) + np.maximum(0, lower - motion.centre + reach)
    speed = np.maximum(0, reach * 2 * np.pi * FREQUENCY / fastest - 1)
    return float((angle + speed).sum())


@cache
def _limits() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    arm = load_k1607()
    return arm.lower, arm.upper, arm.velocity_limit


def search(first_seed: int = 0) -> Iterator[tuple[int, float, np.ndarray]]:
    """Yield (seed, miss, angles (14,) rounded to 0.1 deg) after each run, until one is `GOOD`."""
    seed = first_seed
    while True:
        run = differential_evolution(
            miss, CENTRES + AMPLITUDES, seed=seed, popsize=10, maxiter=120, tol=1e-9, polish=False
        )
        angles = np.round(run.x, 1)
        yield seed, miss(angles), angles
        if miss(angles) < GOOD:
            return
        seed += 1


if __name__ == "__main__":
    for seed, value, angles in search(int(sys.argv[1]) if len(sys.argv) > 1 else 0):
        sys.stdout.write(
            f"seed {seed}, miss {value:.4f}: centre {angles[:7].tolist()} amplitude {angles[7:].tolist()}\n"
        )
        sys.stdout.flush()
