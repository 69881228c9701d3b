"""What does study case 1 bear? A thousand other arms and payloads, and which of them the errors come from.

Run: python examples/sweep.py
"""

import numpy as np

import k1607_pin as k1607
from k1607_pin.report.cases import study_case

study = study_case(1)
drawn = k1607.Drawn(
    {
        "payloads.0.payload.mass": k1607.Uniform(0.0, 9.0),
        "plant.viscous": k1607.Uniform(np.full(7, 2.0), np.full(7, 20.0)),
        "q0": k1607.Normal(study.q0, np.full(7, 0.005)),
    },
    count=1000,
)
run = study.rollouts([name for name in drawn.along if name != "q0"], metrics={"error": ("max",)})
found = k1607.sweep(run, drawn)

worst = 1e3 * found.error_max.sel(direction=["x", "y", "z"]).max("direction")
print(f"{int(found.failed_at.notnull().sum())} of {worst.size} rollouts lost")
print(
    "position error along the worst axis:",
    ", ".join(f"{q:.0%} below {worst.quantile(q):.1f} mm" for q in (0.5, 0.9, 1)),
)
print("correlation with the payload's mass", f"{np.corrcoef(found['payloads.0.payload.mass'], worst)[0, 1]:6.2f}")
friction = found["plant.viscous"]
for k, joint in enumerate(found.joint.values):
    print(f"                 friction of {joint} ", f"{np.corrcoef(friction[:, k], worst)[0, 1]:6.2f}")
