"""The regressor of the joint torques, traced: what `control.baselines.Regressor` gets from Pinocchio."""

from typing import Any

import casadi as ca
import numpy as np

from k1607_pin.compiled.traced_arm import TracedArm, _parameters
from k1607_pin.dynamics.rigid_body import inverse_dynamics


class TracedRegressor:
    """Y (n, 10 n) of M(q) a + C(q, v) w + g(q) = Y(q, v, w, a) theta, as of `Regressor`, without rotor inertia."""

    def __init__(self, arm: TracedArm) -> None:
        self._arm = arm

    def __call__(self, q: Any, v: Any, w: Any, a: Any) -> Any:
        """q (n,) rad; v, w (n,) rad/s; a (n,) rad/s^2."""
        still = np.zeros(self._arm.n)
        return self._of(q, still, a) + (self._of(q, v + w, still) - self._of(q, v - w, still)) / 4

    def _of(self, q: Any, v: Any, a: Any) -> Any:
        """The torques are linear in the parameters: their derivative is the regressor."""
        n = self._arm.n
        theta = ca.SX.sym("theta", 10 * n)
        rows = np.reshape(ca.array(theta)[:, 0], (n, 10))
        bodies = [body._replace(armature=0.0, **_parameters(rows[i])) for i, body in enumerate(self._arm.bodies)]
        tau = inverse_dynamics(bodies, q, v, a, self._arm.gravity)
        column: Any = np.reshape(tau, (n, 1))
        return ca.array(ca.jacobian(column._v, theta))
