"""Study cases 1 and 2 with the joint-space scheme, which the report describes and shows no run of."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from k1607_pin.arm.payload import Payload
from k1607_pin.control.practice import OFF, Practice
from k1607_pin.paths.inverse_path import joint_path
from k1607_pin.report import plots
from k1607_pin.report.cases import study_case
from k1607_pin.report.laws import joint_adaptive, setting
from k1607_pin.report.stability import LONGEST_STEP
from k1607_pin.simulation.integrators import runge_kutta_4
from k1607_pin.simulation.plant import Plant
from k1607_pin.simulation.simulate import simulate

OMEGA_T = (
    0.2  # not the laws' 0.35: along the circle M changes threefold, and what is 0.35 for its mean is 1 at the start
)
COLOURS = (plots.INK, plots.RED, plots.GREEN, "#7a5195", "#c9a227", plots.GREY, "#2a9fd6")


def joint_case(
    number: int,
    gravity: float | None = None,
    period: float | None = None,
    practice: Practice = OFF,
    adapting: bool = True,
    omega_T: float = OMEGA_T,
    payload: float | None = None,
    duration: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """The K-1607 along case 1's line or 2's circle by `JointAdaptive`, 10 lb in the hand for the middle third of the time.

    Path, start and payload are those of `study_case` with recommended settings, and joint angles those of `joint_path`.
    K_p(0) = omega^2 M and K_d(0) = 2 omega M, M the harmonic mean along the path.

    Parameters
    ----------
    gravity : m/s^2 downwards; period : s, of control; payload : kg; duration : s. None for the case's own: 9.81, 1 ms, 10 lb.
    practice : options of the scheme, ``Practice(gravity=True)`` say; torques are limited to the arm's, whatever it has of that.
    adapting : False for gains that stay as they begin.
    omega_T : omega times the period; stable below 1.
    progress : told the share done, 0 to 1, now and then.

    Returns
    -------
    Dataset, as of `simulate`, with what `JointAdaptive` logs: ``joint_error`` rad, ``error`` of the tool m, rad, ``K_p``...

    Raises
    ------
    ValueError
        No such case; numbers that make no sense.
    SimulationError
        The loop was lost.
    """
    case = study_case(number, "recommended", payload=payload, gravity=gravity, control_period=period)
    arm, T = case.plant.arm, case.law.period
    duration = case.duration if duration is None else duration
    joints = joint_path(arm, case.law.path, case.q0, duration, case.law.rotation)
    law = joint_adaptive(setting(case, joints, T, omega_T), adapting)
    law = replace(law, practice=replace(practice, torque_limit=arm.effort_limit))
    thirds = [round(k * duration / 3 / T) * T for k in (1, 2)]
    return simulate(
        Plant(arm, torque_limit=arm.effort_limit),
        law,
        case.q0,
        duration,
        control_period=T,
        physics_step=T / np.ceil(T / LONGEST_STEP - 1e-9),
        step=runge_kutta_4,
        payloads=[(thirds[0], case.payload), (thirds[1], Payload(0.0))],
        progress=progress,
    )


def figure_joint_case(run: xr.Dataset, title: str = "") -> Figure:
    """Every joint's error, mrad, and the tool's, mm: desired less actual over time, the payload's time shaded."""
    figure = Figure(figsize=(7.2, 5.2), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    for axes in (above, below):
        plots.shade(axes, run)
        axes.axhline(0, color=plots.GREY, lw=0.5)
        axes.margins(x=0)
        axes.spines[["top", "right"]].set_visible(False)
    for k, colour in enumerate(COLOURS):
        above.plot(run.time, 1e3 * run.joint_error[:, k], color=colour, lw=1.2, label=f"joint {k + 1}")
    for axis, colour in plots.COLOURS.items():
        below.plot(run.time, 1e3 * run.error.sel(direction=axis), color=colour, lw=1.2, label=f"tool, ${axis}$")
    above.set_ylabel("joint error [mrad]")
    below.set(ylabel="tool position error [mm]", xlabel="time [s]")
    above.set_title(title, fontsize=11, loc="right")
    for axes in (above, below):
        axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    return figure
