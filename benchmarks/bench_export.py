"""What a tick of the exported C takes: written, compiled, and called in a loop in C.

Run: python benchmarks/bench_export.py    (one run, one machine)
"""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from timing import compare, machine

import k1607_pin as k1607
from k1607_pin.compiled.export import export
from k1607_pin.compiled.export.presets import LAWS
from k1607_pin.control.practice import OFF

TICKS = 2000
LOOP = """
#include "arm.h"
int loop(int ticks, const double *q, const double *v)
{{
  arm_law_parameters parameters;
  arm_law_reference wanted = {{{{0}}}};
  arm_law_state state;
  double torque[16], error[16]{sensor};
  int failed = 0;
  arm_law_defaults(&parameters);
  failed |= arm_law_initial_state(&parameters, {reference}q, v, &state);
  for (int k = 0; k < ticks; k++)
    failed |= arm_law_step(&parameters, &wanted, q, v{measured}, &state, torque, error{force});
  return failed;
}}
"""


def looped(folder: Path, arm: k1607.Arm, law: object) -> Callable[[], object]:
    """A function that runs TICKS control periods of a law in C; the state goes on from one to the next."""
    files = export(arm, folder, {"law": law}, functions=(), prefix="arm")
    hybrid = hasattr(law, "sensor")
    text = LOOP.format(
        sensor=", sensor[6] = {0}, force_error[6]" if hybrid else "",
        reference="&wanted, " if hybrid else "",
        measured=", sensor" if hybrid else "",
        force=", force_error" if hybrid else "",
    )
    (folder / "loop.c").write_text(text)
    compiler = shutil.which("cc") or shutil.which("clang")
    assert compiler, "a C compiler is needed"
    sources = [str(file) for file in files if file.name == "arm_law.c"]
    library = folder / "loop.so"
    options = ["-std=c99", "-O2", "-fPIC", "-shared"]
    subprocess.run([compiler, *options, *sources, str(folder / "loop.c"), "-o", str(library), "-lm"], check=True)
    run = ctypes.CDLL(str(library)).loop
    q, v = np.linspace(0.3, 1.2, arm.n), np.full(arm.n, 1e-3)

    def loop() -> object:
        failed = run(TICKS, q.ctypes.data_as(ctypes.c_void_p), v.ctypes.data_as(ctypes.c_void_p))
        assert failed == 0
        return failed

    return loop


def control_ticks() -> dict[str, float]:
    """Law -> microseconds a control tick, checks for numbers that are not finite included: median of many rounds."""
    arm = k1607.load_k1607()
    made = {name: law(arm, 1e-3) for name, law in LAWS.items()}
    made = {"cartesian, as in the report": replace(made["cartesian"], posture=None, practice=OFF), **made}
    with tempfile.TemporaryDirectory() as folder:
        loops = [looped(Path(folder) / str(k), arm, law) for k, law in enumerate(made.values())]
        timings, _ = compare(*loops)
    return {name: 1e6 * timing.median / TICKS for name, timing in zip(made, timings, strict=True)}


def main() -> None:
    print(machine())
    for name, us in control_ticks().items():
        print(f"{name:30} {us:6.2f} µs a tick, K-1607")


if __name__ == "__main__":
    main()
