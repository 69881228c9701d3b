"""The search for what study cases 1 and 2 need and the report does not give: from many starts, the best of them followed up."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from k1607_pin import data
from k1607_pin.compiled.samples import digest
from k1607_pin.files import checksum, write_atomically
from k1607_pin.report.candidates import Candidates, accepted, worth
from k1607_pin.report.cma import EvolutionStrategy
from k1607_pin.report.starts import posture_somewhere, start_of, starts
from k1607_pin.report.unknowns import DRAWN, NAMES, from_steps, to_steps, values_of, with_values

COARSE = 0.0025  # s, physics step of the search; what it finds is run again with the table's own
POPULATION = 32
TRIED = 128  # sets that are drawn for a posture, to begin with the best of them
SHORT, LONG = (
    640,
    16_000,
)  # sets of unknowns that an expedition from a drawn posture takes, and one that follows another up
PATIENCE = 60  # populations without a better one
EXPLORED = 0.5  # share of the budget for drawn postures
FOLLOWED = 4  # of which so many are followed up
SIGMAS = (0.3, 0.6, 0.9)  # first steps of those that follow up, in turn
FINE = 0.1  # of those that make firm
FIRM = 0.4  # share of the budget for making the best one firm:
MARGIN = (
    0.02  # it shall hold with the gain that the wrist's vibration hangs on, K_p rot, changed by so much up and down
)
SHAKEN = 3.0  # worth of one that does not
START = slice(NAMES.index("z0"), NAMES.index("theta_3 circle") + 1)


@dataclass
class Expedition:
    """One descent."""

    of: int
    """Number of the one that it follows up; -1 for a drawn posture, -2 for the set that was given"""
    rollouts: int = 0
    worth: float = np.inf
    values: list[float] = field(default_factory=list)
    posture: list[float] = field(default_factory=list)
    """(7,) rad, at the start of case 1"""
    accepted: int = 0
    """Sets with all 16 numbers within 25 % that were met"""
    lowest: list[float] = field(default_factory=lambda: [np.inf] * len(NAMES))
    highest: list[float] = field(default_factory=lambda: [-np.inf] * len(NAMES))
    """of their values"""
    firm: bool = False
    """Whether its worth counts the `MARGIN` too"""


@dataclass
class Search:
    """All expeditions so far, and what they had in common. Ends and goes on with the file that it is kept in."""

    seed: int
    limits: bool
    choices: dict[str, Any]
    of: dict[str, str]
    """Digests of what is fitted and where it begins"""
    expeditions: list[Expedition] = field(default_factory=list)

    @property
    def rollouts(self) -> int:
        """In all."""
        return sum(one.rollouts for one in self.expeditions)

    @property
    def best(self) -> Expedition:
        """Of least worth, the firm ones first."""
        return min(self.expeditions, key=lambda one: (not one.firm, one.worth))

    def save(self, file: Path | None) -> None:
        """As JSON, whole or not at all; each expedition with a checksum, bound to the search and to its number."""
        if file is not None:
            told = asdict(self)
            told["expeditions"] = [x | {"sha256": self._checksum(k, x)} for k, x in enumerate(told["expeditions"])]
            write_atomically(file, json.dumps(told, indent=1))

    def load(self, file: Path | None) -> None:
        """Expeditions of a file, if there is one.

        Raises
        ------
        ValueError
            The file is of another search, or none, or damaged.
        """
        if file is None or not file.exists():
            return
        try:
            told = json.loads(file.read_bytes())
            found = [(one.pop("sha256", None), one) for one in told.pop("expeditions")]
            expeditions = [Expedition(**one) for _, one in found]
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise ValueError(f"out: {file} is not of a search, or is damaged: {error}") from None
        if told != self._is:
            raise ValueError(f"out: {file} is of another search, {told}, not {self._is}; take another file")
        for k, (sum_of, one) in enumerate(found):
            if sum_of != self._checksum(k, one):
                why = "is damaged" if sum_of else "has no checksum, as an earlier version wrote it"
                raise ValueError(f"out: expedition {k} of {file} {why}; take another file, or delete it to begin anew")
        self.expeditions = expeditions

    @property
    def _is(self) -> dict[str, Any]:
        return {"seed": self.seed, "limits": self.limits, "choices": self.choices, "of": self.of}

    def _checksum(self, k: int, expedition: Mapping[str, Any]) -> str:
        return checksum([self._is, k, dict(expedition)])


def identify(
    budget: int = 200_000,
    seed: int = 0,
    start: Mapping[str, Any] | None = None,
    limits: bool | None = None,
    out: Path | None = None,
    published: np.ndarray | None = None,
    threads: int | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> tuple[dict[str, Any], Search]:
    """Sets of unknowns fitted to the 16 published errors of both study cases.

    Parameters
    ----------
    budget : rollouts, two a set; exceeded by less than what it takes to begin at one posture, some hundred.
    seed : the same seed, the same search, however often it was interrupted.
    start : table like "report" of `study_cases.toml` to begin at; None draws postures anywhere, and takes of the committed table
        what is not searched (gravity, how a payload is gripped, period).
    limits : keep to the assumed limits of the joint angles (torques are not limited); False for joints that turn round and
        round, None for what the table has.
    out : JSON file that is written after each expedition, and gone on with if it is there.
    published : (16,) in, in/s, instead of the report's.
    threads : None for as many as there are processors.
    progress : told rollouts so far and the best worth.

    Returns
    -------
    The best set as such a table, and the search.
    """
    if not isinstance(budget, int) or budget < 1:
        raise ValueError(f"budget: expected a whole number of rollouts from 1 on, got {budget!r}")
    if not isinstance(seed, int) or seed < 0:
        raise ValueError(f"seed: expected a whole number >= 0, got {seed!r}")
    table = dict(data.load("study_cases")["report"] if start is None else start)
    limits = table["choices"]["joint_limits"] if limits is None else limits
    table["choices"] = {**table["choices"], "joint_limits": limits}
    candidates = Candidates(table, COARSE, published, threads)
    given = None if start is None else Expedition(-2, 0, np.inf, values_of(table).tolist(), candidates.known.tolist())
    choices = {key: value for key, value in table["choices"].items() if key not in ("standing", "source")}
    begins = "anywhere" if given is None else digest([*given.values, *given.posture])
    search = Search(seed, limits, choices, {"published": digest(candidates.published), "start": begins})
    search.load(out)

    def told(count: int, best: float) -> None:
        if progress:
            so_far = min((one.worth for one in search.expeditions), default=np.inf)
            progress(search.rollouts + count, min(best, so_far))

    while not search.expeditions or budget - search.rollouts >= 2 * POPULATION:
        k = len(search.expeditions)
        rng = np.random.default_rng([seed, k])
        candidates.count = 0
        parent, base = _next(search, given, budget)
        firm = parent >= 0 and search.rollouts >= (1 - FIRM) * budget
        if base is None:
            base, sigma, sets = _drawn(candidates, rng, limits), 0.6, SHORT
        else:
            sigma, sets = FINE if firm else SIGMAS[k % len(SIGMAS)], LONG
        candidates.known = np.array(base.posture)
        left = (budget - search.rollouts) // (6 if firm else 2)
        sets = min(sets, max(POPULATION, left))
        made = descend(candidates, np.array(base.values), sigma, sets, rng, limits, firm, told)
        made.of, made.posture = parent, base.posture
        search.expeditions.append(made)
        search.save(out)
    best = search.best
    candidates.known = np.array(best.posture)
    postures = candidates(np.array([best.values])).postures[0]
    return with_values(table, np.array(best.values), postures), search


def descend(
    candidates: Candidates,
    start: np.ndarray,
    sigma: float,
    sets: int,
    rng: np.random.Generator,
    limits: bool,
    firm: bool = False,
    told: Callable[[int, float], None] | None = None,
) -> Expedition:
    """From ``start`` (unknowns,) with first steps of ``sigma``, until so many ``sets`` are tried or none is better for long."""
    strategy = EvolutionStrategy(to_steps(start), sigma, rng, POPULATION)
    found, since = Expedition(0, values=start.tolist(), firm=firm), 0
    for _ in range(max(1, sets // POPULATION)):
        x = strategy.ask()
        if not strategy.generation:
            x[0] = strategy.mean  # never worse than the start
        values = from_steps(x)
        outcome = candidates(values)
        y = worth(outcome, limits)
        if firm:
            y = y + np.mean([np.minimum(worth(candidates(x), limits), SHAKEN) for x in _shaken(values)], axis=0)
        strategy.tell(x, y + 1e-3 * np.sum((x - to_steps(values)) ** 2, axis=1))  # back inside the bounds
        good = values[accepted(outcome, limits)]
        found.accepted += len(good)
        found.lowest = np.min([found.lowest, *good], axis=0).tolist()
        found.highest = np.max([found.highest, *good], axis=0).tolist()
        best = int(np.argmin(y))
        since = 0 if y[best] < found.worth - 1e-4 else since + 1
        if y[best] < found.worth:
            found.worth, found.values = float(y[best]), values[best].tolist()
        if told:
            told(candidates.count, found.worth)
        if since >= PATIENCE:
            break
    found.rollouts = candidates.count
    return found


def _shaken(values: np.ndarray) -> list[np.ndarray]:
    """The sets (N, unknowns) with K_p rot lower and higher by `MARGIN`."""
    out = []
    for share in (1 - MARGIN, 1 + MARGIN):
        changed = values.copy()
        changed[:, NAMES.index("K_p rot")] *= share
        out.append(changed)
    return out


def _next(search: Search, given: Expedition | None, budget: int) -> tuple[int, Expedition | None]:
    """Which one to follow up, and itself; None for a posture to be drawn."""
    done = search.expeditions
    if given is not None and not done:
        return -2, given
    if given is None and search.rollouts < EXPLORED * budget:
        return -1, None
    if search.rollouts >= (1 - FIRM) * budget:  # from where there is most room
        k = min(range(len(done)), key=lambda k: (-done[k].accepted, done[k].worth))
        return k, done[k]
    followed = {one.of for one in done}
    drawn = sorted((k for k, one in enumerate(done) if one.of == -1), key=lambda k: done[k].worth)
    waiting = [k for k in drawn[:FOLLOWED] if k not in followed]
    k = waiting[0] if waiting else min(range(len(done)), key=lambda k: done[k].worth)
    return k, done[k]


def _drawn(candidates: Candidates, rng: np.random.Generator, limits: bool) -> Expedition:
    """A posture from anywhere, with the best of some sets of gains and the like."""
    arm = candidates.cases[1].plant.arm
    lower, upper = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    while True:
        q = posture_somewhere(rng, lower, upper)
        start = start_of(q)
        postures, found = starts(q, start[None])
        if found[0] and ((postures[0] >= arm.lower) & (postures[0] <= arm.upper)).all():
            break
    candidates.known = q
    low, high = to_steps(DRAWN.T)
    values = from_steps(rng.uniform(low, high, (TRIED, len(NAMES))))
    values[:, START] = start
    y = worth(candidates(values), limits)
    return Expedition(-1, 0, float(y.min()), values[np.argmin(y)].tolist(), q.tolist())
