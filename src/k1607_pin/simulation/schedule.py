"""Payloads that come and go at their times, at once or little by little."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from k1607_pin.arm.payload import Payload, blend

NOTHING = Payload(0.0)


class PayloadChange(NamedTuple):
    """What the hand carries from a time on; a plain tuple does as well."""

    time: float
    """s"""
    payload: Payload
    ramp: float = 0.0
    """s over which it comes, linearly; 0 for at once"""


class PayloadSchedule:
    """Payload changes in order of time, none before the one before it is complete."""

    def __init__(self, changes: Sequence[Any], duration: float) -> None:
        self._changes = [self._change(k, change) for k, change in enumerate(changes)]
        free_from = 0.0
        for k, change in enumerate(self._changes):
            if not free_from <= change.time <= duration:
                raise ValueError(
                    f"payloads[{k}]: expected a time from {free_from:g} s (what comes before must be complete) to the end, "
                    f"{duration:g} s, got {change.time:g} s"
                )
            free_from = change.time + change.ramp

    @staticmethod
    def _change(k: int, entry: Any) -> PayloadChange:
        try:
            change = PayloadChange(*entry)
            times_are_numbers = bool(np.isfinite([change.time, change.ramp]).all())
        except TypeError:
            times_are_numbers = False
        if not times_are_numbers or change.ramp < 0 or not isinstance(change.payload, Payload):
            raise ValueError(
                f"payloads[{k}]: expected (time [s], Payload) or (time, Payload, ramp >= 0 [s]), got {entry!r}"
            )
        return change

    @property
    def changes(self) -> tuple[PayloadChange, ...]:
        """All of them."""
        return tuple(self._changes)

    def shares(self, t: float) -> np.ndarray:
        """(changes,) of each change's payload, what the hand carries at time t [s]: `at` in numbers."""
        shares = np.zeros(len(self._changes))
        for k, change in enumerate(self._changes):
            if change.time > t:
                break
            share = self._share(change, t)
            shares *= 1 - share
            shares[k] += share
        return shares

    def gripped_shares(self, before: float, now: float) -> np.ndarray:
        """(changes,) of each change's payload, what came into the hand between two times [s]: `gripped` in numbers."""
        shares = np.zeros(len(self._changes))
        begun = [k for k, change in enumerate(self._changes) if change.time <= now]
        if begun:
            last = self._changes[begun[-1]]
            shares[begun[-1]] = self._share(last, now) - (self._share(last, before) if last.time <= before else 0.0)
        return shares

    def at(self, t: float) -> Payload:
        """What the hand carries at time t [s]: the same object for as long as it stays the same."""
        carried = NOTHING
        for change in self._changes:
            if change.time > t:
                break
            carried = blend(carried, change.payload, self._share(change, t))
        return carried

    def gripped(self, before: float, now: float) -> Payload:
        """What came into the hand between two times [s], whatever left it meanwhile: of the latest change by ``now`` the share
        that was not yet there."""
        begun = [change for change in self._changes if change.time <= now]
        if not begun:
            return NOTHING
        there = self._share(begun[-1], before) if begun[-1].time <= before else 0.0
        return blend(NOTHING, begun[-1].payload, self._share(begun[-1], now) - there)

    @staticmethod
    def _share(change: PayloadChange, t: float) -> float:
        return 1.0 if change.ramp == 0 else min(1.0, (t - change.time) / change.ramp)
