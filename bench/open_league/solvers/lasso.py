"""LASSO over the catalogue's columns; the springs are not penalised.

min over x, z of  |y - B x - Z z|^2 / (2 M) + lambda |z|_1

with whitened rows and the columns of Z, once B is projected out of them, of unit length times
sqrt(M) (Tibshirani, J. R. Statist. Soc. B 58, 1996), by scikit-learn's coordinate descent
(Friedman, Hastie and Tibshirani, J. Statist. Software 33, 2010). lambda is the largest whose
cross-validation error over left-out poses is within one standard error of the smallest (Breiman et
al., Classification and Regression Trees, 1984). What is selected is estimated once more by least
squares (Belloni and Chernozhukov, Bernoulli 19, 2013); intervals ignore the selection, as is usual
in practice.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import lasso_path

from bench.open_league.solvers.answer import Json, answer
from bench.open_league.solvers.least_squares import ordinary
from bench.open_league.solvers.problem import Problem, Suspect
from pipeline.base.arrays import Array, Bools, Ints

PATH, SMALLEST = 60, 1e-2
"""Number of penalties, evenly spaced on a log scale, and the smallest relative to the largest."""

FOLDS = 8
"""Number of parts of the poses that are left out in turn."""

STILL, ROUNDS = 1e-4, 2000
"""Duality gap over y'y at which a descent ends, scikit-learn's default, and maximum number of
iterations."""

ALIKE = 1e-6
"""Norm of a column after projection of the springs, relative to the column, below which it is a
combination of theirs [1]."""


def solve(given: Problem) -> Json:
    """Causes with a selected column, and the springs estimated together with those columns."""
    W = given.root
    y, B, Z = W @ given.c, W @ given.B, W @ given.Z
    columns = _selected(y, B, Z, given.pose)
    x, cov, rest = ordinary(np.hstack([B, Z[:, columns]]), y)
    named: dict[str, Suspect] = {}
    for one in given.suspects:  # forms of one cause have one name
        if np.isin(one.columns, columns).any():
            named.setdefault(one.label, one)
    verdict = "explained" if named else "adequate"
    scale = max(rest / (len(y) - len(x)), 1.0)
    return answer(given, verdict, x, cov * scale, 0, list(named.values()), columns.tolist())


def _selected(y: Array, B: Array, Z: Array, pose: Ints) -> Ints:
    """Columns of Z with a coefficient at the penalty that cross-validation selects."""
    whole = _Path.of(y, B, Z)
    penalties = whole.largest * np.geomspace(1, SMALLEST, PATH)
    squares = np.zeros((PATH, FOLDS))
    for fold, out in enumerate(_folds(pose)):
        part = _Path.of(y[~out], B[~out], Z[~out])
        for k, z in enumerate(part.follow(penalties)):
            b = ordinary(B[~out], y[~out] - Z[~out] @ z)[0]
            squares[k, fold] = np.mean((y[out] - B[out] @ b - Z[out] @ z) ** 2)
    mean, se = squares.mean(axis=1), squares.std(axis=1, ddof=1) / np.sqrt(FOLDS)
    least = int(np.argmin(mean))
    chosen = int(np.argmax(mean <= mean[least] + se[least]))
    z = whole.follow(penalties[: chosen + 1])[-1]
    return _independent(B, Z, np.flatnonzero(z))


def _folds(pose: Ints) -> list[Bools]:
    """Rows of each part of the poses, every eighth pose in one."""
    of_pose = np.unique(pose, return_inverse=True)[1]
    return [np.asarray(of_pose % FOLDS == fold) for fold in range(FOLDS)]


def _independent(B: Array, Z: Array, columns: Ints) -> Ints:
    """The columns that are independent of the springs and of the previous columns."""
    kept: list[int] = []
    A = B / np.linalg.norm(B, axis=0)
    for k in columns.tolist():
        column = Z[:, k] / np.linalg.norm(Z[:, k])
        left = column - A @ np.linalg.lstsq(A, column, rcond=None)[0]
        if np.linalg.norm(left) > 1e-4:
            kept.append(k)
            A = np.column_stack([A, column])
    return np.array(kept, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class _Path:
    """The LASSO of some rows along decreasing penalties.

    Attributes:
        X: Z with the springs projected out, scaled, without dependent columns, shape (M, k).
        y: The observations with the springs projected out, shape (M,).
        scale: Factors from coefficients of X to those of Z, shape (k,).
        seen: Columns of Z that are in X, shape (k,).
        width: K.
    """

    X: Array
    y: Array
    scale: Array
    seen: Ints
    width: int

    @classmethod
    def of(cls, y: Array, B: Array, Z: Array) -> _Path:
        """Project out the springs."""
        Q = np.linalg.qr(B / np.linalg.norm(B, axis=0))[0]
        left = Z - Q @ (Q.T @ Z)
        size, whole = np.linalg.norm(left, axis=0), np.linalg.norm(Z, axis=0)
        seen = np.flatnonzero(size > ALIKE * np.maximum(whole, np.finfo(float).tiny))
        scale = np.sqrt(len(y)) / size[seen]
        return cls(left[:, seen] * scale, y - Q @ (Q.T @ y), scale, seen, Z.shape[1])

    @property
    def largest(self) -> float:
        """The smallest penalty at which nothing is selected."""
        return float(np.abs(self.X.T @ self.y).max() / len(self.y))

    def follow(self, penalties: Array) -> Array:
        """Coefficients of Z, unscaled, at each penalty, shape (penalties, K)."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # due to nearly collinear columns
            found = lasso_path(
                np.asfortranarray(self.X), self.y, alphas=penalties, tol=STILL, max_iter=ROUNDS
            )[1]
        z = np.zeros((len(penalties), self.width))
        z[:, self.seen] = found.T * self.scale
        return z
