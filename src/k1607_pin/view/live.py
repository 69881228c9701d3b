"""A meshcat window on a server of our own, in a process that ends with this one."""

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
import weakref
from pathlib import Path
from typing import IO, Any, Self

import numpy as np
import umsgpack
import zmq

from k1607_pin.view import server

ANSWER_WITHIN = 20.0
"""s: how long the server may take to answer one drawing command."""


class LiveWindow:
    """What `meshcat.Visualizer(window=...)` draws in, from any thread: any number of browsers at `web_url`, and it never prints.

    Parameters
    ----------
    host : address to listen on; "127.0.0.1" lets only this machine in.
    port : of the web page; 0 takes any free one.

    Raises
    ------
    ValueError
        ``host`` is no text or an empty one, which would mean every address; ``port`` is no whole number from 0 to 65535.
    OSError
        The server cannot listen there; the message says why.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        require_address(host, port)
        self._turn = threading.RLock()
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 - a pipe that nobody reads would fill up and stop it
        self._process = _start(host, port, self._log)
        # Also when it is collected as garbage and when Python ends.
        self._finalizer = weakref.finalize(self, _stop, self._process)
        try:
            ready = json.loads(self._process.stdout.readline() or "{}")  # type: ignore[union-attr]
            if "web_url" not in ready:
                self._process.wait(ANSWER_WITHIN)
                raise OSError(ready.get("error") or f"the viewer's server did not start: {self._last_words()}")
            self.web_url: str = ready["web_url"]
            self._socket: zmq.Socket = zmq.Context.instance().socket(zmq.REQ)
            self._socket.setsockopt(zmq.LINGER, 0)
            # Ctrl-C between a command and its answer leaves no socket that waits for it
            self._socket.setsockopt(zmq.REQ_CORRELATE, 1)
            self._socket.setsockopt(zmq.REQ_RELAXED, 1)
            self._socket.connect(ready["zmq_url"])
        except BaseException:
            self._finalizer()
            raise

    @property
    def pid(self) -> int:
        """Process id of the server."""
        return self._process.pid

    def send(self, command: Any) -> None:
        """Draw one meshcat command; RuntimeError if the server is gone."""
        data = command.lower()
        # Only an animation has no path. The server replays a scene to a new browser in the order its paths came up: an
        # animation kept at the root would be there before the things it moves.
        path = data["path"] or "animation"
        frames = [data["type"].encode(), path.encode(), umsgpack.packb(data)]
        with self._turn:
            self._exchange(frames)

    def _exchange(self, frames: list[bytes]) -> None:
        self._require_alive()
        self._socket.send_multipart(frames)
        end = time.monotonic() + ANSWER_WITHIN
        while not self._socket.poll(200):  # ms
            self._require_alive()
            if time.monotonic() > end:
                raise RuntimeError(f"the viewer at {self.web_url} does not answer {self._last_words()}".strip())
        answer = self._socket.recv()
        if answer != b"ok":
            raise RuntimeError(f"the viewer at {self.web_url} answered {answer.decode()!r}")

    def close(self) -> None:
        """Stop the server; twice does no harm."""
        with self._turn:
            if hasattr(self, "_socket"):
                self._socket.close()
            self._finalizer()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _require_alive(self) -> None:
        if self._process.poll() is not None:
            raise RuntimeError(f"the viewer at {self.web_url} is closed {self._last_words()}".strip())

    def _last_words(self) -> str:
        """The last line the server wrote that is an error, or nothing."""
        self._log.seek(0)
        lines = [line for line in self._log.read().decode(errors="replace").splitlines() if "Error" in line]
        return f"({lines[-1]})" if lines else ""


def require_address(host: Any, port: Any) -> None:
    """Raise ValueError for what is no address to listen on, an empty one above all: sockets take it for every address."""
    if not isinstance(host, str) or not host.strip() or "\0" in host or "*" in host:
        raise ValueError(
            f"host: expected an address such as '127.0.0.1', or '0.0.0.0' for every address of this machine, got {host!r}"
        )
    if not isinstance(port, int | np.integer) or isinstance(port, bool) or not 0 <= port <= 65535:
        raise ValueError(f"port: expected 0 to 65535, got {port!r}")


def _start(host: str, port: int, log: IO[bytes]) -> subprocess.Popen[bytes]:
    # By file and not by module name: the server needs meshcat only, and importing the package would load Pinocchio.
    # -P keeps the file's own folder off the import path.
    command = [sys.executable, "-P", str(Path(server.__file__)), f"--host={host}", f"--port={port}", "--with-parent"]
    return subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=log,
        env=dict(os.environ),
        start_new_session=True,  # interrupting a notebook cell must not end the viewer
    )


def _stop(process: subprocess.Popen[bytes]) -> None:
    for pipe in (process.stdin, process.stdout):
        if pipe:
            pipe.close()
    try:
        process.wait(5)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
