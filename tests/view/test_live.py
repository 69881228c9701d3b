"""The live viewer's server process: where it listens, how it ends, what it says when it cannot start."""

import asyncio
import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import psutil
import pytest
import umsgpack
import zmq
from tornado.websocket import websocket_connect

import k1607_pin as k1607
from k1607_pin import view
from k1607_pin.view import server
from k1607_pin.view.live import LiveWindow


def listening(pid):
    """Addresses and ports that a process listens on."""
    return [c.laddr for c in psutil.Process(pid).net_connections("inet") if c.status == psutil.CONN_LISTEN]


def is_dead(pid):
    """Gone, or not yet reaped: in a container there may be nobody to do so."""
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def wait_until(condition, seconds=600.0):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)
    return condition()


def test_it_listens_on_loopback_only_and_serves_the_viewer():
    with LiveWindow() as window:
        addresses = listening(window.pid)
        assert len(addresses) == 2  # the page and ZMQ
        assert {address.ip for address in addresses} == {"127.0.0.1"}
        page = urllib.request.urlopen(window.web_url, timeout=600).read()
        assert b"MeshCat.Viewer" in page


def test_another_host_opens_the_page_but_not_the_drawing_port():
    with LiveWindow(host="0.0.0.0") as window:
        assert sorted(address.ip for address in listening(window.pid)) == ["0.0.0.0", "127.0.0.1"]


def test_close_ends_the_server_and_what_follows_says_so():
    live = view.show(k1607.load_k1607())
    pid = live._window.pid
    live.close()
    live.close()
    assert not psutil.pid_exists(pid)
    with pytest.raises(RuntimeError, match="closed"):
        live.display(np.zeros(7))


def test_a_server_that_died_is_reported():
    with LiveWindow() as window:
        scene = view.LiveView(view.Scene(k1607.load_k1607(), window), window)
        os.kill(window.pid, signal.SIGKILL)
        # At once: the system may still be taking the process apart, and a send must notice when it is done.
        with pytest.raises(RuntimeError, match="closed"):
            scene.display(np.zeros(7))


def test_the_server_dies_with_its_parent():
    code = "from k1607_pin.view.live import LiveWindow; w = LiveWindow(); print(w.pid, flush=True); input()"
    parent = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    pid = int(parent.stdout.readline())
    assert psutil.pid_exists(pid)
    parent.kill()
    parent.wait()
    parent.stdout.close()
    parent.stdin.close()
    assert wait_until(lambda: is_dead(pid))


def test_a_taken_port_is_a_clear_error():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(OSError, match=rf"cannot listen on 127\.0\.0\.1:{port}.*in use"):
            LiveWindow(port=port)


def test_an_address_of_another_machine_is_a_clear_error():
    with pytest.raises(OSError, match=r"cannot listen on 192\.0\.2\.1:0"):
        LiveWindow(host="192.0.2.1")


@pytest.mark.parametrize("port", [70000, -1, "80", 80.0, None, True, float("nan")])
def test_a_port_that_is_none(port):
    with pytest.raises(ValueError, match=rf"port: expected 0 to 65535, got {port!r}"):
        LiveWindow(port=port)
    with pytest.raises(ValueError, match="port: expected 0 to 65535"):
        view.show(k1607.load_k1607(), port=port)


@pytest.mark.parametrize("host", ["", " ", "\n", "*", None, 0, b"127.0.0.1", "127.0.0.1\0"])
def test_an_address_that_is_none(host):
    """Sockets take an empty one for every address there is."""
    with pytest.raises(
        ValueError, match=r"host: expected an address such as '127\.0\.0\.1', or '0\.0\.0\.0' for every"
    ):
        LiveWindow(host)
    with pytest.raises(ValueError, match="host: expected an address"):
        view.show(k1607.load_k1607(), host=host)


@pytest.mark.parametrize(
    ("options", "said"), [(["--host="], "every address"), (["--port=70000"], "cannot listen on 127.0.0.1:70000")]
)
def test_the_server_s_own_command_line_refuses_them_too(options, said):
    command = [sys.executable, "-P", server.__file__, *options, "--with-parent"]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    assert said in json.loads(done.stdout)["error"]
    assert "Traceback" not in done.stderr


FOREIGN = {
    "one byte": [b"\xff"],
    "nothing": [b""],
    "a command that is none": [b"draw", b"", b""],
    "a command that waits for a browser": [b"capture_image", b"", b""],
    "another that does": [b"wait"],
    "half a command": [b"set_object", b"/a"],
    "a path of no text": [b"set_transform", b"\xff", umsgpack.packb({"type": "set_transform", "path": ""})],
    "no data": [b"set_object", b"/a", b"\xc1"],
    "data of another command": [b"set_object", b"/a", umsgpack.packb({"type": "delete", "path": "/a"})],
    "data cut off": [b"set_object", b"/a", umsgpack.packb({"type": "set_object", "object": "x" * 99})[:50]],
    "a number": [b"set_object", b"/a", umsgpack.packb(7)],
    "deep": [b"set_object", b"/a", b"\x91" * 100_000],
}


def test_what_is_foreign_ends_no_view():
    with view.show(k1607.load_k1607()) as live:
        url = live._window._socket.getsockopt_string(zmq.LAST_ENDPOINT)
        with zmq.Context.instance().socket(zmq.REQ) as other:
            other.setsockopt(zmq.LINGER, 0)
            other.setsockopt(zmq.RCVTIMEO, 120_000)
            other.connect(url)
            for frames in FOREIGN.values():
                other.send_multipart(frames)
                assert other.recv().startswith(b"error: ")
                live.display(np.zeros(7))
        for raw in (b"\xff", b"GET / HTTP/1.1\r\n\r\n", bytes(range(256)) * 100):
            for port in (int(url.rpartition(":")[2]), int(live.url.split(":")[2].split("/")[0])):
                with socket.create_connection(("127.0.0.1", port)) as plain, contextlib.suppress(OSError):
                    plain.sendall(raw)
                live.display(np.zeros(7))
        live._window._log.seek(0)
        assert b"ignored: UnicodeDecodeError" in live._window._log.read()


def test_a_browser_that_speaks_ends_no_view():
    """It is taken for no picture, which meshcat would answer the next command with."""
    with view.show(k1607.load_k1607()) as live:

        async def speaks():
            browser = await websocket_connect(live.url.replace("http", "ws").replace("static/", ""))
            for said in ("\x00", b"\xff", "{}", '{"data": "image/png,AAAA"}'):
                await browser.write_message(said, isinstance(said, bytes))
            live.display(np.zeros(7))
            await browser.read_message()
            browser.close()

        with ThreadPoolExecutor(
            1
        ) as thread:  # an event loop of its own, whatever other tests have left running in this one
            thread.submit(asyncio.run, speaks()).result()
        for _ in range(5):
            live.display(np.zeros(7))


def test_many_threads_may_draw():
    arm, trouble = k1607.load_k1607(), []

    def draws(seed):
        try:
            for q in np.random.default_rng(seed).uniform(-1, 1, (15, 7)):
                live.display(q)
                live.show_frames(bool(seed % 2))
        except Exception as error:
            trouble.append(error)

    with view.show(arm) as live:
        threads = [threading.Thread(target=draws, args=(seed,)) for seed in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert not trouble


def test_an_interrupted_command_leaves_the_view_alive(monkeypatch):
    """Ctrl-C between a command and its answer."""
    with view.show(k1607.load_k1607()) as live:
        real = live._window._socket

        class Interrupted:
            def poll(self, ms):
                live._window._socket = real
                raise KeyboardInterrupt

            def send_multipart(self, frames):
                real.send_multipart(frames)

        live._window._socket = Interrupted()
        with pytest.raises(KeyboardInterrupt):
            live.display(np.zeros(7))
        live.display(np.ones(7))


def test_bad_input_starts_no_server():
    before = len(psutil.Process().children())
    with pytest.raises(ValueError, match=r"q: expected \(7,\)"):
        view.show(k1607.load_k1607(), Q=np.zeros(6))
    assert len(psutil.Process().children()) == before


def test_nothing_is_printed(capfd):
    with view.show(k1607.load_k1607()) as live:
        live.display(np.zeros(7))
        assert live.url in live._repr_html_()
    assert capfd.readouterr() == ("", "")
