"""Arms from files: the K-1607, any URDF, and the robots of example-robot-data."""

import logging
from collections.abc import Iterable, Mapping
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from k1607_pin import data
from k1607_pin.arm.arm import Arm, frame_id
from k1607_pin.arm.continuous import with_one_angle_each
from k1607_pin.description.dh import exact

logger = logging.getLogger(__name__)

TOOL_FRAMES = {
    "kinova": "j2s6s200_link_6",
    "panda": "panda_hand_tcp",
    "ur3": "tool0",
    "ur5": "tool0",
    "ur10": "tool0",
    "xarm7": "link_eef",
    "z1": "gripperStator",
}
"""Tool frames of well-known robots of example-robot-data."""


def k1607_urdf() -> Path:
    """Where the K-1607's URDF lies: in the package once installed, in ``urdf/`` in a checkout."""
    packaged = Path(str(files("k1607_pin.data"))) / "k1607.urdf"
    return packaged if packaged.exists() else Path(__file__).parents[3] / "urdf" / "k1607.urdf"


def load_k1607(
    tool_frame: str = "tool",
    armature: np.ndarray | None = None,
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81),
) -> Arm:
    """The Robotics Research K-1607.

    Parameters
    ----------
    tool_frame : "tool" is the report's frame {7}; "tool_plate" lies 6.600 in further along z7.
    armature : (n,) kg m^2 reflected rotor inertia; None takes the assumed values of ``data/k1607.toml``.
    gravity : (3,) m/s^2 in the base frame; (0, 0, 0) for orbit.
    """
    if armature is None:
        armature = np.array(data.load("k1607")["armature"]["inertia_kg_m2"])
    return load_urdf(k1607_urdf(), tool_frame, armature=armature, gravity=gravity)


def load_urdf(
    path: str | Path,
    tool_frame: str | None = None,
    locked: Iterable[str] | Mapping[str, float] = (),
    armature: np.ndarray | None = None,
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81),
    package_dirs: Iterable[str | Path] = (),
) -> Arm:
    """The fixed-base arm of a URDF file.

    Parameters
    ----------
    tool_frame : a link or joint name; None takes the last link, if the arm has but one end.
    locked : joints to hold still, at zero or at the given angle [rad]. Joints that do not carry the tool frame
        (a gripper's fingers) are locked at zero unasked, or at the limit nearest to it.
    armature : (n,) kg m^2; None keeps the model's own, zero unless the file says otherwise.
    gravity : (3,) m/s^2 in the base frame.
    package_dirs : where ``package://`` meshes are looked for; the file's folder is always.

    Raises
    ------
    ValueError
        No such file, not a URDF, no such frame or joint, several ends and no tool_frame, a joint that mimics another,
        or not a serial chain of one-degree-of-freedom joints. Meshes that are not found are a warning in the log.
    """
    path = Path(path)
    if not path.is_file():
        raise ValueError(f"path: no URDF file {path}")
    folders = [str(path.parent), *(str(folder) for folder in package_dirs)]
    try:
        model = pin.buildModelFromUrdf(str(path))
        mimics = [
            joint.get("name", "") for joint in ElementTree.parse(path).iter("joint") if joint.find("mimic") is not None
        ]
    except (ValueError, RuntimeError, ElementTree.ParseError) as error:
        raise ValueError(f"path: Pinocchio cannot read {path}: {error}") from error
    try:
        visual = pin.buildGeomFromUrdf(model, str(path), pin.VISUAL, package_dirs=folders)
        collision = pin.buildGeomFromUrdf(model, str(path), pin.COLLISION, package_dirs=folders)
    except (ValueError, RuntimeError) as error:
        logger.warning("%s is loaded without geometry: %s. Are its packages in package_dirs?", path, error)
        visual = collision = pin.GeometryModel()
    arm = _arm(model, visual, collision, tool_frame, locked, armature, gravity)
    if moving := [name for name in mimics if name in arm.joint_names]:
        raise ValueError(f"joint {moving[0]!r} mimics another one: lock it, as an arm's joints must move on their own")
    return arm


def load_example(
    name: str,
    tool_frame: str | None = None,
    locked: Iterable[str] | Mapping[str, float] = (),
    armature: np.ndarray | None = None,
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81),
) -> Arm:
    """A robot of example-robot-data ("panda", "ur5", "xarm7", ...); arguments and errors as for `load_urdf`."""
    import example_robot_data
    from example_robot_data.robots_loader import ROBOTS

    if name not in ROBOTS:
        raise ValueError(f"name: no robot {name!r} in example-robot-data, expected one of {', '.join(sorted(ROBOTS))}")
    robot = example_robot_data.load(name)
    frame = tool_frame or TOOL_FRAMES.get(name)
    return _arm(robot.model, robot.visual_model, robot.collision_model, frame, locked, armature, gravity)


def _arm(
    model: pin.Model,
    visual: pin.GeometryModel,
    collision: pin.GeometryModel,
    tool_frame: str | None,
    locked: Iterable[str] | Mapping[str, float],
    armature: np.ndarray | None,
    gravity: tuple[float, float, float],
) -> Arm:
    if model.njoints > 1 and model.joints[1].nv == 6:
        raise ValueError(
            f"{model.name!r}, joint {model.names[1]!r}: expected a fixed base, got {model.joints[1].shortname()}"
        )
    ends = [model.names[i] for i in range(1, model.njoints) if i not in list(model.parents)]
    if tool_frame is None and len(ends) > 1:
        raise ValueError(
            f"tool_frame: {model.name!r} has several ends (joints {', '.join(ends)}): say which frame is the tool"
        )
    tool_frame = tool_frame or model.frames[model.nframes - 1].name
    angles = dict(locked) if isinstance(locked, Mapping) else dict.fromkeys(locked, 0.0)
    if unknown := [joint for joint in angles if not model.existJointName(joint)]:
        raise ValueError(
            f"locked: no joint {unknown[0]!r} in {model.name!r}, expected among {', '.join(model.names[1:])}"
        )
    carriers = set(model.supports[model.frames[frame_id(model, tool_frame)].parentJoint])
    still = [i for i in range(1, model.njoints) if i not in carriers or model.names[i] in angles]
    if still:
        q = np.clip(pin.neutral(model), model.lowerPositionLimit, model.upperPositionLimit)
        for name, angle in angles.items():
            joint = model.joints[model.getJointId(name)]
            turn = np.zeros(model.nv)
            turn[joint.idx_v] = _angle(name, angle)
            there = pin.integrate(model, pin.neutral(model), turn)  # a continuous joint has two coordinates
            q[joint.idx_q : joint.idx_q + joint.nq] = there[joint.idx_q : joint.idx_q + joint.nq]
        model, (visual, collision) = pin.buildReducedModel(model, [visual, collision], still, q)
    model = pin.Model(with_one_angle_each(model))
    for placement in model.jointPlacements:
        placement.rotation = exact(placement.rotation)
    g = _numbers(gravity)
    if g.shape != (3,) or not np.isfinite(g).all():
        raise ValueError(f"gravity: expected (3,) finite numbers in m/s^2, got {gravity!r}")
    model.gravity = pin.Motion(g, np.zeros(3))
    if armature is not None:
        armature = _numbers(armature)
        if armature.shape != (model.nv,) or not np.isfinite(armature).all() or (armature < 0).any():
            raise ValueError(f"armature: expected ({model.nv},) numbers >= 0 in kg m^2, got {armature!r}")
        model.armature = armature
    return Arm(model, tool_frame, visual, collision)


def _angle(joint: str, angle: float) -> float:
    value = _numbers(angle)
    if value.shape != () or not np.isfinite(value):
        raise ValueError(f"locked: expected a finite angle in rad for {joint!r}, got {angle!r}")
    return float(value)


def _numbers(x: object) -> np.ndarray:
    """x as floats; NaN, which the caller refuses by name, for what is none."""
    try:
        return np.array(x, dtype=float)
    except (TypeError, ValueError):
        return np.array(np.nan)
