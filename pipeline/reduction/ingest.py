"""Raw files to readings, loads and joint values, with everything wrong named.

A file that cannot be trusted as a whole stops the campaign. A row whose loss leaves the rest valid
is left out and listed with its reason.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline import readers, tables
from pipeline.base import doors
from pipeline.base.arrays import Array, Bools, Ints
from pipeline.base.covariance import columns as covariance_columns
from pipeline.base.errors import InputError, listed
from pipeline.base.patterns import fits, is_glob, natural
from pipeline.base.strict import LEAST_FORCE
from pipeline.base.threads import WORTH_A_THREAD, both
from pipeline.machine import instrument
from pipeline.machine.instrument import InstrumentNoise
from pipeline.machine.robot import Robot
from pipeline.machine.surroundings import turns
from pipeline.readers import Export, logs, pose_names
from pipeline.readers.reflector_sets import ReflectorSet
from pipeline.reduction import _pulls, _raw_readings, _size, limits, set_aside
from pipeline.reduction._index import numbered, pull_number
from pipeline.reduction._raw_readings import (
    RawReadings,
    Rejection,
)
from pipeline.reduction.case import ExportTreatment, FilesAsRead
from pipeline.reduction.digits import rounding
from pipeline.reduction.effector import tool
from pipeline.reduction.register import read_apart
from pipeline.reduction.settings import BASE_REFLECTORS, Displacements, Settings, Tracker
from pipeline.reduction.weights import PULL

_SIX = covariance_columns()

_BY_ORDER = "pipeline.dialects.assignment:assigned"
"""Door to readings without names, identified by the order in which they were taken."""
_ROWS = "pipeline.dialects.rows_of_poses:rows_of_poses"
_ENDS = "pipeline.dialects.anchored:with_ends"
"""Door to chains without reflectors, which go from the load point to an anchor."""
_OF_DAY = "pipeline.dialects.times_of_day:on_days"
"""Door to times without a date, which only files of other programs have."""
_NAMES = (
    "say with names in [tracker] of campaign.toml how names hold group and target, as `pipeline "
    "inspect` proposes, name the column of the groups in [tracker.mapping], write "
    'groups = "files" into [tracker] if each file is a group and has its name, or '
)


@dataclass(frozen=True, eq=False)
class _Ingested(FilesAsRead):
    """Content of a raw campaign, as tables that conform to their schemas.

    Attributes:
        joints: Table `tables.joints(robot)`.
        rejected: Table REJECTED.
        readings: Table READINGS; empty for a campaign that arrives reduced.
        loads: Table LOADS; empty for a campaign that arrives reduced.
        doubt: Why the values are implausible, where this was not to be an error.
    """

    joints: pa.Table
    rejected: pa.Table
    readings: pa.Table = field(default_factory=tables.READINGS.empty_table)
    loads: pa.Table = field(default_factory=tables.LOADS.empty_table)
    doubt: InputError | None = None


def ingest(
    settings: Settings, robot: Robot, raw: Mapping[str, bytes], plausible: bool = True
) -> _Ingested:
    """Read a campaign.

    Args:
        settings: campaign.toml.
        robot: The robot, for the columns and limits of the joint log.
        raw: Content of the raw files by name relative to the campaign folder.
        plausible: Whether to refuse values that only a wrong unit or convention explains, and leave
            out poses that the robot cannot take; False lets them through, for later stages to
            identify the mistake.

    Raises:
        InputError: A file is missing or cannot be trusted, or nothing usable is left.
    """
    if settings.test_pose is not None:
        settings.test_pose.within_limits(robot)
    turns(robot, settings)
    log = settings.joints.file
    logged = logs.joints(log, _file(raw, log, "[joints]"), robot, settings.joints)
    joints = logs.of_poses(logged)
    out = limits.impossible(joints, robot)
    doubt = limits.doubt(list(out.values()))
    if doubt and plausible and len(out) == len(joints.line):
        raise doubt
    doubt = None if plausible else doubt
    why = {one.pose: limits.reason(one) for one in out.values()} if plausible else {}
    joints = _leaving(joints, why)
    if settings.displacements:
        return _reduced(settings, settings.displacements, robot, raw, joints, doubt, why)
    return _raw(settings, robot, raw, joints, logged, plausible, doubt, why)


def _poses(log: logs.Log) -> Array:
    return log.number["pose"]


def _renumbered(poses: Any, own: Mapping[int, int]) -> Ints:
    """Poses as numbered in the campaign, shape (n,)."""
    return np.array([own.get(int(pose), int(pose)) for pose in poses], dtype=np.int64)


def _with_own_numbers(log: logs.Log, own: Mapping[int, int]) -> logs.Log:
    """A log with its poses as numbered in the campaign."""
    number = log.number | {"pose": _renumbered(log.number["pose"], own).astype(float)}
    of = {line: own.get(int(pose), pose) for line, pose in log.pose_of.items() if pose == pose}
    return replace(log, number=number, pose_of=of)


def _stood_again(
    joints: logs.Log, left_out: Mapping[int, str], own: Mapping[int, int]
) -> tuple[logs.Log, dict[int, str]]:
    """Joint values of `4` for `4bis`, which has none of its own; and why either is left out."""
    pose = joints.number["pose"]
    lacking = {number: pose_names.plain(code) for code, number in own.items()
               if number not in pose and code not in left_out}  # fmt: skip
    again = {
        new: int(np.flatnonzero(pose == old)[0]) for new, old in lacking.items() if old in pose
    }
    rows = np.r_[np.arange(len(pose)), np.array([*again.values()], dtype=np.int64)]
    number = {name: values[rows] for name, values in joints.number.items()}
    number["pose"] = np.r_[pose, np.array([*again], dtype=float)]
    word = {name: values[rows] for name, values in joints.word.items()}
    why = {own.get(one, one): reason for one, reason in left_out.items()}
    why |= {new: left_out[old] for new, old in lacking.items() if old in left_out}
    return replace(joints, number=number, word=word, line=joints.line[rows]), why


def _leaving(log: logs.Log, why: Mapping[int, str]) -> logs.Log:
    """Rows of a log without those of some poses, which are rejected for these reasons."""
    poses = log.number["pose"]
    rows = np.flatnonzero(np.isin(poses, [*why])).tolist()
    return log.without({k: why[int(poses[k])] for k in rows})


def _doubt(check: Callable[[], None], plausible: bool) -> InputError | None:
    """The error that a check raises; raised again when only plausible values may pass."""
    try:
        check()
    except InputError as problem:
        if plausible:
            raise
        return problem
    return None


def _file(raw: Mapping[str, bytes], name: str, words: str) -> bytes:
    if name not in raw:
        raise InputError(
            "the file is missing",
            f"put it into the campaign folder or correct {words} of campaign.toml",
            file=name,
        )
    return raw[name]


# --- from readings --------------------------------------------------------------------------------


def _raw(
    settings: Settings,
    robot: Robot,
    raw: Mapping[str, bytes],
    joints: logs.Log,
    logged: logs.Log,
    plausible: bool,
    doubt: InputError | None,
    left_out: Mapping[int, str],
) -> _Ingested:
    tracker = settings.tracker
    assert tracker is not None  # there are no displacements
    loads, exports = _read(settings, tracker, raw)
    every = np.concatenate([_poses(loads), _poses(joints)])
    words = {*map(pose_names.letters_of, every)} - {""}
    everything = _raw_readings.gather(exports, settings, loads.states, words)
    joints, logged, left_out, taken = _own_rows(
        settings, robot, everything, joints, logged, left_out
    )
    if own := pose_names.numbers([*everything.pose, *every]):
        everything = replace(everything, pose=_renumbered(everything.pose, own))
        loads, joints = (_with_own_numbers(one, own) for one in (loads, joints))
        joints, left_out = _stood_again(joints, left_out, own)
    width = len(settings.measured) + 2
    everything, (loads, joints), aside = set_aside.kept(
        everything, (loads, joints), settings.set_aside, own, width
    )
    anchors = anchors_read = {}
    if "anchor" in loads.word:
        everything, anchors, anchors_read = doors.opened(_ENDS)(everything, loads, settings)
    shots = _known_shots(everything, settings, loads)
    doubt = _doubt(lambda: _size.check_units(shots, settings), plausible) or doubt
    shots, renamed = _raw_readings.with_own_names(shots, width)
    rounds = _raw_readings.in_rounds(shots, width)
    noisy = settings.reading_noise is not None or tracker.sigma_m is not None
    weighed = _raw_readings.weighed(_raw_readings.once(rounds, width), noisy)
    _three_base_reflectors(weighed, settings)
    _some_pull(weighed, settings, loads)
    weighed, loads = weighed.without_poses(left_out), _leaving(loads, left_out)
    causes = [*weighed.rejected, *loads.rejected, *joints.rejected]
    whole, loads = _pulls.complete(weighed, settings, loads, joints)
    joints = _of_read_poses(settings, robot, joints, whole)
    if not len(loads.line):
        raise _nothing_left(causes or whole.rejected)
    return _Ingested(
        readings=_readings(whole, settings),
        loads=_loads(loads, settings.loads_log.mass_sigma_kg),
        joints=_joints(joints, robot),
        rejected=_rejected([*whole.rejected, *loads.rejected, *joints.rejected]),
        doubt=doubt,
        stale=_raw_readings.stale(weighed),
        contradictions=_raw_readings.contradictions(rounds, width),
        renamed=renamed,
        lost=_raw_readings.lost(shots, whole, settings.measured),
        unused=_raw_readings.unused(everything, whole),
        aside=aside,
        anchors=anchors,
        anchors_read=anchors_read,
        treated=_treated(exports, own) + taken,
        torques=_torques(logged, robot),
    )


def _read(
    settings: Settings, tracker: Tracker, raw: Mapping[str, bytes]
) -> tuple[logs.Log, Mapping[str, Export]]:
    """The log of loads, and the exports of the tracker."""
    file = settings.loads_file
    log = _file(raw, file, "[scale]")
    loads, exports = both(
        lambda: _known_loads(settings, logs.loads(file, log, settings.loads_log)),
        lambda: _exports(settings, tracker, raw),
        much=len(log) > WORTH_A_THREAD,
    )
    _some_reading(exports)
    return loads, exports


def _known_shots(everything: RawReadings, settings: Settings, loads: logs.Log) -> RawReadings:
    """Readings of known targets; those of a log that states groups lie in the states it names."""
    shots = _raw_readings.known(everything, settings, loads.states)
    if loads.states:
        chain = settings.naming.chain
        _raw_readings.pulled_at_rest(shots, chain, loads.states, settings.loads_file)
    return shots


def _of_read_poses(
    settings: Settings, robot: Robot, joints: logs.Log, read: RawReadings
) -> logs.Log:
    """Rows of the joint log whose poses were read; that of the test pose need not be."""
    seen = np.bincount(read.slot + 1, minlength=len(read.pose) + 1)[1:] > 0
    used = np.isin(joints.number["pose"], numbered(read.pose[seen])[0])
    known = used | ~_is_test_pose(settings, robot, joints)
    return joints.kept(known).only(
        used[known], "no usable reading has this pose; measure it or remove the row"
    )


def _treated(exports: Mapping[str, Export], own: Mapping[int, int]) -> tuple[ExportTreatment, ...]:
    """What was done to exports, each where anything was."""
    return tuple(
        ExportTreatment(name, one.faces, one.untimed, (*one.settled, *_numbering(own)))
        for name, one in exports.items()
        if one.faces or one.untimed or one.settled or own
    )


def _own_rows(
    settings: Settings,
    robot: Robot,
    shots: RawReadings,
    joints: logs.Log,
    logged: logs.Log,
    out: Mapping[int, str],
) -> tuple[logs.Log, logs.Log, Mapping[int, str], tuple[ExportTreatment, ...]]:
    """The joint log, whole and a row for each pose, by the poses where its rows only count."""
    look = doors.found(_ROWS)
    rows = look and look(robot, tool(settings).points, shots, joints, frozenset(out))
    if not rows:
        return joints, logged, out, ()
    said = ExportTreatment(joints.file, None, None, (rows.said,))
    return rows.of(joints), rows.of(logged), {}, (said,)


def _numbering(own: Mapping[int, int]) -> Iterator[str]:
    """What poses with letters behind their number are called in the answer."""
    if own:
        yield listed(f"pose {pose_names.shown(code)} as pose {n}" for code, n in own.items())


def _is_test_pose(settings: Settings, robot: Robot, joints: logs.Log) -> Bools:
    """Rows of the joint log with the joint values of [test_pose], to what a pendant shows."""
    if settings.test_pose is None:
        return np.zeros(len(joints.line), dtype=bool)
    q = np.stack([joints.number[joint.name] for joint in robot.joints], axis=1)
    off = np.abs(q - settings.test_pose.joint_values(robot))
    return np.asarray((off < np.where(robot.prismatic, _PENDANT_M, _PENDANT_RAD)).all(axis=1))


_PENDANT_M, _PENDANT_RAD = 1e-5, 1e-4
"""Resolution of joint values on the pendant of a controller: 0.01 mm [m], 0.005 deg [rad]."""


def _known_loads(settings: Settings, loads: logs.Log) -> logs.Log:
    """Rows whose scale or payload is defined in campaign.toml, with the force that was pulled.

    Raises:
        InputError: A chain pulls, and there is no table [scale].
    """
    pulled = np.flatnonzero(~np.isnan(loads.number["force"]))
    if settings.scale is None and len(pulled):
        raise InputError(
            f"there are {len(pulled)} readings of a scale, and campaign.toml has no table [scale]",
            "add [scale] with sigma_n, the standard uncertainty of a reading",
            file=loads.file,
            line=int(loads.line[pulled[0]]),
        )
    scale, known = settings.loads_log, listed(settings.payload) or "none"
    force = (loads.number["force"] - scale.zero_n) / scale.gain
    loads = replace(loads, number={**loads.number, "force": force}).only(
        ~(force < LEAST_FORCE), "the force is not above what [scale] zero_n says; correct either"
    )
    return loads.where(
        "payload",
        lambda names: np.isin(names, ["", *settings.payload]),
        f"campaign.toml has no [payload] table of this name (there is {known}); add or correct it",
    )


def _exports(settings: Settings, tracker: Tracker, raw: Mapping[str, bytes]) -> dict[str, Export]:
    """The tracker exports in the order of `files`, those of a glob in natural order.

    A glob never takes the other logs.
    """
    others = {settings.joints.file, "campaign.toml", settings.robot, tracker.assignment}
    others.add(settings.loads_file)
    found = {
        name: _export(name, raw[name], tracker, settings.bodies)
        for one in tracker.files
        for name in sorted(raw, key=natural)
        if name == one or (is_glob(one) and name not in others and fits(name, one))
    }
    tracker.none_missing([*found])
    of_day = doors.found(_OF_DAY)
    exports = of_day(found, settings.date) if of_day else found
    if tracker.assignment:
        table = _file(raw, tracker.assignment, "assignment in [tracker]")
        named: dict[str, Export] = doors.opened(_BY_ORDER)(exports, tracker.assignment, table)
        return named
    _all_named(exports)
    return exports


def _all_named(exports: Mapping[str, Export]) -> None:
    for name, export in exports.items():
        if export.group is None:
            raise InputError(
                f"the readings have no {'names' if export.target is None else 'groups'}",
                f"{_NAMES if export.target is not None else ''}say what each row is in a table "
                'order,group,target, and name the table with assignment = "assignment.csv" in '
                "[tracker] of campaign.toml",
                file=name,
            )


_SETTLED = "pipeline.intake.by_reflectors:settled"
"""Door to what known reflectors settle of an ambiguous export."""


def _export(name: str, data: bytes, tracker: Tracker, bodies: Sequence[ReflectorSet]) -> Export:
    """Read an export; ambiguities are settled by known reflectors where possible."""
    try:
        return readers.read(name, data, tracker)
    except InputError:
        settled = doors.found(_SETTLED)
        hints, why = settled(name, data, tracker, bodies) if settled else (tracker, ())
        if not why:
            raise
        return replace(readers.read(name, data, hints), settled=why)


def _some_reading(exports: Mapping[str, Export]) -> None:
    if not any(len(export.line) for export in exports.values()):
        if unread := _raw_readings.unread(exports):
            raise _nothing_left(unread)
        raise InputError(
            "there is no reading in it, only a header",
            "export the readings, or correct files in [tracker]",
            file=next(iter(exports)),
        )


def _three_base_reflectors(shots: RawReadings, settings: Settings) -> None:
    if not settings.base_frame:
        return
    names, base = (
        shots.target.dictionary.to_pylist(),
        np.flatnonzero(shots.role == _raw_readings.BASE),
    )
    read = [names[k] for k in np.asarray(shots.target.indices)[base]]
    seen = sorted(set(read))
    if len(seen) < BASE_REFLECTORS:
        raise InputError(
            f"only {len(seen)} base reflectors of [base_frame] were read ({listed(seen)}), "
            "too few to find the base frame",
            f"measure at least {BASE_REFLECTORS}, or remove [base_frame] "
            "if readings are in F_b already",
            file=shots.files[0],
        )
    nominal = np.array([settings.base_frame[name] for name in read])
    first = shots.files[int(shots.file[base[0]])], int(shots.line[base[0]])
    read_apart(seen, shots.position[base], nominal, *first)


def _some_pull(shots: RawReadings, settings: Settings, loads: logs.Log) -> None:
    if shots.loaded.any():
        return
    if pulls := [name for name, one in loads.states.items() if one.loaded]:
        raise InputError(
            f"no group that {loads.file} names as a pull ({listed(pulls)}) is in the export",
            "correct its column group",
            file=shots.files[0],
        )
    called = listed(shots.group.dictionary.to_pylist())
    raise InputError(
        f'no group of the export is a loaded state by naming.group = "{settings.naming.group}"; '
        f"groups are called {called}",
        f"correct naming.group, or give {loads.file} a column group that names the group of each "
        "row",
        file="campaign.toml",
        key=["naming", "group"],
    )


def _readings(shots: RawReadings, settings: Settings) -> pa.Table:
    covariance, source = _covariance(shots, settings)
    slot = pa.array(shots.slot, mask=shots.slot < 0)
    pose, repeat, loaded = (
        pa.array(of_slot.astype(np.int32)).take(slot)
        for of_slot in (shots.pose, shots.repeat, shots.loaded)
    )
    columns = {
        "file": _chosen(shots.file, shots.files),
        "line": shots.line,
        "group": shots.group.cast(pa.string()),
        "target": shots.target,
        "pose": pose,
        "repeat": repeat,
        "state": pa.DictionaryArray.from_arrays(loaded, ["unloaded", "loaded"]),
        **{f"{axis}_m": _column(shots.position[:, k]) for k, axis in enumerate("xyz")},
        **{name: _column(covariance[k]) for k, name in enumerate(_SIX)},
        "covariance_from": source,
        "time": shots.time,
    }
    return tables.conform(pa.table(columns), tables.READINGS)


def _column(values: Array) -> pa.Array:
    return pa.array(np.ascontiguousarray(values))


def _covariance(shots: RawReadings, settings: Settings) -> tuple[list[Array], pa.DictionaryArray]:
    """Covariance of every reading, six columns, and the source of each."""
    stated, source = _stated_covariance(shots, settings)
    if shots.covariance is None:
        return _rounded(shots, stated), _chosen(np.zeros(len(shots)), [source])
    own: Bools = np.asarray(np.isfinite(shots.covariance).all(axis=1))
    six = shots.covariance
    if not six[own][:, _CROSSED].any():
        beams = instrument.correlated(shots.position[own], six[own][:, _DIAGONAL])
        six = six.copy()
        six[own] = six[own] if beams is None else beams
    columns = [np.where(own, six[:, k], stated[k]) for k in range(6)]
    return _rounded(shots, columns), _chosen(own, [source, "file"])


def _rounded(shots: RawReadings, columns: list[Array]) -> list[Array]:
    """The same plus the variance of the last digit, where this is not negligible."""
    variance = rounding(shots.position) ** 2
    out = list(columns)
    for k in _DIAGONAL:
        out[k] = columns[k] + np.where(variance > _COUNTS * columns[k], variance, 0.0)
    return out


_DIAGONAL, _CROSSED = (0, 3, 5), (1, 2, 4)
_COUNTS = 1e-3
"""Fraction of a variance below which a contribution is neglected [1]."""


def _chosen(which: Array | Ints | Bools, words: Sequence[str]) -> pa.DictionaryArray:
    """The word of each number."""
    return pa.DictionaryArray.from_arrays(which.astype(np.int32), list(words))


def _stated_covariance(shots: RawReadings, settings: Settings) -> tuple[list[Array], str]:
    noise, n = settings.reading_noise, len(shots)
    if isinstance(noise, InstrumentNoise):
        source = "instrument" if settings.sheet is None else "sheet"
        return list(instrument.beam_covariance(shots.position, noise).T), source
    if noise == "paper":
        return _alike(instrument.PAPER_SIGMA_M**2 * instrument.PAPER_SHARE, n), "paper"
    tracker = settings.tracker
    if tracker is not None and tracker.sigma_m is not None:
        return _alike(tracker.sigma_m**2 * instrument.ISOTROPIC, n), "stated"
    return [np.full(n, np.nan)] * 6, "none"


def _alike(six: Array, n: int) -> list[Array]:
    """The same six numbers n times; equal columns share an array, to save a million rows."""
    columns = {value: np.full(n, value) for value in set(six.tolist())}
    return [columns[value] for value in six.tolist()]


def _loads(loads: logs.Log, mass_sigma_kg: float) -> pa.Table:
    """Table LOADS; weights without an uncertainty in their row get the one stated for all."""
    stated, weight = (loads.number[name] for name in ("mass_sigma", "mass"))
    sigma = np.where(np.isnan(stated) & ~np.isnan(weight), mass_sigma_kg, np.nan_to_num(stated))
    columns = {
        **_pulls_of(loads),
        "force_n": loads.number["force"],
        "unit_n": loads.number["unit"],
        "mass_kg": loads.number["mass"],
        "mass_sigma_kg": sigma,
        "payload": [name or None for name in loads.word["payload"]],
        "branch": [branch or None for branch in loads.word.get("branch", [""] * len(loads.line))],
        **_source(loads),
    }
    return tables.conform(pa.table(columns), tables.LOADS)


def _joints(joints: logs.Log, robot: Robot) -> pa.Table:
    values = {tables.joint_column(j.name, j.prismatic): joints.number[j.name] for j in robot.joints}
    approach = joints.number.get("approach", np.zeros(len(joints.line)))
    columns = {
        "pose": joints.number["pose"],
        **values,
        "approach": np.nan_to_num(approach),
        **_source(joints),
    }
    return tables.conform(pa.table(columns), tables.joints(robot))


def _torques(log: logs.Log, robot: Robot) -> pd.DataFrame | None:
    """The table described in `FilesAsRead.torques`."""
    names = [f"tau{j}" for j in range(1, robot.n + 1)]
    if not {*names} & {*log.number}:
        return None
    none = np.full(len(log.line), np.nan)
    named = {name: log.number.get(name, none) for name in ("repeat", *names)}
    return pd.DataFrame({"pose": log.number["pose"].astype(np.int64), **named})


def _pulls_of(log: logs.Log) -> dict[str, Array]:
    return {name: log.number[name] for name in ("pose", "repeat")}


def _source(log: logs.Log) -> dict[str, pa.Array | Ints]:
    return {"file": pa.repeat(log.file, len(log.line)), "line": log.line}


def _rejected(rejected: Sequence[Rejection]) -> pa.Table:
    ordered = sorted(dict.fromkeys(rejected), key=lambda r: (r[0], r[1] or 0, r[2]))
    if not ordered:
        return tables.REJECTED.empty_table()
    columns = dict(zip(tables.REJECTED.names, zip(*ordered, strict=True), strict=True))
    return pa.table({name: list(column) for name, column in columns.items()}, tables.REJECTED)


def _nothing_left(rejected: Sequence[Rejection]) -> InputError:
    """The error when no pull is complete, with the reason whose way out is given most often."""
    if not rejected:
        return InputError("no pull is left", "export all of them, or take names out of [set_aside]")
    ways_out = Counter(why.rpartition("; ")[2] for _, _, why in rejected)
    most, times = ways_out.most_common(1)[0]
    where, line, why = next(r for r in rejected if r[2].endswith(most))
    thing = why.rpartition("; ")[0]
    return InputError(
        f"nothing usable is left, because {times} rows are like this one: {thing}",
        most,
        file=where,
        line=line,
    )


# --- already reduced ------------------------------------------------------------------------------


def _reduced(
    settings: Settings,
    stated: Displacements,
    robot: Robot,
    raw: Mapping[str, bytes],
    joints: logs.Log,
    doubt: InputError | None,
    left_out: Mapping[int, str],
) -> _Ingested:
    moved = logs.displacements(stated.file, _file(raw, stated.file, "[displacements]"))
    forces = logs.forces(stated.forces, _file(raw, stated.forces, "[displacements]"))
    moved = moved.only(
        np.isin(moved.word["target"], settings.measured),
        f"this target is none of {listed(settings.measured)}; add it to [tool] or rename it",
    )
    if own := pose_names.numbers(np.concatenate([_poses(one) for one in (moved, forces, joints)])):
        moved, forces, joints = (_with_own_numbers(one, own) for one in (moved, forces, joints))
        joints, left_out = _stood_again(joints, left_out, own)
    moved, forces = _leaving(moved, left_out), _leaving(forces, left_out)
    poses = joints.number["pose"]
    causes = [*moved.rejected, *forces.rejected, *joints.rejected]
    moved, forces = (
        log.only(
            np.isin(log.number["pose"], poses),
            f"this pose has no row in {joints.file}; add its joint values",
        )
        for log in (moved, forces)
    )
    pulled, pulling = _keys(moved), _keys(forces)
    moved = moved.only(
        np.isin(pulled, pulling), f"this pull has no force in {forces.file}; add the row"
    )
    forces = forces.only(
        np.isin(pulling, pulled),
        f"this pull has no displacement in {moved.file}; add it or remove the row",
    )
    used = np.isin(poses, moved.number["pose"])
    joints = joints.only(used, "no displacement has this pose; add it or remove the row")
    if not len(moved.line):
        raise _nothing_left(causes or moved.rejected)
    return _Ingested(
        joints=_joints(joints, robot),
        rejected=_rejected([*moved.rejected, *forces.rejected, *joints.rejected]),
        displacements=_displacements(moved, stated.sigma_m),
        forces=_forces(forces),
        doubt=doubt,
    )


def _keys(log: logs.Log) -> Ints:
    return pull_number(*(values.astype(np.int64) for values in _pulls_of(log).values()))


def _displacements(moved: logs.Log, sigma_m: float | None) -> pa.Table:
    """Table DISPLACEMENTS, the covariance as that of the loaded reading, NaN if not stated."""
    loaded = np.nan if sigma_m is None else sigma_m**2
    columns = {
        **_pulls_of(moved),
        "target": moved.word["target"],
        **{f"{axis}_m": moved.number[axis] for axis in ("dx", "dy", "dz")},
        **{f"loaded_{n}": loaded * c for n, c in zip(_SIX, instrument.ISOTROPIC, strict=True)},
        **{f"zero_{axis}_m": np.nan for axis in "xyz"},
    }
    return _conform(columns, tables.DISPLACEMENTS)


def _forces(forces: logs.Log) -> pa.Table:
    axes = {f"{axis}_n": forces.number[axis] for axis in ("fx", "fy", "fz")}
    at_load_point = {f"at_{axis}_m": np.nan for axis in "xyz"} | {"body": PULL}
    return _conform({**_pulls_of(forces), **axes, **at_load_point}, tables.FORCES)


def _conform(columns: Mapping[str, Any], promise: pa.Schema) -> pa.Table:
    """Columns as the schema promises; those not given are zero."""
    return tables.conform(pd.DataFrame({**dict.fromkeys(promise.names, 0), **columns}), promise)
