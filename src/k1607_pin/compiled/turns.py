"""One thread at a time, and a forked process that does not wait for a thread that it has not got."""

import os
import threading
from collections.abc import Callable
from typing import Any


class Turns:
    """A reentrant lock. In a process that was forked while another thread held it, it is free.

    ``freed`` is called there, to undo what that thread had begun. A module's own: it is never let go of.
    """

    def __init__(self, freed: Callable[[], Any] = lambda: None) -> None:
        self._lock, self._holder, self._depth, self._freed = threading.RLock(), 0, 0, freed
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self._forked)

    def __enter__(self) -> None:
        self._lock.acquire()
        self._holder, self._depth = threading.get_ident(), self._depth + 1

    def __exit__(self, *_: object) -> None:
        self._depth -= 1
        self._lock.release()

    def _forked(self) -> None:
        if self._holder == threading.get_ident() and self._depth:
            return  # the thread that forked goes on in the child, and gives it back
        was, self._lock, self._depth = self._depth, threading.RLock(), 0
        if was:
            self._freed()
