"""Automatic processing: find campaigns that are new or changed and complete, run them, notify.

The outcome of a campaign is remembered beside its tables, so that neither a restart nor a campaign
that cannot be read causes a second run. Nothing in a folder, and no error in it, keeps the other
campaigns from being run.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Protocol

from pipeline.app.outcome import Outcome, failed
from pipeline.base import files
from pipeline.base.errors import CannotWrite, InputError
from pipeline.base.shown import printable
from pipeline.base.strict import Strict
from pipeline.library.preferences import FILE as PREFERENCES
from pipeline.library.preferences import Notify, Preferences
from pipeline.service import notify, sync
from pipeline.service import server as service
from pipeline.service.guard import Guard
from pipeline.store import campaign as campaigns
from pipeline.store.campaign import CampaignFolder, dump

MEMORY = "seen.json"
SERVICE = "service"
"""Name used instead of a campaign's where none is at fault."""
_TOLD_AFTER = 3
"""Number of attempts after which a run that failed for internal reasons is reported to the
webhook."""
_PAUSE_S, _GROWTH, _LONGEST_S = 60.0, 4.0, 86400.0
"""Pause before the second attempt [s], factor of each further pause [1], and longest pause [s]."""
_ENTRIES = 100_000
"""Maximum number of entries of a folder that are examined; a campaign has ten."""


class _LastOutcome(Strict):
    """Outcome of a campaign as `watch` and `serve` remember it.

    Attributes:
        print: Fingerprint of the folder and the code.
        verdict: Its verdict, `rejected`, or `failed`; None before the first run.
        said: Its verdict in a sentence, or why there is none.
        attempts: Number of attempts since the folder changed.
        tried: Time of the last attempt, by this machine's clock [s].
        told: The verdict last reported; None before the first.
    """

    print: str = ""
    verdict: str | None = None
    said: str = ""
    attempts: int = 0
    tried: float = 0.0
    told: str | None = None

    @property
    def pause_s(self) -> float:
        """Pause before the next attempt [s]; infinite if another attempt would not help."""
        if self.verdict != "failed":
            return float("inf")
        return float(min(_PAUSE_S * _GROWTH ** (min(self.attempts, 99) - 1), _LONGEST_S))

    @property
    def settled(self) -> bool:
        """Whether the outcome is final enough to be reported."""
        return self.verdict is not None and (
            self.verdict != "failed" or self.attempts >= _TOLD_AFTER
        )


@dataclass(frozen=True)
class Clock:
    """Source of time; replaced in tests.

    Attributes:
        now: Seconds since 1970, by a clock that may be set back.
        pause: Waits for a number of seconds.
    """

    now: Callable[[], float] = time.time
    pause: Callable[[float], None] = time.sleep


class _Work(Protocol):
    """Brings campaigns up to date: guard.Guard, or a pool of Prefect's workers."""

    def campaign(self, campaign: CampaignFolder) -> Outcome | None:
        """Process one campaign; None if another process works on it."""

    def pages(self) -> Outcome | None:
        """Update the page over all campaigns; return the failure, if any."""


def fingerprint(folder: Path) -> str:
    """Hash of names, sizes and times of all files, and of the code; reads no content.

    Of the two times of a file, nobody can set back the one of its last change of any kind.
    """
    found = [campaigns.code_version().encode()]
    found += [b"%b:%d:%d:%d" % (os.fsencode(one[0]), *one[1:]) for one in _in(folder)]
    return files.sha256(b"\n".join(found))


def _in(folder: Path) -> Iterator[tuple[str, int, int, int]]:
    """Name, size and times [ns] of everything in a folder; links are not followed."""
    waiting, left = [os.fspath(folder)], _ENTRIES
    while waiting and left > 0:
        here = waiting.pop()
        try:
            with os.scandir(here) as entries:
                for entry in sorted(islice(entries, left), key=lambda one: one.name):
                    left -= 1
                    stat = entry.stat(follow_symlinks=False)
                    yield entry.path, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns
                    if entry.is_dir(follow_symlinks=False):
                        waiting.append(entry.path)
        except OSError as problem:  # a copy in progress renames files; a folder may be unreadable
            yield here, -1, problem.errno or 0, 0


def recall(campaign: CampaignFolder) -> _LastOutcome:
    """Remembered outcome of a campaign."""
    return service.noted(_LastOutcome, campaign.processed / MEMORY) or _LastOutcome()


def _remember(campaign: CampaignFolder, seen: _LastOutcome) -> None:
    """Save the outcome beside the tables."""
    files.write(campaign.processed / MEMORY, dump(seen.model_dump()))


def _waiting(root: Path, now: float) -> dict[CampaignFolder, str]:
    """Campaigns that are new, changed or to be tried again, with their fingerprints."""
    prints = {campaign: fingerprint(campaign.folder) for campaign in campaigns.every(root)}
    return {campaign: seen for campaign, seen in prints.items() if _due(campaign, seen, now)}


def _due(campaign: CampaignFolder, seen: str, now: float) -> bool:
    """Whether a campaign is to be run: new files, a lost report, or the end of a pause."""
    before = recall(campaign)
    if before.print != seen:
        return True
    answered = before.verdict not in (None, "rejected", "failed")
    if answered and not os.path.isfile(campaign.reports / "result.json"):
        return True
    # absolute value: a clock that was set back must not prolong the pause to a year
    return abs(now - before.tried) >= before.pause_s


def scan(
    root: Path,
    preferences: Preferences,
    work: _Work,
    clock: Clock = Clock(),
) -> Iterator[Outcome]:
    """Run campaigns that are new or changed and no longer grow; a failure does not stop the others.

    Args:
        root: The project's root.
        preferences: How long a folder must remain unchanged, storage, and webhook.
        work: How campaigns are brought up to date.
        clock: Clock of this machine.
    """
    last = service.LastScan.of(root)
    look = service.LastScan(began=clock.now())
    trouble = _noted(root, look)
    drawn = last is not None and last.drawn  # otherwise it was killed or could not draw

    def at(name: str = "") -> None:
        nonlocal look
        look = look.model_copy(update={"alive": clock.now(), "campaign": printable(name, 80)})
        trouble.extend(_noted(root, look))

    try:
        elsewhere = False
        for made in _scan(root, preferences, work, clock, trouble, at):
            at()
            drawn = False
            if made is None:
                elsewhere = True
            else:
                yield made
        if not drawn:
            wrong = work.pages()
            drawn = wrong is None and not elsewhere  # results from elsewhere: next scan
            trouble += [wrong] if wrong else []
        for campaign in campaigns.every(root):
            trouble += _wrong(campaign.name, partial(_tell, campaign, preferences.notify))
        trouble += sync.publish(root, preferences.storage)
    except Exception as problem:  # scanning continues, whatever the error
        trouble.append(failed(SERVICE, problem))
    ended = look.model_copy(update={"ended": clock.now(), "drawn": drawn})
    trouble += _noted(root, ended)
    yield from reported_once(root, trouble)


def _noted(root: Path, look: service.LastScan) -> list[Outcome]:
    """Record a scan for `doctor`; return what failed."""
    path = root / "data" / "processed" / service.LOOKED
    return _wrong(SERVICE, partial(files.write, path, dump(look.model_dump())))


def _scan(
    root: Path,
    preferences: Preferences,
    work: _Work,
    clock: Clock,
    trouble: list[Outcome],
    at: Callable[[str], None],
) -> Iterator[Outcome | None]:
    """Run campaigns as `scan` does; failures apart from the campaigns themselves go to `trouble`.

    `at` is called with the name of each campaign before it is begun.
    """
    storage = preferences.storage
    refused = sync.fetch(root, storage)
    before = _waiting(root, clock.now())
    if before:
        clock.pause(preferences.service.quiet_s)
        refused = sync.fetch(root, storage)  # also copies what is still growing there
    trouble += refused
    for campaign, seen in before.items():
        if fingerprint(campaign.folder) != seen:  # still being copied: left to the next scan
            continue
        at(campaign.name)
        made = work.campaign(campaign)
        if made is not None:
            trouble += _wrong(campaign.name, partial(_learn, campaign, seen, made, clock.now()))
        yield made


def attend(campaign: CampaignFolder, seen: str, work: _Work) -> Outcome | None:
    """Bring one campaign up to date that a scan has handed out, with its fingerprint at that time.

    Returns:
        None if it has changed since, which the next scan notices, or was done by another process.
    """
    with _attending(campaign):
        if fingerprint(campaign.folder) != seen or not _due(campaign, seen, time.time()):
            return None
        made = work.campaign(campaign)
        if made is not None:
            _learn(campaign, seen, made, time.time())
        return made


def _attending(campaign: CampaignFolder, patience_s: float = -1.0) -> AbstractContextManager[bool]:
    """Hold a campaign that was handed out during the whole of its run."""
    return service.held(campaign.processed / ".attended", patience_s)


def attended(campaign: CampaignFolder) -> bool:
    """Whether a process works on a campaign that was handed out."""
    with _attending(campaign, 0.0) as free:
        return not free


def _wrong(name: str, work: Callable[[], object]) -> list[Outcome]:
    """Call `work`; return its failure as outcome, such as a full disk."""
    try:
        work()
    except Exception as problem:
        return [failed(name, problem)]
    return []


def reported_once(root: Path, trouble: list[Outcome]) -> list[Outcome]:
    """What was not reported at the last scan; everything if that cannot be remembered."""
    try:
        return sync.unreported(root, trouble)
    except CannotWrite as problem:
        return [*trouble, failed(SERVICE, problem)]


def _learn(campaign: CampaignFolder, seen: str, made: Outcome, now: float) -> None:
    before = recall(campaign)
    new = {
        "print": seen,
        "verdict": verdict_of(made),
        "said": _sentence_of(made),
        "attempts": before.attempts + 1 if before.print == seen else 1,
        "tried": now,
    }
    _remember(campaign, before.model_copy(update=new))


def verdict_of(made: Outcome) -> str:
    """The verdict, `rejected` if the input was, or `failed` if another attempt may help.

    Another one may where pipeline.toml is at fault: it is not among the files of the campaign,
    whose change would be noticed.
    """
    if made.verdict is not None:
        return made.verdict
    ours = made.content.get("error", {}).get("file") == PREFERENCES
    lasting = made.exit_code == InputError.exit_code and not made.passing and not ours
    return "rejected" if lasting else "failed"


def _sentence_of(made: Outcome) -> str:
    """The verdict and what to do, from the first screen, or why there is none."""
    error = made.content.get("error")
    sentences = made.content.get("verdict_sentence", [])[:2]
    return str(error["message"]) if error else " ".join(sentences)


def _tell(campaign: CampaignFolder, whom: Notify) -> None:
    """Report a changed verdict once; a failed delivery is repeated at the next scan."""
    seen = recall(campaign)
    if seen.verdict == seen.told or not seen.settled:
        return
    if whom.webhook is None or notify.posted(whom.webhook, _message(campaign, seen)):
        _remember(campaign, recall(campaign).model_copy(update={"told": seen.verdict}))


def _message(campaign: CampaignFolder, seen: _LastOutcome) -> dict[str, str | None]:
    """Message for a webhook; `text` is the key that chat programs display."""
    news = f"{seen.told} -> {seen.verdict}" if seen.told else str(seen.verdict)
    return {
        "text": f"{campaign.name}: {news}. {seen.said}".rstrip(),
        "campaign": campaign.name,
        "before": seen.told,
        "verdict": seen.verdict,
        "report": str((campaign.reports / "index.html").resolve()),
    }


def watch(root: Path, preferences: Preferences) -> Iterator[Outcome]:
    """Scan data/raw repeatedly, without Prefect, until the process ends."""
    wanted = preferences.service
    with Guard(root, "local", wanted) as guard:
        while True:
            began = time.monotonic()
            yield from scan(root, preferences, guard)
            time.sleep(max(0.0, wanted.interval_s - (time.monotonic() - began)))
