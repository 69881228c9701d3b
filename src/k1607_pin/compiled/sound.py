"""That a closed loop which was read from a file is one that may run: every index within what it is an index of."""

from collections.abc import Mapping

import numpy as np

from k1607_pin.compiled.closed_loop import INPUTS, REDUCERS, ClosedLoop, Setup, shape_of
from k1607_pin.compiled.program import OPERATIONS, Program, takes


def require_sound(loop: ClosedLoop, setup: Setup) -> None:
    """Raise ValueError if a program reads or writes what is not there, or the loop is not of this setup."""
    n, weights = setup.plant.arm.n, 2 * len(setup.schedule.changes)
    if (loop.n, loop.weights) != (n, weights) or loop.stages < 1:
        raise ValueError(f"closed loop: expected {n} joints and {weights} weights, got {loop.n} and {loop.weights}")
    for name, shape in loop.parameters.items():
        if shape_of(setup, name) != shape:
            raise ValueError(f"closed loop: expected {name} of shape {shape_of(setup, name)}, got {shape}")
    if wrong := [reducer for _, reducer, _ in loop.metrics if reducer not in REDUCERS]:
        raise ValueError(f"closed loop: expected one of {', '.join(REDUCERS)}, got {wrong[0]}")
    sizes = inputs_of(loop)
    for name, p in loop.programs.items():
        _require_program(name, p, sizes, outputs_of(loop, name))


def inputs_of(loop: ClosedLoop) -> Mapping[str, int]:
    """The most numbers of each input that any program is given."""
    found = dict(zip(INPUTS, loop.input_sizes, strict=True))
    found["shared"] = max(loop.law_tables.size, loop.physics_tables.size, loop.weights)
    found["more"] = max(loop.stages * loop.n, len(loop.reducers), loop.weights)
    return found


def outputs_of(loop: ClosedLoop, name: str) -> tuple[int, ...] | None:
    """How many numbers a program gives in each of its outputs; None where that is for the program to say."""
    n, state = loop.n, loop.state.size
    log = sum(int(np.prod(shape)) for _, shape in loop.logged)
    kinds: dict[str, tuple[int, ...] | None] = {
        "initial": (state,), "law": (n, state, len(loop.reducers), log), "motion": (n, n), "stage": (n, n),
        "acceleration": (n,), "finish": (n, n), "grip": (n,), "payload": None, "hoist": None,
    }  # fmt: skip
    kind = name.rstrip("0123456789")
    if kind not in kinds:
        raise ValueError(f"closed loop: expected one of {', '.join(kinds)}, got a program called {name!r}")
    return kinds[kind]


def _require_program(name: str, p: Program, inputs: Mapping[str, int], outputs: tuple[int, ...] | None) -> None:
    sizes = [inputs[key] for key in INPUTS]
    for i, node in enumerate(p.nodes):
        if node.op not in OPERATIONS:
            raise ValueError(f"{name}: expected an operation, got {node.op!r}")
        if node.op == "input":
            which, element = node.place
            if not (0 <= which < len(sizes) and 0 <= element < sizes[which]):
                raise ValueError(f"{name}: expected an input that there is, got {node.place}")
        if len(node.args) != takes(node.op) or not all(0 <= a < i for a in node.args):
            raise ValueError(f"{name}: expected {takes(node.op)} earlier results for {node.op}, got {node.args}")
    given = tuple(map(len, p.outputs))
    if (outputs is not None and given != outputs) or (outputs is None and len(given) != 1):
        raise ValueError(f"{name}: expected outputs of {outputs} numbers, got {given}")
    if not all(0 <= i < len(p.nodes) for output in p.outputs for i in output):
        raise ValueError(f"{name}: expected outputs of its own results")
