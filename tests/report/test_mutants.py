"""A check earns its place by a mutant that it kills: one formula is made wrong, and the check of its equation has to fail."""

import dataclasses
import importlib

import numpy as np
import pytest

from k1607_pin.control.adaptation import Gains
from k1607_pin.report import equations_jacobian, polynomials, sample, sample_loops
from k1607_pin.report.equations import registry

EQUATIONS = {e.number: e for e in registry()}
SLIGHTLY = 1 + 1e-6
ALL = ...


def changed(out, path, change):
    """A copy of an outcome, one part of it changed: names and indices lead to it, the last index may be that of an array."""
    if not path:
        return change(out)
    key, rest = path[0], path[1:]
    if isinstance(key, str):
        part = changed(getattr(out, key), rest, change)
        return out._replace(**{key: part}) if hasattr(out, "_replace") else dataclasses.replace(out, **{key: part})
    if isinstance(out, list | tuple):
        parts = [changed(x, rest, change) if k == key else x for k, x in enumerate(out)]
        return parts if isinstance(out, list) else type(out)(*parts) if hasattr(out, "_fields") else tuple(parts)
    out = np.array(out)
    out[key] = changed(out[key], rest, change)
    return out


def after(change, *path):
    """A mutant whose outcome, or the part of it that the path leads to, is changed."""
    return lambda right: lambda *a, **k: changed(right(*a, **k), path, change)


def scaled(*path, by=SLIGHTLY):
    """The part a millionth too large."""
    return after(lambda x: by * x, *path)


def shifted(*path):
    """The part off by a thousandth, which tells where it is zero too."""
    return after(lambda x: x + 1e-3, *path)


def turned(*path):
    """The part with the wrong sign."""
    return scaled(*path, by=-1)


def swapped(first, second):
    """Two arguments the wrong way round."""

    def mutant(right):
        def wrong(*a, **k):
            a = list(a)
            a[first], a[second] = a[second], a[first]
            return right(*a, **k)

        return wrong

    return mutant


def transposed(index):
    """An argument transposed."""
    return lambda right: lambda *a, **k: right(*a[:index], a[index].T, *a[index + 1 :], **k)


def unweighted(right):
    return lambda J, W=None, **k: right(J, **k)


def without_weights(right):
    return lambda J, x_dot, z=None, W=None: right(J, x_dot, z)


def without_null_space(right):
    return lambda J, x_dot, z=None, W=None: right(J, x_dot, W=W)


def wrongly_weighted(right):
    return lambda J, W=None: right(J, None if W is None else np.linalg.inv(W))


def moving(name):
    """(68): what is to stand still moves, a thousandth as fast as B_1."""
    return lambda right: lambda *a: (held := right(*a))._replace(**{name: 1e-3 * held.B_1})


def path_with(part, change):
    """A path class whose points have one part changed."""

    def mutant(right):
        class Wrong(right):
            def __call__(self, t):
                return changed(right.__call__(self, t), (part,), lambda x: change(x, t))

        return Wrong

    return mutant


def other_times(k):
    """A circle whose k-th segment ends late."""

    def mutant(right):
        class Wrong(right):
            @property
            def times(self):
                times = list(right.times.fget(self))
                times[k] *= SLIGHTLY
                return tuple(times)

        return Wrong

    return mutant


def segment(k):
    """A circle that runs ahead between two of its times."""

    def ahead(position, t):
        begins, ends = [(0, 1), (1, 9), (9, 10)][k]
        inside = (np.asarray(t) > begins) & (np.asarray(t) < ends)
        return np.where(inside[..., None], position @ np.array([[1, 1e-3, 0], [-1e-3, 1, 0], [0, 0, 1]]), position)

    return path_with("position", ahead)


def cyclic(t):
    """n, s, a as s, a, n: still a rotation."""
    return t[..., [1, 2, 0, 3]]


ADAPTATION = "control.adaptation.gain_rates"
CONJUGATE = np.array([1, -1, -1, -1])

# Equation -> mutants of the function that it names, or of (another function, mutant).
MUTANTS = {
    1: [scaled((ALL, 0, 0)), scaled((ALL, 3, 3)), turned((ALL, 1, 2))],
    2: [scaled((ALL, 0, 3)), scaled((ALL, 1, 3)), turned((ALL, 0, 1)), swapped(0, 1), swapped(4, 5)],
    3: [scaled((ALL, slice(3), 3)), after(lambda T: np.swapaxes(T, -1, -2))],
    4: [after(cyclic), scaled((ALL, 0, 3)), scaled((ALL, slice(3), 0))],
    **{5 + row: [scaled(name, row) for name in "nsap"] for row in range(3)},
    **{8 + k: [m("fghj"[k], i) for i in range(n) for m in (scaled, turned)] for k, n in enumerate((6, 6, 5, 3))},
    12: [scaled((ALL, slice(3), 0)), scaled((ALL, slice(3, 6), 6)), after(lambda J: J[..., [1, 0, 2, 3, 4, 5, 6]])],
    13: [scaled((ALL, slice(3), 2)), after(lambda J: J[..., [3, 4, 5, 0, 1, 2], :])],
    14: [scaled(0, 0), turned(0, 2)],
    15: [scaled(0, 2), after(lambda b: [b[2], b[0], b[1]], 0)],
    16: [scaled(1, 0), turned(1, 1), scaled(1, 2), swapped(0, 1)],
    17: [scaled(1, 0), turned(1, 1), swapped(0, 1)],
    18: [scaled(0, 0), turned(0, 1), scaled(1, 0), scaled(1, 2), turned(1, 3), scaled(0, 5)],
    19: [shifted(i, row) for i in range(2, 7) for row in range(6)],
    20: [scaled((ALL, slice(3), 0)), turned((ALL, 4, 6)), after(lambda J: J[..., [3, 4, 5, 0, 1, 2], :])],
    21: [scaled("velocity"), without_null_space, without_weights, shifted("residual")],
    22: [scaled("matrix"), unweighted, wrongly_weighted],
    23: [scaled("matrix"), turned("matrix")],
    24: [after(lambda q: q * CONJUGATE), scaled((ALL, 0))],
    25: [after(lambda q: q * CONJUGATE), scaled((ALL, 3)), after(lambda q: q[:, [1, 2, 3, 0]])],
    26: [after(lambda q: q * CONJUGATE), scaled((ALL, 0)), scaled((ALL, 2))],
    27: [after(lambda R: np.swapaxes(R, -1, -2)), scaled((ALL, 0, 1))],
    28: [after(lambda R: np.swapaxes(R, -1, -2)), scaled((ALL, 2, 2))],
    29: [after(lambda S: np.swapaxes(S, -1, -2)), scaled((ALL, 0, 1))],
    30: [swapped(0, 1), scaled((ALL, 3))],
    31: [swapped(0, 1), after(lambda q: q * CONJUGATE), scaled((ALL, 1))],
    32: [swapped(0, 1), scaled((ALL, 1))],
    33: [scaled((ALL, 0))],
    34: [swapped(0, 1), scaled((ALL, 1)), scaled((ALL, 3))],
    35: [scaled(), turned((ALL, 1)), scaled((ALL, 2))],
    36: [scaled(), turned((ALL, 1)), scaled((ALL, 2))],
    37: [swapped(0, 1), scaled(), scaled((ALL, 2))],
    38: [swapped(0, 1), scaled((ALL, 0))],
    39: [scaled("Lambda"), scaled("Phi"), scaled("Gamma"), scaled("bias_nullspace"), transposed(1)],
    40: [scaled(), lambda right: lambda gains, e, v: right(Gains(*gains[::-1]), e, v), swapped(1, 2)],
    41: [scaled(slice(3)), scaled(slice(3, 6)), turned(slice(3, 6)), swapped(1, 3)],
    42: [scaled(f"B_{k}") for k in (1, 2, 3, 4)],
    43: [scaled(0, (ALL, slice(6), slice(6, 12))), after(lambda A: A + np.eye(12, dtype=int), 0)],
    44: [scaled(0, (ALL, slice(6), slice(6, 12))), turned(0, (ALL, slice(6, 12), slice(12))), scaled(1, (ALL, 11, 17))],
    45: [scaled("B_1"), scaled("B_2"), swapped(3, 4)],
    46: [scaled("B_3"), scaled("B_4"), swapped(1, 2)],
    47: [scaled(1, (ALL, slice(12), slice(k, k + 6))) for k in (0, 6, 12)],
    48: [scaled("Delta"), scaled("Delta", (11, 5)), scaled("Delta", (6, 6))],
    49: [scaled((k,)) for k in range(6)],
    50: [scaled("Delta"), scaled("Delta", (6, 0)), scaled("Delta", (11, 11))],
    51: [scaled("Delta", (slice(6), slice(6, 12)))],
    52: [scaled("Delta", (slice(6), slice(6, 12))), scaled("Delta", (6, 0))],
    53: [scaled("Delta"), scaled("Delta", (11, 11))],
    54: [scaled(), turned(), scaled((ALL, slice(6)))],
    55: [scaled(), scaled((ALL, slice(6, 12)))],
    56: [scaled("state"), *(scaled(f"B_{k}") for k in (1, 2, 3, 4))],
    57: [
        scaled(name)
        for name in ("claimed", "gains", "driven_position", "driven_velocity", "driven_acceleration", "variation", "weights")
    ],
    58: [scaled(), turned(), transposed(0)],
    59: [scaled("P", (slice(6), slice(6, 12))), scaled("P", (slice(6, 12), slice(6, 12)))],
    60: [scaled("P"), scaled("P", (0, 0)), scaled("P", (11, 0)), lambda right: lambda a, b, Q: right(a, b)],
    61: [scaled("K_p"), scaled("K_d"), transposed(0), swapped(4, 5)],
    62: [scaled("B_3"), turned("B_4"), scaled("B_4")],
    63: [scaled("claimed"), *(scaled(f"driven_{x}") for x in ("position", "velocity", "acceleration"))],
    64: [scaled("B_1"), scaled("B_2"), turned("B_1")],
    65: [scaled("B_3"), scaled("B_4"), turned("B_4")],
    66: [scaled("B_1"), turned("B_1")],
    67: [scaled("B_2"), turned("B_2")],
    68: [moving("B_3"), moving("B_4")],
    69: [scaled("K_p"), turned("K_p"), transposed(0)],
    70: [scaled("K_d"), turned("K_d"), transposed(0)],
    71: [scaled("B_3"), turned("B_4"), after(lambda B: np.sign(B) * np.sqrt(abs(B)), "B_3")],
    72: [scaled("Psi_1"), turned("Psi_1"), swapped(1, 2)],
    73: [scaled("Psi_2"), turned("Psi_2"), swapped(1, 2)],
    74: [scaled("K_p"), turned("K_p"), transposed(0), swapped(2, 3)],
    75: [scaled("K_d"), turned("K_d"), transposed(0), swapped(2, 3)],
    76: [scaled("K_p"), (ADAPTATION, transposed(0)), (ADAPTATION, scaled("K_p")), lambda right: lambda g, r, T: right(g, r, -T)],
    77: [scaled("K_d"), (ADAPTATION, transposed(0)), (ADAPTATION, scaled("K_d")), lambda right: lambda g, r, T: right(g, r, -T)],
    **{
        78 + axis: [
            path_with("position", lambda x, t, axis=axis: x + 1e-3 * t * np.eye(3)[axis] if np.ndim(t) == 0 else x * SLIGHTLY),
            path_with("velocity", lambda x, t: SLIGHTLY * x),
            path_with("acceleration", lambda x, t: SLIGHTLY * x),
        ]
        for axis in (0, 1)
    },
    80: [path_with(part, lambda x, t: SLIGHTLY * x) for part in ("position", "velocity", "acceleration")],
    **{81 + k: [segment(k), other_times(k)] for k in range(3)},
}  # fmt: skip

CACHED = [
    polynomials.exact,
    sample.terms,
    sample_loops.design,
    sample_loops.general,
    equations_jacobian._well_conditioned,
]
CASES = [(number, k) for number, mutants in MUTANTS.items() for k in range(len(mutants))]


def forget():
    for cached in CACHED:
        cached.cache_clear()


@pytest.fixture(autouse=True)
def nothing_kept():
    forget()
    yield
    forget()


def test_every_equation_has_a_mutant_and_passes_without():
    assert sorted(MUTANTS) == list(EQUATIONS)
    assert all(MUTANTS.values())
    assert [n for n, e in EQUATIONS.items() if not e.residual() <= e.tolerance] == []


@pytest.mark.parametrize(("number", "k"), CASES)
def test_the_check_kills_the_mutant(number, k, monkeypatch):
    equation, mutant = EQUATIONS[number], MUTANTS[number][k]
    where, mutant = mutant if isinstance(mutant, tuple) else (equation.where, mutant)
    module, _, name = f"k1607_pin.{where}".rpartition(".")
    right = getattr(importlib.import_module(module), name)
    monkeypatch.setattr(f"{module}.{name}", mutant(right))
    assert not equation.residual() <= equation.tolerance


def test_what_the_registry_names_is_defined_there_and_is_what_the_laws_call():
    """One definition of each formula: the registry's function is the one that the laws import."""
    named = {}
    for equation in EQUATIONS.values():
        module, _, name = f"k1607_pin.{equation.where}".rpartition(".")
        named[name] = getattr(importlib.import_module(module), name)
        assert named[name].__module__ == module, equation.where
    for law in (
        "adaptation",
        "baselines",
        "cartesian",
        "hybrid_law",
        "joint_space",
        "lyapunov",
        "pose",
        "practice",
        "scheme",
    ):
        law = importlib.import_module(f"k1607_pin.control.{law}")
        assert all(getattr(law, name) is named[name] for name in set(vars(law)) & set(named))
