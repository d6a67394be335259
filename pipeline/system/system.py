"""The linear system c = B x + G e, and the record of its solution."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse
from scipy import special

from pipeline.base.arrays import Array, Bools, Ints, Locked, Parameter, Strings


@dataclass(frozen=True, eq=False)
class RowIndex(Locked):
    """Identity of each row of c and B: one coordinate of one target in one pull.

    Attributes:
        pose: Pose number, shape (M,).
        repeat: Pull number within the pose, shape (M,).
        target: Name of the target, shape (M,).
        axis: 0, 1, 2 for x, y, z of F_b, shape (M,).
        pull: Index of the pull in `Pulls`, shape (M,).
    """

    pose: Ints
    repeat: Ints
    target: Strings
    axis: Ints
    pull: Ints

    def __len__(self) -> int:
        """Number of rows M."""
        return len(self.pose)


@dataclass(frozen=True, eq=False)
class Errors:
    """Every source of error of c, as independent unit errors e: the error of c is G e.

    Attributes:
        G: Sensitivity times standard uncertainty [m], sparse, shape (M, E).
        source: Source of each column: `tracker`, `zero`, `wander`, `force_reading`, `direction`,
            `registration`, `force_gain`, `force_zero`, `payload_mass`, `payload_center`, `geometry`
            and others, see `assemble.inputs`, shape (E,).
        common: True where one error acts on more than one pose (registration, gain, mass ...),
            (E,).
    """

    G: scipy.sparse.csr_array
    source: Strings
    common: Bools

    def beside(self, more: Errors) -> Errors:
        """These and further errors of the same rows."""
        return Errors(
            G=scipy.sparse.hstack([self.G, more.G], format="csr"),
            source=np.concatenate([self.source, more.source]),
            common=np.concatenate([self.common, more.common]),
        )


@dataclass(frozen=True, eq=False)
class System(Locked):
    """The linear system c = B x + G e, Eqs. (19), (20), in F_b, SI.

    Shapes: c (M,), B (M, k), x (k,), G (M, E), e (E,). E[e] = 0 and E[e e'] = I, so the covariance
    of c is V = G G' [m^2], shape (M, M).

    Attributes:
        parameters: Name and unit of each entry of x.
        rows: Identity of each row.
        B: Derivative of the displacements with respect to x, shape (M, k).
        c: Displacements loaded minus unloaded [m], shape (M,).
        errors: Sources of error of c and their sizes.
        noise_stated: False when the campaign states no noise of the tracker.
        found_m: Noise of one reading per axis that was estimated in its place [m]; None where it is
            stated or not yet estimated. In the latter case G's columns of tracker, zero and
            direction are relative to it; all others are in metres.
    """

    parameters: tuple[Parameter, ...]
    rows: RowIndex
    B: Array
    c: Array
    errors: Errors
    noise_stated: bool
    found_m: float | None = None

    def part(self, rows: Bools) -> System:
        """Some rows of the system, (M,)."""
        old, errors = self.rows, self.errors
        kept = RowIndex(
            old.pose[rows], old.repeat[rows], old.target[rows], old.axis[rows], old.pull[rows]
        )
        G = errors.G[np.flatnonzero(rows)]
        used = np.asarray(abs(G).sum(axis=0)).ravel() > 0
        few = Errors(G[:, used], errors.source[used], errors.common[used])
        return replace(self, rows=kept, B=self.B[rows], c=self.c[rows], errors=few)

    @property
    def of_pulls(self) -> System:
        """The part of the system whose rows belong to a pull: displacements alone."""
        mine = self.rows.pull >= 0
        return self if mine.all() else self.part(mine)

    @property
    def typical(self) -> Array:
        """Typical size of each parameter, shape (k,)."""
        return np.array([p.typical for p in self.parameters])

    @property
    def relative(self) -> bool:
        """Whether some columns of G are still relative to an unknown noise of the tracker."""
        return not self.noise_stated and self.found_m is None


@dataclass(frozen=True)
class Goodness:
    """Goodness of fit: weighted sum of squared residuals and its own p-value.

    Create it with its class methods only, each of which takes p from the very chi2 that it keeps.

    Attributes:
        chi2: Weighted sum of squared residuals with the noise in use, without weights of single
            readings.
        dof: Rows minus determined parameters.
        p_value: Probability of a chi2 this large or larger; None where no independent noise is
            known.
        tails: Whether the noise that chi2 is compared with has the tails that were found, not those
            stated.
    """

    chi2: float
    dof: int
    p_value: float | None
    tails: bool = False

    @classmethod
    def of(cls, chi2: float, dof: int) -> Goodness:
        """With a normal noise that is stated; p is 1 where no degrees of freedom are left."""
        return cls(chi2, dof, float(special.chdtrc(dof, chi2)) if dof > 0 else 1.0)

    @classmethod
    def untold(cls, chi2: float, dof: int) -> Goodness:
        """With a noise that is estimated from these residuals themselves: without p."""
        return cls(chi2, dof, None)

    @classmethod
    def beyond(cls, chi2: float, dof: int, part: tuple[float, int], nu: float) -> Goodness:
        """With a noise estimated from a part of the rows, with `nu` degrees of freedom.

        p is that of F = (chi2 - chi2_part) / (dof - dof_part); None where the part is the whole.
        """
        lack, more = max(chi2 - part[0], 0.0), dof - part[1]
        return cls(chi2, dof, float(special.fdtrc(more, nu, lack / more)) if more > 0 else None)

    @classmethod
    def among(cls, chi2: float, dof: int, drawn: Array) -> Goodness:
        """Relative to chi2 of simulated campaigns of nothing but the noise that was found, (d,).

        p is the fraction of these with at least this chi2. The scale is corrected for such noise:
        chi2 is multiplied so that the median of the simulated ones is that of chi-square.
        """
        p = float((1 + np.sum(drawn >= chi2)) / (1 + len(drawn)))
        middle = float(special.chdtri(dof, 0.5)) / float(np.median(drawn))
        return cls(chi2 * middle, dof, p, tails=True)


@dataclass(frozen=True, eq=False)
class Estimate(Locked):
    """Estimate of x with its uncertainty.

    Attributes:
        parameters: Name and unit of each entry of x.
        value: Best estimate, shape (k,).
        cov: Covariance of `value`, shape (k, k); infinite on the diagonal where undetermined.
        identifiable: True where the entry is known well enough to be reported, see
            `estimate.identifiable`, (k,).
        residual: c - B x [m], shape (M,).
        goodness: Goodness of fit.
        noise_from: `stated`, `replicates` or `residuals`.
        residual_std_m: Unweighted residual standard deviation, sqrt(r'r / dof) [m].
        quantile: Half width of a 95 % interval in standard deviations (normal or Student).
    """

    parameters: tuple[Parameter, ...]
    value: Array
    cov: Array
    identifiable: Bools
    residual: Array
    goodness: Goodness
    noise_from: str
    residual_std_m: float
    quantile: float

    @property
    def std(self) -> Array:
        """Standard uncertainty of `value`, shape (k,)."""
        return np.sqrt(np.diag(self.cov))

    @property
    def chi2(self) -> float:
        """Weighted sum of squared residuals, about `dof` if model and noise are correct."""
        return self.goodness.chi2

    @property
    def dof(self) -> int:
        """Rows minus determined parameters."""
        return self.goodness.dof

    @property
    def p_value(self) -> float | None:
        """Probability of a chi2 this large or larger; None when no noise is stated."""
        return self.goodness.p_value


@dataclass(frozen=True)
class ScatterRatio:
    """Scatter found over scatter stated.

    Attributes:
        tracker: Ratio for the tracker's readings.
        tracker_std: Its standard uncertainty.
        tracker_p: Probability of a ratio this large if the true one were `TOLERATED`.
        force: Ratio for the scale's readings, relative to the tracker's; 1 unless the data
            contradict it.
        force_std: Its standard uncertainty; 0 where it is not estimated.
        force_p: Probability of an excess this large by chance.
        known_from: `contrasts` that no model of the robot can produce, or `residuals`.
    """

    tracker: float
    tracker_std: float
    tracker_p: float
    force: float
    force_std: float
    force_p: float
    known_from: str

    @property
    def scale(self) -> float:
        """Scatter of the scale over its stated one; 1 unless contrasts contradict that."""
        told = self.force > 1 and self.known_from == "contrasts"
        return self.force * self.tracker if told else 1.0
