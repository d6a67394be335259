"""Summaries of tables that captions and drawings share, so that texts and figures agree."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.base.arrays import Array
from pipeline.base.linear import rms
from pipeline.base.quantities import MM
from pipeline.diagnosis.facts import DETECTED
from pipeline.report.summaries import Tables, has

MOST_MARKS = 2000
"""Maximum number of marks in a figure; of more, the largest and an even selection of the others are
drawn."""

AXES = ["dx_m", "dy_m", "dz_m"]


def _rms(values: pd.Series[float]) -> float:
    """Root mean square of the finite values; NaN without any."""
    numbers = np.asarray(values, dtype=float)
    known = numbers[np.isfinite(numbers)]
    return rms(known) if len(known) else float("nan")


def rms_of_poses(table: pd.DataFrame, **columns: str) -> pd.DataFrame:
    """Rms per pose [mm]: pose, and under each given name the rms of a column [m]."""
    mm = table.assign(**{name: MM * table[column] for name, column in columns.items()})
    by_pose: pd.DataFrame = mm.groupby("pose")[list(columns)].agg(_rms)
    return by_pose.reset_index()


def pose_rms(residuals: pd.DataFrame) -> pd.DataFrame:
    """Rms residual of each pose [mm]: pose, fitted, left_out."""
    return rms_of_poses(residuals, fitted="residual_m", left_out="left_out_m")


def residual_force(tables: Tables) -> pd.DataFrame:
    """Residuals [mm] with the force of their pull [N]: pose, repeat, target, axis, force_n, mm."""
    residuals, forces = tables["residuals"], tables["forces"]
    size = np.linalg.norm(forces[["fx_n", "fy_n", "fz_n"]].to_numpy(float), axis=1)
    joined = residuals.merge(
        forces[["pose", "repeat"]].assign(force_n=size), on=["pose", "repeat"], how="inner"
    )
    joined["mm"] = MM * joined["residual_m"]
    return finite(joined, "mm")


@dataclass(frozen=True)
class _ResidualVariable:
    """A variable over which residuals are examined.

    Attributes:
        column: Column of the rows.
        name: Name in words.
        unit: Unit.
        explained: Share of the residuals' sum of squares explained by their means in six classes of
            the variable, separately for each axis of F_b [1].
        by_chance: Expected value of this share for pure noise [1].
    """

    column: str
    name: str
    unit: str
    explained: float
    by_chance: float


def courses(
    tables: Tables, axes: Mapping[int, str]
) -> tuple[pd.DataFrame, list[_ResidualVariable]]:
    """Residuals [mm] with rail position, torque and time, as far as the campaign has them.

    The torque is that of the joint of the suspect with the most evidence among those in a joint.

    Args:
        tables: Tables of the report.
        axes: The controller's names of the joints, by number.

    Returns:
        Rows with `mm` (joint springs) and `mm_extended` (with the identified causes), and the
        variables over which to examine them.
    """
    rows = tables["examined"].assign(
        mm=lambda t: MM * t["residual_m"], mm_extended=lambda t: MM * t["residual_extended_m"]
    )
    rail = [c for c in rows.columns if c.endswith("_m") and f"tau_{c[:-2]}" in rows.columns]
    joints = [c for c in rows.columns if c.startswith("tau_")]
    called = {c: _called(c[4:], axes.get(number)) for number, c in enumerate(joints, 1)}
    against = [(c, f"position of {called[f'tau_{c[:-2]}']}", "m") for c in rail]
    number = _suspected(tables)
    if 0 < number <= len(joints):
        name = joints[number - 1]
        against.append((name, f"torque about {called[name]}", "N m"))
    against.append(("time_s", "time", "s"))
    items = [_course(rows, *one) for one in against if one[0] in rows and _varies(rows[one[0]])]
    return rows, items


def _suspected(tables: Tables) -> int:
    """Number of the joint of the suspect with the most evidence among those in a joint, or 0."""
    known = suspects(tables["diagnosis"], 60) if has(tables, "diagnosis") else pd.DataFrame()
    best = known.get("where", pd.Series(dtype=str)).astype(str)
    return next((int(where) for where in best if where.isdigit()), 0)


def _called(joint: str, axis: str | None) -> str:
    """`A1 (theta2)`."""
    return f"{axis} ({joint})" if axis else joint


def _varies(values: pd.Series[float]) -> bool:
    return values[np.isfinite(values)].nunique() > 3


def _course(rows: pd.DataFrame, column: str, name: str, unit: str) -> _ResidualVariable:
    known = finite(rows, column, "mm")
    step = pd.qcut(known[column].rank(method="first"), 6, labels=False)
    mean = known.groupby([step, "axis"])["mm"].transform("mean").to_numpy(float)
    squares = float(np.sum(known["mm"].to_numpy(float) ** 2))
    return _ResidualVariable(
        column, name, unit, float(np.sum(mean**2)) / max(squares, 1e-300), 18 / len(known)
    )


def thinned(table: pd.DataFrame, size: Array, most: int = MOST_MARKS) -> pd.DataFrame:
    """At most `most` rows in order: a third are the largest, the others selected evenly.

    Args:
        table: The rows.
        size: Size of each row, of which the absolute value counts, shape (n,).
        most: Maximum number of rows.
    """
    if len(table) <= most:
        return table
    order = np.argsort(-np.abs(size), kind="stable")
    largest, rest = order[: most // 3], np.sort(order[most // 3 :])
    even = rest[np.linspace(0, len(rest) - 1, most - len(largest)).astype(int)]
    return table.iloc[np.sort(np.concatenate([largest, even]))].reset_index(drop=True)


def finite(table: pd.DataFrame, *columns: str) -> pd.DataFrame:
    """The rows in which all these columns are finite."""
    keep = np.isfinite(table[list(columns)].to_numpy(float)).all(axis=1)
    return table.iloc[np.flatnonzero(keep)].reset_index(drop=True)


def whitened(residuals: pd.DataFrame) -> Array:
    """Finite whitened residuals, in standard deviations, shape (M,)."""
    return finite(residuals, "whitened")["whitened"].to_numpy(float)


def _places(tables: Tables) -> pd.DataFrame:
    """Positions of the reflectors in F_b [m]: pose, repeat, target, x, y, z; measured or nominal.

    They are nominal if a campaign consists of displacements, without measured positions.
    """
    measured = tables["displacements"].rename(columns={f"zero_{a}_m": a for a in "xyz"})
    if has(tables, "examined") and not np.isfinite(measured["x"].to_numpy(float)).any():
        return tables["examined"].rename(columns={f"{a}_m": a for a in "xyz"})
    return measured


def suspects(diagnosis: pd.DataFrame, most: int = 12) -> pd.DataFrame:
    """The suspects with the most evidence, best first: name, where, log_evidence, named."""
    known = finite(diagnosis, "log_evidence")
    return known.sort_values("log_evidence", ascending=False, kind="stable").head(most)


def separability(table: pd.DataFrame, identified: Collection[str] = ()) -> pd.DataFrame:
    """Distances in standard deviations between causes that are detectable or identified.

    A cause is detectable if its typical magnitude is at least `DETECTED` standard deviations.

    Args:
        table: Table SEPARABILITY.
        identified: Labels of the causes that the answer names.

    Returns:
        Matrix with labels in the order of the catalogue. On the diagonal: significance of the cause
        in addition to the joint springs; elsewhere: the smaller misfit that either cause leaves if
        the other is fitted in its place. Magnitudes are typical, except for pairs with an
        identified cause, which has the magnitude found. `attrs["found"]` lists the labels of these.
    """
    wide = table.pivot_table(index="cause", columns="rival", values="sigmas", sort=False)
    labels = list(dict.fromkeys(table["cause"]))
    sigmas = wide.loc[labels, labels].to_numpy(float)
    found = _found(table, labels)
    sigmas = np.where(np.isfinite(found), found, np.minimum(sigmas, sigmas.T))
    named = np.isfinite(found).any(axis=1) & np.isin(labels, list(identified))
    shown = np.flatnonzero((np.diagonal(sigmas) >= DETECTED) | named)
    names = [labels[i] for i in shown]
    out = pd.DataFrame(sigmas[np.ix_(shown, shown)], index=names, columns=names)
    out.attrs["found"] = [labels[i] for i in np.flatnonzero(named)]
    return out


def _found(table: pd.DataFrame, labels: list[str]) -> Array:
    """Distances at the magnitudes found [standard deviations], NaN where none is identified."""
    if "sigmas_found" not in table:
        return np.full((len(labels), len(labels)), np.nan)
    wide = table.pivot_table(
        index="cause", columns="rival", values="sigmas_found", sort=False, dropna=False
    )
    return wide.reindex(index=labels, columns=labels).to_numpy(float)


def arrows(tables: Tables) -> pd.DataFrame:
    """Residual vector of every reflector under the strongest pull of each pose.

    Returns:
        pose, repeat, target, x, y, z (unloaded position in F_b [m]), rx, ry, rz [mm]; reflectors
        with unknown positions are omitted.
    """
    sized = residual_force(tables)
    strongest = sized.loc[sized.groupby("pose")["force_n"].idxmax(), ["pose", "repeat"]]
    vectors = (
        sized.merge(strongest, on=["pose", "repeat"])
        .pivot_table(index=["pose", "repeat", "target"], columns="axis", values="mm")
        .reindex(columns=["x", "y", "z"])
        .set_axis(["rx", "ry", "rz"], axis=1)
        .reset_index()
    )
    key = ["pose", "repeat", "target"]
    placed = vectors.merge(_places(tables).drop_duplicates(key)[[*key, *"xyz"]], on=key)
    return finite(placed, *"xyz", "rx", "ry", "rz")


def registration_by_target(registration: pd.DataFrame) -> pd.DataFrame:
    """Per base reflector: target, readings, mean dx, dy, dz, rms and largest distance [mm]."""
    mm = MM * registration.set_index("target")[AXES].set_axis(["dx", "dy", "dz"], axis=1)
    mm["distance"] = np.linalg.norm(mm, axis=1)
    groups = mm.groupby(level="target")
    out = groups[["dx", "dy", "dz"]].mean().assign(rms=groups["distance"].agg(_rms))
    out.insert(0, "readings", groups.size())
    return out.assign(largest=groups["distance"].max()).reset_index()


def prediction_error(validation: pd.DataFrame) -> dict[tuple[str, str], Array]:
    """Relative prediction errors of Eq. (22), as means over targets, sorted over validation poses.

    The keys are the set of poses and the distribution from which stiffnesses are drawn.
    """
    per_pose = validation.groupby(["set", "draw", "index"])["mu"].mean()
    drawn = validation[["set", "draw"]].drop_duplicates().itertuples(index=False, name=None)
    pairs = sorted(drawn, key=lambda pair: (pair[1], pair[0] == "global"))
    return {(str(s), str(d)): np.sort(per_pose.loc[s, d].to_numpy(float)) for s, d in pairs}
