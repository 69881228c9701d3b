"""The report's Lyapunov function on the arm itself: what it does, what (63) claims that it does, and why they differ."""

import logging

import numpy as np
import xarray as xr

from k1607_pin.arguments import number, shown
from k1607_pin.control.adaptation import Gains, gain_rates
from k1607_pin.control.error_system import (
    error_system,
    error_system_rates,
    held_rates,
    lyapunov_function,
    lyapunov_rate,
    weights,
)
from k1607_pin.control.reference_model import ReferenceModel

logger = logging.getLogger(__name__)

NEEDED = (
    "error", "error_rate", "K_p", "K_d", "wanted_velocity", "wanted_angular_velocity", "wanted_acceleration",
    "wanted_angular_acceleration", "tool_position", "tool_rotation", "tool_velocity", "payload_changes", "tau",
    "passive_torque", "Lambda", "Phi", "Gamma", "jacobian_bar", "bias_nullspace",
)  # fmt: skip


def lyapunov(run: xr.Dataset, model: ReferenceModel, beta_1: float, beta_2: float) -> xr.Dataset:
    """v of (56) and its rate along a run of the Cartesian adaptive scheme, from the true Lambda, Phi and Gamma.

    The terms of B_3 and B_4 are left out of v: no gain enters them, and no Psi_3, Psi_4 makes the arm obey (65).

    Parameters
    ----------
    run : of `simulate` with `CartesianAdaptive` and the observer `ObserveOperationalSpace`.
    model, beta_1, beta_2 : the controller's.

    Returns
    -------
    Dataset over ``time`` (control samples). In m^2, radians counting as metres:
    ``v`` and its parts ``v_state``, ``v_gains``; and in m^2/s:
    ``v_rate``, the sum of ``claimed`` = -E^T Q E, all that (63) leaves; ``gains``, zero when K_p, K_d follow the law;
    ``driven`` by the wanted motion and gravity, which (57) keeps in part and (62) sets to zero; ``disturbance`` from the null
    space, motors at their limits, friction, stops, the world, and orientation errors that are not small; and ``slow_motion``,
    what (66)-(68) neglect.
    ``v_rate_measured``: v's own forward difference. Dimensionless: ``premise_66``, ``premise_67``,
    |B' - Lambda^-1 K'| / |Lambda^-1 K'| for both gains (Frobenius); ``change_of_Lambda`` within a period over Lambda itself.
    ``premise_holds``: whether |slow_motion| < |claimed|. Samples next to a change of payload, where no rate exists, are NaN
    and do not hold. A premise that fails is also told in the log.

    Raises
    ------
    ValueError
        A run without what is needed, or of fewer than three samples.
    """
    if not isinstance(run, xr.Dataset):
        raise ValueError(f"run: expected a dataset of simulate, got {shown(run)}")
    if missing := [name for name in NEEDED if name not in run]:
        raise ValueError(
            f"run: expected one of CartesianAdaptive with observe=ObserveOperationalSpace(), got no {', '.join(missing)}"
        )
    if run.sizes["time"] < 3:
        raise ValueError(f"run: expected at least 3 samples, got {run.sizes['time']}")
    number("beta_1", beta_1, 0)  # v weighs the gains by 1/beta
    number("beta_2", beta_2, 0)
    get = {name: run[name].values for name in NEEDED}
    time, x_e, v_e = run.time.values, get["error"], get["error_rate"]
    Lambda, Phi, Gamma = get["Lambda"], get["Phi"], get["Gamma"]
    z, u = np.concatenate([x_e, v_e], axis=1), _wanted_motion(get)
    B = error_system(Lambda, Phi, Gamma, get["K_p"], get["K_d"])
    rows = [gain_rates(model.P_2, model.P_3, beta_1, beta_2, *errors) for errors in zip(x_e, v_e, strict=True)]
    K_rates = Gains(np.array([row.K_p for row in rows]), np.array([row.K_d for row in rows]))
    Lambda_dot = Phi + Phi.swapaxes(-1, -2)  # Lambda' - 2 Phi is skew
    Phi_dot, Gamma_dot = (np.gradient(M, time, axis=0) for M in (Phi, Gamma))
    rates = error_system_rates(Lambda, B, Lambda_dot, Phi_dot, Gamma_dot, K_rates)
    held = held_rates(Lambda, K_rates)
    Psi, Psi_rates = (weights(M, beta_1, beta_2, 0 * M, 0 * M) for M in (Lambda, Lambda_dot))
    v = lyapunov_function(-z, B, model, Psi)
    rate = lyapunov_rate(-z, z, u, B, rates, model, Psi, held, Psi_rates, _disturbance(get))
    slow_motion = rate.variation + rate.weights
    smooth = _smooth(get["payload_changes"])
    holds = smooth & (np.abs(slow_motion) < np.abs(rate.claimed))
    if not holds.all():
        logger.warning(
            "slow motion, (66)-(68), fails at %.0f %% of the samples, first at %.4g s: what it neglects exceeds E^T Q E there",
            100 * (1 - holds.mean()), time[np.flatnonzero(~holds)[0]],
        )  # fmt: skip
    of_v = {"v": v.total, "v_state": v.state, "v_gains": v.B_1 + v.B_2}
    of_rate = {
        "v_rate": rate.total,
        "v_rate_measured": np.append(np.diff(v.total) / np.diff(time), np.nan),
        "claimed": rate.claimed,
        "gains": rate.gains,
        "driven": rate.driven,
        "disturbance": rate.disturbance,
        "slow_motion": slow_motion,
    }
    ratios = {
        "premise_66": _ratio(rates.B_1 - held.B_1, held.B_1),
        "premise_67": _ratio(rates.B_2 - held.B_2, held.B_2),
        "change_of_Lambda": _ratio(Lambda_dot, Lambda) * np.gradient(time),
    }
    return xr.Dataset(
        {name: ("time", x, {"units": "m^2"}) for name, x in of_v.items()}
        | {name: ("time", np.where(smooth, x, np.nan), {"units": "m^2/s"}) for name, x in of_rate.items()}
        | {name: ("time", np.where(smooth, x, np.nan), {"units": ""}) for name, x in ratios.items()}
        | {"premise_holds": ("time", holds, {"units": ""}), "payload": run.payload},
        coords={"time": run.time},
    )


def _wanted_motion(get: dict[str, np.ndarray]) -> np.ndarray:
    """(N, 18) u of (47); the wanted orientation is x + x_e, as an error of 2 delta s is no difference of rotation vectors."""
    x = np.concatenate([get["tool_position"], get["tool_rotation"]], axis=1)
    rates = (get[f"wanted_{name}"] for name in ("velocity", "angular_velocity", "acceleration", "angular_acceleration"))
    return np.concatenate([x + get["error"], *rates], axis=1)


def _disturbance(get: dict[str, np.ndarray]) -> np.ndarray:
    """(N, 12) what z' has beyond (44).

    Upper half: the rate of 2 delta s is eta (w_d - w) + (w_d + w) x delta s; (43) takes w_d - w. Lower half: Lambda^-1 times the
    null space's share of the force, and what the torque on the joints lacks of the law's: limits, friction, stops, the world.
    """
    w, w_d, s = get["tool_velocity"][:, 3:], get["wanted_angular_velocity"], get["error"][:, 3:] / 2
    eta = np.sqrt(1 - (s * s).sum(axis=1, keepdims=True))
    turning = (eta - 1) * (w_d - w) + np.cross(w_d + w, s)
    law = _times(get["K_p"], get["error"]) + _times(get["K_d"], get["error_rate"])
    applied = _times(get["jacobian_bar"].swapaxes(-1, -2), get["tau"] + get["passive_torque"])
    lower = np.linalg.solve(get["Lambda"], (get["bias_nullspace"] + law - applied)[..., None])[..., 0]
    return np.concatenate([np.zeros_like(turning), turning, lower], axis=1)


def _smooth(changes: np.ndarray) -> np.ndarray:
    """(N,) whether central differences at a sample see one payload only, and so does the period before and after it."""
    same = np.diff(changes) == 0
    return np.append(True, same) & np.append(same, True)


def _times(M: np.ndarray, x: np.ndarray) -> np.ndarray:
    return (M @ x[..., None])[..., 0]


def _ratio(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(N,) ratio of Frobenius norms; infinite where b is zero."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.linalg.norm(a, axis=(-2, -1)) / np.linalg.norm(b, axis=(-2, -1))
