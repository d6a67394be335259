"""What a tracker export is: said before anybody computes with it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from pipeline import tables
from pipeline.readers import Hints, read

_MOST_TARGETS = 50
"""Names that are listed; more of them nobody reads."""


@dataclass(frozen=True)
class Inspection:
    """What was recognised in a file.

    Attributes:
        file: Its name.
        dialect: Name of the reader.
        encoding: As recognised; `ascii` where nothing else is needed.
        unit: Unit of length.
        coordinates: `cartesian`, `spherical` or `cylindrical`.
        angle: Unit of angles, None for Cartesian coordinates.
        vertical: `zenith` or `elevation`, None where there is no vertical angle.
        readings: How many can be used.
        groups: How many groups they have, None where the file names none.
        targets: Names of the targets, None where the file has none.
        time_first: First time, ISO 8601 without zone, None where there are no times.
        time_last: Last time.
        covariance: Kind of the uncertainty that is used, None where the file has none.
        unused: Columns that were not looked at.
        rejected: Line and reason of what was left out.
    """

    file: str
    dialect: str
    encoding: str
    unit: str
    coordinates: str
    angle: str | None
    vertical: str | None
    readings: int
    groups: int | None
    targets: list[str] | None
    time_first: str | None
    time_last: str | None
    covariance: str | None
    unused: list[str]
    rejected: list[dict[str, Any]]

    def to_json(self) -> dict[str, Any]:
        """For `--json`."""
        return asdict(self)

    def to_text(self) -> str:
        """For people, one line per fact."""
        kind = self.coordinates
        if self.angle:
            kind += f", angles in {self.angle}"
        if self.vertical:
            kind += f" from the {self.vertical}" if self.vertical == "zenith" else ", elevations"
        facts = {
            "dialect": self.dialect,
            "encoding": self.encoding,
            "unit": self.unit,
            "coordinates": kind,
            "readings": str(self.readings),
            "groups": "not named" if self.groups is None else str(self.groups),
            "targets": "not named" if self.targets is None else " ".join(self.targets),
            "times": f"{self.time_first} to {self.time_last}" if self.time_first else "none",
            "uncertainty": self.covariance or "not stated",
            "not used": ", ".join(self.unused) or "nothing",
            "rejected": str(len(self.rejected)),
        }
        lines = [f"{self.file}", *(f"  {name:12} {fact}" for name, fact in facts.items())]
        return "\n".join(lines)


def inspect(name: str, data: bytes, hints: Hints | None = None) -> Inspection:
    """Read an export and say what it is.

    Args:
        name: File name, for messages.
        data: Content of the file.
        hints: What campaign.toml adds.

    Raises:
        InputError: It is no export that can be read, or something has to be asked back.
    """
    export = read(name, data, hints)
    meaning = export.meaning
    angular = meaning.kind != "cartesian"
    span = pc.min_max(export.time).as_py()
    first, last = (None if span[end] is None else span[end].isoformat() for end in ("min", "max"))
    return Inspection(
        file=name,
        dialect=export.dialect,
        encoding=export.encoding,
        unit=meaning.unit,
        coordinates=meaning.kind,
        angle=meaning.angle if angular else None,
        vertical=meaning.vertical if meaning.kind == "spherical" else None,
        readings=len(export.line),
        groups=None if export.group is None else len(pc.unique(export.group)),
        targets=None if export.target is None else _targets(export.target),
        time_first=first,
        time_last=last,
        covariance=export.covariance_kind,
        unused=list(export.unused),
        rejected=[{"line": line, "reason": reason} for line, reason in sorted(export.rejected)],
    )


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
