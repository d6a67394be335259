"""Outbuilding: the virtual cell; raw files from poses, pulls, noise and hidden effects.

Door: `simulate.command` for the command line, also for the list of `effects` that can be planted;
`simulate.library` for `import pipeline`.
Tests: `tests/simulate/`; nearly all others measure with it.
"""

from pipeline.simulate.campaign import RawCampaign, prepared, raw_files, simulate
from pipeline.simulate.hidden import Planted, plant
from pipeline.simulate.plan import Plan, parse, revised, with_noise
from pipeline.simulate.scene import build, draw

__all__ = [
    "Plan",
    "Planted",
    "RawCampaign",
    "build",
    "draw",
    "parse",
    "plant",
    "prepared",
    "raw_files",
    "revised",
    "simulate",
    "with_noise",
]
