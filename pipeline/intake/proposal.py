"""How a table of no dialect would be read: one proposal, and the questions to be answered first.

A table is cut into cells, every sensible way to read its columns is found, and what the file leaves
open becomes a question with the answers that fit. The proposal is a [tracker.mapping]: what is read
without a question is read by the same lines that a user could paste.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.base.arrays import Array
from pipeline.base.errors import InputError, at, listed
from pipeline.dialects import _kinds
from pipeline.dialects._cells import is_number, is_turn
from pipeline.dialects._circle import FULL
from pipeline.dialects._coordinates import (
    ANGULAR,
    AXES,
    PACKED,
    ZEROS,
    may_be_packed,
    seem_packed,
    settled,
    settled_angle,
    settled_horizontal,
    settled_unit,
    settled_vertical,
    steeper_than_not,
)
from pipeline.dialects._named import is_unit_title, known_units
from pipeline.dialects._titles import horizontal, titled
from pipeline.dialects._unit_words import ANGLE_WORDS, UNIT_WORDS
from pipeline.intake import _roles
from pipeline.intake._beside import Role, SheetTable
from pipeline.intake._contents import contents, mark_of
from pipeline.intake._polar import Polar
from pipeline.intake._roles import RoleAssignment
from pipeline.intake._sheet import Sheet, TableStatements, cells_of, sheet
from pipeline.intake.question import ColumnRole, Question, QuestionTopic, Reply, TableProposal
from pipeline.readers._iso import ISO
from pipeline.readers._layout import JOINT
from pipeline.readers._text import Text, shortened
from pipeline.readers._units import USUAL_UNITS
from pipeline.readers.export_settings import Columns, ExportSettings

_COORDINATES = 'coordinates = "cartesian" (or "spherical", "cylindrical")'
_PACKED = re.compile(r"\bd+\.?m+\.?s+\b", re.IGNORECASE)
"""Titles of degrees with minutes and seconds after the decimal point, without separating signs."""
_METRES = 50.0
"""Largest coordinate for which metres are proposed first: few cells are longer, and none is this
small in millimetres or inches."""


@dataclass
class _Draft:
    """A proposal in preparation: what is settled so far, and what is open."""

    hints: ExportSettings
    line: int
    questions: list[Question] = field(default_factory=list)

    def ask(
        self, about: QuestionTopic, answers: Sequence[Reply], wrong: InputError | None = None
    ) -> None:
        """Add a question, and continue with its first answer; a single answer is not asked."""
        if len(answers) > 1 or about == "columns":
            self.questions.append(Question(about, tuple(answers), self.line, wrong))
        self.settle(answers[0].hints)

    def settle(self, known: Mapping[str, Any]) -> None:
        self.hints = self.hints.model_copy(update=dict(known))


def propose(text: Text, hints: ExportSettings) -> TableProposal | None:
    """How a table would be read, None if there is no table with three numbers in a row.

    Args:
        text: The file.
        hints: Statements of campaign.toml or the command line.

    Raises:
        InputError: The file contradicts itself or the statements.
    """
    found = sheet(text)
    if found is None:
        return None
    draft = _Draft(hints, found.top)
    table = _table(found, draft)
    stated = TableStatements.of(found)
    reading = _chosen(_ways(table, stated, hints), table, draft)
    _whole_points(table, reading, draft)
    _instruments(table, reading, draft, text)
    _length(table, reading, draft, stated)
    if reading.kind != "cartesian":
        _angle(table, reading, draft, stated)
    return TableProposal(draft.hints, _columns(table, reading), tuple(draft.questions))


def _ways(
    table: SheetTable, stated: TableStatements, hints: ExportSettings
) -> list[RoleAssignment]:
    """The ways to read a table that the statements allow.

    Raises:
        InputError: There is none.
    """
    kind = stated.only("kinds") or hints.coordinates
    if kind:
        kind = settled(stated.only("kinds"), hints.coordinates, "coordinates", _COORDINATES)
    if hints.mapping:
        return [_told(table, hints.mapping)]
    unit = hints.unit or stated.only("units")
    ways = _roles.readings(table, kind, unit)
    allowed = [one for one in ways if kind in (None, one.kind)]
    if not allowed:
        text = f"are no {kind} coordinates" if kind else "hold no three coordinates"
        raise InputError(
            f"the columns {text}",
            "describe them in [tracker.mapping] of campaign.toml",
            line=table.sheet.top,
        )
    return allowed


def _told(table: SheetTable, mapping: Columns) -> RoleAssignment:
    """The reading that a mapping describes.

    Raises:
        InputError: Its columns are not those of the table.
    """
    titles = [title.lower() for title in table.sheet.titles]
    roles = {}
    for role, one in mapping.columns.items():
        named = isinstance(one, str) and one.lower() in titles
        place = titles.index(str(one).lower()) if named else one - 1 if isinstance(one, int) else -1
        if 0 <= place < len(titles):
            roles[place] = Role(role, "stated")
    known_values = {one.role for one in roles.values()}
    kind = next((kind for kind, axes in AXES.items() if known_values.issuperset(axes)), None)
    if kind is None:
        raise InputError(
            "the columns of [tracker.mapping] are not those of the table",
            "correct them: three coordinates are needed",
            line=table.sheet.top,
        )
    return RoleAssignment(kind, roles)


def _table(found: Sheet, draft: _Draft) -> SheetTable:
    """Titles and cells; the decimal mark is asked where commas are ambiguous."""
    content = contents(found)
    numbers = [one for one in content if one.kind == "number"]
    mark = draft.hints.decimal
    try:
        mark = mark or mark_of(numbers, found.lines)  # type: ignore[assignment]
    except InputError as wrong:
        draft.ask("decimal", [Reply(one, {"decimal": one}) for one in (",", ".")], wrong)
        mark = ","
    return SheetTable(found, titled(found.titles), content, mark or ".")


def _stated_units(table: SheetTable, places: Sequence[int], known: Mapping[str, str]) -> set[str]:
    """Units that titles and the line below them state for some columns."""
    below = (table.sheet.units[k].strip("[]() ").lower() for k in places)
    found = {table.named[k].unit for k in places} | {known.get(word) for word in below}
    return {unit for unit in found if unit and unit in known.values()}


# --- what is open ---------------------------------------------------------------------------------


def _chosen(ways: list[RoleAssignment], table: SheetTable, draft: _Draft) -> RoleAssignment:
    """The reading that the proposal follows, with its columns written into it if not yet stated."""
    if draft.hints.mapping:
        return ways[0]
    answers = [Reply(_named(table, one), {"mapping": _mapping(table, one)}) for one in ways]
    about = ways[0].open
    if about == "coordinates":
        answers = [
            Reply(one.kind, {"coordinates": one.kind, **answer.hints})
            for one, answer in zip(ways, answers, strict=True)
        ]
    if about:
        draft.ask(about, answers)
    else:
        draft.settle(answers[0].hints)
    return ways[0]


def _named(table: SheetTable, reading: RoleAssignment) -> str:
    """Short name of a reading: which columns are the coordinates."""
    axes = AXES[reading.kind]
    titles = [_called(table.sheet.titles, k) for k in reading.places(*axes)]
    return ", ".join(f"{axis} = {title}" for axis, title in zip(axes, titles, strict=True))


def _called(titles: Sequence[str], place: int) -> str:
    """A column by its title, with its number if the title is missing or not unique."""
    title = titles[place]
    return title if title and titles.count(title) == 1 else f"{title} column {place + 1}".strip()


def _mapping(table: SheetTable, reading: RoleAssignment) -> Columns:
    """[tracker.mapping] of a reading."""
    found = table.sheet
    roles = {place: one.role for place, one in sorted(reading.roles.items()) if one.role}
    none = ("",) * len(found.titles), 0
    titles, header = (found.titles, found.header) if _readable(found) else none
    dated = reading.place("date") is not None  # the format is then that of both together
    form = None if dated else next((table.content[k].form for k in reading.places("time")), None)
    mapping = {
        "columns": {role: _once(titles, place) or place + 1 for place, role in roles.items()},
        "delimiter": found.delimiter,
        "header": header,
        "first": found.first if found.first != header + 1 else None,
        "comment": found.comment,
        "time_format": None if form == ISO or "%m/%d" in str(form) else form,  # as titles have it
    }
    return Columns.model_validate(mapping)


def _once(titles: Sequence[str], place: int) -> str:
    """The title of a column, empty if another has the same."""
    alike = [title for title in titles if title.lower() == titles[place].lower()]
    return alike[0] if len(alike) == 1 else ""


def _readable(found: Sheet) -> bool:
    """Whether there are titles, cut by the separator of the rows and not in a comment."""
    cut = found.delimiter != " " or not any(" " in title for title in found.titles)
    return cut and found.titled and found.commented is None


def _instruments(table: SheetTable, reading: RoleAssignment, draft: _Draft, text: Text) -> None:
    """Ask for one instrument: those of several have their own frames, unless they are Cartesian."""
    place = reading.place("instrument")
    mapping = draft.hints.mapping
    if mapping is None or mapping.instrument or mapping.last:
        return
    if reading.kind == "cartesian":
        _frames(table, reading, mapping, draft)
        return
    if place is not None:
        names = sorted({cell for cell in table.content[place].cells if cell})
        pick = [(name, {"instrument": name}) for name in names]
    else:
        pick = list(_blocks(table.sheet, text))
    if len(pick) > 1:
        draft.ask("instrument", _of_one(mapping, pick))


def _of_one(mapping: Columns, pick: Iterable[tuple[str, dict[str, Any]]]) -> list[Reply]:
    """For each instrument the mapping that reads only its rows."""
    return [Reply(name, {"mapping": mapping.model_copy(update=part)}) for name, part in pick]


def _frames(table: SheetTable, reading: RoleAssignment, mapping: Columns, draft: _Draft) -> None:
    """Ask for one instrument if a column of words separates rows of the same targets elsewhere."""
    axes = reading.places(*AXES[reading.kind])
    rows = table.whole(axes)
    names = [table.cells(reading.place(role), rows) for role in ("group", "target")]
    free = (k for k in range(len(table.content)) if k not in reading.roles)
    for place in free if any(names[1]) else ():
        words = table.cells(place, rows)
        kinds = sorted(_kinds.few(words))
        if _kinds.nominal(kinds) or not kinds:
            continue
        if _kinds.apart(list(zip(*names, strict=True)), words, table.numbers(axes)):
            columns = {**mapping.columns, "instrument": place + 1}
            pick = ((one, {"columns": columns, "instrument": one}) for one in kinds)
            wrong = _kinds.several(table.sheet.titles[place], kinds, draft.line)
            draft.ask("instrument", _of_one(mapping, pick), wrong)
            return


def _blocks(found: Sheet, text: Text) -> Iterator[tuple[str, dict[str, Any]]]:
    """The parts of a file that begin with the same titles below different lines."""
    if not found.blocks:
        return
    ends = [*(line - 1 for line in found.blocks[1:]), len(text)]
    above = found.preamble
    first = found.first - found.header
    for header, end in zip(found.blocks, ends, strict=True):
        rows = [n for n in range(header + first, end + 1) if _is_row(text.line(n), found)]
        if rows:
            name = next((line.strip(" ;,\t#/") for line in above if "nstrument" in line), "")
            yield name or f"line {header}", {"header": header, "first": rows[0], "last": rows[-1]}
            above = tuple(text.line(n) for n in range(rows[-1] + 1, end + 1))


def _is_row(line: str, found: Sheet) -> bool:
    cells = cells_of(line, found.delimiter) or []
    return sum(map(is_number, cells)) >= len(AXES["cartesian"])


def _whole_points(table: SheetTable, reading: RoleAssignment, draft: _Draft) -> None:
    """Refuse rows named x, y and z that contain one coordinate of a point each.

    Raises:
        InputError: They do.
    """
    place = reading.place("target")
    names = {cell.lower() for cell in table.content[place].cells} if place is not None else set()
    if len(names) > 1 and names <= {*"xyz"}:
        raise InputError(
            f"each row contains one coordinate of a point ({listed(sorted(names))}), not x, y and "
            f"z of one",
            "export one row for each point",
            line=draft.line,
        )


def _length(
    table: SheetTable, reading: RoleAssignment, draft: _Draft, stated: TableStatements
) -> None:
    """The unit of length from titles, the lines above, or a statement; else it is asked.

    Raises:
        InputError: The file states several, or a unit of angles.
    """
    angular = ANGULAR[reading.kind]
    lengths = reading.places(*(a for k, a in enumerate(AXES[reading.kind]) if k not in angular))
    with at(line=draft.line):
        known_units([table.named[k] for k in lengths])
    said = _stated_units(table, lengths, UNIT_WORDS) | stated.units | _unit_column(table)
    turned = _stated_units(table, lengths, ANGLE_WORDS)
    if len(said) > 1 or turned:
        named = listed(sorted(said | turned))
        raise InputError(
            f"the export names several units for its coordinates ({named})",
            "correct its titles, or export all coordinates in the same unit",
            line=draft.line,
        )
    if said or draft.hints.unit:
        draft.settle({"unit": settled_unit(next(iter(said), None), draft.hints)})
        return
    largest = np.nanmax(np.abs(table.numbers(lengths)), initial=0.0)
    units = sorted(USUAL_UNITS, key=lambda unit: unit != "m" if largest < _METRES else 0)
    draft.ask("unit", [Reply(unit, {"unit": unit}) for unit in units])


def _unit_column(table: SheetTable) -> set[str]:
    """Units of length in a column of units."""
    places = [k for k, c in enumerate(table.named) if is_unit_title(c.title)]
    cells = {cell.lower() for k in places for cell in table.content[k].cells}
    return {UNIT_WORDS[cell] for cell in cells if cell in UNIT_WORDS}


def _angle(
    table: SheetTable, reading: RoleAssignment, draft: _Draft, stated: TableStatements
) -> None:
    """Unit of angles and zero of the vertical one, likewise; ranges and faces may show them too.

    Raises:
        InputError: The file states several units.
    """
    angular = reading.places("azimuth", "vertical")
    said = _stated_angle_units(table, angular, draft.hints, stated)
    if len(said) > 1:
        raise InputError(
            f"the export names several units of angles ({', '.join(sorted(said))})",
            "correct its titles, or export all angles in the same unit",
            line=draft.line,
        )
    if said or draft.hints.angle:
        draft.settle({"angle": settled_angle(next(iter(said), None), draft.hints.angle)})
    else:
        units = _possible_angles(table.numbers(angular), reading.ways)
        draft.ask("angle", [Reply(unit, {"angle": unit}) for unit in units])
    if reading.kind == "spherical":
        _vertical(table, reading, draft)
    _horizontal(table, reading, draft, stated)


def _stated_angle_units(
    table: SheetTable, angular: Sequence[int], hints: ExportSettings, stated: TableStatements
) -> frozenset[str]:
    """Units of angles that titles and lines above state, and those that the cells show."""
    units = stated.angles | _stated_units(table, angular, ANGLE_WORDS)
    turns = {k for k in angular if any(map(is_turn, table.content[k].cells))}
    packed = any(_PACKED.search(table.sheet.titles[k]) for k in {*angular} - turns)
    if turns or packed:
        return _shown_units(units, bool(turns), packed)
    doubtful = hints.angle is None and units == {"deg"} and seem_packed(table.numbers(angular))
    return frozenset() if doubtful else units


def _shown_units(units: frozenset[str], turns: bool, packed: bool) -> frozenset[str]:
    """Units with those that cells in degrees and minutes, or packed ones, show."""
    units = units - {"deg"} | {PACKED} if packed else units
    return units | {"deg"} if turns else units


def _possible_angles(values: Array, ways: Sequence[Polar]) -> list[str]:
    """Possible units of angles by their size, the most plausible one first; all if none fits."""
    largest = np.nanmax(np.abs(values), initial=0.0)
    allowed = {way.angle for way in ways} or {unit for unit in FULL if largest <= FULL[unit]}
    allowed -= set() if may_be_packed(values) else {PACKED}
    units = [unit for unit in FULL if unit in allowed] or [*FULL]
    return sorted(units, key=PACKED.__ne__) if seem_packed(values) else units


def _vertical(table: SheetTable, reading: RoleAssignment, draft: _Draft) -> None:
    (place,), angle = reading.places("vertical"), str(draft.hints.angle)
    values = table.numbers([place])[:, 0]
    role = table.named[place].role
    called = role if role in ZEROS else None
    allowed = {way.vertical for way in reading.ways if way.angle == angle}
    if draft.hints.vertical is None and called is None and len(allowed) == 1:
        called = allowed.pop()
    try:
        draft.settle({"vertical": settled_vertical(called, draft.hints.vertical, values, angle)})
    except InputError:
        if draft.hints.vertical is not None:
            raise
        zeros = ZEROS if steeper_than_not(values, angle) else ZEROS[::-1]
        draft.ask("vertical", [Reply(zero, {"vertical": zero}) for zero in zeros])


_RECORDS = {"SS", "TR", "BS", "FS", "BD", "BR", "FD", "FR"}
"""First words of the lines of a total station's raw file: sideshot, traverse, back- and
foresight."""


def _horizontal(
    table: SheetTable, reading: RoleAssignment, draft: _Draft, stated: TableStatements
) -> None:
    """Sense of azimuths from lines above, titles or records; else it is asked."""
    titled = horizontal(table.named, reading.place("azimuth"))
    said = stated.senses | ({titled} if titled else set())
    if any(all(JOINT in cell for cell in one.cells) for one in table.content):
        said |= {"counter-clockwise"}  # SpatialAnalyzer alone writes such names
    if any({*one.cells} <= _RECORDS for one in table.content):
        said |= {"clockwise"}
    if len(said) == 1 or draft.hints.horizontal:
        found = settled_horizontal(min(said, default=None), draft.hints.horizontal)
        draft.settle({"horizontal": found})
        return
    senses = ("counter-clockwise", "clockwise")
    draft.ask("horizontal", [Reply(sense, {"horizontal": sense}) for sense in senses])


# --- shown ----------------------------------------------------------------------------------------


def _columns(table: SheetTable, reading: RoleAssignment) -> tuple[ColumnRole, ...]:
    out = []
    for place, content in enumerate(table.content):
        role = reading.roles.get(place)
        if role is None:
            role = Role("", "empty" if content.kind == "empty" else "untold")
        out.append(
            ColumnRole(
                place + 1,
                table.sheet.titles[place],
                content.example,
                role.role,
                role.why,
                None if content.counts else content.counted,
            )
        )
    return tuple(out)


def holds_one(text: Text) -> bool:
    """Whether a file has rows with three numbers."""
    return sheet(text) is not None


def described(text: Text, hints: ExportSettings) -> tuple[ExportSettings, str | None]:
    """All entries of [tracker] that it needs, and a column that should contain times and does not.

    Raises:
        InputError: There is no table, or a question must be answered first.
    """
    found = propose(text, hints)
    if found is None:
        raise InputError(
            "there is no table of points in the file: no rows with three numbers",
            "describe its columns in [tracker.mapping] of campaign.toml, or export it as CSV with "
            "the columns group,target,x_mm,y_mm,z_mm,time",
            line=1,
        )
    if found.questions:
        raise found.questions[0].problem()
    doubtful = (one for one in found.columns if one.why == "untimed")
    untimed = next((f'{one.title} ("{shortened(one.example)}")' for one in doubtful), None)
    return found.hints, untimed
