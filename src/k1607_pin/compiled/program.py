"""A traced function as a list of operations, each on results of earlier ones, and what makes that list shorter."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import casadi as ca

_CODES = {getattr(ca, name): name[3:].lower() for name in dir(ca) if name.startswith("OP_")}
TRIVIAL = ("const", "input")
OPERATIONS = frozenset(_CODES.values()) - {"output"}
"""All that a node may be"""


class Node(NamedTuple):
    """One operation."""

    op: str
    """CasADi's name for it, in lower case"""
    args: tuple[int, ...] = ()
    """Indices of the nodes that it takes"""
    value: float = 0.0
    """Of a constant"""
    place: tuple[int, int] = (0, 0)
    """Of an input: which, and which of its elements"""


class Program(NamedTuple):
    """Straight-line code in static single assignment."""

    nodes: tuple[Node, ...]
    outputs: tuple[tuple[int, ...], ...]
    """For each output, the node of each of its elements"""

    @property
    def operations(self) -> Counter[str]:
        """How often each operation occurs, inputs and constants apart."""
        return Counter(node.op for node in self.nodes if node.op not in TRIVIAL)


def program(f: ca.Function) -> Program:
    """The operations of an SX function with dense outputs, in CasADi's order, made fewer by `simplified`."""
    nodes: list[Node] = []
    work: dict[int, int] = {}
    outputs = [[-1] * f.nnz_out(k) for k in range(f.n_out())]
    for k in range(f.n_instructions()):
        op = _CODES[f.instruction_id(k)]
        into, of = f.instruction_output(k), f.instruction_input(k)
        if op == "output":
            outputs[into[0]][into[1]] = work[of[0]]
            continue
        if op == "const":
            node = Node(op, value=f.instruction_constant(k))
        elif op == "input":
            node = Node(op, place=(of[0], of[1]))
        else:
            node = Node(op, tuple(work[i] for i in of[: takes(op)]))
        work[into[0]] = len(nodes)
        nodes.append(node)
    return simplified(Program(tuple(nodes), tuple(map(tuple, outputs))))


_UNARY = {
    "neg", "exp", "log", "sqrt", "sq", "twice", "sin", "cos", "tan", "asin", "acos", "atan", "not", "floor", "ceil", "fabs",
    "sign", "erf", "inv", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "assign", "log1p", "expm1",
}  # fmt: skip


def takes(op: str) -> int:
    """How many results an operation takes."""
    return 0 if op in TRIVIAL else 1 if op in _UNARY else 2


def simplified(p: Program) -> Program:
    """The same with one division for many by the same number, and nothing that is not used."""
    divisors = Counter(node.args[1] for node in p.nodes if node.op == "div")
    new: list[Node] = []
    renamed: list[int] = []
    inverses: dict[int, int] = {}
    seen: dict[Node, int] = {}

    def add(node: Node) -> int:
        if node not in seen:
            seen[node] = len(new)
            new.append(node)
        return seen[node]

    for node in p.nodes:
        args = tuple(renamed[i] for i in node.args)
        if node.op == "inv" or (node.op == "div" and divisors[node.args[1]] > 1):
            if args[-1] not in inverses:
                inverses[args[-1]] = add(Node("inv", args[-1:]))
            inverse = inverses[args[-1]]
            renamed.append(inverse if node.op == "inv" else add(Node("mul", (args[0], inverse))))
        else:
            renamed.append(add(node._replace(args=args)))
    return needed(new, [[renamed[i] for i in output] for output in p.outputs])


def require_inputs(name: str, p: Program, sizes: Sequence[int]) -> None:
    """That a program reads no more than its caller passes: ``sizes`` numbers of each input.

    Raises
    ------
    ValueError
        It says which input, and which of its numbers; in C that would be memory of something else.
    """
    for k, i in sorted({node.place for node in p.nodes if node.op == "input"}):
        if not (0 <= k < len(sizes) and 0 <= i < sizes[k]):
            there = f"{sizes[k]} are given" if 0 <= k < len(sizes) else f"there are {len(sizes)} inputs"
            raise ValueError(f"{name}: reads number {i} of input {k}, of which {there}")


def needed(nodes: Sequence[Node], outputs: Iterable[Sequence[int]]) -> Program:
    """The program of what the outputs need, in the same order."""
    outputs = [list(output) for output in outputs]
    used = {i for output in outputs for i in output}
    for i in reversed(range(len(nodes))):
        if i in used:
            used.update(nodes[i].args)
    kept = sorted(used)
    renamed = {i: k for k, i in enumerate(kept)}
    return Program(
        tuple(nodes[i]._replace(args=tuple(renamed[a] for a in nodes[i].args)) for i in kept),
        tuple(tuple(renamed[i] for i in output) for output in outputs),
    )


def hoisted(
    programs: Sequence[Program], slow: Sequence[Iterable[int]], into: Sequence[int]
) -> tuple[Program, list[Program]]:
    """What the programs compute of their slow inputs alone, computed once for all of them.

    Parameters
    ----------
    slow : for each program, which of its inputs change seldom. They must be the same inputs, in the same order, for all.
    into : for each, the number of a further input, through which it gets what was computed.

    Returns
    -------
    The program of the slow inputs, numbered from 0, with one output; and the programs without what it does.
    """
    first: list[Node] = []
    seen: dict[Node, int] = {}
    wanted: dict[int, int] = {}  # node of the first program -> element of its output
    rest = []

    def add(node: Node) -> int:
        if node not in seen:
            seen[node] = len(first)
            first.append(node)
        return seen[node]

    for p, inputs, number in zip(programs, slow, into, strict=True):
        order = {k: i for i, k in enumerate(inputs)}
        there: dict[int, int] = {}  # node of p -> node of the first program
        for i, node in enumerate(p.nodes):
            if node.op == "const":
                there[i] = add(node)
            elif node.op == "input" and node.place[0] in order:
                there[i] = add(node._replace(place=(order[node.place[0]], node.place[1])))
            elif node.args and all(a in there for a in node.args):
                there[i] = add(node._replace(args=tuple(there[a] for a in node.args)))
        outside = {i for output in p.outputs for i in output}  # what an output, or an operation that stays, takes
        outside.update(a for i, node in enumerate(p.nodes) if i not in there for a in node.args)
        nodes = [
            Node("input", place=(number, wanted.setdefault(there[i], len(wanted))))
            if i in there and i in outside and node.op not in TRIVIAL
            else node
            for i, node in enumerate(p.nodes)
        ]
        rest.append(needed(nodes, p.outputs))
    return needed(first, [list(wanted)]), rest
