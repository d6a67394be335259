"""The linear system c = B x + G e, and what is known of its solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse

from pipeline.base.arrays import Array, Bools, Ints, Locked, Parameter, Strings

SOFT = 1e-4
"""How unlikely it must be that the reflectors only seem to move against each other."""


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

    @property
    def typical(self) -> Array:
        """Typical size of each parameter, shape (k,)."""
        return np.array([p.typical for p in self.parameters])

    @property
    def relative(self) -> bool:
        """Whether a part of G still waits for the noise of the tracker."""
        return not self.noise_stated and self.found_m is None


@dataclass(frozen=True, eq=False)
class Estimate(Locked):
    """What the data say about x.

    Attributes:
        parameters: Name and unit of each entry of x.
        value: Best estimate, shape (k,).
        cov: Covariance of `value`, shape (k, k); infinite on the diagonal where undetermined.
        identifiable: True where the data determine the entry to better than its typical size, (k,).
        residual: c - B x [m], shape (M,).
        chi2: Weighted sum of squared residuals; about `dof` if the model is true, or if the noise
            of the tracker is found from these residuals.
        dof: Rows minus determined parameters.
        p_value: Probability of a chi2 this large or larger; None when no noise is stated.
        noise_from: `stated`, `replicates` or `residuals`.
        residual_std_m: Unweighted residual standard deviation, sqrt(r'r / dof) [m].
        quantile: Half width of a 95 % interval in standard deviations (normal or Student).
    """

    parameters: tuple[Parameter, ...]
    value: Array
    cov: Array
    identifiable: Bools
    residual: Array
    chi2: float
    dof: int
    p_value: float | None
    noise_from: str
    residual_std_m: float
    quantile: float

    @property
    def std(self) -> Array:
        """Standard uncertainty of `value`, shape (k,)."""
        return np.sqrt(np.diag(self.cov))


@dataclass(frozen=True)
class Scatter:
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
