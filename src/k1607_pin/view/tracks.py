"""What moves and changes with time, as meshcat's viewer plays it."""

from typing import Any

import numpy as np
from meshcat.animation import AnimationClip, AnimationTrack
from meshcat.geometry import pack_numpy_array
from meshcat.path import Path

_DISCRETE = 2300  # three.js: THREE.InterpolateDiscrete


class Track(AnimationTrack):
    """One property of a node over time: as packed arrays, half the size of meshcat's own, and in steps if asked.

    Parameters
    ----------
    name : of the property, such as "position", in three.js's spelling.
    kind : "vector3", "quaternion", "number" or "bool".
    times : (K,) s, increasing, from 0 to the end of the motion: the viewer repeats each track after its last key.
    values : (K, ...) at these times, linear in between.
    steps : each value holds until the next key.
    """

    def __init__(self, name: str, kind: str, times: np.ndarray, values: np.ndarray, steps: bool = False) -> None:
        super().__init__(name, kind, np.asarray(times, dtype=float), np.asarray(values))
        self.steps = steps

    def lower(self) -> dict[str, Any]:
        """What meshcat sends."""
        whole = self.values.dtype == bool  # which the viewer knows no packed array of
        values = self.values.tolist() if whole else _packed(self.values)
        data = {"name": f".{self.name}", "type": self.jstype, "times": _packed(self.frames), "values": values}
        return {**data, "interpolation": _DISCRETE} if self.steps and not whole else data


def clip(*tracks: Track) -> AnimationClip:
    """All that changes of one node."""
    return AnimationClip({track.name: track for track in tracks}, fps=1)  # so that keys are in seconds


def object_path(viewer: Any) -> Path:
    """The thing drawn itself: the node above it is the viewer's to show and hide."""
    return viewer["<object>"].path


def _packed(x: np.ndarray) -> Any:
    return pack_numpy_array(np.ravel(x).astype(np.float32))["array"]
