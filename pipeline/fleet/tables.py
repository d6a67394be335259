"""Tables across all finished campaigns: data/processed/fleet, for queries over all of them.

Partitioned by robot as `<table>/robot=<robot>/<part>.parquet`; a part contains the campaigns whose
name has its hash digit, so that a new answer changes few files and a query opens few. All content
is derived: a part is made from result.json and the campaigns' own tables, and what is missing,
outdated or of a removed campaign is made again. `wear` is made from the others, once for all robots
of a type.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import pyarrow as pa
import pyarrow.compute as pc
from filelock import FileLock

from pipeline import tables
from pipeline.answer import archive
from pipeline.answer.contract import Answer, Cause, Stiffness
from pipeline.base import files, parquet
from pipeline.base.errors import UsageError
from pipeline.base.shown import say
from pipeline.fleet import wear_table
from pipeline.fleet.wear_table import column
from pipeline.store.campaign import FLEET, MANIFEST, CampaignFolder, code_version, dump, recalled

_INDEX = "index.json"
_F64, _STR = pa.float64(), pa.string()


_CAMPAIGN = column("campaign", _STR, "1", "name of the campaign")

_CAMPAIGNS = pa.schema(
    [
        _CAMPAIGN,
        column("title", _STR, "1", "`name` in campaign.toml"),
        column("measured", pa.timestamp("us"), "UTC or local, as exported", "first reading"),
        column("verdict", _STR, "1", "adequate, explained, ambiguous, unexplained or bad_data"),
        column(
            "model", _STR, "1", "whose values the answer gives: joint_springs, extended, averaged"
        ),
        column("data", _STR, "1", "as_given or corrected"),
        column("rms_mm", _F64, "mm", "residual, root mean square over coordinates"),
        column("chi2", _F64, "1", "weighted sum of squared residuals"),
        column("dof", pa.int64(), "1", "rows minus parameters"),
        column("p_value", _F64, "1", "of that sum; null where no noise is stated"),
        column("noise_from", _STR, "1", "stated, replicates or residuals"),
        column("held_out_rms_mm", _F64, "mm", "error at poses left out of the estimate, rms"),
        column("deflection_mm", _F64, "mm", "largest predicted deflection at the test pose"),
        column("causes", pa.int64(), "1", "how many the answer names"),
        column("rejected", pa.int64(), "1", "rows of the files that were left out"),
        column("instrument", _STR, "1", "model of what measured; null where nobody says"),
        column("serial", _STR, "1", "its serial number"),
        column("robot_serial", _STR, "1", "serial number of the robot; null where nobody says"),
        column("says", _STR, "1", "first sentence of the answer"),
    ]
)

_STIFFNESS = pa.schema(
    [
        _CAMPAIGN,
        column("model", _STR, "1", "recommended, joint_springs or extended"),
        column("joint", pa.int64(), "1", "number, from 1"),
        column("joint_name", _STR, "1", "in the robot file: r1, theta2, ..."),
        column("name", _STR, "1", "k_r1, k_theta2, ..."),
        column("axis", _STR, "1", "of the controller, A1 or E1; null where none moves it alone"),
        column("unit", _STR, "1", "of value, std, low, high and nominal: N/m or N m/rad"),
        column("value", _F64, "see unit", "stiffness; null where the data give none"),
        column("std", _F64, "see unit", "standard uncertainty"),
        column("low", _F64, "see unit", "lower end of the 95 % interval; null: no limit"),
        column("high", _F64, "see unit", "upper end of it; null: no limit"),
        column("relative_std", _F64, "1", "std over value"),
        column("identifiable", pa.bool_(), "1", "whether the data determine it"),
        column("nominal", _F64, "see unit", "stiffness in the robot file"),
        column("compliance", _F64, "see compliance_unit", "the estimate itself"),
        column("compliance_std", _F64, "see compliance_unit", "its standard uncertainty"),
        column("compliance_unit", _STR, "1", "m/N or rad/(N m)"),
    ]
)

_COVARIANCE = pa.schema(
    [
        _CAMPAIGN,
        column("parameter", _STR, "1", "c_r1, c_theta2, ...: a compliance"),
        column("other", _STR, "1", "as before"),
        column("covariance", _F64, "product of both units", "of the two; infinite: undetermined"),
    ]
)

_REPAIRS = pa.schema(
    [
        _CAMPAIGN,
        column("day", pa.date32(), "1", "of the repair: `history` of [robot_unit]"),
        column("joint", pa.int64(), "1", "number, from 1; null: all joints"),
        column("what", _STR, "1", "in words"),
    ]
)

_CAUSES = pa.schema(
    [
        _CAMPAIGN,
        column("rank", pa.int64(), "1", "place in the answer, from 1"),
        column("name", _STR, "1", "rail_roll, joint_tilt, outlier, ..."),
        column("place", _STR, "1", "`where` of the answer: joint number, link, target, reading"),
        column("form", _STR, "1", "which of its laws"),
        column("probability", _F64, "1", "that it acts"),
        column("p_value", _F64, "1", "chance of so much evidence without it"),
        column("times_typical", _F64, "1", "its largest parameter over the usual size of that"),
        column("reduction", _F64, "1", "part of the error at left-out poses that it takes away"),
        column(
            "parameter", _STR, "1", "one row for each parameter; null for a mistake in the data"
        ),
        column("value", _F64, "see unit", "its size"),
        column("std", _F64, "see unit", "standard uncertainty"),
        column("unit", _STR, "1", "of value and std"),
    ]
)


def _of(promise: pa.Schema) -> pa.Schema:
    """Schema of a campaign's own table preceded by the campaign, with plain strings."""
    columns = [
        column(field.name, _plain(field.type), *(field.metadata[k].decode() for k in _ABOUT))
        for field in promise
    ]
    return pa.schema([_CAMPAIGN, *columns])


_ABOUT = (b"unit", b"meaning")


def _plain(kind: pa.DataType) -> pa.DataType:
    return kind.value_type if pa.types.is_dictionary(kind) else kind


_PROMISED = {
    "campaigns": _CAMPAIGNS,
    "stiffness": _STIFFNESS,
    "covariance": _COVARIANCE,
    "causes": _CAUSES,
    "repairs": _REPAIRS,
    "residuals": _of(tables.RESIDUALS),
    "reliability": _of(tables.RELIABILITY),
}
"""Schemas of the tables by name; every row also has the `robot` of its partition."""

VIEWS = _PROMISED | {"wear": wear_table.WEAR}
"""The same, with the table that is made from them."""

_OWN = {"residuals": "42_residuals", "reliability": "43_reliability"}
"""Tables that each campaign keeps itself."""


def folder(root: Path) -> Path:
    """Folder of these tables."""
    return root / "data" / "processed" / FLEET


@dataclass(frozen=True)
class _Entry:
    """Entry of a campaign in the index: hash of its manifest, and its robot."""

    mark: str
    robot: str


def refresh(root: Path, scatter: float | None = None) -> bool:
    """Update the tables with the campaigns that are finished.

    Args:
        root: The project's root.
        scatter: Expected day-to-day scatter of a stiffness [1], if stated.

    Returns:
        Whether anything was written.

    Raises:
        CannotWrite: The disk cannot be written.
    """
    place, there = folder(root), _marks(root)
    known = _known(place, scatter)
    if not _stale(known, there):  # before any lock: a finished project may be read-only
        return False
    with files.writing(place):
        place.mkdir(parents=True, exist_ok=True)
        with FileLock(place / ".lock"):
            _bring_up_to_date(place, there, scatter)
    return True


def mend(root: Path, scatter: float | None = None) -> list[Path]:
    """Recreate tables that cannot be read.

    Args:
        root: The project's root.
        scatter: As for `refresh`.

    Returns:
        Tables that could not be read.

    Raises:
        CannotWrite: The disk cannot be written.
    """
    damaged = [path for path in sorted(folder(root).glob("*/*/*.parquet")) if not _readable(path)]
    for path in damaged:
        with files.writing(path):
            path.unlink()
    if damaged:
        refresh(root, scatter)
    return damaged


def _readable(path: Path) -> bool:
    try:
        parquet.read(path)
    except (OSError, pa.ArrowException):
        return False
    return True


def _marks(root: Path) -> dict[str, tuple[CampaignFolder, str]]:
    """Campaigns with a valid result, and the hashes of their manifests, by name."""
    found, processed, reports = {}, root / "data" / "processed", root / "reports"
    for name in sorted(os.listdir(processed)) if processed.is_dir() else []:
        with suppress(FileNotFoundError, NotADirectoryError):  # plain strings, as there are many
            if os.path.isfile(f"{reports}/{name}/result.json"):
                with open(f"{processed}/{name}/{MANIFEST}", "rb") as manifest:
                    mark = files.sha256(manifest.read())
                found[name] = CampaignFolder(root, root / "data" / "raw" / name), mark
    return found


def _bring_up_to_date(
    place: Path, there: Mapping[str, tuple[CampaignFolder, str]], scatter: float | None
) -> None:
    known = _known(place, scatter)
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
        except UsageError:  # of an earlier version, as reported with the page over all campaigns
            continue
        entries[name] = _Entry(mark, answer.kind)
        new.setdefault((answer.kind, _part(name)), []).append(_rows(campaign, answer))
    for (robot, part), rows in new.items():
        _write(place, robot, part, rows, stale)
    for robot in sorted({robot for robot, _ in new}):
        _write_wear(place, robot, scatter)
    content = {name: [entry.mark, entry.robot] for name, entry in sorted(entries.items())}
    index = {"code": code_version(), "scatter": scatter, "campaigns": content}
    files.write(place / _INDEX, dump(index))


def _write_wear(place: Path, robot: str, scatter: float | None) -> None:
    """Write the wear of all robots of a type; remove the file if none has a campaign."""
    path = _path(place, "wear", robot, "wear")
    history = wear_table.History(*(_held(place, name, robot) for name in wear_table.READ))
    if not history.campaigns:
        path.unlink(missing_ok=True)
        return
    rows = wear_table.rows(history, scatter)
    parquet.write(path, pa.Table.from_pylist(rows, wear_table.WEAR))


def _held(place: Path, name: str, robot: str) -> list[dict[str, Any]]:
    """All rows of one table of a type."""
    paths = sorted(_path(place, name, robot, "x").parent.glob("*.parquet"))
    parts = [parquet.read(path) for path in paths]
    return [row for part in parts for row in part.to_pylist()]


def wear(root: Path) -> tuple[wear_table.RobotWear, ...]:
    """Wear of every robot as in the tables; empty if there are none."""
    place = folder(root)
    found = []
    for path in sorted((place / "wear").glob("robot=*/wear.parquet")):
        rows = parquet.read(path).to_pylist()
        found += wear_table.robots(unquote(path.parent.name.removeprefix("robot=")), rows)
    return tuple(found)


def _stale(
    known: Mapping[str, _Entry], there: Mapping[str, tuple[CampaignFolder, str]]
) -> set[str]:
    """Campaigns whose rows are not those of their present answer."""
    changed = {n for n, (_, mark) in there.items() if n not in known or known[n].mark != mark}
    return changed | (known.keys() - there.keys())


def _known(place: Path, scatter: float | None) -> dict[str, _Entry]:
    """Index of the tables; empty if written by other code, and without parts that are lost."""
    try:
        index = recalled(place / _INDEX)
        entries = {name: _Entry(*entry) for name, entry in index["campaigns"].items()}
        same = (index["code"], index["scatter"]) == (code_version(), scatter)
        known = entries if same else {}
    except (TypeError, LookupError, AttributeError):
        return {}
    whole = {
        part: all(_begins_and_ends(_path(place, table, *part)) for table in _PROMISED)
        and _begins_and_ends(_path(place, "wear", part[0], "wear"))
        for part in {(entry.robot, _part(name)) for name, entry in known.items()}
    }
    return {name: one for name, one in known.items() if whole[one.robot, _part(name)]}


def _clear(place: Path) -> None:
    for name in VIEWS:
        shutil.rmtree(place / name, ignore_errors=True)


def _part(campaign: str) -> str:
    """One of sixteen parts."""
    return files.sha256(campaign.encode("utf-8", "surrogateescape"))[0]


def _path(place: Path, table: str, robot: str, part: str) -> Path:
    return place / table / f"robot={quote(robot, safe='')}" / f"{part}.parquet"


def _write(
    place: Path, robot: str, part: str, rows: Iterable[Mapping[str, pa.Table]], stale: set[str]
) -> None:
    """Replace the rows of some campaigns in one part of every table."""
    for name, promise in _PROMISED.items():
        path = _path(place, name, robot, part)
        kept = []
        if _begins_and_ends(path):
            old = parquet.read(path)
            kept = [old.filter(pc.invert(pc.is_in(old["campaign"], pa.array(list(stale)))))]
        table = pa.concat_tables([promise.empty_table(), *kept, *(one[name] for one in rows)])
        if not table.num_rows and name == "campaigns":
            for other in _PROMISED:  # the last campaign of this part is gone
                _path(place, other, robot, part).unlink(missing_ok=True)
            return
        parquet.write(path, table)


def _rows(campaign: CampaignFolder, answer: Answer) -> dict[str, pa.Table]:
    """All rows of one campaign."""
    made = {
        "campaigns": [_campaign(answer)],
        "stiffness": _stiffness(answer),
        "covariance": _covariance(campaign),
        "causes": [row for rank, one in enumerate(answer.diagnosis.causes, 1)
                   for row in _cause(rank, one)],
        "repairs": list(_repairs(answer)),
    }  # fmt: skip
    found = {
        name: pa.Table.from_pylist(
            [{"campaign": campaign.name, **row} for row in rows], _PROMISED[name]
        )
        for name, rows in made.items()
    }
    return found | {name: _own(campaign, name) for name in _OWN}


def _kept(campaign: CampaignFolder, table: str) -> pa.Table | None:
    """Table of a campaign; None if there is none, or if it is damaged, of which a line is said."""
    path = campaign.processed / f"{table}.parquet"
    try:
        return parquet.read(path)
    except FileNotFoundError:
        return None
    except (OSError, pa.ArrowException):
        say(
            f"{path} cannot be read, its rows are missing: run "
            f"'pipeline run {campaign.name} --force'.",
            sys.stderr,
        )
        return None


def _own(campaign: CampaignFolder, name: str) -> pa.Table:
    """One of a campaign's own tables; empty if there is none."""
    promise, table = _PROMISED[name], _kept(campaign, _OWN[name])
    if table is None:
        return promise.empty_table()
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
        "robot_serial": answer.robot_unit and answer.robot_unit.serial,
        "says": answer.verdict_sentence[0],
    }


def _covariance(campaign: CampaignFolder) -> list[dict[str, Any]]:
    """Covariance of the compliances of the recommended model, row by row; empty if not kept."""
    kept = _kept(campaign, "41_covariance")
    if kept is None:
        return []
    columns = kept.to_pydict()
    names = columns.pop("parameter")
    return [
        {"parameter": name, "other": other, "covariance": value}
        for other, values in columns.items()
        if other in names
        for name, value in zip(names, values, strict=True)
    ]


def _repairs(answer: Answer) -> Iterator[dict[str, Any]]:
    for one in answer.robot_unit.history if answer.robot_unit else ():
        day = date.fromisoformat(one.date)
        for joint in one.joints or (None,):
            yield {"day": day, "joint": joint, "what": one.what}


def _moment(measured: str | None) -> datetime | None:
    """A date, or date and time; with an offset it is converted to UTC."""
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
    same = {*_STIFFNESS.names} & {*Stiffness.model_fields}
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


def _begins_and_ends(path: Path) -> bool:
    """Whether a file looks like a complete Parquet file, by its first and last bytes."""
    try:
        with path.open("rb") as opened:
            if os.fstat(opened.fileno()).st_size < 3 * len(_MAGIC):
                return False
            begin = opened.read(len(_MAGIC))
            opened.seek(-len(_MAGIC), os.SEEK_END)
            return begin == opened.read() == _MAGIC
    except OSError:
        return False


_MAGIC = b"PAR1"
"""First and last bytes of a Parquet file (format version 2)."""
