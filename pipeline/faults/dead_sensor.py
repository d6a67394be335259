"""Columns without measured content: no deflection, or a copied force, pose or joint.

A robot deflects under a load; pulls of a pose with different displacements had different forces;
and poses with the same joint values cannot have their reflectors decimetres apart. These tests need
no estimate, and none of these mistakes can be corrected: what is missing was not measured.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array, Bools, Ints
from pipeline.base.linear import rms
from pipeline.base.quantities import plain
from pipeline.faults.assignment import lines
from pipeline.faults.conventions import miss, unloaded
from pipeline.faults.exchanged_pulls import displacement_std
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.joint_row import without_poses
from pipeline.faults.mistake import Mistake, as_it_is, left_out, length, lines_of
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
    case, data = asked.case, asked.reduced.data
    return _still(asked, data) or [*_copied(case, data), *_one_pose(case), *_one_column(case)]


# --- the tracker ----------------------------------------------------------------------------------


def _still(asked: Screening, data: Measured) -> list[Mistake]:
    """The mistake that no displacement is related to the loads by any possible stiffnesses."""
    cell = asked.case.cell
    typical = np.array([p.typical for p in cell.parameters])
    moved = predict(cell, data.pulls, typical).displacement[data.pull, data.target]
    due, seen = rms(moved), rms(data.delta)
    if moved.size < _FEWEST or due < 100 * STILL_M or seen > 10 * _STIFF * due:
        return []
    square = float(np.sum(moved**2))
    part, left = float(np.sum(moved * data.delta)) / square, seen / due / np.sqrt(moved.size)
    chance = abs(part) <= _BY_CHANCE * left and part + _BY_CHANCE * left < _STIFF
    if seen > STILL_M / 10 and not chance:
        return []
    what = "are all exactly zero" if seen == 0 else f"are {plain(1e3 * seen, 2)} mm (rms)"
    file, rows = asked.case.settings.displacements, asked.case.readings
    rows = rows[(rows["state"] == "loaded") & rows["target"].isin(asked.case.settings.measured)]
    return [
        Mistake(
            name="dead_sensor",
            where="tracker" if file is None else file.file,
            evidence=f"the displacements {what} and follow the loads in no way: with its typical "
            f"stiffnesses this robot would move by {plain(1e3 * due, 2)} mm, and none is "
            f"{1 / _STIFF:.0f} times as stiff. The sensor was dead, or what was exported are not "
            "the loaded states",
            correction="nothing can be corrected, no deflection was measured",
            before=seen / due,
            after=1.0,
            unit="1",
            correct=as_it_is,
            at=lines_of(rows),
            hopeless=True,
        )
    ]


# --- the scale ------------------------------------------------------------------------------------


def _copied(case: Case, data: Measured) -> list[Mistake]:
    """Pulls with the same reading of the scale but different displacements, hence other forces."""
    if not len(case.loads):
        return []
    pulls = data.pulls
    size = np.linalg.norm(pulls.force, axis=1)
    mine = np.flatnonzero(pulls.by == PULLED)
    known = case.loads.set_index(["pose", "repeat"])["force_n"]
    key = pd.MultiIndex.from_arrays([pulls.pose[mine], pulls.repeat[mine]])
    logged = known.reindex(key).to_numpy(float)
    found = []
    for force in np.unique(logged[np.isfinite(logged)]).tolist():
        same = mine[logged == force]
        if len(same) >= _COPIED and _unlike(data, same, size):
            found.append(_of_copy(case, data, same, force, len(same) == len(mine)))
    return found


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
    keys = set(zip(data.pulls.pose[same].tolist(), data.pulls.repeat[same].tolist(), strict=True))
    loads = case.loads
    mine = np.array([key in keys for key in zip(loads["pose"], loads["repeat"], strict=True)])
    rows = loads[mine]
    file = str(rows["file"].iloc[0])
    at = lines_of(rows)
    return Mistake(
        name="copied_column",
        where=f"{file} force",
        evidence=f"{len(at)} pulls have the same force of {plain(force, 6)} N ({lines(at)}), and "
        f"within a pose they moved the robot by amounts that differ by more than {_UNLIKE} times: "
        "one number was copied down the column, or the scale hung",
        correction="nothing can be corrected, no force was logged; each was taken to be known to "
        "100 % only"
        if every
        else "recomputed without these pulls",
        before=_UNLIKE,
        after=1.0,
        unit="1",
        correct=_unlogged if every else partial(left_out, at=at, of="loads"),
        at=at,
        hopeless=every,
    )


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
        found.append(
            Mistake(
                name="copied_column",
                where=f"{rows['file'].iloc[0]} joints",
                evidence=f"{len(at)} poses have the same joint values ({lines(at)}), and their "
                f"unloaded reflectors are up to {length(size)} apart: one row was copied down",
                correction="nothing can be corrected, no joint values were logged"
                if every
                else "recomputed without these poses",
                before=1e3 * size,
                after=0.0,
                unit="mm",
                correct=as_it_is if every else partial(without_poses, poses=rows["pose"].tolist()),
                at=at,
                hopeless=every,
            )
        )
    return found


def _one_column(case: Case) -> Iterator[Mistake]:
    """Joints of one unit with equal values in every row, of poses that the table does not place.

    Values that hardly vary may be equal on purpose, and so may any that the reflectors confirm.
    """
    log, off = case.joints, miss(case)
    for one, other in combinations(case.joint_columns, 2):
        equal = one.rpartition("_")[2] == other.rpartition("_")[2] and log[one].equals(log[other])
        if equal and log[one].nunique() > _COPIED and off is not None and off >= GROSS_DISTANCE_M:
            names, at = [column.rpartition("_")[0] for column in (one, other)], lines_of(log)
            file = str(log["file"].iloc[0])
            yield Mistake(
                name="copied_column",
                where=f"{file} {'/'.join(names)}",
                evidence=f"{file}: {' and '.join(names)} are equal in every row, and "
                f"the unloaded reflectors are {length(off)} from where the robot file then places "
                "them: one column was copied over the other",
                correction="nothing can be corrected, the values of one joint were not logged",
                before=1e3 * off,
                after=0.0,
                unit="mm",
                correct=as_it_is,
                at=at,
                hopeless=True,
            )


FAULT = Fault("dead_sensor", dead, in_files=True, in_forces=True)
