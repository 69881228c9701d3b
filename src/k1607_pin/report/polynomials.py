"""Exact proofs: the closed form's own code run on polynomials in the cosines and sines, with rational coefficients.

NumPy object arrays carry SymPy polynomials through the same functions that compute with floats, so what is proved is the
code that runs, for every joint angle and every value of the seven parameters, not samples of it.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from sympy import QQ
from sympy.polys.orderings import lex
from sympy.polys.rings import PolyElement, ring

from k1607_pin.description.dh import table_1
from k1607_pin.kinematics import closed_form, product


class Exact(NamedTuple):
    """The arm on polynomials: both ways to its kinematics."""

    c: tuple[Any, ...]
    """Cosines c1..c7."""
    s: tuple[Any, ...]
    """Sines s1..s7."""
    parameters: closed_form.Parameters
    """a2..a6, d3, d5"""
    terms: closed_form.Terms
    """(5)-(11) of the closed form."""
    frames: list[Any]
    """Partial products of (3), seven (4, 4)."""
    jacobian: Any
    """(6, 7) by cross products, (12)-(17)."""
    columns: list[list[Any]]
    """Columns of the closed-form Jacobian."""


@cache
def exact() -> Exact:
    """Closed form and product (3) on polynomials in c1..c7, s1..s7 and Table 1's seven nonzero parameters."""
    names = [f"s{i}" for i in range(1, 8)] + [f"c{i}" for i in range(1, 8)] + list(closed_form.Parameters._fields)
    _, *generators = ring(names, QQ, lex)
    s, c, parameters = tuple(generators[:7]), tuple(generators[7:14]), closed_form.Parameters(*generators[14:])
    table = table_1()
    zero = 0 * s[0]
    p = parameters
    links = SimpleNamespace(  # Table 1 with letters for lengths; its angles are multiples of 90 degrees
        cos_alpha=[int(x) for x in table.cos_alpha],
        sin_alpha=[int(x) for x in table.sin_alpha],
        a=[zero, zero, p.a2, p.a3, p.a4, p.a5, p.a6],
        d=[zero, zero, p.d3, zero, p.d5, zero, zero],
    )
    frames = product.frame_transforms(links, c, s)
    terms = closed_form.terms(c, s, parameters)
    columns = closed_form.jacobian_columns(c, s, terms, parameters)
    return Exact(c, s, parameters, terms, frames, product.geometric_jacobian(frames), columns)


def is_identity(left: Any, right: Any) -> bool:
    """Whether two polynomials, or arrays of them, are equal for all angles: modulo s_i^2 + c_i^2 = 1."""
    difference = np.ravel(np.asarray(left, dtype=object) - np.asarray(right, dtype=object))
    return all(_reduced(x) == 0 for x in difference)


def _reduced(x: Any) -> Any:
    if not isinstance(x, PolyElement):
        return x
    e = exact()
    circle = [s * s + c * c - 1 for s, c in zip(e.s, e.c, strict=True)]
    return x.rem(circle)
