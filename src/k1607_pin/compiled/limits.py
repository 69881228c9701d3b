"""How large things may be, and what the message says of those that are larger."""

from typing import Any

from k1607_pin.compiled.nest import TracingError

MOST_STATE, MOST_OPERATIONS = 4096, 60_000
"""Numbers of a state, and operations of a program: a compiler takes a minute for as many, and far longer for more"""
AT_ONCE = 4 * 2**30
"""Bytes that one call may take for what goes in and comes out"""
GIB = 2**30


def require_state(name: str, state: Any) -> None:
    """Refuse a state, by its `Layout`, of more than `MOST_STATE` numbers.

    Raises
    ------
    TracingError
        It says how many there are.
    """
    if state.size > MOST_STATE:
        raise TracingError(
            f"{name}: expected at most {MOST_STATE:,} numbers of state, got {state.size:,}; simulate takes any"
        )


def require_operations(name: str, count: int) -> None:
    """Refuse a program of more than `MOST_OPERATIONS` operations.

    Raises
    ------
    TracingError
        It says how many there are.
    """
    if count > MOST_OPERATIONS:
        raise TracingError(
            f"{name}: expected at most {MOST_OPERATIONS:,} operations, got {count:,}, which a compiler would take minutes for; a "
            "loop is traced as often as it runs: write it with arrays, or shorter; simulate takes any"
        )


def require_rollouts(count: int, each: int) -> None:
    """Refuse more rollouts at once, of so many bytes each, than fit into `AT_ONCE`, by a `ValueError` that says how many do."""
    if count * each > AT_ONCE:
        raise ValueError(
            f"q0, vary: expected at most {AT_ONCE // each:,} rollouts at once, {AT_ONCE / GIB:.0f} GiB, got {count:,} of "
            f"{count * each / GIB:.1f} GiB; sweep(run, Listed(...), store=...) takes any number, in chunks"
        )


def require_steps(samples: int, substeps: int, size: int) -> None:
    """Refuse, by a `ValueError`, times and functions of time, ``size`` numbers in all, that do not fit into `AT_ONCE`."""
    if 8 * size > AT_ONCE:
        raise ValueError(
            f"duration, physics_step: expected at most {AT_ONCE / GIB:.0f} GiB of times and functions of time, got "
            f"{8 * size / GIB:.1f} GiB for {samples:,} periods of {substeps:,} steps; simulate takes any"
        )


def require_states(count: int, needed: int) -> None:
    """Refuse, by a `ValueError`, states of a batch that take more bytes, with their results, than `AT_ONCE`."""
    if needed > AT_ONCE:
        raise ValueError(
            f"expected at most {AT_ONCE / GIB:.0f} GiB at once, got {count} states of {needed / GIB:.1f} GiB with their results: "
            "call it on parts of them, or with memory of your own, out=f.empty(count)"
        )
