"""New poses with an earlier search for causes: their rows are added, but no causes are sought.

A search for causes takes seconds, an estimate of the springs milliseconds. If the causes found
explain all readings, new readings are tested against that model by the tests that `run` applies to
single readings, and the springs are estimated again from all rows; a contradiction triggers a new
search.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pipeline.answer.conformity import pose_entry, tolerance_entry
from pipeline.answer.contract import Answer, Stiffness
from pipeline.base.arrays import Bools
from pipeline.base.quantities import MM
from pipeline.faults.mistake import Mistake
from pipeline.faults.screen import Screened, ScreeningBase, singles_of
from pipeline.library.campaign import Campaign, Result
from pipeline.library.model import Model
from pipeline.prediction.model import IdentifiedModel, ModelHypothesis
from pipeline.prediction.tolerance import HeldOutError, judge, path_of
from pipeline.reduction.bring import Reduced, bring
from pipeline.reduction.case import Case
from pipeline.reduction.pose_of_interest import place_of_interest
from pipeline.run import ingested
from pipeline.system.estimate import MISFIT_P, identify
from pipeline.system.system import Estimate

_SAME = 0.1
"""Largest difference from the values of the search in standard uncertainties, and largest relative
difference of the uncertainties [1]; the search also weights readings by the noise that it found."""

_LEADING = 0.8
"""Smallest weight of the likeliest hypothesis with which its rivals are updated like it until the
next search [1]."""

_FURTHER = 4
"""Causes are sought again once the number of poses has grown by one part in this many [1]: this
finds what fewer poses could not show, and all searches of a campaign together cost as much as some
of the last."""


@dataclass(frozen=True, eq=False)
class LastSearch:
    """A search for causes whose model explains all readings.

    Attributes:
        result: Result of the search.
        case: The campaign as read.
        model: Springs and causes with their values.
        known: Which of them are determined, shape (k,).
    """

    result: Result
    case: Case
    model: ModelHypothesis
    known: Bools

    @classmethod
    def of(cls, campaign: Campaign, result: Result) -> LastSearch | None:
        """The search, if an estimate without a new search reproduces its result; else None.

        It does not if there are mistakes, rivals that a pose may make the most likely, positions,
        or rows weighted by more than their stated noise.
        """
        model = result.model.identified.hypotheses[0]
        if model.weight < _LEADING or campaign.raw.settings.positions is not None:
            return None
        with campaign.raw.placing():
            case = _read(campaign)
            again = _estimated(model, bring(case))
        known = np.isfinite(model.std)
        if again is None or (np.isfinite(again.std) != known).any():
            return None
        std = model.std[known]
        apart = np.abs(again.value - model.value)[known] / std, np.abs(again.std[known] / std - 1)
        same = np.max(apart, initial=0.0) < _SAME
        return cls(result, case, model, again.identifiable) if same else None

    def beside(self, campaign: Campaign) -> Result | tuple[Mistake, ...]:
        """Result with further poses; if they contradict the model, the mistakes found instead.

        An empty tuple also calls for a new search. A reading that is the first of its kind is
        tested against what was known before it; the search also considers other explanations, and
        may need the next reading to decide.

        Raises:
            InputError: The data cannot be trusted.
        """
        with campaign.raw.placing():
            case = _read(campaign)
            if not self._grown(case):
                return ()
            reduced = bring(case)
            base = ScreeningBase(self.model.cell, self.model.value)
            found = singles_of(Screened((), case), reduced, base)
            estimate = None if found.findings else _estimated(self.model, reduced)
            if found.doubted or estimate is None:
                return found.findings
            if (estimate.identifiable != self.known).any():
                return ()
            return self._with(campaign, case, reduced, estimate)

    def _grown(self, case: Case) -> bool:
        """Whether the only change is further readings, of a limited number of new poses.

        Rows of loads and joints without readings are poses still to be measured.
        """
        old = self.case
        same = old.settings == case.settings and old.robot.text == case.robot.text
        tables = zip(_tables(old), _tables(case), strict=True)
        lost = case.rejected["file"].isin(case.readings["file"]).any()
        if not same or lost or not all(_holds(*pair) for pair in tables):
            return False
        fresh = case.readings[~case.readings["group"].isin(old.readings["group"])]
        were, are = (one.readings["pose"].nunique() for one in (old, case))
        return bool((fresh["pose"] > 0).all()) and are - were <= max(1, were // _FURTHER)

    def _with(self, campaign: Campaign, case: Case, reduced: Reduced, found: Estimate) -> Result:
        """Result with the values estimated from all rows."""
        before = self.result.model.identified
        model = replace(self.model, value=found.value, cov=found.cov)
        rivals = [self._followed(one, found) for one in before.hypotheses[1:]]
        told = replace(before, hypotheses=(model, *rivals))
        answer = _updated(self.result.answer, told, campaign, case, reduced)
        tables = {
            **self.result.tables, "readings": case.readings, "forces": reduced.shown["forces"]
        }  # fmt: skip
        return Result(answer, Model(told), tables)

    def _followed(self, rival: ModelHypothesis, found: Estimate) -> ModelHypothesis:
        """A rival whose springs change, in value and uncertainty, as the leading one's do."""
        n, old = self.case.robot.n, self.model
        value, ratio = rival.value.copy(), np.ones(len(rival.value))
        value[:n] += (found.value - old.value)[:n]
        finite = np.isfinite(old.std[:n])
        ratio[:n][finite] = found.std[:n][finite] / old.std[:n][finite]
        return replace(rival, value=value, cov=rival.cov * np.outer(ratio, ratio))


def _estimated(model: ModelHypothesis, reduced: Reduced) -> Estimate | None:
    """Springs and causes of a model from all rows; None if they do not fit the stated noise."""
    data = replace(reduced.data, bends=True)
    if not data.noise_stated:
        return None
    found = identify(model.cell, data, model.value)[1]
    told = len(found.value) == len(model.value) and (found.p_value or 0.0) >= MISFIT_P
    return found if told else None


def _read(campaign: Campaign) -> Case:
    return ingested(campaign.raw, plausible=False)


def _tables(case: Case) -> tuple[pd.DataFrame, ...]:
    return case.readings, case.loads, case.joints


def _holds(old: pd.DataFrame, new: pd.DataFrame) -> bool:
    """Whether a table still contains every row of the old one."""
    return len(old.merge(new.drop_duplicates())) >= len(old)


def _updated(
    answer: Answer, told: IdentifiedModel, campaign: Campaign, case: Case, reduced: Reduced
) -> Answer:
    """An answer with the stiffnesses of a model, and its predictions at test pose and path."""
    settings, pulls = case.settings, reduced.data.pulls
    where = place_of_interest(settings.test_pose, case.robot, pulls)
    holds = answer.recommended.reason.holds_for_its_readings
    shown = HeldOutError(told.held_out_m, pulls.range_n[1], holds)
    path = path_of(settings.tolerance, campaign.files, case.robot, case.tool)
    most = np.inf if settings.tolerance is None else settings.tolerance.deflection_mm / MM
    found = judge(told, where.q, where.force, shown, path, most)
    return answer.model_copy(
        update={
            "stiffness": tuple(_known(one, told) for one in answer.stiffness),
            "test_pose": pose_entry(case.robot, where, found),
            "tolerance": tolerance_entry(settings.tolerance, where, found),
        }
    )


def _known(one: Stiffness, told: IdentifiedModel) -> Stiffness:
    value, std, _ = told.stiffness(one.joint - 1) or (None, None, None)
    relative = None if value is None or std is None else std / value
    return one.model_copy(update={"value": value, "std": std, "relative_std": relative})
