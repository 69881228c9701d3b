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


@pytest.mark.parametrize("asked", ["nowhere-cc", "false"])
def test_a_cc_that_does_not_build_is_told(fresh, monkeypatch, caplog, asked):
    monkeypatch.setenv("CC", asked)
    build.compiler.cache_clear()
    assert build.compiler() is not None
    assert f"CC={asked} cannot build" in caplog.text
    assert any(f"CC={asked} cannot build" in text for text in diagnose().verdict)


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
