"""Trace plain NumPy functions into CasADi functions."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import casadi as ca
import numpy as np

from k1607_pin.turns import Turns

Shape = tuple[int, ...]
_before: list[tuple[int, Any]] = []
"""What the blocks of `numpy_mode` under way, the outermost first, have found"""


def _put_back(blocks: int) -> None:
    mode, as_float = _before[-blocks]
    del _before[-blocks:]
    ca.SX.__float__ = as_float  # type: ignore[method-assign]
    ca.GlobalOptions.setNumpyMode(mode)


_TURNS = Turns(lambda: _put_back(len(_before)) if _before else None)  # the mode is one for all threads


@contextmanager
def numpy_mode() -> Iterator[None]:
    """CasADi arrays that behave as NumPy arrays, within the block only: the setting is global and is put back.

    But for float(), and the math module: of a symbol CasADi makes NaN, with which every comparison is false, and a branch gone.
    """
    with _TURNS.taken():
        as_float = ca.SX.__float__
        _before.append((ca.GlobalOptions.getNumpyMode(), as_float))
        ca.GlobalOptions.setNumpyMode(1)
        ca.SX.__float__ = _as_float(as_float)  # type: ignore[method-assign]
        try:
            yield
        finally:
            _put_back(1)


def _as_float(of_constant: Callable[[Any], float]) -> Callable[[Any], float]:
    def as_float(x: Any) -> float:
        if not x.is_constant():
            raise TypeError(
                "a traced number cannot be turned into a Python float, by float(), the math module, or written into an array of "
                "NumPy's; use NumPy's functions on arrays, np.where for conditions, np.stack for an array of numbers"
            )
        return of_constant(x)

    return as_float


def trace(fun: Callable[..., Any], name: str, shapes: Sequence[Shape], cse: bool = True) -> ca.Function:
    """The CasADi function of ``fun``: array arguments of the given shapes, one array out or a tuple of them.

    Inputs are columns in row-major order; outputs are dense, in their own shape (a 1-D output is a column).
    ``cse`` shares common subexpressions.
    """
    with numpy_mode():
        symbols = [ca.SX.sym(f"i{k}", int(np.prod(shape))) for k, shape in enumerate(shapes)]
        arguments = [np.reshape(ca.array(x)[:, 0], shape) for x, shape in zip(symbols, shapes, strict=True)]
        outputs = fun(*arguments)
        outputs = outputs if isinstance(outputs, tuple) else (outputs,)
        dense = [ca.densify(_symbol(x)) for x in outputs]
        return ca.Function(name, symbols, dense, {"cse": cse})


def _symbol(x: Any) -> Any:
    symbol = ca.SX(getattr(x, "_v", x))
    one_dimensional = len(getattr(x, "shape", ())) == 1  # np.ndim counts two: CasADi keeps its 1-D arrays as rows
    return ca.vec(symbol) if one_dimensional else symbol
