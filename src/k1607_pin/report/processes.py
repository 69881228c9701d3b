"""Processes that share work, stop when they should, and end with the one that started them."""

import multiprocessing
import pickle
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from os import _exit
from typing import Any


@contextmanager
def processes(jobs: int, functions: Mapping[str, Callable[..., Any]]) -> Iterator[Executor | None]:
    """What work is given to; None where ``jobs`` is 1 and this process is to do it.

    On the way out nothing more is begun, and what has been is waited for. ``functions`` : name -> what will be sent to them.
    """
    if not isinstance(jobs, int) or jobs < 1:
        raise ValueError(f"jobs: expected a whole number >= 1, got {jobs!r}")
    if jobs == 1:
        yield None
        return
    for name, function in functions.items():
        try:
            pickle.dumps(function)
        except Exception as error:
            raise ValueError(f"jobs: expected 1 where {name!r} is no module's function, got {jobs}: {error}") from None
    # spawned, since a fork copies locks that threads of this process may hold
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), initializer=_follow_parent)
    try:
        with _deaf():
            for _ in range(jobs):  # each starts a process, as long as none is idle
                pool.submit(int)
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def _deaf() -> Iterator[None]:
    """A while without Ctrl-C; processes that are started in it do not hear it from the beginning."""
    if threading.current_thread() is not threading.main_thread():
        yield  # which alone may say so
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _follow_parent() -> None:
    """Leave Ctrl-C to the process that waits for the rows, and end with it however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def wait() -> None:
        if parent:
            parent.join()
        _exit(1)

    threading.Thread(target=wait, daemon=True).start()
