"""What a kernel gives, as a labelled dataset."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from k1607_pin.arm.arm import Arm
from k1607_pin.compiled.closed_loop import ClosedLoop
from k1607_pin.simulation.names import DIRECTIONS, VARIABLES, Variables

OWN: Variables = {"t": ((), "s"), **{name: VARIABLES[name] for name in ("q", "v", "tau", "tool_position")}}
"""What can be logged and reduced besides what the controller logs."""
REST = 3
"""Numbers after the metrics: samples counted, work, time of failure."""


def dataset(
    loop: ClosedLoop, arm: Arm, names: Variables, results: np.ndarray, log: np.ndarray, sample: float
) -> xr.Dataset:
    """Metrics and end of each rollout, and what was logged of it.

    Parameters
    ----------
    names : dimensions and units of what is logged.
    results : (rollouts, 2 n + metrics + `REST`); log : (rollouts, samples, numbers).
    sample : s between logged samples.
    """
    n = loop.n
    out: dict[str, Any] = {}

    def add(
        name: str, of: str, values: np.ndarray, shape: tuple[int, ...], lead: tuple[str, ...] = ("rollout",)
    ) -> None:
        dims, unit = names.get(of, (tuple(f"{of}_{k}" for k in range(len(shape))), ""))
        out[name] = (*lead, *dims), values.reshape(*values.shape[: len(lead)], *shape), {"units": unit}

    counted = results[:, -REST, None]
    for (name, reducer, shape), values in _cut(loop.metrics, results[:, 2 * n :]):
        values = np.where(counted > 0, values, np.nan)  # of a rollout that was lost before it began
        if reducer in ("rms", "mean"):
            values = values / np.maximum(counted, 1)
        add(f"{name}_{reducer}", name, np.sqrt(values) if reducer == "rms" else values, shape)
    if log.shape[1]:
        for (name, shape), values in _cut(loop.logged, log):
            add(name, name, values, shape, ("rollout", "time"))
    add("q_end", "q", results[:, :n], (n,))
    add("v_end", "v", results[:, n : 2 * n], (n,))
    out["work"] = "rollout", results[:, 1 - REST], {"units": "J"}
    out["failed_at"] = "rollout", results[:, -1], {"units": "s"}
    labels = {"joint": list(arm.joint_names), "axis": ["x", "y", "z"], "direction": list(DIRECTIONS)}
    used = {dim for dims, *_ in out.values() for dim in dims}
    coords: dict[str, Any] = {name: label for name, label in labels.items() if name in used}
    if log.shape[1]:
        coords["time"] = "time", np.arange(log.shape[1]) * sample, {"units": "s"}
    return xr.Dataset(out, coords)


def _cut(kinds: Any, values: np.ndarray) -> Any:
    """Each kind, whose last entry is a shape, with its numbers from the last axis of ``values``, in order."""
    k = 0
    for kind in kinds:
        size = int(np.prod(kind[-1]))
        yield kind, values[..., k : k + size]
        k += size


def variables_of(controller: Any) -> Variables:
    """Dimensions and units of what can be logged of a controller."""
    own: Mapping[str, Any] = getattr(controller, "variables", {})
    return {**own, **OWN}
