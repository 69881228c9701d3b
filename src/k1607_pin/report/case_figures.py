"""Figures 15-22 and what the report could not show of its study cases: drawn from four runs and a map."""

from collections.abc import Callable

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from k1607_pin.arm.load import load_k1607
from k1607_pin.control.lyapunov import lyapunov
from k1607_pin.report import plots
from k1607_pin.report.cases import SETTINGS, StudyCase, section_7_2, study_case
from k1607_pin.report.stability import figure_stability, stability_map
from k1607_pin.simulation.observe import ObserveOperationalSpace

CASES = {1: "straight line", 2: "circle"}
Runs = dict[tuple[int, str], tuple[StudyCase, xr.Dataset]]
"""(case, settings) -> what was run, and its log."""

PERIODS = (0.001, 0.002, 0.005, 0.010, 0.020, 0.050)  # s
OMEGAS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)  # 1/s
BETAS = (0.0, 1e5, 1e7)
POSTURE_DEG = (
    -20.0,
    30.0,
    20.0,
    100.0,
    -30.0,
    60.0,
    10.0,
)  # where the map's runs start; no joint near a limit or singularity


def run_cases(progress: Callable[[str], None]) -> Runs:
    """Both cases with both settings; the report's observed, so that its Lyapunov function can be drawn."""
    runs: Runs = {}
    for settings in SETTINGS:
        for number, name in CASES.items():
            progress(f"case {number}, {name}, {settings} settings")
            study = study_case(number, settings)
            runs[number, settings] = (
                study,
                study.run(observe=ObserveOperationalSpace() if settings == "report" else None),
            )
    return runs


def draw(runs: Runs, progress: Callable[[str], None]) -> tuple[dict[str, Figure], dict[int, tuple[float, float]]]:
    """File name -> figure; and case -> share of samples at which slow motion, (66)-(68), holds, and when it first fails, s."""
    figures: dict[str, Figure] = {}
    premise: dict[int, tuple[float, float]] = {}
    for number, name in CASES.items():
        study, run = runs[number, "report"]
        first = 15 if number == 1 else 19
        over_time = (plots.time_histories, plots.position_errors, plots.velocity_errors)
        for k, plot in enumerate(over_time, first):
            figures[f"figure-{k}"] = plot(
                run, f"Figure {k}: {name}", "xy"
            )  # as in the report; z is in the other errors
        figures[f"figure-{first + 3}"] = plots.tool_path(run, f"Figure {first + 3}: {name}")
        figures[f"case-{number}-other-errors"] = plots.other_errors(
            run, f"Case {number}, {name}: the errors called negligible"
        )
        figures[f"case-{number}-gains"] = plots.gains(
            run, f"Case {number}, {name}: what the adaptation does to the gains"
        )
        analysis = lyapunov(run, study.law.model, study.law.beta_1, study.law.beta_2)
        holds = analysis.premise_holds
        premise[number] = float(holds.mean()), float(holds.time[int(np.argmin(holds.values))])
        figures[f"case-{number}-lyapunov"] = plots.lyapunov_rate(analysis, f"Case {number}, {name}: (56) on the arm")
        figures[f"case-{number}-recommended"] = plots.position_errors(
            runs[number, "recommended"][1], f"Case {number}, {name}: 1 kHz, full gravity"
        )
    progress("stability map")
    arm = load_k1607(gravity=(0.0, 0.0, 0.0))
    result = stability_map(arm, np.deg2rad(POSTURE_DEG), section_7_2(), PERIODS, OMEGAS, BETAS)
    figures["stability-map"] = figure_stability(result)
    return figures, premise
