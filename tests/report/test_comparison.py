"""The comparison: what it says of a run is so, nothing is lost when it is interrupted, and who wins where."""

from dataclasses import replace

import numpy as np
import pytest

from k1607_pin.control.baselines import parameters
from k1607_pin.paths.inverse_path import joint_path
from k1607_pin.report.cases import study_case
from k1607_pin.report.comparison import TROUBLES, Trouble, compare
from k1607_pin.report.comparison_figures import best, condition, figure_comparison, table
from k1607_pin.report.laws import LAWS, setting, with_masses
from k1607_pin.report.noisy import Noisy
from k1607_pin.report.rows import Row, loaded


@pytest.fixture(scope="module")
def rows():
    """10 ms, the line: every law, a right model and one too light by 30 %."""
    shares = []
    out = list(compare(cases=[1], periods=[0.01], troubles=TROUBLES[:2], duration=1.5, progress=shares.append))
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert len(shares) == len(out)
    return out


def rms(rows, law, gravity=9.81, trouble="payload"):
    (row,) = (row for row in rows if (row.law, row.gravity, row.trouble) == (law, gravity, trouble))
    return row.rms


def test_nothing_is_lost_at_a_gain_that_theory_calls_stable(rows):
    assert all(np.isfinite(row.rms) for row in rows)
    assert {row.law for row in rows} == set(LAWS)


def test_without_gravity_s_torque_the_adaptive_schemes_lose_in_full_gravity(rows):
    for law in ("Cartesian adaptive", "joint adaptive"):
        assert rms(rows, law) > 4 * rms(rows, "PD + g")


def test_slotine_li_wins_under_payload_and_wrong_masses(rows):
    for trouble in ("payload", "model -30 %"):
        others = [law for law in LAWS if law != "Slotine-Li"]
        assert rms(rows, "Slotine-Li", trouble=trouble) < 0.8 * min(rms(rows, law, trouble=trouble) for law in others)


def test_weightless_the_model_s_acceleration_term_wins_over_pd(rows):
    for law in ("computed torque", "operational space"):
        assert rms(rows, law, 0.0) < 0.2 * min(
            rms(rows, x, 0.0) for x in ("PD + g", "joint adaptive", "Cartesian adaptive")
        )


def test_adaptation_earns_little_at_the_rate_that_is_carried_over(rows):
    fixed, adaptive = (rms(rows, law) for law in ("Cartesian, gains fixed", "Cartesian adaptive"))
    assert 0.9 * fixed < adaptive < fixed


PD = {"PD + g": LAWS["PD + g"]}


def test_rows_survive_an_interruption_and_are_not_run_again(tmp_path):
    file, made = tmp_path / "rows.csv", []

    def law(setting):
        made.append(setting)
        return LAWS["PD + g"](setting)

    def short():
        return compare({"PD + g": law}, [1], [0.01], troubles=TROUBLES[:2], duration=0.3, file=file)

    some = short()
    first, second = next(some), next(some)
    some.close()
    assert loaded(file) == [first, second]
    assert len(made) == 2
    file.write_text(file.read_text() + "PD + g,1,0.01,0.0,payl")  # cut off while it was written
    rows = list(short())
    assert rows[:2] == [first, second]
    assert len(made) == len(rows) == 4
    assert loaded(file) == rows
    assert list(short()) == rows
    assert len(made) == 4


def test_rows_of_other_conditions_stay_in_the_file(tmp_path):
    file = tmp_path / "rows.csv"
    (line,) = compare(PD, [1], [0.01], [9.81], TROUBLES[:1], duration=0.3, file=file)
    (circle,) = compare(PD, [2], [0.01], [9.81], TROUBLES[:1], duration=0.3, file=file)
    assert loaded(file) == [line, circle]
    assert list(compare(PD, [2, 1], [0.01], [9.81], TROUBLES[:1], duration=0.3, file=file)) == [circle, line]


@pytest.mark.parametrize(
    "text",
    [
        "a,b\n1,2\n",
        "HEAD\nPD + g,1,0.01,9.81,payload,x,0,0,0\n",
        "HEAD\nPD + g,1\n",
        "HEAD\nPD + g,1,0.01,9.81,payload,nan,0,0,0\n",
        "HEAD\nPD + g,1,0.01,9.81,payload,-1,0,0,0\n",
        "HEAD\nPD + g,1,0.01,9.81,payload,0,0,0,0,0\n",
    ],
)
def test_a_file_with_something_else_in_it_is_refused_and_left_alone(tmp_path, text):
    file = tmp_path / "rows.csv"
    text = text.replace("HEAD", "law,case,period,gravity,trouble,rms,largest,torque,chatter")
    file.write_text(text)
    with pytest.raises(ValueError, match="file: expected"):
        next(compare(PD, [1], [0.01], file=file))
    assert file.read_text() == text


def test_a_law_that_no_other_process_can_be_given_is_refused():
    with pytest.raises(ValueError, match="'mine' is no module's function"):
        next(compare({"mine": lambda s: None}, jobs=2))
    with pytest.raises(ValueError, match="jobs: expected"):
        next(compare(jobs=0))


class Torque:
    """A law of nothing but a torque over the samples, so that what comes out is known beforehand."""

    def __init__(self, of_sample):
        self.of_sample = of_sample

    def start(self, q, v, duration):
        return 0

    def update(self, t, q, v, sample):
        return self.of_sample(sample), sample + 1, {}


def test_a_lost_loop_is_told_as_such():
    """An arm without torque falls: its tool is 25 cm off its path within a second."""
    (row,) = compare({"limp": lambda s: Torque(lambda k: np.zeros(7))}, [1], [0.01], [9.81], TROUBLES[:1], duration=1.5)
    assert row.rms == np.inf
    assert "lost" in table([row])
    assert figure_comparison([row]).axes


def test_torques_that_rattle_between_their_limits_are_marked():
    """Joint 1 pushed to and fro, weightless: a root mean square, over joints and changes, of 0.6 of the limits."""

    def to_and_fro(s):
        return Torque(lambda k: 0.3 * np.sqrt(7) * s.limit * (-1.0) ** k * np.eye(7)[0])

    (row,) = compare({"to and fro": to_and_fro}, [1], [0.001], [0.0], TROUBLES[:1], duration=0.03)
    assert np.isfinite(row.rms)
    assert row.chatter == pytest.approx(0.6)
    assert "†" in table([row])
    assert best([row]) == {condition(row): []}  # which is no way to win


def test_table_and_figure(rows):
    text = table(rows)
    assert len(text.splitlines()) == 2 + 4  # two gravities, two troubles
    assert all("**" in line for line in text.splitlines()[2:])  # a best in every line
    assert len(figure_comparison(rows).axes) == 2
    two = [Row("a", 1, 0.01, 9.81, "t", 1e-3, 0, 0, 0), Row("b", 1, 0.01, 9.81, "t", 2e-3, 0, 0, 0)]
    assert table(two).splitlines()[2:] == ["| line, 10 ms, 1 g, t | **1** | 2 |"]
    near = replace(two[0], law="c", rms=1.01e-3)
    assert best([near, *two]) == {"line, 10 ms, 1 g, t": [two[0], near]}


def test_masses_are_scaled_and_rotors_are_not(reference):
    light, q = with_masses(reference, 0.7), np.full(7, 0.3)
    assert parameters(light) == pytest.approx(0.7 * parameters(reference))
    assert light.gravity_torque(q) == pytest.approx(0.7 * reference.gravity_torque(q))
    rotors = np.diag(reference.armature)
    assert light.mass_matrix(q) - rotors == pytest.approx(0.7 * (reference.mass_matrix(q) - rotors))
    with pytest.raises(ValueError, match="factor"):
        with_masses(reference, 0.0)


def test_noise_is_what_it_says_and_the_same_again(reference):
    class Eyes:
        def start(self, q, v, duration):
            return None

        def update(self, t, q, v, state):
            return np.zeros(7), None, {"saw": np.concatenate([q, v])}

    zero = np.zeros(7)
    logs = []
    for _ in range(2):
        law = Noisy(Eyes(), 0.001, (1e-3, 1e-1), seed=4)
        state = law.start(zero, zero, 2.0)
        seen = []
        for k in range(2001):
            _, state, log = law.update(k * 0.001, zero, zero, state)
            seen.append(log["saw"])
        logs.append(np.array(seen))
    assert (logs[0] == logs[1]).all()
    assert logs[0][:, :7].std() == pytest.approx(1e-3, rel=0.03)
    assert logs[0][:, 7:].std() == pytest.approx(1e-1, rel=0.03)


def test_every_law_is_told_the_same_wrong_model():
    case = study_case(1, "recommended")
    path = joint_path(case.plant.arm, case.law.path, case.q0, 0.3, case.law.rotation)
    s = setting(case, path, 0.01, model=Trouble("x", 1.3).model)
    q = case.q0
    assert s.arm.gravity_torque(q) == pytest.approx(1.3 * case.plant.arm.gravity_torque(q))
    assert all(make(s).arm is s.arm for make in LAWS.values())
