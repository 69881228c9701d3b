"""Compiled rollouts beside MuJoCo's C loop, Pinocchio's C++ and a Python loop, doing the same work on the same arm.

Run: make bench    (one run, one machine; ratios are taken within a round; --plot FOLDER draws the growth)
"""

import argparse
import ctypes
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
from bench_export import control_ticks
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table
from the_loop import PERIOD, START, STEP, in_mujoco, the_law
from timing import QUICK, compare, machine

import k1607_pin as k1607
from k1607_pin.compiled.batch import Batch
from k1607_pin.compiled.build import compiler, library
from k1607_pin.compiled.kernel import resource
from k1607_pin.compiled.native import Native
from k1607_pin.compiled.rollout import rollouts
from k1607_pin.compiled.traced_arm import TracedArm
from k1607_pin.description import description
from k1607_pin.description.urdf import to_urdf
from k1607_pin.simulation.integrators import semi_implicit_euler

SUBSTEPS = round(PERIOD / STEP)
INERTIA = [0.1, 0.1, 0.05, 0.01, 0.0, 0.0]  # kg m^2, xx yy zz xy xz yz, of the links of an arm whose joints are counted


class Passive:
    """No torque."""

    def start(self, q: np.ndarray, v: np.ndarray, duration: float) -> None:
        """No state."""

    def update(self, t: float, q: np.ndarray, v: np.ndarray, state: None) -> tuple[np.ndarray, None, dict[str, object]]:
        """Nothing."""
        return 0 * q, None, {}


def seconds(fun: Callable[[], object], repeats: int = 5) -> np.ndarray:
    """(repeats,) s of each call, after one that is not counted."""
    fun()
    out = []
    for _ in range(1 if QUICK else repeats):
        start = time.perf_counter()
        fun()
        out.append(time.perf_counter() - start)
    return np.array(out)


def closed_loops(console: Console, table: Table) -> None:
    arm = k1607.load_k1607(gravity=(0, 0, 0))
    law = the_law(arm)
    model, data = in_mujoco(arm)
    v0 = np.linspace(-0.3, 0.3, 7)

    # First: the same motion, passive and under the law.
    data.qpos[:], data.qvel[:] = START, v0
    mujoco.mj_step(model, data, 1000)
    ours = k1607.rollout(arm, Passive(), START, 1.0, v0, metrics={}).q_end.values[0]
    apart = np.abs(ours - data.qpos).max()
    assert apart < 1e-9, apart
    reference = k1607.simulate(arm, law, START, 1.0)
    with_log = k1607.rollout(arm, law, START, 1.0, log=("q",)).q.values[0]
    apart_law = np.abs(with_log - reference.q.values).max()
    assert apart_law < 1e-9, apart_law
    console.print(f"same motion: MuJoCo within {apart:.0e} rad after 1 s, simulate within {apart_law:.0e} rad")

    lanes, length = 16 if QUICK else 1024, 1.0
    run = rollouts(arm, law, length, varied=("controller.beta_1",))
    beta = np.linspace(0, 1e6, lanes)

    def compiled() -> None:
        run(START, vary={"controller.beta_1": beta}, threads=1)

    def mj_step() -> None:
        mujoco.mj_step(model, data, 2000)

    def python_loop() -> None:
        data.qpos[:], data.qvel[:], state = START, 0, law.initial(START, np.zeros(7))
        for k in range(5):
            tau, state, _ = law.update(k * PERIOD, data.qpos.copy(), data.qvel.copy(), state)
            data.qfrc_applied[:] = tau
            mujoco.mj_step(model, data, SUBSTEPS)
        data.qfrc_applied[:] = 0

    _, rounds = compare(compiled, mj_step, python_loop, rounds=9)
    per_step = rounds / np.array([lanes * length / STEP, 2000, 5 * SUBSTEPS])
    target = {"AVX-512": 50, "AVX2": 25}.get(compiler().instructions, float("nan")) if compiler() else float("nan")
    row(table, "closed loop, a physics step, one core", per_step[:, 0])
    row(table, "  MuJoCo's mj_step in C, passive", per_step[:, 1], per_step[:, 1] / per_step[:, 0], f"≥ {target:g}")
    row(table, "  Python loop around MuJoCo, same law", per_step[:, 2], per_step[:, 2] / per_step[:, 0], "≥ 150")
    ops = {name: sum(p.operations.values()) for name, p in run.loop.programs.items()}
    a_step = ops["motion"] + ops["law"] / SUBSTEPS
    peak = multiply_adds()
    share = a_step / np.median(per_step[:, 0]) / peak
    console.print(
        f"operations: {ops['motion']:,} a physics step, {ops['law']:,} a control sample, {ops['hoist']:,} once a rollout; "
        f"{a_step / np.median(per_step[:, 0]) / 1e9:.1f} G operations/s, {share:.0%} of the {peak / 1e9:.1f} G multiply-adds/s "
        "that this core reaches with nothing else to do"
    )


def multiply_adds() -> float:
    """Independent multiply-adds a second on one core, lanes counted: the limit of any straight-line code."""
    made = compiler()
    if made is None:
        return float("nan")
    chains = 10  # enough to hide the latency, few enough for the registers of AVX2
    body = "\n".join(f"  V a{i} = v_all(x + {i});" for i in range(chains))
    loop = " ".join(f"a{i} = a{i} * m + c;" for i in range(chains))
    total = " + ".join(f"a{i}" for i in range(chains))
    text = f"""#define W {made.lanes}
{resource("lanes.h")}
double spin(int64_t n, double x, double y) {{
  const V m = v_all(y), c = v_all(1e-9);
{body}
  for (int64_t k = 0; k < n; k++) {{ {loop} }}
  V t = {total}; return v_lane(t, 0);
}}
"""
    spin = library(text, made).spin
    spin.restype, spin.argtypes = ctypes.c_double, [ctypes.c_int64, ctypes.c_double, ctypes.c_double]
    n = 2_000_000
    return chains * made.lanes * n / float(seconds(lambda: spin(n, 0.5, 0.999)).min())


def dynamics(table: Table) -> None:
    arm = k1607.load_k1607()
    rng = np.random.default_rng(0)
    count = 1000 if QUICK else 200_000
    q, v, tau = rng.normal(size=(3, count, 7))
    forward = k1607.batch(arm, "forward_dynamics")
    memory = forward.empty(count)
    pool, theirs = pin.ModelPool(arm.model, 1), np.empty((7, count), order="F")
    columns = [np.asfortranarray(x.T) for x in (q, v, tau)]
    pin.abaInParallel(1, pool, *columns, theirs)
    ours = forward(q, v, tau, threads=1)
    assert np.abs(ours - theirs.T).max() < 1e-10 * np.abs(theirs).max(), "the same accelerations"
    _, rounds = compare(
        lambda: forward(q, v, tau, threads=1, out=memory),
        lambda: pin.abaInParallel(1, pool, *columns, theirs),
        rounds=15,
    )
    rounds = rounds / count
    target = {"AVX-512": 40, "AVX2": 20}.get(compiler().instructions, float("nan")) if compiler() else float("nan")
    row(table, "forward dynamics of a batch, a state, one core", rounds[:, 0])
    row(
        table,
        "  Pinocchio's abaInParallel in C++, one thread",
        rounds[:, 1],
        rounds[:, 1] / rounds[:, 0],
        f"≥ {target:g}",
    )

    traced = TracedArm(arm)
    space = Batch(lambda q, v: traced.operational_space(q, v)[:4], [(7,), (7,)])
    count = 1000 if QUICK else 1_000_000
    q, v = rng.uniform(0.3, 1.3, size=(2, count, 7))
    memory = space.empty(count)
    found = space(q, v, threads=1, out=memory)
    reference = arm.operational_space(q[-1], v[-1])
    for ours, theirs in zip(found, reference[:4], strict=True):
        assert np.abs(ours[-1] - theirs).max() < 1e-9 * np.abs(theirs).max()
    times = seconds(lambda: space(q, v, threads=1, out=memory), 3)
    row(table, "Λ, Φ, Γ, J of a million states, one core", times, count / times / 1e6, "≥ 2 million/s")
    operations = sum(space.program.operations.values())
    table.add_row(
        f"  {operations:,} operations a state, {memory.shape[1]} numbers out",
        "",
        "",
        "",
        "",
        "",
    )


TEN_THOUSAND = """
import time, numpy as np, sys
sys.path.insert(0, {here!r})
from the_loop import START, the_law
import k1607_pin as k1607
from k1607_pin.compiled.rollout import rollouts
arm = k1607.load_k1607(gravity=(0, 0, 0))
law = the_law(arm)
payloads = [(3.33, k1607.Payload(4.536)), (6.66, k1607.Payload(0.0))]
run = rollouts(arm, law, 10.0, payloads=payloads, varied=("controller.beta_1",))
beta = np.linspace(0, 1e6, {count})
out = []
for threads in (1, 2, 1, 2, 1, 2):
    start = time.perf_counter()
    run(START, vary={{"controller.beta_1": beta}}, threads=threads)
    out.append(time.perf_counter() - start)
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM")).split()[1]
print(*out, int(peak) / 1024)
"""


def ten_thousand(table: Table) -> None:
    code = TEN_THOUSAND.format(here=str(Path(__file__).parent), count=16 if QUICK else 10_000)
    *times, memory = map(float, subprocess.check_output([sys.executable, "-c", code], text=True).split())
    one, two = np.array(times[::2]), np.array(times[1::2])
    row(table, "10,000 rollouts of 10 s, metrics, 2 threads", two, None, "≤ 6 s")
    table.add_row("  memory of the whole process", f"{memory:.0f} MB", "", "", "", "< 300 MB")
    row(table, "  1 to 2 threads", one, one / two, "≥ 1.85")


def ticks(table: Table) -> None:
    arm = k1607.load_k1607(gravity=(0, 0, 0))
    law = the_law(arm)
    native, v = Native(law), np.zeros(7)
    state = law.initial(START, v)
    exported = 1e-6 * np.array([control_ticks()["cartesian, as in the report"] for _ in range(1 if QUICK else 3)])
    row(table, "one control tick in the exported C", exported, None, "≤ 1 µs")
    _, rounds = compare(lambda: native.update(0.5, START, v, state), lambda: law.update(0.5, START, v, state))
    row(table, "one control tick from Python, the law natively", rounds[:, 0], None, "≤ 40 µs")
    row(table, "  the law in NumPy", rounds[:, 1], rounds[:, 1] / rounds[:, 0])


def single(table: Table) -> None:
    arm = k1607.load_k1607(gravity=(0, 0, 0))
    run = rollouts(arm, the_law(arm), 10.0, log=("q", "v", "tau", "error", "error_rate", "K_p", "K_d"))
    row(table, "one rollout of 10 s with a full log, warm", seconds(lambda: run(START), 15), None, "≤ 12 ms")


FIRST = """
import time, sys
{hide}
sys.path.insert(0, {here!r})
from the_loop import START, the_law
import k1607_pin as k1607
arm = k1607.load_k1607(gravity=(0, 0, 0))
law = the_law(arm)
start = time.perf_counter()
k1607.rollout(arm, law, START, 0.1)
print(time.perf_counter() - start)
"""


def first_use(table: Table) -> None:
    """With all that is installed here, and without dask, which xarray imports for its first dataset where it is."""
    code, bare = (
        FIRST.format(here=str(Path(__file__).parent), hide=hide) for hide in ("", "sys.modules['dask'] = None")
    )
    fresh, again, without = [], [], []
    for _ in range(1 if QUICK else 3):
        with tempfile.TemporaryDirectory() as folder:
            environment = {**os.environ, "K1607_CACHE": folder}
            for times, what in ((fresh, code), (again, code), (without, bare)):
                times.append(float(subprocess.check_output([sys.executable, "-c", what], text=True, env=environment)))
    row(table, "first use in a process, compiling", np.array(fresh), None, "≤ 4 s")
    row(table, "first use in a process, from the cache", np.array(again), None, "≤ 0.1 s")
    row(table, "  the same without dask, which xarray imports", np.array(without), None, "≤ 0.1 s")


def growth(folder: Path) -> None:
    """Figure: time against rollouts, joints and threads."""
    arm = k1607.load_k1607(gravity=(0, 0, 0))
    run = rollouts(arm, the_law(arm), 1.0, varied=("controller.beta_1",))
    counts = 2 ** np.arange(0, 5 if QUICK else 15, 2)
    by_count = [
        seconds(lambda n=n: run(START, vary={"controller.beta_1": np.ones(n)}, threads=1), 3).min() for n in counts
    ]
    threads = np.arange(1, (os.cpu_count() or 1) + 1)
    beta = {"controller.beta_1": np.ones(4096)}
    by_threads = [seconds(lambda n=n: run(START, vary=beta, threads=int(n)), 3).min() for n in threads]
    joints = np.arange(3, 5 if QUICK else 13)
    by_joints, operations = zip(*(passive_steps(int(n)) for n in joints), strict=True)
    figure = Figure(figsize=(11, 3.4), layout="constrained")
    panels = figure.subplots(1, 3)
    panels[0].loglog(counts, np.array(by_count) / counts / 1000 * 1e9, "o-", color="#14213d")
    panels[0].set(xlabel="rollouts at once", ylabel="ns a physics step and rollout, one core", title="rollouts")
    panels[1].plot(joints, np.array(by_joints) * 1e9, "o-", color="#14213d")
    panels[1].set(
        xlabel="joints", ylabel="ns a physics step and rollout, one core", title="joints (passive)", ylim=(0, None)
    )
    counted = panels[1].twinx()
    counted.plot(joints, operations, "s--", color="#f07c00", ms=4)
    counted.set(ylabel="operations", ylim=(0, None))
    counted.yaxis.label.set_color("#f07c00")
    panels[2].plot(threads, by_threads[0] / np.array(by_threads), "o-", color="#14213d")
    panels[2].plot(threads, threads, ":", color="grey")
    panels[2].set(xlabel="threads", ylabel="times as fast", title="threads", xticks=threads)
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "growth.png", dpi=130)


def passive_steps(n: int) -> tuple[float, int]:
    """Seconds of a physics step a rollout, and operations, of a falling arm of n joints, their axes in turn."""
    rows = [[-90 if i % 2 else 90, 0.1, 0.2 * (i % 2)] for i in range(n)]
    links = [{"mass_kg": 5.0, "cg_m": [0.02, 0.05, 0.1], "inertia_kg_m2": INERTIA} for _ in range(n)]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "arm.urdf"
        file.write_text(
            to_urdf(
                description.from_mapping(
                    {"dh": {"rows": rows, "units": {"length": "m", "angle": "deg"}}, "link": links}
                )
            )
        )
        arm = k1607.load_urdf(file)
    run = rollouts(arm, Passive(), 0.5, metrics={})
    count = 16 if QUICK else 2048
    q0 = np.tile(np.linspace(0.1, 0.5, n), (count, 1))
    operations = sum(run.loop.programs["motion"].operations.values())
    return float(seconds(lambda: run(q0, threads=1), 3).min()) / count / 500, operations


def row(table: Table, name: str, times: np.ndarray, ratio: np.ndarray | None = None, target: str = "") -> None:
    """Median, least and spread of times; median of a ratio beside its target."""
    low, high = np.quantile(times, (0.25, 0.75))
    texts = [_time(np.median(times)), _time(times.min()), f"{_time(low)}..{_time(high)}"]
    table.add_row(name, *texts, "" if ratio is None else f"{np.median(ratio):.3g}", target)


def _time(x: float) -> str:
    for scale, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")):
        if x >= scale:
            return f"{x / scale:.3g} {unit}"
    return f"{x * 1e9:.3g} ns"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plot", type=Path, metavar="FOLDER", help="also draw growth.png there")
    plot = parser.parse_args().plot
    console = Console(width=140)
    made = compiler()
    console.print(machine())
    engine = f"{made.version}, {made.instructions}" if made else "no compiler"
    console.print(f"MuJoCo {mujoco.__version__}; {engine}; {semi_implicit_euler.__name__}")
    table = Table(title="K-1607, Cartesian adaptive scheme, 1 kHz physics, 100 Hz control")
    for column in ("", "median", "least", "middle half", "ratio or rate", "target"):
        table.add_column(column, justify="right" if column else "left", no_wrap=True)
    closed_loops(console, table)
    for part in (dynamics, ten_thousand, single, ticks, first_use):
        part(table)
    console.print(table)
    if plot:
        growth(plot)
        console.print(f"figure: {plot / 'growth.png'}")


if __name__ == "__main__":
    main()
