"""Why something traces into something else than it does: what it does when it is asked twice for the same."""

import copy
import random
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from k1607_pin.compiled.leaves import apart
from k1607_pin.compiled.nest import functions_within, is_cached, is_number, is_open, parts, same

AGAIN = 50
"""Times that something is asked for the same: what counts, counts in it"""


def reason(holder: Any, ask: Callable[[Any], Any]) -> str:
    """A sentence on what ``ask`` does, with a copy of ``holder``, that a trace cannot see: {"controller": law}, say."""
    holder = apart(holder)
    try:
        with np.errstate(all="ignore"):
            before = dict(remembered(holder))
            first = apart(ask(holder))
            differs = any(not same(first, ask(holder)) for _ in range(AGAIN))
            after = dict(remembered(holder))
    except Exception:  # at a state that was made up
        differs, before, after = False, {}, {}
    changed = [name for name in after if name not in before or not same(before[name], after[name])]
    if changed:
        return (
            f"It changes its own {', '.join(changed[:MOST])} between calls. What it gives must depend on its arguments only: "
            "return what it must remember as part of the state"
        )
    if differs:
        return (
            "Called twice with the same arguments it returns different results: something in it is random, or remembered outside "
            "of it, in a global variable for example; return what it must remember as part of the state"
        )
    return (
        "A Python condition on what is traced, an error that is caught, or something remembered outside of it does not trace; "
        "use np.where for conditions"
    )


MOST = 5  # names


def remembered(x: Any, path: str = "", seen: set[int] | None = None) -> Iterator[tuple[str, Any]]:
    """Dotted names and copies of all that x holds and that may be another one later: numbers, words, where random numbers are."""
    seen = set() if seen is None else seen
    if is_number(x) or isinstance(x, bool | str | bytes | np.bool_ | np.ndarray):
        yield path, copy.copy(x)
    elif isinstance(x, np.random.Generator):
        yield path, repr(x.bit_generator.state)
    elif isinstance(x, np.random.RandomState | random.Random):
        yield path, repr(x.get_state() if isinstance(x, np.random.RandomState) else x.getstate())
    elif id(x) not in seen:
        seen.add(id(x))
        for name, child in (*(parts(x) or ()), *functions_within(x)):
            if not (is_open(x) and is_cached(x, name)):
                yield from remembered(child, f"{path}.{name}" if path else name, seen)
