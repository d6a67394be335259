"""A campaign of absolute positions: from its tables to readings pose by pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
import pandas as pd
import pyarrow as pa
from scipy.spatial.transform import Rotation

from pipeline.base.arrays import Array, Bools, Ints
from pipeline.base.errors import InputError
from pipeline.base.shown import in_toml
from pipeline.machine.robot import Robot
from pipeline.positions.mechanism import ArmWeights, Payloads
from pipeline.positions.readings import PositionReadings
from pipeline.readers._log_table import whole_numbers
from pipeline.readers.export_settings import OWN_LOG, LogForm
from pipeline.readers.logs import (
    ANGLE,
    AXES,
    LENGTH,
    TEMPERATURE,
    TURNS,
    Log,
    Quantity,
    joint_values,
    with_joints,
)
from pipeline.readers.pose_names import shown
from pipeline.reduction.limits import LEEWAY
from pipeline.reduction.settings import PositionsSettings, Settings
from pipeline.tables import SOURCE, TARGET, number, promise, text

_ORDER = {"xyz_intrinsic": "XYZ", "xyz_extrinsic": "xyz", "zyx_intrinsic": "ZYX"}
"""Notation of the rotation sequences in scipy; rx, ry, rz are the angles about x, y and z in
each."""

_FEWEST = 10
"""Minimum number of poses of a campaign: tool, frame and a few DH parameters are some twenty
unknowns, and a pose has three to six readings."""


@dataclass(frozen=True, eq=False)
class Positioned:
    """Positions of a campaign.

    Attributes:
        readings: Readings, pose by pose.
        weights: Gravity and payloads on the arm.
        rejected: File, line and reason of each row that was left out.
        table: Every row that was used, table POSITIONS.
    """

    readings: PositionReadings
    weights: ArmWeights
    rejected: pd.DataFrame
    table: pd.DataFrame


_RejectedRows = list[tuple[str, int | None, str]]
"""File, line and reason of rows that were left out."""


def as_read(
    settings: Settings, robot: Robot, raw: Mapping[str, bytes]
) -> tuple[pd.DataFrame, _RejectedRows]:
    """Every valid row of the tables, whatever its joint values, and the rejected rows.

    Raises:
        InputError: A file is missing or cannot be trusted, no row is left, or a payload is unknown.
    """
    stated = settings.positions
    assert stated is not None
    logs = [_log(settings, stated, robot, raw, name) for name in stated.named]
    rows = pd.concat([_rows(log, robot, stated) for log in logs], ignore_index=True)
    rejected = [one for log in logs for one in log.rejected]
    if rows.empty:
        _too_few(0, stated, rejected)
    unknown = rows[~rows["payload"].isin(["", *settings.payload])]
    for name, file, line in unknown[["payload", "file", "line"]].to_numpy(object)[:1]:
        raise InputError(
            f'payload "{name}" is not known',
            f"give it a table [payload.{in_toml(name)}] in campaign.toml",
            file=file,
            line=int(line),
        )
    return rows, rejected


def usable(
    settings: Settings, robot: Robot, rows: pd.DataFrame, rejected: _RejectedRows
) -> Positioned:
    """The rows within the robot's limits that do not contradict each other, pose by pose.

    Raises:
        InputError: Too few poses are left.
    """
    stated = settings.positions
    assert stated is not None
    rows, beyond = _within_limits(rows, robot)
    rows, apart = _of_one_pose(rows, robot)
    rejected = [*rejected, *beyond, *apart]
    frame = pd.DataFrame(rejected, columns=["file", "line", "reason"])
    poses = rows.groupby(["series", "pose"], sort=False, observed=True)
    stands = poses[[joint.name for joint in robot.joints]].first() / _SAME_POSE
    if (different := len(stands.round().drop_duplicates())) < _FEWEST:
        _too_few(different, stated, rejected)
    readings = by_pose(rows, robot, settings)
    return Positioned(readings, weights_of(settings, readings), frame, rows)


def _too_few(poses: int, stated: PositionsSettings, rejected: _RejectedRows) -> NoReturn:
    """Refuse a table with too few poses, by the first row that was left out if there is one."""
    few = f"{poses} different poses are left, of at least {_FEWEST}"
    if not rejected:
        raise InputError(few, "measure more", file=stated.named[0])
    file, line, reason = rejected[0]
    why, _, way_out = reason.partition("; ")
    raise InputError(
        f"{why}, and so {len(rejected)} rows in all are left out: {few}",
        way_out or "correct the rows that were left out",
        file=file,
        line=line,
    )


def weights_of(settings: Settings, readings: PositionReadings) -> ArmWeights:
    """Gravity, and the payload of each pose."""
    bodies = settings.payload.values()
    std = [(one.mass_sigma_kg, *[one.center_sigma_m] * 3) for one in bodies]
    payloads = Payloads(
        tuple(settings.payload),
        np.array([one.mass_kg for one in bodies], dtype=float),
        np.array([one.center_m for one in bodies], dtype=float).reshape(-1, 3),
        np.array(std, dtype=float).reshape(-1, 4),
    )
    return ArmWeights(settings.gravity.vector, payloads, readings.payload)


def _log(
    settings: Settings, said: PositionsSettings, robot: Robot, raw: Mapping[str, bytes], name: str
) -> Log:
    if name not in raw:
        raise InputError(
            "the file is missing",
            "put it into the campaign folder or correct [positions] of campaign.toml",
            file=name,
        )
    return positions(name, raw[name], robot, said)


def _rows(log: Log, robot: Robot, said: PositionsSettings) -> pd.DataFrame:
    """Rows of a table: series, pose, target, payload, joint values, position and orientation."""
    m = len(log.line)
    series = next((s for s, file in said.files.items() if file == log.file), None)
    empty = np.full(m, "", dtype=object)
    target = log.word.get("target", empty)
    nothing = np.full(m, np.nan)
    turn = np.stack([log.number.get(one, nothing) for one in TURNS], axis=1)
    table = {
        "series": log.word.get("series", empty) if series is None else np.full(m, series, object),
        "pose": log.number.get("pose", np.arange(1.0, m + 1)),
        "target": np.where(target == "", _NAMELESS, target),
        "payload": log.word.get("payload", empty),
        "temperature": log.number.get("temperature", nothing),
        "file": np.full(m, log.file, dtype=object),
        "line": log.line,
        **{axis: log.number[axis] for axis in AXES},
        **dict(zip(TURNS, turn.T, strict=True)),
        **{j.name: q for j, q in zip(robot.joints, joint_values(log, robot).T, strict=True)},
    }
    return pd.DataFrame(table)


def _within_limits(rows: pd.DataFrame, robot: Robot) -> tuple[pd.DataFrame, _RejectedRows]:
    """The rows within the robot's limits, and the rejected ones."""
    q = rows[[joint.name for joint in robot.joints]].to_numpy(float)
    over = np.maximum(robot.lower - q, q - robot.upper)
    worst = np.argmax(over, axis=1)
    bad = over[np.arange(len(q)), worst] > LEEWAY
    out: _RejectedRows = []
    for k in np.flatnonzero(bad).tolist():
        joint = robot.joints[worst[k]]
        out.append((
            str(rows["file"].iloc[k]),
            int(rows["line"].iloc[k]),
            f"joint {joint.name} is beyond the limits of the robot file; correct or remove the row",
        ))  # fmt: skip
    return rows[~bad].reset_index(drop=True), out


_SAME_POSE = 2e-3
"""Largest difference of joint values stated for one pose [rad] or [m], as between two days."""


def _of_one_pose(rows: pd.DataFrame, robot: Robot) -> tuple[pd.DataFrame, _RejectedRows]:
    """The rows that state what most rows of their pose do, and the rejected ones.

    If as many state one thing as another, all rows of the pose are rejected.
    """
    pose = rows.groupby(["series", "pose"], sort=False, observed=True)
    names = [joint.name for joint in robot.joints]
    off = (rows[names] - pose[names].transform("median")).abs().max(axis=1) > _SAME_POSE
    loads = pose["payload"].transform("nunique") > 1
    out: _RejectedRows = []
    for k in np.flatnonzero(off | loads).tolist():
        what = "joint values" if off[k] else "a payload"
        file, line, number = (rows[one].iloc[k] for one in ("file", "line", "pose"))
        why = f"has {what} that other rows of pose {shown(int(number))} contradict"
        out.append((str(file), int(line), f"{why}; correct it, or number it as another pose"))
    return rows[~(off | loads)].reset_index(drop=True), out


def by_pose(rows: pd.DataFrame, robot: Robot, settings: Settings) -> PositionReadings:
    """Readings pose by pose; of a target that was read twice in a pose the last row counts."""
    said, payloads = settings.positions, list(settings.payload)
    assert said is not None
    rows = rows.drop_duplicates(["series", "pose", "target"], keep="last")
    number = rows.groupby(["series", "pose"], sort=False).ngroup().to_numpy()
    first = np.unique(number, return_index=True)[1]
    head = rows.iloc[first]
    targets, target = np.unique(rows["target"].to_numpy(str), return_inverse=True)
    series, names = pd.factorize(head["series"].to_numpy(str))  # in the order of measurement
    m, t = len(first), len(targets)
    at, turn = np.full((m, t, 3), np.nan), np.tile(np.eye(3), (m, t, 1, 1))
    at[number, target] = rows[list(AXES)].to_numpy(float)
    angles = rows[list(TURNS)].to_numpy(float)
    six = _six(angles, target.astype(np.int64), t)
    known = np.flatnonzero(np.isfinite(angles).all(axis=1))
    if len(known):
        turned = _turned(angles[known], said.rotation)
        turn[number[known], target[known]] = turned
    places = {"": 0, **{name: k for k, name in enumerate(payloads, 1)}}
    return PositionReadings(
        series=series.astype(np.int64),
        names=names.astype(object),
        pose=head["pose"].to_numpy(np.int64),
        file=head["file"].to_numpy(object),
        line=head["line"].to_numpy(np.int64),
        q=head[[joint.name for joint in robot.joints]].to_numpy(float),
        targets=targets.astype(object),
        six=six,
        at=at,
        turn=turn,
        payload=np.array([places[one] for one in head["payload"]], dtype=np.int64),
        payloads=np.array(payloads, dtype=object),
        temperature=head["temperature"].to_numpy(float),
    )


def _six(angles: Array, target: Ints, count: int) -> Bools:
    """Targets whose orientation is in each of their rows, (t,)."""
    unknown = np.isnan(angles).any(axis=1)
    return np.bincount(target, unknown, count) == 0


def _turned(angles: Array, rotation: str) -> Array:
    """Orientations from angles about x, y, z applied in the stated order, (k, 3, 3)."""
    order = _ORDER[rotation]
    place = {"X": 0, "Y": 1, "Z": 2}
    sorted_by = angles[:, [place[letter] for letter in order.upper()]]
    return np.asarray(Rotation.from_euler(order, sorted_by).as_matrix())


_NAMELESS = "T"
"""Target name used if a table names none."""


def positions(name: str, data: bytes, robot: Robot, stated: LogForm = OWN_LOG) -> Log:
    """Read a table of positions: joint values, x, y, z and, for 6D targets, rx, ry, rz.

    Args:
        name: Name of the file.
        data: Its content.
        robot: The robot whose joints they are.
        stated: [positions] of campaign.toml.

    Returns:
        Numbers by joint [m] or [rad], x, y, z [m]; if present rx, ry, rz [rad], pose and
        temperature [degC]; words series, target and payload, empty if there is no such column.

    Raises:
        InputError: A joint is missing; the file cannot be read.
    """
    places = [Quantity(axis, LENGTH) for axis in AXES]
    turns = [Quantity(turn, ANGLE, needed=False) for turn in TURNS]
    others = [*turns, Quantity("pose", {}, needed=False),
              Quantity("temperature", TEMPERATURE, needed=False),
              *(Quantity(word, {}, "name", needed=False) for word in _WORDS)]  # fmt: skip
    log = whole_numbers(with_joints(name, data, robot, stated, [*places, *others]))
    reason = "temperature is none of a hall; correct it, or leave it empty"
    return log.where("temperature", lambda c: np.isnan(c) | ((c >= -50) & (c <= 100)), reason)


_WORDS = ("series", "target", "payload")


def schema(robot: Robot) -> pa.Schema:
    """Schema of absolute positions as read, in the frame of the instrument."""
    return promise(
        "positions",
        "series,pose,target",
        text("series", "series of the instrument's frame"),
        number("pose", "1", "number of the pose in its series"),
        TARGET,
        text("payload", "name of the payload on the flange, empty for none"),
        number("temperature", "degC", "of the air, NaN unknown"),
        *SOURCE,
        *(number(axis, "m", "reading") for axis in "xyz"),
        *(number(f"r{axis}", "rad", "reading of a 6D target, NaN for a point") for axis in "xyz"),
        *(number(j.name, "m" if j.prismatic else "rad", "joint value") for j in robot.joints),
    )
