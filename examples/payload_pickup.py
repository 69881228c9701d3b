"""A box gripped while the hand moves: at once or little by little, moving along or at rest. Who pays for its energy?

Run: python examples/payload_pickup.py
"""

import numpy as np

import k1607_pin as k1607
from k1607_pin.control import posture
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.report_paths import Line

arm = k1607.load_k1607()
q0 = np.deg2rad([-20, 30, 20, 100, -30, 60, 10])
start = arm.forward_kinematics(q0)
law = CartesianAdaptive(
    arm,
    Line(start.translation),
    start.rotation,
    gains_from_inertia(arm, q0, omega=100.0),
    reference_model(2 * np.ones(6), 3 * np.ones(6)),
    beta_1=1e5,
    beta_2=1e5,
    period=0.002,
    posture=posture.hold(q0, 10.0),
)
box = k1607.Payload(4.5, cg=np.array([0, 0, 0.15]), inertia=np.diag([0.04, 0.04, 0.02]))

print("J:                         work  brought by the box  change of energy  left over")
for name, ramp, from_rest in (
    ("at once, moving along", 0.0, False),
    ("at once, at rest", 0.0, True),
    ("in half a second, at rest", 0.5, True),
):
    log = k1607.simulate(
        arm, law, q0, 2.0, control_period=0.002, payloads=[(0.6, box, ramp)], from_rest=from_rest, physics_step=0.0005
    )
    change = float(log.energy[-1] - log.energy[0])
    end = log.isel(time=-1)
    print(f"{name:26s} {end.work:7.3f} {end.payload_energy:15.3f} {change:17.3f} {end.energy_residual:10.4f}")
