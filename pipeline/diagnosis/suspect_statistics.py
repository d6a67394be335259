"""Statistics with the joint springs alone: evidence of every suspect, misfit of every place."""

from __future__ import annotations

import numpy as np

from pipeline.base.arrays import compared
from pipeline.diagnosis.blindspots import smallest_visible
from pipeline.diagnosis.cause_search import SearchResult, by_label
from pipeline.diagnosis.facts import Misfit, SuspectStatistics
from pipeline.system.evidence import ROUNDING
from pipeline.system.score_tests import padded
from pipeline.system.whitened import Whitened


def suspect_statistics(found: SearchResult) -> tuple[SuspectStatistics, ...]:
    """Statistics of each suspect added to the joint springs alone, in its likeliest form."""
    view, now, p = found.first, found.scores, found.scores.p()
    seen = smallest_visible(view, view.base, found.threshold.p)
    whole, left = now.whole.sum(axis=1), np.einsum("nii->n", now.N)
    absorbed = np.clip(1.0 - left / np.where(whole > 0, whole, np.inf), 0.0, 1.0)
    out = []
    for forms in by_label(view.suspects).values():
        i = forms[int(np.argmax(compared(now.log_evidence[forms])))]
        size = float(np.min(seen[forms]))
        told = (float(p[i]), float(now.log_evidence[i]), float(absorbed[i]), size)
        out.append(SuspectStatistics(view.suspects[i], *told))
    return tuple(out)


def misfits(view: Whitened) -> tuple[Misfit, ...]:
    """Share of each place of the cell in the misfit, all its suspects at once, smallest p first."""
    places: dict[str, list[int]] = {}
    for i, effect in enumerate(view.suspects):
        places.setdefault(effect.location, []).append(i)
    among = padded([view.columns(members) for members in places.values()])
    now = view.beside(view.base, among=among)
    p = now.p(now.variance(ROUNDING))
    known = (now.rank > 0) & (now.dof - now.rank >= 5)
    out = [
        Misfit(place, float(min(now.drop[i] / now.rest, 1.0)), float(p[i]))
        for i, place in enumerate(places)
        if known[i]
    ]
    return tuple(sorted(out, key=lambda m: compared(m.p_value)))
