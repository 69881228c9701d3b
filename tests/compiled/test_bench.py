"""What `k1607 bench` measures is what it says, for any arm; how fast it is, is not looked at."""

import json
import subprocess
import sys

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.compiled import build
from k1607_pin.compiled.bench import bench, in_turn

pytestmark = pytest.mark.skipif(build.compiler() is None, reason="no C compiler")


@pytest.mark.parametrize("name", ["k1607", "ur5"])
def test_it_measures_any_arm(name):
    arm = k1607.load_k1607() if name == "k1607" else k1607.load_example(name)
    told = []
    found = bench(arm, count=32, rounds=2, done=told.append)
    assert told == [line.work for line in found]
    assert all(line.seconds > 0 for line in found)
    counted = {line.work.partition(",")[0]: line.operations for line in found if line.operations}
    assert counted["forward dynamics"] == sum(k1607.batch(arm, "forward_dynamics").program.operations.values())
    assert counted["closed loop"] > counted["forward dynamics"]


def test_rounds_are_in_turn():
    calls = []
    times = in_turn(3, lambda: calls.append("a"), lambda: calls.append("b"))
    assert calls == ["a", "b"] * 4  # the first is not counted
    assert times.shape == (2, 3)
    assert (np.asarray(times) >= 0).all()


def test_the_command_prints_json():
    command = [sys.executable, "-m", "k1607_pin.cli", "bench", "--robot", "ur5", "--json"]
    found = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert {"work", "seconds", "operations", "beside", "ratio"} == set(found[0])


def test_without_a_compiler_it_says_so(monkeypatch, arm):
    monkeypatch.setenv("K1607_COMPILER", "none")
    build.compiler.cache_clear()
    try:
        with pytest.raises(RuntimeError, match="no C compiler"):
            bench(arm)
    finally:
        build.compiler.cache_clear()
