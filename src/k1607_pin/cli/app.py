"""What all commands share: the application, where they print, and how a robot is named."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from rich.console import Console

if TYPE_CHECKING:
    from k1607_pin.arm.arm import Arm

app = typer.Typer(
    help="The K-1607 and its 1990 NASA/CUA report, made to run.\n\nExample: k1607 equations",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # square brackets in the examples are TOML, not markup
)
console = Console(emoji=False)  # :b: in what is told is no picture


Robot = Annotated[str, typer.Option(help="k1607, a robot of example-robot-data such as panda, or a URDF file.")]
ToolFrame = Annotated[
    str | None, typer.Option("--tool-frame", help="Link that is the tool; the end of the longest chain when left out.")
]
Lock = Annotated[
    list[str] | None,
    typer.Option(
        "--lock",
        help="Joint to hold still, as near to zero as it can be, or at a value: NAME, NAME=30deg, NAME=20mm. Repeat.",
    ),
]


def robot_called(
    name: str, gravity: float = 9.81, tool_frame: str | None = None, lock: list[str] | None = None
) -> "Arm":
    """The K-1607, a robot of example-robot-data, or a URDF file; gravity in m/s^2 downwards.

    tool_frame : None for the loader's choice; lock : as written after ``--lock``.
    """
    from k1607_pin.arm.load import load_example, load_k1607, load_urdf

    down = (0.0, 0.0, -gravity)
    locked = [_locked(text) for text in lock or ()]
    if name == "k1607":
        return load_k1607(tool_frame or "tool", gravity=down, locked=locked)
    load = load_urdf if name.endswith((".urdf", ".xml")) or Path(name).is_file() else load_example
    return load(name, tool_frame, locked, gravity=down)


def _locked(text: str) -> str | tuple[str, float]:
    """What "NAME" or "NAME=30deg" locks: name, and value [rad, m]."""
    from k1607_pin.description.units import ANGLE, LENGTH

    name, equals, value = text.partition("=")
    if not equals:
        return name
    number = value.rstrip("abcdefghijklmnopqrstuvwxyz")
    factor = (ANGLE | LENGTH).get(value[len(number) :])
    try:
        if factor is None:
            raise ValueError
        return name, float(number) * factor
    except ValueError:
        raise ValueError(
            f"--lock: expected NAME, or NAME=VALUE with a unit ({', '.join(ANGLE | LENGTH)}) such as {name}=30deg, got {text!r}"
        ) from None


def finite(x: object) -> object:
    """None for what JSON has no word for."""
    return None if isinstance(x, float) and not np.isfinite(x) else x


def is_own(error: Exception) -> bool:
    """Whether this package defines the error's class, so that its words are all that a user needs: `TracingError`, say."""
    package = __name__.partition(".")[0]
    return any(kind.__module__.partition(".")[0] == package for kind in type(error).__mro__)
