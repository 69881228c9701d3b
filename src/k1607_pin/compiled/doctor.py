"""What this machine has for compiled rollouts, how fast they are on it, and what slows them down."""

import os
import platform
import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from k1607_pin.arm.load import load_k1607
from k1607_pin.compiled.build import cache_folder, compiler, instructions, refused_cc
from k1607_pin.compiled.lanes import processors
from k1607_pin.compiled.rollout import forget, rollouts
from k1607_pin.control.cartesian import CartesianAdaptive, gains_from_inertia
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.report_paths import Line
from k1607_pin.simulation.simulate import simulate

VARIABLES = ("CC", "K1607_COMPILER", "K1607_INSTRUCTIONS", "K1607_CACHE")
GET_ONE = "`apt-get install gcc`, `xcode-select --install`, or `pip install 'k1607-pin[compiler]'`, the ziglang package"
AGREE = 1e-9
"""Of the largest entry: how well compiled rollouts must agree with `simulate`"""
ENOUGH = 100e-9
"""s a physics step of a rollout, one core: up to that a machine with AVX2 or more is as it should be"""


@dataclass(frozen=True)
class Diagnosis:
    """What was found."""

    versions: dict[str, str]
    cpu: str
    processors: int
    """that this process may use"""
    instructions: str
    """the widest that the processor has, or the one asked for"""
    compiler: str
    """its version, or "none" """
    lanes: int
    cache: str
    """folder of traced loops and built libraries"""
    cache_bytes: int
    cache_writable: bool
    environment: dict[str, str]
    """of the variables that have an effect, those that are set"""
    apart: float
    """largest difference from `simulate` over a tenth of a second, of the largest entry"""
    step: float
    """s a physics step of a rollout, one thread"""
    verdict: tuple[str, ...]
    """why it is slow, or wrong; empty where all is well"""


def diagnose() -> Diagnosis:
    """Look at the machine, and run the K-1607's Cartesian scheme for a moment: a second or so."""
    made, folder = compiler(), cache_folder()
    apart, step = _measured(2048 if made else 16)
    built = [*folder.glob("*.so"), *folder.glob("*.json")] if folder.is_dir() else []
    existing = next(x for x in (folder, *folder.parents) if x.exists())
    writable, kind = os.access(existing, os.W_OK), instructions()
    verdict = []
    if made is None:
        hidden = os.environ.get("K1607_COMPILER") == "none"
        why = "K1607_COMPILER=none hides it" if hidden else GET_ONE
        verdict.append(f"no C compiler was found, so that CasADi's interpreter runs: {why}")
    elif made.instructions != kind:
        verdict.append(f"the compiler refuses {kind}: {made.instructions} is used")
    elif kind == "plain":
        verdict.append("two lanes alone: the processor has neither AVX2 nor NEON, or K1607_INSTRUCTIONS says so")
    elif step > ENOUGH:
        verdict.append(f"slower than {ENOUGH * 1e9:.0f} ns a step: is the machine busy?")
    if refused := refused_cc(made):
        verdict.append(refused)
    if not writable:
        verdict.append(f"{folder} cannot be written: every process builds anew; set K1607_CACHE to a folder that can")
    if not apart < AGREE:
        verdict.append(
            f"WRONG: compiled rollouts are {apart:.1e} apart from `simulate`; please report it with all of this"
        )
    return Diagnosis(
        versions={
            "python": platform.python_version(),
            **{name: version(name) for name in ("k1607-pin", "pin", "casadi", "numpy")},
        },
        cpu=_cpu(),
        processors=processors(),
        instructions=kind,
        compiler=f"{made.command[0]}: {made.version}" if made else "none",
        lanes=made.lanes if made else 1,
        cache=str(folder),
        cache_bytes=sum(file.stat().st_size for file in built),
        cache_writable=writable,
        environment={name: os.environ[name] for name in VARIABLES if name in os.environ},
        apart=apart,
        step=step,
        verdict=tuple(verdict),
    )


def _measured(count: int) -> tuple[float, float]:
    """How far compiled rollouts are from `simulate`, and seconds a physics step."""
    arm = load_k1607()
    q0 = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
    start, model = arm.forward_kinematics(q0), reference_model(2 * np.ones(6), 3 * np.ones(6))
    law = CartesianAdaptive(
        arm, Line(start.translation), start.rotation, gains_from_inertia(arm, q0, 10.0), model, 1e3, 1e3, 0.01
    )
    forget()  # what the environment says now counts
    run = rollouts(arm, law, 0.1, varied=("controller.beta_1",), log=("q", "tau"), every=1)
    beta = {"controller.beta_1": np.array([1e3])}
    ours, theirs = run(q0, vary=beta), simulate(arm, law, q0, 0.1)
    apart = max(
        float(np.abs(ours[x].values[0] - theirs[x].values).max() / np.abs(theirs[x].values).max()) for x in ("q", "tau")
    )
    timed = rollouts(arm, law, 0.1, varied=("controller.beta_1",))
    beta = {"controller.beta_1": np.full(count, 1e3)}
    timed(q0, vary=beta, threads=1)
    begin = time.perf_counter()
    timed(q0, vary=beta, threads=1)
    return apart, (time.perf_counter() - begin) / count / 100


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()
