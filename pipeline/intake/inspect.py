"""Description of a tracker export, before anything is computed from it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from pipeline.base.quantities import plain
from pipeline.base.shown import in_toml
from pipeline.dialects._coordinates import angles
from pipeline.dialects._time import shown
from pipeline.intake._separators import separators
from pipeline.intake.by_reflectors import rounds
from pipeline.intake.offer import Offer, offer
from pipeline.library import spreadsheets
from pipeline.readers import TABLE, Export, ExportSettings, read
from pipeline.readers._iso import NO_YEAR
from pipeline.readers._reader import split
from pipeline.readers.export_settings import ROLES

_MOST_TARGETS = 50
"""Maximum number of names that are listed."""


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
        readings: Number of usable readings.
        groups: Number of their groups, None where the file names none.
        targets: Names of the targets, None where the file has none.
        time_first: First time, ISO 8601 without zone, only the time of day where the file has no
            date; None where there are no times.
        time_last: Last time.
        covariance: Kind of the uncertainty that is used, None where the file has none.
        unused: Columns that were not read.
        rejected: Line and reason of rows that were left out.
        rounds: Number of rounds of names, None where groups say what belongs together.
        two_faces: Pairs that were averaged, their largest difference, single ones; None without two
            faces.
        untimed: Column that should contain times and does not, with one of its cells.
        columns: Role of each column of a table without a dialect, and the evidence for it.
        preview: Its first rows as they are read.
        proposal: The same as [tracker.mapping] to paste.
        settled: What the positions of reflectors in campaign.toml settled, and how well.
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
        """Content for `--json`; rare entries are included only where the file has them."""
        rare = ("rounds", "two_faces", "untimed", "columns", "preview", "proposal", "settled")
        out = {k: v for k, v in asdict(self).items() if k not in rare or v not in (None, [])}
        return out | ({"roles": list(ROLES)} if self.columns else {})

    def to_text(self) -> str:
        """Text for people, one line per fact."""
        lines = [f"{self.file}", *(f"  {name:12} {fact}" for name, fact in self._facts())]
        lines += _columns_in_words(self.columns or []) + rows_in_words(self.preview or [])
        return "\n".join([*lines, "", self.proposal.rstrip()] if self.proposal else lines)

    def _facts(self) -> Iterator[tuple[str, str]]:
        """Facts of any file, then those that only few have."""
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
        """Kind of coordinates, with their angles if they have any."""
        if not self.angle:
            return self.coordinates
        vertical = {"zenith": " from the zenith", "elevation": ", elevations", None: ""}
        zero = vertical[self.vertical]
        return f"{self.coordinates}, angles in {self.angle}{zero}, azimuths {self.horizontal}"

    def _groups(self) -> str:
        if self.rounds is not None:
            if self.rounds == 1 and self.readings:
                return 'not named; each name occurs once: groups = "files" if the file is one group'
            return f"not named; the names come in {self.rounds} rounds"
        return "not named" if self.groups is None else str(self.groups)

    def _times(self) -> str:
        if self.time_first:
            return f"{self.time_first} to {self.time_last}"
        return f"none; {self.untimed} holds no times that can be read" if self.untimed else "none"


def _faces_in_words(faces: dict[str, Any]) -> str:
    single = f", {faces['single']} in the second face only" if faces["single"] else ""
    return (
        f"{faces['pairs']} pairs averaged, up to {plain(faces['largest_mm'], 3)} mm apart{single}"
    )


def _columns_in_words(columns: Sequence[Mapping[str, Any]]) -> list[str]:
    """One line for each column: number, title, first cell, role, and evidence."""
    out = []
    for one in columns:
        title = one["title"] or "no title"
        role = one["role"] or "not used"
        why = f" ({one['because']})" if one["because"] else ""
        out.append(f"  column {one['number']:<5} {title}, {one['example'] or 'empty'}: {role}{why}")
    return out


def offer_in_words(file: str, found: Offer) -> str:
    """Interpretation of a file, for people: its columns, first rows and the text to paste."""
    lines = [file, f"  {'dialect':12} {found.dialect}"]
    lines += _columns_in_words([one.to_json() for one in found.columns])
    lines += rows_in_words(found.preview)
    return "\n".join([*lines, "", found.proposal.rstrip()])


def rows_in_words(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """First rows as they would be read."""
    head = ["  the first rows as they would be read:"] if rows else []
    return head + [
        "  " + "  ".join("-" if cell is None else str(cell) for cell in row.values())
        for row in rows
    ]


def inspect(name: str, data: bytes, hints: ExportSettings | None = None) -> _Inspection:
    """Read an export and describe it.

    Args:
        name: File name, for messages.
        data: Content of the file.
        hints: What campaign.toml adds.

    Raises:
        InputError: It is not an export that can be read, or a question must be answered first.
    """
    export = read(name, data, hints)
    names = separators([export])
    if len(names) == 1:
        export = split(export, names[0])
    meaning, turned = export.meaning, angles(export.meaning)
    span = pc.min_max(export.time).as_py()
    first, last = (shown(span[end]) for end in ("min", "max"))
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
        **_as_proposed(name, data, hints or ExportSettings(), export, names),
    )


def _rounds(export: Export) -> int | None:
    """Number of rounds of names; None where groups say what belongs together."""
    if export.group is not None or export.target is None:
        return None
    return int(rounds(export.target.indices.to_numpy())[-1]) if len(export.line) else 0


def _two_faces(export: Export) -> dict[str, Any] | None:
    if export.faces is None:
        return None
    largest = export.faces.largest_m * 1000.0
    return {"pairs": export.faces.pairs, "largest_mm": largest, "single": export.faces.single}


def _as_proposed(
    name: str, data: bytes, hints: ExportSettings, export: Export, names: Sequence[str]
) -> dict[str, Any]:
    """Columns of a table without a dialect as read, and how names combine group and target.

    Args:
        name: File name, for messages.
        data: Content of the file.
        hints: What campaign.toml adds.
        export: What was read.
        names: Possible values of `names` in [tracker].
    """
    if names:
        hints = hints.model_copy(update={"names": names[0]})
    found = offer(name, data, hints) if export.dialect == TABLE else None
    if found is None:
        others = f"   # or {', '.join(map(in_toml, names[1:]))}" if names[1:] else ""
        return {"proposal": f"[tracker]\nnames = {in_toml(names[0])}{others}"} if names else {}
    return {
        "columns": [one.to_json() for one in found.columns],
        "preview": [dict(row) for row in found.preview],
        "proposal": found.proposal,
    }


def as_csv(name: str, data: bytes, hints: ExportSettings | None = None) -> bytes:
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
    first = pc.min(export.time).as_py()
    dated = first is None or first.year > NO_YEAR
    columns = {
        "line": pa.array(export.line),
        "group": group,
        "target": target,
        **{f"{axis}_m": pa.array(export.position[:, k]) for k, axis in enumerate("xyz")},
        "time": export.time if dated else pa.array(map(shown, export.time.to_pylist())),
    }
    return spreadsheets.as_csv(pa.table(columns))


def _targets(names: Any, most: int = _MOST_TARGETS) -> list[str]:
    """Names of the targets, at most `most`."""
    found = sorted(name for name in pc.unique(names.cast("string")).to_pylist())
    return found if len(found) <= most else [*found[:most], f"and {len(found) - most} more"]
