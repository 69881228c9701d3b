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
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from k1607_pin.files import write_atomically

logger = logging.getLogger(__name__)

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

    The variable K1607_COMPILER=none hides them all.
    """
    if os.environ.get("K1607_COMPILER") == "none":
        return None
    wide = instructions()
    for command in _commands():
        for kind in (wide, "plain"):
            made = Compiler((*command, *FLAGS, *TARGETS[kind]), WIDTHS[kind], kind, _version(command))
            if _works(made):
                if refused := refused_cc(made):
                    logger.warning("%s", refused)
                return made
    return None


def _commands() -> Iterator[tuple[str, ...]]:
    for name, *options in (shlex.split(os.environ.get("CC") or "cc"), ["cc"], ["gcc"], ["clang"]):
        if path := shutil.which(name):
            yield path, *options
    if importlib.util.find_spec("ziglang"):
        yield sys.executable, "-m", "ziglang", "cc"


def refused_cc(made: Compiler) -> str:
    """That another compiler than $CC is used, if one is."""
    asked = shlex.split(os.environ.get("CC", ""))
    if not asked or made.command[0] == shutil.which(asked[0]):
        return ""
    return f"CC={os.environ['CC']} cannot build for this machine: {made.command[0]} is used"


def _version(command: tuple[str, ...]) -> str:
    try:
        return subprocess.run([*command, "--version"], capture_output=True, text=True, timeout=60).stdout.splitlines()[
            0
        ]
    except (OSError, IndexError, subprocess.TimeoutExpired):
        return "unknown"


def _works(made: Compiler) -> bool:
    try:
        found = library(f"#define W {made.lanes}\ndouble twice(double x) {{ return 2 * x; }}\n", made).twice
    except (BuildError, OSError):
        return False
    found.restype, found.argtypes = ctypes.c_double, [ctypes.c_double]
    return bool(found(1.5) == 3.0)


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
    key = "\0".join([text, *made.command, made.version, platform.machine(), " ".join(sorted(_cpu_flags()))])
    name = hashlib.sha256(key.encode()).hexdigest()[:32]
    try:
        return _loaded(text, made, cache_folder() / f"{name}.so")
    except OSError as error:
        _tell(f"libraries cannot be kept in {cache_folder()}: {error}; every process builds anew, or set K1607_CACHE")
        return _loaded(text, made, _folder_of_this_process() / f"{name}.so")


def _loaded(text: str, made: Compiler, file: Path) -> ctypes.CDLL:
    if not _whole(file):
        _build(text, made, file)
    return ctypes.CDLL(str(file))


def _whole(file: Path) -> bool:
    try:
        return file.with_suffix(".sha256").read_text() == hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError:
        return False


def _build(text: str, made: Compiler, file: Path) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    for left in file.parent.glob(f"{BUILDING}*"):
        with contextlib.suppress(OSError):
            if time.time() - left.stat().st_mtime > ABANDONED:
                shutil.rmtree(left, ignore_errors=True)
    with tempfile.TemporaryDirectory(dir=file.parent, prefix=BUILDING) as folder:
        (Path(folder) / "kernel.c").write_text(text)
        command = [*made.command, "kernel.c", "-o", "kernel.so", "-lm"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        if done.returncode:
            raise BuildError(f"{' '.join(command)}: {done.stderr.strip()[-2000:]}")
        built = (Path(folder) / "kernel.so").read_bytes()
    write_atomically(file, built)
    write_atomically(file.with_suffix(".sha256"), hashlib.sha256(built).hexdigest())


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
