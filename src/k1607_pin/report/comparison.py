"""The adaptive schemes beside the textbook's laws, on one arm and under one set of troubles; what is made equal is in `laws`."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from k1607_pin.arm.payload import Payload
from k1607_pin.paths.inverse_path import JointPath, joint_path
from k1607_pin.report.cases import StudyCase, study_case
from k1607_pin.report.laws import LAWS, NOTHING_TO_ADD, OMEGA_T, Law, setting
from k1607_pin.report.noisy import NOISE, Noisy
from k1607_pin.report.processes import processes
from k1607_pin.report.rows import Key, Row, appending, loaded
from k1607_pin.report.stability import LONGEST_STEP, LOST
from k1607_pin.simulation.integrators import runge_kutta_4
from k1607_pin.simulation.plant import Plant
from k1607_pin.simulation.simulate import Controller, SimulationError, simulate


@dataclass(frozen=True)
class Trouble:
    """What a run is made difficult by, beside the payload."""

    name: str
    model: float = 1.0
    """What the masses and inertias that a law is told are multiplied by; rotors excepted"""
    noise: tuple[float, float] = (0.0, 0.0)
    """Standard deviation of measured q [rad] and v [rad/s]"""


TROUBLES = (
    Trouble("payload"),
    Trouble("model -30 %", model=0.7),
    Trouble("model +30 %", model=1.3),
    Trouble("noise", noise=NOISE),
)


class Run(NamedTuple):
    """One run to be made."""

    law: str
    make: Law
    case: int
    period: float
    gravity: float
    trouble: Trouble
    duration: float
    omega_T: float
    seed: int

    @property
    def key(self) -> Key:
        """As its `Row` has it."""
        return self.law, self.case, self.period, self.gravity, self.trouble.name


def compare(
    laws: Mapping[str, Law] = LAWS,
    cases: Sequence[int] = (1, 2),
    periods: Sequence[float] = (0.01, 0.001),
    gravities: Sequence[float] = (9.81, 0.0),
    troubles: Sequence[Trouble] = TROUBLES,
    duration: float = 1.8,
    omega_T: float = OMEGA_T,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    file: str | Path | None = None,
    jobs: int = 1,
) -> Iterator[Row]:
    """Every law under every condition on the K-1607, one row as each run is done, always in the same order.

    10 lb are carried in the middle third, as in the study cases, whose paths are followed from their beginning.

    Parameters
    ----------
    periods : s; gravities : m/s^2; duration : s, a whole number of periods; omega_T : omega of every law times its period.
    progress : told the share done, 0 to 1, after each run.
    file : CSV, to which each row is added before it is passed on, so that what is done outlives an interruption. Rows that it
        has are not run again but passed on: whoever changes a law, the duration, omega_T or seed takes another file.
    jobs : processes. With more than 1, laws must be functions of a module or partials of such, and a script that calls this
        must do so under ``if __name__ == "__main__"``; rows are the same.

    Raises
    ------
    ValueError
        No such case; a file with something else in it; laws that no other process can be given.
    """
    conditions = product(cases, periods, gravities, troubles)
    runs = [
        Run(name, make, number, T, g, trouble, duration, omega_T, seed)
        for number, T, g, trouble in conditions
        for name, make in laws.items()
        if g > 0 or name not in NOTHING_TO_ADD
    ]
    done = {row.key: row for row in loaded(file)} if file is not None and Path(file).exists() else {}
    missing = [run for run in runs if run.key not in done]
    with processes(min(jobs, len(missing) or 1), laws) as pool, appending(file, done.values()) as write:
        fresh = pool.map(_row, missing) if pool else map(_row, missing)
        for k, run in enumerate(runs, 1):
            if run.key in done:
                row = done[run.key]
            else:
                row = next(fresh)
                write(row)
            if progress:
                progress(k / len(runs))
            yield row


@lru_cache(maxsize=2)
def _situation(number: int, gravity: float, duration: float) -> tuple[StudyCase, JointPath]:
    """The case, and its way from the beginning for a duration."""
    case = study_case(number, "recommended", gravity=gravity)
    return case, joint_path(case.plant.arm, case.law.path, case.q0, duration, case.law.rotation)


def _row(run: Run) -> Row:
    case, joints = _situation(run.case, run.gravity, run.duration)
    T, duration = run.period, run.duration
    law: Controller = run.make(setting(case, joints, T, run.omega_T, run.trouble.model))
    if any(run.trouble.noise):
        law = Noisy(law, T, run.trouble.noise, run.seed)
    limit = case.plant.arm.effort_limit
    plant = Plant(case.plant.arm, torque_limit=limit)
    thirds = [round(k * duration / 3 / T) * T for k in (1, 2)]
    payloads = [(thirds[0], case.payload), (thirds[1], Payload(0.0))]
    step = T / np.ceil(T / LONGEST_STEP - 1e-9)
    lost = Row(*run.key, np.inf, np.inf, np.nan, np.nan)
    try:
        log = simulate(plant, law, case.q0, duration, None, T, step, runge_kutta_4, payloads=payloads)
    except (SimulationError, np.linalg.LinAlgError):
        return lost
    distance = np.linalg.norm(log.tool_position.values - case.law.path(log.time.values).position, axis=1)
    if distance.max() > LOST:
        return lost
    share = log.tau.values / limit
    rms, torque, chatter = (float(np.sqrt(np.mean(x**2))) for x in (distance, share, np.diff(share, axis=0)))
    return replace(lost, rms=rms, largest=float(distance.max()), torque=torque, chatter=chatter)
