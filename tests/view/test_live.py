"""The live viewer's server process: where it listens, how it ends, what it says when it cannot start."""

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request

import numpy as np
import psutil
import pytest

import k1607_pin as k1607
from k1607_pin import view
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


def test_a_port_out_of_range():
    with pytest.raises(ValueError, match="port: expected 0 to 65535, got 70000"):
        LiveWindow(port=70000)


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
