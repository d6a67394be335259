"""A point of campaign.toml that the readings contradict: which single entry is wrong.

Given the flange in each unloaded pose by the robot's table, the points in [tool] and [base_frame]
and the readings can disagree in one way only: all entries have the small errors of nominal points,
or one of them has an arbitrary error. With y the readings in F_b minus the stated places, the
unknown pose of the tracker in x, and a free entry i,

    y = D x + G_i d_i + e,   e ~ N(0, V),   V = noise + entries + robot's errors of size s

each hypothesis has the restricted likelihood, given what no choice of x and d_i explains (Harville,
J. Am. Stat. Assoc. 72, 1977), averaged over s. A free entry is penalised by a factor for each axis,
the width of its estimate over a metre, so that it must explain far more than chance. Two exchanged
entries, and a table in another unit, are hypotheses without free parameters.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import combinations

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation
from scipy.special import logsumexp

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.base.tails import chi2_beyond
from pipeline.faults.conventions import unloaded
from pipeline.machine.robot import configure
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ
from pipeline.system import alarms

_NOISE_M = 1e-4
"""Standard uncertainty of a reading, and of a reflector put back into its nest, per axis [m]."""
TOOL_M = 5e-4
"""Standard uncertainty of a point of the tool where it is not stated [m]: measured once with the
tracker or a caliper, and mounted again."""
_BASE_M = 2e-3
"""Standard uncertainty of the stated position of a base reflector [m]: surveyed once, on a floor
that settles."""
_ROBOT_M = np.geomspace(1e-4, 3e-2, 6)
"""Sizes s of the robot's own errors that are averaged over [m]: from its repeatability to 30 mm,
which no robot in use exceeds. They rotate the flange by s at a metre, and the robot in F_b by s at
`_CELL_M`."""
_CELL_M = 5.0
"""Lever of the rotation of the robot's foot or rail in F_b by its errors [m]."""
_MOST_POSES = 24
"""Maximum number of poses used; more do not help to identify one entry."""
_STEPS = 3
"""Number of Gauss-Newton steps; starting from readings without the wrong entry, two suffice."""
_FAR = 6.0
"""Deviation in standard deviations, or over the usual misfit, from which a state is left
out [1]."""
_RIVAL = 0.05
"""Minimum probability of an entry to be listed [1]."""
_UNITS = {"mm": 1e-3, "in": 25.4e-3}
"""Units in which a table in metres may actually be written, as factors [m]."""


@dataclass(frozen=True, eq=False)
class DoubtfulEntry(Locked):
    """An entry of campaign.toml that may be wrong.

    Attributes:
        table: `tool` or `base_frame`.
        names: The wrong point, or two that have each other's places; empty where all points of the
            table are in another unit.
        unit: That unit, else None.
        stated: Position of the point in campaign.toml [m], shape (3,); empty for several.
        found: Position according to the readings [m], in the same frame.
        std: Its standard uncertainty per axis [m].
        probability: Probability that this entry is the wrong one, if one is.
    """

    table: str
    names: tuple[str, ...]
    unit: str | None
    stated: Array
    found: Array
    std: Array
    probability: float

    @property
    def path(self) -> list[str]:
        """Path of the entry in campaign.toml; for several points that of the table."""
        return [self.table, *self.names[:1]]

    @property
    def off_m(self) -> float:
        """Distance of the stated from the estimated position [m]."""
        return float(np.linalg.norm(self.found - self.stated))


@dataclass(frozen=True, eq=False)
class _Scene(Locked):
    """Data for the hypotheses: m readings of targets in p poses by time, and b base reflectors.

    Attributes:
        seen: Readings of targets, then of base reflectors, tracker's frame [m], (m + b, 3).
        pose: Pose of each reading of a target, shape (m,).
        target: Its target, shape (m,).
        axes: Rotation of the flange in each pose, shape (p, 3, 3).
        origin: Its origin [m], shape (p, 3).
        tool: Stated positions of the targets, flange frame [m], shape (t, 3).
        base: Stated positions of the base reflectors, F_b [m], shape (b, 3).
        tool_std: Standard uncertainty of a point of the tool per axis [m].
        tool_stated: Whether it is stated.
        noise: Standard uncertainty of a reading per axis [m].
    """

    seen: Array
    pose: Ints
    target: Ints
    axes: Array
    origin: Array
    tool: Array
    base: Array
    tool_std: float
    tool_stated: bool
    noise: float

    @property
    def m(self) -> int:
        """Number of readings of targets."""
        return len(self.pose)

    @property
    def stated(self) -> Array:
        """Stated positions of the readings, F_b [m], shape (m + b, 3)."""
        turned = np.einsum("nij,nj->ni", self.axes[self.pose], self.tool[self.target])
        return np.vstack([self.origin[self.pose] + turned, self.base])

    def of(self, entry: int) -> Bools:
        """Mask of the readings of an entry, targets first, then base reflectors; shape (m + b,)."""
        which = np.concatenate([self.target, len(self.tool) + np.arange(len(self.base))])
        return np.asarray(which == entry)

    def column(self, entry: int) -> Array:
        """G: derivatives of the stated positions by an entry, (3 (m + b), 3)."""
        turn = np.concatenate([self.axes[self.pose], np.tile(np.eye(3), (len(self.base), 1, 1))])
        return np.where(self.of(entry)[:, None, None], turn, 0.0).reshape(-1, 3)

    def errors(self, at: Array) -> tuple[Array, Array, Array]:
        """Columns of the small errors of entries, their standard deviations, columns of the robot.

        Args:
            at: The readings in F_b [m], shape (m + b, 3).
        """
        lever = at[: self.m] - self.origin[self.pose]
        each = np.zeros((self.m, 3, len(self.axes), 6))  # of its own in every pose
        each[np.arange(self.m), :, self.pose] = linear.motions(lever)
        foot = linear.motions(at[: self.m] / _CELL_M).reshape(-1, 6)
        robot = np.hstack([each.reshape(3 * self.m, -1), foot, self._flange(lever)])
        below = np.zeros((3 * len(self.base), robot.shape[1]))
        return *self._entries, np.vstack([robot, below])

    @cached_property
    def _entries(self) -> tuple[Array, Array]:
        """Columns of the small errors of all entries, and their standard deviations."""
        entries = [self.column(k) for k in range(len(self.tool) + len(self.base))]
        size = [self.tool_std] * (3 * len(self.tool)) + [_BASE_M] * (3 * len(self.base))
        return np.hstack(entries), np.array(size)

    def _flange(self, lever: Array) -> Array:
        """Columns of an error of the flange frame that is the same in all poses."""
        turn = self.axes[self.pose]
        own = np.einsum("nji,nj->ni", turn, lever)
        return np.asarray(np.einsum("nij,njk->nik", turn, linear.motions(own)).reshape(-1, 6))

    def only(self, poses: Bools) -> _Scene:
        """The scene with some poses only."""
        keep = poses[self.pose]
        number = np.cumsum(poses) - 1
        return replace(
            self,
            seen=np.vstack([self.seen[: self.m][keep], self.seen[self.m :]]),
            pose=number[self.pose[keep]],
            target=self.target[keep],
            axes=self.axes[poses],
            origin=self.origin[poses],
        )


@dataclass(frozen=True, eq=False)
class _Fit(Locked):
    """Fit of one hypothesis.

    Attributes:
        evidence: Logarithm of the restricted likelihood, averaged over the robot's errors.
        shift: Error of the free entry [m], shape (3,) or (0,).
        cov: Its covariance [m^2].
        left: Residual of each reading [m], shape (m + b, 3).
    """

    evidence: float
    shift: Array
    cov: Array
    left: Array

    @property
    def std(self) -> Array:
        """Standard uncertainty of the error [m], shape (3,) or (0,)."""
        return np.sqrt(np.diag(self.cov))

    @property
    def p_value(self) -> float:
        """Probability of as large an error by chance: d' C^-1 d is chi-square.

        1 where the rows do not determine it.
        """
        if not np.isfinite(self.evidence):
            return 1.0
        square = float(self.shift @ linear.solve(self.cov, self.shift))
        return float(chi2_beyond(square, len(self.shift)))


@lru_cache(maxsize=1)  # used for the readings, and again when the answer is written
def wrong_entries(case: Case) -> tuple[DoubtfulEntry, ...]:
    """Entries of [tool] and [base_frame] one of which is wrong, the most probable first.

    Empty where it is likelier that no entry is wrong, where no single entry reconciles the
    reflectors with the robot's table, or where too little was read.
    """
    scene = _scene(case)
    if scene is None:
        return ()
    found = _single(case, scene)
    best = max(range(len(found)), key=lambda k: found[k][1].evidence)
    if 0 < best <= len(scene.tool) and _moved(scene, best - 1) > found[best][1].evidence:
        return ()  # no entry is wrong in all poses: the target moved on the effector
    kept = scene.only(_alike(scene, found[best][1]))
    if len(kept.axes) < len(scene.axes):
        found = _single(case, kept)
    if not _doubted(kept, found):
        return ()  # exchanged points would leave a single free one far ahead of none
    found += [(claim, _fit(other, None)) for claim, other in _together(case, kept)]
    evidence = np.array([fit.evidence for _, fit in found[1:]])
    share = np.exp(evidence - logsumexp(evidence))
    named = [
        _entry(case, claim, fit, float(p))
        for (claim, fit), p in zip(found[1:], share, strict=True)
        if p >= _RIVAL and float(np.median(_missed(kept, fit))) < GROSS_DISTANCE_M
    ]
    return tuple(sorted(named, key=lambda one: -one.probability))


def _doubted(scene: _Scene, found: Sequence[tuple[_Claim, _Fit]]) -> bool:
    """Whether one wrong entry is likelier than none, at even prior odds, or `_contradicted`."""
    none, *single = (fit.evidence for _, fit in found)
    likelier = bool(single) and float(logsumexp(single)) - np.log(len(single)) > none
    return likelier or _contradicted(scene, found)


def _contradicted(scene: _Scene, found: Sequence[tuple[_Claim, _Fit]]) -> bool:
    """Whether a point of [tool] is farther off than its stated uncertainty explains.

    By p-values of the points, at the rate of the false-alarm budget for all of them; where no
    uncertainty is stated, only the odds decide.
    """
    tool = [fit.p_value for claim, fit in found if claim.table == "tool"]
    return scene.tool_stated and len(tool) * min(tool) < alarms.TOOL_POINT


@dataclass(frozen=True)
class _Claim:
    """What may be wrong: table, points and unit as in `DoubtfulEntry`; nothing without a table."""

    table: str = ""
    names: tuple[str, ...] = ()
    unit: str | None = None


def _single(case: Case, scene: _Scene) -> list[tuple[_Claim, _Fit]]:
    """The hypotheses that nothing is wrong, and that each entry is, with their fits."""
    named = [(table, name) for table, names, _ in _tables(case) for name in names]
    single = [(_Claim(table, (name,)), _fit(scene, k)) for k, (table, name) in enumerate(named)]
    return [(_Claim(), _fit(scene, None)), *single]


def _moved(scene: _Scene, target: int) -> float:
    """Evidence that a target is where it is stated until some pose, and in another place since.

    As for one wrong entry, all poses equally likely; at least two are on either side.
    """
    tool, evidence = np.vstack([scene.tool, scene.tool[target]]), []
    for since in range(2, len(scene.axes) - 1):
        late = (scene.target == target) & (scene.pose >= since)
        other = replace(scene, tool=tool, target=np.where(late, len(scene.tool), scene.target))
        evidence.append(_fit(other, len(scene.tool)).evidence)
    return float(logsumexp(evidence) - np.log(len(evidence))) if evidence else -np.inf


def _together(case: Case, scene: _Scene) -> Iterator[tuple[_Claim, _Scene]]:
    """The scene with a table in another unit, and with two of its points exchanged."""
    for table, names, which in _tables(case):
        places = getattr(scene, which)
        for unit, factor in _UNITS.items() if names else ():
            yield _Claim(table, (), unit), replace(scene, **{which: factor * places})
        for i, j in combinations(range(len(names)), 2):
            order = np.arange(len(names))
            order[[i, j]] = j, i
            yield _Claim(table, (names[i], names[j])), replace(scene, **{which: places[order]})


def _tables(case: Case) -> list[tuple[str, Sequence[str], str]]:
    """Each table with its points in the order of a scene, and its attribute there."""
    return [("tool", case.settings.measured, "tool"), ("base_frame", _base(case)[0], "base")]


def _entry(case: Case, claim: _Claim, fit: _Fit, probability: float) -> DoubtfulEntry:
    places = case.settings.tool if claim.table == "tool" else case.settings.base_frame
    stated = np.array(places[claim.names[0]]) if len(claim.names) == 1 else np.zeros(0)
    found = stated + fit.shift
    return DoubtfulEntry(claim.table, claim.names, claim.unit, stated, found, fit.std, probability)


def _scene(case: Case) -> _Scene | None:
    """Unloaded readings, one median for each target of a pose; None where there are none."""
    zeros = unloaded(case)
    at = zeros.groupby(["pose", "target"], observed=True)[XYZ].median().reset_index()
    names, seen = _base(case)
    if not len(at):
        return None
    when = zeros.groupby("pose")["time"].min()
    poses = (when.sort_values(kind="stable") if when.notna().all() else when).index.to_numpy(int)
    pose = pd.Index(poses).get_indexer(pd.Index(at["pose"].astype(int)))
    here = configure(case.robot, case.q(poses))
    stated = case.settings.tool_uncertainty.sigma_m
    scene = _Scene(
        seen=np.vstack([at[XYZ].to_numpy(float), seen]),
        pose=pose,
        target=pd.Index(case.settings.measured).get_indexer(pd.Index(at["target"])),
        axes=here.flange_axes,
        origin=here.flange_origin,
        tool=case.tool.points,
        base=np.array([case.settings.base_frame[one] for one in names]).reshape(-1, 3),
        tool_std=stated or TOOL_M,
        tool_stated=stated > 0,
        noise=_NOISE_M,
    )
    alike, scatter = _same_shape(scene)
    scene = replace(scene.only(alike), noise=max(_NOISE_M, scatter))
    few = np.unique(np.linspace(0, len(scene.axes) - 1, _MOST_POSES).astype(int))
    return scene.only(np.isin(np.arange(len(scene.axes)), few)) if len(scene.axes) else None


@lru_cache(maxsize=1)
def _base(case: Case) -> tuple[list[str], Array]:
    """Base reflectors that were read, and their median readings, tracker's frame [m], (b, 3)."""
    rows = case.readings[case.readings["pose"].isna()]
    names = [one for one in case.settings.base_frame if (rows["target"] == one).any()]
    at = [rows.loc[rows["target"] == one, XYZ].median().to_numpy(float) for one in names]
    return names, np.array(at).reshape(-1, 3)


def _same_shape(scene: _Scene) -> tuple[Bools, float]:
    """Poses in which the targets keep their usual distances, and the scatter of a reading [m].

    A mask, shape (p,); distances may also be those of a neighbour: poses that are unlike the
    others, but like each other, show a target that moved. A distance scatters as two readings do.
    """
    at = np.full((len(scene.axes), len(scene.tool), 3), np.nan)
    at[scene.pose, scene.target] = scene.seen[: scene.m]
    first, second = np.triu_indices(len(scene.tool), 1)
    apart = pd.DataFrame(np.linalg.norm(at[:, first] - at[:, second], axis=-1))
    off = (apart - apart.median()).abs()
    scatter = 1.4826 * off.median()  # for a normal distribution
    usual = np.hypot(_NOISE_M, scatter)
    next_to = (apart.diff().abs() <= _FAR * usual).all(axis=1).to_numpy()
    alike = ~(off > _FAR * usual).any(axis=1).to_numpy()
    both = scatter.max() / np.sqrt(2) if len(scatter) else 0.0
    return alike | next_to | np.append(next_to[1:], False), float(np.nan_to_num(both))


def _alike(scene: _Scene, fit: _Fit) -> Bools:
    """Mask of the poses whose misfit under a hypothesis is not far above the median, shape (p,)."""
    each = _missed(scene, fit)
    return np.asarray(each <= _FAR * max(float(np.median(each)), _NOISE_M))


def _missed(scene: _Scene, fit: _Fit) -> Array:
    """Rms misfit of the targets of each pose under a hypothesis [m], shape (p,)."""
    square = (fit.left[: scene.m] ** 2).sum(axis=1)
    return np.sqrt(np.bincount(scene.pose, square) / np.bincount(scene.pose))


def _fit(scene: _Scene, entry: int | None) -> _Fit:
    """Fit of the hypothesis that one entry is wrong, or none."""
    out = np.zeros(len(scene.seen), bool) if entry is None else scene.of(entry)
    R, t = _placed(scene, ~out)
    free = np.zeros((3 * len(out), 0)) if entry is None else scene.column(entry)
    for _ in range(_STEPS):
        rows = _rows(scene, free, R, t)
        step = -rows.solved(_ROBOT_M[len(_ROBOT_M) // 2])[0][:6]
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        centre = (scene.seen @ R.T + t).mean(axis=0)
        R, t = turn @ R, turn @ (t - centre) + centre + step[3:]
    rows = _rows(scene, free, R, t)
    evidence, s = rows.averaged(_ROBOT_M)
    x, cov = rows.solved(s)
    return _Fit(evidence, x[6:], cov[6:, 6:], (rows.y - rows.X @ x).reshape(-1, 3))


def _placed(scene: _Scene, kept: Bools) -> tuple[Array, Array]:
    """R, t of the tracker by some readings, or by all if these do not determine it."""
    seen, stated = scene.seen[kept], scene.stated[kept]
    if len(seen) < 3 or linear.extent(stated)[1] < TOOL_M:
        seen, stated = scene.seen, scene.stated
    return linear.rigid(seen, stated)


def _rows(scene: _Scene, free: Array, R: Array, t: Array) -> Rows:
    """Rows of a hypothesis at p_b = R p_t + t: y the readings in F_b minus stated positions [m].

    X are the columns of rotation and translation of the tracker, and those of a `free` entry.
    """
    at = scene.seen @ R.T + t
    entries, size, robot = scene.errors(at)
    placing = linear.motions(at - at.mean(axis=0)).reshape(-1, 6)
    return Rows(
        y=(at - scene.stated).ravel(),
        X=np.hstack([placing[:, 3:], placing[:, :3], free]),
        noise=(entries * size**2) @ entries.T + scene.noise**2 * np.eye(3 * len(at)),
        model=robot @ robot.T,
    )


@dataclass(frozen=True, eq=False)
class Rows(Locked):
    """Rows y = X x + e of a hypothesis, e ~ N(0, noise + s^2 model), in blocks (...) of their own.

    Attributes:
        y: Differences from what is stated, shape (..., k).
        X: Columns of the free parameters, shape (..., k, n).
        noise: Covariance without errors of the model, shape (..., k, k).
        model: Covariance of errors of the model of unit size, shape (..., k, k).
    """

    y: Array
    X: Array
    noise: Array
    model: Array

    def _white(self, s: float) -> tuple[Array, Array, Array]:
        W = linear.whitening(self.noise + s**2 * self.model)
        return W, (W @ self.X).reshape(-1, self.X.shape[-1]), (W @ self.y[..., None]).ravel()

    def solved(self, s: float) -> tuple[Array, Array]:
        """Free parameters for errors of the model of size s, and their covariance."""
        _, X, y = self._white(s)
        inverse = linear.pseudoinverse(X)
        return inverse(y), np.asarray(inverse.cov)

    def averaged(self, sizes: Array) -> tuple[float, float]:
        """Logarithm of the restricted likelihood, averaged over some s, and the likeliest s.

        It is -inf where the rows do not determine every free parameter.
        """
        each = np.array([self._evidence(s) for s in sizes])
        mean = float(logsumexp(each) - np.log(len(each))) if np.isfinite(each).any() else -np.inf
        return mean, float(sizes[int(np.argmax(each))])

    def _evidence(self, s: float) -> float:
        """Restricted log likelihood, -1/2 (log|V| + log|X' V^-1 X| + y' P y)."""
        W, X, y = self._white(s)
        inside = linear.orthonormal(X)
        if inside.shape[1] < X.shape[1]:
            return -np.inf
        rest = float(y @ y - np.sum((inside.T @ y) ** 2))
        size = -2 * np.log(np.einsum("...ii->...i", W)).sum() + float(linear.log_det(X.T @ X))
        return -0.5 * float(size + rest)
