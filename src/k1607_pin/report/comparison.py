"""The adaptive schemes beside the textbook's laws: one bandwidth, one arm, one set of troubles; and what noise does to gains.

What is made equal: every law gets the same model (wrong by the same factor where it is wrong), the same path, measurements and
torque limits, and gains for the same closed loop, (D + omega)^2 e = 0 with omega = `OMEGA_T` / T: K_p(0) = omega^2 M and
K_d(0) = 2 omega M for the joints, the same with Lambda at the tool, computed torque and operational space by definition, and
Slotine and Li's law by K_D = omega M and its sliding variable's pole at omega. Rates of adaptation are as in the recommended
settings, carried over to other omega by the errors that they act on, which go as omega^-2.
"""

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, fields, replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import xarray as xr
from matplotlib.figure import Figure

from k1607_pin import data
from k1607_pin.arm.arm import Arm
from k1607_pin.arm.payload import Payload
from k1607_pin.control.baselines import ComputedTorque, GravityPD, OperationalSpaceControl, SlotineLi, parameter_rates
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.joint_space import JointAdaptive, gains_from_mass, joint_adaptive, model_from_mass
from k1607_pin.control.posture import Posture
from k1607_pin.control.practice import AdaptiveState, Practice, filtered
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.inverse_path import JointPath, joint_path
from k1607_pin.report.cases import StudyCase, study_case
from k1607_pin.report.plots import GREEN, GREY, INK, RED
from k1607_pin.report.stability import LONGEST_STEP, LOST
from k1607_pin.simulation.integrators import runge_kutta_4
from k1607_pin.simulation.plant import Plant
from k1607_pin.simulation.simulate import Controller, SimulationError, simulate

OMEGA_T = 0.35  # as in the recommended settings, of the 1 that is stable
LEARNING = 0.1  # of omega: Slotine and Li's rate
RATTLE = 0.5  # RMS of the torques' change, over their limits: no gear bears that, though the tool hardly moves
LEAK = 5.0  # 1/s, of the gains towards their start
FITTED = 20  # postures of the path that gains are made for
NOISE = (2e-5, 2e-3)  # rad, an encoder of 18 bits; rad/s (assumed)


@dataclass(frozen=True)
class Trouble:
    """What a run is made difficult by, beside the payload."""

    name: str
    model: float = 1.0
    """What the masses and inertias that a law is told are multiplied by; rotors excepted"""
    noise: tuple[float, float] = (0.0, 0.0)
    """Standard deviation of measured q [rad] and v [rad/s]"""


TROUBLES = (
    Trouble("payload"),
    Trouble("model -30 %", model=0.7),
    Trouble("model +30 %", model=1.3),
    Trouble("noise", noise=NOISE),
)


@dataclass(frozen=True)
class Row:
    """One run's outcome."""

    law: str
    case: int
    period: float
    """s"""
    gravity: float
    """m/s^2"""
    trouble: str
    rms: float
    """m, of the tool's true distance from its path; infinite where the loop was lost"""
    largest: float
    """m, likewise"""
    torque: float
    """RMS of the torques over their limits"""
    chatter: float
    """RMS of the torques' change from one period to the next, over their limits"""


class Setting(NamedTuple):
    """What laws are made from: see `LAWS`."""

    arm: Arm
    """as the law is told it is"""
    path: Callable[[float], Any]
    """of the tool's origin"""
    rotation: np.ndarray
    """(3, 3)"""
    joints: JointPath
    posture: Posture
    omega: float
    period: float
    rates: tuple[float, float]
    """beta_1 and beta_2 as a share of K_p(0), 1/(m^2 s) or 1/(rad^2 s)"""
    limit: np.ndarray
    """(n,) N m"""

    @property
    def postures(self) -> np.ndarray:
        """(FITTED, n) rad"""
        return self.joints.spline(np.linspace(0.0, self.joints.duration, FITTED))


def _cartesian(s: Setting, adapting: bool = True, gravity: bool = False, sigma: float = 0.0) -> Controller:
    six, omega = np.ones(6), s.omega
    gains = gains_from_inertia(s.arm, s.postures, omega)
    model = reference_model(omega**2 * six, 2 * omega * six, np.diag([2 * omega**2] * 6 + [2.0] * 6))
    beta_1, beta_2 = (adapting * rate * np.linalg.eigvalsh(gains.K_p)[0] for rate in s.rates)
    practice = Practice(torque_limit=s.limit, gravity=gravity, sigma=sigma)
    return CartesianAdaptive(
        s.arm, s.path, s.rotation, gains, model, beta_1, beta_2, s.period, s.posture, practice=practice
    )


def _joint(s: Setting, gravity: bool = False, sigma: float = 0.0) -> Controller:
    beta_1, beta_2 = (rate * s.omega**2 for rate in s.rates)
    gains, model = gains_from_mass(s.arm, s.postures, s.omega), model_from_mass(s.arm, s.postures, s.omega)
    practice = Practice(torque_limit=s.limit, gravity=gravity, sigma=sigma)
    return JointAdaptive(s.arm, s.joints, gains, model, beta_1, beta_2, s.period, practice)


def _slotine_li(s: Setting) -> Controller:
    K_D = gains_from_mass(s.arm, s.postures, s.omega).K_d / 2
    rates = parameter_rates(s.arm, s.postures[0], K_D, LEARNING * s.omega)
    return SlotineLi(s.arm, s.joints, K_D, s.omega, rates, s.period)


LAWS: dict[str, Callable[[Setting], Controller]] = {
    "Cartesian, gains fixed": lambda s: _cartesian(s, adapting=False),
    "Cartesian adaptive": _cartesian,
    "Cartesian adaptive + g": lambda s: _cartesian(s, gravity=True),
    "Cartesian adaptive + g + leak": lambda s: _cartesian(s, gravity=True, sigma=LEAK),
    "joint adaptive": _joint,
    "joint adaptive + g": lambda s: _joint(s, gravity=True),
    "joint adaptive + g + leak": lambda s: _joint(s, gravity=True, sigma=LEAK),
    "PD + g": lambda s: GravityPD(s.arm, s.joints, gains_from_mass(s.arm, s.postures, s.omega)),
    "computed torque": lambda s: ComputedTorque(s.arm, s.joints, s.omega),
    "operational space": lambda s: OperationalSpaceControl(s.arm, s.path, s.rotation, s.omega, s.posture),
    "Slotine-Li": _slotine_li,
}
"""Add your own: a function of a `Setting`."""
NOTHING_TO_ADD = ("Cartesian adaptive + g", "joint adaptive + g")  # weightless, they are what they are without


def laws_for(laws: Mapping[str, Callable[[Setting], Controller]], gravity: float) -> list[str]:
    """Names of those that are worth a run."""
    return [name for name in laws if gravity > 0 or name not in NOTHING_TO_ADD]


def compare(
    laws: Mapping[str, Callable[[Setting], Controller]] = LAWS,
    cases: Sequence[int] = (1, 2),
    periods: Sequence[float] = (0.01, 0.001),
    gravities: Sequence[float] = (9.81, 0.0),
    troubles: Sequence[Trouble] = TROUBLES,
    duration: float = 1.8,
    omega_T: float = OMEGA_T,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Iterator[Row]:
    """Every law under every condition on the K-1607, one row as each run is done; the first of them within a second.

    10 lb are carried in the middle third, as in the study cases, whose paths are followed from their beginning.

    Parameters
    ----------
    periods : s; gravities : m/s^2; duration : s, a whole number of periods; omega_T : omega of every law times its period.
    progress : told the share done, 0 to 1, after each run.
    """
    conditions = list(product(cases, periods, gravities, troubles))
    runs = sum(len(laws_for(laws, g)) for _, _, g, _ in conditions)
    done, situation = 0, None
    for number, T, g, trouble in conditions:
        if situation != (number, g):
            case = study_case(number, "recommended", gravity=g)
            # the way is the same at any speed: the whole of it, or what is followed
            joints = joint_path(case.plant.arm, case.law.path, case.q0, duration, case.law.rotation)
            situation = (number, g)
        for name in laws_for(laws, g):
            yield _row(name, laws[name], case, joints, T, g, trouble, duration, omega_T, seed)
            done += 1
            if progress:
                progress(done / runs)


def setting(case: StudyCase, joints: JointPath, period: float, omega_T: float = OMEGA_T, model: float = 1.0) -> Setting:
    """What a law is made from, for a study case with recommended settings; model : see `Trouble`."""
    recommended = data.load("study_cases")["recommended"]
    omega = omega_T / period
    slower = omega * recommended["control_period_s"] / recommended["omega_T"]
    rates = recommended["beta_1_share"] * slower**4, recommended["beta_2_share"] * slower**2
    posture = case.law.posture
    assert posture is not None
    kept = Posture(posture.path, min(posture.omega, omega))
    arm = case.plant.arm
    told = with_masses(arm, model)
    return Setting(told, case.law.path, case.law.rotation, joints, kept, omega, period, rates, arm.effort_limit)


def with_masses(arm: Arm, factor: float) -> Arm:
    """The arm with all masses and inertias, rotors excepted, multiplied by a positive number."""
    if not 0 < factor < np.inf:
        raise ValueError(f"factor: expected a positive number, got {factor!r}")
    model = arm.model
    for i in range(1, model.njoints):
        Y = model.inertias[i]
        model.inertias[i] = pin.Inertia(factor * Y.mass, Y.lever, factor * Y.inertia)
    return Arm(model, arm.tool_frame)


@dataclass(frozen=True)
class Noisy:
    """A controller that is told joint angles and velocities with white noise; the same on every run."""

    law: Any
    period: float
    """s"""
    noise: tuple[float, float]
    """Standard deviation, rad and rad/s"""
    seed: int = 0

    @property
    def variables(self) -> Mapping[str, Any]:
        """The law's own."""
        return getattr(self.law, "variables", {})

    def start(self, q: np.ndarray, v: np.ndarray, duration: float) -> tuple[Any, np.ndarray]:
        """The law's state, and all the noise there will be."""
        shape = (round(duration / self.period) + 1, 2, len(q))
        noise = np.random.default_rng(self.seed).normal(size=shape) * np.array(self.noise)[:, None]
        return self.law.start(q, v, duration), noise

    def update(self, t: float, q: np.ndarray, v: np.ndarray, state: Any) -> tuple[np.ndarray, Any, Mapping[str, Any]]:
        """The law's; what it logs is what it saw."""
        inner, noise = state
        of_q, of_v = noise[round(t / self.period)]
        torque, inner, log = self.law.update(t, q + of_q, v + of_v, inner)
        return torque, (inner, noise), log


def _row(
    name: str, make: Any, case: StudyCase, joints: Any, T: float, g: float, trouble: Trouble, duration: float,
    omega_T: float, seed: int,
) -> Row:  # fmt: skip
    law = make(setting(case, joints, T, omega_T, trouble.model))
    if any(trouble.noise):
        law = Noisy(law, T, trouble.noise, seed)
    limit = case.plant.arm.effort_limit
    plant = Plant(case.plant.arm, torque_limit=limit)
    thirds = [round(k * duration / 3 / T) * T for k in (1, 2)]
    payloads = [(thirds[0], case.payload), (thirds[1], Payload(0.0))]
    step = T / np.ceil(T / LONGEST_STEP - 1e-9)
    lost = Row(name, case.number, T, g, trouble.name, np.inf, np.inf, np.nan, np.nan)
    try:
        run = simulate(plant, law, case.q0, duration, None, T, step, runge_kutta_4, payloads=payloads)
    except (SimulationError, np.linalg.LinAlgError):
        return lost
    distance = np.linalg.norm(run.tool_position.values - case.law.path(run.time.values).position, axis=1)
    if distance.max() > LOST:
        return lost
    share = run.tau.values / limit
    sizes = (float(np.sqrt(np.mean(x**2))) for x in (distance, share, np.diff(share, axis=0)))
    rms, torque, chatter = sizes
    return replace(lost, rms=rms, largest=float(distance.max()), torque=torque, chatter=chatter)


def saved(rows: Iterable[Row], file: str | Path) -> Iterator[Row]:
    """The rows, each written to a CSV file before it is passed on: what is done outlives an interruption."""
    with Path(file).open("w", newline="", encoding="utf-8") as stream:
        out = csv.DictWriter(stream, [field.name for field in fields(Row)])
        out.writeheader()
        for row in rows:
            out.writerow(asdict(row))
            stream.flush()
            yield row


def loaded(file: str | Path) -> list[Row]:
    """The rows of a file that `saved` wrote."""
    with Path(file).open(newline="", encoding="utf-8") as stream:
        return [
            Row(row["law"], int(row["case"]), float(row["period"]), float(row["gravity"]), row["trouble"],
                *(float(row[name]) for name in ("rms", "largest", "torque", "chatter")))
            for row in csv.DictReader(stream)
        ]  # fmt: skip


def table(rows: Iterable[Row]) -> str:
    """Markdown: RMS distance from the path in mm, a line a condition, a column a law, the best of each line in bold.

    With a dagger where the torques rattle: their change from one period to the next is more than `RATTLE`.
    """
    rows = list(rows)
    cells = {astuple(row)[:5]: row.rms for row in rows}
    rattling = {astuple(row)[:5] for row in rows if row.chatter > RATTLE}
    laws = list(dict.fromkeys(key[0] for key in cells))
    conditions = list(dict.fromkeys(key[1:] for key in cells))
    lines = ["| path, period, gravity, trouble | " + " | ".join(laws) + " |", "|---" * (len(laws) + 1) + "|"]
    for condition in conditions:
        best = min(cells.get((law, *condition), np.inf) for law in laws)
        case, T, g, trouble = condition
        texts = [f"{('line', 'circle')[case - 1]}, {T * 1e3:g} ms, {g / 9.81:g} g, {trouble}"]
        for law in laws:
            x = cells.get((law, *condition))
            text = "" if x is None else f"{x * 1e3:.3g}" if np.isfinite(x) else "lost"
            text += " †" if (law, *condition) in rattling else ""
            texts.append(f"**{text}**" if x is not None and np.isfinite(x) and x <= 1.02 * best else text)
        lines.append("| " + " | ".join(texts) + " |")
    return "\n".join(lines)


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
    figure.legend(handles=handles, fontsize=8, ncols=len(handles), loc="outside lower center", frameon=False)
    return figure


DRIFT_OPTIONS: dict[str, Practice] = {
    "as the report has it": Practice(),
    "gravity": Practice(gravity=True),
    "gravity, leak 0.02 /s": Practice(gravity=True, sigma=0.02),
    "gravity, bound 20 %": Practice(gravity=True, gain_bound=0.2),
    "gravity, dead zone 0.1 mrad": Practice(gravity=True, dead_zone=1e-4),
    "gravity, filter 20 rad/s": Practice(gravity=True, velocity_cutoff=20.0),
}
"""See `gain_drift`."""


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
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """What becomes of the joint scheme's gains while the arm is only to hold still, with noise in what it measures.

    The arm is taken as linear about q, M(q) a = tau - g(q), which is exact over a control period: ten minutes take seconds.

    Parameters
    ----------
    q : (n,) rad; duration, period, every (between samples of the result) : s; omega_T : see `compare`.
    rates : beta_1 and beta_2 as a share of K_p(0), 1/(rad^2 s), see `model_from_mass`; noise : rad, rad/s.
    progress : told the share done, 0 to 1, now and then.

    Returns
    -------
    Dataset over ``option`` and ``time`` s: ``K_p``, ``K_d``, Frobenius norms over those at the start, and ``error`` rad, the
    largest of the joints; NaN from where the loop was lost.
    """
    M, held, omega, still = arm.mass_matrix(q), arm.gravity_torque(q), omega_T / period, np.zeros(arm.n)
    gains, model = gains_from_mass(arm, q, omega), model_from_mass(arm, q, omega)
    beta_1, beta_2 = (rate * omega**2 for rate in rates)
    mobility, ticks, sample = np.linalg.inv(M), round(duration / period), round(every / period)
    out = np.full((3, len(options), ticks // sample + 1), np.nan)
    for i, practice in enumerate(options.values()):
        rng = np.random.default_rng(seed)
        x, v, state = still, still, AdaptiveState(gains, still)
        start_torque = held if practice.gravity else still
        for k in range(ticks + 1):
            if k % sample == 0:
                norms = (
                    np.linalg.norm(now) / np.linalg.norm(first) for now, first in zip(state.gains, gains, strict=True)
                )
                out[:, i, k // sample] = *norms, np.abs(x).max()
                if progress:
                    progress((i + k / ticks) / len(options))
            of_x, of_v = rng.normal(size=(2, arm.n)) * np.array(noise)[:, None]
            seen = filtered(state.velocity, v + of_v, period, practice)
            step = joint_adaptive(
                x + of_x, seen, still, still, state.gains, model.P_2, model.P_3, beta_1, beta_2, period, gains,
                start_torque, practice,
            )  # fmt: skip
            a = mobility @ (step.torque - held)
            x, v, state = x + period * (v + period / 2 * a), v + period * a, AdaptiveState(step.gains, seen)
            if not np.abs(x).max() < 1.0:  # rad, NaN included
                break
    dims = ("option", "time")
    return xr.Dataset(
        {
            "K_p": (dims, out[0], {"units": ""}),
            "K_d": (dims, out[1], {"units": ""}),
            "error": (dims, out[2], {"units": "rad"}),
        },
        coords={"option": list(options), "time": ("time", np.arange(out.shape[2]) * sample * period, {"units": "s"})},
    )


def figure_drift(result: xr.Dataset) -> Figure:
    """Norms of K_p and K_d over those at the start, a line an option."""
    figure = Figure(figsize=(7.2, 5.0), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    for axes, name in zip(panels, ("K_p", "K_d"), strict=True):
        for option in result.option.values:
            axes.plot(result.time / 60, result[name].sel(option=option), lw=1.3, label=option)
        axes.set_ylabel(f"$|{name}(t)| / |{name}(0)|$")
        axes.margins(x=0)
        axes.spines[["top", "right"]].set_visible(False)
    panels[-1].set_xlabel("time [min]")
    figure.legend(
        *panels[0].get_legend_handles_labels(), fontsize=8, ncols=3, loc="outside lower center", frameon=False
    )
    figure.suptitle("Holding still with noisy sensors", fontsize=11)
    return figure
