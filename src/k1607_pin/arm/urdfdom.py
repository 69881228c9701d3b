"""Pinocchio's URDF parser, and what it says on the way: urdfdom prints its reasons to the process's standard error alone."""

import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from k1607_pin.turns import Turns

_SAID = re.compile(r"^(?:Error|Warning): +(.*)\n(?: +at line \d+ in .*\n?)?", re.MULTILINE)
_before: list[int] = []
"""Standard error as it was, while the parser is listened to"""


def _put_back() -> None:
    while _before:
        kept = _before.pop()
        os.dup2(kept, 2)
        os.close(kept)


_TURNS = Turns(_put_back)  # standard error is one for all threads


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
    with _TURNS.taken():
        try:
            sys.stderr.flush()
            _before.append(os.dup(2))
        except (OSError, ValueError, AttributeError):  # closed: nothing to listen to
            yield
            return
        with tempfile.TemporaryFile() as file:
            os.dup2(file.fileno(), 2)
            try:
                yield
            finally:
                _put_back()
                file.seek(0)
                text = file.read().decode(errors="replace")
                said += (" ".join(line.split()) for line in _SAID.findall(text))
                if others := _SAID.sub("", text).strip():
                    os.write(2, others.encode() + b"\n")


def _unlike(said: list[str]) -> list[str]:
    return list(dict.fromkeys(said))
