"""Timing two things against each other on a noisy machine: in turn, many short rounds, the ratio of medians and its spread."""

import os
import platform
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np

QUICK = os.environ.get("BENCH_QUICK") == "1"
"""Whether to run everything once and briefly, to see that it runs: its numbers mean nothing."""


class Timing(NamedTuple):
    """Seconds a call, over all rounds."""

    minimum: float
    median: float
    maximum: float


def compare(
    *functions: Callable[[], object], rounds: int = 31, seconds: float = 0.02
) -> tuple[list[Timing], np.ndarray]:
    """Time each function in turn, round after round.

    Returns a `Timing` a function, and (rounds, len(functions)) seconds a call, so that ratios can be taken within a round.
    """
    if QUICK:
        rounds, seconds = 2, 0.0
    calls = []
    for f in functions:
        f()
        start = time.perf_counter()
        f()
        calls.append(max(1, round(seconds / max(time.perf_counter() - start, 1e-7))))
    table = np.empty((rounds, len(functions)))
    for r in range(rounds):
        for k, f in enumerate(functions):
            start = time.perf_counter()
            for _ in range(calls[k]):
                f()
            table[r, k] = (time.perf_counter() - start) / calls[k]
    return [Timing(column.min(), float(np.median(column)), column.max()) for column in table.T], table


def machine() -> str:
    """CPU, cores and versions, for the head of a table."""
    cpu = platform.processor() or platform.machine()
    if os.path.exists("/proc/cpuinfo"):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
        cpu = names[0] if names else cpu
    packages = ", ".join(f"{name} {version(name)}" for name in ("pin", "casadi", "numpy"))
    return f"{cpu}, {os.cpu_count()} cores; Python {platform.python_version()}, {packages}"
