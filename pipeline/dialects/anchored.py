"""Chains without reflectors: each goes straight from the load point to the anchor that a log names.

In a loaded state the load point h follows from the reflectors of the effector,

    h = R p + t,  R, t = argmin sum |y_k - R n_k - t|^2,

with n_k their nominal places and p the load point in the flange frame, y_k the readings [m]. The
anchor a is at its place in F_b, seen through the base reflectors of the last round before; one
without a stated place is where it was read. The ends of the chain are then h and h + L (a - h) /
|a - h|, with L the median of |a - h| over all pulls: its direction is all that matters, and chains
to different anchors are not of one length. Once a mistake is corrected they are computed again.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.errors import InputError, listed
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M

if TYPE_CHECKING:
    from pipeline.readers.logs import Log

_Pull = tuple[int, int]
"""Pose and repeat."""

_Round = tuple[float, Array, Array]

_XYZ = ["x_m", "y_m", "z_m"]

_LEAST = 3
"""Minimum number of reflectors that place a body [1]."""
_SIGMA_M = 3e-5
"""Standard uncertainty of an end where neither tool nor load point states one [m]."""


@dataclass(frozen=True, eq=False)
class _Shots(Locked):
    """Readings as arrays, the chains' ends not among them.

    Attributes:
        names: Target of each, shape (n,).
        position: [m], shape (n, 3).
        order: In the course of the campaign, shape (n,).
        group: Number of its group, shape (n,).
        slot: Index into `state`, -1 for base readings, shape (n,).
        state: Pose, repeat and whether it is loaded of each slot, shape (s, 3).
    """

    names: Any
    position: Array
    order: Any
    group: Ints
    slot: Ints
    state: Ints

    @classmethod
    def of(cls, shots: Any) -> _Shots:
        """Those of a `RawReadings`."""
        names = np.array(shots.target.dictionary.to_pylist() or [""], object)
        rows = np.arange(len(shots.line))
        return cls(
            names[np.asarray(shots.target.indices)],
            shots.position,
            rows if shots.time.null_count else shots.time.cast(pa.int64()).to_numpy(),
            np.asarray(shots.group.indices),
            shots.slot,
            np.column_stack([shots.pose, shots.repeat, shots.loaded]).astype(int),
        )

    @classmethod
    def of_case(cls, case: Any) -> _Shots:
        """Those of a `Case`."""
        rows = case.readings[~case.readings["target"].isin(case.settings.naming.chain)]
        state = rows[["pose", "repeat"]].assign(loaded=rows["state"] == "loaded")
        slot = state.groupby([*state], observed=True).ngroup().fillna(-1).to_numpy(int)
        known, first = np.unique(slot[slot >= 0], return_index=True)
        timed = rows["time"].notna().all()
        return cls(
            rows["target"].astype(str).to_numpy(object),
            rows[_XYZ].to_numpy(float),
            rows["time"].astype("int64").to_numpy() if timed else np.arange(len(rows)),
            pd.factorize(rows["group"])[0],
            slot,
            state[slot >= 0].iloc[first].astype(int).to_numpy().reshape(len(known), 3),
        )


def with_ends(
    shots: Any, loads: Log, settings: Any
) -> tuple[Any, dict[_Pull, str], dict[_Pull, Array]]:
    """Readings with both ends of each chain whose row in the log names an anchor.

    A chain of which an end was read is where it was read.
    Readings of the anchors themselves are dropped, except of reflectors of the base.

    Args:
        shots: Readings of all files (`RawReadings`).
        loads: Log of the loads, with the column `anchor`.
        settings: campaign.toml.

    Returns:
        The readings, and the anchor of each such pull: its name where its place is stated, in
            [anchors] or [base_frame], and where it is not, its place as read from the tracker's
            first station [m].

    Raises:
        InputError: An anchor has neither a place nor a reading.
    """
    seen = _Shots.of(shots)
    rounds = _rounds(seen, settings.base_frame)
    rows = _rows(seen, loads, settings.naming.chain)
    at = _anchors(seen, rounds, loads, [*rows.values()], settings.anchors)
    named = {key: str(loads.word["anchor"][row]) for key, row in rows.items()}
    anchors = {key: at[name] for key, name in named.items()}
    stated = {key: name for key, name in named.items() if name in _places(settings)}
    R, t = rounds[0][1:]
    read = {key: R @ place + t for key, place in anchors.items() if key not in stated}
    ends = [
        (slot, rows[key], last, end, k)
        for key, slot, last, both in _ends(seen, rounds, anchors, settings)
        for k, end in enumerate(both)
    ]
    kept = ~np.isin(seen.names, [*{*loads.word["anchor"].tolist()} - {"", *settings.base_frame}])
    left = _added(shots, kept, ends, loads, settings) if ends else shots.kept(kept)
    return left, stated, read


def _rows(shots: _Shots, loads: Log, chain: Collection[str]) -> dict[_Pull, int]:
    """Row of the log of each pull that names an anchor and of whose chain no end was read."""
    seen = shots.state[shots.slot[np.isin(shots.names, [*chain]) & (shots.slot >= 0)]]
    read = {(pose, repeat) for pose, repeat, loaded in seen.tolist() if loaded}
    keys = zip(loads.number["pose"], loads.number["repeat"], strict=True)
    rows = {(int(pose), int(repeat)): k for k, (pose, repeat) in enumerate(keys)}
    return {key: k for key, k in rows.items() if loads.word["anchor"][k] and key not in read}


def again(case: Any) -> Any:
    """A `Case` with the ends of its chains where its readings, as they are now, put them."""
    shots, chain = _Shots.of_case(case), case.settings.naming.chain
    rounds = _rounds(shots, case.settings.base_frame)
    R, t = rounds[0][1:]
    anchors = {key: R.T @ (at - t) for key, at in case.anchors_read.items()}
    places = _places(case.settings)  # a reflector that is wrong may be gone from the base
    anchors |= {key: np.array(places[name]) for key, name in case.anchors.items() if name in places}
    found = {key: both for key, *_, both in _ends(shots, rounds, anchors, case.settings)}
    rows = case.readings[case.readings["state"] == "loaded"]
    keys = zip(rows["pose"].astype(int), rows["repeat"].astype(int), strict=True)
    at = [found[key][chain.index(name)] if name in chain and key in found else own
          for key, name, own in zip(keys, rows["target"], rows[_XYZ].to_numpy(float), strict=True)
          ]  # fmt: skip
    readings = case.readings.copy()
    readings.loc[rows.index, _XYZ] = np.reshape(at, (-1, 3))
    return replace(case, readings=readings)


def _places(settings: Any) -> dict[str, Any]:
    """Stated places of anchors, and of reflectors of the base, which may be some, by name."""
    return {**settings.base_frame, **settings.anchors}


def _ends(
    shots: _Shots, rounds: list[_Round], anchors: Mapping[_Pull, Array], settings: Any
) -> list[tuple[_Pull, int, int, tuple[Array, Array]]]:
    """Pull, slot, last reading and both ends of its chain [m], of all with an anchor."""
    found = []
    for slot, (pose, repeat, loaded) in enumerate(shots.state.tolist()):
        here = np.flatnonzero(shots.slot == slot)
        if not loaded or not len(here) or (pose, repeat) not in anchors:
            continue
        if (near := _load_point(shots, here, settings)) is not None:
            R, t = _last(rounds, shots.order[here].min())
            far = R @ anchors[pose, repeat] + t
            found.append(((pose, repeat), slot, int(here[-1]), near, far))
    length = float(np.median([float(np.linalg.norm(far - near)) for *_, near, far in found] or 1.0))
    return [
        (key, slot, last, (near, near + length * (far - near) / np.linalg.norm(far - near)))
        for key, slot, last, near, far in found
    ]


def _load_point(shots: _Shots, here: Ints, settings: Any) -> Array | None:
    """The load point by the effector's reflectors among some readings; None if these are few.

    Where names of reflectors are exchanged, it is where it is with their own: the exchange is found
    later, and corrects names alone.
    """
    seen = [k for k in here.tolist() if shots.names[k] in settings.measured]
    at, given = shots.position[seen], shots.names[seen].tolist()
    if len({*given}) < _LEAST:
        return None
    nominal = [np.array([settings.tool[one] for one in each])
               for each in (given, _by_place(shots, here, at, given))]  # fmt: skip
    (R, t), _ = min((_placed(each, at) for each in nominal), key=lambda one: one[1])
    return np.asarray(R @ np.array(settings.tool["load_point"]) + t)


def _by_place(shots: _Shots, here: Ints, at: Array, given: list[str]) -> list[str]:
    """Names of readings by the other states of their pose, where those have others close by."""
    names, own = shots.names, shots.slot[here[0]]
    pose = shots.state[np.maximum(shots.slot, 0), 0] == shots.state[own, 0]
    rest = pose & (shots.slot >= 0) & (shots.slot != own)
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


def _rounds(shots: _Shots, base: Mapping[str, Any]) -> list[_Round]:
    """When each round of base reflectors began, and R, t from F_b to the instrument's frame."""
    found, fixed = [], np.isin(shots.names, [*base])
    for one in dict.fromkeys(shots.group[fixed].tolist()):
        rows = np.flatnonzero(fixed & (shots.group == one))
        nominal = np.array([base[name] for name in shots.names[rows]])
        if len({*shots.names[rows]}) >= _LEAST:
            began = float(shots.order[rows].min())
            found.append((began, *linear.rigid(nominal, shots.position[rows])))
    return sorted(found, key=lambda one: one[0]) or [(0.0, np.eye(3), np.zeros(3))]


def _last(rounds: list[_Round], moment: float) -> tuple[Array, Array]:
    """That of the last round before a moment, else of the first."""
    return next((one[1:] for one in reversed(rounds) if one[0] <= moment), rounds[0][1:])


def _anchors(
    shots: _Shots,
    rounds: list[_Round],
    loads: Log,
    rows: Iterable[int],
    stated: Mapping[str, Any],
) -> dict[str, Array]:
    """Places in F_b of the anchors that some rows of the log name [m].

    Raises:
        InputError: One has neither a place nor a reading.
    """
    found: dict[str, Array] = {}
    for row in rows:
        name = str(loads.word["anchor"][row])
        if name in found:
            continue
        read = np.flatnonzero(shots.names == name).tolist()
        if name not in stated and not read:
            raise InputError(
                f'the anchor "{name}" has no place',
                f'write it into [anchors] of campaign.toml as "{name}" = [x, y, z] in F_b [m]'
                + (f", where there is {listed([*stated])}" if stated else ""),
                file=loads.file,
                line=int(loads.line[row]),
            )
        seen = [(_last(rounds, shots.order[k]), shots.position[k]) for k in read]
        places = [R.T @ (y - t) for (R, t), y in seen]
        found[name] = np.array(stated[name]) if name in stated else np.mean(places, axis=0)
    return found


def _added(shots: Any, kept: Bools, ends: list[tuple[Any, ...]], loads: Log, settings: Any) -> Any:
    """The readings that are kept, and the ends of the chains, each in the line of its row.

    They stand behind the readings of their pull: without times, rows tell when a target was read.
    """
    left = shots.kept(kept)
    slot, row, last, at, end = zip(*ends, strict=True)
    names = pa.array([settings.naming.chain[k] for k in end])
    group = shots.group.take(pa.array(last)).cast(pa.string())
    stated = settings.tool_uncertainty
    sigma = stated.sigma_m if stated.load_point_sigma_m is None else stated.load_point_sigma_m
    six = np.tile(max(sigma, _SIGMA_M) ** 2 * np.array([1.0, 0, 0, 1.0, 0, 1.0]), (len(ends), 1))
    files = tuple(dict.fromkeys((*left.files, loads.file)))  # one workbook may hold both
    order = np.argsort(np.r_[np.flatnonzero(kept), np.array(last) + 0.5], kind="stable")
    rows, time = pa.array(order), [left.time, shots.time.take(pa.array(last))]
    return replace(
        left,
        files=files,
        file=np.r_[left.file, np.full(len(ends), files.index(loads.file))][order],
        line=np.r_[left.line, loads.line[list(row)]][order],
        group=_joined(left.group, group).take(rows),
        target=_joined(left.target, names).take(rows),
        position=np.vstack([left.position, at])[order],
        covariance=None if left.covariance is None else np.vstack([left.covariance, six])[order],
        time=pa.chunked_array(time).combine_chunks().take(rows),
        role=np.r_[left.role, len(settings.measured) + np.array(end)][order],
        slot=np.r_[left.slot, slot][order],
    )


def _joined(names: pa.DictionaryArray, more: pa.Array) -> pa.DictionaryArray:
    own = more.dictionary_encode().cast(names.type)
    return pa.chunked_array([names, own]).unify_dictionaries().combine_chunks()
