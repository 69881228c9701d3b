"""Arm calls beside the Pinocchio calls they are made of, and the closed form beside a loop over Pinocchio.

Run: make bench    (one run, one machine; every ratio is taken between columns of the same round)
"""

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
from rich.console import Console
from rich.table import Table
from timing import compare, machine

import k1607_pin as k1607
from k1607_pin.compiled.trace import trace
from k1607_pin.description.dh import table_1
from k1607_pin.kinematics import closed_form, product
from k1607_pin.report.operations import count

POSES = 10_000


def arm_calls(console: Console) -> None:
    arm = k1607.load_k1607()
    rng = np.random.default_rng(0)
    q, v, tau = arm.random_configuration(rng), rng.normal(size=7), rng.normal(size=7)
    model = arm.model
    data, tool = model.createData(), model.getFrameId("tool")

    def pose() -> None:
        pin.forwardKinematics(model, data, q)
        pin.updateFramePlacement(model, data, tool)

    def rate() -> None:
        pin.computeJointJacobiansTimeVariation(model, data, q, v)
        pin.updateFramePlacement(model, data, tool)
        pin.getFrameJacobianTimeVariation(model, data, tool, pin.LOCAL_WORLD_ALIGNED)

    pairs = {
        "forward_kinematics": (lambda: arm.forward_kinematics(q), pose),
        "jacobian": (
            lambda: arm.jacobian(q),
            lambda: pin.computeFrameJacobian(model, data, q, tool, pin.LOCAL_WORLD_ALIGNED),
        ),
        "mass_matrix": (lambda: arm.mass_matrix(q), lambda: pin.crba(model, data, q, pin.Convention.WORLD)),
        "gravity_torque": (lambda: arm.gravity_torque(q), lambda: pin.computeGeneralizedGravity(model, data, q)),
        "bias_torque": (lambda: arm.bias_torque(q, v), lambda: pin.nonLinearEffects(model, data, q, v)),
        "inverse_dynamics": (lambda: arm.inverse_dynamics(q, v, tau), lambda: pin.rnea(model, data, q, v, tau)),
        "coriolis_matrix": (lambda: arm.coriolis_matrix(q, v), lambda: pin.computeCoriolisMatrix(model, data, q, v)),
        "jacobian_time_variation": (lambda: arm.jacobian_time_variation(q, v), rate),
        "forward_dynamics": (lambda: arm.forward_dynamics(q, v, tau), lambda: pin.aba(model, data, q, v, tau)),
    }
    table = Table(title="Arm calls beside the bare Pinocchio calls they are made of")
    for column in ("call", "Arm µs", "min", "max", "Pinocchio µs", "1.3 x + 3 µs", "rounds within", ""):
        table.add_column(column, justify="left" if column == "call" else "right", no_wrap=True)
    for name, (ours, bare) in pairs.items():
        (a, b), rounds = compare(ours, bare)
        allowed = 1.3 * b.median + 3e-6
        within = float(np.mean(rounds[:, 0] <= 1.3 * rounds[:, 1] + 3e-6))
        verdict = "met" if a.median <= allowed else "missed"
        numbers = (f"{x * 1e6:.2f}" for x in (a.median, a.minimum, a.maximum, b.median, allowed))
        table.add_row(name, *numbers, f"{within:.0%}", verdict)
    console.print(table)


def batches(console: Console) -> None:
    arm = k1607.load_k1607()
    Q = arm.random_configuration(np.random.default_rng(0), POSES)
    model = arm.model
    data, tool = model.createData(), model.getFrameId("tool")
    out = np.empty((POSES, 4, 4))

    def idiom() -> np.ndarray:
        """As Pinocchio's examples have it."""
        for k, q in enumerate(Q):
            pin.framesForwardKinematics(model, data, q)
            out[k] = data.oMf[tool].homogeneous
        return out

    def tightest() -> np.ndarray:
        """The fewest calls that give a pose."""
        for k, q in enumerate(Q):
            pin.forwardKinematics(model, data, q)
            out[k] = pin.updateFramePlacement(model, data, tool).homogeneous
        return out

    def batch() -> np.ndarray:
        return k1607.closed_form.forward_kinematics(Q)

    for loop in (idiom, tightest):
        assert np.abs(loop() - batch()).max() < 1e-12, "both sides must compute the same poses"
    timings, rounds = compare(batch, idiom, tightest, rounds=11, seconds=0.1)
    console.print(f"{POSES:,} poses, one core: batched closed form {timings[0].median / POSES * 1e9:.0f} ns a pose")
    for k, loop in enumerate((idiom, tightest), start=1):
        ratio = rounds[:, k] / rounds[:, 0]
        console.print(
            f"  Python loop over Pinocchio, {loop.__name__}: {timings[k].median / POSES * 1e9:.0f} ns, "
            f"[bold]{np.median(ratio):.1f} times[/] (min {ratio.min():.1f}, max {ratio.max():.1f})"
        )


def compiled(console: Console) -> None:
    """The three forms as C from CasADi, -O3: what 'suitable for real-time' means on this machine."""
    compiler = shutil.which("cc") or shutil.which("clang")
    table = Table(title="Forward kinematics: operations, and time compiled to C (-O3, one pose a call)")
    for column in ("form", "x", "+", "sin, cos", "ns"):
        table.add_column(column, justify="left" if column == "form" else "right")
    _, _, folded, closed, _ = count()
    traced = {
        folded.form: lambda q: product.forward_kinematics(table_1(), q),
        closed.form: closed_form.forward_kinematics,
    }
    times = {}
    if compiler:
        with tempfile.TemporaryDirectory() as folder:
            for name, fun in traced.items():
                times[name] = _time_c(compiler, Path(folder), trace(fun, "f", [(7,)]))
    else:
        console.print("no C compiler found: no times")
    for row in count():
        ns = f"{times[row.form]:.0f}" if row.form in times else ""
        table.add_row(row.form, str(row.multiplications), str(row.additions), str(row.trigonometric), ns)
    console.print(table)


def _time_c(compiler: str, folder: Path, f: ca.Function) -> float:
    """Median nanoseconds of one evaluation, the loop in C; checked against the NumPy closed form first."""
    generator = ca.CodeGenerator("f", {"with_header": False})
    generator.add(f)
    loop = """
void loop(const double* q, double* T, long n) {
  double w[512]; const double* arg[1]; double* res[1];
  for (long k = 0; k < n; ++k) { arg[0] = q + 7 * k; res[0] = T + 16 * k; f(arg, res, 0, w, 0); }
}
"""
    (folder / "f.c").write_text(generator.dump() + loop)
    command = [compiler, "-O3", "-shared", "-fPIC", str(folder / "f.c"), "-o", str(folder / "f.so"), "-lm"]
    subprocess.run(command, check=True)
    library = ctypes.CDLL(str(folder / "f.so"))
    Q = np.random.default_rng(0).uniform(-np.pi, np.pi, (POSES, 7))
    T = np.empty((POSES, 4, 4))
    arguments = ctypes.c_void_p(Q.ctypes.data), ctypes.c_void_p(T.ctypes.data), ctypes.c_long(POSES)
    (timing,), _ = compare(lambda: library.loop(*arguments))
    poses = T.swapaxes(-1, -2)  # CasADi writes columns first
    assert np.abs(poses - k1607.closed_form.forward_kinematics(Q)).max() < 1e-12
    return timing.median / POSES * 1e9


def main() -> None:
    console = Console(width=120)
    console.print(machine())
    arm_calls(console)
    batches(console)
    compiled(console)


if __name__ == "__main__":
    main()
