"""What all commands share: the application, where they print, and how a robot is named."""

from typing import TYPE_CHECKING

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
console = Console()


def robot_called(name: str, gravity: float = 9.81) -> "Arm":
    """The K-1607, a robot of example-robot-data, or a URDF file; gravity in m/s^2 downwards."""
    from k1607_pin.arm.load import load_example, load_k1607, load_urdf

    down = (0.0, 0.0, -gravity)
    if name == "k1607":
        return load_k1607(gravity=down)
    return load_urdf(name, gravity=down) if name.endswith(".urdf") else load_example(name, gravity=down)


def finite(x: object) -> object:
    """None for what JSON has no word for."""
    return None if isinstance(x, float) and not np.isfinite(x) else x


def is_own(error: Exception) -> bool:
    """Whether this package defines the error's class, so that its words are all that a user needs: `TracingError`, say."""
    package = __name__.partition(".")[0]
    return any(kind.__module__.partition(".")[0] == package for kind in type(error).__mro__)
