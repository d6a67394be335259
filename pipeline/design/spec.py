"""A design problem as a person writes it: a checked file from its TOML text."""

from __future__ import annotations

from importlib import resources
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from pipeline.base.errors import InputError, listed
from pipeline.base.strict import (
    Force,
    ForceUncertainty,
    Length,
    Name,
    NotNegative,
    Positive,
    Prose,
    Pull,
    Scatter,
    Seconds,
    Strict,
    Uncertainty,
    checked,
)
from pipeline.base.toml import loads, merged
from pipeline.design.schedule import POSE_S, READING_S, TIGHTEN_S, counts
from pipeline.machine.instrument import InstrumentNoise
from pipeline.machine.surroundings import Surrounded
from pipeline.reduction.settings import AskedPose, Point

SHIPPED = ("paper_reference", "paper_cell", "diagnosis_reference")


_Range = tuple[Length, Length]
"""Interval, from and to [m] or [deg]."""


class _PlanSize(Strict):
    """Number of poses, of pulls in total, and of additional poses without a pull."""

    poses: int = Field(ge=1, le=200)
    readings: int = Field(ge=1, le=10_000)
    unloaded: int = Field(default=0, ge=0, le=200)


class _DesignSpec(Strict):
    """Total time for the pulls, and the duration of each action [s].

    A pose takes `pose_s`, two readings of every reflector and, where it is pulled, one slackening;
    a pull one tightening, and a reading of every reflector and both ends of the chain.
    """

    minutes: Positive
    pose_s: Seconds = POSE_S
    tighten_s: Seconds = TIGHTEN_S
    reading_s: Annotated[Seconds, Field(gt=0)] = READING_S


class _PullSpec(Strict):
    """Load steps of the chain at every pose [N], in the order of tightening.

    Where none is stated, `problem.build` chooses one that suits the robot.
    """

    steps_n: list[Pull] = Field(default=[], min_length=1)


class _AnchorSpec(Strict):
    """Position of the chain's anchor, F_b [m]: a number if it is fixed, an interval if free."""

    x_m: Length | _Range
    y_m: Length | _Range
    z_m: Length | _Range

    @field_validator("x_m", "y_m", "z_m")
    @classmethod
    def in_order(cls, value: float | _Range) -> float | _Range:
        """Refuse an interval that does not increase."""
        if isinstance(value, tuple) and value[0] >= value[1]:
            raise ValueError(f"the interval {list(value)} is empty; give [lower, upper]")
        return value


class _CriterionSpec(Strict):
    """The criterion to minimise, and the measured points at which the deflection is predicted."""

    kind: Literal["test_pose", "workspace", "D", "A", "E"] = "test_pose"
    points: list[Name] | None = None
    force_n: Pull = 300.0
    samples: int = Field(default=200, ge=10, le=10_000)

    @field_validator("force_n", mode="before")
    @classmethod
    def a_size(cls, stated: Any) -> Any:
        """Refuse a vector, which belongs to a test pose."""
        if isinstance(stated, list):
            raise ValueError(
                "force_n of [criterion] is one number, the size of the force in every direction; "
                "the force of a pose, a vector, stands in [[test_pose]]"
            )
        return stated


class _WeightedPose(AskedPose):
    """A test pose and its weight."""

    weight: Positive = 1.0


class NoiseSpec(Strict):
    """Noise of the readings: the paper's one sigma per displacement, or the whole budget."""

    displacement_sigma_m: Scatter | None = None
    reading_sigma_m: Scatter | None = None
    tracker: InstrumentNoise | Literal["paper"] | None = None
    tracker_position_m: Point = (6.5, 8.0, 0.7)
    zero: Literal["before", "before_after"] = "before_after"
    scale_sigma_n: ForceUncertainty = 0.0
    scale_sigma_rel: Uncertainty = 0.0

    @property
    def zero_share(self) -> float:
        """Variance of a pose's zero over that of a reading; 0 for independent displacements."""
        if self.displacement_sigma_m is not None:
            return 0.0
        return 1.0 if self.zero == "before" else 0.5

    @model_validator(mode="after")
    def one_tracker(self) -> NoiseSpec:
        """Require exactly one statement of the noise of a reading."""
        given = [self.displacement_sigma_m, self.reading_sigma_m, self.tracker]
        if sum(value is not None for value in given) != 1:
            raise ValueError(
                "give one of displacement_sigma_m, reading_sigma_m and tracker, and no other"
            )
        return self


class Limits(Strict):
    """Limits of a pose and its chain; None where there is no limit.

    Attributes:
        joints: Limits of single joints, inside the robot's own [m] or degrees.
        margin_deg: Margin of turning joints to the robot's own limits [deg]: software limit
            switches trip before them.
        margin_m: Margin of sliding joints [m].
        wrist_within_deg: Maximum angle of the last three joints from the zero of their axes [deg]:
            more winds up hoses, and a controller may take another way.
        singular_margin: Smallest singular value of the arm's Jacobian [1], see `singular.py`; 0.02
            is about 5 deg from a stretched wrist, elbow or shoulder.
        clear_of_itself: Whether the bodies of the arm must not meet: [[capsules]] of the robot
            file, or rough ones made from its table.
        flange_above_m: Minimum height of the flange, z of F_b [m].
        effector_above_m: Minimum height of load point and reflectors, z of F_b [m].
        chain_m: Shortest and longest chain from load point to anchor [m].
        chain_clearance_m: Minimum distance of the chain from the arm, joint to joint up to the
            flange [m].
        pull_within_deg: Largest angle between the pull and the line from flange to load point.
        payload_kg: Payload of the robot.
        max_relative_std: Largest standard uncertainty of a compliance over its nominal size.
        approach: Direction from which the carriage comes along the rail.
    """

    joints: dict[Name, _Range] = Field(default_factory=dict)
    margin_deg: NotNegative = 5.0
    margin_m: NotNegative = 0.02
    wrist_within_deg: Annotated[float, Field(gt=0, le=720)] = 180.0
    singular_margin: Annotated[float, Field(ge=0, lt=0.2)] = 0.02
    clear_of_itself: bool = True
    flange_above_m: Length | None = None
    effector_above_m: Length | None = None
    chain_m: _Range = (0.1, 20.0)
    chain_clearance_m: Positive | None = None
    pull_within_deg: Annotated[float, Field(gt=0, lt=180)] | None = None
    payload_kg: Positive | None = None
    max_relative_std: Positive = 1.0
    approach: Literal["crossed", "up", "down"] = "crossed"

    @property
    def pull_within_rad(self) -> float | None:
        """`pull_within_deg` in rad."""
        return None if self.pull_within_deg is None else float(np.deg2rad(self.pull_within_deg))


MARGINS = ("margin_deg", "margin_m", "wrist_within_deg", "singular_margin", "clear_of_itself")
"""Limits that keep poses away from where a robot cannot be driven."""


class DiagnosisSpec(Strict):
    """Admissible loss of the criterion in exchange for diagnostic power, and the pulls for it.

    `programmes` are the load steps that a pose may get [N]; a step is negative where the turnbuckle
    is slackened to it from above.
    """

    allowed: Annotated[float, Field(ge=1, allow_inf_nan=False)] = 1.25
    poses: int = Field(ge=1, le=200)
    programmes: list[list[Force]] = Field(min_length=1)

    @field_validator("programmes")
    @classmethod
    def not_empty(cls, value: list[list[float]]) -> list[list[float]]:
        """Require steps in every programme, none of them zero."""
        if not all(steps and all(steps) for steps in value):
            raise ValueError("every programme needs load steps, and no step is 0 N")
        return value


class ProblemFile(Surrounded):
    """A whole problem file."""

    format: Literal[1]
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$")
    robot: Name
    assumptions: list[Prose] = Field(default_factory=list)
    tool: dict[Name, Point]
    plan: _PlanSize
    design: _DesignSpec | None = None
    pull: _PullSpec = _PullSpec()
    anchor: _AnchorSpec
    criterion: _CriterionSpec = _CriterionSpec()
    test_pose: list[_WeightedPose] = Field(default_factory=list)
    noise: NoiseSpec = NoiseSpec(displacement_sigma_m=3e-5)
    limits: Limits = Limits()
    diagnosis: DiagnosisSpec | None = None

    @model_validator(mode="after")
    def points_are_there(self) -> ProblemFile:
        """Require load point, reflectors, and the points of the criterion among them."""
        if "load_point" not in self.tool or len(self.tool) < 2:
            raise ValueError("[tool] needs load_point and at least one reflector")
        self.accepts_only(self.targets)
        unknown = set(self.criterion.points or []) - set(self.targets)
        if unknown:
            raise ValueError(f"criterion.points: {listed(sorted(unknown))} not in [tool]")
        if self.criterion.kind == "test_pose" and not self.test_pose:
            raise ValueError("the criterion test_pose needs a [[test_pose]]")
        return self

    @property
    def targets(self) -> list[str]:
        """Names of the reflectors."""
        return [name for name in self.tool if name != "load_point"]


def shipped(name: str) -> str:
    """Text of a problem that ships."""
    return (resources.files("pipeline.design") / f"{name}.toml").read_text("utf-8")


def parse(text: str, file: str = "problem.toml") -> ProblemFile:
    """A problem file from its TOML text.

    Raises:
        InputError: Not TOML, an unknown word, a value of the wrong kind, or two counts of readings.
    """
    content = loads(text, file)
    if "design" in content and "readings" in content.get("plan", {}):
        raise InputError(
            "design.minutes and plan.readings both say how many readings there are",
            "leave out one of them",
            file=file,
        )
    return validated(content, file, text)


_WAY_OUT = "correct it as docs/design.md describes"


def validated(content: dict[str, Any], file: str = "problem.toml", text: str = "") -> ProblemFile:
    """The content of a problem file, checked.

    Raises:
        InputError: An unknown word, a missing table or a value of the wrong kind.
    """
    if "design" in content:
        content = _in_time(content, file)
    return checked(ProblemFile, content, file, "the problem", _WAY_OUT, text)


def _in_time(content: dict[str, Any], file: str) -> dict[str, Any]:
    """The content with as many poses and readings as fit into `[design] minutes`.

    Raises:
        InputError: None fit.
    """
    asked = checked(_DesignSpec, content["design"], file, "design", _WAY_OUT)
    plan = dict(content.get("plan", {}))
    one = {"poses": 1, "readings": 1}
    spec = checked(ProblemFile, content | {"plan": one | plan}, file, "the problem", _WAY_OUT)
    targets, steps = len(spec.targets), max(1, len(spec.pull.steps_n))
    pose_s = asked.pose_s + 2 * targets * asked.reading_s + asked.tighten_s
    pull_s = asked.tighten_s + (targets + 2) * asked.reading_s
    unpulled_s = plan.get("unloaded", 0) * (asked.pose_s + 2 * targets * asked.reading_s)
    poses, sets = counts(
        60 * asked.minutes - unpulled_s,
        pose_s,
        pull_s,
        steps,
        spec.noise.zero_share,
        plan.get("poses"),
    )
    if not sets:
        need = (poses * (pose_s + steps * pull_s) + unpulled_s) / 60
        raise InputError(
            f"design.minutes = {asked.minutes:g} is too short for {poses} poses with {steps} pulls "
            f"each, which take {need:.0f} min",
            "give more time, or plan fewer poses",
            file=file,
        )
    return content | {"plan": plan | {"poses": poses, "readings": poses * sets * steps}}


def revised(spec: ProblemFile, changes: dict[str, Any]) -> ProblemFile:
    """The problem with some entries changed; tables inside `changes` are merged.

    A requested number of readings takes precedence over the one that fits into a time.
    """
    content = merged(spec.model_dump(exclude_unset=True), changes)
    if "readings" in changes.get("plan", {}):
        content.pop("design", None)
    return validated(content, "the options")
