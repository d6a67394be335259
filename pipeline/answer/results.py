"""Everything that a run found out about a campaign, as input for the answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, Protocol

import pandas as pd

from pipeline.answer.contract import Answer, Carried, CommonFactor, Controlled, Overload
from pipeline.answer.recommended import DecisionRow, ModelValues, joint_springs
from pipeline.diagnosis.facts import Diagnosed, Facts
from pipeline.diagnosis.finding import Verdict
from pipeline.diagnosis.verdict import verdict
from pipeline.faults.mistake import Mistake
from pipeline.prediction.model import IdentifiedModel
from pipeline.prediction.tolerance import JudgedTolerance
from pipeline.reduction.bring import Keep, Step
from pipeline.reduction.case import Case
from pipeline.reduction.pose_of_interest import PoseOfInterest
from pipeline.store.campaign import Raw
from pipeline.system.fit import Fitted
from pipeline.system.one_pose import OnePose


@dataclass(frozen=True, eq=False)
class CampaignAnswer:
    """Results from the files of a campaign.

    Attributes:
        answer: Content of result.json.
        shown: Tables displayed in the report, by name.
        model: The identified robot, for use elsewhere.
        files: Further files to deliver, by name.
    """

    answer: Answer
    shown: dict[str, pd.DataFrame]
    model: IdentifiedModel
    files: dict[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ReportedModel:
    """One model of the campaign, as reported.

    Attributes:
        values: Its values.
        model: The identified machine with these values.
        checked: Table VALIDATION; None if nothing is determined, or without the annex.
    """

    values: ModelValues
    model: IdentifiedModel
    checked: pd.DataFrame | None


@dataclass(frozen=True, eq=False)
class ReadingControl:
    """How readings check each other, and how much each pull changes what is estimated.

    Attributes:
        readings: Table RELIABILITY.
        pulls: Table INFLUENCE.
        least: The errors with the lowest redundancy.
        most: The pull with the largest effect on each stiffness and on each cause.
    """

    readings: pd.DataFrame
    pulls: pd.DataFrame
    least: tuple[Controlled, ...]
    most: tuple[Carried, ...]


class AgainstStated(NamedTuple):
    """What the readings say against what was stated; nothing without the check.

    Attributes:
        sentences: A sentence on each contradiction.
        factor: Common factor of all stiffnesses.
        overload: The strongest pull, if the robot could not hold it.
    """

    sentences: Sequence[str] = ()
    factor: CommonFactor | None = None
    overload: Overload | None = None


@dataclass(frozen=True, eq=False)
class CampaignResults:
    """Everything that a run found out about a campaign.

    Attributes:
        campaign: Name of the campaign.
        raw: Content of its folder.
        given: The joint springs from the data as given.
        right: The joint springs from the data with every mistake corrected; the same without
            mistakes.
        diagnosis: Diagnosis of these data, which does not include mistakes.
        facts: Facts from which the verdict follows, mistakes included.
        row: Which values the answer gives, and why.
        told: The recommended values.
        springs: The paper's model on the data as given.
        extended: Estimate of springs and identified causes from the data on which the answer rests;
            None without causes.
        where: The test pose.
        control: Control of the readings on which the recommended values rest; None without the
            annex.
        judged: Predictions at the test pose and along the path, and their conformity.
        one_pose: Evidence that all targets of a pose were computed from one pose of the effector;
            None if not applicable.
    """

    campaign: str
    raw: Raw
    given: Fitted
    right: Fitted
    diagnosis: Diagnosed
    facts: Facts
    row: DecisionRow
    told: ReportedModel
    springs: ReportedModel
    extended: ModelValues | None
    where: PoseOfInterest
    control: ReadingControl | None
    judged: JudgedTolerance
    one_pose: OnePose | None = None

    @property
    def mistakes(self) -> tuple[Mistake, ...]:
        """The mistakes in the data."""
        return self.facts.mistakes

    @cached_property
    def effective(self) -> ModelValues:
        """Joint springs alone from the data on which the answer rests, for a controller."""
        return joint_springs(self.right) if self.mistakes else self.springs.values

    @property
    def verdict(self) -> Verdict:
        """The verdict on the campaign."""
        return verdict(self.facts)


class WithPositions(Protocol):
    """Positions and pulls of one robot; the outbuilding of positions makes it.

    Attributes:
        case: The campaign of pulls, its robot where the positions have it.
    """

    case: Case

    @property
    def agrees(self) -> bool:
        """Whether both say the same of the springs."""

    def given(self, step: Step) -> Fitted:
        """The paper's model of the pulls alone, on the robot as delivered."""

    def beside(self, stands: Fitted, diagnosis: Diagnosed) -> WithPositions:
        """The same after the pulls."""

    def facts(self, pulls: Facts) -> Facts:
        """What the verdict of both follows from."""

    def recommended(self, values: ModelValues, step: Step) -> ModelValues:
        """A model of the pulls, estimated together with the positions."""

    def shown(self, pulls: Mapping[str, pd.DataFrame], keep: Keep) -> dict[str, pd.DataFrame]:
        """The tables of the positions, beside those of the pulls."""

    def answer(self, found: CampaignResults, pulls: Answer) -> Answer:
        """One answer of both."""

    def files(self, pulls: IdentifiedModel) -> dict[str, bytes]:
        """Files to hand over, by name."""
