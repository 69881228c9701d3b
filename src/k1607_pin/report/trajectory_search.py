"""The search that identified the test joint trajectories: `python -m k1607_pin.report.trajectory_search`, a few minutes.

Motions theta_i(t) = c_i + A_i sin(2 pi 0.4 t) in whole degrees. Figures 5 and 6 ask for much acceleration along x and hardly
any about x: joint 1, whose axis is vertical, must carry the motion and the others move little. Part 2's "excellent" at 10 ms
asks for postures in which the null space hardly contains joint 1, its "not adequate" at 100 ms for a pseudo-inverse that
changes along the motion. So: survey postures, scale joint 1's amplitude to figure 5, draw the small amplitudes at random.
"""

import itertools
import sys
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from k1607_pin.description.units import INCH
from k1607_pin.kinematics import closed_form
from k1607_pin.report.studies import TestTrajectory, maximum, part_1, part_2, part_3

FREQUENCY, DURATION = 0.4, 10.0  # Hz, s; assumed: four cycles, and 25 samples a cycle at 100 ms
REACH = 20 * INCH  # m; makes the linear rows of J comparable with the angular ones
GRID = (range(-80, 81, 20), (20, 40, 60), range(-60, 61, 20), (40, 60, 80, 100), range(-80, 81, 20), (20, 40, 60, 80))
VX_100 = 5.45  # in/s; as near to 6 as figure 5 at 10 ms allows: a backward difference errs by at most T/2 max |a|


class Found(NamedTuple):
    """One set that meets the targets."""

    miss: float
    """Largest |log(ours / published)|, half counted for v_x, whose two maxima no motion meets both."""
    centre: np.ndarray
    """(7,) deg"""
    amplitude: np.ndarray
    """(7,) deg"""


def trajectory(centre: np.ndarray, amplitude: np.ndarray, duration: float = DURATION) -> TestTrajectory:
    """The motion of a set in degrees."""
    return TestTrajectory(np.deg2rad(centre), np.deg2rad(amplitude), np.zeros(7), FREQUENCY, duration)


def postures() -> np.ndarray:
    """(m, 7) deg: grid postures far from singular, with little of joint 1 in the null space, and J^+ sensitive to joint 1."""
    grid = np.array([(*posture, 0.0) for posture in itertools.product(*GRID)])
    J = closed_form.jacobian(np.deg2rad(grid))
    sigma = np.linalg.svd(J / np.array([REACH] * 3 + [1.0] * 3)[:, None], compute_uv=False)[:, -1]
    inverse = np.linalg.pinv(J)
    null_share = 1 - np.einsum("mi,mi->m", inverse[:, 0], J[:, :, 0])  # (1, 1) of I - J^+ J
    z = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0.0]])
    turned = np.concatenate([J[:, :3, 0] @ z.T, J[:, 3:, 0] @ z.T], axis=-1)  # d(J_1)/d(theta_1)
    lag = np.abs(np.einsum("mi,mi->m", inverse[:, 0], turned))
    return grid[(sigma > 0.33) & (null_share < 0.012) & (lag > 0.8)]


def miss(centre: np.ndarray, amplitude: np.ndarray) -> float:
    """How far a set is from the published maxima; infinite when Part 2's words are not met."""
    motion = trajectory(centre, amplitude)
    fine, coarse = part_1(motion, 0.01), part_1(motion, 0.1)
    if (
        part_2(motion, 0.01).attrs["relative_error"] > 0.025
        or not 0.15 < part_2(motion, 0.1).attrs["relative_error"] < 0.25
    ):
        return np.inf
    ratios = {
        1.0: (maximum(fine, "omega_x") / 0.5e-3, maximum(coarse, "omega_x") / 5e-3, _gamma(motion) / 0.15e-3),
        0.5: (maximum(fine, "v_x") / (0.5 * INCH), maximum(coarse, "v_x") / (6 * INCH)),
    }
    return max(weight * abs(np.log(r)) for weight, group in ratios.items() for r in group)


def search(seed: int = 0, draws: int = 2000) -> Iterator[tuple[float, list[Found]]]:
    """Yield (share done, sets found so far, best first) after each posture."""
    rng = np.random.default_rng(seed)
    candidates = rng.permutation(postures())
    found: list[Found] = []
    for k, centre in enumerate(candidates, start=1):
        first = 20.0
        for _ in range(3):  # v_x is nearly linear in joint 1's amplitude
            motion = trajectory(centre, np.array([first, 0, 0, 0, 0, 0, 0]), 1 / FREQUENCY)
            first *= VX_100 * INCH / maximum(part_1(motion, 0.1), "v_x")
        if first <= 45:
            amplitudes = rng.integers(1, 4, (draws, 7)) * rng.choice([-1.0, 1.0], (draws, 7))
            amplitudes[:, 0] = np.round(first) + rng.integers(-1, 2, draws)
            for amplitude in amplitudes[_promising(centre, amplitudes)]:
                if np.isfinite(value := miss(centre, amplitude)):
                    found.append(Found(value, centre, amplitude))
        found.sort(key=lambda f: f.miss)
        yield k / len(candidates), found


def _promising(centre: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
    """(m,) which amplitude sets (m, 7) deg meet Part 1 and delta gamma at 100 ms: the cheap test, all at once."""
    T = 0.1
    angle = 2 * np.pi * FREQUENCY * T * np.arange(round(1 / (FREQUENCY * T)) + 1)[:, None]
    q = np.deg2rad(centre + amplitudes[:, None] * np.sin(angle))
    v = np.deg2rad(amplitudes[:, None] * np.cos(angle)) * 2 * np.pi * FREQUENCY
    pose = closed_form.forward_kinematics(q)
    x_dot = np.einsum("mtij,mtj->mti", closed_form.jacobian(q), v)[:, 1:]
    increment = pose[:, 1:, :3, :3] @ np.swapaxes(pose[:, :-1, :3, :3], -1, -2)
    turn = (increment[..., [2, 0], [1, 2]] - increment[..., [1, 2], [2, 0]]) / 2  # about x and y, (35)
    errors = (
        (np.diff(pose[:, :, 0, 3], axis=1) / T - x_dot[..., 0], VX_100 * INCH, 0.03),
        (turn[..., 0] / T - x_dot[..., 3], 5e-3, 0.05),
        ((turn[..., 1] - T * x_dot[..., 4]) / 2, 0.15e-3, 0.05),
    )
    return np.all([np.abs(np.log(np.abs(e).max(axis=1) / target)) < slack for e, target, slack in errors], axis=0)


def _gamma(motion: TestTrajectory) -> float:
    return maximum(part_3(motion, 0.1), "delta_gamma")


if __name__ == "__main__":
    best: list[Found] = []
    try:
        for share, best in search():
            sys.stderr.write(f"\r{share:4.0%}, {len(best)} sets found")
    except KeyboardInterrupt:
        sys.stderr.write("\ninterrupted; best so far:")
    for one in best[:5]:
        sys.stdout.write(
            f"\nmiss {one.miss:.4f}: centre {one.centre.astype(int)} amplitude {one.amplitude.astype(int)}"
        )
    sys.stdout.write("\n")
