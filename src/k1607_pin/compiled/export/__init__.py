"""Plain C99 of an arm and its control laws, for the robot: no dependency but libm, no allocation, a self-test that runs."""

import re
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from k1607_pin.arm.arm import Arm
from k1607_pin.compiled.export.arm import arm_functions
from k1607_pin.compiled.export.c import header, source
from k1607_pin.compiled.export.law import exported_law
from k1607_pin.compiled.export.selftest import selftest
from k1607_pin.compiled.export.words import described_arm, joints_of
from k1607_pin.files import write_atomically

CMAKE = """\
cmake_minimum_required(VERSION 3.10)
project({prefix} C)

if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  set(CMAKE_BUILD_TYPE Release)
endif()
set(CMAKE_C_STANDARD 99)
set(CMAKE_C_STANDARD_REQUIRED ON)
set(CMAKE_C_EXTENSIONS OFF)

add_library({prefix} STATIC {sources})
target_include_directories({prefix} PUBLIC ${{CMAKE_CURRENT_SOURCE_DIR}})
find_library(MATH_LIBRARY m)
if(MATH_LIBRARY)
  target_link_libraries({prefix} PUBLIC ${{MATH_LIBRARY}})
endif()

install(TARGETS {prefix} DESTINATION lib)
install(FILES {prefix}.h DESTINATION include)

if(CMAKE_SOURCE_DIR STREQUAL CMAKE_CURRENT_SOURCE_DIR)
  enable_testing()
  add_executable({prefix}_selftest {prefix}_selftest.c)
  target_link_libraries({prefix}_selftest {prefix})
  add_test(NAME {prefix}_selftest COMMAND {prefix}_selftest)
endif()
"""


def export(
    arm: Arm,
    folder: str | Path,
    controllers: Mapping[str, Any] | None = None,
    functions: Sequence[str] | None = None,
    prefix: str | None = None,
) -> list[Path]:
    """Write C of an arm's kinematics and dynamics, and of control laws, with its header, CMakeLists.txt and self-test.

    The header says what each function takes and gives. The self-test compares all of them with Pinocchio, and the laws with the
    controllers themselves, at random states.

    Parameters
    ----------
    folder : made if it is not there; an earlier export under the same ``prefix`` is replaced.
    controllers : name -> controller with ``initial(q, v)`` and ``update(t, q, v, state)``: becomes ``<prefix>_<name>_step`` and
        ``<prefix>_<name>_initial_state``. Its own numbers, its gains at the start and what it asks of its path are arguments; its
        options, such as a `Practice`, are part of the code.
    functions : some of `export_arm.FUNCTIONS`; None for all that the arm has.
    prefix : of all names; None for the arm's name.

    Returns
    -------
    The files written. The same arguments give the same bytes.

    Raises
    ------
    ValueError
        A name that is none in C or there twice, a function that there is not, a controller without ``initial``, a folder with
        files under the same names that are not of an export of this name.
    TracingError
        A controller that cannot be traced; the message says where.
    """
    prefix = re.sub(r"\W+", "_", arm.name).lower() if prefix is None else prefix
    controllers = controllers or {}
    _require_name("prefix", prefix)
    if prefix.lower() in C_HEADERS or prefix in TARGETS:
        raise ValueError(f"prefix: expected a name that is no header of C's and no target of CMake's, got {prefix!r}")
    for name in controllers:
        _require_name("controllers", name)
        if name.lower() == "selftest":
            raise ValueError("controllers: expected another name than that of the self-test, got 'selftest'")
    made = arm_functions(arm, functions)
    laws = [exported_law(arm, name, controller) for name, controller in controllers.items()]
    names = [f.name for f in made] + [f.name for law in laws for f in law.functions]
    if not names:
        raise ValueError("functions, controllers: expected at least one of either")
    if double := {name for name in names if names.count(name) > 1}:
        raise ValueError(f"functions, controllers: expected each name once, got {', '.join(sorted(double))} twice")
    about = [
        f"{arm.name}: {described_arm(arm)}",
        f"{WRITTEN} {version('k1607-pin')} with CasADi {version('casadi')}.",
        "",
        *joints_of(arm),
    ]
    sources = {f"{prefix}.c": source(prefix, made)} if made else {}
    sources |= {f"{prefix}_{law.name}.c": source(prefix, law.functions, law) for law in laws}
    texts = {
        f"{prefix}.h": header(prefix, about, made, laws),
        **sources,
        f"{prefix}_selftest.c": selftest(prefix, made, laws),
        "CMakeLists.txt": CMAKE.format(prefix=prefix, sources=" ".join(sources)),
    }
    texts = {name: f"{_mark(prefix, name)}\n{text}" for name, text in texts.items()}
    _clear(Path(folder), prefix, texts)
    return [write_atomically(Path(folder) / name, text) for name, text in texts.items()]


WRITTEN = "Written by k1607-pin"


def _mark(prefix: str, name: str) -> str:
    told = f"{WRITTEN}: {name} of {prefix}."
    return f"# {told}" if name == "CMakeLists.txt" else f"/* {told} Not to be edited: write it anew. */"


def _clear(folder: Path, prefix: str, texts: Mapping[str, str]) -> None:
    """Refuse to write over what is not of this robot's export, and take away what an earlier one has left."""
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"folder: expected a folder or none, got a file, {folder}")
    for name in texts:
        if (file := folder / name).exists() and not file.read_text(errors="replace").startswith(_mark(prefix, name)):
            raise ValueError(f"folder: expected none, or one with an export of {prefix!r}, got another's {file}")
    for file in folder.glob(f"{prefix}_*.c"):
        if file.name not in texts and file.read_text(errors="replace").startswith(_mark(prefix, file.name)):
            file.unlink()


C_HEADERS = (
    "assert", "complex", "ctype", "errno", "fenv", "float", "inttypes", "iso646", "limits", "locale", "math", "setjmp", "signal",
    "stdarg", "stdbool", "stddef", "stdint", "stdio", "stdlib", "string", "tgmath", "time", "wchar", "wctype",
    "features", "strings", "alloca", "endian", "memory", "malloc", "unistd", "pthread", "sched",
)  # fmt: skip
TARGETS = ("all", "clean", "help", "install", "package", "test", "edit_cache", "rebuild_cache")


def _require_name(argument: str, name: str) -> None:
    if not re.fullmatch(r"[a-zA-Z][a-zA-Z0-9_]*", name):
        raise ValueError(f"{argument}: expected a name of letters, digits and _ that C takes, got {name!r}")
