"""Locks, and other things of the whole process, that a fork does not leave in the child as another thread had them."""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Turns:
    """A lock that threads take in turns. In a process that is forked meanwhile it is free: the thread that had it is not there.

    Parameters
    ----------
    put_back : called in such a child, for what a thread that had the lock, if one had, would have done at its end.
    """

    def __init__(self, put_back: Callable[[], object] | None = None) -> None:
        self._put_back = put_back
        self._lock, self._owner = threading.RLock(), 0
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self._after_fork)

    @contextmanager
    def taken(self) -> Iterator[None]:
        """The block has the lock; again within itself, too."""
        lock = self._lock  # which a fork in this thread does not take from it
        with lock:
            before, self._owner = self._owner, threading.get_ident()
            try:
                yield
            finally:
                self._owner = before

    def _after_fork(self) -> None:
        if self._owner != threading.get_ident():
            self._lock, self._owner = threading.RLock(), 0
            if self._put_back:
                self._put_back()
