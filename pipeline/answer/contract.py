"""The answer to a campaign, frozen; result.json is its dump, key by key.

docs/result.schema.json and the table in docs/answer.md are made from here (`make schema`). Keys
may be added, not renamed. Terminal, report and history read these records and nothing else.
"""

from __future__ import annotations

import math
from datetime import date
from enum import StrEnum
from operator import not_ as _nothing
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo

from pipeline.base.quantities import mix
from pipeline.diagnosis.finding import Finding, Verdict
from pipeline.prediction.decision import Decision


def _known(value: Any, info: ValidationInfo) -> Any:
    """None for a number that is infinite or undefined; in result.json itself there is none."""
    if info.mode == "json" or not isinstance(value, float):
        return value
    return float(value) if math.isfinite(value) else None


_Number = Annotated[float | None, BeforeValidator(_known)]
"""A number, or null where nobody knows it: the one place where one that is none becomes that."""
_Where = int | str | None


def _dated(text: str) -> str:
    date.fromisoformat(text[:10])
    return text


_Day = Annotated[str, AfterValidator(_dated)]
"""A date, or a date and time, in ISO 8601."""

_Interval = tuple[_Number, _Number]
_Share = Annotated[float, Field(ge=-1e-9, le=1 + 1e-9)]

_T = TypeVar("_T")
_Absent = Annotated[_T, Field(exclude_if=_nothing)]
"""A key that is absent where it holds nothing."""

LEAST_CONTROLLED = 10
"""So many of the errors that are controlled least stand in result.json."""


class Which(StrEnum):
    """The model whose values the answer gives."""

    JOINT_SPRINGS = "joint_springs"
    EXTENDED = "extended"
    AVERAGED = "averaged"


class Data(StrEnum):
    """The data that they are identified from."""

    AS_GIVEN = "as_given"
    CORRECTED = "corrected"


class TableSource(StrEnum):
    """Which table of the robot's geometry they rest on."""

    AS_DELIVERED = "as_delivered"
    ESTIMATED = "estimated"


class Reason(StrEnum):
    """Why these values."""

    ADEQUATE = "adequate"
    TOO_SMALL = "too_small_to_name"
    CAUSE_IDENTIFIED = "cause_identified"
    CAUSE_AND_RIVALS = "cause_and_rivals"
    CAUSE_DOUBTFUL = "cause_doubtful"
    RIVALS = "rivals"
    SPRINGS_UNTOUCHED = "springs_untouched"
    WEIGHED_ANEW = "weighed_anew"
    SPRINGS_DISAGREE = "springs_disagree"
    UNEXPLAINED = "unexplained"
    MISTAKE = "mistake"
    MISTAKE_AND_TOO_SMALL = "mistake_and_too_small_to_name"
    MISTAKE_SPRINGS_UNTOUCHED = "mistake_springs_untouched"
    MISTAKE_AND_CAUSE = "mistake_and_cause"
    MISTAKE_AND_RIVALS = "mistake_and_rivals"
    MISTAKE_AND_UNEXPLAINED = "mistake_and_unexplained"

    @property
    def unseen(self) -> bool:
        """The uncertainties hold what causes may change that are too small to name."""
        return self in (Reason.TOO_SMALL, Reason.MISTAKE_AND_TOO_SMALL)

    @property
    def holds_for_its_readings(self) -> bool:
        """False where the values do not explain the readings: shown, not compared with others."""
        return self not in (
            Reason.UNEXPLAINED,
            Reason.MISTAKE_AND_UNEXPLAINED,
            Reason.SPRINGS_DISAGREE,
        )


class NoiseFrom(StrEnum):
    """Where the noise that weights the readings is known from."""

    STATED = "stated"
    REPLICATES = "replicates"
    RESIDUALS = "residuals"


class Equilibrium(StrEnum):
    """The robot on which the force acts."""

    DEFORMED = "deformed"
    UNDEFORMED = "undeformed"


class JointType(StrEnum):
    """How a joint moves."""

    PRISMATIC = "prismatic"
    REVOLUTE = "revolute"


class Predicted(StrEnum):
    """What the gain of a cause is measured by."""

    DISPLACEMENTS = "displacements"
    UNLOADED_POSITIONS = "unloaded positions"
    POSITIONS = "positions"


class Odd(StrEnum):
    """What a reader has to know about a stiffness."""

    NO_LEVER = "no_lever"
    MIXED = "mixed"
    NEGATIVE = "negative"
    UNCERTAIN = "uncertain"
    ZERO_BESIDE_A_CAUSE = "zero_beside_a_cause"
    MAY_BE_ZERO = "may_be_zero"
    LOST = "lost"
    SCATTERED = "scattered"
    TOGETHER = "together"
    DEPENDS = "depends"


class Fact(BaseModel):
    """A part of the answer; it knows every key it allows."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        allow_inf_nan=False,
        strict=True,
        validate_by_name=True,
        validate_by_alias=True,
        serialize_by_alias=True,
    )

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse it: what is to be changed is `answer.as_json()`, a copy as plain data."""
        raise AttributeError(f"an answer is not changed, and {name} stays; change a copy of it")


class BudgetPart(Fact):
    """Contribution of one source of error to the uncertainty of a stiffness."""

    source: str
    """tracker, zero, force_reading, direction, registration, ..."""
    std: float
    """standard uncertainty, in the stiffness' unit"""
    share: float
    """part of the variance"""


class Remark(Fact):
    """One thing to know of a stiffness; its numbers are those of the stiffness."""

    odd: Odd
    cause: str | None = None
    """cause it depends on, in words"""
    others: tuple[str, ...] = ()
    """what may act in place of that cause, in words"""


class OneWay(Fact):
    """A stiffness where the torque on the joint has one sign; in the unit of the joint's."""

    value: _Number
    """null where the data give none"""
    std: _Number
    """standard uncertainty"""
    ci95: _Interval
    """95 % interval; null is no limit"""
    compliance: _Number
    """the estimate itself"""
    compliance_std: _Number
    """its standard uncertainty; null: undetermined"""
    axis_turns: Literal["plus", "minus"] | None
    """which way this torque turns the controller's axis; null without one"""


class BySign(Fact):
    """Both stiffnesses of a joint, by the sign of the torque in the sense of the robot file."""

    positive: OneWay
    negative: OneWay
    of: Literal["total", "pull"]
    """the torque whose sign it is: of pull and own weight, or of the pull alone"""
    correlation: _Number
    """of both compliances; null: undetermined"""
    value_of: Literal["positive", "negative"]
    """which of them `value` is: that of the test pose"""


class Stiffness(Fact):
    """One joint."""

    joint: int
    """number, from 1"""
    joint_name: str
    """in the robot file: r1, theta2, ..."""
    name: str
    """k_r1, k_theta2, ..."""
    unit: str
    """of value, std and ci95"""
    value: _Number
    """null where the data give none; `finding` says why"""
    std: _Number
    """standard uncertainty"""
    ci95: _Interval
    """95 % interval; null is no limit"""
    identifiable: bool
    """whether the data determine it"""
    joint_type: JointType
    axis: str | None = None
    """axis of the controller that moves this joint and no other, A1 or E1; null where the robot
    file has none"""
    compliance: _Number
    """the estimate itself"""
    compliance_std: _Number
    """its standard uncertainty; null: undetermined"""
    compliance_unit: str
    relative_std: _Number
    """std over value"""
    nominal: _Number
    """stiffness in the robot file"""
    finding: str | None
    """what to know of it, in a sentence"""
    remarks: tuple[Remark, ...] = ()
    """the same, to be told apart"""
    budget: tuple[BudgetPart, ...]
    """where its uncertainty comes from"""
    by_sign: _Absent[BySign | None] = None
    """both, beside `joint_asymmetry`; absent otherwise"""

    @property
    def called(self) -> str:
        """`A1 (k_theta2)`, as controller and result.json name it; `k_theta2` without an axis."""
        return called(self.name, self.axis)


def called(name: str, axis: str | None) -> str:
    """`A1 (k_theta2)`, as controller and result.json name a stiffness; its name without an axis."""
    return name if axis is None else f"{axis} ({name})"


class Combination(Fact):
    """What is determined of joints that are not determined singly: one direction."""

    of: tuple[str, ...]
    """names of the stiffnesses whose compliances are mixed"""
    weights: tuple[float, ...]
    """of each compliance; the largest is 1"""
    value: float
    """sum of weight times compliance"""
    std: float
    """standard uncertainty"""
    ci95: _Interval
    unit: str
    needs: str
    """the motion of one joint that would part them best"""

    @property
    def formula(self) -> str:
        """What is determined, `c_theta2 + 0.58 c_theta4`, c the compliance of a joint."""
        return mix(self.weights, [f"c_{name.removeprefix('k_')}" for name in self.of])


class Fit(Fact):
    """Goodness of fit of a model."""

    rms_mm: _Number
    """residual, root mean square over coordinates, unweighted"""
    chi2: _Number
    dof: int
    p_value: _Number
    """null where no noise is stated"""
    noise_from: NoiseFrom
    residual_std_mm: _Number
    second_order_rms_mm: _Number
    """what c = B x leaves out, rms"""
    noise_statement: str


PerTarget = dict[str, _Number]


class Drawn(Fact):
    """Means of Eq. (22) per target."""

    test_pose: PerTarget
    """over 1000 poses around the test pose"""
    global_: PerTarget = Field(validation_alias="global", serialization_alias="global")
    """over 1000 poses in the workspace"""


class HeldOutPosition(Fact):
    """Cross-validation error of target positions: distance from their prediction [mm]."""

    mean: _Number
    rms: _Number
    p95: _Number
    """95 % of the targets are nearer"""


class Validation(Drawn):
    """How far predictions can be trusted."""

    held_out_rms_mm: _Number
    """rms error of a pose that was left out with all its pulls, unweighted"""
    independent: Drawn
    """as in Eq. (23), each stiffness drawn by itself"""
    poses: int
    test_pose_stated: bool
    """false: the strongest pull stands in"""
    by_payload: _Absent[PerTarget] = {}
    """rms error [mm] of the rows of one payload or weight, the springs from all other loads; null
    where these leave it open; absent with one load"""
    held_out_position_mm: _Absent[HeldOutPosition | None] = None
    """of absolute positions: every tenth pose left out, or of unloaded reflectors each pose in
    turn; absent without positions"""


class TargetDeflection(Fact):
    """Predicted deflection of one target at the test pose."""

    target: str
    dx_mm: _Number
    dy_mm: _Number
    dz_mm: _Number
    std_mm: tuple[_Number, _Number, _Number]
    """per axis; null: infinite"""

    @property
    def size_mm(self) -> float | None:
        """Its length."""
        x, y, z = self.dx_mm, self.dy_mm, self.dz_mm
        return None if x is None or y is None or z is None else math.hypot(x, y, z)


class Values(Fact):
    """One model of the campaign."""

    stiffness: tuple[Stiffness, ...]
    fit: Fit
    validation: Validation | None
    """null where nothing is determined"""
    test_pose_deflection: tuple[TargetDeflection, ...]


class Extended(Fact):
    """The identified causes' own fit, on the data that the answer rests on."""

    stiffness: tuple[Stiffness, ...]
    fit: Fit
    test_pose_deflection: tuple[TargetDeflection, ...]


class Placed(Fact):
    """A cause with its place."""

    name: str
    """a word of the list of causes"""
    where: _Where
    """joint number, link, target, reading, or null"""
    axis: _Absent[str | None] = None
    """axis of the controller that moves that joint; absent without one"""


class Believed(Placed):
    """A cause within a hypothesis."""

    form: str | None
    """which of its laws"""
    in_catalogue: bool
    """false: something without a name, of this kind"""


class Weighed(Fact):
    """A set of causes that may be true."""

    weight: _Share
    causes: tuple[Believed, ...]


class Recommended(Fact):
    """Which values the answer stands for."""

    model: Which
    data: Data
    table: TableSource = TableSource.AS_DELIVERED
    """geometry of the robot that the values rest on: estimated where unloaded reflectors prove the
    delivered one wrong, see `geometry`"""
    reason: Reason
    why: str
    hypotheses: tuple[Weighed, ...]
    """what the values are averaged over"""


class Amplitude(Fact):
    """One parameter of a cause."""

    name: str
    value: _Number
    std: _Number
    unit: str
    ci95: _Interval | None = None
    meaning: str = "size"
    """what it is, in words"""


class Rival(Placed):
    """What else could stand in the place of a cause."""

    probability: _Share


class AsGood(Placed):
    """Something outside the catalogue that predicts left-out poses as well as the cause."""

    reduction: _Number
    """fraction by which the error falls with it in the cause's place"""
    ci95: _Interval
    times_typical: _Number
    """its largest parameter over the usual size of that"""


class Unnamed(Fact):
    """Probability that something outside the catalogue acts in place of a cause."""

    probability: _Share
    looks_like: str | None
    """null where the only sign of it is what the model with the causes leaves"""
    where: _Where
    as_good: tuple[AsGood, ...] = ()
    """what predicts as well in the cause's place, the best first"""


class Gain(Fact):
    """Change of the cross-validation error by a cause beside all others, or by several together.

    Those that have one gain have it together: corrected mistakes, causes of unloaded positions.
    """

    held_out_rms_before_mm: _Number
    """without the cause, the others in the model, weighted as with it; joint_springs.validation is
    weighted by their own noise"""
    held_out_rms_after_mm: _Number
    reduction: _Number
    """fraction by which the error falls at one weighting"""
    ci95: _Interval | None
    of: Predicted | None = None
    test_pose_change_mm: _Number


class Evidence(Fact):
    """Evidence for a mistake in the data."""

    sentence: str
    correction: str
    before: _Number
    after: _Number
    unit: str


class LawShape(Fact):
    """One shape of a law."""

    kind: Literal["periodic", "smooth", "step", "coupling"]
    order: _Number
    """periods per turn or per metre, degree, or 0 of a step"""


class OneLaw(Fact):
    """One of several laws of a place that the readings do not tell apart."""

    variable: Literal["angle", "torque", "position", "temperature", "time", "direction", "force"]
    part: str
    """what of the place follows it: spring, friction, roll, ..."""
    source_joint: int | None
    """whose angle or torque it is of, where another"""
    shapes: tuple[LawShape, ...]
    """which act together"""
    probability: _Share
    """if one of these acts there"""


class UnlistedLaw(Fact):
    """A law that nobody listed.

    In campaigns of positions by how much a joint turns more than its encoder says; in campaigns of
    pulls what a joint, the rail, the scale or the tracker does that the model leaves out.
    """

    kind: Literal["periodic", "smooth", "step", "coupling"]
    variable: Literal["angle", "torque", "position", "temperature", "time", "direction", "force"]
    part: _Absent[str | None] = None
    """what of the place follows it in campaigns of pulls: spring, friction, roll, ...; absent for
    positions"""
    joint: int | None
    """that it moves, from 1; null for scale, tracker, guides"""
    source_joint: int | None
    """whose angle or torque it is of, where another"""
    order: _Number
    """periods per turn or per metre, degree, or 0 of a step; of a smooth law of an angle of a
    campaign of positions how many of the lengths over which it remembers make a turn"""
    range: tuple[_Number, _Number]
    """of the variable, where it was taught, SI"""
    text: str
    either: _Absent[tuple[OneLaw, ...]] = ()
    """laws of this place of which none leads by 20 to 1 on the evidence, the stated one first;
    absent where it does"""


class Cause(Placed):
    """A cause that the data require, or a mistake in the data."""

    location: str | None = None
    """part of the cell: rail, joint 3, force, ..."""
    form: str | None = None
    probability: _Share
    """that it acts and nothing outside the catalogue does, beside which it may act, too; with its
    rivals and `outside_catalogue` 1, where those stand"""
    parameters: tuple[Amplitude, ...]
    p_value: _Number
    """chance of so much evidence without it"""
    times_typical: _Number = None
    """its largest parameter over the usual size of that; null: none"""
    rivals: tuple[Rival, ...]
    outside_catalogue: Unnamed | None = None
    twins: tuple[str, ...] = ()
    """what no pose tells from it"""
    signature: str | None = None
    needs: str | None = None
    """what would settle it"""
    gain: Gain | None
    evidence: Evidence | None = None
    readings: _Absent[tuple[str, ...]] = ()
    """`file:line` of all that a mistake concerns; absent where it is no single row"""
    since: _Absent[str | None] = None
    """`file:line` from which on a unit is another; absent where none changes"""
    law: _Absent[UnlistedLaw | None] = None
    """of an `unlisted_law`; absent otherwise"""


class Alone(Placed):
    """What a cause achieves as the only one."""

    form: str | None
    probability: _Share
    reduction: _Number
    ci95: _Interval


class BlindSpot(Placed):
    """An effect that may be present unseen."""

    why: str
    smallest_visible: _Number
    """null: never detectable"""
    parameter: str
    unit: str
    typical: float
    needs: str


class AxisValue(Fact):
    """Where an axis of the controller stands; a joint where the robot file maps none."""

    name: str
    value: float
    unit: Literal["m", "deg"]


class ToMeasure(Fact):
    """A pose to measure, pulled in the usual load steps up to `force_n`."""

    q: tuple[float, ...]
    q_unit: tuple[Literal["m", "deg"], ...]
    anchor_m: tuple[float, float, float]
    """where to attach the chain, F_b"""
    direction: tuple[float, float, float]
    """of the force on the robot, of length 1, F_b"""
    force_n: float
    """of the largest load step"""
    steps: int
    """load steps"""
    approach: _Number
    """which way the carriage comes; null without a rail"""
    axes: _Absent[tuple[AxisValue, ...]] = ()
    """where the controller's axes stand there"""


class NextPose(ToMeasure):
    """A pose that would decide what is open."""

    separates: tuple[str, ...]
    """the two that stay closest with it"""
    sigmas_before: _Number
    sigmas_after: _Number
    pose: int
    """its number"""


class BestPose(ToMeasure):
    """The pose that would determine a joint best."""

    name: str
    """of its stiffness: k_r1, k_theta2, ..."""
    relative_std_before: _Number
    """of the stiffness; of its typical compliance where it has no value"""
    relative_std_after: _Number
    """the same with this pose, as expected"""
    determines: bool
    """whether the joint then has a value"""


class CellLimits(Fact):
    """The limits that a proposed pose was checked against."""

    kept: tuple[str, ...]
    not_checked: tuple[str, ...]
    capsules: str | None
    """where the robot's come from; null: it has none"""


class MisfitPlace(Fact):
    """A place where the residuals concentrate."""

    place: str
    share: _Number
    p_value: _Number


class PosesPulls(Fact):
    """Two tests of lack of fit."""

    poses: _Number
    pulls: _Number


class Remainder(PosesPulls):
    """The same with the causes, and the smallest p of a further one."""

    further_cause: _Number


class Detection(Fact):
    """Statistics of the search for causes."""

    threshold_p: _Number
    smallest_p: _Number
    lack_of_fit_p: PosesPulls
    remainder_over_scatter: _Number
    """what is left with the causes over the scatter of the readings; null: unknown"""
    remainder_p: Remainder


class Scatter(Fact):
    """Scatter of the readings."""

    tracker_over_stated: _Number
    """found over the noise in use: 1 where repeats have corrected the stated one already, see
    `noise`"""
    tracker_over_stated_std: _Number
    """null: no residuals are left"""
    scale_over_tracker: _Number
    known_from: str


class Diagnosis(Fact):
    """What the model misses."""

    verdict: Verdict
    why: str
    reasons: tuple[Finding, ...]
    """what the verdict follows from, at most one for each of data, base reflectors, unloaded
    reflectors and displacements"""
    causes: tuple[Cause, ...]
    alone: tuple[Alone, ...]
    """what the likeliest causes do each as the only one"""
    unloaded_off_mm: tuple[_Number, _Number]
    """how far the unloaded reflectors stand from the robot's table, and from the table as estimated
    from them"""
    blind_spots: tuple[BlindSpot, ...]
    not_found: tuple[BlindSpot, ...] = ()
    """examined and not found, and the size that would have been found"""
    next_poses: tuple[NextPose, ...]
    best_pose: _Absent[BestPose | None] = None
    """for the joint that is known worst, where no cause is in question; absent without"""
    next_poses_in: _Absent[CellLimits | None] = None
    """what the cell lets a next pose do; absent without [cell]"""
    refused: tuple[str, ...]
    """labels that fit only at an impossible size"""
    misfit_sits_at: tuple[MisfitPlace, ...]
    detection: Detection
    scatter: Scatter
    equilibrium: Equilibrium
    noise_floor_mm: _Number


class NoiseComponent(Fact):
    """One noise, found over stated (in m where none is stated)."""

    name: str
    found_over_stated: _Number
    std: _Number
    p_value: _Number


class FoundNoise(Fact):
    """Noise found in the data beside the stated one."""

    from_: NoiseFrom = Field(validation_alias="from", serialization_alias="from")
    used_over_stated: _Number = None
    """scatter of the readings that the uncertainties rest on"""
    contrasts: int
    components: tuple[NoiseComponent, ...]


class Rejected(Fact):
    """What was left out, where it stands and why."""

    file: str
    line: int | None
    reason: str


class SetAside(Fact):
    """What the operator set aside in campaign.toml, and why."""

    name: str
    reason: str
    readings: int
    """their number, with those of no use without them"""


class Growth(Fact):
    """How much longer the base frame is than campaign.toml has it, relative."""

    value: float
    std: float
    expected: _Number
    """by temperature_c; null without"""
    expected_std: float
    """of that, or how far it may be without a temperature"""
    seen: _Number
    """by the base reflectors alone; null where they do not tell"""
    seen_std: _Number
    probability: float
    """that it has grown at all; 1 with temperature_c"""


class BaseResiduals(Fact):
    """Residuals of the base reflectors; readings identified as outliers are left out."""

    rms_mm: _Number
    max_mm: _Number
    chi2: _Number
    dof: int
    p_value: _Number
    rotation_std_rad: tuple[float, float, float]
    translation_std_m: tuple[float, float, float]
    growth: _Absent[Growth | None] = None
    """of rail and base frame with the temperature; absent where there is none"""


class Controlled(Fact):
    """Redundancy of one error: a row of the table `reliability`."""

    source: str
    """source of the error; `base`: a base reflector's reading"""
    reading: str | None
    """null for an error of no single reading"""
    file: str | None
    line: int | None
    axis: str | None
    """axis of F_b nearest to it"""
    r: float
    """redundancy: the part of it that the residuals show"""
    w: _Number
    """standardised residual"""
    smallest_visible: _Number
    """found in 80 % of the cases at 0.1 % false alarms; null: no size is"""
    unit: str
    """of smallest_visible; 1: standard uncertainties"""
    moves_sigmas: _Number
    """what that size moves most, in standard uncertainties; null: without limit"""
    moves_most: str
    """a stiffness, or target and axis of the test pose"""


class Carried(Fact):
    """The pull that carries most of a stiffness or of a cause."""

    what: str
    """k_theta2, or the cause's parameter that moves most"""
    name: str | None
    """the cause; null for a stiffness"""
    where: _Where
    pose: int
    repeat: int
    moves_sigmas: _Number
    """how far it moves without that pull, in standard uncertainties; null: lost"""


class Body(Fact):
    """Mass and centre of a payload, flange frame."""

    mass_kg: float
    mass_std_kg: float
    center_m: tuple[float, float, float]
    center_std_m: tuple[float, float, float]


class Payload(Fact):
    """A payload as stated, and as the joint torques, or absolute positions, have it."""

    name: str
    stated: Body
    found: Body | None
    """from the joint torques or the absolute positions; null where none tell"""
    poses: int
    """how many it was carried in, with torques or positions"""
    p_value: _Number
    """of differing so much from the stated one by chance"""


class Overload(Fact):
    """The largest force, where it is many times the weight of the rated payload."""

    pose: int
    repeat: int
    force_n: float
    payload_kg: float
    times: float
    """force over the weight of the payload"""


class CommonFactor(Fact):
    """All stiffnesses over those of the robot file, where they are off by one factor."""

    value: float
    """stiffnesses over those of the file, in common"""
    ci95: tuple[float, float]
    joints: int
    """how many tell"""
    probability: float
    """that it is more than robots of one type differ by"""


class Measuring(Fact):
    """The instrument as campaign.toml has it; serial number and certificate not judged."""

    kind: Literal["laser_tracker", "camera", "arm", "unknown"]
    measures: Literal["points", "poses"]
    """found where nobody says so"""
    model: str | None
    serial: str | None
    certificate: str | None = None
    calibrated: str | None
    data_sheet: _Absent[str | None] = None
    """that the noise of its readings is taken from; absent where it is not"""


class TableLetter(Placed):
    """An entry of the robot's table: a length, an offset, a twist or a joint's zero."""

    nominal: float
    """in the robot file"""
    value: float
    std: float
    """standard uncertainty"""
    prior_std: float
    """how rough the table is: as found over all of its lengths or angles"""
    unit: Literal["m", "rad"]
    identifiable: bool
    """the readings alone know it better than the robot file does"""


class Mixed(Placed):
    """An entry of the robot's table within a sum of several."""

    weight: float
    """of its error; the largest is 1"""


class TableCombination(Fact):
    """What is determined of entries of the robot's table that are not determined singly."""

    of: tuple[Mixed, ...]
    value: float
    """sum of weight times error; an error is value minus nominal"""
    std: float
    """standard uncertainty"""
    ci95: _Interval
    unit: Literal["m", "rad"]


class PositionStep(Fact):
    """Mean distance of left-out targets from their prediction by one model [mm]."""

    model: str
    between_mm: _Number
    """every tenth pose left out"""
    space_mm: _Number
    """a tenth of joint space left out"""
    series_mm: _Number
    """one series left out; null where there is one only"""


class Known(Fact):
    """A compliance with its standard uncertainty [m/N] or [rad/(N m)]."""

    value: float
    std: float


class SpringBy(Fact):
    """One joint by each kind of reading; null where that tells nothing of it."""

    name: str
    by_weight: Known | None
    by_pulls: Known | None


class SpringsBy(Fact):
    """Springs by the arm's weight in absolute positions, and by pulls, in one campaign."""

    chi2: float
    """squared difference in its uncertainty"""
    dof: int
    """springs, or mixes of them, that both tell"""
    p_value: float
    joined: bool
    """they agree: the stiffnesses are from both together"""
    lighter: float | None
    """springs over those that the arm would have if it weighed what is usual for its payload; null
    where the robot file states masses"""
    each: tuple[SpringBy, ...]


class Repaired(Fact):
    """Work after which some joints are no longer what they were."""

    date: _Day
    joints: tuple[int, ...]
    """their numbers, from 1; empty: all"""
    what: str | None


class Unit(Fact):
    """A machine or a scale as campaign.toml has it."""

    serial: str | None
    certificate: str | None
    calibrated: str | None
    history: _Absent[tuple[Repaired, ...]] = ()
    """its repairs; absent where none is named"""


class Identity(Fact):
    """What a report is filed by; null is what campaign.toml does not state."""

    first: _Day | None
    """first reading"""
    last: _Day | None
    """last reading"""
    operator: str | None
    temperature_c: _Number
    """mean of rail and base frame"""
    scale: Unit | None
    poses: int
    unloaded_only: _Absent[int] = 0
    """poses beside them in which reflectors were read and nothing was pulled; absent without
    such"""
    pulls: int
    force_n: tuple[float, float] | None
    """smallest and largest load"""


class DayToDay(Fact):
    """Day-to-day scatter, from poses repeated on another day."""

    poses: int
    """pairs of the same pose on two days"""
    relative_std: float
    """scatter of the displacements of a day, relative"""
    p_value: float
    """of so much difference by the noise of the readings alone"""


class Tip(Fact):
    """Predicted deflection of the load point, where the force acts."""

    deflection_mm: _Number
    std_mm: _Number
    """standard uncertainty, never below the error at left-out poses; null: infinite"""

    @property
    def expanded_mm(self) -> float | None:
        """U (k = 2) [mm]."""
        return None if self.std_mm is None else 2 * self.std_mm


class PosePart(Fact):
    """Contribution of one source of error to the uncertainty at the test pose."""

    source: str
    """as in the budget of a stiffness; held_out: left-out poses"""
    std_mm: float
    """standard uncertainty along the deflection"""


class TestPose(Tip):
    """The pose that the user asked about."""

    __test__ = False

    axes: tuple[AxisValue, ...]
    force_n: tuple[float, float, float]
    """on the robot, F_b"""
    vector_mm: tuple[float, float, float] | None = None
    """the deflection, F_b; null in answers of earlier versions"""
    along_force_mm: _Number = None
    """its part along the force"""
    budget: _Absent[tuple[PosePart, ...]] = ()
    """where std_mm comes from, adding up in quadrature; absent where it is infinite"""
    stated: bool
    """false: the strongest pull stands in"""


class Stretch(Tip):
    """Consecutive points of a path with the same decision, and the worst of them."""

    decision: Decision
    first: int
    """pose of its first point, as the file numbers them"""
    last: int
    points: int
    at: int
    """pose of the largest deflection, which the numbers are of"""


class JudgedPath(Fact):
    """A machining path with forces."""

    file: str
    points: int
    force_n: tuple[float, float] | None = None
    """smallest and largest force asked for"""
    decision: Decision
    """pass where every point does, fail where one fails"""
    stretches: tuple[Stretch, ...]

    @property
    def largest(self) -> Stretch:
        """The stretch with the largest deflection."""
        return max(self.stretches, key=lambda one: one.deflection_mm or 0.0)


class Tolerance(Fact):
    """What [tolerance] of campaign.toml asks, decided by ISO 14253-1 with a guard band 1.65 u."""

    deflection_mm: float
    """T"""
    test_pose: Decision | None
    """null where campaign.toml has no [test_pose]"""
    path: JudgedPath | None

    @property
    def worst(self) -> Decision | None:
        """The least favourable of what is decided: fail, undecided, pass."""
        found = {self.test_pose, self.path and self.path.decision}
        order = (Decision.FAIL, Decision.UNDECIDED, Decision.PASS)
        return next((one for one in order if one in found), None)


class About(StrEnum):
    """What a line of the first screen is about."""

    VERDICT = "verdict"
    TO_DO = "to_do"
    MODEL = "model"
    NUMBERS = "numbers"
    TOLERANCE = "tolerance"
    TEST_POSE = "test_pose"
    WRONG = "wrong"
    NOT_FOUND = "not_found"
    NEXT = "next"


class Line(Fact):
    """One line of the first screen."""

    about: About
    text: str


class Forward(Fact):
    """What the forward model takes into account."""

    equilibrium: Equilibrium
    priors: _Absent[tuple[str, ...]] = ()
    """causes whose prior odds and sizes campaign.toml takes from other campaigns; absent where all
    are guessed"""


class Input(Fact):
    """One file that was read."""

    file: str
    sha256: str
    bytes: int


class _Heading(Fact):
    """What stands first in result.json."""

    format: Literal[1]
    campaign: str
    name: str
    robot: str
    simulated: _Absent[bool] = False
    """the readings are of a virtual cell"""
    measured: _Day | None
    """date, or date and time"""
    verdict_sentence: tuple[str, ...]
    """the first screen, most important first"""
    first_screen: tuple[Line, ...]
    """the same, with what each line is about"""
    recommended: Recommended
    """which values stand at the top, and why"""


class Answer(Values, _Heading):
    """result.json; the values at the top are those of the recommended model."""

    test_pose: _Absent[TestPose | None] = None
    """the pose asked about, its force and the deflection of the load point; absent with
    positions"""
    tolerance: _Absent[Tolerance | None] = None
    """absent without [tolerance]"""
    identity: Identity
    """what the report is filed by"""
    day_to_day: _Absent[DayToDay | None] = None
    """absent where no pose was repeated on another day"""
    combinations: tuple[Combination, ...] = ()
    """what only several joints together are known by"""
    diagnosis: Diagnosis
    joint_springs: Values
    """the paper's model on the data as given, always"""
    effective: _Absent[tuple[Stiffness, ...]] = ()
    """joint springs alone on the corrected data, which a controller takes beside a cause; absent
    without an error in the data"""
    extended: Extended | None
    """the identified causes' own fit; null without"""
    budget: tuple[dict[str, str | float], ...]
    """shares of the variance by source [%]"""
    noise: FoundNoise
    rejected: tuple[Rejected, ...]
    """everything that was left out"""
    set_aside: tuple[SetAside, ...] = ()
    """left out on purpose, by [set_aside] of campaign.toml"""
    findings: tuple[str, ...]
    """sentences to act on"""
    registration: BaseResiduals | None
    reliability: tuple[Controlled, ...] = ()
    """the ten errors with the lowest r"""
    influence: tuple[Carried, ...] = ()
    """the pull that carries most of each stiffness and cause"""
    payloads: _Absent[tuple[Payload, ...]] = ()
    """as stated and as found; absent without any"""
    instrument: _Absent[Measuring | None] = None
    """what measured; absent where nobody says"""
    robot_unit: _Absent[Unit | None] = None
    """which machine of its type; absent where nobody says"""
    overload: _Absent[Overload | None] = None
    """a force far beyond the rated payload; absent without one"""
    geometry: _Absent[tuple[TableLetter, ...]] = ()
    """the robot's table as absolute positions or unloaded reflectors show it; absent without
    them"""
    geometry_combinations: _Absent[tuple[TableCombination, ...]] = ()
    """what only several entries of the robot's table together are known by; absent without such"""
    position_steps: _Absent[tuple[PositionStep, ...]] = ()
    """what each part of the model is worth; absent without positions"""
    springs_by: _Absent[SpringsBy | None] = None
    """springs by weight and by pulls; absent without both"""
    common_factor: _Absent[CommonFactor | None] = None
    """of all stiffnesses against the robot file's; absent where these agree"""
    model: Forward
    assumptions: tuple[str, ...]
    inputs: tuple[Input, ...]
    versions: dict[str, str]

    @property
    def of_positions(self) -> bool:
        """Whether absolute positions were measured, and no displacements."""
        return bool(self.position_steps) and self.springs_by is None

    def called(self, name: str) -> str:
        """A stiffness as people call it, by the axis of the controller."""
        return next(one.called for one in self.stiffness if one.name == name)

    @property
    def axes(self) -> dict[int, str]:
        """Axis of the controller by number of the joint that it moves alone."""
        return {joint.joint: joint.axis for joint in self.stiffness if joint.axis}

    @property
    def machine(self) -> str:
        """The machine, to find its other campaigns: its type, with its serial number if said."""
        serial = self.robot_unit and self.robot_unit.serial
        return f"{self.kind}, serial number {serial}" if serial else self.kind

    @property
    def kind(self) -> str:
        """Type of the robot; virtual ones are none of those that stand in a hall."""
        return f"{self.robot} (simulated)" if self.simulated else self.robot

    def as_json(self) -> dict[str, Any]:
        """The same as plain data, in the order in which result.json has it."""
        return self.model_dump(mode="json")
