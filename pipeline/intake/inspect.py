"""What a tracker export is: said before anybody computes with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from pipeline import tables
from pipeline.base.quantities import plain
from pipeline.base.shown import in_toml
from pipeline.dialects._coordinates import angles
from pipeline.intake._separators import separators
from pipeline.intake.known import rounds
from pipeline.intake.offer import Offer, offer
from pipeline.readers import TABLE, Export, Hints, read
from pipeline.readers._names import split

_MOST_TARGETS = 50
"""Names that are listed; more of them nobody reads."""


@dataclass(frozen=True)
class _Inspection:
    """What was recognised in a file.

    Attributes:
        file: Its name.
        dialect: Name of the reader.
        encoding: As recognised; `ascii` where nothing else is needed.
        unit: Unit of length.
        coordinates: `cartesian`, `spherical` or `cylindrical`.
        angle: Unit of angles, None for Cartesian coordinates.
        vertical: `zenith` or `elevation`, None where there is no vertical angle.
        horizontal: `clockwise` or `counter-clockwise`, None for Cartesian coordinates.
        readings: How many can be used.
        groups: How many groups they have, None where the file names none.
        targets: Names of the targets, None where the file has none.
        time_first: First time, ISO 8601 without zone, None where there are no times.
        time_last: Last time.
        covariance: Kind of the uncertainty that is used, None where the file has none.
        unused: Columns that were not looked at.
        rejected: Line and reason of what was left out.
        rounds: How often the names begin again, None where groups say what belongs together.
        two_faces: Pairs that were averaged, their largest difference, single ones; None for one.
        untimed: Column that should hold times and does not, with one of its cells.
        columns: What each column of a table without a dialect was taken for, and why.
        preview: Its first rows as they are read.
        proposal: The same as [tracker.mapping] to paste.
        settled: What the places of reflectors in campaign.toml settled, and how well.
    """

    file: str
    dialect: str
    encoding: str
    unit: str
    coordinates: str
    angle: str | None
    vertical: str | None
    horizontal: str | None
    readings: int
    groups: int | None
    targets: list[str] | None
    time_first: str | None
    time_last: str | None
    covariance: str | None
    unused: list[str]
    rejected: list[dict[str, Any]]
    rounds: int | None = None
    two_faces: dict[str, Any] | None = None
    untimed: str | None = None
    columns: list[dict[str, Any]] | None = None
    preview: list[dict[str, Any]] | None = None
    proposal: str | None = None
    settled: list[str] | None = None

    def to_json(self) -> dict[str, Any]:
        """For `--json`; what few files have is there only where they have it."""
        rare = ("rounds", "two_faces", "untimed", "columns", "preview", "proposal", "settled")
        return {k: v for k, v in asdict(self).items() if k not in rare or v not in (None, [])}

    def to_text(self) -> str:
        """For people, one line per fact."""
        lines = [f"{self.file}", *(f"  {name:12} {fact}" for name, fact in self._facts())]
        lines += _columns_in_words(self.columns or []) + rows_in_words(self.preview or [])
        return "\n".join([*lines, "", self.proposal.rstrip()] if self.proposal else lines)

    def _facts(self) -> Iterator[tuple[str, str]]:
        """What is said of any file, then what only few have."""
        yield from {
            "dialect": self.dialect,
            "encoding": self.encoding,
            "unit": self.unit,
            "coordinates": self._kind(),
            "readings": str(self.readings),
            "groups": self._groups(),
            "targets": "not named" if self.targets is None else " ".join(self.targets),
            "times": self._times(),
            "uncertainty": self.covariance or "not stated",
            "not used": ", ".join(self.unused) or "nothing",
            "rejected": str(len(self.rejected)),
        }.items()
        if self.two_faces:
            yield "two faces", _faces_in_words(self.two_faces)
        yield from (("settled", one) for one in self.settled or [])

    def _kind(self) -> str:
        """Kind of coordinates, with their angles where they have any."""
        if not self.angle:
            return self.coordinates
        vertical = {"zenith": " from the zenith", "elevation": ", elevations", None: ""}
        zero = vertical[self.vertical]
        return f"{self.coordinates}, angles in {self.angle}{zero}, azimuths {self.horizontal}"

    def _groups(self) -> str:
        if self.rounds is not None:
            return f"not named; {self.rounds} rounds of names"
        return "not named" if self.groups is None else str(self.groups)

    def _times(self) -> str:
        if self.time_first:
            return f"{self.time_first} to {self.time_last}"
        return f"none; {self.untimed} contains no reliable times" if self.untimed else "none"


def _faces_in_words(faces: dict[str, Any]) -> str:
    single = f", {faces['single']} in the second face only" if faces["single"] else ""
    return (
        f"{faces['pairs']} pairs averaged, up to {plain(faces['largest_mm'], 3)} mm apart{single}"
    )


_WHY = {
    "title": "by its title",
    "words": "words that differ",
    "names": "names",
    "numbers": "numbers that name points",
    "time": "times",
    "matrix": "a covariance: symmetric",
    "faces": "a point is read in two faces",
    "rigid": "targets keep their distances while they move",
    "range": "no angles: too large, or no distance among them",
    "order": "three numbers, in this order",
    "stated": "as stated",
    "empty": "empty",
    "untold": "",
    "untimed": "contains no reliable times",
}
"""What says what a column is, in words."""


def _columns_in_words(columns: Sequence[Mapping[str, Any]]) -> list[str]:
    """One line for each column: number, title, first cell, what it is, and why."""
    out = []
    for one in columns:
        title = one["title"] or "no title"
        said = one["role"] or "not used"
        why = f" ({_WHY[one['why']]})" if _WHY[one["why"]] else ""
        out.append(f"  column {one['number']:<5} {title}, {one['example'] or 'empty'}: {said}{why}")
    return out


def offer_in_words(file: str, found: Offer) -> str:
    """What a file seems to be, for people: its columns, first rows and what to paste."""
    lines = [file, f"  {'dialect':12} {found.dialect}"]
    lines += _columns_in_words([vars(column) for column in found.columns])
    lines += rows_in_words(found.preview)
    return "\n".join([*lines, "", found.proposal.rstrip()])


def rows_in_words(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """First rows as they would be read."""
    head = ["  the first rows as they would be read:"] if rows else []
    return head + [
        "  " + "  ".join("-" if cell is None else str(cell) for cell in row.values())
        for row in rows
    ]


def inspect(name: str, data: bytes, hints: Hints | None = None) -> _Inspection:
    """Read an export and say what it is.

    Args:
        name: File name, for messages.
        data: Content of the file.
        hints: What campaign.toml adds.

    Raises:
        InputError: It is no export that can be read, or something has to be asked back.
    """
    export = read(name, data, hints)
    names = separators([export])
    if len(names) == 1:
        export = split(export, names[0])
    meaning, turned = export.meaning, angles(export.meaning)
    span = pc.min_max(export.time).as_py()
    first, last = (None if span[end] is None else span[end].isoformat() for end in ("min", "max"))
    return _Inspection(
        file=name,
        dialect=export.dialect,
        encoding=export.encoding,
        unit=meaning.unit,
        coordinates=meaning.kind,
        angle=turned.unit,
        vertical=turned.vertical,
        horizontal=turned.horizontal,
        readings=len(export.line),
        groups=None if export.group is None else len(pc.unique(export.group)),
        targets=None if export.target is None else _targets(export.target),
        time_first=first,
        time_last=last,
        covariance=export.covariance_kind,
        unused=list(export.unused),
        rejected=[{"line": line, "reason": reason} for line, reason in sorted(export.rejected)],
        rounds=_rounds(export),
        two_faces=_two_faces(export),
        untimed=export.untimed,
        **_as_proposed(name, data, hints or Hints(), export, names),
    )


def _rounds(export: Export) -> int | None:
    """How often the names begin again; None where groups say what belongs together."""
    if export.group is not None or export.target is None:
        return None
    return int(rounds(export.target.indices.to_numpy())[-1]) if len(export.line) else 0


def _two_faces(export: Export) -> dict[str, Any] | None:
    if export.faces is None:
        return None
    largest = export.faces.largest_m * 1000.0
    return {"pairs": export.faces.pairs, "largest_mm": largest, "single": export.faces.single}


def _as_proposed(
    name: str, data: bytes, hints: Hints, export: Export, names: Sequence[str]
) -> dict[str, Any]:
    """How the columns of a table without a dialect were taken, and how names hold group and target.

    Args:
        name: File name, for messages.
        data: Content of the file.
        hints: What campaign.toml adds.
        export: What was read.
        names: What [tracker] names may say.
    """
    if names:
        hints = hints.model_copy(update={"names": names[0]})
    found = offer(name, data, hints) if export.dialect == TABLE else None
    if found is None:
        others = f"   # or {', '.join(map(in_toml, names[1:]))}" if names[1:] else ""
        return {"proposal": f"[tracker]\nnames = {in_toml(names[0])}{others}"} if names else {}
    return {
        "columns": [dict(vars(one)) for one in found.columns],
        "preview": [dict(row) for row in found.preview],
        "proposal": found.proposal,
    }


def as_csv(name: str, data: bytes, hints: Hints | None = None) -> bytes:
    """The readings of an export in SI, as CSV for a spreadsheet.

    Raises:
        InputError: As `inspect`.
    """
    export = read(name, data, hints)
    nobody = pa.nulls(len(export.line), pa.string())
    group, target = (
        nobody if names is None else names.cast(pa.string())
        for names in (export.group, export.target)
    )
    columns = {
        "line": pa.array(export.line),
        "group": group,
        "target": target,
        **{f"{axis}_m": pa.array(export.position[:, k]) for k, axis in enumerate("xyz")},
        "time": export.time,
    }
    return tables.as_csv(pa.table(columns))


def _targets(names: Any, most: int = _MOST_TARGETS) -> list[str]:
    """Names of the targets, not more than one can read."""
    found = sorted(name for name in pc.unique(names.cast("string")).to_pylist())
    return found if len(found) <= most else [*found[:most], f"and {len(found) - most} more"]
