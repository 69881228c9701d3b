"""How many operations the forward kinematics takes: the report's "highly suitable for real-time" as a number."""

from collections import Counter
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from k1607_pin.compiled.trace import trace
from k1607_pin.description.dh import table_1
from k1607_pin.kinematics import closed_form, product


class Operations(NamedTuple):
    """Scalar operations of one evaluation."""

    form: str
    multiplications: int
    additions: int
    """Additions, subtractions and negations."""
    trigonometric: int
    """Sines and cosines."""


class _Counted:
    """A number that counts what is done to it, zeros and ones included: the cost of a formula as it is written."""

    def __init__(self, tally: Counter[str]) -> None:
        self.tally = tally

    def _count(self, kind: str) -> "_Counted":
        self.tally[kind] += 1
        return self

    def __mul__(self, _: Any) -> "_Counted":
        return self._count("*")

    def __add__(self, _: Any) -> "_Counted":
        return self._count("+")

    def __neg__(self) -> "_Counted":
        return self._count("+")

    __rmul__, __sub__, __radd__, __rsub__ = __mul__, __add__, __add__, __add__


def count() -> list[Operations]:
    """Operations of the product of seven matrices, the closed form, and both traced with common subexpressions shared."""
    tally: Counter[str] = Counter()
    links = np.array([[[_Counted(tally) for _ in range(4)] for _ in range(4)] for _ in range(7)], dtype=object)
    T = links[0]
    for link in links[1:]:
        T = T @ link
    in_links = Counter({"*": 7 * 6, "+": 7 * 3})  # (2): four products with cos, sin alpha, two with d, three signs
    rows = [Operations("product of seven 4x4 matrices, (2)-(3), as written", *_sum(tally + in_links))]

    tally.clear()
    c, s = ([_Counted(tally) for _ in range(7)] for _ in range(2))
    parameters = closed_form.Parameters(*(_Counted(tally) for _ in closed_form.Parameters._fields))
    closed_form.terms(c, s, parameters)
    rows.append(Operations("closed form, (5)-(11), as coded: repeated products shared by hand", *_sum(tally)))

    table = table_1()
    for name, fun in (
        ("product (3), zeros of Table 1 folded, traced", lambda q: product.forward_kinematics(table, q)),
        ("closed form, traced", closed_form.forward_kinematics),
    ):
        rows.append(_traced(f"{name}, common subexpressions shared", fun))
    rows.append(_traced("closed form and Jacobian together, traced", _both))
    return rows


def _both(q: Any) -> Any:
    return closed_form.forward_kinematics(q), closed_form.jacobian(q)


def _sum(tally: Counter[str]) -> tuple[int, int, int]:
    return tally["*"], tally["+"], 14


KINDS = {
    ca.OP_MUL: "*", ca.OP_SQ: "*", ca.OP_TWICE: "+", ca.OP_ADD: "+", ca.OP_SUB: "+", ca.OP_NEG: "+",
    ca.OP_SIN: "trigonometric", ca.OP_COS: "trigonometric",
}  # fmt: skip
FREE = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}


def _traced(name: str, fun: Any) -> Operations:
    f = trace(fun, "f", [(7,)])
    tally: Counter[str] = Counter()
    for k in range(f.n_instructions()):
        operation = f.instruction_id(k)
        if operation not in FREE:
            tally[KINDS[operation]] += 1
    return Operations(name, tally["*"], tally["+"], tally["trigonometric"])
