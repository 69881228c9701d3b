"""What README and docs state in numbers is computed again."""

import re
from pathlib import Path

import numpy as np
import pytest

from k1607_pin import data
from k1607_pin.report import sensitivity
from k1607_pin.report.equations import check_all
from k1607_pin.report.published import allowed_by_figure_6
from k1607_pin.report.unknowns import NAMES

ROOT = Path(__file__).parents[2]


def text(name):
    return " ".join((ROOT / name).read_text(encoding="utf-8").split())


def numbers(cell):
    """(18), (35), (36) or (76), (77): the equations that a table's first cell names."""
    return {int(n) for n in re.findall(r"\((\d+)\)", cell)}


def rows(section):
    return set().union(*(numbers(line.split("|")[1]) for line in section.splitlines() if line.startswith("| (")))


@pytest.fixture(scope="module")
def verdicts():
    return {c.number: c.verdict for c in check_all()}


def test_misprints_and_gaps_are_counted(verdicts):
    misprints, gaps = ([*verdicts.values()].count(verdict) for verdict in ("misprint", "gap"))
    assert f"{misprints} of the {len(verdicts)} equations are misprints as transcribed, and {gaps} hold only" in text(
        "README.md"
    )


def test_the_errata_list_every_misprint_and_every_gap(verdicts):
    page = (ROOT / "docs/errata.md").read_text(encoding="utf-8")
    misprints, gaps = (rows(part) for part in page.split("## Gaps of the stability proof"))
    garbled = {1}  # a definition
    slip_and_gap = {57}  # a lost x_d' beside a term that the argument drops
    assert misprints == {n for n, v in verdicts.items() if v == "misprint"} | garbled | slip_and_gap
    assert gaps >= {n for n, v in verdicts.items() if v == "gap"}


def test_the_lines_of_the_readme_run_and_do_what_their_comments_say():
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    names = {}
    exec(compile(code, "README.md", "exec"), names)
    assert names["found"].converged
    assert float(abs(names["run"].error[:, :3]).max()) == pytest.approx(1e-4, rel=0.15)  # a tenth of a millimetre
    assert names["runs"].sizes["rollout"] == 1000
    assert names["runs"].failed_at.isnull().all()


def test_figure_11_contradicts_figure_6_by_the_factor_that_is_told():
    facts = data.load("published")
    allowed = allowed_by_figure_6(facts["part1"]["wx_max_error_mrad_s"]["100ms"])
    factor = facts["part3"]["delta_beta_max_error_milli"]["100ms"] / allowed
    assert f"contradicts the report's own figure 6 by a factor of {factor:.0f}" in text("README.md")


def test_ten_thousand_loops_take_what_was_measured():
    """README's five seconds are those of the measurements; no test is about how fast this machine is."""
    (measured,) = re.findall(
        r"\| 10,000 rollouts of 10 s, metrics only, 2 threads \| ([\d.]+) s", text("docs/measurements.md")
    )
    assert float(measured) < 5
    assert "ten thousand closed loops of ten seconds each in five" in text("README.md")


def test_as_many_unknowns_are_fitted_as_is_told():
    assert len(NAMES) == 20
    assert "Twenty unknowns are fitted to sixteen numbers" in text("docs/study_cases.md")
    assert "fits twenty such numbers" in text("notebooks/08_a_hundred_thousand_closed_loops.ipynb")


def test_the_tables_of_what_each_number_hangs_on_are_what_comes_out():
    """docs/study_cases.md, one assumption changed at a time; two digits, so that half of the last one is rounding."""
    page = (ROOT / "docs/study_cases.md").read_text(encoding="utf-8").split("## Which assumption")[1]
    cases = [part.split("\n\n")[1].splitlines()[2:] for part in page.split("### Case ")[1:]]
    stated = [
        {x[0]: x[1:] for x in ([c.strip() for c in line.strip("|").split("|")] for line in rows)} for rows in cases
    ]
    for name, ratios in sensitivity.table().items():
        cells = stated[0][name] + stated[1][name]
        lost = np.array([cell == "lost" for cell in cells])
        assert (np.isnan(ratios) == lost).all(), name
        assert ratios[~lost] == pytest.approx([float(x) for x in cells if x != "lost"], abs=0.015), name
