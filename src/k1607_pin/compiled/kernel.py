"""A closed loop as one C text, and the native function built from it."""

import ctypes
from importlib.resources import files

import numpy as np

from k1607_pin.compiled import emit
from k1607_pin.compiled.build import Compiler, library
from k1607_pin.compiled.closed_loop import INPUTS, ClosedLoop
from k1607_pin.compiled.plan import Plan
from k1607_pin.compiled.results import REST

SHARED = INPUTS.index("shared")


def source(loop: ClosedLoop, lanes: int) -> str:
    """C of the whole kernel, for ``lanes`` side by side."""
    noise = [source.size for _, source in loop.law_tables.noise]
    programs = loop.programs
    sizes = {
        "N": loop.n,
        "NP": sum(int(np.prod(shape)) for shape in loop.parameters.values()),
        "NS": loop.state.size,
        "GIVEN": int(loop.state_is_given),
        "NM": sum(int(np.prod(shape)) for _, _, shape in loop.metrics),
        "NLOG": sum(int(np.prod(shape)) for _, shape in loop.logged),
        "NPI": len(programs["payload"].outputs[0]) if "payload" in programs else 0,
        "NW": loop.weights,
        "NH": len(programs["hoist"].outputs[0]),
        "NN": sum(noise),
        "NSEED": len(noise),
        "NL": loop.law_tables.size,
        "NX": loop.physics_tables.size,
        "STAGES": loop.stages,
        "GRIP": int("grip" in programs),
    }
    lines = [f"#define W {lanes}", *(f"#define {name} {value}" for name, value in sizes.items())]
    calls = [
        f"stage{i}(0, q, v, tau, 0, 0, P, pi, H, k, qs, vs); "
        f"acceleration(shared, qs, vs, tau, 0, 0, P, pi, H, 0, k + {i} * N);"
        for i in range(1, loop.stages)
    ]
    lines.append(f"#define STAGE_CALLS {' '.join(calls)}")
    start = [0.0 if reducer in ("rms", "mean", "max", "last") else np.inf for reducer in loop.reducers]
    lines.append(f"static const double metric_start[NM + 1] = {{{', '.join(map(emit.literal, [*start, 0.0]))}}};")
    lines.append(f"static const int noise_size[NSEED + 1] = {{{', '.join(map(str, [*noise, 0]))}}};")
    functions = [emit.function(name, p, passed(name, sizes), (SHARED,)) for name, p in programs.items()]
    parts = [resource("lanes.h"), "\n".join(lines[1:]), *functions, resource("driver.c")]
    return "\n".join([lines[0], *parts])


_HELD = {"q": "N", "v": "N", "parameters": "NP", "payload": "NPI"}
_MOVING = _HELD | {"tau": "N", "hoisted": "NH"}
PASSED = {
    "initial": _HELD | {"shared": "NL"},
    "hoist": _HELD,
    "payload": {"q": "N", "v": "N", "parameters": "NP", "shared": "NW"},
    "grip": _HELD | {"shared": "NW"},
    "law": _HELD | {"shared": "NL", "state": "NS", "noise": "NN", "hoisted": "NH", "more": "NM"},
    "motion": _MOVING | {"shared": "NX"},
    "acceleration": _MOVING | {"shared": "NX"},
    "stage": _MOVING | {"more": "NK"},
    "finish": _MOVING | {"more": "NK"},
}
"""What driver.c passes to each program: input -> name of its size; a null pointer for the others"""


def passed(program: str, sizes: dict[str, int]) -> list[int]:
    """How many numbers of each of `INPUTS` driver.c passes to a program of this name."""
    of = sizes | {"NK": sizes["STAGES"] * sizes["N"]}
    taken = PASSED[program.rstrip("0123456789")]
    return [of[taken[name]] if name in taken else 0 for name in INPUTS]


def require_array(name: str, x: np.ndarray, shape: tuple[int, ...], dtype: type) -> int:
    """Where x begins in memory, if native code may read it as C does.

    Raises
    ------
    ValueError
        Another shape, another type, or not row by row.
    """
    if x.shape != shape or x.dtype != dtype or not x.flags.c_contiguous:
        order = "" if x.flags.c_contiguous else " not row by row"
        raise ValueError(
            f"{name}: expected {np.dtype(dtype)} of shape {shape}, got {x.dtype} of shape {x.shape}{order}"
        )
    return x.ctypes.data


def resource(name: str) -> str:
    """A C text of this package."""
    return (files("k1607_pin.compiled") / name).read_text()


class _Plan(ctypes.Structure):
    """`Plan` as driver.c has it."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in ("ticks", "substeps", "every", "rows")),
        *((name, ctypes.c_double) for name in ("period", "physics_step", "runaway")),
        *((name, ctypes.c_void_p) for name in ("law_shared", "physics_shared", "weights", "change")),
    ]


class Kernel:
    """The native function of a closed loop: advances blocks of ``lanes`` rollouts."""

    piece = 200_000
    """Physics steps of a block that one call does: a tenth of a second or so, which Ctrl-C waits for"""

    def __init__(self, loop: ClosedLoop, compiler: Compiler) -> None:
        self.lanes = compiler.lanes
        self._compiler, self._loop = compiler, loop
        self._run = library(source(loop, compiler.lanes), compiler).rollout
        self._run.restype = None
        self._run.argtypes = [ctypes.POINTER(_Plan), ctypes.c_int64, *[ctypes.c_void_p] * 4]

    def __str__(self) -> str:
        return f"{self._compiler.instructions}, {self.lanes} lanes, {self._compiler.version}"

    def __call__(self, plan: Plan, inputs: np.ndarray, seeds: np.ndarray, results: np.ndarray, log: np.ndarray) -> None:
        """Fill results (blocks, RESULT, lanes) and log (blocks, rows, NLOG, lanes) from inputs (blocks, INPUT, lanes).

        Raises
        ------
        ValueError
            An array that driver.c would read wrongly.
        """
        loop, W, blocks = self._loop, self.lanes, len(inputs)
        n, given = loop.n, loop.state.size if loop.state_is_given else 0
        taken = 2 * n + sum(int(np.prod(shape)) for shape in loop.parameters.values()) + given
        rows = sum(int(np.prod(shape)) for _, shape in loop.logged)
        arrays = (
            ("inputs", inputs, (blocks, taken, W), float),
            ("seeds", seeds, (blocks, len(loop.law_tables.noise), W), np.int64),
            ("results", results, (blocks, 2 * n + len(loop.reducers) + REST, W), float),
            ("log", log, (blocks, plan.rows, rows, W), float),
        )
        steps = plan.ticks * plan.substeps
        shared: dict[str, tuple[np.ndarray, tuple[int, ...], type]] = {
            "law_shared": (plan.law_shared, (plan.ticks + 1, loop.law_tables.size), float),
            "physics_shared": (plan.physics_shared, (steps, loop.physics_tables.size), float),
            "weights": (plan.weights, (len(plan.weights), loop.weights), float),
            "change": (plan.change, (plan.ticks + 1,), np.int32),
        }
        pointers = {name: require_array(name, *x) for name, x in shared.items()}
        in_c = _Plan(*(pointers.get(field[0], getattr(plan, field[0])) for field in _Plan._fields_))
        self._run(ctypes.byref(in_c), blocks, *(require_array(*x) for x in arrays))
