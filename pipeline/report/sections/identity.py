"""What the report is filed by: when, who, with what, which machine."""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.answer.contract import Answer, Identity, Measuring, Unit
from pipeline.base.quantities import plain
from pipeline.report.columns import Cells, said, table_of
from pipeline.report.record import Section, section_of

_BLANK = "not stated"

_KINDS = {"laser_tracker": "laser tracker", "arm": "measuring arm", "unknown": "unknown kind"}


def identity(answer: Answer) -> Section | None:
    """Date, operator, instrument, scale, robot and software; what nobody said is not stated."""
    columns: list[Cells[tuple[str, str]]] = [
        said("What", lambda row: row[0]),
        said("Stated", lambda row: row[1] or _BLANK),
    ]
    found = answer.identity
    rows = [] if found is None else _rows(answer, found)
    return section_of(
        "identity", "This campaign", [table_of("identity", "What was measured", columns, rows)]
    )


def _rows(answer: Answer, found: Identity) -> Iterator[tuple[str, str]]:
    yield "Campaign", answer.name
    yield "Measured", _when(answer, found)
    yield "Operator", found.operator or ""
    yield "Robot", f"{answer.robot}, {_unit(answer.robot_unit)}"
    yield "Instrument", _instrument(answer.instrument)
    if found.force_n is not None:
        yield "Scale", _unit(found.scale)
    warm = found.temperature_c
    yield "Temperature of rail and base", "" if warm is None else f"{plain(warm)} °C"
    yield "Poses and pulls", _counts(found)
    yield "Software", f"pipeline {answer.versions.get('pipeline', _BLANK)}"


def _when(answer: Answer, found: Identity) -> str:
    """First and last reading, or the date that campaign.toml states."""
    if found.first is None or found.last is None:
        return answer.measured or ""
    first, last = (one[:16].replace("T", " ") for one in (found.first, found.last))
    return f"{first} to {last[11:] if last[:10] == first[:10] else last}"


def _unit(unit: Unit | None) -> str:
    return _certified(*((None,) * 3 if unit is None else _papers(unit)))


def _papers(of: Unit | Measuring) -> tuple[str | None, str | None, str | None]:
    return of.serial, of.certificate, of.calibrated


def _certified(serial: str | None, certificate: str | None, calibrated: str | None) -> str:
    """Serial number and certificate of a device."""
    return (
        f"serial number {serial or _BLANK}, certificate {certificate or _BLANK}, calibrated "
        f"{calibrated or _BLANK}"
    )


def _instrument(one: Measuring | None) -> str:
    if one is None:
        return f"laser tracker, model {_BLANK}, {_certified(None, None, None)}"
    kind = _KINDS.get(one.kind, one.kind)
    sheet = f"; noise by its data sheet ({one.data_sheet})" if one.data_sheet else ""
    return f"{kind}, model {one.model or _BLANK}, {_certified(*_papers(one))}{sheet}"


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
