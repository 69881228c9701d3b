"""Where the sampled Cartesian scheme stops being stable: control period against gain, and against beta."""

from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from k1607_pin.arm.arm import Arm
from k1607_pin.arm.payload import Payload
from k1607_pin.compiled.rollout import rollout
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.reference_model import ReferenceModel
from k1607_pin.description.units import INCH
from k1607_pin.paths.report_paths import Line
from k1607_pin.simulation.integrators import runge_kutta_4

LONGEST_STEP = (
    2.5e-3  # s, of the physics, by Runge-Kutta: what is lost is lost to the sampling and not to the integrator
)
LOST = 0.25  # m: a tool this far off its path is not controlled, whether or not the numbers have run away yet
SIGNALS = {
    "distance": lambda log: np.sqrt(np.sum(log["error"][:3] ** 2)),
    "lost": lambda log: np.where(log["distance"] > LOST, log["t"], np.inf),  # s, of the samples where it is
}
FEW = 12  # values along an axis: crosses where it is lost
TICKS = 8  # values along an axis: as many ticks


def stability_map(
    arm: Arm,
    q0: np.ndarray,
    model: ReferenceModel,
    periods: Sequence[float],
    omegas: Sequence[float],
    betas: Sequence[float],
    duration: float = 1.2,
    payload: float = 4.536,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Runs of case 1's line from q0 (n,), a payload [kg] in the middle third, over control periods [s], gains and beta.

    Gains: K_p(0) = omega^2 Lambda(q0), K_d(0) = 2 omega Lambda(q0); ``betas``: beta_1 = beta_2. Without adaptation, and while
    Lambda changes little, the error obeys x'' = -omega^2 x - 2 omega x' with the right side held for T: stable for omega T < 1.

    ``progress`` is told the share done, 0 to 1, before each period.

    Returns
    -------
    Dataset over ``period`` s, ``omega`` 1/s, ``beta``: ``rms`` m, of the distance from the path, infinite where the loop was
    lost (the arm ran away, or the tool came further than `LOST` off its path); ``lost_at`` s, NaN where it was not.
    """
    start = arm.forward_kinematics(q0)
    path = Line(start.translation)
    shape = (len(periods), len(omegas), len(betas))
    rms, lost_at = np.full(shape, np.inf), np.full(shape, np.nan)
    unit = gains_from_inertia(arm, q0, 1.0)
    omega, beta = (x.ravel() for x in np.meshgrid(omegas, betas, indexing="ij"))
    vary = {
        "controller.gains.K_p": omega[:, None, None] ** 2 * unit.K_p,
        "controller.gains.K_d": omega[:, None, None] * unit.K_d,
        "controller.beta_1": beta,
        "controller.beta_2": beta,
    }
    for i, T in enumerate(periods):
        if progress:
            progress(i / len(periods))
        samples = max(3, round(duration / T))
        law = CartesianAdaptive(arm, path, start.rotation, unit, model, 0.0, 0.0, T)
        run = rollout(
            arm,
            law,
            q0,
            samples * T,
            control_period=T,
            physics_step=T / np.ceil(T / LONGEST_STEP - 1e-9),
            step=runge_kutta_4,
            payloads=[(samples // 3 * T, Payload(payload)), (2 * samples // 3 * T, Payload(0.0))],
            vary=vary,
            signals=SIGNALS,
            metrics={"distance": "rms", "lost": "min"},
        )
        off = np.fmin(run.failed_at, np.where(np.isfinite(run.lost_min), run.lost_min, np.nan))
        rms[i] = np.where(np.isnan(off), run.distance_rms, np.inf).reshape(shape[1:])
        lost_at[i] = off.values.reshape(shape[1:])
    return xr.Dataset(
        {
            "rms": (("period", "omega", "beta"), rms, {"units": "m"}),
            "lost_at": (("period", "omega", "beta"), lost_at, {"units": "s"}),
        },
        coords={
            "period": ("period", list(periods), {"units": "s"}),
            "omega": ("omega", list(omegas), {"units": "1/s"}),
            "beta": ("beta", list(betas), {"units": ""}),
        },
    )


def figure_stability(result: xr.Dataset) -> Figure:
    """One panel a beta: RMS error over control period and gain, crosses where the loop is lost, and the line omega T = 1."""
    figure = Figure(figsize=(4.4 * result.sizes["beta"] + 1.0, 4.2), layout="constrained")
    finite = result.rms.values[np.isfinite(result.rms.values)] / INCH
    norm = LogNorm(finite.min(), finite.max()) if finite.size else None
    panels = figure.subplots(1, result.sizes["beta"], squeeze=False, sharey=True)[0]
    periods, omegas = result.period.values * 1e3, result.omega.values
    for axes, beta in zip(panels, result.beta.values, strict=True):
        rms = result.rms.sel(beta=beta).values.T / INCH
        axes.set_facecolor("#ead9d6")
        mesh = axes.pcolormesh(periods, omegas, np.where(np.isfinite(rms), rms, np.nan), norm=norm, cmap="viridis_r")
        lost = np.argwhere(~np.isfinite(rms)) if max(rms.shape) <= FEW else np.empty((0, 2), int)
        axes.plot(periods[lost[:, 1]], omegas[lost[:, 0]], "x", color="#b3261e", ms=6, mew=1.6, ls="none")
        axes.plot(periods, 1e3 / periods, color="black", lw=1.4, label=r"theory: $\omega T = 1$")
        axes.fill_between([], [], color="#ead9d6", label="lost")
        axes.set(xscale="log", yscale="log", xlabel="control period T [ms]", title=rf"$\beta$ = {beta:g}")
        if len(omegas) <= FEW:
            axes.set_ylim(omegas.min() / 1.3, omegas.max() * 1.3)
        else:
            axes.set_ylim(omegas.min(), omegas.max())
        ticks = periods if len(periods) <= TICKS else np.array([1, 2, 5, 10, 20, 50, 100.0])
        ticks = ticks[(ticks >= periods.min()) & (ticks <= periods.max())]
        axes.set_xticks(ticks, [f"{T:g}" for T in ticks], minor=False)
        axes.set_xticks([], minor=True)
    panels[0].set_ylabel(r"gain: $\omega$ of $K_p = \omega^2 \Lambda$, $K_d = 2\omega\Lambda$ [1/s]")
    panels[0].legend(fontsize=8, loc="lower left")
    if finite.size:
        figure.colorbar(mesh, ax=list(panels), label="RMS distance from the path [in]")
    figure.suptitle("Where the sampled scheme stops being stable", fontsize=11)
    return figure
