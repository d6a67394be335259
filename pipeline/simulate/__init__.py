"""The virtual cell: poses, pulls, noise and hidden effects become the files of a raw campaign."""

from pipeline.simulate.campaign import RawCampaign, prepared, raw_files, readings, simulate, truth
from pipeline.simulate.hidden import Planted, plant
from pipeline.simulate.plan import Plan, parse, revised, with_noise
from pipeline.simulate.scene import Draws, Scene, build, draw

__all__ = [
    "Draws",
    "Plan",
    "Planted",
    "RawCampaign",
    "Scene",
    "build",
    "draw",
    "parse",
    "plant",
    "prepared",
    "raw_files",
    "readings",
    "revised",
    "simulate",
    "truth",
    "with_noise",
]
