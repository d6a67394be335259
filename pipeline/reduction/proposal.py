"""What the files of a new campaign say themselves: which is which, names, states, units.

Nothing is made up: what only a person knows (places of reflectors, uncertainties, a unit that no
file states) stays open.
"""

from __future__ import annotations

import contextlib
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from typing import Any, Literal

import numpy as np
import pyarrow as pa

from pipeline import readers
from pipeline.base import patterns
from pipeline.base.arrays import Array
from pipeline.base.errors import InputError
from pipeline.machine.robot import SHIPPED, Robot, load
from pipeline.machine.robot.mdh import parse as parse_robot
from pipeline.readers import Export, Hints, logs
from pipeline.readers._log_form import OURS, LogForm
from pipeline.readers._names import separators, split
from pipeline.readers._text import is_workbook
from pipeline.readers.logs import Log
from pipeline.readers.offer import Offer, offer
from pipeline.reduction import limits
from pipeline.reduction.settings import Naming

_STATES = ("unloaded", "loaded")
_TOKEN = re.compile(r"[0-9]+|[^\W\d_]+|[\W_]+")
"""A number, a word, or what stands between them."""
_UNIT = Hints(unit="mm")
_LOOKED_AT = 100_000
"""Readings of an export from which names are understood: they repeat from pose to pose."""
_SHOWN = 8
"""Group names that are given on; their form shows in fewer."""


@dataclass(frozen=True)
class Group:
    """How group names are read.

    Attributes:
        pattern: Regular expression with the parts pose, state and, where there is one, repeat.
        states: The words of the states as they stand in the names: that of the unloaded one, and
            those of loaded ones, as on the way up and down.
    """

    pattern: str
    states: tuple[str, ...] = _STATES

    @property
    def state_of(self) -> dict[str, str]:
        """`unloaded` or `loaded` by word."""
        return {word: _STATES[k > 0] for k, word in enumerate(self.states)}


@dataclass(frozen=True)
class Proposal:
    """What the files say.

    Attributes:
        exports: Names of the tracker exports.
        reach: Largest number in an export that does not state its unit; None where all do.
        offer: What else [tracker] has to say of the export, None where nothing else is open.
        nameless: Whether an export does not say what its readings are: `names`, or only `groups`
            where it names the targets; None where it does.
        names: What [tracker] names may say of names that hold group and target in one; with
            several it is open which one.
        loads: Log of the loads, None where there is none.
        unsure: Of `force` and `mass` those in the log whose uncertainty it does not say itself.
        joints: Joint log, None where there is none.
        robots: Robots whose joints the log has; those that ship, and files in the folder.
        load_columns: Our names for the columns of the loads, by their titles; without those that
            have ours; several, with bars between them, where a title does not state its unit.
        joint_columns: The same of the joint log, by robot.
        group: How group names are read; None where nobody can tell.
        either: How they are read whichever of some words is the unloaded state; empty where that
            is known, or nobody can tell how they are read.
        groups: Group names, some of them; none where the log of the loads says what they are.
        measured: Targets read unloaded and loaded.
        chain: Both ends of the chain, the one at the effector first; empty where there is none.
        base: Reflectors in groups that are no state of a pose.
        apart_m: Distances between measured targets as read [m], by both names.
        refused: Why a file is none of these.
    """

    exports: tuple[str, ...] = ()
    reach: float | None = None
    offer: Offer | None = None
    nameless: Literal["names", "groups"] | None = None
    names: tuple[str, ...] = ()
    loads: str | None = None
    unsure: tuple[str, ...] = ("force",)
    joints: str | None = None
    robots: tuple[str, ...] = ()
    load_columns: dict[str, str] = field(default_factory=dict)
    joint_columns: dict[str, dict[str, str]] = field(default_factory=dict)
    group: Group | None = None
    either: tuple[Group, ...] = ()
    groups: tuple[str, ...] = ()
    measured: tuple[str, ...] = ()
    chain: tuple[str, ...] = ()
    base: tuple[str, ...] = ()
    apart_m: dict[tuple[str, str], float] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)


def propose(
    files: Mapping[str, bytes], hints: Hints | None = None, unloaded: str | None = None
) -> Proposal:
    """What the files of a campaign's folder say.

    Args:
        files: Content by name; TOML files are taken for robots.
        hints: What is said by now of an export that leaves more open than its unit.
        unloaded: The word of the unloaded state in group names, where they leave it open.
    """
    logged = propose_logs(files)
    known = {logged.loads, logged.joints, *logged.refused}
    others = [
        name
        for name, data in files.items()
        if not name.endswith(".toml") and (name not in known or is_workbook(data))
    ]
    exports: dict[str, Export] = {}
    refused: dict[str, str] = {}
    reach: list[float] = []
    for name in others:
        try:
            exports[name], largest = _export(name, files[name])
            reach += largest
        except InputError as problem:
            if name not in known:
                refused[name] = problem.thing
    found = None if exports else _offered({name: files[name] for name in refused}, hints)
    if found:
        name, _, exports[name], largest = found
        del refused[name]
        reach += largest
    offered = found[1] if found else None
    if more := _with_groups(files, exports, offered or hints, logged):
        offered, exports = more
    names = _separators(exports, hints)
    if len(names) == 1:
        exports = {name: split(one, names[0]) for name, one in exports.items()}
    rows = _by_group(list(exports.values()))
    told = _told(logged, files, rows or {})
    columns = logged.load_columns | (told.columns if told else {})
    return replace(
        _named(rows, told.states if told else {}, unloaded),
        nameless=_lacking(list(exports.values())),
        offer=offered,
        names=names,
        exports=tuple(exports),
        reach=max(reach, default=None),
        loads=logged.loads,
        unsure=_unsure(logged.loads, files, columns),
        joints=logged.joints,
        robots=logged.robots,
        load_columns=columns,
        joint_columns=logged.joint_columns,
        refused=logged.refused | refused,
    )


def propose_logs(files: Mapping[str, bytes]) -> Proposal:
    """Which files are the logs beside the exports; of several alike the first.

    A workbook may be both, and an export, too: on a sheet for each.

    Args:
        files: Content by name; TOML files are taken for robots.
    """
    robots = dict(_robots(files))
    said = Proposal()
    for name, data in files.items():
        if name.endswith(".toml") or not _may_be_log(name, data):
            continue
        fits = dict(_having(name, data, robots))
        form = _loads(name, data) if not fits or is_workbook(data) else None
        if fits := fits or ({} if form else dict(_by_number(name, data, robots))):
            columns = {robot: form.columns for robot, form in fits.items()}
            new = {"joints": name, "robots": tuple(fits), "joint_columns": columns}
            said = _added(said, name, new, said.joints)
        if form:
            said = _added(said, name, {"loads": name, "load_columns": form.columns}, said.loads)
    return said


def _may_be_log(name: str, data: bytes) -> bool:
    try:
        return logs.may_be_log(name, data)
    except InputError:
        return is_workbook(data)  # several of its sheets may be meant: each log looks for its own


def _added(said: Proposal, name: str, new: Mapping[str, Any], earlier: str | None) -> Proposal:
    """A proposal with a log, refused where an earlier one is of the same kind."""
    if earlier is None:
        return replace(said, **new)
    return replace(said, refused=said.refused | {name: f"{earlier} is such a log, too"})


def _robots(files: Mapping[str, bytes]) -> Iterator[tuple[str, Robot]]:
    """Robots in the folder, then those that ship."""
    for name, data in files.items():
        if name.endswith(".toml"):
            try:
                yield name, parse_robot(data.decode("utf-8", "replace"), name)
            except InputError:
                continue
    for name in SHIPPED:
        yield name, load(name)


def _having(name: str, data: bytes, robots: Mapping[str, Robot]) -> Iterator[tuple[str, LogForm]]:
    """Robots all of whose joints a log has, and what has to be said of its columns."""
    for key, robot in robots.items():
        form = _form(
            partial(logs.joints, name, data, robot),
            partial(logs.understood_joints, name, data, robot),
        )
        if form:
            yield key, _within_limits(name, data, robot, form)


def _within_limits(name: str, data: bytes, robot: Robot, form: LogForm) -> LogForm:
    """Titles that state no unit with the one that keeps all poses within the robot's limits.

    Where several do, those stay; where none does, all.
    """
    fitting = _possible(name, data, robot, form)
    said = {title: {one.columns[title] for one in fitting} for title in form.columns}
    left = {
        title: "|".join(one for one in ours.split("|") if one in said[title]) or ours
        for title, ours in form.columns.items()
    }
    return form.model_copy(update={"columns": left})


def _by_number(
    name: str, data: bytes, robots: Mapping[str, Robot]
) -> Iterator[tuple[str, LogForm]]:
    """Robots that can take every row of numbers of a log as a pose, in one order of the columns."""
    for key, robot in robots.items():
        with contextlib.suppress(InputError):
            ways = logs.numbered_joints(name, data, robot)
            fitting = [form for form in ways if _possible(name, data, robot, form)]
            if len(fitting) == 1:
                yield key, _within_limits(name, data, robot, fitting[0])


def _possible(name: str, data: bytes, robot: Robot, form: LogForm) -> list[LogForm]:
    """A log in each of the units that its titles leave open in which the robot takes all poses."""
    open_ones = {ours for ours in form.columns.values() if "|" in ours}
    units = [{one.rpartition("_")[2] for one in ours.split("|")} for ours in open_ones]
    fitting = []
    for choice in product(*sorted({tuple(sorted(some)) for some in units})):
        columns = {title: _in_one_of(ours, choice) for title, ours in form.columns.items()}
        chosen = form.model_copy(update={"columns": columns})
        with contextlib.suppress(InputError):
            if not limits.impossible(logs.joints(name, data, robot, chosen), robot):
                fitting.append(chosen)
    return fitting


def _in_one_of(ours: str, units: Sequence[str]) -> str:
    """Of several names that differ by unit the one with a unit of these."""
    return next((one for one in ours.split("|") if one.rpartition("_")[2] in units), ours)


def _loads(name: str, data: bytes) -> LogForm | None:
    """What has to be said of the columns of a log of loads, None where it is none."""
    return _form(partial(logs.loads, name, data), partial(logs.understood_loads, name, data))


def _unsure(
    name: str | None, files: Mapping[str, bytes], columns: Mapping[str, str]
) -> tuple[str, ...]:
    """What a log of loads holds and whose uncertainty only a person knows.

    A scale shows forces wherever nothing else can be read.
    """
    with contextlib.suppress(InputError):
        form = logs.settled(LogForm(columns=dict(columns)))
        log = logs.loads(name, files[name], form) if name else None
        if log is not None and len(log.line):
            given = {kind: ~np.isnan(log.number[kind]) for kind in ("force", "mass")}
            given["mass"] &= np.isnan(log.number["mass_sigma"])
            return tuple(kind for kind, rows in given.items() if rows.any())
    return ("force",)


def _form(read: Callable[[LogForm], Log], meant: Callable[[], LogForm | None]) -> LogForm | None:
    """How a log is read: as ours, else by what its titles mean; None where it is none.

    A row that cannot be read, or a decimal mark that has to be asked, makes no other file of it.
    """
    try:
        return OURS if _readable(read, OURS) else meant()
    except InputError:
        return None


def _readable(read: Callable[[LogForm], Log], form: LogForm) -> bool:
    """Whether a log can be read; one without rows is one."""
    try:
        read(form)
    except InputError as problem:
        return "nothing but a header" in problem.thing
    return True


def _export(name: str, data: bytes) -> tuple[Export, list[float]]:
    """An export, and its largest number where it does not state its unit."""
    try:
        return readers.read(name, data), []
    except InputError:
        found = readers.read(name, data, _UNIT)
        return found, [1e3 * float(np.abs(found.position).max(initial=0.0))]


def _offered(
    files: Mapping[str, bytes], hints: Hints | None
) -> tuple[str, Offer, Export, list[float]] | None:
    """The one file that is an export if something is said of it, as it is most likely read."""
    found = []
    for name, data in files.items():
        try:
            one = offer(name, data, hints or Hints())
            if one is not None:
                found.append((name, one, readers.read(name, data, one.hints)))
        except InputError:
            continue
    if len(found) != 1:
        return None
    name, one, export = found[0]
    metres = {"mm": 1e-3, "in": 0.0254}.get(str(one.hints.unit), 1.0)
    largest = float(np.abs(export.position).max(initial=0.0)) / metres
    unsaid = any(question.about == "unit" for question in one.questions)
    return name, one, export, [largest] if unsaid else []


def _with_groups(
    files: Mapping[str, bytes],
    exports: Mapping[str, Export],
    said: Offer | Hints | None,
    logged: Proposal,
) -> tuple[Offer, dict[str, Export]] | None:
    """A table with the column of its groups that the log of loads makes sense of.

    None where it is not one export that names targets and no groups, or no column is one.
    """
    if len(exports) != 1 or logged.loads is None:
        return None
    ((name, export),) = exports.items()
    if export.group is not None or export.target is None:
        return None
    with contextlib.suppress(InputError):
        one = said if isinstance(said, Offer) else offer(name, files[name], said or Hints())
        if one is None or one.hints.mapping is None:
            return None
        for title in export.unused:
            hints = _grouped_in(one.hints, title)
            tried = {name: readers.read(name, files[name], hints)}
            rows = _by_group(list(tried.values()))
            if rows and _told(logged, files, rows):
                return replace(one, hints=hints), tried
    return None


def _separators(exports: Mapping[str, Export], hints: Hints | None) -> tuple[str, ...]:
    """What [tracker] names says, or may say, of exports whose names hold group and target."""
    said = hints.names if hints else None
    return (said,) if said else tuple(separators(list(exports.values())))


def _grouped_in(hints: Hints, title: str) -> Hints:
    """What is said of a table, with the column of its groups in its mapping."""
    assert hints.mapping is not None
    columns = hints.mapping.model_dump()["columns"] | {"group": title}
    mapping = hints.mapping.model_copy(update={"columns": columns})
    return hints.model_copy(update={"mapping": mapping})


# --- names ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Told:
    """What a log of loads says of the groups.

    Attributes:
        columns: Our name for the title that names them, where it is not ours already.
        states: `unloaded` or `loaded` by group.
    """

    columns: dict[str, str]
    states: dict[str, str]


def _told(
    logged: Proposal, files: Mapping[str, bytes], rows: Mapping[str, Mapping[str, Array]]
) -> _Told | None:
    """What the log of loads says of the groups; None where it does not, or their names do.

    The column is the one under our title, or one that makes sense of what was read.
    """
    if logged.loads is None or not rows or len(_grouped(rows)) == 1:
        return None
    data = files[logged.loads]
    form = logs.settled(LogForm(columns=logged.load_columns))
    for columns in ({}, *({title: "group"} for title in logs.unknown(logged.loads, data, form))):
        tried = form.model_copy(update={"columns": form.columns | columns})
        with contextlib.suppress(InputError):
            found = logs.loads(logged.loads, data, tried).states
            alike = {name: logs.group_name(name) for name in rows}
            states = {name: _STATES[found[k].loaded] for name, k in alike.items() if k in found}
            if found.keys() <= {*alike.values()} and _makes_sense(states, rows):
                return _Told(columns, states)
    return None


def _makes_sense(states: Mapping[str, str], rows: Mapping[str, Mapping[str, Array]]) -> bool:
    """Whether groups are unloaded and loaded states, and all others something else.

    What was read unloaded was read loaded, too, and no target of theirs in any other group.
    """
    unloaded, loaded, others = (
        {target for name, at in rows.items() if states.get(name) == one for target in at}
        for one in (*_STATES, None)
    )
    return bool(unloaded) and unloaded <= loaded and loaded.isdisjoint(others)


def _named(
    rows: dict[str, dict[str, Array]] | None, told: Mapping[str, str], word: str | None
) -> Proposal:
    """What the names of groups and targets are, as far as they or a log tell.

    Args:
        rows: Where the targets of each group were read; None where an export has no names.
        told: State of each group that a log names.
        word: That of the unloaded state, where somebody says it.
    """
    if rows is None:
        return Proposal()
    ways = () if told else _grouped(rows)
    ways = tuple(one for one in ways if len(ways) == 1 or one.states[0] == word) or ways
    if not ways and not told:
        return Proposal(groups=tuple(rows)[:_SHOWN])
    state = _state_of(list(rows), ways[0]) if ways else told
    unloaded, loaded, others = (
        [at for name, at in rows.items() if state.get(name) == one] for one in (*_STATES, None)
    )
    read = _targets(unloaded)
    measured = [name for name in read if name in _targets(loaded)]
    ends = [name for name in _targets(loaded) if name not in read]
    return Proposal(
        group=ways[0] if len(ways) == 1 else None,
        either=ways if len(ways) > 1 else (),
        groups=() if told else tuple(rows)[:_SHOWN],
        measured=tuple(measured),
        chain=_chain(ends, measured, loaded),
        base=tuple(_targets(others)),
        apart_m=_apart(measured, unloaded),
    )


def _lacking(exports: Sequence[Export]) -> Literal["names", "groups"] | None:
    """What an export does not name."""
    if any(one.target is None for one in exports):
        return "names"
    return "groups" if any(one.group is None for one in exports) else None


def _by_group(exports: Sequence[Export]) -> dict[str, dict[str, Array]] | None:
    """Where the targets of each group were read; None where an export has no names."""
    rows: dict[str, dict[str, Array]] = {}
    for one in exports:
        if one.group is None or one.target is None:
            return None
        groups, targets = (
            names[:_LOOKED_AT].cast(pa.string()).to_pylist() for names in (one.group, one.target)
        )
        for group, target, at in zip(groups, targets, one.position[:_LOOKED_AT], strict=True):
            rows.setdefault(group, {})[target] = at
    return rows


def _targets(states: Sequence[Mapping[str, Array]]) -> list[str]:
    return list(dict.fromkeys(target for at in states for target in at))


def _chain(
    ends: Sequence[str], measured: Sequence[str], loaded: Sequence[Mapping[str, Array]]
) -> tuple[str, ...]:
    """Two ends, the one nearer to the effector first; none where there are not two."""
    if len(ends) != 2:
        return ()
    nearer = Counter[str]()
    for at in loaded:
        effector = [at[name] for name in measured if name in at]
        if effector and all(end in at for end in ends):
            away = [float(np.linalg.norm(at[end] - np.mean(effector, axis=0))) for end in ends]
            nearer[ends[int(np.argmin(away))]] += 1
    first = max(ends, key=lambda end: nearer[end])
    return first, next(end for end in ends if end != first)


def _apart(
    names: Sequence[str], states: Sequence[Mapping[str, Array]]
) -> dict[tuple[str, str], float]:
    """Median distances between targets over states [m]."""
    out = {}
    for k, one in enumerate(names):
        for other in names[k + 1 :]:
            seen = [np.linalg.norm(at[one] - at[other]) for at in states if {one, other} <= {*at}]
            if seen:
                out[one, other] = float(np.median(seen))
    return out


def _state_of(names: Sequence[str], group: Group) -> dict[str, str]:
    """State of each group that is one."""
    found = patterns.parts(pa.array(names, pa.string()), group.pattern).to_pylist()
    word = {said.lower(): state for said, state in group.state_of.items()}
    return {
        name: word[parts["state"].lower()]
        for name, parts in zip(names, found, strict=True)
        if parts is not None and parts["state"].lower() in word
    }


def _grouped(rows: Mapping[str, Mapping[str, Array]]) -> tuple[Group, ...]:
    """How group names are read: the usual way, or by a number and a word of a few.

    Names of one form are a number for the pose, a word for the state and perhaps a number for the
    repeat. Words whose groups have more targets are loaded: the chain's ends are read only then.
    Where as many are read in all, any word may be that of the unloaded state: a way for each.
    """
    usual = Group(Naming().group)
    if _state_of(list(rows), usual):
        return (usual,)
    tokens = {name: _TOKEN.findall(name) for name in rows if re.search("[0-9]", name)}
    longest = max(tokens.values(), key=len, default=[])
    alike = {name: own for name, own in tokens.items() if _fits(own, longest)}
    numbers = [k for k, token in enumerate(longest) if token.isdigit()]
    for k in range(len(longest)):
        said = {name: own[k] for name, own in alike.items() if len(own) > k}
        if _states(said, alike, numbers[0]):
            orders = _orders(said, rows)
            least = min(len(alike[name]) for name in said)
            found = [Group(_pattern(longest, numbers, k, one, least), one) for one in orders]
            return tuple(one for one in found if _apart_from_each_other(list(rows), one))
    return ()


def _apart_from_each_other(names: Sequence[str], group: Group) -> bool:
    """Whether no two groups are the same pull: on the way up and down numbers may begin again."""
    found = patterns.parts(pa.array(names, pa.string()), group.pattern).drop_null().to_pylist()
    keys = [(parts["pose"], group.state_of.get(parts["state"]), parts["repeat"]) for parts in found]
    numbered = [key for key in keys if key[2]]
    return len(set(numbered)) == len(numbered)


def _states(said: Mapping[str, str], alike: Mapping[str, Sequence[str]], place: int) -> bool:
    """Whether a part of the names is one of some words, and most numbers at a place have two."""
    words = set(said.values())
    pose = {name: alike[name][place] for name in said if len(alike[name]) > place}
    both = {(number, said[name]) for name, number in pose.items()}
    return (
        len(words) > 1
        and all(word.isalpha() for word in words)
        and len(both) >= 1.5 * len(set(pose.values()))
    )


def _fits(own: Sequence[str], longest: Sequence[str]) -> bool:
    """Whether numbers and words stand where they stand in the longest name, as far as it goes."""
    return all(
        a.isdigit() == b.isdigit() and a.isalpha() == b.isalpha()
        for a, b in zip(own, longest, strict=False)
    )


def _orders(
    said: Mapping[str, str], rows: Mapping[str, Mapping[str, Array]]
) -> list[tuple[str, ...]]:
    """The word of the unloaded state, then those of loaded ones; any first where none has least.

    Only words whose groups have a target in common can be states of one effector.
    """
    read: dict[str, list[set[str]]] = {word: [] for word in said.values()}
    for name, word in said.items():
        read[word].append({*rows[name]})
    most = {word: max(map(len, some)) for word, some in read.items()}
    unloaded, *loaded = sorted(most, key=lambda word: most[word])
    if most[unloaded] < most[loaded[0]]:
        return [(unloaded, *loaded)]
    if not set.intersection(*(set[str]().union(*some) for some in read.values())):
        return []
    return [(one, *(word for word in most if word != one)) for one in most]


def _pattern(
    tokens: Sequence[str], numbers: Sequence[int], state: int, states: tuple[str, ...], least: int
) -> str:
    """An expression for names of one form, the last parts of which may be missing."""
    parts = {
        numbers[0]: "(?P<pose>[0-9]+)",
        state: f"(?P<state>{'|'.join(map(re.escape, states))})",
    }
    if len(numbers) > 1:
        parts[numbers[1]] = "(?P<repeat>[0-9]*)" if numbers[1] >= least else "(?P<repeat>[0-9]+)"
    out = []
    for k, token in enumerate(tokens):
        fixed = "[0-9]+" if token.isdigit() else re.escape(token).replace("\\ ", " ")
        maybe = f"{fixed}?" if len(fixed) == 1 else f"(?:{fixed})?"
        out.append(parts.get(k, maybe if k >= least else fixed))
    none = "" if len(numbers) > 1 else "(?P<repeat>[0-9]*)"
    return "".join(out) + none
