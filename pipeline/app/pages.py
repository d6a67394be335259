"""All finished campaigns together: the page over them, and what each says of the one before it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from filelock import FileLock

from pipeline.answer.archive import finished, mark, shown
from pipeline.answer.history import chance, changes, previous, together, trusted
from pipeline.base import files
from pipeline.base.arrays import Array
from pipeline.base.errors import UsageError
from pipeline.report import words
from pipeline.report.overview import NOT_EXPLAINED, SAME_READINGS, comparison
from pipeline.report.record import Report
from pipeline.store.campaign import Campaign, code_version, dump, find, versions

COVARIANCES = {"recommended": "41_covariance", "joints": "41_covariance_joint_springs"}
"""Models of a campaign that can be compared, with the tables of their covariance."""

MODELS = (*COVARIANCES, "extended")
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


def compare(root: Path, first: str, second: str) -> tuple[Report, dict[str, Any]]:
    """Two campaigns, or two models of one: what is said, and the same as data.

    Args:
        root: The project's root.
        first: A campaign, whose answer's values are taken, or `campaign:joints` (the joint
            springs alone on the data as given) or `campaign:extended` (the causes' own fit).
        second: As before.

    Raises:
        InputError: There is no such campaign.
        UsageError: There is no such model, or no result yet.
    """
    if first == second:
        raise UsageError(f"{first} is compared with itself: name another campaign or model")
    sides = [_side(root, name) for name in (first, second)]
    (a, entries_a, cov_a), (b, entries_b, cov_b) = sides
    whole = [one for one in (a, b) if one.name in (first, second)]
    loose = [one.name for one in whole if not trusted(one.result())]
    independent = a.name != b.name and not loose
    covariances = (cov_a, cov_b) if independent else None
    why = NOT_EXPLAINED.format(" and ".join(loose)) if loose else SAME_READINGS
    models = (_model(a, first), _model(b, second))
    report = comparison((first, second), entries_a, entries_b, covariances, why, models)
    found = changes(entries_a, entries_b, independent)
    same = [j["name"] for j in entries_a] == [j["name"] for j in entries_b]
    chi2, dof = together(entries_a, entries_b, cov_a, cov_b) if independent and same else (None, 0)
    content = {
        "before": first,
        "after": second,
        "stiffness": [asdict(change) for change in found],
        "chi2": chi2,
        "dof": dof,
        "p_value": None if chi2 is None else chance(chi2, dof),
    }
    return report, content


def _model(campaign: Campaign, name: str) -> str:
    """Which model's values were asked for, in words; nothing where the name says it."""
    return words.values_of(campaign.result()) if name == campaign.name else ""


def _side(root: Path, name: str) -> tuple[Campaign, list[dict[str, Any]], Array]:
    """A campaign, the stiffness entries of one model and their covariance."""
    campaign, model = _campaign_and_model(root, name)
    result = campaign.result()
    if model == "extended":
        if not result.get("extended"):
            raise UsageError(f"{campaign.name} has no richer model than its joint springs")
        entries = result["extended"]["stiffness"]
        std = [j["compliance_std"] for j in entries]
        return campaign, entries, np.diag([np.nan if s is None else s**2 for s in std])
    if "joint_springs" not in result:
        raise UsageError(f"{campaign.name} is of an older version: run `pipeline run` first")
    entries = (result if model == "recommended" else result["joint_springs"])["stiffness"]
    names = [f"c_{j['name'].removeprefix('k_')}" for j in entries]
    kept = campaign.processed / f"{COVARIANCES[model]}.parquet"
    if not kept.is_file():
        raise UsageError(f"{campaign.name} has no covariance: run `pipeline run {campaign.name}`")
    cov = pd.read_parquet(kept).set_index("parameter").loc[names, names]
    return campaign, entries, cov.to_numpy(float)


def _campaign_and_model(root: Path, name: str) -> tuple[Campaign, str]:
    known = {campaign.name: campaign for campaign in finished(root)}
    head, _, model = name.rpartition(":")
    if name in known:
        return known[name], "recommended"
    if head in known:
        if model not in MODELS:
            raise UsageError(f'there is no model "{model}": use {", ".join(MODELS)}')
        return known[head], model
    return find(root, name), "recommended"
