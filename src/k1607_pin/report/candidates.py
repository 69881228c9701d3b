"""Many sets of unknowns at once: both study cases of each, run natively, beside the sixteen published errors."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from k1607_pin import data
from k1607_pin.compiled.rollout import Rollouts, rollouts
from k1607_pin.description.units import INCH
from k1607_pin.report.cases import as_published
from k1607_pin.report.published import WITHIN
from k1607_pin.report.published_cases import ERRORS, SMALL, SMALL_ANGLE
from k1607_pin.report.starts import line_s_end, rotation, starts, x_of_starts
from k1607_pin.report.unknowns import NAMES
from k1607_pin.simulation.integrators import runge_kutta_4

WELL_WITHIN = np.log([0.77, 1.23])  # of what counts as met, 0.75 to 1.25
REACHED = 1e-6  # m, rad
WANTED, NEAR = 12, 1.095  # so many are to be well within 10 %
VARIED = (
    "controller.gains.K_p", "controller.gains.K_d", "controller.beta_1", "controller.beta_2", "controller.rotation",
    "plant.viscous", "plant.arm.armature", "payloads.0.payload.cg",
)  # fmt: skip
PLACE = {1: "controller.path.start", 2: "controller.path.height"}
LOST, NO_START = 20.0, 40.0  # worth of a set that a run of is lost with (and more, the sooner), and that cannot start


class Outcome(NamedTuple):
    """Of N sets of unknowns."""

    ratios: np.ndarray
    """(N, 16) ours over published, magnitudes, as `sensitivity.ratios`; NaN where a run is lost or cannot start"""
    words: np.ndarray
    """(N, 4) what is called negligible over what that is taken to mean: z and orientation of case 1, then of case 2"""
    outside: np.ndarray
    """(N,) rad by which the joints leave the assumed limits, at most"""
    alive: np.ndarray
    """(N,) share of the two runs that went well"""
    postures: np.ndarray
    """(N, 2, 7) rad at the two starts"""
    missed: np.ndarray
    """(N,) m and rad by which the arm cannot come to the line's end"""


def published_errors() -> np.ndarray:
    """(16,) magnitudes, in and in/s, in the order of `sensitivity.ratios`."""
    facts = data.load("published")
    return np.abs([facts[f"case{n}"][key][axis] for n in (1, 2) for key in ERRORS for axis in "xy"])


def worth(outcome: Outcome, limits: bool) -> np.ndarray:
    """(N,) the smaller the better: mean |log ratio| and ten times what is beyond 23 %, five times what the `WANTED`th best is
    beyond `NEAR`, what is not negligible, and with ``limits`` what is beyond the joints' limits."""
    off = np.log(np.maximum(outcome.ratios, 1e-6))
    beyond = np.maximum(WELL_WITHIN[0] - off, 0.0) + np.maximum(off - WELL_WITHIN[1], 0.0)
    value = np.mean(np.abs(off) + 10 * beyond, axis=1)
    value += 5 * np.maximum(np.sort(np.abs(off), axis=1)[:, WANTED - 1] - np.log(NEAR), 0.0)
    value += np.sum(np.log(np.maximum(outcome.words / 0.95, 1.0)), axis=1)
    if limits:
        value += 20 * outcome.outside
    value += np.where(outcome.missed > REACHED, 0.3 + 200 * outcome.missed, 0.0)
    lost = np.where(outcome.alive >= 0, LOST + 5 * (1 - outcome.alive), NO_START)
    return np.where(np.isnan(value), lost, np.minimum(value, LOST))


def accepted(outcome: Outcome, limits: bool) -> np.ndarray:
    """(N,) whether all 16 numbers are met, what is called negligible is, and with ``limits`` the joints keep to theirs."""
    met = (np.abs(outcome.ratios - 1) <= WITHIN).all(axis=1) & (outcome.words <= 1).all(axis=1)
    met &= outcome.missed <= REACHED
    return met & (outcome.outside == 0) if limits else met


class Candidates:
    """Runs sets of unknowns; counts its rollouts.

    Parameters
    ----------
    choice : table like "report" of `study_cases.toml`: what is not among the unknowns, and the posture to begin at.
    physics_step : s; None for the table's.
    published : (16,) in, in/s; None for the report's.
    """

    def __init__(
        self,
        choice: Mapping[str, Any],
        physics_step: float | None = None,
        published: np.ndarray | None = None,
        threads: int | None = None,
    ) -> None:
        self.choice, self.threads, self.count = dict(choice), threads, 0
        self.published = published_errors() if published is None else np.asarray(published, dtype=float)
        self.cases = {n: as_published(n, self.choice) for n in (1, 2)}
        self.known = self.cases[1].q0
        self.step = physics_step or self.cases[1].physics_step
        self._loops: dict[tuple[int, float], Rollouts] = {}

    def __call__(self, values: np.ndarray) -> Outcome:
        """Both cases of each set; values : (N, unknowns), see `UNKNOWNS`."""
        N = len(values)
        of = dict(zip(NAMES, values.T, strict=True))
        start = np.stack(
            [of[name] for name in ("z0", "elevation", "azimuth", "roll", "theta_3", "theta_3 circle")], axis=1
        )
        postures, found = starts(self.known, start)
        ratios, words = np.full((N, 16), np.nan), np.full((N, 4), np.nan)
        outside, alive = np.zeros(N), np.where(found, 0.0, -1.0)
        for number in (1, 2):
            lasting = of["duration"] if number == 1 else np.full(N, self.cases[2].duration)
            for duration in np.unique(lasting[found]):
                these = np.flatnonzero(found & (lasting == duration))
                self._run(number, duration, of, postures, these, (ratios, words, outside, alive))
        missed, way = line_s_end(postures[:, 0])
        arm = self.cases[1].plant.arm
        beyond = np.maximum(way - arm.upper, 0.0) + np.maximum(arm.lower - way, 0.0)
        outside = np.maximum(outside, beyond.max(axis=(1, 2)))
        return Outcome(ratios, words, outside, alive, postures, missed)

    def _run(self, number: int, duration: float, of: Any, postures: np.ndarray, these: np.ndarray, into: Any) -> None:
        ratios, words, outside, alive = into
        x = {name: value[these] for name, value in of.items()}
        zero, arm = 0 * x["z0"], self.cases[number].plant.arm
        z0 = x["z0"] * INCH
        vary = {
            "controller.gains.K_p": _diagonal(*(x[f"K_p {axis}"] for axis in ("x", "y", "z", "rot"))),
            "controller.gains.K_d": _diagonal(*(x[f"K_d {axis}"] for axis in ("x", "y", "z", "rot"))),
            "controller.beta_1": x["beta_1"],
            "controller.beta_2": x["beta_2"],
            "controller.rotation": rotation(x["elevation"], x["azimuth"], x["roll"]),
            "plant.viscous": np.repeat(x["friction"][:, None], arm.n, axis=1),
            "plant.arm.armature": x["armature"][:, None] * self._armature(),
            "payloads.0.payload.cg": np.stack([zero, zero, x["payload offset"] * INCH], axis=1),
            PLACE[number]: np.stack([zero + x_of_starts()[0], zero, z0], axis=1) if number == 1 else z0,
        }
        run = self._loop(number, float(duration))(postures[these, number - 1], vary=vary, threads=self.threads)
        self.count += len(these)
        well = np.isnan(run.failed_at.values)
        alive[these] += np.where(well, 0.5, 0.5 * run.failed_at.values / duration)
        columns = [run[f"{variable}_{kind}"].values[:, k] for variable, kind, *_ in ERRORS.values() for k in (0, 1)]
        got = np.stack(columns, axis=1) / INCH
        part = self.published[8 * (number - 1) : 8 * number]
        ratios[these, 8 * (number - 1) : 8 * number] = np.where(well[:, None], got / part, np.nan)
        most = run.error_max.values
        words[these, 2 * number - 2] = most[:, 2] / INCH / (SMALL * part[:2].max())
        words[these, 2 * number - 1] = np.rad2deg(most[:, 3:].max(axis=1)) / SMALL_ANGLE
        outside[these] = np.maximum(outside[these], np.nan_to_num(run.outside_max.values.max(axis=1)))

    def _armature(self) -> np.ndarray:
        return self.cases[1].plant.arm.armature / self.choice["plant"]["armature_scale"]

    def _loop(self, number: int, duration: float) -> Rollouts:
        if (number, duration) not in self._loops:
            case = self.cases[number]
            lower, upper = case.plant.arm.lower, case.plant.arm.upper

            def outside(log: Mapping[str, Any]) -> Any:
                return np.maximum(np.maximum(lower - log["q"], log["q"] - upper), 0.0 * log["q"])

            case = replace(case, duration=duration)
            self._loops[number, duration] = rollouts(
                case.plant, case.law, duration, case.law.period, self.step, runge_kutta_4, case.payloads, case.from_rest,
                varied=(*VARIED, PLACE[number]), signals={"outside": outside},
                metrics={"error": ("max", "rms"), "error_rate": ("max", "rms"), "outside": ("max",)},
            )  # fmt: skip
        return self._loops[number, duration]


def _diagonal(x: np.ndarray, y: np.ndarray, z: np.ndarray, turning: np.ndarray) -> np.ndarray:
    """(N, 6, 6)"""
    return np.stack([x, y, z, turning, turning, turning], axis=-1)[..., None] * np.eye(6)
