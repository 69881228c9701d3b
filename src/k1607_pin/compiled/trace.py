"""Trace plain NumPy functions into CasADi functions."""

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import casadi as ca
import numpy as np

Shape = tuple[int, ...]
_TAKING_TURNS = threading.RLock()  # the mode is one for all threads


@contextmanager
def numpy_mode() -> Iterator[None]:
    """CasADi arrays that behave as NumPy arrays, within the block only: the setting is global and is put back."""
    with _TAKING_TURNS:
        before = ca.GlobalOptions.getNumpyMode()
        ca.GlobalOptions.setNumpyMode(1)
        try:
            yield
        finally:
            ca.GlobalOptions.setNumpyMode(before)


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
