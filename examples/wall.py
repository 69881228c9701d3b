"""The hand drives up to a wall and presses on it with 20 N: the same gains on walls from 1 to 100 kN/m.

Run: python examples/wall.py
"""

import numpy as np

import k1607_pin as k1607
from k1607_pin.control.hybrid import HybridAdaptive, Mode, hybrid_gains
from k1607_pin.control.posture import hold
from k1607_pin.control.practice import Practice
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.report_paths import Line
from k1607_pin.simulation.wall import Wall

arm = k1607.load_k1607()
q0 = np.deg2rad([-20, 30, 20, 100, -30, 60, 10])
start = arm.forward_kinematics(q0)
stay = Line(start.translation, extent=np.zeros(3))
push = Mode(selection=(1, 0, 0, 0, 0, 0), force=(20.0, 0, 0, 0, 0, 0))  # force along x, position in all else
stiffest = np.array([1e5] * 3 + [1e3] * 3)  # N/m, N m/rad: the most that is expected
gains, force_gains = hybrid_gains(arm, q0, stiffest, omega=60, force_omega=200, force_damping=0.7)
model = reference_model(2 * np.ones(6), 3 * np.ones(6))
force_model = reference_model(200.0**2 * np.ones(6), 400.0 * np.ones(6), np.diag([200.0**2] * 6 + [0.2] * 6))

for stiffness in (1e3, 1e4, 1e5):
    wall = Wall(start.translation + 0.005 * np.eye(3)[0], normal=(-1, 0, 0), stiffness=stiffness)
    law = HybridAdaptive(
        arm, stay, start.rotation, push, wall.sensor(arm), stiffest, gains, force_gains, model, force_model,
        1e5, 1e5, 1e-5, 1e-10, period=0.001, posture=hold(q0, 10.0), practice=Practice(gravity=True, gain_bound=0.8),
        force_practice=Practice(gain_bound=0.8),
    )  # fmt: skip
    log = k1607.simulate(arm, law, q0, 2.0, control_period=0.001, physics_step=0.0005, external=wall.external(arm))
    force, t = log.force.values[:, 0], log.time.values
    touch, off = t[np.argmax(force > 0)], t[np.abs(force - 20) > 0.4][-1]
    print(
        f"{stiffness / 1e3:5.0f} kN/m: touches at {touch:.2f} s, within 2 % of 20 N {off - touch:.3f} s "
        f"later, peak {force.max():.2f} N, at the end {force[-1]:.3f} N, sideways {1e3 * np.abs(log.error[:, 1:3]).max():.2f} mm"
    )
