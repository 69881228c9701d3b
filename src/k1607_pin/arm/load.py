"""Arms from files: the K-1607, any URDF, and the robots of example-robot-data."""

import logging
import os
from collections.abc import Iterable, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from k1607_pin import data
from k1607_pin.arguments import numbers
from k1607_pin.arm.arm import Arm, frame_id
from k1607_pin.arm.continuous import with_one_angle_each
from k1607_pin.arm.locked import Locked, locked_values, reduced, still_posture
from k1607_pin.arm.serial import without_range
from k1607_pin.arm.tool import tool_of
from k1607_pin.arm.urdfdom import heard
from k1607_pin.description.dh import exact
from k1607_pin.description.urdf_file import Mimic, UrdfFile, read_urdf
from k1607_pin.description.urdf_inertia import look_at_inertias

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
    locked: Locked = (),
) -> Arm:
    """The Robotics Research K-1607.

    Parameters
    ----------
    tool_frame : "tool" is the report's frame {7}; "tool_plate" lies 6.600 in further along z7.
    armature : (n,) kg m^2 reflected rotor inertia; None takes the assumed values of ``data/k1607.toml``.
    gravity : (3,) m/s^2 in the base frame; (0, 0, 0) for orbit.
    locked : joints to hold still, as for `load_urdf`.
    """
    arm = load_urdf(k1607_urdf(), tool_frame, locked, armature, gravity)
    if armature is not None:
        return arm
    model, rotors = arm.model, data.load("k1607")["armature"]["inertia_kg_m2"]
    model.armature = np.array([rotors[int(name.removeprefix("joint")) - 1] for name in arm.joint_names])
    return arm.with_model(model)


def load_urdf(
    path: str | Path,
    tool_frame: str | None = None,
    locked: Locked = (),
    armature: np.ndarray | None = None,
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81),
    package_dirs: str | Path | Iterable[str | Path] = (),
    check_inertia: bool = True,
) -> Arm:
    """The fixed-base arm of a URDF file.

    Parameters
    ----------
    tool_frame : a link or joint name; None takes the one link at the end of the longest chain of joints that move.
    locked : joints to hold still, as near to zero as their limits allow or at the given value [rad, m]. Joints that do not
        carry the tool frame (a gripper's fingers) are locked unasked, those that mimic another where that leads them, and
        those whose limits leave no range.
    armature : (n,) kg m^2; None keeps the model's own, zero unless the file says otherwise.
    gravity : (3,) m/s^2 in the base frame.
    package_dirs : where ``package://`` meshes are looked for; the file's folder is always.
    check_inertia : False takes masses and inertias as they are, whatever they are.

    The log warns of what is loaded otherwise than written: meshes that are not found, joint friction (`Plant.from_description`
    has it), joints without range, inertias that no body has.

    Raises
    ------
    ValueError
        No such file, not a URDF, numbers that are none (with link or joint, and line), a negative mass or moment of inertia, no
        such frame or joint, several ends and no tool_frame, a moving joint that mimics another, a locked value beyond its
        limits, more than 150 movable joints or 1,000 links in the file, or 100 joints in the
        arm, or not a serial chain of one-degree-of-freedom joints.
    """
    file = read_urdf(path, check_inertia)
    folders = [str(file.path.parent), *_folders(package_dirs)]
    try:
        model, said = heard(lambda: pin.buildModelFromXML(file.text))
    except ValueError as error:
        raise ValueError(f"path: Pinocchio cannot read {file.path}: {error}") from None
    if check_inertia and "inertial" in "".join(said).lower():
        raise ValueError(
            f"path: Pinocchio leaves out a part of {file.path}: {'; '.join(said)}. check_inertia=False takes the file as it is"
        )
    if said:
        logger.warning("%s: a part is left out: %s", file.path, "; ".join(said))
    try:
        (visual, collision), _ = heard(
            lambda: [_geometry(model, file, kind, folders) for kind in (pin.VISUAL, pin.COLLISION)]
        )
    except ValueError as error:
        why = str(error).rstrip(".")
        logger.warning("%s is loaded without geometry: %s. Are its packages in package_dirs?", file.path, why)
        visual = collision = pin.GeometryModel()
    _look(file, check_inertia)
    return _arm(model, visual, collision, tool_frame, locked, armature, gravity, file.mimics, check_inertia)


def load_example(
    name: str,
    tool_frame: str | None = None,
    locked: Locked = (),
    armature: np.ndarray | None = None,
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81),
    check_inertia: bool = True,
) -> Arm:
    """A robot of example-robot-data ("panda", "ur5", "xarm7", ...); arguments and errors as for `load_urdf`."""
    from example_robot_data.robots_loader import ROBOTS

    if not isinstance(name, str) or name not in ROBOTS:
        raise ValueError(f"name: no robot {name!r} in example-robot-data, expected one of {', '.join(sorted(ROBOTS))}")
    if ROBOTS[name].free_flyer:
        raise ValueError(f"{name!r}, joint 'root_joint': expected a fixed base, got one that moves freely")
    try:
        loader, said = heard(ROBOTS[name])
    except (ValueError, OSError, ImportError, AttributeError) as error:
        raise ValueError(f"name: example-robot-data cannot load {name!r}: {error}") from None
    if said:
        logger.warning("%s: %s", name, "; ".join(said))
    robot, mimics = loader.robot, {}
    if loader.df_path.endswith(".urdf"):
        file = read_urdf(loader.df_path, check_inertia)
        _look(file, check_inertia)
        mimics = file.mimics
    frame = TOOL_FRAMES.get(name) if tool_frame is None else tool_frame
    return _arm(
        robot.model, robot.visual_model, robot.collision_model, frame, locked, armature, gravity, mimics, check_inertia
    )


def _geometry(model: pin.Model, file: UrdfFile, kind: Any, folders: list[str]) -> pin.GeometryModel:
    return pin.buildGeomFromUrdfString(model, file.text, kind, package_dirs=folders)


def _folders(folders: str | Path | Iterable[str | Path]) -> list[str]:
    try:
        return [os.fspath(folder) for folder in ([folders] if isinstance(folders, str | Path) else folders)]
    except TypeError:
        raise ValueError(f"package_dirs: expected folders, got {folders!r}") from None


def _look(file: UrdfFile, check_inertia: bool) -> None:
    for doubt in look_at_inertias(file) if check_inertia else ():
        logger.warning("%s", doubt)


def _arm(
    model: pin.Model,
    visual: pin.GeometryModel,
    collision: pin.GeometryModel,
    tool_frame: str | None,
    locked: Locked,
    armature: np.ndarray | None,
    gravity: tuple[float, float, float],
    mimics: Mapping[str, Mimic],
    check_inertia: bool,
) -> Arm:
    if model.njoints > 1 and model.joints[1].nv == 6:
        raise ValueError(
            f"{model.name!r}, joint {model.names[1]!r}: expected a fixed base, got {model.joints[1].shortname()}"
        )
    given = locked_values(model, locked)
    rigid = [i for i in without_range(model) if model.names[i] not in given]
    still = {*rigid, *(model.getJointId(name) for name in given)}
    if rigid and len(still) == model.njoints - 1:
        raise ValueError(
            f"{model.name!r}: no movable joint: the limits of {_listed(model, rigid)} leave no range: "
            "write a lower and an upper one"
        )
    tool_frame = tool_of(model, still) if tool_frame is None else tool_frame
    carriers = set(model.supports[model.frames[frame_id(model, tool_frame)].parentJoint])
    still |= set(range(1, model.njoints)) - carriers
    moving = [model.names[i] for i in range(1, model.njoints) if i not in still]
    if followers := [name for name in moving if name in mimics]:
        raise ValueError(
            f"joint {followers[0]!r} mimics another one: lock it, as an arm's joints must move on their own: "
            f"locked=[{followers[0]!r}], on the command line --lock {followers[0]}"
        )
    if rigid := [i for i in rigid if i in carriers]:
        logger.warning("%s: locked, since their limits leave no range: %s", model.name, _listed(model, rigid))
    model, (visual, collision) = reduced(model, [visual, collision], still, still_posture(model, still, given, mimics))
    model = pin.Model(with_one_angle_each(model))
    for placement in model.jointPlacements:
        placement.rotation = exact(placement.rotation)
    if massless := [model.names[i] for i in range(1, model.njoints) if model.inertias[i].mass == 0 and check_inertia]:
        logger.warning(
            "%s: nothing that has a mass is fixed to the joints %s", model.name, ", ".join(map(repr, massless))
        )
    model.gravity = pin.Motion(numbers("gravity", gravity, (3,), "m/s^2"), np.zeros(3))
    if armature is not None:
        rotors = numbers("armature", armature, (model.nv,), "kg m^2")
        if (rotors < 0).any():
            raise ValueError(f"armature: expected ({model.nv},) numbers >= 0 in kg m^2, got {armature!r}")
        model.armature = rotors
    arm = Arm(model, tool_frame, visual, collision)
    if arm.damping.any() or arm.friction.any():
        _say_once(
            f"{arm.name}: the arm moves without the joint friction of its description; Plant.from_description(arm) has it"
        )
    return arm


SAID_ONCE: set[str] = set()


def _say_once(text: str) -> None:
    if text not in SAID_ONCE:
        SAID_ONCE.add(text)
        logger.warning("%s", text)


def _listed(model: pin.Model, joints: list[int]) -> str:
    return ", ".join(repr(model.names[i]) for i in joints)
