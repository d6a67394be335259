"""`remove`: take a campaign out of all pages and tables, and keep its measurements aside."""

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
    """Delete the results of a campaign and move its measurements aside.

    Args:
        root: The project's root.
        name: Name of the campaign, whose folder in data/raw may be gone.

    Returns:
        Where its folder is kept; None if there was none in data/raw.

    Raises:
        UsageError: There is no such campaign.
        CannotWrite: The disk cannot be written.
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
    if pages.refresh(root) is None:  # it was the last one
        (root / "reports" / "index.html").unlink(missing_ok=True)
    return kept


def _vacant(path: Path) -> Path:
    """The path, with a number appended if it exists already."""
    number = 1
    free = path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.name}-{number}")
    return free
