"""Sizes from which one campaign distinguishes each cause from all others."""

from __future__ import annotations

import numpy as np

from pipeline.design.separability import separation
from pipeline.diagnosis.facts import DETECTED, SEPARATED
from pipeline.diagnosis.isolability import Twins
from pipeline.system.whitened import Whitened


def identifiable(view: Whitened, known: Twins) -> dict[str, float]:
    """Multiple of its typical size from which each cause is detected and separated from others.

    APART / min(min_b d_ab, d_aa APART / DETECTED), with d of `separation`: for its least visible
    form a against every form b of the others, except twins; infinite if no size is sufficient.
    """
    apart = separation(view.M, view.base, view.at)
    labels = [effect.label for effect in view.suspects]
    twins = {frozenset(pair) for pair in known.pairs}
    out: dict[str, float] = {}
    for a, label in enumerate(labels):
        others = [
            b
            for b, other in enumerate(labels)
            if other != label and frozenset((label, other)) not in twins
        ]
        least = min(apart[a, others].min(), apart[a, a] * SEPARATED / DETECTED)
        out[label] = max(out.get(label, 0.0), SEPARATED / least if least > 1e-9 else np.inf)
    return out
