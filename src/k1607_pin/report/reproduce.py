"""Parts 1-3 and study cases 1 and 2 from end to end: numbers, figures and a page, written to a folder."""

import json
from collections.abc import Callable
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

import jinja2
import numpy as np

from k1607_pin import data
from k1607_pin.files import write_atomically
from k1607_pin.kinematics import closed_form, singularities
from k1607_pin.report import case_figures, equations, operations, published, published_cases, studies
from k1607_pin.report.figures import FIGURES
from k1607_pin.report.published import Comparison
from k1607_pin.report.runs import write_figure


def reproduce(
    out: Path, progress: Callable[[str], None] = lambda step: None
) -> tuple[list[Comparison], list[Comparison]]:
    """Write ``results.json``, ``aims.json``, every figure as PNG and SVG, and ``index.html`` to ``out``.

    Returns the comparisons of the two JSON files: with what the report publishes, and with what we aim at at 1 kHz.

    Each file appears whole or not at all; what an interrupted run has written stays.
    ``progress`` is told each step before it starts.
    """
    out = Path(out)
    trajectory = studies.identified_trajectory()
    progress("published numbers")
    results = published.compare(trajectory)
    runs = case_figures.run_cases(progress)
    for number in case_figures.CASES:
        results += published_cases.compare_case(number, runs[number, "report"][1])
    aims = [row for n in case_figures.CASES for row in published_cases.compare_aims(n, runs[n, "recommended"][1])]
    write_atomically(out / "results.json", json.dumps([asdict(r) for r in results], indent=2) + "\n")
    write_atomically(out / "aims.json", json.dumps([asdict(r) for r in aims], indent=2) + "\n")
    progress("sampling study")
    write_atomically(out / "sampling.json", json.dumps(published.sampling_table(trajectory), indent=2) + "\n")
    for name, draw in FIGURES.items():
        progress(name)
        write_figure(out / name, draw(trajectory))
    progress("figures of the cases")
    of_cases, premise = case_figures.draw(runs, progress)
    for name, figure in of_cases.items():
        write_figure(out / name, figure)
    progress("equations and page")
    beyond = {n: published_cases.overdriven(*runs[n, "report"]) for n in case_figures.CASES}
    write_atomically(out / "index.html", _page(out, trajectory, results, aims, list(of_cases), premise, beyond))
    return results, aims


def _page(
    out: Path,
    trajectory: studies.TestTrajectory,
    results: list[Comparison],
    aims: list[Comparison],
    case_figures: list[str],
    premise: dict[int, tuple[float, float]],
    beyond: dict[int, list[published_cases.Overdriven]],
) -> str:
    facts = data.load("published")
    rng = np.random.default_rng(0)
    singular = []
    for family in singularities.FAMILIES:
        members = np.array([family.member(rng) for _ in range(200)])
        sigma = np.linalg.svd(closed_form.jacobian(members), compute_uv=False)[:, -1].max()
        singular.append({**family._asdict(), "sigma": float(sigma)})
    environment = jinja2.Environment(loader=jinja2.PackageLoader("k1607_pin.report", "."), autoescape=True)
    environment.filters["sig"] = lambda x: f"{x:.3g}"
    return environment.get_template("page.html.j2").render(
        version=version("k1607-pin"),
        results=results,
        aims=aims,
        assumptions=list(data.facts("study_cases")),
        figures=list(FIGURES),
        case_figures=case_figures,
        premise=premise,
        overdriven=[(number, *joint) for number, joints in beyond.items() for joint in joints],
        compared=(out / "comparison.png").exists(),
        readings=studies.delta_beta_readings(trajectory),
        allowed=published.allowed_by_figure_6(facts["part1"]["wx_max_error_mrad_s"]["100ms"]),
        needed=facts["part3"]["delta_beta_max_error_milli"]["100ms"] * 1e-3 * 4 / published.PERIODS["100ms"] ** 2,
        part_2=[
            (
                name,
                text,
                *(studies.part_2(trajectory, T, name).attrs["relative_error"] for T in published.PERIODS.values()),
            )
            for name, text in studies.READINGS.items()
        ],
        accuracy=published.accuracy_table(trajectory),
        sampling=published.sampling_table(trajectory),
        trajectory=data.load("identified")["test_trajectory"],
        operations=operations.count(),
        equations=equations.check_all(),
        singular=singular,
    )
