"""Result tables: what systems, estimates and residuals look like as Parquet."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.results import Estimate, System
from pipeline.stages.estimate import left_out
from pipeline.stages.whiten import whitener

AXES = np.array(["x", "y", "z"], dtype=object)


def rows_table(system: System) -> pd.DataFrame:
    """What each row of a system is."""
    rows = system.rows
    return pd.DataFrame(
        {
            "row": np.arange(len(rows)),
            "pose": rows.pose,
            "repeat": rows.repeat,
            "target": rows.target,
            "axis": AXES[rows.axis],
        }
    )


def system_table(system: System) -> pd.DataFrame:
    """Table `tables.system`."""
    columns = {f"B_{p.name}": system.B[:, k] for k, p in enumerate(system.parameters)}
    return rows_table(system).assign(c_m=system.c, **columns)


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


def residuals_table(system: System, estimate: Estimate) -> pd.DataFrame:
    """Table RESIDUALS; without stated noise, whitened by their own scatter."""
    white = whitener(system.errors, system.rows.pose)
    whitened = white(estimate.residual)
    if not system.noise_stated:
        whitened = whitened / np.sqrt(np.sum(whitened**2) / max(estimate.dof, 1))
    return rows_table(system).assign(
        residual_m=estimate.residual, whitened=whitened, left_out_m=left_out(system, white)
    )


def estimate_table(estimate: Estimate) -> pd.DataFrame:
    """Table ESTIMATE."""
    return pd.DataFrame(
        {
            "parameter": [p.name for p in estimate.parameters],
            "unit": [p.unit for p in estimate.parameters],
            "value": estimate.value,
            "std": estimate.std,
            "identifiable": estimate.identifiable,
        }
    )


def covariance_table(estimate: Estimate) -> pd.DataFrame:
    """Table `tables.covariance`."""
    names = [p.name for p in estimate.parameters]
    return pd.DataFrame(estimate.cov, columns=names).assign(parameter=names)
