"""The 16 published errors of study cases 1 and 2 beside ours, and what we add at 1 kHz in full gravity."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from k1607_pin import data
from k1607_pin.description.units import INCH
from k1607_pin.report.cases import StudyCase
from k1607_pin.report.published import WITHIN, Comparison

SMALL = 0.25  # of the published largest error of x and y: what "negligible" is taken to mean for z (assumed)
SMALL_ANGLE = 2.0  # degrees: what it is taken to mean for the orientation (assumed)
AIM_MAX, AIM_RMS = 0.02, 0.005  # in: what is aimed at at 1 kHz in full gravity

ERRORS = {
    "max_error_in": ("error", "max", "max error of {}", "in"),
    "rms_error_in": ("error", "rms", "RMS error of {}", "in"),
    "max_rate_error_in_s": ("error_rate", "max", "max error of {}'s rate", "in/s"),
    "rms_rate_error_in_s": ("error_rate", "rms", "RMS error of {}'s rate", "in/s"),
}
"""Key in `published.toml` -> variable of a run, statistic, words, unit."""


def statistic(run: xr.Dataset, variable: str, direction: str, kind: str) -> float:
    """Of a run's error: the value of largest magnitude with its sign ("max"), or the RMS over all samples ("rms"); SI."""
    x = run[variable].sel(direction=direction).values
    return float(x[np.argmax(np.abs(x))] if kind == "max" else np.sqrt(np.mean(x**2)))


def compare_case(number: int, run: xr.Dataset) -> list[Comparison]:
    """The eight published errors of a study case, and its two words, beside those of a run."""
    published, rests_on = data.load("published")[f"case{number}"], data.load("study_cases")["report"]["rests_on"]
    rows = []
    for key, (variable, kind, words, unit) in ERRORS.items():
        for axis in "xy":
            theirs, ours = published[key][axis], statistic(run, variable, axis, kind) / INCH
            ratio = abs(ours / theirs)
            opposite = kind == "max" and ours * theirs < 0
            verdict = ("met in magnitude" if opposite else "met") if abs(ratio - 1) <= WITHIN else "not met"
            rows.append(
                Comparison(
                    f"case{number}.{key}.{axis}", f"case {number}, {words.format(axis)}", theirs, unit, ours, ratio, verdict,
                    rests_on[f"case{number}_{key}_{axis}"] + ("; the sign is the opposite one" if opposite else ""),
                )
            )  # fmt: skip
    word, largest = published["z_and_orientation"], max(published["max_error_in"].values())
    z = abs(statistic(run, "error", "z", "max")) / INCH
    angle = max(abs(float(np.rad2deg(statistic(run, "error", d, "max")))) for d in ("rx", "ry", "rz"))
    for name, ours, unit, limit in (("z", z, "in", SMALL * largest), ("orientation", angle, "deg", SMALL_ANGLE)):
        rows.append(
            Comparison(
                f"case{number}.{name}", f"case {number}, max error of {name}", word, unit, ours, None,
                "agrees" if ours <= limit else "disagrees",
                f"all of the set; 'negligible' up to {limit:.3g} {unit} (assumed)",
            )
        )  # fmt: skip
    return rows


class Overdriven(NamedTuple):
    """A joint of which a run asks more torque than it is assumed to have."""

    joint: int
    """from 1"""
    asked: float
    """N m, the largest of the run"""
    limit: float
    """N m, assumed"""
    last: float
    """s, when it was last beyond"""


def overdriven(study: StudyCase, run: xr.Dataset) -> list[Overdriven]:
    """The joints whose assumed torque limits a run goes beyond; no law is bound by them unless its practice says so."""
    limit, tau = study.plant.arm.effort_limit, np.abs(run.tau.values)
    return [
        Overdriven(int(k) + 1, float(tau[:, k].max()), float(limit[k]), float(run.time[tau[:, k] > limit[k]][-1]))
        for k in np.flatnonzero(tau.max(axis=0) > limit)
    ]


def compare_aims(number: int, run: xr.Dataset) -> list[Comparison]:
    """Distance of the tool from its path, largest and RMS, beside what is aimed at; ``published`` is the aim."""
    distance = np.linalg.norm(run.error.sel(direction=["x", "y", "z"]).values, axis=1) / INCH
    rms = float(np.sqrt(np.mean(distance**2)))
    return [
        Comparison(
            f"case{number}.recommended.{name}", f"case {number} at 1 kHz, 1 g: {words}", aim, "in", ours, ours / aim,
            "met" if ours <= aim else "not met", "recommended settings; rigid arm, exact sensors (assumed)",
        )
        for name, words, aim, ours in (
            ("max", "largest distance from the path", AIM_MAX, float(distance.max())),
            ("rms", "RMS distance from the path", AIM_RMS, rms),
        )
    ]  # fmt: skip
