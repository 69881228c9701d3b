"""A URDF as its author wrote it: decoded, bounded, and looked over for what a parser would drop without a word."""

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from k1607_pin.description.bounds import DEEPEST, LARGEST, MOST_BYTES, MOST_LINKS, MOST_MOVABLE

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
NUMBERS = {  # element -> attribute -> how many numbers
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
    "limit": dict.fromkeys(("lower", "upper", "effort", "velocity"), 1),
    "dynamics": {"damping": 1, "friction": 1},
    "mimic": {"multiplier": 1, "offset": 1},
}
NEEDED = {"mass": ("value",), "inertia": tuple(NUMBERS["inertia"])}
UNBOUNDED = ("effort", "velocity", "lower", "upper")  # 1e30 stands for "no limit" here, and multiplies nothing
DIRECTED = ("revolute", "continuous", "prismatic", "planar")
MOVING = (*DIRECTED, "floating")


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another: multiplier times its angle, plus offset [rad, m]."""

    driver: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class UrdfFile:
    """What a URDF says, before any rigid-body library reads it."""

    path: Path
    text: str
    """The file decoded, for a parser that reads UTF-8."""
    root: Any
    """Its elements, with the lines they stand in."""

    @property
    def mimics(self) -> dict[str, Mimic]:
        """Joint -> what it follows."""
        found = {}
        for joint in self.root.iterchildren("joint"):
            mimic = joint.find("mimic")
            if mimic is not None:
                multiplier, offset = (
                    float(mimic.get(name, default)) for name, default in (("multiplier", "1"), ("offset", "0"))
                )
                found[joint.get("name", "")] = Mimic(mimic.get("joint", ""), multiplier, offset)
        return found

    def where(self, element: Any) -> str:
        """ "arm.urdf, line 12, link 'forearm'": where an element stands."""
        named = next(
            (e for e in (element, *element.iterancestors()) if e.getparent() is self.root and e.get("name")), None
        )
        return f"{self.path}, line {element.sourceline}" + (
            f", {named.tag} {named.get('name')!r}" if named is not None else ""
        )


def read_urdf(path: str | Path, check_inertia: bool = True) -> UrdfFile:
    """The URDF file at ``path``; ``check_inertia=False`` leaves ``<inertial>`` elements unread.

    Raises
    ------
    ValueError
        No such file, no XML, too large or too deep, entities, and numbers that are none: with link or joint, and line.
    """
    try:
        path = Path(os.fsdecode(path))
    except TypeError:
        raise ValueError(f"path: expected the path of a URDF file, got {path!r}") from None
    if not path.is_file():
        raise ValueError(f"path: no URDF file {path}")
    try:
        raw = path.read_bytes() if path.stat().st_size <= MOST_BYTES else b""
    except OSError as error:
        raise ValueError(f"path: {path} cannot be read: {error.strerror}") from None
    if path.stat().st_size > MOST_BYTES:
        raise _unreadable(path, f"it has more than {MOST_BYTES // 2**20} MB")
    text = _decoded(path, raw)
    file = UrdfFile(path, text, _parsed(path, text))
    _bounded(file)
    _tree(file)
    _numbers_read(file, check_inertia)
    return file


def _unreadable(path: Path, why: object) -> ValueError:
    return ValueError(f"path: Pinocchio cannot read {path}: {why}")


def _decoded(path: Path, raw: bytes) -> str:
    """The text, whose declaration names no encoding any more: it is handed on as UTF-8."""
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        encoding = "utf-16"
    else:
        declared = re.match(rb"(?:\xef\xbb\xbf)?\s*<\?xml[^>]*?encoding\s*=\s*[\"']([^\"']*)[\"']", raw)
        encoding = declared[1].decode("ascii", "replace") if declared else "utf-8"
    try:
        text = raw.decode("utf-8-sig" if encoding.lower() in ("utf-8", "utf8") else encoding)
    except LookupError:
        raise _unreadable(path, f"line 1: unknown encoding {encoding!r}; save it as UTF-8") from None
    except (UnicodeError, ValueError) as error:
        raise _unreadable(path, f"it is not {encoding}: {error}; save it as UTF-8") from None
    return re.sub(r"^(\s*<\?xml[^>]*?)\s+encoding\s*=\s*[\"'][^\"']*[\"']", r"\1", text.removeprefix("\ufeff"), count=1)


def _parsed(path: Path, text: str) -> Any:
    """The root element. Nothing outside is fetched, no entity is expanded; prefixes that nobody declared are let pass."""
    parser = etree.XMLParser(
        recover=True, resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True
    )
    try:
        root = etree.fromstring(text.encode(), parser)
    except (etree.XMLSyntaxError, ValueError, AssertionError) as error:
        raise _unreadable(path, error) from None
    for fault in parser.error_log:
        if fault.domain_name != "NAMESPACE":
            raise _unreadable(path, f"line {fault.line}: {fault.message}")
    if root is None:
        raise _unreadable(path, "it holds no XML element")
    for element in root.iter(etree.Element):
        if element.prefix is None and element.tag.startswith(
            "{"
        ):  # a namespace by default: a URDF's parser knows nothing of it
            element.tag = element.tag.rpartition("}")[2]
    dtd = root.getroottree().docinfo.internalDTD
    entity = next(iter(dtd.iterentities()), None) if dtd is not None else None
    if entity is not None:
        raise _unreadable(path, f"it declares the entity {entity.name!r}: write out what it stands for")
    if root.tag != "robot":
        raise _unreadable(path, f"line {root.sourceline}: expected <robot>, got <{root.tag}>")
    return root


def _bounded(file: UrdfFile) -> None:
    depth, deepest = 0, 0
    for event, _ in etree.iterwalk(file.root, events=("start", "end")):
        depth += 1 if event == "start" else -1
        deepest = max(deepest, depth)
    links = sum(1 for _ in file.root.iterchildren("link"))
    joints = sum(joint.get("type") in MOVING for joint in file.root.iterchildren("joint"))
    for what, count, most in (
        ("elements within elements", deepest, DEEPEST),
        ("links", links, MOST_LINKS),
        ("movable joints", joints, MOST_MOVABLE),
    ):
        if count > most:
            raise _unreadable(file.path, f"expected at most {most:,} {what}, got {count:,}")
    for kind in ("link", "joint"):
        seen: dict[str, int] = {}
        for element in file.root.iterchildren(kind):
            name = element.get("name")
            if not name:
                raise _unreadable(file.path, f"line {element.sourceline}: a {kind} without a name")
            if name in seen:
                raise _unreadable(
                    file.path, f"lines {seen[name]} and {element.sourceline}: two {kind}s are called {name!r}"
                )
            seen[name] = element.sourceline


def _tree(file: UrdfFile) -> None:
    """Refuse links that are carried twice, which Pinocchio would take twice, or in a circle, which it would leave out."""
    carried: dict[str, Any] = {}
    for joint in file.root.iterchildren("joint"):
        child = joint.find("child")
        name = child.get("link", "") if child is not None else ""
        if name in carried:
            raise ValueError(
                f"path: {file.where(joint)}: the link {name!r} is carried by joint {carried[name].get('name')!r} already, "
                f"in line {carried[name].sourceline}"
            )
        if name:
            carried[name] = joint
    for joint in carried.values():
        seen, link = set(), joint
        while link is not None and link not in seen:
            seen.add(link)
            parent = link.find("parent")
            link = carried.get(parent.get("link", "")) if parent is not None else None
        if link is not None:
            raise ValueError(
                f"path: {file.where(link)}: links carry each other in a circle, from joint {link.get('name')!r} back to it; "
                "a robot description is a tree"
            )


def _numbers_read(file: UrdfFile, check_inertia: bool) -> None:
    """Refuse what is no number where one belongs."""
    for element in _looked_at(file.root, check_inertia):
        attributes = NUMBERS[element.tag]
        for name in NEEDED.get(element.tag, ()):
            if name not in element.attrib:
                inside = (element.text or "").strip()
                hint = f', as in <{element.tag} {name}="{inside}"/>' if inside else ""
                raise ValueError(f"path: {file.where(element)}: <{element.tag}> needs the attribute {name!r}{hint}")
        for name, count in attributes.items():
            if name in element.attrib:
                _vector(file, element, name, count)
    for joint in file.root.iterchildren("joint"):
        dynamics = joint.find("dynamics")
        for name in ("damping", "friction") if dynamics is not None else ():
            if float(dynamics.get(name, "0")) < 0:
                raise ValueError(f"path: {file.where(dynamics)}: expected {name} >= 0, got {dynamics.get(name)!r}")
        axis = joint.find("axis")
        if joint.get("type") in DIRECTED and axis is not None and np.abs(_vector(file, axis, "xyz", 3)).max() < 1e-9:
            raise ValueError(f"path: {file.where(axis)}: expected an axis with a direction, got {axis.get('xyz')!r}")
    if check_inertia:
        for link in file.root.iterchildren("link"):
            inertials = link.findall("inertial")
            if len(inertials) > 1:
                raise ValueError(f"path: {file.where(inertials[1])}: a second <inertial>, which would not be read")
            for inertial in inertials:
                for name in ("mass", "inertia"):
                    if len(found := inertial.findall(name)) != 1:
                        raise ValueError(
                            f"path: {file.where(inertial)}: expected one <{name}> in <inertial>, got {len(found)}"
                        )


def _looked_at(root: Any, check_inertia: bool) -> Iterator[Any]:
    """The elements with numbers that shape the arm's motion; looks are left to the parser."""
    for joint in root.iterchildren("joint"):
        yield from (e for e in joint.iterchildren(*NUMBERS))
    for link in root.iterchildren("link"):
        for inertial in link.iterchildren("inertial") if check_inertia else ():
            yield from inertial.iterchildren(*NUMBERS)


def _vector(file: UrdfFile, element: Any, name: str, count: int) -> np.ndarray:
    """(count,) numbers of an attribute, as urdfdom reads them: a point for decimals, neither NaN nor infinity."""
    written = element.get(name, "")
    words = written.split() if count > 1 else [written]
    good = len(words) == count and all(NUMBER.fullmatch(word) for word in words)
    values = np.array([float(word) for word in words]) if good else np.full(count, np.nan)
    largest = np.finfo(float).max if name in UNBOUNDED else LARGEST
    if not (np.abs(values) <= largest).all():  # NaN is refused too
        expected = "a finite number" if count == 1 else f"{count} finite numbers"
        bound = f" up to {LARGEST:g}" if np.isfinite(values).all() else ""
        hint = "; write a point for the decimal comma" if "," in written else ""
        raise ValueError(
            f"path: {file.where(element)}: <{element.tag} {name}>: expected {expected}{bound}, got {written!r}{hint}"
        )
    return values
