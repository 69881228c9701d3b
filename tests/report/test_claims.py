"""What README and docs state in numbers is computed again."""

import re
from pathlib import Path

import pytest

from k1607_pin.report.equations import check_all

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
