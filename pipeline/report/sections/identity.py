"""What the report is filed by: when, who, with what, which machine."""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.answer.contract import Answer, Identity, JointType, Measuring, Unit
from pipeline.base.quantities import plain
from pipeline.report.columns import Cells, said, table_of
from pipeline.report.record import Section, section_of

_BLANK = "not stated"

_KINDS = {"laser_tracker": "laser tracker", "arm": "measuring arm", "unknown": "unknown kind"}

Row = tuple[str, str]
"""What it is, and what is stated of it."""

NAMES = ("Campaign", "Operator", "Software")
"""What is stated there is a name, in every language the same."""


def identity(answer: Answer) -> Section | None:
    """Date, operator, instrument, scale, robot and software; what nobody said is not stated."""
    columns: list[Cells[Row]] = [
        said("What", lambda row: row[0]),
        said("Stated", lambda row: row[1] or _BLANK),
    ]
    return section_of(
        "identity",
        "This campaign",
        [table_of("identity", "What was measured", columns, rows(answer, _BLANK))],
    )


def rows(answer: Answer, blank: str = "") -> Iterator[Row]:
    """What a report is filed by; what nobody said is left out where there is no word for it."""
    found = answer.identity
    if found is None:
        return
    every = (
        ("Campaign", answer.name),
        ("Measured", _when(answer, found)),
        ("Operator", found.operator),
        ("Robot", _list(answer.robot, _unit(answer.robot_unit, blank))),
        ("Instrument", _instrument(answer.instrument, blank)),
        ("Scale", "" if found.force_n is None else _unit(found.scale, blank)),
        (f"Temperature of {'rail and base' if _slides(answer) else 'base'}", _warm(found)),
        ("Poses and pulls", _counts(found)),
        ("Software", f"pipeline {answer.versions.get('pipeline', _BLANK)}"),
    )
    pulled = found.force_n is not None
    for name, text in every:
        if (text or blank) and (pulled or name != "Scale"):
            yield name, text or ""


def _slides(answer: Answer) -> bool:
    """Whether the robot stands on a rail."""
    return any(one.joint_type == JointType.PRISMATIC for one in answer.stiffness)


def _list(*parts: str) -> str:
    """Those that say something."""
    return ", ".join(part for part in parts if part)


def _when(answer: Answer, found: Identity) -> str:
    """First and last reading, or the date that campaign.toml states."""
    if found.first is None or found.last is None:
        return answer.measured or ""
    first, last = (one[:16].replace("T", " ") for one in (found.first, found.last))
    return f"{first} to {last[11:] if last[:10] == first[:10] else last}"


def _warm(found: Identity) -> str:
    return "" if found.temperature_c is None else f"{plain(found.temperature_c)} °C"


def _unit(of: Unit | Measuring | None, blank: str) -> str:
    """Serial number and certificate of a device."""
    papers = (None,) * 3 if of is None else (of.serial, of.certificate, of.calibrated)
    serial, certificate, calibrated = (paper or blank for paper in papers)
    return _list(
        f"serial number {serial}" if serial else "",
        f"certificate {certificate}" if certificate else "",
        f"calibrated {calibrated}" if calibrated else "",
    )


def _instrument(one: Measuring | None, blank: str) -> str:
    if one is None and not blank:
        return ""
    kind = "laser tracker" if one is None else _KINDS.get(one.kind, one.kind)
    model = (one and one.model) or blank
    sheet = f"; noise by its data sheet ({one.data_sheet})" if one and one.data_sheet else ""
    return f"{_list(kind, f'model {model}' if model else '', _unit(one, blank))}{sheet}"


def _counts(found: Identity) -> str:
    if found.force_n is None:
        return f"{found.poses} poses"
    least, most = (plain(force) for force in found.force_n)
    beside = (
        f"; {_counted(found.unloaded_only)} measured unloaded only" if found.unloaded_only else ""
    )
    return f"{found.poses} poses, {found.pulls} pulls of {least} N to {most} N{beside}"


def _counted(poses: int) -> str:
    """`1 more pose`, `5 more poses`."""
    return "1 more pose" if poses == 1 else f"{poses} more poses"
