"""The learning rate: what each law itself does at rest, linear in beta_1 and Gamma, and swept from none to lost."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from k1607_pin.arm.payload import Payload
from k1607_pin.control.baselines import Regressor, SlotineLi
from k1607_pin.control.cartesian import CartesianAdaptive
from k1607_pin.paths.report_paths import PathPoint
from k1607_pin.report.comparison import TROUBLES, compare
from k1607_pin.report.laws import LAWS
from k1607_pin.report.learning import (
    compared,
    edge,
    holding,
    learning_curve,
    learning_rate,
    load_of,
    with_learning_rate,
)
from k1607_pin.report.learning_figure import ADAPTING, at, figure_learning, multiples, summary


@pytest.fixture(scope="module", params=[*ADAPTING, "joint adaptive"])
def cell(request):
    return compared(request.param, 1, 0.01)


def error_by_itself(law, q, load, samples):
    """(samples,) |e| of the law held against a load at rest: each sample its own `update`, then the error that balances it."""
    still, state, sizes = (
        np.zeros(7),
        law.start(q, np.zeros(7), 0.01) if isinstance(law, SlotineLi) else law.initial(q, 0 * q),
        [],
    )
    tool, unknown = law.arm.forward_kinematics(q), load
    first = state
    for k in range(samples):
        if isinstance(law, SlotineLi):
            learnt = Regressor(law.arm)(q, still, still, still) @ (state - first)
            e = np.linalg.solve(law.omega * law.K_D, unknown - learnt)
            now = replace(law, path=_Still(q + e))
        elif isinstance(law, CartesianAdaptive):
            force = law.arm.operational_space(q, still).jacobian_bar.T @ unknown
            e = np.linalg.solve(state.gains.K_p, force)
            now = replace(law, path=_Still(tool.translation + e[:3]), rotation=pin.exp3(e[3:]) @ tool.rotation)
        else:
            e = np.linalg.solve(state.gains.K_p, unknown)
            now = replace(law, path=_Still(q + e))
        sizes.append(np.linalg.norm(e))
        state = now.update(k * law.period, q, still, state)[1]
    return np.array(sizes)


class _Still:
    def __init__(self, position):
        self.position = position

    def __call__(self, t):
        return PathPoint(self.position, 0 * self.position, 0 * self.position)


def test_it_is_how_fast_the_law_s_own_updates_take_the_error_away(cell):
    """A hundredth of a per cent of the error a sample, so that the samples are a derivative."""
    law, q = cell.law, cell.q0
    load = 0.01 * load_of(law, q, cell.payload)  # small, so that the error does not move the arm
    slow = with_learning_rate(law, 1e-4 / law.period, q, load)
    if not isinstance(slow, SlotineLi):
        slow = replace(slow, beta_2=0.0)
    sizes = error_by_itself(slow, q, load, 3)
    assert -np.diff(np.log(sizes))[0] / law.period == pytest.approx(1e-4 / law.period, rel=1e-3)


def test_any_law_can_be_given_any_rate(cell):
    law, q, load = cell.law, cell.q0, load_of(cell.law, cell.q0, cell.payload)
    for rate in (0.0, 0.3, 20.0):
        assert learning_rate(with_learning_rate(law, rate, q, load), q, load) == pytest.approx(rate, rel=1e-9)
    power = 0 if isinstance(law, SlotineLi) else 2  # what is small gains do not learn
    assert learning_rate(law, q, 0.5 * load) == pytest.approx(0.5**power * learning_rate(law, q, load), rel=1e-9)


def test_what_a_law_knows_is_no_load():
    told, alone = (compared(name, 1, 0.01) for name in ("joint adaptive + g", "joint adaptive"))
    q, arm = told.q0, told.law.arm
    assert load_of(alone.law, q, Payload(0.0)) == pytest.approx(arm.gravity_torque(q))
    nothing = load_of(told.law, q, Payload(0.0))
    assert not nothing.any()
    with pytest.raises(ValueError, match="there is nothing to learn"):
        learning_rate(told.law, q, nothing)
    with pytest.raises(ValueError, match="rate: expected a number >= 0 in 1/s, got -1"):
        with_learning_rate(told.law, -1, q, nothing)


HOLDS = np.array([True, True, True, False, True, False, False])
LOST = np.array([False, False, False, False, False, True, True])


@pytest.mark.parametrize(
    ("holds", "lost", "bracket"),
    [
        (HOLDS, LOST, (2, 5)),
        (HOLDS & False, ~LOST | True, (0, 0)),
        (HOLDS | True, LOST & False, (6, np.inf)),
        (np.arange(7) < 3, np.arange(7) >= 3, (2, 3)),
    ],
)
def test_the_edge_is_a_bracket(holds, lost, bracket):
    assert edge(np.arange(7.0), holds, lost) == bracket


@pytest.fixture(scope="module")
def curve():
    return learning_curve(compared("joint adaptive + g", 1, 0.01), [0.1, 1.0, 1e2, 1e4, 1e7])


def test_from_none_to_lost(curve):
    """Held: what is learnt takes the error away, the more the faster. 1e7 times the rate turns the gains' sign in a sample."""
    kept = curve.rms[(curve.rate <= curve.holds_to).values].values
    assert (np.diff(kept[:5]) < 0).all()
    assert kept[4] < 0.5 * kept[0]
    assert curve.lost.values[-1]
    assert np.isinf(curve.rms.values[-1])
    assert 1e4 * curve.own <= curve.holds_to < curve.lost_from <= 1e7 * curve.own
    assert at(curve, 2 * curve.lost_from) == np.inf
    assert at(curve, 0.0) == kept[0]


def test_its_runs_are_the_comparison_s(curve):
    """The same cell by `simulate`: with the law's own rate."""
    name = "joint adaptive + g"
    (row,) = compare({name: LAWS[name]}, [1], [0.01], [9.81], TROUBLES[:1])
    assert float(curve.rms.sel(factor=1.0)) == pytest.approx(row.rms, rel=1e-6)


def test_table_and_figure(curve):
    assert "lost" in multiples({"cell": curve}, (0.0, 1.0, 1e7))
    assert summary({"cell": curve}).count("\n") == 2
    (axes,) = figure_learning({"a condition": {"a law": curve}}).axes
    assert axes.get_xlabel() == "learning rate [1/s]"
    assert axes.get_xticklabels()[0].get_text() == "none"


@pytest.mark.parametrize("name", ["Cartesian adaptive + g", "joint adaptive + g"])
def test_holding_still_learns_the_payload(name):
    """Three seconds at a rate of the order of 1 /s: the payload's error falls while it is carried, and none is lost."""
    cell = holding(compared(name, 1, 0.01), 3.0)
    found = learning_curve(cell, [100.0])
    assert found.holds.all()
    assert found.lost_from == np.inf
    assert 0 < float(found.rms[1]) < float(found.rms[0])


def test_what_makes_no_curve_is_refused():
    cell = compared("joint adaptive + g", 1, 0.01, duration=0.3)
    with pytest.raises(ValueError, match="factors: expected none below 0"):
        learning_curve(cell, [-1.0])
    with pytest.raises(ValueError, match="a law that learns"):
        learning_curve(replace(cell, law=replace(cell.law, beta_1=0.0)), [1.0])
