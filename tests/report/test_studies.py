"""Parts 1-3: against independent derivatives, and against the published maxima."""

import dataclasses

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.report import published, studies
from k1607_pin.report.trajectory_search import GOOD, miss


@pytest.fixture(scope="module")
def motion():
    return studies.identified_trajectory()


def test_velocities_are_the_derivative_of_the_angles(motion):
    t, h = np.linspace(0.1, 9.9, 50), 1e-5
    numeric = (motion.angles(t + h) - motion.angles(t - h)) / (2 * h)
    # central difference: h^2/6 times a third derivative of 0.33 x 2.5^3 rad/s^3, plus rounding 2e-16/h
    assert np.abs(numeric - motion.velocities(t)).max() < 1e-9


def test_the_lower_loop_agrees_with_pinocchio(motion):
    arm = k1607.load_k1607()
    t = np.linspace(0, 10, 40)
    ours = studies.jacobian_velocity(motion, t)
    theirs = [arm.jacobian(motion.angles(s)) @ motion.velocities(s) for s in t]
    assert np.abs(ours - theirs).max() < 1e-12


def test_part_1_error_is_half_the_period_times_the_acceleration(motion):
    T = 1e-3
    result = studies.part_1(motion, T)
    h = 1e-4
    a = (studies.jacobian_velocity(motion, result.time + h) - studies.jacobian_velocity(motion, result.time - h)) / (
        2 * h
    )
    assert np.abs(result.error - T / 2 * a).max() < T * T * np.abs(a).max() * 10


def test_part_3_is_half_the_period_times_part_1(motion):
    """The relation that makes figures 6 and 11 contradict each other, to third order in the angle of a period."""
    T = 0.01
    error_1 = studies.part_1(motion, T, studies.SCHEMES["backward, rotation vector"]).error[:, 3:]
    error_3 = studies.part_3(motion, T).error
    angle = T * np.abs(studies.jacobian_velocity(motion, studies.times(motion, T))[:, 3:]).max() * np.sqrt(3)
    assert np.abs(np.asarray(error_3) - T / 2 * np.asarray(error_1)).max() < angle**3 / 24


def test_orders_of_differencing(motion):
    study = studies.sampling_study(motion, np.geomspace(1e-3, 2e-2, 6))
    for scheme in studies.SCHEMES:
        order = 1 if scheme.startswith("backward") else 2
        assert np.abs(study.slope.sel(scheme=scheme, component=["v_x", "omega_x"]) - order).max() < 0.01


def test_the_leading_term_is_the_error_of_v_x(motion):
    study = studies.sampling_study(motion, np.array([2e-3, 4e-3]))
    v_x = study.sel(component="v_x")
    assert np.abs(v_x.error / v_x.leading_term - 1).max() < 0.01  # next term: smaller by the period times a frequency


def test_the_exact_rotation_vector_helps_central_differences(motion):
    central, exact = (
        studies.worst_error(motion, 0.05, studies.SCHEMES[f"central, {way}"])[3]
        for way in ("eq. (35)", "rotation vector")
    )
    assert exact < 0.75 * central


def test_largest_period_is_where_the_error_reaches_the_tolerance(motion):
    T = studies.largest_period(motion, "omega_x", 1e-3)
    assert studies.worst_error(motion, T, studies.BACKWARD)[3] == pytest.approx(1e-3, rel=1e-4)
    assert studies.largest_period(motion, "omega_x", 1e-12) == 1e-4
    assert studies.largest_period(motion, "omega_x", 1e12) == 0.5


def test_same_instant_reading_of_part_2_does_not_depend_on_the_period(motion):
    shares = [studies.part_2(motion, T, "same instant").attrs["relative_error"] for T in (0.01, 0.1)]
    assert shares[0] == pytest.approx(shares[1], rel=0.02)  # sampled maxima of one curve


@pytest.mark.parametrize("period", [0.0, -0.01, np.nan, np.inf, 100.0])
def test_bad_periods_are_refused(motion, period):
    with pytest.raises(ValueError, match="period"):
        studies.part_1(motion, period)


def test_unknown_reading_is_refused(motion):
    with pytest.raises(ValueError, match="late pseudo-inverse"):
        studies.part_2(motion, 0.01, "literal")


def test_every_published_maximum_that_can_be_met_is_met(motion):
    rows = {r.id: r for r in published.compare(motion)}
    assert rows.pop("part3.delta_beta.100ms").verdict == "contradicts figure 6"
    assert rows.pop("conclusion.max_period").verdict == "derived"
    assert {r.verdict for r in rows.values()} == {"met", "agrees"}
    assert all(abs(r.ratio - 1) <= 0.25 for r in rows.values() if r.ratio is not None)
    assert len(rows) == 10


def test_other_motions_do_not_agree(motion):
    """The verdicts can fail: twice the amplitude of every joint misses figures, and its errors are not negligible."""
    wild = dataclasses.replace(motion, amplitude=3 * motion.amplitude)
    verdicts = {r.id: r.verdict for r in published.compare(wild)}
    assert verdicts["part1.vx.100ms"] == "not met"
    assert verdicts["part2.theta1.10ms"] == "disagrees"
    assert verdicts["part3.delta_gamma.10ms"] == "disagrees"


def test_the_motion_stays_within_the_arm_limits_and_clear_of_singularities(motion):
    arm = k1607.load_k1607()
    t = np.linspace(0, 10, 500)
    q, v = motion.angles(t), motion.velocities(t)
    assert (q >= arm.lower).all()
    assert (q <= arm.upper).all()
    assert (np.abs(v) <= arm.velocity_limit).all()
    assert np.linalg.svd(k1607.closed_form.jacobian(q), compute_uv=False)[:, -1].min() > 0.05


def test_the_identified_set_is_what_the_search_calls_good(motion):
    angles = np.rad2deg(np.concatenate([motion.centre, motion.amplitude]))
    assert (motion.phase == 0).all()
    assert miss(angles) < 2 * GOOD
    angles[8] *= -1  # joint 2 the other way
    assert miss(angles) > 10 * GOOD


def test_only_one_reading_explains_both_of_figure_11_s_maxima(motion):
    both = [
        reading.reading
        for reading in studies.delta_beta_readings(motion)
        if abs(reading.delta_beta / 15 - 1) < 0.25 and abs(reading.delta_gamma / 0.15 - 1) < 0.25
    ]
    assert both == ["the curve is delta xi, about z"]
