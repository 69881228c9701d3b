"""The study cases by the joint-space scheme."""

import numpy as np
import pytest

from k1607_pin.control.practice import Practice
from k1607_pin.report.cases import study_case
from k1607_pin.report.joint_cases import figure_joint_case, joint_case


@pytest.mark.parametrize("number", [1, 2])
def test_the_tool_stays_on_its_path_while_a_payload_comes_and_goes(number):
    run, case = joint_case(number, period=0.004), study_case(number, "recommended")
    assert float(run.time[-1]) == pytest.approx(case.duration)
    carried = run.time.values[run.payload.values > 0]
    assert carried[[0, -1]] == pytest.approx([case.duration / 3, case.duration * 2 / 3], abs=0.005)
    distance = np.linalg.norm(run.tool_position.values - case.law.path(run.time.values).position, axis=1)
    assert distance.max() < 8e-3  # m: gravity's sag, which is as omega^-2
    assert np.abs(run.joint_error).max() < 0.012  # rad
    assert len(figure_joint_case(run).axes) == 2


@pytest.mark.parametrize(("number", "largest", "when"), [(1, 0.34e-3, 2.0), (2, 0.52e-3, 3.7)])
def test_at_1_khz_it_is_as_docs_comparison_has_it(number, largest, when):
    run = joint_case(number)
    distance = np.linalg.norm(run.error.values[:, :3], axis=1)
    assert distance.max() == pytest.approx(largest, rel=0.02)
    assert run.time.values[distance.argmax()] == pytest.approx(when, abs=0.05)


def test_gravity_s_torque_and_adaptation_each_do_their_part():
    short = {"duration": 0.9, "period": 0.002}
    sag, held = (joint_case(1, **short, practice=Practice(gravity=g)) for g in (False, True))
    assert np.abs(held.error[:, :3]).max() < 0.5 * np.abs(sag.error[:, :3]).max()
    fixed = joint_case(1, **short, adapting=False)
    assert (fixed.K_p[-1] == fixed.K_p[0]).all()
    assert (sag.K_p[-1] != sag.K_p[0]).any()


def test_no_such_case():
    with pytest.raises(ValueError, match="study case 1 or 2"):
        joint_case(3)
