"""Plots of a controlled run, one function a figure: desired dashed, actual solid, the payload's time shaded.

``axes_shown`` are the base's axes that are drawn; the report's figures have x and y alone.
"""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from k1607_pin.description.units import INCH

INK, RED, GREEN, GREY = "#1f3b5c", "#c8501e", "#3c8a5a", "#8a9099"
COLOURS = {"x": INK, "y": RED, "z": GREEN}
PAYLOAD = "#f2e3bd"


def time_histories(run: xr.Dataset, title: str = "", axes_shown: str = "xyz") -> Figure:
    """Tool position over time, desired and actual, in; figures 15 and 19."""
    figure, axes = _axes(run, title, "position [in]")
    for name in axes_shown:
        wanted, actual = (run[v].sel(axis=name) / INCH for v in ("wanted_position", "tool_position"))
        axes.plot(run.time, actual, color=COLOURS[name], lw=1.4, label=f"actual ${name}$")
        axes.plot(run.time, wanted, "--", color="black", lw=1.0, label=f"desired ${name}$")
    _legend(axes)
    return figure


def position_errors(run: xr.Dataset, title: str = "", axes_shown: str = "xyz") -> Figure:
    """Desired less actual tool position over time, in; figures 16 and 20."""
    return _errors(run, run.error, title, axes_shown, "error of {}", "position error [in]", "in")


def velocity_errors(run: xr.Dataset, title: str = "", axes_shown: str = "xyz") -> Figure:
    """Desired less actual tool velocity over time, in/s; figures 17 and 21."""
    return _errors(run, run.error_rate, title, axes_shown, r"error of $\dot {}$", "velocity error [in/s]", "in/s")


def tool_path(run: xr.Dataset, title: str = "") -> Figure:
    """The tool's path seen from above, desired and actual, in, and in words how far it is off in z; figures 18 and 22."""
    figure = Figure(figsize=(5.2, 5.0), layout="constrained")
    axes = figure.subplots()
    wanted, actual = (run[name].values[:, :2] / INCH for name in ("wanted_position", "tool_position"))
    carried = run.payload.values > 0
    loaded = np.where(carried[:, None], actual, np.nan)
    axes.plot(*loaded.T, color=PAYLOAD, lw=7, solid_capstyle="butt", label="with payload")
    axes.plot(*actual.T, color=INK, lw=1.6, label="actual")
    axes.plot(*wanted.T, "--", color=RED, lw=1.1, label="desired")
    axes.plot(*actual[0], "o", color=INK, ms=5)
    height = float(np.abs(run.wanted_position.sel(axis="z") - run.tool_position.sel(axis="z")).max()) / INCH
    axes.set(xlabel=f"x [in]; z, which is not seen, is off by up to {height:.3g} in", ylabel="y [in]", aspect="equal")
    axes.set_title(title, fontsize=11, loc="right")
    axes.margins(0.12)
    axes.grid(True, lw=0.3, color="#dddddd")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=8, loc="best")
    return figure


def other_errors(run: xr.Dataset, title: str = "") -> Figure:
    """What the report calls negligible: the error of z, in, and of the orientation, degrees."""
    figure = Figure(figsize=(7.2, 4.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    shade(above, run)
    shade(below, run)
    above.plot(run.time, run.error.sel(direction="z") / INCH, color=GREEN, lw=1.4)
    above.set_ylabel("error of z [in]")
    for direction, colour in zip(("rx", "ry", "rz"), COLOURS.values(), strict=True):
        angle = np.rad2deg(run.error.sel(direction=direction))
        below.plot(run.time, angle, color=colour, lw=1.2, label=f"about {direction[1]}")
    below.set(xlabel="time [s]", ylabel="orientation error [°]")
    for axes in (above, below):
        axes.spines[["top", "right"]].set_visible(False)
        axes.axhline(0, color=GREY, lw=0.5)
        axes.margins(x=0)
    _legend(below)
    above.set_title(title, fontsize=11, loc="right")
    return figure


def gains(run: xr.Dataset, title: str = "") -> Figure:
    """The diagonal of K_p and K_d over time, each as a share of its start."""
    figure = Figure(figsize=(7.2, 4.6), layout="constrained")
    for axes, name in zip(figure.subplots(2, 1, sharex=True), ("K_p", "K_d"), strict=True):
        shade(axes, run)
        diagonal = np.diagonal(run[name].values, axis1=1, axis2=2)
        for k, (direction, colour) in enumerate(zip(("x", "y", "z"), COLOURS.values(), strict=True)):
            start = np.where(diagonal[0] == 0, 1.0, diagonal[0])  # from zero: as they are
            axes.plot(run.time, diagonal[:, k] / start[k], color=colour, lw=1.4, label=f"along {direction}")
            axes.plot(
                run.time, diagonal[:, k + 3] / start[k + 3], ":", color=colour, lw=1.4, label=f"about {direction}"
            )
        axes.set_ylabel(f"diagonal of ${name}(t) / {name}(0)$")
        axes.ticklabel_format(useOffset=False)
        axes.margins(x=0)
        axes.spines[["top", "right"]].set_visible(False)
    axes.set_xlabel("time [s]")
    _legend(axes)
    figure.suptitle(title, fontsize=11, ha="right", x=0.99)
    return figure


def _errors(run: xr.Dataset, error: xr.DataArray, title: str, names: str, label: str, ylabel: str, unit: str) -> Figure:
    figure, axes = _axes(run, title, ylabel)
    for name in names:
        values = error.sel(direction=name).values / INCH
        largest = float(values[np.argmax(np.abs(values))])
        rms = float(np.sqrt((values**2).mean()))
        text = label.format(name if "$" in label else f"${name}$")
        axes.plot(
            run.time, values, color=COLOURS[name], lw=1.3, label=f"{text}: max {largest:.3g}, RMS {rms:.3g} {unit}"
        )
    _legend(axes)
    return figure


def _axes(run: xr.Dataset, title: str, label: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(7.2, 3.4), layout="constrained")
    axes = figure.subplots()
    shade(axes, run)
    axes.set(xlabel="time [s]", ylabel=label)
    axes.set_title(title, fontsize=11, loc="right")
    axes.axhline(0, color=GREY, lw=0.5)
    axes.margins(x=0, y=0.12)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def shade(axes: Any, run: xr.Dataset) -> None:
    """Where the hand carries something."""
    carried = np.concatenate([[False], run.payload.values > 0, [False]])
    edges = np.flatnonzero(np.diff(carried.astype(int)))
    times = np.append(run.time.values, run.time.values[-1])
    for k, (begin, end) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        mass = float(run.payload.values[begin:end].max())
        label = f"payload, up to {mass:.3g} kg" if k == 0 else None
        axes.axvspan(times[begin], times[end], color=PAYLOAD, lw=0, label=label, zorder=0)


def _legend(axes: Any) -> None:
    """Below the plot, where no curve can be hidden by it."""
    longest = max(len(label) for label in axes.get_legend_handles_labels()[1])
    axes.legend(
        fontsize=8, ncols=4 if longest < 26 else 2, loc="upper center", bbox_to_anchor=(0.5, -0.22), frameon=False
    )


def lyapunov_rate(analysis: xr.Dataset, title: str = "") -> Figure:
    """v of (56), and its rate: what (63) leaves of it, -E^T Q E, beside what the proof neglects; magnitudes, log scale."""
    figure = Figure(figsize=(7.2, 5.2), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1, 2))
    shade(above, analysis)
    shade(below, analysis)
    above.plot(analysis.time, analysis.v, color=INK, lw=1.4)
    above.set_ylabel("v [m²]")
    above.set_title(title, fontsize=11, loc="right")
    lines = {
        "v_rate": (INK, "-", "all of v'"),
        "claimed": (RED, "-", "$E^T Q E$, all that (63) leaves"),
        "slow_motion": (GREEN, "--", "neglected: slow motion, (66)-(68)"),
        "driven": ("#7a5195", ":", "neglected: wanted motion, gravity"),
        "disturbance": (GREY, ":", "null space, friction, limits"),
    }
    for name, (colour, style, label) in lines.items():
        size = np.abs(analysis[name].values)
        if np.nanmax(size) > 0:
            below.semilogy(analysis.time, np.where(size > 0, size, np.nan), style, color=colour, lw=1.2, label=label)
    highest = max(float(np.nanmax(np.abs(analysis[name].values))) for name in lines)
    below.set(xlabel="time [s]", ylabel="|terms of v'| [m²/s]", ylim=(1e-12 * highest, 10 * highest))
    for axes in (above, below):
        axes.margins(x=0)
        axes.spines[["top", "right"]].set_visible(False)
    figure.legend(*below.get_legend_handles_labels(), fontsize=8, ncols=3, loc="outside lower center", frameon=False)
    return figure
