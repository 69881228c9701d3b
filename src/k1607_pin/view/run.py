"""Simulated runs as `simulate` returns them, or as a `SimulationError` holds them: checked once, here."""

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from k1607_pin.arm.arm import Arm
from k1607_pin.simulation.wall import Wall
from k1607_pin.view.motion import FRAMES_PER_SECOND, motion

SAME_PLACE = 1e-3
"""m: how far the run's tool may be from the arm's, before they are taken for two arms."""


class Run(NamedTuple):
    """What is drawn of a run of N samples, two at least."""

    times: np.ndarray
    """(N,) s, increasing"""
    Q: np.ndarray
    """(N, n) rad"""
    wanted: np.ndarray | None
    """(N, 3) m, where the tool's origin should be; base axes"""
    payload: np.ndarray
    """(N,) kg, what the hand carries from each time on"""
    contact: np.ndarray
    """(N, 3) N of the world on the tool; base axes"""
    wall: Wall | None


def read_run(arm: Arm, run: xr.Dataset, Q: Any = None, wall: Wall | None = None) -> Run:
    """The parts of a run that are drawn.

    Parameters
    ----------
    run : over ``time`` [s], with ``q`` (time, joint) rad and, as far as they are there, ``wanted_position`` (time, axis) m,
        ``payload`` (time) kg, ``contact_force`` (time, axis) N and ``tool_position`` (time, axis) m.
    Q : must be None: a run brings its own angles.
    wall : to draw with it.

    Raises
    ------
    ValueError
        Q beside a run; no ``time`` or ``q``; other dimensions or shapes; numbers that are not finite; times that do not increase;
        a mass below zero; a tool that is not where this arm has it, because the run is another arm's.
    """
    if Q is not None:
        raise ValueError("Q: expected nothing beside a run, which brings its own joint angles")
    times, Q = _variable(run, "time", "s", ()), _variable(run, "q", "rad", (arm.n,))
    wanted = _variable(run, "wanted_position", "m", (3,)) if "wanted_position" in run else None
    payload = _variable(run, "payload", "kg", ()) if "payload" in run else np.zeros(len(times))
    contact = _variable(run, "contact_force", "N", (3,)) if "contact_force" in run else np.zeros((len(times), 3))
    if (payload < 0).any():
        k = int(np.argmin(payload))
        raise ValueError(f"run: expected payload >= 0 kg, got {payload[k]:g} kg at {times[k]:g} s")
    if "tool_position" in run:
        tool = _variable(run, "tool_position", "m", (3,))[0]
        apart = float(np.linalg.norm(tool - arm.forward_kinematics(Q[0]).translation))
        if apart > SAME_PLACE:
            raise ValueError(
                f"run: expected the tool where {arm.name!r} has its frame {arm.tool_frame!r}, got a tool_position {apart:.3g} m "
                f"from there at {times[0]:g} s; is it the run of another arm, or of another tool frame?"
            )
    if len(times) == 1:  # a simulation that failed at once: one picture of it
        times = times[0] + np.array([0.0, 1 / FRAMES_PER_SECOND])
        Q, payload, contact = (np.repeat(x, 2, axis=0) for x in (Q, payload, contact))
        wanted = None if wanted is None else np.repeat(wanted, 2, axis=0)
    times, Q = motion(arm, times, Q)
    return Run(times, Q, wanted, payload, contact, wall)


def require_wall(wall: Wall | None, run: Any) -> None:
    """Refuse a wall that is none, or that stands beside anything but a run; `ValueError` says which."""
    if wall is not None and not isinstance(wall, Wall):
        raise ValueError(f"wall: expected a Wall, as the simulation had it, got {wall!r}")
    if wall is not None and not isinstance(run, xr.Dataset):
        raise ValueError("wall: expected it beside a run of simulate, got it without one")


def payload_keys(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Times from 0 (K,) s when what the hand carries changes, and what it carries from then on (K,) kg.

    A change is at its very time. Of many within one frame of the viewer the first and the last are kept. The last key is the end
    of the run.
    """
    seconds = run.times - run.times[0]
    changes = np.flatnonzero(np.diff(run.payload)) + 1
    frame = np.floor(seconds[changes] * FRAMES_PER_SECOND)
    kept = changes[(np.diff(frame, prepend=-1) > 0) | (np.diff(frame, append=np.inf) > 0)]
    keys = np.concatenate([[0], kept, [len(seconds) - 1]])
    keys = keys[np.diff(keys, append=len(seconds)) > 0]  # a change at the end is the end
    return seconds[keys], run.payload[keys]


def contact_keys(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Times from 0 (K,) s and the force on the tool then (K, 3) N: of each of the viewer's frames the largest, and both ends.

    So an impact shorter than a frame is seen, as it was at its largest.
    """
    seconds = run.times - run.times[0]
    frame = np.floor(seconds * FRAMES_PER_SECOND)
    falling = np.lexsort([-np.linalg.norm(run.contact, axis=1), frame])  # within each frame
    largest = falling[np.diff(frame, prepend=-1) > 0]
    keys = np.union1d(largest, [0, len(seconds) - 1])
    return seconds[keys], run.contact[keys]


def _variable(run: xr.Dataset, name: str, unit: str, shape: tuple[int, ...]) -> np.ndarray:
    """(N, *shape) finite floats."""
    expected = f"{name} (time{', ' if shape else ''}{', '.join(map(str, shape))}) in {unit}"
    if name not in run.variables:
        raise ValueError(
            f"run: expected {expected}, got a dataset of {', '.join(map(str, run.variables)) or 'nothing'}"
        )
    variable = run[name]
    if "time" not in variable.dims or variable.ndim != 1 + len(shape):
        hint = "; choose one run of many with .isel" if variable.ndim > 1 + len(shape) else ""
        raise ValueError(f"run: expected {expected}, got dimensions {variable.dims}{hint}")
    values = variable.transpose("time", ...).values
    if values.dtype.kind not in "fiu":
        raise ValueError(f"run: expected {expected}, got numbers of type {values.dtype}")
    if values.shape[1:] != shape or not len(values):
        raise ValueError(f"run: expected {expected}, got shape {values.shape}")
    values = values.astype(float)
    finite = np.isfinite(values).reshape(len(values), -1).all(axis=1)
    if not finite.all():
        raise ValueError(
            f"run: expected {expected}, all finite, got {int((~finite).sum())} samples that are not, the first at sample "
            f"{int(np.argmin(finite))}"
        )
    return values
