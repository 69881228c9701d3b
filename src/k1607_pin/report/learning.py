"""How fast a law learns, as one number for every law that learns, and what comes of it: from not at all to lost.

At rest a load that the law does not know, tau (n,) N m, is held by an error e with S e = tau, S being the law's stiffness. What
the law learns at that error, L e a second, takes the load over, and the error goes as e' = -S^-1 L e:

    joint adaptive         S = K_p                L = beta_1 |e|^2 P_2^T        since K_p' e = beta_1 (P_2^T e)(e^T e), (76)
    Cartesian adaptive     the same at the tool, for the force J_bar^T tau
    Slotine and Li         S = omega K_D          L = omega Y Gamma Y^T         Y: the regressor at rest, gravity's

The **learning rate** is e^T S^-1 L e / e^T e in 1/s, its inverse the time in which the law begins to learn the load. It is linear
in beta_1, or in Gamma, so that any law can be given any. It is that of the beginning: the gains' falls with the square of the
error that is left, Slotine and Li's does not. At the tool |e|^2 adds m^2 and rad^2, as (76) does.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from k1607_pin.arguments import number, numbers, shown
from k1607_pin.arm.payload import Payload, with_payload
from k1607_pin.compiled.rollout import rollout
from k1607_pin.control.baselines import Regressor, SlotineLi
from k1607_pin.control.cartesian import CartesianAdaptive
from k1607_pin.control.joint_space import JointAdaptive
from k1607_pin.control.posture import hold
from k1607_pin.paths.inverse_path import joint_path
from k1607_pin.paths.joint_plan import JointPoint
from k1607_pin.paths.report_paths import Line
from k1607_pin.report.cases import StudyCase, study_case
from k1607_pin.report.laws import LAWS, setting
from k1607_pin.report.stability import LONGEST_STEP
from k1607_pin.simulation.integrators import runge_kutta_4
from k1607_pin.simulation.noise import with_noise
from k1607_pin.simulation.plant import Plant

Law = CartesianAdaptive | JointAdaptive | SlotineLi
FACTORS = (0.0, *np.geomspace(1e-3, 1e6, 28))  # of the law's own rate
BEYOND = (
    10.0  # times the largest distance without learning: a tool further off is lost, whether or not the numbers run away
)
COPIES, APART = 4, 1e-7  # starts, and rad by which they differ: a verdict on which they do not agree is none
FINER = 7  # rates between the last that holds and the first that is lost, so that they are within a tenth of each other


def load_of(law: Law, q: np.ndarray, payload: Payload) -> np.ndarray:
    """(n,) N m: what the law does not know of at rest at q (n,) rad: the payload; without gravity's torque the arm, too."""
    carried = with_payload(law.arm, payload).gravity_torque(q)
    told = isinstance(law, SlotineLi) or law.practice.gravity
    return carried - law.arm.gravity_torque(q) if told else carried


def learning_rate(law: Law, q: np.ndarray, load: np.ndarray) -> float:
    """1/s, see above; q : (n,) rad where it rests; load : (n,) N m that it does not know of, see `load_of`.

    Raises
    ------
    ValueError
        No load, of which there is nothing to learn.
    """
    if isinstance(law, SlotineLi):
        still = np.zeros(law.arm.n)
        Y = Regressor(law.arm)(q, still, still, still)
        S = law.omega * law.K_D
        e = np.linalg.solve(S, load)
        learnt = law.omega * (Y * law.rates) @ (Y.T @ e)
    else:
        S = law.gains.K_p
        if isinstance(law, CartesianAdaptive):
            load = law.arm.operational_space(q, np.zeros(law.arm.n)).jacobian_bar.T @ load
        e = np.linalg.solve(S, load)
        learnt = law.beta_1 * (e @ e) * law.model.P_2.T @ e
    if not e.any():
        raise ValueError("load: expected one that the law does not know of, got none: there is nothing to learn")
    return float(e @ np.linalg.solve(S, learnt) / (e @ e))


def with_learning_rate(law: Law, rate: float, q: np.ndarray, load: np.ndarray) -> Law:
    """The law with beta_1, or Slotine and Li's Gamma, scaled to a learning rate [1/s]; beta_2 stays.

    Raises
    ------
    ValueError
        A rate that is negative or not finite, no load, or a Gamma of zeros, which no factor changes.
    """
    number("rate", rate, at_least=0, unit="1/s")
    if not isinstance(law, SlotineLi):
        return replace(law, beta_1=rate / learning_rate(replace(law, beta_1=1.0), q, load))
    if not (own := learning_rate(law, q, load)) > 0:
        raise ValueError("law: expected rates that are not zero, so that they can be scaled")
    return replace(law, rates=rate / own * law.rates)


def compared(name: str, number: int, period: float, gravity: float = 9.81, duration: float = 1.8) -> StudyCase:
    """One cell of `compare`: a law of `LAWS` on a study case's beginning, the payload in the middle third, torques limited."""
    case = study_case(number, "recommended", gravity=gravity)
    arm = case.plant.arm
    joints = joint_path(arm, case.law.path, case.q0, duration, case.law.rotation)
    law: Any = LAWS[name](setting(case, joints, period))
    step = period / np.ceil(period / LONGEST_STEP - 1e-9)
    return replace(case, plant=Plant(arm, torque_limit=arm.effort_limit), law=law, duration=duration, physics_step=step)


def holding(case: StudyCase, duration: float = 60.0) -> StudyCase:
    """The case's law and payload where the case starts, for a time [s]: to see what drifts."""
    law: Any = case.law
    if isinstance(law, CartesianAdaptive):
        omega = law.posture.omega if law.posture else 0.35 / law.period
        still = Line(law.arm.forward_kinematics(case.q0).translation, np.zeros(3))
        return replace(case, law=replace(law, path=still, posture=hold(case.q0, omega)), duration=duration)
    return replace(case, law=replace(law, path=_StandStill(case.q0)), duration=duration)


class _StandStill(NamedTuple):
    """A `JointPath` that stays."""

    q: np.ndarray
    """(n,) rad"""

    def __call__(self, t: Any) -> JointPoint:
        return JointPoint(self.q + 0 * t, 0 * self.q + 0 * t, 0 * self.q + 0 * t)


def learning_curve(
    case: StudyCase,
    factors: Sequence[float] | np.ndarray = FACTORS,
    noise: tuple[float, float] = (0.0, 0.0),
    beyond: float = BEYOND,
    threads: int | None = None,
) -> xr.Dataset:
    """A case run with its law's learning rate (beta_1, Gamma) multiplied by factors, 0 for none, in compiled rollouts.

    beta_2, which learns no load but damping, stays what it is, without learning too.

    Each factor is run from ``COPIES`` starts that differ by less than any joint sensor tells. It *holds* when all of them do, and
    is *lost* when none does; a run is lost whose numbers run away, or whose tool comes further off its path than ``beyond`` times
    the largest distance without learning. Between the last factor that holds and the first that is lost more are run. So the
    verdict is a bracket, and hangs on no single run at its edge.

    ``noise``: standard deviation of measured q [rad] and v [rad/s], `noisy.NOISE` say; another seed for each start.

    >>> from k1607_pin.report.learning import compared, learning_curve
    >>> curve = learning_curve(compared("joint adaptive + g", 1, 0.01), [1.0, 1e4, 1e6])
    >>> print(f"{curve.own:.3f} /s", *(f"{1e3 * float(curve.rms.sel(factor=x)):.2f} mm" for x in (0, 1, 1e4)))
    0.014 /s 1.37 mm 1.37 mm 0.39 mm

    Returns
    -------
    Dataset over ``factor``: ``rate`` 1/s; ``rms``, ``largest`` m of the tool's distance from its path, and ``torque``, RMS over
    limit, of the first start, infinite where that is lost; ``holds`` and ``lost``, of all. Attributes ``holds_to`` and
    ``lost_from`` 1/s: up to the one every rate that was run holds, from the other on every one is lost (infinite if none is);
    ``own`` 1/s, of factor 1; ``bound`` m.

    Raises
    ------
    ValueError
        Factors that are negative or not finite; a law that is lost without learning, or that learns nothing.
    """
    law: Law = case.law
    own = learning_rate(law, case.q0, load_of(law, case.q0, case.payload))
    if not own > 0:
        raise ValueError("case: expected a law that learns, got a rate of none: there is nothing to multiply")
    chosen = numbers("factors", factors, (None,))
    if (chosen < 0).any():
        raise ValueError(f"factors: expected none below 0, got {shown(chosen)}")
    number("beyond", beyond, above=0)
    done = _run(case, np.union1d([0.0], chosen), noise, beyond, None, threads)
    if not done.holds[0]:
        raise ValueError(
            "case: expected one that holds without learning, got one that is lost with a rate of 0 (beta_2 stays)"
        )
    held, lost = edge(done.factor.values, done.holds.values, done.lost.values)
    if 0 < held < lost < np.inf:
        more = _run(case, np.geomspace(held, lost, FINER + 2)[1:-1], noise, beyond, done.bound, threads)
        done = xr.concat([done, more], "factor", combine_attrs="override").sortby("factor")
        held, lost = edge(done.factor.values, done.holds.values, done.lost.values)
    done["rate"] = ("factor", own * done.factor.values, {"units": "1/s"})
    return done.assign_attrs(own=own, holds_to=own * held, lost_from=own * lost)


def edge(factors: np.ndarray, holds: np.ndarray, lost: np.ndarray) -> tuple[float, float]:
    """The last of rising factors (N,) up to which all hold, and the first from which on all are lost, infinite if none is.

    Between the two lie those on which their starts do not agree, and those that hold beyond one that does not.
    """
    bad, good = np.flatnonzero(~holds), np.flatnonzero(~lost)
    first_bad = bad[0] if bad.size else len(factors)
    first_lost = good[-1] + 1 if good.size else 0
    held = factors[first_bad - 1] if first_bad else 0.0
    return float(held), float(factors[first_lost]) if first_lost < len(factors) else np.inf


def _run(
    case: StudyCase,
    factors: np.ndarray,
    noise: tuple[float, float],
    beyond: float,
    bound: float | None,
    threads: int | None,
) -> xr.Dataset:
    """``bound`` None takes it from the first factor, which is none."""
    law: Law = case.law
    arm = case.plant.arm
    limit = np.where(np.isfinite(arm.effort_limit), arm.effort_limit, 1.0)
    signals = {
        "distance": lambda log: np.sqrt(np.sum((log["tool_position"] - log["wanted_position"]) ** 2)),  # the true one
        "share": lambda log: np.sqrt(np.sum((log["tau"] / limit) ** 2) / len(limit)),
    }
    each = np.repeat(factors, COPIES)
    away = APART * np.random.default_rng(0).uniform(-1, 1, (COPIES, arm.n))
    away[0] = 0.0
    controller: Any
    controller, vary = _learning(law, each)
    if any(noise):
        controller = with_noise(controller, arm.n, law.period, *noise)
        vary = {name.replace("controller", "controller.law"): x for name, x in vary.items()}
        vary["controller.noise.seed"] = np.tile(np.arange(COPIES), len(factors))
    run = rollout(
        case.plant,
        controller,
        case.q0 + np.tile(away, (len(factors), 1)),
        case.duration,
        control_period=law.period,
        physics_step=case.physics_step,
        step=runge_kutta_4,
        payloads=case.payloads,
        from_rest=case.from_rest,
        vary=vary,
        signals=signals,
        metrics={"distance": ("rms", "max"), "share": ("rms",)},
        threads=threads,
    )
    alive = np.isnan(run.failed_at.values)
    largest = np.where(alive, run.distance_max.values, np.inf)
    if bound is None:
        bound = beyond * largest[0] if np.isfinite(largest[0]) else 0.0  # of what is lost without, nothing holds
    lost = ~(largest <= bound)
    first = np.where(lost, np.inf, 1.0)[::COPIES]
    of_first = {"rms": run.distance_rms, "largest": run.distance_max, "torque": run.share_rms}
    units = {"rms": "m", "largest": "m", "torque": ""}
    of_all = lost.reshape(len(factors), COPIES)
    return xr.Dataset(
        {
            **{
                name: ("factor", np.where(np.isinf(first), np.inf, x.values[::COPIES]), {"units": units[name]})
                for name, x in of_first.items()
            },
            "holds": ("factor", ~of_all.any(axis=1)),
            "lost": ("factor", of_all.all(axis=1)),
        },
        coords={"factor": ("factor", factors)},
        attrs={"bound": bound},
    )


def _learning(law: Law, factors: np.ndarray) -> tuple[Law, dict[str, np.ndarray]]:
    """The law with nothing learnt, which is what is traced, and what makes it learn."""
    if isinstance(law, SlotineLi):
        return replace(law, rates=0 * law.rates), {"controller.rates": factors[:, None] * law.rates}
    varied = {"controller.beta_1": factors * law.beta_1, "controller.beta_2": np.full(len(factors), law.beta_2)}
    return replace(law, beta_1=0.0, beta_2=0.0), varied
