"""The identification as a figure: how close the 16 numbers come, and how far each unknown may go.

Run: python -m k1607_pin.report.identification_figure docs        (writes identification.png, prints the table of study_cases.md)
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from k1607_pin import data
from k1607_pin.report.determined import Determined, determined
from k1607_pin.report.plots import GREEN, GREY, INK, RED
from k1607_pin.report.published import WITHIN
from k1607_pin.report.runs import write_figure
from k1607_pin.report.sensitivity import HEADER, ratios
from k1607_pin.report.unknowns import NAMES, UNKNOWNS, values_of

NARROW = 0.10


def figure_identification(choice: dict[str, Any], ours: np.ndarray, ranges: Determined) -> Figure:
    """Dots: ours over published. Bars: each unknown moved alone, with all 16 numbers within 25 %.

    Parameters
    ----------
    choice : table like "report" of `study_cases.toml`; ours : (16,) as of `sensitivity.ratios`; ranges : of that set.
    """
    figure = Figure(figsize=(10.4, 5.2), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.15, 1.3, 0.8))
    _ratios(left, ours)
    values, logs = values_of(choice), np.array([one.log for one in UNKNOWNS])
    scale = np.where(logs, values / 100, 1.0)
    low, high = (ranges.lower - values) / scale, (ranges.upper - values) / scale
    _bars(middle, np.flatnonzero(logs), values, low, high)
    middle.set_xscale("symlog", linthresh=1)
    middle.set(xlim=(-150, 1500), xlabel="change [%]")
    ticks = [-100, -10, -1, 0, 1, 10, 100, 1000]
    middle.set_xticks(ticks, [f"{x:g}" for x in ticks], fontsize=8)
    middle.set_title("each moved alone, 16 within 25 %", fontsize=9, loc="left")
    _bars(right, np.flatnonzero(~logs), values, low, high)
    right.set_xscale("symlog", linthresh=0.1)
    ticks = [-100, -1, 0, 1, 100]
    right.set_xticks(ticks, [f"{x:g}" for x in ticks], fontsize=8)
    right.set(xlim=(-200, 200), xlabel="change [in] or [deg]")
    return figure


def _ratios(axes: Axes, ours: np.ndarray) -> None:
    rows = np.arange(len(ours))
    for share, alpha in ((WITHIN, 0.07), (NARROW, 0.10)):
        axes.axvspan(1 - share, 1 + share, color=INK, alpha=alpha, lw=0)
    axes.axvline(1.0, color=GREY, lw=0.8)
    near = np.abs(ours - 1) <= NARROW
    met = np.abs(ours - 1) <= WITHIN
    for chosen, colour in ((near, GREEN), (met & ~near, INK), (~met, RED)):
        axes.plot(ours[chosen], rows[chosen], "o", color=colour, ms=5)
    axes.axhline(7.5, color=GREY, lw=0.8)
    for case, row in (("line", 0), ("circle", 8)):
        axes.text(
            0.985, row, case, transform=axes.get_yaxis_transform(), fontsize=8, color=GREY, va="center", ha="right"
        )
    axes.set_yticks(rows, HEADER * 2, fontsize=8)
    axes.set(
        ylim=(15.6, -0.6),
        xlabel="ours / published",
        xlim=(min(0.7, ours.min() - 0.03), max(1.3, ours.max() + 0.03)),
    )
    axes.set_title(f"magnitudes: {near.sum()} within 10 %, {met.sum()} within 25 %", fontsize=9, loc="left")


def _bars(axes: Axes, which: np.ndarray, values: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
    for row, k in enumerate(which):
        axes.plot([low[k], high[k]], [row, row], color=INK, lw=5, solid_capstyle="butt", alpha=0.6)
    axes.axvline(0.0, color=GREY, lw=0.5, zorder=0)
    labels = [f"{NAMES[k]}  {values[k]:.4g} {UNKNOWNS[k].unit}".rstrip() for k in which]
    axes.set_yticks(range(len(which)), labels, fontsize=8)
    axes.set_ylim(len(which) - 0.4, -0.6)


def table(choice: dict[str, Any], ranges: Determined) -> str:
    """Markdown: each unknown, its value, and how far it goes alone."""
    lines = ["| | value | from | to | |", "|---|---|---|---|---|"]
    for one, *numbers in zip(UNKNOWNS, values_of(choice), ranges.lower, ranges.upper, strict=True):
        lines.append("| " + " | ".join([one.name, *(f"{x:.4g}" for x in numbers), one.unit]) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    chosen = data.load("study_cases")["report"]
    far = determined(chosen)
    write_figure(Path(sys.argv[1]) / "identification", figure_identification(chosen, ratios(chosen), far), ("png",))
    print(table(chosen, far))
    print(", ".join(f"{a} and {b} ({x:+.2f})" for a, b, x in far.pairs))
