"""A motion to look at when there is none: every joint in turn, out and back."""

import numpy as np

from k1607_pin.arm.arm import Arm

SECONDS_A_JOINT = 1.6


def each_joint_in_turn(arm: Arm, rate: float = 30.0) -> tuple[np.ndarray, np.ndarray]:
    """Times (N,) s and joint angles (N, n) rad: from a bent posture each joint swings up to 40° out and back, within limits.

    rate : poses a second.
    """
    low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    rest = low + 0.5 * (high - low)
    bent = np.clip(rest + np.deg2rad(20) * (-1.0) ** np.arange(arm.n), low, high)
    swing = np.where(high - bent > bent - low, 1, -1) * np.minimum(np.deg2rad(40), np.maximum(high - bent, bent - low))
    t = np.arange(round(SECONDS_A_JOINT * arm.n * rate) + 1) / rate
    turn = t[:, None] / SECONDS_A_JOINT - np.arange(arm.n)  # 0 to 1 while it is this joint's turn
    bump = np.where((turn > 0) & (turn < 1), np.sin(np.pi * np.clip(turn, 0, 1)) ** 2, 0)
    return t, bent + swing * bump
