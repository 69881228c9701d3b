"""What noise does to adapted gains while the arm is only to hold still: ten minutes of the joint-space scheme."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from k1607_pin.arm.arm import Arm
from k1607_pin.control.joint_space import JointAdaptive, gains_from_mass, joint_adaptive, model_from_mass
from k1607_pin.control.practice import AdaptiveState, Practice, filtered
from k1607_pin.paths.report_paths import PathPoint
from k1607_pin.report.noisy import NOISE, Noisy
from k1607_pin.report.stability import LONGEST_STEP
from k1607_pin.simulation.integrators import runge_kutta_4
from k1607_pin.simulation.simulate import SimulationError, simulate

DRIFT_OPTIONS: dict[str, Practice] = {
    "as the report has it": Practice(),
    "gravity": Practice(gravity=True),
    "gravity, leak 0.02 /s": Practice(gravity=True, sigma=0.02),
    "gravity, bound 20 %": Practice(gravity=True, gain_bound=0.2),
    "gravity, dead zone 0.1 mrad": Practice(gravity=True, dead_zone=1e-4),
    "gravity, filter 20 rad/s": Practice(gravity=True, velocity_cutoff=20.0),
}
"""See `gain_drift`."""
LOST = 1.0  # rad: a joint that is to hold still and is this far off is not controlled
Progress = Callable[[float], None]


def gain_drift(
    arm: Arm,
    q: np.ndarray,
    options: Mapping[str, Practice] = DRIFT_OPTIONS,
    duration: float = 600.0,
    period: float = 0.01,
    omega_T: float = 0.15,
    rates: tuple[float, float] = (500.0, 500.0),
    noise: tuple[float, float] = NOISE,
    every: float = 1.0,
    seed: int = 0,
    whole_arm: bool = False,
    progress: Progress | None = None,
) -> xr.Dataset:
    """What becomes of the joint scheme's gains while the arm is only to hold still, with noise in what it measures.

    Parameters
    ----------
    q : (n,) rad; duration, period, every (between samples of the result) : s; omega_T : see `compare`.
    rates : beta_1 and beta_2 as a share of K_p(0), 1/(rad^2 s), see `model_from_mass`; noise : rad, rad/s.
    whole_arm : whether by `simulate`; else the arm is taken as linear about q, M(q) a = tau - g(q), and that is solved exactly
        over each period, which is many times as fast. The noise is the same.
    progress : told the share done, 0 to 1, now and then.

    Returns
    -------
    Dataset over ``option`` and ``time`` s: ``K_p``, ``K_d``, Frobenius norms over those at the start, and ``error`` rad, the
    largest of the joints; NaN from where the loop was lost.

    Raises
    ------
    ValueError
        A duration that is too short for a sample; numbers that make no sense.
    """
    if not 0 < every <= duration < np.inf:
        raise ValueError(f"duration: expected at least {every:g} s, the time between samples, got {duration!r} s")
    omega, ticks, sample = omega_T / period, round(duration / period), round(every / period)
    still = PathPoint(q, np.zeros(arm.n), np.zeros(arm.n))
    gains, model = gains_from_mass(arm, q, omega), model_from_mass(arm, q, omega)
    beta_1, beta_2 = (rate * omega**2 for rate in rates)
    out = np.full((3, len(options), ticks // sample + 1), np.nan)
    for i, practice in enumerate(options.values()):
        law = JointAdaptive(arm, lambda t: still, gains, model, beta_1, beta_2, period, practice)

        def told(share: float, done: int = i) -> None:
            if progress:
                progress((done + share) / len(options))

        history = (_whole if whole_arm else _linear)(law, q, ticks, sample, noise, seed, told)
        out[:, i, : history.shape[1]] = history
    dims = ("option", "time")
    return xr.Dataset(
        {
            "K_p": (dims, out[0], {"units": ""}),
            "K_d": (dims, out[1], {"units": ""}),
            "error": (dims, out[2], {"units": "rad"}),
        },
        coords={"option": list(options), "time": ("time", np.arange(out.shape[2]) * sample * period, {"units": "s"})},
    )


def _linear(
    law: JointAdaptive, q: np.ndarray, ticks: int, sample: int, noise: tuple[float, float], seed: int, told: Progress
) -> np.ndarray:
    """(3, samples until it is lost): norms of K_p and K_d over those at the start, largest error."""
    n, period, practice = law.arm.n, law.period, law.practice
    mobility, held, still = np.linalg.inv(law.arm.mass_matrix(q)), law.arm.gravity_torque(q), np.zeros(n)
    known = held if practice.gravity else still
    rng, x, v, state, history = np.random.default_rng(seed), still, still, AdaptiveState(law.gains, still), []
    for k in range(ticks + 1):
        if k % sample == 0:
            norms = (
                np.linalg.norm(now) / np.linalg.norm(first) for now, first in zip(state.gains, law.gains, strict=True)
            )
            history.append([*norms, np.abs(x).max()])
            told(k / ticks)
        of_x, of_v = rng.normal(size=(2, n)) * np.array(noise)[:, None]
        seen = filtered(state.velocity, v + of_v, period, practice)
        step = joint_adaptive(
            x + of_x, seen, still, still, state.gains, law.model.P_2, law.model.P_3, law.beta_1, law.beta_2, period,
            law.gains, known, practice,
        )  # fmt: skip
        a = mobility @ (step.torque - held)
        x, v, state = x + period * (v + period / 2 * a), v + period * a, AdaptiveState(step.gains, seen)
        if not np.abs(x).max() < LOST:  # NaN included
            break
    return np.transpose(history)


def _whole(
    law: JointAdaptive, q: np.ndarray, ticks: int, sample: int, noise: tuple[float, float], seed: int, told: Progress
) -> np.ndarray:
    """As `_linear`, by `simulate`."""
    period = law.period
    step = period / np.ceil(period / LONGEST_STEP - 1e-9)
    noisy = Noisy(law, period, noise, seed)
    try:
        run = simulate(law.arm, noisy, q, ticks * period, None, period, step, runge_kutta_4, progress=told)
    except SimulationError as error:
        run = error.log
    errors = np.abs(run.q.values - q).max(axis=1)
    held = np.logical_and.accumulate(errors < LOST)
    norms = (np.linalg.norm(run[K].values[held][::sample], axis=(1, 2)) for K in ("K_p", "K_d"))
    return np.array([*(norm / norm[0] for norm in norms), errors[held][::sample]])


def outcome(result: xr.Dataset) -> list[dict[str, Any]]:
    """Of each option, the last that `gain_drift` has: ``K_p``, ``K_d``, ``error_rad``, and ``lost_after_s``, None if held."""
    rows = []
    for option in result.option.values:
        last = result.sel(option=option).dropna("time").isel(time=-1)
        lost = None if last.time == result.time[-1] else float(last.time)
        values = {"K_p": float(last.K_p), "K_d": float(last.K_d), "error_rad": float(last.error)}
        rows.append({"option": str(option), **values, "lost_after_s": lost})
    return rows


def figure_drift(result: xr.Dataset, whole: xr.Dataset | None = None) -> Figure:
    """Norms of K_p and K_d over those at the start, a line an option; those of the whole arm dashed, if there are any."""
    figure = Figure(figsize=(7.2, 5.4), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    for axes, name in zip(panels, ("K_p", "K_d"), strict=True):
        for option in result.option.values:
            (line,) = axes.plot(result.time / 60, result[name].sel(option=option), lw=1.3, label=option)
            if np.isnan(result[name].sel(option=option)[-1]):
                last = int(np.isfinite(result[name].sel(option=option)).sum()) - 1
                axes.plot(result.time[last] / 60, result[name].sel(option=option)[last], "x", color=line.get_color())
            if whole is not None and option in whole.option:
                axes.plot(whole.time / 60, whole[name].sel(option=option), "--", color="black", lw=1.0)
        axes.set_ylabel(f"$|{name}(t)| / |{name}(0)|$")
        axes.margins(x=0)
        axes.spines[["top", "right"]].set_visible(False)
    if whole is not None:
        panels[0].plot([], [], "--", color="black", lw=1.0, label="the same on the whole arm")
    panels[0].plot([], [], "x", color="black", ls="none", label="lost")
    panels[-1].set_xlabel("time [min]")
    figure.legend(
        *panels[0].get_legend_handles_labels(), fontsize=8, ncols=3, loc="outside lower center", frameon=False
    )
    figure.suptitle("Holding still with noisy sensors", fontsize=11)
    return figure
