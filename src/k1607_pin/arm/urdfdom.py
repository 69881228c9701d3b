"""Pinocchio's URDF parser, and what it says on the way: urdfdom prints its reasons to the process's standard error alone."""

import os
import re
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

_one_at_a_time = threading.Lock()
_SAID = re.compile(r"^(?:Error|Warning): +(.*)\n(?: +at line \d+ in .*\n?)?", re.MULTILINE)


def _anew() -> None:
    """In a child of a fork: another thread of the parent may hold the lock, and will not let it go here."""
    global _one_at_a_time
    _one_at_a_time = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_anew)


def heard(build: Callable[[], Any]) -> tuple[Any, list[str]]:
    """What ``build()`` returns, and the parser's messages; a ValueError has them in its text."""
    said: list[str] = []
    try:
        with _listening(said):
            result = build()
    except (ValueError, RuntimeError, IndexError, UnicodeError) as error:
        raise ValueError("; ".join([*_unlike(said), str(error).strip()])) from None
    return result, _unlike(said)


@contextmanager
def _listening(said: list[str]) -> Iterator[None]:
    """Standard error of the whole process into a file for a while; what was not the parser's is passed on afterwards."""
    with _one_at_a_time:
        try:
            sys.stderr.flush()
            kept = os.dup(2)
        except (OSError, ValueError, AttributeError):  # closed: nothing to listen to
            yield
            return
        with tempfile.TemporaryFile() as file:
            os.dup2(file.fileno(), 2)
            try:
                yield
            finally:
                os.dup2(kept, 2)
                os.close(kept)
                file.seek(0)
                text = file.read().decode(errors="replace")
                said += (" ".join(line.split()) for line in _SAID.findall(text))
                if others := _SAID.sub("", text).strip():
                    os.write(2, others.encode() + b"\n")


def _unlike(said: list[str]) -> list[str]:
    return list(dict.fromkeys(said))
