"""Finished answers: which there are, the one before, and the tables that their reports show."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.answer.history import previous
from pipeline.base import files
from pipeline.store.campaign import Campaign, dump

_SHOWN = {
    "rejected": "13_rejected",
    "registration": "20_registration",
    "forces": "22_forces",
    "displacements": "23_displacements",
    "residuals": "42_residuals",
    "examined": "50_examined",
    "diagnosis": "51_diagnosis",
    "separability": "52_separability",
    "validation": "60_validation",
    "workspace": "61_workspace",
    "workspace_joint_springs": "62_workspace_joint_springs",
}
"""Tables that a report shows, and the files they are kept in."""


def finished(root: Path) -> list[Campaign]:
    """Campaigns with a result that counts, by name; their raw folders may be gone."""
    out = []
    for path in sorted((root / "reports").glob("*/result.json")):
        campaign = Campaign(root, root / "data" / "raw" / path.parent.name)
        manifest = campaign.manifest()
        if manifest is not None:  # a campaign that was run by path lies elsewhere
            out.append(Campaign(root, root / manifest.get("source", campaign.folder)))
    return out


def earlier(campaign: Campaign, result: dict[str, Any]) -> Mapping[str, Any] | None:
    """The result of the same robot's campaign before this one, as far as it is finished."""
    return previous(result, (other.result() for other in finished(campaign.root)))


def mark(before: Mapping[str, Any] | None) -> str | None:
    """What of the previous campaign a report depends on, in short."""
    if before is None:
        return None
    return files.sha256(dump([before["campaign"], before["stiffness"]]))


def shown(campaign: Campaign) -> dict[str, pd.DataFrame]:
    """The tables of a report, as the run left them."""
    import pyarrow.parquet as pq

    paths = {name: campaign.processed / f"{file}.parquet" for name, file in _SHOWN.items()}
    return {name: pq.read_table(p).to_pandas() for name, p in paths.items() if p.is_file()}
