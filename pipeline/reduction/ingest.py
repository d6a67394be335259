"""Stage 1. Raw files in, readings, loads and joint values out; whatever is wrong is named.

A file that cannot be trusted as a whole stops the campaign. A row whose loss leaves the rest valid
is left out and listed with its reason.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline import readers, tables
from pipeline.base.arrays import Array, Bools, Ints
from pipeline.base.covariance import columns as covariance_columns
from pipeline.base.errors import InputError, listed
from pipeline.base.threads import MUCH, both
from pipeline.machine import instrument
from pipeline.machine.instrument import InstrumentNoise
from pipeline.machine.robot import Robot
from pipeline.readers import Columns, Export, Hints, logs
from pipeline.readers.assignment import assigned
from pipeline.reduction import _pulls, _shots
from pipeline.reduction._index import numbered
from pipeline.reduction._shots import Rejection, Shots
from pipeline.reduction.settings import BASE_REFLECTORS, Scale, Settings, Tracker

_SIX = covariance_columns()


@dataclass(frozen=True)
class Ingested:
    """What a raw campaign holds, as tables that keep their promise.

    Attributes:
        readings: Table READINGS; empty for a campaign that arrives reduced.
        loads: Table LOADS; empty for a campaign that arrives reduced.
        joints: Table `tables.joints(robot)`.
        rejected: Table REJECTED.
        displacements: Table DISPLACEMENTS of a campaign that arrives reduced, else None.
        forces: Table FORCES of a campaign that arrives reduced, else None.
        dialects: Dialect recognised in each tracker export.
        doubt: Why the values are implausible, where that was not to stop the reading.
    """

    readings: pa.Table
    loads: pa.Table
    joints: pa.Table
    rejected: pa.Table
    displacements: pa.Table | None
    forces: pa.Table | None
    dialects: dict[str, str]
    doubt: InputError | None = None


def ingest(
    settings: Settings, robot: Robot, raw: Mapping[str, bytes], plausible: bool = True
) -> Ingested:
    """Read a campaign.

    Args:
        settings: campaign.toml.
        robot: The robot, for the columns and limits of the joint log.
        raw: Content of the raw files by name relative to the campaign folder.
        plausible: Refuse values that only a wrong unit or convention explains; False lets them
            through to whoever can say which one it is.

    Raises:
        InputError: A file is missing or cannot be trusted, or nothing usable is left.
    """
    if settings.test_pose is not None:
        settings.test_pose.within_limits(robot)
    log = settings.joints.file
    joints, q = logs.joints(log, _file(raw, log, "[joints]"), robot)
    doubt = _doubt(lambda: logs.within_limits(joints, q, robot), plausible)
    if settings.tracker and settings.scale:
        return _raw(
            settings, settings.tracker, settings.scale, robot, raw, joints, q, plausible, doubt
        )
    return _reduced(settings, robot, raw, joints, q, doubt)


def _doubt(check: Callable[[], None], plausible: bool) -> InputError | None:
    """What a check complains about; raised when only plausible values may pass."""
    try:
        check()
    except InputError as problem:
        if plausible:
            raise
        return problem
    return None


def _file(raw: Mapping[str, bytes], name: str, said: str) -> bytes:
    if name not in raw:
        raise InputError(
            "the file is missing",
            f"put it into the campaign folder or correct {said} of campaign.toml",
            file=name,
        )
    return raw[name]


# --- from readings --------------------------------------------------------------------------------


def _raw(
    settings: Settings,
    tracker: Tracker,
    scale: Scale,
    robot: Robot,
    raw: Mapping[str, bytes],
    joints: logs.Log,
    q: Array,
    plausible: bool,
    doubt: InputError | None,
) -> Ingested:
    log = _file(raw, scale.file, "[scale]")
    loads, exports = both(
        lambda: logs.loads(scale.file, log),
        lambda: _exports(settings, tracker, raw),
        much=len(log) > MUCH,
    )
    _some_reading(exports)
    shots, strange = _shots.known(_shots.gather(exports, settings), settings)
    doubt = _doubt(lambda: _shots.check_units(shots, settings), plausible) or doubt
    shots, copies = _shots.once(shots, len(settings.measured) + 2)
    shots, bare = _shots.weighed(shots, tracker.noise is not None or tracker.sigma_m is not None)
    _three_base_reflectors(shots, settings)
    _some_pull(shots, settings)
    unread = [(file, n, why) for file, e in exports.items() for n, why in e.rejected]
    causes: list[Rejection] = [*unread, *strange, *copies, *bare, *loads.rejected, *joints.rejected]
    complete = _pulls.complete(shots, settings, loads, joints)
    shots, loads = shots.only(complete.shots), loads.only(complete.loads, complete.why_not_load)
    seen = np.bincount(shots.slot + 1, minlength=len(shots.pose) + 1)[1:] > 0
    used = np.isin(joints.number["pose"], numbered(shots.pose[seen])[0])
    reason = "no usable reading has this pose; measure it or remove the row"
    q, joints = q[used], joints.only(used, reason)
    if not len(loads.line):
        raise _nothing_left(causes or complete.rejected)
    rejected = [*causes, *complete.rejected, *loads.rejected, *joints.rejected]
    return Ingested(
        readings=_readings(shots, tracker),
        loads=_loads(loads),
        joints=_joints(joints, q, robot),
        rejected=_rejected(rejected),
        displacements=None,
        forces=None,
        dialects={name: export.dialect for name, export in exports.items()},
        doubt=doubt,
    )


def _tracker_files(settings: Settings, names: Sequence[str]) -> list[str]:
    """Which of some file names are tracker exports, sorted; a glob never takes the other logs."""
    others = {settings.joints.file, "campaign.toml"}
    others |= {settings.scale.file} if settings.scale else set()
    others |= {settings.tracker.assignment or ""} if settings.tracker else set()
    patterns = settings.tracker.files if settings.tracker else []
    return sorted(
        name
        for name in names
        if name in patterns or (name not in others and any(fnmatchcase(name, p) for p in patterns))
    )


def _exports(settings: Settings, tracker: Tracker, raw: Mapping[str, bytes]) -> dict[str, Export]:
    found = _tracker_files(settings, list(raw))
    tracker.none_missing(found)
    said = hints(tracker)
    exports = {name: readers.read(name, raw[name], said) for name in found}
    if tracker.assignment:
        table = _file(raw, tracker.assignment, "assignment in [tracker]")
        return assigned(exports, tracker.assignment, table)
    for name, export in exports.items():
        if export.group is None:
            raise InputError(
                f"the readings have no {'names' if export.target is None else 'groups'}",
                "say what each row is in a table order,group,target, and name the table with "
                'assignment = "assignment.csv" in [tracker] of campaign.toml',
                file=name,
            )
    return exports


def hints(tracker: Tracker) -> Hints:
    """What [tracker] adds to exports that do not say it themselves."""
    said = tracker.model_dump(exclude={"files", "assignment", "mapping", "sigma_m", "noise"})
    mapping = tracker.mapping
    return Hints(**said, mapping=Columns(**mapping.model_dump()) if mapping else None)


def _some_reading(exports: Mapping[str, Export]) -> None:
    if not any(len(export.line) for export in exports.values()):
        unread = [(file, n, why) for file, e in exports.items() for n, why in e.rejected]
        if unread:
            raise _nothing_left(unread)
        raise InputError(
            "there is no reading in it, nothing but a header",
            "export the readings, or correct files in [tracker]",
            file=next(iter(exports)),
        )


def _three_base_reflectors(shots: Shots, settings: Settings) -> None:
    if not settings.base_frame:
        return
    names = shots.target.dictionary.to_pylist()
    present = np.unique(np.asarray(shots.target.indices)[shots.role == _shots.BASE])
    seen = sorted(names[k] for k in present)
    if len(seen) < BASE_REFLECTORS:
        raise InputError(
            f"only {len(seen)} base reflectors of [base_frame] were read ({listed(seen)}), "
            "too few to find the base frame",
            f"measure at least {BASE_REFLECTORS}, or remove [base_frame] "
            "if readings are in F_b already",
            file=shots.files[0],
        )


def _some_pull(shots: Shots, settings: Settings) -> None:
    if not shots.loaded.any():
        raise InputError(
            f'no group of the export is a loaded state by naming.group = "{settings.naming.group}"',
            "correct naming.group in campaign.toml",
            file=shots.files[0],
        )


def _readings(shots: Shots, tracker: Tracker) -> pa.Table:
    covariance, source = _covariance(shots, tracker)
    slot = pa.array(shots.slot, mask=shots.slot < 0)
    pose, repeat, loaded = (
        _int32(of_slot).take(slot) for of_slot in (shots.pose, shots.repeat, shots.loaded)
    )
    columns = {
        "file": _files(shots),
        "line": pa.array(shots.line),
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


def _files(shots: Shots) -> pa.DictionaryArray:
    return pa.DictionaryArray.from_arrays(shots.file.astype(np.int32), list(shots.files))


def _column(values: Array) -> pa.Array:
    return pa.array(np.ascontiguousarray(values))


def _covariance(shots: Shots, tracker: Tracker) -> tuple[list[Array], pa.DictionaryArray]:
    """Covariance of every reading, six columns, and where each is from."""
    stated, source = _stated_covariance(shots, tracker)
    if shots.covariance is None:
        return stated, _alternatives(np.zeros(len(shots), bool), [source])
    own: Bools = np.asarray(np.isfinite(shots.covariance).all(axis=1))
    columns = [np.where(own, shots.covariance[:, k], stated[k]) for k in range(6)]
    return columns, _alternatives(own, [source, "file"])


def _alternatives(which: Bools, words: Sequence[str]) -> pa.DictionaryArray:
    """The second of two words where `which`, else the first."""
    return pa.DictionaryArray.from_arrays(which.astype(np.int32), list(words))


def _stated_covariance(shots: Shots, tracker: Tracker) -> tuple[list[Array], str]:
    noise, n = tracker.noise, len(shots)
    if isinstance(noise, InstrumentNoise):
        return list(instrument.beam_covariance(shots.position, noise).T), "instrument"
    if noise == "paper":
        return _alike(instrument.PAPER_SIGMA_M**2 * instrument.PAPER_SHARE, n), "paper"
    if tracker.sigma_m is not None:
        return _alike(tracker.sigma_m**2 * instrument.ISOTROPIC, n), "stated"
    return [np.full(n, np.nan)] * 6, "none"


def _alike(six: Array, n: int) -> list[Array]:
    """The same six numbers n times; equal columns are one array, which a million rows notice."""
    columns = {value: np.full(n, value) for value in set(six.tolist())}
    return [columns[value] for value in six.tolist()]


def _loads(loads: logs.Log) -> pa.Table:
    none = pa.nulls(len(loads.line), pa.string())
    branch = pa.array(loads.word.get("branch", none), pa.string())
    columns = {
        "pose": _int32(loads.number["pose"]),
        "repeat": _int32(loads.number["repeat"]),
        "force_n": pa.array(loads.number["force"]),
        "branch": pc.if_else(pc.equal(branch, ""), None, branch).dictionary_encode(),
        **_source(loads),
    }
    return tables.conform(pa.table(columns), tables.LOADS)


def _joints(joints: logs.Log, q: Array, robot: Robot) -> pa.Table:
    approach = joints.number.get("approach", np.zeros(len(q)))
    columns = {
        "pose": _int32(joints.number["pose"]),
        **{
            tables.joint_column(joint.name, joint.prismatic): pa.array(
                np.ascontiguousarray(q[:, j])
            )
            for j, joint in enumerate(robot.joints)
        },
        "approach": _int32(np.nan_to_num(approach)),
        **_source(joints),
    }
    return tables.conform(pa.table(columns), tables.joints(robot))


def _source(log: logs.Log) -> dict[str, pa.Array]:
    return {"file": pa.repeat(log.file, len(log.line)), "line": pa.array(log.line)}


def _int32(values: Array | Ints | Bools) -> pa.Array:
    return pa.array(values.astype(np.int32))


def _rejected(rejected: Sequence[Rejection]) -> pa.Table:
    ordered = sorted(dict.fromkeys(rejected), key=lambda r: (r[0], r[1] or 0, r[2]))
    file, line, reason = zip(*ordered, strict=True) if ordered else ((), (), ())
    columns = {
        "file": pa.array(file, pa.string()),
        "line": pa.array(line, pa.int64()),
        "reason": pa.array(reason, pa.string()),
    }
    return tables.conform(pa.table(columns), tables.REJECTED)


def _nothing_left(rejected: Sequence[Rejection]) -> InputError:
    """No pull is complete: say it with the reason whose way out is given most often."""
    ways_out = [why.rpartition("; ")[2] for _, _, why in rejected]
    most = max(ways_out, key=ways_out.count)
    where, line, why = next(r for r in rejected if r[2].endswith(most))
    thing = why.rpartition("; ")[0]
    return InputError(
        f"nothing usable is left, because {ways_out.count(most)} rows are like this one: {thing}",
        most,
        file=where,
        line=line,
    )


# --- already reduced ------------------------------------------------------------------------------


def _reduced(
    settings: Settings,
    robot: Robot,
    raw: Mapping[str, bytes],
    joints: logs.Log,
    q: Array,
    doubt: InputError | None,
) -> Ingested:
    said = settings.displacements
    assert said
    moved = logs.displacements(said.file, _file(raw, said.file, "[displacements]"))
    forces = logs.forces(said.forces, _file(raw, said.forces, "[displacements]"))
    moved = moved.only(
        np.isin(moved.word["target"], settings.measured),
        f"this target is none of {listed(settings.measured)}; add it to [tool] or rename it",
    )
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
        np.array([pull in set(pulling) for pull in pulled], dtype=bool),
        f"this pull has no force in {forces.file}; add the row",
    )
    forces = forces.only(
        np.array([pull in set(pulled) for pull in pulling], dtype=bool),
        f"this pull has no displacement in {moved.file}; add it or remove the row",
    )
    used = np.isin(poses, moved.number["pose"])
    q, joints = (
        q[used],
        joints.only(used, "no displacement has this pose; add it or remove the row"),
    )
    if not len(moved.line):
        raise _nothing_left(causes or moved.rejected)
    rejected = [*moved.rejected, *forces.rejected, *joints.rejected]
    return Ingested(
        readings=tables.READINGS.empty_table(),
        loads=tables.LOADS.empty_table(),
        joints=_joints(joints, q, robot),
        rejected=_rejected(rejected),
        displacements=_displacements(moved, said.sigma_m),
        forces=_forces(forces),
        dialects={},
        doubt=doubt,
    )


def _keys(log: logs.Log) -> list[tuple[float, float]]:
    return list(zip(log.number["pose"].tolist(), log.number["repeat"].tolist(), strict=True))


def _displacements(moved: logs.Log, sigma_m: float | None) -> pa.Table:
    """Covariance of a displacement as that of its loaded reading, NaN where none is stated."""
    n = len(moved.line)
    loaded = np.nan if sigma_m is None else sigma_m**2
    columns = {
        "pose": _int32(moved.number["pose"]),
        "repeat": _int32(moved.number["repeat"]),
        "target": pa.array(moved.word["target"].tolist(), pa.string()),
        **{f"{axis}_m": pa.array(moved.number[axis]) for axis in ("dx", "dy", "dz")},
        **{
            f"loaded_{name}": pa.array(np.full(n, loaded * c))
            for name, c in zip(_SIX, instrument.ISOTROPIC, strict=True)
        },
        **{f"zero_{name}": pa.array(np.zeros(n)) for name in _SIX},
        **{f"zero_{axis}_m": pa.array(np.full(n, np.nan)) for axis in "xyz"},
        "zero_count": _int32(np.zeros(n)),
        "zero_time_s": pa.array(np.zeros(n)),
    }
    return tables.conform(pa.table(columns), tables.DISPLACEMENTS)


def _forces(forces: logs.Log) -> pa.Table:
    n = len(forces.line)
    nothing = [
        name for name in tables.FORCES.names if name.startswith("u") or name == "reading_std_n"
    ]
    columns = {
        "pose": _int32(forces.number["pose"]),
        "repeat": _int32(forces.number["repeat"]),
        **{f"{axis}_n": pa.array(forces.number[axis]) for axis in ("fx", "fy", "fz")},
        **{name: pa.array(np.zeros(n)) for name in [*nothing, "time_s"]},
        "branch": _int32(np.zeros(n)),
    }
    return tables.conform(pa.table(columns), tables.FORCES)
