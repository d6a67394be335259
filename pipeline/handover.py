"""The identified model as a file for others: load it, ask what a force does, correct a path."""

from __future__ import annotations

import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from pipeline import toml
from pipeline.cell import Cell, Prediction, Tool, jacobian, paper_cell
from pipeline.cell import predict as forward
from pipeline.effects import Effect, Noise, Observation, Pulls, Wrench, catalogue
from pipeline.errors import InputError
from pipeline.results import Array, Bools, Estimate, Locked
from pipeline.robot import Robot
from pipeline.robot.mdh import parse as parse_robot


@dataclass(frozen=True, eq=False)
class Deflection(Locked):
    """How a point of the tool gives way.

    Attributes:
        displacement: Loaded minus unloaded [m], F_b, shape (m, 3).
        cov: Its covariance [m^2], shape (m, 3, 3); infinite on the diagonal where the campaign did
            not determine a spring that acts there.
    """

    displacement: Array
    cov: Array

    @property
    def std(self) -> Array:
        """Standard uncertainty per axis [m], shape (m, 3)."""
        return np.sqrt(np.diagonal(self.cov, axis1=1, axis2=2))


@dataclass(frozen=True, eq=False)
class Model(Locked):
    """An identified robot: what acts in the machine, with values and covariance.

    What belongs to the measurement alone (scale, tracker, noise) is no part of it; having been
    estimated beside the springs, it stays in their covariance.

    Attributes:
        campaign: The campaign it comes from.
        verdict: What the diagnosis said of it, as in result.json.
        cell: Robot, tool and effects.
        value: Parameters of the cell, SI, shape (k,).
        cov: Their covariance, shape (k, k); infinite on the diagonal where undetermined.
    """

    campaign: str
    verdict: str
    cell: Cell
    value: Array
    cov: Array

    @staticmethod
    def load(path: Path | str) -> Model:
        """The model in a model.toml.

        Raises:
            InputError: There is no such file, or it is no model.
        """
        try:
            text = Path(path).read_text("utf-8")
        except (OSError, UnicodeDecodeError) as problem:
            raise InputError(
                "cannot be read", "give the path of a model.toml", file=str(path)
            ) from problem
        return parse(text, str(path))

    @property
    def std(self) -> Array:
        """Standard uncertainty of `value`, shape (k,)."""
        return np.sqrt(np.diag(self.cov))

    def predict(self, q: Array, force: Array, point: Array | None = None) -> Deflection:
        """What a force does to the point of the tool where it acts.

        Args:
            q: Joint values [m] or [rad], shape (m, n) or (n,).
            force: Force on the robot [N], F_b, shape (m, 3) or (3,).
            point: Point of the tool in the flange frame [m], shape (3,); the campaign's load point
                when not given.
        """
        cell = self.at(point)
        pulls = _pulls(q, force)
        displacement = forward(cell, pulls, self.value).displacement[:, 0]
        A = jacobian(replace(cell, equilibrium="undeformed"), pulls, self.value)[:, 0]
        return Deflection(displacement, self._spread(A))

    def positions(self, q: Array, force: Array, points: Array) -> Prediction:
        """Points of the tool unloaded and loaded, the force acting at the first of them.

        Args:
            q: Joint values [m] or [rad], shape (m, n).
            force: Force on the robot [N], F_b, shape (m, 3).
            points: In the flange frame [m], shape (t, 3).
        """
        names = np.array([str(k) for k in range(len(points))], dtype=object)
        cell = replace(self.cell, tool=Tool(points[0], names, points))
        return forward(cell, _pulls(q, force), self.value)

    def at(self, point: Array | None) -> Cell:
        """Its cell with a tool of one point, where the force acts and the displacement is seen."""
        load = self.cell.tool.load_point if point is None else np.asarray(point, float)
        return replace(self.cell, tool=Tool(load, np.array(["point"], dtype=object), load[None]))

    def _spread(self, A: Array) -> Array:
        """Covariance of A x, A of shape (m, 3, k); infinite where undetermined springs move it."""
        known = np.isfinite(self.std)
        cov = A[..., known] @ self.cov[np.ix_(known, known)] @ np.swapaxes(A[..., known], 1, 2)
        typical = np.array([p.typical for p in self.cell.parameters])
        lost = np.abs(A * typical)[..., ~known].max(axis=-1, initial=0.0) > NOTHING_M
        m, axis = np.nonzero(lost)
        cov[m, axis, axis] = np.inf
        return np.asarray(cov)


NOTHING_M = 1e-9
"""A spring that moves a point less than this at its typical size does not act there."""


def model(campaign: str, verdict: str, cell: Cell, estimate: Estimate) -> Model:
    """What is handed over of an estimate: the machine without the measurement."""
    keep = [not _measurement(effect) for effect in cell.effects]
    of_machine = np.repeat(keep, [len(effect.parameters) for effect in cell.effects])
    effects = tuple(effect for effect, kept in zip(cell.effects, keep, strict=True) if kept)
    return Model(
        campaign=campaign,
        verdict=verdict,
        cell=replace(cell, effects=effects),
        value=estimate.value[of_machine],
        cov=estimate.cov[np.ix_(of_machine, of_machine)],
    )


def extended(
    campaign: str, verdict: str, cell: Cell, causes: Iterable[Effect], estimate: Estimate | None
) -> Model | None:
    """What is handed over of an estimate with named causes in it; None where there are none."""
    whole = cell.with_effects(*causes)
    if estimate is None or whole.parameters != estimate.parameters:
        return None
    return model(campaign, verdict, whole, estimate)


def _measurement(effect: Effect) -> bool:
    return any(isinstance(facet, Wrench | Observation | Noise) for facet in effect.facets)


def files(handed: Model) -> dict[str, bytes]:
    """The files of a hand-over by name."""
    return {"model.toml": dumps(handed).encode(), "model.urdf": urdf(handed).encode()}


def dumps(handed: Model) -> str:
    """model.toml: values, uncertainty, covariance, tool and robot, SI throughout."""
    cell, std = handed.cell, handed.std
    baseline = len(paper_cell(cell.robot, cell.tool).effects)
    content: dict[str, Any] = {
        "format": 1,
        "campaign": handed.campaign,
        "robot_name": cell.robot.name,
        "verdict": handed.verdict,
        "equilibrium": cell.equilibrium,
        "effects": [[e.label, e.form] for e in cell.effects[baseline:]],
        "covariance": handed.cov.tolist(),
        "parameter": [
            {"name": p.name, "unit": p.unit, "value": float(x), "std": float(s)}
            | _stiffness(p.name, float(x), float(s), cell.robot)
            for p, x, s in zip(cell.parameters, handed.value, std, strict=True)
        ],
        "tool": {
            "load_point": cell.tool.load_point.tolist(),
            **dict(zip(cell.tool.targets, cell.tool.points.tolist(), strict=True)),
        },
    }
    robot = tomllib.loads(cell.robot.text)
    return HEAD + toml.dumps(content | {"robot": robot})


HEAD = """\
# The identified elastic model of a robot: x = c_j (compliances) and what the diagnosis named, SI.
# displacement = B(q, force) x, covariance B C B'. In Python:
#   from pipeline.handover import Model
#   Model.load("model.toml").predict(q, force)      # q [m, rad], force [N] in F_b
"""


def _stiffness(name: str, x: float, std: float, robot: Robot) -> dict[str, Any]:
    """The stiffness behind a joint's compliance, where it has one."""
    units = {f"c_{joint.name}": joint.stiffness_unit for joint in robot.joints}
    if name not in units or not np.isfinite(std) or x <= 0:
        return {}
    return {"stiffness": 1 / x, "stiffness_std": std / x**2, "stiffness_unit": units[name]}


class _Parameter(BaseModel):
    model_config = ConfigDict(extra="ignore")

    name: str
    value: float


class _File(BaseModel):
    model_config = ConfigDict(extra="ignore")

    format: int
    campaign: str
    verdict: str
    equilibrium: str
    effects: list[tuple[str, str]]
    covariance: list[list[float]]
    parameter: list[_Parameter]
    tool: dict[str, tuple[float, float, float]]
    robot: dict[str, Any]


def parse(text: str, file: str = "model.toml") -> Model:
    """A model from the text of model.toml.

    Raises:
        InputError: It is no model, or its effects are unknown.
    """
    way_out = "write it anew with `pipeline run`"
    try:
        content = _File.model_validate(tomllib.loads(text))
    except (tomllib.TOMLDecodeError, ValidationError) as problem:
        said = problem.errors()[0]["msg"] if isinstance(problem, ValidationError) else problem
        raise InputError(f"is no model ({said})", way_out, file=file) from problem
    robot = parse_robot(toml.dumps(content.robot), file)
    points = {name: np.array(at) for name, at in content.tool.items() if name != "load_point"}
    names = np.array(list(points), dtype=object)
    tool = Tool(np.array(content.tool["load_point"]), names, np.array(list(points.values())))
    cell = replace(paper_cell(robot, tool), equilibrium=content.equilibrium)
    cell = cell.with_effects(*(_named(robot, *words, file) for words in content.effects))
    value = np.array([entry.value for entry in content.parameter])
    cov = np.array(content.covariance)
    wanted = [p.name for p in cell.parameters]
    if [entry.name for entry in content.parameter] != wanted or cov.shape != (len(value),) * 2:
        raise InputError(
            f"its parameters are not {', '.join(wanted)} with their covariance", way_out, file=file
        )
    return Model(content.campaign, content.verdict, cell, value, cov)


def _named(robot: Robot, label: str, form: str, file: str) -> Effect:
    for effect in catalogue(robot):
        if effect.label == label and form in (effect.form, ""):  # "" before it had several
            return effect
    raise InputError(
        f"{robot.name} has no effect {label} {form}".rstrip(),
        "load it with the version of the pipeline that wrote it",
        file=file,
    )


def _pulls(q: Array, force: Array) -> Pulls:
    """Loads outside of any campaign: nothing is known of branch, approach and time."""
    q, force = np.atleast_2d(np.asarray(q, float)), np.atleast_2d(np.asarray(force, float))
    m = max(len(q), len(force))
    number, none = np.arange(1, m + 1), np.zeros(m)
    return Pulls(
        pose=number,
        repeat=np.ones(m, dtype=np.int64),
        q=np.broadcast_to(q, (m, q.shape[1])),
        force=np.broadcast_to(force, (m, 3)),
        branch=none,
        approach=none,
        time=none,
        time_zero=none,
    )


def urdf(handed: Model) -> str:
    """The robot as URDF; every joint carries its stiffness in an <elasticity> of its own.

    URDF has no word for the stiffness of a joint and its readers pass over words they do not know.
    """
    cell, robot = handed.cell, handed.cell.robot
    root = ET.Element("robot", name=robot.name)
    baseline = len(paper_cell(robot, cell.tool).effects)
    named = ", ".join(effect.label for effect in cell.effects[baseline:])
    root.append(
        ET.Comment(
            f" campaign {handed.campaign.replace('--', '- ')}; covariance"
            f"{f' and {named}' if named else ''} in model.toml "
        )
    )
    ET.SubElement(root, "link", name="F_b")
    parent = "F_b"
    known = np.isfinite(handed.std)
    for j, joint in enumerate(robot.joints):
        element = _joint(root, joint.name, parent, f"link_{joint.name}", robot.placement[j])
        element.set("type", "prismatic" if joint.prismatic else "revolute")
        ET.SubElement(element, "axis", xyz="0 0 1")
        _limits(element, joint.lower, joint.upper)
        _elasticity(element, handed, j, known)
        parent = f"link_{joint.name}"
    _joint(root, "flange", parent, "F_flange", robot.flange)
    points = {"load_point": cell.tool.load_point}
    points |= dict(zip(cell.tool.targets, cell.tool.points, strict=True))
    for name, at in points.items():
        shift = np.eye(4)
        shift[:3, 3] = at
        _joint(root, f"to_{name}", "F_flange", name, shift)
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, "unicode") + "\n"


def _joint(root: ET.Element, name: str, parent: str, child: str, at: Array) -> ET.Element:
    ET.SubElement(root, "link", name=child)
    element = ET.SubElement(root, "joint", name=name, type="fixed")
    ET.SubElement(element, "parent", link=parent)
    ET.SubElement(element, "child", link=child)
    roll = np.arctan2(at[2, 1], at[2, 2])
    pitch = np.arctan2(-at[2, 0], np.hypot(at[2, 1], at[2, 2]))
    yaw = np.arctan2(at[1, 0], at[0, 0])
    ET.SubElement(element, "origin", xyz=_row(at[:3, 3]), rpy=_row([roll, pitch, yaw]))
    return element


def _limits(element: ET.Element, lower: float, upper: float) -> None:
    """URDF wants finite limits of everything, effort and velocity too, which a robot file lacks."""
    ends = {"lower": max(lower, -FAR), "upper": min(upper, FAR), "effort": FAR, "velocity": FAR}
    ET.SubElement(element, "limit", {name: repr(float(end)) for name, end in ends.items()})


FAR = 1e6


def _elasticity(element: ET.Element, handed: Model, j: int, known: Bools) -> None:
    joint, x = handed.cell.robot.joints[j], float(handed.value[j])
    if not known[j] or x <= 0:
        return
    std = float(handed.std[j])
    ET.SubElement(
        element,
        "elasticity",
        stiffness=repr(1 / x),
        std=repr(std / x**2),
        unit=joint.stiffness_unit,
    )


def _row(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)
