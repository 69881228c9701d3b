"""The command line, as a user types it."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from itertools import islice
from pathlib import Path

import numpy as np
import psutil
import pytest
import xarray as xr
from typer.testing import CliRunner

from k1607_pin import Drawn, Scaled, Uniform, cli
from k1607_pin.compiled.build import BuildError
from k1607_pin.compiled.tracer import TracingError
from k1607_pin.compiled.workers import WorkersLostError
from k1607_pin.report.comparison import TROUBLES, compare
from k1607_pin.report.comparison_figures import table
from k1607_pin.report.rows import loaded
from k1607_pin.report.sweeps import parameters_of
from k1607_pin.simulation.simulate import SimulationError

WITHIN = 600.0  # s; of processes that would otherwise be waited for without end
ROOT = Path(__file__).parents[1]
COMMANDS = [command.callback.__name__ for command in cli.app.registered_commands]


def k1607(*arguments: str, **options) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-m", "k1607_pin.cli", *arguments], capture_output=True, text=True, **options
    )


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_an_example_that_is_a_command(command):
    text = CliRunner().invoke(cli.app, [command, "--help"]).output
    assert f"k1607 {command}" in text.split("Options:")[0]


OWN_ERRORS = [
    TracingError("controller.update: cannot be compiled"),
    SimulationError(0.5, np.zeros(2), np.ones(2), xr.Dataset(coords={"time": [0.0]})),
    WorkersLostError("chunk 3 has lost its workers"),
    BuildError("cc: no such file"),
]


@pytest.mark.parametrize("error", OWN_ERRORS, ids=lambda error: type(error).__name__)
def test_an_error_of_the_package_is_a_message(error, monkeypatch, capsys):
    def fails():
        raise error

    monkeypatch.setattr(cli, "app", fails)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    told = capsys.readouterr()
    assert not told.out
    assert " ".join(told.err.split()) == f"k1607: {' '.join(str(error).split())}"


def test_a_fault_of_the_package_keeps_its_traceback(monkeypatch):
    def fails():
        raise TypeError("unsupported operand")

    monkeypatch.setattr(cli, "app", fails)
    with pytest.raises(TypeError, match="unsupported operand"):
        cli.main()


def test_committed_urdf_is_up_to_date():
    result = k1607("urdf", "--check", "--out", str(ROOT / "urdf" / "k1607.urdf"))
    assert result.returncode == 0, result.stderr


def test_urdf_check_fails_on_a_stale_file(tmp_path):
    stale = tmp_path / "k1607.urdf"
    stale.write_text("<robot/>")
    result = k1607("urdf", "--check", "--out", str(stale))
    assert result.returncode == 2
    assert "not what the data give" in result.stderr
    assert stale.read_text() == "<robot/>"


def test_urdf_of_one_s_own_table_from_the_help_text(tmp_path):
    """The example printed by --help, taken from there and run."""
    text = CliRunner().invoke(cli.app, ["urdf", "--help"]).output
    example = text[text.index("[dh]") : text.index("Options:")]
    (tmp_path / "my_arm.toml").write_text("\n".join(line.strip() for line in example.splitlines()))
    result = k1607("urdf", "--dh", "my_arm.toml", "--out", "my_arm.urdf", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    import k1607_pin

    assert k1607_pin.load_urdf(tmp_path / "my_arm.urdf", "tool").n == 2


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("[dh]\nunits = {length='m', angle='deg'}\nrows = [[0,0,0],[0,nan,0]]", "row 2, column 'a'"),
        ("[dh]\nunits = {length='furlong', angle='deg'}\nrows = [[0,0,0]]", "furlong"),
        ("not toml", "not TOML"),
    ],
)
def test_a_bad_table_is_one_line_not_a_traceback(tmp_path, content, words):
    (tmp_path / "bad.toml").write_text(content)
    result = k1607("urdf", "--dh", str(tmp_path / "bad.toml"), "--out", str(tmp_path / "bad.urdf"))
    assert result.returncode == 2
    assert words in " ".join(result.stderr.split())
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "bad.urdf").exists()


def test_equations_as_json():
    result = k1607("equations", "8", "28", "--json")
    entries = json.loads(result.stdout)
    assert [e["number"] for e in entries] == [8, 28]
    assert {e["verdict"] for e in entries} == {"misprint"}


def test_equations_table_counts_the_verdicts():
    result = k1607("equations")
    assert result.returncode == 0
    assert "35 holds, 18 definition, 21 misprint, 9 gap, 0 fails" in result.stdout


def test_unknown_equation():
    result = k1607("equations", "99")
    assert result.returncode == 2
    assert "from 1 to 83" in " ".join(result.stderr.split())


def test_reproduce_as_json(tmp_path):
    result = k1607("reproduce", "--out", str(tmp_path), "--json")
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout) == json.loads((tmp_path / "results.json").read_text())
    page = (tmp_path / "index.html").read_text()
    assert "<code>k1607 compare</code>" in page  # not run in this folder
    assert "comparison.png" not in page


def test_simulate_as_json_with_log_figures_and_animation(tmp_path):
    result = k1607("simulate", "1", "--settings", "recommended", "--payload", "5", "--json",
                   "--out", str(tmp_path / "run"), "--html", str(tmp_path / "run.html"))  # fmt: skip
    assert result.returncode == 0, result.stderr
    told = json.loads(result.stdout)
    assert told["lost_at_s"] is None
    errors = {row["error"]: row for row in told["errors"]}
    assert abs(errors["x"]["max"]) < 0.02
    assert errors["about z"]["unit"] == "deg"
    with xr.open_dataset(tmp_path / "run" / "run.nc") as run:
        assert float(run.payload.max()) == pytest.approx(5 * 0.45359237)
    assert (tmp_path / "run" / "path.png").exists()
    assert "<html" in (tmp_path / "run.html").read_text()[:500]


def test_simulate_runs_at_the_period_that_was_asked_for(tmp_path):
    result = k1607("simulate", "1", "--period", "8", "--out", str(tmp_path))
    assert result.returncode == 0, result.stderr
    with xr.open_dataset(tmp_path / "run.nc") as run:
        assert float(run.time[1]) == pytest.approx(0.008)


def test_a_run_that_is_lost_says_when_keeps_its_log_and_fails(tmp_path):
    result = k1607("simulate", "1", "--period", "50", "--gravity", "9.81", "--out", str(tmp_path))
    assert result.returncode == 2
    assert "has run away after t =" in " ".join(result.stderr.split())
    assert (tmp_path / "run.nc").exists()
    assert "Traceback" not in result.stderr


def test_simulate_refuses_what_there_is_not():
    result = k1607("simulate", "3")
    assert result.returncode == 2
    assert "study case 1 or 2" in result.stderr
    result = k1607("simulate", "1", "--robot", "panda", "--settings", "report")
    assert result.returncode == 2
    assert "recommended" in result.stderr


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_compare_goes_on_where_it_was_stopped(tmp_path):
    command = ("compare", "--case", "1", "--quick", "--json", "--out", str(tmp_path))
    file = tmp_path / "comparison.csv"

    def stopped_after(rows, stop):
        process = subprocess.Popen(
            [sys.executable, "-m", "k1607_pin.cli", *command, "--jobs", "2"],
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        while process.poll() is None and not (file.exists() and len(loaded(file)) >= rows):
            time.sleep(0.01)
        helpers = psutil.Process(process.pid).children(recursive=True)
        stop(process)
        _, told = process.communicate(timeout=600)
        assert not psutil.wait_procs(helpers, timeout=600)[1]  # none is left behind
        return process.returncode, told

    assert stopped_after(2, lambda process: process.kill())[0] == -signal.SIGKILL
    before = file.read_text()
    # Ctrl-C as a terminal sends it, when there are more rows: it is to meet the comparison, and not the imports before it
    code, told = stopped_after(len(loaded(file)) + 2, lambda process: os.killpg(process.pid, signal.SIGINT))
    assert code == 130
    assert "goes on from there" in " ".join(told.split())
    assert "Traceback" not in told
    assert file.read_text().startswith(before)
    wanted = {"cases": [1], "periods": [0.01], "gravities": [9.81], "troubles": TROUBLES[:1]}
    assert loaded(file)[:4] == list(islice(compare(**wanted), 4))  # as one process makes them, and in its order
    head, first, *rest = file.read_text().splitlines(keepends=True)
    marked = first.replace(str(loaded(file)[0].rms), "0.125")
    file.write_text(head + marked + "".join(rest))
    result = k1607(*command, "--jobs", "1")
    assert result.returncode == 0, result.stderr
    rows = loaded(file)
    assert file.read_text().startswith(head + marked + "".join(rest))  # no run was made twice
    assert len(rows) == 2 * (11 + 9)  # two troubles; weightless, two laws are what others are
    assert [row["rms"] for row in json.loads(result.stdout)] == [row.rms for row in rows]
    assert table(rows) in (tmp_path / "comparison.md").read_text()
    assert (tmp_path / "comparison.png").exists()


def test_compare_refuses_a_file_of_something_else(tmp_path):
    (tmp_path / "comparison.csv").write_text("a,b\n1,2\n")
    result = k1607("compare", "--quick", "--out", str(tmp_path))
    assert result.returncode == 2
    assert "to have the columns" in " ".join(result.stderr.split())


def test_sweep_as_json_with_a_store(tmp_path):
    vary = ("--vary", "payloads.0.payload.mass=0:9:3", "--vary", "plant.viscous~uniform:5:15")
    told = json.loads(k1607("sweep", "1", *vary, "-n", "4", "--json", "--store", str(tmp_path / "s")).stdout)
    assert told["rollouts"] == told["counted"] == 12
    with xr.open_zarr(tmp_path / "s") as found:
        assert found.sizes["payloads.0.payload.mass"] == 3
        worst = 1e3 * found.error_max.sel(direction=["x", "y", "z"]).max("direction")
        assert told["errors"]["largest position error, mm"][-1] == pytest.approx(float(worst.max()))
        assert told["lost"] == float(found.failed_at.notnull().mean())


@pytest.mark.parametrize(
    ("vary", "said"),
    [
        ("K_p=500:5000:3", "(6, 6), not a number: type controller.gains.K_p*=0.5:2:3 to scale it, "
                           "controller.gains.K_p[0,0]=500:5000:3 for one entry"),
        ("K_p~uniform:1:2", "type controller.gains.K_p*~uniform:0.5:2 to scale it, controller.gains.K_p[0,0]~uniform:1:2 for"),
        ("K_p[0]=1:2:3", "expected an entry of controller.gains.K_p, an array (6, 6), got controller.gains.K_p[0]"),
        ("K_p[0,6]=1:2:3", "expected an entry of controller.gains.K_p"),
        ("K_p[0,x]=1:2:3", "expected an entry of controller.gains.K_p"),
        ("K_p[]~normal:1:2", "expected an entry of controller.gains.K_p"),
        ("K_p[0,0=1:2:3", "name=lower:upper:count"),
        ("K_p*=1:2:1000000000000000", "name=lower:upper:count"),
    ],
)  # fmt: skip
def test_a_number_for_a_matrix_says_what_of_it(vary, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        parameters_of([f"controller.gains.{vary}"], 4, 0, {"controller.gains.K_p": np.diag(np.arange(1.0, 7))})


@pytest.mark.parametrize("which", [":", ":,:"])
def test_all_entries_of_a_matrix_may_be_one_number(which):
    now = {"K_p": np.diag([1.0, 2.0])}
    found = parameters_of([f"K_p[{which}]=3:5:2"], 4, 0, now).values(0, 2)["K_p"]
    np.testing.assert_array_equal(found, [np.full((2, 2), 3.0), np.full((2, 2), 5.0)])


def test_entries_and_factors_are_what_python_s_are():
    now = {"K": np.diag([1.0, 2.0, 4.0]), "v": np.array([3.0, 5.0]), "x": np.array(2.0)}

    def values(*texts):
        made = parameters_of(texts, 4, 1, now)
        return made.values(0, math.prod(made.dims.values()))

    np.testing.assert_array_equal(values("K*=0.5:2:2")["K"], [0.5 * now["K"], 2 * now["K"]])
    entry = values("K[0,2]=7:9:3")["K"]
    np.testing.assert_array_equal(entry[:, 0, 2], [7, 8, 9])
    entry[:, 0, 2] = 0
    np.testing.assert_array_equal(entry, np.stack(3 * [now["K"]]))
    np.testing.assert_array_equal(values("K[1,:]=7:9:2")["K"][:, 1], [[7] * 3, [9] * 3])
    np.testing.assert_array_equal(values("v[:]=7:9:2")["v"], [[7, 7], [9, 9]])
    np.testing.assert_array_equal(values("x*=1:2:2")["x"], [2, 4])
    np.testing.assert_array_equal(values("x=1:2:2")["x"], [1, 2])
    theirs = Drawn({"K": Scaled(now["K"], Uniform(0.5, 2.0))}, 4, 1).values(0, 4)["K"]
    np.testing.assert_array_equal(values("K*~uniform:0.5:2")["K"], theirs)
    one = values("K[0,2]~uniform:7:9")["K"]
    assert len(set(one[:, 0, 2])) == 4
    assert one[:, 0, 2].min() > 7
    np.testing.assert_array_equal(one[:, 1:], np.stack(4 * [now["K"][1:]]))
    each = Drawn({"v": Uniform(np.full(2, 5.0), np.full(2, 15.0))}, 4, 1).values(0, 4)["v"]
    np.testing.assert_array_equal(values("v~uniform:5:15")["v"], each)  # a vector's entries are drawn one by one
    np.testing.assert_array_equal(values("v[:]~uniform:5:15")["v"], each)
    with pytest.raises(ValueError, match="v is zero, which no factor changes"):
        parameters_of(["v*=1:2:2"], 4, 0, {"v": np.zeros(2)})


def test_sweep_says_what_it_does_not_heed(tmp_path):
    result = k1607("sweep", "1", "--vary", "controller.gains.K_p*=0.9:1.1:2", "-n", "7", "--seed", "3", "--json")
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout)["rollouts"] == 2
    assert "-n 7 changes nothing: nothing is drawn, and the grid has 2 rollouts" in result.stderr
    assert "--seed 3 changes nothing" in result.stderr


def test_sweep_refuses_what_it_cannot_read():
    assert "name=lower:upper:count" in " ".join(k1607("sweep", "--vary", "plant.viscous=1:2").stderr.split())
    assert "at least one parameter" in " ".join(k1607("sweep").stderr.split())
    twice = ("--vary", "plant.viscous=5:15:2", "--vary", "plant.viscous=1:2:2")
    assert "each name once, got plant.viscous twice" in " ".join(k1607("sweep", *twice).stderr.split())


def test_learning_as_json_with_curve_and_figure(tmp_path):
    told = k1607("learning", "1", "--law", "joint adaptive + g", "--period", "10", "--json", "--out", str(tmp_path))
    assert told.returncode == 0, told.stderr
    told = json.loads(told.stdout)
    first, last = told["rates"][0], told["rates"][-1]
    assert first["rate"] == 0
    assert first["holds"]
    assert last["lost"]
    assert last["rms"] is None
    assert 0 < told["own"] < told["holds_to"] < told["lost_from"]
    with xr.open_dataset(tmp_path / "learning.nc") as curve:
        assert float(curve.rms[0]) == first["rms"]
    assert (tmp_path / "learning.png").exists()


def test_learning_refuses_a_law_that_there_is_not():
    assert "expected recommended or one of" in " ".join(k1607("learning", "--law", "mine").stderr.split())


def test_drift_as_json_with_log_and_figure(tmp_path):
    result = k1607("drift", "--minutes", "0.05", "--json", "--out", str(tmp_path))
    assert result.returncode == 0, result.stderr
    rows = {row["option"]: row for row in json.loads(result.stdout)}
    assert rows["as the report has it"]["K_p"] > 1.1
    assert rows["gravity"]["lost_after_s"] is None
    with xr.open_dataset(tmp_path / "gain-drift.nc") as log:
        assert float(log.K_d.sel(option="gravity")[-1]) == pytest.approx(rows["gravity"]["K_d"])
    assert (tmp_path / "gain-drift.png").exists()


def test_view_writes_a_page(tmp_path):
    result = k1607("view", "--html", "arm.html", "--pose", "20,-30,10,80,0,60,0", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "arm.html").stat().st_size > 100_000


def test_view_refuses_a_bad_pose():
    assert "--pose: expected numbers" in " ".join(k1607("view", "--pose", "1,x").stderr.split())
    assert "(7,)" in k1607("view", "--pose", "1,2").stderr


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_view_serves_until_interrupted():
    process = subprocess.Popen([sys.executable, "-u", "-m", "k1607_pin.cli", "view"], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    line = process.stdout.readline()
    assert "http://127.0.0.1:" in line
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=600) == 0


SWEEP = """
import signal
from k1607_pin.cli import main
from k1607_pin.compiled import sweep

class Store(sweep.InStore):
    def write(self, k, found):
        super().write(k, found)
        print("written", flush=True)
        signal.pause()  # the workers are in the middle of further chunks

sweep.InStore = Store
main()
"""


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_ctrl_c_of_a_sweep_says_how_to_go_on(tmp_path):
    """After the first of some hundred chunks."""
    vary = ("--vary", "controller.beta_1=0:1e3:1000000", "--store", str(tmp_path / "s"))
    command = [sys.executable, "-c", SWEEP, "sweep", "1", *vary]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "written\n", process.communicate(timeout=WITHIN)[1]
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=WITHIN)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "the same command goes on from there" in " ".join(said.split())
    assert "Traceback" not in said
    done = len(list((tmp_path / "s" / "sweep" / "done").glob("*.0")))
    assert done == 1
