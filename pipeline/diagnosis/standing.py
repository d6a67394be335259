"""Where the unloaded reflectors stand: joint zeros, base frame and weight show there, in mm.

Robots stand half a millimetre to three off their table, for many reasons at once, and a wrong
joint zero can look like any of them. So a cause is believed only where it, or two or three
together, bring the reflectors to where they stand to within the scatter of the readings, or where
one alone takes nearly all and leaves no more than any robot has. A robot whose geometry is off
elsewhere is not accused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special, stats

from pipeline.cell import Cell, load, predict
from pipeline.diagnosis.gain import Gain, interval, rms
from pipeline.effects import Effect, Geometry, Observation, Pulls
from pipeline.results import Array, Bools, Estimate, Ints, Locked
from pipeline.stages.assemble import Measured

NAMES = ("joint_offset", "base_rotation", "gravity_sag")
"""Causes that move the unloaded reflectors by far more than they change displacements."""

LEAST_M = 3e-4
"""Reflectors that stand less than this off, rms, stand as well as any robot does."""

BELIEVED = 1e-3
"""Causes that leave more than chance does at this p are not the ones..."""

NEARLY_ALL = 0.15
"""... but for one alone that leaves at most this part of the misfit, and less than LEAST_M."""

NEEDED = 1e-6
"""Each must make the misfit this improbable where it is missing."""

MOST = 3

TOOL_M = 5e-3
"""Points of the effector are estimated along, this far from their nominals at most."""

STEP = 1e-3
"""Of a typical size, for differences; [m] for points of the tool."""


@dataclass(frozen=True, eq=False)
class Zeros(Locked):
    """What the tracker says of the unloaded reflectors.

    Attributes:
        cell: The robot and its tool, nothing that yields.
        pulls: One pull for each zero, as if nothing pulled.
        pose: Pose of each zero, 0..p-1, shape (z,).
        target: Its target in the tool, shape (z,).
        at: Where it stands [m], F_b, shape (z, 3).
        white: Inverse Cholesky factors of the covariances of `at`, shape (z, 3, 3).
        known: Columns that are always estimated along, whitened, shape (3 z + priors, n): points of
            the tool, where the base stands, and what is stated of its rotation and the joints.
        free: How many of them, the first, no prior holds.
        joints: How many of them, the last, are errors of the joints' zeros as they are stated.
    """

    cell: Cell
    pulls: Pulls
    pose: Ints
    target: Ints
    at: Array
    white: Array
    known: Array
    free: int
    joints: int = 0

    @property
    def exact(self) -> Zeros:
        """The same with the joints taken to stand where the log says: how far off is the table?"""
        rows, columns = (n - self.joints for n in self.known.shape)
        return replace(self, known=self.known[:rows, :columns], joints=0)

    def stands(self, effects: Sequence[Effect], values: Array) -> Array:
        """Where the table and some effects put the reflectors [m], shape (z, 3)."""
        cell = replace(self.cell, effects=tuple(effects))
        points = predict(cell, self.pulls, values).unloaded
        return np.asarray(points[np.arange(len(self.target)), self.target])

    def whitened(self, rows: Array) -> Array:
        """Rows of shape (z, 3) or (z, 3, k), whitened, with the priors below."""
        wide = rows[..., None] if rows.ndim == 2 else rows
        white = (self.white @ wide).reshape(3 * len(wide), wide.shape[2])
        padded = np.vstack([white, np.zeros((len(self.known) - len(white), wide.shape[2]))])
        return padded.reshape(len(padded), *rows.shape[2:])

    def without(self, pose: int) -> Zeros:
        """The same without one pose."""
        kept = self.pose != pose
        rows = np.concatenate([np.repeat(kept, 3), np.ones(len(self.known) - 3 * len(kept), bool)])
        return replace(
            self,
            pulls=_only(self.pulls, kept),
            pose=self.pose[kept],
            target=self.target[kept],
            at=self.at[kept],
            white=self.white[kept],
            known=self.known[rows],
        )


@dataclass(frozen=True, eq=False)
class Fit(Locked):
    """Some causes, estimated from where the reflectors stand.

    Attributes:
        effects: The causes.
        values: Their parameters, shape (k,).
        cov: Covariance of them, shape (k, k); larger where more than scatter is left.
        known: What is estimated along, shape (n,).
        chi2: Weighted sum of squares of what is left.
        dof: Its degrees of freedom.
    """

    effects: tuple[Effect, ...]
    values: Array
    cov: Array
    known: Array
    chi2: float
    dof: int

    @property
    def p(self) -> float:
        """Probability that chance leaves as much."""
        return float(special.chdtrc(self.dof, self.chi2)) if self.dof > 0 else 1.0

    def size(self, number: int) -> tuple[Array, Array]:
        """Parameters of one cause and their standard uncertainties."""
        ends = np.cumsum([len(effect.parameters) for effect in self.effects])
        mine = slice(ends[number] - len(self.effects[number].parameters), ends[number])
        return self.values[mine], np.sqrt(np.diag(self.cov))[mine]


@dataclass(frozen=True, eq=False)
class Standing(Locked):
    """What the unloaded reflectors say.

    Attributes:
        miss_m: How far they stand from the table, tool and base estimated along, rms [m]; NaN
            where too few were read.
        left_m: The same with the causes.
        fit: The causes, None where none is believed.
        p_values: Of the misfit without each cause.
        rivals: For each cause, others that would do as well with their probabilities.
        gain: What the causes are worth at poses that were left out.
        visible: From which multiple of its typical size each cause would be asked about, by label.
    """

    miss_m: float
    left_m: float
    visible: Mapping[str, float]
    fit: Fit | None = None
    p_values: tuple[float, ...] = ()
    rivals: tuple[tuple[tuple[Effect, float], ...], ...] = ()
    gain: Gain | None = None

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The causes."""
        return self.fit.effects if self.fit else ()


NOTHING = Standing(np.nan, np.nan, {})


def standing(
    cell: Cell, data: Measured, scale: float, effects: Sequence[Effect], rng: np.random.Generator
) -> Standing:
    """Ask the unloaded reflectors for causes that displacements hardly show.

    Args:
        cell: The paper's model.
        data: The measurements; `unloaded` may be NaN, then nothing is found.
        scale: Scatter of the tracker over its stated standard uncertainty.
        effects: The catalogue.
        rng: Draws the bootstrap of the gain.
    """
    suspects = tuple(effect for effect in effects if effect.name in NAMES)
    zeros = _zeros(cell, data, scale)
    if zeros is None or not suspects:
        return NOTHING
    miss = _left(zeros.exact, ())
    visible = _visible(zeros, suspects)
    if miss < LEAST_M or _fitted(zeros, ()).p > NEEDED:
        return Standing(miss, miss, visible)
    nobody = Standing(miss, miss, {})  # where the table is off, one more cause would not be seen
    best = _search(zeros, suspects)
    if best is None:
        return nobody
    rest = [_fitted(zeros, _but(best.effects, k)) for k in range(len(best.effects))]
    if max(one.p for one in rest) > NEEDED:
        return nobody
    return replace(
        nobody,
        visible=visible,
        left_m=_left(zeros.exact, best.effects),
        fit=best,
        p_values=tuple(one.p for one in rest),
        rivals=tuple(_rivals(zeros, best, k, suspects) for k in range(len(best.effects))),
        gain=_gain(zeros, suspects, rng),
    )


def as_stiff(cell: Cell, estimate: Estimate) -> Cell:
    """The cell of a robot that is as stiff as it was found: so much it sags under its weight."""
    known = estimate.identifiable & (estimate.value > 0)
    joints = tuple(
        replace(joint, stiffness=float(1 / x)) if told else joint
        for joint, x, told in zip(cell.robot.joints, estimate.value, known, strict=True)
    )
    return replace(cell, robot=replace(cell.robot, joints=joints))


def corrected(cell: Cell, data: Measured, found: Standing) -> Measured:
    """The measurements of a robot that stands where it was found to stand."""
    if found.fit is None:
        return data
    fit = found.fit
    bare = replace(cell, effects=fit.effects)
    q = data.pulls.q
    delta = data.delta[:, None]
    for facet, values in bare.split(fit.values):
        if isinstance(facet, Geometry):
            q = q + (facet.geometry(cell.robot, data.pulls, values) - data.pulls.q)
    loaded = load(bare, data.pulls, fit.values)
    for facet, values in bare.split(fit.values):
        if isinstance(facet, Observation):
            delta = facet.observe(loaded, delta, data.pulls.time, -values)
    return replace(data, pulls=replace(data.pulls, q=q, force=loaded.force), delta=delta[:, 0])


def _zeros(cell: Cell, data: Measured, scale: float) -> Zeros | None:
    _, first = np.unique(data.zero, return_index=True)
    first = first[np.isfinite(data.unloaded[first]).all(axis=1)]
    poses, pose = np.unique(data.pulls.pose[data.pull[first]], return_inverse=True)
    if len(poses) < 4 or not np.isfinite(scale):
        return None
    still = replace(data.pulls, force=np.zeros_like(data.pulls.force))
    bare = replace(cell, effects=(), equilibrium="undeformed")  # nothing pulls
    cov = data.zero_cov[first] * scale**2
    zeros = Zeros(
        cell=bare,
        pulls=_only(still, data.pull[first]),
        pose=pose,
        target=data.target[first],
        at=data.unloaded[first],
        white=np.linalg.inv(np.linalg.cholesky(cov)),
        known=np.zeros((3 * len(first), 0)),
        free=3,
    )
    return replace(
        zeros, known=_along(zeros, data), joints=int(np.any(data.joint_std) * cell.robot.n)
    )


def _along(zeros: Zeros, data: Measured) -> Array:
    """Columns estimated along, each in units of its prior, with a row for each prior below."""
    z, targets = len(zeros.target), len(zeros.cell.tool.targets)
    here = zeros.stands((), np.zeros(0))
    columns = [np.tile(np.eye(3), (z, 1, 1))]  # where the base stands: free
    tool = np.zeros((z, 3, 3 * targets))
    for axis in range(3):
        points = zeros.cell.tool.points + STEP * np.eye(3)[axis]
        moved = replace(
            zeros, cell=replace(zeros.cell, tool=replace(zeros.cell.tool, points=points))
        )
        slope = (moved.stands((), np.zeros(0)) - here) / STEP
        tool[np.arange(z), :, 3 * zeros.target + axis] = slope
    columns.append(tool * TOOL_M)
    turned = np.stack([np.cross(axis, here) for axis in np.eye(3)], axis=2)
    values, vectors = np.linalg.eigh(data.rotation_cov)
    columns.append(turned @ (vectors * np.sqrt(np.maximum(values, 0.0))))
    if data.joint_std.any():
        columns.append(_by_joint(zeros, here) * data.joint_std)
    K = np.concatenate(columns, axis=2)
    white = (zeros.white @ K).reshape(-1, K.shape[2])
    priors = np.eye(K.shape[2])[zeros.free :]
    return np.vstack([white, priors])


def _by_joint(zeros: Zeros, here: Array) -> Array:
    """Where the reflectors move with each joint, by differences, shape (z, 3, n)."""
    slopes = []
    for turn in 1e-6 * np.eye(zeros.cell.robot.n):
        moved = replace(zeros, pulls=replace(zeros.pulls, q=zeros.pulls.q + turn))
        slopes.append((moved.stands((), np.zeros(0)) - here) / 1e-6)
    return np.stack(slopes, axis=2)


def _only(pulls: Pulls, which: Bools | Ints) -> Pulls:
    return replace(pulls, **{name: value[which] for name, value in vars(pulls).items()})


def _fitted(zeros: Zeros, effects: Sequence[Effect], rounds: int = 4) -> Fit:
    """Estimate causes and what goes along, linearised anew each round."""
    parameters = [p for effect in effects for p in effect.parameters]
    typical = np.array([p.typical for p in parameters])
    values = np.zeros(len(parameters))
    n = zeros.known.shape[1]
    for _ in range(rounds if len(parameters) else 1):
        slopes = [
            zeros.stands(effects, values + d) - zeros.stands(effects, values - d)
            for d in STEP * typical * np.eye(len(parameters))
        ]
        J = np.stack(slopes, axis=2) / (2 * STEP) if slopes else np.zeros((*zeros.at.shape, 0))
        X = np.hstack([zeros.known, zeros.whitened(J)])
        y = zeros.whitened(zeros.at - zeros.stands(effects, values))
        size = np.maximum(np.linalg.norm(X, axis=0), 1e-300)
        U, s, Vt = np.linalg.svd(X / size, full_matrices=False)
        kept = s > 1e-8 * s[0]
        inverse = (Vt[kept].T / s[kept]) @ U[:, kept].T / size[:, None]
        step = inverse @ y
        values = values + step[n:] * typical
        if np.max(np.abs(step[n:]), initial=0.0) < 1e-4:
            break
    left = y - X @ step
    chi2 = float(left @ left)
    dof = 3 * len(zeros.at) - zeros.free - 3 * len(zeros.cell.tool.targets) - len(parameters)
    cov = (inverse @ inverse.T)[n:, n:] * np.outer(typical, typical)
    return Fit(tuple(effects), values, cov * max(1.0, chi2 / max(dof, 1)), step[:n], chi2, dof)


def _left(zeros: Zeros, effects: Sequence[Effect]) -> float:
    """What causes leave of where the reflectors stand, rms over coordinates [m]."""
    return rms(_short(zeros, zeros, _fitted(zeros, effects)))


def _short(zeros: Zeros, of: Zeros, fit: Fit) -> Array:
    """What the fit of `of` lacks of where the reflectors of `zeros` stand [m], shape (z, 3)."""
    along = (zeros.known[: 3 * len(zeros.at)] @ fit.known).reshape(-1, 3, 1)
    moved = np.linalg.solve(zeros.white, along)[..., 0]
    return np.asarray(zeros.at - zeros.stands(fit.effects, fit.values) - moved)


def _but(effects: tuple[Effect, ...], number: int) -> tuple[Effect, ...]:
    return effects[:number] + effects[number + 1 :]


def _search(zeros: Zeros, suspects: tuple[Effect, ...]) -> Fit | None:
    """The fewest causes that leave no more than chance; None when three do not."""
    chosen: tuple[Effect, ...] = ()
    alone: Fit | None = None
    for _ in range(MOST):
        free = [suspect for suspect in suspects if suspect not in chosen]
        fits = [_fitted(zeros, (*chosen, suspect)) for suspect in free]
        best = min(fits, key=lambda fit: fit.chi2)
        if best.p > BELIEVED and _possible(best):
            return best
        chosen, alone = best.effects, alone or best
    return alone if alone and _nearly_all(zeros, alone) and _possible(alone) else None


def _nearly_all(zeros: Zeros, fit: Fit) -> bool:
    """Whether causes take nearly all of the misfit and leave what any robot has."""
    left = _left(zeros.exact, fit.effects)
    return left < LEAST_M and left <= NEARLY_ALL * _left(zeros.exact, ())


def _visible(zeros: Zeros, suspects: tuple[Effect, ...]) -> dict[str, float]:
    """Multiples of the typical size from which a cause is asked about.

    The reflectors then stand LEAST_M off, by more than scatter and stated errors make likely.
    """
    here, out = zeros.stands((), np.zeros(0)), {}
    for suspect in suspects:
        typical = np.array([p.typical for p in suspect.parameters])
        moved = replace(zeros, at=zeros.stands((suspect,), typical))
        size, fit = _left(moved.exact, ()), _fitted(moved, ())
        if not np.any(moved.at != here) or size < 1e-9 or fit.dof < 1:
            out[suspect.label] = np.inf
            continue
        beyond = stats.chi2.isf(NEEDED, fit.dof) - fit.dof
        out[suspect.label] = max(LEAST_M / size, float(np.sqrt(beyond / fit.chi2)))
    return out


def _possible(fit: Fit) -> bool:
    """Every parameter within its physical bounds, to three standard uncertainties."""
    parameters = [p for effect in fit.effects for p in effect.parameters]
    slack = 3 * np.sqrt(np.diag(fit.cov))
    lower, upper = (np.array([getattr(p, end) for p in parameters]) for end in ("lower", "upper"))
    return bool(np.all((fit.values > lower - slack) & (fit.values < upper + slack)))


def _rivals(
    zeros: Zeros, best: Fit, number: int, suspects: tuple[Effect, ...]
) -> tuple[tuple[Effect, float], ...]:
    """What could stand in the place of one cause, itself included, likeliest first."""
    rest = _but(best.effects, number)
    others = [s for s in suspects if s not in best.effects]
    fits = [best, *(_fitted(zeros, (*rest, other)) for other in others)]
    able = [best.effects[number], *others]
    rough = max(1.0, best.chi2 / max(best.dof, 1))  # what is left beside the scatter
    odds = special.softmax([-fit.chi2 / rough / 2 - len(fit.values) for fit in fits])
    order = np.argsort(-odds, kind="stable")
    return tuple((able[i], float(odds[i])) for i in order if odds[i] > 1e-3)


def _gain(zeros: Zeros, suspects: tuple[Effect, ...], rng: np.random.Generator) -> Gain:
    """Leave out one pose at a time, and choose the causes without it."""
    before, after = np.zeros_like(zeros.at), np.zeros_like(zeros.at)
    chosen = []
    for pose in range(int(zeros.pose.max()) + 1):
        out, rest = zeros.pose == pose, zeros.without(pose)
        found = _search(rest, suspects)
        effects = found.effects if found else ()
        before[out] = _short(zeros.exact, rest.exact, _fitted(rest.exact, ()))[out]
        after[out] = _short(zeros.exact, rest.exact, _fitted(rest.exact, effects))[out]
        chosen.append(tuple(effect.label for effect in effects))
    rows = np.repeat(zeros.pose, 3)
    reduction, ci95 = interval(before.ravel(), after.ravel(), rows, rng)
    return Gain(before.ravel(), after.ravel(), reduction, ci95, tuple(chosen), "unloaded positions")


def student(fit: Fit) -> float:
    """Quantile of 95 % intervals."""
    return float(stats.t.ppf(0.975, max(fit.dof, 1)))
