"""DH parameters as estimated from positions or from unloaded reflectors, for result.json."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.answer import contract
from pipeline.base import linear
from pipeline.base.arrays import Array, Parameter
from pipeline.base.tails import NORMAL_95
from pipeline.diagnosis.facts import UnloadedFacts
from pipeline.geometry.roughness import ScaleGrid
from pipeline.machine.robot import Robot
from pipeline.machine.robot.dh_parameters import dh_parameters, nominal
from pipeline.system.combinations import mixes

_KNOWN = 0.5
"""Ratio of posterior to prior variance below which a parameter counts as determined [1]: the
readings then contribute more information than the prior."""


def table_entries(
    robot: Robot, off: Array, variance: Array, rough: Array, before: Array
) -> tuple[contract.TableLetter, ...]:
    """Every geometric parameter that moves the flange relative to F_b.

    Args:
        robot: The robot with its nominal DH parameters.
        off: Estimated minus nominal parameters [m] or [rad], shape (k,).
        variance: Variances of the estimates, shape (k,).
        rough: Prior standard deviation of each parameter as reported, shape (k,).
        before: Prior standard deviation of each parameter in the estimate, shape (k,).
    """
    every = dh_parameters(robot)
    table = nominal(robot, every)
    return tuple(
        contract.TableLetter(
            name=letter.name,
            where=letter.joint,
            nominal=float(stated),
            value=float(stated + moved),
            std=float(np.sqrt(v)),
            prior_std=float(prior),
            unit="rad" if letter.turns else "m",
            identifiable=bool(v < _KNOWN * std**2),
        )
        for letter, stated, moved, v, prior, std in zip(
            every, table, off, variance, rough, before, strict=True
        )
    )


_HALF = 2.0
"""Typical size of a parameter over its prior standard deviation [1]. A combination is determined if
known to half of its typical size, that is, if the readings alone determine it as well as the prior,
the same criterion as `_KNOWN` for a single parameter."""


def table_combinations(
    entries: Sequence[contract.TableLetter], cov: Array, after: Array, before: Array
) -> tuple[contract.TableCombination, ...]:
    """Every combination that the readings determine of entries that they do not determine singly.

    With S = diag(s^2) the prior covariance of the entries and C their posterior covariance, the
    readings alone have the information S^(1/2) C^-1 S^(1/2) - 1 on the entries in units of s, with
    the base frame, the tool and all other parameters unknown.

    Args:
        entries: All entries, in the order of the DH parameters.
        cov: Covariance of the estimates as reported [m] or [rad], shape (k, k).
        after: C, for the priors `before`, shape (k, k).
        before: s, shape (k,).
    """
    one, size = np.eye(len(before)), _HALF * before
    N = _HALF**2 * (linear.solve(after / np.outer(before, before), one) - one)
    kinds = [Parameter(e.name, e.unit, s) for e, s in zip(entries, size.tolist(), strict=True)]
    off = np.array([entry.value - entry.nominal for entry in entries])
    alone = np.array([entry.identifiable for entry in entries], dtype=bool)
    return tuple(
        _combination(
            [entries[k] for k in one.of], one.weights, off[one.of], cov[np.ix_(one.of, one.of)]
        )
        for one in mixes(N, kinds, off, alone)
    )


def _combination(
    members: Sequence[contract.TableLetter], weights: Array, off: Array, cov: Array
) -> contract.TableCombination:
    value, std = float(weights @ off), float(np.sqrt(weights @ cov @ weights))
    return contract.TableCombination(
        of=tuple(
            contract.Mixed(name=entry.name, where=entry.where, weight=weight)
            for entry, weight in zip(members, weights.tolist(), strict=True)
        ),
        value=value,
        std=std,
        ci95=(value - NORMAL_95 * std, value + NORMAL_95 * std),
        unit=members[0].unit,
    )


def estimated(
    stood: UnloadedFacts,
) -> tuple[tuple[contract.TableLetter, ...], tuple[contract.TableCombination, ...]]:
    """Entries and determined combinations of them, by unloaded reflectors of pulls.

    Empty if too few were read.
    """
    if (found := stood.cells) is None:
        return (), ()
    at, best = found.zeros.columns.table, found.best
    entries = _estimated_entries(stood, found)
    return entries, table_combinations(
        entries, found.covariance[at, at], found.cov[best][at, at], found.std[best][at]
    )


def _estimated_entries(stood: UnloadedFacts, found: ScaleGrid) -> tuple[contract.TableLetter, ...]:
    zeros = found.zeros
    at = zeros.columns.table
    rough = np.maximum(found.per_letter, zeros.stated)
    free = {column for one in found.free for column in one.columns}
    before = np.array(
        [max(found.std[found.best, k], rough[k - at.start]) for k in range(at.start, at.stop)]
    )
    before = np.where([k in free for k in range(at.start, at.stop)], np.inf, before)
    ends = zeros.at_end
    variance = np.diag(ends @ found.covariance @ ends.T)
    every = table_entries(zeros.robot, ends @ found.mean, variance, rough, before)
    shared = _shared(stood)
    return tuple(
        entry.model_copy(update={"identifiable": entry.identifiable and letter.label not in shared})
        for entry, letter in zip(every, dh_parameters(zeros.robot), strict=True)
    )


def _shared(stood: UnloadedFacts) -> set[str]:
    """Labels of entries that cannot be distinguished from a twin."""
    pairs = [one for one in stood.causes if one.twins]
    return {effect.label for one in pairs for effect in (one.effect, *one.twins)}
