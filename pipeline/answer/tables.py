"""Result tables: systems, estimates and residuals as kept in Parquet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array, Parameter
from pipeline.diagnosis.average import Springs
from pipeline.system.system import Estimate, System
from pipeline.system.whiten import whitener

_AXES = np.array(["x", "y", "z"], dtype=object)


def _rows_table(system: System) -> pd.DataFrame:
    """Number, pose, repeat, target and axis of each row of a system."""
    rows = system.rows
    return pd.DataFrame(
        {
            "row": np.arange(len(rows)),
            "pose": rows.pose,
            "repeat": rows.repeat,
            "target": rows.target,
            "axis": _AXES[rows.axis],
        }
    )


def system_table(system: System) -> pd.DataFrame:
    """Table `tables.system`."""
    columns = {f"B_{p.name}": system.B[:, k] for k, p in enumerate(system.parameters)}
    return _rows_table(system).assign(c_m=system.c, **columns)


def errors_table(system: System) -> pd.DataFrame:
    """Table ERRORS."""
    G = system.errors.G.tocoo()
    return pd.DataFrame(
        {
            "error": G.col,
            "source": system.errors.source[G.col],
            "common": system.errors.common[G.col],
            "row": G.row,
            "value_m": G.data,
        }
    )


def residuals_table(system: System, estimate: Estimate, left_out_m: Array) -> pd.DataFrame:
    """Table RESIDUALS; without stated noise, the residuals are whitened by their own scatter.

    Args:
        system: The system.
        estimate: Its solution.
        left_out_m: Residuals of each pose when it is left out of the estimate [m], shape (M,).
    """
    whitened = whitener(system.errors, system.rows.pose)(estimate.residual)
    if not system.noise_stated:
        whitened = whitened / np.sqrt(np.sum(whitened**2) / max(estimate.dof, 1))
    return _rows_table(system).assign(
        residual_m=estimate.residual, whitened=whitened, left_out_m=left_out_m
    )


def models_table(springs: System, paper: Estimate, residual: Array, nominal: Array) -> pd.DataFrame:
    """Table MODELS.

    Args:
        springs: The system of the joint springs.
        paper: Its solution.
        residual: Residuals of the recommended model [m], shape (M,).
        nominal: Compliances of the robot file, NaN where it states none, shape (n,).
    """
    return _rows_table(springs).assign(
        measured_m=springs.c,
        nominal_m=springs.B @ nominal,
        joint_springs_m=springs.c - paper.residual,
        recommended_m=springs.c - residual,
    )


def estimate_table(names: Sequence[Parameter], found: Estimate | Springs) -> pd.DataFrame:
    """Table ESTIMATE."""
    return pd.DataFrame(
        {
            "parameter": [p.name for p in names],
            "unit": [p.unit for p in names],
            "value": found.value,
            "std": found.std,
            "identifiable": found.identifiable,
        }
    )


def covariance_table(names: Sequence[Parameter], cov: Array) -> pd.DataFrame:
    """Table `tables.covariance`."""
    named = [p.name for p in names]
    return pd.DataFrame(cov, columns=named).assign(parameter=named)
