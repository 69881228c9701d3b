"""Files written whole or not at all."""

import hashlib
import json
import os
import re
import tempfile
from pathlib import Path
from typing import Any

LEFT = re.compile(r"\.(.+)\.[a-z0-9_]{8}")
"""Name of a file that is being written, and within it the name that it will have"""


def plain_name(name: str, what: str = "name") -> str:
    """``name`` if it can name a file in a given folder, and nothing elsewhere.

    Raises
    ------
    ValueError
        Separators, dots in front, characters that do not print, nothing or too much; ``what`` says whose name it is.
    """
    if (
        not name.isprintable()
        or not name.strip()
        or name[0] == "."
        or set(name) & set('/\\:*?"<>|')
        or len(name.encode()) > 200
    ):
        raise ValueError(
            f"{what}: expected a name that can be a file's, without / and \\ and dots in front, got {name!r}"
        )
    return name


def checksum(told: Any) -> str:
    """SHA-256 of what JSON can hold, however it is laid out in a file."""
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def write_atomically(path: str | os.PathLike[str], content: str | bytes, durable: bool = True) -> Path:
    """Write ``content`` to ``path``, parents made as needed; a reader sees the old file or the new one, never a part.

    A loss of power may leave a part where it is not ``durable``, which is faster: for what is checked when it is read.
    A process that is killed may leave a file called as `LEFT` says.
    """
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    data = content.encode() if isinstance(content, str) else content
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            if durable:
                os.fsync(file.fileno())  # else a crash may leave the new name with none of the content
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(name, 0o666 & ~umask)  # mkstemp makes it private; give it what open() would
        os.replace(name, target)
    except BaseException:
        os.unlink(name)
        raise
    return target
