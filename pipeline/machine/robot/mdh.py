"""A robot from its table: TOML rows of DH parameters in, constant joint placements out.

In any convention link j is `placement[j]` times a motion along or about its z axis, so that all
users of this file (numpy kinematics, Pinocchio, B) handle a single form.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cache, cached_property
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import AliasChoices, ConfigDict, Field, model_validator

from pipeline.base import files, toml
from pipeline.base.arrays import Array, Bools, Locked
from pipeline.base.errors import InputError, listed
from pipeline.base.strict import (
    STANDARD_GRAVITY,
    Degrees,
    Length,
    Mass,
    Name,
    NotNegative,
    Numbers,
    Positive,
    Prose,
    Stiffness,
    checked,
)
from pipeline.machine.robot.capsules import BASE, Capsule, Capsules, capsules
from pipeline.machine.robot.steps import Fixed, screw_x, screw_z, turn_y

_FILES = resources.files(__package__)
SHIPPED = tuple(sorted(one.name[:-5] for one in _FILES.iterdir() if one.name.endswith(".toml")))
"""Names of the robots that ship, one for each robot file beside this module."""


class Joint(Numbers):
    """One `[[joint]]` of a robot file; lengths [m], angles in degrees or radians by suffix.

    Columns of joints.csv are named after it: `r1_m`, `theta2_deg`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9]*$", max_length=50)
    type: Literal["revolute", "prismatic"]
    alpha_deg: Degrees = 0.0
    beta_deg: Degrees = 0.0
    theta_deg: Degrees = 0.0
    a_m: Length | None = None
    d_m: Length = 0.0
    r_m: Length | None = None
    lower_m: Length | None = None
    upper_m: Length | None = None
    lower_deg: Degrees | None = None
    upper_deg: Degrees | None = None
    stiffness_n_per_m: Stiffness | None = None
    stiffness_nm_per_rad: Stiffness | None = None
    stiffness_range_n_per_m: tuple[Stiffness, Stiffness] | None = None
    stiffness_range_nm_per_rad: tuple[Stiffness, Stiffness] | None = None
    effort_n: Positive | None = None
    effort_nm: Positive | None = None
    mass_kg: NotNegative | None = None
    centre_of_mass_m: tuple[Length, Length, Length] | None = None

    @model_validator(mode="after")
    def units_fit_the_type(self) -> Joint:
        """A prismatic joint has m, N and N/m, a revolute one degrees, N m and N m/rad."""
        wrong = _TURNING if self.type == "prismatic" else _SLIDING
        if any(getattr(self, key) is not None for key in wrong):
            raise ValueError(
                f"joint {self.name} is {self.type}: its limits or stiffness have the other unit"
            )
        if self.stiffness_range and self.stiffness_range[0] >= self.stiffness_range[1]:
            raise ValueError(f"joint {self.name}: the range of its stiffness does not go upwards")
        if self.lower >= self.upper:
            raise ValueError(
                f"joint {self.name}: lower limit {self.lower} is not below upper {self.upper}"
            )
        return self

    @property
    def prismatic(self) -> bool:
        """True for a prismatic joint (m, N), False for a revolute one (rad, N m)."""
        return self.type == "prismatic"

    @property
    def lower(self) -> float:
        """Lower limit [m] or [rad]."""
        return self._limit(self.lower_m, self.lower_deg, -np.inf)

    @property
    def upper(self) -> float:
        """Upper limit [m] or [rad]."""
        return self._limit(self.upper_m, self.upper_deg, np.inf)

    def _limit(self, metres: float | None, degrees: float | None, none: float) -> float:
        given = metres if self.prismatic else degrees
        if given is None:
            return none
        return given if self.prismatic else float(np.deg2rad(given))

    @property
    def stiffness(self) -> float | None:
        """Nominal stiffness [N/m] or [N m/rad], None if unknown."""
        return self.stiffness_n_per_m or self.stiffness_nm_per_rad

    def with_stiffness(self, stiffness: float) -> Joint:
        """The same joint with another stiffness [N/m] or [N m/rad]."""
        key = "stiffness_n_per_m" if self.prismatic else "stiffness_nm_per_rad"
        return self.model_copy(update={key: stiffness})

    @property
    def stiffness_unit(self) -> str:
        """Unit of its stiffness."""
        return "N/m" if self.prismatic else "N m/rad"

    @property
    def compliance_unit(self) -> str:
        """Unit of its compliance."""
        return "m/N" if self.prismatic else "rad/(N m)"

    @property
    def stiffness_range(self) -> tuple[float, float] | None:
        """Stated range of its stiffness [N/m] or [N m/rad], None if not stated."""
        return self.stiffness_range_n_per_m or self.stiffness_range_nm_per_rad

    @property
    def effort(self) -> float | None:
        """Maximum force or torque of its drive [N] or [N m], None if unknown."""
        return self.effort_n or self.effort_nm

    @property
    def typical_stiffness(self) -> float:
        """Nominal stiffness, else geometric mean of its range, else a default of large arms."""
        if self.stiffness is None and self.stiffness_range is not None:
            return math.sqrt(self.stiffness_range[0] * self.stiffness_range[1])
        return self.stiffness or (5e7 if self.prismatic else 1e6)


_SLIDING = ("lower_m", "upper_m", "stiffness_n_per_m", "stiffness_range_n_per_m", "effort_n")
_TURNING = (
    "lower_deg",
    "upper_deg",
    "stiffness_nm_per_rad",
    "stiffness_range_nm_per_rad",
    "effort_nm",
)
"""Keys of a prismatic joint only (`_SLIDING`), and of a revolute joint only."""


class _Controller(Numbers):
    """Mapping from the controller's axes to the joint variables: q = matrix @ axes + offset."""

    model_config = ConfigDict(extra="forbid")

    axes: list[Name]
    matrix: list[list[Degrees]]
    offset_deg: list[Degrees] | None = None


class RobotFile(Numbers):
    """A robot file, as written by a person.

    A row means, by the file's convention:

        khalil     Rx(alpha) Tx(d) Rz(theta) Tz(r)   modified DH, letters of Khalil and Kleinfinger
        craig      Rx(alpha) Tx(a) Rz(theta) Tz(d)   modified DH in Craig's letters, rows i-1 | i
        standard   Rz(theta) Tz(d) Tx(a) Rx(alpha)   the classic (distal) DH table

    Between nearly parallel axes these letters diverge; a rotation Ry(beta) after Rx(alpha), Hayati
    and Mirmirani's fifth letter (J. Robotic Systems 2, 1985), keeps them small.
    """

    model_config = ConfigDict(extra="forbid")

    format: Literal[1]
    name: str = Field(pattern=r"^[A-Za-z0-9_.-]+$", max_length=100)
    description: Prose
    convention: Literal["khalil", "craig", "standard"]
    source: Prose
    assumptions: list[Prose] = Field(default=[])
    payload_kg: Mass | None = None
    base: Fixed | None = None
    flange: Fixed | None = None
    joint: list[Joint] = Field(min_length=1)
    capsules: list[Capsule] = Field(
        default=[], validation_alias=AliasChoices("capsules", "capsule")
    )
    capsules_source: Prose = ""
    controller: _Controller | None = None
    length_sigma_m: Positive | None = None
    angle_sigma_deg: Positive | None = None


@dataclass(frozen=True, eq=False)
class Robot(Locked):
    """Geometry of a serial robot in its base frame F_b.

    Attributes:
        name: Name of the robot file.
        description: One sentence about the machine.
        joints: The joints from base to flange, n of them.
        placement: Frame of joint j at q_j = 0 in the frame of joint j-1, shape (n, 4, 4).
        flange: Flange frame in the frame of the last joint, shape (4, 4).
        controller: Names of the controller's axes; empty if the file does not map them.
        controller_matrix: q = controller_matrix @ axes + controller_offset, shape (n, axes).
        controller_offset: [rad] or [m], shape (n,).
        assumptions: Assumptions stated in the file, for the report.
        payload_kg: Rated payload [kg], None if the file does not state it.
        capsules: Its bodies; empty if the file has none.
        text: Text of the file, for hashing and the report.
        roughness: Standard deviation of its lengths [m] and angles [rad] as delivered; NaN if the
            file does not state it.
        gravity: Acceleration in F_b [m/s^2], shape (3,); upwards for a robot on a ceiling.
    """

    name: str
    description: str
    joints: tuple[Joint, ...]
    placement: Array
    flange: Array
    controller: tuple[str, ...]
    controller_matrix: Array
    controller_offset: Array
    assumptions: tuple[str, ...]
    payload_kg: float | None
    capsules: Capsules
    text: str
    roughness: tuple[float, float] = (math.nan, math.nan)
    gravity: Array = field(default_factory=lambda: np.array([0.0, 0.0, -STANDARD_GRAVITY]))

    def under(self, gravity: Array) -> Robot:
        """The same robot where its base frame has gravity [m/s^2], shape (3,)."""
        return self if np.array_equal(self.gravity, gravity) else replace(self, gravity=gravity)

    @property
    def down(self) -> Array:
        """Unit vector of gravity in F_b, shape (3,)."""
        return np.asarray(self.gravity / np.linalg.norm(self.gravity))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def prismatic(self) -> Bools:
        """True for prismatic joints, shape (n,)."""
        return np.array([joint.prismatic for joint in self.joints])

    @property
    def lower(self) -> Array:
        """Lower joint limits [m] or [rad], shape (n,)."""
        return np.array([joint.lower for joint in self.joints])

    @property
    def upper(self) -> Array:
        """Upper joint limits [m] or [rad], shape (n,)."""
        return np.array([joint.upper for joint in self.joints])

    def from_degrees(self, q: ArrayLike) -> Array:
        """Convert joint values from m and degrees to [m] or [rad], (n,) or (m, n).

        Args:
            q: Prismatic joints in m, revolute joints in degrees.

        Raises:
            InputError: There is not one number for each joint.
        """
        values = _row("q", q, [joint.name for joint in self.joints])
        return np.where(self.prismatic, values, np.deg2rad(values))

    def from_controller(self, axes: ArrayLike) -> Array:
        """Joint values [m] or [rad] from axis values as the controller shows them, (n,) or (m, n).

        Args:
            axes: Values in mm and degrees, in the order of `controller`; (k,) or (m, k).

        Raises:
            InputError: There is not one number for each axis.
        """
        names = self.controller or tuple(joint.name for joint in self.joints)
        values = _row("axes", axes, names)
        if not self.controller:
            return np.where(self.prismatic, 1e-3 * values, np.deg2rad(values))
        si = np.where(self.slides, 1e-3 * values, np.deg2rad(values))
        return np.asarray(si @ self.controller_matrix.T + self.controller_offset)

    @cached_property
    def slides(self) -> Bools:
        """True for axes of the controller that move a prismatic joint, shape (axes,)."""
        return np.asarray(self.prismatic.astype(float) @ np.abs(self.controller_matrix) > 0)

    @cached_property
    def nominal_compliance(self) -> Array:
        """Reciprocal of the nominal (or typical) stiffness [m/N] or [rad/(N m)], shape (n,)."""
        return np.array([1.0 / joint.typical_stiffness for joint in self.joints])


def _row(what: str, given: ArrayLike, names: Sequence[str]) -> Array:
    """User-supplied numbers, checked to be one for each of these names, (n,) or (m, n)."""
    way_out = f"give a number for each of {listed(names)}"
    try:
        values = np.asarray(given, dtype=float)
    except (TypeError, ValueError) as problem:
        raise InputError(f"{what} is no array of numbers", way_out) from problem
    if values.ndim not in (1, 2) or values.shape[-1] != len(names):
        raise InputError(f"{what} has shape {values.shape}", way_out)
    return values


def _letters(row: Joint, convention: str) -> tuple[float, float]:
    """The row's translations along x and along z [m], in any convention."""
    if convention == "khalil":
        if row.a_m is not None:
            raise ValueError(f"joint {row.name}: convention khalil has d_m and r_m, not a_m")
        return row.d_m, row.r_m or 0.0
    if row.r_m is not None:
        raise ValueError(f"joint {row.name}: convention {convention} has a_m and d_m, not r_m")
    return row.a_m or 0.0, row.d_m


def along_x(row: Joint, convention: str) -> Array:
    """Part of a row along and about x, followed by its rotation about y, shape (4, 4)."""
    shift, _ = _letters(row, convention)
    return screw_x(np.deg2rad(row.alpha_deg), shift) @ turn_y(np.deg2rad(row.beta_deg))


def along_z(row: Joint, convention: str) -> Array:
    """Part of a row along and about z, without the joint's own motion, shape (4, 4)."""
    _, shift = _letters(row, convention)
    return screw_z(np.deg2rad(row.theta_deg), shift)


def placements(file: RobotFile) -> tuple[Array, Array]:
    """Constant joint placements of a table, including its base and flange.

    Returns:
        placement (n, 4, 4) and flange (4, 4) as in `Robot`.

    Raises:
        ValueError: A row has letters that do not belong to its convention.
    """
    placement = []
    before = Fixed() if file.base is None else file.base
    behind = before.step  # transformation pending before the next joint: base, or a distal row
    for row in file.joint:
        x, z = along_x(row, file.convention), along_z(row, file.convention)
        if file.convention == "standard":
            placement.append(behind)
            behind = z @ x
        else:
            placement.append(behind @ x @ z)
            behind = np.eye(4)
    return np.array(placement), behind @ (Fixed() if file.flange is None else file.flange).step


def _links(file: RobotFile) -> dict[str, tuple[int, Array]]:
    """Number of each link and the frame of its row in that of its joint, (4, 4)."""
    behind = [np.eye(4)] * len(file.joint)
    if file.convention == "standard":
        behind = [along_z(row, "standard") @ along_x(row, "standard") for row in file.joint]
    rows = {row.name: (k, T) for k, (row, T) in enumerate(zip(file.joint, behind, strict=True), 1)}
    return {BASE: (0, np.eye(4)), **rows}


def _weighing(row: Joint, T: Array) -> Joint:
    """The row with its centre of mass in the frame of its joint, T the row's frame there."""
    if row.centre_of_mass_m is None:
        return row
    x, y, z = (T[:3, :3] @ row.centre_of_mass_m + T[:3, 3]).tolist()
    return row.model_copy(update={"centre_of_mass_m": (x, y, z)})


def parse(text: str, file: str) -> Robot:
    """Create a robot from the text of its file.

    Raises:
        InputError: The text is not TOML or not a robot; states where and what is expected.
    """
    return of_table(toml.loads(text, file), text, file)


def of_table(table: Mapping[str, Any], text: str, file: str) -> Robot:
    """Create a robot from a parsed text, as returned by `toml.loads`.

    Raises:
        InputError: It is not a robot; states where and what is expected.
    """
    content = checked(RobotFile, table, file, "the robot", "correct the robot file", text)
    try:
        placement, flange = placements(content)
    except ValueError as problem:
        raise InputError(str(problem), "correct the row or the convention", file=file) from problem
    names, links = [joint.name for joint in content.joint], _links(content)
    if len(set(names)) < len(names):
        raise InputError(f"joint names {listed(names)} are not unique", "rename one", file=file)
    axes, matrix, offset = _controller(content.controller, content.joint, file)
    _one_meaning_each(names, axes, matrix, offset, file, text)
    return Robot(
        name=content.name,
        description=content.description,
        joints=tuple(_weighing(row, links[row.name][1]) for row in content.joint),
        placement=placement,
        flange=flange,
        controller=axes,
        controller_matrix=matrix,
        controller_offset=offset,
        assumptions=tuple(content.assumptions),
        payload_kg=content.payload_kg,
        capsules=capsules(content.capsules, links, content.capsules_source, file),
        text=text,
        roughness=(
            content.length_sigma_m or math.nan,
            math.radians(content.angle_sigma_deg or math.nan),
        ),
    )


def _controller(
    controller: _Controller | None, joints: Sequence[Joint], file: str
) -> tuple[tuple[str, ...], Array, Array]:
    n = len(joints)
    if controller is None:
        return (), np.zeros((n, 0)), np.zeros(n)
    matrix = np.array(controller.matrix, dtype=float) if controller.matrix else np.zeros((0, 0))
    if matrix.shape != (n, len(controller.axes)):
        raise InputError(
            f"controller.matrix has shape {matrix.shape}, "
            f"not {n} joints x {len(controller.axes)} axes",
            "give one row per joint and one column per axis",
            file=file,
        )
    offset_deg = controller.offset_deg or [0.0] * n
    if len(offset_deg) != n:
        raise InputError(
            f"controller.offset_deg has {len(offset_deg)} values, not {n}",
            "give one value per joint",
            file=file,
        )
    for joint, degrees in zip(joints, offset_deg, strict=True):
        if joint.type == "prismatic" and degrees:
            raise InputError(
                f"controller.offset_deg has {degrees:g} for {joint.name}, which is prismatic",
                f"write 0 there and add the offset to d_m of {joint.name}",
                file=file,
            )
    return tuple(controller.axes), matrix, np.deg2rad(offset_deg)


def _one_meaning_each(
    names: list[str],
    axes: tuple[str, ...],
    matrix: Array,
    offset: Array,
    file: str,
    text: str,
) -> None:
    """Check that a joint and an axis of the same name are identical.

    Raises:
        InputError: They are not: a column of that name would be ambiguous.
    """
    for k, axis in enumerate(axes):
        for j, name in enumerate(names):
            alone = np.eye(len(names))[j], np.eye(len(axes))[k]
            same = np.array_equal(matrix[:, k], alone[0]) and np.array_equal(matrix[j], alone[1])
            if name.lower() == axis.lower() and not (same and offset[j] == 0):
                terms = [f"{c:+g} {other}" for c, other in zip(matrix[j], axes, strict=True) if c]
                turn = f" {np.rad2deg(offset[j]):+g} deg" if offset[j] else ""
                raise InputError(
                    f"{name} is a joint, and {axis} an axis of the controller that is not that "
                    f"joint: joint {name} = {' '.join(terms)}{turn}, so that a column {axis} of "
                    "a log could be read either way",
                    f"call the joints otherwise, such as theta{j + 1}, and leave the controller's "
                    "axes their names",
                    file=file,
                    line=toml.line_of(text, ["controller", "axes"]),
                )


def load(name: str, folder: Path | None = None) -> Robot:
    """Load a robot that ships with the pipeline, or a user's own file by path.

    Args:
        name: One of `SHIPPED`, or a path to a .toml file, relative to `folder`.
        folder: The campaign folder.

    Raises:
        InputError: There is no such robot (similar names are suggested), or its file cannot be read
            or does not describe a robot.
    """
    if name in SHIPPED:
        return _shipped(name)
    path, unknown = (folder or Path()) / name, no_robot(name, "campaign.toml" if folder else None)
    if path.suffix != ".toml":
        raise unknown
    return parse(files.words(path, path.name, toml.LARGEST_TEXT, unknown), path.name)


def no_robot(name: str, file: str | None) -> InputError:
    """Error for a name that is neither a shipped robot nor a file."""
    near = meant(name)
    asked = f"did you mean {listed(near)}? If not, " if near else ""
    return InputError(
        f'there is no robot "{name}"',
        f"{asked}use one that ships, which `pipeline robot --list` shows, or the path of a robot "
        "file ending in .toml",
        file=file,
        key=["robot"],
    )


def meant(typed: str) -> list[str]:
    """Shipped robots whose name or description contains what was typed, else similar names."""
    plain = {name: _plain(name) for name in SHIPPED}
    word = _plain(typed)
    found = [one for one in SHIPPED if word in plain[one] or word in _plain(load(one).description)]
    heads = [one[: len(word)] for one in plain.values()]  # kr501: a type without its variant
    near = get_close_matches(word, dict.fromkeys(heads), 3)
    return found or [
        name for one in near for name, own in zip(SHIPPED, heads, strict=True) if own == one
    ]


def _plain(words: str) -> str:
    """Letters and digits only, common to `KR 210 R2700-2` and `kr210_r2700_2`."""
    return "".join(one for one in words.casefold() if one.isalnum())


@cache
def _shipped(name: str) -> Robot:
    return parse((_FILES / f"{name}.toml").read_text("utf-8"), f"{name}.toml")
