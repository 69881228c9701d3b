"""Show an arm: as a page in a file, in a notebook cell, or live in a browser."""

import html as markup
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import xarray as xr

from k1607_pin.arm.arm import Arm
from k1607_pin.files import write_atomically
from k1607_pin.simulation.wall import Wall
from k1607_pin.view.live import LiveWindow, require_address
from k1607_pin.view.motion import motion, pose
from k1607_pin.view.offline import Recorder
from k1607_pin.view.run import read_run, require_wall
from k1607_pin.view.scene import Scene

if TYPE_CHECKING:
    from IPython.display import HTML


def html(
    arm: Arm,
    times: Any = None,
    Q: Any = None,
    *,
    wall: Wall | None = None,
    frames: bool | None = None,
    title: str | None = None,
) -> str:
    """One self-contained HTML page with the arm in 3-D: no server, no network, for any browser of 2023 or later.

    Parameters
    ----------
    times : (N,) s, increasing; or a simulated run, the `xarray.Dataset` of `simulate` or of `SimulationError.log`, which brings
        its own angles, path, payload and contact force, see `Scene.play`; None for a single pose.
    Q : (N, n) rad, the motion at these times; or (n,) rad, the pose; None for the pose nearest to zero.
    wall : of the run, drawn with it.
    frames : show the base frame {0}, the joint frames and the tool frame; the page's own controls switch them too. None shows
        them unless a run is shown.
    title : of the page; None takes the robot's name.

    Raises
    ------
    ValueError
        Times not increasing or fewer than two, Q of another shape, numbers that are not finite; for a run, the same of its
        variables, none called ``q`` or ``time``, or a tool that is not where this arm has it; a wall that is none, or without
        a run.
    """
    require_wall(wall, times)
    window = Recorder()
    _draw(_scene(arm, window, times, frames), times, Q, wall)
    return window.page(title or arm.name)


def save_html(
    arm: Arm,
    path: str | os.PathLike[str],
    times: Any = None,
    Q: Any = None,
    *,
    wall: Wall | None = None,
    frames: bool | None = None,
    title: str | None = None,
) -> Path:
    """Write the page of `html` to ``path``, whole or not at all; returns the path. Errors as for `html`."""
    return write_atomically(path, html(arm, times, Q, wall=wall, frames=frames, title=title))


def notebook(
    arm: Arm,
    times: Any = None,
    Q: Any = None,
    *,
    wall: Wall | None = None,
    frames: bool | None = None,
    height: int = 480,
) -> "HTML":
    """The page of `html` in a notebook cell ``height`` pixels high; it stays in the saved notebook. Errors as there."""
    from IPython.display import HTML

    page = markup.escape(html(arm, times, Q, wall=wall, frames=frames))
    return HTML(f'<div><iframe srcdoc="{page}" style="width: 100%; height: {height}px; border: 0"></iframe></div>')


def show(
    arm: Arm,
    times: Any = None,
    Q: Any = None,
    *,
    wall: Wall | None = None,
    frames: bool | None = None,
    host: str = "127.0.0.1",
    port: int = 0,
) -> "LiveView":
    """Show the arm live, in any number of browsers at the ``url`` of what this returns.

    Parameters
    ----------
    times, Q, wall, frames : as for `html`.
    host : address to listen on; the default lets only this machine in.
    port : of the page; 0 takes a free one.

    Raises
    ------
    ValueError
        As for `html`; an empty host, which would mean every address of this machine; a port that is none.
    OSError
        The port is taken, or the address is not this machine's.
    """
    require_address(host, port)
    _check(arm, times, Q, wall)
    window = LiveWindow(host, port)
    try:
        view = LiveView(_scene(arm, window, times, frames), window)
        _draw(view.scene, times, Q, wall)
    except BaseException:
        window.close()
        raise
    return view


class LiveView:
    """An arm in the browser, until closed; also a context manager, and in a notebook it shows itself. Any thread may draw.

    Attributes
    ----------
    scene : the `Scene`; its ``viewer`` draws more.
    """

    def __init__(self, scene: Scene, window: LiveWindow) -> None:
        self.scene = scene
        self._window = window

    @property
    def url(self) -> str:
        """Address of the page."""
        return self._window.web_url

    def display(self, q: Any) -> None:
        """Show the arm at q (n,) rad."""
        self.scene.display(q)

    def play(self, times: Any, Q: Any = None, wall: Wall | None = None) -> None:
        """Play joint angles Q (N, n) rad at times (N,) s, or a run with its wall, in real time, over and over: `Scene.play`."""
        self.scene.play(times, Q, wall)

    def show_frames(self, visible: bool = True) -> None:
        """Show or hide the frames."""
        self.scene.show_frames(visible)

    def close(self) -> None:
        """Stop the server; twice does no harm."""
        self._window.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<LiveView of {self.scene.arm.name!r} at {self.url}>"

    def _repr_html_(self) -> str:
        url = markup.escape(self.url)
        return (
            f'<div><a href="{url}">{url}</a><br>'
            f'<iframe src="{url}" style="width: 100%; height: 480px; border: 0"></iframe></div>'
        )


def _scene(arm: Arm, window: Any, times: Any, frames: bool | None) -> Scene:
    # Around a run's tool the frames would hide what the run is shown for.
    return Scene(arm, window, not isinstance(times, xr.Dataset) if frames is None else frames)


def _check(arm: Arm, times: Any, Q: Any, wall: Wall | None) -> None:
    """Raise what drawing would raise, before a server is started for it."""
    require_wall(wall, times)
    if isinstance(times, xr.Dataset):
        read_run(arm, times, Q)
    elif times is None:
        pose(arm, Q)
    else:
        motion(arm, times, Q)


def _draw(scene: Scene, times: Any, Q: Any, wall: Wall | None) -> None:
    if times is None:
        q = pose(scene.arm, Q)
        scene.display(q)
        scene.fit_camera(q)
    else:
        scene.play(times, Q, wall)
