"""A controller with its update run natively is the controller, to rounding."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.compiled import build, emit
from k1607_pin.compiled.native import Native
from k1607_pin.compiled.program import Node, Program
from k1607_pin.control.finite import NotFiniteError
from k1607_pin.control.hybrid import HybridAdaptive, Mode, hybrid_gains
from k1607_pin.control.posture import hold
from k1607_pin.control.practice import Practice
from k1607_pin.control.reference_model import reference_model
from k1607_pin.paths.report_paths import Line
from k1607_pin.simulation.wall import Wall

pytestmark = pytest.mark.skipif(build.compiler() is None, reason="no C compiler")


@pytest.mark.parametrize("more", [False, True])
def test_simulates_alike(arm, cartesian, q0, more):
    law = cartesian(arm, posture=hold(q0, 5.0), practice=Practice(gravity=True, sigma=0.1)) if more else cartesian(arm)
    native = k1607.simulate(arm, Native(law), q0, 0.3)
    reference = k1607.simulate(arm, law, q0, 0.3)
    assert set(native.data_vars) == set(reference.data_vars)
    for name in reference.data_vars:
        x, y = native[name].values, reference[name].values
        assert native[name].dims == reference[name].dims
        # the residual is a difference of energies, and rounds as they do
        scale = np.abs(reference.energy.values if name == "energy_residual" else y).max()
        assert np.abs(x - y).max() <= 1e-10 * max(scale, 1e-3), name


def hybrid(arm, q0):
    """On a wall, at 1 ms: its program takes constants that other programs compute."""
    start = arm.forward_kinematics(q0)
    wall = Wall(start.translation, (-1.0, 0, 0), 1e4)
    stiffest = np.array([1e4] * 3 + [1e3] * 3)
    gains, force_gains = hybrid_gains(arm, q0, stiffest, omega=40, force_omega=200, force_damping=0.7)
    force_model = reference_model(200.0**2 * np.ones(6), 400.0 * np.ones(6), np.diag([200.0**2] * 6 + [0.2] * 6))
    return HybridAdaptive(
        arm, Line(start.translation, np.array([0.0, 0.1, 0.05])), start.rotation,
        (Mode((1, 0, 0, 0, 0, 0), (20.0, 0, 0, 0, 0, 0)), Mode(np.zeros(6), time=0.7)), wall.sensor(arm), stiffest, gains,
        force_gains, reference_model(2 * np.ones(6), 3 * np.ones(6)), force_model, 1e5, 1e5, 1e-5, 1e-10, period=0.001,
        posture=hold(q0, 10.0), practice=Practice(gravity=True),
    )  # fmt: skip


def test_a_hybrid_law(arm, q0):
    law = hybrid(arm, q0)
    native, state, v = Native(law), law.start(q0, np.zeros(7), 1.0), 0.1 * np.ones(7)
    for t in (0.0, 0.3, 0.8):
        (tau, after, _), (wanted, expected, _) = (x.update(t, q0, v, state) for x in (native, law))
        assert np.abs(tau - wanted).max() <= 1e-10 * np.abs(wanted).max()
        x, y = (np.array(native._state.flat(s), dtype=float) for s in (after, expected))
        assert np.abs(x - y).max() <= 1e-10 * np.abs(y).max()
        state = expected


@dataclass(frozen=True)
class Own:
    """Keeps the time of its last contact, none so far."""

    arm: k1607.Arm

    def start(self, q, v, duration):
        return {"last": -np.inf, "count": np.zeros(2)}

    def update(self, t, q, v, state):
        return -v / (1.0 + t), {"last": state["last"], "count": state["count"] + 1.0}, {}


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["t", "q", "v"])
@pytest.mark.parametrize("own", [False, True])
def test_what_is_not_finite_is_refused_by_name(arm, law, q0, own, name, bad):
    native = Native(Own(arm) if own else law)
    given = {"t": 0.01, "q": q0.copy(), "v": np.zeros(7)}
    state = native.start(q0, np.zeros(7), 0.1)
    first = native.update(*given.values(), state)
    if name == "t":
        given["t"] = bad
    else:
        given[name][3] = bad
    with pytest.raises(NotFiniteError, match=f"^{name}: expected finite"):
        native.update(*given.values(), state)
    again = native.update(0.01, q0, np.zeros(7), state)
    np.testing.assert_array_equal(first[0], again[0])


def test_a_torque_that_is_not_finite_is_not_handed_out(arm, q0):
    native = Native(Own(arm))
    state = native.start(q0, np.zeros(7), 0.1)
    with pytest.raises(NotFiniteError, match="torque"):
        native.update(-1.0, q0, np.ones(7), state)  # division by zero


@pytest.mark.parametrize("q", [np.zeros(6), np.zeros((7, 1)), 0.0, np.zeros(7) + 1j, ["a"] * 7])
def test_what_does_not_fit_is_refused_by_name(arm, law, q0, q):
    native = Native(law)
    with pytest.raises(ValueError, match=r"^q: expected"):
        native.update(0.0, q, np.zeros(7), native.start(q0, np.zeros(7), 0.1))


def test_a_program_that_reads_what_nobody_passes_does_not_become_c():
    p = Program((Node("input", place=(1, 7)),), ((0,),))
    with pytest.raises(ValueError, match=r"law: reads number 7 of input 1, of which 7 are given"):
        emit.function("law", p, (3, 7))
    with pytest.raises(ValueError, match=r"law: reads number 7 of input 1, of which there are 1 inputs"):
        emit.function("law", p, (3,))
    assert "i1[7]" in emit.function("law", p, (3, 8))


def test_what_it_gives_is_its_callers(arm, law, q0):
    """Nothing that was given out changes with the next update."""
    native = Native(law)
    state = native.start(q0, np.zeros(7), 0.1)
    first = native.update(0.0, q0, np.zeros(7), state)
    kept = [first[0].copy(), first[1].gains.K_p.copy(), first[2]["K_p"].copy()]
    native.update(0.01, q0 + 0.1, np.ones(7), first[1])
    for x, y in zip(kept, (first[0], first[1].gains.K_p, first[2]["K_p"]), strict=True):
        np.testing.assert_array_equal(x, y)


def test_without_a_compiler_it_says_so(law, monkeypatch):
    monkeypatch.setenv("K1607_COMPILER", "none")
    build.compiler.cache_clear()
    try:
        with pytest.raises(RuntimeError, match="no C compiler"):
            Native(law)
    finally:
        build.compiler.cache_clear()


def test_a_path_that_traces_is_native(law):
    assert Native(law)._asked == []


@dataclass(frozen=True)
class Awkward:
    """A path that does not trace, or that gives something else when it is traced."""

    path: Line
    how: str

    def __call__(self, t):
        if self.how == "condition" and t < 0.1:
            return self.path(0.0)
        if self.how == "float":
            return self.path(float(t))
        if self.how == "other on symbols" and not isinstance(t, float):
            return self.path(2 * t)
        return self.path(t)


@pytest.mark.parametrize("how", ["condition", "float", "other on symbols"])
def test_a_path_that_does_not_is_asked(arm, law, q0, how):
    awkward = replace(law, path=Awkward(law.path, how))
    native = Native(awkward)
    assert len(native._asked) == 1
    state = native.start(q0, np.zeros(7), 1.0)
    for t in (0.0, 0.05, 0.5):
        ours, theirs = (x.update(t, q0, np.zeros(7), state)[0] for x in (native, awkward))
        assert np.abs(ours - theirs).max() <= 1e-10 * max(np.abs(theirs).max(), 1e-3)
