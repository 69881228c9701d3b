"""Postures to start from, for an arm that nobody has given one."""

import numpy as np

from k1607_pin.arguments import whole
from k1607_pin.arm.arm import Arm
from k1607_pin.arm.inverse import require_arm


def ready_postures(arm: Arm, tries: int = 500, seed: int = 0) -> np.ndarray:
    """(tries, n) rad: random postures in the middle half of the joints' ranges, the furthest from a singularity first.

    Furthest by the smallest singular value of J, its linear rows divided by the arm's length (the largest distance of the tool
    from the base among the postures tried), so that metres and radians weigh alike.
    """
    require_arm(arm)
    tries, seed = whole("tries", tries, 1), whole("seed", seed, 0)
    lower, upper = (np.where(np.isfinite(x), x, sign * np.pi) for x, sign in ((arm.lower, -1), (arm.upper, 1)))
    middle, span = (lower + upper) / 2, np.minimum(upper - lower, 2 * np.pi)
    Q = middle + span * np.random.default_rng(seed).uniform(-0.25, 0.25, (tries, arm.n))
    length = float(np.linalg.norm(arm.forward_kinematics(Q)[:, :3, 3], axis=1).max()) or 1.0  # a tool on the only axis
    J = arm.jacobian(Q) / np.array([length] * 3 + [1.0] * 3)[:, None]
    return Q[np.argsort(-np.linalg.svd(J, compute_uv=False)[:, -1])]
