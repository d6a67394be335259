"""Data for filing: date, operator, instruments, machine."""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.answer.contract import Answer, Identity, JointType, Measuring, Unit
from pipeline.base.language import Say
from pipeline.base.quantities import plain
from pipeline.report.record import Item

_KINDS = {"laser_tracker": "laser tracker", "arm": "measuring arm", "unknown": "unknown kind"}

LabelledText = tuple[str, str]
"""A heading, and what is stated under it."""

_NAMES = ("Campaign", "Operator", "Software")
"""Headings whose entries are names, which are not translated."""


def items(answer: Answer, say: Say) -> Iterator[Item]:
    """The same for the certificate, translated by `say`."""
    for name, text in rows(answer):
        yield Item(say(name), text if name in _NAMES else say(text))


def rows(answer: Answer) -> Iterator[LabelledText]:
    """Data for filing; what is not stated is omitted."""
    found = answer.identity
    slides = any(one.joint_type == JointType.PRISMATIC for one in answer.stiffness)
    every = (
        ("Campaign", answer.name),
        ("Measured", _when(answer, found)),
        ("Operator", found.operator),
        ("Robot", _list(answer.robot, _unit(answer.robot_unit))),
        ("Instrument", _instrument(answer.instrument)),
        ("Scatter of the readings", _scatter(answer.noise.used_over_stated)),
        ("Scale", "" if found.force_n is None else _unit(found.scale)),
        (f"Temperature of {'rail and base' if slides else 'base'}", _warm(found)),
        ("Poses and pulls", _counts(found)),
        ("Software", f"pipeline {answer.versions.get('pipeline', '')}".rstrip()),
    )
    yield from ((name, text) for name, text in every if text)


def _list(*parts: str) -> str:
    """Join the texts that are not empty."""
    return ", ".join(part for part in parts if part)


def _when(answer: Answer, found: Identity) -> str:
    """First and last reading, or the date that campaign.toml states."""
    if found.first is None or found.last is None:
        return answer.measured or ""
    first, last = (one[:16].replace("T", " ") for one in (found.first, found.last))
    return f"{first} to {last[11:] if last[:10] == first[:10] else last}"


def _warm(found: Identity) -> str:
    return "" if found.temperature_c is None else f"{plain(found.temperature_c)} °C"


def _unit(of: Unit | Measuring | None) -> str:
    """Serial number, certificate and date of calibration of a device."""
    if of is None:
        return ""
    return _list(
        f"serial number {of.serial}" if of.serial else "",
        f"certificate {of.certificate}" if of.certificate else "",
        f"calibrated {of.calibrated}" if of.calibrated else "",
    )


def _instrument(one: Measuring | None) -> str:
    if one is None:
        return ""
    model = f"model {one.model}" if one.model else ""
    sheet = f"; noise by its data sheet ({one.data_sheet})" if one.data_sheet else ""
    return f"{_list(_KINDS.get(one.kind, one.kind), model, _unit(one))}{sheet}"


def _scatter(over_stated: float | None) -> str:
    return "" if over_stated is None else f"{plain(over_stated, 2)} times the noise stated"


def _counts(found: Identity) -> str:
    if found.force_n is None:
        return f"{found.poses} poses, no pulls"
    least, most = (plain(force) for force in found.force_n)
    beside = (
        f"; {_counted(found.unloaded_only)} measured unloaded only" if found.unloaded_only else ""
    )
    return f"{found.poses} poses, {found.pulls} pulls of {least} N to {most} N{beside}"


def _counted(poses: int) -> str:
    """`1 more pose`, `5 more poses`."""
    return "1 more pose" if poses == 1 else f"{poses} more poses"
