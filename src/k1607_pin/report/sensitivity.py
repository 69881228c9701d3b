"""Which assumption each of the study cases' 16 numbers hangs on: one changed at a time.

Run: python -m k1607_pin.report.sensitivity        (some 80 rollouts; prints the table of docs/study_cases.md)
"""

from typing import Any

import numpy as np

from k1607_pin import data
from k1607_pin.description.units import INCH
from k1607_pin.report.candidates import Candidates
from k1607_pin.report.cases import as_published
from k1607_pin.report.published_cases import ERRORS, statistic
from k1607_pin.report.unknowns import DURATION, NAMES, UNKNOWNS, values_of
from k1607_pin.simulation.simulate import SimulationError

SHARE = 0.2  # by which a number is changed, up and down
SHIFT = 4.0  # in or degrees, of heights and angles, whose size says nothing

HEADER = [f"{axis} {key.split('_error')[0].replace('_', ' ')}" for key in ERRORS for axis in "xy"]
"""Of the numbers of one case."""


def ratios(choice: dict[str, Any], payload: float | None = None) -> np.ndarray:
    """(16,) ours / published, magnitudes, in the order of `ERRORS`, x before y, case 1 before case 2; NaN where a run is lost."""
    published, out = data.load("published"), []
    for number in (1, 2):
        try:
            run = as_published(number, choice, payload).run()
        except (SimulationError, ValueError):
            out += [np.nan] * 8
            continue
        for key, (variable, kind, _, _) in ERRORS.items():
            for axis in "xy":
                out.append(abs(statistic(run, variable, axis, kind) / INCH / published[f"case{number}"][key][axis]))
    return np.array(out)


def table() -> dict[str, np.ndarray]:
    """Name -> (16,) ratios: "as chosen", "no payload", and each assumption lowered ("-") and raised ("+")."""
    chosen = data.load("study_cases")["report"]
    here, changed = values_of(chosen), {}
    for k, one in enumerate(UNKNOWNS):
        for sign, symbol in ((-1, "-"), (1, "+")):
            values = here.copy()
            values[k] += sign * (SHARE * here[k] if one.log else SHIFT)
            if one.lower <= values[k] <= one.upper:
                changed[f"{one.name} {symbol}"] = values
    values = np.array([here, *changed.values()])
    values[:, DURATION] = np.round(values[:, DURATION])
    found = Candidates(chosen)(values).ratios
    return {"as chosen": found[0], "no payload": ratios(chosen, 0.0)} | dict(zip(changed, found[1:], strict=True))


def rests_on(rows: dict[str, np.ndarray], move: float = 0.1) -> list[str]:
    """(16,) the assumptions that move each number by more than ``move`` of itself, strongest first, and what loses the run."""
    base, moves = rows["as chosen"], {}
    for name in NAMES:
        changes = [np.abs(np.log(rows[f"{name} {s}"] / base)) for s in "-+" if f"{name} {s}" in rows]
        moves[name] = np.max([np.nan_to_num(change) for change in changes], axis=0) if changes else 0 * base
    out = []
    for k in range(len(base)):
        strong = sorted((name for name in moves if moves[name][k] > move), key=lambda name: -moves[name][k])
        lost = [name for name, row in rows.items() if np.isnan(row[k])]
        out.append((", ".join(strong) or "none by itself") + (f"; lost with {', '.join(lost)}" if lost else ""))
    return out


if __name__ == "__main__":
    rows = table()
    for case in (1, 2):
        print(f"\nCase {case}\n\n| | {' | '.join(HEADER)} |\n{'|---' * (len(HEADER) + 1)}|")
        for name, row in rows.items():
            cells = ["lost" if np.isnan(x) else f"{x:.2f}" for x in row[8 * (case - 1) : 8 * case]]
            print(f"| {name} | " + " | ".join(cells) + " |")
    print("\n[report.rests_on]")
    keys = [f"case{n}_{key}_{axis}" for n in (1, 2) for key in ERRORS for axis in "xy"]
    for key, text in zip(keys, rests_on(rows), strict=True):
        print(f'{key} = "{text}"')
