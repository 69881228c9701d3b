"""`reproduce` writes a page, figures and numbers that agree with each other."""

import html
import json
import re

import pytest

from k1607_pin.report import operations
from k1607_pin.report.figures import FIGURES
from k1607_pin.report.reproduce import reproduce


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("out")
    (out / "comparison.png").touch()
    steps = []
    results, aims = reproduce(out, steps.append)
    assert set(FIGURES) < set(steps)
    assert len(steps) == len(set(steps))
    return out, results, aims


def test_results_json_has_an_entry_a_published_number(folder):
    out, results, aims = folder
    assert [e["verdict"] for e in json.loads((out / "aims.json").read_text())] == [a.verdict for a in aims]
    entries = json.loads((out / "results.json").read_text())
    assert [e["id"] for e in entries] == [r.id for r in results]
    for e in entries:
        assert {"id", "published", "unit", "ours", "ratio", "verdict"} <= e.keys()
        if isinstance(e["published"], float):
            assert e["ratio"] == pytest.approx(abs(e["ours"] / e["published"]))


def test_every_figure_is_drawn_as_png_and_svg(folder):
    out, _, _ = folder
    of_cases = [f"figure-{k}" for k in range(15, 23)] + ["stability-map"]
    of_cases += [f"case-{n}-{what}" for n in (1, 2) for what in ("other-errors", "gains", "lyapunov", "recommended")]
    for name in [*FIGURES, *of_cases]:
        assert (out / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert "<svg" in (out / f"{name}.svg").read_text()[:1000]


def test_the_page_shows_every_number_and_figure_and_needs_no_network(folder):
    out, results, aims = folder
    page = html.unescape((out / "index.html").read_text())
    for r in [*results, *aims]:
        assert r.quantity in page
        assert f"{r.ours:.3g}" in page
    for name in FIGURES:
        assert f'src="{name}.png"' in page
    for number in (1, 2):
        assert re.search(rf"\d+ % of the samples of case {number} \(it first fails at [\d.]+ s\)", page)
    assert "http://" not in page
    assert "https://" not in page
    assert sorted(p.name for p in out.iterdir() if p.name.startswith(".")) == []  # no temporary files left


def test_the_page_shows_the_comparison_that_is_in_the_folder(folder):
    assert 'src="comparison.png"' in (folder[0] / "index.html").read_text()


def test_operations_are_counted():
    full, closed, folded, traced, _ = operations.count()
    assert full.multiplications == 6 * 64 + 42  # six 4x4 products, and the entries of (2)
    assert full.additions == 6 * 48 + 21
    assert closed.multiplications < full.multiplications / 4
    assert traced.multiplications <= closed.multiplications
    assert abs(folded.multiplications - traced.multiplications) < 10
    assert {row.trigonometric for row in (full, closed, folded, traced)} == {14}
