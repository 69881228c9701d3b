"""Payload schedules: steps, ramps, and what a mixture of two bodies is."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from k1607_pin.arm.payload import Payload, blend
from k1607_pin.simulation.schedule import NOTHING, PayloadSchedule

BOX = Payload(4.5, np.array([0.0, 0.0, 0.1]), np.diag([0.03, 0.03, 0.02]))
BAR = Payload(2.0, np.array([0.3, -0.1, 0.0]), np.diag([0.01, 0.2, 0.2]))


def inertia(payload):
    return pin.Inertia(payload.mass, payload.cg, payload.inertia).matrix()


@given(
    st.floats(0, 1), st.sampled_from([NOTHING, BOX, BAR, Payload(3.0, BAR.cg)]), st.sampled_from([NOTHING, BOX, BAR])
)
def test_a_blend_s_spatial_inertia_is_the_mean(share, first, second):
    expected = (1 - share) * inertia(first) + share * inertia(second)
    assert np.abs(inertia(blend(first, second, share)) - expected).max() < 1e-14


def test_a_step_comes_at_its_time_and_stays_one_object():
    schedule = PayloadSchedule([(1.0, BOX), (2.0, Payload(0.0))], 3.0)
    assert schedule.at(0.99) is NOTHING
    assert schedule.at(1.0) is BOX
    assert schedule.at(1.99) is BOX
    assert schedule.at(2.5).mass == 0


def test_a_ramp_grows_linearly_and_ends_exactly():
    schedule = PayloadSchedule([(1.0, BOX, 0.5), (2.0, Payload(0.0), 0.5)], 3.0)
    assert schedule.at(1.25).mass == pytest.approx(BOX.mass / 2, rel=1e-15)
    assert schedule.at(1.25).cg == pytest.approx(BOX.cg, abs=1e-15)
    assert schedule.at(1.5) is BOX
    assert schedule.at(2.25).mass == pytest.approx(BOX.mass / 2, rel=1e-15)
    assert schedule.at(2.5).mass == 0


@given(st.floats(0, 4), st.floats(0, 0.5))
def test_shares_are_what_is_carried_and_what_is_new(t, ago):
    changes = [(0.5, BOX), (1.0, BAR, 0.5), (2.0, Payload(0.0), 0.3), (3.0, BOX, 0.7)]
    schedule = PayloadSchedule(changes, 4.0)
    bodies = np.array([inertia(change[1]) for change in changes])
    carried = np.tensordot(schedule.shares(t), bodies, 1)
    assert np.abs(carried - inertia(schedule.at(t))).max() < 1e-14
    gripped = np.tensordot(schedule.gripped_shares(t - ago, t), bodies, 1)
    assert np.abs(gripped - inertia(schedule.gripped(t - ago, t))).max() < 1e-14


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ([(0.5, BOX), (0.2, BAR)], r"payloads\[1\].*got 0.2 s"),
        ([(0.5, BOX, 1.0), (1.0, BAR)], r"payloads\[1\].*complete"),
        ([(5.0, BOX)], r"payloads\[0\].*to the end, 3 s"),
        ([(-1.0, BOX)], r"payloads\[0\]"),
        ([(np.nan, BOX)], r"payloads\[0\]"),
        ([(1.0, BOX, -0.1)], r"ramp >= 0"),
        ([(1.0, 4.5)], r"payloads\[0\].*Payload"),
        ([1.0], r"payloads\[0\]"),
    ],
)
def test_schedules_that_make_no_sense_are_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        PayloadSchedule(changes, 3.0)
