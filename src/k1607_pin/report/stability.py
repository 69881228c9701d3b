"""Where the sampled Cartesian scheme stops being stable: control period against gain, and against beta."""

from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from k1607_pin.arm.arm import Arm
from k1607_pin.arm.payload import Payload
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.reference_model import ReferenceModel
from k1607_pin.description.units import INCH
from k1607_pin.paths.report_paths import Line
from k1607_pin.simulation.integrators import runge_kutta_4
from k1607_pin.simulation.simulate import SimulationError, simulate

LONGEST_STEP = (
    2.5e-3  # s, of the physics, by Runge-Kutta: what is lost is lost to the sampling and not to the integrator
)
LOST = 0.25  # m: a tool this far off its path is not controlled, whether or not the numbers have run away yet


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

    Returns
    -------
    Dataset over ``period`` s, ``omega`` 1/s, ``beta``: ``rms`` m, of the distance from the path, infinite where the loop was
    lost (the arm ran away, or the tool came further than `LOST` off its path); ``lost_at`` s, NaN where it was not.
    """
    start = arm.forward_kinematics(q0)
    path = Line(start.translation)
    shape = (len(periods), len(omegas), len(betas))
    rms, lost_at = np.full(shape, np.inf), np.full(shape, np.nan)
    for done, (i, j, k) in enumerate(np.ndindex(shape)):
        if progress:
            progress(done / rms.size)
        T, samples = periods[i], max(3, round(duration / periods[i]))
        law = CartesianAdaptive(
            arm, path, start.rotation, gains_from_inertia(arm, q0, omegas[j]), model, betas[k], betas[k], T
        )
        thirds = [(samples // 3 * T, Payload(payload)), (2 * samples // 3 * T, Payload(0.0))]
        step = T / np.ceil(T / LONGEST_STEP - 1e-9)
        try:
            run = simulate(arm, law, q0, samples * T, None, T, step, runge_kutta_4, payloads=thirds)
        except SimulationError as error:
            lost_at[i, j, k] = error.time
            continue
        distance = np.linalg.norm(run.error.values[:, :3], axis=1)
        if distance.max() > LOST:
            lost_at[i, j, k] = run.time.values[np.argmax(distance > LOST)]
        else:
            rms[i, j, k] = np.sqrt(np.mean(distance**2))
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
        mesh = axes.pcolormesh(periods, omegas, np.where(np.isfinite(rms), rms, np.nan), norm=norm, cmap="viridis_r")
        lost = np.argwhere(~np.isfinite(rms))
        axes.plot(periods[lost[:, 1]], omegas[lost[:, 0]], "x", color="#b3261e", ms=6, mew=1.6, ls="none", label="lost")
        axes.plot(periods, 1e3 / periods, color="black", lw=1.4, label=r"theory: $\omega T = 1$")
        axes.set(xscale="log", yscale="log", xlabel="control period T [ms]", title=rf"$\beta$ = {beta:g}")
        axes.set_ylim(omegas.min() / 1.3, omegas.max() * 1.3)
        axes.set_xticks(periods, [f"{T:g}" for T in periods], minor=False)
        axes.set_xticks([], minor=True)
    panels[0].set_ylabel(r"gain: $\omega$ of $K_p = \omega^2 \Lambda$, $K_d = 2\omega\Lambda$ [1/s]")
    panels[0].legend(fontsize=8, loc="lower left")
    if finite.size:
        figure.colorbar(mesh, ax=list(panels), label="RMS distance from the path [in]")
    figure.suptitle("Where the sampled scheme stops being stable", fontsize=11)
    return figure
