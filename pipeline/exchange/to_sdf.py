"""model.sdf: the robot with a spring at every joint, for Drake, Gazebo and others."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from pipeline.base.arrays import Array
from pipeline.exchange._xml import (
    BASE,
    FLANGE,
    Spring,
    body,
    comment,
    document,
    in_xml,
    row,
    rpy,
    shift,
    springs,
)
from pipeline.prediction.model import IdentifiedModel

_USE = (
    "Every joint is a spring about its commanded value: for a pose q [m, rad], write the values of",
    "q into <spring_reference>, and begin there, in a world without gravity. The limits of the",
    "axes stand in model.urdf; here they would stop what a load does to a gear.",
)


def sdf(handed: IdentifiedModel) -> bytes:
    """The robot as SDFormat 1.9: links, one joint each with its spring, a frame for each point."""
    robot, found = handed.robot, springs(handed)
    root = ET.Element("sdf", version="1.9")
    named = (f"{one.joint.name}: {one.said}." for one in found)
    root.append(ET.Comment(comment(handed, [*_USE, *named])))
    model = ET.SubElement(root, "model", name=robot.name)
    ET.SubElement(model, "link", name=BASE)
    _joint(model, f"{BASE}_in_the_world", "fixed", "world", BASE)
    parent = BASE
    for j, spring in enumerate(found):
        parent = _link(model, parent, spring, robot.placement[j])
    _frame(model, FLANGE, parent, robot.flange)
    for name, at in handed.tool.named.items():
        _frame(model, in_xml(name).replace("::", ":"), FLANGE, shift(at))  # :: separates scopes
    return document(root)


def _link(model: ET.Element, parent: str, spring: Spring, placement: Array) -> str:
    """Add a joint and the link after it; return the name of the link."""
    joint, mass = spring.joint, body(spring)
    name = f"link_{joint.name}"
    link = ET.SubElement(model, "link", name=name)
    _pose(link, placement, parent)
    inertial = ET.SubElement(link, "inertial")
    _pose(inertial, shift(mass.centre))
    _said(inertial, mass=mass.mass)
    about = dict.fromkeys(("ixx", "iyy", "izz"), mass.inertia)
    _said(ET.SubElement(inertial, "inertia"), **about, ixy=0.0, ixz=0.0, iyz=0.0)
    kind = "prismatic" if joint.prismatic else "revolute"
    axis = ET.SubElement(_joint(model, joint.name, kind, parent, name), "axis")
    ET.SubElement(axis, "xyz").text = "0 0 1"
    dynamics = ET.SubElement(axis, "dynamics")
    _said(dynamics, damping=spring.damping, spring_reference=0.0, spring_stiffness=spring.stiffness)
    return name


def _joint(model: ET.Element, name: str, kind: str, parent: str, child: str) -> ET.Element:
    joint = ET.SubElement(model, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent").text = parent
    ET.SubElement(joint, "child").text = child
    return joint


def _frame(model: ET.Element, name: str, on: str, at: Array) -> None:
    _pose(ET.SubElement(model, "frame", name=name, attached_to=on), at)


def _pose(of: ET.Element, at: Array, relative_to: str = "") -> None:
    pose = ET.SubElement(of, "pose", {"relative_to": relative_to} if relative_to else {})
    pose.text = row([*at[:3, 3], *rpy(at[:3, :3])])


def _said(of: ET.Element, **values: float) -> None:
    for name, value in values.items():
        ET.SubElement(of, name).text = repr(float(value))
