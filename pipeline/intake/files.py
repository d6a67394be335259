"""What the files of a new campaign say: kind of each file, names, states, units.

Nothing is made up: what only a person knows (positions of reflectors, uncertainties, a unit that no
file states) stays open.
"""

from __future__ import annotations

import contextlib
import itertools
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from posixpath import dirname, join, splitext
from typing import Literal

import numpy as np
import pyarrow as pa

from pipeline import readers
from pipeline.base.arrays import Array
from pipeline.base.errors import InputError
from pipeline.base.patterns import is_glob, natural
from pipeline.dialects.taught import unnumbered
from pipeline.dialects.workbook import sheets
from pipeline.intake import _log_words, log_columns, nominal
from pipeline.intake._folder import ROBOT, described
from pipeline.intake._group_names import STATES, Group, states_of, ways_to_read
from pipeline.intake._names_by_place import NEAR
from pipeline.intake._prose import PROSE, is_prose
from pipeline.intake._separators import LOOKED_AT, in_some, separators
from pipeline.intake.by_reflectors import settled
from pipeline.intake.nominal import NominalPlaces, PlaceTable
from pipeline.intake.offer import Offer, as_table, offer
from pipeline.intake.question import ColumnRole
from pipeline.intake.which_logs import LogFiles, called, propose_logs, pulses_among, unsure
from pipeline.readers import Columns, Export, ExportSettings, logs
from pipeline.readers._reader import named_by_file, split
from pipeline.readers._text import is_workbook
from pipeline.readers.export_settings import GroupNames
from pipeline.readers.reflector_sets import ReflectorSet

_NO_HINTS = ExportSettings()
_TWO_LEVELS = re.compile(b"::.*::")
_PARTS = re.compile(r"[\W_]+")
"""What separates the parts of a name: B1 is read as B1_tour1, too."""
_MANY = 4
"""Minimum number of exports that a glob stands for."""
_SHOWN = 8
"""Maximum number of group names that are passed on; fewer show their form."""


@dataclass(frozen=True)
class FilesProposal(LogFiles):
    """What the files say about logs, exports and their names.

    Attributes:
        exports: Names of the tracker exports.
        reach: Largest number in an export that does not state its unit; None where all do.
        offer: Further entries of [tracker] for the export, None where nothing else is open.
        nameless: What an export does not name: `names`, or only `groups` if it names the targets;
            None if it names both.
        by_file: What names groups besides the exports, as `groups` of [tracker]; None if nothing.
        patterns: The exports as [tracker] files has them: a glob for a folder full of them.
        names: Possible values of `names` in [tracker] for names that combine group and target; with
            several it is open which one.
        unsure: Those of `force` and `mass` in the log whose uncertainty it does not state.
        ways: How group names are read: one way for each word that may be the unloaded state, none
            if it cannot be decided.
        groups: Some of the group names; none if the log of the loads says what they are.
        measured: Targets read unloaded and loaded.
        often: Targets in as many groups as any, where it is open which are measured.
        chain: Both ends of the chain, the one at the effector first; empty if there is none.
        base: Reflectors in groups that are not states of a pose.
        anchors: Those of them that a column of the log of loads names, by its title.
        apart_m: Distances between measured targets as read [m], by both names; empty while a unit
            or angle is open.
        base_apart_m: The same between base reflectors.
        words: Names of all targets of the exports, and the parts of all their names.
        called: Those of the robots whose type is named in files.
        resting: Points of the joint log that are no poses, by name: value by title of the axis.
        nominal: Places of reflectors that other files state.
    """

    exports: tuple[str, ...] = ()
    reach: float | None = None
    offer: Offer | None = None
    nameless: Literal["names", "groups"] | None = None
    by_file: GroupNames | None = None
    patterns: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    unsure: tuple[str, ...] = ("force",)
    ways: tuple[Group, ...] = ()
    groups: tuple[str, ...] = ()
    measured: tuple[str, ...] = ()
    often: tuple[str, ...] = ()
    chain: tuple[str, ...] = ()
    base: tuple[str, ...] = ()
    anchors: dict[str, tuple[str, ...]] = field(default_factory=dict)
    apart_m: dict[tuple[str, str], float] = field(default_factory=dict)
    base_apart_m: dict[tuple[str, str], float] = field(default_factory=dict)
    words: frozenset[str] = frozenset()
    called: tuple[str, ...] = ()
    resting: dict[str, dict[str, float]] = field(default_factory=dict)
    nominal: NominalPlaces = field(default_factory=NominalPlaces)

    @property
    def group(self) -> Group | None:
        """How group names are read; None if that is open."""
        return self.ways[0] if len(self.ways) == 1 else None

    @property
    def either(self) -> tuple[Group, ...]:
        """The possible ways, if there are several."""
        return self.ways if len(self.ways) > 1 else ()

    @property
    def nothing(self) -> bool:
        """Whether no file is an export or a log."""
        return not (self.exports or self.loads or self.joints)


def propose(
    files: Mapping[str, bytes], hints: ExportSettings = _NO_HINTS, unloaded: str | None = None
) -> FilesProposal:
    """Interpret the files of a campaign's folder.

    Args:
        files: Content by name; TOML files are taken for robots.
        hints: Statements so far on an export that leaves more open than its unit.
        unloaded: The word of the unloaded state in group names, where they leave it open.
    """
    lists = _no_exports(nominal.tables(files))
    while lists:  # beside an export of the same targets
        others = {name: data for name, data in files.items() if name not in lists}
        hints, said = _cut_by_places(others, hints, unloaded, lists)
        words = said.words | _in_log(others, said, lists)
        own = {name: nominal.of_targets(one, words) for name, one in lists.items()}
        fitting = {name: one for name, one in own.items() if one}
        if fitting.keys() == lists.keys():
            said = _with_places(files, _hooked_at_places(others, said, fitting), fitting)
            more = _settled_by_base(others, said, hints)
            return said if more is None else propose(files, more, unloaded)
        lists = fitting
    said = _proposed(files, hints, unloaded)
    return replace(said, called=called(files, said.robots))


def _cut_by_places(
    files: Mapping[str, bytes],
    hints: ExportSettings,
    unloaded: str | None,
    lists: Mapping[str, PlaceTable],
) -> tuple[ExportSettings, FilesProposal]:
    """What files say, and the statements with how names are cut if only lists of places show it."""
    said = _proposed(files, hints, unloaded)
    way = _names_of_places(files, said.names, lists) if len(said.names) > 1 else None
    if way is None:
        return hints, said
    hints = hints.model_copy(update={"names": way})
    return hints, _proposed(files, hints, unloaded)


def _with_places(
    files: Mapping[str, bytes], said: FilesProposal, lists: Mapping[str, PlaceTable]
) -> FilesProposal:
    """What files say with the nominal places of lists among them."""
    points = itertools.chain(said.base, *said.anchors.values())
    found = nominal.placed(lists, said.measured, [*points], said.apart_m | said.base_apart_m)
    pulses = pulses_among(files, said)
    return replace(said, nominal=found, called=called(files, said.robots), pulses=pulses)


def _names_of_places(
    files: Mapping[str, bytes], ways: Sequence[str], lists: Mapping[str, PlaceTable]
) -> str | None:
    """The only way to cut names in which the targets are those of a list of places; else None."""
    fitting = []
    for way in ways:
        hints = ExportSettings(names=way)
        with contextlib.suppress(InputError):
            exports = [*_exports(files, propose_logs(files)).exports.values()]
            names = _targets([*(_by_group([split(e, way) for e in exports]) or {}).values()])
            if any(sum(n in names for n in one.numbers) > 1 for one in lists.values()):
                fitting.append(hints.names)
    return fitting[0] if len(fitting) == 1 else None


def _settled_by_base(
    files: Mapping[str, bytes], said: FilesProposal, hints: ExportSettings
) -> ExportSettings | None:
    """The statements with what the listed places of base reflectors settle; None if nothing."""
    places = said.nominal.places
    base = {name: places[name] for name in said.base if name in places}
    if said.offer is None or not said.offer.questions or not base:
        return None
    for name in said.exports:
        after, why = settled(name, files[name], hints, [ReflectorSet("[base_frame]", base)])
        if why:
            return after
    return None


def _no_exports(lists: Mapping[str, PlaceTable]) -> dict[str, PlaceTable]:
    """The lists whose names do not contain those of another, as B1_tour1 does B1."""
    parts = {
        name: {part for one in table.numbers for part in _PARTS.split(one) if part != one}
        for name, table in lists.items()
    }
    return {
        name: table
        for name, table in lists.items()
        if not any(nominal.may_be_of(other, parts[name]) for other in lists.values())
    }


def _proposed(
    files: Mapping[str, bytes], hints: ExportSettings, unloaded: str | None
) -> FilesProposal:
    """Interpret files none of which is a list of nominal places; arguments as for `propose`."""
    logged = propose_logs(files)
    found = _exports(files, logged)
    found = (
        _as_stated(files, found, hints) if found.exports else _offered(files, found, hints, logged)
    )
    found = _with_groups(files, found, hints, logged)
    naming = _naming(files, found, hints, logged)
    rows = _by_group(naming.exports)
    stated = _stated_groups(logged, files, rows)
    named = _named(rows, stated.states, unloaded)
    anchors = {} if named.chain else _anchors(logged, files, named.base)
    columns = logged.load_columns | stated.columns | _log_words.anchors(anchors)
    fixed = tuple(one for one in named.base if not any(one in own for own in anchors.values()))
    return replace(
        named,
        base=fixed,
        anchors=anchors,
        apart_m=named.apart_m if found.sized else {},
        base_apart_m=named.base_apart_m if found.sized else {},
        words=_words(naming.exports),
        nameless=_lacking(naming.exports),
        by_file=naming.by_file,
        patterns=patterns([*found.exports], [*files]),
        offer=found.offer,
        names=naming.names,
        exports=tuple(found.exports),
        reach=max(found.reach, default=None),
        unsure=unsure(logged.loads, files, columns),
        resting=unnumbered(files[logged.joints]) if logged.joints else {},
        **vars(logged) | {"load_columns": columns, "refused": logged.refused | found.refused},
    )


@dataclass(frozen=True)
class _Exports:
    """The tracker exports among some files.

    Attributes:
        exports: By name.
        reach: Largest number of each that does not state its unit.
        refused: Why others are not exports.
        offer: Interpretation of the one that could not be read without further statements.
    """

    exports: dict[str, Export]
    reach: tuple[float, ...]
    refused: dict[str, str]
    offer: Offer | None = None

    @property
    def asked(self) -> list[str]:
        """The others that further statements may explain."""
        return [k for k, why in self.refused.items() if not why.startswith((PROSE, ROBOT))]

    @property
    def sized(self) -> bool:
        """Whether distances are known: no unit or angle is open; a mirror keeps them."""
        open_now = self.offer.questions if self.offer else ()
        return not self.reach and all(one.about == "horizontal" for one in open_now)

    def read_as(self, one: Offer, exports: dict[str, Export]) -> _Exports:
        """With these instead, which can be read with the statements of an offer."""
        unsaid = any(question.about == "unit" for question in one.questions)
        metres = logs.LENGTH.get(str(one.hints.unit), 1.0)
        far = [float(np.abs(e.position).max(initial=0.0)) / metres for e in exports.values()]
        refused = {name: why for name, why in self.refused.items() if name not in exports}
        return _Exports(exports, tuple(far) if unsaid else (), refused, one)


def _exports(files: Mapping[str, bytes], logged: LogFiles) -> _Exports:
    """The files that are exports, including workbooks that are also logs."""
    known = {logged.loads, logged.joints, *logged.refused}
    exports: dict[str, Export] = {}
    refused: dict[str, str] = {}
    reach: list[float] = []
    for name, data in files.items():
        if name.endswith(".toml") or (name in known and not is_workbook(data)):
            continue
        if robot := described(name, files):
            refused[name] = robot
            continue
        try:
            exports[name], largest = _export(name, data)
            reach += largest
        except InputError as problem:
            if name not in known:
                refused[name] = PROSE if is_prose(name, data) else problem.thing
    return _Exports(exports, tuple(reach), refused)


def _as_stated(files: Mapping[str, bytes], found: _Exports, hints: ExportSettings) -> _Exports:
    """Add the files that only the statements explain to exports that need none."""
    if hints == _NO_HINTS:
        return _as_others(files, found)
    read, reach = {}, [*found.reach]
    for name in found.asked:
        with contextlib.suppress(InputError):
            read[name], largest = _export(name, files[name], hints)
            reach += largest
    refused = {name: why for name, why in found.refused.items() if name not in read}
    both = found.exports | read
    return _Exports(both, tuple(reach), refused, _settled(hints)) if read else found


def _as_others(files: Mapping[str, bytes], found: _Exports) -> _Exports:
    """Add the files that leave open what another of the same titles shows: one instrument.

    Whether angles are from the zenith is seen only by some that are beyond a right angle.
    """
    tables = [name for name, one in found.exports.items() if one.dialect == readers.TABLE]
    for name in tables[:_TRIED] if found.asked else ():
        with contextlib.suppress(InputError):
            one = as_table(name, files[name], _NO_HINTS)
            read = dict(_read_as(one.hints, files, [*found.exports, *found.asked])) if one else {}
            if one and len(found.exports) < len(read) and read.keys() >= found.exports.keys():
                sure = replace(one, questions=())
                return replace(found.read_as(sure, read), reach=found.reach)
    return found


def _read_as(
    hints: ExportSettings, files: Mapping[str, bytes], names: Sequence[str]
) -> Iterator[tuple[str, Export]]:
    """Those of some files that can be read with some statements."""
    for name in names:
        with contextlib.suppress(InputError):
            yield name, readers.read(name, files[name], hints)


def _export(
    name: str, data: bytes, hints: ExportSettings = _NO_HINTS
) -> tuple[Export, list[float]]:
    """An export, and its largest number if it does not state its unit."""
    try:
        return readers.read(name, data, hints), []
    except InputError as open_unit:
        with contextlib.suppress(InputError):  # nobody has said that it is in mm
            found = readers.read(name, data, hints.model_copy(update={"unit": "mm"}))
            return found, [1e3 * float(np.abs(found.position).max(initial=0.0))]
        raise open_unit


def _offered(
    files: Mapping[str, bytes], found: _Exports, hints: ExportSettings, logged: LogFiles
) -> _Exports:
    """Add the one file that is an export with further statements, in its most likely reading.

    Of several it is the one whose groups can be read, perhaps of other columns.
    """
    offers = _offers(files, found, hints)
    entries = {name: one for name, one in offers.items() if _tells(one[1])}
    if len(offers) > 1 and not entries:
        grouped = {k: _regrouped(k, files, one, logged) for k, (one, _) in offers.items()}
        entries = {name: both for name, both in grouped.items() if both}
    offers = entries if len(entries) == 1 else offers
    if len(offers) != 1:
        return _of_one_form(files, found, offers)
    ((name, (one, export)),) = offers.items()
    return found.read_as(_named_by_groups(one) if entries else one, {name: export})


def _of_one_form(
    files: Mapping[str, bytes], found: _Exports, offers: Mapping[str, tuple[Offer, Export]]
) -> _Exports:
    """Add the files that the statements for one of them explain, if these are most of them."""
    for one, _ in (offers[name] for name in [*offers][:_TRIED]):
        read = dict(_read_as(one.hints, files, [*offers]))
        if 2 * len(read) > len(offers):
            return found.read_as(one, read)
    return found


_TRIED = 3
"""Maximum number of files whose statements are tried on all others [1]."""


def _offers(
    files: Mapping[str, bytes], found: _Exports, hints: ExportSettings
) -> dict[str, tuple[Offer, Export]]:
    """What is to be said of files that are refused, or of workbooks, and how they are read then."""
    offers: dict[str, tuple[Offer, Export]] = {}
    books = [name for name in files if is_workbook(files[name]) and name not in found.refused]
    for name in (*found.asked, *books):
        with contextlib.suppress(InputError):
            if one := offer(name, files[name], hints) or _settled(hints):
                offers[name] = one, readers.read(name, files[name], one.hints)
        if name in books and name not in {*offers, *found.exports} and not hints.sheet:
            ways = [*_of_sheets(name, files[name], hints)]
            offers |= {name: max(ways, key=lambda both: len(both[1].line))} if ways else {}
    return offers


def _of_sheets(name: str, data: bytes, hints: ExportSettings) -> Iterator[tuple[Offer, Export]]:
    """How the sheets of a workbook are read that leave nothing open but their unit.

    Titles x, y, z leave open whether they are the coordinates, as long as groups do not confirm it.
    """
    for one in sheets(name, data):
        with contextlib.suppress(InputError):
            way = hints.model_copy(update={"sheet": one})
            said = offer(name, data, way) or _settled(way)
            if said and all(one.about == "unit" for one in _named_by_groups(said).questions):
                yield said, readers.read(name, data, said.hints)


def _settled(hints: ExportSettings) -> Offer | None:
    """The statements alone, where they leave nothing open; None if there are none."""
    return None if hints == _NO_HINTS else Offer("", (), (), "", (), hints)


def _tells(export: Export) -> bool:
    """Whether the names of its groups show which of them are states of poses."""
    rows = _by_group([export])
    return bool(rows and ways_to_read(rows))


def _named_by_groups(one: Offer) -> Offer:
    """Drop the question about columns if titles name the coordinates: the groups confirm them."""
    stated = all(c.why == "title" for c in one.columns if c.role in ("x", "y", "z"))
    left = [q for q in one.questions if q.about != "columns" or len(q.answers) > 1 or not stated]
    return replace(one, questions=tuple(left))


def _with_groups(
    files: Mapping[str, bytes], found: _Exports, hints: ExportSettings, logged: LogFiles
) -> _Exports:
    """Add the columns of a table's groups whose names, or the log of loads, make sense.

    Unchanged if it is not a single export, its groups are already readable, or no columns qualify.
    """
    if len(found.exports) != 1:
        return found
    ((name, export),) = found.exports.items()
    if export.target is None or _tells(export):
        return found
    if _stated_groups(logged, files, _by_group([export])).states:
        return found
    with contextlib.suppress(InputError):
        one = found.offer or as_table(name, files[name], hints)
        if one and (both := _regrouped(name, files, one, logged)):
            unsaid = any(question.about == "unit" for question in both[0].questions)
            reach = found.reach if unsaid else ()
            return replace(found, exports={name: both[1]}, offer=both[0], reach=reach)
    return found


def _regrouped(
    name: str, files: Mapping[str, bytes], one: Offer, logged: LogFiles
) -> tuple[Offer, Export] | None:
    """A table with the first of its columns as groups that make sense; None if none do."""
    if (mapping := one.hints.mapping) is None:
        return None
    for parts in _parts(one):
        hints = _grouped_by(one.hints, mapping, parts)
        with contextlib.suppress(InputError):
            tried = readers.read(name, files[name], hints)
            if _sets_apart([tried], logged, files):
                return _named_by_groups(replace(one, hints=hints)), tried
    return None


def _parts(one: Offer) -> list[dict[str, str]]:
    """Possible columns of the groups of a table: one column, or those of pose, state and pull.

    A state is a word, the others are numbers; a pose column precedes that of the pulls. The number
    of a pose may have a word before it, and a state a number behind it: `Pose-1`, `Load-2`.
    """
    left = _untaken(one)
    numbers = [c.title for c in left if c.counted]
    words = [c.title for c in left if c.title not in numbers]
    alone = [{"group": c.title} for c in left]
    pairs = [{"pose": pose, "state": state} for state in words for pose in numbers]
    three = [{**two, "repeat": last} for two in pairs for last in numbers if last != two["pose"]]
    named = [{"pose": pose, "state": state} for pose, state in itertools.permutations(words, 2)]
    return [*alone, *named, *three, *pairs]


def _untaken(one: Offer) -> list[ColumnRole]:
    """The columns with a title that hold neither targets, coordinates, times nor row numbers."""
    mapping = one.hints.mapping.columns if one.hints.mapping else {}
    taken = {mapping.get(role) for role in ("target", "x", "y", "z", "time", "date")}
    return [c for c in one.columns if c.title and c.title not in taken and c.counted is not None]


@dataclass(frozen=True)
class _Naming:
    """What names groups.

    Attributes:
        exports: The exports with their groups.
        names: Possible values of `names` in [tracker]; with several it is open which one.
        by_file: Value of `groups`, None if files name none.
    """

    exports: list[Export]
    names: tuple[str, ...] = ()
    by_file: GroupNames | None = None


def _naming(
    files: Mapping[str, bytes], found: _Exports, hints: ExportSettings, logged: LogFiles
) -> _Naming:
    """What names groups: the exports, or the first way in which these are states of poses."""
    exports = [*found.exports.values()]
    namings = _namings(exports, files, found.offer.hints if found.offer else hints)
    plain = next(namings)
    each = itertools.chain([plain], namings)
    fitting = (one for one in each if _sets_apart(one.exports, logged, files))
    return plain if hints.groups else next(fitting, plain)


def _namings(
    exports: list[Export], files: Mapping[str, bytes], hints: ExportSettings
) -> Iterator[_Naming]:
    """As the exports name groups, or with more of what stands above targets, if it varies."""
    names = (hints.names,) if hints.names else tuple(separators(exports))
    if len(names) == 1:
        exports = [split(one, names[0]) for one in exports]
    if hints.groups:
        exports = [named_by_file(one, hints.groups) for one in exports]
    yield _Naming(exports, names, hints.groups)
    if not (names or hints.groups):
        yield from _of_levels_above(exports, files, hints)


def _of_levels_above(
    exports: list[Export], files: Mapping[str, bytes], hints: ExportSettings
) -> Iterator[_Naming]:
    """Groups by what stands above them or in their place: collections, files and their folders."""
    lacking = _lacking(exports)
    if lacking is None and all(_TWO_LEVELS.search(files[one.file]) for one in exports):
        joined = hints.model_copy(update={"names": _WHOLE_NAMES})
        yield _Naming([_export(e.file, files[e.file], joined)[0] for e in exports], (_WHOLE_NAMES,))
    if len(exports) > 1:
        yield from _by_files(exports, lacking)


def _by_files(exports: list[Export], lacking: str | None) -> Iterator[_Naming]:
    """Groups by the files of several exports and their folders."""
    ways: dict[str | None, tuple[GroupNames, ...]] = {
        "groups": ("files", "folders/files"), None: ("files::groups",)}  # fmt: skip
    for way in ways.get(lacking, ()):
        yield _Naming([named_by_file(one, way) for one in exports], (), way)
    for pattern in in_some(exports) if lacking == "groups" else ():
        both = [named_by_file(split(one, pattern), "files::groups") for one in exports]
        yield _Naming(both, (pattern,), "files::groups")


_WHOLE_NAMES = "(?P<group>.+)::(?P<target>.+)"
"""Names of groups with those of their collections."""


def _sets_apart(exports: Sequence[Export], logged: LogFiles, files: Mapping[str, bytes]) -> bool:
    """Whether groups are states of poses, and no target was read twice in a pull.

    An unloaded state may be read again after the last pull, under the same name.
    """
    rows = _by_group(exports) or {}
    if _in_several_places(exports):
        return False
    stated, ways = _stated_groups(logged, files, rows).states, ways_to_read(rows)
    if stated or not ways:
        return bool(stated)
    states = states_of(list(rows), ways[0])
    pairs = [pair for pair, _ in _named_readings(exports) if states.get(pair[0]) == STATES[1]]
    return len({*pairs}) == len(pairs)


def _named_readings(exports: Sequence[Export]) -> Iterator[tuple[tuple[str, str], Array]]:
    """Group and target of each reading that has both, and its position."""
    for one in exports:
        if one.group is not None and one.target is not None:
            names = zip(one.group.to_pylist(), one.target.to_pylist(), strict=True)
            yield from zip(names, one.position, strict=True)


def _in_several_places(exports: Sequence[Export]) -> bool:
    """Whether most readings that have the name of an earlier one were made elsewhere."""
    rows: dict[tuple[str, str], list[Array]] = {}
    for key, at in _named_readings(exports):
        rows.setdefault(key, []).append(at)
    every = np.array([at for some in rows.values() for at in some])
    near = NEAR * float(np.ptp(every)) if len(every) else 0.0
    again = [some for some in rows.values() if len(some) > 1]
    apart = sum(float(np.ptp(some, axis=0).max()) > near for some in again)
    return 2 * apart > len(again)


def _grouped_by(
    hints: ExportSettings, mapping: Columns, parts: Mapping[str, str]
) -> ExportSettings:
    """Statements on a table, with the columns of its groups in its mapping."""
    others = mapping.model_dump()["columns"].items()
    columns = {role: one for role, one in others if role != "group" and one not in parts.values()}
    mapping = mapping.model_copy(update={"columns": {**parts, **columns}})
    return hints.model_copy(update={"mapping": mapping})


def patterns(exports: Sequence[str], files: Sequence[str]) -> tuple[str, ...]:
    """The exports in natural order, with one glob for each folder and suffix that has only such."""
    kinds = {one: join(dirname(one), f"*{splitext(one)[1]}") for one in files}
    count, used = Counter(kinds.values()), Counter(kinds[name] for name in exports)
    whole = {
        kind
        for kind in used
        if used[kind] == count[kind] >= _MANY and not is_glob(kind[: kind.rindex("*")])
    }
    ordered = sorted(exports, key=natural)
    return tuple(dict.fromkeys(kinds[n] if kinds[n] in whole else n for n in ordered))


# --- names ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _StatedGroups:
    """What a log of loads says about the groups; empty if it does not, or their names do.

    Attributes:
        columns: Our name for the title that names them, where it is not ours already.
        states: `unloaded` or `loaded` by group.
    """

    columns: dict[str, str] = field(default_factory=dict)
    states: dict[str, str] = field(default_factory=dict)


def _stated_groups(
    logged: LogFiles, files: Mapping[str, bytes], rows: Mapping[str, Mapping[str, Array]] | None
) -> _StatedGroups:
    """Group states from the log: in the column with our title, or one that fits what was read."""
    if logged.loads is None or not rows or len(ways_to_read(rows)) == 1:
        return _StatedGroups()
    data = files[logged.loads]
    form = log_columns.settled(logged.load_columns)
    titles = log_columns.unknown(logged.loads, data, form)
    for columns in ({}, *({title: "group"} for title in titles)):
        tried = form.model_copy(update={"columns": form.columns | columns})
        with contextlib.suppress(InputError):
            found = logs.loads(logged.loads, data, tried).states
            alike = {name: logs.group_name(name) for name in rows}
            states = {name: STATES[found[k].loaded] for name, k in alike.items() if k in found}
            if found.keys() <= {*alike.values()} and _makes_sense(states, rows):
                return _StatedGroups(columns, states)
    return _StatedGroups()


def _in_log(
    files: Mapping[str, bytes], logged: LogFiles, lists: Mapping[str, PlaceTable]
) -> set[str]:
    """The names of places of lists that columns of the log of loads consist of: its anchors."""
    names = {name for one in lists.values() for name in one.numbers}
    if logged.loads is None:
        return set()
    found = log_columns.naming(logged.loads, files[logged.loads], names)
    return {one for title in _log_words.anchors(found) for one in found[title]}


def _anchors(
    logged: LogFiles, files: Mapping[str, bytes], points: Sequence[str]
) -> dict[str, tuple[str, ...]]:
    """The points to which a chain was hooked, by the titles of the log's columns that name them.

    All points of their kind are anchors: those that differ from them in their number only.
    """
    if logged.loads is None:
        return {}
    taken = {"pose", *map(str.lower, logged.load_columns)}
    named = log_columns.naming(logged.loads, files[logged.loads], {*points})
    left = {title: own for title, own in named.items() if title.lower() not in taken}
    return {
        title: tuple(one for one in points if _kind(one) in {*map(_kind, left[title])})
        for title in _log_words.anchors(left)
    }


def _kind(name: str) -> str:
    """A name without its numbers."""
    return re.sub("[0-9]+", "", name)


def _hooked_at_places(
    files: Mapping[str, bytes], said: FilesProposal, lists: Mapping[str, PlaceTable]
) -> FilesProposal:
    """Anchors that were never read, if a column of the log names places of a list."""
    if said.anchors or said.chain:
        return said
    points = [name for one in lists.values() for name in one.numbers
              if name not in (*said.measured, *said.base)]  # fmt: skip
    anchors = _anchors(said, files, points)
    columns = said.load_columns | _log_words.anchors(anchors)
    return replace(said, anchors=anchors, load_columns=columns)


def _makes_sense(states: Mapping[str, str], rows: Mapping[str, Mapping[str, Array]]) -> bool:
    """Whether groups are unloaded and loaded states, and all others something else.

    What was read unloaded was read loaded, too, and no target of theirs in any other group.
    """
    unloaded, loaded, others = (
        {target for name, at in rows.items() if states.get(name) == one for target in at}
        for one in (*STATES, None)
    )
    return bool(unloaded) and unloaded <= loaded and loaded.isdisjoint(others)


def _named(
    rows: dict[str, dict[str, Array]] | None, stated: Mapping[str, str], word: str | None
) -> FilesProposal:
    """Roles of the names of groups and targets, as far as they or a log show.

    Args:
        rows: Position of each target in each group; None if an export has no names.
        stated: State of each group that a log names.
        word: That of the unloaded state, if a person states it.
    """
    if rows is None:
        return FilesProposal()
    ways = _ways(rows, stated, word)
    if not ways and not stated:
        often = Counter(target for at in rows.values() for target in at)
        most = tuple(name for name, count in often.items() if count == max(often.values()))
        return FilesProposal(groups=tuple(rows)[:_SHOWN], often=most)
    state = states_of(list(rows), ways[0]) if ways else stated
    groups = () if stated else tuple(rows)[:_SHOWN]
    return replace(_by_state(rows, state), ways=ways, groups=groups)


def _by_state(rows: Mapping[str, Mapping[str, Array]], state: Mapping[str, str]) -> FilesProposal:
    """Roles of targets by the states in which they were read; groups without one are the base's.

    Targets read in most loaded groups, and in few unloaded ones, are the ends of the chain.
    """
    unloaded, loaded, others = (
        [at for name, at in rows.items() if state.get(name) == one] for one in (*STATES, None)
    )
    before, under = _share(unloaded), _share(loaded)
    ends = [name for name, often in under.items() if 2 * before.get(name, 0) < often]
    measured = [name for name in before if name in under and name not in ends]
    base = tuple(name for name in _targets(others) if name not in (*measured, *ends))
    return FilesProposal(
        measured=tuple(measured),
        chain=_chain(ends, measured, loaded),
        base=base,
        apart_m=_apart(measured, unloaded),
        base_apart_m=_apart(base, others),
    )


def _share(states: Sequence[Mapping[str, Array]]) -> dict[str, float]:
    """In what share of some states each target was read."""
    often = Counter(target for at in states for target in at)
    return {name: n / len(states) for name, n in often.items()}


def _ways(
    rows: Mapping[str, Mapping[str, Array]], stated: Mapping[str, str], word: str | None
) -> tuple[Group, ...]:
    """How group names are read if no log says it: by one word of the unloaded state, or by any."""
    ways = () if stated else ways_to_read(rows)
    return tuple(one for one in ways if one.states[0] == word) or ways


def _lacking(exports: Sequence[Export]) -> Literal["names", "groups"] | None:
    """What an export does not name."""
    if any(one.target is None for one in exports):
        return "names"
    return "groups" if any(one.group is None for one in exports) else None


def _words(exports: Sequence[Export]) -> frozenset[str]:
    """Names of all targets of some exports, and what is between the signs in all names."""
    targets, groups = (
        {str(name) for column in some if column is not None
         for name in column.cast(pa.string()).unique().to_pylist()}
        for some in ([one.target for one in exports], [one.group for one in exports])
    )  # fmt: skip
    return frozenset(targets.union(*map(_PARTS.split, targets | groups)))


def _by_group(exports: Sequence[Export]) -> dict[str, dict[str, Array]] | None:
    """Position of each target in each group; None if an export has no names."""
    rows: dict[str, dict[str, Array]] = {}
    for one in exports:
        if one.group is None or one.target is None:
            return None
        groups, targets = (
            names[:LOOKED_AT].cast(pa.string()).to_pylist() for names in (one.group, one.target)
        )
        for group, target, at in zip(groups, targets, one.position[:LOOKED_AT], strict=True):
            rows.setdefault(group, {})[target] = at
    return rows


def _targets(states: Sequence[Mapping[str, Array]]) -> list[str]:
    return list(dict.fromkeys(target for at in states for target in at))


def _chain(
    ends: Sequence[str], measured: Sequence[str], loaded: Sequence[Mapping[str, Array]]
) -> tuple[str, ...]:
    """Two ends, the one nearer to the effector first; empty if there are not two."""
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
    for one, other in itertools.combinations(names, 2):
        seen = [np.linalg.norm(at[one] - at[other]) for at in states if {one, other} <= {*at}]
        if seen:
            out[one, other] = float(np.median(seen))
    return out
