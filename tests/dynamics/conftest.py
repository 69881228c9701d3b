"""Models to hold against Pinocchio: serial arms, and trees with sliding joints that carry their tool anywhere."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest

import k1607_pin as k1607
from k1607_pin.arm.bodies import bodies
from k1607_pin.dynamics.rigid_body import Body


def random_tree(seed: int, n: int = 9) -> pin.Model:
    """A tree of revolute and prismatic joints, depth first, as Pinocchio's algorithms need it."""
    pin.seed(seed)
    rng = np.random.default_rng(seed)
    kinds = [pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ, pin.JointModelPX, pin.JointModelPZ]
    model, parent = pin.Model(), 0
    while model.nv < n:
        axis = rng.normal(size=3)
        unaligned = [pin.JointModelRevoluteUnaligned(axis / np.linalg.norm(axis))]
        joint = rng.choice([*(k() for k in kinds), *unaligned])
        parent = model.addJoint(parent, joint, pin.SE3.Random(), f"joint{model.nv}")
        model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
        if model.nv % 3 == 0:
            parent = int(
                rng.choice([j for j in model.supports[parent]])
            )  # back up the branch, so the order stays depth first
    model.armature = rng.uniform(0, 1, n)
    return model


class Robot(NamedTuple):
    """A model with a tool."""

    model: pin.Model
    frame: int
    """The tool's index in the model's frames."""

    @property
    def bodies(self) -> list[Body]:
        return bodies(self.model)

    @property
    def gravity(self) -> np.ndarray:
        return self.model.gravity.linear

    @property
    def tool(self) -> tuple[int, np.ndarray, np.ndarray]:
        """Which body carries it, offset (3,) and rotation (3, 3) there."""
        frame = self.model.frames[self.frame]
        return frame.parentJoint - 1, frame.placement.translation, frame.placement.rotation


def of_arm(arm: k1607.Arm) -> Robot:
    model = arm.model
    return Robot(model, model.getFrameId(arm.tool_frame))


def of_tree(seed: int, n: int) -> Robot:
    """With the tool on the first of the bodies farthest from the base, six joints at least."""
    model = random_tree(seed, n)
    joint = max(range(1, n + 1), key=lambda i: len(model.supports[i]))
    assert len(model.supports[joint]) > 6
    return Robot(model, model.addFrame(pin.Frame("tool", joint, 0, pin.SE3.Random(), pin.OP_FRAME)))


ROBOTS: dict[str, Callable[[], Robot]] = {
    "k1607": lambda: of_arm(k1607.load_k1607()),
    "panda": lambda: of_arm(k1607.load_example("panda")),
    "ur5": lambda: of_arm(k1607.load_example("ur5")),
    "tree, tool in the middle": lambda: of_tree(1, 9),  # six joints, one of them sliding, below it; three beside it
    "tree, tool at the end": lambda: of_tree(2, 9),
    "tree, redundant": lambda: of_tree(10, 12),  # eight joints below the tool, three of them sliding
}


@pytest.fixture(scope="module", params=list(ROBOTS))
def robot(request: pytest.FixtureRequest) -> Robot:
    """Two redundant arms, one of six joints, three trees."""
    return ROBOTS[request.param]()
