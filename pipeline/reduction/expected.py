"""The catalogue as a campaign has it: learnt odds and sizes, and advice not yet followed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from difflib import get_close_matches

import numpy as np

from pipeline.base.errors import InputError, listed
from pipeline.machine.effect import Effect
from pipeline.machine.effects import catalogue, joint_hardening, scale, table, tracker_drift
from pipeline.reduction.case import Case
from pipeline.reduction.measured import Measured
from pipeline.reduction.register import timed


def expected(case: Case, data: Measured) -> tuple[Effect, ...]:
    """The catalogue with the prior odds and sizes that campaign.toml takes from other campaigns.

    Raises:
        InputError: It names a cause that this robot and these loads cannot have.
    """
    effects, priors = _possible(case, data), case.settings.priors
    known = sorted({effect.name for effect in effects})
    if strange := sorted(set(priors) - set(known)):
        raise InputError(
            f"[priors] has {listed(strange)}, which no cause here is called",
            f"did you mean {near[0]}?"
            if (near := get_close_matches(strange[0], known, 1))
            else f"remove it, or use one of {listed(known, len(known))}",
            file="campaign.toml",
            key=["priors", strange[0]],
        )
    return tuple(
        replace(one, odds=priors[one.name].odds, size=priors[one.name].size)
        if one.name in priors
        else one
        for one in _asking_more(effects, case, data)
    )


def _possible(case: Case, data: Measured) -> tuple[Effect, ...]:
    """The catalogue; a chain that goes from the load point to an anchor has no reflectors."""
    ends = case.readings[case.readings["target"].isin(case.settings.naming.chain)]
    none = len(ends) > 0 and ends["file"].isin(case.loads["file"]).all()
    every = catalogue(case.robot, data.pulls)
    return tuple(one for one in every if not none or one.name != "chain_offset")


def _asking_more(effects: Iterable[Effect], case: Case, data: Measured) -> Iterator[Effect]:
    """The catalogue without the advice that the campaign has followed already."""
    readings = case.readings
    base = readings[readings["target"].isin(case.settings.base_frame)]
    rounds = base["group"].nunique() > 1 and timed(base)
    unloaded = bool(case.settings.tool) and bool(np.isfinite(data.unloaded).all(axis=1).any())
    levels = bool(np.unique(data.pulls.pose, return_counts=True)[1].max(initial=0) >= _LEVELS)
    done = ((tracker_drift, rounds), (table, unloaded), (scale, levels), (joint_hardening, levels))
    more = {one.NEEDS: one.FURTHER for one, followed in done if followed}
    for effect in effects:
        yield replace(effect, needs=more[effect.needs]) if effect.needs in more else effect


_LEVELS = 3
"""Pulls of a pose that show a curve or an offset of the force [1]."""
