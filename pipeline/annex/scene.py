"""Tables of the picture of the cell: bodies, poses, and vectors of the reflectors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pipeline.annex import bodies, promises
from pipeline.annex.bodies import Bodies
from pipeline.annex.posture import TOOL_RADIUS
from pipeline.answer.recommended import ModelValues
from pipeline.base.arrays import Array, Bools, Ints
from pipeline.base.covariance import PAIRS, PLACES
from pipeline.machine.cell import Cell, Tool, load
from pipeline.machine.robot import Configuration, Robot, configure
from pipeline.reduction.measured import Measured
from pipeline.reduction.settings import Settings

if TYPE_CHECKING:
    from pipeline.positions.study import Study

MOST_POSES = 40
"""Maximum number of poses in the picture; of more, those with the largest residuals and an even
selection of the others are drawn."""

_Tables = dict[str, pd.DataFrame]


def scene(values: ModelValues) -> _Tables:
    """Tables SCENE, POSES and VECTORS of a campaign of pulls."""
    case, data = values.fitted.case, values.fitted.data
    first = np.unique(data.pulls.pose, return_index=True)[1]
    vectors = _displaced(values)
    shown = _chosen(data.pulls.pose[first], vectors)
    first = first[np.isin(data.pulls.pose[first], shown)]
    here = configure(case.robot, data.pulls.q[first])
    standing = _points(case.settings, values.fitted.reduced.registration.t)
    return {
        "scene": _bodies(case.robot, here, case.tool, data.pulls.pose[first], standing),
        "poses": _poses_pulled(values, shown),
        "vectors": vectors[vectors["pose"].isin(shown)].reset_index(drop=True),
    }


def _points(settings: Settings, tracker: Array) -> list[Bodies]:
    """Tracker and base reflectors whose positions in F_b are known."""
    fixed = {name: np.array(at) for name, at in settings.base_frame.items()}
    at = {"tracker": tracker} if fixed else {}
    if not fixed and settings.cell is not None and settings.cell.tracker_m is not None:
        at = {"tracker": np.array(settings.cell.tracker_m)}
    return [bodies.points(bodies.TRACKER, at), bodies.points(bodies.REFLECTOR, fixed)]


def _chosen(poses: Ints, vectors: pd.DataFrame) -> Ints:
    """At most `MOST_POSES` poses: a third with the largest residuals, the others evenly."""
    if len(poses) <= MOST_POSES:
        return poses
    size = np.linalg.norm(vectors[_xyz("left_{}_m")].to_numpy(float), axis=1)
    worst = vectors.assign(size=size).groupby("pose")["size"].max().nlargest(MOST_POSES // 3)
    rest = np.setdiff1d(poses, worst.index.to_numpy())
    even = rest[np.linspace(0, len(rest) - 1, MOST_POSES - len(worst)).astype(int)]
    return np.sort(np.concatenate([worst.index.to_numpy(np.int64), even]))


def _bodies(
    robot: Robot, here: Configuration, tool: Tool, poses: Ints, standing: Sequence[Bodies]
) -> pd.DataFrame:
    """Table SCENE."""
    base, carriage, arm = bodies.links(robot, here)
    thick = TOOL_RADIUS * (float(arm.radius[-1]) if len(arm.radius) else 0.05)
    still = [_rows(one, np.zeros(1, np.int64)) for one in (base, *standing) if len(one.names)]
    moving = [_rows(one, poses) for one in (carriage, arm, bodies.effector(here, tool, thick))]
    return pd.concat([*still, *moving], ignore_index=True)


def _rows(one: Bodies, poses: Ints) -> pd.DataFrame:
    """One row per capsule and pose."""
    m, c = len(poses), len(one.names)
    ends = one.ends[:m].reshape(m * c, 6)
    columns = [*_xyz("from_{}_m"), *_xyz("to_{}_m")]
    return pd.DataFrame(ends, columns=columns).assign(
        pose=np.repeat(poses, c),
        part=one.part,
        name=np.tile(one.names, m),
        radius_m=np.tile(one.radius, m),
    )


def _xyz(name: str) -> list[str]:
    return [name.format(axis) for axis in "xyz"]


# --- pulls ----------------------------------------------------------------------------------------


def _displaced(values: ModelValues) -> pd.DataFrame:
    """Table VECTORS of all poses, each under its largest load."""
    data, left = values.fitted.data, values.first.estimate.residual.reshape(-1, 3)
    size = np.linalg.norm(data.pulls.force, axis=1)
    kept = np.flatnonzero(_strongest(data.pulls.pose, size)[data.pull] & data.shifts)
    moved, cov = data.delta[kept], (data.loaded_cov + data.zero_cov)[kept]
    if not data.noise_stated and data.found_m is None:
        cov = np.full_like(cov, np.nan)
    parts = {
        "pose": data.pulls.pose[data.pull[kept]],
        "target": data.name[kept],
        **_spread("{}_m", _places(values.fitted.case.cell, data)[kept]),
        **_spread("moved_{}_m", moved),
        **_spread("left_{}_m", left[kept]),
        **{f"c{ab}_m2": cov[:, i, j] for ab, (i, j) in zip(PAIRS, PLACES, strict=True)},
    }
    return pd.DataFrame(parts)


def _strongest(pose: Ints, size: Array) -> Bools:
    """Whether each pull is the strongest of its pose, shape (m,)."""
    order = np.lexsort((-size, pose))
    first = np.unique(pose[order], return_index=True)[1]
    out = np.zeros(len(pose), dtype=bool)
    out[order[first]] = True
    return out


def _places(cell: Cell, data: Measured) -> Array:
    """Unloaded position of each target in F_b [m], as measured or else nominal, shape (d, 3)."""
    loaded = load(cell, data.pulls, np.zeros(len(cell.parameters)))
    of = loaded.points.mean(axis=1)[data.pull] if data.poses else None
    nominal = loaded.points[data.pull, data.target] if of is None else of
    return np.where(np.isfinite(data.unloaded), data.unloaded, nominal)


def _spread(name: str, vectors: Array) -> dict[str, Array]:
    return {name.format(axis): column for axis, column in zip("xyz", vectors.T, strict=True)}


def _poses_pulled(values: ModelValues, shown: Ints) -> pd.DataFrame:
    """Table POSES."""
    case, pulls = values.fitted.case, values.fitted.data.pulls
    size = np.linalg.norm(pulls.force, axis=1)
    read = _lines(case.readings)
    logged = case.joints.set_index("pose")
    given = case.settings.displacements
    reduced: dict[str, Any] = {"file": given.file if given else "", **_NO_LINES}
    rows = [
        {
            "pose": pose,
            "label": f"Pose {pose}",
            **read.get(pose, reduced),
            "joints_file": str(logged.loc[pose, "file"]),
            "joints_line": logged.loc[pose, "line"],
            "pulls": int(np.sum(pulls.pose == pose)),
            "force_n": float(size[pulls.pose == pose].max()),
        }
        for pose in shown.tolist()
    ]
    return _typed(rows)


_NO_LINES: dict[str, Any] = {"first_line": None, "last_line": None}


def _lines(readings: pd.DataFrame) -> dict[int, dict[str, Any]]:
    """File, first and last line of the readings of each pose; of several files, the first."""
    mine = readings.dropna(subset=["pose"]).astype({"pose": "int64"})
    return {
        int(str(pose)): {
            "file": str(one["file"].iloc[0]),
            "first_line": int(one["line"][one["file"] == one["file"].iloc[0]].min()),
            "last_line": int(one["line"][one["file"] == one["file"].iloc[0]].max()),
        }
        for pose, one in mine.groupby("pose")
    }


def _typed(rows: Sequence[dict[str, Any]]) -> pd.DataFrame:
    lines = dict.fromkeys(("first_line", "last_line", "joints_line"), "Int64")
    return pd.DataFrame(rows, columns=promises.POSES.names).astype(lines)


# --- positions ------------------------------------------------------------------------------------


def scene_of_positions(found: Study) -> _Tables:
    """Tables SCENE, POSES and VECTORS of a campaign of absolute positions."""
    final = found.final
    readings, mechanism = final.readings, final.mechanism
    vectors = _off(found)
    numbers = np.arange(1, len(readings) + 1)
    shown = _chosen(numbers, vectors)
    at = shown - 1
    here = configure(mechanism.robot, readings.q[at])
    tool = Tool(mechanism.tool[0, :3, 3], readings.targets, mechanism.tool[:, :3, 3])
    named = {
        f"instrument, series {name}" if len(readings.names) > 1 else "instrument": (
            -frame[:3, :3].T @ frame[:3, 3]
        )
        for name, frame in zip(readings.names, mechanism.frames, strict=True)
    }
    standing = [bodies.points(bodies.TRACKER, {name: np.array(p) for name, p in named.items()})]
    return {
        "scene": _bodies(mechanism.robot, here, tool, shown, standing),
        "poses": _poses_read(found, at),
        "vectors": vectors[vectors["pose"].isin(shown)].reset_index(drop=True),
    }


def _off(found: Study) -> pd.DataFrame:
    """Table VECTORS of all poses.

    The first vector is the deviation from the nominal robot, the second the residual of the
    complete model.
    """
    final, first = found.final, found.stages[0].found
    readings, m, t = final.readings, len(final.readings), len(final.readings.targets)
    place = final.linear.at
    off, left = (one.left.reshape(m, t, 6)[:, :, :3].reshape(-1, 3) for one in (first, final))
    seen = np.isfinite(readings.at).all(axis=2).ravel()
    parts = {
        "pose": np.repeat(np.arange(1, m + 1), t),
        "target": np.tile(readings.targets, m),
        **_spread("{}_m", place.reshape(-1, 3)),
        **_spread("moved_{}_m", off),
        **_spread("left_{}_m", left),
        **{f"c{ab}_m2": np.full(m * t, np.nan) for ab in PAIRS},
    }
    return pd.DataFrame(parts)[seen].reset_index(drop=True)


def _poses_read(found: Study, at: Ints) -> pd.DataFrame:
    """Table POSES."""
    readings = found.final.readings
    several = len(readings.names) > 1
    rows = []
    for k in at.tolist():
        line, series = int(readings.line[k]), int(readings.series[k])
        name = f", series {readings.names[series]}" if several else ""
        one = {"file": readings.file[k], "first_line": line, "last_line": line}
        own = {"joints_file": one["file"], "joints_line": line, "pulls": 0, "force_n": np.nan}
        rows.append({"pose": k + 1, "label": f"Pose {readings.pose[k]}{name}", **one, **own})
    return _typed(rows)
