"""What does study case 1 bear? A thousand payloads and joints with more or less friction, drawn; and which of them count.

Run: python examples/sweep.py
"""

import numpy as np

import k1607_pin as k1607
from k1607_pin.report.cases import study_case

study = study_case(1)
drawn = k1607.Drawn(
    {
        "payloads.0.payload.mass": k1607.Uniform(0.0, 9.0),
        "plant.viscous": k1607.Uniform(np.full(7, 5.0), np.full(7, 20.0)),
    },
    count=1000,
)
found = k1607.sweep(study.rollouts(list(drawn.along), metrics={"error": ("max",)}), drawn, study.q0)

held = found.isel(rollout=np.isnan(found.failed_at))
worst = 1e3 * held.error_max.sel(direction=["x", "y", "z"]).max("direction")
print(f"{found.sizes['rollout'] - worst.size} of {found.sizes['rollout']} rollouts lost")
print("largest position error:", ", ".join(f"{q:.0%} below {worst.quantile(q):.1f} mm" for q in (0.5, 0.9, 1)))
print("its correlation with")
print(f"  the payload          {np.corrcoef(held['payloads.0.payload.mass'], worst)[0, 1]:5.2f}")
for friction, joint in zip(held["plant.viscous"].T, held.joint.values, strict=True):
    print(f"  friction of {joint}   {np.corrcoef(friction, worst)[0, 1]:5.2f}")
