"""A controller with its update run natively is the controller, to rounding."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import k1607_pin as k1607
from k1607_pin.compiled import build
from k1607_pin.compiled.native import Native
from k1607_pin.control.posture import hold
from k1607_pin.control.practice import Practice
from k1607_pin.paths.report_paths import Line

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
