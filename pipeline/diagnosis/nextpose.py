"""Which pull would tell two causes apart: T-optimal among reachable poses, loads and anchors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.cell import sensitivity
from pipeline.diagnosis.identify import Case
from pipeline.diagnosis.view import View, coefficients, eliminate
from pipeline.effects import Pulls
from pipeline.results import Array, Locked
from pipeline.robot import configure
from pipeline.simulate.poses import default_anchors, draw_poses

APART = 4.6
"""Sigmas between two causes from which the right one leads by 20 to 1 in 95 % of the cases."""

CANDIDATES = 240


@dataclass(frozen=True, eq=False)
class Proposal(Locked):
    """One pull that would help.

    Attributes:
        separates: Labels of the two causes.
        q: Joint values [m] or [rad], shape (n,).
        anchor: Where to attach the chain [m], F_b, shape (3,).
        force_n: How strongly to pull [N].
        before: Sigmas between the causes now.
        after: Sigmas expected with the further pulls.
        pulls: How many pulls are proposed for this pair up to here.
    """

    separates: tuple[str, str]
    q: Array
    anchor: Array
    force_n: float
    before: float
    after: float
    pulls: int


@dataclass(frozen=True, eq=False)
class Candidates(Locked):
    """Reachable pulls.

    Attributes:
        pulls: The pulls.
        anchor: Where each is attached [m], shape (m, 3).
    """

    pulls: Pulls
    anchor: Array


def candidates(case: Case, rng: np.random.Generator) -> Candidates:
    """Random reachable poses, each at a small and at the largest force of the campaign.

    Args:
        case: The case.
        rng: Draws the poses.
    """
    robot, tool = case.cell.robot, case.cell.tool
    anchors = default_anchors(robot)
    which = np.arange(CANDIDATES) % len(anchors)
    points = np.vstack([tool.load_point, tool.points])
    q = draw_poses(robot, points, anchors, which, rng)
    size = np.linalg.norm(case.data.pulls.force, axis=1)
    at = configure(robot, q).points(points)[:, 0]
    chain = anchors[which] - at
    unit = chain / np.linalg.norm(chain, axis=1, keepdims=True)
    pose = np.tile(np.arange(len(q)), 2)
    force = np.repeat([size.max(), max(size.min(), 0.25 * size.max())], len(q))
    late = np.nanmax(case.data.pulls.time, initial=0.0)
    pulls = Pulls(
        pose=pose,
        repeat=np.repeat([1, 2], len(q)),
        q=q[pose],
        force=unit[pose] * force[:, None],
        branch=np.repeat([1.0, -1.0], len(q)),
        approach=rng.choice([-1.0, 1.0], len(q))[pose],
        time=np.full(len(pose), late + 600.0),
        time_zero=np.full(len(pose), late + 300.0),
    )
    return Candidates(pulls, anchors[which][pose])


def propose(
    case: Case,
    view: View,
    pair: tuple[int, int],
    rest: Sequence[int],
    among: Candidates,
    most: int = 4,
) -> list[Proposal]:
    """Pulls that tell two suspects apart best, one after the other until they are apart.

    Args:
        case: The case.
        view: The campaign from the model with all accepted causes.
        pair: Indices of the two suspects.
        rest: Accepted causes that are not in question.
        among: Reachable pulls.
        most: So many pulls at most.
    """
    a, b = pair
    M = view.M
    before = apart(view, M, a, b, rest)
    more = _products(case, view, among, sorted({a, b, *rest}))
    out: list[Proposal] = []
    while len(out) < most and (not out or out[-1].after < APART):
        after = apart(view, M + more, a, b, rest)
        best = int(np.argmax(after))
        if after[best] < before * 1.05 + 0.05:
            break
        M = M + more[best]
        out.append(
            Proposal(
                (case.suspects[a].label, case.suspects[b].label),
                among.pulls.q[best],
                among.anchor[best],
                float(np.linalg.norm(among.pulls.force[best])),
                float(before),
                float(after[best]),
                len(out) + 1,
            )
        )
    return out


def apart(view: View, M: Array, a: int, b: int, rest: Sequence[int]) -> Array:
    """Sigmas between two suspects: what each, at its fitted size, leaves when the other is fitted.

    The smaller of both directions, for products M of shape (..., W, W).
    """
    return np.minimum(_left(view, M, a, b, rest), _left(view, M, b, a, rest))


def _left(view: View, M: Array, true: int, other: int, rest: Sequence[int]) -> Array:
    springs = np.arange(view.first)
    base = np.concatenate([springs, view.columns(rest), view.columns([true])])
    mine = view.columns([true])
    size = coefficients(view.M, base)[-len(mine) :]
    taken = np.concatenate([springs, view.columns(rest), view.columns([other])])
    used = np.concatenate([taken, mine])
    small = M[..., used[:, None], used]
    S = eliminate(small, np.arange(len(taken)))[..., len(taken) :, len(taken) :]
    return np.asarray(np.sqrt(np.maximum(np.einsum("i,...ij,j->...", size, S, size), 0.0)))


def _products(case: Case, view: View, among: Candidates, needed: list[int]) -> Array:
    """What each candidate would add to the products, shape (m, W, W)."""
    flat = replace(view.model.cell, equilibrium="undeformed")
    pulls, values = among.pulls, view.model.values
    springs = flat.effects[:1]
    W, m = len(view.M), len(pulls)
    X = np.zeros((m, 3 * len(flat.tool.targets), W))
    B = sensitivity(flat, pulls, values, springs)
    X[:, :, : view.springs] = B.reshape(m, -1, view.springs)
    chosen = [case.suspects[i] for i in needed]
    Z = sensitivity(flat, pulls, values, chosen)
    columns = np.concatenate([view.columns([i]) for i in needed])
    X[:, :, columns] = Z.reshape(m, -1, len(columns))
    at = np.concatenate([np.arange(view.springs), columns])
    scale = np.zeros(W)
    scale[at] = view.typical[at]
    X = X * scale / np.median(view.spread)
    return np.swapaxes(X, 1, 2) @ X
