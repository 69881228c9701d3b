"""What every test may use: three arms, and examples that come out the same on every run."""

import signal
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

import k1607_pin as k1607

# A shell's background jobs ignore Ctrl-C, and so would the processes that tests start and send it to.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples on every run and every machine. `pytest --hypothesis-profile=explore` looks for new ones.
settings.register_profile(
    "repeatable", derandomize=True, deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("explore", settings.get_profile("repeatable"), derandomize=False, max_examples=2000)
settings.load_profile("repeatable")

LOADERS: dict[str, Callable[[], k1607.Arm]] = {
    "k1607": k1607.load_k1607,
    "panda": lambda: k1607.load_example("panda"),
    "ur5": lambda: k1607.load_example("ur5"),
}


@pytest.fixture(scope="session", params=list(LOADERS))
def arm(request: pytest.FixtureRequest) -> k1607.Arm:
    """The reference case, another redundant arm, and one of six joints without a null space."""
    return LOADERS[request.param]()


@pytest.fixture(scope="session")
def reference() -> k1607.Arm:
    """The K-1607 alone."""
    return k1607.load_k1607()


@pytest.fixture(scope="session")
def postures() -> np.ndarray:
    """(100000, 7) rad: full turns of every joint, limits or not."""
    return np.random.default_rng(1607).uniform(-np.pi, np.pi, (100_000, 7))
