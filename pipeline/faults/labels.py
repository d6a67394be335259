"""Exchanged names of two reflectors in one state."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache, partial

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array, Bools
from pipeline.faults.conventions import aligned, pairs, renamed, unloaded
from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake, of_group
from pipeline.machine.robot import configure
from pipeline.readers.reflector_sets import CLEARLY_NEARER, GROSS_DISTANCE_M
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ

_PULLS = 3
"""Minimum number of pulls of a pose that determine how its chain is hung."""

_USUAL = 10.0
"""Deviation of a length from the usual one, in median deviations, above which it is gross [1]:
seven standard deviations."""


def _labels(case: Case) -> list[Mistake]:
    """States in which two measured reflectors bear each other's name.

    One is misnamed if it is centimetres from its position by the robot's table and another reading
    of the state is there.
    """
    at = aligned(case)
    return [] if at is None else list(_measured(case, *at))


def _chain_labels(case: Case) -> list[Mistake]:
    """States in which the ends of the chain bear each other's name.

    The first is farther from the load point than the second, unlike in the rest of the campaign:
    their distance alone tells it, and such a pull's force has the opposite direction.
    """
    at = aligned(case)
    if at is None:
        return []
    seen, expected, _ = pairs(case, unloaded(case))
    usual = float(np.median(np.linalg.norm(seen - expected @ at[0].T - at[1], axis=1)))
    return list(_chain(case, *at, max(GROSS_DISTANCE_M, 3 * usual)))


def _measured(case: Case, R: Array, t: Array) -> Iterator[Mistake]:
    rows = case.readings
    rows = rows[
        rows["pose"].isin(case.joints["pose"]) & rows["target"].isin(case.settings.measured)
    ]
    seen, expected, _ = pairs(case, rows)
    off = np.linalg.norm(seen - expected @ R.T - t, axis=1)
    near = max(GROSS_DISTANCE_M, 3 * float(np.median(off)))
    wrong = rows[off > near]
    places = dict(zip(rows.index, expected @ R.T + t, strict=True))
    for group in dict.fromkeys(wrong["group"]):
        state = case.readings[case.readings["group"] == group]
        swaps = list(_swaps(wrong[wrong["group"] == group], state, places, near))
        names = dict(swaps)
        names |= {b: a for a, b in swaps if b not in names}
        if names and _in_place(case, names, state, places, (R, t), near):
            yield _finding(case, str(group), names, off, rows)


def _in_place(
    case: Case,
    names: dict[str, str],
    state: pd.DataFrame,
    places: dict[int, Array],
    base: tuple[Array, Array],
    near: float,
) -> bool:
    """Whether an exchange puts every renamed reading where its reflector should be.

    An end of the chain should be at its usual distance from the load point.
    """
    at = state.drop_duplicates("target").set_index("target")[XYZ]
    index = dict(zip(state["target"], state.index, strict=True))
    for name, other in names.items():
        here = at.loc[other].to_numpy(float)
        if index[name] in places:
            off = float(np.linalg.norm(here - places[index[name]]))
        else:
            off = _off_chain(case, base, float(state["pose"].iloc[0]), name, here)
        if off >= near:
            return False
    return True


def _off_chain(case: Case, base: tuple[Array, Array], pose: float, name: str, here: Array) -> float:
    """Deviation of an end of the chain from its usual distance to the load point [m].

    It is reduced in proportion where ten median deviations of the usual distance exceed
    `GROSS_DISTANCE_M`.
    """
    R, t = base
    ends = chain_distances(case, R, t)
    if not len(ends) or name not in case.settings.naming.chain or np.isnan(pose):
        return np.inf  # a round of the base has no pose
    usual = ends[("near", "far")[case.settings.naming.chain.index(name)]]
    stands = configure(case.robot, case.q(np.array([int(pose)])))
    load = stands.points(case.tool.load_point[None])[0, 0]
    off = abs(float(np.linalg.norm(here - load @ R.T - t)) - float(usual.median()))
    spread = _USUAL * float((usual - usual.median()).abs().median())
    return off / max(1.0, spread / GROSS_DISTANCE_M)


def _swaps(
    wrong: pd.DataFrame, state: pd.DataFrame, places: dict[int, Array], near: float
) -> Iterator[tuple[str, str]]:
    """Pairs (name as written, name of the reading that is where it should be)."""
    points = state[XYZ].to_numpy(float)
    for index, name in zip(wrong.index, wrong["target"], strict=True):
        away = np.linalg.norm(points - places[index], axis=1)
        nearest = int(np.argmin(away))
        other = str(state["target"].iloc[nearest])
        given = float(away[state.index.get_loc(index)])
        if other != name and away[nearest] < min(near, given / CLEARLY_NEARER):
            yield str(name), other


def _finding(
    case: Case, group: str, names: dict[str, str], off: Array, rows: pd.DataFrame
) -> Mistake:
    """The mistake; `names` maps each name to that of the reading where it should be."""
    before = 1e3 * float(off[(rows["group"] == group).to_numpy()].max())
    after = 1e3 * float(np.median(off))
    text = " and ".join(sorted(set(names)))
    at = of_group(case, group, set(names))
    return Mistake(
        name="label_swap",
        where=group,
        evidence=f"in {group} the names {text} ({', '.join(at)}) are exchanged: as recorded, a "
        f"reflector is {before:.0f} mm from its expected position, at that of the other one",
        correction=f"recomputed with {text} of {group} exchanged",
        before=before,
        after=after,
        # a reading at the position of `name`, written as `other`, is one of `name`
        correct=partial(renamed, true={b: a for a, b in names.items()}, groups=[group]),
        at=at,
        alike=text,
    )


# --- the chain ------------------------------------------------------------------------------------


def chain_distances(case: Case, R: Array, t: Array) -> pd.DataFrame:
    """Distance of both ends of the chain from the load point [m]: group, pose, near, far."""
    table = _ends(case, R, t)
    ends = {end: [float(np.linalg.norm(one)) for one in table[end]] for end in ("near", "far")}
    return table.assign(**ends)


def _ends(case: Case, R: Array, t: Array) -> pd.DataFrame:
    """Both ends of the chain, seen from the load point [m]: group, pose, near, far, of (3,)."""
    near, far = case.settings.naming.chain
    rows = case.readings
    rows = rows[rows["pose"].isin(case.joints["pose"]) & rows["target"].isin([near, far])]
    poses, at = np.unique(rows["pose"].to_numpy(int), return_inverse=True)
    if not len(poses):
        return pd.DataFrame({"group": [], "pose": [], "near": [], "far": []})
    points = configure(case.robot, case.q(poses)).points(case.tool.load_point[None])[at, 0]
    rows = rows.assign(away=[*(rows[XYZ].to_numpy(float) - points @ R.T - t)])
    table = rows.drop_duplicates(["group", "pose", "target"])
    table = table.pivot_table(
        index=["group", "pose"], columns="target", values="away", aggfunc="first"
    )
    table = table.reindex(columns=[near, far]).dropna().set_axis(["near", "far"], axis=1)
    return table.reset_index()


@lru_cache(maxsize=1)
def anchors(case: Case) -> pd.DataFrame:
    """Where each pull's chain ends, by group: number of the place, and whether it is an anchor.

    Far ends within `GROSS_DISTANCE_M` of each other are in one place, -1 where the tracker stands,
    as a lost lock says. One of two or more poses is an anchor: whether it was read in each of them
    or once, how far it is from the robot is no property of the chain.
    """
    rows = case.readings[case.readings["state"] == "loaded"].drop_duplicates(["group", "target"])
    rows = rows[rows["target"] == case.settings.naming.chain[1]].set_index("group")
    at, place = rows[XYZ].to_numpy(float), np.full(len(rows), -1)
    left = np.linalg.norm(at, axis=1) > GROSS_DISTANCE_M
    while left.any():
        near = left & (np.linalg.norm(at - at[np.argmax(left)], axis=1) < GROSS_DISTANCE_M)
        place[near], left = place.max(initial=-1) + 1, left & ~near
    poses = rows["pose"].groupby(place).transform("nunique")
    return pd.DataFrame({"place": place, "anchor": (poses > 1) & (place >= 0)}, rows.index)


@lru_cache(maxsize=1)
def unlike(case: Case) -> pd.DataFrame:
    """Deviation of the chain's length from the usual one, by group: away, gross, elsewhere.

    `away` [m] is the deviation from the median of all pulls, or from that of the others of the pose
    if it has three pulls and this is smaller. It is gross beyond `GROSS_DISTANCE_M` and ten times
    the median deviation: no chain stretches or is hung like that. Towards an anchor it is 0, and
    where both ends are on one straight line with the load point, as no wrong reading is: they were
    fixed elsewhere along the chain.
    """
    rows = case.readings[case.readings["state"] == "loaded"].drop_duplicates(["group", "target"])
    ends = [rows[rows["target"] == name].set_index("group") for name in case.settings.naming.chain]
    between = (ends[1][XYZ] - ends[0][XYZ]).dropna()
    length = pd.Series(np.linalg.norm(between.to_numpy(float), axis=1), between.index)
    free = length[~anchors(case)["anchor"][length.index]]
    of_pose = free.groupby(ends[0]["pose"].reindex(free.index))
    own = (free - of_pose.transform(_of_others)).abs().where(of_pose.transform("count") >= _PULLS)
    away = own.fillna(np.inf).clip(upper=(free - free.median()).abs())
    gross = away > max(GROSS_DISTANCE_M, _USUAL * away.median())
    elsewhere = gross & _straight(case, free.index)
    away, gross = away.where(~elsewhere, 0.0), gross & ~elsewhere
    table = pd.DataFrame({"away": away, "gross": gross, "elsewhere": elsewhere})
    table = table.reindex(length.index)
    return table.eq(True).assign(away=table["away"].fillna(0.0))


def _straight(case: Case, groups: pd.Index[str]) -> Bools:
    """Whether the line through both ends passes the load point as it does in the other pulls.

    That is by no more than ten times the median, and by less than `GROSS_DISTANCE_M`.
    """
    base = aligned(case)
    table = pd.DataFrame() if base is None else _ends(case, *base)
    if table.empty:
        return np.zeros(len(groups), dtype=bool)
    near, far = (np.stack(table[one].to_list()) for one in ("near", "far"))
    u = (far - near) / np.maximum(np.linalg.norm(far - near, axis=1, keepdims=True), 1e-12)
    off = np.linalg.norm(near - np.sum(near * u, axis=1, keepdims=True) * u, axis=1)
    by = pd.Series(off, table["group"])[lambda one: ~one.index.duplicated()].reindex(groups)
    return np.asarray(by < min(GROSS_DISTANCE_M, _USUAL * np.median(off)))


def _of_others(length: pd.Series[float]) -> Array:
    """Median of all others for each of some lengths."""
    others = np.where(np.eye(len(length), dtype=bool), np.nan, length.to_numpy(float))
    return np.nanmedian(others, axis=1) if len(length) > 1 else np.full(len(length), np.nan)


def _chain(case: Case, R: Array, t: Array, clear: float) -> Iterator[Mistake]:
    """Exchanged names of the chain's ends.

    An exchange leaves the chain's length, and how it is hung, as in the other pulls, or, where the
    ends of some pulls were fixed elsewhere along the chain, one straight line; a bad reading does
    not.
    """
    table = chain_distances(case, R, t)
    if not len(table):
        return
    reversed_ = (table["near"] > table["far"] + clear).to_numpy()
    if not reversed_.any() or reversed_.mean() > 0.5:
        return
    reversed_ = reversed_ & ~unlike(case)["gross"].reindex(table["group"]).to_numpy(bool)
    elsewhere = unlike(case)["elsewhere"].reindex(table["group"]).eq(True).to_numpy(bool)
    hung = _hung_alike(table, reversed_)
    if elsewhere[~reversed_].any():
        hung = hung | _straight(case, pd.Index(table["group"]))
    reversed_ = reversed_ & hung
    near, far = case.settings.naming.chain
    wrong = table.loc[reversed_, ["group", "near", "far"]]
    for group, a, b in wrong.itertuples(index=False, name=None):
        at = of_group(case, str(group), (near, far))
        yield Mistake(
            name="label_swap",
            where=str(group),
            evidence=f"in {group} the names {near} and {far} ({', '.join(at)}) are exchanged: "
            f"{near} is {1e3 * a:.0f} mm from the load point and {far} {1e3 * b:.0f} mm, against "
            "all others",
            correction=f"recomputed with {near} and {far} of {group} exchanged",
            before=1e3 * a,
            after=1e3 * b,
            correct=partial(renamed, true={near: far, far: near}, groups=[str(group)]),
            at=at,
            alike=f"{near} and {far}",
        )


def _hung_alike(table: pd.DataFrame, reversed_: Bools) -> Bools:
    """Whether both ends are at their usual distances from the load point once renamed.

    As in `unlike`: within `GROSS_DISTANCE_M` or ten times the median deviation, of all pulls or of
    those of the pose.
    """
    swapped = np.where(reversed_[:, None], table[["far", "near"]], table[["near", "far"]])
    ends = pd.DataFrame(swapped, columns=["near", "far"])
    usual = ends.mask(pd.Series(reversed_))
    of_pose = usual.groupby(table["pose"]).transform("median")
    away = (ends - of_pose).abs().fillna(np.inf).clip(upper=(ends - usual.median()).abs())
    gross = away > np.maximum(GROSS_DISTANCE_M, _USUAL * away[~reversed_].median())
    return np.asarray(~gross.any(axis=1))


FAULT = Fault("label_swap", lambda asked: _labels(asked.case), in_files=True)

CHAIN = Fault("label_swap", lambda asked: _chain_labels(asked.case), in_files=True)
