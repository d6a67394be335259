"""A measurement plan from TOML text: measurements and true values of a virtual campaign."""

from __future__ import annotations

import re
from datetime import datetime
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from pipeline.base.errors import UsageError
from pipeline.base.strict import (
    STANDARD_GRAVITY,
    Degrees,
    Force,
    ForceUncertainty,
    JointValue,
    Mass,
    MassUncertainty,
    Name,
    NotNegative,
    Scatter,
    Seconds,
    Stiffness,
    Strict,
    Uncertainty,
    checked,
)
from pipeline.base.strict import Pull as PullForce
from pipeline.base.toml import loads, merged
from pipeline.design.pull import round_pull, share
from pipeline.library import holds
from pipeline.machine.instrument import InstrumentNoise
from pipeline.machine.robot import Robot
from pipeline.machine.surroundings import Surrounded
from pipeline.readers._units import Usual
from pipeline.reduction.settings import AskedPose, PayloadSettings, Point, Scale
from pipeline.store.campaign import unfit

TOOL: dict[str, Point] = {
    "load_point": (0.15, 0.0, 0.25),
    "P1": (0.20, 0.05, 0.12),
    "P2": (-0.12, 0.19, 0.10),
    "P3": (-0.10, -0.18, 0.22),
}
"""The effector of the reference set-up [m], flange frame."""

BASE: dict[str, Point] = {
    "B1": (0.6, -0.5, -0.30),
    "B2": (0.6, 18.5, -0.30),
    "B3": (-0.6, 18.5, -0.28),
    "B4": (-0.6, -0.5, -0.28),
}
"""Fixed reflectors at the ends of the rail's bed [m], F_b."""


_PAYLOADS = {
    "light": PayloadSettings(mass_kg=60.0, center_m=(0.05, 0.02, 0.10)),
    "heavy": PayloadSettings(mass_kg=220.0, center_m=(-0.04, 0.10, 0.25)),
}
"""Two payloads within the rating of a KR500, their centres off the axis of its last joint."""


class _PosePlan(Strict):
    """Poses of the robot: joint values, or the number of feasible poses to draw.

    Attributes:
        count: Number of poses drawn when `q` is not given.
        q: Joint values of each pose, prismatic joints in m, revolute in degrees.
        approach: Direction from which the carriage came, +1 or -1 per pose; alternating when not
            given.
    """

    count: int = Field(default=16, ge=1, le=100_000)
    q: list[list[JointValue]] | None = Field(default=None, min_length=1)
    approach: list[Literal[1, -1]] | None = None

    @property
    def number(self) -> int:
        """Number of poses."""
        return self.count if self.q is None else len(self.q)

    @model_validator(mode="after")
    def one_approach_per_pose(self) -> _PosePlan:
        """Require as many approaches as poses, and only one of count and q."""
        if self.q is not None and "count" in self.model_fields_set:
            raise ValueError("count and q are both given; keep one of them")
        if self.approach is not None and len(self.approach) != self.number:
            raise ValueError(f"approach has {len(self.approach)} entries for {self.number} poses")
        return self


class _PullPlan(Strict):
    """Loads of the robot at every pose; loads that are not stated are chosen to suit the robot.

    Attributes:
        load: A chain with a scale, weights at the load point, or each payload on the flange.
        masses_kg: The weights in the order in which they are hung.
        mass_sigma_kg: Standard uncertainty of each, as stated; the true mass is drawn from it.
        steps_n: Reading of the scale at each load step, in the order of tightening.
        repeats: Number of passes through the steps, the chain released in between.
        pose_steps_n: Load steps of each pose, where poses differ; a step is negative where the
            turnbuckle is slackened to it from above. A pose without steps is read unloaded only.
        zero: Whether the unloaded targets are read only before the pulls or after them too.
        anchors: Attachment points on the floor [m], F_b; spread along the robot when not given.
        anchor: Index into `anchors` per pose; in turn for drawn poses, else the nearest in reach.
        setting_sd_n: Standard deviation with which the operator meets a step [N].
    """

    load: Literal["chain", "weights", "payloads"] = "chain"
    masses_kg: list[Mass] = Field(default=[100.0, 250.0, 150.0], min_length=1)
    mass_sigma_kg: MassUncertainty = 0.0
    steps_n: list[PullForce] = Field(default=[1200.0, 3000.0, 2000.0], min_length=1)
    repeats: int = Field(default=1, ge=1)
    pose_steps_n: list[list[Force]] | None = Field(default=None, min_length=1)
    zero: Literal["before", "before_after"] = "before_after"
    anchors: list[Point] | None = Field(default=None, min_length=1)
    anchor: list[int] | None = None
    setting_sd_n: ForceUncertainty = 15.0


class _TrackerPlan(Strict):
    """The tracker: its pose, its noise and its export.

    Attributes:
        position: Of its origin [m], F_b.
        yaw_deg: Rotation of its frame about z, then `pitch_deg` about y, then `roll_deg` about x.
        kind: Kind of instrument in campaign.toml.
        measures: Each target by itself, or one pose from which all targets are computed.
        sigma_rad: Standard uncertainty per axis of such a pose's rotation.
        sigma_m: Standard uncertainty per axis; this, or `noise`.
        noise: `paper` for Eq. (18), or range and transverse parts in the beam's frame.
        noise_scale: True scatter over stated scatter; 0 for readings without noise.
        stated: False leaves the noise out of campaign.toml.
        dialect: Format of the export, a key of `readers.catalogue`.
        unit: Unit of length in the export.
        digits: Decimals of a coordinate in that unit, or `full`; by default 4 for mm, 7 for m, 6
            for in.
    """

    position: Point = (6.5, 8.0, 0.7)
    yaw_deg: Degrees = 132.0
    pitch_deg: Degrees = 0.4
    roll_deg: Degrees = -0.3
    kind: Literal["laser_tracker", "camera", "arm", "unknown"] = "laser_tracker"
    measures: Literal["points", "poses"] = "points"
    sigma_rad: Uncertainty = 1e-4
    sigma_m: Scatter | None = None
    noise: InstrumentNoise | Literal["paper"] | None = None
    noise_scale: NotNegative = 1.0
    stated: bool = True
    dialect: str = "plain"
    unit: Usual = "mm"
    digits: Annotated[int, Field(ge=0, le=15)] | Literal["full"] | None = None

    @field_validator("digits", mode="before")
    @classmethod
    def digits_count(cls, stated: Any) -> Any:
        """Require a number of digits or `full`, with one message for anything else."""
        if stated is None or stated == "full" or re.fullmatch(r"[0-9]|1[0-5]", str(stated)):
            return stated
        raise ValueError(f'"{stated}" is neither a number from 0 to 15 nor full')

    @model_validator(mode="after")
    def one_noise(self) -> _TrackerPlan:
        """Allow sigma_m or noise, not both."""
        if self.sigma_m is not None and self.noise is not None:
            raise ValueError("sigma_m and noise are both given; keep one of them")
        return self

    @property
    def model(self) -> float | InstrumentNoise | Literal["paper"]:
        """The noise model in use; 0.03 mm per axis when none is given."""
        return self.noise or self.sigma_m or 3e-5

    @property
    def decimals(self) -> int | None:
        """Decimals in the export; None for all digits."""
        if self.digits == "full":
            return None
        return {"mm": 4, "m": 7, "in": 6}[self.unit] if self.digits is None else self.digits


class SpringScale(Scale):
    """The spring scale as certified, and its true errors; its zero error is drawn as stated.

    Attributes:
        sigma_n: Standard uncertainty of a reading, constant part, as stated [N].
        noise_scale: True scatter over stated scatter.
        gain_error: True relative gain error; drawn from `gain_sigma` when not given.
    """

    sigma_n: ForceUncertainty = 2.0
    noise_scale: NotNegative = 1.0
    gain_error: Annotated[float, Field(ge=-1, le=10)] | None = None


class _Timing(Strict):
    """Start and durations of the readings."""

    start: datetime = datetime(2026, 11, 3, 8, 0, 8)
    reading_s: Annotated[Seconds, Field(gt=0)] = 8.0
    pull_s: Seconds = 60.0
    pose_s: Seconds = 120.0


class _TrueValues(Strict):
    """True values that no file of the campaign contains.

    Attributes:
        stiffness: Of every joint [N/m] or [N m/rad]; nominal when not given.
        stiffness_spread: Every stiffness is multiplied by a random factor within 1 +- this.
        tool_sd_m: Standard deviation of the tool's points from nominal, per axis.
        equilibrium: Whether the wrench acts on the undeformed or on the deflected robot.
        effects: Further effects and blunders, `rail_roll`, `joint_tilt:2=2x`, `scale_zero=20`.
    """

    stiffness: list[Stiffness] | None = None
    stiffness_spread: Annotated[float, Field(ge=0, lt=1)] = 0.0
    tool_sd_m: Uncertainty = 0.0
    equilibrium: Literal["undeformed", "deformed"] = "undeformed"
    effects: list[Name] = Field(default=[])


class Plan(Surrounded):
    """A whole virtual campaign; with the seed it determines every byte that is written."""

    name: str = Field(default="kr500_demo", pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$")
    robot: Name = "kr500_rail"
    seed: int = Field(default=1, ge=0)
    tool: dict[Name, Point] = Field(default=TOOL)
    base_frame: dict[Name, Point] = Field(default=BASE)
    poses: _PosePlan = _PosePlan()
    pulls: _PullPlan = _PullPlan()
    tracker: _TrackerPlan = _TrackerPlan()
    scale: SpringScale = SpringScale()
    payload: dict[Name, PayloadSettings] = Field(default=_PAYLOADS, min_length=1)
    clock: _Timing = _Timing()
    hidden: _TrueValues = _TrueValues()
    test_pose: AskedPose | None = None

    @field_validator("name")
    @classmethod
    def names_a_folder(cls, name: str) -> str:
        """Require a name that a campaign's folder may have."""
        if why := unfit(name):
            raise ValueError(f'"{name}" cannot name a campaign ({why})')
        return name

    @model_validator(mode="after")
    def tool_is_complete(self) -> Plan:
        """Require a load point and at least one target; three base reflectors, or none."""
        if "load_point" not in self.tool or len(self.tool) < 2:
            raise ValueError("tool needs load_point and at least one target")
        self.accepts_only(self.targets)
        if 0 < len(self.base_frame) < 3:
            raise ValueError("base_frame needs at least three reflectors, or none")
        return self

    @model_validator(mode="after")
    def anchors_are_there(self) -> Plan:
        """Require one anchor index per pose, each of them in the list."""
        chosen, anchors = self.pulls.anchor, self.pulls.anchors
        if chosen is None:
            return self
        if anchors is None or len(chosen) != self.poses.number:
            raise ValueError("pulls.anchor needs pulls.anchors and one index per pose")
        if not all(0 <= index < len(anchors) for index in chosen):
            raise ValueError(f"pulls.anchor counts from 0 to {len(anchors) - 1}")
        return self

    @model_validator(mode="after")
    def steps_are_there(self) -> Plan:
        """Where poses have their own steps, require that one has any and that no step is zero."""
        steps = self.pulls.pose_steps_n
        if steps is None:
            return self
        if len(steps) != self.poses.number:
            raise ValueError(
                f"pulls.pose_steps_n is for {len(steps)} poses, there are {self.poses.number}"
            )
        if not any(steps) or not all(all(own) for own in steps):
            raise ValueError("pulls.pose_steps_n: a pose at least needs steps, and no step is 0 N")
        return self

    @property
    def targets(self) -> list[str]:
        """Names of the measured reflectors."""
        return [name for name in self.tool if name != "load_point"]

    def without_noise(self) -> Plan:
        """The same campaign without random errors in its readings, and with all digits written."""
        return revised(
            self,
            {
                "tracker": {"noise_scale": 0.0, "digits": "full"},
                "scale": {"noise_scale": 0.0, "gain_error": self.scale.gain_error or 0.0},
            },
        )


def parse(text: str, file: str = "plan.toml") -> Plan:
    """A plan from its TOML text.

    Raises:
        InputError: Not TOML, an unknown word or a value out of range; names the place.
    """
    return _validated(loads(text, file), file, text)


def fitted(plan: Plan, robot: Robot) -> Plan:
    """The plan with loads that suit the robot in place of those that are not stated.

    With the pulls, the scale and the accuracy of setting them are scaled: a dynamometer is chosen
    by its range, and its uncertainty is about the same fraction of it.

    Raises:
        InputError: A load is more than any such robot can hold.
    """
    size = share(robot, np.array(plan.tool["load_point"]))
    if size != 1.0:
        plan = revised(plan, _unstated(plan, size))
    way_out = "state others in the plan, or leave them out"
    holds.refuse_absurd(robot, _hardest(plan), way_out, "plan")
    return plan


def _unstated(plan: Plan, size: float) -> dict[str, Any]:
    """Loads that the plan does not state, `size` times those of the reference set-up."""
    pulls, scale, one = plan.pulls, plan.scale, round_pull
    changed: dict[str, Any] = {
        "steps_n": [one(size * step) for step in pulls.steps_n],
        "masses_kg": [one(size * mass) for mass in pulls.masses_kg],
        "setting_sd_n": one(size * pulls.setting_sd_n),
    }
    payload = {
        name: body.model_copy(update={"mass_kg": one(size * body.mass_kg)}).model_dump()
        for name, body in plan.payload.items()
    }
    return {
        "pulls": {k: v for k, v in changed.items() if k not in pulls.model_fields_set},
        "scale": {}
        if scale.model_fields_set & {"sigma_n"}
        else {"sigma_n": one(size * scale.sigma_n)},
        **({} if "payload" in plan.model_fields_set else {"payload": payload}),
    }


def _hardest(plan: Plan) -> float:
    """The largest load of a plan [N]."""
    pulls = plan.pulls
    if pulls.load == "payloads":
        return STANDARD_GRAVITY * max(body.mass_kg for body in plan.payload.values())
    if pulls.load == "weights":
        return STANDARD_GRAVITY * max(pulls.masses_kg)
    return max(abs(step) for steps in pulls.pose_steps_n or [pulls.steps_n] for step in steps)


_INSTRUMENT = {
    "range_m": 8e-6,
    "range_per_m": 0.3e-6,
    "transverse_m": 7.5e-6,
    "transverse_per_m": 3e-6,
}
"""Half the MPE of an AT500-class tracker, the usual size of its standard uncertainty."""


def with_noise(plan: Plan, word: str) -> Plan:
    """The plan with the tracker's noise as typed: `paper`, `instrument`, or m per axis.

    Raises:
        UsageError: It is none of these.
        InputError: The number is out of range.
    """
    named = {"paper": "paper", "instrument": _INSTRUMENT}
    try:
        sigma_m = None if word in named else float(word)
    except ValueError as problem:
        raise UsageError(
            f'"{word}" is no noise: write paper, instrument, or metres per axis like 3e-5'
        ) from problem
    return revised(plan, {"tracker": {"noise": named.get(word), "sigma_m": sigma_m}})


def revised(plan: Plan, changes: dict[str, Any]) -> Plan:
    """The plan with some entries changed; tables inside `changes` are merged, not replaced.

    Raises:
        InputError: A change is an unknown word or out of range.
    """
    return _validated(merged(plan.model_dump(exclude_unset=True), changes), "plan")


def _validated(content: dict[str, Any], file: str, text: str = "") -> Plan:
    return checked(Plan, content, file, "the plan", "correct the plan", text)
