"""Which causes one campaign can tell apart, and from which size on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Ints
from pipeline.system.beside import left_beside
from pipeline.system.elimination import eliminate
from pipeline.system.evidence import WIDTHS
from pipeline.system.whitened import Whitened


def separation(M: Array, base: Ints, at: Ints) -> Array:
    """Sigmas between suspects at typical size, shape (..., n, n).

    Entry (a, b) is what a leaves when base and b are fitted, (a, a) when only the base is, root
    mean square over its k parameters, each at typical size by itself:

        d_ab^2 = trace(S_aa - S_ab S_bb^+ S_ba) / k,    d_aa^2 = trace(S_aa) / k,

    S the products of whitened columns with the base taken out, parameters in typical sizes: the
    root of the noncentrality of the test of a beside b (Baarda, A Testing Procedure for Use in
    Geodetic Networks, 1968).

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
    """Sigmas between accepted causes and others, as large as these readings have them, (a, n).

    What an accepted cause at its fitted size leaves when the other is fitted in its place
    (`left_by`); of one that is possible there the smaller of both ways. One that is not is fitted
    at next to nothing and would leave as much. `separation` has typical sizes. NaN for a cause and
    itself.

    Args:
        view: The campaign whitened at the accepted causes.
        accepted: These causes.
        among: The others, shape (n,).
        possible: For each accepted one what may act in its place: suspect by label, in the form
            that fits best.
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
    """What each of two causes, as fitted, leaves for the other; some more are in the model."""
    S = eliminate(view.M, np.concatenate([np.arange(view.first), view.columns(rest)]))
    a, b = (view.columns([i]) for i in (one, other))
    z, w = sizes(view, (one, other), rest)
    return float(left_by(S, a, z, b)), float(left_by(S, b, w, a))


def sizes(view: Whitened, who: Sequence[int | None], rest: Sequence[int]) -> tuple[Array, ...]:
    """What each who could act in a place would be, fitted without the others, in typical sizes.

    Args:
        view: The campaign.
        who: Suspects; None for none.
        rest: Causes that are in the model whoever it is.
    """
    S = eliminate(view.M, np.concatenate([np.arange(view.first), view.columns(rest)]))
    mine = (view.columns([] if i is None else [i]) for i in who)
    return tuple(_fitted(S, own, S[own, -1]) for own in mine)


def left_by(S: Array, true: Ints, size: Array, other: Ints) -> Array:
    """Sigmas of what `true` leaves when `other` is fitted, sums of squares S beside the rest."""
    whole = np.einsum("i,...ij,j->...", size, S[..., true[:, None], true], size)
    if not len(other):
        return np.asarray(np.sqrt(np.maximum(whole, 0.0)))
    h = S[..., other[:, None], true] @ size
    taken = np.einsum("...i,...i->...", h, _fitted(S, other, h))
    return np.asarray(np.sqrt(np.maximum(whole - taken, 0.0)))


def _fitted(S: Array, own: Ints, h: Array) -> Array:
    """Sizes (G + I / w^2)^-1 h of some columns, held to those that the evidence holds possible."""
    G = S[..., own[:, None], own] + np.eye(len(own)) / WIDTHS.max() ** 2
    return linear.solve(G, h)
