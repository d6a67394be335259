"""The virtual cell: poses, pulls, noise and hidden effects become the files of a raw campaign."""

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
