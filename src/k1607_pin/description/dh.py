"""Modified Denavit-Hartenberg tables: Craig's convention, the report's Table 1 and eq. (2)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from k1607_pin import data
from k1607_pin.arguments import shown
from k1607_pin.description import units
from k1607_pin.description.bounds import LARGEST, MOST_JOINTS

COLUMNS = ("alpha", "a", "d", "theta_offset")


def exact(x: np.ndarray) -> np.ndarray:
    """Sines, cosines and rotations freed of rounding: an entry within 4 ulp of 0 or ±1 is that number.

    cos(90°) evaluates to 6e-17; as an exact 0 it vanishes from traced expressions and from written files.
    """
    whole = np.clip(np.round(x), -1, 1)
    return np.where(np.abs(x - whole) <= 4 * np.finfo(float).eps, whole + 0.0, x)


def link_transform(c: Any, s: Any, cos_alpha: Any, sin_alpha: Any, a: Any, d: Any) -> Any:
    """Frame i in frame i-1, (..., 4, 4), eq. (2).

    c, s : cosine and sine of theta_i; cos_alpha, sin_alpha, a, d : alpha_{i-1}, a_{i-1}, d_i [m].
    Numbers, arrays of equal shape, traced symbols or exact polynomials alike.
    """
    return matrix(
        [
            [c, -s, 0, a],
            [s * cos_alpha, c * cos_alpha, -sin_alpha, -d * sin_alpha],
            [s * sin_alpha, c * sin_alpha, cos_alpha, d * cos_alpha],
            [0, 0, 0, 1],
        ]
    )


def matrix(rows: Sequence[Sequence[Any]], out: np.ndarray | None = None) -> Any:
    """(..., m, k) from m rows of k entries, the first of shape (...), each other of that shape or a constant.

    A batch of numbers is written to ``out`` where given.
    """
    first = rows[0][0]
    if isinstance(first, np.ndarray) and first.dtype == float:  # a batch of numbers: written in place, 3 times faster
        if out is None:
            out = np.empty((*first.shape, len(rows), len(rows[0])))
        for i, row in enumerate(rows):
            for j, entry in enumerate(row):
                out[..., i, j] = entry
        return out
    zero = 0 * first
    return np.stack([np.stack([zero + entry for entry in row], axis=-1) for row in rows], axis=-2)


@dataclass(frozen=True)
class DHTable:
    """A serial arm of n revolute joints, SI. Row i (from 0) holds alpha_{i}, a_{i}, d_{i+1} of eq. (2)."""

    alpha: np.ndarray
    """(n,) rad: angle between successive joint axes, about x."""
    a: np.ndarray
    """(n,) m: distance between successive joint axes, along x."""
    d: np.ndarray
    """(n,) m: offset along the joint axis, z."""
    theta_offset: np.ndarray
    """(n,) rad: joint angle of eq. (2) at which the arm's own joint variable is zero."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.alpha)

    @property
    def cos_alpha(self) -> np.ndarray:
        """(n,) cosines of alpha, exact at multiples of 90°."""
        return exact(np.cos(self.alpha))

    @property
    def sin_alpha(self) -> np.ndarray:
        """(n,) sines of alpha, exact at multiples of 90°."""
        return exact(np.sin(self.alpha))

    @classmethod
    def from_rows(cls, rows: Sequence[Sequence[float]], length: str = "m", angle: str = "rad") -> "DHTable":
        """A table from rows ``(alpha, a, d)`` or ``(alpha, a, d, theta_offset)`` in the given units.

        Raises
        ------
        ValueError
            No row, a row of wrong length, an entry that is no finite number (row and column named), an unknown unit.
        """
        to_rad = units.factor(units.ANGLE, angle, "D-H table, column 'alpha'")
        to_m = units.factor(units.LENGTH, length, "D-H table, columns 'a' and 'd'")
        if not hasattr(rows, "__len__") or isinstance(rows, str | bytes | Mapping) or len(rows) == 0:
            raise ValueError(f"D-H table: expected at least one row, got {rows!r}")
        if len(rows) > MOST_JOINTS:
            raise ValueError(f"D-H table: expected at most {MOST_JOINTS} rows, got {len(rows):,}")
        table = np.zeros((len(rows), 4))
        for i, row in enumerate(rows, start=1):
            if isinstance(row, str | bytes | Mapping) or not hasattr(row, "__len__") or len(row) not in (3, 4):
                raise ValueError(
                    f"D-H table, row {i}: expected (alpha, a, d) or (alpha, a, d, theta_offset), got {row!r}"
                )
            for column, value in zip(COLUMNS, row, strict=False):
                if not _is_finite_number(value):
                    raise ValueError(
                        f"D-H table, row {i}, column {column!r}: expected a finite number, got {shown(value)}"
                    )
                if abs(value) > LARGEST:
                    raise ValueError(
                        f"D-H table, row {i}, column {column!r}: expected a number up to {LARGEST:g}, got {value!r}"
                    )
            table[i - 1, : len(row)] = row
        return cls(*(table * [to_rad, to_m, to_m, to_rad]).T.copy())

    @classmethod
    def from_mapping(cls, table: Mapping[str, Any]) -> "DHTable":
        """A table from the ``[dh]`` part of a description file: ``rows`` and ``units = {length, angle}``."""
        check_keys("D-H table", table, required=("rows", "units"), optional=("standing", "source"))
        check_keys("D-H table, units", table["units"], required=("length", "angle"))
        return cls.from_rows(table["rows"], table["units"]["length"], table["units"]["angle"])

    def placements(self) -> np.ndarray:
        """(n, 4, 4): frame i in frame i-1 at theta_i = theta_offset_i, eq. (2)."""
        c, s = exact(np.cos(self.theta_offset)), exact(np.sin(self.theta_offset))
        return link_transform(c, s, self.cos_alpha, self.sin_alpha, self.a, self.d) + 0.0  # no negative zeros

    @classmethod
    def from_placements(cls, placements: np.ndarray) -> "DHTable":
        """The table whose `placements` are given, (n, 4, 4): what a URDF reads back as.

        Raises
        ------
        ValueError
            A placement that no modified D-H row can express; the joint is named.
        """
        T = np.asarray(placements, dtype=float)
        alpha = np.arctan2(-T[:, 1, 2], T[:, 2, 2])
        offset = np.arctan2(-T[:, 0, 1], T[:, 0, 0])
        d = -np.sin(alpha) * T[:, 1, 3] + np.cos(alpha) * T[:, 2, 3]
        table = cls(alpha, T[:, 0, 3].copy(), d, offset)
        gap = np.abs(table.placements() - T).max(axis=(1, 2))
        if gap.max() > 1e-9:
            raise ValueError(
                f"joint {gap.argmax() + 1}: its placement is not of the form of a modified D-H row (off by {gap.max():.1e})"
            )
        return table


def check_keys(what: str, table: Any, required: Sequence[str] = (), optional: Sequence[str] = ()) -> None:
    """Raise `ValueError` unless ``table`` is a mapping with the required keys and none but these and the optional ones."""
    if not isinstance(table, Mapping):
        raise ValueError(f"{what}: expected a table, got {table!r}")
    for key in required:
        if key not in table:
            raise ValueError(f"{what}: expected the key {key!r}, got {', '.join(table) or 'nothing'}")
    if unknown := [key for key in table if key not in (*required, *optional)]:
        raise ValueError(f"{what}: unknown key {unknown[0]!r}, expected among {', '.join((*required, *optional))}")


def _is_finite_number(value: Any) -> bool:
    if isinstance(value, bool | np.bool_ | str | bytes) or not np.isscalar(value):
        return False
    try:
        return math.isfinite(value)  # type: ignore[arg-type]
    except (TypeError, OverflowError):  # complex numbers; whole numbers beyond any float
        return False


def table_1() -> DHTable:
    """Table 1 of the report, in SI."""
    return DHTable.from_mapping(data.load("k1607")["dh"])
