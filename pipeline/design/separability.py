"""Which causes a campaign can separate, and from which magnitude on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.diagnosis.cause_search import SearchResult, SearchTask, by_label
from pipeline.diagnosis.diagnose import LEAST_OF_RIVALS
from pipeline.system.elimination import eliminate
from pipeline.system.evidence import WIDTHS
from pipeline.system.score_tests import left_beside
from pipeline.system.whitened import Whitened


def told_apart(task: SearchTask, found: SearchResult, helps: bool) -> dict[str, Any]:
    """How far causes are from each other, by the first form of each: parts of `Diagnosed`."""
    every = by_label(task.suspects)
    main = [forms[0] for forms in every.values()]
    return {
        "apart": separation(found.first.M, found.first.base, found.first.at[main]),
        "apart_labels": tuple(every),
        "apart_found": _apart_found(task, found, main, helps),
    }


def _apart_found(task: SearchTask, found: SearchResult, main: Sequence[int], helps: bool) -> Array:
    """`Diagnosed.apart_found`, by the first form of each cause."""
    labels = [task.suspects[i].label for i in main]
    out = np.full((len(main), len(main)), np.nan)
    accepted = found.accepted if helps else ()
    possible = [
        {one.label: one.suspect for one in reversed(rivals) if one.probability > LEAST_OF_RIVALS}
        for rivals in found.rivals[: len(accepted)]
    ]
    apart = separation_found(found.wide, accepted, main, possible)
    for one, row in zip(accepted, apart, strict=True):
        if task.suspects[one].label in labels:
            place = labels.index(task.suspects[one].label)
            out[place], out[:, place] = row, row
    return out


def separation(M: Array, base: Ints, at: Ints) -> Array:
    """Separation of suspects of typical magnitude [standard deviations], shape (..., n, n).

    Entry (a, b) is the residual of a after fitting base and b, (a, a) after fitting the base only,
    root mean square over its k parameters, each at its typical magnitude:

        d_ab^2 = trace(S_aa - S_ab S_bb^+ S_ba) / k,    d_aa^2 = trace(S_aa) / k,

    with S the products of whitened columns after elimination of the base, parameters in typical
    magnitudes: the root of the noncentrality of the test of a given b (Baarda, A Testing Procedure
    for Use in Geodetic Networks, 1968).

    Args:
        M: Products of whitened columns, of one campaign or of many plans, shape (..., W, W).
        base: Columns that are estimated in any case.
        at: Columns of each of n suspects, -1 where it has fewer, shape (n, k).
    """
    S, N, whole = left_beside(M, base, at)
    H = S[..., at, :] * (at >= 0)[..., None]
    taken = np.einsum("...biw,...biw->...bw", H, linear.left(N, whole)[0] @ H)
    mean = np.zeros((M.shape[-1], len(at)))
    np.add.at(mean, (at, np.arange(len(at))[:, None]), at >= 0)
    mean = mean / mean.sum(axis=0)
    alone = np.einsum("...ww->...w", S)
    left = np.swapaxes((alone[..., None, :] - taken) @ mean, -1, -2)
    each = np.arange(len(at))
    left[..., each, each] = alone @ mean
    return np.asarray(np.sqrt(np.maximum(left, 0.0)))


def separation_found(
    view: Whitened,
    accepted: Sequence[int],
    among: Sequence[int],
    possible: Sequence[Mapping[str, int]],
) -> Array:
    """Separation of accepted causes of fitted magnitude from others [standard deviations], (a, n).

    Residual of an accepted cause, at its fitted magnitude, after fitting the other in its place
    (`left_by`); for an other that is possible there, the smaller of both directions. An impossible
    one would be fitted with a negligible magnitude, so that the reverse direction means nothing.
    NaN for a cause and itself. `separation` uses typical magnitudes.

    Args:
        view: The campaign whitened at the accepted causes.
        accepted: These causes.
        among: The others, shape (n,).
        possible: For each accepted cause, what may be present in its place: suspect by label, in
            the form that fits best.
    """
    out = np.full((len(accepted), len(among)), np.nan)
    for place, one in enumerate(accepted):
        for k, other in enumerate(among):
            label = view.suspects[other].label
            if label != view.suspects[one].label:
                rival = possible[place].get(label)
                rest = [i for i in accepted if i not in (one, other)]
                left = _left_either_way(view, one, other if rival is None else rival, rest)
                out[place, k] = left[0] if rival is None else min(left)
    return out


def _left_either_way(
    view: Whitened, one: int, other: int, rest: Sequence[int]
) -> tuple[float, float]:
    """Residual of each of two fitted causes after fitting the other; `rest` is in the model."""
    S = eliminate(view.M, np.concatenate([np.arange(view.first), view.columns(rest)]))
    a, b = (view.columns([i]) for i in (one, other))
    z, w = sizes(view, (one, other), rest)
    return float(left_by(S, a, z, b)), float(left_by(S, b, w, a))


def sizes(view: Whitened, who: Sequence[int | None], rest: Sequence[int]) -> tuple[Array, ...]:
    """Each suspect's magnitude if fitted in a place without the others, in typical magnitudes.

    Args:
        view: The campaign.
        who: Suspects; None for none.
        rest: Causes that are in the model in any case.
    """
    S = eliminate(view.M, np.concatenate([np.arange(view.first), view.columns(rest)]))
    mine = (view.columns([] if i is None else [i]) for i in who)
    return tuple(_fitted(S, own, S[own, -1]) for own in mine)


def left_by(S: Array, true: Ints, size: Array, other: Ints) -> Array:
    """Residual of `true` after fitting `other` [standard deviations], from products S."""
    whole = np.einsum("i,...ij,j->...", size, S[..., true[:, None], true], size)
    if not len(other):
        return np.asarray(np.sqrt(np.maximum(whole, 0.0)))
    h = S[..., other[:, None], true] @ size
    taken = np.einsum("...i,...i->...", h, _fitted(S, other, h))
    return np.asarray(np.sqrt(np.maximum(whole - taken, 0.0)))


def _fitted(S: Array, own: Ints, h: Array) -> Array:
    """Ridge estimate (G + I / w^2)^-1 h of some columns, w the widest prior of the evidence."""
    G = S[..., own[:, None], own] + np.eye(len(own)) / WIDTHS.max() ** 2
    return linear.solve(G, h)
