"""Sweeps: the same bytes whoever computes them, in whatever chunks, with whatever interruptions."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import tracemalloc
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import cloudpickle
import numpy as np
import pytest
import scipy.stats
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import k1607_pin as k1607
from k1607_pin.compiled import sweep as sweep_module
from k1607_pin.compiled.chunks import Cut
from k1607_pin.compiled.rollout import Rollouts, rollouts
from k1607_pin.compiled.workers import Workers, WorkersLostError
from k1607_pin.report.cases import study_case

START = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
cloudpickle.register_pickle_by_value(sys.modules[__name__])  # as what is written in a notebook is sent
SPAWN = multiprocessing.get_context("spawn")
WITHIN = 120.0  # s; of what would otherwise be waited for without end
DRAWN = k1607.Drawn(
    {"payloads.0.payload.mass": k1607.Uniform(0.0, 9.0), "q0": k1607.Normal(START, np.full(7, 0.02))}, count=150, seed=3
)


class Hold:
    """Damping and a spring, nothing else."""

    def start(self, q, v, duration):
        return ()

    def initial(self, q, v):
        return ()

    def update(self, t, q, v, state):
        return 50 * (START - q) - 20 * v, state, {"error": START - q}


def loop() -> Rollouts:
    """A tenth of a second with a payload."""
    return rollouts(
        k1607.load_k1607(gravity=(0, 0, 0)), Hold(), 0.1, payloads=[(0.03, k1607.Payload(1.0))],
        varied=("payloads.0.payload.mass",), metrics={"error": ("max", "rms"), "tau": ("max",)},
    )  # fmt: skip


@pytest.fixture(scope="module")
def run():
    return loop()


@pytest.fixture(scope="module")
def expected(run):
    """By one call of `rollout`'s own."""
    values = DRAWN.values(0, 150)
    return run(values["q0"], None, {name: x for name, x in values.items() if name != "q0"})


def same(found, expected):
    """To the last bit, and nothing left out."""
    for name in expected.data_vars:
        np.testing.assert_array_equal(found[name].values, expected[name].values, err_msg=name)


@pytest.mark.parametrize("chunk", [None, 7, 50, 1000])
def test_chunks_do_not_matter(run, expected, chunk):
    found = k1607.sweep(run, DRAWN, chunk=chunk)
    same(found, expected)
    np.testing.assert_array_equal(found["q0"], DRAWN.values(0, 150)["q0"])


def test_processes_give_the_same_bytes(run, expected):
    same(k1607.sweep(run, DRAWN, chunk=40, executor=partial(ProcessPoolExecutor, 2, SPAWN)), expected)


def test_dask_gives_the_same_bytes(run, expected):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        same(k1607.sweep(run, DRAWN, chunk=40, executor=client.get_executor()), expected)


class Dies(Hold):
    """In a worker process, kills it once; the file tells that it has."""

    def __init__(self, file, pid):
        self.file, self.pid = file, pid

    def __setstate__(self, state):
        self.__dict__.update(state)
        if os.getpid() != self.pid and not Path(self.file).exists():
            Path(self.file).touch()
            os.kill(os.getpid(), signal.SIGKILL)


def mortal(file, pid):
    return rollouts(
        k1607.load_k1607(gravity=(0, 0, 0)), Dies(file, pid), 0.1, payloads=[(0.03, k1607.Payload(1.0))],
        varied=("payloads.0.payload.mass",), metrics={"error": ("max", "rms"), "tau": ("max",)},
    )  # fmt: skip


def test_a_killed_worker_costs_time_and_no_results(expected, tmp_path):
    file = tmp_path / "died"
    pool = partial(ProcessPoolExecutor, 2, SPAWN)
    same(k1607.sweep(mortal(str(file), os.getpid()), DRAWN, chunk=40, executor=pool), expected)
    assert file.exists()


def test_an_executor_that_nobody_can_make_anew_is_told_of(tmp_path):
    with ProcessPoolExecutor(1, SPAWN) as pool, pytest.raises(WorkersLostError, match="a function that makes it"):
        k1607.sweep(mortal(str(tmp_path / "died"), os.getpid()), DRAWN, chunk=40, executor=pool)


def test_a_task_that_kills_again_and_again_is_given_up():
    with Workers(partial(ProcessPoolExecutor, 1, SPAWN)) as workers, pytest.raises(WorkersLostError, match="3 times"):
        list(workers.results(os._exit, [(0, (1,))], None))


# Stores


def of(store):
    """Name -> bytes of each file, the marks apart."""
    return {str(f.relative_to(store)): f.read_bytes() for f in Path(store).rglob("*") if f.is_file()}


def test_a_store_is_the_same_with_and_without_interruption(run, expected, tmp_path):
    pytest.importorskip("zarr")
    whole = k1607.sweep(run, DRAWN, chunk=20, store=tmp_path / "whole")
    same(whole, expected)
    xr.testing.assert_identical(whole, k1607.sweep(run, DRAWN, chunk=20))  # q0 with a dimension of its own included

    class Stop(Exception):
        pass

    def stop(done, total, rate, left):
        if done >= 60:
            raise Stop

    with pytest.raises(Stop):
        k1607.sweep(run, DRAWN, chunk=20, store=tmp_path / "twice", progress=stop)
    told = []
    again = k1607.sweep(run, DRAWN, chunk=20, store=tmp_path / "twice", progress=lambda *x: told.append(x))
    assert told[0][0] >= 60  # what was there
    assert [x[0] for x in told] == sorted(x[0] for x in told)
    assert told[-1][:2] == (150, 150)
    for before, (done, total, rate, left) in pairwise(told):
        assert done > before[0]
        assert left == pytest.approx((total - done) / rate)
    assert told[0][2:] == (0.0, np.inf)  # what an earlier call has done says nothing of how fast this one is
    same(again, expected)
    assert of(tmp_path / "twice") == of(tmp_path / "whole")
    same(xr.open_zarr(tmp_path / "twice", consolidated=True), expected)


def test_ctrl_c_keeps_what_is_done(run, expected, tmp_path):
    pytest.importorskip("zarr")

    def interrupt(done, total, rate, left):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        k1607.sweep(run, DRAWN, chunk=20, store=tmp_path / "s", progress=interrupt)
    told = []
    same(k1607.sweep(run, DRAWN, chunk=20, store=tmp_path / "s", progress=lambda *x: told.append(x)), expected)
    assert told[0][0] == 20


class Interrupting:
    """Ctrl-C while a worker is at the first piece of a chunk; the piece ends when the workers have been told to stop."""

    def __init__(self, engine, told):
        self.engine, self.lanes, self.piece, self.told, self.pieces = engine, engine.lanes, 1, told, 0

    def __call__(self, *arguments):
        self.pieces += 1
        if self.pieces == 1:
            os.kill(os.getpid(), signal.SIGINT)
        assert self.told.wait(WITHIN)
        self.engine(*arguments)


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
@pytest.mark.parametrize("lent", [False, True])
def test_ctrl_c_waits_for_a_piece_and_not_for_a_chunk(run, tmp_path, monkeypatch, lent):
    told, end, compute = threading.Event(), Workers.end_tasks, sweep_module._computed
    engine = Interrupting(run.engine, told)
    monkeypatch.setattr(run, "engine", run.engine)  # as it was, afterwards

    def end_tasks(workers):
        end(workers)
        told.set()

    def computed(*task):
        run.engine = engine
        return compute(*task)

    monkeypatch.setattr(Workers, "end_tasks", end_tasks)
    monkeypatch.setattr(sweep_module, "_computed", computed)
    drawn = k1607.Drawn(DRAWN.distributions, 4000)
    with ThreadPoolExecutor(2) as pool:
        executor = pool if lent else partial(ThreadPoolExecutor, 2)
        with pytest.raises(KeyboardInterrupt) as raised:
            k1607.sweep(run, drawn, chunk=2000, store=tmp_path / "s", executor=executor)
    assert 1 <= engine.pieces <= 2  # of some hundred a chunk
    assert "0 of 4,000 rollouts are done" in raised.value.__notes__[0]
    assert "goes on from there" in raised.value.__notes__[0]


LONG = """
import multiprocessing, sys
from concurrent.futures import ProcessPoolExecutor
import numpy as np
import k1607_pin as k1607
from k1607_pin.report.cases import study_case

class Pool(ProcessPoolExecutor):
    def submit(self, *arguments):
        made = super().submit(*arguments)
        print("under way", flush=True)
        return made

def main():
    study = study_case(1)
    name = "payloads.0.payload.mass"
    loop = k1607.rollouts(study.plant, study.law, 200.0, study.law.period, varied=("controller.beta_1",))
    drawn = k1607.Drawn({"controller.beta_1": k1607.Uniform(0.0, 1.0)}, 10**6)
    pool = lambda: Pool(2, multiprocessing.get_context("spawn"))
    k1607.sweep(loop, drawn, study.q0, chunk=50_000, store=sys.argv[1], executor=pool)

if __name__ == "__main__":
    main()
"""


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_ctrl_c_does_not_wait_for_chunks_of_processes(tmp_path):
    """Each of which would take many minutes; sent to the sweep alone, so that no worker hears of it but by the sweep."""
    script = tmp_path / "long.py"
    script.write_text(LONG)
    process = subprocess.Popen(
        [sys.executable, str(script), str(tmp_path / "s")], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout.readline() == "under way\n", process.communicate(timeout=WITHIN)[1]
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=WITHIN)
    finally:
        process.kill()
    assert process.returncode != 0
    assert "0 of 1,000,000 rollouts are done. They are in" in said


KILLED = """
import os, signal, sys
import k1607_pin as k1607
from k1607_pin.report.cases import study_case

study = study_case(1)
drawn = k1607.Drawn({"payloads.0.payload.mass": k1607.Uniform(0.0, 9.0)}, 40)
die = lambda done, *_: done >= 16 and os.kill(os.getpid(), signal.SIGKILL)
k1607.sweep(study.rollouts(list(drawn.along)), drawn, study.q0, chunk=8, store=sys.argv[1], progress=die)
"""


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_a_sweep_that_is_killed_goes_on_in_another_process(tmp_path):
    pytest.importorskip("zarr")
    done = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "s")], capture_output=True, text=True)
    assert done.returncode == -signal.SIGKILL, done.stderr
    drawn = k1607.Drawn({"payloads.0.payload.mass": k1607.Uniform(0.0, 9.0)}, 40)
    study, told = study_case(1), []
    loop = study.rollouts(list(drawn.along))
    again = k1607.sweep(loop, drawn, study.q0, chunk=8, store=tmp_path / "s", progress=lambda *x: told.append(x[0]))
    assert told == [16, 24, 32, 40]
    k1607.sweep(loop, drawn, study.q0, chunk=8, store=tmp_path / "whole")
    assert of(tmp_path / "s") == of(tmp_path / "whole")
    xr.testing.assert_identical(again, k1607.sweep(loop, drawn, study.q0))


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_a_sweep_that_is_killed_while_it_makes_its_store_is_begun_again(run, expected, tmp_path):
    pytest.importorskip("zarr")
    killed = KILLED.replace(
        "die =",
        "from k1607_pin import files; files.os.replace = lambda old, new: os.kill(os.getpid(), 9)\ndie =",
    )
    assert killed != KILLED
    done = subprocess.run([sys.executable, "-c", killed, str(tmp_path / "s")], capture_output=True, text=True)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert not (tmp_path / "s").exists()
    same(k1607.sweep(run, DRAWN, chunk=20, store=tmp_path / "s"), expected)


def test_distributions_of_one_median_are_other_sweeps():
    told = {str(k1607.Drawn({"x": x}, 8).identity()) for x in (k1607.Uniform(0, 1), k1607.Normal(0.5, 0.3))}
    assert len(told) == 2


def test_no_two_ranges_of_whole_numbers_are_the_same_sweep():
    told = {str(k1607.Drawn({"x": k1607.Integers(0, n)}, 8).identity()) for n in range(1, 2000)}
    assert len(told) == 1999


def test_an_empty_folder_will_do_for_a_store(run, expected, tmp_path):
    pytest.importorskip("zarr")
    (tmp_path / "s").mkdir()
    same(k1607.sweep(run, DRAWN, chunk=50, store=tmp_path / "s"), expected)
    assert [f.name for f in tmp_path.iterdir()] == ["s"]
    (tmp_path / "scratch").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "scratch")
    same(k1607.sweep(run, DRAWN, chunk=50, store=tmp_path / "link"), expected)


def test_memory_is_bounded_with_a_store(run, tmp_path):
    pytest.importorskip("zarr")
    drawn = k1607.Drawn(DRAWN.distributions, 60_000)
    tracemalloc.start()
    try:
        found = k1607.sweep(run, drawn, chunk=1000, store=tmp_path / "s", ahead=4)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert found.nbytes > 20e6
    assert peak < found.nbytes / 3


def test_another_sweep_s_store_is_refused(run, tmp_path):
    pytest.importorskip("zarr")
    k1607.sweep(run, DRAWN, chunk=50, store=tmp_path / "s")
    other = k1607.Drawn(DRAWN.distributions, count=150, seed=4)
    with pytest.raises(ValueError, match="seed: 3, now 4"):
        k1607.sweep(run, other, chunk=50, store=tmp_path / "s")
    with pytest.raises(ValueError, match="chunk"):
        k1607.sweep(run, DRAWN, chunk=51, store=tmp_path / "s")
    (tmp_path / "else").mkdir()
    (tmp_path / "else" / "mine.txt").write_text("precious")
    with pytest.raises(ValueError, match="store: expected a new folder"):
        k1607.sweep(run, DRAWN, store=tmp_path / "else")
    assert (tmp_path / "else" / "mine.txt").read_text() == "precious"
    with pytest.raises(ValueError, match="store: expected a folder, got a file"):
        k1607.sweep(run, DRAWN, store=tmp_path / "else" / "mine.txt")


def test_results_too_large_for_memory_ask_for_a_store(run):
    with pytest.raises(ValueError, match=r"store: expected a folder for results of .* GiB"):
        k1607.sweep(run, k1607.Drawn(DRAWN.distributions, count=10**9))


# Samples


def test_a_grid_has_a_dimension_a_parameter(run):
    grid = k1607.Grid({"payloads.0.payload.mass": [0.0, 3.0, 6.0], "v0": np.repeat([[0.0], [0.1]], 7, axis=1)})
    found = k1607.sweep(run, grid, START, chunk=2)
    assert found.error_max.shape == (3, 2, 7)
    assert found.error_max.dims[:2] == ("payloads.0.payload.mass", "v0.number")
    alone = run(START, np.full(7, 0.1), {"payloads.0.payload.mass": [6.0]})
    np.testing.assert_array_equal(found.tau_max[2, 1], alone.tau_max[0])


def test_a_list_and_draws_at_each_point_of_a_grid(run):
    listed = k1607.Listed({"payloads.0.payload.mass": [1.0, 2.0, 5.0]})
    found = k1607.sweep(run, listed, START, chunk=2)
    np.testing.assert_array_equal(found.tau_max, run(START, None, {"payloads.0.payload.mass": [1.0, 2.0, 5.0]}).tau_max)
    both = k1607.Grid({"payloads.0.payload.mass": [1.0, 2.0]}, k1607.Drawn({"q0": k1607.Normal(START, np.ones(7))}, 4))
    crossed = k1607.sweep(run, both)
    assert crossed.tau_max.dims[:2] == ("payloads.0.payload.mass", "rollout")
    q0 = both.each.values(0, 4)["q0"]
    np.testing.assert_array_equal(crossed.tau_max[1], run(q0, None, {"payloads.0.payload.mass": [2.0]}).tau_max)


@pytest.mark.parametrize("points", ["sobol", "random"])
@given(start=st.integers(0, 300), size=st.integers(1, 50))
@settings(max_examples=25, deadline=None)
def test_what_is_drawn_depends_on_its_number_alone(points, start, size):
    of_all = k1607.Drawn(DRAWN.distributions, 400, 5, points).values(0, 400)
    part = k1607.Drawn(DRAWN.distributions, 10**6, 5, points).values(start, start + size)
    for name, x in part.items():
        np.testing.assert_array_equal(x, of_all[name][start : start + size])


@pytest.mark.parametrize("points", ["sobol", "random"])
@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        (k1607.Uniform(-1.0, 3.0), scipy.stats.uniform(-1, 4)),
        (k1607.LogUniform(1e-2, 1e3), scipy.stats.loguniform(1e-2, 1e3)),
        (k1607.Normal(2.0, 0.5), scipy.stats.norm(2, 0.5)),
    ],
)
def test_distributions_are_what_they_are_called(points, ours, theirs):
    x = k1607.Drawn({"x": ours}, 4096, 1, points).values(0, 4096)["x"]
    assert scipy.stats.kstest(x, theirs.cdf).pvalue > 1e-3
    np.testing.assert_allclose(k1607.Drawn({"x": theirs}, 4096, 1, points).values(0, 4096)["x"], x, rtol=1e-9)


def test_a_scaled_array_keeps_its_shape():
    A = np.array([[2.0, 1.0], [1.0, 3.0]])
    x = k1607.Drawn({"x": k1607.Scaled(A, k1607.LogUniform(0.5, 2.0)), "y": k1607.Uniform(0.0, 1.0)}, 512).values(
        0, 512
    )
    factor = x["x"][:, 0, 0] / 2
    np.testing.assert_allclose(x["x"], factor[:, None, None] * A, rtol=1e-15)
    assert scipy.stats.kstest(factor, scipy.stats.loguniform(0.5, 2).cdf).pvalue > 1e-3
    assert x["y"].shape == (512,)


def test_some_entries_of_an_array_are_drawn_each_for_itself():
    A = np.array([[2.0, 1.0], [1.0, 3.0]])
    drawn = k1607.Drawn({"x": k1607.Entries(A, (0, slice(None)), k1607.Uniform(5.0, 6.0))}, 64)
    x = drawn.values(0, 64)["x"]
    np.testing.assert_array_equal(x[:, 1], np.tile(A[1], (64, 1)))
    assert len(np.unique(x[:, 0])) == 128
    assert ((x[:, 0] > 5) & (x[:, 0] < 6)).all()
    other = k1607.Drawn({"x": k1607.Entries(A, (1, slice(None)), k1607.Uniform(5.0, 6.0))}, 64)
    assert drawn.identity() != other.identity()
    with pytest.raises(ValueError, match=r"index: expected an entry of an array \(2, 2\), got \(0, 2\)"):
        k1607.Entries(A, (0, 2), k1607.Uniform(5.0, 6.0))


def test_integers_are_all_alike_often():
    x = k1607.Drawn({"x": k1607.Integers(3, 7)}, 4096).values(0, 4096)["x"]
    assert set(np.unique(x, return_counts=True)[1]) == {1024}


@given(st.lists(st.integers(1, 7), min_size=1, max_size=3), st.integers(1, 60))
def test_chunks_cover_everything_once(sizes, rollouts_a_chunk):
    cut = Cut.of({f"d{k}": size for k, size in enumerate(sizes)}, rollouts_a_chunk)
    seen = np.zeros(sizes, int)
    for k in range(cut.count):
        region = tuple(cut.region(k).values())
        seen[region] += 1
        first, last = cut.stretch(k)
        np.testing.assert_array_equal(np.arange(seen.size).reshape(sizes)[region].ravel(), np.arange(first, last))
        assert last - first <= rollouts_a_chunk
    assert (seen == 1).all()


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: k1607.Uniform(1.0, 0.0), "lower < upper"),
        (lambda: k1607.LogUniform(0.0, 1.0), "lower: expected positive"),
        (lambda: k1607.Normal(0.0, 0.0), "sigma: expected"),
        (lambda: k1607.Listed({"a": [1, 2], "b": [1]}), "as many values"),
        (lambda: k1607.Listed({"a": [1, np.nan]}), "a: expected"),
        (lambda: k1607.Grid({}), "axes: expected at least one"),
        (lambda: k1607.Drawn({"a": 3.0}, 5), "a: expected a distribution"),
        (lambda: k1607.Drawn({"a": k1607.Uniform(0, 1)}, 0), "count"),
    ],
)
def test_samples_refuse(make, said):
    with pytest.raises(ValueError, match=said):
        make()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"parameters": k1607.Listed({"q0": START[None]})}, "parameters: expected payloads.0.payload.mass"),
        ({"q0": START}, "q0: expected none beside"),
        ({"chunk": 0}, "chunk: expected"),
        ({"q0": None, "ahead": 0}, "ahead: expected"),
        ({"q0": None, "executor": 3}, "executor: expected"),
        ({"parameters": k1607.Listed({"payloads.0.payload.mass": [1.0]})}, "q0: expected where"),
    ],
)
def test_sweep_refuses(run, more, said):
    with pytest.raises(ValueError, match=said):
        k1607.sweep(**{"run": run, "parameters": DRAWN, **more})


def test_memory_is_bounded_by_what_is_ahead(run):
    """No more chunks are under way than were asked for."""
    under_way, most = [0], [0]

    class Counting(ThreadPoolExecutor):
        def submit(self, *arguments):
            under_way[0] += 1
            most[0] = max(most[0], under_way[0])
            future = super().submit(*arguments)
            future.add_done_callback(lambda _: under_way.__setitem__(0, under_way[0] - 1))
            return future

    with Counting(2) as pool:
        k1607.sweep(run, DRAWN, chunk=5, executor=pool, ahead=3)
    assert most[0] <= 3


def test_results_called_as_parameters_are_refused():
    arm = k1607.load_k1607(gravity=(0, 0, 0))
    made = k1607.rollouts(arm, Hold(), 0.05, metrics={}, signals={"q0": lambda log: log["t"]}, log=("q0",))
    with pytest.raises(ValueError, match="q0 as both"):
        k1607.sweep(made, k1607.Listed({"q0": START[None]}))


def test_a_store_is_of_one_closed_loop_and_one_way_of_drawing(run, tmp_path):
    pytest.importorskip("zarr")
    k1607.sweep(run, DRAWN, chunk=50, store=tmp_path / "s")
    longer = rollouts(
        k1607.load_k1607(gravity=(0, 0, 0)), Hold(), 0.11, payloads=[(0.03, k1607.Payload(1.0))],
        varied=("payloads.0.payload.mass",), metrics={"error": ("max", "rms"), "tau": ("max",)},
    )  # fmt: skip
    with pytest.raises(ValueError, match="closed loop: "):
        k1607.sweep(longer, DRAWN, chunk=50, store=tmp_path / "s")
    with pytest.raises(ValueError, match="points: sobol, now random"):
        k1607.sweep(run, k1607.Drawn(DRAWN.distributions, 150, 3, "random"), chunk=50, store=tmp_path / "s")


def test_the_fingerprint_tells_paths_and_payloads_apart():
    """Which are tables, and not in the programs."""
    study = study_case(1)
    other = replace(study, law=replace(study.law, path=replace(study.law.path, rate=3.4)))
    later = replace(study, duration=study.duration + 3 * study.law.period)
    assert len({one.rollouts(()).fingerprint() for one in (study, other, later)}) == 3


class KilledWorker(Exception):
    """As dask's, which is known by its name."""


def test_workers_that_dask_gives_up_are_asked_again():
    calls = []

    def dies_twice(k):
        calls.append(k)
        if calls.count(k) < 3:
            raise KilledWorker
        return k

    with Workers(partial(ThreadPoolExecutor, 2)) as workers:
        assert sorted(workers.results(dies_twice, [(0, (0,)), (1, (1,))], None)) == [(0, 0), (1, 1)]


def test_default_chunks_are_bounded():
    for count in (1, 100, 10**5, 10**8):
        for steps in (1, 4000, 10**8):
            chunk = sweep_module._chunk(count, 80, steps)
            assert 1 <= chunk <= sweep_module.MOST
            assert chunk * 80 <= sweep_module.CHUNK_BYTES
            assert chunk <= sweep_module.LEAST or chunk * steps <= sweep_module.CHUNK_STEPS
    assert sweep_module._chunk(10**8, sweep_module.CHUNK_BYTES, 1) == 1


@pytest.mark.parametrize(("points", "bits"), [("sobol", 33), ("random", 53)])
def test_shares_are_in_the_middle_of_their_cells(points, bits):
    """And never 0 or 1, of which a normal distribution would make infinity."""
    drawn = k1607.Drawn({"a": k1607.Uniform(0.0, 1.0)}, 4096, 1, points).values(0, 4096)["a"]
    assert (drawn * 2.0**bits % 2 == 1).all()
