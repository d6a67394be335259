"""What stands at the flange."""

from __future__ import annotations

import numpy as np

from pipeline.machine.cell import Tool
from pipeline.reduction.settings import Settings


def tool(settings: Settings) -> Tool:
    """The effector of a campaign: its load point and the targets that are measured."""
    names = settings.measured
    return Tool(
        load_point=np.array(settings.tool["load_point"]),
        targets=np.array(names, dtype=object),
        points=np.array([settings.tool[name] for name in names]),
        six=settings.instrument.measures == "poses",
    )
