"""Readings that repeat another one to the last digit, hence were not measured again.

An end of a chain that repeats the other end leaves a pull without direction, left out as read.
Another target that repeats the one before it is in the wrong place: the tests of readings name it.
A target that repeats its own reading of another state is in a plausible place, where no test of
positions would find it; equal digits do, if the noise makes them practically impossible. Of two
pulls the copy is the one whose force contradicts the displacements; of two poses it is the one that
is elsewhere than the robot's table predicts; otherwise the later one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from pipeline.base import covariance
from pipeline.base.arrays import Array
from pipeline.faults.exchanged import misplaced_groups
from pipeline.faults.exchanged_pulls import odd_forces
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake, as_it_is, left_out, outlying
from pipeline.reduction.case import Case
from pipeline.reduction.digits import rounding
from pipeline.reduction.measured import STILL_M
from pipeline.reduction.register import XYZ
from pipeline.system import alarms

_SCATTERS = 0.5
"""Fraction of equal readings among those repeated under equal conditions above which the data have
no noise [1], so that equal digits mean nothing."""


def stale(case: Case) -> list[Mistake]:
    """Stale readings because of which their pull was left out."""
    if not case.stale:
        return []
    used = set(zip(case.readings["file"], case.readings["line"], strict=True))
    return [
        _repeats(
            f"{one.group}/{one.target}",
            f"{one.file}:{one.line}",
            one.of,
            correction="computed without this pull, whose direction is unknown",
            correct=as_it_is,
        )
        for one in case.stale
        if (one.file, one.line) not in used
    ]


def repeated(asked: Screening) -> list[Mistake]:
    """Readings of a target that repeat its reading in another state.

    Or of a base reflector in another round. Two readings with noise s agree in all digits of width
    h along an axis with a probability of at most h / (sqrt(4 pi) s), which is multiplied over axes
    and over all targets that repeat the same group. A repetition is reported if this is below
    `alarms.READING` after counting all pairs of groups of a pose, or of two poses. Targets that
    stand still while the robot moves, such as an anchor, are as likely to be read alike then.
    """
    case = asked.case
    rows = case.readings
    rows = rows[rows["pose"].notna() | rows["target"].isin(case.settings.base_frame)]
    rows = rows[rows[XYZ].any(axis=1)]  # a lost lock is (0, 0, 0) however often
    rows = rows.assign(at=rows["pose"].fillna(-1)).drop_duplicates(["group", "target"])
    equal = rows.duplicated(["target", *XYZ], keep=False)
    still = rows[(rows["state"] == "unloaded") | rows["pose"].isna()]
    if not equal.any() or _without_noise(still):
        return []
    step = rounding(case.readings[XYZ].to_numpy(float))  # h / sqrt(12)
    ratio = np.sqrt(3 / np.pi) * step / _scatter(rows, still, step or STILL_M)
    chance = pd.Series(np.prod(np.minimum(ratio, 1.0), axis=1), rows.index)
    pairs = rows.groupby("at")["group"].nunique()
    within = float((pairs * (pairs - 1) / 2).sum())
    across = float(pairs.sum() * (pairs.sum() - 1) / 2) - within
    found: dict[int, Mistake] = {}
    for names, same, here in _unexplained(case, rows, rows[equal]):
        alike = here[0]["at"] == here[1]["at"]
        p = (within if alike else across) * float(np.prod(chance[same[1]].to_numpy(float)))
        if p < alarms.READING:
            which = _copy(asked, names, here)
            for k in same[which]:
                row = rows.loc[[k]].iloc[0]
                where, line = f"{names[which]}/{row['target']}", f"{row['file']}:{row['line']}"
                one = _repeats(where, line, names[1 - which], p_value=p)
                origin = f"{sorted(names)}" if alike else f"{here[1 - which]['at']} {row['at']}"
                found.setdefault(k, replace(one, alike=origin))
    return [found[k] for k in sorted(found)]


def _unexplained(
    case: Case, rows: pd.DataFrame, equal: pd.DataFrame
) -> Iterator[tuple[tuple[str, str], tuple[list[int], list[int]], tuple[Any, Any]]]:
    """Groups as of `_twice` and their first rows, without those of a target that stands still.

    Nor of an anchor alone: it was read once, for every pull towards it.
    """
    anchor = {case.settings.naming.chain[1]}
    for names, same in _twice(equal):
        here = rows.loc[same[0]].iloc[0], rows.loc[same[1]].iloc[0]
        still = here[0]["at"] != here[1]["at"] and _stand_alike(case, here)
        if not still and {*rows.loc[same[0], "target"]} - anchor:
            yield names, same, here


def _twice(rows: pd.DataFrame) -> Iterator[tuple[tuple[str, str], tuple[list[int], list[int]]]]:
    """Pairs of groups that share readings, the earlier first, and their rows."""
    shared: dict[tuple[str, str], tuple[list[int], list[int]]] = {}
    for _, here in rows.groupby(["target", *XYZ], observed=True, sort=False):
        (one, k), *others = zip(here["group"].astype(str), here.index, strict=True)
        for other, n in others:
            first, second = shared.setdefault((one, other), ([], []))
            first.append(k)
            second.append(n)
    yield from shared.items()


def _stand_alike(case: Case, here: tuple[pd.Series, pd.Series]) -> bool:
    """Whether two poses have the same joint values in the log."""
    log = case.joints[case.joints["pose"].isin([one["pose"] for one in here])]
    return len(log) == 2 and bool(log.duplicated(case.joint_columns).any())


def _copy(asked: Screening, names: tuple[str, str], here: tuple[Any, Any]) -> int:
    """Which of two groups that share readings was not measured; by default 1, the later one."""
    if here[0]["at"] != here[1]["at"]:
        wrong = [name in misplaced_groups(asked.case) for name in names]
    elif any(one["state"] != "loaded" for one in here):
        return 1
    else:
        odd = odd_forces(asked)
        wrong = [odd.get((int(one["pose"]), int(one["repeat"])), False) for one in here]
    return 0 if wrong == [True, False] else 1


def _without_noise(still: pd.DataFrame) -> bool:
    """Whether repeated zeros and base readings are mostly equal."""
    more = int((still.groupby(["at", "target"], observed=True).size() - 1).sum())
    return more > 0 and still.duplicated(["at", "target", *XYZ]).sum() > _SCATTERS * more


def _scatter(rows: pd.DataFrame, still: pd.DataFrame, least: float) -> Array:
    """Standard uncertainties of readings per axis [m]: that stated, or less if zeros repeat better.

    What is stated is cautious, or has not the unit of the numbers, which is asked about later.
    """
    off = still.groupby(["at", "target"], observed=True)[XYZ].diff().to_numpy(float)
    off = np.abs(off[np.isfinite(off).all(axis=1) & off.any(axis=1)])
    std = np.sqrt(np.einsum("mii->mi", covariance.matrices(rows)))  # the median is 0.95 s
    return np.asarray(np.fmax(np.fmin(std, np.median(off) if off.size else np.nan), least))


def _repeats(where: str, line: str, of: str, **known: Any) -> Mistake:
    usual = {"correction": f"recomputed without {where}", "correct": partial(left_out, at=(line,))}
    return outlying(
        where,
        f"the reading {where} ({line}) repeats that of {of} to the last digit: it was not "
        "measured again",
        **{"before": 0.0, "unit": "mm", "at": (line,), **usual, **known},
    )


FAULT = Fault("outlier", lambda asked: [*stale(asked.case), *repeated(asked)], in_files=True)
