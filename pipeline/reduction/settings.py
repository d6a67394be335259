"""campaign.toml: what was measured, where, with what. Checked once, typed from there on."""

from __future__ import annotations

import re
from collections.abc import Sequence
from decimal import Decimal
from difflib import get_close_matches
from statistics import median_low
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, field_validator, model_validator

from pipeline.base import doors, toml
from pipeline.base.arrays import Array, Bools
from pipeline.base.errors import InputError, listed
from pipeline.base.language import Language
from pipeline.base.linear import extent
from pipeline.base.patterns import is_glob
from pipeline.base.strict import (
    LEAST_FORCE,
    STANDARD_GRAVITY,
    AxisValue,
    Day,
    FileName,
    Force,
    ForceUncertainty,
    Glob,
    JointValue,
    Length,
    Mass,
    MassUncertainty,
    Misplaced,
    Name,
    Relative,
    Scatter,
    Strict,
    Temperature,
    Uncertainty,
    checked,
    with_parts,
)
from pipeline.machine.instrument import DataSheet, InstrumentNoise, sheet
from pipeline.machine.robot import Robot, axes
from pipeline.machine.robot.axes import LIMIT_SLACK, from_log_units
from pipeline.machine.surroundings import Surrounded
from pipeline.readers.export_settings import ExportSettings, JointForm, LogForm
from pipeline.readers.reflector_sets import ReflectorSet

BASE_REFLECTORS = 3
"""Minimum number of reflectors of a base frame; the third fixes the rotation about the other
two."""

_MOST_FIELDS = 20
"""Maximum number of a house's own entries."""

_MOST_SET_ASIDE = 200
"""Maximum number of names that are set aside: each is looked up in all readings."""

_MOST_GLOBS = 20
"""Maximum number of patterns for exports."""

ONE_LINE = 1e-3
"""Second width of the targets over the first below which they are on one line, their rotation about
it unknown [1]."""

Point = tuple[Length, Length, Length]
"""Coordinates [m]."""

REACH_M = 20.0
"""Maximum distance of a point of an effector from its flange [m]; in millimetres this is two
centimetres."""

_SURVEYED_M = 0.9e-3
"""Last digit [m] below which coordinates are as surveyed; those to whole millimetres may be those
of a drawing, and exact."""

HALL_M = 200.0
"""Maximum range of a tracker [m] (Leica AT403: 160 m radius)."""


def _on_the_effector(point: Point) -> Point:
    """Check a point of the effector, flange frame [m].

    Raises:
        ValueError: It is out of reach.
    """
    if (far := max(map(abs, point))) > REACH_M:
        raise ValueError(f"a coordinate of {far:g} m is on no effector; give it in metres")
    return point


_Centre = Annotated[Point, AfterValidator(_on_the_effector)]
"""Centre of mass in the flange frame [m]."""


class Tracker(ExportSettings):
    """The tracker's exports and its noise; without noise it is estimated from the residuals."""

    files: list[Glob] = Field(min_length=1)
    assignment: FileName | None = None
    sigma_m: Scatter | None = None
    noise: InstrumentNoise | Literal["paper"] | None = None

    @model_validator(mode="after")
    def one_noise(self) -> Tracker:
        """Allow sigma_m or noise, not both."""
        if self.sigma_m is not None and self.noise is not None:
            raise ValueError("sigma_m and noise are both given; keep one of them")
        return self

    @model_validator(mode="after")
    def few_globs(self) -> Tracker:
        """Limit the patterns, since each is matched against every file of the folder."""
        if sum(map(is_glob, self.files)) > _MOST_GLOBS:
            raise ValueError(f"files has more than {_MOST_GLOBS} patterns; use wider ones")
        return self

    def none_missing(self, found: Sequence[str]) -> None:
        """Check that every export that `files` names is there, and at least one in total.

        Raises:
            InputError: One is missing.
        """
        for pattern in self.files:
            if not found or (not is_glob(pattern) and pattern not in found):
                raise InputError(
                    "the tracker export is missing",
                    "put it into the campaign folder or correct [tracker] files in campaign.toml",
                    file=pattern,
                )


_State = Literal["unloaded", "loaded"]


class Naming(Strict):
    """How group and target names are read.

    Attributes:
        group: Expression with the parts pose and state and, where pulls are numbered, repeat.
        states: Other words for the two states, in addition to our own; case does not matter.
        measured: Targets on the effector.
        chain: Ends of the chain.
    """

    group: Annotated[str, with_parts("pose", "state")] = (
        r"pose(?P<pose>[0-9]+)_rep(?P<repeat>[0-9]+)_(?P<state>unloaded|loaded)"
    )
    states: dict[Annotated[str, Field(max_length=200)], _State] = Field(default_factory=dict)
    measured: list[Name] = Field(default=["P1", "P2", "P3"], min_length=1)
    chain: list[Name] = Field(default=["Pl1", "Pl2"], min_length=2, max_length=2)

    @model_validator(mode="after")
    def one_state_each(self) -> Naming:
        """Refuse a word for both states, whatever its case."""
        entries = {word.lower(): state for word, state in self.states.items()}
        for word, state in self.states.items():
            if entries[word.lower()] != state:
                raise ValueError(f'states has "{word}" for unloaded and for loaded; keep one')
        return self

    @property
    def state_of(self) -> dict[str, _State]:
        """State by its word in lower case, ours and theirs."""
        ours: dict[str, _State] = {"unloaded": "unloaded", "loaded": "loaded"}
        return ours | {word.lower(): state for word, state in self.states.items()}


class _Device(Strict):
    """Which device of its type; kept and shown, not evaluated.

    Attributes:
        serial: Serial number.
        certificate: Of its last calibration.
        calibrated: Date of that calibration.
    """

    serial: Name | None = None
    certificate: Name | None = None
    calibrated: Day | None = None


class Scale(LogForm, _Device):
    """The spring scale: its log, which holds weights and payloads too, and its uncertainty.

    A scale that shows `zero_n` with nothing on it, and `gain` newtons for each further one, pulls
    with (reading - zero_n) / gain. Its certificate is by ISO 376.
    """

    file: FileName = "loads.csv"
    zero_n: Annotated[float, Field(ge=-1e4, le=1e4)] = 0.0
    gain: Annotated[float, Field(ge=0.5, le=2.0)] = 1.0
    sigma_n: ForceUncertainty = 0.0
    sigma_rel: Relative = 0.0
    gain_sigma: Relative = 0.0
    zero_sigma_n: ForceUncertainty = 0.0
    mass_sigma_kg: MassUncertainty = 0.0


class _Gravity(Strict):
    """Direction and size of gravity, F_b [m/s^2]; by default rail or foot are level."""

    direction: Point = (0.0, 0.0, -1.0)
    m_s2: Annotated[float, Field(ge=9.0, le=10.0)] = STANDARD_GRAVITY

    @field_validator("direction")
    @classmethod
    def points_somewhere(cls, direction: Point) -> Point:
        """Refuse a zero direction; its length is otherwise irrelevant."""
        if np.linalg.norm(direction) < LEAST_FORCE:
            raise ValueError("the direction is zero; without it weights pull along -z of F_b")
        return direction

    @property
    def vector(self) -> Array:
        """Acceleration in F_b [m/s^2], shape (3,)."""
        return self.m_s2 * np.array(self.direction) / np.linalg.norm(self.direction)


class PayloadSettings(Strict):
    """A payload on the flange: its mass [kg] and centre [m], flange frame; uncertainty per axis."""

    mass_kg: Mass
    mass_sigma_kg: MassUncertainty = 0.0
    center_m: _Centre
    center_sigma_m: Uncertainty = 0.0


class _JointLog(JointForm):
    """The controller's joint log, and the uncertainty of the joint zeros, one for all poses."""

    file: FileName = "joints.csv"
    sigma_m: Uncertainty = 0.0
    sigma_rad: Uncertainty = 0.0


class _ToolUncertainty(Strict):
    """Standard uncertainty per axis of the points in [tool]; the load point's own if given."""

    sigma_m: Uncertainty = 0.0
    load_point_sigma_m: Uncertainty | None = None


class _BaseUncertainty(Strict):
    """Standard uncertainty per axis of the points in [base_frame]."""

    sigma_m: Uncertainty | None = None


class Displacements(Strict):
    """A campaign that arrives already reduced."""

    file: FileName = "displacements.csv"
    forces: FileName = "forces.csv"
    sigma_m: Scatter | None = None


class PositionsSettings(LogForm):
    """A campaign of absolute positions: tables of joint values and of what was read there.

    Attributes:
        file: One table with all series, where `files` names none.
        files: One table for each series, by its name.
        rotation: Convention of rx, ry, rz of a 6D target: rotations about its x, y and z, one after
            the other about moving axes, or about fixed ones.
        sigma_m: Standard uncertainty of a coordinate; estimated where it is not stated.
    """

    file: FileName = "poses.csv"
    files: dict[Name, FileName] = Field(default_factory=dict)
    rotation: Literal["xyz_intrinsic", "xyz_extrinsic", "zyx_intrinsic"] = "xyz_intrinsic"
    sigma_m: Scatter | None = None

    @property
    def named(self) -> list[str]:
        """Names of the tables."""
        return [*dict.fromkeys(self.files.values())] or [self.file]


_MEANT = "pipeline.intake.meant:pose"
"""Door of the intake: what a pose beyond the limits of the robot may have been meant to be."""


class AskedPose(Strict):
    """The pose at which a good prediction matters most, Eqs. (12), (13); N in F_b.

    Attributes:
        q: Joints of the robot file, m and degrees.
        axes: The controller's axes as it shows them, mm and degrees; either these or `q`.
        force_n: Force on the load point.
    """

    __test__ = False

    q: list[JointValue] | None = None
    axes: list[AxisValue] | None = None
    force_n: tuple[Force, Force, Force]

    @field_validator("force_n")
    @classmethod
    def pulls(cls, force: tuple[float, float, float]) -> tuple[float, float, float]:
        """Refuse a zero force, under which nothing deflects."""
        if np.linalg.norm(force) < LEAST_FORCE:
            raise ValueError("the force must be greater than zero")
        return force

    @model_validator(mode="after")
    def one_of_both(self) -> AskedPose:
        """Require either joints or axes."""
        if (self.q is None) == (self.axes is None):
            raise ValueError(
                "needs either axes (the controller's, mm and degrees) or q (the joints of the "
                f"robot file, m and degrees){'' if self.q is None else ', not both'}"
            )
        return self

    @property
    def key(self) -> str:
        """Name of the entry in which the pose is given."""
        return "q" if self.axes is None else "axes"

    @property
    def said(self) -> list[float]:
        """The values as written."""
        return (self.q if self.axes is None else self.axes) or []

    def names(self, robot: Robot) -> Sequence[str]:
        """Names of the values: of joints, or of the controller's axes."""
        return (axes.joints if self.axes is None else axes.of)(robot).names

    def joint_values(self, robot: Robot, file: str = "campaign.toml") -> Array:
        """The pose in m and rad, shape (n,).

        Args:
            robot: The robot that takes it.
            file: Name of the file that states it, for the message.

        Raises:
            InputError: The number of values is not that of the robot's joints or axes.
        """
        names = self.names(robot)
        if len(self.said) != len(names):
            kind = "joints" if self.axes is None else "axes"
            raise InputError(
                f"test_pose.{self.key} has {len(self.said)} values, the robot {len(names)} {kind}",
                f"give one value for each of {', '.join(names)}",
                file=file,
                key=["test_pose", self.key],
            )
        return self._joints(robot, np.array(self.said))

    def _joints(self, robot: Robot, stated: Array) -> Array:
        if self.axes is None:
            return from_log_units(robot, stated)
        return robot.from_controller(stated)

    def within_limits(self, robot: Robot) -> None:
        """Check that the robot can take the pose.

        Raises:
            InputError: It has another number of joints, or one of them is outside its limits.
        """
        values = self.joint_values(robot)
        out = np.flatnonzero(beyond_limits(robot, values))
        if not out.size:
            return
        meant = doors.found(_MEANT)
        joint, value = robot.joints[out[0]], values[out[0]]
        unit, one = ("m", 1.0) if joint.prismatic else ("deg", np.rad2deg(1.0))
        axis = None if self.axes is None else axes.alone(robot)[out[0]]
        of = joint.name if axis in (None, joint.name) else f"{axis}, which is {joint.name}"
        raise InputError(
            f"test_pose.{self.key} has {of} = {one * value:.7g} {unit}, outside its limits "
            f"{one * joint.lower:g} to {one * joint.upper:g} {unit}",
            (meant and meant(self, robot)) or "give a pose that the robot can take",
            file="campaign.toml",
            key=["test_pose", self.key],
        )


def beyond_limits(robot: Robot, q: Array) -> Bools:
    """Joints outside their limits at joint values [m], [rad], shape (n,)."""
    return np.asarray((q < robot.lower - LIMIT_SLACK) | (q > robot.upper + LIMIT_SLACK))


class ToleranceSettings(Strict):
    """Maximum deflection of the point where the force acts, and the poses at which it is checked.

    Attributes:
        deflection_mm: Largest admissible deflection [mm], T of ISO 14253-1.
        path: A machining path with forces, as `pipeline compensate` reads it; the test pose alone
            where not given.
    """

    deflection_mm: Annotated[float, Field(gt=0, le=1e4)]
    path: FileName | None = None


class Instrument(_Device):
    """The instrument that measured the effector: its kind, and what it measures.

    Attributes:
        kind: With `laser_tracker`, residuals that no tracker has are a misfit where no noise is
            stated; any other kind is judged by the data alone.
        measures: `points`, each target by itself, or `poses`: targets computed from one 6D pose.
        sigma_rad: Standard uncertainty per axis of a pose's rotation, in addition to [tracker]
            sigma_m.
        length_sigma_rel: Relative standard uncertainty of its lengths, from the certificate
            (ISO 10360-10); one error for the whole campaign.
        model: If its data sheet is known, this gives the noise of readings for which no other is
            stated.
    """

    kind: Literal["laser_tracker", "camera", "arm", "unknown"] = "laser_tracker"
    measures: Literal["points", "poses"] = "points"
    sigma_rad: Scatter | None = None
    length_sigma_rel: Relative = 0.0
    model: Name | None = None

    @model_validator(mode="after")
    def a_rotation_is_of_poses(self) -> Instrument:
        """Refuse the uncertainty of a rotation for points."""
        if self.sigma_rad is not None and self.measures == "points":
            raise ValueError('sigma_rad is that of a pose: set measures = "poses"')
        return self


class _RepairSettings(Strict):
    """Work on a machine that changed some of its joints.

    Attributes:
        date: The day; campaigns of that day and later ones come after it.
        joints: Numbers of the joints, from 1; all where none is named.
        what: In words.
    """

    date: Day
    joints: tuple[Annotated[int, Field(ge=1, le=50)], ...] = ()
    what: Name | None = None


class UnitSettings(_Device):
    """One machine of its type; kept and shown, and campaigns of other machines are not its history.

    Attributes:
        history: Repairs, which are not wear; one campaign of the machine that lists them is enough.
    """

    history: tuple[_RepairSettings, ...] = ()


class CausePrior(Strict):
    """Prior of a cause learnt from other campaigns; `pipeline priors` writes it.

    The odds are bounded, so that no cause is certain merely by being common.

    Attributes:
        odds: Prior odds relative to any other cause.
        size: Its expected size over the typical one.
    """

    odds: Annotated[float, Field(ge=0.25, le=4.0)] = 1.0
    size: Annotated[float, Field(ge=1 / 3, le=3.0)] = 1.0


class _ModelSettings(Strict):
    """What the forward model takes into account."""

    equilibrium: Literal["undeformed", "deformed"] = "undeformed"


class Settings(Surrounded):
    """A whole campaign.toml."""

    format: Literal[1]
    name: Name
    robot: FileName
    simulated: bool = False
    date: Day | None = None
    operator: Name | None = None
    language: Language | None = None
    fields: Annotated[dict[Name, Name], Field(max_length=_MOST_FIELDS)] = Field(
        default_factory=dict
    )
    temperature_c: Temperature | None = None
    tracker: Tracker | None = None
    naming: Naming = Naming()
    base_frame: dict[Name, Point] = Field(default_factory=dict)
    base_frame_uncertainty: _BaseUncertainty = _BaseUncertainty()
    anchors: dict[Name, Point] = Field(default_factory=dict)
    scale: Scale | None = None
    gravity: _Gravity = _Gravity()
    payload: dict[Name, PayloadSettings] = Field(default_factory=dict)
    joints: _JointLog = _JointLog()
    displacements: Displacements | None = None
    positions: PositionsSettings | None = None
    instrument: Instrument = Instrument()
    robot_unit: UnitSettings = UnitSettings()
    tool: dict[Name, Point] = Field(default_factory=dict)
    tool_uncertainty: _ToolUncertainty = _ToolUncertainty()
    test_pose: AskedPose | None = None
    tolerance: ToleranceSettings | None = None
    model: _ModelSettings = _ModelSettings()
    priors: dict[Name, CausePrior] = Field(default_factory=dict)
    set_aside: Annotated[dict[Name, Name], Field(max_length=_MOST_SET_ASIDE)] = Field(
        default_factory=dict
    )

    @model_validator(mode="after")
    def raw_or_reduced(self) -> Settings:
        """Require [tracker] (and [scale] with a chain) or [displacements], or [positions]."""
        ways = (self.tracker, self.displacements, self.positions)
        if ways == (None, None, None):
            raise ValueError(
                "needs the tables [tracker] and [scale], or [displacements], or [positions]"
            )
        if self.of_positions and self.scale is not None:
            raise ValueError(
                "has [scale] beside [positions], but nothing that was pulled; add [tracker], or "
                "remove [scale]"
            )
        if self.displacements is not None and (self.tracker is not None or self.scale is not None):
            raise ValueError("has [displacements] beside [tracker] or [scale]; keep one of them")
        if self.set_aside and self.tracker is None:
            raise ValueError(
                "has [set_aside] without [tracker], whose readings and logs it refers to; remove "
                "the rows from the tables instead"
            )
        return self

    @property
    def of_positions(self) -> bool:
        """Whether positions were read and nothing was pulled."""
        return self.positions is not None and self.tracker is None and self.displacements is None

    @model_validator(mode="after")
    def tool_has_its_points(self) -> Settings:
        """Require nominal coordinates of the load point and of every measured target."""
        lacking = [name for name in ("load_point", *self.measured) if name not in self.tool]
        if lacking and not self.of_positions:
            spare = [name for name in self.tool if name not in ("load_point", *self.measured)]
            near = get_close_matches(lacking[0], spare, 1)
            way_out = f"is it {near[0]}? Then rename that" if near else ""
            raise Misplaced(f"[tool] lacks {', '.join(lacking)}", ["tool", *near], way_out)
        self.accepts_only(self.measured)
        return self

    @model_validator(mode="after")
    def a_tolerance_is_asked_somewhere(self) -> Settings:
        """Require a test pose or path for a tolerance, and forces to predict a deflection from."""
        if self.tolerance is None:
            return self
        if self.of_positions:
            raise ValueError(
                "has [tolerance] beside [positions], which has no forces to predict a deflection "
                "from; remove one of the two"
            )
        if self.test_pose is None and self.tolerance.path is None:
            raise ValueError(
                "has [tolerance] but no place to apply it: give [test_pose], or path in [tolerance]"
            )
        return self

    @model_validator(mode="after")
    def a_pose_has_three_targets(self) -> Settings:
        """Require three targets that are not on one line for a pose."""
        if self.of_positions:
            return self
        places = np.array([self.tool[name] for name in self.measured])
        if self.instrument.measures == "poses" and not tells_a_pose(places):
            raise ValueError(
                'measures = "poses" needs three targets in [tool] that are not on one line; '
                f"there are {listed(self.measured)}"
            )
        return self

    @model_validator(mode="after")
    def one_part_each(self) -> Settings:
        """Require each reflector to be a measured target, a chain end or fixed to the base."""
        parts = {"naming.measured": self.measured, "[base_frame]": list(self.base_frame)}
        if self.displacements is None:
            parts["naming.chain"] = self.naming.chain
        seen: dict[str, str] = {}
        for part, names in parts.items():
            for name in names:
                if seen.setdefault(name, part) != part:
                    raise ValueError(f'"{name}" is in {seen[name]} and in {part}; rename one')
            if twice := sorted({name for name in names if names.count(name) > 1}):
                raise ValueError(f"{part} has {listed(twice)} twice; name each reflector once")
        return self

    @model_validator(mode="after")
    def one_place_each(self) -> Settings:
        """Refuse two reflectors in one place; a campaign of positions estimates their places."""
        if not self.of_positions:
            places = [self.tool[name] for name in self.measured]
            if same := [n for n in self.measured if places.count(self.tool[n]) > 1]:
                raise ValueError(f"[tool] has {listed(same)} in one place; give each its own")
        return self

    @property
    def base_std(self) -> float:
        """Standard uncertainty per axis of the base reflectors' nominal positions [m].

        Where it is not stated, that of the last digit h of their coordinates (its median), h /
        sqrt(12), if this is below a millimetre: coarser numbers are those of a drawing, not of a
        surveyor.
        """
        if self.base_frame_uncertainty.sigma_m is not None:
            return self.base_frame_uncertainty.sigma_m
        every = [x for point in self.base_frame.values() for x in point]
        places = [Decimal(repr(float(x))).normalize().as_tuple().exponent for x in every if x]
        last = 10.0 ** median_low([int(place) for place in places] or [0])
        return last / np.sqrt(12) if last < _SURVEYED_M else 0.0

    @property
    def sheet(self) -> DataSheet | None:
        """Data sheet from which the noise of the readings is taken; None where there is none.

        Any stated noise takes precedence. A sheet is valid for points, relative to the instrument,
        whose position is unknown without a base frame.
        """
        tracker, stated = self.tracker, self.instrument
        if tracker is None or tracker.sigma_m is not None or tracker.noise is not None:
            return None
        fits = stated.measures == "points" and stated.kind == "laser_tracker" and self.base_frame
        return sheet(stated.model) if fits and stated.model else None

    @property
    def reading_noise(self) -> InstrumentNoise | Literal["paper"] | None:
        """Noise of a reading in the frame of its beam, as stated or from the data sheet."""
        if self.sheet is not None:
            return self.sheet.noise
        return self.tracker.noise if self.tracker else None

    def within_reach(self, text: str) -> None:
        """Check every point of [tool] against the reach of an effector, when a campaign is run.

        Args:
            text: campaign.toml, for the line.

        Raises:
            InputError: One is out of reach.
        """
        for name, point in self.tool.items():
            try:
                _on_the_effector(point)
            except ValueError as wrong:
                thing, _, way_out = str(wrong).partition("; ")
                line = toml.line_of(text, ["tool", name])
                raise InputError(f"[tool] {name}: {thing}", way_out, line=line) from wrong

    @property
    def loads_log(self) -> Scale:
        """Log of scale, weights and payloads; it exists without a scale, too."""
        return self.scale or Scale()

    @property
    def loads_file(self) -> str:
        """Its name."""
        return self.loads_log.file

    @property
    def bodies(self) -> list[ReflectorSet]:
        """Reflectors with fixed mutual positions, as far as these are known."""
        tool = {name: self.tool[name] for name in self.measured}
        tables = {"[tool]": tool, "[base_frame]": self.base_frame}
        return [ReflectorSet(table, places) for table, places in tables.items() if len(places) > 1]

    @property
    def measured(self) -> list[str]:
        """Targets whose displacement is measured; a reduced campaign has those of its tool."""
        if self.displacements is not None and "measured" not in self.naming.model_fields_set:
            return [name for name in self.tool if name != "load_point"]
        return self.naming.measured


def tells_a_pose(places: Array) -> bool:
    """Whether targets at these places (t, 3) [m] determine a pose: three, not on one line."""
    first, second, *_ = *extent(places), 0.0, 0.0
    return len(places) > 2 and bool(second > ONE_LINE * first)


_UNFILLED = re.compile(r'\s*#\s*("[^"]+"|[^\s=#]+)\s*=\s*\?')
"""Pattern of a value that `init` leaves open, `# P1 = ?`, and its name."""


def parse(text: str) -> Settings:
    """Settings from the text of campaign.toml.

    Raises:
        InputError: Not TOML, a value that is still to be filled in, an unknown word, a missing
            table or a value of the wrong kind.
    """
    content = toml.loads(text, "campaign.toml")
    _filled_in(text)
    way_out = "correct it as docs/campaign.md describes"
    return checked(Settings, content, "campaign.toml", "", way_out, text)


def unfilled(text: str) -> dict[int, str]:
    """Names of the values of campaign.toml that are still to be filled in, by line."""
    found = ((k, _UNFILLED.match(line)) for k, line in enumerate(text.splitlines(), 1))
    return {k: one[1].strip('"') for k, one in found if one}


def _filled_in(text: str) -> None:
    """Refuse a campaign.toml with values that are still to be filled in.

    Raises:
        InputError: Names each such value with its line.
    """
    if left := unfilled(text):
        named = listed((f"{name} (line {line})" for line, name in left.items()), most=20)
        raise InputError(
            f"not filled in yet: {named}",
            "write what goes there without the #, or remove the line of what your cell has not",
            file="campaign.toml",
            line=min(left),
        )
