"""What campaign.toml sets aside on purpose: a group, a target, a pose, a pull or a row.

It leaves the campaign before anything is judged, with what cannot be used without it, and counts
neither as measured nor as rejected.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from difflib import get_close_matches

import numpy as np

from pipeline.base.arrays import Bools
from pipeline.base.errors import InputError
from pipeline.readers.logs import Log
from pipeline.readers.pose_names import coded
from pipeline.reduction._index import pull_number
from pipeline.reduction._raw_readings import STRANGE, RawReadings, Rejection


@dataclass(frozen=True)
class NamedAside:
    """What was set aside by the operator.

    Attributes:
        name: As in campaign.toml.
        reason: In the words of campaign.toml.
        readings: Number of readings, with those that cannot be used without them.
    """

    name: str
    reason: str
    readings: int


_POSE = re.compile(r"pose (?P<pose>\w+)(?: (?:pull|repeat) (?P<repeat>[0-9]{1,9}))?", re.IGNORECASE)


def kept(
    shots: RawReadings,
    logs: Sequence[Log],
    stated: Mapping[str, str],
    own: Mapping[int, int],
    width: int,
) -> tuple[RawReadings, list[Log], tuple[NamedAside, ...]]:
    """Readings and rows of the logs without what is set aside.

    Args:
        shots: All readings.
        logs: Logs of loads and joints.
        stated: Reason for each name.
        own: Numbers of poses with letters, by their code.
        width: Number of roles; the last two are the ends of the chain.

    Raises:
        InputError: Nothing has one of the names.
    """
    out = []
    for name, reason in stated.items():
        left, fewer = _without(shots, logs, name, own, width)
        gone = len(shots) - len(left)
        if left.rejected == shots.rejected and not gone and fewer == [*logs]:
            raise _nothing_called(name, shots)
        out.append(NamedAside(name, reason, gone))
        shots, logs = left, fewer
    return shots, [*logs], tuple(out)


def _without(
    shots: RawReadings, logs: Sequence[Log], name: str, own: Mapping[int, int], width: int
) -> tuple[RawReadings, list[Log]]:
    pose, repeat = _pull(name, logs, own)
    mine = _named(shots, name) if pose is None else _of_pull(shots, pose, repeat)
    out = mine | _useless(shots, mine, width)
    there, left = _states(shots, out), _states(shots, ~out)
    pulls: set[tuple[int | None, int | None]] = {(pose, repeat)}
    pulls |= {(p, r) for p, r, loaded in there - left if loaded}
    poses: set[int | None] = {pose} if repeat is None else set()
    poses |= {p for p, *_ in there} - {p for p, *_ in left}
    bare = {p for p, _ in pulls} - {p for p, _, loaded in left if loaded}
    fewer = [_fewer(log, name, pulls, poses, bare) for log in logs]
    return replace(shots.kept(~out), rejected=_others(shots.rejected, name)), fewer


def _pull(name: str, logs: Sequence[Log], own: Mapping[int, int]) -> tuple[int | None, int | None]:
    """Pose and pull called `pose 4bis`, `pose 7 pull 2`, or by a row of a log; None if neither."""
    if found := _POSE.fullmatch(name):
        word, repeat = found["pose"], found["repeat"]
        pose = int(word) if word.isdecimal() else own.get(coded(word) or -1, -1)
        return pose, int(repeat) if repeat else None
    for log in logs:
        for k in np.flatnonzero([f"{log.file}:{line}" == name for line in log.line])[:1]:
            repeat = log.number["repeat"][k] if "force" in log.number else None
            return int(log.number["pose"][k]), None if repeat is None else int(repeat)
    return None, None


def _states(shots: RawReadings, rows: Bools) -> set[tuple[int, int, bool]]:
    """Pose, pull and whether it is loaded, of the states of some readings."""
    slots = np.unique(shots.slot[rows & (shots.slot >= 0)])
    of = (shots.pose[slots], shots.repeat[slots], shots.loaded[slots])
    return {*zip(*(each.tolist() for each in of), strict=True)}


def _of_pull(shots: RawReadings, pose: int | None, repeat: int | None) -> Bools:
    slots = (shots.pose == pose) & ((repeat is None) | ((shots.repeat == repeat) & shots.loaded))
    return np.asarray(np.append(slots, False)[shots.slot])  # index -1, a base reading: the last


def _named(shots: RawReadings, name: str) -> Bools:
    """Readings of a group, a target, `group/target` or `file:line`, shape (n,)."""
    group, target = (
        np.array(one.dictionary.to_pylist() or [""], object)[np.asarray(one.indices)]
        for one in (shots.group, shots.target)
    )
    out = (group == name) | (target == name)
    for cut in [k for k, letter in enumerate(name) if letter == "/"]:
        out |= (group == name[:cut]) & (target == name[cut + 1 :])
    file, _, line = name.rpartition(":")
    if line.isdecimal() and file in shots.files:
        out |= (shots.file == shots.files.index(file)) & (shots.line == int(line))
    return np.asarray(out)


def _useless(shots: RawReadings, mine: Bools, width: int) -> Bools:
    """Readings of pulls that some readings leave without zero, targets or chain, shape (n,)."""
    loaded: Bools = np.asarray(np.append(shots.loaded, False)[shots.slot])
    zero = (shots.slot >= 0) & ~loaded
    target = pull_number(np.append(shots.pose, -1)[shots.slot], shots.role - STRANGE)
    at_end = shots.role >= width - 2
    lost = loaded & np.isin(target, target[mine & zero]) & ~np.isin(target, target[~mine & zero])
    whole = loaded & np.isin(shots.slot, shots.slot[mine & loaded & at_end])
    some = shots.slot[loaded & ~at_end & ~lost & ~mine]
    whole |= np.isin(shots.slot, shots.slot[lost | mine]) & loaded & ~np.isin(shots.slot, some)
    return np.asarray(lost | whole)


def _fewer(
    log: Log,
    name: str,
    pulls: Set[tuple[int | None, int | None]],
    poses: Set[int | None],
    bare: Set[int | None],
) -> Log:
    """A log without rows of some pulls and poses, and without the rejected row `file:line`.

    Rejected rows go with a pose, and of a log of loads with poses that are left without a pull.
    """
    of_loads = "force" in log.number
    repeat = log.number.get("repeat", np.full(len(log.line), -1))
    rows = zip(log.number["pose"], repeat, strict=True)
    out = np.array([p in poses or (of_loads and (p, r) in pulls) for p, r in rows], dtype=bool)
    gone = poses | bare if of_loads else poses
    rejected = tuple(
        one for one in _others(log.rejected, name) if log.pose_of.get(one[1] or 0) not in gone
    )
    same = not out.any() and len(rejected) == len(log.rejected)
    return log if same else replace(log.kept(~out), rejected=rejected)


def _others(rejected: Sequence[Rejection], name: str) -> tuple[Rejection, ...]:
    return tuple(one for one in rejected if f"{one[0]}:{one[1]}" != name)


def _nothing_called(name: str, shots: RawReadings) -> InputError:
    names = (shots.group.dictionary, shots.target.dictionary)
    known = [str(one) for each in names for one in each.to_pylist()]
    near = get_close_matches(name, known, 1)
    return InputError(
        f'[set_aside] names "{name}", and no group, target, pose or row is called so',
        f"is it {near[0]}?"
        if near
        else "write a group, a target, group/target, pose 7, pose 7 "
        "pull 2 or file:line, or remove the line",
        file="campaign.toml",
        key=["set_aside", name],
    )
