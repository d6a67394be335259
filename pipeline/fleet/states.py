"""State of every campaign: new, changed, done or rejected."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from pipeline.app.outcome import EARLIER, Outcome, dated, failed
from pipeline.store import campaign as campaigns
from pipeline.store.campaign import CampaignFolder


def states(root: Path) -> Iterator[Outcome]:
    """State of every campaign under data/raw."""
    for campaign in campaigns.every(root):
        yield dated(campaign, _status)


def _status(campaign: CampaignFolder) -> Outcome:
    before, key = campaign.manifest(), campaign.read().key
    if before is not None and campaign.done(key):
        return _standing(campaign, "done", before.get("verdict"))
    rejected = campaign.rejection(key)
    if rejected is None:
        return _standing(campaign, "changed" if before else "new", None)
    refused = failed(campaign.name, rejected)
    content = {"campaign": campaign.name, "state": "rejected", "verdict": None}
    return replace(refused, content=refused.content | content, text=f"{campaign.name:24} rejected")


def _standing(campaign: CampaignFolder, state: str, verdict: str | None) -> Outcome:
    """State of a campaign that was not rejected; a report of an earlier input is marked."""
    content = {"campaign": campaign.name, "state": state, "verdict": verdict}
    report = campaign.reports / "index.html"
    shown = str(report) if report.is_file() else ""
    if shown and state != "done":
        content |= {"earlier_report": shown}
        shown += f" ({EARLIER})"
    text = f"{campaign.name:24} {state:8} {verdict or '':12} {shown}".rstrip()
    return Outcome(campaign.name, content, text)
