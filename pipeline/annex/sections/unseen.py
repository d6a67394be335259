"""Effects that may be present unnoticed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from pipeline.answer.contract import (
    BlindSpot,
)
from pipeline.answer.words import unnoticed
from pipeline.base.quantities import common_prefix, plain, prefixed
from pipeline.report import words
from pipeline.report.record import (
    Block,
    Cells,
    Column,
    Paragraph,
    ReportTable,
    entry,
    present,
    table_of,
    word_column,
)

_WIDE = 300.0
"""Largest ratio of two magnitudes that share a prefix of their unit [1]."""


def not_found(spots: Sequence[BlindSpot]) -> ReportTable | None:
    """Table of the effects that would have shown, those of one kind in one row."""
    title = "Effects that were examined and not found"
    return table_of("not-found", title, [*_who(), *_SIZES], _alike(spots), _DETECTED)


_DETECTED = "An effect of the minimal detectable magnitude is detected in 80 % of the cases."


def blind_spots(spots: Sequence[BlindSpot]) -> list[Block]:
    """Effects that may be present unnoticed, those of one kind in one row; empty without any.

    The sentence on their number is that of the first screen.
    """
    if not spots:
        return []
    never = [spot for spot in spots if spot.smallest_visible is None]
    small = [spot for spot in spots if spot.smallest_visible is not None]
    return list(present([Paragraph(f"{unnoticed(len(spots))}."), _never(never), _small(small)]))


_Group = list[BlindSpot]


def _never(spots: Sequence[BlindSpot]) -> ReportTable | None:
    columns: list[Cells[_Group]] = [
        *_who(),
        word_column("Why", lambda group: "; ".join(dict.fromkeys(spot.why for spot in group))),
        _REVEALED,
    ]
    title = "Effects that these readings cannot detect at any magnitude"
    return table_of("blind-spots-never", title, columns, _alike(spots))


def _small(spots: Sequence[BlindSpot]) -> ReportTable | None:
    title = "Effects that these readings detect only above their typical magnitude"
    columns = [*_who(), *_SIZES, _REVEALED]
    return table_of("blind-spots", title, columns, _alike(spots), _DETECTED)


def _alike(spots: Sequence[BlindSpot]) -> Iterable[_Group]:
    alike: dict[tuple[str, str, str], _Group] = {}
    for spot in spots:
        alike.setdefault((spot.name, spot.unit, spot.needs), []).append(spot)
    return alike.values()


def _who() -> list[Cells[_Group]]:
    return [
        word_column("Effect", lambda group: words.cause(group[0].name, None)),
        word_column("Where", lambda group: ", ".join(map(_place, sorted(group, key=_order)))),
    ]


def _place(spot: BlindSpot) -> str:
    """`A5`, `joint 6` where no axis is mapped, `upper arm`, or nothing."""
    if isinstance(spot.where, int):
        return spot.axis or f"joint {spot.where}"
    return (spot.where or "").replace("_", " ")


def _order(spot: BlindSpot) -> tuple[int, str]:
    place = str(spot.where)
    return len(place), place


def _sizes(title: str, size: Callable[[BlindSpot], float | None]) -> Cells[_Group]:
    """A column of magnitudes, as a range over the places of one kind of effect."""
    return Column(title, numeric=True), lambda group: entry(*_range(group, size))


def _range(group: _Group, size: Callable[[BlindSpot], float | None]) -> tuple[str, float | None]:
    sizes = sorted(one for one in map(size, group) if one is not None)
    unit = "" if group[0].unit == "1" else group[0].unit
    one_prefix = unit and sizes[-1] <= _WIDE * sizes[0]
    factor, letter = common_prefix(sizes) if one_prefix else (1.0, "")
    shown = dict.fromkeys(plain(value / factor, 2) for value in (sizes[0], sizes[-1]))
    return f"{' to '.join(shown)} {prefixed(unit, letter)}".rstrip(), sizes[0]


_SIZES = (
    _sizes("Typical magnitude", lambda spot: spot.typical),
    _sizes("Minimal detectable magnitude", lambda spot: spot.smallest_visible),
)
_REVEALED: Cells[_Group] = word_column("What would reveal it", lambda group: group[0].needs)
