"""All mutations, and the case of a number: a campaign and its mutations."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from bench.fuzz import in_bytes, in_practice, in_robot, in_settings, in_tables
from bench.fuzz.bases import NAMES, base
from bench.fuzz.mutation import Files, Mutation, one

SEED = 2026

MUTATIONS: tuple[Mutation, ...] = (
    *in_bytes.MUTATIONS,
    *in_tables.MUTATIONS,
    *in_settings.MUTATIONS,
    *in_robot.MUTATIONS,
    *in_practice.MUTATIONS,
)

FAMILIES: dict[str, list[Mutation]] = defaultdict(list)
for _mutation in MUTATIONS:
    FAMILIES[_mutation.family].append(_mutation)

_OFTEN = ("cell", "joints", "loads", "readings", "points")
"""Families drawn twice as often, as these errors are common in practice."""

_COUNTS = (1, 1, 1, 1, 2, 2, 3)


@dataclass(frozen=True, eq=False)
class Case:
    """A spoilt campaign.

    Attributes:
        number: Determines everything else.
        base: Name of the clean campaign.
        mutations: Mutations applied, in this order.
        files: The resulting files.
        shown: Whether its report is made, too.
    """

    number: int
    base: str
    mutations: tuple[Mutation, ...]
    files: Files
    shown: bool = False

    @property
    def meant(self) -> bool:
        """Whether a different answer is right."""
        return any(mutation.meant for mutation in self.mutations)

    @property
    def covered(self) -> set[str]:
        """Blind spots that include its effect."""
        return {name for mutation in self.mutations for name in mutation.covered}


def case(number: int) -> Case:
    """The case of a number."""
    rng = np.random.default_rng([SEED, number])
    name, count, shown = one(rng, NAMES), one(rng, _COUNTS), bool(rng.random() < 0.1)
    families = [*FAMILIES, *(each for each in _OFTEN if each in FAMILIES)]
    files, done = base(name), []
    for _ in range(40):  # many mutations do not apply to some campaigns
        mutation = one(rng, FAMILIES[one(rng, families)])
        spoilt = mutation.act(files, rng)
        if dict(spoilt) != dict(files):
            files = spoilt
            done.append(mutation)
        if len(done) == count:
            break
    return Case(number, name, tuple(done), files, shown)
