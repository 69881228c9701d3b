"""What study cases 1 and 2 need and the report does not give, as numbers that can be searched: names, bounds, meaning."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Unknown:
    """One number to be identified."""

    name: str
    place: tuple[str | int, ...]
    """Where it stands in the table "report" of `study_cases.toml`: keys, and the index in a list."""
    unit: str
    lower: float
    upper: float
    step: float
    """By which a search tries others at first: a factor, or for what is not searched by its logarithm a difference."""
    log: bool
    """Searched by its logarithm."""
    drawn: tuple[float, float] | None
    """Between which a search without a start begins; None for what a drawn posture settles."""


UNKNOWNS = (
    Unknown("K_p x", ("gains", "K_p_x_N_m"), "N/m", 100.0, 50e3, 2.0, True, (500, 8000)),
    Unknown("K_p y", ("gains", "K_p_y_N_m"), "N/m", 100.0, 50e3, 2.0, True, (500, 8000)),
    Unknown("K_p z", ("gains", "K_p_z_N_m"), "N/m", 100.0, 200e3, 2.0, True, (800, 30000)),
    Unknown("K_p rot", ("gains", "K_p_N_m_rad"), "N m/rad", 50.0, 50e3, 2.0, True, (300, 15000)),
    Unknown("K_d x", ("gains", "K_d_x_N_s_m"), "N s/m", 1.0, 5e3, 2.0, True, (50, 1500)),
    Unknown("K_d y", ("gains", "K_d_y_N_s_m"), "N s/m", 1.0, 5e3, 2.0, True, (50, 1500)),
    Unknown("K_d z", ("gains", "K_d_z_N_s_m"), "N s/m", 1.0, 10e3, 2.0, True, (100, 2000)),
    Unknown("K_d rot", ("gains", "K_d_N_m_s_rad"), "N m s/rad", 0.01, 2e3, 3.0, True, (0.05, 200)),
    Unknown("beta_1", ("gains", "beta_1"), "", 0.1, 1e6, 4.0, True, (1, 10000)),
    Unknown("beta_2", ("gains", "beta_2"), "", 0.1, 1e5, 4.0, True, (1, 10000)),
    Unknown("armature", ("plant", "armature_scale"), "", 0.2, 10.0, 1.5, True, (0.5, 8)),
    Unknown("friction", ("plant", "viscous_N_m_s"), "N m s", 0.01, 60.0, 2.0, True, (0.01, 20)),
    Unknown("duration", ("line", "duration_s"), "s", 4.0, 60.0, 1.25, True, (8, 25)),
    Unknown("z0", ("start", "z0_in"), "in", -40.0, 60.0, 4.0, False, None),
    Unknown("elevation", ("start", "elevation_deg"), "deg", -20.0, 200.0, 10.0, False, None),
    Unknown("azimuth", ("start", "azimuth_deg"), "deg", -360.0, 360.0, 10.0, False, None),
    Unknown("roll", ("start", "roll_deg"), "deg", -360.0, 360.0, 10.0, False, None),
    Unknown("theta_3", ("start", "case1_deg", 2), "deg", -360.0, 360.0, 10.0, False, None),
    Unknown("theta_3 circle", ("start", "case2_deg", 2), "deg", -360.0, 360.0, 10.0, False, None),
    Unknown("payload offset", ("plant", "payload_offset_in"), "in", 0.0, 6.6, 2.0, False, (0, 6.6)),
)
"""All of them; the payload's offset is along z7, from the report's tool frame to the tool plate."""

NAMES = tuple(one.name for one in UNKNOWNS)
LOWER, UPPER = (np.array([getattr(one, end) for one in UNKNOWNS]) for end in ("lower", "upper"))
DURATION = NAMES.index("duration")
DRAWN = np.array([one.drawn or (one.lower, one.upper) for one in UNKNOWNS])
_LOG = np.array([one.log for one in UNKNOWNS])
_STEP = np.array([np.log(one.step) if one.log else one.step for one in UNKNOWNS])


def to_steps(values: np.ndarray) -> np.ndarray:
    """(..., unknowns) -> the same counted in steps of the search."""
    x = np.clip(values, LOWER, UPPER)
    return np.where(_LOG, np.log(np.where(_LOG, x, 1.0)), x) / _STEP


def from_steps(steps: np.ndarray) -> np.ndarray:
    """The inverse of `to_steps`; what is outside the bounds is put on them, and the line lasts whole seconds."""
    x = steps * _STEP
    values = np.clip(np.where(_LOG, np.exp(np.where(_LOG, np.minimum(x, 50.0), 0.0)), x), LOWER, UPPER)
    values[..., DURATION] = np.round(values[..., DURATION])
    return values


def values_of(choice: Mapping[str, Any]) -> np.ndarray:
    """(unknowns,) of a table like "report" of `study_cases.toml`."""
    return np.array([_holder(choice, one)[one.place[-1]] for one in UNKNOWNS], dtype=float)


def with_values(choice: Mapping[str, Any], values: np.ndarray, postures: np.ndarray) -> dict[str, Any]:
    """A table like ``choice`` with these values (unknowns,), and the postures (2, 7) rad at the two starts."""
    made: dict[str, Any] = copy.deepcopy(dict(choice))
    for case, q in zip((1, 2), np.rad2deg(postures), strict=True):
        made["start"][f"case{case}_deg"] = q.tolist()
    for one, value in zip(UNKNOWNS, values, strict=True):
        _holder(made, one)[one.place[-1]] = float(value)
    return made


def _holder(choice: Mapping[str, Any], one: Unknown) -> Any:
    holder: Any = choice
    for key in one.place[:-1]:
        holder = holder[key]
    return holder
