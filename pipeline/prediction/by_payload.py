"""Prediction of each weight or payload by springs estimated from the other loads only."""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import Bools
from pipeline.base.linear import rms
from pipeline.prediction.model import NOTHING_M
from pipeline.reduction.measured import Measured
from pipeline.reduction.settings import Settings
from pipeline.reduction.weights import PULL
from pipeline.system.estimate import solve
from pipeline.system.system import System


def by_payload(settings: Settings, data: Measured, system: System) -> dict[str, float | None]:
    """Held-out rms error [m] per coordinate for each payload or weight; {} with one load.

    r = c_k - B_k x, with x estimated from the rows of all other loads with their own covariance;
    None if these leave a parameter undetermined that moves the rows of k.

    Args:
        settings: Settings with the names of the payloads.
        data: The measurements.
        system: Their linear system, for the model in question.
    """
    body = np.where(system.rows.pull < 0, PULL, data.body[system.rows.pull])
    bodies = np.unique(body)
    if len(bodies) < 2:
        return {}
    return {
        _name(settings, data, int(one)): _held_out(system, body == one)
        for one in bodies[bodies != PULL]
    }


def _name(settings: Settings, data: Measured, body: int) -> str:
    """Name of a payload; `120 kg` for a weight."""
    names = list(settings.payload)
    if body < len(names):
        return names[body]
    force = data.pulls.force[np.argmax(data.body == body)]
    return f"{np.linalg.norm(force) / settings.gravity.m_s2:.6g} kg"


def _held_out(system: System, mine: Bools) -> float | None:
    found = solve(system.part(~mine), np.zeros(len(system.parameters)))
    B = system.B[mine]
    dark = np.isinf(np.diag(found.cov))
    if (np.abs(B * system.typical)[:, dark].max(initial=0.0)) > NOTHING_M:
        return None
    return rms(system.c[mine] - B @ found.value)
