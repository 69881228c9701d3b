"""Compilers that are asked for arithmetic other than IEEE 754's: with it a check for NaN is gone, and small numbers are zero."""

import os
import shlex
import subprocess
import sys
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path

LOOSE = (
    "-ffast-math", "-Ofast", "-fast", "-funsafe-math-optimizations", "-ffinite-math-only", "-fassociative-math",
    "-freciprocal-math", "-fno-signed-zeros", "-fno-honor-nans", "-fno-honor-infinities", "-fapprox-func",
    "-fsingle-precision-constant", "-mdaz-ftz", "-menable-no-nans", "-menable-no-infs", "-menable-unsafe-fp-math",
)  # fmt: skip
"""Options that change the arithmetic, or that of the whole process by what they link"""
MODELS = ("-ffp-model=", "-fp-model=", "-fdenormal-fp-math=")
STRICT = ("precise", "strict", "source", "consistent", "ieee", "ieee,ieee")
TRIAL = """
#if defined __FAST_MATH__ || (defined __FINITE_MATH_ONLY__ && __FINITE_MATH_ONLY__)
#error "loose arithmetic: __FAST_MATH__ or __FINITE_MATH_ONLY__ is defined, as by -ffast-math"
#endif
#if defined __ASSOCIATIVE_MATH__ || defined __RECIPROCAL_MATH__ || defined __NO_SIGNED_ZEROS__
#error "loose arithmetic: sums in another order, reciprocals or unsigned zeros, as by -funsafe-math-optimizations"
#endif
int is_nan(double x) { return x != x; }
double half(double x) { return x / 2; }
double lost(double x, double y) { return (x + y) - y; }
double over(double x) { return 1 / (0 * x); }
"""
"""C that builds where arithmetic is sound, as far as macros tell"""
_RUN = """
import ctypes, sys
try:
    trial = ctypes.CDLL(sys.argv[1])
except OSError as error:
    print(error)
    sys.exit(3)
for name, count in (("is_nan", 1), ("half", 1), ("lost", 2), ("over", 1)):
    fun = getattr(trial, name)
    fun.argtypes = [ctypes.c_double] * count
    fun.restype = ctypes.c_int if name == "is_nan" else ctypes.c_double
small, tiny = float.fromhex("0x1p-1022"), float.fromhex("0x1p-1074")
for sound, why in (
    (trial.is_nan(float("nan")) == 1, "a check for NaN is compiled away"),
    (trial.half(small) == small / 2 != 0 and 2 * tiny != 0, "denormal numbers are zero"),
    (trial.lost(1.0, 1e17) == 0, "sums are taken in another order"),
    (trial.over(-1.0) == float("-inf"), "zeros have no sign"),
):
    if not sound:
        sys.exit(print(why) or 4)
"""


class LoadError(OSError):
    """A library that was built cannot be loaded from where it is."""


def loose_option(options: Iterable[str]) -> str:
    """The first option that asks for it; "" where there is none."""
    for option, following in pairwise([*options, ""]):
        name, _, model = option.partition("=")
        if option in LOOSE:
            return option
        if f"{name}=" in MODELS and model not in STRICT:
            return option
        if option == "-fp-model" and following not in STRICT:
            return f"{option} {following}"
    return ""


def expanded(options: Iterable[str], deep: int = 0) -> Iterator[str]:
    """Options with those of response files, "@file", in their place, as a compiler reads them.

    Raises
    ------
    ValueError
        A response file that is not there, or cannot be parsed.
    """
    for option in options:
        if not option.startswith("@") or option == "@":
            yield option
            continue
        try:
            inside = shlex.split(Path(option[1:]).read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ValueError(f"{option} cannot be read: {getattr(error, 'strerror', None) or error}") from None
        if deep > 8:
            raise ValueError(f"{option} names itself")
        yield from expanded(inside, deep + 1)


def tried(library: Path) -> str:
    """What is wrong with the arithmetic of `TRIAL` as it was built; "" if nothing is.

    Run in a process of its own: what such a library brings along turns small numbers into zero in the one that loads it.

    Raises
    ------
    LoadError
        It cannot be loaded.
    """
    if not sys.executable or getattr(sys, "frozen", False):  # nothing that would run it
        return ""
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", _RUN, os.fspath(library)],
        stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace",
    )  # fmt: skip
    if done.returncode == 3:
        raise LoadError(done.stdout.strip())
    return (
        "" if done.returncode == 0 else done.stdout.strip() or f"its code ends a process: {done.stderr.strip()[-200:]}"
    )
