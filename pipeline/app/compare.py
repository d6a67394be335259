"""Two campaigns, or two models of one, side by side."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.answer.archive import finished
from pipeline.answer.history import chance, changes, together, trusted
from pipeline.app.outcome import Outcome
from pipeline.base import files
from pipeline.base.arrays import Array
from pipeline.base.errors import CannotWrite, UsageError
from pipeline.report import words
from pipeline.report.overview import NOT_EXPLAINED, SAME_READINGS, comparison
from pipeline.report.record import Report
from pipeline.report.render import page as as_page
from pipeline.report.text import as_text
from pipeline.store.campaign import Campaign, find

_COVARIANCES = {"recommended": "41_covariance", "joints": "41_covariance_joint_springs"}
"""Models of a campaign that can be compared, with the tables of their covariance."""

_MODELS = (*_COVARIANCES, "extended")


def compare(root: Path, first: str, second: str) -> tuple[Outcome, Path | None]:
    """Two campaigns or models beside each other, and the page of it, where one can be kept."""
    said, content = compared(root, first, second)
    name = f"{first}--{second}"
    path = root / "reports" / f"{name}.html".replace(":", ".").replace("/", ".")
    try:
        files.write(path, as_page(said, {}).encode())
    except CannotWrite as problem:  # the answer itself needs no page
        unkept = content | {"page": None}
        code, complaints = problem.exit_code, [str(problem)]
        return Outcome(name, unkept, as_text(said), code, complaints=complaints), None
    return Outcome(name, content | {"page": str(path)}, as_text(said)), path


def compared(root: Path, first: str, second: str) -> tuple[Report, dict[str, Any]]:
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
    kept = campaign.processed / f"{_COVARIANCES[model]}.parquet"
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
        if model not in _MODELS:
            raise UsageError(f'there is no model "{model}": use {", ".join(_MODELS)}')
        return known[head], model
    return find(root, name), "recommended"
