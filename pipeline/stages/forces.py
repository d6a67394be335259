"""Stage 3. Chain reflectors and spring-scale readings in, force vectors out: Eqs. (10), (11)."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline import covariance
from pipeline.settings import Scale, Settings
from pipeline.stages.register import XYZ

PULL = ["pose", "repeat"]
BRANCH = {"up": 1, "down": -1}


def forces(settings: Settings, placed: pd.DataFrame, loads: pd.DataFrame) -> pd.DataFrame:
    """Point each scale reading along its chain, u = (Pl2 - Pl1) / |Pl2 - Pl1|.

    The direction's covariance is that of the two reflectors across the chain,
    (I - u u') (C1 + C2) (I - u u') / L^2; relative to the tracker's variance, in 1/m^2, where
    no noise is stated.

    Args:
        settings: Names of the chain reflectors and the scale's uncertainty.
        placed: Table PLACED, F_b.
        loads: Table LOADS.

    Returns:
        Table FORCES, one row per pull that has both.
    """
    loaded = placed[placed["state"] == "loaded"]
    ends = [
        loaded[loaded["target"] == name].astype({"pose": int, "repeat": int}).set_index(PULL)
        for name in settings.naming.chain
    ]
    pulls = loads.set_index(PULL).sort_index()
    both = pulls.index.intersection(ends[0].index).intersection(ends[1].index)
    near, far, pulls = ends[0].loc[both], ends[1].loc[both], pulls.loc[both]
    chain = far[XYZ].to_numpy() - near[XYZ].to_numpy()
    length = np.linalg.norm(chain, axis=1, keepdims=True)
    u = chain / length
    across = np.eye(3) - u[:, :, None] * u[:, None, :]
    C = covariance.matrices(near) + covariance.matrices(far)
    if not covariance.stated(covariance.matrices(placed)):
        C = np.broadcast_to(2 * np.eye(3), C.shape)
    direction = across @ C @ across / length[..., None] ** 2
    reading = pulls["force_n"].to_numpy()
    force = reading[:, None] * u
    return pd.DataFrame(
        {
            **{name: both.get_level_values(name) for name in PULL},
            **dict(zip(["fx_n", "fy_n", "fz_n"], force.T, strict=True)),
            "reading_std_n": reading_std(settings.scale or Scale(), reading),
            **dict(zip(covariance.columns("u", ""), covariance.flat(direction).T, strict=True)),
            "branch": pulls["branch"].map(BRANCH).fillna(0).astype(int).to_numpy(),
            "time_s": _seconds(loaded, settings.measured).reindex(both).to_numpy(),
        }
    )


def reading_std(scale: Scale, reading: np.ndarray) -> np.ndarray:
    """Standard uncertainty of scale readings [N]: constant and relative parts, independent."""
    return np.hypot(scale.sigma_n, scale.sigma_rel * reading)


def _seconds(loaded: pd.DataFrame, measured: list[str]) -> pd.Series:
    rows = loaded[loaded["target"].isin(measured)].astype({"pose": int, "repeat": int})
    return rows.groupby(PULL)["time_s"].mean()
