"""Time of a query over a thousand campaigns, and time to make their tables."""

from __future__ import annotations

import json
import re
import shutil
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from pipeline.fleet import tables as fleet
from pipeline.fleet.query import ask
from pipeline.run import run as computed
from pipeline.store.campaign import CampaignFolder, dump, find

HERE = Path(__file__).parents[1]
KEPT = HERE / "data" / "raw" / "fanuc_r2000ic"
CAMPAIGNS = 1000
RUNS = 5
"""Number of runs of each query, of which the slowest counts."""


def queries() -> list[str]:
    """The queries of docs/query.md."""
    text = (HERE / "docs" / "query.md").read_text("utf-8")
    return re.findall(r"^```sql\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


def copies(campaign: CampaignFolder, names: Iterable[str], rng: np.random.Generator) -> None:
    """Finished campaigns of other names, with the same data but different stiffnesses."""
    content, manifest = campaign.result(), campaign.manifest()
    for name in names:
        other = CampaignFolder(campaign.root, campaign.root / "data" / "raw" / name)
        shutil.copytree(campaign.processed, other.processed, ignore=shutil.ignore_patterns(".*"))
        other.reports.mkdir(parents=True)
        for joint in content["stiffness"]:
            if joint["value"] is not None:
                joint["value"] += joint["std"] * rng.standard_normal()
        (other.reports / "result.json").write_bytes(dump({**content, "campaign": name}))
        (other.processed / "manifest.json").write_bytes(dump({**(manifest or {}), "name": name}))


def run() -> Iterator[tuple[str, float, str]]:
    """Time of the slowest of the documented queries, and to update the tables [s]."""
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        shutil.copytree(KEPT, root / "data" / "raw" / "first")
        campaign = find(root, "first")
        computed(campaign)
        rest = [f"c{k:04d}" for k in range(1, CAMPAIGNS)]
        copies(campaign, rest, np.random.default_rng(12))
        yield "seconds: tables of all of them made", _seconds(root, None), f"{CAMPAIGNS} campaigns"
        result = root / "reports" / rest[0] / "result.json"
        content = json.loads(result.read_bytes())
        result.write_bytes(dump(content | {"verdict_sentence": ["Measured anew."]}))
        (root / "data/processed" / rest[0] / "manifest.json").write_bytes(dump({"outputs": {}}))
        yield "seconds: brought up to date with a new one", _seconds(root, None), ""
        for query in queries():
            slowest = max(_seconds(root, query) for _ in range(RUNS))
            yield " ".join(query.split())[:58], slowest, "aim < 1 s, the slowest of five"


def _seconds(root: Path, query: str | None) -> float:
    began = time.perf_counter()
    fleet.refresh(root) if query is None else ask(root, query)
    return time.perf_counter() - began
