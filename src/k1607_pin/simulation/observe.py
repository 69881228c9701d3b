"""What can be seen of a run beyond its log: observers for `simulate`."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin

from k1607_pin.arm.arm import Arm
from k1607_pin.kinematics.differential import Damping, SingularJacobianError


@dataclass(frozen=True)
class ObserveOperationalSpace:
    """Lambda, Phi, Gamma and their like of (39), of the arm with what it carries, at every control sample.

    At a singular posture, with no damping that acts, they are NaN and ``sigma_min`` says why.
    """

    damping: Damping | None = None
    variables: ClassVar[dict[str, tuple[tuple[str, ...], str]]] = {
        "Lambda": (("row", "column"), "kg, kg m; kg m, kg m^2"),
        "Phi": (("row", "column"), "kg/s, kg m/s; kg m/s, kg m^2/s"),
        "Gamma": (("row", "column"), "N/m, N/rad; N, N m/rad"),
        "jacobian_bar": (("joint", "direction"), "1/m (rad/m), 1"),
        "bias_nullspace": (("direction",), "N, N m"),
        "tool_rotation": (("axis",), "rad"),
        "tool_velocity": (("direction",), "m/s, rad/s"),
        "sigma_min": ((), ""),
    }

    def __call__(self, arm: Arm, q: np.ndarray, v: np.ndarray) -> dict[str, Any]:
        """What ``variables`` names, at q, v (n,)."""
        J = arm.jacobian(q)
        log: dict[str, Any] = {
            "tool_rotation": pin.log3(arm.forward_kinematics(q).rotation),
            "tool_velocity": J @ v,
        }
        try:
            there = arm.operational_space(q, v, self.damping)
        except SingularJacobianError as error:
            lost = np.full((6, 6), np.nan)
            return log | {
                "Lambda": lost,
                "Phi": lost,
                "Gamma": lost,
                "jacobian_bar": np.full((arm.n, 6), np.nan),
                "bias_nullspace": lost[0],
                "sigma_min": error.sigma_min,
            }
        return log | {
            "Lambda": there.Lambda,
            "Phi": there.Phi,
            "Gamma": there.Gamma,
            "jacobian_bar": there.jacobian_bar,
            "bias_nullspace": there.bias_nullspace,
            "sigma_min": there.sigma_min,
        }
