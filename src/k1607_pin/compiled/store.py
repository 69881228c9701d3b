"""Where a sweep's results are kept: in memory, or in a zarr store that outlives the process."""

import shutil
import tempfile
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from k1607_pin.compiled.chunks import Cut

MAKING, ABANDONED = ".making", 3600.0
"""End of the name of a store's folder while it is made; s after which one was left by a process that was killed"""
MARKS = "sweep/done"
"""Array in the store: which chunks are there, and in its attributes of which sweep."""


class Variable(NamedTuple):
    """One of the results."""

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    attrs: Mapping[str, Any]

    @property
    def size(self) -> int:
        """Bytes"""
        return 8 * int(np.prod(self.shape, dtype=object))


class InMemory:
    """Arrays of the whole result."""

    def __init__(
        self, frame: xr.Dataset, variables: Mapping[str, Variable], parameters: Iterable[str], chunks: int
    ) -> None:
        self._frame, self._variables, self._parameters = frame, variables, set(parameters)
        self.arrays: dict[str, Any] = {name: np.full(x.shape, np.nan) for name, x in variables.items()}
        self.done = np.zeros(chunks, dtype=bool)

    def mark(self, k: int) -> None:
        """Chunk k is written."""
        self.done[k] = True

    def opened(self) -> xr.Dataset:
        """What is there."""
        made = {name: (x.dims, self.arrays[name], x.attrs) for name, x in self._variables.items()}
        coords = {name: x for name, x in made.items() if name in self._parameters}
        rest = {name: x for name, x in made.items() if name not in self._parameters}
        return self._frame.assign_coords(coords).assign(rest)


class InStore:
    """Arrays of a zarr store, created or gone on with.

    A chunk is marked after it is written, and files appear whole or not at all: what a kill leaves unmarked is made again.

    Parameters
    ----------
    store : a folder, or a URL that zarr understands.
    frame : coordinates and attributes; variables : the rest, of which ``parameters`` are coordinates too.
    identity : what the sweep is, by name; an earlier one's must be the same.

    Raises
    ------
    ValueError
        zarr is not installed; the store holds something else, or another sweep: the message says what differs.
    """

    def __init__(
        self,
        store: str | Path,
        frame: xr.Dataset,
        variables: Mapping[str, Variable],
        parameters: Iterable[str],
        cut: Cut,
        identity: Mapping[str, str],
    ) -> None:
        try:
            import zarr
        except ImportError:
            raise ValueError("store: expected zarr to be installed: pip install 'k1607-pin[sweep]'") from None
        self._store = str(store)
        folder = None if "://" in self._store else Path(store)
        if folder and folder.is_file():
            raise ValueError(f"store: expected a folder, got a file, {store}")
        try:
            group = zarr.open_group(self._store, mode="r+", zarr_format=2, use_consolidated=False)
        except FileNotFoundError:
            if folder and folder.exists() and any(folder.iterdir()):
                raise ValueError(f"store: expected a new folder or the store of a sweep, got {store}") from None
            if folder and not folder.exists():
                folder.parent.mkdir(parents=True, exist_ok=True)
                for left in folder.parent.glob(f".{folder.name}.*{MAKING}"):  # by a process killed meanwhile
                    if time.time() - left.stat().st_mtime > ABANDONED:
                        shutil.rmtree(left, ignore_errors=True)
                with tempfile.TemporaryDirectory(MAKING, f".{folder.name}.", folder.parent) as beside:
                    made = Path(beside) / folder.name
                    _create(str(made), frame, variables, parameters, cut, identity)
                    try:
                        made.replace(folder)  # whole or not at all
                    except OSError:  # another process was faster
                        if not folder.is_dir():
                            raise
            else:
                _create(self._store, frame, variables, parameters, cut, identity)
            group = zarr.open_group(self._store, mode="r+", zarr_format=2, use_consolidated=False)
        if MARKS not in group:
            raise ValueError(
                f"store: expected the store of a sweep, got {store}; delete it if its making was interrupted"
            )
        self._marks = group[MARKS]
        _require_same(self._marks.attrs["of"], identity)
        for left in folder.rglob("*.partial") if folder else ():  # by a process killed while it wrote
            left.unlink()
        self.done = np.array(self._marks[:])
        self.arrays = {name: group[name] for name in variables}

    def mark(self, k: int) -> None:
        """Chunk k is written."""
        self.done[k] = True
        self._marks[:] = self.done

    def opened(self) -> xr.Dataset:
        """What is there, read when it is looked at."""
        found = xr.open_dataset(self._store, engine="zarr", consolidated=False)
        results = {name: found[name] for name in self.arrays if name in found.data_vars}
        return found.drop_vars(list(results)).assign(results)  # zarr knows no order


def _create(
    store: str,
    frame: xr.Dataset,
    variables: Mapping[str, Variable],
    parameters: Iterable[str],
    cut: Cut,
    identity: Mapping[str, str],
) -> None:
    import zarr

    frame.to_zarr(store, mode="w-", zarr_format=2, consolidated=False)
    group = zarr.open_group(store, mode="r+", zarr_format=2, use_consolidated=False)
    box = dict(zip(cut.dims, cut.box, strict=True))
    for name, x in variables.items():
        group.create_array(
            name,
            shape=x.shape,
            chunks=tuple(box.get(dim, size) for dim, size in zip(x.dims, x.shape, strict=True)),
            dtype="float64",
            fill_value=np.nan,
            attributes={**x.attrs, "_ARRAY_DIMENSIONS": list(x.dims)},
        )
    group.attrs["coordinates"] = " ".join(parameters)
    zarr.consolidate_metadata(store, zarr_format=2)
    # last, so that a store with marks is a whole one, where it cannot be made beside and renamed
    group.create_array(
        MARKS,
        shape=(cut.count,),
        chunks=(cut.count,),
        dtype="bool",
        fill_value=False,
        attributes={"of": dict(identity)},
    )


def _require_same(earlier: Mapping[str, str], now: Mapping[str, str]) -> None:
    if other := [name for name in {**now, **earlier} if earlier.get(name) != now.get(name)]:
        told = "; ".join(f"{name}: {earlier.get(name, 'nothing')}, now {now.get(name, 'nothing')}" for name in other)
        raise ValueError(f"store: expected the sweep that it was begun with, got another one. {told}")
