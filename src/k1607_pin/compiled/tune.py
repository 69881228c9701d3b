"""Gains for a wanted bound on error and torque: by exact derivatives, or by search over rollouts."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import xarray as xr
from scipy.optimize import differential_evolution

from k1607_pin.arm.arm import Arm
from k1607_pin.compiled.differentiable import differentiable
from k1607_pin.compiled.factors import Factors
from k1607_pin.compiled.leaves import replaced
from k1607_pin.compiled.results import OWN
from k1607_pin.compiled.rollout import Rollouts, rollouts
from k1607_pin.simulation.plant import Plant
from k1607_pin.simulation.simulate import SimulationError, simulate

METHODS = ("gradient", "search")
LOST = 1e3
"""Counts as this many times the bound, and up to twice that the sooner it is lost: a rollout that runs away"""


class Tuned(NamedTuple):
    """What `tune` found. Errors and torques are those of `simulate` with it."""

    controller: Any
    """with the numbers found"""
    values: dict[str, np.ndarray]
    """Each free number, by its name"""
    factors: dict[str, np.ndarray]
    """What each was multiplied by: one number, or (m,) of the axes"""
    worst: float
    """Largest error or torque over its bound; of a run that is lost infinite"""
    met: bool
    """Whether that is at most 1"""
    error: np.ndarray
    """(m,) largest error in each direction, until the run's end"""
    torque: np.ndarray
    """(n,) N m, largest torque of each joint, likewise"""
    rollouts: int
    """How many the search has run, or how often the gradient's function and its derivatives were evaluated"""
    run: xr.Dataset
    """The log of `simulate`"""


def tune(
    plant: "Plant | Arm",
    controller: Any,
    q0: np.ndarray,
    duration: float,
    free: Mapping[str, Any],
    error_bound: Any = None,
    torque_bound: Any = None,
    method: str = "gradient",
    error: str = "error",
    v0: np.ndarray | None = None,
    budget: int | None = None,
    seed: int = 0,
    **settings: Any,
) -> Tuned:
    """Factors on the free numbers that make the largest error and torque over their bounds, whichever is worst, smallest.

    Parameters
    ----------
    plant, controller, q0, v0, duration, settings : as for `rollout`; settings are some of `SETTINGS`, control_period say.
    free : name below "controller", "controller.gains.K_p" say -> "scale", one factor; "axes", one an axis, which makes D K D of a
        matrix and leaves it positive definite; or (lowest, highest) factors, one number each or (m,) for the axes. Else factors
        are between 0.1 and 10.
    error_bound : one number or (m,), of the magnitude of ``error`` at the control samples, in its units; inf for what is free.
    torque_bound : one number or (n,) N m, likewise, of the torque that the motors give.
    method : "gradient", IPOPT (Waechter and Biegler, 2006) with exact derivatives of the rollout, which finds the best near the
        start; or "search", differential evolution (Storn and Price, 1997), which looks everywhere between the factors, and does
        with laws that are not smooth.
    error : which variable of the controller's log is bounded: "error", "joint_error", "force_error".
    budget : iterations of the gradient, 60 by default; rollouts of the search, 2000.
    seed : of the search.

    Raises
    ------
    ValueError
        Names, factors or bounds that do not fit; a free number that is 0, which no factor changes. Bounds that cannot be met are
        no error: ``met`` and ``worst`` tell how close it came.
    """
    if method not in METHODS:
        raise ValueError(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
    if budget is not None and (not isinstance(budget, int) or budget < 1):
        raise ValueError(f"budget: expected a whole number from 1 on, got {budget!r}")
    if unknown := sorted(set(settings) - set(SETTINGS)):
        raise ValueError(f"settings: expected some of {', '.join(SETTINGS)}, got {', '.join(unknown)}")
    if (external := settings.get("external")) is not None and not callable(external):
        raise ValueError(
            f"external: expected a function that gives a Wrench, as `simulate` takes it, got {external!r:.80}"
        )
    if error in OWN:
        raise ValueError(
            f"error: expected what the controller logs, {error!r} is every loop's; torque_bound bounds the torque"
        )
    factors = Factors(controller, free)
    for z in (factors.lower, factors.upper):
        _with(controller, factors.values(z))
    common = {"control_period": getattr(controller, "period", 0.01), **settings, "varied": tuple(free)}
    if method == "gradient":
        run = rollouts(plant, controller, duration, metrics={}, log=(error, "tau"), **common)
    else:
        run = rollouts(plant, controller, duration, metrics={error: ("max",), "tau": ("max",)}, **common)
    arm = run.setup.plant.arm
    q0, v0 = arm.as_vector(q0, "q0"), np.zeros(arm.n) if v0 is None else arm.as_vector(v0, "v0")
    limits = _limits(run, error, error_bound, torque_bound)
    if method == "gradient":
        z, count = _by_gradient(run, factors, limits, q0, v0, budget or 60)
    else:
        z, count = _by_search(run, factors, limits, q0, v0, budget or 2000, seed)
    values = factors.values(z)
    found = _with(controller, values)
    common.pop("varied")
    lost = False
    try:
        log = simulate(run.setup.plant, found, q0, duration, v0, **common)
    except SimulationError as stopped:
        lost, log = True, stopped.log
    largest = {name: np.abs(log[name].values).max(axis=0) for name in (error, "tau")}
    worst = np.inf if lost else max(float((x / limits[name]).max()) for name, x in largest.items())
    return Tuned(found, values, factors.named(z), worst, worst <= 1, largest[error], largest["tau"], count, log)


SETTINGS = ("control_period", "physics_step", "step", "payloads", "from_rest", "external")
"""Of `rollout` and `simulate`, that `tune` passes on."""


def _with(controller: Any, values: Mapping[str, np.ndarray]) -> Any:
    """The controller with other numbers, which it checks."""
    return replaced(controller, {name.partition(".")[2]: x if x.ndim else float(x) for name, x in values.items()})


def _limits(run: Rollouts, error: str, error_bound: Any, torque_bound: Any) -> dict[str, np.ndarray]:
    """Each bound as one number a component of its variable, inf where there is none."""
    shapes = {name: shape for name, _, shape in run.loop.metrics} | dict(run.loop.logged)
    limits = {}
    for argument, name, asked in (("error_bound", error, error_bound), ("torque_bound", "tau", torque_bound)):
        try:
            x = np.array(np.inf if asked is None else asked, dtype=float)
            good = x.shape in ((), shapes[name]) and bool((x > 0).all())
        except (TypeError, ValueError):
            good = False
        if not good:
            raise ValueError(f"{argument}: expected one positive number or {shapes[name]}, inf for none, got {asked!r}")
        limits[name] = np.broadcast_to(x, shapes[name])
    if not any(np.isfinite(x).any() for x in limits.values()):
        raise ValueError("error_bound, torque_bound: expected at least one bound, got none")
    return limits


def _by_gradient(
    run: Rollouts, factors: Factors, limits: Mapping[str, np.ndarray], q0: np.ndarray, v0: np.ndarray, budget: int
) -> tuple[np.ndarray, int]:
    """The least u with (x / bound)^2 <= u for all samples: smooth, where a maximum is not."""
    z, u = ca.MX.sym("z", len(factors.lower)), ca.MX.sym("u")
    bound = np.concatenate([limits[name].ravel() for name, _ in run.loop.logged])
    told = np.isfinite(bound)
    logged = differentiable(run, q0, v0)(factors.flat(z, ca.exp))
    ratios = logged[np.flatnonzero(told).tolist(), :] / ca.repmat(bound[told], 1, logged.shape[1])
    squared = ca.vec(ratios * ratios)
    worst = ca.Function("worst", [z], [ca.mmax(squared)])
    start = np.clip(0.0, factors.lower, factors.upper)
    if _lost(run, factors, start, q0, v0):
        raise ValueError("controller: expected one whose rollout does not run away, to start from; a search needs none")
    first = float(worst(start))
    problem = {"x": ca.vertcat(z, u), "f": u, "g": squared - u}
    solver = ca.nlpsol("tune", "ipopt", problem, IPOPT | {"ipopt.max_iter": budget})
    found = solver(
        x0=np.append(start, first), lbx=np.append(factors.lower, 0.0), ubx=np.append(factors.upper, np.inf), ubg=0.0
    )
    stats = solver.stats()
    end = np.clip(found["x"].full().ravel()[:-1], factors.lower, factors.upper)
    better = float(worst(end)) < first and not _lost(run, factors, end, q0, v0)  # not so where it is NaN
    return (end if better else start), stats["n_call_nlp_g"] + stats["n_call_nlp_jac_g"]


def _lost(run: Rollouts, factors: Factors, z: np.ndarray, q0: np.ndarray, v0: np.ndarray) -> bool:
    return bool(np.isfinite(run(q0, v0, factors.values(z)).failed_at[0]))


IPOPT: dict[str, Any] = {
    "print_time": False,
    "show_eval_warnings": False,  # a step too far runs away; IPOPT then takes a shorter one
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-5,
    "ipopt.hessian_approximation": "limited-memory",
}


def _by_search(
    run: Rollouts,
    factors: Factors,
    limits: Mapping[str, np.ndarray],
    q0: np.ndarray,
    v0: np.ndarray,
    budget: int,
    seed: int,
) -> tuple[np.ndarray, int]:
    count = 0

    def worst(z: np.ndarray) -> np.ndarray:
        """Of candidates (p, N)."""
        nonlocal count
        count += z.shape[1]
        found = run(q0, v0, factors.values(z.T))
        ratios = [(found[f"{name}_max"].values / x).reshape(z.shape[1], -1).max(axis=1) for name, x in limits.items()]
        lost = found.failed_at.values
        return np.where(np.isnan(lost), np.max(ratios, axis=0), LOST * (2 - lost / run.duration))

    p = len(factors.lower)
    each = -(-max(POPULATION, 8 * p) // p)
    best = differential_evolution(
        worst, np.stack([factors.lower, factors.upper], axis=1), maxiter=max(budget // (each * p) - 1, 0), popsize=each, tol=1e-3,
        rng=seed, polish=False, x0=np.clip(0.0, factors.lower, factors.upper), updating="deferred", vectorized=True,
    )  # fmt: skip
    return best.x, count


POPULATION = 32  # at least: whole blocks of lanes
