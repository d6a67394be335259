"""All finished campaigns together: the page over them, and what each says of the one before it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from filelock import FileLock

from pipeline.answer.archive import finished, mark, shown
from pipeline.answer.history import previous
from pipeline.base import files
from pipeline.store.campaign import Campaign, code_version, dump, versions

INDEX_MANIFEST = "index.json"


def refresh(root: Path) -> Path | None:
    """Bring the page over all campaigns up to date, and every report's change since the last.

    Nothing is drawn again whose content is still true; what a killed run left half-written goes.

    Returns:
        The page over all campaigns, None when there is no campaign.
    """
    campaigns = finished(root)
    results = {campaign.name: campaign.result() for campaign in campaigns}
    for campaign in campaigns:
        campaign.tidy()
        before = previous(results[campaign.name], results.values())
        if _told(campaign.manifest()) != mark(before):
            _tell(campaign, before)
    return _index(root, list(results.values())) if campaigns else None


def _told(manifest: Mapping[str, Any] | None) -> str | None:
    return None if manifest is None else manifest.get("previous")


def _tell(campaign: Campaign, before: Mapping[str, Any] | None) -> None:
    """Write a campaign's report anew, with what has changed since the previous campaign."""
    from pipeline.report.render import render

    with campaign.locked():
        manifest = campaign.manifest()
        if manifest is None or _told(manifest) == mark(before):
            return  # another run has been faster
        pages = render(campaign.result(), shown(campaign), manifest.get("run_time_s"), before)
        campaign.amend(pages, {"previous": mark(before)})


def _index(root: Path, results: list[dict[str, Any]]) -> Path:
    from pipeline.report.render import render_overview

    page, manifest = root / "reports" / "index.html", root / "data" / "processed" / INDEX_MANIFEST
    key = files.sha256(dump([results, code_version(), versions()]))
    try:
        kept = json.loads(manifest.read_bytes())
        current = kept == {"key": key, "page": files.sha256(page.read_bytes())}
    except (FileNotFoundError, ValueError):
        current = False
    if not current:
        content = render_overview(results)
        with files.writing(manifest):
            manifest.parent.mkdir(parents=True, exist_ok=True)
            with FileLock(manifest.with_name(".lock")):
                for path in (page, manifest):
                    files.sweep(path.parent, f".{path.name}.????????")
                files.write(page, content)
                files.write(manifest, dump({"key": key, "page": files.sha256(content)}))
    return page
