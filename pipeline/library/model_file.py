"""model.toml: the identified model as a file that is exchanged, written by a run and read back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from pipeline.base import toml
from pipeline.base.arrays import Array, Parameter
from pipeline.base.errors import InputError, first_wrong
from pipeline.base.files import words
from pipeline.base.strict import STANDARD_GRAVITY, Numbers
from pipeline.machine import sides
from pipeline.machine.cell import Cell, Tool, paper_cell
from pipeline.machine.effect import Effect
from pipeline.machine.effects import catalogue, unlisted
from pipeline.machine.effects.nameless import competing
from pipeline.machine.robot import Robot
from pipeline.machine.robot.mdh import parse as parse_robot
from pipeline.prediction.model import IdentifiedModel, ModelHypothesis


def dumps(handed: IdentifiedModel) -> str:
    """Text of model.toml: values, uncertainty, covariance, tool and robot, SI throughout."""
    robot, tool = handed.robot, handed.tool
    springs = _parameters(paper_cell(robot, tool).parameters, handed)
    content: dict[str, Any] = {
        "format": 2,
        "campaign": handed.campaign,
        "robot_name": robot.name,
        "verdict": handed.verdict,
        **({} if handed.held_out_m is None else {"held_out_rms_m": handed.held_out_m}),
        **({} if handed.pulled_n is None else {"pulled_n": list(handed.pulled_n)}),
        **_at_pose(handed),
        "covariance": handed.cov.tolist(),
        "recommended": dict(handed.recommended),
        "parameter": [
            spring | dict(zip(_STIFFNESS, handed.stiffness(j) or (), strict=False))
            for j, spring in enumerate(springs)
        ],
        "hypothesis": [_hypothesis(one, tool) for one in handed.hypotheses],
        "tool": _points(tool),
        "gravity_m_s2": robot.gravity.tolist(),
    }
    return _HEAD + toml.dumps(content | {"robot": toml.loads(robot.text, robot.name)})


def _at_pose(handed: IdentifiedModel) -> dict[str, Any]:
    """The test pose, if a reported stiffness depends on it."""
    if handed.at_pose is None or not any(
        sides.columns(handed.robot.n, one.more) for one in handed.hypotheses
    ):
        return {}
    q, force = handed.at_pose
    return {"test_pose": {"q": q.tolist(), "force_n": force.tolist()}}


def _points(tool: Tool) -> dict[str, list[float]]:
    return {name: at.tolist() for name, at in tool.named.items()}


def _hypothesis(one: ModelHypothesis, tool: Tool) -> dict[str, Any]:
    mine = _points(one.cell.tool)
    entries: dict[str, Any] = {} if mine == _points(tool) else {"tool": mine}
    if one.free is not None and one.within is not None:
        entries |= {"undetermined": one.free.T.tolist(), "variance_within": one.within.tolist()}
    return entries | {
        "weight": one.weight,
        "equilibrium": one.cell.equilibrium,
        "effects": [[e.label, e.form] for e in one.more],
        "parameter": _parameters(one.cell.parameters, one),
        "covariance": one.cov.tolist(),
    }


_STIFFNESS = ("stiffness", "stiffness_std", "stiffness_unit")


def _parameters(
    names: Sequence[Parameter], found: IdentifiedModel | ModelHypothesis
) -> list[dict[str, Any]]:
    return [
        {"name": p.name, "unit": p.unit, "value": x, "std": s}
        for p, x, s in zip(names, found.value.tolist(), found.std.tolist(), strict=True)
    ]


_HEAD = """\
# The identified elastic model of a robot, SI: the compliances of its joints ([[parameter]], with
# their covariance) over all that may be true, and each hypothesis with its weight and causes.
# displacement = sum over hypotheses of weight B(q, force) x. In Python:
#   import pipeline
#   pipeline.load_model("model.toml").predict(q, force_n)    # q [m] or [rad], force [N] in F_b
"""


class _Parameter(Numbers):
    name: str
    value: float
    stiffness: float | None = None


class _Hypothesis(Numbers):
    weight: float = 1.0
    equilibrium: str
    effects: list[tuple[str, str]]
    covariance: list[list[float]]
    parameter: list[_Parameter]
    tool: dict[str, tuple[float, float, float]] | None = None
    undetermined: list[list[float]] | None = None
    variance_within: list[float] | None = None


class _TestPose(Numbers):
    q: list[float]
    force_n: tuple[float, float, float]


class _File(Numbers):
    format: Literal[2]
    campaign: str
    verdict: str
    recommended: dict[str, str]
    held_out_rms_m: float | None = None
    pulled_n: tuple[float, float] | None = None
    test_pose: _TestPose | None = None
    parameter: list[_Parameter]
    hypothesis: Annotated[list[_Hypothesis], Field(min_length=1)]
    tool: dict[str, tuple[float, float, float]]
    gravity_m_s2: tuple[float, float, float] = (0.0, 0.0, -STANDARD_GRAVITY)
    robot: dict[str, Any]


def load(path: Path | str) -> IdentifiedModel:
    """Load the model from a model.toml.

    Raises:
        InputError: There is no such file, or it is not a model.
    """
    missing = InputError("cannot be read", "give the path of a model.toml", file=str(path))
    return parse(words(Path(path), str(path), _LARGEST, missing), str(path))


def parse(text: str, file: str = "model.toml") -> IdentifiedModel:
    """Create a model from the text of model.toml.

    Raises:
        InputError: It is not a model, or its effects are unknown.
    """
    try:
        content = _File.model_validate(toml.loads(text, file, _LARGEST))
    except ValidationError as problem:
        path, sentence = first_wrong(problem)
        raise InputError(
            f"is no model ({'.'.join(path)}: {sentence})", _ANEW, file=file
        ) from problem
    robot = parse_robot(toml.dumps(content.robot), file)
    robot = robot.under(np.array(content.gravity_m_s2))
    springs = paper_cell(robot, Tool.of(content.tool))
    return IdentifiedModel(
        content.campaign,
        content.verdict,
        content.recommended,
        tuple(_read(one, springs, file) for one in content.hypothesis),
        np.array([entry.stiffness is not None for entry in content.parameter]),
        content.held_out_rms_m,
        content.pulled_n,
        _pose(content.test_pose, robot, file),
    )


def _pose(stated: _TestPose | None, robot: Robot, file: str) -> tuple[Array, Array] | None:
    if stated is None:
        return None
    if len(stated.q) != robot.n:
        raise InputError(f"test_pose.q is not of {robot.n} joints", _ANEW, file=file)
    return np.array(stated.q), np.array(stated.force_n)


_LARGEST = 2**26
"""Maximum size of a model.toml [B]; the covariances of many hypotheses are long."""
_ANEW = "write it anew with `pipeline run`"


def _read(one: _Hypothesis, springs: Cell, file: str) -> ModelHypothesis:
    tool = springs.tool if one.tool is None else Tool.of(one.tool)
    cell = replace(springs, equilibrium=one.equilibrium, tool=tool)
    cell = cell.with_effects(*(_named(cell.robot, *words, file) for words in one.effects))
    value, cov = np.array([entry.value for entry in one.parameter]), np.array(one.covariance)
    wanted = [p.name for p in cell.parameters]
    if [entry.name for entry in one.parameter] != wanted or cov.shape != (len(value),) * 2:
        raise InputError(
            f"its parameters are not {', '.join(wanted)} with their covariance", _ANEW, file=file
        )
    return ModelHypothesis(one.weight, cell, value, cov, *_beyond(one, len(value), file))


def _beyond(one: _Hypothesis, k: int, file: str) -> tuple[Array | None, Array | None]:
    """Undetermined directions (k, f) and variance apart from them (k,), from the file.

    Raises:
        InputError: One is there without the other, or they do not have k parameters.
    """
    free, within = one.undetermined, one.variance_within
    if not free and not within:
        return None, None
    if not (free and within) or {len(row) for row in (*free, within)} != {k}:
        raise InputError(
            f"undetermined and variance_within are not of {k} parameters", _ANEW, file=file
        )
    return np.array(free, float).T, np.array(within, float)


def _named(robot: Robot, label: str, form: str, file: str) -> Effect:
    for effect in (*catalogue(robot), *competing(robot)):
        if effect.label == label and effect.form == form:
            return effect
    law = unlisted.named(robot, label, form)
    if law is not None:
        return law
    raise InputError(
        f"{robot.name} has no effect {label} {form}".rstrip(),
        "load it with the version of the pipeline that wrote it",
        file=file,
    )
