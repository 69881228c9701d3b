import os
import stat
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from k1607_pin.files import write_atomically


@given(content=st.one_of(st.binary(), st.text()))
def test_reads_back_what_was_written(content, tmp_path_factory):
    path = tmp_path_factory.mktemp("write") / "new" / "folder" / "file"
    assert write_atomically(path, content) == path
    assert path.read_bytes() == (content.encode() if isinstance(content, str) else content)
    assert os.listdir(path.parent) == ["file"]


def test_replaces_the_old_content(tmp_path):
    path = tmp_path / "file"
    write_atomically(path, "a longer first version")
    write_atomically(str(path), "second")
    assert path.read_text() == "second"
    assert os.listdir(tmp_path) == ["file"]


@pytest.mark.parametrize("step", ["fdopen", "chmod", "replace"])
def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, step):
    path = tmp_path / "file"
    path.write_text("old")

    def fail(*_args, **_kwargs):
        raise OSError(f"{step}: disk full")

    monkeypatch.setattr(os, step, fail)
    with pytest.raises(OSError, match="disk full"):
        write_atomically(path, "new")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["file"]


def test_an_interrupt_counts_as_failure(tmp_path, monkeypatch):
    def interrupt(*_args):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(tmp_path / "file", "new")
    assert os.listdir(tmp_path) == []


def test_content_that_is_neither_text_nor_bytes(tmp_path):
    path = tmp_path / "file"
    path.write_text("old")
    with pytest.raises(TypeError):
        write_atomically(path, 1607)  # type: ignore[arg-type]
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["file"]


@pytest.mark.skipif(os.name != "posix", reason="permission bits")
@pytest.mark.parametrize("umask", [0o022, 0o027, 0o077, 0o002])
def test_permissions_follow_the_umask(tmp_path, umask):
    before = os.umask(umask)
    try:
        path = write_atomically(tmp_path / "ours", "x")
        (tmp_path / "plain").write_text("x")
        assert os.umask(umask) == umask  # and the umask is as it was
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode) == 0o666 & ~umask


def test_a_reader_never_sees_a_part(tmp_path):
    path, versions = tmp_path / "file", ("a" * 200_000, "b" * 100_000)
    write_atomically(path, versions[0])
    stop, seen = threading.Event(), set()

    def read():
        while not stop.is_set():
            seen.add(path.read_text())

    reader = threading.Thread(target=read)
    reader.start()
    for k in range(60):
        write_atomically(path, versions[k % 2])
    stop.set()
    reader.join()
    assert seen
    assert seen <= set(versions)
