"""A controller of your own in one class: gravity compensation and an impedance at the tool, a spring and a damper to the path.

Run: python examples/own_controller.py
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

import k1607_pin as k1607
from k1607_pin.arm.ready import ready_postures
from k1607_pin.control.pose import pose_error
from k1607_pin.paths.report_paths import Line


@dataclass(frozen=True)
class Impedance:
    """tau = J^T (K x_e + D x_e') + g(q) - d q'; the last, damping at the joints, quiets the null space."""

    arm: k1607.Arm
    path: Line
    rotation: np.ndarray
    stiffness: np.ndarray  # (6,) N/m, N m/rad
    damping: np.ndarray  # (6,) N s/m, N m s/rad
    joint_damping: float = 5.0  # N m s/rad

    variables: ClassVar = {"error": (("direction",), "m, rad"), "wanted_position": (("axis",), "m")}

    def start(self, q, v, duration):
        """No state to carry along."""

    def update(self, t, q, v, state):
        wanted, tool, J = self.path(t), self.arm.forward_kinematics(q), self.arm.jacobian(q)
        error = pose_error(tool.translation, tool.rotation, wanted.position, self.rotation)
        rate = np.concatenate([wanted.velocity, np.zeros(3)]) - J @ v
        force = self.stiffness * error + self.damping * rate
        torque = J.T @ force + self.arm.gravity_torque(q) - self.joint_damping * v
        return torque, state, {"error": error, "wanted_position": wanted.position}


for arm in (k1607.load_k1607(), k1607.load_example("panda"), k1607.load_example("ur5")):
    q0 = ready_postures(arm)[0]
    start = arm.forward_kinematics(q0)
    law = Impedance(
        arm,
        Line(start.translation, np.array([0.05, 0.1, 0.0])),
        start.rotation,
        stiffness=np.array([4000.0] * 3 + [100.0] * 3),
        damping=np.array([300.0] * 3 + [5.0] * 3),
    )
    log = k1607.simulate(arm, law, q0, 2.0, control_period=0.001, payloads=[(1.0, k1607.Payload(0.5))])
    distance = 1e3 * np.linalg.norm(log.error.values[:, :3], axis=1)
    print(
        f"{arm.name:6s} at most {distance.max():.2f} mm off its path, {distance[-1]:.2f} mm in the end with 0.5 kg in the hand"
    )
