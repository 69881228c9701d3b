"""What docs/comparison.md, docs/study_cases.md and README say of the learning rate, run again at a few rates."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from k1607_pin.report.learning import holding, learning_curve, learning_rate, load_of
from k1607_pin.report.learning_figure import ADAPTING, CELLS, EQUAL, HOLD, SAME, cells, recommended
from k1607_pin.report.noisy import NOISE

ROOT = Path(__file__).parents[2]
CLEAR = 1.25  # of a stated limit: it is a bracket of two digits


def tables(name, first):
    """The rows, cell by cell, of each table of a page whose first head cell is ``first``."""
    found = []
    for block in re.split(r"\n\s*\n", (ROOT / name).read_text(encoding="utf-8")):
        rows = [[x.strip() for x in line.strip("|").split("|")] for line in block.splitlines() if line.startswith("|")]
        if rows and rows[0][0] == first:
            found.append(rows[2:])
    return found


def number(text):
    return float(text.split()[0])


PAGE = dict(zip(("line", "circle", "hold"), tables("docs/comparison.md", "law"), strict=True))


@pytest.fixture(scope="module", params=[(where, law) for where in PAGE for law in ADAPTING], ids=" ".join)
def row(request):
    where, law = request.param
    (stated,) = (row for row in PAGE[where] if row[0] == law)
    case = cells(2 if where == "circle" else 1, HOLD if where == "hold" else None)[law]
    own = learning_rate(case.law, case.q0, load_of(case.law, case.q0, case.payload))
    least, holds, lost = (number(stated[k].split(" at ")[-1]) for k in (6, 7, 8))
    rates = [own, *EQUAL, least / CLEAR, holds / CLEAR, CLEAR * lost]
    return stated, own, rates, learning_curve(case, np.array(rates) / own)


def test_the_table_of_rates_is_what_comes_out(row):
    stated, own, rates, curve = row
    assert number(stated[1]) == pytest.approx(own, rel=0.05)
    rms = {float(rate): 1e3 * float(x) for rate, x in zip(curve.rate, curve.rms, strict=True)}
    found = [rms[0.0], *(rms[min(rms, key=lambda x, rate=rate: abs(x - rate))] for rate in rates[:3])]
    assert found == pytest.approx([number(x) for x in stated[2:6]], rel=0.01)
    near = min(rms, key=lambda x: abs(x - rates[3]))
    assert number(stated[6]) == pytest.approx(rms[near], rel=0.35)  # the least lies at the edge, and is steep there
    held, gone = rates[4] / own, rates[5] / own
    assert curve.holds.sel(factor=held, method="nearest")
    assert curve.lost.sel(factor=gone, method="nearest")


@pytest.mark.parametrize("long", [False, True], ids=["the cases", "holding"])
def test_multiples_of_beta_1_are_what_comes_out(long):
    stated = tables("docs/study_cases.md", r"$\beta_1$")[long]
    assert [row[0] for row in stated] == ["none" if not x else f"x {x:g}" for x in SAME]
    for column, case in enumerate(recommended().values(), 1):
        factors = SAME[:2] + SAME[-3::2] if long else SAME
        curve = learning_curve(holding(case, HOLD) if long else case, factors)
        for row, factor in zip(stated, SAME, strict=True):
            if factor not in factors:
                continue
            rms = float(curve.rms.sel(factor=factor))
            if row[column] == "lost":
                assert np.isinf(rms)
                continue
            off, share = re.match(r"([\d.]+) mm, ([\d.]+) % off", row[column]).groups()
            assert 1e3 * rms == pytest.approx(float(off), rel=0.01)
            assert 100 * (1 - rms / float(curve.rms[0])) == pytest.approx(float(share), abs=0.3)
        if not long:
            low, high = ((56e3, 62e3), (82e3, 91e3))[column - 1]  # as the page says of the limit
            assert low / CLEAR < curve.holds_to / curve.own < curve.lost_from / curve.own < CLEAR * high


def test_what_the_text_makes_of_the_tables():
    least = {(where, row[0]): number(row[6]) for where, rows in PAGE.items() for row in rows}
    at = {(where, row[0], k): number(row[k]) for where, rows in PAGE.items() for row in rows for k in (2, 3, 4, 5)}
    own = {row[0]: number(row[1]) for row in PAGE["line"]}
    assert 180 < own["Slotine-Li"] / own["joint adaptive + g"] < own["Slotine-Li"] / own["Cartesian adaptive + g"] < 230
    for where in ("line", "circle"):
        joint, parameters = ((where, law) for law in ("joint adaptive + g", "Slotine-Li"))
        assert abs(at[(*joint, 4)] / at[(*parameters, 4)] - 1) < 0.05  # at 1 /s
        assert 0.6 < at[(*parameters, 5)] / at[(*joint, 5)] < 0.68  # at 10 /s
        assert abs(least[joint] / least[parameters] - 1) < 0.05
        cartesian = (where, "Cartesian adaptive + g")
        assert 1 - least[cartesian] / at[(*cartesian, 2)] == pytest.approx(0.4, abs=0.01)
    for k in (3, 4, 5):
        assert (
            at["hold", "Slotine-Li", k] < at["hold", "joint adaptive + g", k] < at["hold", "Cartesian adaptive + g", k]
        )
    assert least["hold", "Slotine-Li"] < 0.5 * least["hold", "joint adaptive + g"]
    lost = {where: number(row[8]) for where, rows in PAGE.items() for row in rows if row[0] == "joint adaptive + g"}
    assert lost["hold"] / lost["line"] == pytest.approx(0.25, abs=0.03)
    readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    shares = [
        [row[k].split(", ")[-1].split()[0] for k in (1, 2)] for row in tables("docs/study_cases.md", r"$\beta_1$")[0]
    ]
    own_share, much = shares[SAME.index(1.0)], [round(float(x)) for x in shares[SAME.index(1e4)]]
    assert f"it takes {own_share[0]} and {own_share[1]} % off" in readme
    assert f"the $\\beta_1$ {much[0]} and {much[1]} %" in readme
    assert list(CELLS) == list(recommended())


def test_what_noise_leaves_of_it():
    """Recommended settings: lost with beta_2, whatever beta_1; without it there is a limit. At 10 ms little changes."""
    for case in recommended().values():
        with pytest.raises(ValueError, match="holds without learning"):
            learning_curve(case, [1.0], NOISE)
    line = recommended()[CELLS[0]]
    fixed = replace(line, law=replace(line.law, beta_2=0.0))
    curve = learning_curve(fixed, [178 / CLEAR, 178, 237 * CLEAR, 1e3], NOISE)
    assert curve.holds.sel(factor=178 / CLEAR)
    assert curve.lost.sel(factor=[237 * CLEAR, 1e3]).all()
    assert 1 - float(curve.rms.sel(factor=178)) / float(curve.rms[0]) == pytest.approx(0.15, abs=0.02)
    slow = learning_curve(cells(1)["joint adaptive + g"], [1e4], NOISE)
    assert 1e3 * float(slow.rms.sel(factor=1e4)) == pytest.approx(0.386, rel=0.01)
