"""Stage 4. Placed readings in, loaded minus unloaded out; the pulls of a pose share its zero."""

from __future__ import annotations

import pandas as pd

from pipeline import covariance
from pipeline.settings import Settings
from pipeline.stages.register import XYZ

POSE_TARGET = ["pose", "target"]


def displacements(settings: Settings, placed: pd.DataFrame) -> pd.DataFrame:
    """Subtract from every loaded reading the mean of its pose's unloaded readings.

    Zeros before and after the pulls weigh alike, so that a drift linear in time cancels at
    mid-time; the zero's covariance is that of the mean.

    Args:
        settings: Names of the measured targets.
        placed: Table PLACED, F_b.

    Returns:
        Table DISPLACEMENTS, sorted by pose, repeat and order of the targets.
    """
    measured = settings.measured
    rows = placed[placed["target"].isin(measured)].astype({"pose": int, "repeat": int})
    zero = _zero(rows[rows["state"] == "unloaded"])
    loaded = rows[rows["state"] == "loaded"].join(zero, on=POSE_TARGET, how="inner")
    order = loaded["target"].map({name: i for i, name in enumerate(measured)})
    loaded = loaded.assign(order=order).sort_values(["pose", "repeat", "order"])
    return pd.DataFrame(
        {
            **{name: loaded[name] for name in ("pose", "repeat", "target")},
            **{f"d{axis[0]}_m": loaded[axis] - loaded[f"zero_{axis}"] for axis in XYZ},
            **{f"loaded_{name}": loaded[name] for name in covariance.columns()},
            **{f"zero_{name}": loaded[f"zero_{name}"] for name in [*covariance.columns(), *XYZ]},
            "zero_count": loaded["zero_count"].astype(int),
            "zero_time_s": loaded["zero_time_s"],
        }
    ).reset_index(drop=True)


def _zero(unloaded: pd.DataFrame) -> pd.DataFrame:
    groups = unloaded.groupby(POSE_TARGET)
    count = groups.size()
    mean = groups[XYZ].mean().add_prefix("zero_")
    cov = groups[covariance.columns()].sum(min_count=1).div(count**2, axis=0).add_prefix("zero_")
    time = groups["time_s"].mean().rename("zero_time_s")
    return pd.concat([mean, cov, count.rename("zero_count"), time], axis=1)
