"""An invented system with all kinds of errors, and textbook results on its whole matrices."""

import numpy as np
import scipy.sparse

from pipeline.base.arrays import Parameter
from pipeline.system.system import Errors, RowIndex, System

TYPICAL = np.array([1.3e-8, 3.0e-7, 2.0e-6])
"""Typical sizes of three parameters of different order of magnitude."""

X = np.array([1.25e-8, 2.6e-7, 2.1e-6])
"""Their true values."""

SHARED = ("force_gain", "registration")
"""Sources of error common to all poses."""


def made(rng, pulls=(3, 2, 4, 3), force_m=4e-5, scales=(1.0, 1.0), common=True):
    """Poses of unequal size with rows in any order: own noise, one zero a pose, one force a pull.

    Args:
        rng: Source of all that is drawn.
        pulls: Pulls of each pose, each of three rows.
        force_m: What a scale reading's standard uncertainty moves [m].
        scales: True scatter of tracker and scale over what is stated.
        common: Whether there are errors common to all poses.
    """
    pull = np.repeat(np.arange(sum(pulls)), 3)
    pose = np.repeat(np.arange(len(pulls)) * 3 + 1, pulls)[pull]
    M = len(pull)
    B = rng.normal(size=(M, 3)) * 3e-3 / TYPICAL
    own = np.diag(rng.uniform(2e-5, 5e-5, M))
    zero = (pose[:, None] == np.unique(pose)) * rng.uniform(2e-5, 4e-5, M)[:, None]
    force = (pull[:, None] == np.unique(pull)) * rng.normal(scale=force_m, size=M)[:, None]
    G = np.hstack([own, zero, force])
    source = ["tracker"] * M + ["zero"] * len(pulls) + ["force_reading"] * sum(pulls)
    if common:
        G = np.hstack([G, (B @ X * 2e-2)[:, None], 3e-5 * rng.normal(size=(M, 1))])
        source += SHARED
    is_force = np.array([one == "force_reading" for one in source])
    true = G * np.where(is_force, scales[1], scales[0])
    c = B @ X + true @ rng.standard_normal(G.shape[1])
    order = rng.permutation(M)
    fields = (pose, pull, np.full(M, "P1", object), np.arange(M) % 3, pull)
    return System(
        parameters=tuple(Parameter(f"c{k}", "m/N", t, 0.0) for k, t in enumerate(TYPICAL)),
        rows=RowIndex(*(field[order] for field in fields)),
        B=B[order],
        c=c[order],
        errors=Errors(
            scipy.sparse.csr_array(G[order]),
            np.array(source, object),
            np.isin(source, SHARED),
        ),
        noise_stated=True,
    )


def dense(system, scale=None, common=True):
    """V as one matrix; sources of error scaled as given, with or without the common ones."""
    G, errors = system.errors.G.toarray(), system.errors
    factor = np.array([(scale or {}).get(name, 1.0) for name in errors.source])
    G = G * factor * (~errors.common | common)
    return G @ G.T


def generalised(X, y, V):
    """b, its covariance and chi2 of generalised least squares, with V inverted directly."""
    W = np.linalg.inv(V)
    cov = np.linalg.inv(X.T @ W @ X)
    b = cov @ (X.T @ (W @ y))
    r = y - X @ b
    return b, cov, r @ W @ r


def restricted(X, y, V):
    """Minus twice the restricted log likelihood, without its constant."""
    W = np.linalg.inv(V)
    *_, chi2 = generalised(X, y, V)
    return np.linalg.slogdet(V)[1] + np.linalg.slogdet(X.T @ W @ X)[1] + chi2


def rss(columns, y):
    """Residual sum of squares of numpy's least squares."""
    left = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
    return left @ left


def twice(columns):
    """The columns, with a combination of the first two as a sixth."""
    return np.column_stack([columns, columns[:, 0] - 3 * columns[:, 1]])


def any_system(rng, n, rank):
    """Rows that depend on the parameters in a few directions only; all kinds of errors."""
    size = 10.0 ** rng.uniform(-8, -6, n)
    B = rng.standard_normal((40, rank)) @ rng.standard_normal((rank, n)) * 1e-3 / size
    pose = np.repeat(np.arange(8), 5)
    G = np.hstack([np.diag(rng.uniform(2e-5, 5e-5, 40)), 3e-5 * rng.standard_normal((40, 2))])
    source = np.array(["tracker"] * 40 + ["force_gain"] * 2, object)
    errors = Errors(scipy.sparse.csr_array(G), source, source == "force_gain")
    rows = RowIndex(pose, pose, np.full(40, "P1", object), np.arange(40) % 3, pose)
    named = tuple(Parameter(f"c{k}", "rad/(N m)", t) for k, t in enumerate(size))
    return System(named, rows, B, B @ size + G @ rng.standard_normal(42), errors, True)
