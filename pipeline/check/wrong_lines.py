"""Lines of campaign.toml that the readings contradict, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from pipeline.answer.contradictions import contradicted, in_mm
from pipeline.base.errors import InputError, place
from pipeline.base.toml import line_of
from pipeline.check.export_words import WrongWord, wrong_word
from pipeline.faults.conventions import conventions
from pipeline.faults.entries import DoubtfulEntry, wrong_entries
from pipeline.reduction.case import Case
from pipeline.reduction.settings import Settings
from pipeline.run import as_ingested
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
    word = wrong_word(raw.settings, given, partial(_read, raw))
    if word is not None:
        return [_wrong_word(text, word)]
    found = () if given is None else wrong_entries(given)
    return [_wrong_entry(text, one, found) for one in found]


def _read(raw: Raw, settings: Settings) -> Case | None:
    """Read with other settings, keeping implausible values; None if it cannot be read."""
    try:
        return as_ingested(replace(raw, settings=settings), plausible=False)[0]
    except InputError:
        return None


def text_of(raw: Raw) -> str:
    """Text of campaign.toml."""
    return raw.files[TOML].decode("utf-8", "replace")


def _wrong_word(text: str, word: WrongWord) -> WrongLine:
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
