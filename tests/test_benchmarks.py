"""Every benchmark runs to its end, its checks that both sides compute the same included; what it measures is not looked at."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = sorted((Path(__file__).parents[1] / "benchmarks").glob("bench_*.py"))


def test_there_are_benchmarks():
    assert BENCHMARKS


@pytest.mark.parametrize("benchmark", BENCHMARKS, ids=lambda path: path.stem)
def test_benchmark_runs(benchmark, tmp_path):
    options = ["--plot", str(tmp_path)] if "--plot" in benchmark.read_text() else []
    result = subprocess.run(
        [sys.executable, str(benchmark), *options],
        capture_output=True,
        text=True,
        env={**os.environ, "BENCH_QUICK": "1"},
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip()
    assert not options or (tmp_path / "growth.png").stat().st_size
