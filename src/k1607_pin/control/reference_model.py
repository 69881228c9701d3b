"""The reference model that the error is to follow, and the Lyapunov equation that gives the adaptation its weights, (48)-(60)."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, solve_continuous_lyapunov

from k1607_pin.arguments import as_floats, numbers


@dataclass(frozen=True)
class ReferenceModel:
    """m uncoupled second-order systems, x'' + Delta_2 x' + Delta_1 x = 0, and the P that solves (60) for them."""

    Delta: np.ndarray
    """(2m, 2m) of (50)"""
    Q: np.ndarray
    """(2m, 2m) symmetric positive definite"""
    P: np.ndarray
    """(2m, 2m) symmetric positive definite: P Delta + Delta^T P = -Q"""

    @property
    def P_2(self) -> np.ndarray:
        """(m, m) upper right block of P, (59): weight of the error in the adaptation."""
        m = len(self.P) // 2
        return self.P[:m, m:]

    @property
    def P_3(self) -> np.ndarray:
        """(m, m) lower right block of P, (59): weight of the error's rate."""
        m = len(self.P) // 2
        return self.P[m:, m:]

    def response(self, z_0: np.ndarray, t: float) -> np.ndarray:
        """(2m,) state of the model at time t [s] from z_0 (2m,), (53)."""
        return expm(self.Delta * t) @ z_0


def reference_model(Delta_1: np.ndarray, Delta_2: np.ndarray, Q: np.ndarray | None = None) -> ReferenceModel:
    """The model of (48)-(50) and the P of (59)-(60).

    Parameters
    ----------
    Delta_1 : (m,) omega_i^2 [1/s^2], or (m, m); Delta_2 : (m,) 2 xi_i omega_i [1/s], or (m, m).
    Q : (2m, 2m) symmetric positive definite; None takes the identity, as the report does.

    Raises
    ------
    ValueError
        Wrong shapes, entries that are not finite, a model that is not stable, Q not symmetric positive definite.
    """
    Delta_1, Delta_2 = _square(Delta_1, "Delta_1"), _square(Delta_2, "Delta_2")
    m = len(Delta_1)
    if Delta_2.shape != (m, m):
        raise ValueError(f"Delta_2: expected ({m}, {m}) as Delta_1, got {Delta_2.shape}")
    Delta = np.block([[np.zeros((m, m)), np.eye(m)], [-Delta_1, -Delta_2]])
    if (slowest := np.linalg.eigvals(Delta).real.max()) >= 0:
        raise ValueError(f"Delta_1, Delta_2: expected a stable model, got an eigenvalue of real part {slowest:.3g}")
    Q = np.eye(2 * m) if Q is None else numbers("Q", Q, (2 * m, 2 * m))
    if np.abs(Q - Q.T).max() > 1e-12 * np.abs(Q).max() or np.linalg.eigvalsh(Q)[0] <= 0:
        raise ValueError("Q: expected a symmetric positive definite matrix")
    P = solve_continuous_lyapunov(Delta.T, -Q)
    return ReferenceModel(Delta, Q, (P + P.T) / 2)


def _square(x: np.ndarray, name: str) -> np.ndarray:
    expected = "(m,) or (m, m) finite numbers"
    x = as_floats(name, x, expected)
    if x.ndim == 1:
        x = np.diag(x)
    if x.ndim != 2 or x.shape[0] != x.shape[1] or not len(x):
        raise ValueError(f"{name}: expected {expected}, got shape {x.shape}")
    return numbers(name, x)
