"""All finished campaigns together: the page over them, and what each says of the one before it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from filelock import FileLock

from pipeline.answer import fleet
from pipeline.answer.archive import Finished, earlier, finished, mark, read, shown
from pipeline.answer.history import previous
from pipeline.base import files
from pipeline.base.errors import CannotWrite
from pipeline.store.campaign import Campaign, code_version, dump, recalled, versions

INDEX_MANIFEST = "index.json"


def refresh(root: Path) -> Path | None:
    """Bring page and tables over all campaigns up to date, and each report's change since the last.

    Nothing is drawn again whose content is still true; what a killed run left half-written goes,
    and a campaign whose result no longer counts is left out, which is said.

    Returns:
        The page over all campaigns, None when there is no campaign.
    """
    everyone = finished(root, _left_out)
    answers = [one.answer for one in everyone]
    for one in everyone:
        one.campaign.tidy()
        before = previous(one.answer, answers)
        if (one.campaign.manifest() or {}).get("previous") != mark(before):
            _tell(one.campaign)
    with suppress(CannotWrite):  # the next query makes what is missing, or says why not
        fleet.refresh(root)
    return _index(root, everyone) if everyone else None


def _left_out(why: str) -> None:
    sys.stderr.write(f"{why} Until then it is left out of the page over all campaigns.\n")


def _tell(campaign: Campaign) -> None:
    """Write a campaign's report anew, with what has changed since the previous campaign."""
    from pipeline.report.render import render

    with campaign.locked():
        manifest, answer = campaign.manifest(), read(campaign)
        before = earlier(campaign, answer)  # of what is there now that nobody else writes here
        if manifest is None or manifest.get("previous") == mark(before):
            return  # another run has been faster
        took, beside = manifest.get("run_time_s"), campaign.answers(manifest)
        pages = render(answer, shown(campaign), took, before, beside)
        campaign.publish(manifest | {"previous": mark(before)}, pages)


def _index(root: Path, everyone: Sequence[Finished]) -> Path:
    """The page over these, drawn of those that are finished once no other run draws it."""
    from pipeline.report.render import render_overview

    page, manifest = root / "reports" / "index.html", root / "data" / "processed" / INDEX_MANIFEST
    if _is_of(page, manifest, _key(everyone)):
        return page
    with files.writing(manifest):
        manifest.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(manifest.with_name(".lock")):
            now = finished(root) or everyone
            if not _is_of(page, manifest, key := _key(now)):
                content = render_overview([one.answer for one in now])
                for path in (page, manifest):
                    files.sweep(path.parent, f".{path.name}.????????")
                files.write(page, content)
                files.write(manifest, dump({"key": key, "page": files.sha256(content)}))
    return page


def _key(everyone: Sequence[Finished]) -> str:
    digests = [one.digest for one in everyone]
    return files.sha256(dump([digests, code_version(), versions()]))


def _is_of(page: Path, manifest: Path, key: str) -> bool:
    drawn = files.sha256(page.read_bytes()) if page.is_file() else None
    return bool(recalled(manifest) == {"key": key, "page": drawn})
