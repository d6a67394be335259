"""Whether a campaign needs a run at all, asked before an engine is started."""

from __future__ import annotations

from pipeline.base.errors import InputError
from pipeline.store.campaign import CampaignFolder


def current(campaign: CampaignFolder) -> bool:
    """Whether its last run is still valid, so that no engine needs to start.

    Raises:
        InputError: It cannot be read, and trying again will not help.
    """
    try:
        return campaign.done(campaign.read().key)
    except InputError as problem:
        if problem.passing:  # the engine reads again a little later
            return False
        raise
