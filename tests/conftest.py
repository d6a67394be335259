"""The bench: campaigns whose truth we know."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

from pipeline import settings, tables
from pipeline.campaign import Raw
from pipeline.robot import load
from pipeline.simulate import Plan, RawCampaign, simulate

if TYPE_CHECKING:
    from pipeline.run import Reduced

SEED = 20261103


@pytest.fixture(scope="session")
def small_plan() -> Plan:
    """Seven poses, two load steps up and one down: enough for every joint, quick to compute."""
    return Plan(
        name="small", seed=SEED, poses={"count": 7}, pulls={"steps_n": [1500.0, 3000.0, 2000.0]}
    )


@pytest.fixture(scope="session")
def small_campaign(small_plan: Plan) -> RawCampaign:
    """A campaign of `small_plan` with 0.03 mm of noise."""
    return simulate(small_plan)


@pytest.fixture(scope="session")
def exact_campaign(small_plan: Plan) -> RawCampaign:
    """A campaign of `small_plan` without noise, all digits written."""
    return simulate(small_plan.without_noise())


@pytest.fixture(scope="session")
def read_back() -> Callable[[RawCampaign], Reduced]:
    """From a simulated campaign's files to forces and displacements, by the run's own steps."""
    from pipeline.run import reduce

    def through_the_stages(campaign: RawCampaign) -> Reduced:
        stated = settings.parse(campaign.files["campaign.toml"].decode())
        raw = Raw(stated, load(stated.robot), campaign.files, key="")
        return reduce(raw, lambda _, table, promise: tables.conform(table, promise).to_pandas())

    return through_the_stages
