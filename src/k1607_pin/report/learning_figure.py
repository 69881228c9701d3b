"""What learning earns and where it loses the loop, over its rate, for laws and cases of docs/comparison.md and study_cases.md.

Run: python -m k1607_pin.report.learning_figure docs        (writes learning.png, prints the tables of the two pages)
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

from k1607_pin.report.cases import StudyCase, study_case
from k1607_pin.report.learning import FACTORS, compared, holding, learning_curve, learning_rate, load_of
from k1607_pin.report.plots import GREEN, INK, RED
from k1607_pin.report.runs import write_figure

ADAPTING = ("Cartesian adaptive + g", "joint adaptive + g", "Slotine-Li")
CELLS = ("case 1, line", "case 2, circle")
SAME = (0.0, 1.0, 10.0, 1e2, 1e3, 1e4, 3e4, 1e5)  # times the recommended beta_1
EQUAL = (1.0, 10.0)  # 1/s, rates at which laws are held against each other
HOLD = 60.0  # s
RECOMMENDED = "recommended settings, 1 kHz, 1 g"
COLOURS = {"Cartesian adaptive + g": "#d98200", "joint adaptive + g": RED, "Slotine-Li": GREEN}


def recommended() -> dict[str, StudyCase]:
    """The study cases with recommended settings: 1 kHz, full gravity, of which the law knows nothing."""
    return {name: study_case(number, "recommended") for number, name in enumerate(CELLS, 1)}


def cells(number: int, duration: float | None = None) -> dict[str, StudyCase]:
    """The learning laws of `compare` at 10 ms in full gravity on a case; with a duration [s], holding still at its start."""
    found = {name: compared(name, number, 0.01) for name in ADAPTING}
    return {name: holding(case, duration) if duration else case for name, case in found.items()}


def at(curve: xr.Dataset, rate: float) -> float:
    """m, the RMS distance at a learning rate [1/s] between those that were run; infinite beyond the last that holds."""
    if rate > curve.holds_to:
        return np.inf
    kept = curve.isel(factor=np.flatnonzero((curve.rate <= curve.holds_to).values))
    return float(np.interp(rate, kept.rate, kept.rms))


def multiples(curves: Mapping[str, xr.Dataset], factors: Sequence[float] = SAME) -> str:
    """Markdown: RMS distance in mm at multiples of the recommended beta_1, and what they take off."""
    lines = ["| beta_1 | " + " | ".join(curves) + " |", "|---" * (len(curves) + 1) + "|"]
    for factor in factors:
        cells = []
        for curve in curves.values():
            none, rms = float(curve.rms[0]), float(curve.rms.sel(factor=factor))
            cells.append(f"{1e3 * rms:.4f} mm, {100 * (1 - rms / none):.1f} % off" if np.isfinite(rms) else "lost")
        lines.append(f"| {f'x {factor:g}' if factor else 'none'} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def summary(curves: Mapping[str, xr.Dataset], rates: Sequence[float] = EQUAL) -> str:
    """Markdown: each law's rate in the comparison, RMS distances in mm without learning, at that rate, at equal rates and at
    best, and the bracket of the rates that lose it."""
    head = [
        "law",
        "its rate here",
        "none",
        "at its rate",
        *(f"at {rate:g} /s" for rate in rates),
        "least",
        "holds to",
        "lost from",
    ]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for name, curve in curves.items():
        kept = curve.rms.where(curve.rate <= curve.holds_to)
        best = int(np.nanargmin(kept.values))
        numbers = [float(curve.rms[0]), at(curve, curve.own), *(at(curve, rate) for rate in rates)]
        cells = [
            name,
            f"{_two(curve.own)} /s",
            *(f"{1e3 * x:.3g}" for x in numbers),
            f"{1e3 * float(kept[best]):.3g} at {_two(float(curve.rate[best]))} /s",
            f"{_two(curve.holds_to)} /s",
            f"{_two(curve.lost_from)} /s",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _two(x: float) -> str:
    """Two digits, without a power of ten."""
    return f"{float(f'{x:.2g}'):g}"


def figure_learning(panels: Mapping[str, Mapping[str, xr.Dataset]]) -> Figure:
    """One panel a condition: RMS distance over learning rate, none at the left; a dot at a law's own rate, a cross where lost."""
    columns = min(len(panels), 2)
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(4.5 * columns + 1.4, 3.9 * rows + 0.4), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes, (title, curves) in zip(grid.flat, panels.items(), strict=False):
        slowest = min(float(curve.rate[1:].min()) for curve in curves.values())
        none = 0.2 * slowest  # where the axis has no learning at all
        for name, curve in curves.items():
            style = {"color": COLOURS.get(name, INK), "ls": "--" if "circle" in name else "-", "label": name}
            _draw(axes, curve, none, style)
        axes.set(xscale="log", yscale="log", xlabel="learning rate [1/s]", ylabel="RMS distance [mm]", title=title)
        axes.axvline(0.5 * slowest, color="#c5ccd3", lw=0.8, ls=":")
        ticks = 10.0 ** np.arange(np.ceil(np.log10(slowest)), 5)
        axes.set_xticks([none, *ticks], ["none", *(f"$10^{{{np.log10(x):.0f}}}$" for x in ticks)])
        axes.set_xticks([], minor=True)
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.grid(which="major", color="#e7ebef", lw=0.7)
        axes.legend(fontsize=8, loc="lower left", frameon=False)
    figure.suptitle("What learning earns. Dot: the rate that was chosen; cross: the first that is lost", fontsize=10)
    return figure


def _draw(axes: Any, curve: xr.Dataset, none: float, style: dict[str, Any]) -> None:
    kept = curve.isel(factor=np.flatnonzero((curve.rate <= curve.holds_to).values))
    x = np.where(kept.rate > 0, kept.rate, none)
    axes.plot(x, 1e3 * kept.rms, lw=1.6, **style)
    axes.plot(curve.own, 1e3 * at(curve, curve.own), "o", color=style["color"], ms=5)
    if np.isfinite(curve.lost_from):
        edge, height = [curve.holds_to, curve.lost_from], 1e3 * float(kept.rms[-1])
        axes.plot(edge, [height, height], ":", color=style["color"], lw=1.2)
        axes.plot(curve.lost_from, height, "x", color=style["color"], ms=8, mew=2)


def swept(case: StudyCase) -> xr.Dataset:
    """The curve of a case, the equal rates and the multiples of the pages among its rates."""
    own = learning_rate(case.law, case.q0, load_of(case.law, case.q0, case.payload))
    return learning_curve(case, np.unique([*FACTORS, *SAME, *(rate / own for rate in EQUAL)]))


def main(folder: str) -> None:
    """Write the figure into a folder and print the tables."""
    cases = {name: swept(case) for name, case in recommended().items()}
    still = {name: swept(holding(case, HOLD)) for name, case in recommended().items()}
    print(f"{multiples(cases)}\n\nholding for {HOLD:g} s\n{multiples(still)}")
    panels = {RECOMMENDED: cases}
    for number, name in enumerate(CELLS, 1):
        panels[f"{name}, 10 ms, 1 g"] = {law: swept(case) for law, case in cells(number).items()}
    panels[f"holding for {HOLD:g} s, 10 ms, 1 g"] = {law: swept(case) for law, case in cells(1, HOLD).items()}
    for title, curves in list(panels.items()):
        print(f"\n{title}\n{summary(curves)}")
    write_figure(Path(folder) / "learning", figure_learning(panels))


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "out")
