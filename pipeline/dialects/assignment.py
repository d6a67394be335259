"""Assign names to readings without names, by a table that lists them in the order they were taken.

Its columns are `order,group,target`, or `order,pose,repeat,state,target` with pose, repeat and
state empty for base reflectors. Orders count the rows of an export from 1, including bad ones; if
several exports have no names, a column `file` says which one is meant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pyarrow as pa

from pipeline.base.errors import InputError, at
from pipeline.readers._reader import Export
from pipeline.readers.logs import Log, Quantity, columns, once, table

_BASE = "base"
_Names = dict[int, tuple[str, str]]


def assigned(exports: Mapping[str, Export], name: str, data: bytes) -> dict[str, Export]:
    """The exports with groups and targets for every reading.

    Args:
        exports: Exports by file name; those that contain names are unchanged.
        name: File name of the assignment.
        data: Its content.

    Raises:
        InputError: A reading has no assignment, or one that contradicts its own name.
    """
    nameless = [file for file, export in exports.items() if export.group is None]
    with at(name):
        names = _names(name, data, nameless)
        return {
            file: _assigned(export, names.get(file, {}), name) if export.group is None else export
            for file, export in exports.items()
        }


def _names(name: str, data: bytes, files: list[str]) -> dict[str, _Names]:
    words = [Quantity(w, {}, "name", needed=False) for w in ("file", "group", "state")]
    numbers = [Quantity(n, {}, needed=False) for n in ("pose", "repeat")]
    wanted = [Quantity("order", {}), Quantity("target", {}, "name"), *words, *numbers]
    log = once(table(name, data, wanted), ["order", *({"file"} & {*columns(name, data)})])
    if log.rejected:
        file, line, reason = log.rejected[0]
        thing, _, way_out = reason.rpartition("; ")
        raise InputError(thing, way_out, file=file, line=line)
    if len(files) > 1 and "file" not in log.word:
        raise InputError(
            f"{len(files)} exports have no names, but the assignment has no column file",
            "add the column with the name of the export",
            line=1,
        )
    out: dict[str, _Names] = {}
    groups = _groups(log)
    for k, order in enumerate(log.number["order"]):
        file = str(log.word["file"][k]) if "file" in log.word else (files or [""])[0]
        out.setdefault(file, {})[int(order)] = (groups[k], str(log.word["target"][k]))
    return out


def _groups(log: Log) -> list[str]:
    """Group of each row, as stated or formed from pose, repeat and state."""
    if "group" in log.word:
        return [str(group) for group in log.word["group"]]
    if not {"pose", "repeat"} <= set(log.number) or "state" not in log.word:
        raise InputError(
            "there is neither a column group nor the columns pose, repeat and state",
            "add the one or the others",
            line=1,
        )
    columns = log.number["pose"], log.number["repeat"], log.word["state"]
    groups = [_group(*row) for row in zip(*columns, strict=True)]
    if None in groups:
        raise InputError(
            "pose, repeat and state are not all given, or state is neither loaded nor unloaded",
            "fill in all three, or leave all three empty for a base reflector",
            line=int(log.line[groups.index(None)]),
        )
    return [str(group) for group in groups]


def _group(pose: float, repeat: float, state: str) -> str | None:
    """Group name of a state, or of base reflectors; None if a part is missing."""
    given = np.isfinite([pose, repeat])
    if state in ("loaded", "unloaded") and given.all():
        return f"pose{int(pose):02d}_rep{int(repeat)}_{state}"
    return None if state or given.any() else _BASE


def _assigned(export: Export, names: _Names, name: str) -> Export:
    if export.rows != len(names):
        raise InputError(
            f"the export has {export.rows} rows but {name} assigns {len(names)}, "
            "so that the rows cannot be matched",
            f"make {name} say what every row of the export is",
            file=export.file,
        )
    missing = [int(order) for order in export.order if int(order) not in names]
    if missing:
        raise InputError(
            f"{name} does not say what row {missing[0]} of {export.file} is",
            "number its rows from 1 on without a gap",
        )
    found = [names[int(order)] for order in export.order]
    group, target = (
        pa.array([pair[k] for pair in found], pa.string()).dictionary_encode() for k in (0, 1)
    )
    own = target if export.target is None else export.target
    columns = own.to_pylist(), target.to_pylist(), export.line.tolist()
    for mine, theirs, line in zip(*columns, strict=True):
        if mine != theirs:
            raise InputError(
                f"the export calls this reading {mine}, {name} calls it {theirs}",
                "correct the assignment",
                file=export.file,
                line=line,
            )
    return replace(export, group=group, target=target)
