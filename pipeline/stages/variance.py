"""Stage 6b. How large the noise is, from the data: variance components by restricted likelihood.

V = sum over components of scale^2 G_s G_s' + the rest as stated. What is looked at are contrasts
that no model of the robot can make: changes of the effector's own triangle, zeros read again, and
pulls that were repeated. A wrong model of the robot therefore does not pass for noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import scipy.sparse
from scipy import special, stats

from pipeline import covariance
from pipeline.cell import Cell
from pipeline.results import Array, Bools, Errors, Estimate, Ints, Locked, Rows, Strings, System
from pipeline.robot import configure
from pipeline.settings import Settings
from pipeline.stages.assemble import TRACKED, Measured
from pipeline.stages.register import XYZ
from pipeline.stages.whiten import whitener

Loss = Callable[[Array], tuple[Array, float]]
"""Minus twice a restricted log likelihood by log scales: part of each pose, and the rest."""

SCALED: Mapping[str, tuple[str, ...]] = {
    "tracker": TRACKED,
    "force_reading": ("force_reading",),
}
"""The components, and the sources of error whose standard uncertainty each of them multiplies."""

NAMES = {"tracker": "tracker_noise", "force_reading": "force_noise"}
"""What the contract calls a component that is larger than stated."""

SAME_FORCE = 0.03
"""Repeats pull as strongly as the first of them to this part of it; a turnbuckle is set so."""

SAME_DIRECTION = 0.005
"""And within this angle [rad]: a chain hung into the same place again."""

SURELY = 0.003
"""A scale this improbable under the stated noise is another noise."""

UNTOLD = 0.5
"""A relative standard uncertainty of a scale above this: the data cannot tell it."""

ZEROS = -1
"""Stands for the pull of a contrast between zeros."""

FEWEST = 12
"""Contrasts below this say too little about a component."""


@dataclass(frozen=True, eq=False)
class Components(Locked):
    """Noise found, as factors on the stated standard uncertainties.

    Attributes:
        name: `tracker`, `force_reading`, shape (n,).
        scale: Factor on the stated standard uncertainty; 1 where the data cannot tell, shape (n,).
        std: Relative standard uncertainty of `scale`; infinite where the data cannot tell, (n,).
        p_value: Probability of a scale this large or larger if the stated noise were true, (n,).
        dof: Contrasts that were looked at.
        stated: False when the campaign states no noise of the tracker; its scale then is in m.
        chi2: Weighted sum of squares of the contrasts of pulls, which are a part of the misfit of
            every model, in the noise as it is used.
        chi2_dof: Their number.
    """

    name: Strings
    scale: Array
    std: Array
    p_value: Array
    dof: int
    stated: bool
    chi2: float = 0.0
    chi2_dof: int = 0

    @property
    def larger(self) -> Bools:
        """Components that are larger than stated beyond chance, shape (n,)."""
        return self.p_value < SURELY

    @property
    def replaced(self) -> Bools:
        """Components whose noise found takes the place of the stated or missing one, shape (n,)."""
        missing = (self.name == "tracker") & (not self.stated)
        return np.asarray(self.larger | (missing & np.isfinite(self.std)), dtype=bool)

    @property
    def used(self) -> bool:
        """Whether any is."""
        return bool(self.replaced.any())

    def of(self, name: str) -> float:
        """Scale of one component."""
        return float(self.scale[list(self.name).index(name)])


@dataclass(frozen=True, eq=False)
class Zeros(Locked):
    """Differences between unloaded readings of one target in one pose.

    Attributes:
        pose: Shape (n,).
        target: Index into the tool's targets, shape (n,).
        which: Number of the difference within its pose and target, shape (n,).
        delta: [m], F_b, shape (n, 3).
        cov: [m^2], shape (n, 3, 3).
    """

    pose: Ints
    target: Ints
    which: Ints
    delta: Array
    cov: Array


def repeated_zeros(settings: Settings, placed: pd.DataFrame) -> Zeros:
    """Every further unloaded reading minus the mean of those before it.

    These differences are independent of each other and of the mean, the zero of the pose.

    Args:
        settings: Names of the measured targets.
        placed: Table PLACED, F_b.
    """
    names = pd.Index(settings.measured)
    rows = placed[(placed["state"] == "unloaded") & placed["target"].isin(names)]
    rows = rows.sort_values("time", kind="stable")
    groups = rows.groupby(["pose", "target"])
    nth = groups.cumcount().to_numpy()
    points, C = rows[XYZ], covariance.matrices(rows)
    past = (groups[XYZ].cumsum() - points).to_numpy() / np.maximum(nth, 1)[:, None]
    six = rows[covariance.columns()]
    C_past = (groups[covariance.columns()].cumsum() - six).assign(
        **{n: lambda t, n=n: t[n] / np.maximum(nth, 1) ** 2 for n in covariance.columns()}
    )
    again = nth > 0
    return Zeros(
        pose=rows["pose"].to_numpy(np.int64)[again],
        target=np.asarray(names.get_indexer(pd.Index(rows["target"])), dtype=np.int64)[again],
        which=np.asarray(nth, dtype=np.int64)[again],
        delta=(points.to_numpy() - past)[again],
        cov=(C + covariance.matrices(C_past))[again],
    )


def pure_error(system: System, residual: Array, data: Measured, zeros: Zeros, cell: Cell) -> System:
    """Contrasts of the campaign that no model of the robot can make, as a system without x.

    Left out of each group of equal pulls is one free rigid motion of the effector, out of each
    repeated zero another; with fewer than three targets, zeros are taken to stand still instead.
    Pulls of a group are brought to the force of the first, so that what the model misses in
    proportion to the force cancels too.

    Args:
        system: The system, for its errors.
        residual: c - B x; the model only carries small differences of direction in a group [m].
        data: The measurements that the system was made from.
        zeros: Repeated zeros; none of them matters when empty.
        cell: For the positions of the targets.
    """
    stack = stacked(system, residual, data, zeros, cell)
    errors = stack.errors
    K = _contrasts(stack.group, stack.modes)
    contrasts = K.shape[1]
    at = np.asarray(np.abs(K).argmax(axis=0)).ravel()
    rows = Rows(
        pose=stack.pose[at],
        repeat=np.zeros(contrasts, np.int64),
        target=np.full(contrasts, "", dtype=object),
        axis=np.zeros(contrasts, np.int64),
        pull=np.where(at < 3 * len(data.pull), 0, ZEROS),
    )
    G = scipy.sparse.csr_array(K.T @ scipy.sparse.diags_array(stack.to_first) @ errors.G)
    return System(
        parameters=(),
        rows=rows,
        B=np.zeros((contrasts, 0)),
        c=K.T @ (stack.to_first * stack.c),
        errors=Errors(G, errors.source, errors.common),
        noise_stated=system.noise_stated,
        found_m=system.found_m,
    )


@dataclass(frozen=True, eq=False)
class Stack(Locked):
    """All that one campaign's readings tell of displacements: rows of c, then repeated zeros.

    Attributes:
        c: Values [m], shape (R,).
        errors: Their errors.
        pose: Pose number of each row, shape (R,).
        target: Index of its target, shape (R,).
        axis: 0, 1, 2 for x, y, z of F_b, shape (R,).
        pull: Index of its pull, -1 for repeated zeros, shape (R,).
        which: Number of the difference of zeros, 0 for rows of c, shape (R,).
        group: Equal pulls share a number, and so do the targets of one repeated zero, shape (R,).
        modes: What six small rigid motions of the effector do to it, shape (R, 6).
        to_first: Force of the first pull of its group over its own, shape (R,).
    """

    c: Array
    errors: Errors
    pose: Ints
    target: Ints
    axis: Ints
    pull: Ints
    which: Ints
    group: Ints
    modes: Array
    to_first: Array


def stacked(system: System, c: Array, data: Measured, zeros: Zeros, cell: Cell) -> Stack:
    """Rows of c (or of residuals, shape (M,)), and below them the repeated zeros."""
    first = np.unique(data.pulls.pose, return_index=True)[1]
    q = dict(zip(data.pulls.pose[first].tolist(), data.pulls.q[first], strict=True))
    known = np.isin(zeros.pose, list(q))
    zero_pose, zero_target = zeros.pose[known], zeros.target[known]
    pose = np.concatenate([data.pulls.pose[data.pull], zero_pose])
    values, which = np.unique(pose, return_inverse=True)
    axes = configure(cell.robot, np.array([q[p] for p in values.tolist()])).flange_axes[which]
    target = np.concatenate([data.target, zero_target])
    tool = cell.tool.points - cell.tool.points.mean(axis=0)
    levers = np.einsum("rij,rj->ri", axes, tool[target])
    modes = np.zeros((len(pose), 3, 6))
    modes[:, :, :3] = np.eye(3)
    modes[:, :, 3:] = np.swapaxes(np.cross(np.eye(3)[None], levers[:, None, :]), 1, 2)
    repeats, to_first = _repeats(data)
    brought = np.repeat(np.append(to_first[data.pull], np.ones(len(zero_pose))), 3)
    group = np.concatenate([repeats[data.pull], zero_pose * 1000 + zeros.which[known]])
    group[len(data.pull) :] += group[: len(data.pull)].max() + 1
    if len(set(data.target.tolist())) < 3:
        modes[len(data.pull) :] = 0.0
    C = zeros.cov[known]
    if not data.noise_stated:
        nth = zeros.which[known][:, None, None]
        C = (system.found_m or 1.0) ** 2 * np.eye(3) * (1 + 1 / nth)
    factors = covariance.factors(C)
    own = scipy.sparse.block_diag(list(factors), format="csr") if len(factors) else None
    G, source, common = system.errors.G, system.errors.source, system.errors.common
    if own is not None:
        G = scipy.sparse.csr_array(scipy.sparse.block_diag([G, own], format="csr"))
        source = np.concatenate([source, np.full(own.shape[1], "zero", dtype=object)])
        common = np.concatenate([common, np.zeros(own.shape[1], dtype=bool)])
    d = len(data.pull)
    return Stack(
        c=np.concatenate([c, zeros.delta[known].ravel()]),
        errors=Errors(G, source, common),
        pose=np.repeat(pose, 3),
        target=np.repeat(target, 3),
        axis=np.tile(np.arange(3), len(pose)),
        pull=np.repeat(np.append(data.pull, np.full(len(zero_pose), -1)), 3),
        which=np.repeat(np.append(np.zeros(d, np.int64), zeros.which[known]), 3),
        group=np.repeat(group, 3),
        modes=modes.reshape(-1, 6),
        to_first=brought,
    )


def _repeats(data: Measured) -> tuple[Ints, Array]:
    """Which pulls repeat each other, and by what each is to be multiplied to be the first of them.

    Repeats have the same pose, force and branch. Where the branch is not known, the pull before
    and the last pull unlike theirs have to be alike too: friction answers to where one comes from,
    and the chain may have been released between two pulls.

    Returns:
        Number of each pull's group, and force of the group's first over its own, both (m,).
    """
    pulls = data.pulls
    order = np.lexsort((pulls.repeat, pulls.time, pulls.pose))
    pose, force, branch = pulls.pose[order], pulls.force[order], pulls.branch[order]
    like = _like(pose, force)
    before = np.where(branch[:, None] == 0, _before(pose, like), -1)
    key = np.column_stack([like, branch.astype(np.int64), before])
    _, first, number = np.unique(key, axis=0, return_index=True, return_inverse=True)
    size = np.linalg.norm(force, axis=1)
    group, to_first = np.empty(len(order), dtype=np.int64), np.empty(len(order))
    group[order], to_first[order] = number.ravel(), size[first][number.ravel()] / size
    return group, to_first


def _like(pose: Ints, force: Array) -> Ints:
    """Place of the first pull of the same pose with a force like it, shape (m,)."""
    like = np.full(len(pose), -1, dtype=np.int64)
    while (free := np.flatnonzero(like < 0)).size:
        _, first, which = np.unique(pose[free], return_index=True, return_inverse=True)
        leader = free[first][which]
        size = np.linalg.norm(force[leader], axis=1)
        along = np.einsum("mi,mi->m", force[free], force[leader]) / size
        across = np.sqrt(np.maximum(np.sum(force[free] ** 2, axis=1) - along**2, 0.0))
        near = np.abs(along / size - 1) <= SAME_FORCE
        near = (near & (across <= SAME_DIRECTION * size)) | (free == leader)
        like[free[near]] = leader[near]
    return like


def _before(pose: Ints, like: Ints) -> Ints:
    """`like` of the pull before and of the last unlike one, -1 where there is none, (m, 2)."""
    place = np.arange(len(pose))
    new = np.ones(len(pose), dtype=bool)
    new[1:] = (pose[1:] != pose[:-1]) | (like[1:] != like[:-1])
    last = np.column_stack([place, np.flatnonzero(new)[np.cumsum(new) - 1]]) - 1
    there = (last >= 0) & (pose[last] == pose[:, None])
    return np.where(there, like[last], -1)


def _contrasts(group: Ints, modes: Array) -> scipy.sparse.csc_array:
    """Orthonormal columns that the modes of no group can reach, shape (rows, contrasts)."""
    order = np.argsort(group, kind="stable")
    ends = np.flatnonzero(np.diff(group[order])) + 1
    blocks, at = [], []
    for rows in np.split(order, ends):
        U, s, _ = np.linalg.svd(modes[rows], full_matrices=True)
        rank = int((s > 1e-9 * max(s[0], 1e-300)).sum()) if s[0] > 0 else 0
        blocks.append(U[:, rank:])
        at.append(rows)
    K = scipy.sparse.block_diag(blocks, format="csr")
    back = np.empty(len(group), dtype=np.int64)
    back[np.concatenate(at)] = np.arange(len(group))
    return scipy.sparse.csc_array(K[back])


def variance_components(
    system: System,
    design: Array | None = None,
    names: Sequence[str] = ("tracker", "force_reading"),
) -> Components:
    """Scales of the noise components by restricted maximum likelihood.

    Fixed effects are the columns of `design` and the errors common to all poses; what is left is
    normal with V = sum s^2 G_s G_s' + stated rest. For an answer that no wrong model of the robot
    can spoil, give the system of `pure_error`; for residuals of a model, the campaign's own.
    Its standard uncertainties are the larger of the information's and of the scatter from pose
    to pose, so that tails longer than normal do not make it too sure.

    Args:
        system: c, and its errors by source.
        design: Fixed effects, shape (M, k); B of the system when not given.
        names: Components to find, keys of `SCALED`.
    """
    X = system.B if design is None else design
    log_scale, std = np.zeros(len(names)), np.full(len(names), np.inf)
    p = np.ones(len(names))
    if len(system.rows) - X.shape[1] < FEWEST:
        return _components(system, names, log_scale, std, p, len(system.rows))
    common = system.errors.G[:, system.errors.common].toarray()
    felt = np.linalg.norm(common, axis=0) > 0.01 * np.sqrt(np.mean(system.c**2))
    X = np.hstack([X, common[:, felt]])
    blocks = _Blocks.of(system, X, [SCALED[name] for name in names])
    told = np.array([_told(system, SCALED[name]) for name in names])
    if told.any():
        log_scale[told], std[told], p[told] = _maximum(blocks, told)
    return _components(system, names, log_scale, std, p, blocks.dof)


def _components(
    system: System, names: Sequence[str], log_scale: Array, std: Array, p: Array, dof: int
) -> Components:
    lost = ~(std < UNTOLD)
    log_scale, std = np.where(lost, 0.0, log_scale), np.where(lost, np.inf, std)
    name = np.array(names, object)
    missing = (name == "tracker") & (not system.noise_stated)
    scale = np.exp(log_scale) * np.where(missing, system.found_m or 1.0, 1.0)
    return Components(name, scale, std, np.where(lost | missing, 1.0, p), dof, system.noise_stated)


def _told(system: System, sources: Sequence[str]) -> bool:
    mine = np.isin(system.errors.source.astype(str), sources)
    return bool(mine.any()) and bool(abs(system.errors.G[:, mine]).sum() > 0)


@dataclass(frozen=True, eq=False)
class _Blocks(Locked):
    """Rows by pose, padded to the largest: y, X and the parts of V.

    Attributes:
        y: Shape (p, s).
        X: Orthonormal fixed effects, shape (p, s, k).
        parts: Covariance of each component as stated, then of the rest, shape (n + 1, p, s, s).
        dof: Rows minus fixed effects.
    """

    y: Array
    X: Array
    parts: Array
    dof: int

    @classmethod
    def of(cls, system: System, X: Array, groups: Sequence[Sequence[str]]) -> _Blocks:
        _, index = np.unique(system.rows.pose, return_inverse=True)
        count = np.bincount(index, minlength=1)
        order = np.argsort(index, kind="stable")
        place = np.empty(len(index), dtype=np.int64)
        place[order] = np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)
        p, s = len(count), int(count.max())
        unit = float(np.sqrt(np.mean(system.c**2))) or 1.0
        U, size, _ = np.linalg.svd(X / unit, full_matrices=False)
        norms = np.linalg.norm(X / unit, axis=0)
        if X.shape[1]:
            scaled = (X / unit)[:, norms > 0] / norms[norms > 0]
            U, size, _ = np.linalg.svd(scaled, full_matrices=False)
        Q = U[:, size > 1e-10 * size.max(initial=1e-300)]
        y, wide = np.zeros((p, s)), np.zeros((p, s, Q.shape[1]))
        y[index, place], wide[index, place] = system.c / unit, Q
        source = system.errors.source.astype(str)
        rest = ~np.isin(source, [name for group in groups for name in group])
        parts = np.zeros((len(groups) + 1, p, s, s))
        masks = [np.isin(source, group) for group in groups] + [rest]
        for k, mask in enumerate(masks):
            own = system.errors.G[:, mask & ~system.errors.common]
            V = (own @ own.T).tocoo()
            parts[k, index[V.row], place[V.row], place[V.col]] = V.data / unit**2
        empty = np.ones((p, s), dtype=bool)
        empty[index, place] = False
        which, at = np.nonzero(empty)
        parts[-1, which, at, at] = 1.0  # padding: independent rows of zeros
        return cls(y, wide, parts, len(index) - Q.shape[1])

    @property
    def rough(self) -> float:
        """Log scale that gives the rows their mean square if all components share it."""
        stated = np.einsum("kpii->", self.parts[:-1])
        return float(0.5 * np.log(np.sum(self.y**2) / stated))

    def loss(self, log_scale: Array) -> tuple[Array, float]:
        """Minus twice the restricted log likelihood: part of each pose, shape (p,), and of X."""
        weights = np.append(np.exp(2 * log_scale), 1.0)
        V = np.einsum("k,kpij->pij", weights, self.parts)
        try:
            L = np.linalg.cholesky(V)
        except np.linalg.LinAlgError:
            return np.full(len(self.y), np.inf), 0.0
        both = np.linalg.solve(L, np.concatenate([self.X, self.y[..., None]], axis=2))
        X, y = both[..., :-1], both[..., -1]
        own = 2 * np.log(np.einsum("pii->pi", L)).sum(axis=1) + (y**2).sum(axis=1)
        if not X.shape[2]:
            return own, 0.0
        N = np.einsum("psi,psj->ij", X, X)
        g = np.einsum("psi,ps->i", X, y)
        return own, float(np.linalg.slogdet(N)[1] - g @ np.linalg.solve(N, g))

    def of_scales(self, told: Bools) -> Loss:
        """The loss as a function of some log scales; the other components stay as stated."""

        def loss(x: Array) -> tuple[Array, float]:
            full = np.zeros(len(told))
            full[told] = x
            return self.loss(full)

        return loss


STEP = 3e-3
"""Differences of log scale for first and second derivatives."""


def _maximum(blocks: _Blocks, told: Bools) -> tuple[Array, Array, Array]:
    """The log scales that are told, their standard uncertainties and their p-values.

    The p-value is of the likelihood ratio against the component as stated. A curvature says
    nothing of it: a component may stand out clearly at a scale at which it would be invisible.
    """
    loss, start = blocks.of_scales(told), np.full(int(told.sum()), blocks.rough)
    x = _lowest(loss, start)
    _, H, scores = _derivatives(loss, x)
    values, vectors = np.linalg.eigh(H)
    if values.min() <= 0:
        weak = (vectors[:, values <= 1e-3] ** 2).sum(axis=1) > 0.1
        cov = (vectors / np.maximum(values, 1e-3)) @ vectors.T
        information, longer = 2 * np.where(weak, np.inf, np.diag(cov)), np.ones(len(x))
    else:
        inverse = (vectors / values) @ vectors.T
        sandwich = np.diag(inverse @ (scores.T @ scores) @ inverse)
        information = 2 * np.diag(inverse)
        longer = np.maximum(sandwich / information, 1.0)
    best, p = _total(loss, x), np.empty(len(x))
    for i, k in enumerate(np.flatnonzero(told)):
        others = told & (np.arange(len(told)) != k)
        as_stated = blocks.of_scales(others)
        worse = _total(as_stated, _lowest(as_stated, np.delete(x, i))) - best
        tail = 0.5 * stats.chi2.sf(max(worse, 0.0) / longer[i], 1)
        p[i] = tail if x[i] > 0 else 1 - tail
    return x, np.sqrt(information * longer), p


def _lowest(loss: Loss, start: Array) -> Array:
    """Where a loss is lowest, by Newton's method."""
    x = start
    for _ in range(40):
        if not len(x):
            break
        gradient, H, _ = _derivatives(loss, x)
        values, vectors = np.linalg.eigh(H)
        move = vectors @ (vectors.T @ gradient / np.maximum(np.abs(values), 0.5))
        move = np.clip(move, -0.7, 0.7)
        x = np.clip(x - move, start - 4.0, start + 4.0)
        if np.abs(move).max() < 1e-4:
            break
    return x


def _derivatives(loss: Loss, x: Array) -> tuple[Array, Array, Array]:
    """Gradient and Hessian of the loss, and gradient of each pose's part, shape (p, n)."""
    n = len(x)
    steps = STEP * np.eye(n)
    here = _total(loss, x)
    ahead = [loss(x + d) for d in steps]
    behind = [loss(x - d) for d in steps]
    up = np.array([own.sum() + rest for own, rest in ahead])
    down = np.array([own.sum() + rest for own, rest in behind])
    scores = np.stack([(a[0] - b[0]) / (2 * STEP) for a, b in zip(ahead, behind, strict=True)], 1)
    H = np.diag((up - 2 * here + down) / STEP**2)
    for i in range(n):
        for j in range(i):
            both = _total(loss, x + steps[i] + steps[j])
            H[i, j] = H[j, i] = (both - up[i] - up[j] + here) / STEP**2
    return (up - down) / (2 * STEP), H, scores


def _total(loss: Loss, x: Array) -> float:
    own, rest = loss(x)
    return float(own.sum() + rest)


def rescaled(data: Measured, found: Components) -> Measured:
    """The same measurements with the noise that was found wherever it is larger than stated.

    A tracker noisier than stated also placed the base frame worse, unless the scatter of the base
    reflectors themselves has said already how well that is placed.
    """
    factor = np.where(found.larger | ~np.array([found.stated, True]), found.scale, 1.0)
    tracker, force = factor.tolist()
    told = data.rotation_found or not found.stated
    return replace(
        data.scaled(tracker / (data.found_m or 1.0)),
        rotation_cov=data.rotation_cov * (1.0 if told else tracker**2),
        reading_std=data.reading_std * force,
        noise_stated=True,
        found_m=None,
    )


def resting_on(estimate: Estimate, found: Components) -> Estimate:
    """The estimate whose noise is itself estimated: Student's quantile, and the test of misfit.

    The noise was made to fit the contrasts, so they cannot speak for the model: what chi2 holds
    beside them is compared with them (F test of the lack of fit).
    """
    dof = 0.5 / float(np.max(found.std[found.replaced])) ** 2
    lack, lack_dof = max(estimate.chi2 - found.chi2, 0.0), estimate.dof - found.chi2_dof
    return replace(
        estimate,
        p_value=float(stats.f.sf(lack / lack_dof, lack_dof, dof)) if lack_dof > 0 else None,
        noise_from="replicates",
        quantile=float(stats.t.ppf(0.975, dof)),
    )


def at_most(p: float) -> float:
    """The largest probability that a p-value leaves to what contradicts the null, at even odds.

    No alternative makes the null less likely than -e p ln p against one (Sellke, Bayarri and
    Berger 2001); so 0.95 where p is 0.003, and a half where p says nothing.
    """
    if p >= np.exp(-1):
        return 0.5
    return float(1 / (1 - np.e * special.xlogy(p, p)))


def noise(
    settings: Settings,
    cell: Cell,
    placed: pd.DataFrame,
    data: Measured,
    system: System,
    estimate: Estimate,
) -> Components:
    """The noise of a campaign from its repeats, its repeated zeros and its effector's triangle."""
    zeros = repeated_zeros(settings, placed)
    pure = pure_error(system, estimate.residual, data, zeros, cell)
    found = variance_components(pure)
    return replace(found, **_of_pulls(pure, found)) if found.used else found


def _of_pulls(pure: System, found: Components) -> dict[str, Any]:
    """`chi2` and `chi2_dof` of the contrasts between pulls."""
    rows = np.flatnonzero(pure.rows.pull != ZEROS)
    factor = np.ones(len(pure.errors.source))
    for name in found.name[found.replaced]:
        unit = (pure.found_m or 1.0) if name == "tracker" else 1.0
        factor[np.isin(pure.errors.source.astype(str), SCALED[name])] = found.of(name) / unit
    G = scipy.sparse.csr_array(pure.errors.G[rows] @ scipy.sparse.diags_array(factor))
    white = whitener(replace(pure.errors, G=G), pure.rows.pose[rows])
    return {"chi2": float(np.sum(white(pure.c[rows]) ** 2)), "chi2_dof": len(rows)}
