"""Numbers of many rollouts in the kernel's layout: blocks of rollouts, one a lane."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from k1607_pin.arguments import as_floats


def batches(given: Mapping[str, tuple[Any, tuple[int, ...]]]) -> tuple[dict[str, np.ndarray], int]:
    """Each as (1, ...) or (N, ...), and N."""
    values: dict[str, np.ndarray] = {}
    for name, (x, shape) in given.items():
        x = as_floats(name, x)
        if x.shape == shape:
            x = x[None]
        if x.ndim != len(shape) + 1 or x.shape[1:] != shape or not len(x):
            raise ValueError(f"{name}: expected {shape} or (N, {', '.join(map(str, shape))}), got shape {x.shape}")
        if not np.isfinite(x).all():
            raise ValueError(f"{name}: expected finite numbers, got {int((~np.isfinite(x)).sum())} that are not")
        values[name] = x
    counts = {name: len(x) for name, x in values.items() if len(x) > 1}
    if len(set(counts.values())) > 1:
        raise ValueError(
            f"vary: expected as many values of each, got {', '.join(f'{k} of {name}' for name, k in counts.items())}"
        )
    return values, max(counts.values(), default=1)


def rows_of(x: np.ndarray, count: int) -> np.ndarray:
    """(count, size), one row repeated where there is one."""
    flat = x.reshape(len(x), -1)
    return np.broadcast_to(flat, (count, flat.shape[1]))


def in_lanes(columns: Sequence[np.ndarray], blocks: int, W: int) -> np.ndarray:
    """(blocks, sizes together, W) from columns (count, size); the last rollout fills up the last block."""
    count, size = len(columns[0]), sum(c.shape[1] for c in columns)
    out = np.empty((blocks, size, W))
    which = np.minimum(np.arange(blocks * W), count - 1)
    k = 0
    for c in columns:
        out[:, k : k + c.shape[1]] = c[which].reshape(blocks, W, -1).transpose(0, 2, 1)
        k += c.shape[1]
    return out


def by_rollout(x: np.ndarray, count: int) -> np.ndarray:
    """(count, ...) from (blocks, ..., W)."""
    moved = np.moveaxis(x, -1, 1)
    return moved.reshape(moved.shape[0] * moved.shape[1], *moved.shape[2:])[:count]


def processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
