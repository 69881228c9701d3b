"""Random joint plans over twelve orders of magnitude of distance and limits: how many are refused, and the most of a limit taken.

python benchmarks/check_plans.py [N] [seed]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import k1607_pin as k1607
from k1607_pin.arm.arm import Arm
from k1607_pin.paths.joint_plan import JointPlan, plan_joints
from k1607_pin.paths.timing import Limits, shares

RANGE = 1e5  # m
JOINT = """<joint name="j{i}" type="prismatic"><parent link="l{last}"/><child link="l{i}"/><axis xyz="{axis}"/>
<limit lower="-{range}" upper="{range}" velocity="1" effort="1e3"/></joint>
<link name="l{i}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
AXES = ("1 0 0", "0 1 0", "0 0 1")


def slide(n: int = 3) -> Arm:
    """n prismatic joints with room for any distance."""
    joints = [JOINT.format(i=i + 1, last=i, axis=AXES[i % 3], range=RANGE) for i in range(n)]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "slide.urdf"
        file.write_text(f'<robot name="slide"><link name="l0"/>{"".join(joints)}</robot>')
        return k1607.load_urdf(file, tool_frame=f"l{n}")


def case(rng: np.random.Generator, n: int) -> tuple[np.ndarray, Limits, bool]:
    """Waypoints (m, n), limits and whether to stop: sizes 1e-8 to 1e4, limits 1e-6 to 1e6; round at times."""
    m = int(rng.integers(1, 4))
    steps = 10 ** rng.uniform(-8, 4, (m, 1)) * rng.uniform(-1, 1, (m, n))
    if rng.random() < 0.3:  # of several magnitudes in one motion
        steps = 10 ** rng.uniform(-8, 4, (m, n)) * rng.choice([-1, 1], (m, n))
    limits = Limits(*10 ** rng.uniform(-6, 6, 3))
    if rng.random() < 0.3:  # where one of the phases ends just as another begins
        v, a = limits.velocity, limits.acceleration
        limits = Limits(v, a, a * a / v)
        steps = rng.choice([-1, 1], (m, n)) * rng.choice([1, 2]) * a**3 / limits.jerk**2
        steps = np.clip(steps, -1e4, 1e4)
    return np.cumsum(steps, axis=0), limits, bool(rng.random() < 0.5)


def taken(plan: JointPlan, limits: Limits) -> float:
    """The largest share of a limit."""
    return max(shares(plan.spline, limits))


def main(count: int, seed: int) -> None:
    rng, arms = np.random.default_rng(seed), [slide(n) for n in (1, 2, 3)]
    refused, most = [], (0.0, -1)
    for k in range(count):
        arm = arms[k % 3]
        ways, limits, stop = case(rng, arm.n)
        if np.abs(np.diff(ways, axis=0, prepend=0.0)).max() < 1e-8:
            continue  # no motion to speak of
        try:
            plan = plan_joints(arm, ways, np.zeros(arm.n), *limits, stop=stop)
        except ValueError as error:
            refused.append((k, str(error)))
            continue
        most = max(most, (taken(plan, limits), k))
    for k, words in refused[:10]:
        print(f"plan {k}: {words}")
    print(f"{count} plans, {len(refused)} refused; largest share of a limit 1 {most[0] - 1:+.1e} (plan {most[1]})")


if __name__ == "__main__":
    main(*(int(x) for x in (*sys.argv[1:], *("1000", "0")[len(sys.argv) - 1 :])))
