"""The report's figures 5-8, 10 and 11, drawn as it shows them, and the ones it could not show."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from k1607_pin import data
from k1607_pin.description.units import INCH
from k1607_pin.report import studies
from k1607_pin.report.studies import TestTrajectory

INK, RED, GREY = "#1f3b5c", "#c8501e", "#8a9099"


def figure_5(trajectory: TestTrajectory) -> Figure:
    """Errors of x-axis velocities at 10 ms (solid) and 100 ms (asterisks), in/s."""
    return _error_figure(
        trajectory, "v_x", 1 / INCH, "error of $v_x$ [in/s]", "Figure 5: errors of x-axis velocities", "*"
    )


def figure_6(trajectory: TestTrajectory) -> Figure:
    """Errors of x-axis angular velocities at 10 ms (solid) and 100 ms (dotted), mrad/s."""
    title = "Figure 6: errors of x-axis angular velocities"
    return _error_figure(trajectory, "omega_x", 1e3, r"error of $\omega_x$ [mrad/s]", title, None)


def _error_figure(
    trajectory: TestTrajectory, component: str, scale: float, label: str, title: str, marker: str | None
) -> Figure:
    figure, axes = _axes(title, label)
    fine, coarse = (studies.part_1(trajectory, T).error.sel(component=component) * scale for T in (0.01, 0.1))
    if marker:
        axes.plot(coarse.time, coarse, marker, color=RED, ms=5, label="T = 100 ms")
    else:
        axes.plot(coarse.time, coarse, ":", color=RED, lw=1.6, label="T = 100 ms")
    axes.plot(fine.time, fine, color=INK, lw=1.4, label="T = 10 ms")
    for T, curve, colour in ((10, fine, INK), (100, coarse, RED)):
        largest = float(np.abs(curve).max())
        axes.axhline(largest, color=colour, lw=0.6, ls="--")
        at = (1.005 * trajectory.duration, largest)
        axes.annotate(f"max {largest:.3g} at {T} ms", at, color=colour, fontsize=8, va="center", annotation_clip=False)
    axes.legend(loc="lower right", ncols=2)
    return figure


def figure_7(trajectory: TestTrajectory) -> Figure:
    """Velocities of joint angle 1 at 10 ms: from the pseudo-inverse (asterisks) and true (dotted)."""
    return _joint_figure(trajectory, 0.01, "Figure 7: velocity of joint angle 1, T = 10 ms")


def figure_8(trajectory: TestTrajectory) -> Figure:
    """The same at 100 ms."""
    return _joint_figure(trajectory, 0.1, "Figure 8: velocity of joint angle 1, T = 100 ms")


def _joint_figure(trajectory: TestTrajectory, period: float, title: str) -> Figure:
    figure, axes = _axes(title, r"$\dot\theta_1$ [rad/s]")
    result = studies.part_2(trajectory, period)
    every = max(1, round(0.05 / period))  # an asterisk every 50 ms at least: more would be a band
    axes.plot(
        result.time[::every], result.pseudo_inverse.sel(joint=1)[::every], "*", color=RED, ms=4.5,
        label=r"$\dot\theta_{1J}$, pseudo-inverse",
    )  # fmt: skip
    axes.plot(result.time, result.joint_velocity.sel(joint=1), ":", color=INK, lw=1.6, label=r"$\dot\theta_1$")
    axes.annotate(
        f"largest error {result.attrs['relative_error']:.1%} of the largest speed",
        (0.01, 1.01), xycoords="axes fraction", fontsize=8, color=GREY,
    )  # fmt: skip
    axes.legend(loc="lower right", ncols=2)
    return figure


def figure_10(trajectory: TestTrajectory) -> Figure:
    """Quaternion errors at 10 ms: delta beta (solid), delta gamma (asterisks), thousandths."""
    return _quaternion_figure(trajectory, 0.01, "Figure 10: quaternion errors, T = 10 ms")


def figure_11(trajectory: TestTrajectory) -> Figure:
    """The same at 100 ms."""
    return _quaternion_figure(trajectory, 0.1, "Figure 11: quaternion errors, T = 100 ms")


def _quaternion_figure(trajectory: TestTrajectory, period: float, title: str) -> Figure:
    figure, axes = _axes(title, r"error [10$^{-3}$]")
    error = studies.part_3(trajectory, period).error * 1e3
    every = max(1, round(0.05 / period))
    gamma = error.sel(component="delta_gamma")[::every]
    axes.plot(error.time, error.sel(component="delta_beta"), color=INK, lw=1.4, label=r"$\delta\beta$")
    axes.plot(gamma.time, gamma, "*", color=RED, ms=4.5, label=r"$\delta\gamma$")
    axes.legend(loc="lower right", ncols=2)
    return figure


def figure_sampling(trajectory: TestTrajectory) -> Figure:
    """Largest error against the sampling period, log-log, for every way of differencing: slopes 1 and 2."""
    study = studies.sampling_study(trajectory, np.geomspace(1e-3, 0.2, 24))
    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    styles = {"backward, eq. (35)": (INK, "-"), "backward, rotation vector": ("#6aa6e8", "--"),
              "central, eq. (35)": (RED, "-"), "central, rotation vector": ("#e8b04a", "--")}  # fmt: skip
    facts = data.load("published")["part1"]
    panels = (
        ("v_x", 1 / INCH, "max error of $v_x$ [in/s]", facts["vx_max_error_in_s"]),
        ("omega_x", 1e3, r"max error of $\omega_x$ [mrad/s]", facts["wx_max_error_mrad_s"]),
    )
    for axes, (component, scale, label, published) in zip(figure.subplots(1, 2), panels, strict=True):
        T = study.period * 1e3
        for scheme, (colour, line) in styles.items():
            slope = float(study.slope.sel(scheme=scheme, component=component))
            error = study.error.sel(scheme=scheme, component=component) * scale
            axes.loglog(T, error, line, color=colour, lw=1.6, label=f"{scheme}: slope {slope:.2f}")
        for order, scheme in ((1, "backward, eq. (35)"), (2, "central, eq. (35)")):
            line = study.leading_term.sel(scheme=scheme, component=component) * scale
            text = ("theory: T/2 max|a|, slope 1", "theory: T²/6 max|jerk|, slope 2")[order - 1]
            axes.loglog(T, line, ":", color="black", lw=1.0, label=text)
        axes.plot([10, 100], [published["10ms"], published["100ms"]], "ko", ms=5, mfc="none", label="published")
        axes.axvline(10, color=GREY, lw=0.8, ls=":")
        axes.set(xlabel="sampling period [ms]", ylabel=label, ylim=(None, 2e3))  # room for the legend
        axes.grid(True, which="both", lw=0.3, color="#dddddd")
        axes.legend(fontsize=7.5, loc="upper left")
    figure.suptitle("Error against sampling period: what the report's 'about 10 msec' buys", fontsize=11)
    return figure


FIGURES: dict[str, Callable[[TestTrajectory], Figure]] = {
    "figure-05": figure_5,
    "figure-06": figure_6,
    "figure-07": figure_7,
    "figure-08": figure_8,
    "figure-10": figure_10,
    "figure-11": figure_11,
    "sampling-period": figure_sampling,
}
"""File name -> drawing."""


def _axes(title: str, label: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(7.2, 3.4), layout="constrained")
    axes = figure.subplots()
    axes.set(xlabel="time [s]", ylabel=label)
    axes.margins(x=0)
    axes.set_title(title, fontsize=11, loc="right")
    axes.axhline(0, color=GREY, lw=0.5)
    axes.margins(y=0.3)  # room for the legend below the curves
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes
