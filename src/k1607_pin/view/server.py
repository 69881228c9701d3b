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

import zmq
from meshcat.servers.tree import SceneTree
from meshcat.servers.zmqserver import VIEWER_HTML, VIEWER_ROOT, ZMQWebSocketBridge
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.netutil import bind_sockets
from tornado.web import Application, RequestHandler

_CONTROLS = Path(__file__).with_name("controls.js")


class Page(RequestHandler):
    """meshcat's page with our controls."""

    def get(self) -> None:
        page = Path(VIEWER_ROOT, VIEWER_HTML).read_text(encoding="utf-8")
        script = f"<script>\n{_CONTROLS.read_text(encoding='utf-8')}\nwithControls(viewer);\n</script>\n"
        self.set_header("Cache-Control", "no-store")
        self.finish(page.replace("</body>", f"{script}</body>"))


class Bridge(ZMQWebSocketBridge):
    """meshcat's bridge from ZMQ to browsers, with its web port on ``host`` and its ZMQ port on loopback."""

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
        app.add_handlers(".*", [(r"/static/(?:index.html)?", Page)])
        return app


def main() -> int:
    """Serve until interrupted, or until standard input closes if so asked."""
    parser = argparse.ArgumentParser(description="Serve meshcat's viewer on one address.")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: this machine only)")
    parser.add_argument("--port", type=int, default=0, help="port of the web page (default: any free one)")
    parser.add_argument("--with-parent", action="store_true", help="end when standard input closes")
    options = parser.parse_args()
    try:
        bridge = Bridge(options.host, options.port)
    except OSError as error:
        _say(error=f"cannot listen on {options.host}:{options.port}: {error.strerror or error}")
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


def _say(**line: str) -> None:
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
