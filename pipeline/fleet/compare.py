"""Comparison of two campaigns, or of two models of one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.answer.archive import Finished, with_digest
from pipeline.answer.contract import Answer, Data, Stiffness, Which
from pipeline.app.outcome import Outcome
from pipeline.base import doors, files, parquet
from pipeline.base.arrays import Array
from pipeline.base.errors import CannotWrite, UsageError
from pipeline.base.shown import typed
from pipeline.fleet import tables as fleet
from pipeline.fleet.history import alike, changes, finished, of_one_day, trusted
from pipeline.fleet.overview import (
    NOT_EXPLAINED,
    NOT_STOOD_FOR,
    OF_TWO_KINDS,
    SAME_READINGS,
    comparison,
)
from pipeline.fleet.sentences import of
from pipeline.fleet.trends import chance, together
from pipeline.report import words
from pipeline.report.record import Report
from pipeline.report.render import page as as_page
from pipeline.store.campaign import CampaignFolder, find

_TEXT = "pipeline.annex.text:as_text"
"""Door: a report as plain text."""

_COVARIANCES = {"recommended": "41_covariance", "joints": "41_covariance_joint_springs"}
"""Models of a campaign that have a covariance, with the names of its tables."""

_MODELS = (*_COVARIANCES, "extended")


def compare(root: Path, first: str, second: str) -> tuple[Outcome, Path | None]:
    """Compare two campaigns or models; return the outcome and its page, if that can be written."""
    report, content = compared(root, first, second)
    name = f"{first}--{second}"
    path = root / "reports" / f"{name}.html".replace(":", ".").replace("/", ".")
    done = Outcome(name, content | {"page": str(path)}, doors.opened(_TEXT)(report))
    try:
        files.write(path, as_page(report, {}).encode())
    except CannotWrite as problem:  # the result itself needs no page
        content, complaints = content | {"page": None}, [str(problem)]
        code = problem.exit_code
        return replace(done, content=content, exit_code=code, complaints=complaints), None
    return done, path


@dataclass(frozen=True, eq=False)
class _Side:
    """One of the two sides of a comparison.

    Attributes:
        asked: Name as given, a campaign or `campaign:model`.
        campaign: Name of the campaign.
        of: `recommended`, `joints` or `extended`.
        answer: Answer of the campaign.
        stiffness: Stiffnesses of the model.
        cov: Covariance of their compliances [SI], shape (n, n).
    """

    asked: str
    campaign: str
    of: str
    answer: Answer
    stiffness: Sequence[Stiffness]
    cov: Array

    @property
    def whole(self) -> bool:
        """Whether a campaign was given rather than one of its models."""
        return self.asked == self.campaign

    @property
    def stood_for(self) -> bool:
        """Whether these values are the ones that the answer recommends."""
        recommended = self.answer.recommended
        as_given = recommended.model is Which.JOINT_SPRINGS and recommended.data is Data.AS_GIVEN
        return {"joints": as_given, "extended": recommended.model is Which.EXTENDED}.get(
            self.of, True
        )

    @property
    def model(self) -> str:
        """Model of these values, in words; empty if its name was given."""
        return words.values_of(self.answer) if self.whole else ""


def compared(root: Path, first: str, second: str) -> tuple[Report, dict[str, Any]]:
    """Compare two campaigns, or two models of one, as report and as data.

    Args:
        root: The project's root.
        first: A campaign, for the values of its answer, or `campaign:joints` (the joint springs
            alone on the data as given) or `campaign:extended` (springs and causes estimated
            together).
        second: Likewise.

    Raises:
        InputError: There is no such campaign.
        UsageError: There is no such model, or no result yet.
    """
    if first == second:
        raise UsageError(f"{first} is compared with itself: name another campaign or model")
    a, b = _side(root, first), _side(root, second)
    why = _not_tested(a, b)
    independent = why is None
    daily = _from_day_to_day(root, a, b)
    report = comparison(
        (first, second),
        a.stiffness,
        b.stiffness,
        (_any_day(a, daily), _any_day(b, daily)) if independent else None,
        why or "",
        (a.model, b.model),
        (a.answer.machine, b.answer.machine),
        daily,
    )
    found = changes(a.stiffness, b.stiffness, independent, daily)
    content = {
        "before": first,
        "after": second,
        "stiffness": [asdict(change) for change in found],
        **_all_together(a, b, independent, daily),
    }
    return report, content


def _not_tested(a: _Side, b: _Side) -> str | None:
    """Why the differences cannot be tested; None if they can."""
    if a.campaign == b.campaign:
        return SAME_READINGS
    if not alike(a.answer, b.answer):
        return OF_TWO_KINDS
    loose = [one.campaign for one in (a, b) if not trusted(one.answer)]
    if loose:
        return NOT_EXPLAINED.format(" and ".join(loose))
    other = [one.asked for one in (a, b) if not one.stood_for]
    return NOT_STOOD_FOR.format(" and ".join(other)) if other else None


def _from_day_to_day(root: Path, a: _Side, b: _Side) -> dict[str, float]:
    """Day-to-day scatter of the robot's stiffnesses [1], by name; empty if not applicable."""
    wear = of(a.answer.machine, fleet.wear(root))
    same = a.answer.machine == b.answer.machine and not of_one_day(a.answer, b.answer)
    if not same or wear is None or not wear.followed:
        return {}
    return {joint.name: joint.scatter / 100 for joint in wear.joints}


def _any_day(side: _Side, daily: Mapping[str, float]) -> Array:
    """Covariance of the compliances including the day-to-day scatter [SI], shape (n, n)."""
    x = [(joint.compliance or 0.0) * daily.get(joint.name, 0.0) for joint in side.stiffness]
    return np.asarray(side.cov + np.diag(np.square(x)))


def _all_together(
    a: _Side, b: _Side, independent: bool, daily: Mapping[str, float]
) -> dict[str, float | int | None]:
    """Chi-square test of all joints together; None if errors are shared or joints differ."""
    same = [joint.name for joint in a.stiffness] == [joint.name for joint in b.stiffness]
    if not (independent and same):
        return {"chi2": None, "dof": 0, "p_value": None}
    chi2, dof = together(a.stiffness, b.stiffness, _any_day(a, daily), _any_day(b, daily))
    return {"chi2": chi2, "dof": dof, "p_value": chance(chi2, dof)}


def _side(root: Path, asked: str) -> _Side:
    """The campaign or model given, with its covariance."""
    one, model = _campaign_and_model(root, asked)
    name, answer = one.campaign.name, one.answer
    known = {"recommended": answer, "joints": answer.joint_springs, "extended": answer.extended}
    values = known[model]
    if values is None:
        raise UsageError(f"{name} has no richer model than its joint springs")
    cov = _covariance(one.campaign, model, values.stiffness)
    return _Side(asked, name, model, answer, values.stiffness, cov)


def _covariance(campaign: CampaignFolder, model: str, stiffness: Sequence[Stiffness]) -> Array:
    """Covariance of the compliances [SI], from the run's table; `extended`: variances only."""
    if model not in _COVARIANCES:
        std = [joint.compliance_std for joint in stiffness]
        return np.diag([np.nan if s is None else s**2 for s in std])
    kept = campaign.processed / f"{_COVARIANCES[model]}.parquet"
    if not kept.is_file():
        raise UsageError(
            f"{campaign.name} has no covariance: run `pipeline run {typed(campaign.name)}`"
        )
    names = [f"c_{joint.joint_name}" for joint in stiffness]
    return parquet.read(kept).to_pandas().set_index("parameter").loc[names, names].to_numpy(float)


def _campaign_and_model(root: Path, name: str) -> tuple[Finished, str]:
    known = {one.campaign.name: one for one in finished(root)}
    head, _, model = name.rpartition(":")
    if name in known:
        return known[name], "recommended"
    if head in known:
        if model not in _MODELS:
            raise UsageError(f'there is no model "{model}": use {", ".join(_MODELS)}')
        return known[head], model
    campaign = find(root, name)
    return with_digest(campaign), "recommended"
