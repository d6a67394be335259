"""Stage 6: the joint springs of one campaign, resting on the noise that its data show."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pipeline.reduction.bring import Reduced
from pipeline.reduction.case import Case
from pipeline.reduction.measured import Measured
from pipeline.system.estimate import identify
from pipeline.system.system import Estimate, System
from pipeline.system.variance import Components, noise, rescaled, resting_on


@dataclass(frozen=True, eq=False)
class Fitted:
    """A campaign with its joint springs.

    Attributes:
        case: The campaign.
        reduced: Its measurements with the stated noise.
        data: Its measurements with the noise that is used.
        system: c = B x with that noise.
        estimate: What the data say about x.
        noise: Noise found beside the stated one.
    """

    case: Case
    reduced: Reduced
    data: Measured
    system: System
    estimate: Estimate
    noise: Components


def fit(case: Case, reduced: Reduced) -> Fitted:
    """Identify the joint springs; where the noise is found larger than stated, with that noise."""
    data, start = reduced.data, case.robot.nominal_compliance
    data = replace(data, bends=data.noise_stated)  # of residuals alone nobody knows what is noise
    system, estimate = identify(case.cell, data, start)
    data = data.in_metres(system.found_m)
    found = noise(case.settings, case.cell, reduced.placed, data, system, estimate)
    if found.used:
        data = replace(rescaled(data, found), bends=True)
        system, estimate = identify(case.cell, data, start)
        estimate = resting_on(estimate, found)
    return Fitted(case, reduced, data, system, estimate, found)
