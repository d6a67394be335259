"""The frozen records a report is made of; all text in them is plain, never markup."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TypeVar

from pipeline.base.quantities import MISSING, known, typeset

_Part = TypeVar("_Part")


@dataclass(frozen=True)
class TableEntry:
    """One cell of a table.

    Attributes:
        text: What is shown.
        sort: What it is sorted by: a number where it shows one.
        link: Address relative to the page, where it leads somewhere.
    """

    text: str
    sort: float | str | None = None
    link: str = ""


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes:
        title: Heading, with its unit where all cells share one.
        numeric: Aligned to the right and sorted as numbers.
        code: File names and hashes, set in a fixed width.
    """

    title: str
    numeric: bool = False
    code: bool = False

    def prose(self, cell: TableEntry) -> bool:
        """Whether a cell is so long that its lines are broken."""
        return not (self.numeric or self.code) and len(cell.text) > _LINE


_LINE = 24
"""Characters of a cell that stay on one line."""

_PROSE_REM, _LETTER_REM, _EDGES_REM = 13.0, 0.55, 1.6
"""Least width of a cell of prose, width of a letter, space at both sides, as in page.css."""

_HALF_REM = 34.0
"""Least width of half a page in page.css."""

_FEW = 4
"""A table of more columns is read more easily across the page."""


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
        """Whether it takes the whole width of the page: half would cut off its last column."""
        least = sum(map(self._least_rem, range(len(self.columns))))
        return len(self.columns) > _FEW or least > _HALF_REM

    def _least_rem(self, place: int) -> float:
        """Least width of a column [rem]; words of a heading break."""
        column, cells = self.columns[place], [row[place] for row in self.rows]
        if any(map(column.prose, cells)):
            return _PROSE_REM
        letters = [*map(len, column.title.split()), *(len(cell.text) for cell in cells)]
        return _EDGES_REM + _LETTER_REM * max(letters, default=0)


@dataclass(frozen=True)
class Paragraph:
    """A paragraph; a `finding` is something to act on."""

    kind: str = field(default="text", init=False)
    text: str
    tone: str = "plain"

    def __post_init__(self) -> None:
        """Set numbers and units as they are printed."""
        object.__setattr__(self, "text", typeset(self.text))


@dataclass(frozen=True)
class Figure:
    """A picture that is drawn under this name.

    Attributes:
        name: File name without ending.
        title: What it shows.
        caption: What to see in it.
        alt: What it shows and says, for who cannot see it.
        held: It stays where its text is, also on paper.
    """

    kind: str = field(default="figure", init=False)
    name: str
    title: str
    caption: str
    alt: str
    held: bool = False

    def __post_init__(self) -> None:
        """Set numbers and units as they are printed."""
        object.__setattr__(self, "caption", typeset(self.caption))


Block = ReportTable | Paragraph | Figure


@dataclass(frozen=True)
class Section:
    """A heading and what stands below it."""

    key: str
    title: str
    blocks: tuple[Block, ...]


def present(parts: Iterable[_Part | None]) -> tuple[_Part, ...]:
    """Those that are there."""
    return tuple(part for part in parts if part is not None)


def section_of(key: str, title: str, blocks: Iterable[Block | None]) -> Section | None:
    """A part with the blocks that are there, None when none is."""
    kept: tuple[Block, ...] = present(blocks)
    return Section(key, title, kept) if kept else None


@dataclass(frozen=True)
class Item:
    """One line of the first screen: what it is about, if that is said, and what it says."""

    label: str
    text: str

    def __post_init__(self) -> None:
        """Set numbers and units as they are printed."""
        object.__setattr__(self, "text", typeset(self.text))


def unlabelled(*texts: str) -> tuple[Item, ...]:
    """Lines that need no label."""
    return tuple(Item("", text) for text in texts)


@dataclass(frozen=True)
class Bar:
    """One stiffness of the certificate.

    Attributes:
        name: Axis and joint.
        value: With its standard uncertainty.
        beside: Share of the nominal value, or the relative uncertainty where none is stated.
        enter: What a controller takes.
        track: Where lower limit, value and upper limit stand between the ends of the bar, 0 to 1;
            None where there is nothing to draw.
    """

    name: str
    value: str
    beside: str
    enter: str
    track: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        """Set numbers and units as they are printed."""
        for name in ("value", "beside", "enter"):
            object.__setattr__(self, name, typeset(getattr(self, name)))


@dataclass(frozen=True)
class Certificate:
    """The first page: what is decided and found, and what it is filed by.

    Attributes:
        found: What is wrong.
        to_do: What to do.
        measure: What to measure next.
        tolerance: Why none is judged; empty where one is.
        picture: The robot.
        gauge: The deflection beside its tolerance; None where nothing is asked.
        bars: The stiffnesses.
        nominal: Where the nominal value stands along the bars, 0 to 1; None without one.
        beside: Heading of what stands beside the bars.
        note: What has to be known of them.
        filed: What is stated of campaign, machine and instruments.
        logo: Of the house, as SVG; empty for none.
        sign: Who has to sign.
        digest: Of result.json, by which this answer is found again.
    """

    found: str
    to_do: str
    measure: str
    tolerance: str
    picture: Figure | None
    gauge: Figure | None
    bars: tuple[Bar, ...]
    nominal: float | None
    beside: str
    note: str
    filed: tuple[Item, ...]
    digest: str
    logo: str = ""
    sign: tuple[str, ...] = ("Measured", "Checked", "Released")

    def __post_init__(self) -> None:
        """Set numbers and units as they are printed."""
        for name in ("found", "to_do", "measure", "note"):
            object.__setattr__(self, name, typeset(getattr(self, name)))


TONES = ("good", "neutral", "attention", "bad")
"""From the best to the worst."""


@dataclass(frozen=True)
class Headline:
    """What is decided.

    Attributes:
        word: In a few words.
        tone: One of `TONES`.
    """

    word: str
    tone: str


@dataclass(frozen=True)
class Frame:
    """The few words of page and paper that are no part of what is said, and their language."""

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
    stiffness: str = "Stiffness (k = 1)"
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
    """Everything that is said on one page.

    Attributes:
        kicker: What the page is about, above its heading.
        heading: Its heading, a campaign's name.
        title: Title of page and PDF, complete in itself.
        verdict: The verdict in a few words.
        tone: Of the verdict, one of `TONES`.
        first: The answer in words, line by line.
        sections: The rest, in order of use.
        elsewhere: Where else to find what stands here.
        run_time: How long the run took, or None.
        judged: What a tolerance decides, told before the verdict; None without one.
        certificate: The first page; None of a report that is none of a campaign.
        frame: Words of page and paper.
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
    frame: Frame = Frame()

    @property
    def worst(self) -> str:
        """The worst tone of what the first screen begins with: no colour promises more."""
        tones = (self.tone, *([self.judged.tone] if self.judged else []))
        return max(tones, key=TONES.index)

    @property
    def figures(self) -> tuple[Figure, ...]:
        """All figures in order."""
        of = self.certificate
        first = () if of is None else present((of.picture, of.gauge))
        return (*first, *(b for s in self.sections for b in s.blocks if isinstance(b, Figure)))


def entry(text: str, sort: object = None) -> TableEntry:
    """A cell sorted by a number, or by its text where there is none."""
    return TableEntry(text, float(sort) if known(sort) else None)


def text_entry(value: object, sort: object = None) -> TableEntry:
    """A cell of words; empty shows as such."""
    text = "" if value is None else str(value)
    return TableEntry(text or MISSING, float(sort) if known(sort) else text)
