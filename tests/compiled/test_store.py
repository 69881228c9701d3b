"""Stores: shared by processes, damaged, of others, of earlier versions; what comes back is what was computed, or nothing does."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import k1607_pin as k1607
from k1607_pin.compiled import store as store_module
from k1607_pin.compiled import store_files
from k1607_pin.compiled.rollout import rollouts
from k1607_pin.files import checksum

pytest.importorskip("zarr")
WITHIN = 120.0  # s; of processes that would otherwise be waited for without end
START = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
GRID = k1607.Grid({"payloads.0.payload.mass": [0.0, 3.0, 6.0]}, k1607.Drawn({"q0": k1607.Normal(START, np.ones(7))}, 7))
CHUNK = 2  # so that there are smaller ones at the end, and chunks that share a file of a parameter
MASS, Q0 = "payloads.0.payload.mass", "q0"


class Hold:
    """Damping and a spring, nothing else."""

    def start(self, q, v, duration):
        return ()

    def initial(self, q, v):
        return ()

    def update(self, t, q, v, state):
        return 50 * (START - q) - 20 * v, state, {"error": START - q}


@pytest.fixture(scope="module")
def run():
    return rollouts(
        k1607.load_k1607(gravity=(0, 0, 0)), Hold(), 0.03, payloads=[(0.0, k1607.Payload(1.0))], varied=(MASS,),
        metrics={"error": ("max",)},
    )  # fmt: skip


@pytest.fixture(scope="module")
def expected(run):
    return k1607.sweep(run, GRID, chunk=CHUNK)


def contents(store):
    return {f.relative_to(store).as_posix(): f.read_bytes() for f in Path(store).rglob("*") if f.is_file()}


@pytest.fixture(scope="module")
def whole(run, tmp_path_factory):
    """The files of a store that nothing has happened to."""
    folder = tmp_path_factory.mktemp("whole") / "s"
    k1607.sweep(run, GRID, chunk=CHUNK, store=folder)
    return contents(folder)


@pytest.fixture
def store(whole, tmp_path):
    """A copy of it."""
    for name, x in whole.items():
        file = tmp_path / "s" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(x)
    return tmp_path / "s"


def mended(run, store, expected, whole):
    """The same command makes what is damaged again: to the last byte, results and store."""
    found = k1607.sweep(run, GRID, chunk=CHUNK, store=store)
    xr.testing.assert_identical(found.load(), expected)
    assert contents(store) == whole
    found.close()


# Damage

DAMAGE = {
    "deleted": lambda x: None,
    "empty": lambda x: b"",
    "cut off": lambda x: x[: len(x) // 2],
    "longer": lambda x: x + b"\0",
    "garbage": lambda x: bytes(range(256)),
    "one bit": lambda x: x[: len(x) // 2] + bytes([x[len(x) // 2] ^ 4]) + x[len(x) // 2 + 1 :],
    "JSON of something else": lambda x: b'{"a": [1, 2]}',
    "no JSON object": lambda x: b"[" * 100_000,
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_what_is_damaged_is_named_and_made_again(run, expected, whole, store, damage, caplog):
    """One file of each kind, one at a time: chunks, a chunk of a parameter, a mark, coordinates, each sort of metadata."""
    names = [
        f"{Q0}/0.0", f"{MASS}/1", "error_max/2.3.0", "failed_at/0.1", "sweep/done/4.0", "joint/0", ".zgroup", ".zattrs",
        ".zmetadata", "error_max/.zarray", "error_max/.zattrs", "sweep/.zgroup", "sweep/done/.zarray", "sweep/done/.zattrs",
    ]  # fmt: skip
    for name in names:
        file = store / name
        x = DAMAGE[damage](file.read_bytes())
        caplog.clear()
        if x is None:
            file.unlink()
        else:
            file.write_bytes(x)
        mended(run, store, expected, whole)
        if (name, damage) != ("sweep/done/4.0", "deleted"):  # then nothing tells that the chunk was ever done
            assert name in caplog.text, name


def test_no_single_bit_of_any_file_changes_a_result(run, expected, whole, store):
    rng = np.random.default_rng(0)
    names = sorted(whole)
    for name in rng.choice(names, 25):
        x = bytearray((store / name).read_bytes())
        x[rng.integers(len(x))] ^= 1 << rng.integers(8)
        (store / name).write_bytes(x)
        mended(run, store, expected, whole)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("error_max/0.0.0", "error_max/1.0.0"),
        ("q_end/0.0.0", "v_end/0.0.0"),
        ("sweep/done/0.0", "sweep/done/1.0"),
        (f"{Q0}/0.0", f"{Q0}/1.0"),
    ],
)
def test_chunks_that_are_swapped_are_seen(run, expected, whole, store, one, other, caplog):
    (store / one).write_bytes(whole[other])
    (store / other).write_bytes(whole[one])
    mended(run, store, expected, whole)
    assert one in caplog.text or "sweep" in one


def test_chunks_with_their_marks_that_are_swapped_are_seen(run, expected, whole, store):
    for name in whole:
        head, _, place = name.rpartition("/")
        if place in ("0.0.0", "0.0") and (other := f"{head}/1{place[1:]}") in whole:
            (store / name).write_bytes(whole[other])
            (store / other).write_bytes(whole[name])
    mended(run, store, expected, whole)


def test_chunks_of_another_sweep_are_seen(run, expected, whole, store, tmp_path):
    """With their marks, and of the same shapes."""
    drawn = k1607.Drawn(GRID.each.distributions, 7, seed=1)
    k1607.sweep(run, k1607.Grid(GRID.axes, drawn), chunk=CHUNK, store=tmp_path / "other")
    for name, x in contents(tmp_path / "other").items():
        if name != store_module.IDENTITY:
            (store / name).write_bytes(x)
    mended(run, store, expected, whole)


def test_lost_rollouts_have_files_too(run, tmp_path, caplog):
    """All NaN, which zarr would leave out: one that is deleted is seen all the same."""
    far = k1607.Listed({MASS: [1.0, 1.0], "v0": np.full((2, 7), 1e30)})
    k1607.sweep(run, far, START, store=tmp_path / "s")
    file = tmp_path / "s" / "failed_at" / "0"
    file.unlink()
    k1607.sweep(run, far, START, store=tmp_path / "s")
    assert file.exists()
    assert "failed_at/0" in caplog.text


# Whose it is


def test_a_store_of_an_earlier_version_is_refused(run, store):
    mine = json.loads((store / "sweep" / "done" / ".zattrs").read_text())
    (store / "sweep" / "done" / ".zattrs").write_text(json.dumps({"of": mine["of"]}))
    before = contents(store)
    with pytest.raises(ValueError, match="store: expected a store of format 2, got one of an earlier version"):
        k1607.sweep(run, GRID, chunk=CHUNK, store=store)
    assert contents(store) == before


def test_a_store_of_a_later_version_is_refused(run, store):
    told = json.loads((store / "sweep" / "done" / ".zattrs").read_text())
    later = {**store_module._without_checksum(told), "format": 3}
    later["sha256"] = checksum(later)
    (store / "sweep" / "done" / ".zattrs").write_text(json.dumps(later))
    with pytest.raises(ValueError, match="got format 3"):
        k1607.sweep(run, GRID, chunk=CHUNK, store=store)


@pytest.mark.parametrize("damage", ["deleted", "garbage"])
def test_a_store_that_nothing_tells_whose_it_is_is_left_alone(run, store, damage):
    other = k1607.Grid(GRID.axes, k1607.Drawn(GRID.each.distributions, 7, seed=1))
    file = store / "sweep" / "done" / ".zattrs"
    file.write_bytes(DAMAGE[damage](b"") or b"{")
    before = contents(store)
    with pytest.raises(ValueError, match=r"whose sweep/done/\.zattrs is damaged, and no chunk in it is of this sweep"):
        k1607.sweep(run, other, chunk=CHUNK, store=store)
    assert contents(store) == before


def test_one_s_own_files_are_left_alone(run, expected, store):
    mine = {
        "notes.txt": b"mine",
        "thesis.partial": b"a draft",
        "error_max/0.0.partial": b"mine",
        ".hidden.abcdefgh": b"x",
    }
    for name, x in mine.items():
        (store / name).write_bytes(x)
        os.utime(store / name, (0, 0))
    xr.testing.assert_identical(k1607.sweep(run, GRID, chunk=CHUNK, store=store).load(), expected)
    assert mine.items() <= contents(store).items()


def test_what_a_killed_writer_left_is_cleared_away_and_what_is_being_written_is_not(run, store):
    old, new = store / "error_max" / ".0.0.0.abcd_123", store / "error_max" / ".0.0.0.abcd_124"
    for file in (old, new):
        file.touch()
    os.utime(old, (0, 0))
    k1607.sweep(run, GRID, chunk=CHUNK, store=store)
    assert not old.exists()
    assert new.exists()


def test_what_is_left_of_a_store_s_making_is_cleared_away(run, tmp_path):
    names = {".s.abcd_123.making": 7200, ".s.abcd_124.making": 60, ".s.old.making": 7200, "s.making": 7200}
    for name, age in names.items():
        (tmp_path / name / "s").mkdir(parents=True)
        os.utime(tmp_path / name, (time.time() - age,) * 2)
    k1607.sweep(run, GRID, chunk=CHUNK, store=tmp_path / "s")
    assert {f.name for f in tmp_path.iterdir()} == {"s", *names} - {".s.abcd_123.making"}


def test_a_store_whose_making_was_interrupted_is_made(run, expected, whole, tmp_path):
    """In a folder that was there, file by file."""
    for name in (".zgroup", "joint/0"):
        (tmp_path / "s" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "s" / name).write_bytes(whole[name])
    mended(run, tmp_path / "s", expected, whole)


# Where it is


@pytest.mark.parametrize("form", ["file://{}", "file://localhost{}", "FILE://{}", "file:{}"])
def test_a_file_url_is_the_folder(run, expected, whole, tmp_path, form):
    folder = tmp_path / "with space" / "s"
    url = form.format(str(folder).replace(" ", "%20"))
    xr.testing.assert_identical(k1607.sweep(run, GRID, chunk=CHUNK, store=url).load(), expected)
    mended(run, folder, expected, whole)


@pytest.mark.parametrize("url", ["file://elsewhere/s", "file:s", "file://", "nowhere://s", "nowhere://"])
def test_a_url_that_leads_nowhere_is_refused(run, url):
    with pytest.raises(ValueError, match="store: expected"):
        k1607.sweep(run, GRID, chunk=CHUNK, store=url)


def test_a_store_in_memory_by_url(run, expected, caplog):
    fsspec = pytest.importorskip("fsspec")
    files = fsspec.get_mapper("memory://k1607/s")
    for _ in range(2):
        xr.testing.assert_identical(k1607.sweep(run, GRID, chunk=CHUNK, store="memory://k1607/s").load(), expected)
        files["error_max/0.0.0"] = b"damaged"
    assert "error_max/0.0.0" in caplog.text


@pytest.mark.skipif(os.name == "nt" or os.getuid() == 0, reason="root reads everything")
def test_a_file_that_may_not_be_read_is_named(run, store):
    (store / "error_max" / "0.0.0").chmod(0)
    with pytest.raises(ValueError, match=r"store: cannot read .*error_max/0\.0\.0"):
        k1607.sweep(run, GRID, chunk=CHUNK, store=store)


# Several processes

SHARED = """
import os, sys
import numpy as np
import k1607_pin as k1607
from k1607_pin import files
from k1607_pin.report.cases import study_case

def say(word):
    print(word, flush=True)
    assert input() == word

if sys.argv[2] == "slow":
    replace = os.replace
    def slowly(old, new):
        if str(new).endswith(os.path.join("error_max", "0.0")):
            files.os.replace = replace
            say("writing")
        replace(old, new)
    files.os.replace = slowly

study = study_case(1)
drawn = k1607.Drawn({"payloads.0.payload.mass": k1607.Uniform(0.0, 9.0)}, 40)
loop = study.rollouts(list(drawn.along))
say("ready")
k1607.sweep(loop, drawn, study.q0, chunk=8, store=sys.argv[1])
say("done")
"""


def told(process, word):
    assert process.stdout.readline().strip() == word, process.communicate(timeout=WITHIN)[1]


def go_on(process, word):
    process.stdin.write(word + "\n")
    process.stdin.flush()


def test_three_processes_share_a_store(tmp_path):
    """One is in the middle of a file while two others begin at the same time and finish; then it goes on."""
    command = [sys.executable, "-c", SHARED, str(tmp_path / "s")]
    pipes = {name: subprocess.PIPE for name in ("stdin", "stdout", "stderr")}
    slow, *others = processes = [
        subprocess.Popen([*command, kind], text=True, **pipes) for kind in ("slow", "fast", "fast")
    ]
    try:
        for process in processes:
            told(process, "ready")
        go_on(slow, "ready")
        told(slow, "writing")
        partial = [f for f in (tmp_path / "s" / "error_max").iterdir() if f.name.startswith(".0.0.")]
        assert len(partial) == 1
        (tmp_path / "s" / "mine.partial").write_text("mine")
        for process in others:
            go_on(process, "ready")
        for process in others:
            told(process, "done")
        assert partial[0].exists()
        go_on(slow, "writing")
        told(slow, "done")
        for process in processes:
            _, error = process.communicate("done\n", timeout=WITHIN)
            assert process.returncode == 0, error
            assert "damaged" not in error
    finally:
        for process in processes:
            process.kill()
    found = contents(tmp_path / "s")
    assert found.pop("mine.partial") == b"mine"
    assert not [name for name in found if store_files.LEFT.fullmatch(Path(name).name)]
    alone = subprocess.run(
        [*command[:3], str(tmp_path / "alone"), "fast"],
        input="ready\ndone\n",
        text=True,
        capture_output=True,
        timeout=WITHIN,
    )
    assert alone.returncode == 0, alone.stderr
    assert contents(tmp_path / "alone") == found


def test_another_process_may_be_faster_at_the_making(run, expected, tmp_path, monkeypatch):
    """The other one's is there when ours is ready to be put in its place."""
    make, kinds = store_module.made_whole, iter([True])

    def second(folder, content):
        if next(kinds, False):
            make(folder, content)
        return make(folder, content)

    monkeypatch.setattr(store_module, "made_whole", second)
    found = k1607.sweep(run, GRID, chunk=np.int64(CHUNK), store=tmp_path / "s")
    xr.testing.assert_identical(found.load(), expected)
    assert [f.name for f in tmp_path.iterdir()] == ["s"]
