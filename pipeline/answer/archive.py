"""Finished answers of campaigns, the one of the previous campaign, and the tables of reports."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline import tables
from pipeline.answer import contract
from pipeline.answer.contract import Answer, Reason
from pipeline.answer.history import precedes, previous
from pipeline.answer.recommended import row_of
from pipeline.answer.words import BECAUSE
from pipeline.base import files, parquet
from pipeline.base.appearance import Appearance, AppearanceFacts
from pipeline.base.doors import is_there, opened
from pipeline.base.errors import UsageError
from pipeline.diagnosis.finding import Verdict
from pipeline.store.campaign import CampaignFolder, dump

_SHOWN = {
    "rejected": "13_rejected",
    "registration": "20_registration",
    "forces": "22_forces",
    "displacements": "23_displacements",
    "covariance": "41_covariance",
    "residuals": "42_residuals",
    "models": "46_models",
    "enough": "47_enough",
    "examined": "50_examined",
    "curves": "50_curves",
    "curve_readings": "51_curve_readings",
    "diagnosis": "51_diagnosis",
    "separability": "52_separability",
    "laws": "53_laws",
    "validation": "60_validation",
    "held_out": "60_held_out",
    "workspace": "61_workspace",
    "workspace_joint_springs": "62_workspace_joint_springs",
    "arm": "63_arm",
    "scene": "70_scene",
    "poses": "71_poses",
    "vectors": "72_vectors",
    "posture": "73_posture",
    "path": "63_path",
}
"""Names of the tables that a report shows, and of the files in which they are kept."""


@dataclass(frozen=True, eq=False)
class Finished:
    """A campaign with its answer.

    Attributes:
        campaign: The campaign.
        answer: Its answer as written by the last finished run.
        digest: SHA-256 of the result.json from which the answer was read.
    """

    campaign: CampaignFolder
    answer: Answer
    digest: str


def read(campaign: CampaignFolder) -> Answer:
    """The answer of a campaign as written by its last finished run.

    Raises:
        UsageError: There is none, or that of an earlier version lacks what is now required.
    """
    return with_digest(campaign).answer


def with_digest(campaign: CampaignFolder) -> Finished:
    """A campaign with its answer and the digest that identifies it.

    Raises:
        UsageError: There is no answer, or that of an earlier version lacks what is now required.
    """
    try:
        written = campaign.result_text()
        content = _brought_up_to_date(json.loads(written))
        # keys that only another version knows are ignored
        answer = Answer.model_validate(content, strict=False, extra="ignore")
        return Finished(campaign, answer, files.sha256(written))
    except (ValueError, LookupError, TypeError, AttributeError, OSError, RecursionError) as problem:
        raise UsageError(
            f"{campaign.name} has a result of an earlier version: run `pipeline run "
            f"{campaign.name}` first"
        ) from problem


def done(campaign: CampaignFolder, key: str) -> Answer | None:
    """The answer of an earlier run with the same key and intact outputs; None without one."""
    return read(campaign) if campaign.done(key) else None


def _brought_up_to_date(content: dict[str, Any]) -> dict[str, Any]:
    """Convert the content of a result.json, possibly of an earlier version, to this version.

    Early versions had values of the joint springs only, and no name of the joint in a stiffness.
    """
    alone = {name: content[name] for name in contract.Values.model_fields}
    extended = content.get("extended")
    return {
        "recommended": _joint_springs_alone(Verdict(content["diagnosis"]["verdict"])),
        **_joints_named(content),
        "diagnosis": {"reasons": [], **content["diagnosis"]},
        "joint_springs": _joints_named(content.get("joint_springs", alone)),
        "extended": extended and _joints_named(extended),
    }


def _joint_springs_alone(verdict: Verdict) -> dict[str, Any]:
    """Recommendation of an early version, which had values of the joint springs only."""
    row = row_of(Reason.ADEQUATE if verdict is Verdict.ADEQUATE else Reason.UNEXPLAINED)
    alone = {"model": row.model, "data": row.data, "reason": row.reason, "why": BECAUSE[row.reason]}
    return {**alone, "hypotheses": [{"weight": 1.0, "causes": []}]}


def _joints_named(values: dict[str, Any]) -> dict[str, Any]:
    named = [{"joint_name": j["name"].removeprefix("k_"), **j} for j in values["stiffness"]]
    return {**values, "stiffness": named}


def finished(root: Path, tell: Callable[[str], object] = str) -> list[Finished]:
    """Campaigns with a finished result, sorted by name; their raw folders may no longer exist.

    Args:
        root: Root of the project.
        tell: Called with a sentence on each campaign that is omitted because this version cannot
            read its result.
    """
    out = []
    for campaign, _ in _with_manifest(root):
        try:
            out.append(with_digest(campaign))
        except UsageError as problem:
            tell(str(problem))
    return out


def _with_manifest(root: Path) -> Iterator[tuple[CampaignFolder, dict[str, Any]]]:
    for path in sorted((root / "reports").glob("*/result.json")):
        campaign = CampaignFolder(root, root / "data" / "raw" / path.parent.name)
        manifest = campaign.manifest()
        if manifest is not None:  # the folder of a campaign that was run by path is elsewhere
            yield CampaignFolder(root, root / manifest.get("source", campaign.folder)), manifest


def earlier(campaign: CampaignFolder, answer: Answer) -> Answer | None:
    """The answer to the same robot's previous finished campaign; None without one.

    Candidates are chosen by their manifests, and read from the latest day backwards, to avoid
    reading the hundreds of campaigns of a whole plant.
    """
    by_day: dict[str, list[CampaignFolder]] = {}
    for other, manifest in _with_manifest(campaign.root):
        day = manifest.get("measured", _LONG_AGO)
        alike = all(manifest.get(key, said) == said for key, said in _machine(answer).items())
        if alike and precedes(day, answer.measured):
            by_day.setdefault(day, []).append(other)
    found = _readable(by_day.pop(_LONG_AGO, []))
    for day in sorted(by_day, reverse=True):
        found += _readable(by_day[day])
        last = previous(answer, found)
        if last is not None and str(last.measured) >= day:
            return last
    return previous(answer, found)


def _readable(campaigns: list[CampaignFolder]) -> list[Answer]:
    found = []
    for one in campaigns:
        with contextlib.suppress(UsageError):
            found.append(read(one))
    return found


_LONG_AGO = "0000"
"""Date assumed for a manifest of an earlier version, which did not contain one."""


def about(answer: Answer) -> dict[str, str | None]:
    """Entries of the manifest by which `earlier` selects campaigns without reading answers."""
    return _machine(answer) | {"measured": answer.measured}


def _machine(answer: Answer) -> dict[str, str | None]:
    return {"robot": answer.robot, "machine": answer.machine}


_TOGETHER, _REFRESH = "pipeline.fleet.pages:robots_together", "pipeline.fleet.pages:refresh"
"""Doors of the fleet, which evaluates all campaigns together."""


def robots_together(answer: Answer, root: Path) -> str | None:
    """Sentence on all campaigns of the answer's robot together, as known so far.

    None if the fleet is not installed or states nothing; the page then compares with the previous
    campaign.
    """
    return opened(_TOGETHER)(answer, root) if is_there(_TOGETHER) else None


def refresh(root: Path) -> Path | None:
    """Bring the page over all campaigns up to date, and the parts of reports on other campaigns.

    Returns:
        Path of the page; None if there is no campaign or the fleet is not installed.
    """
    page: Path | None = opened(_REFRESH)(root) if is_there(_REFRESH) else None
    return page


def mark(before: Answer | None) -> str | None:
    """Digest of the part of the previous answer on which a report depends; None without one."""
    if before is None:
        return None
    stiffness = [joint.model_dump(mode="json") for joint in before.stiffness]
    return files.sha256(dump([before.campaign, stiffness]))


def kept_tables(campaign: CampaignFolder) -> dict[str, pd.DataFrame]:
    """The tables of a report as kept by the run, by name."""
    paths = {name: campaign.processed / f"{file}.parquet" for name, file in _SHOWN.items()}
    return {name: tables.frame(parquet.read(p)) for name, p in paths.items() if p.is_file()}


def look_of(
    dress: Callable[[Mapping[str, Any], AppearanceFacts], Appearance],
    said: Mapping[str, Any],
    of: Answer,
) -> Appearance:
    """Appearance of a campaign's certificate, with the facts that lines of the house may quote.

    Args:
        dress: Result of `looks` for the project.
        said: Language and fields stated in campaign.toml, as kept in the manifest.
        of: The answer.
    """
    worst = of.tolerance.worst if of.tolerance else None
    facts = {
        "campaign": of.name,
        "measured": (of.measured or "")[:10],
        "operator": (of.identity and of.identity.operator) or "",
        "robot": of.robot,
        "machine": of.machine,
        "verdict": str(of.diagnosis.verdict),
        "tolerance": str(worst or ""),
        "digest": files.sha256(dump(of.as_json()))[:16],
    }
    return dress(said, facts)
