"""`remove`: a campaign out of every page and table, its measurements kept aside."""

from __future__ import annotations

import shutil
from pathlib import Path

from pipeline.base import files
from pipeline.base.errors import UsageError
from pipeline.fleet import pages
from pipeline.store.campaign import CampaignFolder

REMOVED = "removed"
"""Folder under data where measurements of removed campaigns are kept."""


def remove(root: Path, name: str) -> Path | None:
    """Delete what was computed of a campaign and move what was measured aside.

    Args:
        root: The project's root.
        name: Of the campaign, whose folder in data/raw may be gone.

    Returns:
        Where its folder is kept; None where there was none in data/raw.

    Raises:
        UsageError: There is no such campaign.
        CannotWrite: The disk refuses.
    """
    campaign = CampaignFolder(root, root / "data" / "raw" / Path(name).name)
    there = [one for one in (campaign.folder, campaign.processed, campaign.reports) if one.is_dir()]
    if not there:
        raise UsageError(f"there is no campaign {name}, neither measured nor computed")
    kept = None
    with campaign.locked(), files.writing(campaign.reports):
        if campaign.folder.is_dir():
            kept = _vacant(root / "data" / REMOVED / campaign.name)
            kept.parent.mkdir(parents=True, exist_ok=True)
            campaign.folder.rename(kept)
        shutil.rmtree(campaign.reports, ignore_errors=True)
    with files.writing(campaign.processed):
        shutil.rmtree(campaign.processed, ignore_errors=True)
    if pages.refresh(root) is None:  # it was the last
        (root / "reports" / "index.html").unlink(missing_ok=True)
    return kept


def _vacant(path: Path) -> Path:
    """The path, with a number behind it where something is there already."""
    number = 1
    free = path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.name}-{number}")
    return free
