"""The live viewer's server: meshcat's own, but listening on one address only and gone with the process that started it.

    python -m k1607_pin.view.server [--host 127.0.0.1] [--port N]

It writes one line of JSON: the addresses once it listens, or the error that kept it from listening.
"""

import argparse
import contextlib
import json
import os
import sys
import threading
from pathlib import Path

import umsgpack
import zmq
from meshcat.servers.tree import SceneTree
from meshcat.servers.zmqserver import MESHCAT_COMMANDS, VIEWER_HTML, VIEWER_ROOT, WebSocketHandler, ZMQWebSocketBridge
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.netutil import bind_sockets
from tornado.web import Application, RequestHandler
from tornado.websocket import WebSocketClosedError

_CONTROLS = Path(__file__).with_name("controls.js")


class Page(RequestHandler):
    """meshcat's page with our controls."""

    def get(self) -> None:
        page = Path(VIEWER_ROOT, VIEWER_HTML).read_text(encoding="utf-8")
        script = f"<script>\n{_CONTROLS.read_text(encoding='utf-8')}\nwithControls(viewer);\n</script>\n"
        self.set_header("Cache-Control", "no-store")
        self.finish(page.replace("</body>", f"{script}</body>"))


class Browser(WebSocketHandler):
    """A browser's socket: it is drawn to, and what it says is not heard."""

    def on_message(self, message: str | bytes) -> None:
        # meshcat's own takes it for a picture that was asked for, and answers the next drawing command with it
        _log(f"ignored: {len(message)} bytes from a browser, which has nothing to say")

    def on_close(self) -> None:
        self.bridge.websocket_pool.discard(self)


class Bridge(ZMQWebSocketBridge):
    """meshcat's bridge from ZMQ to browsers, with its web port on ``host`` and its ZMQ port on loopback.

    What is no drawing command is answered with an error and told in the log, and drawing goes on.
    """

    def __init__(self, host: str, port: int) -> None:
        # Replaces meshcat's constructor, which listens on every interface and tries ports until one is free.
        self.host = host
        self.websocket_pool: set = set()
        self.tree = SceneTree()
        self.app = self.make_app()
        self.ioloop = IOLoop.current()
        sockets = bind_sockets(port, host)
        HTTPServer(self.app).add_sockets(sockets)
        self.fileserver_port = sockets[0].getsockname()[1]
        shown = f"[{host}]" if ":" in host else host
        self.web_url = f"http://{shown}:{self.fileserver_port}/static/"
        # Whoever reaches the ZMQ port draws in the scene: only this machine may, whatever the web page's address.
        self.zmq_socket, self.zmq_stream, _ = self.setup_zmq("tcp://127.0.0.1:*")
        self.zmq_url = self.zmq_socket.getsockopt_string(zmq.LAST_ENDPOINT)

    def make_app(self) -> Application:
        app = super().make_app()
        app.add_handlers(".*", [(r"/static/(?:index.html)?", Page), (r"/", Browser, {"bridge": self})])
        return app

    def handle_zmq(self, frames: list[bytes]) -> None:
        try:
            _require_command(frames)
            super().handle_zmq(frames)
        except Exception as error:  # whatever it is: the next command is to be drawn again
            _log(f"ignored: {type(error).__name__}: {error}")
            with contextlib.suppress(zmq.ZMQError):  # it has been answered already
                self.zmq_socket.send(f"error: {error}".encode())

    def forward_to_websockets(self, frames: list[bytes]) -> None:
        for browser in list(self.websocket_pool):
            try:
                browser.write_message(frames[2], binary=True)
            except WebSocketClosedError:
                self.websocket_pool.discard(browser)


def _require_command(frames: list[bytes]) -> None:
    """Raise ValueError for what is none of meshcat's drawing commands."""
    kind = frames[0].decode("utf-8", "replace")
    if kind not in MESHCAT_COMMANDS or len(frames) != 3:
        raise ValueError(
            f"expected one of {', '.join(MESHCAT_COMMANDS)}, a path and data, got {len(frames)}, {kind!r:.60}"
        )
    frames[1].decode("utf-8")
    data = umsgpack.unpackb(frames[2])
    if not isinstance(data, dict) or data.get("type") != kind:
        raise ValueError(f"expected the data of {kind}")


def main() -> int:
    """Serve until interrupted, or until standard input closes if so asked."""
    parser = argparse.ArgumentParser(description="Serve meshcat's viewer on one address.")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: this machine only)")
    parser.add_argument("--port", type=int, default=0, help="port of the web page (default: any free one)")
    parser.add_argument("--with-parent", action="store_true", help="end when standard input closes")
    options = parser.parse_args()
    if not options.host.strip():
        _say(error="cannot listen on '': expected an address; an empty one would be every address of this machine")
        return 1
    try:
        if not 0 <= options.port <= 65535:  # getaddrinfo takes the rest of a division
            raise OverflowError("expected a port from 0 to 65535")
        bridge = Bridge(options.host, options.port)
    except (OSError, OverflowError, UnicodeError) as error:  # not here, or a port or a name that is none
        _say(error=f"cannot listen on {options.host}:{options.port}: {getattr(error, 'strerror', None) or error}")
        return 1
    if options.with_parent:
        threading.Thread(target=_end_with_parent, daemon=True).start()
    _say(web_url=bridge.web_url, zmq_url=bridge.zmq_url)
    with contextlib.suppress(KeyboardInterrupt):
        bridge.run()
    return 0


def _end_with_parent() -> None:
    sys.stdin.buffer.read()  # the pipe closes when the parent closes it, and also when the parent is killed
    os._exit(0)


def _log(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _say(**line: str) -> None:
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
