"""Stiffness of every joint of a rail-mounted robot, from pulls that a laser tracker watched.

    import pipeline

    campaign = pipeline.load_campaign("data/raw/kr500_demo")
    result = pipeline.identify(campaign)
    result.model.predict(q, force_n)  # q [m] or [rad], force [N] in F_b

Numpy and the rest are imported when the first of these names is asked for.
"""

from __future__ import annotations

import sys

if (
    sys.argv[:1] == ["-m"]
    and not sys.flags.safe_path
    and not __file__.startswith(f"{sys.path[0]}/")
):
    del sys.path[0]  # `python -m pipeline`: the current folder, where anybody's modules may lie

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pipeline.base.version import __version__ as __version__

if TYPE_CHECKING:
    from pipeline.base.errors import CannotWrite, InputError, PipelineError, UsageError
    from pipeline.design.library import Design, design_poses
    from pipeline.library.campaign import (
        Campaign,
        Picture,
        Result,
        identify,
        load_campaign,
        run_campaign,
    )
    from pipeline.library.compensate import Compensation
    from pipeline.library.compliance import CartesianStiffness
    from pipeline.library.model import (
        Deflection,
        Model,
        PositionModel,
        Positions,
        load_model,
        load_position_model,
    )
    from pipeline.machine.robot import Robot
    from pipeline.machine.robot import load as load_robot
    from pipeline.simulate.library import Simulated, simulate_campaign

__all__ = [
    "Campaign",
    "CannotWrite",
    "CartesianStiffness",
    "Compensation",
    "Deflection",
    "Design",
    "InputError",
    "Model",
    "Picture",
    "PipelineError",
    "PositionModel",
    "Positions",
    "Result",
    "Robot",
    "Simulated",
    "UsageError",
    "design_poses",
    "identify",
    "load_campaign",
    "load_model",
    "load_position_model",
    "load_robot",
    "run_campaign",
    "simulate_campaign",
]

_FROM = {
    "base.errors": ("CannotWrite", "InputError", "PipelineError", "UsageError"),
    "library.campaign": (
        "Campaign",
        "Picture",
        "Result",
        "identify",
        "load_campaign",
        "run_campaign",
    ),
    "library.model": (
        "Deflection",
        "Model",
        "PositionModel",
        "Positions",
        "load_model",
        "load_position_model",
    ),
    "design.library": ("Design", "design_poses"),
    "simulate.library": ("Simulated", "simulate_campaign"),
    "machine.robot": ("Robot", "load_robot"),
    "library.compensate": ("Compensation",),
    "library.compliance": ("CartesianStiffness",),
}
_RENAMED = {"load_robot": "load"}


def __getattr__(name: str) -> Any:
    """One of `__all__`, imported when it is first asked for."""
    for module, names in _FROM.items():
        if name in names:
            found = getattr(import_module(f"pipeline.{module}"), _RENAMED.get(name, name))
            globals()[name] = found
            return found
    raise AttributeError(f"module 'pipeline' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
