"""Practice's options: each does what it says, and nothing at its default; and what becomes of the gains without them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import eigh, sqrtm

import k1607_pin as k1607
from k1607_pin.compiled.trace import trace
from k1607_pin.control.adaptation import Gains, adapted, gain_rates
from k1607_pin.control.practice import OFF, Practice, adaptation_rates, filtered, limited, next_gains, relative_size
from k1607_pin.control.reference_model import reference_model
from k1607_pin.report.gain_drift import gain_drift

NUMBERS = st.floats(-1e3, 1e3, allow_subnormal=False)
SQUARE = arrays(float, (3, 3), elements=NUMBERS)
VECTOR = arrays(float, 3, elements=NUMBERS)
PERIOD = 0.01


@given(SQUARE, SQUARE, SQUARE, SQUARE, VECTOR, st.floats(0.0, 1.0))
def test_off_is_the_report_s_law_to_the_last_bit(K_p0, K_d0, A, B, error, share):
    start, rates = Gains(K_p0, K_d0), Gains(B, A)
    gains = Gains(A, B)
    for new, plain in zip(
        next_gains(start, gains, rates, error, share, PERIOD, OFF), adapted(gains, rates, PERIOD), strict=True
    ):
        assert (new == plain).all()
    torque, all_of_it = limited(error, OFF)
    assert torque is error
    assert all_of_it == 1.0
    assert filtered(error + 1, error, PERIOD, OFF) is error


@pytest.mark.parametrize("name", ["sigma", "gain_bound", "dead_zone", "torque_limit", "velocity_cutoff", "gravity"])
@given(A=SQUARE, B=SQUARE, error=VECTOR)
def test_each_option_leaves_the_others_off(name, A, B, error):
    """With one on but not called upon, the gains are the report's to the last bit."""
    on = {
        "sigma": 0.0,
        "gain_bound": np.inf,
        "dead_zone": 0.0,
        "torque_limit": np.full(3, 1e9),
        "velocity_cutoff": np.inf,
        "gravity": True,
    }[name]
    practice, gains, rates = Practice(**{name: on}), Gains(A, B), Gains(B, A)
    torque, share = limited(error, practice)
    assert (torque == error).all()
    new = next_gains(gains, gains, rates, error + 1e4, share, PERIOD, practice)  # an error out of any dead zone
    for k, plain in zip(new, adapted(gains, rates, PERIOD), strict=True):
        assert k == pytest.approx(plain, rel=1e-12, abs=1e-12) if name == "torque_limit" else (k == plain).all()


@given(SQUARE, SQUARE, st.floats(0.01, 10.0))
def test_sigma_leaks_to_the_start_exponentially(K_0, K, sigma):
    still = Gains(np.zeros((3, 3)), np.zeros((3, 3)))
    gains = Gains(K, K)
    for _ in range(50):
        gains = next_gains(Gains(K_0, K_0), gains, still, np.ones(3), 1.0, PERIOD, Practice(sigma=sigma))
    assert gains.K_p - K_0 == pytest.approx((1 - sigma * PERIOD) ** 50 * (K - K_0), rel=1e-9, abs=1e-9)
    # and that is exp(-sigma t) but for the step's square
    assert (1 - sigma * PERIOD) ** 50 == pytest.approx(np.exp(-sigma * 0.5), rel=sigma**2 * PERIOD)


def random_start(rng, m):
    """K(0) as an arm's: positive definite, a light direction among heavy ones, coupled."""
    root = rng.normal(size=(m, m)) * 10.0 ** rng.uniform(-1, 1, (m, 1))
    return root @ root.T + 1e-3 * np.diag(np.diag(root @ root.T))


def pushed(start, rates, bound):
    gains = start
    for rate in rates:
        gains = next_gains(start, gains, rate, np.ones(len(start.K_p)), 1.0, PERIOD, Practice(gain_bound=bound))
    return gains


@given(st.integers(0, 10_000), st.integers(1, 7), st.floats(0.01, 0.99))
def test_bounded_below_one_gains_stay_positive_definite_whatever_pushes_them(seed, m, bound):
    """x^T K x within (1 +- bound) x^T K(0) x for every x, that is, every axis and none left out."""
    rng = np.random.default_rng(seed)
    start = Gains(random_start(rng, m), random_start(rng, m))
    pushes = [Gains(*(10.0 ** rng.uniform(-3, 6) * np.outer(*rng.normal(size=(2, m))) for _ in "pd")) for _ in range(8)]
    for k, k_0 in zip(pushed(start, pushes, bound), start, strict=True):
        assert relative_size(k_0, k - k_0) <= bound * (1 + 1e-6)
        share = eigh((k + k.T) / 2, k_0, eigvals_only=True)
        assert 1 - bound - 1e-6 <= share[0] <= share[-1] <= 1 + bound + 1e-6
        root = np.linalg.inv(np.real(sqrtm(k_0)))
        assert np.linalg.norm(root @ (k - k_0) @ root, 2) <= bound * (1 + 1e-6) + 1e-9  # of what is not symmetric too


@given(st.integers(0, 10_000), st.integers(1, 7), st.booleans())
def test_the_bound_is_the_same_in_other_units_and_axes(seed, m, units):
    """x = T z, so that forces go with T^T and gains with T^T K T: metres to centimetres, or any axes."""
    rng = np.random.default_rng(seed)
    T = np.diag(10.0 ** rng.uniform(-3, 3, m)) if units else np.linalg.qr(rng.normal(size=(m, m)))[0]
    start = Gains(*(random_start(rng, m) for _ in "pd"))
    pushes = [Gains(*(1e3 * np.outer(*rng.normal(size=(2, m))) for _ in "pd")) for _ in range(5)]

    def turned(gains):
        return Gains(*(T.T @ k @ T for k in gains))

    there = pushed(turned(start), [turned(push) for push in pushes], 0.5)
    here = turned(pushed(start, pushes, 0.5))
    for a, b, k_0 in zip(there, here, turned(start), strict=True):
        size = np.sqrt(np.outer(np.diag(k_0), np.diag(k_0)))
        assert np.abs((a - b) / size).max() < 1e-6


def test_distance_of_diagonal_gains_is_the_root_of_the_sum_of_shares():
    """By hand: N/m and N m/rad side by side."""
    assert relative_size(np.diag([4e4, 9.0]), np.diag([5e4, 9.0]) - np.diag([4e4, 9.0])) == pytest.approx(0.25)
    assert relative_size(np.diag([4e4, 9.0]), np.diag([4e4, 12.0]) - np.diag([4e4, 9.0])) == pytest.approx(1 / 3)
    assert relative_size(np.diag([4e4, 9.0]), np.array([[4e4, 60.0], [0, 9.0]]) - np.diag([4e4, 9.0])) == pytest.approx(
        60 / 600
    )


def test_the_bound_projects_towards_the_start_and_lets_back_in():
    start, practice = Gains(np.eye(3), np.eye(3)), Practice(gain_bound=0.5)
    push = Gains(1e3 * np.diag([1.0, 0, 0]), np.zeros((3, 3)))
    out = next_gains(start, start, push, np.ones(3), 1.0, PERIOD, practice)
    assert out.K_p - start.K_p == pytest.approx(np.diag([0.5, 0, 0]))
    back = next_gains(start, out, Gains(-push.K_p / 100, push.K_d), np.ones(3), 1.0, PERIOD, practice)
    assert back.K_p == pytest.approx(out.K_p - np.diag([0.1, 0, 0]))


@pytest.mark.parametrize("start", [np.zeros((3, 3)), np.diag([1.0, 0, 1]), np.diag([1.0, -1, 1])])
def test_a_bound_without_a_measure_is_refused(start):
    with pytest.raises(
        ValueError, match=r"gain_bound: expected a positive definite K_d\(0\) to measure by, got an eig"
    ):
        Practice(gain_bound=1.0).check(7, 3, Gains(np.eye(3), start))
    Practice().check(7, 3, Gains(np.eye(3), start))


@given(st.integers(0, 10_000), st.integers(1, 7))
def test_rates_move_each_gain_by_the_share_of_itself_that_is_asked_for(seed, m):
    """K_p under the error at which K_p holds the disturbance, K_d under the rate at which K_d does."""
    rng = np.random.default_rng(seed)
    gains = Gains(*(random_start(rng, m) for _ in "pd"))
    model = reference_model(rng.uniform(1, 4, m), rng.uniform(2, 5, m))
    load, still = rng.normal(size=m), np.zeros(m)
    beta_1, beta_2 = adaptation_rates(gains, model, load, 0.3)
    e, rate = np.linalg.solve(gains.K_p, load), np.linalg.solve(gains.K_d, load)
    for k, errors, at in ((gains.K_p, (e, still), 0), (gains.K_d, (still, rate), 1)):
        moving = gain_rates(model.P_2, model.P_3, beta_1, beta_2, *errors)[at]
        assert relative_size(k, moving) == pytest.approx(0.3, rel=1e-6)
    # of a load twice as heavy the gains learn four times as fast
    assert adaptation_rates(gains, model, 2 * load, 0.3) == pytest.approx((beta_1 / 4, beta_2 / 4))


@pytest.mark.parametrize(("load", "rate"), [(np.zeros(3), 1.0), (np.ones(2), 1.0), (np.full(3, np.nan), 1.0)])
def test_rates_for_nothing_are_refused(load, rate):
    gains, model = Gains(np.eye(3), np.eye(3)), reference_model(np.ones(3), np.ones(3))
    with pytest.raises(ValueError, match=r"disturbance: expected \(3,\)"):
        adaptation_rates(gains, model, load, rate)
    with pytest.raises(ValueError, match="rate"):
        adaptation_rates(gains, model, np.ones(3), -rate)


@given(SQUARE, SQUARE, arrays(float, 3, elements=st.floats(-1.0, 1.0)), st.floats(0.1, 2.0))
def test_the_dead_zone_freezes_and_lets_go(K, rate, error, zone):
    gains, practice = Gains(K, K), Practice(dead_zone=zone)
    new = next_gains(gains, gains, Gains(rate, rate), error, 1.0, PERIOD, practice)
    if np.abs(error).max() <= zone:
        assert (new.K_p == K).all()
    else:
        assert new.K_p == pytest.approx(K + PERIOD * rate, rel=1e-12, abs=1e-12)


def test_a_dead_zone_of_its_own_for_each_error():
    gains, rates = Gains(np.eye(2), np.eye(2)), Gains(np.ones((2, 2)), np.ones((2, 2)))
    practice = Practice(dead_zone=np.array([1.0, 0.1]))
    asleep = next_gains(gains, gains, rates, np.array([-0.9, 0.05]), 1.0, PERIOD, practice)
    awake = next_gains(gains, gains, rates, np.array([0.0, -0.2]), 1.0, PERIOD, practice)
    assert (asleep.K_p == gains.K_p).all()
    assert (awake.K_p != gains.K_p).all()


@given(VECTOR, arrays(float, 3, elements=st.floats(0.1, 500.0)))
def test_saturation_keeps_the_direction_and_the_bound(torque, limit):
    practice = Practice(torque_limit=limit)
    out, share = limited(torque, practice)
    assert (np.abs(out) <= limit * (1 + 1e-12)).all()
    assert out == pytest.approx(share * torque)
    assert 0 < share <= 1
    if share < 1:
        assert (np.abs(out) >= limit * (1 - 1e-12)).any()  # no more is given up than must be
    else:
        assert (out == torque).all()


@given(SQUARE, SQUARE, st.floats(0.01, 0.99))
def test_adaptation_rests_in_saturation(K, rate, share):
    gains, practice = Gains(K, K), Practice(torque_limit=np.ones(3))
    new = next_gains(gains, gains, Gains(rate, rate), np.ones(3), share, PERIOD, practice)
    assert (new.K_d == K).all()


def test_the_filter_passes_what_is_constant_and_halves_the_power_at_its_cutoff():
    practice, period = Practice(velocity_cutoff=20.0), 1e-4
    out = np.zeros(1)
    for _ in range(20_000):  # 40 time constants
        out = filtered(out, np.ones(1), period, practice)
    assert out == pytest.approx(1.0, abs=1e-12)
    t = np.arange(20_000) * period
    response, out = [], np.zeros(1)
    for x in np.sin(20.0 * t):
        out = filtered(out, np.array([x]), period, practice)
        response.append(out[0])
    settled = t > 1.0
    basis = np.column_stack([np.sin(20.0 * t), np.cos(20.0 * t)])[settled]
    a, b = np.linalg.lstsq(basis, np.array(response)[settled], rcond=None)[0]
    assert np.hypot(a, b) == pytest.approx(np.sqrt(0.5), rel=2e-3)
    assert np.arctan2(b, a) == pytest.approx(-np.pi / 4, abs=3e-3)


@pytest.mark.parametrize(
    "practice",
    [
        Practice(),
        Practice(sigma=0.5),
        Practice(gain_bound=0.01),
        Practice(dead_zone=np.array([0.5, 1.0, 2.0])),
        Practice(torque_limit=np.array([0.5, 1.0, 2.0])),
        Practice(velocity_cutoff=30.0),
        Practice(0.5, 0.01, 0.3, np.full(3, 0.7), 30.0),
    ],
    ids=["off", "sigma", "bound", "dead zone", "limit", "filter", "all"],
)
def test_traced_equals_floats(practice):
    def step(K_p0, K_d0, K_p, K_d, error, rate, torque, before, v):
        start, gains = Gains(K_p0, K_d0), Gains(K_p, K_d)
        out, share = limited(torque, practice)
        rates = gain_rates(np.eye(3), np.eye(3), 3.0, 2.0, error, rate)
        after = next_gains(start, gains, rates, error, share, PERIOD, practice)
        return out, after.K_p, after.K_d, filtered(before, v, PERIOD, practice)

    shapes = [(3, 3)] * 4 + [(3,)] * 5
    traced, rng = trace(step, "step", shapes), np.random.default_rng(5)
    for _ in range(30):
        arguments = [rng.normal(size=shape) for shape in shapes]
        arguments[:2] = [k @ k.T + np.eye(3) for k in arguments[:2]]
        for a, b in zip(step(*arguments), traced(*(np.ravel(x) for x in arguments)), strict=True):
            assert np.abs(np.array(b).reshape(a.shape) - a).max() < 1e-12 * (1 + np.abs(a).max())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sigma": -1.0}, "sigma"),
        ({"gain_bound": np.nan}, "gain_bound"),
        ({"dead_zone": np.array([1.0, -1.0])}, "dead_zone"),
        ({"torque_limit": np.array([1.0, 0.0])}, "torque_limit"),
        ({"torque_limit": 5.0}, "torque_limit"),
        ({"velocity_cutoff": 0.0}, "velocity_cutoff"),
    ],
)
def test_what_makes_no_sense_is_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        Practice(**changes)


@pytest.fixture(scope="module")
def drift():
    """Ten minutes of holding still with noisy sensors, six joints, every 40 ms."""
    arm = k1607.load_example("ur5")
    options = {
        "none": Practice(gravity=True),
        "leak": Practice(gravity=True, sigma=0.05),
        "bound": Practice(gravity=True, gain_bound=0.1),
        "dead zone": Practice(gravity=True, dead_zone=1e-3),
    }
    q = np.array([0.3, -1.2, 1.4, -0.9, -1.2, 0.2])
    return gain_drift(arm, q, options, period=0.04, omega_T=0.15, rates=(500.0, 500.0), every=10.0)


def test_noise_alone_drives_the_gains_for_as_long_as_it_lasts(drift):
    K_d = drift.K_d.sel(option="none")
    held = K_d.values[np.isfinite(K_d.values)]
    assert held[0] == 1.0
    assert (np.diff(held) > 0).all()
    assert held[-1] > 1.2


def test_each_option_keeps_them_where_they_are(drift):
    for option, within in (("leak", 0.1), ("bound", 0.1 + 1e-9), ("dead zone", 1e-9)):
        K_d = drift.K_d.sel(option=option).values
        assert np.isfinite(K_d).all()
        assert np.abs(K_d - 1).max() <= within, option
    assert float(drift.error.sel(option="leak").max()) < 1e-3  # rad
