"""What all rollouts of a batch share: the clock, functions of time as tables, and when payloads change."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Plan:
    """As the kernel takes it."""

    ticks: int
    """Control periods"""
    substeps: int
    """Physics steps in each"""
    every: int
    """Samples between logged ones"""
    rows: int
    """Logged samples, 0 for no log"""
    period: float
    """s"""
    physics_step: float
    """s"""
    runaway: float
    """rad/s: from there on a rollout counts as lost"""
    law_shared: np.ndarray
    """(ticks + 1, :) doubles: time and tables at the control samples"""
    physics_shared: np.ndarray
    """(ticks * substeps, :) doubles: likewise at the physics steps"""
    weights: np.ndarray
    """(changes, :) doubles: shares of the payloads in what is carried, then in what is new"""
    change: np.ndarray
    """(ticks + 1,) int32: 0 for none, else 1 + row of ``weights``, negative where something is gripped"""
