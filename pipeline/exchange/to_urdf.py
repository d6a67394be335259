"""model.urdf: the robot for programs that read URDF, which cannot express a stiffness."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from pipeline.base.arrays import Array
from pipeline.exchange._xml import BASE, FLANGE, causes, document, in_xml, row, rpy, shift
from pipeline.prediction.model import IdentifiedModel

_FAR = 1e6
"""Substitute for infinity in a URDF [m], [rad], [N], [N m], [m/s] or [rad/s]."""


def urdf(handed: IdentifiedModel) -> bytes:
    """The robot as URDF, with the stiffness of each joint in an additional <elasticity> element.

    URDF has no element for the stiffness of a joint, and its parsers ignore unknown elements.
    """
    robot = handed.robot
    root = ET.Element("robot", name=robot.name)
    beside = causes(handed)
    more = f" and {', '.join(beside)}" if beside else ""
    comment = f" campaign {handed.campaign}; covariance{more} in model.toml "
    root.append(ET.Comment(in_xml(comment).replace("--", "- ")))
    ET.SubElement(root, "link", name=BASE)
    parent = BASE
    for j, joint in enumerate(robot.joints):
        element = _joint(root, joint.name, parent, f"link_{joint.name}", robot.placement[j])
        element.set("type", "prismatic" if joint.prismatic else "revolute")
        ET.SubElement(element, "axis", xyz="0 0 1")
        # URDF requires finite limits, also of velocity, which a robot file does not state
        ends = {"lower": max(joint.lower, -_FAR), "upper": min(joint.upper, _FAR)}
        ends |= {"effort": joint.effort or _FAR, "velocity": _FAR}
        ET.SubElement(element, "limit", {name: repr(float(end)) for name, end in ends.items()})
        if stated := handed.stiffness(j):
            stiffness, std, unit = stated
            entries = {"stiffness": repr(stiffness), "std": repr(std), "unit": unit}
            ET.SubElement(element, "elasticity", entries)
        parent = f"link_{joint.name}"
    _joint(root, "flange", parent, FLANGE, robot.flange)
    for name, at in handed.tool.named.items():
        _joint(root, f"to_{in_xml(name)}", FLANGE, in_xml(name), shift(at))
    return document(root)


def _joint(root: ET.Element, name: str, parent: str, child: str, at: Array) -> ET.Element:
    ET.SubElement(root, "link", name=child)
    element = ET.SubElement(root, "joint", name=name, type="fixed")
    ET.SubElement(element, "parent", link=parent)
    ET.SubElement(element, "child", link=child)
    ET.SubElement(element, "origin", xyz=row(at[:3, 3]), rpy=row(rpy(at[:3, :3])))
    return element
