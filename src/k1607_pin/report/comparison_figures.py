"""The comparison of control laws as a table and as a figure."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from k1607_pin.files import write_atomically
from k1607_pin.report.plots import GREEN, GREY, INK, RED
from k1607_pin.report.rows import Row
from k1607_pin.report.runs import write_figure

RATTLE = 0.5  # RMS of the torques' change, over their limits: no gear bears that, though the tool hardly moves


def condition(row: Row) -> str:
    """What a row's law had to bear."""
    return f"{('line', 'circle')[row.case - 1]}, {row.period * 1e3:g} ms, {row.gravity / 9.81:g} g, {row.trouble}"


def best(rows: Iterable[Row]) -> dict[str, list[Row]]:
    """Condition -> the rows of least RMS distance from the path and of up to 2 % more, the first first; none that rattles."""
    held: dict[str, list[Row]] = {}
    for row in rows:
        held.setdefault(condition(row), [])
        if np.isfinite(row.rms) and row.chatter <= RATTLE:
            held[condition(row)].append(row)
    least = {name: min((row.rms for row in those), default=np.inf) for name, those in held.items()}
    return {
        name: sorted((row for row in those if row.rms <= 1.02 * least[name]), key=lambda row: row.rms)
        for name, those in held.items()
    }


def table(rows: Iterable[Row]) -> str:
    """Markdown: RMS distance from the path in mm, a line a condition, a column a law, the `best` of each line in bold.

    With a dagger where the torques rattle: their change from one period to the next is more than `RATTLE`.
    """
    rows = list(rows)
    cells = {(row.law, condition(row)): row for row in rows}
    laws = list(dict.fromkeys(row.law for row in rows))
    lines = ["| path, period, gravity, trouble | " + " | ".join(laws) + " |", "|---" * (len(laws) + 1) + "|"]
    for name, winners in best(rows).items():
        here = (cells.get((law, name)) for law in laws)
        lines.append("| " + " | ".join([name, *(_cell(row, winners) for row in here)]) + " |")
    return "\n".join(lines)


def _cell(row: Row | None, winners: list[Row]) -> str:
    if row is None:
        return ""
    text = f"{row.rms * 1e3:.3g}" if np.isfinite(row.rms) else "lost"
    return f"**{text}**" if row in winners else f"{text} †" if row.chatter > RATTLE else text


def write_comparison(out: Path, rows: Sequence[Row]) -> None:
    """Write ``comparison.md``, the table, and ``comparison.png`` and ``.svg`` to ``out``; each file whole or not at all."""
    lead = "RMS distance of the tool from its path, mm; bold: the best within 2 %; †: torques that rattle; lost: it ran away"
    write_atomically(out / "comparison.md", f"# Control laws compared\n\n{lead}.\n\n{table(rows)}\n")
    write_figure(out / "comparison", figure_comparison(rows))


def figure_comparison(rows: Iterable[Row]) -> Figure:
    """A panel for each period and gravity: RMS distance from the path of every law, a colour a trouble, a sign a case."""
    rows = list(rows)
    laws = list(dict.fromkeys(row.law for row in rows))[::-1]
    troubles = list(dict.fromkeys(row.trouble for row in rows))
    panels = list(dict.fromkeys((row.period, row.gravity) for row in rows))
    figure = Figure(
        figsize=(5.0 * min(2, len(panels)) + 1.6, 3.4 * np.ceil(len(panels) / 2) + 0.6), layout="constrained"
    )
    grid = figure.subplots(int(np.ceil(len(panels) / 2)), min(2, len(panels)), squeeze=False, sharey=True)
    colours = dict(zip(troubles, (INK, GREEN, RED, GREY, "#7a5195", "#c9a227"), strict=False))
    for axes, (T, g) in zip(grid.flat, panels, strict=False):
        here = [row for row in rows if (row.period, row.gravity) == (T, g)]
        finite = [row.rms for row in here if np.isfinite(row.rms)]
        edge = 3 * max(finite, default=1e-3) * 1e3
        for row in here:
            y = laws.index(row.law) + 0.16 * (troubles.index(row.trouble) - (len(troubles) - 1) / 2)
            held = np.isfinite(row.rms)
            axes.plot(
                row.rms * 1e3 if held else edge, y, ("o" if row.case == 1 else "s") if held else "x",
                color=colours.get(row.trouble, GREY), ms=4.5, mfc=None if row.case == 1 else "none", ls="none",
            )  # fmt: skip
            if row.chatter > RATTLE:
                axes.annotate("†", (row.rms * 1e3, y), (4, 0), textcoords="offset points", fontsize=8, va="center")
        axes.set(xscale="log", title=f"{T * 1e3:g} ms, {g / 9.81:g} g", xlabel="RMS distance from the path [mm]")
        axes.set_yticks(range(len(laws)), laws)
        axes.grid(True, axis="x", lw=0.3, color="#dddddd")
        axes.spines[["top", "right"]].set_visible(False)
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    handles = [grid.flat[0].plot([], [], "o", color=colours.get(name, GREY), label=name)[0] for name in troubles]
    for sign, words in (("o", "line"), ("s", "circle"), ("x", "lost")):
        face = "none" if sign == "s" else "black"
        handles += grid.flat[0].plot([], [], sign, color="black", mfc=face, ms=4.5, label=words)
    handles += grid.flat[0].plot([], [], ls="none", marker="$†$", color="black", label="torques rattle")
    figure.legend(handles=handles, fontsize=8, ncols=len(handles), loc="outside lower center", frameon=False)
    return figure
