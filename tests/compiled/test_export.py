"""Exported C: compiled as strictly as can be, run against what is known, and made to fail."""

import copy
import ctypes
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.arm.ready import ready_postures
from k1607_pin.cli.compiled import export as export_command
from k1607_pin.compiled.export import export
from k1607_pin.compiled.export.function import fields
from k1607_pin.compiled.export.law import exported_law
from k1607_pin.compiled.export.plain_c import statements
from k1607_pin.compiled.export.presets import LAWS, law_of
from k1607_pin.compiled.leaves import Layout
from k1607_pin.compiled.program import program
from k1607_pin.compiled.trace import trace
from k1607_pin.compiled.traced_arm import TracedArm
from k1607_pin.compiled.tracer import TracingError
from k1607_pin.control.cartesian import CartesianAdaptive
from k1607_pin.control.practice import OFF
from k1607_pin.paths.report_paths import Line

CC = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow", "-Wmissing-prototypes"]
PERIOD = 0.001

needs_cc = pytest.mark.skipif(CC is None, reason="no C compiler")


def compiled(folder, *arguments):
    return subprocess.run([CC, *arguments], cwd=folder, capture_output=True, text=True)


def selftest(folder):
    """What the self-test says, compiled without a warning."""
    sources = sorted(file.name for file in folder.glob("*.c"))
    built = compiled(folder, *STRICT, "-O0", *sources, "-o", "selftest", "-lm")
    assert not built.returncode, built.stderr
    return subprocess.run([folder / "selftest"], capture_output=True, text=True)


@pytest.fixture(scope="module")
def exported(arm, tmp_path_factory):
    """An arm with all its functions and laws."""
    folder = tmp_path_factory.mktemp("c")
    export(arm, folder, {name: law_of(arm, name, PERIOD) for name in LAWS}, prefix="arm")
    return folder


@needs_cc
def test_selftest_of_everything(arm, exported):
    done = selftest(exported)
    assert done.returncode == 0, done.stdout
    assert done.stdout.endswith("arm: 14 functions, 0 failures\n")  # 8 of the arm, a step and a start of 3 laws
    for name in ("operational_space", "cartesian_step", "joint_step", "hybrid_step"):
        assert re.search(rf"^ok +arm_{name}: 25 states", done.stdout, re.M)


@needs_cc
@pytest.mark.parametrize("function", ["gravity_torque", "cartesian_step", "hybrid_step"])
def test_selftest_fails_on_a_constant_that_is_another(reference, tmp_path, function):
    """A length of the arm, altered in its seventh digit."""
    law = function.removesuffix("_step")
    laws = {law: law_of(reference, law, PERIOD)} if law in LAWS else {}
    source = export(reference, tmp_path, laws, () if laws else (function,), "arm")[1]
    text = source.read_text()
    constant = re.compile(r"(?<![\w.])\d+\.\d{5,}").search(text, text.index(f"static void {function}_values("))
    source.write_text(text[: constant.start()] + repr(float(constant[0]) * (1 + 1e-6)) + text[constant.end() :])
    done = selftest(tmp_path)
    assert done.returncode == 1
    assert f"FAILED  arm_{function}: torque is off" in done.stdout


@needs_cc
def test_selftest_fails_without_the_check_for_nan(reference, tmp_path):
    export(reference, tmp_path, functions=("jacobian",))
    source = tmp_path / "k1607.c"
    source.write_text(source.read_text().replace("return finite;", "return finite || n > 0;"))
    done = selftest(tmp_path)
    assert done.returncode == 1
    assert "not finite went through" in done.stdout


@needs_cc
def test_selftest_fails_on_a_result_that_is_no_number(reference, tmp_path):
    export(reference, tmp_path, functions=("gravity_torque",))
    source = tmp_path / "k1607.c"
    source.write_text(re.sub(r"(torque\[3\] = )", r"\1NAN + ", source.read_text()))
    assert "NAN" in source.read_text()
    done = selftest(tmp_path)
    assert done.returncode == 1
    assert "FAILED" in done.stdout


class Clipping:
    """A law that limits what is none."""

    def __init__(self, arm):
        self.arm = arm

    def initial(self, q, v):
        return None

    def update(self, t, q, v, state):
        return np.clip(np.sqrt(np.sin(q)) * 100, -5.0, 5.0), None, {}


@pytest.mark.filterwarnings("ignore:invalid value")
def test_a_law_whose_torque_is_not_finite_is_not_exported(reference, tmp_path):
    with pytest.raises(ValueError, match="expected finite torques"):
        export(reference, tmp_path / "none", {"law": Clipping(reference)})


@pytest.mark.parametrize("name", LAWS)
def test_cases_reach_both_the_limit_and_the_adaptation(reference, name):
    """Golden vectors of a law that only ever saturates, or never moves its gains, would prove little."""
    step = exported_law(reference, name, law_of(reference, name, PERIOD)).functions[-1]
    at = {}
    for key, arguments in (("given", step.inputs), ("expected", step.outputs)):
        first = 0
        for struct, field in fields(arguments):
            at[key, struct and struct.name, field.name] = slice(first, first + field.size)
            first += field.size
    K = next(field.name for struct, field in fields(step.outputs) if struct)
    share = [
        np.max(np.abs(case.expected[at["expected", None, "torque"]]) / reference.effort_limit) for case in step.cases
    ]
    moved = [
        np.abs(case.expected[at["expected", "state", K]] / case.given[at["given", "state", K]] - 1).max()
        for case in step.cases
    ]
    assert max(share) == pytest.approx(1.0)
    assert min(share) < 0.99
    assert max(moved) > 1e-7  # ten thousand times what the self-test lets pass


@needs_cc
@pytest.mark.parametrize("name", LAWS)
def test_a_hundred_steps_equal_the_controller(reference, tmp_path, name):
    """State and all: 100 ticks of a motion near the path, with other numbers than it was exported with."""
    law = law_of(reference, name, PERIOD)
    options = {"velocity_cutoff": 300.0, "sigma": 0.5, "dead_zone": 1e-4, "torque_limit": None}
    law = replace(law, practice=replace(law.practice, **options))
    export(reference, tmp_path, {"law": law}, functions=(), prefix="arm")
    sources = ["arm_law.c", "-shared", "-fPIC", "-o", "law.so", "-lm"]
    assert not compiled(tmp_path, *STRICT, "-O1", *sources).returncode
    library = ctypes.CDLL(str(tmp_path / "law.so"))
    header = (tmp_path / "arm.h").read_text()
    changes = {key: x for key, x in (("beta_1", 2 * law.beta_1), ("transition", 0.03)) if hasattr(law, key)}
    other = replace(law, **changes)

    parameters, state = struct(header, "parameters")(), struct(header, "state")()
    library.arm_law_defaults(ctypes.byref(parameters))
    np.testing.assert_array_equal(entries(parameters, "period"), law.period)
    for key, x in changes.items():
        setattr(parameters, key, x)

    rng = np.random.default_rng(5)
    q, v = ready_postures(reference)[0], np.zeros(7)
    in_python = other.initial(q, v)
    reference_0 = wanted(header, other, 0.0)
    at_start = [reference_0] if name == "hybrid" else []
    arguments = [ctypes.byref(x) for x in (parameters, *at_start)]
    assert library.arm_law_initial_state(*arguments, array(q), array(v), ctypes.byref(state)) == 0
    for k in range(100):
        t = k * PERIOD
        q, v = q + 1e-4 * rng.normal(size=7), 1e-2 * rng.normal(size=7)
        tau, in_python, log = other.update(t, q, v, in_python)
        torque, error, force = (np.empty(size) for size in (7, 7 if name == "joint" else 6, 6))
        measured = [array(other.sensor(t, q, v))] if name == "hybrid" else []
        further = [array(force)] if name == "hybrid" else []
        now = wanted(header, other, t)
        status = library.arm_law_step(
            ctypes.byref(parameters), ctypes.byref(now), array(q), array(v), *measured, ctypes.byref(state),
            array(torque), array(error), *further,
        )  # fmt: skip
        assert status == 0
        close(torque, tau)
        close(error, log["joint_error" if name == "joint" else "error"])
    expected = Layout(in_python).flat(in_python)
    for field, _ in state._fields_:
        found = entries(state, field)
        close(found, expected[: len(found)])
        expected = expected[len(found) :]
    assert not expected
    K_p = (in_python.position if name == "hybrid" else in_python.gains).K_p
    assert np.abs(K_p - law.gains.K_p).max() > 1e-8 * np.abs(K_p).max()  # ten thousand times what is let pass


@needs_cc
def test_a_sample_that_is_not_finite_leaves_the_state_alone(reference, tmp_path):
    law = replace(law_of(reference, "cartesian", PERIOD), practice=OFF)
    export(reference, tmp_path, {"law": law}, functions=(), prefix="arm")
    assert not compiled(tmp_path, *STRICT, "arm_law.c", "-shared", "-fPIC", "-o", "law.so", "-lm").returncode
    library, header = ctypes.CDLL(str(tmp_path / "law.so")), (tmp_path / "arm.h").read_text()
    parameters, state = struct(header, "parameters")(), struct(header, "state")()
    q, v = ready_postures(reference)[0], np.full(7, 0.01)
    library.arm_law_defaults(ctypes.byref(parameters))
    library.arm_law_initial_state(ctypes.byref(parameters), array(q), array(v), ctypes.byref(state))

    def step(q, now):
        torque, error = np.ones(7), np.ones(6)
        status = library.arm_law_step(
            ctypes.byref(parameters),
            ctypes.byref(now),
            array(q),
            array(v),
            ctypes.byref(state),
            array(torque),
            array(error),
        )
        return status, torque, error

    before, now = bytes(state), wanted(header, law, 0.0)
    bad = q.copy()
    bad[3] = np.nan
    overflowing = wanted(header, law, 0.0)
    overflowing.position[0] = 1e306  # finite, but its torque is not
    for given in ((bad, now), (q, overflowing)):
        status, torque, error = step(*given)
        assert status == 1
        assert not torque.any()
        assert not error.any()
        assert bytes(state) == before
    status, torque, _ = step(q, now)
    assert status == 0
    assert torque.any()
    assert bytes(state) != before


@needs_cc
def test_a_next_state_that_is_not_finite_is_not_kept(reference, tmp_path):
    """Its torque looks well."""

    class Squaring:
        arm = reference

        def initial(self, q, v):
            return np.ones(1)

        def update(self, t, q, v, state):
            return -q, state * state, {}

    export(reference, tmp_path, {"law": Squaring()}, functions=(), prefix="arm")
    assert not compiled(tmp_path, *STRICT, "arm_law.c", "-shared", "-fPIC", "-o", "law.so", "-lm").returncode
    step = ctypes.CDLL(str(tmp_path / "law.so")).arm_law_step
    state, torque, q = array(np.array([1e100])), array(np.ones(7)), array(np.ones(7))
    assert [step(q, q, state, torque) for _ in range(3)] == [0, 1, 1]
    assert state[0] == 1e200
    assert not any(torque[:7])


@needs_cc
def test_the_library_needs_libm_alone(exported):
    """Undefined symbols of the library: libm's, and what compilers put in themselves."""
    if not shutil.which("nm"):
        pytest.skip("no nm")
    own, needed = set(), set()
    for source in exported.glob("arm*.c"):
        if "selftest" in source.name:
            continue
        compiled(exported, "-std=c99", "-O0", "-fno-stack-protector", "-c", source.name, "-o", "unit.o")
        listed = subprocess.run(["nm", "unit.o"], cwd=exported, capture_output=True, text=True, check=True).stdout
        assert not re.search(r" [bBdDC] ", listed), listed  # nothing is kept from call to call
        needed |= {line.split()[-1].lstrip("_") for line in listed.splitlines() if " U " in line}
        own |= {line.split()[-1].lstrip("_") for line in listed.splitlines() if " T " in line}
    assert needed <= {"sin", "cos", "sqrt", "exp", "atan2", "fmin", "fmax", "memcpy", "memset", "sincos"}
    assert {"arm_jacobian", "arm_hybrid_step", "arm_cartesian_defaults"} <= own


@needs_cc
def test_fast_math_is_refused(reference, tmp_path):
    export(reference, tmp_path, functions=("gravity_torque",))
    done = compiled(tmp_path, "-std=c99", "-ffast-math", "-c", "k1607.c")
    assert done.returncode
    assert "-ffast-math" in done.stderr


def test_header_serves_cpp(exported):
    cpp = shutil.which("c++")
    if cpp is None:
        pytest.skip("no C++ compiler")
    (exported / "use.cc").write_text(
        '#include "arm.h"\nint main() { double q[7] = {0}, J[42]; return arm_jacobian(q, J); }\n'
    )
    flags = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-c", "use.cc", "-o", "use.o"]
    built = subprocess.run([cpp, *flags], cwd=exported, capture_output=True, text=True)
    assert not built.returncode, built.stderr
    if shutil.which("nm"):
        listed = subprocess.run(["nm", "use.o"], cwd=exported, capture_output=True, text=True, check=True).stdout
        assert re.search(r" U _?arm_jacobian$", listed, re.M)  # not mangled


@needs_cc
def test_cmake_builds_and_tests(reference, tmp_path):
    if not (shutil.which("cmake") and shutil.which("ctest")):
        pytest.skip("no cmake")
    export(reference, tmp_path, {"joint": law_of(reference, "joint", PERIOD)}, ("jacobian",))
    for command in (["cmake", "-S", ".", "-B", "b"], ["cmake", "--build", "b"], ["ctest", "--test-dir", "b"]):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
    assert "1 tests passed" in done.stdout or "100% tests passed" in done.stdout


def test_header_counts_the_operations_and_names_the_versions(exported, arm):
    header = (exported / "arm.h").read_text()
    assert f"k1607-pin {k1607.__version__} with CasADi {ca.__version__}" in header
    p = program(trace(lambda q: np.reshape(TracedArm(arm).jacobian(q), (-1,)), "J", [(arm.n,)]))
    counted = re.search(r"(\d+) operations[^;]*?int arm_jacobian\(", header, re.S)
    assert int(counted[1]) == sum(p.operations.values())
    assert f"{p.operations['mul']} mul" in counted[0]


def test_the_same_again_from_the_command_line(tmp_path):
    """Another process, with other hashes of its own, writes the same bytes."""
    arm = k1607.load_example("ur5")
    export(arm, tmp_path / "here", {"joint": law_of(arm, "joint", PERIOD)}, ("jacobian",))
    command = ["export", str(tmp_path / "there"), "--robot", "ur5", "--law", "joint", "--function", "jacobian"]
    done = subprocess.run([sys.executable, "-m", "k1607_pin.cli", *command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    here, there = ({x.name: x.read_bytes() for x in (tmp_path / name).iterdir()} for name in ("here", "there"))
    assert here == there
    assert set(here) == {"ur5.h", "ur5.c", "ur5_joint.c", "ur5_selftest.c", "CMakeLists.txt"}
    assert "cc -std=c99" in done.stdout


@pytest.mark.parametrize(
    ("law", "period", "words"), [("slotine", 1.0, "law: expected one of"), ("joint", 0.0, "period")]
)
def test_the_command_line_refuses_what_there_is_not(tmp_path, law, period, words):
    with pytest.raises(ValueError, match=words):
        export_command(tmp_path / "none", robot="ur5", law=[law], function=None, period=period, prefix=None)
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"functions": ("jacobi",)}, "functions: expected some of forward_kinematics"),
        ({"prefix": "7dof"}, "prefix: expected a name of letters"),
        ({"controllers": {"a b": None}}, "controllers: expected a name of letters"),
        ({"controllers": {"selftest": None}}, "another name than that of the self-test"),
        ({"prefix": "math"}, "prefix: expected a name that is no header of C's"),
        ({"prefix": "test"}, "no target of CMake's"),
        ({"controllers": {"law": object()}}, "expected 'law' to have initial"),
        ({"functions": ()}, "at least one of either"),
    ],
)
def test_what_cannot_be_is_refused(reference, tmp_path, arguments, words):
    with pytest.raises(ValueError, match=words):
        export(reference, tmp_path / "none", **arguments)
    assert not (tmp_path / "none").exists()


def test_fewer_than_six_joints_have_no_operational_space(tmp_path):
    whole = k1607.load_example("ur5")
    arm = k1607.load_example("ur5", locked=whole.joint_names[3:])
    export(arm, tmp_path, prefix="short")
    header = (tmp_path / "short.h").read_text()
    assert "short_forward_dynamics" in header
    assert "short_operational_space" not in header
    with pytest.raises(ValueError, match="no operational_space"):
        export(arm, tmp_path, functions=("operational_space",))


class Branching:
    """A controller that asks a traced number a question."""

    def __init__(self, arm):
        self.arm = arm

    def initial(self, q, v):
        return None

    def update(self, t, q, v, state):
        return (q if q[0] > 0 else v), None, {}


class Counting(Branching):
    """A controller that remembers."""

    calls = 0

    def update(self, t, q, v, state):
        self.calls += 1
        return self.calls * q, None, {}


class Previewing(Branching):
    path = staticmethod(lambda t: np.full(7, t))

    def __init__(self, arm):
        super().__init__(arm)
        self.path = Previewing.path

    def update(self, t, q, v, state):
        return self.path(t + 0.1) - q, None, {}


@pytest.mark.parametrize(
    ("law", "words"),
    [(Branching, "np.where"), (Previewing, "the time of the sample"), (Counting, "changes its own calls")],
)
def test_a_controller_that_cannot_be_exported_says_why(reference, tmp_path, law, words):
    with pytest.raises(TracingError, match=words):
        export(reference, tmp_path, {"law": law(reference)})


@needs_cc
def test_a_controller_of_one_s_own_without_state(reference, tmp_path):
    """Its time is an argument, and there is no state to begin with."""

    class Own(Branching):
        def update(self, t, q, v, state):
            return self.arm.gravity_torque(q) - 3.0 * v * np.exp(-t), None, {}

    export(reference, tmp_path, {"own": Own(reference)}, functions=())
    header = (tmp_path / "k1607.h").read_text()
    assert "double t; " in header
    assert "initial_state" not in header
    assert selftest(tmp_path).returncode == 0


class Nest:
    """A state, and how to make the next of it; not looked into."""

    def __init__(self, first):
        self.first, self.layout = first, Layout(first)


@dataclass(frozen=True)
class Awkward:
    """A law whose numbers have names that C has uses for, or that are none in C."""

    arm: k1607.Arm
    double: float
    w1: Callable[..., np.ndarray]
    torque: Callable[..., float]
    sin: Callable[..., float]
    nest: Nest
    long: float = 2.0

    def initial(self, q, v):
        return self.nest.first

    def update(self, t, q, v, state):
        asked = self.w1(t, q, v) + np.hstack([self.torque(t, q, v), self.sin(t, q, v), np.zeros(5)])
        x = np.stack(self.nest.layout.flat(state))
        return self.double * asked + self.long * np.sin(q) - x[0], self.nest.layout.rebuilt(0.5 * x + v[0]), {}


@needs_cc
@pytest.mark.parametrize(
    "state",
    [
        np.ones(2),
        1.5,
        (1.0, np.ones((2, 2))),
        {"int": 1.0, "a b": 2.0, "a_b": 3.0, "2nd": np.ones(3), "ä": 5.0, "class": 6.0, "NAN": 7.0},
        {"K": {"int": 1.0, "x": 2.0}, "L": {"int": 3.0, "x": 4.0}},
    ],
    ids=["array", "number", "tuple", "names", "nested"],
)
def test_any_names_become_names_of_c(reference, tmp_path, state):
    def measured(shape):
        return lambda t, q, v: 0.1 * np.ones(shape) if shape else 0.1

    law = Awkward(reference, 3.0, measured((7,)), measured(()), measured(()), Nest(state))
    export(reference, tmp_path, {"law": law}, functions=(), prefix="arm")
    done = selftest(tmp_path)
    assert done.returncode == 0, done.stdout
    if cpp := shutil.which("c++"):
        built = subprocess.run([cpp, "-x", "c++", "-fsyntax-only", tmp_path / "arm.h"], capture_output=True, text=True)
        assert not built.returncode, built.stderr


class OtherOrder:
    """Gives its state's numbers in another order than it began with."""

    def initial(self, q, v):
        return {"i": 0 * q, "f": v}

    def update(self, t, q, v, state):
        return -q - state["i"], {"f": state["f"] + q, "i": state["i"] + 1e-3 * v}, {}


@needs_cc
def test_a_state_in_another_order_goes_where_it_belongs(reference, tmp_path):
    export(reference, tmp_path, {"law": OtherOrder()}, functions=(), prefix="arm")
    assert selftest(tmp_path).returncode == 0
    assert not compiled(tmp_path, *STRICT, "arm_law.c", "-shared", "-fPIC", "-o", "law.so", "-lm").returncode
    step = ctypes.CDLL(str(tmp_path / "law.so")).arm_law_step
    q, v = np.linspace(0.1, 0.7, 7), np.linspace(1, 2, 7)
    state, torque = array(np.concatenate([0 * q, v])), array(np.zeros(7))
    assert step(array(q), array(v), state, torque) == 0
    np.testing.assert_allclose(state[:14], np.concatenate([1e-3 * v, v + q]))


@needs_cc
@pytest.mark.parametrize("error", [lambda q: -q, lambda q: -q[:3], lambda q: -q[0]], ids=["joints", "three", "one"])
def test_a_law_may_log_any_error_and_nothing_is_made_up_about_its_numbers(reference, tmp_path, error):
    class Own:
        """Of one's own."""

        gain = 3.0

        def __init__(self):
            self.touch = 2.0

        def initial(self, q, v):
            return {"integral": 0 * q, "offset": 0.0}

        def update(self, t, q, v, state):
            tau = -self.gain * q - self.touch * v - state["integral"]
            return tau, {"integral": state["integral"] + q, "offset": state["offset"] + v[0]}, {"error": error(q)}

    export(reference, tmp_path, {"law": Own()}, functions=(), prefix="arm")
    assert selftest(tmp_path).returncode == 0
    header = (tmp_path / "arm.h").read_text()
    assert re.search(r"integral\[7\]; /\* as the controller has it \*/", header)
    assert "force" not in header
    assert "Part of the code: touch 2." in header


@needs_cc
def test_an_arm_that_is_singular_everywhere_is_exported(tmp_path):
    links = "".join(
        f"<link name='l{k}'><inertial><origin xyz='0.5 0 0'/><mass value='1'/>"
        "<inertia ixx='0.01' iyy='0.01' izz='0.01' ixy='0' ixz='0' iyz='0'/></inertial></link>"
        for k in range(5)
    )
    joints = "".join(
        f"<joint name='j{k}' type='revolute'><parent link='l{k}'/><child link='l{k + 1}'/><origin xyz='1 0 0'/>"
        "<axis xyz='0 1 0'/><limit lower='-3' upper='3' effort='10' velocity='3'/></joint>"
        for k in range(4)
    )
    (tmp_path / "planar.urdf").write_text(f"<robot name='planar'>{links}{joints}</robot>")
    arm = k1607.load_urdf(tmp_path / "planar.urdf")
    export(arm, tmp_path / "c", {"joint": law_of(arm, "joint", 0.001)}, ("gravity_torque", "jacobian"))
    assert selftest(tmp_path / "c").returncode == 0
    header = (tmp_path / "c" / "planar.h").read_text()
    assert "q[2]  j2: revolute, -3 to 3 rad, 10 N m at most" in header


@needs_cc
def test_selftest_fails_on_another_default(reference, tmp_path):
    export(reference, tmp_path, {"joint": law_of(reference, "joint", PERIOD)}, functions=())
    source = tmp_path / "k1607_joint.c"
    text = source.read_text()
    assert "    0.001, /* period */" in text
    source.write_text(text.replace("    0.001, /* period */", "    0.01, /* period */"))
    done = selftest(tmp_path)
    assert done.returncode == 1
    assert "joint_defaults: period is not as exported" in done.stdout


@needs_cc
@pytest.mark.parametrize("joint", range(7))
def test_selftest_fails_on_a_torque_limit_that_is_another(reference, tmp_path, joint):
    """Of each joint, though only the one that is nearest to its limit counts at a time."""
    limit = np.array([1999.0, 1998, 799, 798, 149, 148, 49])
    law = law_of(reference, "joint", PERIOD)
    law = replace(law, practice=replace(law.practice, torque_limit=limit))
    export(reference, tmp_path, {"joint": law}, functions=())
    source = tmp_path / "k1607_joint.c"
    text, count = re.subn(rf"\b{limit[joint]:.1f}\b", f"{10 * limit[joint]:.1f}", source.read_text())
    assert count
    source.write_text(text)
    assert selftest(tmp_path).returncode == 1


def test_what_is_there_already_is_replaced_only_if_it_is_of_the_same_export(reference, tmp_path):
    law = {"joint": law_of(reference, "joint", PERIOD)}
    export(reference, tmp_path, law | {"hold": OtherOrder()}, ("jacobian",))
    files = export(reference, tmp_path, law, ("jacobian",))
    assert {file.name for file in tmp_path.iterdir()} == {file.name for file in files}
    with pytest.raises(ValueError, match=r"folder: expected none, or one with an export of 'other'.*CMakeLists"):
        export(reference, tmp_path, functions=("jacobian",), prefix="other")
    (tmp_path / "k1607_joint.c").write_text("mine")
    with pytest.raises(ValueError, match=r"folder: .*k1607_joint.c"):
        export(reference, tmp_path, law, ("jacobian",))
    assert (tmp_path / "k1607_joint.c").read_text() == "mine"
    with pytest.raises(ValueError, match="folder: expected a folder or none, got a file"):
        export(reference, tmp_path / "k1607_joint.c", functions=("jacobian",))


def test_what_is_another_export_s_is_not_taken_away(reference, tmp_path):
    law = {"left": law_of(reference, "joint", PERIOD)}
    export(reference, tmp_path, law, (), prefix="arm_other")
    (tmp_path / "CMakeLists.txt").unlink()  # another build system
    mine = tmp_path / "arm_tests.c"
    mine.write_text((tmp_path / "arm_other_selftest.c").read_text() + "/* mine */")
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    export(reference, tmp_path, functions=("jacobian",), prefix="arm")
    assert {name: (tmp_path / name).read_bytes() for name in before} == before


@needs_cc
def test_a_scheme_made_another_by_a_subclass_keeps_its_units_and_names_no_argument_as_code(reference, tmp_path):
    class Mine(CartesianAdaptive):
        @cached_property
        def inertia(self):
            return self.arm.mass_matrix(np.zeros(7))

        def update(self, t, q, v, state):
            tau, state, log = super().update(t, q, v, state)
            return tau - 0.1 * self.inertia @ v, state, log

    law = copy.copy(law_of(reference, "cartesian", PERIOD))
    object.__setattr__(law, "__class__", Mine)
    export(reference, tmp_path, {"law": law}, functions=(), prefix="arm")
    header = (tmp_path / "arm.h").read_text()
    assert "rate at which K_p adapts, (76)" in header
    assert "m; wanted position of the tool's origin" in header
    assert selftest(tmp_path).returncode == 0


@needs_cc
def test_of_one_s_own_law_what_is_asked_is_not_called_code(reference, tmp_path):
    @dataclass(frozen=True)
    class Own:
        arm: k1607.Arm
        path: Line
        gain: float = 3.0
        steps: int = 4

        def initial(self, q, v):
            return None

        def update(self, t, q, v, state):
            p = self.arm.forward_kinematics(q).translation
            force = self.gain * (self.path(t).position - p) / self.steps
            return self.arm.jacobian(q)[:3].T @ force - v, None, {}

    law = Own(reference, Line(np.array([0.5, 0.0, 0.5])))
    export(reference, tmp_path, {"law": law}, functions=(), prefix="arm")
    header = (tmp_path / "arm.h").read_text()
    assert "Part of the code: steps 4." in header
    assert selftest(tmp_path).returncode == 0


@pytest.mark.parametrize("period", [0.001, 0.004])
@pytest.mark.parametrize("name", ["cartesian", "joint"])
def test_what_is_exported_comes_back_from_a_start_that_is_off(arm, name, period):
    """The tool by a centimetre, or the joints by 20 mrad, in any direction, with the motors' limits."""
    law, q0, rng = law_of(arm, name, period), ready_postures(arm)[0], np.random.default_rng(0)
    off = rng.normal(size=(32, arm.n))
    size = np.linalg.norm(off @ arm.jacobian(q0)[:3].T, axis=1) / 0.01
    off /= (size if name == "cartesian" else np.abs(off).max(axis=1) / 0.02)[:, None]
    plant = k1607.Plant(arm, torque_limit=arm.effort_limit)
    error = "error" if name == "cartesian" else "joint_error"
    found = k1607.rollout(plant, law, q0 + off, 1.0, control_period=period, metrics={error: "last"})
    assert np.isnan(found.failed_at).all()
    assert found[f"{error}_last"].values.max() < 2e-3


@needs_cc
@pytest.mark.parametrize("seed", range(4))
def test_every_operation_in_plain_c(tmp_path, seed):
    """Random nests of all operations: the C against CasADi's own evaluation."""
    rng = np.random.default_rng(seed)
    x = ca.SX.sym("x", 6)
    pool = [x[k] for k in range(6)] + [ca.SX(float(c)) for c in rng.normal(size=4)]
    unary = [
        lambda a: -a, ca.sin, ca.cos, lambda a: ca.sqrt(ca.fabs(a)), lambda a: a * a, ca.tanh, ca.sign, ca.fabs,
        lambda a: 2 * a, lambda a: 1 / (1 + a * a), ca.floor, ca.exp, ca.logic_not, ca.atan,
    ]  # fmt: skip
    binary = [
        lambda a, b: a + b, lambda a, b: a - b, lambda a, b: a * b, lambda a, b: a / (1 + b * b), ca.fmin, ca.fmax,
        ca.atan2, lambda a, b: a < b, lambda a, b: a <= b, lambda a, b: a == b, lambda a, b: a != b, ca.logic_and,
        ca.logic_or, lambda a, b: ca.if_else(a < b, a, b), lambda a, b: ca.if_else(a, b, 0), ca.hypot,
    ]  # fmt: skip
    for k in range(240):
        one, other = (pool[i] for i in rng.integers(len(pool), size=2))
        made = unary[k % len(unary)](one) if k % 3 else binary[k // 3 % len(binary)](one, other)
        pool.append(ca.tanh(made) if k % 5 == 0 else made)
    outputs = ca.vertcat(*pool[10:])
    f = ca.Function("f", [x], [outputs])
    p = program(f)
    lines = statements(p, lambda k, i: f"x[{i}]", [f"y[{k}]" for k in range(outputs.numel())])
    text = "#include <math.h>\nvoid f(const double *x, double *y);\nvoid f(const double *x, double *y)\n{\n"
    (tmp_path / "f.c").write_text(text + "\n".join(lines) + "\n}\n")
    built = compiled(tmp_path, *STRICT, "-O1", "f.c", "-shared", "-fPIC", "-o", "f.so", "-lm")
    assert not built.returncode, built.stderr
    run = ctypes.CDLL(str(tmp_path / "f.so")).f
    with np.errstate(all="ignore"):
        for _ in range(20):
            given, found = rng.normal(size=6), np.empty(outputs.numel())
            run(array(given), array(found))
            expected = f(given).full().ravel()
            fine = np.isfinite(expected)
            assert fine.mean() > 0.9
            np.testing.assert_allclose(found[fine], expected[fine], rtol=1e-9, atol=1e-9)


@needs_cc
def test_minimum_maximum_and_sign_keep_what_is_no_number(tmp_path):
    x = ca.SX.sym("x", 2)
    outputs = ca.vertcat(ca.fmin(x[0], x[1]), ca.fmax(x[0], x[1]), ca.sign(x[0]))
    lines = statements(program(ca.Function("f", [x], [outputs])), lambda k, i: f"x[{i}]", [f"y[{k}]" for k in range(3)])
    (tmp_path / "f.c").write_text(
        "void f(const double *x, double *y);\nvoid f(const double *x, double *y)\n{\n" + "\n".join(lines) + "\n}\n"
    )
    assert not compiled(tmp_path, *STRICT, "-O2", "f.c", "-shared", "-fPIC", "-o", "f.so").returncode
    run = ctypes.CDLL(str(tmp_path / "f.so")).f
    for given in ([np.nan, 1.0], [1.0, np.nan], [2.0, 1.0], [-np.inf, 0.0], [0.0, 0.0]):
        found, x = np.empty(3), np.array(given)
        run(array(x), array(found))
        np.testing.assert_array_equal(found, [np.minimum(*x), np.maximum(*x), np.sign(x[0])])


# Structures as the header has them.


def struct(header, name):
    body = re.search(rf"typedef struct \{{([^}}]*)\}} arm_law_{name};", header)[1]
    members = re.findall(r"^  double (\w+)(?:\[(\d+)\])?;", body, re.M)
    fields = [(key, ctypes.c_double * int(size) if size else ctypes.c_double) for key, size in members]
    return type(name, (ctypes.Structure,), {"_fields_": fields})


def entries(x, field):
    return np.ravel(
        np.ctypeslib.as_array(getattr(x, field)) if hasattr(getattr(x, field), "_length_") else getattr(x, field)
    )


def wanted(header, law, t):
    """The reference at time t, by the names that the header has."""
    made, point = struct(header, "reference")(), law.path(t)
    values = {"position": point.position, "velocity": point.velocity}
    if getattr(law, "posture", None):
        values["posture_position"], values["posture_velocity"] = law.posture.path(t)
    if hasattr(law, "mode"):
        values["selection"], values["wanted_force"] = law.mode(t)
    for field, _ in made._fields_:
        getattr(made, field)[:] = list(values[field])
    return made


def array(x):
    return np.ascontiguousarray(x, dtype=float).ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("period", [0.001, 0.002, 0.01])
@pytest.mark.parametrize("name", ["k1607", "panda", "ur5", "xarm7"])
def test_the_hybrid_law_that_is_exported_holds_in_its_own_period(name, period):
    """It looks at its sampled loop when it starts, (H12)."""
    arm = k1607.load_k1607() if name == "k1607" else k1607.load_example(name)
    law_of(arm, "hybrid", period).start(ready_postures(arm)[0], np.zeros(arm.n), 0.5)
