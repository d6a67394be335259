"""Simulated fleets at the level of campaigns: true stiffnesses that age, and their estimates.

Stiffnesses change a little every day, days differ by a random factor, and the error of a campaign
is drawn from its covariance, which is that of the demo campaign's own answer. Nothing is shared
with the model that monitors them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from pipeline.base.arrays import Array
from pipeline.reduction.bring import conformed
from pipeline.run import campaign_answer
from pipeline.store.campaign import find

ROOT = Path(__file__).parents[2]
YEAR = 365.25


@dataclass(frozen=True)
class Kind:
    """One kind of fleet.

    Attributes:
        name: Name of the kind.
        says: Description.
        joints: Number of joints of the first robot that wear; 7 is all of them.
        robots: Number of robots.
        own: Day-to-day scatter of each joint [1].
        common: Day-to-day scatter common to all joints [1].
        repairs: Whether each robot has a joint replaced, which is reported.
        jump: Fraction of its stiffness that a joint of the first robot loses from the fifth
            campaign on, which is not reported.
    """

    name: str
    says: str
    joints: int = 0
    robots: int = 6
    own: float = 0.01
    common: float = 0.0
    repairs: bool = False
    jump: float = 0.0


KINDS = {
    one.name: one
    for one in (
        Kind("one", "wear in one joint", 1),
        Kind("two", "wear in two joints", 2),
        Kind("all", "wear in all joints", 7),
        Kind("alone", "wear in one joint of the only robot", 1, robots=1),
        Kind("jump", "one joint loses 8 % at once", jump=0.08),
        Kind("repaired", "nothing wears, each robot has a joint replaced", repairs=True),
        Kind("loose", "nothing wears, days differ by 2 %", own=0.02),
        Kind("together", "nothing wears, days differ by 1 % in all joints alike", common=0.01),
    )
}

WEAR = 0.05
"""Stiffness lost per year [1]."""

CAMPAIGNS = 12
APART = YEAR / 2
EARLY_OR_LATE = 20
"""Number of campaigns of each robot; days between two, and maximum deviation from that [d]."""

UNSEEN = 0.05
"""Probability that a campaign leaves one of the joints undetermined [1]."""


@dataclass(eq=False)
class Robot:
    """One robot with its campaigns.

    Attributes:
        day: Day of each campaign, shape (K,).
        x: Estimated compliances, NaN if undetermined, shape (K, n).
        cov: Their covariance, shape (n, n).
        worn: Whether something has changed that is not reported.
        repairs: Day and joint of each repair.
    """

    day: Array
    x: Array
    cov: Array
    worn: bool
    repairs: list[tuple[float, int]] = field(default_factory=list)


@cache
def measured() -> tuple[Array, Array]:
    """Compliances of the demo campaign and their covariance, from raw files."""
    kept = {}

    def keep(name, table, promise):
        kept[name] = conformed(name, table, promise)
        return kept[name]

    campaign_answer("kr500_demo", find(ROOT, "kr500_demo").read(), keep)
    cov = kept["41_covariance"].set_index("parameter").to_numpy(float)
    return kept["40_estimate"]["value"].to_numpy(float), cov


def fleet(kind: Kind, seed: int) -> list[Robot]:
    """All robots of a fleet over all their campaigns."""
    streams = np.random.default_rng([seed, len(kind.name)]).spawn(kind.robots)
    return [_robot(kind, rng, first=k == 0) for k, rng in enumerate(streams)]


def _robot(kind: Kind, rng: np.random.Generator, first: bool) -> Robot:
    x, cov = measured()
    n = len(x)
    late = rng.uniform(-EARLY_OR_LATE, EARLY_OR_LATE, CAMPAIGNS)
    day = np.round(rng.uniform(0, APART) + APART * np.arange(CAMPAIGNS) + late)
    new = rng.lognormal(0, 0.15, n) / x
    pull = rng.permutation(n)
    left = np.ones(n)
    left[pull[: kind.joints if first else 0]] = (1 - WEAR) ** (1 / YEAR)
    repairs, stiffness, found = [], new.copy(), []
    if kind.repairs:
        repairs = [(day[int(rng.integers(1, CAMPAIGNS - 1))] + 7, int(rng.integers(n)))]
    gone = 0.0
    for k, today in enumerate(day):
        for at, joint in repairs:
            if gone <= at < today:
                stiffness[joint] *= rng.lognormal(0, 0.3)
        stiffness = stiffness * left ** (today - gone)
        if first and kind.jump and k == 4:
            stiffness[pull[0]] *= 1 - kind.jump
        gone = today
        factor = rng.lognormal(0, kind.own, n) * rng.lognormal(0, kind.common or 1e-12)
        seen = rng.multivariate_normal(1 / (stiffness * factor), cov)
        if rng.random() < UNSEEN:
            seen[rng.integers(n)] = np.nan
        found.append(seen)
    worn = first and bool(kind.joints or kind.jump)
    return Robot(day, np.array(found), cov, worn, repairs)
