"""Gains that keep the tool within 5 mm and a degree of its path while 10 lb come and the motors' torque stays bounded.

Run: python examples/tune_gains.py
"""

import numpy as np

import k1607_pin as k1607
from k1607_pin.control.cartesian import gains_from_inertia
from k1607_pin.control.practice import Practice
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.report_paths import Line

arm = k1607.load_k1607()
q0 = np.deg2rad([-20, 30, 20, 100, -30, 60, 10])
start = arm.forward_kinematics(q0)
soft = k1607.CartesianAdaptive(
    arm, Line(start.translation, np.array([0.1, 0.2, 0.0])), start.rotation, gains_from_inertia(arm, q0, omega=10.0),
    reference_model(2 * np.ones(6), 3 * np.ones(6)), beta_1=1e3, beta_2=1e3, period=0.01, practice=Practice(gravity=True),
)  # fmt: skip
error_bound = np.array([5e-3] * 3 + [np.deg2rad(1.0)] * 3)  # m, rad
torque_bound = 600.0  # N m, every motor
load = [(0.3, k1607.Payload(4.536))]
free = {"controller.gains.K_p": "scale", "controller.gains.K_d": "scale"}


def told(name: str, found: k1607.Tuned) -> None:
    millimetres, degrees = 1e3 * found.error[:3].max(), np.rad2deg(found.error[3:].max())
    K_p, K_d = found.factors.values()
    print(
        f"{name:9} K_p x {K_p:5.2f}, K_d x {K_d:5.2f}: {millimetres:5.2f} mm, {degrees:5.2f} deg, {found.torque.max():4.0f} N m, "
        f"{'met' if found.met else f'missed: {found.worst:.2f} of a bound'}, {found.rollouts} rollouts"
    )


fixed = dict.fromkeys(free, (1.0, 1.0))
told("at first", k1607.tune(arm, soft, q0, 1.0, fixed, error_bound, torque_bound, "search", budget=1, payloads=load))
for method in ("gradient", "search"):
    told(method, k1607.tune(arm, soft, q0, 1.0, free, error_bound, torque_bound, method, payloads=load))
weak = 400.0  # less than the arm's own weight asks for
told("too weak", k1607.tune(arm, soft, q0, 1.0, free, error_bound, weak, "search", payloads=load))
