"""Tasks on any executor: a bounded number ahead, given out again when their worker dies, ended when nobody waits."""

import atexit
import contextlib
import os
import tempfile
import uuid
from collections import Counter
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from pathlib import Path
from types import TracebackType
from typing import Any

TRIES = 3
AHEAD = 128
"""Tasks given out to an executor that does not tell how many workers it has"""
DEATHS = ("KilledWorker", "CommClosedError")
"""What dask raises for a worker that died more often than it allows"""

Task = tuple[int, tuple[Any, ...]]
"""Number and arguments"""


class WorkersLostError(RuntimeError):
    """Workers died again and again, or for good."""


def go_on_unless(halt: str) -> None:
    """Called by a task again and again: ends it where `Workers.halt` says so, by a file that threads and processes see alike.

    Raises
    ------
    CancelledError
        Nobody waits for the task any more.
    """
    if os.path.exists(halt):
        raise CancelledError("nobody waits for this task any more")


class Workers:
    """An executor, or a function that makes one: made anew when it breaks, and shut down at the end.

    Attributes
    ----------
    halt : for `go_on_unless`.
    """

    def __init__(self, executor: Executor | Callable[[], Executor]) -> None:
        self._make = None if isinstance(executor, Executor) else executor
        self._pool = executor if isinstance(executor, Executor) else executor()
        self.halt = os.path.join(tempfile.gettempdir(), f"k1607-halt-{uuid.uuid4().hex}")

    def __enter__(self) -> "Workers":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if kind is not None:
            self.end_tasks()
        if self._make:
            self._pool.shutdown(cancel_futures=True)
            _remove(self.halt)
        elif kind is not None:
            atexit.register(_remove, self.halt)  # tasks of a lent executor may look at it until it is shut down

    @property
    def in_threads(self) -> bool:
        """Whether they share this process's memory."""
        return isinstance(self._pool, ThreadPoolExecutor)

    def end_tasks(self) -> None:
        """Have the tasks under way end at their next `go_on_unless`."""
        with contextlib.suppress(OSError):  # then they end when they are done
            Path(self.halt).touch()

    def results(
        self, function: Callable[..., Any], tasks: Iterable[Task], ahead: int | None
    ) -> Generator[tuple[int, Any], None, None]:
        """Number and outcome of each task, as they come. What is not begun when nobody asks any more is cancelled.

        Raises
        ------
        WorkersLostError
            A task has lost its worker `TRIES` times, or the executor is broken and nobody can make it anew.
        """
        ahead = ahead or 2 * getattr(self._pool, "_max_workers", AHEAD // 2)
        todo, again, lost = iter(tasks), list[Task](), Counter[int]()
        running: dict[Future[Any], tuple[Task, Executor]] = {}
        try:
            while True:
                while len(running) < ahead and (task := again.pop() if again else next(todo, None)):
                    future = self._submitted(function, task[1])
                    running[future] = task, self._pool
                if not running:
                    return
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    task, pool = running.pop(future)
                    try:
                        outcome = future.result()
                    except Exception as error:
                        if not isinstance(error, BrokenExecutor) and type(error).__name__ not in DEATHS:
                            raise
                        lost[task[0]] += 1
                        if lost[task[0]] == TRIES:
                            raise WorkersLostError(
                                f"task {task[0]} has lost its worker {TRIES} times: {error}"
                            ) from error
                        again.append(task)
                        if isinstance(error, BrokenExecutor) and pool is self._pool:
                            self._renew(error)
                        continue
                    yield task[0], outcome
        finally:
            for future in running:
                future.cancel()

    def _submitted(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Future[Any]:
        try:
            return self._pool.submit(function, *arguments)
        except BrokenExecutor as error:
            self._renew(error)
            return self._pool.submit(function, *arguments)

    def _renew(self, error: BrokenExecutor) -> None:
        if self._make is None:
            raise WorkersLostError(
                f"executor: expected a function that makes it, so that it can be made anew; this one is broken: {error}"
            ) from error
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._pool = self._make()


def _remove(file: str) -> None:
    with contextlib.suppress(OSError):
        os.unlink(file)
