"""Entries of [tracker] contradicted by the export: unit, decimal mark, kind, meaning of angles.

Each is tried with every other possible value. An entry is wrong if the distances between
reflectors, and their places according to the robot's table, fit with another value and not with the
stated one, or if the export can be read only with another value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import get_args

from pipeline.check.survey import distances
from pipeline.faults.conventions import miss
from pipeline.readers import ExportSettings
from pipeline.readers.reflector_sets import CLEARLY_NEARER, GROSS_DISTANCE_M
from pipeline.reduction.case import Case
from pipeline.reduction.settings import Settings

_WORDS = ("unit", "decimal", "coordinates", "angle", "vertical", "horizontal")

_Read = Callable[[Settings], Case | None]
"""Reads a campaign with given settings; None if it cannot be read with them."""


@dataclass(frozen=True)
class WrongWord:
    """A wrong entry of [tracker].

    Attributes:
        key: Its key.
        stated: Its value in campaign.toml.
        better: Correct value; None to remove the entry, as the export states it itself.
        before_m: Error of distances or places with the stated value [m]; None if the export cannot
            be read.
        after_m: The same with the correct value.
    """

    key: str
    stated: str
    better: str | None
    before_m: float | None
    after_m: float


def wrong_word(settings: Settings, given: Case | None, read: _Read) -> WrongWord | None:
    """The one wrong entry of [tracker]; None if all are right or it cannot be decided.

    Args:
        settings: Settings as stated.
        given: The campaign as stated; None if it cannot be read.
        read: Reads it with other settings.
    """
    before = None if given is None else _misfit(given)
    if before is not None and before < GROSS_DISTANCE_M:
        return None
    found = []
    for key, stated, other in _others(settings):
        tried = read(_with(settings, key, other))
        after = None if tried is None else _misfit(tried)
        if (
            after is not None
            and after < GROSS_DISTANCE_M
            and (before is None or CLEARLY_NEARER * after < before)
        ):
            found.append(WrongWord(key, stated, other, before, after))
    return min(found, key=lambda one: one.after_m, default=None)


def _others(settings: Settings) -> Iterator[tuple[str, str, str | None]]:
    """Every stated entry with every other value that it may have, and finally none."""
    setting = settings.tracker
    for key in _WORDS if setting else ():
        stated = getattr(setting, key)
        literal = get_args(ExportSettings.model_fields[key].annotation)[0]
        for other in (*get_args(literal), None):
            if stated is not None and other != stated:
                yield key, stated, other


def _with(settings: Settings, key: str, value: str | None) -> Settings:
    assert settings.tracker is not None  # it has entries
    tracker = settings.tracker.model_copy(update={key: value})
    return settings.model_copy(update={"tracker": tracker})


def _misfit(case: Case) -> float | None:
    """Largest error of distances and places of unloaded reflectors [m]; None if none is known."""
    off = [one.off_m for one in distances(case)]
    away = miss(case)
    return max([*off, *([] if away is None else [away])], default=None)
