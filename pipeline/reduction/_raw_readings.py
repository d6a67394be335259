"""All tracker readings of a campaign as arrays: what each is, and which are left out and why."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.base import doors, patterns
from pipeline.base.arrays import Array, Bools, Ints, Locked, sifted
from pipeline.base.errors import InputError, listed
from pipeline.base.threads import WORTH_A_THREAD, spread
from pipeline.readers import Export
from pipeline.readers._log_table import NUMBER_LIMIT
from pipeline.readers._text import shortened
from pipeline.readers.logs import GroupState, group_name
from pipeline.readers.pose_names import coded
from pipeline.reduction._index import numbered
from pipeline.reduction.settings import Naming, Settings

BASE, STRANGE = -1, -2
"""Roles of a target other than 0..t-1: a base reflector, and an unknown name."""

Rejection = tuple[str, int | None, str]

_OF_EACH = ("file", "line", "group", "target", "position", "covariance", "time", "role", "slot")
"""Attributes of `RawReadings` with one row per reading."""


@dataclass(frozen=True, eq=False)
class RawReadings(Locked):
    """Readings of all files, in their order.

    Attributes:
        files: Names of the files.
        file: Index into `files`, shape (n,).
        line: Line in the file, shape (n,).
        group: Names, dictionary of strings, length n.
        target: Names, dictionary of strings, length n.
        position: Frame of the export [m], shape (n, 3).
        covariance: As the file states it, six numbers [m^2], NaN where it has none, shape (n, 6);
            or None.
        time: Timestamps, length n.
        role: Index into the measured and chain targets of `Settings.naming`, or BASE, or STRANGE,
            shape (n,).
        slot: Index into pose, repeat, loaded of the state read, -1 for base readings, shape (n,).
        pose: Pose of each slot, shape (s,).
        repeat: Pull of each slot, shape (s,).
        loaded: Whether a slot is a loaded state, shape (s,).
        rejected: Readings that were left out, with the reason.
    """

    files: tuple[str, ...]
    file: Ints
    line: Ints
    group: pa.DictionaryArray
    target: pa.DictionaryArray
    position: Array
    covariance: Array | None
    time: pa.TimestampArray
    role: Ints
    slot: Ints
    pose: Ints
    repeat: Ints
    loaded: Bools
    rejected: tuple[Rejection, ...]

    def __len__(self) -> int:
        """Number of readings."""
        return len(self.line)

    def without(self, why: Mapping[int, str]) -> RawReadings:
        """Reject some readings, each for its reason."""
        if not why:
            return self
        good = np.ones(len(self), dtype=bool)
        good[list(why)] = False
        left_out = tuple(self.rejection(k, why[k]) for k in sorted(why))
        return replace(self.kept(good), rejected=self.rejected + left_out)

    def kept(self, good: Bools) -> RawReadings:
        """Keep some of the readings; the others are dropped without being reported."""
        return replace(self, **sifted({name: getattr(self, name) for name in _OF_EACH}, good))

    def without_poses(self, why: Mapping[int, str]) -> RawReadings:
        """Reject the readings of some poses, each for the reason of its pose."""
        of = np.append(self.pose, -1)[self.slot]  # index -1, a base reading, takes the last
        rows = np.flatnonzero(np.isin(of, [*why])).tolist()
        return self.without({k: why[int(of[k])] for k in rows})

    def counted(self, width: int) -> Ints:
        """Number of readings of each target with a role in each slot, shape (s, width)."""
        place = (self.slot + 1) * (width + 1) + self.role + 1  # base readings come first
        shape = len(self.pose) + 1, width + 1
        return np.bincount(place, minlength=shape[0] * shape[1]).reshape(shape)[1:, 1:]

    def named(self, slot: int) -> str:
        """Text for a slot in a message."""
        state = "loaded" if self.loaded[slot] else "unloaded"
        return f"pose {self.pose[slot]} repeat {self.repeat[slot]} {state}"

    def place(self, k: int) -> str:
        """File and line of a reading."""
        return f"{self.files[self.file[k]]}:{self.line[k]}"

    def rejection(self, k: int, reason: str) -> Rejection:
        """File, line and reason of a rejected reading."""
        return self.files[self.file[k]], int(self.line[k]), reason


def gather(
    exports: Mapping[str, Export],
    settings: Settings,
    states: Mapping[str, GroupState] | None = None,
    letters: Set[str] = frozenset(),
) -> RawReadings:
    """Combine the readings of all files and look up what they are.

    Args:
        exports: By name.
        settings: campaign.toml.
        states: State of groups by name, which takes precedence over the name itself.
        letters: Letters that a log has behind numbers of poses, `bis`.
    """
    group = _joined([_called(export.group, file) for file, export in exports.items()])
    target = _joined([export.target for export in exports.values()])
    slot_of_group, pose, repeat, loaded = _slots(
        group.dictionary, settings.naming, states or {}, letters
    )
    role = _roles(target.dictionary.to_pylist(), settings)[np.asarray(target.indices)]
    slot = slot_of_group[np.asarray(group.indices)]
    slot[role == BASE] = -1
    sizes = [len(export.line) for export in exports.values()]
    return RawReadings(
        files=tuple(exports),
        file=_stacked(
            [np.full(size, k) if k else np.zeros(size, int) for k, size in enumerate(sizes)]
        ),
        line=_stacked([export.line for export in exports.values()]),
        group=group,
        target=target,
        position=_stacked([export.position for export in exports.values()]),
        covariance=_covariances(list(exports.values())),
        time=pa.chunked_array([export.time for export in exports.values()]).combine_chunks(),
        role=role,
        slot=slot,
        pose=pose,
        repeat=repeat,
        loaded=loaded,
        rejected=unread(exports),
    )


def unused(everything: RawReadings, used: RawReadings) -> tuple[str, ...]:
    """Groups none of whose readings is used, in their order."""
    there, left = (pc.unique(one.group.cast(pa.string())) for one in (everything, used))
    return tuple(there.filter(pc.invert(pc.is_in(there, left))).to_pylist())


@dataclass(frozen=True)
class UnusedReadings:
    """Readings of known targets that are not used.

    Attributes:
        readings: Their number.
        of: Number of all.
        poses: Poses of which no pull is left.
        absent: Targets to be measured of which there is no reading.
    """

    readings: int = 0
    of: int = 0
    poses: tuple[int, ...] = ()
    absent: tuple[str, ...] = ()


NONE_LOST = UnusedReadings()


def lost(given: RawReadings, used: RawReadings, measured: Sequence[str]) -> UnusedReadings:
    """What is lost between two stages, of the targets to be measured."""
    there, left = (
        {*one.pose[slots[one.loaded[slots]]].tolist()}
        for one, slots in ((each, each.slot[each.slot >= 0]) for each in (given, used))
    )
    absent = tuple(name for k, name in enumerate(measured) if not (used.role == k).any())
    return UnusedReadings(len(given) - len(used), len(given), tuple(sorted(there - left)), absent)


def unread(exports: Mapping[str, Export]) -> tuple[Rejection, ...]:
    """Rows of all files that could not be read."""
    return tuple((file, line, why) for file, e in exports.items() for line, why in e.rejected)


def _called(group: pa.DictionaryArray, file: str) -> pa.DictionaryArray:
    """Groups of an export, where readings without one have the name of the file."""
    names = group.dictionary
    if not pc.any(pc.equal(names, "")).as_py():
        return group
    named = pc.if_else(pc.equal(names, ""), file, names)
    return pa.DictionaryArray.from_arrays(group.indices, named)


def _joined(parts: Sequence[pa.DictionaryArray]) -> pa.DictionaryArray:
    return pa.chunked_array(parts).unify_dictionaries().combine_chunks()


def _stacked(parts: Sequence[Any]) -> Any:
    """Arrays concatenated; a single one is not copied, which matters for a million rows."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _covariances(exports: Sequence[Export]) -> Array | None:
    if all(export.covariance is None for export in exports):
        return None
    return np.concatenate(
        [
            np.full((len(e.line), 6), np.nan) if e.covariance is None else e.covariance
            for e in exports
        ]
    )


def _slots(
    names: pa.StringArray, naming: Naming, states: Mapping[str, GroupState], letters: Set[str]
) -> tuple[Ints, Ints, Ints, Bools]:
    """Slot of each group name, -1 where it has none, and pose, repeat, loaded of the slots."""
    keys = np.full((3, len(names)), -1, dtype=np.int64)
    rest = np.arange(len(names))
    if states:
        every = [states.get(group_name(name)) for name in names.to_pylist()]
        items = [one[:3] for one in every if one is not None]
        stated = np.array([one is not None for one in every], dtype=bool)
        keys[:, stated] = np.array(items, dtype=np.int64).reshape(-1, 3).T
        names, rest = names.filter(pa.array(~stated)), rest[~stated]
    half = len(names) // 2
    parts = pa.chunked_array(
        spread(
            lambda part: patterns.parts(part, naming.group),
            [names[:half], names[half:]],
            half > WORTH_A_THREAD // 2,
        )
    ).combine_chunks()
    keys[:, rest[np.asarray(parts.is_valid())]] = _keys(names, parts, naming, letters)
    pose, repeat, loaded = keys[:, matched := keys[0] >= 0]
    # pack pose, repeat and state into one number: pose and repeat are below 2^31
    packed, member = numbered(pose * 2**32 + repeat * 2 + loaded)
    slot = np.full(keys.shape[1], -1, dtype=np.int64)
    slot[matched] = member
    return slot, packed // 2**32, packed % 2**32 // 2, packed % 2 == 1


def _keys(names: pa.StringArray, parts: pa.StructArray, naming: Naming, letters: Set[str]) -> Ints:
    """Pose, repeat and loaded of the names that have them, shape (3, n).

    Raises:
        InputError: A name matches, but does not hold a pose, repeat and state.
    """
    found = parts.drop_null()
    named = names.filter(parts.is_valid())
    words = naming.state_of
    word = pc.index_in(pc.utf8_lower(found.field("state")), pa.array(list(words)))
    loaded = np.array([*(state == "loaded" for state in words.values()), -1], dtype=np.int64)[
        word.fill_null(-1)
    ]
    pose, repeat = _poses(named, found, letters), _whole(found, "repeat", missing=_UNNUMBERED)
    for wrong in np.flatnonzero((pose < 0) | (repeat == _NO_NUMBER) | (loaded < 0))[:1]:
        raise _no_state(str(named[wrong]), found[wrong].as_py(), words)
    return np.array([pose, _counted(pose, repeat, loaded == 1), loaded], dtype=np.int64)


_NO_NUMBER, _UNNUMBERED = -1, -2
"""Placeholders for a number: the part is not one, or the name has none."""


def _poses(names: pa.StringArray, found: pa.StructArray, words: Set[str]) -> Ints:
    """Poses of the names, shape (n,), with letters behind their number where logs have such poses.

    What was pulled in `P04bis` is then not what was pulled in `P04`, whatever the expression leaves
    out. Letters that all names have are no part of a pose.
    """
    pose = _whole(found, "pose").copy()
    for k in np.flatnonzero(pose < 0).tolist():
        pose[k] = coded(found[k]["pose"].as_py() or "") or _NO_NUMBER
    behind = {k: _letters_behind(str(names[k]), found[k].as_py(), words)
              for k in np.flatnonzero(pose >= 0).tolist() if words}  # fmt: skip
    for k, own in behind.items() if len({*behind.values()}) > 1 else ():
        pose[k] = coded(f"{pose[k]}{own}") or _NO_NUMBER if own else pose[k]
    return pose


def _letters_behind(name: str, parts: Mapping[str, str], words: Set[str]) -> str:
    """Letters right behind the number of the pose in a name, or some of these words after a gap.

    Its state is none.
    """
    found = re.search(rf"(?<![0-9]){re.escape(parts['pose'])}([ _-]?)([^\W\d_]+)", name)
    state = parts["state"] or ""
    if found is None or (state and found[2].startswith(state)):
        return ""
    letters = found[2].removesuffix(state)
    return letters if not found[1] or letters.lower() in words else ""


def _whole(found: pa.StructArray, part: str, missing: int = _NO_NUMBER) -> Ints:
    """A part of names as whole numbers below BEYOND, shape (n,)."""
    if part not in found.type.names:
        return np.full(len(found), missing)
    try:
        plain = found.field(part).cast(pa.int64()).to_numpy()
        if plain.min(initial=0) >= 0 and plain.max(initial=0) < NUMBER_LIMIT:
            return np.asarray(plain)
    except pa.ArrowInvalid:
        pass  # some name lacks it or has text instead: find out which
    cells = pc.utf8_trim_whitespace(found.field(part))
    there = np.asarray(pc.greater(pc.binary_length(cells), 0))
    short = pc.match_substring_regex(cells, r"^[0-9]{1,18}$")
    values = pc.if_else(short, cells, str(_NO_NUMBER)).cast(pa.int64()).to_numpy()
    return np.where(there, np.where(values < NUMBER_LIMIT, values, _NO_NUMBER), missing)


def _counted(pose: Ints, repeat: Ints, loaded: Bools) -> Ints:
    """Assign repeat numbers to names without one: from 0 unloaded, from 1 loaded.

    Names of a pose are counted in file order, skipping the numbers that other names of it have:
    "Last" together with "Last 2" is the first pull.
    """
    nameless = repeat == _UNNUMBERED
    out = np.where(nameless, -1, repeat)
    used = {key: set[int]() for key in zip(pose[nameless], loaded[nameless], strict=True)}
    for k in np.flatnonzero(~nameless) if used else ():
        used.get((pose[k], loaded[k]), set[int]()).add(int(repeat[k]))
    for k in np.flatnonzero(nameless):
        taken = used[pose[k], loaded[k]]
        out[k] = next(n for n in itertools.count(int(loaded[k])) if n not in taken)
        taken.add(int(out[k]))
    return out


def _no_state(name: str, parts: Mapping[str, str], stated: Mapping[str, str]) -> InputError:
    """The error for a group whose name matches but holds no pose, repeat and state."""
    read = listed(f'{part} "{shortened(text)}"' for part, text in parts.items() if part in _PARTS)
    meant, word = doors.found(_MEANT), parts.get("state", "")
    add = meant(word) if meant and word and word.lower() not in stated else ""
    return InputError(
        f'naming.group reads {read} from group "{shortened(name)}"',
        f"let it find whole numbers and one of {listed(stated)}{add}",
        file="campaign.toml",
        key=["naming", "group"],
    )


_PARTS = ("pose", "repeat", "state")

_MEANT = "pipeline.intake.meant:state"
"""Door of the intake: which state an unknown word may have been meant to be."""


def _roles(names: Sequence[str], settings: Settings) -> Ints:
    place = {name: k for k, name in enumerate([*settings.measured, *settings.naming.chain])}
    place |= dict.fromkeys(settings.base_frame, BASE)
    return np.array([place.get(name, STRANGE) for name in names], dtype=np.int64)


def known(
    shots: RawReadings, settings: Settings, states: Mapping[str, GroupState] | None = None
) -> RawReadings:
    """Keep only readings of reflectors whose use is known."""

    def strange(k: int) -> str:
        """Reason for a reading of a target that campaign.toml does not state."""
        named = f"target {shortened(shots.target[k].as_py())} is neither in naming.measured"
        return f"{named} nor in naming.chain nor in [base_frame]; add it there or rename it"

    nowhere = (
        f"{settings.loads_file} does not name the group" if states
        else "the group does not match naming.group"
    )  # fmt: skip
    lost = (
        f"{nowhere}, so it holds base reflectors only, and this target "
        f"is none of {listed(settings.base_frame)}; rename the group or the target"
    )
    unused = np.flatnonzero((shots.role == STRANGE) | ((shots.slot < 0) & (shots.role != BASE)))
    return shots.without(
        {k: strange(k) if shots.role[k] == STRANGE else lost for k in unused.tolist()}
    )


def pulled_at_rest(
    shots: RawReadings, ends: Sequence[str], states: Mapping[str, GroupState], log: str
) -> None:
    """Check that no end of a chain was read in a group that a log calls unloaded.

    Args:
        shots: Readings of known reflectors.
        ends: Names of the ends.
        states: State of groups according to the log.
        log: Its name.

    Raises:
        InputError: One was: a force is missing there, and a pull would be taken for a zero.
    """
    entries = {name: states.get(group_name(name)) for name in shots.group.dictionary.to_pylist()}
    at_rest = pa.array(
        [name for name, one in entries.items() if one and not one.loaded], pa.string()
    )
    chain, rest = (
        pc.is_in(names.cast(pa.string()), among)
        for names, among in (
            (shots.target, pa.array(ends, pa.string())), (shots.group, at_rest)
        )
    )  # fmt: skip
    for k in np.flatnonzero(np.asarray(pc.and_(chain, rest)))[:1]:
        group, end = shots.group[k].as_py(), shots.target[k].as_py()
        raise InputError(
            f"group {shortened(group)} has no force here, and {end} was read in it "
            f"({shots.place(int(k))}), as in a pull only",
            "fill in the force, or correct the group",
            file=log,
            line=states[group_name(group)].line,
        )


@dataclass(frozen=True)
class ExchangedNames:
    """An unloaded and a loaded group of one pose that have each other's name.

    Attributes:
        pose: Their pose.
        groups: Their names, that of the unloaded one first.
        at: Where their readings stand, `file:line`.
    """

    pose: int
    groups: tuple[str, str]
    at: tuple[str, ...]


def with_own_names(
    shots: RawReadings, width: int
) -> tuple[RawReadings, tuple[ExchangedNames, ...]]:
    """Give unloaded and loaded groups their own names where only the unloaded one has a chain.

    Nothing is exchanged in a campaign that reads the chain unloaded in other poses, too.

    Args:
        shots: Readings of known reflectors.
        width: Number of roles; the last two are the ends of the chain.
    """
    pairs = _pairs(shots, width)
    if not pairs:
        return shots, ()
    slot, names, found = shots.slot.copy(), np.array(shots.group.indices), list[ExchangedNames]()
    for pair in pairs:
        rows = [np.flatnonzero(shots.slot == one) for one in pair]
        own = [names[each[0]] for each in rows]
        for each, one, name in zip(rows, pair[::-1], own[::-1], strict=True):
            slot[each], names[each] = one, name
        groups = tuple(str(shots.group.dictionary[int(k)]) for k in own)
        at = tuple(shots.place(k) for k in np.concatenate(rows).tolist())
        found.append(ExchangedNames(int(shots.pose[pair[0]]), (groups[0], groups[1]), at))
    group = pa.DictionaryArray.from_arrays(pa.array(names), shots.group.dictionary)
    return replace(shots, slot=slot, group=group), tuple(found)


def _pairs(shots: RawReadings, width: int) -> list[tuple[int, int]]:
    """States with a chain but no pull, each with the only pull of its pose without a chain.

    There are none unless each of the former has a pull of its own.
    """
    ends = shots.counted(width)[:, -2:] > 0
    bare = shots.loaded & (shots.counted(width) > 0).any(axis=1) & ~ends.any(axis=1)
    taut = ~shots.loaded & ends.all(axis=1)
    pairs = [
        (int(zero), int(pulls[0]))
        for zero in np.flatnonzero(taut)
        if len(pulls := np.flatnonzero(bare & (shots.pose == shots.pose[zero]))) == 1
    ]
    return pairs if len({pull for _, pull in pairs}) == taut.sum() else []


def in_rounds(shots: RawReadings, width: int) -> RawReadings:
    """Split unloaded readings before and after the pulls of a pose into states of their own.

    They may share one name. Another round begins where a target is read again after a reading of
    another state, of whatever pose, in order of time, or of rows where a reading of the pose has no
    time. An exact repetition of a reading is a copy, not another round.

    Args:
        shots: Readings of known reflectors.
        width: Number of roles.
    """
    slot, pose, repeat = shots.slot.copy(), [*shots.pose], [*shots.repeat]
    zeros = np.flatnonzero((shots.counted(width) > 1).any(axis=1) & ~shots.loaded).tolist()
    by_time, by_row = _sittings(shots) if zeros else (slot, slot)
    for zero in zeros:
        in_pose = np.isin(shots.slot, np.flatnonzero(shots.pose == shots.pose[zero]))
        sitting = by_time if (by_time[in_pose] >= 0).all() else by_row
        rows = np.flatnonzero(shots.slot == zero)
        rows = rows[np.argsort(sitting[rows], kind="stable")]
        round_ = _rounds(sitting[rows], shots.role[rows])
        if round_.max(initial=0) == 0 or _copied(shots, rows):
            continue
        for number in range(1, int(round_.max()) + 1):
            slot[rows[round_ == number]] = len(pose)
            repeat.append(1 + max(r for r, p in zip(repeat, pose, strict=True) if p == pose[zero]))
            pose.append(pose[zero])
    more = len(pose) - len(shots.pose)
    return replace(
        shots,
        slot=slot,
        pose=np.array(pose, dtype=shots.pose.dtype),
        repeat=np.array(repeat, dtype=shots.repeat.dtype),
        loaded=np.append(shots.loaded, np.zeros(more, dtype=bool)),
    )


def _sittings(shots: RawReadings) -> tuple[Ints, Ints]:
    """Run of readings of one state that each is in, by time (-1 without) and by row, (n,) each."""
    begins = np.diff(shots.slot, prepend=-2) != 0
    timed = np.flatnonzero(np.asarray(shots.time.is_valid()))
    order = timed[np.argsort(shots.time.take(pa.array(timed)).cast(pa.int64()), kind="stable")]
    by_time = np.full(len(shots), -1)
    by_time[order] = np.cumsum(np.diff(shots.slot[order], prepend=-2) != 0)
    return by_time, np.cumsum(begins)


def _rounds(sitting: Ints, role: Ints) -> Ints:
    """Round of each reading of a state: another one begins with a sitting that reads one again."""
    out, read, number = np.zeros(len(role), dtype=np.int64), set[int](), 0
    for one in np.unique(sitting):
        mine = sitting == one
        if not read.isdisjoint(role[mine].tolist()):
            number, read = number + 1, set()
        read |= {*role[mine].tolist()}
        out[mine] = number
    return out


def _copied(shots: RawReadings, rows: Ints) -> bool:
    """Whether a reading occurs twice to the last digit."""
    each = np.column_stack([shots.role[rows], shots.position[rows]])
    return len(np.unique(each, axis=0)) < len(rows)


def once(shots: RawReadings, width: int) -> RawReadings:
    """Reject repeated readings: of equal ones all but the first, of contradicting ones all.

    Base reflectors may be read any number of times; only true copies are dropped there.

    Args:
        width: Number of roles.
    """
    why: dict[int, str] = {}
    for rows in _same(shots, width):
        first, *more = rows
        equal = all((shots.position[k] == shots.position[first]).all() for k in more)
        for k in more if equal else rows if more else ():
            other = shots.place(first if k != first else more[0])
            why[k] = (
                f"repeats {other}; remove one of them"
                if equal
                else f"contradicts {other}, the same target in the same state; keep the right one"
            )
    return shots.without(why)


def _same(shots: RawReadings, width: int) -> list[list[int]]:
    """Readings of one target in one state, of all that may occur more than once."""
    same: dict[tuple[object, ...], list[int]] = {}
    for k in np.flatnonzero(_repeated(shots, width)).tolist():
        same.setdefault(_identity(shots, k), []).append(k)
    return list(same.values())


@dataclass(frozen=True)
class Contradiction:
    """Readings of one target in one state that differ, so that none of them is used.

    Attributes:
        pose: Its pose.
        group: Its group.
        target: Its target.
        at: Where they stand, `file:line`.
        apart_m: How far apart the farthest of them are from the first [m].
    """

    pose: int
    group: str
    target: str
    at: tuple[str, ...]
    apart_m: float


def contradictions(shots: RawReadings, width: int) -> tuple[Contradiction, ...]:
    """All of them that `once` leaves out."""
    found = []
    for first, *more in _same(shots, width):
        apart = np.linalg.norm(shots.position[more] - shots.position[first], axis=1)
        if shots.slot[first] >= 0 and apart.any():
            pose = int(shots.pose[shots.slot[first]])
            group, target = str(shots.group[first].as_py()), str(shots.target[first].as_py())
            at = tuple(shots.place(k) for k in (first, *more))
            found.append(Contradiction(pose, group, target, at, float(apart.max())))
    return tuple(found)


@dataclass(frozen=True)
class RepeatedReading:
    """A reading that repeats the previous one to the last digit: it was not measured again.

    Attributes:
        group: Its group.
        target: Its target.
        file: Its file.
        line: Its line there.
        of: Target of the previous reading.
    """

    group: str
    target: str
    file: str
    line: int
    of: str


def stale(shots: RawReadings) -> tuple[RepeatedReading, ...]:
    """Readings of a state that repeat the previous row, of another target of that state."""
    same = (shots.position[1:] == shots.position[:-1]).all(axis=1)
    same &= (shots.slot[1:] == shots.slot[:-1]) & (shots.slot[1:] >= 0)
    same &= (shots.role[1:] != shots.role[:-1]) & (shots.file[1:] == shots.file[:-1])
    found = []
    for k in (np.flatnonzero(same) + 1).tolist():
        group, target, of = shots.group[k], shots.target[k], shots.target[k - 1]
        found.append(
            RepeatedReading(
                group=str(group.as_py()),
                target=str(target.as_py()),
                file=shots.files[shots.file[k]],
                line=int(shots.line[k]),
                of=str(of.as_py()),
            )
        )
    return tuple(found)


def weighed(shots: RawReadings, stated: bool) -> RawReadings:
    """Keep only target and chain readings that have a covariance, if any of them has one.

    This settles for all later stages whether the noise is known: for every reading or for none.

    Args:
        stated: Whether campaign.toml gives a noise for those that have none of their own.
    """
    if stated or shots.covariance is None:
        return shots
    ours = shots.role >= 0
    own = np.isfinite(shots.covariance).all(axis=1)
    if not (ours & own).any():
        return shots
    reason = (
        "this reading has no uncertainty, as others have; export it or state sigma_m in [tracker]"
    )
    return shots.without(dict.fromkeys(np.flatnonzero(ours & ~own).tolist(), reason))


def _repeated(shots: RawReadings, width: int) -> Bools:
    """Readings that may occur more than once, shape (n,)."""
    twice = shots.counted(width) > 1
    out = np.zeros(len(shots), dtype=bool)
    if twice.any():
        state = shots.slot >= 0
        out[state] = twice[shots.slot[state], shots.role[state]]
    base = np.flatnonzero(shots.slot < 0)
    same = {
        **{f"{axis}": shots.position[base, axis] for axis in range(3)},
        "target": np.asarray(shots.target.indices)[base],
        "group": np.asarray(shots.group.indices)[base],
        "time": shots.time.cast(pa.int64()).fill_null(-1).to_numpy()[base],
    }
    out[base] = pd.DataFrame(same).duplicated(keep=False).to_numpy()
    return out


def _identity(shots: RawReadings, k: int) -> tuple[object, ...]:
    if shots.slot[k] >= 0:
        return int(shots.slot[k]), int(shots.role[k])
    x, y, z = shots.position[k]
    return shots.target[k].as_py(), shots.group[k].as_py(), shots.time[k].as_py(), x, y, z
