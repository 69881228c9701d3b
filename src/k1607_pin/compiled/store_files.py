"""The files of a store, by their names within it: in a folder, or wherever a URL that fsspec understands leads."""

import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit
from urllib.request import url2pathname

from k1607_pin.files import LEFT, write_atomically

ABANDONED = 3600.0
"""s after which a file or folder that is being made was left by a process that was killed"""


class Files(Protocol):
    """Whole files: a reader sees an old one or a new one, or none."""

    def read(self, name: str) -> bytes | None:
        """Its content; None where there is none."""

    def write(self, name: str, content: bytes) -> None:
        """In place of what was there."""

    def names(self) -> Iterator[str]:
        """Of all files."""

    def opened(self) -> Any:
        """What xarray opens."""


class Folder:
    """Files below a folder, which need not be there yet."""

    def __init__(self, path: Path) -> None:
        if path.exists() and not path.is_dir():
            raise ValueError(f"store: expected a folder, got a file, {path}")
        self.path = path

    def read(self, name: str) -> bytes | None:
        """See `Files`."""
        try:
            return (self.path / name).read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            raise ValueError(f"store: cannot read {self.path / name}: {error.strerror or error}") from error

    def write(self, name: str, content: bytes) -> None:
        """See `Files`."""
        write_atomically(self.path / name, content, durable=False)

    def names(self) -> Iterator[str]:
        """See `Files`; without those that are being written, and the folders' own."""
        for file in self.path.rglob("*"):
            if not file.is_dir() and not LEFT.fullmatch(file.name):
                yield file.relative_to(self.path).as_posix()

    def opened(self) -> str:
        """See `Files`."""
        return str(self.path)

    def clear(self, is_ours: Callable[[str], bool]) -> None:
        """Take away what a process that was killed while it wrote has left of the files that are ours."""
        for file in self.path.rglob(".*"):
            named = LEFT.fullmatch(file.name)
            if named and is_ours(file.with_name(named[1]).relative_to(self.path).as_posix()) and _is_abandoned(file):
                file.unlink(missing_ok=True)


class Remote:
    """Files behind a URL."""

    def __init__(self, url: str) -> None:
        try:
            import fsspec

            self._map, self._url = fsspec.get_mapper(url), url
        except (ImportError, ValueError) as error:  # no fsspec, none that knows the protocol, or not what it is made of
            raise ValueError(
                f"store: expected a folder, or a URL that fsspec understands, got {url!r}: {error}"
            ) from None

    def read(self, name: str) -> bytes | None:
        """See `Files`."""
        found = self._map.get(name)
        return None if found is None else bytes(found)

    def write(self, name: str, content: bytes) -> None:
        """See `Files`."""
        self._map[name] = content

    def names(self) -> Iterator[str]:
        """See `Files`."""
        yield from self._map

    def opened(self) -> Any:
        """See `Files`."""
        from zarr.storage import FsspecStore

        return FsspecStore.from_mapper(self._map)


def files_of(store: str) -> Folder | Remote:
    """Those of a folder, of a URL "file:///...", or of another URL.

    Raises
    ------
    ValueError
        A file, a URL of another machine's files, one that nothing here understands.
    """
    if store.lower().startswith("file:"):
        parts = urlsplit(store)
        if parts.netloc not in ("", "localhost") or not parts.path.startswith("/") or parts.query or parts.fragment:
            raise ValueError(f"store: expected file:///folder, with all of its path, got {store!r}; or give the folder")
        return Folder(Path(url2pathname(parts.path)))
    return Remote(store) if "://" in store else Folder(Path(store))


def made_whole(folder: Path, content: dict[str, bytes]) -> bool:
    """Make a new folder of files, all of it or nothing; False if it has appeared meanwhile."""
    import tempfile

    folder.parent.mkdir(parents=True, exist_ok=True)
    for left in folder.parent.glob(f".{folder.name}.*{MAKING}"):
        if LEFT.fullmatch(left.name.removesuffix(MAKING)) and _is_abandoned(left):
            shutil.rmtree(left, ignore_errors=True)
    with tempfile.TemporaryDirectory(MAKING, f".{folder.name}.", folder.parent) as beside:
        made = Folder(Path(beside) / folder.name)
        for name, x in content.items():
            made.write(name, x)
        try:
            made.path.replace(folder)
        except OSError:
            if not folder.is_dir():
                raise
            return False
    return True


MAKING = ".making"
"""End of the name of a store's folder while it is made"""


def _is_abandoned(path: Path) -> bool:
    try:
        return time.time() - path.stat().st_mtime > ABANDONED
    except OSError:  # gone meanwhile
        return False
