"""The same law on other arms: case 1's line in proportion, 1 kHz, full gravity, a payload in the middle third.

Run: python examples/another_robot.py
"""

import numpy as np

import k1607_pin as k1607
from k1607_pin.report.cases import study_case

for name in ("panda", "ur5", "xarm7"):
    arm = k1607.load_example(name)
    case = study_case(1, "recommended", arm)
    run = case.run()
    distance = 1e3 * np.linalg.norm(run.error.values[:, :3], axis=1)
    length = np.linalg.norm(case.law.path.extent)
    print(
        f"{name:6s} {length:.2f} m in {case.duration:g} s with {case.payload.mass:.2f} kg: "
        f"at most {distance.max():.3f} mm off its path, RMS {np.sqrt((distance**2).mean()):.3f} mm"
    )
