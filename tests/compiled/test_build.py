"""The build: what is found, what is kept, and what happens without a compiler."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.compiled import build
from k1607_pin.compiled.doctor import diagnose
from k1607_pin.compiled.rollout import forget

pytestmark = pytest.mark.skipif(build.compiler() is None, reason="no C compiler")
SETTINGS = {"duration": 0.1, "log": ("q", "tau", "K_p")}
PAYLOADS = [(0.03, k1607.Payload(3.0, np.array([0.0, 0.1, 0.0])), 0.02), (0.08, k1607.Payload(0.0))]


@pytest.fixture
def fresh(monkeypatch, tmp_path):
    """A cache folder of one's own; what was found and traced before is forgotten, before and after."""
    monkeypatch.setenv("K1607_CACHE", str(tmp_path / "cache"))
    build.compiler.cache_clear()
    forget()
    yield tmp_path / "cache"
    build.compiler.cache_clear()
    forget()


@pytest.mark.parametrize("kind", ["AVX2", "plain"])
def test_other_widths_agree_to_rounding(arm, law, q0, agrees, fresh, monkeypatch, kind):
    if kind == "AVX2" and build.instructions() not in ("AVX2", "AVX-512"):
        pytest.skip("no AVX2")
    widest = k1607.rollout(arm, law, q0, payloads=PAYLOADS, **SETTINGS)
    monkeypatch.setenv("K1607_INSTRUCTIONS", kind)
    build.compiler.cache_clear()
    forget()
    other = k1607.rollout(arm, law, q0, payloads=PAYLOADS, **SETTINGS)
    assert other.attrs["engine"].startswith(kind)
    agrees(other, widest.isel(rollout=0), SETTINGS["log"], tolerance=1e-11)


@pytest.mark.parametrize("from_rest", [False, True])
def test_without_a_compiler_the_results_are_the_same(arm, law, q0, agrees, fresh, monkeypatch, from_rest):
    vary = {"controller.beta_1": [0.0, 1e3, 1e4], "payloads.0.payload.mass": [1.0, 2.0, 3.0]}
    settings = {**SETTINGS, "payloads": PAYLOADS, "from_rest": from_rest, "vary": vary}
    native = k1607.rollout(arm, law, q0, **settings)
    monkeypatch.setenv("K1607_COMPILER", "none")
    build.compiler.cache_clear()
    forget()
    with pytest.warns(RuntimeWarning, match="no C compiler"):
        interpreted = k1607.rollout(arm, law, q0, **settings)
    assert "CasADi" in interpreted.attrs["engine"]
    for i in range(3):
        agrees(interpreted, native.isel(rollout=i), SETTINGS["log"], i, tolerance=1e-11)
    for name in ("error_max", "error_rms", "tau_max", "work"):
        np.testing.assert_allclose(interpreted[name], native[name], rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(interpreted.failed_at, native.failed_at)


def test_without_a_compiler_payloads_of_nothing_and_batches_of_none_are_as_with_one(arm, law, q0, fresh, monkeypatch):
    settings = {"payloads": [(0.0, k1607.Payload(0.0))], "metrics": {"error": "min"}}
    native = k1607.rollout(arm, law, q0, 0.05, **settings)
    monkeypatch.setenv("K1607_COMPILER", "none")
    forget()
    build.compiler.cache_clear()
    with pytest.warns(RuntimeWarning, match="no C compiler"):
        interpreted = k1607.rollout(arm, law, q0, 0.05, **settings)
    np.testing.assert_allclose(interpreted.q_end, native.q_end, atol=1e-12)
    np.testing.assert_allclose(interpreted.error_min, native.error_min, atol=1e-12)
    with pytest.warns(RuntimeWarning, match="no C compiler"):
        assert k1607.batch(arm, "jacobian")(np.zeros((0, 7))).shape == (0, 6, 7)


def test_unknown_instructions_are_refused(fresh, monkeypatch):
    monkeypatch.setenv("K1607_INSTRUCTIONS", "MMX")
    with pytest.raises(ValueError, match="K1607_INSTRUCTIONS: expected one of AVX-512"):
        build.instructions()


def test_the_ziglang_package_will_do(fresh, monkeypatch, tmp_path):
    """A stand-in that hands over to the compiler that there is: the package itself is some hundred megabytes."""
    (package := tmp_path / "found" / "ziglang").mkdir(parents=True)
    (package / "__init__.py").touch()
    real = build.compiler().command[0]
    (package / "__main__.py").write_text(
        "import subprocess, sys\nassert sys.argv[1] == 'cc'\n"
        f"raise SystemExit(subprocess.run([{real!r}, *sys.argv[2:]]).returncode)\n"
    )
    monkeypatch.syspath_prepend(package.parent)
    monkeypatch.setenv("PYTHONPATH", str(package.parent))
    monkeypatch.setattr(build.shutil, "which", lambda name: None)
    build.compiler.cache_clear()
    made = build.compiler()
    assert made.command[:4] == (sys.executable, "-m", "ziglang", "cc")


def test_built_once(arm, law, q0, fresh):
    k1607.rollout(arm, law, q0, 0.05)
    before = {file: file.stat().st_mtime_ns for file in fresh.iterdir()}
    forget()
    k1607.rollout(arm, law, q0 + 0.01, 0.1)  # of another start and length
    assert {file: file.stat().st_mtime_ns for file in fresh.iterdir()} == before


def test_another_version_of_the_compiler_builds_anew(fresh):
    """Under the same name: what is in the cache may be what it did wrong."""
    made = build.compiler()
    text = "#define W 1\nint seven(void) { return 7; }\n"
    build.library(text, made)
    before = {file.name for file in fresh.iterdir()}
    build.library(text, made)
    assert {file.name for file in fresh.iterdir()} == before
    build.library(text, replace(made, version="a later one"))
    assert len({file.name for file in fresh.iterdir()} - before) == 2  # the library and its hash


def test_many_processes_may_build_at_once(fresh):
    code = (
        "import ctypes; from k1607_pin.compiled import build; made = build.compiler();"
        "lib = build.library('#define W 1\\nint seven(void) { return 7; }\\n' + '/* */' * 20000, made); print(lib.seven())"
    )
    running = [subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, env=os.environ) for _ in range(4)]
    assert [p.communicate()[0].strip() for p in running] == [b"7"] * 4
    assert all(file.suffix in (".so", ".sha256") for file in fresh.iterdir())


@pytest.mark.parametrize("kind", ["no folder", "a file", "not executable"])
def test_a_cache_that_cannot_be_used_is_told_and_no_obstacle(arm, law, q0, fresh, monkeypatch, caplog, tmp_path, kind):
    folder = Path("/proc/nowhere") if kind == "no folder" else tmp_path / "other"
    if kind == "a file":
        folder.write_text("")
    if kind == "not executable":  # as on a file system mounted noexec
        load = build.ctypes.CDLL

        def refused(name):
            if name.startswith(str(folder)):
                raise OSError("failed to map segment from shared object")
            return load(name)

        monkeypatch.setattr(build.ctypes, "CDLL", refused)
    monkeypatch.setenv("K1607_CACHE", str(folder))
    for cached in (build.compiler, build._tell):
        cached.cache_clear()
    forget()
    assert "lanes" in k1607.rollout(arm, law, q0, 0.05).attrs["engine"]
    assert caplog.text.count("cannot be kept in") == 1


DAMAGE = {
    "empty": lambda x: b"",
    "a hundred bytes": lambda x: x[:100],
    "a page": lambda x: x[:4096],
    "half": lambda x: x[: len(x) // 2],
    "no end": lambda x: x[:5000] + bytes(len(x) - 5000),
    "one bit": lambda x: x[:9000] + bytes([x[9000] ^ 1]) + x[9001:],
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_file_in_the_cache_is_built_anew(arm, law, q0, fresh, damage):
    first = k1607.rollout(arm, law, q0, 0.05)
    forget()
    build.compiler.cache_clear()
    files = list(fresh.glob("*.so"))
    for file in files:
        damaged = file.with_name("damaged")
        damaged.write_bytes(DAMAGE[damage](file.read_bytes()))
        damaged.replace(file)  # loaded ones keep what they have
    assert k1607.rollout(arm, law, q0, 0.05).identical(first)
    assert all(map(build._whole, files))


def test_what_a_killed_build_has_left_is_cleared_away(fresh):
    left, running = fresh / f"{build.BUILDING}left", fresh / f"{build.BUILDING}running"
    left.mkdir(parents=True)
    running.mkdir()
    os.utime(left, (0, 0))
    assert build.compiler()
    assert not left.exists()
    assert running.exists()


def test_what_the_compiler_says_is_told(fresh):
    with pytest.raises(build.BuildError, match="error"):
        build.library("this is no C", build.compiler())
    assert {file.suffix for file in Path(fresh).iterdir()} == {
        ".so",
        ".sha256",
    }  # of the one that tells whether it works


def test_cc_may_have_options_and_spaces(arm, law, q0, fresh, monkeypatch, tmp_path):
    folder = tmp_path / "with space"
    folder.mkdir()
    compiler = folder / "my cc"
    compiler.symlink_to(Path(build.compiler().command[0]).resolve())
    build.compiler.cache_clear()
    monkeypatch.setenv("CC", f"'{compiler}' -DMINE=1")
    made = build.compiler()
    assert made.command[:2] == (str(compiler), "-DMINE=1")
    assert np.isfinite(k1607.rollout(arm, law, q0, **SETTINGS).q.values).all()


LOOSE = [
    "-ffast-math", "-Ofast", "-O3 -Ofast -O2", "-funsafe-math-optimizations", "-ffinite-math-only", "-fassociative-math",
    "-ffast-math -fno-fast-math", "-ffp-model=fast", "-fp-model fast", "'-ffast-math'", "-fdenormal-fp-math=positive-zero",
]  # fmt: skip


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        ("nowhere-cc", "there is no nowhere-cc"),
        ("false", "false"),
        ("/", "there is no /"),
        ("gcc '", "No closing quotation"),
        ('"', "No closing quotation"),
        ("gcc @nowhere.rsp", "@nowhere.rsp cannot be read: No such file"),
        ("gcc -fnothing-of-the-kind", "nothing-of-the-kind"),
        *((f"gcc {option}", "loosens the arithmetic") for option in LOOSE),
        ("gcc -D__FAST_MATH__", "loose arithmetic: __FAST_MATH__"),
    ],
)
def test_a_cc_that_cannot_be_used_is_told(fresh, monkeypatch, caplog, asked, why):
    """With the reason, and what is used instead."""
    used = build.compiler().command[0]
    asked = asked.replace("gcc", used)  # which may have another name
    monkeypatch.setenv("CC", asked)
    build.compiler.cache_clear()
    assert build.compiler().command[0] == used
    (told,) = [text for text in caplog.messages if text.startswith("CC=")]
    assert told.startswith(f"CC={asked} cannot build for this machine: ")
    assert why in told
    assert told.endswith(f"; {used} is used")
    assert build.refused_cc(build.compiler()) == told


def test_doctor_tells_of_a_cc_that_cannot_be_used(fresh, monkeypatch):
    asked = f"{build.compiler().command[0]} -ffast-math"
    monkeypatch.setenv("CC", asked)
    build.compiler.cache_clear()
    assert any(f"CC={asked} cannot build" in text for text in diagnose().verdict)


@pytest.mark.parametrize("asked", ["", "  ", "gcc", "gcc -O1 -fno-fast-math -frounding-math", "gcc -ffp-model=precise"])
def test_a_cc_that_asks_for_nothing_loose_is_no_matter(fresh, monkeypatch, asked):
    monkeypatch.setenv("CC", asked.replace("gcc", build.compiler().command[0]))
    build.compiler.cache_clear()
    assert build.compiler()
    assert "loose" not in build.refused_cc(build.compiler())
    assert "loosens" not in build.refused_cc(build.compiler())


def script(file, text):
    file.write_text(f"#!/bin/sh\n{text}\n")
    file.chmod(0o755)
    return file


DENORMALS = """
static void __attribute__((constructor)) off(void)
{
#if defined __SSE__
  __builtin_ia32_ldmxcsr(__builtin_ia32_stmxcsr() | 0x8040);
#elif defined __aarch64__
  unsigned long x;
  __asm__ volatile("mrs %0, fpcr" : "=r"(x));
  x |= 1ul << 24;
  __asm__ volatile("msr fpcr, %0" : : "r"(x));
#endif
}
"""


@pytest.mark.skipif(os.name == "nt", reason="a shell script")
def test_a_wrapper_that_loosens_behind_our_back_is_found_out(fresh, monkeypatch, tmp_path):
    """What no option says: a macro tells of one, a trial in another process of the other; this process keeps its denormals."""
    real = build.compiler().command[0]
    fast = script(tmp_path / "fast", f'exec {real} -ffast-math "$@"')
    (tmp_path / "off.c").write_text(DENORMALS)
    flushing = script(
        tmp_path / "flushing",
        f'case "$*" in *--version*) exec {real} "$@";; esac; exec {real} "$@" {tmp_path / "off.c"}',
    )
    (tmp_path / "options.rsp").write_text("-DMINE=1 @" + str(tmp_path / "inner.rsp"))
    (tmp_path / "inner.rsp").write_text("'-ffast-math'")
    (tmp_path / "round.rsp").write_text("@" + str(tmp_path / "round.rsp"))
    for asked, why in {
        str(fast): "loose arithmetic",
        str(flushing): "denormal numbers are zero",
        f"{real} @{tmp_path / 'options.rsp'}": "-ffast-math loosens",
        f"{real} @{tmp_path / 'round.rsp'}": "names itself",
    }.items():
        monkeypatch.setenv("CC", asked)
        build.compiler.cache_clear()
        assert build.compiler().command[0] == real
        assert why in build.refused_cc(build.compiler()), asked
        assert 2 * float.fromhex("0x1p-1074") > 0  # denormals are what they were


def test_options_of_a_response_file_are_taken(fresh, monkeypatch, tmp_path):
    (tmp_path / "options.rsp").write_text("-DMINE=1")
    monkeypatch.chdir(tmp_path)  # it is built in another folder
    monkeypatch.setenv("CC", f"{build.compiler().command[0]} @options.rsp")
    build.compiler.cache_clear()
    assert build.compiler().command[1] == "-DMINE=1"


def test_what_was_tried_is_not_tried_again(fresh, monkeypatch):
    assert build.compiler()
    monkeypatch.setattr(build, "tried", lambda file: pytest.fail("tried again"))
    build.compiler.cache_clear()
    assert build.compiler()


def test_a_library_under_another_s_name_is_built_anew(fresh):
    made = build.compiler()
    texts = [f"#define W 1\nint number(void) {{ return {k}; }}\n" for k in (3, 4)]
    names = []
    for text in texts:
        before = set(fresh.glob("*.so"))
        build.library(text, made)
        names += set(fresh.glob("*.so")) - before
    for suffix in (".so", ".sha256"):
        content = names[0].with_suffix(suffix).read_bytes()
        names[1].with_suffix(suffix).unlink()
        names[1].with_suffix(suffix).write_bytes(content)
    assert not build._whole(names[1])


def test_a_checksum_of_foreign_bytes_is_no_obstacle(fresh):
    made = build.compiler()
    for file in fresh.glob("*.sha256"):
        file.write_bytes(b"\xff\xfe")
    build.compiler.cache_clear()
    assert build.compiler() == made


def test_without_a_compiler_what_runs_away_is_the_same(arm, law, q0, fresh, monkeypatch):
    vary = {"controller.gains.K_d": law.gains.K_d * np.array([1.0, 200.0, 1.1])[:, None, None]}
    settings = {"vary": vary, "log": ("q",), "metrics": {"q": ("max", "rms", "last"), "tau": "max"}}
    native = k1607.rollout(arm, law, q0, 0.3, **settings)
    assert np.isfinite(native.failed_at.values).tolist() == [False, True, False]
    monkeypatch.setenv("K1607_COMPILER", "none")
    build.compiler.cache_clear()
    forget()
    with pytest.warns(RuntimeWarning, match="no C compiler"):
        interpreted = k1607.rollout(arm, law, q0, 0.3, **settings)
    for name in native.data_vars:  # rounding grows where it runs away
        np.testing.assert_allclose(interpreted[name], native[name], rtol=1e-5, atol=1e-9)
