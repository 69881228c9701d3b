"""From C text to a loaded library: which compiler, how wide, and a cache that many processes may share."""

import atexit
import contextlib
import ctypes
import functools
import hashlib
import importlib.util
import logging
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from k1607_pin.compiled.loose import TRIAL, expanded, loose_option, tried
from k1607_pin.files import write_atomically

logger = logging.getLogger(__name__)
T = TypeVar("T")

FLAGS = (
    "-std=gnu11",
    "-O2",
    "-funroll-loops",
    "-fPIC",
    "-shared",
    "-ffp-contract=fast",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-Werror=implicit-function-declaration",
)
"""Not -ffast-math: with it, a check for NaN is compiled away. Not -O3: of some arms gcc makes three copies of a step, three times
as slow."""


class BuildError(RuntimeError):
    """The compiler refused; the message carries what it said."""


@dataclass(frozen=True)
class Compiler:
    """How to build for this machine."""

    command: tuple[str, ...]
    lanes: int
    """Doubles side by side"""
    instructions: str
    """What the width comes from: "AVX-512", "AVX2", "NEON", "plain" """
    version: str


WIDTHS = {"AVX-512": 8, "AVX2": 4, "NEON": 2, "plain": 2}
TARGETS = {
    "AVX-512": ("-march=native", "-mprefer-vector-width=512"),
    "AVX2": ("-mavx2", "-mfma"),
    "NEON": ("-mcpu=native",),
    "plain": (),
}


def instructions() -> str:
    """The widest that this processor has; the variable K1607_INSTRUCTIONS names less."""
    if asked := os.environ.get("K1607_INSTRUCTIONS"):
        if asked not in WIDTHS:
            raise ValueError(f"K1607_INSTRUCTIONS: expected one of {', '.join(WIDTHS)}, got {asked!r}")
        return asked
    machine = platform.machine().lower()
    if machine in ("arm64", "aarch64"):
        return "NEON"
    if machine in ("x86_64", "amd64"):
        flags = _cpu_flags()
        if {"avx512f", "avx512dq", "avx512vl"} <= flags:
            return "AVX-512"
        if {"avx2", "fma"} <= flags:
            return "AVX2"
    return "plain"


def _cpu_flags() -> set[str]:
    try:
        if sys.platform == "darwin":
            out = subprocess.run(
                ["sysctl", "-n", "machdep.cpu.features", "machdep.cpu.leaf7_features"], capture_output=True, text=True
            )
            return set(out.stdout.lower().replace("avx512f", "avx512f ").split())
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return set(next(line for line in lines if line.startswith("flags")).split(":")[1].split())
    except (OSError, StopIteration):
        return set()


@functools.cache
def compiler() -> Compiler | None:
    """The first that compiles: $CC (options and all), cc, gcc, clang, the ziglang package; None where there is none.

    A $CC that cannot be used is told by a warning in the log, with the reason and what is used instead: one that is not there,
    that cannot be parsed, that does not build, or whose options loosen the arithmetic, as -ffast-math does. CFLAGS is not read.
    The variable K1607_COMPILER=none hides all compilers.
    """
    if os.environ.get("K1607_COMPILER") == "none":
        return None
    try:
        made = _asked()
    except _RefusedError:
        made = None
    made = made or _found()
    if refused := refused_cc(made):
        logger.warning("%s", refused)
    return made


def refused_cc(made: Compiler | None) -> str:
    """Why $CC is not what is used, and what is; "" if it is, or is not set."""
    try:
        _asked()
    except _RefusedError as why:
        used = f"{made.command[0]} is used" if made else "no compiler is used"
        return f"CC={os.environ['CC']} cannot build for this machine: {why}; {used}"
    return ""


class _RefusedError(Exception):
    """Why a compiler is not used."""


def _asked() -> Compiler | None:
    """The compiler that $CC names; None where it is not set, or nothing but spaces."""
    try:
        name, *options = shlex.split(os.environ.get("CC", "")) or [""]
        options = list(expanded(options))
    except ValueError as error:
        raise _RefusedError(str(error)) from None
    if not name:
        return None
    if not (path := shutil.which(name)):
        raise _RefusedError(f"there is no {name}")
    if option := loose_option(options):
        raise _RefusedError(f"{option} loosens the arithmetic: a check for NaN may be gone, and small numbers zero")
    return _usable((os.path.abspath(path), *options))


def _found() -> Compiler | None:
    """The first of this machine's compilers that can be used."""
    for command in _commands():
        with contextlib.suppress(_RefusedError):
            return _usable(command)
    return None


def _commands() -> Iterator[tuple[str, ...]]:
    for name in ("cc", "gcc", "clang"):
        if path := shutil.which(name):
            yield (os.path.abspath(path),)
    if importlib.util.find_spec("ziglang"):
        yield sys.executable, "-m", "ziglang", "cc"


def _usable(command: tuple[str, ...]) -> Compiler:
    """As wide as it builds for this machine, with sound arithmetic."""
    wide, version = instructions(), _version(command)
    for kind in dict.fromkeys((wide, "plain")):
        made = Compiler((*command, *FLAGS, *TARGETS[kind]), WIDTHS[kind], kind, version)
        try:
            if why := _in_a_folder(TRIAL, made, _tried):
                raise _RefusedError(why)
            return made
        except (BuildError, OSError) as error:
            last = error
    raise _RefusedError(" ".join(str(last).split())[-300:])


def _tried(file: Path) -> str:
    """As `tried`; that it was is kept beside the library."""
    mark = file.with_name(f"{file.stem}-tried.sha256")
    checksum = _checksum(file)
    with contextlib.suppress(OSError):
        if mark.read_bytes() == checksum:
            return ""
    if not (why := tried(file)):
        write_atomically(mark, checksum)
    return why


def _version(command: tuple[str, ...]) -> str:
    try:
        return subprocess.run(
            [*command, "--version"], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60
        ).stdout.splitlines()[0]
    except (OSError, IndexError, ValueError, subprocess.TimeoutExpired):
        return "unknown"


def cache_folder() -> Path:
    """Where built libraries are kept: $K1607_CACHE, else k1607-pin in the user's cache folder."""
    if asked := os.environ.get("K1607_CACHE"):
        return Path(asked)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home())) / "k1607-pin"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "k1607-pin"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "k1607-pin"


def library(text: str, made: Compiler) -> ctypes.CDLL:
    """The library of a C text, built or from the cache.

    The name is a hash of text, compiler, and processor; it appears whole or not at all, so that processes may build at once, and
    is loaded only if its bytes are those that were built. Where the folder cannot be used, one is that ends with the process.
    """
    return _in_a_folder(text, made, lambda file: ctypes.CDLL(str(file)))


def _in_a_folder(text: str, made: Compiler, use: Callable[[Path], T]) -> T:
    """What ``use`` makes of the library: in the cache folder, or where that cannot be used, in one of this process."""
    key = "\0".join([text, *made.command, made.version, platform.machine(), " ".join(sorted(_cpu_flags()))])
    name = f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.so"
    try:
        return use(_built(text, made, cache_folder() / name))
    except OSError as error:
        _tell(f"libraries cannot be kept in {cache_folder()}: {error}; every process builds anew, or set K1607_CACHE")
        return use(_built(text, made, _folder_of_this_process() / name))


def _built(text: str, made: Compiler, file: Path) -> Path:
    if not _whole(file):
        _build(text, made, file)
    return file


def _whole(file: Path) -> bool:
    try:
        return file.with_suffix(".sha256").read_bytes() == _checksum(file)
    except OSError:
        return False


def _checksum(file: Path) -> bytes:
    """Of its bytes and its name, so that no other's will do."""
    return hashlib.sha256(f"{file.stem}\0".encode() + file.read_bytes()).hexdigest().encode()


def _build(text: str, made: Compiler, file: Path) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    for left in file.parent.glob(f"{BUILDING}*"):
        with contextlib.suppress(OSError):
            if time.time() - left.stat().st_mtime > ABANDONED:
                shutil.rmtree(left, ignore_errors=True)
    with tempfile.TemporaryDirectory(dir=file.parent, prefix=BUILDING) as folder:
        (Path(folder) / "kernel.c").write_text(text)
        command = [*made.command, "kernel.c", "-o", "kernel.so", "-lm"]
        try:
            done = subprocess.run(
                command, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace"
            )
        except OSError as error:
            raise BuildError(f"{' '.join(command)}: {error.strerror or error}") from None
        if done.returncode:
            raise BuildError(f"{' '.join(command)}: {done.stderr.strip()[-2000:]}")
        built = Path(folder) / "kernel.so"
        if not built.is_file():
            raise BuildError(f"{' '.join(command)}: nothing was built. {done.stderr.strip()[-2000:]}")
        content = built.read_bytes()
    write_atomically(file, content)
    write_atomically(file.with_suffix(".sha256"), _checksum(file))


BUILDING, ABANDONED = "building-", 3600.0
"""Prefix of folders that are built in; s after which one was left by a process that was killed"""


@functools.cache
def _folder_of_this_process() -> Path:
    folder = tempfile.mkdtemp(prefix="k1607-pin-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


@functools.cache
def _tell(what: str) -> None:
    """A warning, once."""
    logger.warning(what)
