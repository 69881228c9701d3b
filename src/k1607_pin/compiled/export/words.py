"""What the header says of the numbers that a control law takes and gives."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from k1607_pin.arm.arm import Arm
from k1607_pin.compiled.checked import attributes
from k1607_pin.compiled.emit import LIBM
from k1607_pin.compiled.export.function import Field
from k1607_pin.compiled.leaves import is_ours, numbers
from k1607_pin.control.practice import OFF, Practice

Variables = Mapping[str, tuple[tuple[str, ...], str]]

RENAMED = {
    "mode.0": "selection",
    "mode.1": "wanted_force",
    "posture.path.0": "posture_position",
    "posture.path.1": "posture_velocity",
    "posture.omega": "posture_omega",
}
"""What a controller has without a telling name"""

OUTPUTS = {"error": ("joint_error", "error"), "force_error": ("force_error",)}
"""Given beside the torque: name, and the first of these that the controller logs"""

TOOL = {
    "position": ("m", "wanted position of the tool's origin, base axes"),
    "velocity": ("m/s", "its rate"),
    "acceleration": ("m/s^2", "its second derivative"),
    "rotation": ("1", "wanted orientation, tool in base"),
    "angular_velocity": ("rad/s", "wanted, base axes"),
    "angular_acceleration": ("rad/s^2", "wanted, base axes"),
}
JOINTS = {
    "position": ("rad (m)", "wanted joint positions"),
    "velocity": ("rad/s (m/s)", "wanted joint velocities"),
    "acceleration": ("rad/s^2 (m/s^2)", "wanted joint accelerations"),
}
KNOWN = {
    "t": ("s", "time of the sample"),
    "rotation": ("1", "wanted orientation, tool in base, held"),
    "period": ("s", "control period"),
    "beta_1": ("SI", "rate at which K_p adapts, (76)"),
    "beta_2": ("SI", "rate at which K_d adapts, (77)"),
    "force_beta_1": ("SI", "rate at which the force loop's K_p adapts"),
    "force_beta_2": ("SI", "rate at which the force loop's K_d adapts"),
    "K_p": ("", "proportional gains, (40)"),
    "K_d": ("", "derivative gains, (40)"),
    "posture_omega": ("1/s", "how fast the posture is approached"),
    "posture_position": ("rad (m)", "posture to keep to where the tool's task leaves freedom"),
    "posture_velocity": ("rad/s (m/s)", "its rate"),
    "omega": ("1/s", "double pole of the closed loop"),
    "stiffness": ("N/m, N m/rad", "assumed of the contact, compliance axes"),
    "compliance": ("1", "compliance axes in the base, columns"),
    "transition": ("s", "in which what a change of mode leaves behind fades"),
    "force_integral": ("1/s", "gain of the force error's integral"),
    "touch": ("N, N m", "force below which the force loop does not learn"),
    "sensor": ("N, N m", "force and moment of the world on the tool, base axes"),
    "selection": ("1", "1 force-controlled, 0 position-controlled, compliance axes"),
    "wanted_force": ("N, N m", "of the tool on the world, compliance axes"),
    "error": ("", "wanted less actual, (41)"),
    "force_error": ("N, N m", "wanted less measured, compliance axes"),
    "velocity": ("rad/s (m/s)", "filtered joint velocities"),
    "offset": ("m, rad; N, N m", "of the reference after a change of mode, fading"),
    "offset_rate": ("per s", "its rate"),
    "transfer": ("N, N m", "what the last change of mode would have made the command jump by, fading"),
    "integral": ("N, N m", "of the force error"),
}


TITLES = {
    "CartesianAdaptive": "the Cartesian adaptive scheme, figure 13, (40)-(41) and (76)-(77).",
    "JointAdaptive": "the joint-space adaptive scheme, figure 12, (40) and (76)-(77) in joint errors.",
    "HybridAdaptive": "the hybrid position/force scheme, figure 14; docs/hybrid.md derives its law.",
}


def title(controller: Any) -> str:
    """What it is, in a line."""
    kind = type(controller).__name__
    return TITLES.get(kind) or ((type(controller).__doc__ or "").strip() or kind).splitlines()[0]


def options(controller: Any, arguments: Sequence[str]) -> tuple[str, ...]:
    """What of it is code: those of its practices that are not off, a line each; of one's own, what is no argument.

    Parameters
    ----------
    arguments : dotted names of what is, with all that is below them.
    """
    lines = []
    if not _is_known(controller):
        plain = attributes(controller) | numbers(controller)
        fixed = [f"{name} {_short(x)}" for name, x in plain.items() if not _below(name, arguments)]
        lines += [f"Part of the code: {', '.join(fixed)}."] if fixed else []
    for where, practice in vars(controller).items():
        if not isinstance(practice, Practice):
            continue
        values = {f.name: np.asarray(getattr(practice, f.name)) for f in fields(practice)}
        on = [f"{name} {np.array2string(x)}" for name, x in values.items() if not np.array_equal(x, getattr(OFF, name))]
        lines += [f"Part of the code, {where}: {', '.join(on)}."] if on else []
    return tuple(lines)


KEYWORDS = (
    "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern", "float", "for",
    "goto", "if", "inline", "int", "long", "register", "restrict", "return", "short", "signed", "sizeof", "static", "struct",
    "switch", "typedef", "union", "unsigned", "void", "volatile", "while", "NAN", "INFINITY", "alignas", "alignof", "and",
    "and_eq", "asm", "bitand", "bitor", "bool", "catch", "class", "compl", "concept", "consteval", "constexpr", "constinit",
    "const_cast", "co_await", "co_return", "co_yield", "decltype", "delete", "dynamic_cast", "explicit", "export", "false",
    "friend", "mutable", "namespace", "new", "noexcept", "not", "not_eq", "nullptr", "operator", "or", "or_eq", "private",
    "protected", "public", "reinterpret_cast", "requires", "static_assert", "static_cast", "template", "this", "thread_local",
    "throw", "true", "try", "typeid", "typename", "using", "virtual", "wchar_t", "xor", "xor_eq",
)  # fmt: skip
"""Of C and, for the header's sake, of C++; and what math.h makes of two more"""


MACRO = re.compile(r"FP_|HUGE_|M_[A-Z0-9]|MATH_|[A-Z]+_MAX$|[A-Z]+_MIN$|EOF$|NULL$|BUFSIZ$")
"""Of C's headers"""
LOCAL = re.compile(
    r"w\d+|q|v|ok|in|out|status|\w*_?state|torque|parameters|reference|mem\w+|all_finite|set_zero|"
    + "|".join([*OUTPUTS, *LIBM])
)
"""What stands beside the names of what is measured, in the code itself"""


def name_in_c(name: str, role: str) -> str:
    """A name that C takes, of any."""
    name = re.sub(r"\W", "_", name, flags=re.ASCII)
    good = (
        re.match("[a-zA-Z]", name)
        and not MACRO.match(name)
        and name not in KEYWORDS
        and not (role == "measured" and LOCAL.fullmatch(name))
    )
    return name if good else f"{role}_{name}".rstrip("_")


def _below(name: str, arguments: Sequence[str]) -> bool:
    return any(name == one or name.startswith(f"{one}.") for one in arguments)


def _short(x: Any) -> str:
    return np.array2string(np.asarray(x), threshold=12, edgeitems=2, separator=", ").replace("\n", "")


def output_names(log: Mapping[str, Any]) -> dict[str, str]:
    """C's name -> the controller's, of what is given beside the torque."""
    found = {name: next((key for key in keys if key in log), None) for name, keys in OUTPUTS.items()}
    return {name: key for name, key in found.items() if key is not None}


def described_arm(arm: Arm) -> str:
    """What tells it from another of the same name."""
    gravity = ", ".join(f"{float(g):g}" for g in arm.model.gravity.linear)
    mass = sum(inertia.mass for inertia in arm.model.inertias)
    return f"{arm.n} joints, {mass:.6g} kg, tool frame {arm.tool_frame!r}, gravity ({gravity}) m/s^2 in the base."


def joints_of(arm: Arm) -> list[str]:
    """A line a joint: its place in q, name, kind, limits; and where the tool is."""
    lines = []
    for k, name in enumerate(arm.joint_names):
        prismatic = arm.model.joints[k + 1].shortname().startswith("JointModelP")
        kind, unit, force = ("prismatic", "m", "N") if prismatic else ("revolute", "rad", "N m")
        limits = f"{arm.lower[k]:.6g} to {arm.upper[k]:.6g} {unit}, {arm.effort_limit[k]:.6g} {force} at most"
        lines.append(f"  q[{k}]  {name}: {kind}, {limits}")
    at_zero = ", ".join(f"{x:.6g}" for x in arm.forward_kinematics(np.zeros(arm.n)).translation)
    return [*lines, f"At q = 0 the tool is at ({at_zero}) m in the base."]


def _is_known(controller: Any) -> bool:
    """Whether its class is this package's, or made from one, so that it is known what its numbers are."""
    return any(map(is_ours, type(controller).__mro__))


def described(role: str, name: str, shape: tuple[int, ...], controller: Any, key: str = "") -> Field:
    """The field with its unit and meaning, as far as they are known; ``key``: the controller's name for what is logged."""
    variables: Variables = getattr(controller, "variables", {})
    if not _is_known(controller):
        unit, says = KNOWN["t"] if (role, name) == ("reference", "t") else (variables.get(key or name, ((), ""))[1], "")
        return Field(name, shape, unit or "as the controller has it", says)
    unit, says = KNOWN.get(name) or KNOWN.get(name[-len("K_p") :], ("", ""))  # the gains of a loop
    if role == "reference":
        of_path = JOINTS if "joint_error" in variables else TOOL
        unit, says = of_path.get(name, (unit, says))
    if not unit:
        logged = key or name.replace("gains_", "").replace("position_", "")
        unit = variables.get(logged, ((), ""))[1]
    if role == "parameters" and "K_" in name:
        says = f"{says}, at the start"
    return Field(name, shape, unit or "as the controller has it", says)
