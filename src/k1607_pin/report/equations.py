"""The registry of the report's numbered equations: what each says, where it runs, how it is checked, and the verdict."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

EXACT = "polynomial identity, exact"


@dataclass(frozen=True)
class Equation:
    """One numbered equation and its check; residuals are computed when asked for, never stored."""

    number: int
    says: str
    """In words."""
    where: str
    """The function or attribute that implements it, below ``k1607_pin``."""
    how: str
    """What it is checked against."""
    residual: Callable[[], float]
    """Largest deviation of the implemented (where misprinted: corrected) form from an independent source."""
    tolerance: float
    """What rounding, or the order of an approximation, allows."""
    definition: bool = False
    """It introduces a notation or quantity and claims nothing; the residual checks the implementation alone."""
    printed: Callable[[], float] | None = None
    """Largest deviation of the form as transcribed, where it differs."""
    lost: bool = False
    """The transcription has lost it altogether: nothing printed to evaluate."""
    proof: Callable[[], bool] | None = None
    """Exact proof of the implemented form, where there is one."""
    note: str = ""
    """What was mended, and other remarks."""
    gap: str = ""
    """What the report's argument lacks here; ``printed`` then says by how much, and it is no printer's mistake."""
    slip: bool = False
    """``printed`` shows a printer's mistake all the same; the gap is in what is made of the equation."""


@dataclass(frozen=True)
class Checked:
    """An equation after its check has run."""

    number: int
    says: str
    where: str
    how: str
    verdict: str
    """holds | definition | misprint | gap | fails"""
    residual: float
    tolerance: float
    printed_residual: float | None
    """Of the form as transcribed; None where it is the same, or lost."""
    exact: bool | None
    """Outcome of the exact proof; None where there is none."""
    note: str
    gap: str


def check(equation: Equation) -> Checked:
    """Run one equation's check. The verdict follows from the residuals:

    fails: the implemented form misses its tolerance, or its exact proof fails; misprint: it holds but the transcribed form
    misses the tolerance, or is lost; gap: the same, but what is missing is missing from the argument, not from the print;
    definition and holds: as they say.
    """
    residual = float(equation.residual())
    printed = None if equation.printed is None else float(equation.printed())
    exact = None if equation.proof is None else bool(equation.proof())
    if not residual <= equation.tolerance or exact is False:
        verdict = "fails"
    elif equation.lost or (printed is not None and not printed <= equation.tolerance):
        verdict = "gap" if equation.gap and not equation.slip else "misprint"
    else:
        verdict = "definition" if equation.definition else "holds"
    return Checked(
        equation.number,
        equation.says,
        equation.where,
        equation.how + (f"; {EXACT}" if exact else ""),
        verdict,
        residual,
        equation.tolerance,
        printed,
        exact,
        equation.note,
        equation.gap,
    )


def registry() -> list[Equation]:
    """All equations, (1)-(83), by number."""
    from k1607_pin.report import (
        equations_adaptation,
        equations_dynamics,
        equations_jacobian,
        equations_kinematics,
        equations_orientation,
        equations_paths,
        equations_reference_model,
        equations_stability,
    )

    return [
        *equations_kinematics.EQUATIONS,
        *equations_jacobian.EQUATIONS,
        *equations_orientation.EQUATIONS,
        *equations_dynamics.EQUATIONS,
        *equations_reference_model.EQUATIONS,
        *equations_stability.EQUATIONS,
        *equations_adaptation.EQUATIONS,
        *equations_paths.EQUATIONS,
    ]


def check_all(numbers: Iterable[int] = ()) -> list[Checked]:
    """Check the equations of the given numbers, all when there are none.

    Raises
    ------
    ValueError
        A number that is not in the registry.
    """
    known = {equation.number: equation for equation in registry()}
    wanted = list(numbers) or list(known)
    if unknown := [n for n in wanted if n not in known]:
        raise ValueError(f"equation {unknown[0]}: expected a number from {min(known)} to {max(known)}")
    return [check(known[n]) for n in wanted]
