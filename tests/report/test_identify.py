"""The identification: candidates run as the study cases do, a known truth is approached, a stopped search goes on."""

import copy
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from k1607_pin import data
from k1607_pin.cli import app
from k1607_pin.report.candidates import Candidates, accepted, published_errors, worth
from k1607_pin.report.cases import study_case
from k1607_pin.report.cma import EvolutionStrategy
from k1607_pin.report.determined import AWAY, determined
from k1607_pin.report.identification_figure import figure_identification
from k1607_pin.report.identify import Expedition, Search, _next, identify
from k1607_pin.report.sensitivity import ratios
from k1607_pin.report.starts import angles_of, line_s_end, rotation, start_of, starts, x_of_starts
from k1607_pin.report.unknowns import LOWER, NAMES, UNKNOWNS, UPPER, from_steps, to_steps, values_of, with_values


@pytest.fixture(scope="module")
def committed():
    return data.load("study_cases")["report"]


@pytest.fixture(scope="module")
def outcome(committed):
    return Candidates(committed, threads=1)(values_of(committed)[None])


def test_the_committed_set_is_worth_what_pinocchio_says(committed, outcome):
    assert np.abs(outcome.ratios[0] / ratios(committed) - 1).max() < 1e-3
    assert accepted(outcome, committed["choices"]["joint_limits"])[0]


def test_the_physics_are_converged(committed, outcome):
    finer = Candidates(committed, committed["choices"]["physics_step_s"] / 2, threads=1)(values_of(committed)[None])
    assert np.abs(finer.ratios - outcome.ratios).max() < 1e-5


def test_beta_1_has_no_effect_where_the_committed_set_is(committed, outcome):
    """As docs/study_cases.md has it: without it, and with 1,200 times as much."""
    values = np.tile(values_of(committed), (2, 1))
    values[:, NAMES.index("beta_1")] = [0.0, 1200 * values[0, NAMES.index("beta_1")]]
    without, much = np.abs(Candidates(committed, threads=1)(values).ratios - outcome.ratios).max(axis=1)
    assert without < 1e-4
    assert much < 0.03


def test_worth_is_least_where_all_agree_and_grows_with_each_trouble(outcome):
    ideal = outcome._replace(ratios=np.ones((1, 16)), words=0 * outcome.words, outside=np.zeros(1), alive=np.ones(1))
    assert worth(ideal, True)[0] == 0.0
    for trouble in (
        {"ratios": np.r_[1.5, np.ones(15)][None]},
        {"words": np.array([[1.2, 0.0, 0.0, 0.0]])},
        {"outside": np.array([0.1])},
        {"missed": np.array([1e-3])},
        {"ratios": np.r_[np.full(5, 1.2), np.ones(11)][None]},
    ):
        assert worth(ideal._replace(**trouble), True)[0] > 0.0
        assert accepted(ideal._replace(**trouble), True)[0] == (trouble.get("ratios", np.array([2.0])).max() == 1.2)
    four, five = (ideal._replace(ratios=np.r_[np.full(k, 1.2), np.ones(16 - k)][None]) for k in (4, 5))
    assert worth(five, True)[0] - worth(four, True)[0] > 0.3  # twelve within 10 %, or not
    lost = ideal._replace(ratios=np.full((1, 16), np.nan))
    late, early, never = (worth(lost._replace(alive=np.array([x])), True)[0] for x in (0.9, 0.3, -1.0))
    assert worth(ideal._replace(ratios=np.full((1, 16), 3.0)), True)[0] < late < early < never


def test_steps_and_values_are_each_others_inverse():
    rng = np.random.default_rng(0)
    values = from_steps(rng.uniform(to_steps(LOWER), to_steps(UPPER), (50, len(NAMES))))
    assert np.allclose(from_steps(to_steps(values)), values)
    assert (from_steps(to_steps(values) + 1e3) <= UPPER).all()
    assert (from_steps(to_steps(values) - 1e3) >= LOWER).all()


def test_values_go_into_the_table_and_come_out_again(committed):
    values = values_of(committed) * 0.9
    made = with_values(committed, values, np.zeros((2, 7)))
    assert np.allclose(values_of(made), values)
    assert values_of(committed)[0] == committed["gains"]["K_p_x_N_m"]  # untouched


def test_angles_are_the_rotations():
    rng = np.random.default_rng(1)
    for _ in range(20):
        angles = rng.uniform([1, -179, -179], [179, 179, 179])
        assert np.allclose(angles_of(rotation(*angles)), angles)


def test_starts_hold_the_tool_where_it_is_wanted(committed):
    arm = Candidates(committed).cases[1].plant.arm
    known = np.deg2rad(committed["start"]["case1_deg"])
    wanted = start_of(known) + np.random.default_rng(2).normal(size=(20, 6)) * [1.0, 4, 4, 4, 4, 4]
    postures, found = starts(known, wanted)
    assert found.sum() > 10
    for (one, two), start in zip(postures[found], wanted[found], strict=True):
        for q, x, theta_3 in zip((one, two), x_of_starts(), start[4:], strict=True):
            tool = arm.forward_kinematics(q)
            assert np.allclose(tool.translation, [x, 0.0, start[0] * 0.0254], atol=1e-8)
            assert np.allclose(tool.rotation, rotation(*start[1:4]), atol=1e-8)
            assert np.sin((q[2] - np.deg2rad(theta_3)) / 2) == pytest.approx(0, abs=1e-8)
    assert not starts(known, wanted + 300.0 * np.eye(6)[0])[1].any()  # out of reach


def test_the_line_s_end_is_where_the_arm_can_come_to(committed):
    """Told apart as by the search of all branches that `simulate` makes before it begins."""
    candidates = Candidates(committed, threads=1)
    case = candidates.cases[1]
    q = candidates.known
    bent = q + 0.2 * np.eye(7)[3]  # at the elbow; the committed posture comes to the end of its reach
    missed, way = line_s_end(np.stack([q, bent]))
    for one, end, off in zip((q, bent), way[:, -1], missed, strict=True):
        T, there = case.plant.arm.forward_kinematics(one), case.plant.arm.forward_kinematics(end)
        wanted = T.translation + np.array([9.0, 18.0, 0.0]) * 0.0254
        assert off < 1e-9
        assert np.allclose(there.translation, wanted, atol=1e-9)
        assert np.allclose(there.rotation, T.rotation, atol=1e-9)
    stretched = q.copy()
    stretched[3] = np.deg2rad(20.0)  # the elbow nearly straight: 18 in further there is nothing
    assert line_s_end(stretched[None])[0][0] > 1e-2


def test_a_start_out_of_reach_is_worth_least(committed):
    values = np.tile(values_of(committed), (2, 1))
    values[1, NAMES.index("z0")] = 60.0
    value = worth(Candidates(committed, 0.0025, threads=1)(values), True)
    assert value[1] > value[0] + 10


def test_the_strategy_finds_a_bent_valley():
    def rosenbrock(x):
        return np.sum(100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2, axis=1)

    strategy = EvolutionStrategy(np.zeros(5), 0.3, np.random.default_rng(0), 16)
    for _ in range(400):
        x = strategy.ask()
        strategy.tell(x, rosenbrock(x))
    assert np.abs(strategy.mean - 1).max() < 1e-3


@pytest.fixture(scope="module")
def truth(committed):
    """A set of our own, well within reach, the numbers it would have published, and a start beside it."""
    committed = copy.deepcopy(committed)
    committed["start"]["z0_in"] -= 1.0
    committed["gains"]["K_p_N_m_rad"] *= 0.7  # and its wrist farther from being lost
    start = copy.deepcopy(committed)
    start["gains"]["K_d_x_N_s_m"] *= 0.6
    start["gains"]["K_d_y_N_s_m"] *= 0.6
    start["gains"]["beta_2"] *= 1.3
    candidates = Candidates(committed, 0.0025, threads=1)
    numbers = candidates(values_of(committed)[None]).ratios[0] * published_errors()
    return start, numbers


def test_a_known_truth_is_approached(truth):
    start, numbers = truth
    limits, told = start["choices"]["joint_limits"], []
    found, search = identify(1000, 3, start, limits, None, numbers, 1, lambda *x: told.append(x))
    first, last = (Candidates(x, 0.0025, numbers, threads=1)(values_of(x)[None]) for x in (start, found))
    assert search.best.worth < 0.7 * worth(first, limits)[0]  # six seeds: 0.06 to 0.39 of it
    assert np.abs(np.log(last.ratios)).mean() < np.abs(np.log(first.ratios)).mean()  # six seeds: 0.35 to 0.69 of it
    assert worth(last, limits)[0] == pytest.approx(search.best.worth, rel=0.01)
    assert search.rollouts == told[-1][0] <= 1000
    assert np.all(np.diff([best for _, best in told]) <= 0)


def test_a_search_goes_on_where_it_was_stopped(truth, tmp_path, monkeypatch):
    monkeypatch.setattr("k1607_pin.report.identify.LONG", 32)
    start, numbers = truth
    limits, file = start["choices"]["joint_limits"], tmp_path / "search.json"
    _, whole = identify(200, 3, start, limits, file, numbers, 1)
    assert [one.firm for one in whole.expeditions] == [False, False, True]
    stopped = json.loads(file.read_text())
    del stopped["expeditions"][1:]
    file.write_text(json.dumps(stopped))
    _, again = identify(200, 3, start, limits, file, numbers, 1)
    assert again == whole
    with pytest.raises(ValueError, match="another search"):
        identify(200, 4, start, limits, file, numbers)


def test_another_search_does_not_go_on_with_a_file(truth, tmp_path):
    table, errors = truth
    identify(64, 0, table, out=tmp_path / "s.json", published=errors, threads=1)
    for other in ((None, errors), (table, 2 * errors), (table, None)):
        with pytest.raises(ValueError, match="of another search"):
            identify(64, 0, other[0], out=tmp_path / "s.json", published=other[1], threads=1)


def test_a_search_may_begin_anywhere(truth):
    _, errors = truth
    (_, first), (_, second) = (identify(1, 5, published=errors, threads=1) for _ in range(2))
    assert first == second
    assert first.best.of == -1
    q = np.array(first.best.posture)
    arm = study_case(1).plant.arm
    assert (q >= np.maximum(arm.lower, -np.pi)).all()
    assert (q <= np.minimum(arm.upper, np.pi)).all()
    np.testing.assert_allclose(arm.forward_kinematics(q).translation[:2], [x_of_starts()[0], 0.0], atol=1e-6)


def test_the_best_is_the_best_of_those_that_are_firm():
    loose, firm, worse = (
        Expedition(0, worth=x, firm=y, accepted=k) for x, y, k in ((0.1, False, 5), (0.2, True, 9), (0.3, True, 1))
    )
    search = Search(0, True, {}, {}, [worse, loose, firm])
    assert search.best is firm
    search.expeditions.pop()
    assert search.best is worse
    search.expeditions = [Expedition(0, rollouts=100, worth=0.1, accepted=2), Expedition(0, worth=0.2, accepted=9)]
    assert _next(search, None, 100)[0] == 1  # where there is most room, not the best


def test_how_far_each_may_go_contains_the_set_and_holds(committed):
    limits = committed["choices"]["joint_limits"]
    ranges = determined(committed, threads=1)
    values = values_of(committed)
    assert (ranges.lower <= values).all()
    assert (ranges.upper >= values).all()
    ends = np.array(
        [np.where(np.arange(len(values)) == k, end[k], values) for end in ranges[:2] for k in range(len(values))]
    )
    assert accepted(Candidates(committed, threads=1)(ends), limits).all()
    assert np.mean(ranges.upper > ranges.lower) > 0.7  # some have no room on the grid of steps
    steps = {side: to_steps(end) for side, end in zip((-1, 1), ranges[:2], strict=True)}
    here, beyond = to_steps(values), []
    for side, end in steps.items():
        for k in np.flatnonzero((end > to_steps(LOWER) + 1e-6) & (end < to_steps(UPPER) - 1e-6)):
            away = abs(end[k] - here[k])
            tried = AWAY[np.searchsorted(AWAY, away + 1e-6)] if away + 1e-6 < AWAY[-1] else None
            if tried is not None and k != NAMES.index("duration"):
                beyond.append(here + side * tried * np.eye(len(here))[k])
    assert len(beyond) > 20
    assert not accepted(Candidates(committed, threads=1)(from_steps(np.array(beyond))), limits).any()
    assert 3 <= len(ranges.pairs) < 60
    for one, other, correlation in ranges.pairs:
        assert one in NAMES
        assert other in NAMES
        assert 0.8 < abs(correlation) < 1
    figure = figure_identification(committed, ratios(committed), ranges)
    texts = [label.get_text() for axes in figure.axes for label in axes.get_yticklabels()]
    assert all(any(text.startswith(one.name) for text in texts) for one in UNKNOWNS)


def test_the_command_tells_set_and_ratios(tmp_path, monkeypatch, committed):
    monkeypatch.chdir(tmp_path)
    ran = CliRunner().invoke(app, ["identify", "--budget", "64", "--threads", "1", "--json"])
    assert ran.exit_code == 0, ran.output
    told = json.loads(ran.stdout)
    assert told["rollouts"] == 64
    assert np.abs(np.array(told["ratios"]) - 1).max() <= 0.25  # no worse than the committed set, where it begins
    assert set(told["report"]) == set(committed)
    assert (tmp_path / "identified.json").exists()


@pytest.mark.parametrize(
    ("arguments", "words"), [({"budget": 0}, "budget"), ({"seed": -1}, "seed"), ({"budget": 1.5}, "budget")]
)
def test_what_makes_no_sense_is_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        identify(**arguments)


def test_a_file_that_is_no_search_is_refused(tmp_path):
    file = tmp_path / "x.json"
    file.write_text("[1, 2]")
    with pytest.raises(ValueError, match="not of a search"):
        identify(100, out=file)


@pytest.fixture
def search(tmp_path):
    """Of two expeditions, and its file."""
    search = Search(0, True, {"joint_limits": True}, {"start": "anywhere"})
    for k in range(2):
        search.expeditions.append(Expedition(-1, 100, 0.5 + k, [1.0, 0.1], [0.25] * 7))
    search.save(tmp_path / "x.json")
    return search, tmp_path / "x.json"


def again(search):
    return Search(search.seed, search.limits, search.choices, search.of)


def test_a_search_comes_back_from_its_file(search):
    """Infinities too; and what is left of it where its last expeditions are taken out."""
    search, file = search
    found = again(search)
    found.load(file)
    assert found == search
    told = json.loads(file.read_text())
    del told["expeditions"][1]
    file.write_text(json.dumps(told))
    found = again(search)
    found.load(file)
    assert found.expeditions == search.expeditions[:1]


def test_no_single_bit_of_a_search_s_file_is_taken_for_another_number(search):
    search, file = search
    whole, rng, refused = file.read_bytes(), np.random.default_rng(0), []
    for at, bit in zip(rng.integers(len(whole), size=300), rng.integers(8, size=300), strict=True):
        file.write_bytes(whole[:at] + bytes([whole[at] ^ (1 << bit)]) + whole[at + 1 :])
        found = again(search)
        try:
            found.load(file)
        except ValueError as error:
            refused.append(str(error))
        else:
            assert found == search  # a space that is another one
    assert len(refused) > 100
    assert all(str(file) in text for text in refused)


@pytest.mark.parametrize(
    "content", [b"", b"\xff\xfe", b"[" * 100_000, b"null", b"{}", b'{"expeditions": 3}', b'{"expeditions": [3]}']
)
def test_what_is_no_search_is_named(search, content):
    search, file = search
    file.write_bytes(content)
    with pytest.raises(ValueError, match=r"out: .*x\.json is not of a search, or is damaged"):
        again(search).load(file)


def test_expeditions_of_an_earlier_version_or_in_another_order_are_refused(search):
    search, file = search
    told = json.loads(file.read_text())
    told["expeditions"].reverse()
    file.write_text(json.dumps(told))
    with pytest.raises(ValueError, match=r"expedition 0 of .*x\.json is damaged"):
        again(search).load(file)
    for one in told["expeditions"]:
        del one["sha256"]
    file.write_text(json.dumps(told))
    with pytest.raises(ValueError, match="has no checksum, as an earlier version wrote it"):
        again(search).load(file)
