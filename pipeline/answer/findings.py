"""All that a run found out about a campaign, for whoever words the answer."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from pipeline.answer.recommended import DecisionRow, ModelValues
from pipeline.diagnosis.facts import Diagnosed, Facts
from pipeline.diagnosis.finding import Verdict
from pipeline.diagnosis.verdict import verdict
from pipeline.faults.mistake import Mistake
from pipeline.prediction import model as handover
from pipeline.prediction.tolerance import JudgedTolerance
from pipeline.reduction.pose_of_interest import Where
from pipeline.store.campaign import Raw
from pipeline.system.fit import Fitted
from pipeline.system.one_pose import OnePose


@dataclass(frozen=True, eq=False)
class Told:
    """One model of the campaign with what is stated of it.

    Attributes:
        values: Its values.
        model: The machine with them.
        checked: Table VALIDATION; None where nothing is determined.
    """

    values: ModelValues
    model: handover.IdentifiedModel
    checked: pd.DataFrame | None


@dataclass(frozen=True, eq=False)
class Findings:
    """All that a run found out about a campaign.

    Attributes:
        campaign: Name of the campaign.
        raw: What its folder holds.
        given: The joint springs from the data as given.
        right: The joint springs from the data with every mistake put right; the same without any.
        diagnosis: What the model misses, mistakes apart.
        facts: What the verdict follows from, mistakes included.
        row: Which values the answer gives, and why.
        told: Those values.
        springs: The paper's model on the data as given.
        extended: The identified causes' own fit, on the data that the answer rests on; None
            without causes.
        where: The test pose.
        control: Table RELIABILITY of those values.
        carried: Table INFLUENCE of those values.
        judged: What those values predict where the user asked for it.
        one_pose: What shows that targets were computed from one pose; None where nobody has to.
    """

    campaign: str
    raw: Raw
    given: Fitted
    right: Fitted
    diagnosis: Diagnosed
    facts: Facts
    row: DecisionRow
    told: Told
    springs: Told
    extended: ModelValues | None
    where: Where
    control: pd.DataFrame
    carried: pd.DataFrame
    judged: JudgedTolerance
    one_pose: OnePose | None = None

    @property
    def mistakes(self) -> tuple[Mistake, ...]:
        """What is wrong with the data."""
        return self.facts.mistakes

    @property
    def verdict(self) -> Verdict:
        """Of the campaign."""
        return verdict(self.facts)
