"""State of every campaign of a service: the first page of the reports, made for each request.

The page over all campaigns (`fleet`) shows what is finished. This one shows what is not: running,
waiting, to be tried again, rejected, without campaign.toml; and when data/raw was last scanned.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from urllib.parse import quote

from pipeline.base.errors import InputError
from pipeline.base.shown import printable
from pipeline.report.record import (
    Cells,
    Column,
    Report,
    ReportTable,
    TableEntry,
    section_of,
    table_of,
    unlabelled,
    word_column,
)
from pipeline.report.render import page
from pipeline.report.words import VERDICTS
from pipeline.service import doctor, watch
from pipeline.service import server as service
from pipeline.store import campaign as campaigns
from pipeline.store.campaign import CampaignFolder


class FolderState(StrEnum):
    """What a service does with a campaign; those that need attention come first."""

    REJECTED = "rejected"
    FAILED = "tried again"
    INCOMPLETE = "no campaign.toml"
    RUNNING = "running"
    WAITING = "waiting"
    DONE = "done"


_TONES = {
    FolderState.REJECTED: "bad",
    FolderState.FAILED: "bad",
    FolderState.INCOMPLETE: "attention",
}


@dataclass(frozen=True)
class _FolderStatus:
    """State of one folder of data/raw.

    Attributes:
        name: Name of the folder.
        state: What the service does with it.
        at: Since when, or time of the last attempt [s]; None if unknown.
        text: Its verdict, or why there is none.
        reported: Its folder in reports/, as an address; empty if there is no report.
    """

    name: str
    state: FolderState
    at: float | None
    text: str
    reported: str = ""


def folder_statuses(root: Path) -> list[_FolderStatus]:
    """All folders of data/raw, those that need attention first."""
    try:
        look, every = service.LastScan.of(root), campaigns.every(root)
    except InputError as problem:
        return [_FolderStatus("data/raw", FolderState.FAILED, None, str(problem))]
    found = [_of(campaign, look) for campaign in every]
    found += _incomplete(root, {os.path.realpath(campaign.folder) for campaign in every})
    order = list(FolderState)
    return sorted(found, key=lambda one: (order.index(one.state), one.name))


def _of(campaign: CampaignFolder, look: service.LastScan | None) -> _FolderStatus:
    seen = watch.recall(campaign)
    there = os.path.isfile(campaign.reports / "index.html")
    address = f"{quote(os.fsencode(campaign.name))}/index.html" if there else ""
    name = printable(campaign.name, 80)
    alive = _alive(look, name)
    if alive is not None or watch.attended(campaign):
        return _FolderStatus(name, FolderState.RUNNING, alive, "at work", address)
    if seen.print != watch.fingerprint(campaign.folder):
        new = "new" if seen.verdict is None else "changed since it was last run"
        return _FolderStatus(
            name, FolderState.WAITING, None, f"{new}: the next look takes it", address
        )
    if seen.verdict == "failed":
        again = f"tried {seen.attempts} times, again at {_clock(seen.tried + seen.pause_s)}"
        return _FolderStatus(name, FolderState.FAILED, seen.tried, f"{again}: {seen.said}", address)
    if seen.verdict == "rejected":
        return _FolderStatus(name, FolderState.REJECTED, seen.tried, seen.said, address)
    words = VERDICTS.get(seen.verdict or "", (seen.said, ""))[0]
    return _FolderStatus(name, FolderState.DONE, seen.tried, words, address)


def _alive(look: service.LastScan | None, name: str) -> float | None:
    """When the scan that works on a campaign last reported; None if none does."""
    at_it = look is not None and look.ended is None and look.campaign == name
    return look.alive if look is not None and at_it else None


def _incomplete(root: Path, known: set[str]) -> Iterator[_FolderStatus]:
    """Folders that are not processed because they have no campaign.toml."""
    raw = root / "data" / "raw"
    with suppress(OSError):
        for name in os.listdir(raw):
            real = os.path.realpath(raw / name)  # a campaign may be there by other names, too
            if name[0] != "." and real not in known and os.path.isdir(real):
                text = "not taken before it has one: `pipeline init` writes it"
                yield _FolderStatus(printable(name, 80), FolderState.INCOMPLETE, None, text)


def _clock(at: float | None) -> str:
    """Local time to the second, or on another day, date and minutes."""
    if at is None:
        return ""
    when = datetime.fromtimestamp(at)
    today = when.date() == datetime.now().date()
    return when.strftime("%H:%M:%S" if today else "%Y-%m-%d %H:%M")


def now(root: Path) -> bytes:
    """The page, as HTML that needs no other file."""
    found = folder_statuses(root)
    verdict, tone = _verdict(found)
    parts = [section_of("campaigns", "Campaigns", [_table(found)])]
    more = section_of("pages", "Results", [_pages(root)])
    report = Report(
        kicker="Joint stiffness",
        heading="Campaigns now",
        title="Joint stiffness: campaigns now",
        verdict=verdict,
        tone=tone,
        first=unlabelled(*_looked(root)),
        sections=tuple(part for part in (*parts, more) if part),
        elsewhere="This page is made anew every ten seconds.",
    )
    return page(report, {}).encode()


def _verdict(found: Sequence[_FolderStatus]) -> tuple[str, str]:
    """Number of campaigns in each state, and the tone of the first of them."""
    if not found:
        return "No campaign yet", "neutral"
    counts = Counter(one.state for one in found)
    words = ", ".join(f"{counts[state]} {state}" for state in FolderState if counts[state])
    return words[0].upper() + words[1:], _TONES.get(found[0].state, "neutral")


def _looked(root: Path) -> Iterator[str]:
    """When data/raw was last scanned, and how often that happens."""
    running = service.Running.of(root)
    if running is not None:
        yield f"Looks at data/raw: {doctor.looks(root, running).text}."
        if running.every_s:
            yield f"One every {running.every_s:g} s. It is {_clock(time.time())} now."


def _linked(one: _FolderStatus) -> TableEntry:
    return TableEntry(one.name, one.name, one.reported)


def _table(found: Sequence[_FolderStatus]) -> ReportTable | None:
    columns: list[Cells[_FolderStatus]] = [
        (Column("Campaign"), _linked),
        word_column("State", lambda one: str(one.state)),
        word_column("Since", lambda one: _clock(one.at)),
        word_column("What is known of it", lambda one: one.text),
    ]
    return table_of("campaigns", "Every folder of data/raw", columns, found)


def _pages(root: Path) -> ReportTable | None:
    if not (root / "reports" / "index.html").is_file():
        return None
    over = "verdicts, stiffnesses over time, wear"
    columns: list[Cells[str]] = [
        (Column("Page"), lambda name: TableEntry(name, name, "index.html")),
        word_column("What it has", lambda _: over),
    ]
    return table_of("pages", "All finished campaigns", columns, ["All campaigns"])
