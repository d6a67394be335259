"""Before anything is identified: evidence of every suspect, misfit of every place."""

from __future__ import annotations

import numpy as np
from scipy import special

from pipeline.base import linear
from pipeline.diagnosis.blindspots import smallest_visible
from pipeline.diagnosis.facts import Clue, Misfit
from pipeline.diagnosis.identify import Found, by_label
from pipeline.system.elimination import eliminate
from pipeline.system.evidence import ROUNDING
from pipeline.system.whitened import Whitened


def clues(found: Found) -> tuple[Clue, ...]:
    """Each suspect added to the joint springs alone, in its likeliest form."""
    view, now = found.first, found.scores
    S = eliminate(view.M, view.base)
    seen = smallest_visible(view, view.base, found.threshold.p)
    out = []
    for forms in by_label(view.suspects).values():
        i = max(forms, key=lambda i: now.log_evidence[i])
        columns = view.columns([i])
        whole = float(np.trace(view.M[np.ix_(columns, columns)]))
        left = float(np.trace(S[np.ix_(columns, columns)]))
        absorbed = 1.0 - left / whole if whole > 0 else 1.0
        out.append(
            Clue(
                view.suspects[i],
                float(now.p[i]),
                float(now.log_evidence[i]),
                min(max(absorbed, 0.0), 1.0),
                float(np.min([seen[j] for j in forms])),
            )
        )
    return tuple(out)


def misfits(view: Whitened) -> tuple[Misfit, ...]:
    """Which place of the cell takes most of the misfit when all its suspects join at once."""
    S = eliminate(view.M, view.base)
    dof = view.rows_left
    rest = max(float(S[-1, -1]), ROUNDING * dof)
    places: dict[str, list[int]] = {}
    for i, effect in enumerate(view.suspects):
        places.setdefault(effect.location, []).append(i)
    out = []
    for place, members in places.items():
        columns = view.columns(members)
        left, rank = linear.left(S[np.ix_(columns, columns)], view.M[columns, columns])
        k = int(rank)
        if not k or dof - k < 5:
            continue
        T = min(max(float(S[columns, -1] @ left @ S[columns, -1]), 0.0), rest)
        variance = max((rest - T) / (dof - k), ROUNDING)
        p = float(special.fdtrc(k, dof - k, (T / k) / variance))
        out.append(Misfit(place, T / rest, p))
    return tuple(sorted(out, key=lambda m: m.p_value))
