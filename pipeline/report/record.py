"""The frozen records of which a report consists; all their texts are plain, without markup.

A table is made of its columns, each with the function that gives its cell, and one row per record.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeVar

from pipeline.base.quantities import MISSING, known, plain, typeset, with_std

_Part = TypeVar("_Part")


@dataclass(frozen=True)
class TableEntry:
    """One cell of a table.

    Attributes:
        text: Text shown.
        sort: Key for sorting; a number if the cell shows one.
        link: Address of a link relative to the page; empty for none.
    """

    text: str
    sort: float | str | None = None
    link: str = ""


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes:
        title: Heading, with the unit if all cells share one.
        numeric: Aligned to the right and sorted as numbers.
        code: File names and hashes, set in a fixed width.
    """

    title: str
    numeric: bool = False
    code: bool = False

    def prose(self, cell: TableEntry) -> bool:
        """Whether a cell holds a text long enough to be wrapped."""
        return not (self.numeric or self.code) and len(cell.text) > _LINE


_LINE = 24
"""Maximum number of characters of a cell without line breaks."""

_PROSE_REM, _LETTER_REM, _EDGES_REM = 13.0, 0.55, 1.6
"""Minimum width of a cell of prose, width of a letter, and padding of both sides together, as in
page.css [rem]."""

_HALF_REM = 34.0
"""Minimum width of half a page in page.css [rem]."""

_FEW = 4
"""Maximum number of columns of a table on half a page; more are easier to read across it."""


@dataclass(frozen=True)
class ReportTable:
    """A table with its heading and a note below."""

    kind: str = field(default="table", init=False)
    name: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[TableEntry, ...], ...]
    note: str = ""

    @property
    def wide(self) -> bool:
        """Whether it takes the whole width of the page, as half would be too narrow for it."""
        least = sum(map(self._least_rem, range(len(self.columns))))
        return len(self.columns) > _FEW or least > _HALF_REM

    def _least_rem(self, place: int) -> float:
        """Minimum width of a column [rem]; headings may be broken between words."""
        column, cells = self.columns[place], [row[place] for row in self.rows]
        if any(map(column.prose, cells)):
            return _PROSE_REM
        letters = [*map(len, column.title.split()), *(len(cell.text) for cell in cells)]
        return _EDGES_REM + _LETTER_REM * max(letters, default=0)


class _Printed:
    """Base of records with texts in which numbers and units are set as they are printed."""

    printed: ClassVar[tuple[str, ...]] = ("text",)

    def __post_init__(self) -> None:
        """Set them."""
        for name in self.printed:
            object.__setattr__(self, name, typeset(getattr(self, name)))


@dataclass(frozen=True)
class Paragraph(_Printed):
    """A paragraph; a `finding` is something to act on."""

    kind: str = field(default="text", init=False)
    text: str
    tone: str = "plain"


@dataclass(frozen=True)
class Figure(_Printed):
    """The texts of a figure, whose drawing is found by its name.

    Attributes:
        name: File name without ending.
        title: What it shows.
        caption: What to see in it.
        alt: Alternative text for readers who cannot see it.
        held: Whether it stays at its place in the text on paper, too.
    """

    printed = ("caption",)
    kind: str = field(default="figure", init=False)
    name: str
    title: str
    caption: str
    alt: str
    held: bool = False


Block = ReportTable | Paragraph | Figure


@dataclass(frozen=True)
class Section:
    """A heading and the blocks below it."""

    key: str
    title: str
    blocks: tuple[Block, ...]


def present(parts: Iterable[_Part | None]) -> tuple[_Part, ...]:
    """Drop the parts that are None."""
    return tuple(part for part in parts if part is not None)


def section_of(key: str, title: str, blocks: Iterable[Block | None]) -> Section | None:
    """A section of the blocks that are not None; None if all are."""
    kept: tuple[Block, ...] = present(blocks)
    return Section(key, title, kept) if kept else None


@dataclass(frozen=True)
class Item(_Printed):
    """One line of the first screen: its label, which may be empty, and its text."""

    label: str
    text: str


def unlabelled(*texts: str) -> tuple[Item, ...]:
    """Lines without labels."""
    return tuple(Item("", text) for text in texts)


@dataclass(frozen=True)
class StiffnessBar(_Printed):
    """One stiffness of the certificate.

    Attributes:
        name: Axis and joint.
        value: Value with its expanded uncertainty.
        beside: Ratio to nominal, or the relative expanded uncertainty if no nominal is stated.
        enter: Entry for the controller.
        track: Places of lower limit, value and upper limit between the ends of the bar, 0 to 1;
            None if nothing is drawn.
    """

    printed = ("value", "beside", "enter")
    name: str
    value: str
    beside: str
    enter: str
    track: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Certificate(_Printed):
    """The first page: decisions, findings, and the data for filing.

    Attributes:
        found: What is wrong.
        to_do: What to do.
        measure: What to measure next.
        tolerance: Why no tolerance is judged; empty if one is.
        picture: The robot.
        gauge: The deflection and its tolerance; None without a deflection.
        bars: The stiffnesses.
        nominal: Place of the nominal value along the bars, 0 to 1; None without one.
        beside: Heading of the column beside the bars.
        note: Explanation of the bars and of what to enter.
        filed: Statements on campaign, machine and instruments.
        logo: Logo of the house as SVG; empty for none.
        sign: Lines for signatures.
        digest: First digits of the digest of result.json, which identifies this answer.
    """

    printed = ("found", "to_do", "measure", "note")
    found: str
    to_do: str
    measure: str
    tolerance: str
    picture: Figure | None
    gauge: Figure | None
    bars: tuple[StiffnessBar, ...]
    nominal: float | None
    beside: str
    note: str
    filed: tuple[Item, ...]
    digest: str
    logo: str = ""
    sign: tuple[str, ...] = ("Measured", "Checked", "Released")


_TONES = ("good", "neutral", "attention", "bad")
"""Tones of a headline from best to worst."""


@dataclass(frozen=True)
class Headline:
    """A decision.

    Attributes:
        word: The decision in a few words.
        tone: One of `_TONES`.
    """

    word: str
    tone: str


@dataclass(frozen=True)
class PageFrame:
    """Fixed texts of page and paper around the content of the report, and their language."""

    language: str = "en"
    skip: str = "Skip to the report"
    made: str = "Made by pipeline"
    took: str = "Run time"
    figure: str = "Figure"
    verdict: str = "Verdict"
    to_do: str = "What to do"
    measure: str = "To measure next"
    tolerance: str = "Tolerance"
    values: str = "Stiffnesses"
    axis: str = "Axis"
    stiffness: str = "Stiffness ± U"
    interval: str = "Interval"
    enter: str = "Into the controller"
    filed: str = "What this is filed by"
    digest: str = "Digest"
    begins: str = "begins the SHA-256 of result.json"
    signed: str = ": name, date"
    answers: str = "The answer in words"
    sections: str = "Sections"


@dataclass(frozen=True)
class Report:
    """Complete content of one page.

    Attributes:
        kicker: Subject of the page, above its heading.
        heading: Heading, the name of a campaign.
        title: Title of page and PDF, complete in itself.
        verdict: The verdict in a few words.
        tone: Tone of the verdict, one of `_TONES`.
        first: The answer in words, line by line.
        sections: The remaining sections, in order of use.
        elsewhere: Other files with the same content.
        run_time: Run time, or None.
        judged: The decision on the tolerance, shown before the verdict; None without one.
        certificate: The first page; None if the report is not about a campaign.
        frame: Fixed texts of page and paper.
    """

    kicker: str
    heading: str
    title: str
    verdict: str
    tone: str
    first: tuple[Item, ...]
    sections: tuple[Section, ...]
    elsewhere: str = ""
    run_time: str | None = None
    judged: Headline | None = None
    certificate: Certificate | None = None
    frame: PageFrame = PageFrame()

    @property
    def worst(self) -> str:
        """The worse of the tones of verdict and tolerance, so that no colour is too optimistic."""
        return max((self.tone, *([self.judged.tone] if self.judged else [])), key=_TONES.index)

    @property
    def figures(self) -> tuple[Figure, ...]:
        """All figures in order."""
        of = self.certificate
        first = () if of is None else present((of.picture, of.gauge))
        return (*first, *(b for s in self.sections for b in s.blocks if isinstance(b, Figure)))


def entry(text: str, sort: object = None) -> TableEntry:
    """A cell that is sorted by a number, or by its text if there is none."""
    return TableEntry(text, float(sort) if known(sort) else None)


def text_entry(value: object, sort: object = None) -> TableEntry:
    """A cell of words; an empty one is marked as missing."""
    text = "" if value is None else str(value)
    return TableEntry(text or MISSING, float(sort) if known(sort) else text)


_Thing = TypeVar("_Thing")

Cells = tuple[Column, Callable[[_Thing], TableEntry]]
"""A column, and the function that gives its cell for one record."""


def word_column(title: str, words: Callable[[_Thing], object], code: bool = False) -> Cells[_Thing]:
    """A column of words."""
    return Column(title, code=code), lambda thing: text_entry(words(thing))


def number_column(
    title: str, value: Callable[[_Thing], float | None], shown: Callable[[Any], str] = plain
) -> Cells[_Thing]:
    """A column of numbers."""
    return Column(title, numeric=True), lambda thing: entry(shown(value(thing)), value(thing))


def measured_column(
    title: str, both: Callable[[_Thing], tuple[float | None, float | None]]
) -> Cells[_Thing]:
    """A column of values with their standard uncertainties."""
    return Column(title, numeric=True), lambda thing: entry(with_std(*both(thing)), both(thing)[0])


def roughly(value: float | None) -> str:
    """A number to two significant digits."""
    return plain(value, 2)


def table_of(
    name: str,
    title: str,
    columns: Sequence[Cells[_Thing]],
    things: Iterable[_Thing],
    note: str = "",
) -> ReportTable | None:
    """A table with one row per record; None without records."""
    rows = tuple(tuple(cell(thing) for _, cell in columns) for thing in things)
    return (
        ReportTable(name, title, tuple(column for column, _ in columns), rows, note)
        if rows
        else None
    )
