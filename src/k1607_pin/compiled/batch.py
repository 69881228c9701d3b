"""Any NumPy function of a state, natively on a batch of states."""

import ctypes
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from numbers import Integral
from typing import Any

import casadi as ca
import numpy as np

from k1607_pin.arguments import as_floats
from k1607_pin.arm.arm import Arm
from k1607_pin.compiled import emit
from k1607_pin.compiled.build import compiler, library
from k1607_pin.compiled.interpreted import WARNING, function_of
from k1607_pin.compiled.kernel import resource
from k1607_pin.compiled.lanes import processors
from k1607_pin.compiled.leaves import Layout
from k1607_pin.compiled.limits import require_states
from k1607_pin.compiled.order import in_order
from k1607_pin.compiled.program import Program
from k1607_pin.compiled.trace import numpy_mode
from k1607_pin.compiled.traced_arm import TracedArm
from k1607_pin.compiled.tracer import TracingError, column, explained, program_of, symbol_array

ANYWHERE = 0.1  # times 1, 2, ...: arguments that a function is tried on for the shapes of what it gives
AGREE = 1e-9  # of the largest entry: traced and on numbers
BLOCKS = 256  # a thread takes at least so many at a time


class Batch:
    """``fun`` on batches: arrays (..., *shape) in, what it gives with the same (...) in front out.

    Parameters
    ----------
    fun : written with NumPy, takes arrays of ``shapes`` and gives an array or a (named) tuple of them; it is traced once.

    Raises
    ------
    TracingError
        The function does not trace; the operation is named.
    """

    def __init__(
        self,
        fun: Callable[..., Any],
        shapes: Sequence[tuple[int, ...]],
        names: Sequence[str] = (),
        finite: bool = False,
    ) -> None:
        """``names`` of the arguments, for messages; ``finite``: refuse what is not, else NaN is passed on as NumPy does."""
        self.shapes = [tuple(shape) for shape in shapes]
        self.names, self.finite = names or [f"argument {k}" for k in range(len(self.shapes))], finite
        if not self.shapes:
            raise ValueError("shapes: expected at least one argument's, got none")
        sizes = [int(np.prod(shape)) for shape in self.shapes]
        sample = fun(
            *(ANYWHERE * np.arange(1.0, size + 1).reshape(s) for size, s in zip(sizes, self.shapes, strict=True))
        )
        self._layout = Layout(sample)
        with numpy_mode():
            symbols = [symbol_array(f"i{k}", shape) for k, shape in enumerate(self.shapes)]
            with explained(getattr(fun, "__name__", "fun")):
                flat = self._layout.flat(fun(*symbols))
            columns = [column(Layout(None).flat(x)) for x in symbols]
            f = ca.Function("f", columns, [ca.densify(column(flat))], {"cse": True})
            self.program = in_order(program_of("fun", f))
        if len(flat) != self._layout.size:
            raise TracingError(f"fun: expected {self._layout.size} numbers as when called on floats, got {len(flat)}")
        self._require_same(fun)
        made = compiler()
        self.lanes = made.lanes if made else 1
        self._run = None
        if made:
            self._run = library(_source(self.program, sizes, self._layout.size, made.lanes), made).run
            self._run.restype = None
            self._run.argtypes = [ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p]

    def _require_same(self, fun: Callable[..., Any]) -> None:
        """What a trace cannot see, a condition on float(x) say, is found by what it does."""
        f, taken = function_of("f", self.program, [f"i{k}" for k in range(len(self.shapes))])
        rng = np.random.default_rng(0)
        for _ in range(4):
            given = [rng.normal(size=shape) for shape in self.shapes]
            columns = [np.ravel(x)[: f.size1_in(k)] if f"i{k}" in taken else 0 for k, x in enumerate(given)]
            with np.errstate(all="ignore"):
                wanted = np.array(self._layout.flat(fun(*given)), dtype=float)
            traced = f(*columns).full().ravel()
            scale = np.max(np.abs(wanted[np.isfinite(wanted)]), initial=1e-3)
            if not np.allclose(traced, wanted, rtol=0, atol=AGREE * scale, equal_nan=True):
                raise TracingError(
                    f"{getattr(fun, '__name__', 'fun')}: traced it gives {traced} where on numbers it gives {wanted}: a Python "
                    "condition, or something random, does not trace"
                )

    def empty(self, count: int) -> np.ndarray:
        """Memory for the results of ``count`` states, to be used again and again as ``out``."""
        return np.empty((count, self._layout.size))

    def __call__(self, *arguments: Any, threads: int | None = None, out: np.ndarray | None = None) -> Any:
        """The function on a batch.

        threads : None for as many as there are processors; out : of `empty`, where the results are put; None for new memory.
        """
        if len(arguments) != len(self.shapes):
            raise ValueError(f"expected {len(self.shapes)} arguments, got {len(arguments)}")
        if threads is not None and (not isinstance(threads, Integral) or threads < 1):
            raise ValueError(f"threads: expected a whole number from 1 on, got {threads!r}")
        arrays = [as_floats(name, x) for name, x in zip(self.names, arguments, strict=True)]
        for name, x, shape in zip(self.names, arrays, self.shapes, strict=True):
            if x.shape[x.ndim - len(shape) :] != shape or x.shape[: x.ndim - len(shape)] != self._lead(arrays):
                raise ValueError(
                    f"{name}: expected (..., {', '.join(map(str, shape))}), alike for all, got shape {x.shape}"
                )
            # a sum tells at a third of the cost, short of an overflow
            with np.errstate(over="ignore"):
                good = not self.finite or np.isfinite(x.sum()) or np.isfinite(x).all()
            if not good:
                raise ValueError(f"{name}: expected finite numbers, got {int((~np.isfinite(x)).sum())} that are not")
        lead = self._lead(arrays)
        count = int(np.prod(lead))
        needed = 8 * count * self._layout.size + sum(x.nbytes for x in arrays)
        if out is None:
            require_states(count, needed)
        inputs = [
            np.ascontiguousarray(x.reshape(count, int(np.prod(s)))) for x, s in zip(arrays, self.shapes, strict=True)
        ]
        shape = (count, self._layout.size)
        if out is None:
            out = self.empty(count)
        if out.shape != shape or out.dtype != float or not out.flags.c_contiguous or not out.flags.writeable:
            raise ValueError(
                f"out: expected a contiguous writable array of floats of shape {shape}, got {out.shape} of {out.dtype}"
            )
        if self._run is None:
            out[:] = self._interpreted(inputs)
        else:
            self._natively(inputs, out, threads)
        return self._shaped(out, lead)

    def _lead(self, arrays: Sequence[np.ndarray]) -> tuple[int, ...]:
        return arrays[0].shape[: arrays[0].ndim - len(self.shapes[0])]

    def _natively(self, inputs: list[np.ndarray], out: np.ndarray, threads: int | None) -> None:
        W, count = self.lanes, len(out)
        whole = count // W
        edges = np.linspace(0, whole, max(1, min(threads or processors(), whole // BLOCKS)) + 1).astype(int)

        def run(first: int, last: int) -> None:
            self._blocks([x[first * W : last * W] for x in inputs], out[first * W : last * W])

        if len(edges) == 2:
            run(0, whole)
        else:
            with ThreadPoolExecutor(len(edges) - 1) as pool:
                list(pool.map(lambda piece: run(*piece), pairwise(edges)))
        if rest := count - whole * W:
            padded = [np.concatenate([x[whole * W :], np.repeat(x[-1:], W - rest, axis=0)]) for x in inputs]
            last = np.empty((W, out.shape[1]))
            self._blocks(padded, last)
            out[whole * W :] = last[:rest]

    def _blocks(self, inputs: list[np.ndarray], out: np.ndarray) -> None:
        pointers = (ctypes.c_void_p * max(1, len(inputs)))(*(x.ctypes.data for x in inputs))
        self._run(len(out) // self.lanes, pointers, out.ctypes.data)  # type: ignore[misc]

    def _interpreted(self, inputs: list[np.ndarray]) -> np.ndarray:
        warnings.warn(WARNING, RuntimeWarning, stacklevel=3)
        if not len(inputs[0]):
            return self.empty(0)
        f, taken = function_of("f", self.program, [f"i{k}" for k in range(len(inputs))])
        arguments = [x.T[: f.size1_in(k)] if f"i{k}" in taken else 0 for k, x in enumerate(inputs)]
        return f.map(len(inputs[0]))(*arguments).full().T

    def _shaped(self, out: np.ndarray, lead: tuple[int, ...]) -> Any:
        taken = 0

        def part(x: Any) -> np.ndarray:
            nonlocal taken
            size = int(np.size(x))
            taken += size
            return out[:, taken - size : taken].reshape((*lead, *np.shape(x)))

        return self._layout.mapped(part)


def batch(arm: Arm, method: str) -> Batch:
    """A method of `Arm` on batches of states: "operational_space", "forward_dynamics", "jacobian", "mass_matrix", ...

    Singular postures are not looked for. Arguments are the method's, (..., n) each, finite.

    Raises
    ------
    ValueError
        No such method.
    """
    arguments = METHODS.get(method)
    if arguments is None:
        raise ValueError(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
    if not isinstance(arm, Arm):
        raise ValueError(f"arm: expected an Arm (load_k1607, load_urdf, load_example), got {arm!r:.80}")
    if method == "operational_space" and arm.n < 6:
        raise ValueError(f"method: expected six joints or more for operational_space, {arm.name!r} has {arm.n}")
    traced = TracedArm(arm)
    names = ("q", "v", "tau" if method == "forward_dynamics" else "a")[:arguments]
    return Batch(getattr(traced, method), [(arm.n,)] * arguments, names, finite=True)


METHODS = {
    "forward_kinematics": 1, "jacobian": 1, "jacobian_time_variation": 2, "mass_matrix": 1, "gravity_torque": 1, "bias_torque": 2,
    "coriolis_matrix": 2, "inverse_dynamics": 3, "forward_dynamics": 3, "operational_space": 2,
}  # fmt: skip
"""How many arguments each takes."""


def _source(p: Program, sizes: Sequence[int], out: int, lanes: int) -> str:
    """C of the function on blocks of states, which lie one after the other as NumPy has them."""
    loads = "\n".join(
        f"    V x{k}[{size}]; for (int i = 0; i < {size}; i++) for (int l = 0; l < W; l++) "
        f"((double *)&x{k}[i])[l] = in[{k}][(b * W + l) * {size} + i];"
        for k, size in enumerate(sizes)
    )
    return f"""#define W {lanes}
{resource("lanes.h")}
{emit.function("f", p, sizes)}
void run(int64_t blocks, const double *const *in, double *out)
{{
  for (int64_t b = 0; b < blocks; b++) {{
{loads}
    V y[{out}];
    f({", ".join([*(f"x{k}" for k in range(len(sizes))), "y"])});
    for (int l = 0; l < W; l++) for (int i = 0; i < {out}; i++) out[(b * W + l) * {out} + i] = ((double *)&y[i])[l];
  }}
}}
"""
