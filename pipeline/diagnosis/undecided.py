"""What is still open, and the pulls that would decide it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.diagnosis.gain import Gain
from pipeline.diagnosis.identify import Case, Found
from pipeline.diagnosis.isolability import Twins
from pipeline.diagnosis.judgement import CERTAIN
from pipeline.diagnosis.nextpose import Candidates, Proposal, candidates, propose
from pipeline.diagnosis.verdict import Cause
from pipeline.errors import InputError


def next_poses(
    case: Case,
    found: Found,
    causes: Sequence[Cause],
    worth: Gain | None,
    known: Twins,
    rng: np.random.Generator,
) -> tuple[Proposal, ...]:
    """For every undecided pair the pulls that would decide it, as far as any can."""
    pairs = _undecided(found, causes, worth, known)
    if not pairs:
        return ()
    try:
        among: Candidates = candidates(case, rng)
    except InputError:
        return ()
    out: list[Proposal] = []
    for mine, rival in pairs:
        rest = [i for i in found.accepted if i != mine]
        out += propose(found.wide, (mine, rival), rest, among)
    return tuple(out)


def _undecided(
    found: Found, causes: Sequence[Cause], worth: Gain | None, known: Twins, most: int = 3
) -> list[tuple[int, int | None]]:
    """Accepted causes, each with what it must still be told from; None stands for nothing at all.

    Twins are left out: no pull helps, a sensor does (`needs` of the causes).
    """
    pairs: list[tuple[int, int | None]] = []
    for place, mine in enumerate(found.accepted):
        cause = causes[place]
        never = (cause.effect.label, *known.of(cause.effect.label))
        rivals = [r for r in found.rivals[place] if r.label not in never and r.probability > 0.02]
        if cause.probability < CERTAIN:
            pairs += [(mine, r.suspect) for r in rivals]
        if found.strange and found.strange[place].probability > 1 - CERTAIN:
            pairs.append((mine, found.strange[place].suspect))
    if not pairs and worth is not None and worth.ci95[0] <= 0:
        pairs = [
            (mine, None) for mine, c in zip(found.accepted, causes, strict=False) if not c.twins
        ]
    return pairs[:most]
