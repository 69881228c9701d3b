"""States at which a control law is known, from the controller itself on floats: near its path, and far from it."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from k1607_pin.arm.arm import Arm
from k1607_pin.arm.ready import ready_postures
from k1607_pin.compiled.checked import attributes, require_built, require_unchanged
from k1607_pin.compiled.export.arm import CASES, clear_posture
from k1607_pin.compiled.export.function import Case
from k1607_pin.compiled.export.trace import Leaf, TracedLaw
from k1607_pin.compiled.leaves import apart, named_numbers, numbers, paths, replaced
from k1607_pin.compiled.tracer import TracingError

TICKS = 3  # before the one that is kept: the state is then one that the law comes to
FAR, NEAR = 0.02, 1e-5  # rad, rad/s: how far from one of them to the next, away from the path and near it
H = 1e-3  # s
FASTER = 1e4  # near it, so that the gains' change is seen beside the gains


class _Moment(NamedTuple):
    """All that a law is told."""

    law: Any
    t: float
    q: np.ndarray
    v: np.ndarray
    state: Any

    def of(self, leaf: Leaf) -> Any:
        """The leaf's value."""
        if leaf.role == "parameters":
            return numbers(self.law)[leaf.path]
        if leaf.role in ("q", "v"):
            return getattr(self, leaf.role)
        if leaf.role == "measured":
            return below(self.law, leaf.path)(self.t, self.q, self.v)
        if leaf.role == "state":
            return dict(named_numbers(self.state, ""))[leaf.path]
        if not leaf.source:
            return self.t
        return dict(named_numbers(below(self.law, leaf.source)(self.t), leaf.source))[leaf.path]


def law_cases(
    arm: Arm, controller: Any, traced: TracedLaw, step: Sequence[Leaf], start: Sequence[Leaf]
) -> tuple[list[Case], list[Case]]:
    """Of the step and of the initial state, whose arguments are these leaves: with other parameters, some periods on."""
    rng = np.random.default_rng(1990)
    controller = apart(controller)
    steps, starts = [], []
    for k in range(CASES):
        near = k % 2 == 1
        law = _varied(controller, [leaf for leaf in step if leaf.role == "parameters"], rng, FASTER if near else 1.0)
        if near:
            t, size = float(rng.uniform(0.05, 0.2)), NEAR
            q = _follower(law, t, ready_postures(arm)[0])
            v = (_follower(law, t + H, q) - q) / H
        else:
            t, size = float(rng.uniform(0.1, 2.0)), FAR
            q, v = clear_posture(arm, rng), 0.3 * rng.normal(size=arm.n)
        state = law.initial(q.copy(), v.copy())
        built, before = paths(state), attributes(law)
        starts.append(Case(_flat(_Moment(law, 0.0, q, v, state), start), _numbers(traced.layout.flat(state))))
        for _ in range(TICKS):
            _, state, _ = law.update(t, q.copy(), v.copy(), state)
            require_built(paths(state), built)
            q, v = q + size * rng.normal(size=arm.n), v + size * rng.normal(size=arm.n)
        tau, after, log = law.update(t, q.copy(), v.copy(), apart(state))
        if np.shape(tau) != (arm.n,):
            raise TracingError(f"controller.update: expected a torque of shape ({arm.n},), got {np.shape(tau)}")
        require_built(paths(after), built)
        require_unchanged(law, before)
        results = [tau, *(log[key] for key in traced.keys.values()), traced.layout.flat(after)]
        expected = np.concatenate([_numbers(x) for x in results])
        if not np.isfinite(expected).all():
            raise ValueError(
                f"controllers: expected finite torques and states, got some that are not at q = {q}, v = {v}"
            )
        steps.append(Case(_flat(_Moment(law, t, q, v, state), step), expected))
    return steps, starts


def _flat(moment: _Moment, leaves: Sequence[Leaf]) -> np.ndarray:
    return np.concatenate([_numbers(moment.of(leaf)) for leaf in leaves])


def _numbers(x: Any) -> np.ndarray:
    return np.ravel(np.asarray(x, dtype=float))


def _varied(controller: Any, parameters: Sequence[Leaf], rng: np.random.Generator, faster: float) -> Any:
    own = numbers(controller)
    for leaf in parameters:
        factor = rng.uniform(0.9, 1.1, leaf.shape) * (faster if "beta" in leaf.path else 1)
        with suppress(ValueError):  # a rotation is left as it is: it would be none
            controller = replaced(controller, {leaf.path: own[leaf.path] * factor})
    return controller


def _follower(law: Any, t: float, q: np.ndarray) -> np.ndarray:
    """(n,) with as little of the error that the law logs as Newton's method gets to: where no limit of the law is reached."""
    still = np.zeros(len(q))
    for _ in range(30):
        log = law.update(t, q.copy(), still.copy(), law.initial(q.copy(), still.copy()))[2]
        error = log.get("joint_error", log.get("error"))
        if np.shape(error) != (q.shape if "joint_error" in log else (6,)) or not hasattr(law, "arm"):
            break  # a law of one's own, whose error is another
        q = q + (error if "joint_error" in log else np.linalg.lstsq(law.arm.jacobian(q), error, rcond=None)[0])
    return q


def below(x: Any, path: str) -> Any:
    """What is there under a dotted name."""
    for name in filter(None, path.split(".")):
        x = x[name] if isinstance(x, Mapping) else x[int(name)] if name.isdigit() else getattr(x, name)
    return x
