"""Tables across all finished campaigns: data/processed/fleet, for questions that span them.

Partitioned by robot as `<table>/robot=<robot>/<part>.parquet`; a part holds the campaigns whose
name has its digit, so that few files are written for a new answer and few are opened for a query.
Nothing here is first-hand: a part is made from result.json and the campaign's own tables, and what
is missing, old or of a campaign that is gone is made anew.
"""

from __future__ import annotations

import io
import os
import shutil
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from filelock import FileLock

from pipeline import tables
from pipeline.answer import archive
from pipeline.answer.contract import Answer, Cause, Stiffness
from pipeline.base import files
from pipeline.base.errors import UsageError
from pipeline.store.campaign import FLEET, MANIFEST, Campaign, code_version, dump, recalled

_INDEX = "index.json"
_F64, _STR = pa.float64(), pa.string()


def _col(name: str, kind: pa.DataType, unit: str, meaning: str) -> pa.Field:
    """One column; any may be null, where an answer does not have it."""
    return pa.field(name, kind, True, {"unit": unit, "meaning": meaning})


_CAMPAIGN = _col("campaign", _STR, "1", "name of the campaign")

CAMPAIGNS = pa.schema(
    [
        _CAMPAIGN,
        _col("title", _STR, "1", "`name` in campaign.toml"),
        _col("measured", pa.timestamp("us"), "UTC or local, as exported", "first reading"),
        _col("verdict", _STR, "1", "adequate, explained, ambiguous, unexplained or bad_data"),
        _col(
            "model", _STR, "1", "whose values the answer gives: joint_springs, extended, averaged"
        ),
        _col("data", _STR, "1", "as_given or corrected"),
        _col("rms_mm", _F64, "mm", "residual, root mean square over coordinates"),
        _col("chi2", _F64, "1", "weighted sum of squared residuals"),
        _col("dof", pa.int64(), "1", "rows minus parameters"),
        _col("p_value", _F64, "1", "of that sum; null where no noise is stated"),
        _col("noise_from", _STR, "1", "stated, replicates or residuals"),
        _col("held_out_rms_mm", _F64, "mm", "error at poses left out of the estimate, rms"),
        _col("deflection_mm", _F64, "mm", "largest predicted deflection at the test pose"),
        _col("causes", pa.int64(), "1", "how many the answer names"),
        _col("rejected", pa.int64(), "1", "rows of the files that were left out"),
        _col("instrument", _STR, "1", "model of what measured; null where nobody says"),
        _col("serial", _STR, "1", "its serial number"),
        _col("says", _STR, "1", "first sentence of the answer"),
    ]
)

STIFFNESS = pa.schema(
    [
        _CAMPAIGN,
        _col("model", _STR, "1", "recommended, joint_springs or extended"),
        _col("joint", pa.int64(), "1", "number, from 1"),
        _col("joint_name", _STR, "1", "in the robot file: r1, theta2, ..."),
        _col("name", _STR, "1", "k_r1, k_theta2, ..."),
        _col("unit", _STR, "1", "of value, std, low, high and nominal: N/m or N m/rad"),
        _col("value", _F64, "see unit", "stiffness; null where the data give none"),
        _col("std", _F64, "see unit", "standard uncertainty"),
        _col("low", _F64, "see unit", "lower end of the 95 % interval; null: no limit"),
        _col("high", _F64, "see unit", "upper end of it; null: no limit"),
        _col("relative_std", _F64, "1", "std over value"),
        _col("identifiable", pa.bool_(), "1", "whether the data determine it"),
        _col("nominal", _F64, "see unit", "stiffness in the robot file"),
        _col("compliance", _F64, "see compliance_unit", "the estimate itself"),
        _col("compliance_std", _F64, "see compliance_unit", "its standard uncertainty"),
        _col("compliance_unit", _STR, "1", "m/N or rad/(N m)"),
    ]
)

CAUSES = pa.schema(
    [
        _CAMPAIGN,
        _col("rank", pa.int64(), "1", "place in the answer, from 1"),
        _col("name", _STR, "1", "rail_roll, joint_tilt, outlier, ..."),
        _col("place", _STR, "1", "`where` of the answer: joint number, link, target, reading"),
        _col("form", _STR, "1", "which of its laws"),
        _col("probability", _F64, "1", "among the causes that could stand there"),
        _col("p_value", _F64, "1", "chance of so much evidence without it"),
        _col("times_typical", _F64, "1", "its largest parameter over the usual size of that"),
        _col("reduction", _F64, "1", "part of the error at left-out poses that it takes away"),
        _col("parameter", _STR, "1", "one row for each parameter; null for a mistake in the data"),
        _col("value", _F64, "see unit", "its size"),
        _col("std", _F64, "see unit", "standard uncertainty"),
        _col("unit", _STR, "1", "of value and std"),
    ]
)


def _of(promise: pa.Schema) -> pa.Schema:
    """A campaign's own table with the campaign in front, its words written out."""
    columns = [
        _col(field.name, _plain(field.type), *(field.metadata[k].decode() for k in _ABOUT))
        for field in promise
    ]
    return pa.schema([_CAMPAIGN, *columns])


_ABOUT = (b"unit", b"meaning")


def _plain(kind: pa.DataType) -> pa.DataType:
    return kind.value_type if pa.types.is_dictionary(kind) else kind


PROMISED = {
    "campaigns": CAMPAIGNS,
    "stiffness": STIFFNESS,
    "causes": CAUSES,
    "residuals": _of(tables.RESIDUALS),
    "reliability": _of(tables.RELIABILITY),
}
"""The tables by name; every row has the `robot` of its partition besides."""

_OWN = {"residuals": "42_residuals", "reliability": "43_reliability"}
"""Tables that a campaign keeps itself."""


def folder(root: Path) -> Path:
    """Where they are."""
    return root / "data" / "processed" / FLEET


@dataclass(frozen=True)
class _Entry:
    """What is known of a campaign in the tables: hash of its manifest, and its robot."""

    mark: str
    robot: str


def refresh(root: Path) -> None:
    """Bring the tables up to date with the campaigns that are finished.

    Raises:
        CannotWrite: The disk refuses.
    """
    place, there = folder(root), _marks(root)
    if not _stale(_known(place), there):  # before any lock: a finished project may be read-only
        return
    with files.writing(place):
        place.mkdir(parents=True, exist_ok=True)
        with FileLock(place / ".lock"):
            _bring_up_to_date(place, there)


def _marks(root: Path) -> dict[str, tuple[Campaign, str]]:
    """Campaigns with a result that counts, and the hashes of their manifests, by name."""
    found, processed, reports = {}, root / "data" / "processed", root / "reports"
    for name in sorted(os.listdir(processed)) if processed.is_dir() else []:
        with suppress(FileNotFoundError, NotADirectoryError):  # plain names: a thousand are usual
            if os.path.isfile(f"{reports}/{name}/result.json"):
                with open(f"{processed}/{name}/{MANIFEST}", "rb") as manifest:
                    mark = files.sha256(manifest.read())
                found[name] = Campaign(root, root / "data" / "raw" / name), mark
    return found


def _bring_up_to_date(place: Path, there: Mapping[str, tuple[Campaign, str]]) -> None:
    known = _known(place)
    if not known:
        _clear(place)
    stale = _stale(known, there)
    entries = {name: entry for name, entry in known.items() if name not in stale}
    new: dict[tuple[str, str], list[dict[str, pa.Table]]] = {}
    for name in stale & known.keys():
        new.setdefault((known[name].robot, _part(name)), [])
    for name in sorted(stale & there.keys()):
        campaign, mark = there[name]
        try:
            answer = archive.read(campaign)
        except UsageError:  # of an earlier version, as the page over all campaigns says
            continue
        entries[name] = _Entry(mark, answer.robot)
        new.setdefault((answer.robot, _part(name)), []).append(_rows(campaign, answer))
    for (robot, part), rows in new.items():
        _write(place, robot, part, rows, stale)
    content = {name: [entry.mark, entry.robot] for name, entry in sorted(entries.items())}
    files.write(place / _INDEX, dump({"code": code_version(), "campaigns": content}))


def _stale(known: Mapping[str, _Entry], there: Mapping[str, tuple[Campaign, str]]) -> set[str]:
    """Campaigns whose rows are not those of their present answer."""
    changed = {n for n, (_, mark) in there.items() if n not in known or known[n].mark != mark}
    return changed | (known.keys() - there.keys())


def _known(place: Path) -> dict[str, _Entry]:
    """What the tables hold: nothing where other code wrote them, none of a part that is lost."""
    try:
        index = recalled(place / _INDEX)
        entries = {name: _Entry(*entry) for name, entry in index["campaigns"].items()}
        known = entries if index["code"] == code_version() else {}
    except (TypeError, LookupError, AttributeError):
        return {}
    whole = {
        part: all(_path(place, table, *part).is_file() for table in PROMISED)
        for part in {(entry.robot, _part(name)) for name, entry in known.items()}
    }
    return {name: one for name, one in known.items() if whole[one.robot, _part(name)]}


def _clear(place: Path) -> None:
    for name in PROMISED:
        shutil.rmtree(place / name, ignore_errors=True)


def _part(campaign: str) -> str:
    """One of sixteen."""
    return files.sha256(campaign.encode("utf-8", "surrogateescape"))[0]


def _path(place: Path, table: str, robot: str, part: str) -> Path:
    return place / table / f"robot={quote(robot, safe='')}" / f"{part}.parquet"


def _write(
    place: Path, robot: str, part: str, rows: Iterable[Mapping[str, pa.Table]], stale: set[str]
) -> None:
    """Replace the rows of some campaigns in one part of every table."""
    for name, promise in PROMISED.items():
        path = _path(place, name, robot, part)
        kept = []
        if path.is_file():
            old = pq.ParquetFile(io.BytesIO(path.read_bytes())).read()
            kept = [old.filter(pc.invert(pc.is_in(old["campaign"], pa.array(list(stale)))))]
        table = pa.concat_tables([promise.empty_table(), *kept, *(one[name] for one in rows)])
        if not table.num_rows and name == "campaigns":
            for other in PROMISED:  # the last campaign of this part is gone
                _path(place, other, robot, part).unlink(missing_ok=True)
            return
        sink = io.BytesIO()
        pq.write_table(table, sink, compression="zstd")
        files.write(path, sink.getvalue())


def _rows(campaign: Campaign, answer: Answer) -> dict[str, pa.Table]:
    """All rows of one campaign."""
    made = {
        "campaigns": [_campaign(answer)],
        "stiffness": _stiffness(answer),
        "causes": [row for rank, one in enumerate(answer.diagnosis.causes, 1)
                   for row in _cause(rank, one)],
    }  # fmt: skip
    found = {
        name: pa.Table.from_pylist(
            [{"campaign": campaign.name, **row} for row in rows], PROMISED[name]
        )
        for name, rows in made.items()
    }
    return found | {name: _own(campaign, name) for name in _OWN}


def _own(campaign: Campaign, name: str) -> pa.Table:
    """One of a campaign's own tables; empty where it has none."""
    path, promise = campaign.processed / f"{_OWN[name]}.parquet", PROMISED[name]
    if not path.is_file():
        return promise.empty_table()
    table = pq.ParquetFile(io.BytesIO(path.read_bytes())).read()
    table = table.append_column("campaign", pa.array([campaign.name] * table.num_rows, _STR))
    return table.select(promise.names).replace_schema_metadata(None).cast(promise)


def _campaign(answer: Answer) -> dict[str, Any]:
    checked, sizes = answer.validation, [one.size_mm for one in answer.test_pose_deflection]
    return {
        "title": answer.name,
        "measured": _moment(answer.measured),
        "verdict": str(answer.diagnosis.verdict),
        "model": str(answer.recommended.model),
        "data": str(answer.recommended.data),
        "rms_mm": answer.fit.rms_mm,
        "chi2": answer.fit.chi2,
        "dof": answer.fit.dof,
        "p_value": answer.fit.p_value,
        "noise_from": str(answer.fit.noise_from),
        "held_out_rms_mm": checked and checked.held_out_rms_mm,
        "deflection_mm": max((size for size in sizes if size is not None), default=None),
        "causes": len(answer.diagnosis.causes),
        "rejected": len(answer.rejected),
        "instrument": answer.instrument and answer.instrument.model,
        "serial": answer.instrument and answer.instrument.serial,
        "says": answer.verdict_sentence[0],
    }


def _moment(measured: str | None) -> datetime | None:
    """A date, or a date and time; with an offset it becomes UTC."""
    if measured is None:
        return None
    said = datetime.fromisoformat(measured)
    return said if said.tzinfo is None else said.astimezone(UTC).replace(tzinfo=None)


def _stiffness(answer: Answer) -> list[dict[str, Any]]:
    sets: dict[str, tuple[Stiffness, ...]] = {
        "recommended": answer.stiffness,
        "joint_springs": answer.joint_springs.stiffness,
    }
    if answer.extended is not None:
        sets["extended"] = answer.extended.stiffness
    same = {*STIFFNESS.names} & {*Stiffness.model_fields}
    return [
        {"model": model, "low": one.ci95[0], "high": one.ci95[1]}
        | {name: getattr(one, name) for name in same}
        for model, joints in sets.items()
        for one in joints
    ]


def _cause(rank: int, one: Cause) -> list[dict[str, Any]]:
    about = {
        "rank": rank,
        "name": one.name,
        "place": None if one.where is None else str(one.where),
        "form": one.form,
        "probability": one.probability,
        "p_value": one.p_value,
        "times_typical": one.times_typical,
        "reduction": one.gain and one.gain.reduction,
    }
    sizes = [
        {"parameter": size.name, "value": size.value, "std": size.std, "unit": size.unit}
        for size in one.parameters
    ]
    return [about | size for size in sizes or [{}]]
