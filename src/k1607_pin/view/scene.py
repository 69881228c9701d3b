"""`Scene`: an arm in a meshcat window, drawn through Pinocchio's MeshcatVisualizer."""

import functools
import threading
from collections.abc import Callable
from typing import Any, ParamSpec

import meshcat
import meshcat.geometry as mg
import numpy as np
import pinocchio as pin
import xarray as xr
from meshcat.animation import Animation
from meshcat.path import Path
from pinocchio.visualize import MeshcatVisualizer

from k1607_pin.arm.arm import Arm, frame_id
from k1607_pin.simulation.wall import Wall
from k1607_pin.view import camera, traces
from k1607_pin.view.collada_mesh import collada_mesh
from k1607_pin.view.motion import keyframes, motion, pose
from k1607_pin.view.run import Run, read_run, require_wall
from k1607_pin.view.tracks import Track, clip
from k1607_pin.view.triads import Label, triad

P = ParamSpec("P")
_CAMERA = "/Cameras/default/rotated"
_LEGEND = f"{_CAMERA}/<object>/legend"  # carried by the camera
_LIGHTS = {"AmbientLight": 0.5, "PointLightPositiveX": 0.4, "PointLightNegativeX": 0.4, "FillLight": 0.2}
_CELL = 0.25  # m, of the grid on the floor
_DIRECTIONS = np.array(
    [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)], dtype=float
).T  # (3, 27)
_MAX_FITTED = 100  # poses of a motion that the camera is fitted to


def _in_turn(method: Callable[P, None]) -> Callable[P, None]:
    """Of several threads one after the other: what is drawn is computed in places that all share."""

    @functools.wraps(method)
    def taken(*arguments: P.args, **named: P.kwargs) -> None:
        scene: Any = arguments[0]
        with scene._turn:
            method(*arguments, **named)

    return taken


class _Visualizer(MeshcatVisualizer):
    """Pinocchio's, but for COLLADA files."""

    def loadMeshFromFile(self, geometry_object: pin.GeometryObject) -> Any:
        if geometry_object.meshPath.lower().endswith(".dae") and not geometry_object.overrideMaterial:
            return collada_mesh(geometry_object.meshPath)
        return super().loadMeshFromFile(geometry_object)


class Scene:
    """An arm, its frames, floor, light and camera in any meshcat window.

    Parameters
    ----------
    arm : what to show; without visual geometry only its frames are seen.
    window : a `LiveWindow` or a `Recorder`.
    frames : show the base frame {0}, the joint frames {1} to {n} and the tool frame, x red, y green, z blue.

    Attributes
    ----------
    viewer : the `meshcat.Visualizer`, to draw more with, in metres in the arm's base frame.
    """

    def __init__(self, arm: Arm, window: Any, frames: bool = True) -> None:
        self.arm = arm
        self.viewer = meshcat.Visualizer(window=window)
        self._model, self._visual = arm.model, arm.visual_model or pin.GeometryModel()
        self._turn = threading.RLock()
        self._visualizer = _Visualizer(self._model, None, self._visual)
        self._visualizer.initViewer(viewer=self.viewer)
        self._visualizer.loadViewerModel(rootNodeName="arm")
        self._frames = self._tracked_frames()
        self._outlines = [_outline(part.geometry) for part in self._visual.geometryObjects]
        self._size = float(np.ptp(self._extent(pose(arm)), axis=0).max()) or 1.0  # m
        self._animated = False
        self._set_stage()
        self._draw_frames()
        self.show_frames(frames)

    # What it shows

    @_in_turn
    def display(self, q: Any = None) -> None:
        """Show the arm at q (n,) rad; a motion or run that plays ends. ValueError for another shape, or not finite."""
        q = pose(self.arm, q)
        if self._animated:
            self.viewer.set_animation(Animation(), play=False)
            self.viewer["run"].delete()
            self.viewer[_LEGEND].delete()
            self._animated = False
        self._visualizer.display(q)
        for path, placement in zip(self._frame_paths(), self._frame_placements(q), strict=True):
            self.viewer[path].set_transform(placement.homogeneous)

    @_in_turn
    def play(self, times: Any, Q: Any = None, wall: Wall | None = None) -> None:
        """Play joint angles Q (N, n) rad at times (N,) s, in real time, over and over; the viewer's slider seeks.

        The slider counts from the first of the times. Between two times the angles are linear.

        Parameters
        ----------
        times : (N,) s; or a run, the `xarray.Dataset` of `simulate`, without Q: then the tool's path is drawn as it comes about,
            the wanted one dashed, the payload as a ball at the tool, as long as it is carried and as large as its mass, and its
            ``contact_force`` as an arrow that ends at the tool, as long as the force is large: the largest in each of the
            viewer's frames, and a peak far above the rest cut short, see `contact.full_scale`.
        wall : of the run, drawn as a translucent square around where the tool is opposite to it.

        Raises
        ------
        ValueError
            Times not increasing, fewer than two, wrong shape, not finite; for a run, as `read_run`; a wall without a run.
        """
        require_wall(wall, times)
        run = read_run(self.arm, times, Q, wall) if isinstance(times, xr.Dataset) else None
        times, Q = motion(self.arm, times, Q) if run is None else (run.times, run.Q)
        self.display(Q[0])
        seconds, Q = keyframes(times, Q)
        animation = Animation()
        for path, values in self._paths_of_motion(Q):
            placed = Track("position", "vector3", seconds, values[:, :3])
            animation.clips[path] = clip(placed, Track("quaternion", "quaternion", seconds, values[:, 3:]))
        if run is None:
            self.fit_camera(Q)
        else:
            animation.clips |= self._draw_run(run, seconds, Q)
        self.viewer.set_animation(animation, play=True, repetitions=float("inf"))
        self._animated = True

    @_in_turn
    def show_frames(self, visible: bool = True) -> None:
        """Show or hide the frames; so does the box "frames" in the viewer's own controls."""
        self.viewer["frames"].set_property("visible", bool(visible))

    @_in_turn
    def fit_camera(self, Q: Any, points: Any = None, margin: float = camera.MARGIN) -> None:
        """Place the camera so that the arm is wholly seen in each pose of Q (N, n) rad, and so are points (K, 3) m, if given.

        margin : how much larger than that the picture is, as a factor.
        """
        Q = np.atleast_2d(Q)
        chosen = Q[np.unique(np.linspace(0, len(Q) - 1, _MAX_FITTED).astype(int))]
        more = np.empty((0, 3)) if points is None else points
        points = np.vstack([*(self._extent(q) for q in chosen), more])
        centre, eye = camera.fit(points, margin)
        # The viewer turns about the origin of the world: the arm moves there, not the camera away from it.
        shift = np.eye(4)
        shift[:3, 3] = -centre
        self.viewer.set_transform(shift)
        floor = shift.copy()
        floor[2, 3] += points[:, 2].min()
        self.viewer["/Grid"].set_transform(floor)
        x, y, z = eye - centre
        self.viewer[f"{_CAMERA}/<object>"].set_property("position", [x, z, -y])  # the camera's own axes have y up

    # How it is drawn

    def _set_stage(self) -> None:
        self.viewer["/Background"].set_property("top_color", [0.97, 0.98, 1.0])
        self.viewer["/Background"].set_property("bottom_color", [0.80, 0.84, 0.89])
        self.viewer["/Axes"].set_property("visible", False)  # frame {0} is ours
        for light, strength in _LIGHTS.items():
            self.viewer[f"/Lights/{light}/<object>"].set_property("intensity", strength)
        self.viewer["/Grid"].set_object(_grid(self._size))
        self.viewer[_CAMERA].set_object(mg.PerspectiveCamera(fov=camera.FIELD_OF_VIEW, near=0.01, far=200.0))

    def _tracked_frames(self) -> list[tuple[str, int, pin.SE3]]:
        """Label, joint and placement in the joint's frame of each frame shown."""
        n = self.arm.n
        tracked = [(f"{{{i}}}", i, pin.SE3.Identity()) for i in range(n + 1)]
        tool = self._model.frames[frame_id(self._model, self.arm.tool_frame)]
        if tool.parentJoint == n and not tool.placement.isIdentity(1e-9):
            tracked.append(("tool", n, tool.placement))
        return tracked

    def _frame_paths(self) -> list[str]:
        return [f"frames/{label.strip('{}')}" for label, _, _ in self._frames]

    def _frame_placements(self, q: np.ndarray) -> list[pin.SE3]:
        data = self._visualizer.data
        pin.forwardKinematics(self._model, data, q)
        return [data.oMi[joint] * placement for _, joint, placement in self._frames]

    def _draw_frames(self) -> None:
        length = 0.08 * self._size
        for k, (path, (label, joint, _)) in enumerate(zip(self._frame_paths(), self._frames, strict=True)):
            size = 1.35 * length if joint == 0 else length  # {0} and {1} coincide when joint 1 is at zero
            self.viewer[path]["axes"].set_object(triad(size))
            # At the tips of x, z, y in turn: consecutive frames share an axis, and often their origin.
            tip = np.roll([1.2 * size, 0.0, 0.0], -k)
            self.viewer[path]["label"].set_object(Label(label, 0.4 * length, tip))

    def _draw_run(self, run: Run, seconds: np.ndarray, Q: np.ndarray) -> dict[Path, Any]:
        """Draw what a run has beside the arm, shown at seconds (M,) in poses Q (M, n); returns how it changes."""
        tool = self.arm.forward_kinematics(Q)[:, :3, 3]
        clips = traces.draw(self.viewer["run"], run, seconds, tool, self._size)
        self.viewer[_LEGEND].set_object(traces.legend(run, camera.half_height(1.0)))
        self.fit_camera(Q, traces.extent(run, seconds, tool, self._size), camera.MARGIN_WITH_LEGEND)
        return clips

    def _extent(self, q: np.ndarray) -> np.ndarray:
        """(N, 3) m: points that bound the arm at q."""
        origins = np.array([placement.translation for placement in self._frame_placements(q)])
        placed = self._visualizer.visual_data
        pin.updateGeometryPlacements(self._model, self._visualizer.data, self._visual, placed)
        boxes = [
            points @ placed.oMg[i].rotation.T + placed.oMg[i].translation for i, points in enumerate(self._outlines)
        ]
        return np.vstack([origins, *boxes])

    def _paths_of_motion(self, Q: np.ndarray) -> list[tuple[Path, np.ndarray]]:
        """What moves, and how: (M, 7) of x, y, z [m] and the quaternion, scalar last, as three.js has it."""
        parts = [(i, part) for i, part in enumerate(self._visual.geometryObjects) if part.parentJoint > 0]
        frames = [k for k, (_, joint, _) in enumerate(self._frames) if joint > 0]
        values = np.empty((len(Q), len(parts) + len(frames), 7))
        for row, q in zip(values, Q, strict=True):
            placements = self._frame_placements(q)
            pin.updateGeometryPlacements(self._model, self._visualizer.data, self._visual, self._visualizer.visual_data)
            placed = [self._visualizer.visual_data.oMg[i] for i, _ in parts] + [placements[k] for k in frames]
            row[:] = [pin.SE3ToXYZQUAT(placement) for placement in placed]
        names = [self._visualizer.getViewerNodeName(part, pin.GeometryType.VISUAL) for _, part in parts]
        names += [self._frame_paths()[k] for k in frames]
        return [(self.viewer[name].path, values[:, k]) for k, name in enumerate(names)]


def _outline(geometry: Any) -> np.ndarray:
    """(N, 3) m: few points of a geometry, in its own frame, that bound it nearly as well as all."""
    if hasattr(geometry, "vertices"):
        points = geometry.vertices()
        return points[np.unique(np.argmax(points @ _DIRECTIONS, axis=0))]
    geometry.computeLocalAABB()
    box = geometry.aabb_local
    return box.center() + np.where(_DIRECTIONS[:, np.all(_DIRECTIONS, axis=0)].T > 0, 0.5, -0.5) * (box.max_ - box.min_)


def _grid(size: float) -> mg.LineSegments:
    """Lines on the floor, centred on the base, for an arm of that size [m]."""
    side = _CELL * np.ceil(1.5 * size / _CELL)
    ticks = np.arange(-side, side + _CELL / 2, _CELL)
    along_x = np.array([[[-side, t, 0.0], [side, t, 0.0]] for t in ticks]).reshape(-1, 3)
    points = np.vstack([along_x, along_x[:, [1, 0, 2]]])
    return mg.LineSegments(mg.PointsGeometry(points.T.astype(np.float32)), mg.LineBasicMaterial(color=0xAAB4BF))
