"""All that a run found out about a campaign, for whoever words the answer."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from pipeline import handover
from pipeline.campaign import Raw
from pipeline.diagnosis import verdict as verdicts
from pipeline.results import Estimate
from pipeline.screening.finding import Finding
from pipeline.screening.fit import Fitted
from pipeline.stages.validate import Where


@dataclass(frozen=True, eq=False)
class Findings:
    """All that a run found out about a campaign.

    Attributes:
        campaign: Name of the campaign.
        raw: What its folder holds.
        given: The joint springs from the data as given.
        right: The joint springs from the data with every mistake put right; the same without any.
        mistakes: What is wrong with the data.
        diagnosis: What the model misses, beside the mistakes.
        richer: The machine with the named causes in it, None without any.
        residuals: Table RESIDUALS of `given`.
        where: The test pose.
        checked: Table VALIDATION of `given`.
    """

    campaign: str
    raw: Raw
    given: Fitted
    right: Fitted
    mistakes: tuple[Finding, ...]
    diagnosis: verdicts.Diagnosis
    richer: handover.Model | None
    residuals: pd.DataFrame
    where: Where
    checked: pd.DataFrame

    @property
    def estimate(self) -> Estimate:
        """The joint springs from the data as given."""
        return self.given.estimate
