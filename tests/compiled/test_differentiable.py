"""Rollouts with derivatives: the numbers of `simulate`, and the derivatives of its finite differences."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.compiled.differentiable import differentiable
from k1607_pin.compiled.leaves import replaced
from k1607_pin.simulation.integrators import runge_kutta_4

NAMES = ("controller.gains.K_p", "controller.gains.K_d")
LOG = ("error", "tau")
CARRIED = [(0.05, k1607.Payload(4.0, (0.05, 0.0, 0.1)), 0.03), (0.12, k1607.Payload(0.0))]
CASES = {
    "as it is": {},
    "payload at rest": {"payloads": [(0.05, k1607.Payload(4.0))], "from_rest": True},
    "payload that comes little by little, Runge-Kutta": {
        "payloads": CARRIED,
        "step": runge_kutta_4,
        "physics_step": 0.005,
    },
}


def logged(run):
    return np.concatenate([run[name].values for name in LOG], axis=1)


@pytest.mark.parametrize("case", CASES)
def test_values_and_derivatives_are_simulate_s(arm, law, q0, case):
    settings = {"duration": 0.2, **CASES[case]}
    f = differentiable(k1607.rollouts(arm, law, varied=NAMES, metrics={}, log=LOG, **settings), q0, np.full(7, 0.1))
    start = np.concatenate([np.ravel(K) for K in law.gains])
    rng = np.random.default_rng(0)
    symmetric = [(x + x.T) / 2 for x in rng.normal(size=(2, 6, 6))]
    direction = np.concatenate([(K @ x + x @ K).ravel() / 2 for K, x in zip(law.gains, symmetric, strict=True)])

    def simulated(x):
        gains = {f"gains.{name[-3:]}": K for name, K in zip(NAMES, x.reshape(2, 6, 6), strict=True)}
        return logged(k1607.simulate(arm, replaced(law, gains), q0, v0=np.full(7, 0.1), **settings)).T

    expected = simulated(start)
    assert np.abs(f(start).full() - expected).max() < 1e-9 * np.abs(expected).max()

    h = 1e-5
    differences = (simulated(start + h * direction) - simulated(start - h * direction)) / (2 * h)
    forward = f.forward(1)(start, f(start), direction).full()
    for part in (slice(0, 3), slice(3, 6), slice(6, 13)):
        assert np.abs(forward[part] - differences[part]).max() < 1e-5 * np.abs(differences[part]).max()

    weights = rng.normal(size=expected.shape)
    reverse = f.reverse(1)(start, f(start), weights).full()
    assert float(reverse.ravel() @ direction) == pytest.approx(np.sum(weights * forward), rel=1e-10)
    assert np.sum(weights * forward) == pytest.approx(np.sum(weights * differences), rel=1e-5)


@dataclass(frozen=True)
class Hidden:
    """A law whose ``initial`` nobody sees."""

    law: Any

    def start(self, q, v, duration):
        return self.law.start(q, v, duration)

    def update(self, t, q, v, state):
        return self.law.update(t, q, v, state)


def test_a_start_that_cannot_be_differentiated_is_refused(arm, law, q0):
    run = k1607.rollouts(arm, Hidden(law), 0.1, metrics={}, log=("tau",))
    with pytest.raises(ValueError, match="expected one with `initial`"):
        differentiable(run, q0, np.zeros(7))
