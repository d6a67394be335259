"""Which pulls are complete: loaded reflectors, their zero, the chain, the load and the joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Bools, Ints, Locked
from pipeline.readers.logs import Log
from pipeline.reduction._index import found, numbered, pull_number
from pipeline.reduction._raw_readings import RawReadings
from pipeline.reduction.settings import Settings


@dataclass(frozen=True, eq=False)
class _States(Locked):
    """What was read of each slot.

    Attributes:
        present: Whether each measured and chain target was read, shape (s, t + 2).
        zero: Whether each measured target was read unloaded in the pose of the slot, shape (s, t).
        joints: Whether the pose has joint values, shape (s,).
        load: Row of the load log, -1 where there is none, shape (s,).
        chain: Whether a chain loads it; assumed where its load is missing and other rows have a
            force, (s,).
        apart: Whether the ends of the chain are not in one place, shape (s,).
    """

    present: Bools
    zero: Bools
    joints: Bools
    load: Ints
    chain: Bools
    apart: Bools


_ONE_PLACE_M = 1e-6
"""Maximum distance of the ends of a chain that are one reading entered twice [m]; even a chain of a
metre in a wrong unit is longer."""


def complete(
    shots: RawReadings, settings: Settings, loads: Log, joints: Log
) -> tuple[RawReadings, Log]:
    """Readings and loads without those that have no counterpart, and only those."""
    states = _states(shots, len(settings.measured), loads, joints)
    why = _why_not(shots, settings, states, loads.file, joints.file)
    dropped = np.zeros(len(shots.pose), dtype=bool)
    dropped[list(why)] = True
    out = np.append(dropped, False)[shots.slot]  # index -1, a base reading, takes the last
    lost = {k: why[int(shots.slot[k])] for k in np.flatnonzero(out).tolist()}
    for k in np.flatnonzero(_without_zero(shots, states) & ~out).tolist():
        name, pose = shots.target[k].as_py(), shots.pose[shots.slot[k]]
        lost[k] = f"{name} was not read unloaded in pose {pose}; measure its zero"
    return shots.without(lost), _loads(states, dropped, why, loads)


def _states(shots: RawReadings, t: int, loads: Log, joints: Log) -> _States:
    present = np.asfortranarray(shots.counted(t + 2) > 0)  # read by column
    poses, of = numbered(shots.pose)
    zero = np.zeros((len(poses), t), dtype=bool)
    for k in range(t):
        zero[of[~shots.loaded & present[:, k]], k] = True
    logged = (loads.number[name].astype(np.int64) for name in ("pose", "repeat"))
    load = found(pull_number(*logged), pull_number(shots.pose, shots.repeat))
    pulled = ~np.isnan(loads.number["force"])
    return _States(
        present=present,
        zero=np.asfortranarray(zero[of]),
        joints=np.isin(poses, joints.number["pose"])[of],
        load=np.where(shots.loaded, load, -1),
        chain=shots.loaded & np.append(pulled, pulled.any())[load],
        apart=_apart(shots, t),
    )


def _apart(shots: RawReadings, t: int) -> Bools:
    """Whether the two ends of the chain, roles t and t + 1, are not in one place, shape (s,)."""
    ends = np.full((2, len(shots.pose), 3), np.nan)
    for k in (0, 1):
        rows = np.flatnonzero((shots.role == t + k) & (shots.slot >= 0))
        ends[k, shots.slot[rows]] = shots.position[rows]
    return ~(np.abs(ends[1] - ends[0]).max(axis=1) <= _ONE_PLACE_M)


def _why_not(
    shots: RawReadings, settings: Settings, states: _States, load_file: str, joint_file: str
) -> dict[int, str]:
    """Slots that cannot be used, and why."""
    t = len(settings.measured)
    read = states.present.any(axis=1)
    usable = (states.present[:, :t] & states.zero).any(axis=1)
    chain = states.present[:, t:].all(axis=1)
    loaded = shots.loaded
    why: dict[int, str] = {}

    def because(which: Bools, text: str, repeat: bool = True) -> None:
        for k in np.flatnonzero(which & read).tolist():
            pull = f" repeat {shots.repeat[k]}" if repeat else ""
            why.setdefault(k, f"pose {shots.pose[k]}{pull} has no {text}")

    because(~states.joints, f"row in {joint_file}; add its joint values", repeat=False)
    because(
        loaded & ~states.zero.any(axis=1),
        "unloaded reading; measure its zero or correct its group",
        repeat=False,
    )
    for k, name in enumerate(settings.naming.chain):
        because(
            states.chain & ~chain & ~states.present[:, t + k],
            f"loaded reading of {name}, so the direction of the pull is unknown; measure it",
        )
    ends = " and ".join(settings.naming.chain)
    because(states.chain & ~states.apart, f"distance between {ends}; measure them again")
    because(loaded & (states.load < 0), f"force in {load_file}; add the row")
    because(loaded & ~usable, "target read both unloaded and loaded; measure it")
    return why


def _without_zero(shots: RawReadings, states: _States) -> Bools:
    """Loaded readings of a target whose zero is missing."""
    t = states.zero.shape[1]
    if not (states.present[:, :t] & ~states.zero)[shots.loaded].any():
        return np.zeros(len(shots), dtype=bool)
    out: Bools = (shots.slot >= 0) & (shots.role >= 0) & (shots.role < t)
    slot, role = shots.slot[out], shots.role[out]
    out[out] = shots.loaded[slot] & ~states.zero[slot, role]
    return out


def _loads(states: _States, dropped: Bools, why: dict[int, str], loads: Log) -> Log:
    """Rows of the load log with a usable pull."""
    kept = np.zeros(len(loads.line), dtype=bool)
    read = states.present.any(axis=1) & (states.load >= 0)
    kept[states.load[read & ~dropped]] = True
    reason = {int(states.load[s]): why[s] for s in np.flatnonzero(read & dropped).tolist()}
    unread = "has no usable loaded tracker reading; measure it or remove the row"
    pull = zip(loads.number["pose"], loads.number["repeat"], strict=True)
    each = [f"pose {pose:.0f} repeat {repeat:.0f} {unread}" for pose, repeat in pull]
    return loads.without({k: reason.get(k, each[k]) for k in np.flatnonzero(~kept).tolist()})
