"""Outcomes of the comparison's runs, and the CSV file that keeps them."""

import csv
import io
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TextIO

from k1607_pin.files import write_atomically

Key = tuple[str, int, float, float, str]
"""Of a run: law, case, period [s], gravity [m/s^2], trouble."""


@dataclass(frozen=True)
class Row:
    """One run's outcome."""

    law: str
    case: int
    period: float
    """s"""
    gravity: float
    """m/s^2"""
    trouble: str
    rms: float
    """m, of the tool's true distance from its path; infinite where the loop was lost"""
    largest: float
    """m, likewise"""
    torque: float
    """RMS of the torques over their limits"""
    chatter: float
    """RMS of the torques' change from one period to the next, over their limits"""

    @property
    def key(self) -> Key:
        """What was run."""
        return self.law, self.case, self.period, self.gravity, self.trouble


def loaded(file: str | Path) -> list[Row]:
    """The rows of a file that `compare` wrote; a last line that was cut off is left out.

    Raises
    ------
    ValueError
        Something else is in it.
    """
    try:
        text = Path(file).read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"file: expected {file} to be a comparison's, got {error}") from None
    names = [field.name for field in fields(Row)]
    whole = text[: text.rfind("\n") + 1]
    reader = csv.DictReader(io.StringIO(whole))
    try:
        columns, lines = reader.fieldnames, list(reader)
    except csv.Error as error:
        raise ValueError(f"file: expected {file} to be a comparison's, got {error}") from None
    if whole and columns != names:
        raise ValueError(f"file: expected {file} to have the columns {','.join(names)}, got {columns}")
    rows = []
    for number, row in enumerate(lines, start=2):
        try:
            numbers = [float(row[name]) for name in ("rms", "largest", "torque", "chatter")]
            if None in row or not (numbers[0] >= 0 and numbers[1] >= 0) or min(numbers[2:]) < 0:  # more columns; NaN
                raise ValueError
            condition = row["law"], int(row["case"]), float(row["period"]), float(row["gravity"]), row["trouble"]
            rows.append(Row(*condition, *numbers))
        except (TypeError, ValueError, OverflowError):
            raise ValueError(
                f"file: expected line {number} of {file} to be a run's, got {list(row.values())}"
            ) from None
    return rows


@contextmanager
def appending(file: str | Path | None, rows: Iterable[Row]) -> Iterator[Callable[[Row], None]]:
    """A function that adds a row to the file, which begins with those given."""
    if file is None:
        yield lambda row: None
        return
    begun = io.StringIO(newline="")
    _writer(begun).writeheader()
    _writer(begun).writerows(map(asdict, rows))
    write_atomically(file, begun.getvalue())
    with Path(file).open("a", newline="", encoding="utf-8") as stream:

        def write(row: Row) -> None:
            _writer(stream).writerow(asdict(row))
            stream.flush()

        yield write


def _writer(stream: TextIO) -> "csv.DictWriter[str]":
    return csv.DictWriter(stream, [field.name for field in fields(Row)], lineterminator="\n")
