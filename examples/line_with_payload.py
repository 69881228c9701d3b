"""Study case 1's line with 10 lb in the hand for the middle second: the Cartesian adaptive scheme, with and without adaptation.

Posture, initial gains and beta are ours (the report publishes none of them); weightless, as in orbit; 10 ms.
Run: python examples/line_with_payload.py
"""

import numpy as np

import k1607_pin as k1607
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.reference_model import reference_model
from k1607_pin.description.units import INCH, POUND
from k1607_pin.paths.report_paths import Line

arm = k1607.load_k1607(gravity=(0, 0, 0))
q0 = np.deg2rad([-20, 30, 20, 100, -30, 60, 10])
start = arm.forward_kinematics(q0)
gains = gains_from_inertia(arm, q0, omega=2.0)
model = reference_model(2 * np.ones(6), 3 * np.ones(6))  # section 7.2: P2 = P3 = I/4
payloads = [(1.0, k1607.Payload(10 * POUND)), (2.0, k1607.Payload(0.0))]

for beta in (0.0, 1e6):
    law = CartesianAdaptive(arm, Line(start.translation), start.rotation, gains, model, beta, beta, period=0.01)
    log = k1607.simulate(arm, law, q0, duration=3.0, payloads=payloads)
    error = log.error.values[:, :3] / INCH
    largest, rms = np.abs(error).max(axis=0).round(3), np.sqrt((error**2).mean(axis=0)).round(3)
    print(f"beta {beta:g}: largest error {largest} in, RMS {rms} in (x, y, z)")
