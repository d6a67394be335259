"""The linear system c = B x + G e, and what is known of its solution."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse
from scipy import special

from pipeline.base.arrays import Array, Bools, Ints, Locked, Parameter, Strings


@dataclass(frozen=True, eq=False)
class Rows(Locked):
    """What each row of c and B is: one coordinate of one target in one pull.

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
            `registration`, `force_gain`, `force_zero`, `payload_mass`, `payload_center`,
            `geometry`, shape (E,).
        common: True where one error moves more than one pose (registration, gain, mass ...), (E,).
    """

    G: scipy.sparse.csr_array
    source: Strings
    common: Bools


@dataclass(frozen=True, eq=False)
class System(Locked):
    """The linear system c = B x + G e, Eqs. (19), (20), in F_b, SI.

    Shapes: c (M,), B (M, k), x (k,), G (M, E), e (E,). E[e] = 0 and E[e e'] = I, so the covariance
    of c is V = G G' [m^2], shape (M, M).

    Attributes:
        parameters: Name and unit of each entry of x.
        rows: What each row is.
        B: Derivative of the displacements by x, shape (M, k).
        c: Displacements loaded minus unloaded [m], shape (M,).
        errors: Where c may be wrong and by how much.
        noise_stated: False when the campaign states no noise of the tracker.
        found_m: What of it was found in its place, per axis of one reading [m]; None where it is
            stated, and where it is not yet found: then G's columns of tracker, zero and direction
            are relative to it, and the others are in metres.
    """

    parameters: tuple[Parameter, ...]
    rows: Rows
    B: Array
    c: Array
    errors: Errors
    noise_stated: bool
    found_m: float | None = None

    def part(self, rows: Bools) -> System:
        """Some rows of the system, (M,)."""
        old, errors = self.rows, self.errors
        kept = Rows(
            old.pose[rows], old.repeat[rows], old.target[rows], old.axis[rows], old.pull[rows]
        )
        G = errors.G[np.flatnonzero(rows)]
        used = np.asarray(abs(G).sum(axis=0)).ravel() > 0
        few = Errors(G[:, used], errors.source[used], errors.common[used])
        return replace(self, rows=kept, B=self.B[rows], c=self.c[rows], errors=few)

    @property
    def of_pulls(self) -> System:
        """The rows of displacements alone."""
        mine = self.rows.pull >= 0
        return self if mine.all() else self.part(mine)

    @property
    def typical(self) -> Array:
        """Typical size of each parameter, shape (k,)."""
        return np.array([p.typical for p in self.parameters])

    @property
    def relative(self) -> bool:
        """Whether a part of G still waits for the noise of the tracker."""
        return not self.noise_stated and self.found_m is None


@dataclass(frozen=True)
class Goodness:
    """What a model leaves and how likely chance leaves as much: one sum of squares and its own p.

    It is made by its class methods only, each of which takes p from the very chi2 that it keeps.

    Attributes:
        chi2: Weighted sum of squared residuals in the noise that is used, every reading alike.
        dof: Rows minus determined parameters.
        p_value: Probability of a chi2 this large or larger; None where no noise is known beside it.
        tails: The noise beside which it stands has the tails that were found, not those stated.
    """

    chi2: float
    dof: int
    p_value: float | None
    tails: bool = False

    @classmethod
    def of(cls, chi2: float, dof: int) -> Goodness:
        """In a normal noise that is stated; p is 1 where nothing is left that could be a misfit."""
        return cls(chi2, dof, float(special.chdtrc(dof, chi2)) if dof > 0 else 1.0)

    @classmethod
    def untold(cls, chi2: float, dof: int) -> Goodness:
        """In a noise that these residuals tell themselves."""
        return cls(chi2, dof, None)

    @classmethod
    def beyond(cls, chi2: float, dof: int, part: tuple[float, int], nu: float) -> Goodness:
        """In a noise that a part of the rows tells, known with `nu` degrees of freedom.

        p is that of F = (chi2 - chi2_part) / (dof - dof_part); None where the part is the whole.
        """
        lack, more = max(chi2 - part[0], 0.0), dof - part[1]
        return cls(chi2, dof, float(special.fdtrc(more, nu, lack / more)) if more > 0 else None)

    @classmethod
    def among(cls, chi2: float, dof: int, drawn: Array) -> Goodness:
        """Among the chi2 of campaigns of nothing but the noise that was found, shape (d,).

        p is the share of them that leaves as much. What such noise does to the scale of chi2 is
        taken off: half of the campaigns then stay below the median of chi-square.
        """
        p = float((1 + np.sum(drawn >= chi2)) / (1 + len(drawn)))
        middle = float(special.chdtri(dof, 0.5)) / float(np.median(drawn))
        return cls(chi2 * middle, dof, p, tails=True)


@dataclass(frozen=True, eq=False)
class Estimate(Locked):
    """What the data say about x.

    Attributes:
        parameters: Name and unit of each entry of x.
        value: Best estimate, shape (k,).
        cov: Covariance of `value`, shape (k, k); infinite on the diagonal where undetermined.
        identifiable: True where the data determine the entry to better than its typical size, (k,).
        residual: c - B x [m], shape (M,).
        goodness: What of the residuals chance explains.
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
        """Weighted sum of squared residuals, about `dof` if model and noise are true."""
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
        tracker: Of the tracker's readings.
        tracker_std: Its standard uncertainty.
        tracker_p: Probability of so much if it were `TOLERATED` at most.
        force: Of the scale's readings, relative to the tracker's; 1 unless the data say otherwise.
        force_std: Its standard uncertainty; 0 where it is not looked at.
        force_p: Probability of so much more by chance.
        known_from: `contrasts` that no model of the robot can make, or `residuals`.
    """

    tracker: float
    tracker_std: float
    tracker_p: float
    force: float
    force_std: float
    force_p: float
    known_from: str
