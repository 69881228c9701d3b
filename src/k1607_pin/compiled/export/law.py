"""One control period of a controller as functions to export.

What of the controller is a number of its own (rates, gains at the start, the period) is an argument. So is what it asks of the
world: what a callable gives for a time is a reference, what it gives for time, q and v is measured.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from k1607_pin.arm.arm import Arm
from k1607_pin.compiled.export.arm import inputs_of
from k1607_pin.compiled.export.cases import law_cases
from k1607_pin.compiled.export.function import Argument, Field, Function, Struct
from k1607_pin.compiled.export.known import completed
from k1607_pin.compiled.export.trace import ROLES, Leaf, TracedLaw
from k1607_pin.compiled.export.words import RENAMED, described, described_arm, name_in_c, options, title
from k1607_pin.compiled.leaves import numbers
from k1607_pin.compiled.program import Program

STRUCTS = {
    "parameters": "What may be changed from run to run; `defaults` gives the values it was exported with.",
    "reference": "What is wanted at the time of the sample.",
    "state": "Carried from one period to the next.",
}
OPTIONAL = ("parameters", "reference", "measured")
"""Arguments only if they are used"""


class Law(NamedTuple):
    """What is exported of one controller."""

    name: str
    says: str
    options: tuple[str, ...]
    """What of the controller is part of the code"""
    functions: tuple[Function, ...]
    """The step, and what its state is at the start if it has one"""
    defaults: Mapping[str, np.ndarray]
    """Field of the parameters -> the controller's own value"""


def exported_law(arm: Arm, name: str, controller: Any) -> Law:
    """The functions ``<name>_step`` and ``<name>_initial_state``.

    Raises
    ------
    TracingError
        The controller does something that cannot be traced; the message says where. Or traced it does something else than on
        numbers.
    ValueError
        It has no ``initial``, so that it is not known what its state is.
    """
    if not hasattr(controller, "initial") or not hasattr(controller, "update"):
        raise ValueError(
            f"controllers: expected {name!r} to have initial(q, v) and update(t, q, v, state), got {controller!r}"
        )
    traced = TracedLaw(arm, controller)
    results = [traced.tau, *traced.logged.values(), traced.after]
    every = [leaf for role in ROLES for leaf in traced.leaves if leaf.role == role]
    of_step, of_start = (_used(traced.program(outputs, every)) for outputs in (results, [traced.initial]))
    step = [leaf for k, leaf in enumerate(every) if leaf.role not in OPTIONAL or k in of_step | of_start]
    needed = {every[k].role for k in of_start} | {"q", "v"}
    start = [leaf for leaf in step if leaf.role in needed]
    names = _names(step)

    def group(role: str) -> tuple[Field, ...]:
        return tuple(described(role, names[leaf.key], leaf.shape, controller) for leaf in step if leaf.role == role)

    there = inputs_of(arm)
    arguments: dict[str, tuple[Argument, ...]] = {
        role: (Struct(role, members, STRUCTS[role]),) if (members := group(role)) else () for role in STRUCTS
    }
    arguments |= {"q": (there["q"],), "v": (there["v"]._replace(says="joint velocities, measured"),)}
    arguments["measured"] = group("measured")
    torque = there["torque"]._replace(says="to be held until the next period")
    logged = (described("output", key, traced.shapes[key], controller, log) for key, log in traced.keys.items())
    step_cases, start_cases = law_cases(arm, controller, traced, step, start)
    functions = [
        Function(
            f"{name}_step",
            "One control period: the torque from the present state, then the next state, put in the place of the old.",
            tuple(argument for role in ROLES for argument in arguments[role]),
            (torque, *logged, *arguments["state"]),
            traced.program(results, step),
            step_cases,
        )
    ]
    if arguments["state"]:
        beginning = Function(
            f"{name}_initial_state",
            "The state before the first period, from what there is at its sample.",
            tuple(argument for role in ROLES if role in needed for argument in arguments[role]),
            arguments["state"],
            traced.program([traced.initial], start),
            start_cases,
        )
        functions.insert(0, beginning)
    own = numbers(controller)
    defaults = {names[leaf.key]: own[leaf.path] for leaf in step if leaf.role == "parameters"}
    return Law(name, title(controller), _about(arm, controller, step), tuple(map(completed, functions)), defaults)


def _about(arm: Arm, controller: Any, step: Sequence[Leaf]) -> tuple[str, ...]:
    """What of the controller is part of the code, its own model of the arm included where that is another."""
    arguments = [leaf.source or leaf.path for leaf in step if leaf.role in OPTIONAL]
    lines = options(controller, arguments)
    model = getattr(controller, "arm", None)
    if isinstance(model, Arm) and model.model != arm.model:
        lines += (f"Its model of the arm is its own: {described_arm(model)}",)
    return lines


def _used(program: Program) -> set[int]:
    """Which inputs anything depends on."""
    return {node.place[0] for node in program.nodes if node.op == "input"}


def _names(leaves: Sequence[Leaf]) -> dict[tuple[str, str], str]:
    """What C calls them: the end of the dotted name, as much of it as tells it from the others of its role."""
    names: dict[tuple[str, str], str] = {}
    for leaf in leaves:
        others = [other.path.split(".") for other in leaves if other.role == leaf.role and other is not leaf]
        parts = leaf.path.split(".")
        k = 1
        while k < len(parts) and any(other[-k:] == parts[-k:] for other in others):
            k += 1
        name = RENAMED.get(leaf.path) or name_in_c("_".join(parts[-k:]), leaf.role)
        while (leaf.role, name) in {(role, given) for (role, _), given in names.items()}:
            name += "_"  # "a b" beside "a_b"
        names[leaf.key] = name
    return names
