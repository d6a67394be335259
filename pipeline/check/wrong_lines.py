"""Lines of campaign.toml that the readings contradict, in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import get_args

import numpy as np

from pipeline.base.errors import InputError, place
from pipeline.base.toml import line_of
from pipeline.check.contradictions import contradicted, in_mm
from pipeline.check.survey import distances, misshapen
from pipeline.faults.conventions import conventions, miss
from pipeline.faults.entries import DoubtfulEntry, wrong_entries
from pipeline.readers import ExportSettings
from pipeline.readers.reflector_sets import CLEARLY_NEARER, GROSS_DISTANCE_M
from pipeline.reduction.case import Case
from pipeline.reduction.settings import Settings
from pipeline.run import ingested_with_doubt
from pipeline.store.campaign import Raw

TOML = "campaign.toml"


@dataclass(frozen=True)
class WrongLine:
    """A wrong line of campaign.toml.

    Attributes:
        line: Its number; None if it cannot be found.
        key: Its key.
        said: What is wrong with it, and the way out.
        probability: Probability that it is this line, if one is wrong.
    """

    line: int | None
    key: str
    said: str
    probability: float = 1.0

    @property
    def sentence(self) -> str:
        """The sentence preceded by its place."""
        return f"{place(TOML, self.line)}{self.said}"


def wrong_lines(raw: Raw) -> list[WrongLine]:
    """Lines of campaign.toml that the readings contradict, the most probable first.

    At most one of them is wrong; several are reported if the readings leave it open.
    """
    if raw.settings.tracker is None:
        return []
    given = _read(raw, raw.settings)
    text = text_of(raw)
    word = _wrong_entry_of_tracker(raw.settings, given, partial(_read, raw))
    if word is not None:
        return [_wrong_word(text, word)]
    found = () if given is None else wrong_entries(given)
    return [_wrong_entry(text, one, found) for one in found] or _far_load_point(raw.settings, text)


_FAR = (1 / 0.0254) ** 0.5
"""Distance of the load point from the nearest target over the size of the effector from which on
its unit is wrong [1]: halfway, as a ratio, between a load point as far as the effector is large and
the same one in inches taken for metres."""


def _far_load_point(settings: Settings, text: str) -> list[WrongLine]:
    """The load point where it is far from an effector of the size of its targets."""
    load = np.array(settings.tool["load_point"])
    points = np.array([(0.0, 0.0, 0.0), *(settings.tool[name] for name in settings.measured)])
    size = max(float(np.linalg.norm(one - other)) for one, other in combinations(points, 2))
    away = float(np.linalg.norm(points - load, axis=1).min())
    if away <= _FAR * size:
        return []
    units = {"inches": 0.0254, "millimetres": 1e-3}
    near = [(u, k * load) for u, k in units.items() if np.linalg.norm(k * load) <= _FAR * size]
    maybe = "".join(
        f" if these are {unit}, write [{', '.join(f'{x:.7g}' for x in at)}];" for unit, at in near
    )
    return [
        WrongLine(
            line_of(text, ["tool", "load_point"]),
            "tool.load_point",
            f"load_point is {away:.3g} m from flange and reflectors, which are at most {size:.2g} "
            f"m apart;{maybe} all of [tool] is in metres",
        )
    ]


def _read(raw: Raw, settings: Settings) -> Case | None:
    """Read with other settings, keeping implausible values; None if it cannot be read."""
    try:
        return ingested_with_doubt(replace(raw, settings=settings), plausible=False)[0]
    except InputError:
        return None


def text_of(raw: Raw) -> str:
    """Text of campaign.toml."""
    return raw.files[TOML].decode("utf-8", "replace")


def _wrong_word(text: str, word: _WrongWord) -> WrongLine:
    off = (
        "the export cannot be read"
        if word.before_m is None
        else f"the reflectors are {in_mm(word.before_m)} off"
    )
    right = f'write {word.key} = "{word.better}"' if word.better else f"remove {word.key}"
    sentence = (
        f'{word.key} = "{word.stated}" is wrong: with it {off}, and {in_mm(word.after_m)} without; '
        f"{right}"
    )
    return WrongLine(line_of(text, ["tracker", word.key]), f"tracker.{word.key}", sentence)


def _wrong_entry(text: str, one: DoubtfulEntry, found: Sequence[DoubtfulEntry]) -> WrongLine:
    key = ".".join([one.table, *(["/".join(one.names)] if one.names else [])])
    return WrongLine(line_of(text, one.path), key, contradicted(text, one, found), one.probability)


def mistaken(raw: Raw) -> list[str]:
    """Units, signs and names of whole files that explain grossly wrong readings."""
    given = _read(raw, raw.settings)
    return [] if given is None else [one.evidence for one in conventions(given)]


_WORDS = ("unit", "decimal", "coordinates", "angle", "vertical", "horizontal")

_Read = Callable[[Settings], Case | None]
"""Reads a campaign with given settings; None if it cannot be read with them."""


@dataclass(frozen=True)
class _WrongWord:
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


def _wrong_entry_of_tracker(
    settings: Settings, given: Case | None, read: _Read
) -> _WrongWord | None:
    """The one wrong entry of [tracker]; None if all are right or it cannot be decided.

    Unit, decimal mark, kind of coordinates and meaning of angles are each tried with every other
    possible value. An entry is wrong if the distances between reflectors, and their places
    according to the robot's table, fit with another value and not with the stated one, or if the
    export can be read only with another value.

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
            found.append(_WrongWord(key, stated, other, before, after))
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
    strange = misshapen(case, GROSS_DISTANCE_M)  # as a file of another unit has them
    away = miss(replace(case, readings=case.readings[~case.readings["group"].isin(strange)]))
    return max([*off, *([] if away is None else [away])], default=None)
