"""The arm in 3-D."""

import threading
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from k1607_pin.cli.app import console, robot_called

if TYPE_CHECKING:
    pass


def view(
    robot: Annotated[
        str, typer.Option(help="k1607, a robot of example-robot-data such as panda, or a URDF file.")
    ] = "k1607",
    html: Annotated[
        Path | None, typer.Option(help="Write one self-contained page to this file, and no server.")
    ] = None,
    pose: Annotated[
        str | None, typer.Option(help="Joint angles in degrees, comma-separated; each joint in turn when left out.")
    ] = None,
    frames: Annotated[bool, typer.Option(help="Show the frames.")] = True,
    host: Annotated[
        str, typer.Option(help="Address to serve on; the default lets only this machine in.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port of the page; 0 takes a free one.")] = 0,
) -> None:
    """Show an arm in 3-D: live in the browser, or as a page that opens offline.

    \b
    Examples:
        k1607 view --html k1607.html
        k1607 view --robot panda
        k1607 view --pose 20,-30,10,80,0,60,0
    """
    from k1607_pin import view as viewer
    from k1607_pin.view.demo import each_joint_in_turn

    arm = robot_called(robot)
    times, Q = each_joint_in_turn(arm) if pose is None else (None, _degrees(pose))
    if html is not None:
        path = viewer.save_html(arm, html, times, Q, frames=frames)
        console.print(f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB): open it in any browser", highlight=False)
        return
    with viewer.show(arm, times, Q, frames=frames, host=host, port=port) as live, suppress(KeyboardInterrupt):
        console.print(f"{arm.name} at {live.url} - press Ctrl-C to stop", highlight=False)
        threading.Event().wait()


def _degrees(text: str) -> np.ndarray:
    try:
        return np.deg2rad([float(x) for x in text.split(",")])
    except ValueError:
        raise ValueError(f"--pose: expected numbers in degrees such as 20,-30,10,80,0,60,0, got {text!r}") from None
