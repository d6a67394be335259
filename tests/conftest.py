"""The bench: campaigns whose truth we know."""

import pytest

from pipeline.simulate import Plan, RawCampaign, simulate

SEED = 20261103


@pytest.fixture(scope="session")
def small_plan() -> Plan:
    """Seven poses, two load steps: enough for every joint, quick to compute."""
    return Plan(name="small", seed=SEED, poses={"count": 7}, pulls={"steps_n": [1500.0, 3000.0]})


@pytest.fixture(scope="session")
def small_campaign(small_plan: Plan) -> RawCampaign:
    """A campaign of `small_plan` with 0.03 mm of noise."""
    return simulate(small_plan)


@pytest.fixture(scope="session")
def exact_campaign(small_plan: Plan) -> RawCampaign:
    """A campaign of `small_plan` without noise, all digits written."""
    return simulate(small_plan.without_noise())
