"""The hand wipes along a rough wall, pressing with 20 N, while the wall turns from 1 to 100 kN/m; then it lets go, bumplessly.

Run: python examples/sliding_contact.py [--html FILE]

With --html it writes the animation, with the wall and the force of the wall on the hand, to FILE; it opens offline.
"""

import argparse

import numpy as np

import k1607_pin as k1607
from k1607_pin.control.hybrid import HybridAdaptive, Mode, hybrid_gains
from k1607_pin.control.posture import hold
from k1607_pin.control.practice import Practice
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.report_paths import Line
from k1607_pin.simulation.wall import Wall

parser = argparse.ArgumentParser()
parser.add_argument("--html", metavar="FILE", help="write the animation to FILE")
html = parser.parse_args().html

arm = k1607.load_k1607()
q0 = np.deg2rad([-20, 30, 20, 100, -30, 60, 10])
start = arm.forward_kinematics(q0)
wipe = Line(start.translation, extent=np.array([0.0, 0.1, 0.05]))
push = Mode(selection=(1, 0, 0, 0, 0, 0), force=(20.0, 0, 0, 0, 0, 0))  # force along x, position in all else
hold_all = Mode(selection=np.zeros(6), time=2.0)
wall = Wall(start.translation, normal=(-1, 0, 0), stiffness=[(0.0, 1e3), (0.8, 1e5, 0.5)], friction=0.3)
stiffest = np.array([1e5] * 3 + [1e3] * 3)  # N/m, N m/rad
gains, force_gains = hybrid_gains(arm, q0, stiffest, omega=60, force_omega=200, force_damping=0.7)
model = reference_model(2 * np.ones(6), 3 * np.ones(6))
force_model = reference_model(200.0**2 * np.ones(6), 400.0 * np.ones(6), np.diag([200.0**2] * 6 + [0.2] * 6))
law = HybridAdaptive(
    arm, wipe, start.rotation, (push, hold_all), wall.sensor(arm), stiffest, gains, force_gains, model, force_model,
    1e5, 1e5, 1e-5, 1e-10, period=0.001, posture=hold(q0, 10.0), practice=Practice(gravity=True, gain_bound=0.8),
    force_practice=Practice(gain_bound=0.8),
)  # fmt: skip
log = k1607.simulate(arm, law, q0, 2.5, control_period=0.001, physics_step=0.00025, external=wall.external(arm))

print("  t [s]  wall [kN/m]  push [N]  rubbing [N]  off its line [mm]")
for t in (0.2, 0.7, 0.85, 0.9, 1.0, 1.3, 1.9, 2.4):
    now = log.sel(time=t, method="nearest")
    push_, rub = float(now.force[0]), np.linalg.norm(now.force.values[1:3])
    off = 1e3 * np.linalg.norm(now.error.values[1:3])
    print(f"{t:7.2f} {wall.stiffness_at(t) / 1e3:12.1f} {push_:9.3f} {rub:12.3f} {off:18.3f}")
jump = np.abs(np.diff(log.tau.values, axis=0)).max(axis=1)
print(
    f"largest change of a joint torque from one millisecond to the next at the switch: {jump[1998:2003].max():.3f} N m"
)
if html:
    from k1607_pin import view

    print(f"animation: {view.save_html(arm, html, log, wall=wall)}")
