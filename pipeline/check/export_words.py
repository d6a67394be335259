"""A word of [tracker] that the export contradicts: unit, decimal mark, kind, what angles are.

Each is tried with every other value that it may have. One is wrong where the distances between
reflectors, and where the robot's table has them, fit with another value and not with the stated
one, or where the export can be read only with another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import get_args

from pipeline.check.survey import distances
from pipeline.faults.conventions import miss
from pipeline.readers import Hints
from pipeline.readers.known import BETTER, GROSS_M
from pipeline.reduction.case import Case
from pipeline.reduction.settings import Settings

_WORDS = ("unit", "decimal", "coordinates", "angle", "vertical", "horizontal")

_Read = Callable[[Settings], Case | None]
"""A campaign with some settings, None where it cannot be read so."""


@dataclass(frozen=True)
class Word:
    """A word of [tracker] that is wrong.

    Attributes:
        key: The word.
        stated: What campaign.toml says.
        better: What it should say; None for nothing at all, the export says it itself.
        before_m: How far distances or places are off as stated [m]; None where it cannot be read.
        after_m: The same with the better value.
    """

    key: str
    stated: str
    better: str | None
    before_m: float | None
    after_m: float


def wrong_word(settings: Settings, given: Case | None, read: _Read) -> Word | None:
    """The one word of [tracker] that is wrong; None where all are right or nobody can tell.

    Args:
        settings: As stated.
        given: The campaign as stated; None where it cannot be read.
        read: How it is read with other words.
    """
    before = None if given is None else _misfit(given)
    if before is not None and before < GROSS_M:
        return None
    found = []
    for key, stated, other in _others(settings):
        tried = read(_with(settings, key, other))
        after = None if tried is None else _misfit(tried)
        if after is not None and after < GROSS_M and (before is None or BETTER * after < before):
            found.append(Word(key, stated, other, before, after))
    return min(found, key=lambda one: one.after_m, default=None)


def _others(settings: Settings) -> Iterator[tuple[str, str, str | None]]:
    """Every stated word with every other value that it may have, none at all last."""
    said = settings.tracker
    for key in _WORDS if said else ():
        stated = getattr(said, key)
        literal = get_args(Hints.model_fields[key].annotation)[0]
        for other in (*get_args(literal), None):
            if stated is not None and other != stated:
                yield key, stated, other


def _with(settings: Settings, key: str, value: str | None) -> Settings:
    assert settings.tracker is not None  # it has words
    tracker = settings.tracker.model_copy(update={key: value})
    return settings.model_copy(update={"tracker": tracker})


def _misfit(case: Case) -> float | None:
    """How far distances and places of unloaded reflectors are off [m]; None where none is known."""
    off = [one.off_m for one in distances(case)]
    away = miss(case)
    return max([*off, *([] if away is None else [away])], default=None)
