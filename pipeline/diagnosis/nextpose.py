"""Which pull would tell two causes apart: T-optimal among reachable poses, loads and anchors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.cell import sensitivity
from pipeline.diagnosis.elimination import coefficients, eliminate
from pipeline.diagnosis.identify import Case
from pipeline.diagnosis.view import View
from pipeline.effects import Effect, Pulls
from pipeline.results import Array, Ints, Locked
from pipeline.robot import configure
from pipeline.simulate.poses import default_anchors, draw_poses

APART = 4.6
"""Sigmas between two causes from which the right one leads by 20 to 1 in 95 % of the cases."""

CANDIDATES = 240

SPRINGS = "joint_springs"
"""What a cause is told from when nothing else could stand in its place."""


@dataclass(frozen=True, eq=False)
class Proposal(Locked):
    """One pull that would help.

    Attributes:
        separates: Labels of the two causes, or of a cause and `SPRINGS`.
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
    view: View,
    pair: tuple[int, int | None],
    rest: Sequence[int],
    among: Candidates,
    most: int = 4,
) -> list[Proposal]:
    """Pulls that tell two suspects apart best, one after the other until they are apart.

    Args:
        view: The campaign from the model with all accepted causes.
        pair: Indices of the two suspects; None for the joint springs alone.
        rest: Accepted causes that are not in question.
        among: Reachable pulls.
        most: So many pulls at most.
    """
    duel = _duel(view, pair, rest)
    labels = [SPRINGS if i is None else view.suspects[i].label for i in pair]
    M = duel.M
    before = float(duel.apart(M))
    more = duel.products(view, among)
    out: list[Proposal] = []
    while len(out) < most and (not out or out[-1].after < APART):
        after = duel.apart(M + more)
        best = int(np.argmax(after))
        if after[best] < before * 1.05 + 0.05:
            break
        M = M + more[best]
        out.append(
            Proposal(
                (labels[0], labels[1]),
                among.pulls.q[best],
                among.anchor[best],
                float(np.linalg.norm(among.pulls.force[best])),
                before,
                float(after[best]),
                len(out) + 1,
            )
        )
    return out


@dataclass(frozen=True, eq=False)
class _Duel(Locked):
    """Two suspects beside springs and causes that are not in question: only their columns.

    Attributes:
        effects: Those that are not in question, then the two.
        columns: Columns of the view: springs, common errors, then those of `effects`.
        M: Products of these columns.
        taken: Columns of M that are estimated whoever it was.
        mine: Columns of M of either suspect.
        size: What each would be, fitted alone.
    """

    effects: tuple[Effect, ...]
    columns: Ints
    M: Array
    taken: Ints
    mine: tuple[Ints, Ints]
    size: tuple[Array, Array]

    def apart(self, M: Array) -> Array:
        """Sigmas between them: what each, at its fitted size, leaves when the other is fitted.

        The smaller of both directions, for products M of shape (..., W, W).
        """
        ahead = self._left(M, self.mine[0], self.size[0], self.mine[1])
        if not len(self.mine[1]):
            return ahead
        return np.minimum(ahead, self._left(M, self.mine[1], self.size[1], self.mine[0]))

    def _left(self, M: Array, true: Ints, size: Array, other: Ints) -> Array:
        S = eliminate(M, np.concatenate([self.taken, other]))[..., true[:, None], true]
        return np.asarray(np.sqrt(np.maximum(np.einsum("i,...ij,j->...", size, S, size), 0.0)))

    def products(self, view: View, among: Candidates) -> Array:
        """What each candidate would add to M, shape (m, W, W)."""
        flat = replace(view.model.cell, equilibrium="undeformed")
        pulls, values = among.pulls, view.model.values
        m, springs = len(pulls), flat.effects[:1]
        X = np.zeros((m, 3 * len(flat.tool.targets), len(self.columns)))
        B = sensitivity(flat, pulls, values, springs).reshape(*X.shape[:2], -1)
        Z = sensitivity(flat, pulls, values, self.effects).reshape(*X.shape[:2], -1)
        X[:, :, : view.springs] = B
        X[:, :, view.first :] = Z
        X = X * view.typical[self.columns] / np.median(view.spread)
        return np.swapaxes(X, 1, 2) @ X


def _duel(view: View, pair: tuple[int, int | None], rest: Sequence[int]) -> _Duel:
    two = [i for i in pair if i is not None]
    mine = [view.columns([] if i is None else [i]) for i in pair]
    parts = [np.arange(view.first), *(view.columns([i]) for i in rest), *mine]
    ends = np.cumsum([len(part) for part in parts])
    at = [np.arange(end - len(part), end) for end, part in zip(ends, parts, strict=True)]
    taken = np.concatenate(at[:-2])
    sizes = []
    for columns in mine:
        base = np.concatenate([*parts[:-2], columns])
        sizes.append(coefficients(view.M, base)[len(base) - len(columns) :])
    columns = np.concatenate(parts)
    return _Duel(
        effects=tuple(view.suspects[i] for i in (*rest, *two)),
        columns=columns,
        M=view.M[np.ix_(columns, columns)],
        taken=taken,
        mine=(at[-2], at[-1]),
        size=(sizes[0], sizes[1]),
    )
