"""Decision on the values that the answer gives, made once for everything downstream.

The first row of `TABLE` whose condition holds decides. Its model is that of the diagnosis if this
identifies causes, otherwise the joint springs; its data are those with the mistakes corrected.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.answer.contract import Data, Reason, Which
from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Parameter
from pipeline.diagnosis.average import (
    Hypothesis,
    Springs,
    at_pose,
    springs,
    two_sided,
    weighed,
)
from pipeline.diagnosis.facts import Diagnosed, Facts
from pipeline.diagnosis.finding import Finding, Verdict
from pipeline.diagnosis.hypotheses import beside_small
from pipeline.diagnosis.unloaded_geometry import corrected
from pipeline.diagnosis.verdict import of_both, verdict
from pipeline.prediction import model as handover
from pipeline.reduction.pose_of_interest import PoseOfInterest
from pipeline.system.estimate import left_out
from pipeline.system.fit import Fitted
from pipeline.system.system import Estimate


@dataclass(frozen=True)
class DecisionBasis:
    """Everything on which the decision depends.

    Attributes:
        mistakes: Whether the data contain a mistake.
        verdict: Verdict on the data without it.
        modelled: Whether something that the diagnosis identified changes the springs.
        rivals: Whether other hypotheses than the identified one have weight, too.
        beside: Whether the model has a cause in addition to the springs; without one, the unloaded
            geometry or the scatter of the scale was corrected.
        too_small: Whether causes that are too small to name may be present.
        disagree: Whether positions and pulls are each explained, but by different springs.
    """

    mistakes: bool
    verdict: Verdict
    modelled: bool
    rivals: bool
    beside: bool = True
    too_small: bool = False
    disagree: bool = False

    @property
    def unseen(self) -> bool:
        """Whether springs alone are the model, but causes too small to name may be present."""
        return self.too_small and not self.modelled and not self.unexplained

    @property
    def named(self) -> bool:
        """Whether the verdict names causes, certain or not."""
        return self.verdict in (Verdict.EXPLAINED, Verdict.AMBIGUOUS)

    @property
    def causes(self) -> bool:
        """Whether causes are named that change the springs."""
        return self.named and self.modelled

    @property
    def explained(self) -> bool:
        """Whether these causes are identified with certainty."""
        return self.causes and self.verdict == Verdict.EXPLAINED

    @property
    def unexplained(self) -> bool:
        """Whether no known cause explains the readings."""
        return self.verdict == Verdict.UNEXPLAINED

    @classmethod
    def of(cls, facts: Facts, diagnosis: Diagnosed) -> DecisionBasis:
        """Basis of a campaign from its facts, mistakes included, and its diagnosis."""
        found = diagnosis.hypotheses
        beside = bool(found and found[0].effects)
        rest = Verdict.UNEXPLAINED if facts.hopeless else verdict(replace(facts, mistakes=()))
        mistakes, small = bool(facts.mistakes), bool(diagnosis.too_small)
        open_ = [row for row in of_both(facts) if row.verdict != Verdict.ADEQUATE]
        disagree = {row.finding for row in open_} == {Finding.SPRINGS_DISAGREE}
        return cls(mistakes, rest, len(found) > 0, len(found) > 1, beside, small, disagree)


@dataclass(frozen=True)
class DecisionRow:
    """One row of the decision.

    Attributes:
        reason: Name of the row.
        model: The model whose values are given.
        data: Data of the estimate: the corrected ones if and only if the data contain a mistake.
        holds: Condition under which the row applies to these data.
    """

    reason: Reason
    model: Which
    data: Data
    holds: Callable[[DecisionBasis], bool]


_SPRINGS, _EXTENDED, _AVERAGED = Which.JOINT_SPRINGS, Which.EXTENDED, Which.AVERAGED
_GIVEN, _CORRECTED = Data.AS_GIVEN, Data.CORRECTED

TABLE: tuple[DecisionRow, ...] = (
    DecisionRow(Reason.MISTAKE_AND_RIVALS, _AVERAGED, _CORRECTED, lambda f: f.causes and f.rivals),
    DecisionRow(Reason.MISTAKE_AND_CAUSE, _EXTENDED, _CORRECTED, lambda f: f.causes),
    DecisionRow(Reason.MISTAKE_AND_UNEXPLAINED, _SPRINGS, _CORRECTED, lambda f: f.unexplained),
    DecisionRow(
        Reason.MISTAKE_SPRINGS_UNTOUCHED, _AVERAGED, _CORRECTED, lambda f: f.named and f.unseen
    ),
    DecisionRow(Reason.MISTAKE_SPRINGS_UNTOUCHED, _SPRINGS, _CORRECTED, lambda f: f.named),
    DecisionRow(Reason.MISTAKE_AND_TOO_SMALL, _AVERAGED, _CORRECTED, lambda f: f.unseen),
    DecisionRow(Reason.MISTAKE, _SPRINGS, _CORRECTED, lambda _: True),
    DecisionRow(
        Reason.WEIGHED_ANEW, _AVERAGED, _GIVEN, lambda f: f.causes and not f.beside and f.rivals
    ),
    DecisionRow(Reason.WEIGHED_ANEW, _EXTENDED, _GIVEN, lambda f: f.causes and not f.beside),
    DecisionRow(Reason.CAUSE_AND_RIVALS, _AVERAGED, _GIVEN, lambda f: f.explained and f.rivals),
    DecisionRow(Reason.CAUSE_IDENTIFIED, _EXTENDED, _GIVEN, lambda f: f.explained),
    DecisionRow(Reason.RIVALS, _AVERAGED, _GIVEN, lambda f: f.causes and f.rivals),
    DecisionRow(Reason.CAUSE_DOUBTFUL, _EXTENDED, _GIVEN, lambda f: f.causes),
    DecisionRow(Reason.SPRINGS_UNTOUCHED, _AVERAGED, _GIVEN, lambda f: f.named and f.unseen),
    DecisionRow(Reason.SPRINGS_UNTOUCHED, _SPRINGS, _GIVEN, lambda f: f.named),
    DecisionRow(Reason.SPRINGS_DISAGREE, _SPRINGS, _GIVEN, lambda f: f.disagree),
    DecisionRow(Reason.UNEXPLAINED, _SPRINGS, _GIVEN, lambda f: f.unexplained),
    DecisionRow(Reason.TOO_SMALL, _AVERAGED, _GIVEN, lambda f: f.unseen),
    DecisionRow(Reason.ADEQUATE, _SPRINGS, _GIVEN, lambda f: f.verdict == Verdict.ADEQUATE),
)
"""Rows of the decision; the first that holds decides."""


def decide(basis: DecisionBasis) -> DecisionRow:
    """The first row of `TABLE` that holds."""
    data = _CORRECTED if basis.mistakes else _GIVEN
    return next(row for row in TABLE if row.data == data and row.holds(basis))


@dataclass(frozen=True, eq=False)
class ModelValues:
    """Springs and causes of one model, with everything needed to report them.

    Attributes:
        fitted: The campaign from which they were estimated, with its joint springs.
        hypotheses: Hypotheses on the causes with the springs estimated for each, the identified
            causes first; a single one without causes for the joint springs alone.
        left_out_m: Residuals of each pose when it is left out [m], shape (M,); NaN where the other
            poses do not predict it.
        where: The test pose, whose sign of the torque counts for a joint with a stiffness for each
            sign; None if no joint can have two.
    """

    fitted: Fitted
    hypotheses: tuple[Hypothesis, ...]
    left_out_m: Array
    where: PoseOfInterest | None = None

    @property
    def first(self) -> Hypothesis:
        """Hypothesis of the identified causes, whose fit and residuals are shown."""
        return self.hypotheses[0]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the result tables; for several hypotheses those of the springs only."""
        return self.first.estimate.parameters[: len(self.found.value)]

    @cached_property
    def found(self) -> Estimate | Springs:
        """Values and uncertainties of the parameters, averaged over several hypotheses."""
        return self.first.estimate if len(self.hypotheses) == 1 else springs(self.hypotheses)

    def model(self, campaign: str, verdict: str, row: DecisionRow) -> handover.IdentifiedModel:
        """The identified model for use elsewhere (model.toml)."""
        return handover.IdentifiedModel(
            campaign,
            verdict,
            {"model": str(row.model), "data": str(row.data), "reason": str(row.reason)},
            tuple(
                handover.part(h.weight, h.cell, h.estimate, h.system, h.ratio)
                for h in self.hypotheses
            ),
            self._stated,
            _left_out_m(self.left_out_m),
            self.fitted.data.pulls.range_n,
            None if self.where is None else (self.where.q, self.where.force),
        )

    @property
    def _stated(self) -> Bools:
        """Joints whose stiffness is determined, shape (n,)."""
        if self.where is None or not any(map(two_sided, self.hypotheses)):
            return self.found.identifiable[: self.fitted.case.robot.n]
        return springs(at_pose(self.hypotheses, self.where.q, self.where.force)).identifiable


def joint_springs(fitted: Fitted) -> ModelValues:
    """Values of the joint springs without causes."""
    alone = Hypothesis(1.0, (), fitted.case.cell, fitted.system, fitted.estimate)
    return ModelValues(fitted, (alone,), left_out(fitted.system))


def identified(fitted: Fitted, diagnosis: Diagnosed, where: PoseOfInterest) -> ModelValues | None:
    """Springs with the identified causes; None if these do not change the springs."""
    if not diagnosis.hypotheses:
        return None
    own = replace(diagnosis.hypotheses[0], weight=1.0)
    return ModelValues(fitted, (own,), _left_out(diagnosis), where)


def springs_of_extended(fitted: Fitted, diagnosis: Diagnosed) -> Fitted:
    """The joint springs with the geometry as estimated from the unloaded reflectors.

    If these do not correct it (`UnloadedFacts.corrects`), the geometry stays nominal.
    """
    stood, cell = diagnosis.facts.unloaded, fitted.case.cell
    if not stood.corrects:
        return fitted
    robot = corrected(cell, fitted.data, stood)[0].robot
    return fitted.standing(robot, lambda data: corrected(cell, data, stood)[1])


def recommend(
    row: DecisionRow, stands: Fitted, diagnosis: Diagnosed, where: PoseOfInterest
) -> ModelValues:
    """The values that the answer gives.

    Args:
        row: The decision.
        stands: Joint springs from the data without mistakes, as by `springs_of_extended`.
        diagnosis: Diagnosis of these data.
        where: The test pose.
    """
    if row.model == _SPRINGS:
        return joint_springs(stands)
    if not diagnosis.hypotheses:
        alone = joint_springs(stands)
        every = weighed(beside_small(alone.hypotheses, diagnosis.too_small))
        return replace(alone, hypotheses=every, where=where)
    return ModelValues(stands, diagnosis.hypotheses, _left_out(diagnosis), where)


def _left_out(diagnosis: Diagnosed) -> Array:
    """Cross-validation residuals [m] with the causes, which are chosen anew in each fold if tested.

    Shape (M,).
    """
    tested = any(cause.gain and cause.gain.of == "displacements" for cause in diagnosis.causes)
    return diagnosis.left_out_after_m if tested else left_out(diagnosis.hypotheses[0].system)


def _left_out_m(residuals: Array) -> float | None:
    """Rms [m] of the cross-validation residuals that other poses determine; None without any."""
    known = residuals[np.isfinite(residuals)]
    return linear.rms(known) if len(known) else None


def left_out_mm(residuals: Array) -> float | None:
    """Rms [mm] of the cross-validation residuals that other poses determine; None without any."""
    rms = _left_out_m(residuals)
    return None if rms is None else 1e3 * rms
