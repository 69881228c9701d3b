"""The doctor finds what there is, and says why it is slow."""

import json
import subprocess
import sys

import pytest

from k1607_pin.compiled import build
from k1607_pin.compiled.doctor import AGREE, diagnose
from k1607_pin.compiled.rollout import forget


@pytest.fixture
def fresh():
    build.compiler.cache_clear()
    forget()
    yield
    build.compiler.cache_clear()
    forget()


def test_it_tells_what_there_is(fresh):
    found = diagnose()
    assert found.apart < AGREE
    assert found.step > 0
    assert found.processors >= 1
    assert not any("WRONG" in text for text in found.verdict)
    made = build.compiler()
    assert (found.compiler == "none") == (made is None)
    assert found.lanes == (made.lanes if made else 1)


def test_no_compiler_is_told_with_a_way_out(fresh, monkeypatch):
    monkeypatch.setenv("K1607_COMPILER", "none")
    with pytest.warns(RuntimeWarning, match="no C compiler"):
        found = diagnose()
    assert found.compiler == "none"
    assert found.environment == {"K1607_COMPILER": "none"} | found.environment
    assert any("K1607_COMPILER=none hides it" in text for text in found.verdict)
    assert found.apart < AGREE


@pytest.mark.skipif(build.compiler() is None, reason="no C compiler")
def test_few_lanes_and_a_cache_that_cannot_be_written_are_told(fresh, monkeypatch):
    monkeypatch.setenv("K1607_INSTRUCTIONS", "plain")
    monkeypatch.setenv("K1607_CACHE", "/proc/nowhere")
    found = diagnose()
    assert found.lanes == 2
    assert any("two lanes" in text for text in found.verdict)
    assert found.cache == "/proc/nowhere"


def test_command():
    result = subprocess.run([sys.executable, "-m", "k1607_pin.cli", "doctor", "--json"], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    found = json.loads(result.stdout)
    assert set(found) >= {"versions", "compiler", "lanes", "cache", "step", "verdict"}
    shown = subprocess.run([sys.executable, "-m", "k1607_pin.cli", "doctor"], capture_output=True, text=True)
    assert "compiler" in shown.stdout


@pytest.mark.skipif(build.compiler() is None, reason="no C compiler")
def test_what_is_slow_is_told(fresh, monkeypatch):
    monkeypatch.setattr("k1607_pin.compiled.doctor.ENOUGH", 1e-12)
    assert any("slower than" in text for text in diagnose().verdict)
