"""Which causes one campaign can tell apart, and from which size on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.diagnosis.facts import APART, DETECTED
from pipeline.diagnosis.isolability import Twins
from pipeline.system.elimination import eliminate
from pipeline.system.whitened import Whitened


def separation(view: Whitened, suspects: Sequence[int]) -> Array:
    """Sigmas between suspects at typical size, shape (n, n).

    Entry (a, b) is what a typical a leaves when springs and b are fitted; (a, a) when only the
    springs are:

        d_ab^2 = 1' S_aa 1 - h' S_bb^+ h,    h = S_ba 1,    d_aa^2 = 1' S_aa 1,

    S the products of whitened columns with the base taken out, parameters in typical sizes: the
    root of the noncentrality of the test of a beside b (Baarda, A Testing Procedure for Use in
    Geodetic Networks, 1968).

    Args:
        view: The campaign, whitened.
        suspects: Indices of n suspects.
    """
    S = eliminate(view.M, view.base)
    most = max(len(view.suspects[i].parameters) for i in suspects)
    at = np.full((len(suspects), most), -1)
    for row, i in enumerate(suspects):
        columns = view.columns([i])
        at[row, : len(columns)] = columns
    there = at >= 0
    G = S[at[:, :, None, None], at[None, None, :, :]]
    G = G * there[:, :, None, None] * there[None, None, :, :]
    whole = np.where(there, np.maximum(view.M[at, at], 1e-100), 1.0)
    inverse, _ = linear.left(np.einsum("aiaj->aij", G), whole)
    h = G.sum(axis=1)
    alone = np.einsum("aai->a", h)
    shared = np.einsum("abi,bij,abj->ab", h, inverse, h)
    left = alone[:, None] - shared
    np.fill_diagonal(left, alone)
    return np.asarray(np.sqrt(np.maximum(left, 0.0)))


def identifiable(view: Whitened, known: Twins) -> dict[str, float]:
    """Multiple of its typical size from which each cause is detected and separated from all others.

    APART / min(min_b d_ab, d_aa APART / DETECTED), d of `separation`: for its least visible form a
    against every form b of the others, twins left out; infinite where no size would do.
    """
    apart = separation(view, range(len(view.suspects)))
    labels = [effect.label for effect in view.suspects]
    twins = {frozenset(pair) for pair in known.pairs}
    out: dict[str, float] = {}
    for a, label in enumerate(labels):
        others = [
            b
            for b, other in enumerate(labels)
            if other != label and frozenset((label, other)) not in twins
        ]
        least = min(apart[a, others].min(), apart[a, a] * APART / DETECTED)
        out[label] = max(out.get(label, 0.0), APART / least if least > 1e-9 else np.inf)
    return out
