"""One closed loop as programs: what happens at a control sample, in a physics step, and when a payload changes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from k1607_pin.compiled.leaves import Layout, numbers
from k1607_pin.compiled.program import Program
from k1607_pin.compiled.tables import Tables
from k1607_pin.compiled.traced_arm import inertial_parameters
from k1607_pin.simulation.plant import Plant
from k1607_pin.simulation.schedule import PayloadSchedule

REDUCERS = ("max", "min", "rms", "mean", "last")
ARM = ("inertial", "armature", "gravity")
"""What may be varied of an arm beside the numbers of the controller and the plant: see `TracedArm`."""

Signals = Mapping[str, Callable[[Mapping[str, Any]], Any]]
"""Name -> function of the log of a sample, "t", "q", "v", "tau" and "tool_position" included, to be logged and reduced too"""


@dataclass(frozen=True)
class Setup:
    """What is traced, apart from numbers that differ between lanes."""

    plant: Plant
    controller: Any
    external: Any
    """None, an object with wrench(t, q, v) -> (6,) N, N m at the tool, base axes, or a function of them that gives a `Wrench`"""
    schedule: PayloadSchedule
    from_rest: bool
    step: Callable[..., Any]
    physics_step: float
    signals: Signals


@dataclass(frozen=True)
class ClosedLoop:
    """Programs and the layout of what they take and give.

    Inputs of each, by number: shared (time and tables, one number for all lanes), q, v, tau, state, noise, parameters, payload,
    hoisted, and `more`: stages of the integrator, weights of the payloads, or the metrics so far.
    """

    n: int
    programs: Mapping[str, Program]
    """"initial" -> state; "law" -> tau, state, metrics, log; "motion" or "stage1", ..., "acceleration", "finish"; "payload",
    "grip", "hoist" """
    law_tables: Tables
    physics_tables: Tables
    parameters: Mapping[str, tuple[int, ...]]
    """Name and shape of each number that is an input of every lane, in order"""
    state: Layout
    state_is_given: bool
    """Whether the initial state is an input and not computed"""
    metrics: tuple[tuple[str, str, tuple[int, ...]], ...]
    """Variable, reducer, shape"""
    logged: tuple[tuple[str, tuple[int, ...]], ...]
    """Variable and shape"""
    stages: int
    weights: int
    """How many numbers say what of the payloads is carried, and what is new"""

    @property
    def input_sizes(self) -> tuple[int, ...]:
        """Of `INPUTS`; 0 for shared and more, which differ between programs."""
        count = sum(int(np.prod(shape)) for shape in self.parameters.values())
        noise = sum(source.size for _, source in self.law_tables.noise)
        payload = len(self.programs["payload"].outputs[0]) if "payload" in self.programs else 0
        hoisted = len(self.programs["hoist"].outputs[0])
        return 0, self.n, self.n, self.n, self.state.size, noise, count, payload, hoisted, 0

    @property
    def reducers(self) -> list[str]:
        """Of each number of the metrics."""
        return [reducer for _, reducer, shape in self.metrics for _ in range(int(np.prod(shape)))]


def start_of(reducers: Sequence[str]) -> np.ndarray:
    """What each number of the metrics is before the first sample."""
    return np.where(np.array(reducers, dtype=str) == "min", np.inf, 0.0)


INPUTS = ("shared", "q", "v", "tau", "state", "noise", "parameters", "payload", "hoisted", "more")


def is_of_arm(name: str) -> bool:
    """Whether a dotted name is of `ARM`, and not of a number that its owner has."""
    *_, owner, kind = ["", "", *name.split(".")]
    return owner == "arm" and kind in ARM


def value_of(setup: Setup, name: str) -> np.ndarray:
    """The number called ``name`` as it is where it is not varied.

    Raises
    ------
    ValueError
        There is none; the message lists those there are.
    """
    root, _, rest = name.partition(".")
    roots = {
        "plant": setup.plant,
        "controller": setup.controller,
        "external": setup.external,
        "payloads": setup.schedule.changes,
    }
    if root in roots:
        if is_of_arm(name):
            arm, kind = setup.plant.arm, rest.rpartition(".")[2]
            if kind == "inertial":
                return inertial_parameters(arm)
            return arm.armature if kind == "armature" else arm.model.gravity.linear.copy()
        there = numbers(roots[root])
        if rest in there:
            return there[rest]
    known = [f"{r}.{key}" for r, x in roots.items() for key in numbers(x)]
    known += [f"plant.arm.{key}" for key in ARM]
    raise ValueError(f"vary: expected some of {', '.join(known)}, got {name!r}")


def shape_of(setup: Setup, name: str) -> tuple[int, ...]:
    """Shape of the number called ``name``; errors as of `value_of`."""
    return value_of(setup, name).shape
