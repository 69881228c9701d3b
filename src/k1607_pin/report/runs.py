"""A run on disk: its log, and its figures."""

import io
from collections.abc import Callable
from pathlib import Path

import xarray as xr
from matplotlib.figure import Figure

from k1607_pin.files import write_atomically
from k1607_pin.report import plots

FIGURES: dict[str, Callable[[xr.Dataset, str], Figure]] = {
    "time-histories": plots.time_histories,
    "position-errors": plots.position_errors,
    "velocity-errors": plots.velocity_errors,
    "path": plots.tool_path,
    "other-errors": plots.other_errors,
    "gains": plots.gains,
}
"""File name -> drawing."""


def write_run(out: Path, run: xr.Dataset, title: str) -> None:
    """Write ``run.nc`` (netCDF, for `xarray.open_dataset`) and the figures as PNG to ``out``; each file whole or not at all."""
    out = Path(out)
    write_atomically(out / "run.nc", bytes(run.to_netcdf()))
    for name, draw in FIGURES.items():
        write_figure(out / name, draw(run, title), ("png",))


def write_figure(path: Path, figure: Figure, kinds: tuple[str, ...] = ("png", "svg")) -> None:
    """Write a figure to ``path`` with each kind's ending."""
    for kind in kinds:
        buffer = io.BytesIO()
        figure.savefig(buffer, format=kind, dpi=150)
        write_atomically(path.with_name(f"{path.name}.{kind}"), buffer.getvalue())
