"""Base reflectors with exchanged names, in [base_frame] or in one round: two, or all off by one.

A rigid motion preserves distances: the names are right if the distances between the reflectors are
those in campaign.toml. Where several assignments satisfy this, as for a rectangle, the robot's
table shows which one brings the effector to its position; for one round, the other rounds do.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
import pandas as pd

from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.faults.assignment import lines
from pipeline.faults.conventions import GROSS_ANCHORED_M, anchored_miss, renamed, with_places
from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake, length, lines_of
from pipeline.readers.reflector_sets import CLEARLY_NEARER, GROSS_DISTANCE_M
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ
from pipeline.reduction.settings import BASE_REFLECTORS

_MOST = 1000
"""Maximum number of assignments that are tried; a layout with more of them identifies no name."""


def base_names(case: Case) -> list[Mistake]:
    """The mistakes that base reflectors are misnamed, if exactly one other assignment fits.

    In all rounds, against [base_frame]; else in single ones, by the distances in each.
    """
    rows = case.readings
    rounds = rows["group"][
        rows["pose"].isna() & rows["target"].isin(list(case.settings.base_frame))
    ]
    single = (_misnamed(case, group) for group in rounds.unique())
    return _misnamed(case, None) or [one for found in single for one in found]


def _misnamed(case: Case, group: str | None) -> list[Mistake]:
    """Misnamed base reflectors of a round, or of all if None."""
    names, seen, nominal = _reflectors(case, group)
    if len(names) < BASE_REFLECTORS:
        return []
    given = tuple(range(len(names)))
    before = _miss(seen, nominal, given)
    table = anchored_miss(case) if group is None else None
    fine = before < GROSS_DISTANCE_M and (table is None or table < GROSS_ANCHORED_M)
    order = None if fine else _true(case, names, seen, nominal, group)
    if order is None or order == given:
        return []
    place = _places(names, order)
    if before < GROSS_DISTANCE_M and not _nearer(anchored_miss(_renamed(case, place)), table):
        return []
    return [_finding(case, place, (before, _miss(seen, nominal, order)), group)]


def not_rigid(case: Case) -> float | None:
    """Rms deviation of the base reflectors from [base_frame] after the best rigid motion [m].

    None where it is below `GROSS_DISTANCE_M`, or where fewer reflectors were read than a
    registration needs.
    """
    names, seen, nominal = _reflectors(case, None)
    if len(names) < BASE_REFLECTORS:
        return None
    off_m = _miss(seen, nominal, range(len(names)))
    return off_m if off_m >= GROSS_DISTANCE_M else None


def _reflectors(case: Case, group: str | None) -> tuple[list[str], Array, Array]:
    """Names, median readings [m], tracker's frame, and positions in [base_frame] [m]."""
    base, rows = case.settings.base_frame, _of_base(case, group)
    rows = rows[rows["target"].isin(list(base))]
    at = rows.groupby(rows["target"].astype(str))[XYZ].median()
    names = [str(name) for name in at.index]
    return names, at.to_numpy(float), np.array([base[name] for name in names]).reshape(-1, 3)


def _of_base(case: Case, group: str | None) -> pd.DataFrame:
    """Readings of the base reflectors in a round, or in all if None."""
    rows = case.readings
    return rows[rows["pose"].isna() & (group is None or rows["group"] == group)]


def _miss(seen: Array, nominal: Array, order: Sequence[int]) -> float:
    """Rms deviation of the readings from their positions after the best rigid motion [m]."""
    due = nominal[list(order)]
    return float(np.sqrt(np.mean(np.sum((linear.moved_onto(seen, due) - due) ** 2, axis=1))))


def _true(
    case: Case, names: list[str], seen: Array, nominal: Array, group: str | None
) -> tuple[int, ...] | None:
    """The place of each reflector; None where no single assignment fits."""
    tried = [order for order, _ in zip(_alike(seen, nominal), range(_MOST), strict=False)]
    miss = {order: _miss(seen, nominal, order) for order in tried}
    least = min(miss.values(), default=np.inf)
    most = max(CLEARLY_NEARER * least, GROSS_DISTANCE_M / CLEARLY_NEARER)
    kept = [order for order in tried if miss[order] <= most]
    if least >= GROSS_DISTANCE_M or len(tried) == _MOST:
        return None
    if len(kept) == 1:
        return kept[0]
    away = {order: _away(case, names, seen, group, order) for order in kept}
    best, second = sorted(kept, key=lambda order: away[order] or np.inf)[:2]
    return best if _nearer(away[best], away[second]) else None


def _away(
    case: Case, names: list[str], seen: Array, group: str | None, order: tuple[int, ...]
) -> float | None:
    """How far the effector is from the table with an assignment, or a round from all others [m]."""
    if group is None:
        return anchored_miss(_renamed(case, _places(names, order)))
    rows = _of_base(case, None)
    at = rows[rows["group"] != group].groupby(rows["target"].astype(str))[XYZ].median()
    return float(np.abs(seen - at.reindex(names).to_numpy(float)[list(order)]).max())


def _nearer(one: float | None, other: float | None) -> bool:
    """Whether the robot's table favours one assignment over the other."""
    if one is None or other is None:
        return False
    return one < GROSS_ANCHORED_M and CLEARLY_NEARER * one < other


def _alike(seen: Array, nominal: Array) -> Iterator[tuple[int, ...]]:
    """Assignments whose distances between reflectors agree with the readings."""
    read, stated = (np.linalg.norm(at[:, None] - at, axis=2) for at in (seen, nominal))

    def further(begun: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
        k = len(begun)
        if k == len(read):
            yield begun
        for place in set(range(len(read))) - set(begun):
            off = np.abs(stated[place, list(begun)] - read[k, :k])
            if (off < 2 * GROSS_DISTANCE_M).all():
                yield from further((*begun, place))

    return further(())


def _places(names: list[str], order: Sequence[int]) -> dict[str, str]:
    """For each misnamed reflector, the name of its place in campaign.toml."""
    return {names[k]: names[place] for k, place in enumerate(order) if place != k}


def _renamed(case: Case, place: dict[str, str]) -> Case:
    """The campaign with the places in [base_frame] under the right names."""
    base = case.settings.base_frame
    return with_places("base_frame", {name: base[at] for name, at in place.items()}, case)


def _finding(
    case: Case, place: dict[str, str], miss: tuple[float, float], group: str | None
) -> Mistake:
    wrong, (before, after) = sorted(place), miss
    rows = _of_base(case, group)
    at = lines_of(rows[rows["target"].isin(wrong)])
    each = ", ".join(f"{name} stands at the place of {place[name]}" for name in wrong)
    where, whose = "-".join(wrong), "names or places in [base_frame]"
    correct = partial(_renamed, place=place)
    if group is not None:
        where, whose = f"{group} {where}", f"names in {group}"
        correct = partial(renamed, true=place, groups=(group,))
    return Mistake(
        name="label_swap",
        where=where,
        evidence=f"the base reflectors have each other's {whose}: {each} "
        f"({lines(at)}); as stated they are {length(before)} from their places, and "
        f"{length(after)} with the names exchanged",
        correction=f"recomputed with the places of {', '.join(wrong)} exchanged",
        before=1e3 * before,
        after=1e3 * after,
        correct=correct,
        at=at,
    )


FAULT = Fault("label_swap", lambda asked: base_names(asked.case), in_files=True)
