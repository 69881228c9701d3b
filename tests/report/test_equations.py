"""The registry: complete, honest in both directions, and proved where it says so."""

import dataclasses

import numpy as np
import pytest

from k1607_pin.kinematics import closed_form
from k1607_pin.report import equations, equations_jacobian, polynomials, sample
from k1607_pin.report.equations import Equation, check, check_all, registry

MISPRINTS = {5, 8, 9, 10, 16, 18, 28, 35, 36, 44, 48, 52, 53, 58, 59, 72, 73, 74, 75, 76, 77}
LOST = {9, 10}
GAPS = {39, 41, 57, 62, 63, 66, 67, 68, 71}  # the printed form misses for want of an argument
NAMED_ONLY = {56, 76, 77}  # right as they stand; what lacks is in what is made of them


@pytest.fixture(scope="module")
def checked():
    return {c.number: c for c in check_all()}


def test_every_number_from_1_to_83_is_there_once():
    assert [e.number for e in registry()] == list(range(1, 84))


def test_verdicts(checked):
    assert {n for n, c in checked.items() if c.verdict == "misprint"} == MISPRINTS
    assert {n for n, c in checked.items() if c.verdict == "gap"} == GAPS
    assert {n for n, c in checked.items() if c.gap} == GAPS | NAMED_ONLY
    assert all(c.verdict in ("holds", "definition") for n, c in checked.items() if n not in MISPRINTS | GAPS)


def test_a_misprint_and_a_gap_show_both_residuals(checked):
    for n in (MISPRINTS | GAPS) - LOST:
        assert checked[n].printed_residual > 100 * checked[n].tolerance
        assert checked[n].residual <= checked[n].tolerance
    for n in LOST:
        assert checked[n].printed_residual is None


def test_closed_form_and_error_system_are_proved_exactly(checked):
    assert {n for n, c in checked.items() if c.exact} == {5, 6, 7, 8, 9, 10, 11, 18, 19, 44, 55, 57}


def test_where_it_is_implemented_exists():
    import importlib

    for e in registry():
        module, _, name = f"k1607_pin.{e.where}".rpartition(".")
        assert hasattr(importlib.import_module(module), name), e.where


@pytest.mark.parametrize("number", range(1, 84))
def test_every_check_runs_the_function_that_it_names(number, monkeypatch):
    """Break the named function: the check must notice, or it checks something else."""
    (equation,) = [e for e in registry() if e.number == number]
    module, _, name = f"k1607_pin.{equation.where}".rpartition(".")

    def broken(*_, **__):
        raise ZeroDivisionError(f"{equation.where} was called")

    def clear():
        polynomials.exact.cache_clear()
        for cached in (sample.terms, equations_jacobian._well_conditioned):
            cached.cache_clear()

    clear()
    monkeypatch.setattr(f"{module}.{name}", broken)
    try:
        with pytest.raises(ZeroDivisionError):
            check(equation)
    finally:
        monkeypatch.undo()
        clear()


def example(**changes):
    base = Equation(99, "says", "where", "how", residual=lambda: 0.0, tolerance=1e-12)
    return dataclasses.replace(base, **changes)


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({}, "holds"),
        ({"definition": True}, "definition"),
        ({"residual": lambda: 1.0}, "fails"),
        ({"residual": lambda: np.nan}, "fails"),
        ({"definition": True, "residual": lambda: 1.0}, "fails"),
        ({"printed": lambda: 1.0}, "misprint"),
        ({"printed": lambda: 0.0}, "holds"),
        ({"printed": lambda: 1.0, "residual": lambda: 1.0}, "fails"),
        ({"lost": True}, "misprint"),
        ({"printed": lambda: 1.0, "gap": "a term"}, "gap"),
        ({"printed": lambda: 0.0, "gap": "a term"}, "holds"),
        ({"printed": lambda: 1.0, "gap": "a term", "residual": lambda: 1.0}, "fails"),
        ({"gap": "a term", "definition": True}, "definition"),
        ({"proof": lambda: False}, "fails"),
        ({"proof": lambda: True}, "holds"),
    ],
)
def test_the_verdict_follows_from_the_residuals(changes, verdict):
    assert check(example(**changes)).verdict == verdict


def test_a_wrong_closed_form_would_be_noticed(monkeypatch):
    """Turn one sign in the code that is proved: both the exact proof and the numbers must see it."""
    right = closed_form.terms

    def wrong(c, s, parameters):
        t = right(c, s, parameters)
        return t._replace(f=(t.f[0], t.f[1], -t.f[2], *t.f[3:]))

    monkeypatch.setattr(closed_form, "terms", wrong)
    for cached in (polynomials.exact, sample.terms):
        cached.cache_clear()
    try:
        (eight,) = check_all([8])
        assert eight.verdict == "fails"
        assert eight.exact is False
        assert eight.residual > 0.1
    finally:
        monkeypatch.undo()
        for cached in (polynomials.exact, sample.terms):
            cached.cache_clear()


def test_polynomial_identities_know_the_circle():
    e = polynomials.exact()
    assert polynomials.is_identity(e.s[0] ** 2 + e.c[0] ** 2, 1 + 0 * e.s[0])
    assert not polynomials.is_identity(e.s[0] ** 2 + e.c[1] ** 2, 1 + 0 * e.s[0])


def test_unknown_number_is_refused():
    with pytest.raises(ValueError, match="equation 99: expected a number from 1 to 83"):
        equations.check_all([99])
