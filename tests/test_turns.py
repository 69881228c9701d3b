"""A process that is forked while another thread is in the middle of something is not left waiting for that thread."""

import os
import signal
import subprocess
import sys
import threading

import pytest

from k1607_pin.turns import Turns

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
WITHIN = 120.0  # s; of a process that would otherwise be waited for without end

FORKED = """
import gc, os, sys, threading
import casadi as ca
import numpy as np
import k1607_pin as k1607
from k1607_pin.compiled.rollout import Rollouts

inside, go = threading.Event(), threading.Event()
START = np.deg2rad([-20.0, 30, 20, 100, -30, 60, 10])
arm = k1607.load_k1607(gravity=(0, 0, 0))

class Hold:
    def start(self, q, v, duration):
        return ()

    def initial(self, q, v):
        return ()

    def update(self, t, q, v, state):
        return 50 * (START - q) - 20 * v, state, {"error": START - q}

class Waits(Hold):
    def update(self, t, q, v, state):
        if not isinstance(q, np.ndarray) and not inside.is_set():  # traced, under all locks
            inside.set()
            go.wait()
        return super().update(t, q, v, state)

def end(law):
    return k1607.rollout(arm, law, START + 0.1, 0.05).q_end.values

found = []
before = ca.GlobalOptions.getNumpyMode(), ca.SX.__float__
thread = threading.Thread(target=lambda: found.append(end(Waits())))
thread.start()
inside.wait()
reader, writer = os.pipe()
pid = os.fork()
if pid == 0:
    as_before = gc.isenabled() and (ca.GlobalOptions.getNumpyMode(), ca.SX.__float__) == before
    os.write(writer, end(Hold()).tobytes() if as_before else b"left as it was")
    os._exit(0)
os.close(writer)
with os.fdopen(reader, "rb") as pipe:
    childs = pipe.read()
assert os.waitpid(pid, 0)[1] == 0
go.set()
thread.join()
assert gc.isenabled() and (ca.GlobalOptions.getNumpyMode(), ca.SX.__float__) == before
assert childs == found[0].tobytes(), childs[:20]
print("alike")
"""


def test_a_fork_in_the_middle_of_a_rollout_s_making_hangs_nobody():
    process = subprocess.Popen(
        [sys.executable, "-c", FORKED],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        out, error = process.communicate(timeout=WITHIN)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)  # its child too
            process.communicate()
    assert out == "alike\n", error


def forked(inside):
    """What a child makes of it, within the fork."""
    reader, writer = os.pipe()
    if (pid := os.fork()) == 0:
        try:
            os.write(writer, inside().encode())
        finally:
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as pipe:
        said = pipe.read().decode()
    os.waitpid(pid, 0)
    return said


def test_the_thread_that_forks_keeps_its_turn():
    done = []
    turns = Turns(lambda: done.append(1))

    def child():
        with turns.taken():
            pass
        return f"{len(done)}"

    with turns.taken():
        assert forked(child) == "0"
    assert forked(child) == "1"


def test_turns_are_taken_one_at_a_time():
    turns, order, inside, go = Turns(), [], threading.Event(), threading.Event()

    def first():
        with turns.taken(), turns.taken():
            inside.set()
            go.wait(WITHIN)
            order.append("first")

    def second():
        inside.wait(WITHIN)
        go.set()
        with turns.taken():
            order.append("second")

    threads = [threading.Thread(target=f) for f in (first, second)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(WITHIN)
    assert order == ["first", "second"]
