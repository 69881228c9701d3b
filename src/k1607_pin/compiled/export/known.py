"""What is known of an exported function: more cases than were visited, and how close to them its C can be expected to come."""

import numpy as np

from k1607_pin.compiled.export.function import Case, Function, fields
from k1607_pin.compiled.interpreted import function_of
from k1607_pin.compiled.program import Program
from k1607_pin.compiled.tracer import TracingError

DRAWN, TRIED = 20, 600
"""Cases at arguments that are drawn, beside those visited, and of how many they are chosen"""
FAR, FIXED, CLOSEST = (-2.0, -0.3), (-4.0, -2.0), 1e-6
"""Exponents of ten of how far from those given, as a share of their size; of parameters; and where they are close"""
ALONE = 0.3  # share of those where but one number of an argument is far
CHOICES = ("if_else_zero", "fmin", "fmax")
ULP = np.finfo(float).eps
CLOSE, FARTHEST = 1e-11, 1e-9
"""Tolerance where rounding is not larger; and what no rounding excuses"""
ROUNDINGS = 100.0
"""So many times the change that the last place of the arguments makes"""
SHARE, NOTHING = 1e-3, 1e-9
"""An entry is measured by its largest number, or by this of the largest of all entries, of which it may be a difference; and
what is nothing but rounding"""


def completed(f: Function) -> Function:
    """With `DRAWN` more cases, and tolerances.

    The cases visited are known from Pinocchio or from the controller on numbers, and reach little of what there is: one mode, one
    payload. At the others, drawn about these, C is held against the program's own evaluation, which those have proved.

    Raises
    ------
    TracingError
        The program gives something else than is known: not all that traces is what it was.
    """
    given, expected = (np.array([case[k] for case in f.cases]) for k in (0, 1))
    rng = np.random.default_rng(2)
    drawn = _drawn(f, given, rng)
    drawn = drawn[np.isfinite(_evaluated(f, drawn)).all(axis=1)]
    drawn = drawn[_telling(_conditions(f, drawn), DRAWN)]
    found = _evaluated(f, drawn)
    known = np.concatenate([expected, found])
    rounding = _rounding(f, np.concatenate([given, drawn]), rng)
    off = np.abs(_evaluated(f, given) - expected)
    tolerances, first = [], 0
    for _, field in fields(f.outputs):
        here = slice(first, first := first + field.size)
        scale = scale_of(known[:, here])
        tolerance = max(CLOSE, ROUNDINGS * float(np.max(rounding[:, here] / scale, initial=0.0)))
        if not np.max(off[:, here] / scale, initial=0.0) <= max(FARTHEST, tolerance):
            raise TracingError(
                f"{f.name} gives another {field.name} than on numbers, {np.max(off[:, here]):.2g} apart. A Python condition, "
                "something random or remembered, or a state that is no number does not trace"
            )
        tolerances.append(max(tolerance, 10 * float(np.max(off[:, here] / scale, initial=0.0))))
    cases = [*f.cases, *(Case(x, y) for x, y in zip(drawn, found, strict=True))]
    return f._replace(cases=cases, tolerances=tuple(tolerances))


def _drawn(f: Function, given: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(TRIED, numbers) about those given, some of the arguments close to them, the others not."""
    spread, first = np.zeros((TRIED, given.shape[1])), 0
    for struct, field in fields(f.inputs):
        here = slice(first, first := first + field.size)
        largest = np.abs(given[:, here]).max(axis=0, initial=0.0)
        size = np.maximum(largest, 1e-3 * largest.max()) if largest.any() else np.ones(field.size)
        far = FIXED if struct and struct.name == "parameters" else FAR  # K(0) is to stay positive definite
        close = rng.random((TRIED, 1)) < np.linspace(0, 1, TRIED)[:, None]
        alone = rng.random((TRIED, 1)) < ALONE
        others = alone & (np.arange(field.size) != rng.integers(field.size, size=(TRIED, 1)))
        spread[:, here] = np.where(close | others, CLOSEST, 10.0 ** rng.uniform(*far, (TRIED, 1))) * size
    return given[rng.integers(len(given), size=TRIED)] + spread * rng.normal(size=spread.shape)


def _conditions(f: Function, given: np.ndarray) -> np.ndarray:
    """(cases, conditions) whether each condition of the program, those of minima and maxima included, is met."""
    nodes = f.program.nodes
    asked = [
        (node.args[0], node.args[1] if node.op != "if_else_zero" else None) for node in nodes if node.op in CHOICES
    ]
    if not asked:
        return np.zeros((len(given), 0), dtype=bool)
    of = f._replace(
        program=Program(nodes, (tuple(a for a, _ in asked), tuple(a if b is None else b for a, b in asked)))
    )
    left, right = np.split(_evaluated(of, given), 2, axis=1)
    return np.where([b is None for _, b in asked], left != 0, left < right)


def _telling(met: np.ndarray, count: int) -> np.ndarray:
    """(count,) which cases, so that as many pairs of conditions as can be are met in all ways; without conditions the first."""
    literals = np.concatenate([met, ~met], axis=1)
    new = np.ones((literals.shape[1],) * 2)
    chosen: list[int] = []
    for _ in range(min(count, len(met))):
        gain = np.einsum("ki,ij,kj->k", literals, new, literals, optimize=True)
        gain[chosen] = -1
        best = int(np.argmax(gain))
        chosen.append(best)
        new[np.ix_(literals[best], literals[best])] = 0.0
    return np.array(chosen, dtype=int)


def scale_of(known: np.ndarray) -> np.ndarray:
    """(entries,) by which a difference is measured, of (cases, entries) numbers; what is nothing but rounding has no scale."""
    largest = np.abs(known).max(axis=0)
    if not largest.size or largest.max() <= NOTHING:
        return np.ones(largest.size)
    return np.maximum(largest, SHARE * largest.max())


def _rounding(f: Function, given: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(cases, numbers) by which results change with the last place of the arguments."""
    there = _evaluated(f, given)
    nearby = (_evaluated(f, given * (1 + ULP * rng.choice([-1, 1], given.shape))) for _ in range(4))
    return np.max([np.abs(x - there) for x in nearby], axis=0)


def _evaluated(f: Function, given: np.ndarray) -> np.ndarray:
    """(cases, numbers) of the program, by CasADi's own evaluation."""
    names = [str(k) for k in range(len(list(fields(f.inputs))))]
    run, taken = function_of("f", f.program, names)
    parts = np.split(given, np.cumsum([x.size for _, x in fields(f.inputs)])[:-1], axis=1)
    takes = [x.T[: run.size1_in(k)] if names[k] in taken else np.zeros((1, len(given))) for k, x in enumerate(parts)]
    found = run.map(len(given))(*takes)
    return np.concatenate([x.full().T for x in (found if isinstance(found, tuple) else (found,))], axis=1)
