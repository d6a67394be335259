"""Which values the answer gives: decided once, read by everything downstream.

The first row of `TABLE` whose condition holds decides. Its model is that of the diagnosis where
this identifies causes, else the joint springs; its data are those without the mistakes that were
found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

from pipeline.answer.contract import Data, Reason, Which
from pipeline.base.arrays import Array, Parameter
from pipeline.diagnosis.average import Hypothesis, Springs, springs
from pipeline.diagnosis.facts import Diagnosis, Facts
from pipeline.diagnosis.finding import Verdict
from pipeline.diagnosis.verdict import verdict
from pipeline.prediction import model as handover
from pipeline.system.estimate import left_out
from pipeline.system.fit import Fitted
from pipeline.system.system import Estimate


@dataclass(frozen=True)
class Basis:
    """All that the decision depends on.

    Attributes:
        mistakes: The data hold a mistake.
        verdict: Of the diagnosis of the data without it.
        modelled: Something that the diagnosis identified changes the springs.
        rivals: Another hypothesis than the identified one counts, too.
        beside: A cause is in the model beside the springs; without one, the unloaded geometry or
            the scatter of the scale was corrected.
    """

    mistakes: bool
    verdict: Verdict
    modelled: bool
    rivals: bool
    beside: bool = True

    @property
    def causes(self) -> bool:
        """Causes hold that change the springs."""
        return self.verdict in (Verdict.EXPLAINED, Verdict.AMBIGUOUS) and self.modelled

    @classmethod
    def of(cls, facts: Facts, diagnosis: Diagnosis) -> Basis:
        """Those of a campaign, mistakes included."""
        found = diagnosis.hypotheses
        beside = bool(found and found[0].effects)
        rest = verdict(replace(facts, mistakes=()))
        return cls(bool(facts.mistakes), rest, len(found) > 0, len(found) > 1, beside)


@dataclass(frozen=True)
class Row:
    """One row of the decision.

    Attributes:
        reason: Its name.
        holds: When it applies.
        model: Whose values.
        data: From which data.
    """

    reason: Reason
    holds: Callable[[Basis], bool]
    model: Which
    data: Data


TABLE: tuple[Row, ...] = (
    Row(
        Reason.MISTAKE_AND_RIVALS,
        lambda f: f.mistakes and f.causes and f.rivals,
        Which.AVERAGED,
        Data.CORRECTED,
    ),
    Row(
        Reason.MISTAKE_AND_CAUSE, lambda f: f.mistakes and f.causes, Which.EXTENDED, Data.CORRECTED
    ),
    Row(
        Reason.MISTAKE_AND_UNEXPLAINED,
        lambda f: f.mistakes and f.verdict == Verdict.UNEXPLAINED,
        Which.JOINT_SPRINGS,
        Data.CORRECTED,
    ),
    Row(
        Reason.MISTAKE_SPRINGS_UNTOUCHED,
        lambda f: f.mistakes and f.verdict != Verdict.ADEQUATE,
        Which.JOINT_SPRINGS,
        Data.CORRECTED,
    ),
    Row(Reason.MISTAKE, lambda f: f.mistakes, Which.JOINT_SPRINGS, Data.CORRECTED),
    Row(Reason.WEIGHED_ANEW, lambda f: f.causes and not f.beside, Which.EXTENDED, Data.AS_GIVEN),
    Row(
        Reason.CAUSE_AND_RIVALS,
        lambda f: f.causes and f.rivals and f.verdict == Verdict.EXPLAINED,
        Which.AVERAGED,
        Data.AS_GIVEN,
    ),
    Row(
        Reason.CAUSE_IDENTIFIED,
        lambda f: f.causes and f.verdict == Verdict.EXPLAINED,
        Which.EXTENDED,
        Data.AS_GIVEN,
    ),
    Row(Reason.RIVALS, lambda f: f.causes and f.rivals, Which.AVERAGED, Data.AS_GIVEN),
    Row(Reason.CAUSE_DOUBTFUL, lambda f: f.causes, Which.EXTENDED, Data.AS_GIVEN),
    Row(
        Reason.SPRINGS_UNTOUCHED,
        lambda f: f.verdict in (Verdict.EXPLAINED, Verdict.AMBIGUOUS),
        Which.JOINT_SPRINGS,
        Data.AS_GIVEN,
    ),
    Row(
        Reason.UNEXPLAINED,
        lambda f: f.verdict == Verdict.UNEXPLAINED,
        Which.JOINT_SPRINGS,
        Data.AS_GIVEN,
    ),
    Row(
        Reason.ADEQUATE, lambda f: f.verdict == Verdict.ADEQUATE, Which.JOINT_SPRINGS, Data.AS_GIVEN
    ),
)
"""First match wins."""


def row_of(reason: str) -> Row:
    """The row of a reason."""
    return next(row for row in TABLE if row.reason == reason)


def decide(basis: Basis) -> Row:
    """The row of `TABLE` that holds."""
    return next(row for row in TABLE if row.holds(basis))


@dataclass(frozen=True, eq=False)
class Values:
    """Springs and causes of one model with all that is needed to state them.

    Attributes:
        fitted: The campaign that they rest on, with its joint springs.
        hypotheses: Springs with what was identified, the identified causes first; for the joint
            springs alone these only.
        left_out_m: Residuals of each pose when it is left out [m], shape (M,); NaN where the other
            poses do not predict it.
    """

    fitted: Fitted
    hypotheses: tuple[Hypothesis, ...]
    left_out_m: Array

    @property
    def first(self) -> Hypothesis:
        """The identified causes themselves, whose fit and residuals are shown."""
        return self.hypotheses[0]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Of its tables: those of the springs alone where several hypotheses have others."""
        return self.first.estimate.parameters[: len(self.found.value)]

    @cached_property
    def found(self) -> Estimate | Springs:
        """Values and uncertainties of the parameters."""
        return self.first.estimate if len(self.hypotheses) == 1 else springs(self.hypotheses)

    def model(self, campaign: str, verdict: str, row: Row) -> handover.Model:
        """What is handed over of it."""
        return handover.Model(
            campaign,
            verdict,
            {"model": str(row.model), "data": str(row.data), "reason": str(row.reason)},
            tuple(handover.part(h.weight, h.cell, h.estimate) for h in self.hypotheses),
            self.found.identifiable[: self.fitted.case.robot.n],
        )


def joint_springs(fitted: Fitted) -> Values:
    """The joint springs and nothing else."""
    alone = Hypothesis(1.0, (), fitted.case.cell, fitted.system, fitted.estimate)
    return Values(fitted, (alone,), left_out(fitted.system))


def identified(fitted: Fitted, diagnosis: Diagnosis) -> Values | None:
    """Springs with the identified causes; None where these do not change the springs."""
    if not diagnosis.hypotheses:
        return None
    own = replace(diagnosis.hypotheses[0], weight=1.0)
    return Values(fitted, (own,), _left_out(diagnosis))


def recommend(row: Row, given: Fitted, right: Fitted, diagnosis: Diagnosis) -> Values:
    """The values that the answer gives.

    Args:
        row: What decides.
        given: The joint springs from the data as given.
        right: The joint springs from the data without mistakes; the same where there are none.
        diagnosis: Of the data without mistakes.
    """
    fitted = right if row.data == Data.CORRECTED else given
    if row.model == Which.JOINT_SPRINGS:
        return joint_springs(fitted)
    return Values(fitted, diagnosis.hypotheses, _left_out(diagnosis))


def _left_out(diagnosis: Diagnosis) -> Array:
    """Cross-validation residuals with the causes, chosen in each fold where these were tested."""
    tested = any(cause.gain and cause.gain.of == "displacements" for cause in diagnosis.causes)
    return diagnosis.left_out_after_m if tested else left_out(diagnosis.hypotheses[0].system)
