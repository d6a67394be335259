"""A campaign of absolute positions and pulls of one robot: one estimate, one answer.

Positions are identified first and say where the pulls' robot stands (`positions.with_pulls`); what
both say of the springs is estimated together (`positions.combined`), and what that changes of the
positions goes back into their model.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd

from pipeline import tables
from pipeline.answer import contract
from pipeline.answer.contract import About, Answer, Line
from pipeline.answer.diagnosis import cause_entry
from pipeline.answer.recommended import ModelValues, joint_springs
from pipeline.answer.results import CampaignResults
from pipeline.base import doors, linear
from pipeline.base.tails import chi2_beyond
from pipeline.diagnosis.agreement import SpringAgreement
from pipeline.diagnosis.amplitude import both_ways
from pipeline.diagnosis.average import Hypothesis
from pipeline.diagnosis.facts import Diagnosed, EffectSize, Facts, FoundCause
from pipeline.diagnosis.finding import Verdict
from pipeline.diagnosis.hypotheses import usual
from pipeline.diagnosis.verdict import of_both, verdict
from pipeline.machine.effect import Elastic
from pipeline.machine.robot.weight import weighs
from pipeline.positions import answer as of_positions
from pipeline.positions.answer import PositionsResults
from pipeline.positions.campaign import model_file
from pipeline.positions.combined import combined, spring_agreement
from pipeline.positions.positions_estimate import PositionsEstimate, called_for, laws_of_gears
from pipeline.positions.with_pulls import as_estimated, beside_pulls, opened, unloaded_p_value
from pipeline.prediction.model import IdentifiedModel
from pipeline.reduction.bring import Keep, Step, bring
from pipeline.reduction.case import Case
from pipeline.system import alarms
from pipeline.system.estimate import left_out
from pipeline.system.fit import Fitted, fit

_ANNEX = "pipeline.annex.position_tables:identified"
"""Tables of the positions for the figures behind the first page."""


@dataclass(frozen=True, eq=False)
class PositionsAndPulls:
    """What positions and pulls of one robot say.

    Attributes:
        case: The campaign of pulls, its robot where the positions have it.
        delivered: The same with its robot as its file has it.
        said: What the positions say; in the end beside the pulls.
        lighter: Springs over those with an arm of usual weight, where nobody states masses.
        agreement: Springs by the weight against those by the pulls.
    """

    case: Case
    delivered: Case
    said: PositionsResults
    lighter: float
    agreement: SpringAgreement | None = None

    @classmethod
    def of(cls, case: Case, said: PositionsResults, step: Step) -> PositionsAndPulls:
        """The pulls of a robot that stands where its positions have it.

        As its file has it where nothing explains these.
        """
        if verdict(replace(said.facts, mistakes=())) is Verdict.UNEXPLAINED:
            return cls(case, case, said, 1.0)
        there, found, factor = step(as_estimated)(case, said.found.final)
        return cls(there, case, said.ending(said.found.ending(found)), factor)

    def given(self, step: Step) -> Fitted:
        """The paper's model of the pulls alone, on the robot as delivered."""
        return step(fit)(self.delivered, bring(self.delivered))

    def beside(self, stands: Fitted, diagnosis: Diagnosed) -> PositionsAndPulls:
        """The same after the pulls, whose likeliest model adds to what the positions know."""
        if not isinstance(stands.data.stance, PositionsEstimate):
            return self
        one = diagnosis.hypotheses[0] if diagnosis.hypotheses else joint_springs(stands).first
        now = combined(one, stands.data)
        agreement = spring_agreement(one, now, self.lighter)
        found, every = self.said.found.final, self.said.found.final.mechanism.elements
        before = opened(found, called_for(every, stands.data.stance.held))
        gears = laws_of_gears(one.cell.effects, every)
        table_p = unloaded_p_value(before, stands.data.stance, stands.data, self.case.tool, gears)
        agreement = replace(agreement, table_p=table_p)
        found = opened(found, called_for(every, now.stance.held))
        if agreement.p >= alarms.MISFIT:
            found = beside_pulls(found, now.stance, now.value, now.cov)
        return replace(
            self, said=self.said.ending(self.said.found.ending(found)), agreement=agreement
        )

    @property
    def agrees(self) -> bool:
        """Whether both say the same of the springs."""
        return self.agreement is not None and self.agreement.p >= alarms.MISFIT

    def facts(self, pulls: Facts) -> Facts:
        """What the verdict of both follows from: the worse evidence decides."""
        mine = self.said.facts
        return replace(
            pulls,
            mistakes=(*pulls.mistakes, *mine.mistakes),
            positions=replace(mine, mistakes=()),
            agreement=self.agreement,
        )

    def recommended(self, values: ModelValues, step: Step) -> ModelValues:
        """A model of the pulls, estimated together with the positions."""
        beside: ModelValues = step(beside_positions)(values)
        return beside

    @cached_property
    def _alone(self) -> Answer:
        return of_positions.answer(self.said)

    def files(self, pulls: IdentifiedModel) -> dict[str, bytes]:
        """What `pipeline predict` reads, by name.

        Args:
            pulls: What is handed over of the pulls.
        """
        return model_file(self.said, pulls, self.agrees)

    def shown(self, pulls: Mapping[str, pd.DataFrame], keep: Keep) -> dict[str, pd.DataFrame]:
        """The tables of the positions, beside those of the pulls."""
        rejected = pd.concat([self.said.rejected, pulls["rejected"]], ignore_index=True)
        pictured = doors.found(_ANNEX)
        return {
            **(pictured(self.said.found, keep, pulls["laws"]) if pictured else {}),
            "rejected": keep("13_rejected", rejected, tables.REJECTED),
        }

    def answer(self, found: CampaignResults, pulls: Answer) -> Answer:
        """One answer: that of the pulls, with what only positions say."""
        mine = self._alone
        lines = tuple(self._lines(pulls))
        validation = pulls.validation and pulls.validation.model_copy(
            update={
                "held_out_position_mm": mine.validation and mine.validation.held_out_position_mm
            }
        )
        return pulls.model_copy(
            update={
                "verdict_sentence": tuple(line.text for line in lines),
                "first_screen": lines,
                "recommended": pulls.recommended.model_copy(
                    update={"table": contract.TableSource.ESTIMATED}
                ),
                "validation": validation,
                "diagnosis": self._diagnosis(found, pulls.diagnosis),
                "rejected": (*mine.rejected, *pulls.rejected),
                "findings": tuple(dict.fromkeys((*pulls.findings, *mine.findings))),
                "payloads": mine.payloads or pulls.payloads,
                "geometry": mine.geometry,
                "geometry_combinations": mine.geometry_combinations,
                "position_steps": mine.position_steps,
                "springs_by": self._springs(),
                "assumptions": tuple(dict.fromkeys((*pulls.assumptions, *mine.assumptions))),
            }
        )

    def _diagnosis(self, found: CampaignResults, pulls: contract.Diagnosis) -> contract.Diagnosis:
        """Mistakes of both, causes of the pulls and of the positions, and what yields in both."""
        mine, facts = self._alone.diagnosis, found.facts
        causes = [one for one in mine.causes if one.evidence is None]  # mistakes are told of both
        causes += [cause_entry(one) for one in yielding(found.told.values.hypotheses)]
        known_values = {(one.name, one.where) for one in pulls.causes}
        beside = []
        for one in causes:
            if (one.name, one.where) not in known_values:
                known_values.add((one.name, one.where))
                beside.append(one)
        return pulls.model_copy(
            update={
                "verdict": verdict(facts),
                "reasons": tuple(row.finding for row in of_both(facts)),
                "causes": (*pulls.causes, *beside),
                "unloaded_off_mm": mine.unloaded_off_mm,
            }
        )

    def _lines(self, pulls: Answer) -> Iterator[Line]:
        """The first screen of the pulls, and beside its lines what the positions add to them."""
        predicted = next(one.text for one in self._alone.first_screen if one.about == About.VERDICT)
        more = {
            About.VERDICT: [] if self.said.facts.mistakes else [predicted],
            About.MODEL: list(self._model()),
            About.WRONG: list(of_positions.besides_causes(self.said)),
        }
        for line in pulls.first_screen:
            beside = more.pop(line.about, [])
            yield line.model_copy(update={"text": " ".join([line.text, *beside])})

    def _model(self) -> Iterator[str]:
        """What positions and pulls share."""
        if not self.agrees or self.case.stance is None:
            return
        yield (
            "The table of the robot is estimated from its positions, its springs from pulls and "
            "from the arm's own weight together."
        )
        if self.agreement is not None and self.agreement.factor is not None:
            fit = "The masses stated do not fit" if weighs(self.case.robot) else _NO_MASSES
            yield f"{fit}: the pulls tell how heavy the arm is, which the positions alone cannot."

    def _springs(self) -> contract.SpringsBy | None:
        """Springs by weight and by pulls, beside each other."""
        agreement = self.agreement
        if agreement is None:
            return None
        names = [f"k_{joint.name}" for joint in self.case.robot.joints]
        return contract.SpringsBy(
            chi2=agreement.chi2,
            dof=agreement.dof,
            p_value=agreement.p,
            joined=self.agrees,
            lighter=agreement.factor,
            each=tuple(
                contract.SpringBy(name=name, by_weight=_of(w), by_pulls=_of(p))
                for name, w, p in zip(names, agreement.weight, agreement.pulls, strict=True)
            ),
        )


def beside_positions(values: ModelValues) -> ModelValues:
    """The same model estimated together with the absolute positions of the same campaign.

    The cross-validation residuals of joint springs are then those of the joint estimate. Those with
    causes are kept, since each fold of the pulls has chosen its causes by itself.
    """
    data, left = values.fitted.data, values.left_out_m
    springs = not values.first.effects  # further hypotheses then have causes of a usual size
    every = tuple(
        combined(one, data, usual(one.effects[0]) if springs and one.effects else None).hypothesis
        for one in values.hypotheses
    )
    if springs:
        left = left_out(every[0].system)[: len(left)]
    return replace(values, hypotheses=every, left_out_m=left)


_NO_MASSES = "No masses are stated"


def _of(one: np.ndarray) -> contract.Known | None:
    """Compliance with its uncertainty; None where nothing tells it."""
    value, std = one.tolist()
    return contract.Known(value=value, std=std) if np.isfinite(std) else None


def yielding(hypotheses: Sequence[Hypothesis]) -> Iterator[FoundCause]:
    """Elements of the first hypothesis as causes, with their parameters.

    The p-value is that of the parameters y with their covariance C: chi-square of y' C^-1 y.
    """
    first = hypotheses[0]
    at = {one.name: k for k, one in enumerate(first.estimate.parameters)}
    for effect in first.effects:
        if isinstance(effect, Elastic) and all(one.name in at for one in effect.parameters):
            k = [at[one.name] for one in effect.parameters]
            y, C = first.estimate.value[k], first.estimate.cov[np.ix_(k, k)]
            p = float(chi2_beyond(float(y @ linear.inverse(C) @ y), len(k)))
            each = zip(effect.parameters, y.tolist(), np.sqrt(np.diag(C)).tolist(), strict=True)
            sizes = tuple(EffectSize.symmetric(*one) for one in each)
            yield FoundCause(effect, 1.0, sizes, p, each_way=both_ways(effect, hypotheses))
