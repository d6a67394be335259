"""By itself: find campaigns that are new or changed and complete, run them, tell who wants to know.

What was made of a campaign is remembered beside its tables, so that neither a restart nor a
campaign that cannot be read makes a run happen twice.
"""

from __future__ import annotations

import json
import time
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from pipeline.app import sync
from pipeline.app.outcome import Compute, Outcome, outcome
from pipeline.app.preferences import Notify, Preferences
from pipeline.base import files
from pipeline.base.errors import InputError
from pipeline.store import campaign as campaigns
from pipeline.store.campaign import Campaign, dump

MEMORY = "seen.json"
_PATIENCE = 3
"""How often a run that broke for reasons of its own is tried before the campaign has to change."""


@dataclass(frozen=True)
class Seen:
    """What was made of a campaign, as `watch` and `serve` remember it.

    Attributes:
        print: Fingerprint of the folder and the code.
        verdict: Its verdict, `rejected`, or `failed`; None before the first run.
        attempts: How often it was tried since the folder changed.
        told: The verdict that was last told; None before the first.
    """

    print: str = ""
    verdict: str | None = None
    attempts: int = 0
    told: str | None = None

    @property
    def settled(self) -> bool:
        """Nothing is to be gained from trying again."""
        return self.verdict != "failed" or self.attempts >= _PATIENCE


def _fingerprint(campaign: Campaign) -> str:
    """Names, sizes and times of everything in a folder, and the code; cheap, reads no content."""
    found = [campaigns.code_version()]
    for path in sorted(campaign.folder.rglob("*")):
        try:
            stat = path.stat()
        except FileNotFoundError:  # a copy in progress renames its files
            continue
        name = path.relative_to(campaign.folder).as_posix()
        found.append(f"{name}:{stat.st_size}:{stat.st_mtime_ns}")
    return files.sha256("\n".join(found).encode())


def _recall(campaign: Campaign) -> Seen:
    """What is remembered of a campaign."""
    try:
        return Seen(**json.loads((campaign.processed / MEMORY).read_bytes()))
    except (FileNotFoundError, ValueError, TypeError):
        return Seen()


def _remember(campaign: Campaign, seen: Seen) -> None:
    """Keep it beside the tables."""
    files.write(campaign.processed / MEMORY, dump(asdict(seen)))


def _waiting(root: Path) -> dict[Campaign, str]:
    """Campaigns that changed since they were last looked at, with their fingerprints."""
    prints = {campaign: _fingerprint(campaign) for campaign in campaigns.every(root)}
    return {campaign: now for campaign, now in prints.items() if not _seen(campaign, now)}


def _seen(campaign: Campaign, now: str) -> bool:
    before = _recall(campaign)
    lost = before.verdict not in ("rejected", "failed") and not (
        (campaign.reports / "result.json").is_file()
    )
    return before.print == now and before.settled and not lost


def scan(
    root: Path,
    preferences: Preferences,
    compute: Compute,
    pause: Callable[[float], None] = time.sleep,
) -> Iterator[Outcome]:
    """Run what is new or changed and has stopped growing; one that fails stops none of the others.

    Args:
        root: The project's root.
        preferences: How long a folder must stay as it is, where campaigns live, whom to tell.
        compute: How a campaign is brought up to date.
        pause: Waits; given by tests.
    """
    storage = preferences.storage
    refused = sync.fetch(root, storage)
    before = _waiting(root)
    if before:
        pause(preferences.service.quiet_s)
        refused = sync.fetch(root, storage)  # what still grows there grows here, too
    for campaign, now in before.items():
        if _fingerprint(campaign) != now:  # still being copied: the next look will take it
            continue
        made = outcome(campaign, compute)
        _learn(campaign, now, made)
        yield made
    if before:
        from pipeline.app import pages  # brings pandas, which watching itself does not need

        pages.refresh(root)
    refused += sync.publish(root, storage)
    yield from sync.untold(root, refused)
    for campaign in campaigns.every(root):
        _tell(campaign, preferences.notify)


def _learn(campaign: Campaign, now: str, made: Outcome) -> None:
    before = _recall(campaign)
    attempts = before.attempts + 1 if before.print == now else 1
    _remember(campaign, replace(before, print=now, verdict=verdict_of(made), attempts=attempts))


def verdict_of(made: Outcome) -> str:
    """The verdict, `rejected` when the input was, or `failed` when trying again may help."""
    if made.verdict is not None:
        return made.verdict
    lasting = made.exit_code == InputError.exit_code and not made.passing
    return "rejected" if lasting else "failed"


def _tell(campaign: Campaign, notify: Notify) -> None:
    """Tell a changed verdict once; what could not be delivered is tried again next time."""
    seen = _recall(campaign)
    if seen.verdict is None or seen.verdict == seen.told or not seen.settled:
        return
    if notify.webhook is None or _posted(notify.webhook, message(campaign, seen)):
        _remember(campaign, replace(seen, told=seen.verdict))


def message(campaign: Campaign, seen: Seen) -> dict[str, str | None]:
    """What a webhook gets; `text` is the word that chats show."""
    news = f"{seen.told} -> {seen.verdict}" if seen.told else str(seen.verdict)
    said = ""
    if seen.verdict not in ("rejected", "failed"):
        from pipeline.answer.archive import read  # brings the numerical libraries

        said = " " + " ".join(read(campaign).verdict_sentence)
    return {
        "text": f"{campaign.name}: {news}.{said}",
        "campaign": campaign.name,
        "before": seen.told,
        "verdict": seen.verdict,
        "report": str((campaign.reports / "index.html").resolve()),
    }


def _posted(address: str, content: dict[str, str | None]) -> bool:
    request = urllib.request.Request(
        address, json.dumps(content).encode(), {"Content-Type": "application/json"}
    )
    try:
        with urllib.request.urlopen(request, timeout=10):
            return True
    except OSError:
        return False


def watch(root: Path, preferences: Preferences) -> Iterator[Outcome]:
    """Look at data/raw again and again, without Prefect; ends with the process."""
    from pipeline.run import run  # brings the numerical libraries, which take a second

    service = preferences.service
    while True:
        began = time.monotonic()
        yield from scan(root, preferences, run)
        time.sleep(max(0.0, service.interval_s - (time.monotonic() - began)))
