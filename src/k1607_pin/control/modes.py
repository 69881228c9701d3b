"""What the hybrid scheme controls when: the selection S of figure 14, and the forces wanted where it is 1."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from k1607_pin.arguments import as_floats, number, numbers, shown


class Mode(NamedTuple):
    """What is controlled from a time on."""

    selection: Any
    """(6,) or the (6, 6) diagonal S of figure 14, compliance axes: 1 force-controlled, 0 position-controlled"""
    force: Any = (0.0,) * 6
    """(6,) N, N m that the tool is to exert on the world, compliance axes, or a function of time [s]; 0 where S is 0"""
    time: float = 0.0
    """s, from which it holds; ignored when modes are given as a function of time"""


Modes = Mode | Sequence[Mode] | Callable[[float], Mode]
"""For good, from times on, or as a function of time [s]"""


def checked_modes(modes: Modes) -> tuple[Mode, ...] | Callable[[float], Mode]:
    """Modes in order of time, or the function of time as it is, which `mode_at` checks.

    Raises
    ------
    ValueError
        S not diagonal of 0 and 1, a force on a position-controlled axis, times that do not rise from 0.
    """
    if callable(modes):
        return modes
    if not isinstance(modes, Sequence):
        raise ValueError(f"modes: expected a Mode, a sequence of Modes, or a function of time, got {shown(modes)}")
    listed = [modes] if isinstance(modes, Mode) else modes
    checked = tuple(_checked_mode(f"modes[{k}]", mode) for k, mode in enumerate(listed))
    times = [mode.time for mode in checked]
    if not times or times[0] != 0 or not (np.diff(times) > 0).all():
        raise ValueError(f"modes: expected times in s that rise from 0, got {times}")
    return checked


def mode_at(modes: Any, t: float, period: float) -> tuple[np.ndarray, np.ndarray]:
    """The diagonal of S and the wanted force, (6,) each, at time t [s], of what `checked_modes` gave; period : s.

    Raises
    ------
    ValueError
        A mode given as a function of time is not one, or wants a force on a position-controlled axis.
    """
    if callable(modes):
        now = _checked_mode(f"modes({t:g})", modes(t))
    else:
        index = np.searchsorted([mode.time for mode in modes], t + period / 2, "right") - 1
        now = modes[max(int(index), 0)]
    if callable(now.force):
        return now.selection, _checked_force(f"force({t:g})", now.force(t), now.selection)
    return now.selection, now.force


def checked_selection(name: str, selection: Any) -> np.ndarray:
    """(6,) the diagonal of S, from (6,) or the diagonal (6, 6), of zeros and ones; else a `ValueError`."""
    expected = "a selection of (6,) or diagonal (6, 6) zeros and ones"
    S = as_floats(name, selection, expected)
    diagonal = np.diag(S) if S.shape == (6, 6) else S
    is_diagonal = S.shape == (6,) or (S.shape == (6, 6) and bool((np.diag(diagonal) == S).all()))
    if not is_diagonal or not np.isin(diagonal, (0.0, 1.0)).all():
        raise ValueError(f"{name}: expected {expected}, got {shown(selection)}")
    return diagonal.copy()


def _checked_mode(name: str, mode: Any) -> Mode:
    """The mode with S as its diagonal and a constant force as an array."""
    if not isinstance(mode, Mode):
        raise ValueError(f"{name}: expected a Mode, got {shown(mode)}")
    diagonal = checked_selection(name, mode.selection)
    time = number(f"{name}.time", mode.time, unit="s")
    return Mode(diagonal, mode.force if callable(mode.force) else _checked_force(name, mode.force, diagonal), time)


def _checked_force(name: str, force: Any, selection: np.ndarray) -> np.ndarray:
    f = numbers(name, force, (6,), "N, N m").copy()
    if (wrong := (f != 0) & (selection == 0)).any():
        got = ", ".join(f"{f[k]:g} on axis {k}" for k in np.flatnonzero(wrong))
        raise ValueError(f"{name}: expected no force on position-controlled axes, got {got}")
    return f
