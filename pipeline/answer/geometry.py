"""The robot's table as the unloaded reflectors show it, for result.json."""

from __future__ import annotations

import numpy as np

from pipeline.answer import contract
from pipeline.base.arrays import Array
from pipeline.base.linear import rms
from pipeline.diagnosis.facts import Standing
from pipeline.machine.robot import Robot
from pipeline.machine.robot.letters import letters, nominal

KNOWN = 0.5
"""Variance over that of the prior below which the readings alone know more than the prior does."""


def table_entries(
    robot: Robot, off: Array, variance: Array, rough: Array, before: Array
) -> tuple[contract.Letter, ...]:
    """Every geometric parameter that moves the flange against F_b.

    Args:
        robot: With its table as delivered.
        off: How far each parameter is from it [m] or [rad], shape (k,).
        variance: Of that, shape (k,).
        rough: How rough the table was found to be, for each, shape (k,).
        before: Standard deviation of each before the data, shape (k,).
    """
    every = letters(robot)
    table = nominal(robot, every)
    return tuple(
        contract.Letter(
            name=letter.name,
            where=letter.joint,
            nominal=float(stated),
            value=float(stated + moved),
            std=float(np.sqrt(v)),
            prior_std=float(prior),
            unit="rad" if letter.turns else "m",
            identifiable=bool(v < KNOWN * std**2),
        )
        for letter, stated, moved, v, prior, std in zip(
            every, table, off, variance, rough, before, strict=True
        )
    )


def estimated_table(stood: Standing) -> tuple[contract.Letter, ...]:
    """The table of a campaign of pulls; empty where too few reflectors were read unloaded."""
    found = stood.cells
    if found is None:
        return ()
    zeros = found.zeros
    at = zeros.columns.table
    rough = np.maximum(found.per_letter, zeros.stated)
    free = {column for one in found.free for column in one.columns}
    before = np.array(
        [max(found.std[found.best, k], rough[k - at.start]) for k in range(at.start, at.stop)]
    )
    before = np.where([k in free for k in range(at.start, at.stop)], np.inf, before)
    every = table_entries(zeros.robot, found.mean[at], np.diag(found.covariance)[at], rough, before)
    shared = _shared(stood)
    return tuple(
        entry.model_copy(update={"identifiable": entry.identifiable and letter.label not in shared})
        for entry, letter in zip(every, letters(zeros.robot), strict=True)
    )


def _shared(stood: Standing) -> set[str]:
    """Entries of which only the sum with a twin is known."""
    pairs = [one for one in stood.causes if one.twins]
    return {effect.label for one in pairs for effect in (one.effect, *one.twins)}


def with_positions(values: contract.Values, stood: Standing) -> contract.Values:
    """Values with how far left-out poses' unloaded reflectors are from that table's prediction."""
    if stood.gain is None or values.validation is None:
        return values
    off = 1e3 * np.linalg.norm(stood.gain.after.reshape(-1, 3), axis=1)
    held = contract.HeldOutPosition(
        mean=float(off.mean()), rms=rms(off), p95=float(np.quantile(off, 0.95))
    )
    checked = values.validation.model_copy(update={"held_out_position_mm": held})
    return values.model_copy(update={"validation": checked})
