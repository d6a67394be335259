"""A common next step: residuals of DH least squares, learned from the joint values alone.

A Gaussian process of scikit-learn with one length per joint, its hyperparameters by likelihood.
"""

import sys
import warnings
from pathlib import Path

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

from bench.peers import arm as arms
from bench.peers import dh

ENOUGH = 800
"""Poses, evenly spaced, from which hyperparameters are taken: the time grows with their cube."""


def learned(q: np.ndarray, off: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Expected residuals at other joint values [m], shape (k, 3).

    Args:
        q: Joint values for training [rad], shape (m, n).
        off: Residuals there [m], shape (m, 3).
        there: Joint values [rad], shape (k, n).
    """
    size = off.std()
    curve = Matern(np.ones(q.shape[1]), (1e-2, 1e3), nu=1.5)
    noise = WhiteKernel(0.3, (1e-3, 1e1))
    process = GaussianProcessRegressor(ConstantKernel(1.0) * curve + noise, random_state=0)
    some = np.linspace(0, len(q) - 1, min(len(q), ENOUGH)).round().astype(int)
    with warnings.catch_warnings():  # a length at its bound is a joint that tells nothing
        warnings.simplefilter("ignore", ConvergenceWarning)
        process.fit(q[some], off[some] / size)
    all_of_them = GaussianProcessRegressor(process.kernel_, optimizer=None)
    return all_of_them.fit(q, off / size).predict(there) * size


def main(robot: str, folder: str) -> None:
    """Calibrate and learn with train.csv, and predict test.csv of a folder."""
    arm, here = arms.read(Path(robot)), Path(folder)
    q, seen = dh.columns(here / "train.csv", arm)
    there, _ = dh.columns(here / "test.csv", arm)
    x = dh.calibrated(arm, q, seen)
    more = learned(q, seen - dh.told(arm, x, q), there)
    np.savetxt(here / "learned.csv", dh.told(arm, x, there) + more, delimiter=",")


if __name__ == "__main__":
    main(*sys.argv[1:])
