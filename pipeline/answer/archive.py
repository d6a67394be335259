"""Finished answers of campaigns, and the tables of their reports."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from pipeline import tables
from pipeline.answer.contract import Answer
from pipeline.base import files, parquet
from pipeline.base.doors import found
from pipeline.base.errors import UsageError
from pipeline.store.campaign import CampaignFolder

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
        # keys that only another version knows are ignored
        answer = Answer.model_validate(json.loads(written), strict=False, extra="ignore")
        return Finished(campaign, answer, files.sha256(written))
    except (ValueError, LookupError, TypeError, AttributeError, OSError, RecursionError) as problem:
        raise UsageError(
            f"{campaign.name} has a result of an earlier version: run `pipeline run "
            f"{campaign.name}` first"
        ) from problem


def done(campaign: CampaignFolder, key: str) -> Answer | None:
    """The answer of an earlier run with the same key and intact outputs; None without one."""
    return read(campaign) if campaign.done(key) else None


_AMONG, _REFRESH = "pipeline.fleet.pages:among", "pipeline.fleet.pages:refresh"
"""Doors of the fleet: other campaigns as a report shows them, and the page over all of them."""


@dataclass(frozen=True)
class Among:
    """Other campaigns of the same robot, as far as the report of one shows them.

    Attributes:
        previous: Answer to the previous campaign; None without one.
        wear: Sentence on all campaigns of the robot together, as known so far; None without one.
        kept: Entries of the manifest by which all this is found again.
    """

    previous: Answer | None = None
    wear: str | None = None
    kept: Mapping[str, str | None] = field(default_factory=dict)


def among(campaign: CampaignFolder, answer: Answer) -> Among:
    """Other campaigns of the answer's robot; none without the outbuilding that knows them."""
    known = found(_AMONG)
    return known(campaign, answer) if known else Among()


def refresh(root: Path) -> Path | None:
    """Bring the page over all campaigns up to date, and the parts of reports on other campaigns.

    Returns:
        Path of the page; None if there is no campaign or the fleet is not installed.
    """
    drawn = found(_REFRESH)
    page: Path | None = drawn(root) if drawn else None
    return page


def kept_tables(campaign: CampaignFolder) -> dict[str, pd.DataFrame]:
    """The tables of a report as kept by the run, by name."""
    paths = {name: campaign.processed / f"{file}.parquet" for name, file in _SHOWN.items()}
    return {name: tables.frame(parquet.read(p)) for name, p in paths.items() if p.is_file()}
