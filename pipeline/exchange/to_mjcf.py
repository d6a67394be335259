"""model.xml: the robot with a spring at every joint, for MuJoCo."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from pipeline.base.arrays import Array
from pipeline.exchange._xml import (
    BASE,
    FLANGE,
    Spring,
    body,
    comment,
    document,
    in_xml,
    left_out,
    row,
    rpy,
    springs,
)
from pipeline.prediction.model import IdentifiedModel

_USE = (
    "Every joint is a spring about its commanded value. For a pose q [m, rad], before a step:",
    "  data.qpos[:] = model.qpos_spring[:] = q",
    "or write the values of q into springref. The limits of the axes do not act (limited), because",
    "they would stop what a load does to a gear. Gravity is off.",
)


def mjcf(handed: IdentifiedModel) -> bytes:
    """The robot as MJCF: bodies, one joint each with its stiffness, and a site for each point.

    With the joint values q_0 as reference, MuJoCo's spring torques are k (q_0 - q): in equilibrium
    under a force f at the load point, K (q - q_0) = J(q)' f, evaluated on the deflected robot.
    """
    robot, found = handed.robot, springs(handed)
    root = ET.Element("mujoco", model=robot.name)
    root.append(ET.Comment(comment(handed, _USE)))
    ET.SubElement(root, "compiler", angle="radian")
    ET.SubElement(root, "option", gravity="0 0 0", timestep="0.001", integrator="implicitfast")
    root.append(_custom(handed, found))
    inner = ET.SubElement(ET.SubElement(root, "worldbody"), "body", name=BASE)
    for j, spring in enumerate(found):
        inner = _link(inner, spring, robot.placement[j])
    ET.SubElement(inner, "site", {"name": FLANGE, **_at(robot.flange)})
    for name, point in handed.tool.named.items():
        at = robot.flange[:3, :3] @ point + robot.flange[:3, 3]
        ET.SubElement(inner, "site", name=in_xml(name), pos=row(at))
    return document(root)


def _custom(handed: IdentifiedModel, found: list[Spring]) -> ET.Element:
    """User data that MuJoCo preserves: uncertainties, and what springs cannot represent."""
    custom = ET.Element("custom")
    entries = {"campaign": handed.campaign, "verdict": handed.verdict}
    entries |= {f"stiffness_{one.joint.name}": one.said for one in found}
    entries["only_in_model_toml"] = "; ".join(left_out(handed))
    for name, data in entries.items():
        ET.SubElement(custom, "text", name=name, data=in_xml(data))
    return custom


def _link(parent: ET.Element, spring: Spring, placement: Array) -> ET.Element:
    """Add the body after a joint to the previous body."""
    joint, mass = spring.joint, body(spring)
    link = ET.SubElement(parent, "body", {"name": f"link_{joint.name}", **_at(placement)})
    about = row([mass.inertia] * 3)
    inertia = {"pos": row(mass.centre), "mass": repr(mass.mass), "diaginertia": about}
    ET.SubElement(link, "inertial", inertia)
    entries = {
        "name": joint.name,
        "type": "slide" if joint.prismatic else "hinge",
        "axis": "0 0 1",
        "stiffness": repr(spring.stiffness),
        "springref": "0.0",
        "damping": repr(spring.damping),
    }
    if np.isfinite([joint.lower, joint.upper]).all():
        entries |= {"range": row([joint.lower, joint.upper]), "limited": "false"}
    ET.SubElement(link, "joint", entries)
    return link


def _at(frame: Array) -> dict[str, str]:
    """Position and orientation of a frame (4, 4) relative to the previous one.

    The quaternion [w, x, y, z] is that of Rz(yaw) Ry(pitch) Rx(roll), from products of half-angle
    functions.
    """
    (sr, sp, sy), (cr, cp, cy) = (f(rpy(frame[:3, :3]) / 2) for f in (np.sin, np.cos))
    quat = [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
    return {"pos": row(frame[:3, 3]), "quat": row(quat)}
