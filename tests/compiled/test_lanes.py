"""The kernel's own sine, cosine, exponential and the rest against mpmath's, at every width that this machine has."""

import ctypes
from functools import cache

import mpmath
import numpy as np
import pytest
from scipy.special import erf

from k1607_pin.compiled import build, emit
from k1607_pin.compiled.emit import LIBM
from k1607_pin.compiled.kernel import resource

WIDE = build.compiler()
pytestmark = pytest.mark.skipif(WIDE is None, reason="no C compiler")
HAVE = (
    [WIDE.instructions, "AVX2", "plain"]
    if WIDE and WIDE.instructions == "AVX-512"
    else [WIDE.instructions, "plain"]
    if WIDE
    else []
)
KINDS = list(dict.fromkeys(HAVE))
BINARY = {"fmin", "fmax", "pow", "atan2", "fmod", "hypot", "copysign"}
NAMES = {
    "fabs": "abs", "fmin": "minimum", "fmax": "maximum",
    "pow": "power", "atan2": "arctan2", "asin": "arcsin", "acos": "arccos", "atan": "arctan", "asinh": "arcsinh",
    "acosh": "arccosh", "atanh": "arctanh",
}  # fmt: skip
MP_NAMES = {"pow": "power", "fabs": "fabs", "log": "ln"}
EXACT = {"fabs", "fmin", "fmax", "fmod", "floor", "ceil", "copysign", "sqrt"}  # rounded alike wherever IEEE 754 holds
SPECIAL = np.array([0.0, -0.0, 1.0, -1.0, 1e-300, -1e-300, 1e-8, 710.0, -750.0, 1e300, np.inf, -np.inf, np.nan])


def made(kind):
    command = [*WIDE.command[: -len(build.TARGETS[WIDE.instructions]) or None], *build.TARGETS[kind]]
    return build.Compiler(tuple(command), build.WIDTHS[kind], kind, WIDE.version)


@pytest.fixture(scope="module", params=KINDS)
def functions(request):
    """Each of libm's functions by its lanes: name -> function of two arrays."""
    compiler = made(request.param)
    calls = []
    for f in sorted(LIBM):
        arguments = "*a, *b" if f in BINARY else "*a"
        calls.append(f"void f_{f}(const V *a, const V *b, V *o) {{ (void)b; *o = v_{f}({arguments}); }}")
    text = f"#define W {compiler.lanes}\n{resource('lanes.h')}\n" + "\n".join(calls)
    found = build.library(text, compiler)

    def call(name, x, y):
        W = compiler.lanes
        x, y = (np.concatenate([a, np.ones(-len(a) % W)]) for a in (x, y))
        out = np.empty_like(x)
        for k in range(0, len(x), W):
            getattr(found, f"f_{name}")(*(ctypes.c_void_p(a[k : k + W].ctypes.data) for a in (x, y, out)))
        return out

    return call


@cache
def samples(name):
    """Two arrays of arguments, and what the function gives of them: to half a unit of the last place, on any machine.

    NumPy says what is infinite or no number; its own sines differ from processor to processor, mpmath's do not.
    """
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.normal(size=800), rng.normal(size=800) * 30, rng.uniform(-1, 1, 800) ** 9, SPECIAL])
    if name in ("sin", "cos", "tan"):
        x = np.concatenate([x[np.abs(x) < 1e6], rng.uniform(-1e5, 1e5, 2000), np.arange(-60, 60) * np.pi / 4, [np.nan]])
    y = rng.permutation(x)
    if name == "atan2":  # every pair of the special ones, and about where its pieces meet
        x = np.concatenate([x, np.repeat(SPECIAL, len(SPECIAL)), rng.uniform(0.6, 1.7, 800)])
        y = np.concatenate([y, np.tile(SPECIAL, len(SPECIAL)), rng.choice([1.0, -1.0], 800)])
    fun = erf if name == "erf" else getattr(np, NAMES.get(name, name))
    with np.errstate(all="ignore"):
        out = fun(x, y) if name in BINARY else fun(x)
    if name not in EXACT:
        true = getattr(mpmath, MP_NAMES.get(name, name))
        with mpmath.workprec(120):
            of_two = name in BINARY
            for k in np.flatnonzero(
                np.isfinite(out) & np.isfinite(x) & (x != 0) & (np.isfinite(y) & (y != 0) | (not of_two))
            ):
                value = true(*map(mpmath.mpf, (x[k], y[k]) if of_two else (x[k],)))
                out[k] = np.copysign(float(value), out[k])  # mpmath knows no -0
    return x, y, out


@pytest.mark.parametrize("name", sorted(LIBM))
def test_against_mpmath(functions, name):
    """To 3 units of the last place of the result, 9 for tanh, or of 1 for sine and cosine, whose angle is reduced."""
    x, y, theirs = samples(name)
    ours = functions(name, x, y)[: len(x)]
    np.testing.assert_array_equal(np.isnan(ours), np.isnan(theirs))
    np.testing.assert_array_equal(ours[np.isinf(theirs)], theirs[np.isinf(theirs)])
    if name in ("atan2", "copysign"):
        np.testing.assert_array_equal(np.signbit(ours)[~np.isnan(theirs)], np.signbit(theirs)[~np.isnan(theirs)])
    finite = np.isfinite(theirs)
    scale = np.maximum(np.abs(theirs[finite]), 1.0 if name in ("sin", "cos") else 1e-307)
    off = np.abs(ours[finite] - theirs[finite]) / scale
    assert off.max() <= (9 if name == "tanh" else 3) * np.finfo(float).eps


def test_literals_are_exact():
    for x in (0.1, -1 / 3, 1e-300, np.pi, 5e-324):
        assert float(emit.literal(x)) == x
    assert (emit.literal(np.inf), emit.literal(-np.inf), emit.literal(np.nan)) == ("INFINITY", "-INFINITY", "NAN")
