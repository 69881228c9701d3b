"""Operational space, physics step and control tick, beside bare Pinocchio and MuJoCo computing the same.

Run: make bench    (one run, one machine; every ratio is taken within a round)
"""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import casadi as ca
import mujoco
import numpy as np
import pinocchio as pin
from rich.console import Console
from rich.table import Table
from the_loop import START, in_mujoco, the_law
from timing import compare, machine

import k1607_pin as k1607
from k1607_pin.arm.bodies import bodies
from k1607_pin.compiled.trace import trace
from k1607_pin.dynamics.operational_space import OperationalSpace, operational_space, operational_space_of_bodies
from k1607_pin.simulation.integrators import semi_implicit_euler
from k1607_pin.simulation.plant import Plant

LWA = pin.LOCAL_WORLD_ALIGNED
RESULTS = ("Lambda", "Phi", "Gamma", "jacobian", "jacobian_bar", "bias_nullspace", "gravity")


def cartesian(console: Console) -> None:
    arm = k1607.load_k1607()
    rng = np.random.default_rng(0)
    q, v = START + rng.normal(size=7, scale=0.1), rng.normal(size=7)
    model = arm.model
    data, tool = model.createData(), model.getFrameId("tool")

    def terms() -> tuple[np.ndarray, ...]:
        """What Lambda, Phi and Gamma are made of, by the fewest calls that give it."""
        M = pin.crba(model, data, q, pin.Convention.WORLD)
        g = pin.computeGeneralizedGravity(model, data, q)
        C = pin.computeCoriolisMatrix(model, data, q, v)
        J = pin.getFrameJacobian(model, data, tool, LWA)
        J_dot = pin.getFrameJacobianTimeVariation(model, data, tool, LWA)
        T = pin.updateFramePlacement(model, data, tool)
        return M, C, g, J, J_dot, T.translation, pin.log3(T.rotation)

    def one_by_one() -> None:
        """The same, each quantity by the call that is named after it."""
        pin.crba(model, data, q, pin.Convention.WORLD)
        pin.computeGeneralizedGravity(model, data, q)
        pin.computeCoriolisMatrix(model, data, q, v)
        pin.computeFrameJacobian(model, data, q, tool, LWA)
        pin.computeJointJacobiansTimeVariation(model, data, q, v)
        pin.updateFramePlacement(model, data, tool)
        pin.getFrameJacobianTimeVariation(model, data, tool, LWA)
        pin.forwardKinematics(model, data, q)
        pin.log3(pin.updateFramePlacement(model, data, tool).rotation)

    M, C, g, J, J_dot, *x = terms()
    arguments = [np.copy(a) for a in (M, C, g, J, J_dot, np.concatenate(x), v)]
    space = arm.operational_space(q, v)
    _require_equal(space, _by_inverses(*arguments))
    _require_equal(space, operational_space(*arguments))
    functions = {
        "Arm.operational_space": lambda: arm.operational_space(q, v),
        "  of that the formula, NumPy and LAPACK": lambda: operational_space(*arguments),
        "  of that the Pinocchio calls it needs, bare": terms,
        "each quantity by its own Pinocchio call, bare": one_by_one,
    }
    bare = list(functions).index("  of that the Pinocchio calls it needs, bare")
    _, rounds = compare(*functions.values())
    table = _table("Λ, Φ, Γ and J̄ of one state, K-1607", "× Pinocchio")
    for name, column in zip(functions, rounds.T, strict=True):
        _row(table, name, column, column / rounds[:, bare])

    compiler = shutil.which("cc") or shutil.which("clang")
    if compiler:
        constants, gravity = bodies(model), model.gravity.linear
        frame = model.frames[tool]
        place = frame.parentJoint - 1, frame.placement.translation, frame.placement.rotation
        shapes = [a.shape for a in arguments]
        traced = {
            "the formula traced, C": (trace(lambda *a: _results(operational_space(*a)), "f", shapes), arguments),
            "all of it from bodies traced, C": (
                trace(
                    lambda q, v: _results(operational_space_of_bodies(constants, q, v, *place, gravity)),
                    "f",
                    [(7,), (7,)],
                ),
                [q, v],
            ),
        }
        for name, (f, values) in traced.items():
            with tempfile.TemporaryDirectory() as folder:
                loop, found = _in_c(compiler, Path(folder), f, values)
            _require_equal(space, found)
            _, rounds = compare(loop, terms)
            times = rounds[:, 0] / CALLS
            operations = f"{name}, {f.n_instructions() - f.nnz_in() - f.nnz_out():,} operations"
            _row(table, operations, times, times / rounds[:, 1])
    console.print(table)


def physics(console: Console) -> None:
    """A physics step within `simulate`, its energy account included, and a control tick, its log included."""
    arm = k1607.load_k1607(gravity=(0, 0, 0))
    model, data = arm.model, arm.model.createData()
    model_there, theirs = in_mujoco(arm)
    law = the_law(arm)

    def rollout(seconds: float, substeps: int) -> object:
        return k1607.simulate(arm, law, START, seconds, control_period=0.01, physics_step=0.01 / substeps)

    log = k1607.simulate(arm, law, START, 1.0)
    theirs.qpos[:] = START
    for tau in log.tau.values[:-1]:
        theirs.qfrc_applied[:] = tau
        mujoco.mj_step(model_there, theirs, 10)
    apart = float(np.abs(theirs.qpos - log.q.values[-1]).max())
    assert apart < 1e-9, "MuJoCo must arrive where we do"

    state = law.initial(START, np.zeros(7))
    q, v, tau = log.q.values[-1], log.v.values[-1], log.tau.values[-1]
    plant, acceleration = Plant(arm), pin.aba(model, data, q, v, tau)
    assert np.abs(plant.acceleration(q, v, tau) - acceleration).max() < 1e-12 * np.abs(acceleration).max()
    tool = model.getFrameId("tool")

    def law_s_pinocchio() -> None:
        pin.forwardKinematics(model, data, q)
        pin.updateFramePlacement(model, data, tool)
        pin.computeFrameJacobian(model, data, q, tool, LWA)

    _, rounds = compare(
        lambda: rollout(0.2, 1),
        lambda: rollout(0.2, 101),
        lambda: rollout(1.2, 1),
        lambda: semi_implicit_euler(lambda q, v: plant.acceleration(q, v, tau), q, v, 1e-3),
        lambda: pin.aba(model, data, q, v, tau),
        lambda: mujoco.mj_step(model_there, theirs),
        lambda: law.update(0.5, q, v, state),
        law_s_pinocchio,
        rounds=31,
    )
    short, fine, long, step, aba, mj_step, update, kinematics = rounds.T
    # What a rollout costs besides cancels: 100 steps more in each of 20 ticks, and 100 ticks more.
    in_simulate = (fine - short) / 2000
    tick = (long - short) / 100 - in_simulate
    table = _table("One physics step", "× pin.aba")
    _row(table, "simulate: step, energy account, checks", in_simulate, in_simulate / aba)
    _row(table, "semi_implicit_euler of Plant.acceleration alone", step, step / aba)
    _row(table, "mujoco.mj_step, no contacts, called from Python", mj_step, mj_step / aba)
    _row(table, "pin.aba, bare", aba, aba / aba)
    console.print(table)
    table = _table("One control tick of the Cartesian adaptive scheme", "× Pinocchio")
    _row(table, "simulate: law, energies, log", tick, tick / kinematics)
    _row(table, "of that the law", update, update / kinematics)
    _row(table, "forward kinematics and Jacobian, bare", kinematics, kinematics / kinematics)
    console.print(table)
    against = in_simulate / mj_step
    second = 100 * (tick + 10 * in_simulate)
    console.print(
        f"simulate's step against mj_step: {np.median(against):.1f} times (min {against.min():.1f}); "
        f"one second at 100 Hz and 1 kHz: {np.median(second) * 1e3:.0f} ms; MuJoCo ends it within {apart:.0e} rad of ours"
    )


def _by_inverses(
    M: np.ndarray, C: np.ndarray, g: np.ndarray, J: np.ndarray, J_dot: np.ndarray, x: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, ...]:
    """(39) as it is defined."""
    Lambda = np.linalg.inv(J @ np.linalg.inv(M) @ J.T)
    J_bar = np.linalg.inv(M) @ J.T @ Lambda
    forces, p = J_bar.T @ C - Lambda @ J_dot, J_bar.T @ g
    return Lambda, forces @ J_bar, np.outer(p, x) / (x @ x), J, J_bar, forces @ (np.eye(len(v)) - J_bar @ J) @ v, p


def _results(space: OperationalSpace) -> tuple[object, ...]:
    return tuple(getattr(space, name) for name in RESULTS)


def _require_equal(space: OperationalSpace, found: Sequence[object]) -> None:
    for name, other in zip(RESULTS, found[: len(RESULTS)], strict=True):
        ours = getattr(space, name)
        assert np.abs(ours - np.reshape(other, ours.shape)).max() < 1e-11 * np.abs(ours).max(), f"{name} must agree"


CALLS = 1000  # of the C function in one call of its loop


def _in_c(
    compiler: str, folder: Path, f: ca.Function, values: Sequence[np.ndarray]
) -> tuple[Callable[[], object], list[np.ndarray]]:
    """A function that runs f CALLS times in C, and what comes out of it."""
    generator = ca.CodeGenerator("f", {"with_header": False})
    generator.add(f)
    loop = f"""
void loop(const double** arg, double** res) {{
  static double w[{f.sz_w() + 1}]; const double* a[{f.sz_arg()}]; double* r[{f.sz_res()}];
  for (int k = 0; k < {CALLS}; ++k) {{
    for (int i = 0; i < {f.n_in()}; ++i) a[i] = arg[i];
    for (int i = 0; i < {f.n_out()}; ++i) r[i] = res[i];
    f(a, r, 0, w, 0);
  }}
}}
"""
    (folder / "f.c").write_text(generator.dump() + loop)
    command = [compiler, "-O3", "-shared", "-fPIC", str(folder / "f.c"), "-o", str(folder / "f.so"), "-lm"]
    subprocess.run(command, check=True)
    library = ctypes.CDLL(str(folder / "f.so"))
    inputs = [np.ascontiguousarray(value, dtype=float) for value in values]
    outputs = [np.empty(f.size_out(i)[::-1]) for i in range(f.n_out())]  # CasADi writes columns first
    pointers = [
        (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays)) for arrays in (inputs, outputs)
    ]

    def run() -> object:
        return library.loop(*pointers), inputs, outputs  # which the pointers point into

    run()
    return run, [out.T for out in outputs]


def _table(title: str, ratio: str) -> Table:
    table = Table(title=title)
    for column in ("", "median µs", "min", ratio, "min", "middle half"):
        table.add_column(column, justify="right" if column else "left", no_wrap=True)
    return table


def _row(table: Table, name: str, seconds: np.ndarray, ratio: np.ndarray) -> None:
    """The middle half of the rounds, and not all, is the spread: others use the machine too."""
    low, median, high = np.quantile(ratio, (0.25, 0.5, 0.75))
    us = seconds * 1e6
    numbers = (f"{x:.2f}" for x in (np.median(us), us.min(), median, ratio.min()))
    table.add_row(name, *numbers, f"{low:.2f}..{high:.2f}")


def main() -> None:
    console = Console(width=120)
    console.print(machine())
    cartesian(console)
    physics(console)


if __name__ == "__main__":
    main()
