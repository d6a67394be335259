"""Chains without reflectors: each goes straight from the load point to the anchor that a log names.

In a loaded state the load point h follows from the reflectors of the effector,

    h = R p + t,  R, t = argmin sum |y_k - R n_k - t|^2,

with n_k their nominal places and p the load point in the flange frame, y_k the readings [m]. The
anchor a is at its place in F_b, seen through the base reflectors of the last round before; one
without a stated place is where it was read. The ends of the chain are then h and h + L (a - h) /
|a - h|, with L the median of |a - h| over all pulls: its direction is all that matters, and chains
to different anchors are not of one length.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools
from pipeline.base.errors import InputError, listed
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M

if TYPE_CHECKING:
    from pipeline.readers.logs import Log

_LEAST = 3
"""Minimum number of reflectors that place a body [1]."""
_SIGMA_M = 3e-5
"""Standard uncertainty of an end where neither tool nor load point states one [m]."""


def with_ends(shots: Any, loads: Log, settings: Any) -> Any:
    """Readings with both ends of each chain whose row in the log names an anchor.

    Readings of the anchors themselves are dropped.

    Args:
        shots: Readings of all files (`RawReadings`).
        loads: Log of the loads, with the column `anchor`.
        settings: campaign.toml.

    Raises:
        InputError: An anchor has neither a place nor a reading.
    """
    names = _names(shots.target)
    order = (
        np.arange(len(names)) if shots.time.null_count else shots.time.cast(pa.int64()).to_numpy()
    )
    rounds = _rounds(shots, names, order, settings.base_frame)
    at = _anchors(shots, names, order, rounds, loads, settings.anchors)
    found = []
    for slot, row in _hooked(shots, loads):
        here = np.flatnonzero(shots.slot == slot)
        if (near := _load_point(shots, names, here, settings)) is not None:
            R, t = _last(rounds, order[here].min())
            found.append((slot, row, here[-1], near, R @ at[loads.word["anchor"][row]] + t))
    length = float(np.median([float(np.linalg.norm(far - near)) for *_, near, far in found] or 1.0))
    ends = [
        (slot, row, last, near + k * length * (far - near) / np.linalg.norm(far - near), k)
        for slot, row, last, near, far in found
        for k in (0, 1)
    ]
    return _added(shots, ~np.isin(names, [*at]), ends, loads, settings) if ends else shots


def _hooked(shots: Any, loads: Log) -> Iterator[tuple[int, int]]:
    """Each loaded slot whose row in the log names an anchor, and the row."""
    keys = zip(loads.number["pose"], loads.number["repeat"], strict=True)
    rows = {(int(pose), int(repeat)): k for k, (pose, repeat) in enumerate(keys)}
    for slot in np.flatnonzero(shots.loaded).tolist():
        row = rows.get((int(shots.pose[slot]), int(shots.repeat[slot])))
        if row is not None and loads.word["anchor"][row]:
            yield slot, row


def _load_point(shots: Any, names: Any, here: Any, settings: Any) -> Array | None:
    """The load point by the effector's reflectors among some readings; None if these are few.

    Where names of reflectors are exchanged, it is where it is with their own: the exchange is found
    later, and corrects names alone.
    """
    seen = [k for k in here.tolist() if names[k] in settings.measured]
    if len({names[k] for k in seen}) < _LEAST:
        return None
    at, given = shots.position[seen], names[seen].tolist()
    nominal = [np.array([settings.tool[one] for one in each])
               for each in (given, _by_place(shots, names, here, at, given))]  # fmt: skip
    (R, t), _ = min((_placed(each, at) for each in nominal), key=lambda one: one[1])
    return np.asarray(R @ np.array(settings.tool["load_point"]) + t)


def _by_place(shots: Any, names: Any, here: Any, at: Array, given: list[str]) -> list[str]:
    """Names of readings by the other states of their pose, where those have others close by."""
    pose = shots.pose[np.maximum(shots.slot, 0)] == shots.pose[shots.slot[here[0]]]
    rest = pose & (shots.slot >= 0) & (shots.slot != shots.slot[here[0]])
    known = [one for one in dict.fromkeys(given) if (rest & (names == one)).any()]
    if not known:
        return given
    centre = [np.median(shots.position[rest & (names == one)], axis=0) for one in known]
    away = np.linalg.norm(at[:, None] - np.array(centre), axis=2)
    there = [known[k] for k in away.argmin(axis=1)]
    close = away.min(axis=1) < GROSS_DISTANCE_M
    return [new if near else old for new, old, near in zip(there, given, close, strict=True)]


def _placed(nominal: Array, at: Array) -> tuple[tuple[Array, Array], float]:
    """R, t of a body by its points, and the largest distance that is left [m]."""
    R, t = linear.rigid(nominal, at)
    return (R, t), float(np.linalg.norm(at - nominal @ R.T - t, axis=1).max())


def _names(column: pa.DictionaryArray) -> Any:
    return np.array(column.dictionary.to_pylist() or [""], object)[np.asarray(column.indices)]


def _rounds(
    shots: Any, names: Any, order: Any, base: Mapping[str, Any]
) -> list[tuple[float, Array, Array]]:
    """When each round of base reflectors began, and R, t from F_b to the instrument's frame."""
    group, found = np.asarray(shots.group.indices), []
    fixed = np.isin(names, [*base])
    for one in dict.fromkeys(group[fixed].tolist()):
        rows = np.flatnonzero(fixed & (group == one))
        nominal = np.array([base[names[k]] for k in rows])
        if len({*names[rows]}) >= _LEAST:
            found.append((float(order[rows].min()), *linear.rigid(nominal, shots.position[rows])))
    return sorted(found, key=lambda one: one[0]) or [(0.0, np.eye(3), np.zeros(3))]


def _last(rounds: list[tuple[float, Array, Array]], moment: float) -> tuple[Array, Array]:
    """That of the last round before a moment, else of the first."""
    return next((one[1:] for one in reversed(rounds) if one[0] <= moment), rounds[0][1:])


def _anchors(
    shots: Any,
    names: Any,
    order: Any,
    rounds: list[tuple[float, Array, Array]],
    loads: Log,
    stated: Mapping[str, Any],
) -> dict[str, Array]:
    """Places of the anchors in F_b [m].

    Raises:
        InputError: One has neither a place nor a reading.
    """
    found: dict[str, Array] = {}
    for row, name in enumerate(loads.word["anchor"].tolist()):
        if not name or name in found:
            continue
        read = np.flatnonzero(names == name).tolist()
        if name not in stated and not read:
            raise InputError(
                f'the anchor "{name}" has no place',
                f'write it into [anchors] of campaign.toml as "{name}" = [x, y, z] in F_b [m]'
                + (f", where there is {listed([*stated])}" if stated else ""),
                file=loads.file,
                line=int(loads.line[row]),
            )
        seen = [(_last(rounds, order[k]), shots.position[k]) for k in read]
        places = [R.T @ (y - t) for (R, t), y in seen]
        found[name] = np.array(stated[name]) if name in stated else np.mean(places, axis=0)
    return found


def _added(shots: Any, kept: Bools, ends: list[tuple[Any, ...]], loads: Log, settings: Any) -> Any:
    """The readings that are kept, and the ends of the chains, each in the line of its row."""
    left = shots.kept(kept)
    slot, row, last, at, end = zip(*ends, strict=True)
    names = pa.array([settings.naming.chain[k] for k in end])
    group = shots.group.take(pa.array(last)).cast(pa.string())
    stated = settings.tool_uncertainty
    sigma = stated.sigma_m if stated.load_point_sigma_m is None else stated.load_point_sigma_m
    six = np.tile(max(sigma, _SIGMA_M) ** 2 * np.array([1.0, 0, 0, 1.0, 0, 1.0]), (len(ends), 1))
    files = tuple(dict.fromkeys((*left.files, loads.file)))  # one workbook may hold both
    return replace(
        left,
        files=files,
        file=np.r_[left.file, np.full(len(ends), files.index(loads.file))],
        line=np.r_[left.line, loads.line[list(row)]],
        group=_joined(left.group, group),
        target=_joined(left.target, names),
        position=np.vstack([left.position, at]),
        covariance=None if left.covariance is None else np.vstack([left.covariance, six]),
        time=pa.chunked_array([left.time, shots.time.take(pa.array(last))]).combine_chunks(),
        role=np.r_[left.role, len(settings.measured) + np.array(end)],
        slot=np.r_[left.slot, slot],
    )


def _joined(names: pa.DictionaryArray, more: pa.Array) -> pa.DictionaryArray:
    own = more.dictionary_encode().cast(names.type)
    return pa.chunked_array([names, own]).unify_dictionaries().combine_chunks()
