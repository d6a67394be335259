"""The catalogue with prior odds and sizes learnt from other campaigns."""

from __future__ import annotations

from dataclasses import replace
from difflib import get_close_matches

from pipeline.base.errors import InputError, listed
from pipeline.machine.effect import Effect
from pipeline.machine.effects import catalogue
from pipeline.reduction.case import Case
from pipeline.reduction.measured import Measured


def expected(case: Case, data: Measured) -> tuple[Effect, ...]:
    """The catalogue with the prior odds and sizes that campaign.toml takes from other campaigns.

    Raises:
        InputError: It names a cause that this robot and these loads cannot have.
    """
    effects, priors = catalogue(case.robot, data.pulls), case.settings.priors
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
        for one in effects
    )
