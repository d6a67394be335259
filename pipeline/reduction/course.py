"""Base reflectors that part between their rounds, as those of a base frame that warms.

y_k = p_t(k) + v_r + w_r x l_k + E_r l_k + e_k,    l_k = p_k - p_0,

in F_b [m]: p_t free for each reflector t, and since the first round a motion (v_r, w_r) of round r
and a strain E_r = g_r 1, or g_r u u' along the longest extent u of the base frame, as of a rail.
Lengths that the tracker measures too long or too short (temperature and pressure of its beam) have
the same strain. It is corrected in all readings, in proportion to time between two rounds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pipeline.base import covariance, linear
from pipeline.base.arrays import Array, Ints, Locked
from pipeline.base.tails import chi2_beyond
from pipeline.tables import XYZ

_MOST = 30
"""Maximum number of rounds; of more, a strain of each says nothing about a course."""

CONTRADICTED = 1e-4
"""p-value below which the base reflectors disagree by more than their stated uncertainties [1]."""


@dataclass(frozen=True, eq=False)
class Course(Locked):
    """Motion and strain of the base frame at its rounds, both relative to the first one.

    Attributes:
        groups: Group of each round, in order of time, (r,).
        begun: Mean time of its readings [s], shape (r,).
        centre: Point p_0 [m], shape (3,).
        shift: v_r [m], shape (r, 3).
        gradient: Sum of w_r x and E_r [1], shape (r, 3, 3).
        growth: g_r [1], shape (r,).
        std: Standard uncertainty of each, shape (r,).
        length_m: Longest extent of the base frame [m].
        p_value: Probability of as much strain by chance.
        std_m: Standard uncertainty per axis of the motions at the reflectors [m].
        unknowns: Number of unknowns.
    """

    groups: tuple[str, ...]
    begun: Array
    centre: Array
    shift: Array
    gradient: Array
    growth: Array
    std: Array
    length_m: float
    p_value: float
    std_m: float
    unknowns: int

    def seen_from(self, R: Array, t: Array, scale: float) -> Course:
        """The same in the frame of a tracker, for p_b = (R p + t) / scale."""
        return replace(
            self,
            centre=(scale * self.centre - t) @ R,
            shift=scale * self.shift @ R,
            gradient=R.T @ self.gradient @ R,
        )

    def parting(self, points: Array, since: Array) -> Array:
        """What the correction moves points by if the robot did not grow with its base [m].

        a S_r l of the strain alone, and translations g_r a L along x, y and z, as nobody knows
        which point of the base stayed where it was: S_r the symmetric part of the gradient, L the
        longest extent; each is uncertain by itself, that is as large once.

        Args:
            points: Positions [m], shape (m, 3).
            since: Seconds after the first reading, NaN as in the first round, shape (m,).

        Returns:
            Shape (m, 3, 4).
        """
        known = np.nan_to_num(since)
        share = np.column_stack(
            [np.interp(known, self.begun, one) for one in np.eye(len(self.begun))]
        )
        strain = (self.gradient + np.swapaxes(self.gradient, 1, 2)) / 2
        own = np.einsum("mr,rij,mj->mi", share, strain, points - self.centre)
        away = (share @ self.growth * self.length_m)[:, None, None] * np.eye(3)
        return np.concatenate([own[:, :, None], away], axis=2)

    def as_in_first(self, readings: pd.DataFrame, since: Array) -> pd.DataFrame:
        """Table READINGS with all positions as they would have been read in the first round.

        Args:
            readings: Its rows, m of them.
            since: Seconds after the first reading, NaN as the reading before, shape (m,).
        """
        known, points = pd.Series(since).ffill().bfill(), readings[XYZ].to_numpy(float)
        rounds = np.eye(len(self.begun))
        share = np.column_stack([np.interp(known, self.begun, one) for one in rounds])
        moved = np.einsum("mr,rij,mj->mi", share, self.gradient, points - self.centre)
        still = points - share @ self.shift - moved
        return readings.assign(**dict(zip(XYZ, still.T, strict=True)))


def course(table: pd.DataFrame, R: Array) -> Course | None:
    """The course of the base frame, if rounds call for a strain and no one reflector explains it.

    As in `CONTRADICTED`: a motion of each round leaves more than chance does, also with any one
    reflector displaced in a round, or since one; with a strain it does not. Rotations are estimated
    where translations and the strain leave more than chance. Where no noise is stated, it is what
    the strain leaves.

    Args:
        table: Table REGISTRATION with `time_s`.
        R: Rotation from the tracker's frame into F_b, shape (3, 3).
    """
    groups = table["group"].astype(str)
    begun = table.groupby(groups)["time_s"].mean().sort_values()
    stated = bool(covariance.known(covariance.numbers(table)).all())
    if not 1 < len(begun) <= _MOST or not np.isfinite(begun).all():
        return None
    seen = _Rounds.of(table, R, begun.index.get_indexer(pd.Index(groups)))
    bare = seen.fit(seen.rigid)
    if stated and not bare.contradicted():
        return None
    found = seen.strained(stated)
    variance = 1.0 if stated else found.rest / max(found.dof, 1)
    if found.contradicted(variance) or not bare.contradicted(variance):
        return None
    if not all(one.contradicted(variance) for one in seen.displaced(bare)):
        return None
    return seen.course(found, begun, variance, bare.rest - found.rest)


@dataclass(frozen=True, eq=False)
class _StrainFit(Locked):
    """Columns of a model of the base readings, and what they leave.

    Attributes:
        X: Whitened columns, those of the motions last, shape (3 m, k).
        ways: Motions of one round, the strain last if there is any, shape (m, 3, w).
        rest: Residual sum of squares.
        dof: Its degrees of freedom.
    """

    X: Array
    ways: Array
    rest: float
    dof: int

    def contradicted(self, variance: float = 1.0) -> bool:
        """Whether it leaves more than chance does."""
        return self.dof < 1 or bool(chi2_beyond(self.rest / variance, self.dof) < CONTRADICTED)


@dataclass(frozen=True, eq=False)
class _Rounds(Locked):
    """Whitened base readings, m of them.

    Attributes:
        y: Residuals, shape (3 m,).
        white: Whitening matrices, shape (m, 3, 3).
        lever: Nominal positions about their centre [m], shape (m, 3).
        centre: This [m], F_b, shape (3,).
        rail: Direction of their longest extent, shape (3,).
        target: Whether each is of each reflector [1], shape (m, t).
        rounds: Whether each is of each round [1], shape (m, r).
    """

    y: Array
    white: Array
    lever: Array
    centre: Array
    rail: Array
    target: Array
    rounds: Array

    @classmethod
    def of(cls, table: pd.DataFrame, R: Array, rounds: Ints) -> _Rounds:
        """From the table REGISTRATION."""
        white = linear.whitening(R @ covariance.weighing(table) @ R.T)
        off = table[["dx_m", "dy_m", "dz_m"]].to_numpy(float)
        nominal = table[XYZ].to_numpy(float) - off
        lever = nominal - nominal.mean(axis=0)
        target = pd.factorize(table["target"])[0]
        which = (np.eye(one.max() + 1)[one] for one in (target, rounds))
        rail = linear.principal(lever)[2][0]
        return cls(
            (white @ off[..., None]).ravel(), white, lever, nominal.mean(axis=0), rail, *which
        )

    @property
    def rigid(self) -> Array:
        """Motions of a round, shape (m, 3, 6)."""
        return linear.motions(self.lever)

    def _columns(self, ways: Array, which: Array) -> Array:
        """`ways` (m, 3, w) in each of several sets of readings (m, n), whitened, (3 m, n w)."""
        each = (self.white @ ways)[:, :, None, :] * which[:, None, :, None]
        return np.asarray(each.reshape(len(self.y), -1))

    def fit(self, ways: Array) -> _StrainFit:
        """Free places, and `ways` of every later round."""
        places = self._columns(self.rigid[:, :, :3], self.target)
        X = np.hstack([places, self._columns(ways, self.rounds[:, 1:])])
        U = linear.orthonormal(X)
        left = self.y - U @ (U.T @ self.y)
        return _StrainFit(X, ways, float(left @ left), len(left) - U.shape[1])

    def strained(self, stated: bool) -> _StrainFit:
        """The better strain, in all directions or along the rail; with rotations if need be."""
        parts = self.lever, np.outer(self.lever @ self.rail, self.rail)
        still, turned = (
            min(
                (self.fit(np.concatenate([ways, one[..., None]], axis=2)) for one in parts),
                key=lambda one: one.rest,
            )
            for ways in (self.rigid[..., :3], self.rigid)
        )
        return turned if not stated or still.contradicted() else still

    def displaced(self, bare: _StrainFit) -> Iterator[_StrainFit]:
        """A model beside a displacement of each reflector in each round, and since it."""
        U = linear.orthonormal(bare.X)
        left = self.y - U @ (U.T @ self.y)
        since = np.hstack([self.rounds, np.cumsum(self.rounds[:, ::-1], axis=1)[:, ::-1]])
        for target in self.target.T:
            for when in since.T:
                D = self._columns(self.rigid[:, :, :3], (target * when)[:, None])
                Q = linear.orthonormal(D - U @ (U.T @ D))
                yield replace(
                    bare,
                    rest=bare.rest - float(np.sum((Q.T @ left) ** 2)),
                    dof=bare.dof - Q.shape[1],
                )

    def course(
        self, found: _StrainFit, begun: pd.Series[float], variance: float, drop: float
    ) -> Course:
        """The course with the estimates of a model, whose strain explains `drop`."""
        later, w = len(begun) - 1, found.ways.shape[2]
        size = np.zeros((later + 1, w))
        size[1:] = linear.least_squares(found.X, self.y)[-later * w :].reshape(later, w)
        cov = variance * linear.covariance(found.X.T @ found.X)[-later * w :, -later * w :]
        own = cov.reshape(later, w, later, w)[np.arange(later), :, np.arange(later)]
        spread = np.einsum("mia,rab,mib->", found.ways, own, found.ways)
        alike = np.allclose(found.ways[..., -1], self.lever)
        strain = np.eye(3) if alike else np.outer(self.rail, self.rail)
        turns = size[:, 3:6] if w > 6 else np.zeros((later + 1, 3))
        growth = size[:, -1]
        return Course(
            groups=tuple(map(str, begun.index)),
            begun=np.asarray(begun, dtype=float),
            centre=self.centre,
            shift=size[:, :3],
            gradient=growth[:, None, None] * strain - linear.turning(turns),
            growth=growth,
            std=np.append(0.0, np.sqrt(own[:, -1, -1])),
            length_m=float(np.ptp(self.lever @ self.rail)),
            p_value=float(chi2_beyond(drop / variance, later)),
            std_m=float(np.sqrt(spread / (3 * later * len(self.lever)))),
            unknowns=later * w,
        )
