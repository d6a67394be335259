"""Run one campaign through Prefect, for `pipeline run`."""

from __future__ import annotations

import os
import signal
import sys
from typing import TYPE_CHECKING

from pipeline.app.progress import Tell
from pipeline.base import files
from pipeline.base.environment import elsewhere
from pipeline.base.shown import say
from pipeline.service import server
from pipeline.service.current import current
from pipeline.service.processes import sheltered
from pipeline.store.campaign import CampaignFolder

if TYPE_CHECKING:  # these types import the numerical libraries, which takes a second
    from pipeline.answer.contract import Answer


def through_prefect(campaign: CampaignFolder, force: bool, tell: Tell) -> Answer:
    """Bring a campaign up to date as a Prefect flow, unless it is current."""
    if current(campaign) and not force:  # also reports input that no engine can read
        from pipeline.answer.archive import read

        return read(campaign)
    home = campaign.root / server.HOME
    with files.writing(home):
        home.mkdir(parents=True, exist_ok=True)
    server.has_room(home)
    if server.serving(campaign.root) is None and (sentence := server.mended(campaign.root)):
        say(sentence, sys.stderr)
    (server.join if os.environ.get("PREFECT_API_URL") else server.settle)(campaign.root)
    server.see_settings()
    there = CampaignFolder(campaign.root.absolute(), campaign.folder.absolute())
    with elsewhere():
        from pipeline.service.flow import identified, telling  # importing Prefect takes two seconds

        with telling(tell), sheltered(signal.SIGUSR1):
            return identified(there, force)
