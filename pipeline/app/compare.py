"""Two campaigns, or two models of one, side by side."""

from __future__ import annotations

from dataclasses import asdict, dataclass
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
    a, b = _side(root, first), _side(root, second)
    loose = [one.asked for one in (a, b) if one.whole and not trusted(one.campaign.result())]
    independent = a.campaign.name != b.campaign.name and not loose
    covariances = (a.cov, b.cov) if independent else None
    why = NOT_EXPLAINED.format(" and ".join(loose)) if loose else SAME_READINGS
    models = (a.model, b.model)
    report = comparison((first, second), a.entries, b.entries, covariances, why, models)
    found = changes(a.entries, b.entries, independent)
    content = {
        "before": first,
        "after": second,
        "stiffness": [asdict(change) for change in found],
        **_together(a, b, independent),
    }
    return report, content


@dataclass(frozen=True, eq=False)
class _Side:
    """One of the two.

    Attributes:
        asked: As it was typed.
        campaign: Its campaign.
        entries: The stiffness entries of the model that was asked for.
        cov: Covariance of their compliances, shape (n, n); NaN where it is not known.
    """

    asked: str
    campaign: Campaign
    entries: list[dict[str, Any]]
    cov: Array

    @property
    def whole(self) -> bool:
        """The campaign was asked for, not one of its models."""
        return self.asked == self.campaign.name

    @property
    def model(self) -> str:
        """Which model's values were asked for, in words; nothing where the name says it."""
        return words.values_of(self.campaign.result()) if self.whole else ""


def _together(a: _Side, b: _Side, independent: bool) -> dict[str, Any]:
    """The test of all joints at once, where the two can be tested."""
    if not independent or [j["name"] for j in a.entries] != [j["name"] for j in b.entries]:
        return {"chi2": None, "dof": 0, "p_value": None}
    chi2, dof = together(a.entries, b.entries, a.cov, b.cov)
    return {"chi2": chi2, "dof": dof, "p_value": None if chi2 is None else chance(chi2, dof)}


def _side(root: Path, name: str) -> _Side:
    campaign, model = _campaign_and_model(root, name)
    result = campaign.result()
    if model == "extended":
        if not result.get("extended"):
            raise UsageError(f"{campaign.name} has no richer model than its joint springs")
        entries = result["extended"]["stiffness"]
        std = np.array([j["compliance_std"] for j in entries], dtype=float)  # None becomes NaN
        return _Side(name, campaign, entries, np.diag(std**2))
    if "joint_springs" not in result:
        raise UsageError(f"{campaign.name} is of an older version: run `pipeline run` first")
    entries = (result if model == "recommended" else result["joint_springs"])["stiffness"]
    return _Side(name, campaign, entries, _covariance(campaign, model, entries))


def _covariance(campaign: Campaign, model: str, entries: list[dict[str, Any]]) -> Array:
    names = [f"c_{j['name'].removeprefix('k_')}" for j in entries]
    kept = campaign.processed / f"{_COVARIANCES[model]}.parquet"
    if not kept.is_file():
        raise UsageError(f"{campaign.name} has no covariance: run `pipeline run {campaign.name}`")
    return pd.read_parquet(kept).set_index("parameter").loc[names, names].to_numpy(float)


def _campaign_and_model(root: Path, name: str) -> tuple[Campaign, str]:
    known = {campaign.name: campaign for campaign in finished(root)}
    head, _, model = name.rpartition(":")
    if name in known or head not in known:
        return known.get(name) or find(root, name), "recommended"
    if model not in _MODELS:
        raise UsageError(f'there is no model "{model}": use {", ".join(_MODELS)}')
    return known[head], model
