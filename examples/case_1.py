"""Study case 1 as the report had it, and as it can be had: 10 ms and weightless, then 1 kHz in full gravity.

Run: python examples/case_1.py
"""

import numpy as np

from k1607_pin.description.units import INCH
from k1607_pin.report.cases import study_case

for settings in ("report", "recommended"):
    case = study_case(1, settings)
    run = case.run()  # an xarray.Dataset; run.error: wanted less actual, m and rad
    error = run.error.sel(direction=["x", "y"]).values / INCH
    rms = np.sqrt((error**2).mean(axis=0))
    print(f"{settings}: largest error {np.abs(error).max(axis=0).round(4)} in, RMS {rms.round(4)} in (x, y)")
