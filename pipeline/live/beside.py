"""New poses beside a search that stands: their rows join the system, and no cause is sought.

A search for causes costs seconds, an estimate of the springs milliseconds. Where what was found
explains all that is read, new readings are held against it by the tests that `run` makes of single
readings, and the springs are estimated again from all rows; whoever contradicts calls the search.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pipeline.answer.contract import Answer, Stiffness
from pipeline.answer.judged import pose_entry, tolerance_entry
from pipeline.base.arrays import Bools
from pipeline.base.quantities import MM
from pipeline.faults.mistake import Mistake
from pipeline.faults.screen import Screened, ScreeningBase, singles_of
from pipeline.library.campaign import Campaign, Result
from pipeline.library.model import Model
from pipeline.prediction.model import IdentifiedModel, ModelHypothesis
from pipeline.prediction.tolerance import Shown, asked, judge
from pipeline.reduction.bring import Reduced, bring, conformed, plain
from pipeline.reduction.case import Case
from pipeline.reduction.pose_of_interest import place_of_interest
from pipeline.run import ingested
from pipeline.system.estimate import MISFIT_P, identify
from pipeline.system.system import Estimate

_SAME = 0.1
"""Standard uncertainties by which an estimate may miss that of the search, and share by which its
uncertainty may: the search weighs readings by what it saw of their noise as well."""

_LEADING = 0.8
"""Weight of the likeliest hypothesis from which its rivals follow it until the next search."""

_FURTHER = 4
"""When a quarter of the poses has come since, causes are sought again: what fewer poses could not
show is found so, and the searches of a campaign cost together as much as some of the last."""


@dataclass(frozen=True, eq=False)
class Standing:
    """A search whose model explains all that was read.

    Attributes:
        result: What it found.
        case: The campaign as it was read.
        model: Springs and causes with their values.
        known: Which of them are determined, shape (k,).
    """

    result: Result
    case: Case
    model: ModelHypothesis
    known: Bools

    @classmethod
    def of(cls, campaign: Campaign, result: Result) -> Standing | None:
        """A search, if new rows beside it give what it would.

        None where it has mistakes, or rivals that a pose may make the likelier ones, or weighs its
        rows by more than is stated of them.
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
        """What further poses say; where something contradicts, and the search must run, what.

        A reading that is the first of its kind stands against what was known before it; the search
        also asks what else would explain it, and may have to wait for the next one to tell.

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
        """Whether all is as it was, but for further readings of poses, and not many poses.

        Rows of loads and joints that nothing was read of are poses to come.
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
        """The answer with the values that all rows give."""
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
        """A rival whose springs move, and are known better, as those of the leading one."""
        n, old = self.case.robot.n, self.model
        value, ratio = rival.value.copy(), np.ones(len(rival.value))
        value[:n] += (found.value - old.value)[:n]
        finite = np.isfinite(old.std[:n])
        ratio[:n][finite] = found.std[:n][finite] / old.std[:n][finite]
        return replace(rival, value=value, cov=rival.cov * np.outer(ratio, ratio))


def _estimated(model: ModelHypothesis, reduced: Reduced) -> Estimate | None:
    """Springs and causes of a model from all rows; None where they do not fit as stated."""
    data = replace(reduced.data, bends=True)
    if not data.noise_stated:
        return None
    found = identify(model.cell, data, model.value)[1]
    told = len(found.value) == len(model.value) and (found.p_value or 0.0) >= MISFIT_P
    return found if told else None


def _read(campaign: Campaign) -> Case:
    return ingested(campaign.raw, conformed, plain, plausible=False)


def _tables(case: Case) -> tuple[pd.DataFrame, ...]:
    return case.readings, case.loads, case.joints


def _holds(old: pd.DataFrame, new: pd.DataFrame) -> bool:
    """Whether every row of a table is still there."""
    return len(old.merge(new.drop_duplicates())) >= len(old)


def _updated(
    answer: Answer, told: IdentifiedModel, campaign: Campaign, case: Case, reduced: Reduced
) -> Answer:
    """An answer with the stiffnesses of a model, and what it predicts where the user asked."""
    settings, pulls = case.settings, reduced.data.pulls
    where = place_of_interest(settings.test_pose, case.robot, pulls)
    shown = Shown(told.held_out_m, pulls.range_n[1])
    path = asked(settings.tolerance, campaign.files, case.robot, case.tool)
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
