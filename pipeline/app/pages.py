"""All finished campaigns together: the page over them, and what each says of the one before it."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from filelock import FileLock

from pipeline.answer.archive import Finished, finished, mark, read, shown
from pipeline.answer.contract import Answer, Stiffness
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
        if _told(one.campaign.manifest()) != mark(before):
            _tell(one, before)
    return _index(root, answers) if answers else None


def _left_out(why: str) -> None:
    sys.stderr.write(f"{why} Until then it is left out of the page over all campaigns.\n")


def _told(manifest: Mapping[str, Any] | None) -> str | None:
    return None if manifest is None else manifest.get("previous")


def _tell(one: Finished, before: Answer | None) -> None:
    """Write a campaign's report anew, with what has changed since the previous campaign."""
    from pipeline.report.render import render

    campaign = one.campaign
    with campaign.locked():
        manifest = campaign.manifest()
        if manifest is None or _told(manifest) == mark(before):
            return  # another run has been faster
        pages = render(read(campaign), shown(campaign), manifest.get("run_time_s"), before)
        campaign.amend(pages, {"previous": mark(before)})


def _index(root: Path, answers: Sequence[Answer]) -> Path:
    from pipeline.report.render import render_overview

    page, manifest = root / "reports" / "index.html", root / "data" / "processed" / INDEX_MANIFEST
    key = files.sha256(dump([[one.as_json() for one in answers], code_version(), versions()]))
    try:
        kept = json.loads(manifest.read_bytes())
        current = kept == {"key": key, "page": files.sha256(page.read_bytes())}
    except (FileNotFoundError, ValueError):
        current = False
    if not current:
        content = render_overview(answers)
        with files.writing(manifest):
            manifest.parent.mkdir(parents=True, exist_ok=True)
            with FileLock(manifest.with_name(".lock")):
                for path in (page, manifest):
                    files.sweep(path.parent, f".{path.name}.????????")
                files.write(page, content)
                files.write(manifest, dump({"key": key, "page": files.sha256(content)}))
    return page


@dataclass(frozen=True, eq=False)
class _Side:
    """One of two that are compared.

    Attributes:
        asked: What was asked for, a campaign or `campaign:model`.
        campaign: The campaign's name.
        answer: Its answer.
        stiffness: The stiffnesses of the model.
        cov: Covariance of their compliances [SI], shape (n, n).
    """

    asked: str
    campaign: str
    answer: Answer
    stiffness: Sequence[Stiffness]
    cov: Array

    @property
    def whole(self) -> bool:
        """Whether a campaign was asked for, not one of its models."""
        return self.asked == self.campaign

    @property
    def model(self) -> str:
        """Which model's values these are, in words; nothing where what was asked for says it."""
        return words.values_of(self.answer) if self.whole else ""


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
    a, b = _side(root, first), _side(root, second)
    loose = [one.campaign for one in (a, b) if one.whole and not trusted(one.answer)]
    independent = a.campaign != b.campaign and not loose
    report = comparison(
        (first, second),
        a.stiffness,
        b.stiffness,
        (a.cov, b.cov) if independent else None,
        NOT_EXPLAINED.format(" and ".join(loose)) if loose else SAME_READINGS,
        (a.model, b.model),
    )
    found = changes(a.stiffness, b.stiffness, independent)
    content = {
        "before": first,
        "after": second,
        "stiffness": [asdict(change) for change in found],
        **_all_together(a, b, independent),
    }
    return report, content


def _all_together(a: _Side, b: _Side, independent: bool) -> dict[str, float | int | None]:
    """The test of all joints together; nothing where two share errors or have other joints."""
    same = [joint.name for joint in a.stiffness] == [joint.name for joint in b.stiffness]
    if not (independent and same):
        return {"chi2": None, "dof": 0, "p_value": None}
    chi2, dof = together(a.stiffness, b.stiffness, a.cov, b.cov)
    return {"chi2": chi2, "dof": dof, "p_value": chance(chi2, dof)}


def _side(root: Path, asked: str) -> _Side:
    """What was asked for, with its covariance."""
    one, model = _campaign_and_model(root, asked)
    name, answer = one.campaign.name, one.answer
    if model == "extended":
        if answer.extended is None:
            raise UsageError(f"{name} has no richer model than its joint springs")
        stiffness = answer.extended.stiffness
        std = [joint.compliance_std for joint in stiffness]
        cov = np.diag([np.nan if s is None else s**2 for s in std])
        return _Side(asked, name, answer, stiffness, cov)
    stiffness = answer.stiffness if model == "recommended" else answer.joint_springs.stiffness
    return _Side(asked, name, answer, stiffness, _covariance(one.campaign, model, stiffness))


def _covariance(campaign: Campaign, model: str, stiffness: Sequence[Stiffness]) -> Array:
    """Of the compliances of these joints [SI], from the table that the run kept."""
    kept = campaign.processed / f"{COVARIANCES[model]}.parquet"
    if not kept.is_file():
        raise UsageError(f"{campaign.name} has no covariance: run `pipeline run {campaign.name}`")
    names = [f"c_{joint.joint_name}" for joint in stiffness]
    return pd.read_parquet(kept).set_index("parameter").loc[names, names].to_numpy(float)


def _campaign_and_model(root: Path, name: str) -> tuple[Finished, str]:
    known = {one.campaign.name: one for one in finished(root)}
    head, _, model = name.rpartition(":")
    if name in known:
        return known[name], "recommended"
    if head in known:
        if model not in MODELS:
            raise UsageError(f'there is no model "{model}": use {", ".join(MODELS)}')
        return known[head], model
    campaign = find(root, name)
    return Finished(campaign, read(campaign)), "recommended"
