"""Parse a URDF, and find the chain of joints between two of its links.

What a robot file cannot represent is refused by name: floating, planar and mimic joints.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from pydantic import ValidationError

from pipeline.base import linear
from pipeline.base.arrays import Array, Locked
from pipeline.base.errors import InputError, listed
from pipeline.machine.robot.steps import Fixed

TYPES = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic"}
"""Joint types of a robot file by those of a URDF."""

_SHORTEST = 1e-9
"""Length of an axis vector below which it has no direction [1]."""

_ENDLESS = 1e30
"""Limit of the numbers of a URDF [any]; larger ones are invalid or stand for infinity."""

_FAR = 1e3
"""Joint limit from which a joint counts as unlimited [m] or [rad]: 160 turns."""

_WEAKEST, _STRONGEST = 1e-3, 1e7
"""Efforts outside this range count as unstated [N] or [N m]: the weights of 0.1 g and 1000 t."""


@dataclass(frozen=True)
class Limit:
    """Contents of the `<limit>` of a joint, SI; None if not stated."""

    lower: float | None
    upper: float | None
    effort: float | None


@dataclass(frozen=True, eq=False)
class UrdfJoint(Locked):
    """A joint of a URDF and the link it moves.

    Attributes:
        name: Its name.
        type: Joint type as in the URDF.
        parent: Link that carries it.
        child: Link that it moves.
        origin: Its frame relative to the parent, shape (4, 4).
        axis: Unit vector of its motion, in its own frame, shape (3,).
        limit: Its limits.
        mimic: Joint that it follows, None for an independent joint.
    """

    name: str
    type: str
    parent: str
    child: str
    origin: Array
    axis: Array
    limit: Limit
    mimic: str | None


@dataclass(frozen=True, eq=False)
class LinkMass(Locked):
    """Mass [kg] of a link, and its centre of mass in the link's frame [m], shape (3,)."""

    mass: float
    centre: Array


@dataclass(frozen=True)
class Tree:
    """The contents of a URDF.

    Attributes:
        name: Name of the robot.
        joints: Joints by the link that they move.
        bodies: Masses by link; links without mass are absent.
        links: Names of all links.
    """

    name: str
    joints: Mapping[str, UrdfJoint]
    bodies: Mapping[str, LinkMass]
    links: tuple[str, ...]


_MOST_JOINTS = 1000
"""Maximum number of joints [1]; a whole cell with its fixed links has some hundred. Pinocchio goes
from link to link by recursion, and ends the process in a chain of 30 000."""

_MOST_AXES = 100
"""Maximum number of moving joints of an arm [1]; Pinocchio needs 2 GB for 300."""

_MOST_ATTRIBUTES = 100
"""Maximum number of attributes of an element [1], of which URDF has six at most: Pinocchio compares
each with those before it, and takes two minutes for 300 000."""


def read(text: str, file: str) -> Tree:
    """Read the links and joints of a URDF.

    Raises:
        InputError: It is not a URDF, or a number cannot be read; names the place.
    """
    root = _root(text, file)
    if (n := len(root.findall("joint"))) > _MOST_JOINTS:
        thing = f"has {n} joints, more than the {_MOST_JOINTS} that are read"
        raise InputError(thing, "give the URDF of the arm alone", file=file)
    joints = [_joint(element, file) for element in root.findall("joint")]
    links = tuple(_word(link, "name", "a link", file) for link in root.findall("link"))
    _one_parent_each(joints, file)
    bodies = dict(zip(links, (_body(one, file) for one in root.findall("link")), strict=True))
    return Tree(
        name=root.get("name") or "robot",
        joints={joint.child: joint for joint in joints},
        bodies={name: body for name, body in bodies.items() if body is not None},
        links=links,
    )


def _one_parent_each(joints: Sequence[UrdfJoint], file: str) -> None:
    twice = [name for name, n in Counter(joint.child for joint in joints).items() if n > 1]
    if twice:
        thing = f"link {twice[0]} has several parent joints, and a link of a serial arm has one"
        raise InputError(thing, "remove the others, if the arm is one without them", file=file)


def _root(text: str, file: str) -> ET.Element:
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, ValueError) as problem:
        raise InputError(
            f"is no XML ({problem})", "give the URDF that the robot's package makes", file=file
        ) from problem
    for element in root.iter():
        if (n := len(element.attrib)) > _MOST_ATTRIBUTES:
            thing = f"a <{element.tag}> has {n} attributes, more than the {_MOST_ATTRIBUTES} read"
            raise InputError(thing, "give the URDF that the robot's package makes", file=file)
    if any("xacro" in str(element.tag) for element in root.iter()):
        way_out = "expand it first (`xacro FILE.xacro > FILE.urdf`)"
        raise InputError("contains xacro, which must be expanded to URDF first", way_out, file=file)
    if root.tag != "robot":
        thing = f"begins with <{root.tag}>, a URDF with <robot>"
        raise InputError(thing, "give the URDF of the robot", file=file)
    return root


def _word(element: ET.Element, key: str, whose: str, file: str) -> str:
    word = element.get(key)
    if not word:
        raise InputError(f"{whose} has no {key}", "correct the URDF", file=file)
    return word


def _numbers(element: ET.Element | None, key: str, none: str, whose: str, file: str) -> Array:
    """As many numbers as `none` has, which is the default."""
    words = none if element is None else element.get(key, none)
    try:
        values = np.array([float(word) for word in words.split()])
    except ValueError:
        values = np.array([np.nan])
    count = len(none.split())
    if len(values) != count or not (np.abs(values) < _ENDLESS).all():
        thing = f'{whose}: {key} = "{words}" is not {count} number{"s" * (count > 1)} of a robot'
        raise InputError(thing, "correct the URDF", file=file)
    return values


def _pose(element: ET.Element | None, whose: str, file: str) -> Array:
    """The frame of an `<origin>`, shape (4, 4)."""
    x, y, z = _numbers(element, "xyz", "0 0 0", whose, file).tolist()
    turns = np.remainder(_numbers(element, "rpy", "0 0 0", whose, file), 2 * np.pi)
    roll, pitch, yaw = np.rad2deg(turns).tolist()
    try:
        return Fixed(xyz_m=(x, y, z), rpy_deg=(roll, pitch, yaw)).step
    except ValidationError as problem:
        thing = f"{whose}: its origin {x:g} {y:g} {z:g} lies farther off than anything in a hall"
        raise InputError(thing, "give metres, as a URDF has them", file=file) from problem


def _joint(element: ET.Element, file: str) -> UrdfJoint:
    name = _word(element, "name", "a joint", file)
    whose = f"joint {name}"
    ends = []
    for end in ("parent", "child"):
        found = element.find(end)
        ends.append(_word(ET.Element(end) if found is None else found, "link", whose, file))
    axis = _numbers(element.find("axis"), "xyz", "1 0 0", whose, file)
    type_ = _word(element, "type", whose, file)
    if np.linalg.norm(axis) < _SHORTEST and type_ in TYPES:
        raise InputError(f"{whose}: its axis has no length", "correct the URDF", file=file)
    mimic = element.find("mimic")
    return UrdfJoint(
        name=name,
        type=type_,
        parent=ends[0],
        child=ends[1],
        origin=_pose(element.find("origin"), whose, file),
        axis=axis / max(float(np.linalg.norm(axis)), _SHORTEST),
        limit=_limit(element.find("limit"), type_, whose, file),
        mimic=None if mimic is None else mimic.get("joint", "another joint"),
    )


def _limit(element: ET.Element | None, type_: str, whose: str, file: str) -> Limit:
    """Limits of a joint; a range of 0 to 0, zero effort and enormous values count as unstated."""
    lower, upper, effort = (
        float(_numbers(element, key, "0", whose, file)[0]) for key in ("lower", "upper", "effort")
    )
    ranged = type_ != "continuous" and lower < upper
    return Limit(
        lower if ranged and lower > -_FAR else None,
        upper if ranged and upper < _FAR else None,
        effort if _WEAKEST < effort < _STRONGEST else None,
    )


def _body(element: ET.Element, file: str) -> LinkMass | None:
    inertial = element.find("inertial")
    if inertial is None:
        return None
    whose = f"link {element.get('name')}"
    mass = float(_numbers(inertial.find("mass"), "value", "0", whose, file)[0])
    if mass < 0:
        raise InputError(f"{whose}: its mass is {mass:g} kg", "correct the URDF", file=file)
    return LinkMass(mass, _pose(inertial.find("origin"), whose, file)[:3, 3]) if mass > 0 else None


@dataclass(frozen=True, eq=False)
class Chain(Locked):
    """Chain of joints between two links.

    Attributes:
        start: Frame of the link at which the joints start, relative to the base, shape (4, 4).
        joints: Joints from there to the flange, including fixed ones.
    """

    start: Array
    joints: tuple[UrdfJoint, ...]


def chain(tree: Tree, base: str, flange: str, file: str) -> Chain:
    """The joints from one link, or from the link it is fixed to, to another.

    Raises:
        InputError: There is no such link or chain, or a joint cannot be represented in a robot
            file.
    """
    _known(tree, base, file)
    _known(tree, flange, file)
    down, up = _parted(tree, base, flange)
    for joint in up:
        _representable(joint, file)
    start = down[0].parent if down else base
    if moving(down) or (up and up[0].parent != start):
        thing = f"no chain of joints leads from link {base} to link {flange}"
        before = listed([joint.parent for joint in _from_root(tree, flange)])
        raise InputError(thing, f"before {flange} lie {before}: choose one of them", file=file)
    if not 0 < (n := len(moving(up))) <= _MOST_AXES:
        none, many = "nothing moves", f"{n} joints move, more than {_MOST_AXES},"
        thing = f"{many if n else none} between link {base} and link {flange}"
        raise InputError(thing, "choose links with the joints of an arm between them", file=file)
    step = reduce(np.matmul, (joint.origin for joint in down), np.eye(4))
    return Chain(linear.solve(step, np.eye(4)), tuple(up))


def moving(joints: Iterable[UrdfJoint]) -> list[UrdfJoint]:
    """Joints that are not fixed; these become the rows of a robot file."""
    return [joint for joint in joints if joint.type != "fixed"]


def _known(tree: Tree, link: str, file: str) -> None:
    if link not in tree.links:
        thing = f'has no link "{link}"'
        raise InputError(thing, f"its links are {listed(tree.links)}", file=file)


def _parted(tree: Tree, base: str, flange: str) -> tuple[list[UrdfJoint], list[UrdfJoint]]:
    """The joints to each of two links from where their branches separate."""
    down, up = _from_root(tree, base), _from_root(tree, flange)
    while down and up and down[0] is up[0]:
        del down[0], up[0]
    return down, up


def _from_root(tree: Tree, link: str) -> list[UrdfJoint]:
    """The joints from the root to a link, in this order."""
    joints: list[UrdfJoint] = []
    while link in tree.joints and len(joints) < len(tree.joints):
        joints.append(tree.joints[link])
        link = joints[-1].parent
    return joints[::-1]


def _representable(joint: UrdfJoint, file: str) -> None:
    if joint.type not in (*TYPES, "fixed"):
        thing = f"joint {joint.name} is {joint.type}, a robot file has turning and sliding joints"
        raise InputError(thing, "choose links between which there is none", file=file)
    if joint.mimic is not None:
        thing = f"joint {joint.name} follows {joint.mimic}, in a robot file each moves by itself"
        raise InputError(thing, "choose links between which there is none", file=file)
