"""In which order a program's operations stand in C: compilers keep to it, and registers and latency decide how fast it runs."""

import heapq
from collections.abc import Sequence

from k1607_pin.compiled.program import TRIVIAL, Node, Program

CYCLES = {"inv": 13, "div": 13, "sqrt": 19, "sin": 40, "cos": 40}
"""Latency, roughly that of today's x86-64 and ARM processors; other operations `FEW`"""
FEW = 4
REGISTER = 0.05
"""What freeing a register is worth, as a share of the longest path: the least time of `benchmarks/bench_rollouts.py` with AVX2"""


def in_order(p: Program) -> Program:
    """The same program by list scheduling: of what can be done next, that from which most is still to do to the end.

    A multiplication and the addition that it is for are one operation, and so are sine and cosine of an angle. An operation
    that leaves fewer values in registers goes first where the way to the end is about as long.
    """
    lead = _together(p.nodes)
    members: dict[int, list[int]] = {}
    for i, first in enumerate(lead):
        members.setdefault(first, []).append(i)
    takes = {k: {lead[a] for i in group for a in p.nodes[i].args} - {k} for k, group in members.items()}
    users: dict[int, list[int]] = {k: [] for k in members}
    for k, arguments in takes.items():
        for a in arguments:
            users[a].append(k)
    given = {k for k in members if p.nodes[k].op in TRIVIAL}
    to_end = _to_end(p.nodes, takes, users)
    longest = max(to_end.values(), default=1)

    order: list[int] = sorted(given)
    missing = {k: len(arguments - given) for k, arguments in takes.items()}
    left = {k: len(after) for k, after in users.items()}

    def worth(k: int) -> float:
        freed = sum(left[a] == 1 for a in takes[k] - given)
        return to_end[k] / longest + REGISTER * (freed - bool(users[k]))

    ready = [(-worth(k), k) for k in members if k not in given and not missing[k]]
    heapq.heapify(ready)
    done = set(given)
    while ready:
        _, k = heapq.heappop(ready)
        if k in done:  # once more, with what it was worth before
            continue
        done.add(k)
        order += members[k]
        for a in takes[k] - given:
            left[a] -= 1
            if left[a] == 1:
                for user in users[a]:
                    if user not in done and not missing[user]:
                        heapq.heappush(ready, (-worth(user), user))
        for user in users[k]:
            missing[user] -= 1
            if not missing[user]:
                heapq.heappush(ready, (-worth(user), user))
    return _in(order, p)


def _together(nodes: Sequence[Node]) -> list[int]:
    """For each node the one with which it is done: the addition of a product, the first of an angle's sine and cosine."""
    used = [0] * len(nodes)
    for node in nodes:
        for a in node.args:
            used[a] += 1
    lead = list(range(len(nodes)))
    angles: dict[int, int] = {}
    for i, node in enumerate(nodes):
        if node.op in ("sin", "cos"):
            lead[i] = angles.setdefault(node.args[0], i)
        elif node.op in ("add", "sub"):
            product = next((a for a in node.args if nodes[a].op in ("mul", "sq") and used[a] == 1), None)
            if product is not None:
                lead[product] = i
    return lead


def _to_end(nodes: Sequence[Node], takes: dict[int, set[int]], users: dict[int, list[int]]) -> dict[int, int]:
    """Cycles from the start of each to the end of all that depends on it."""
    waiting = {k: len(after) for k, after in users.items()}
    found: dict[int, int] = {}
    last = [k for k, count in waiting.items() if not count]
    while last:
        k = last.pop()
        found[k] = CYCLES.get(nodes[k].op, FEW) + max((found[j] for j in users[k]), default=0)
        for a in takes[k]:
            waiting[a] -= 1
            if not waiting[a]:
                last.append(a)
    return found


def _in(order: Sequence[int], p: Program) -> Program:
    new = {i: k for k, i in enumerate(order)}
    nodes = tuple(p.nodes[i]._replace(args=tuple(new[a] for a in p.nodes[i].args)) for i in order)
    return Program(nodes, tuple(tuple(new[i] for i in output) for output in p.outputs))
