"""Parts 1-3 from end to end: numbers, figures and a page, written to a folder."""

import io
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
from k1607_pin.report import equations, operations, published, studies
from k1607_pin.report.figures import FIGURES
from k1607_pin.report.published import Comparison


def reproduce(out: Path, progress: Callable[[str], None] = lambda step: None) -> list[Comparison]:
    """Write ``results.json``, every figure as PNG and SVG, and ``index.html`` to ``out``; return the comparisons.

    Each file appears whole or not at all; what an interrupted run has written stays.
    ``progress`` is told each step before it starts.
    """
    out = Path(out)
    trajectory = studies.identified_trajectory()
    progress("published numbers")
    results = published.compare(trajectory)
    write_atomically(out / "results.json", json.dumps([asdict(r) for r in results], indent=2) + "\n")
    progress("sampling study")
    write_atomically(out / "sampling.json", json.dumps(published.sampling_table(trajectory), indent=2) + "\n")
    for name, draw in FIGURES.items():
        progress(name)
        figure = draw(trajectory)
        for kind in ("png", "svg"):
            buffer = io.BytesIO()
            figure.savefig(buffer, format=kind, dpi=150)
            write_atomically(out / f"{name}.{kind}", buffer.getvalue())
    progress("equations and page")
    write_atomically(out / "index.html", _page(trajectory, results))
    return results


def _page(trajectory: studies.TestTrajectory, results: list[Comparison]) -> str:
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
        figures=list(FIGURES),
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
