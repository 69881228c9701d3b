"""Autonomous mode: name where the hand should go, and let the planner find how; then the arm goes there.

Run: python examples/planned_path.py
"""

from dataclasses import replace

import numpy as np
import pinocchio as pin

import k1607_pin as k1607
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.posture import Posture
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.cartesian_plan import plan_poses
from k1607_pin.paths.joint_plan import plan_joints
from k1607_pin.paths.timing import Limits

arm = k1607.load_k1607()
q0 = np.deg2rad([-20, 30, 20, 100, -30, 60, 10])
start = arm.forward_kinematics(q0)


def away(x: float, y: float, z: float, turn: float = 0.0) -> pin.SE3:
    """A pose so many metres from the start, the tool turned by so many degrees about its own axis."""
    return pin.SE3(start.rotation @ pin.exp3(np.deg2rad([0.0, 0.0, turn])), start.translation + np.array([x, y, z]))


plan = plan_poses(arm, [away(0, 0.3, 0), away(-0.2, 0.3, 0.1), start], q0, linear=Limits(0.4, 1.0, 10.0))
law = CartesianAdaptive(
    arm,
    plan,
    None,  # the plan has its own orientations
    gains_from_inertia(arm, q0, omega=100.0),
    reference_model(2 * np.ones(6), 3 * np.ones(6)),
    beta_1=1e5,
    beta_2=1e5,
    period=0.002,
    posture=Posture(lambda t: plan.joints(t)[:2], omega=10.0),  # the joint that is left over keeps to the plan too
)
run = k1607.simulate(arm, law, q0, np.ceil(plan.duration), control_period=0.002)  # it rests when it has arrived
off = 1e3 * np.linalg.norm(run.error.values[:, :3], axis=1)
print(
    f"three sides of a triangle in {plan.duration:.2f} s, stops at the corners; under control at most {off.max():.2f} mm off"
)
print(f"    smallest singular value of J on the way {plan.joints.sigma_min.min():.2f}")

turning = plan_poses(
    arm, [away(0, 0.3, 0, turn=90)], q0, angular=Limits(5.0, 20.0, 200.0), linear=Limits(2.0, 10.0, 100.0)
)
print(
    f"the same side while the tool turns by 90 deg: {turning.duration:.2f} s, {turning.factor:.2f} times what was asked for"
)
print(f"    because of the {turning.reason or 'limits given'}")
posture = Posture(lambda t: turning.joints(t)[:2], omega=10.0)
run = k1607.simulate(arm, replace(law, path=turning, posture=posture), q0, 0.8, control_period=0.002)
tilted = np.rad2deg(np.linalg.norm(run.error.values[:, 3:], axis=1))
print(f"    under control at most {tilted.max():.2f} deg off, at the end {tilted[-1]:.3f} deg")

joints = plan_joints(arm, [q0 + 0.2, q0 + 0.5, q0 + np.linspace(0.9, 0.6, 7)], q0)
print(f"in joint space through two postures to a third, without a stop: {joints.duration:.2f} s")

try:
    plan_poses(arm, [away(0, 2, 0)], q0)
except ValueError as error:
    print(f"2 m to the left: {error}")
