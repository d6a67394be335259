"""Readings without measured content: no deflection, or a copied force, pose or joint.

A robot deflects under a load; pulls of a pose with different displacements had different forces;
and poses with the same joint values cannot have their reflectors decimetres apart. These tests need
no estimate, and none of these mistakes can be corrected: what is missing was not measured.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline.base.arrays import Array, Bools, Ints
from pipeline.base.linear import rms
from pipeline.base.quantities import plain
from pipeline.faults.assignment import lines
from pipeline.faults.conventions import miss, unloaded
from pipeline.faults.exchanged_pulls import displacement_std, rows_of
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.joint_row import without_poses
from pipeline.faults.mistake import Mistake, as_it_is, length, lines_of, pulls_of, without_pulls
from pipeline.machine.cell import predict
from pipeline.machine.effect import PULLED
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M
from pipeline.reduction.case import Case
from pipeline.reduction.measured import STILL_M, Measured
from pipeline.reduction.register import XYZ
from pipeline.reduction.settings import Scale

_STIFF = 1 / 30
"""Minimum ratio of a robot's compliance to its typical one [1]: stiffnesses of a type differ by a
factor of a few, and if one joint is thirty times stiffer, not all of them are."""

_PART = 0.1
"""Fraction of its predicted displacement that a target moves by on the border between a robot of
several times the typical stiffness and none [1]."""

_BY_CHANCE = 4.0
"""Standard errors within which a displacement along the predicted one counts as none [1]."""

_FEWEST = 9
"""Minimum number of coordinates for a finding: three displacements."""

_COPIED = 3
"""Minimum number of equal values that count as copied."""

_UNLIKE = 1.3
"""Minimum ratio of displacements in a pose that friction cannot cause at equal forces [1]."""

_ALONG = 0.98
"""Minimum cosine between two pulls of a pose in the same direction [1]: their chain stays hung."""

_CLEAR = 20.0
"""Minimum displacement that is compared with another one, in standard uncertainties of the
tracker [1]."""


def dead(asked: Screening) -> list[Mistake]:
    """No deflection anywhere, else a force copied into unlike pulls, a copied pose or joint."""
    case, cell, data = asked.case, asked.case.cell, asked.reduced.data
    typical = np.array([p.typical for p in cell.parameters])
    moved = predict(cell, data.pulls, typical).displacement[data.pull, data.target]
    return _still(case, data, moved) or [
        *_copied(case, data),
        *_silent(case, data, moved),
        *_one_pose(case),
        *_one_column(case),
    ]


# --- the tracker ----------------------------------------------------------------------------------


def _still(case: Case, data: Measured, moved: Array) -> list[Mistake]:
    """Displacements that no possible stiffnesses relate to the loads.

    All of them, or runs of consecutive ones, of all targets or of one, as by `_dead_runs`.
    """
    if _unrelated(moved, data.delta):
        return [_of_still(case, data, moved, np.arange(len(moved)))]
    due, seen = np.sum(moved**2, axis=1), np.sum(moved * data.delta, axis=1)
    left, found = _as_read(case, data), list[Mistake]()
    for target in (None, *(() if data.poses else np.unique(data.target))):
        while True:
            mine = left if target is None else left[data.target[left] == target]
            runs = ((mine[part], least) for part, least in _dead_runs(due[mine], seen[mine]))
            still = (run for run, least in runs if _unrelated(moved[run], data.delta[run], least))
            if (run := next(still, None)) is None:
                break
            found.append(_of_still(case, data, moved, run))
            left = left[~np.isin(left, run)]
    return found


def _unrelated(moved: Array, delta: Array, least: float = _STIFF) -> bool:
    """Whether displacements (n, 3) cannot be those of a robot that should make `moved` [m].

    It would make the fraction `least` of them at least.
    """
    due, seen = (rms(one) if one.size else 0.0 for one in (moved, delta))
    if moved.size < _FEWEST or due < 100 * STILL_M or seen > 10 * _STIFF * due:
        return False
    part = float(np.sum(moved * delta)) / float(np.sum(moved**2))
    error = _BY_CHANCE * seen / due / np.sqrt(moved.size)
    return bool(seen <= STILL_M / 10 or (abs(part) <= error and part + error < least))


def _as_read(case: Case, data: Measured) -> Ints:
    """Displacements in the order in which their pulls were read, shape (d,)."""
    pulls = pd.MultiIndex.from_arrays([data.pulls.pose, data.pulls.repeat])
    rows = case.readings[case.readings["state"] == "loaded"]
    read = pd.MultiIndex.from_frame(rows[["pose", "repeat"]].drop_duplicates())
    place = read.get_indexer_for(pulls) if len(read) else np.arange(len(pulls))
    return np.argsort(place[data.pull], kind="stable")


def _dead_runs(due: Array, seen: Array) -> Iterator[tuple[slice, float]]:
    """Runs of displacements that may be zeros, and the fraction of m that none falls short of.

    m the displacement with typical stiffnesses and d the measured one: by least squares d = 0 in
    the run and b m beside it, hence that of greatest sum b m'm / 2 - m'd. First with b from the
    others, of which no part is ten times as stiff as the rest. Then with b / 2 a tenth: by the
    first sum, neighbours twice as stiff as the rest would belong to the run.

    Args:
        due: m'm [m^2], shape (d,).
        seen: m'd [m^2], shape (d,).
    """
    run = _greatest(_PART * due - seen)
    others = np.delete(np.arange(len(due)), run)
    follows = float(np.sum(seen[others]) / max(np.sum(due[others]), 1e-300))
    yield _greatest(max(follows / 2, _PART) * due - seen), max(_STIFF, _PART * follows)
    yield run, _STIFF


def _greatest(gain: Array) -> slice:
    """The consecutive terms of greatest sum."""
    sums = np.concatenate([[0.0], np.cumsum(gain)])
    last = int(np.argmax(sums - np.minimum.accumulate(sums)))
    return slice(int(np.argmin(sums[: last + 1])), last)


def _of_still(case: Case, data: Measured, moved: Array, run: Ints) -> Mistake:
    """The mistake of displacements without content."""
    due, seen, keys = rms(moved[run]), rms(data.delta[run]), _keys(data, run)
    given = case.settings.displacements
    file = given.file if given else "tracker"
    at = () if given else lines_of(case.readings[_loaded(case, keys)])
    what = "are all exactly zero" if seen == 0 else f"are {plain(1e3 * seen, 2)} mm (rms)"
    still = (
        f"{what} and follow the loads in no way: with its typical stiffnesses this robot would "
        f"move by {plain(1e3 * due, 2)} mm, and none is {1 / _STIFF:.0f} times as stiff. The "
        "sensor was dead, or what was exported are not the loaded states"
    )
    mistake = partial(Mistake, name="dead_sensor", before=seen / due, after=1.0, unit="1", at=at)
    if len(run) == len(moved):
        return mistake(
            where=file,
            evidence=f"the displacements {still}",
            correction="nothing can be corrected, no deflection was measured",
            correct=as_it_is,
            hopeless=True,
        )
    targets = set(data.name[run])  # a pose that is read as one has none
    only = str(min(targets)) if len(targets) == 1 and not data.poses else ""
    of = f", all of {only}" if only else ""
    return mistake(
        where=f"{file}/{only}" if only else file,
        evidence=f"{len(run)} of {len(moved)} displacements{of} ({lines(at) or file}) {still}",
        correction="recomputed without these readings",
        correct=partial(_unread, keys=keys),
    )


def _keys(data: Measured, run: Ints) -> pd.MultiIndex:
    """Pose and repeat, and target where each was measured by itself, of some displacements."""
    of, pull = (data.pulls.pose, data.pulls.repeat), data.pull[run]
    each = {"pose": of[0][pull], "repeat": of[1][pull], "target": data.name[run]}
    return pd.MultiIndex.from_frame(pd.DataFrame(each).iloc[:, : 2 if data.poses else 3])


def _loaded(case: Case, keys: pd.MultiIndex) -> Bools:
    """The loaded readings, or displacements as given, of some keys."""
    given, names = case.displacements, list(keys.names)
    rows = case.readings if given is None else given.select(names).to_pandas()
    mine: Bools = pd.MultiIndex.from_frame(rows[names]).isin(keys)
    return mine if given is not None else mine & (rows["state"] == "loaded").to_numpy(bool)


def _unread(case: Case, keys: pd.MultiIndex) -> Case:
    """The campaign without the displacements of some keys."""
    left = ~_loaded(case, keys)
    if case.displacements is not None:
        return replace(case, displacements=case.displacements.filter(pa.array(left)))
    return replace(case, readings=case.readings[left])


# --- the scale ------------------------------------------------------------------------------------


def _copied(case: Case, data: Measured) -> list[Mistake]:
    """Pulls with the same reading of the scale but different displacements, hence other forces."""
    if not len(case.loads):
        return []
    pulls = data.pulls
    size = np.linalg.norm(pulls.force, axis=1)
    mine = np.flatnonzero(pulls.by == PULLED)
    logged = case.loads["force_n"].to_numpy(float)[rows_of(case, data, mine)]
    found = []
    for force in np.unique(logged[np.isfinite(logged)]).tolist():
        same = mine[logged == force]
        if len(same) >= _COPIED and _unlike(data, same, size):
            found.append(_of_copy(case, data, same, force, len(same) == len(mine)))
    return found


def _silent(case: Case, data: Measured, moved: Array) -> Iterator[Mistake]:
    """A scale that shows next to nothing, independent of the forces g [N] that displacements imply.

    Of consecutive pulls, those of greatest sum g^2 / 10 - g f, with the readings f [N]. All of them
    are not asked about: they may be in another unit.
    """
    if not len(case.loads):
        return
    force, m = np.linalg.norm(data.pulls.force, axis=1), len(data.pulls)
    dot, square = (
        np.bincount(data.pull, np.sum(moved * one, axis=1), m) for one in (data.delta, moved)
    )
    implied = force * dot / np.maximum(square, 1e-300)
    read = pd.unique(data.pull[_as_read(case, data)])
    read = read[data.pulls.by[read] == PULLED]
    run = read[_greatest(_PART * implied[read] ** 2 - implied[read] * force[read])]
    f, g, others = force[run], implied[run], implied[np.setdiff1d(read, run)]
    if len(run) < _COPIED or not len(others) or rms(f) > _STIFF * rms(g) or _correlated(f, g):
        return
    if rms(g) * _PART > rms(others):
        return  # no pull is so hard: what moved is not the robot
    rows = _loads_of(case, data, run)
    at = lines_of(rows)
    yield Mistake(
        name="dead_sensor",
        where=f"{rows['file'].iloc[0]} force",
        evidence=f"{len(at)} pulls have forces of {plain(rms(f), 2)} N (rms; {lines(at)}), and "
        f"moved the robot as {plain(rms(g), 2)} N would with its typical stiffnesses: none is "
        f"{1 / _STIFF:.0f} times as compliant. The scale was dead",
        correction="recomputed without these pulls",
        before=rms(f) / rms(g),
        after=1.0,
        unit="1",
        correct=partial(without_pulls, pulls=pulls_of(rows)),
        at=at,
    )


def _correlated(f: Array, g: Array) -> bool:
    """Whether readings (n,) follow others (n,) beyond chance, whatever their offset and factor."""
    r = float(np.corrcoef(f, g)[0, 1]) if np.ptp(f) and np.ptp(g) else 0.0
    return abs(r) * np.sqrt(len(f) - 2) > _BY_CHANCE * np.sqrt(1 - min(r**2, 1.0))


def _loads_of(case: Case, data: Measured, pulls: Ints) -> pd.DataFrame:
    """The rows of the loads of some pulls."""
    return case.loads.iloc[np.sort(rows_of(case, data, pulls))]


def _unlike(data: Measured, same: Ints, size: Array) -> bool:
    """Whether most pairs of these pulls in one pose and direction have different displacements."""
    moved = np.sqrt(np.bincount(data.pull, np.sum(data.delta**2, axis=1), len(data.pulls)))
    count = np.bincount(data.pull, minlength=len(data.pulls))
    std = displacement_std(data) * np.sqrt(3 * count)
    along = data.pulls.force / np.maximum(size, 1e-300)[:, None]
    first, second = (same[k] for k in np.triu_indices(len(same), 1))
    pair = (data.pulls.pose[first] == data.pulls.pose[second]) & (count[first] == count[second])
    pair &= np.sum(along[first] * along[second], axis=1) > _ALONG
    least, most = (f(moved[first], moved[second]) for f in (np.minimum, np.maximum))
    pair &= most > _CLEAR * std[first]
    apart: Bools = most > _UNLIKE * least
    return int(pair.sum()) >= _COPIED and bool(apart[pair].mean() > 0.5)


def _of_copy(case: Case, data: Measured, same: Ints, force: float, every: bool) -> Mistake:
    rows = _loads_of(case, data, same)
    at = lines_of(rows)
    return _copied_in(
        rows,
        "force",
        f"{len(at)} pulls have the same force of {plain(force, 6)} N ({lines(at)}), and "
        f"within a pose they moved the robot by amounts that differ by more than {_UNLIKE} times: "
        "one number was copied down the column, or the scale hung",
        lost="no force was logged; each was taken to be known to 100 % only" if every else "",
        kept="these pulls",
        before=_UNLIKE,
        after=1.0,
        unit="1",
        correct=_unlogged if every else partial(without_pulls, pulls=pulls_of(rows)),
    )


def _copied_in(
    rows: pd.DataFrame, what: str, told: str, lost: str, kept: str, **known: Any
) -> Mistake:
    """The mistake of rows with copied numbers; what was `lost`, if nothing can be corrected."""
    correction = f"nothing can be corrected, {lost}" if lost else f"recomputed without {kept}"
    where, at = f"{rows['file'].iloc[0]} {what}", lines_of(rows)
    usual: dict[str, Any] = {"name": "copied_column", "at": at, "hopeless": bool(lost)}
    return Mistake(where=where, evidence=told, correction=correction, **usual, **known)


def _unlogged(case: Case) -> Case:
    """The campaign with forces of which only the order of magnitude is known."""
    known = case.settings.scale or Scale()
    scale = known.model_copy(update={"sigma_rel": 1.0, "gain_sigma": 1.0})
    return replace(case, settings=case.settings.model_copy(update={"scale": scale}))


# --- the joint log --------------------------------------------------------------------------------


def _one_pose(case: Case) -> list[Mistake]:
    """Equal rows of the joint log, of poses whose unloaded reflectors are far apart."""
    log = case.joints.sort_values(["file", "line"])
    zeros = unloaded(case).groupby(["target", "pose"], observed=True)[XYZ].median()
    found = []
    for _, rows in log.groupby(case.joint_columns, sort=False):
        if len(rows) < _COPIED:
            continue
        here = zeros[zeros.index.isin(rows["pose"], level="pose")]
        spread = here.groupby("target", observed=True).agg(np.ptp).to_numpy(float)
        if not len(spread) or np.linalg.norm(spread, axis=1).max() < GROSS_DISTANCE_M:
            continue
        at, size = lines_of(rows), float(np.linalg.norm(spread, axis=1).max())
        every = len(rows) == len(log)
        found += [
            _copied_in(
                rows,
                "joints",
                f"{len(at)} poses have the same joint values ({lines(at)}), and their "
                f"unloaded reflectors are up to {length(size)} apart: one row was copied down",
                lost="no joint values were logged" if every else "",
                kept="these poses",
                before=1e3 * size,
                correct=as_it_is if every else partial(without_poses, poses=rows["pose"].tolist()),
            )
        ]
    return found


def _one_column(case: Case) -> Iterator[Mistake]:
    """Joints of one unit with equal values in every row, of poses that the table does not place.

    Values that hardly vary may be equal on purpose, and so may any that the reflectors confirm.
    """
    log, off = case.joints, miss(case)
    for one, other in combinations(case.joint_columns, 2):
        equal = one.rpartition("_")[2] == other.rpartition("_")[2] and log[one].equals(log[other])
        if equal and log[one].nunique() > _COPIED and off is not None and off >= GROSS_DISTANCE_M:
            names = [column.rpartition("_")[0] for column in (one, other)]
            yield _copied_in(
                log,
                "/".join(names),
                f"{log['file'].iloc[0]}: {' and '.join(names)} are equal in every row, and "
                f"the unloaded reflectors are {length(off)} from where the robot file then places "
                "them: one column was copied over the other",
                lost="the values of one joint were not logged",
                kept="",
                before=1e3 * off,
                correct=as_it_is,
            )


FAULT = Fault("dead_sensor", dead, in_files=True, in_forces=True)
