"""Where a sweep's results are kept: in memory, or in a zarr store that outlives the process."""

import hashlib
import json
import logging
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from k1607_pin.compiled.chunks import Cut
from k1607_pin.compiled.store_files import Folder, files_of, made_whole
from k1607_pin.files import checksum

logger = logging.getLogger(__name__)

FORMAT = 2
"""Of the store; 1 had one mark a chunk and no checksums"""
MARKS = "sweep/done"
"""Array in the store: for each chunk the checksums of its files, and one of these"""
IDENTITY = f"{MARKS}/.zattrs"
"""File in the store: of which sweep it is"""
CHECKSUM = 16
"""Bytes that are kept of a SHA-256"""


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
        self, frame: xr.Dataset, variables: Mapping[str, Variable], parameters: Iterable[str], cut: Cut
    ) -> None:
        self._frame, self._variables, self._parameters, self._cut = frame, variables, set(parameters), cut
        self.arrays: dict[str, Any] = {name: np.full(x.shape, np.nan) for name, x in variables.items()}
        self.done = np.zeros(cut.count, dtype=bool)

    def write(self, k: int, found: Mapping[str, np.ndarray]) -> None:
        """Chunk k's rollouts of each variable."""
        for name, x in found.items():
            self._cut.write(k, self.arrays[name], self._variables[name].dims, x)
        self.done[k] = True

    def opened(self) -> xr.Dataset:
        """What is there."""
        made = {name: (x.dims, self.arrays[name], x.attrs) for name, x in self._variables.items()}
        coords = {name: x for name, x in made.items() if name in self._parameters}
        rest = {name: x for name, x in made.items() if name not in self._parameters}
        return self._frame.assign_coords(coords).assign(rest)


class InStore:
    """Arrays of a zarr store, created or gone on with; any number of processes may write to it at the same time.

    A chunk has a mark: the checksums of its files, bound to the sweep and to their places. It is written after them, and files
    appear whole or not at all. What does not fit is named by a warning in the log, and made again: chunks by the sweep, and what
    follows from the sweep alone (coordinates, metadata) at once.

    Parameters
    ----------
    store : a folder, or a URL that fsspec understands.
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
        self._store, self._files = store, files_of(str(store))
        self._variables, self._cut = variables, cut
        of = {"format": FORMAT, "of": dict(identity)}
        seal = checksum(of)
        told = {**of, "sha256": seal}
        self._scratch, self._arrays = _created(frame, variables, parameters, cut, told)
        self._fixed = {name: x.to_bytes() for name, x in self._scratch.items()}
        self._fixed[IDENTITY] = self._fixed.pop(IDENTITY)  # last: a store that has it is a whole one
        self._salt = {
            name: hashlib.sha256(f"{seal} {checksum(json.loads(self._fixed[f'{name}/.zarray']))}".encode())
            for name in variables
        } | {MARKS: hashlib.sha256(seal.encode())}
        self._begin(told)
        if isinstance(self._files, Folder):
            self._files.clear(lambda name: name in self._fixed or name in self._names_of_chunks())
        damaged = [name for name, x in self._fixed.items() if not _same(name, self._files.read(name), x)]
        for name in damaged:
            self._files.write(name, self._fixed[name])
        self.done = np.zeros(cut.count, dtype=bool)
        for k in range(cut.count):
            mark, wrong = self._looked_at(k)
            self.done[k] = mark and not wrong
            damaged += wrong if mark else []
        if damaged:
            logger.warning("store: %s: made again, since they are damaged or missing: %s", store, _few(damaged))

    def write(self, k: int, found: Mapping[str, np.ndarray]) -> None:
        """Chunk k's rollouts of each variable."""
        for name, x in found.items():
            self._cut.write(k, self._arrays[name], self._variables[name].dims, x)
        sums = b""
        for name, key in self._keys(k).items():
            content = self._scratch.pop(key).to_bytes()
            self._files.write(key, content)
            sums += self._checksum(name, key, content)
        self._files.write(self._mark(k), sums + self._checksum(MARKS, self._mark(k), sums))
        self.done[k] = True

    def opened(self) -> xr.Dataset:
        """What is there, read when it is looked at."""
        found = xr.open_dataset(self._files.opened(), engine="zarr", consolidated=False)
        results = {name: found[name] for name in self._variables if name in found.data_vars}
        return found.drop_vars(list(results)).assign(results)  # zarr knows no order

    def _begin(self, told: Mapping[str, Any]) -> None:
        """Make the store if it is not there; refuse it if it is not this sweep's."""
        content = self._files.read(IDENTITY)
        found = _loaded(content)
        if found is not None and set(found) == {"of"}:
            raise ValueError(
                f"store: expected a store of format {FORMAT}, got one of an earlier version, {self._store}, which has no "
                "checksums; take another folder, or delete this one to run the sweep again"
            )
        if found is not None and found.get("sha256") == checksum(_without_checksum(found)):
            if found.get("format") != FORMAT:
                raise ValueError(
                    f"store: expected a store of format {FORMAT}, got format {found.get('format')!r}, {self._store}, made by "
                    "another version; take another folder"
                )
            _require_same(found["of"], told["of"])
            return
        there = list(self._files.names())
        if not there:
            folder = self._files.path if isinstance(self._files, Folder) else None
            if folder is None or folder.exists():
                for name, x in self._fixed.items():
                    self._files.write(name, x)
            else:
                made_whole(folder, self._fixed)
            return self._begin(told)  # which may be another process's, that was faster
        ours = any(mark and not wrong for mark, wrong in map(self._looked_at, range(self._cut.count)))
        half_made = all(_same(name, self._files.read(name), self._fixed.get(name)) for name in there)
        if not ours and not half_made:
            why = "" if f"{MARKS}/.zarray" not in there else (
                f", whose {IDENTITY} is {'missing' if content is None else 'damaged'}, and no chunk in it is of this sweep: "
                "delete it to run the sweep again"
            )  # fmt: skip
            raise ValueError(f"store: expected a new folder or the store of this sweep, got {self._store}{why}")

    def _looked_at(self, k: int) -> tuple[bool, list[str]]:
        """Whether chunk k has a mark, and which of its files do not fit it."""
        mark = self._files.read(self._mark(k))
        if mark is None:
            return False, []
        *sums, own = (mark[i : i + CHECKSUM] for i in range(0, max(len(mark), 1), CHECKSUM))
        if len(sums) != len(self._variables) or own != self._checksum(MARKS, self._mark(k), b"".join(sums)):
            return True, [self._mark(k)]
        wrong = []
        for (name, key), wanted in zip(self._keys(k).items(), sums, strict=True):
            content = self._files.read(key)
            if content is None or self._checksum(name, key, content) != wanted:
                wrong.append(key)
        return True, wrong

    def _checksum(self, name: str, key: str, content: bytes) -> bytes:
        made = self._salt[name].copy()
        made.update(f"{key}\0".encode() + content)
        return made.digest()[:CHECKSUM]

    def _keys(self, k: int) -> dict[str, str]:
        """Variable -> the file of its part of chunk k."""
        at = self._cut.index(k)
        return {
            name: f"{name}/{'.'.join(str(at.get(dim, 0)) for dim in x.dims)}" for name, x in self._variables.items()
        }

    def _names_of_chunks(self) -> Iterator[str]:
        for k in range(self._cut.count):
            yield self._mark(k)
            yield from self._keys(k).values()

    def _mark(self, k: int) -> str:
        return f"{MARKS}/{k}.0"


def _created(
    frame: xr.Dataset,
    variables: Mapping[str, Variable],
    parameters: Iterable[str],
    cut: Cut,
    told: Mapping[str, Any],
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The files of a store that has no chunk yet, in memory, and its arrays, which write there."""
    try:
        import zarr
        from numcodecs import Blosc
    except ImportError:
        raise ValueError("store: expected zarr to be installed: pip install 'k1607-pin[sweep]'") from None
    files: dict[str, Any] = {}
    store = zarr.storage.MemoryStore(files)
    frame.to_zarr(store, mode="w-", zarr_format=2, consolidated=False)
    group = zarr.open_group(store, mode="r+", zarr_format=2, use_consolidated=False)
    box = dict(zip(cut.dims, cut.box, strict=True))
    arrays = {
        name: group.create_array(
            name,
            shape=x.shape,
            chunks=tuple(box.get(dim, size) for dim, size in zip(x.dims, x.shape, strict=True)),
            dtype="float64",
            fill_value=np.nan,
            compressors=Blosc(cname="lz4", clevel=5, shuffle=Blosc.SHUFFLE),
            attributes={**x.attrs, "_ARRAY_DIMENSIONS": list(x.dims)},
            config={"write_empty_chunks": True},  # a chunk has all its files
        )
        for name, x in variables.items()
    }
    group.attrs["coordinates"] = " ".join(parameters)
    zarr.consolidate_metadata(store, zarr_format=2)
    size = CHECKSUM * (len(variables) + 1)
    group.create_array(
        MARKS,
        shape=(cut.count, size),
        chunks=(1, size),
        dtype="uint8",
        fill_value=0,
        compressors=None,
        attributes=dict(told),
    )
    return files, arrays


def _loaded(content: bytes | None) -> dict[str, Any] | None:
    """The JSON object of a file; None where it is none."""
    try:
        found = json.loads(content or b"")
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def _without_checksum(found: Mapping[str, Any]) -> dict[str, Any]:
    return {name: x for name, x in found.items() if name != "sha256"}


def _same(name: str, found: bytes | None, wanted: bytes | None) -> bool:
    """Whether a file is what it should be; of JSON, whether it says the same."""
    if found is None or wanted is None or found == wanted:
        return found == wanted
    said = _loaded(found) if "/.z" in f"/{name}" else None
    return said is not None and said == _loaded(wanted)


def _few(names: list[str], most: int = 12) -> str:
    names = list(dict.fromkeys(names))
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _require_same(earlier: Mapping[str, str], now: Mapping[str, str]) -> None:
    if other := [name for name in {**now, **earlier} if earlier.get(name) != now.get(name)]:
        told = "; ".join(f"{name}: {earlier.get(name, 'nothing')}, now {now.get(name, 'nothing')}" for name in other)
        raise ValueError(f"store: expected the sweep that it was begun with, got another one. {told}")
