"""Pages of all finished campaigns: the overview, what each states of others, and removal."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from pipeline.answer.archive import Among, Finished, kept_tables, read
from pipeline.answer.contract import Answer
from pipeline.base import files
from pipeline.base.appearance import Dress, appearances
from pipeline.base.errors import CannotWrite, UsageError
from pipeline.base.shown import printable
from pipeline.fleet import tables as fleet
from pipeline.fleet.history import about, earlier, finished, mark, previous
from pipeline.fleet.preferred import expected_scatter
from pipeline.fleet.sentences import alarm, fleet_sentences
from pipeline.fleet.wear_table import RobotWear
from pipeline.store.campaign import CampaignFolder, code_version, dump, recalled, versions

_INDEX_MANIFEST = "index.json"


def refresh(root: Path) -> Path | None:
    """Update the overview and its tables, and in each report the change since the last campaign.

    Only outdated pages are drawn again; remains of killed runs are removed, and a campaign whose
    result is outdated is left out, which is reported.

    Returns:
        The page over all campaigns, None if there is no campaign.
    """
    everyone = finished(root, _left_out)
    answers = [one.answer for one in everyone]
    wear, dress = _wear(root), appearances(root)
    for one in everyone:
        tidy(one.campaign)
        stands = {
            "previous": mark(previous(one.answer, answers)),
            "wear": fleet_sentences(one.answer, wear),
        }
        manifest = one.campaign.manifest() or {}
        stands["look"] = dress(manifest, one.answer).key
        if not _says(manifest, stands):
            _tell(one.campaign, dress)
    return _index(root, everyone, wear) if everyone else None


def tidy(campaign: CampaignFolder) -> None:
    """Remove what a killed run left behind, also if nothing has to be computed.

    A running process cleans up after itself, and a read-only disk is left unchanged.
    """
    folders = (campaign.processed, campaign.reports)
    if not any(files.leftovers(folder) for folder in folders):
        return
    with suppress(Timeout, OSError), FileLock(campaign.processed / ".lock", timeout=0):
        for folder in folders:
            files.sweep(folder)


def among(campaign: CampaignFolder, answer: Answer) -> Among:
    """What a campaign's page states about the other campaigns of its robot, as known so far."""
    before, wear = earlier(campaign, answer), fleet_sentences(answer, fleet.wear(campaign.root))
    return Among(before, wear, {"previous": mark(before), "wear": wear} | about(answer))


def _wear(root: Path) -> tuple[RobotWear, ...]:
    """Wear of all robots, updated; new alarms are printed."""
    before = _alarms(fleet.wear(root))
    with suppress(CannotWrite):  # the next query creates what is missing, or says why not
        fleet.refresh(root, expected_scatter(root))
    wear = fleet.wear(root)
    for machine, words in _alarms(wear).items():
        if before.get(machine) != words:
            sys.stderr.write(f"{printable(machine)}: {printable(words)}\n")
    return wear


def _alarms(wear: Sequence[RobotWear]) -> dict[str, str]:
    return {one.machine: alarm(one) for one in wear if one.alarm}


def _says(manifest: Mapping[str, Any], stands: Mapping[str, str | None]) -> bool:
    """Whether a report agrees with the present previous campaign, wear and look."""
    return all(manifest.get(name) == value for name, value in stands.items())


def _left_out(why: str) -> None:
    sys.stderr.write(f"{why} Until then it is left out of the page over all campaigns.\n")


def _tell(campaign: CampaignFolder, dress: Dress) -> None:
    """Write a campaign's report again, with the changes since previous campaigns."""
    from pipeline.report.render import render

    with campaign.locked():
        manifest, answer = campaign.manifest(), read(campaign)
        beside = among(campaign, answer)  # as read under the lock
        look = dress(manifest or {}, answer)
        stands = {**beside.kept, "look": look.key}
        if manifest is None or _says(manifest, stands):
            return  # another run has done it
        took, there = manifest.get("run_time_s"), campaign.answers(manifest)
        pages = render(
            answer, kept_tables(campaign), took, beside.previous, there, beside.wear, look
        )
        campaign.publish(manifest | stands, pages)


def _index(root: Path, everyone: Sequence[Finished], wear: Sequence[RobotWear]) -> Path:
    """The page over all campaigns, drawn under a lock from those finished by then."""
    from pipeline.fleet.overview import render_overview

    page, manifest = root / "reports" / "index.html", root / "data" / "processed" / _INDEX_MANIFEST
    if _is_of(page, manifest, _key(everyone, wear)):
        return page
    with files.writing(manifest):
        manifest.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(manifest.with_name(".lock")):
            now = finished(root) or everyone
            if not _is_of(page, manifest, key := _key(now, wear)):
                content = render_overview([one.answer for one in now], wear)
                for path in (page, manifest):
                    files.sweep(path.parent, f".{path.name}.????????")
                files.write(page, content)
                files.write(manifest, dump({"key": key, "page": files.sha256(content)}))
    return page


def _key(everyone: Sequence[Finished], wear: Sequence[RobotWear]) -> str:
    digests = [one.digest for one in everyone]
    return files.sha256(dump([digests, repr(wear), code_version(), versions()]))


def _is_of(page: Path, manifest: Path, key: str) -> bool:
    drawn = files.sha256(page.read_bytes()) if page.is_file() else None
    return bool(recalled(manifest) == {"key": key, "page": drawn})


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
    if refresh(root) is None:  # it was the last one
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
