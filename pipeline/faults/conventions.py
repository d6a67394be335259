"""Mistakes that affect a whole campaign, from the unloaded positions of the reflectors.

Robots agree with their table within millimetres. The unloaded reflectors, after the best rigid
motion onto their positions by the table (so that a poor base frame has no effect), deviate by far
more if a unit, the handedness of the tracker's frame, the joint convention or a sign of the table
is wrong.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline.base import covariance
from pipeline.base.arrays import Array, Ints
from pipeline.base.linear import moved_onto, rigid
from pipeline.faults import unloaded_points as shown
from pipeline.faults.fault import Fault
from pipeline.faults.mistake import Mistake, lines_of
from pipeline.faults.unloaded_points import UnloadedPoints, by_base
from pipeline.machine import instrument
from pipeline.machine.instrument import InstrumentNoise
from pipeline.machine.robot import SHIPPED, Robot, configure, load
from pipeline.machine.robot.dh_parameters import dh_parameters, twists
from pipeline.machine.robot.variants import alike, differing, variants
from pipeline.readers.reflector_sets import CLEARLY_NEARER, GROSS_DISTANCE_M
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ
from pipeline.reduction.settings import Point

GROSS_ANCHORED_M = 0.3
"""Deviation from the table in a base frame, however poor its reflectors, from which on it is
gross [m]."""

FEWEST_POSES = 3
"""Minimum number of poses; with fewer, a rigid motion can hide a wrong table."""

UNITS = {
    1e3: ("m", "the numbers are metres and were read as millimetres"),
    25.4: ("inch", "the numbers are inches and were read as millimetres"),
    1e-3: ("mm", "the numbers are millimetres and were read as metres"),
    1 / 25.4: ("mm", "the numbers are millimetres and were read as inches"),
    25.4e-3: ("inch", "the numbers are inches and were read as metres"),
    1 / 25.4e-3: ("m", "the numbers are metres and were read as inches"),
}
"""Factor on the tracker's coordinates: their actual unit, and the sentence for it."""

LOGGED = (
    ("_rad", "rad", 180 / np.pi, "the numbers are radians and were read as degrees"),
    ("_rad", "deg", np.pi / 180, "the numbers are degrees and were read as radians"),
    ("_m", "joints_mm", 1e-3, "the sliding joint is in millimetres and was read as metres"),
    ("_m", "joints_m", 1e3, "the sliding joint is in metres and was read as millimetres"),
)
"""Columns of the joint log by their ending: their actual unit, factor, and the sentence for it."""

_LOGGED_ALONE = (
    ("_rad", "rad", 180 / np.pi, "is in radians and was read as degrees"),
    ("_rad", "deg", np.pi / 180, "is in degrees and was read as radians"),
)
"""The same for a single column, as in a log that was assembled from two."""

_DH_SAYS = {
    "modified_dh": "the robot file has modified DH parameters, read as standard ones",
    "standard_dh": "the robot file has standard DH parameters, read as modified ones",
}


_Way = Callable[[UnloadedPoints], float | None]
"""How the deviation of the reflectors is measured: `_miss` or `_anchored_miss`."""


def symbol(unit: str) -> str:
    """A unit of force as it is written: kN, daN, kgf."""
    return f"{unit[:-1]}N" if unit.endswith("n") else unit


@dataclass(frozen=True)
class _SupposedMistake:
    """One mistake that may have been made.

    Attributes:
        name: As in `Mistake`.
        where: As in `Mistake`.
        says: What was mistaken for what.
        correct: Correction of a case.
        moves: The same correction of its unloaded points alone, of which hundreds are tried.
        write: What to write instead; empty where `says` shows it.
        single: Whether it is only tested by itself and not together with another mistake, because
            there are many of its kind.
    """

    name: str
    where: str
    says: str
    correct: Callable[[Case], Case]
    moves: Callable[[UnloadedPoints], UnloadedPoints]
    write: str = ""
    single: bool = False


def conventions(case: Case) -> list[Mistake]:
    """The wrong unit, sign or convention; at most two of them at once.

    Nothing is found where the reflectors are where they should be, where too few poses were
    measured, or where no single mistake and no pair explains their positions. What moves the whole
    robot rigidly shows only against the base reflectors, which are tested second.
    """
    points = unloaded_points(case)
    for how, gross in ((_miss, GROSS_DISTANCE_M), (_anchored_miss, GROSS_ANCHORED_M)):
        before = how(points)
        if before is not None and before >= gross:
            return _search(case, points, how, gross, before)
    return []


def _search(
    case: Case, points: UnloadedPoints, how: _Way, gross: float, before: float
) -> list[Mistake]:
    singles = list(supposed_mistakes(case))
    most = min(gross, before / CLEARLY_NEARER)
    for tried in ([(h,) for h in singles], _pairs(singles) if how is _miss else []):
        misses = [_after(points, chosen, how, most) for chosen in tried]
        best = int(np.argmin([*misses, np.inf]))
        if best < len(tried) and misses[best] < gross and CLEARLY_NEARER * misses[best] < before:
            if _is_this_robot(points, tried[best][0], how, misses[best]):
                return []  # with another length, which the table is asked about later
            return [_finding(case, h, before, misses[best]) for h in tried[best]]
    return []


def _is_this_robot(
    points: UnloadedPoints, chosen: _SupposedMistake, how: _Way, after: float
) -> bool:
    """Whether one length of the robot explains the reflectors clearly better than another robot."""
    other = chosen.where in SHIPPED and how is _miss
    return other and CLEARLY_NEARER * _by_one_length(points) < after


def _pairs(singles: Sequence[_SupposedMistake]) -> list[tuple[_SupposedMistake, ...]]:
    """Pairs of mistakes in different places."""
    data = [h for h in singles if not h.single]
    return [p for p in itertools.combinations(data, 2) if p[0].where != p[1].where]


def _after(
    points: UnloadedPoints, chosen: Sequence[_SupposedMistake], how: _Way, most: float
) -> float:
    """Deviation of the reflectors with some mistakes corrected [m]; infinite if not informative.

    It is not informative from `most` on, nor where the poses coincide: a factor that shrinks all
    readings to a point fits a point.
    """
    for hypothesis in chosen:
        points = hypothesis.moves(points)
    value = how(points)
    if value is None or value >= most:
        return np.inf
    return np.inf if CLEARLY_NEARER * value > _apart(points) else value


def _apart(points: UnloadedPoints) -> float:
    """Distance of the poses from each other, as read or by the table, the smaller one [m], rms."""
    of = [points.target == one for one in np.unique(points.target)]
    return min(
        float(np.sqrt(np.mean([each[here].var(axis=0).sum() for here in of])))
        for each in (points.seen, points.expected)
    )


def _finding(case: Case, h: _SupposedMistake, before: float, after: float) -> Mistake:
    return Mistake(
        name=h.name,
        where=h.where,
        evidence=f"{h.says}: as given the unloaded reflectors are {1e3 * before:.0f} mm from "
        f"where the robot file places them, and {1e3 * after:.1f} mm with that corrected{h.write}",
        correction=f"recomputed as if {h.says}",
        before=1e3 * before,
        after=1e3 * after,
        correct=h.correct,
        at=lines_of(case.joints) if h.name == "exchanged" else (),
    )


def miss(case: Case, fewest: int = FEWEST_POSES) -> float | None:
    """Deviation of the unloaded reflectors from the robot's table [m], median over groups.

    None where too few poses were read.
    """
    return _miss(unloaded_points(case), fewest)


def _miss(points: UnloadedPoints, fewest: int = FEWEST_POSES) -> float | None:
    if len(points.q) < fewest:
        return None
    return _off(points.seen, points.expected, points.state)


def _off(seen: Array, expected: Array, state: Ints) -> float:
    """Median over groups of the distance from where points are expected, moved rigidly [m]."""
    residual = seen - moved_onto(expected, seen)
    square = np.bincount(state, (residual**2).sum(axis=1)) / np.maximum(np.bincount(state), 1)
    return float(np.sqrt(np.median(square)))


def _by_one_length(points: UnloadedPoints) -> float:
    """The smallest deviation as in `_miss` that any other value of one length leaves [m]."""
    seen, expected, state = points.seen, points.expected, points.state
    lengths = [one for one in dh_parameters(points.robot) if not one.turns]
    along = twists(configure(points.robot, points.q), lengths)[points.at, :, 3:]
    found = [np.inf]
    for axis in np.moveaxis(along, 1, 0):
        value = 0.0
        for _ in range(2):  # nearly linear: the frame turns a little with it
            r, moved = (seen - moved_onto(expected + (value + step) * axis, seen)
                        for step in (0.0, _STEP_M))  # fmt: skip
            slope = (moved - r) / _STEP_M
            value -= float((slope * r).sum() / max((slope**2).sum(), _FLAT))
        found.append(_off(seen, expected + value * axis, state))
    return min(found)


_STEP_M = 1e-3
"""Step by which the derivative along a length is taken [m]."""
_FLAT = 1e-12
"""Sum of squares below which a length moves no point [1]."""


def anchored_miss(case: Case) -> float | None:
    """Median deviation [m] with the readings transformed by the base reflectors instead of freely.

    None without three base reflectors.
    """
    return _anchored_miss(unloaded_points(case))


def _anchored_miss(points: UnloadedPoints) -> float | None:
    where = points.frame if points.nominal else None
    if where is None:
        return None
    away = np.linalg.norm(points.seen @ where[0].T + where[1] - points.expected, axis=1)
    return float(np.median(away)) if len(away) else None


@lru_cache(maxsize=1)
def anchored(case: Case) -> tuple[Array, Array] | None:
    """R, t that transform readings into F_b by the base reflectors, None with fewer than three.

    Without [base_frame] the readings are taken to be in F_b.
    """
    rows = case.readings[case.readings["pose"].isna()]
    names = rows["target"].to_numpy(object)
    return by_base(rows[XYZ].to_numpy(float), names, case.settings.base_frame)


@lru_cache(maxsize=1)  # used by a dozen tests of one campaign
def unloaded(case: Case) -> pd.DataFrame:
    """Unloaded readings of the measured targets in poses with joint values."""
    rows = case.readings
    known = rows["target"].isin(case.settings.measured) & (rows["state"] == "unloaded")
    return rows[known & rows["pose"].isin(case.joints["pose"])]


def unloaded_points(case: Case) -> UnloadedPoints:
    """The unloaded readings of a campaign as arrays, with all that its table places them by."""
    zeros = unloaded(case)
    poses, at = np.unique(zeros["pose"].to_numpy(int), return_inverse=True)
    alone = case.readings[case.readings["pose"].isna()]
    return UnloadedPoints(
        seen=zeros[XYZ].to_numpy(float),
        state=pd.factorize(zeros["group"])[0],
        target=pd.Index(case.settings.measured).get_indexer(pd.Index(zeros["target"])),
        at=at,
        q=case.q(poses),
        robot=case.robot,
        measured=tuple(case.settings.measured),
        tool=case.tool.points,
        base=alone[XYZ].to_numpy(float),
        names=alone["target"].to_numpy(object),
        nominal=case.settings.base_frame,
    )


def pairs(case: Case, rows: pd.DataFrame) -> tuple[Array, Array, Ints]:
    """Readings (n, 3) in the tracker's frame, their places by the table in F_b, their groups."""
    poses, at = np.unique(rows["pose"].to_numpy(int), return_inverse=True)
    target = pd.Index(case.settings.measured).get_indexer(pd.Index(rows["target"]))
    points = configure(case.robot, case.q(poses)).points(case.tool.points)
    return rows[XYZ].to_numpy(float), points[at, target], pd.factorize(rows["group"])[0]


def aligned(case: Case) -> tuple[Array, Array] | None:
    """Rigid motion from the table's F_b to the tracker's frame.

    With too few poses it is that of the base reflectors; None without them.
    """
    if unloaded(case)["pose"].nunique() < FEWEST_POSES:
        base = anchored(case) if case.settings.base_frame else None
        return base and (base[0].T, -base[0].T @ base[1])
    seen, expected, _ = pairs(case, unloaded(case))
    return _robust(expected, seen)


def _robust(expected: Array, seen: Array) -> tuple[Array, Array]:
    """Rigid motion of the expected points onto the readings, without those far off."""
    R, t = rigid(expected, seen)
    for _ in range(3):
        off = np.linalg.norm(seen - expected @ R.T - t, axis=1)
        good = off < np.maximum(3 * np.median(off), 1e-3)
        R, t = rigid(expected[good], seen[good])
    return R, t


# --- what may have gone wrong ---------------------------------------------------------------------


def supposed_mistakes(case: Case) -> Iterator[_SupposedMistake]:
    """Every mistake that is tested."""
    for factor, (unit, says) in UNITS.items():
        says = f"in the tracker export {says}"
        yield _of_tracker("unit_mixup", unit, says, factor * np.eye(3))
    for ending, unit, factor, says in LOGGED:
        mine = [column.endswith(ending) for column in case.joint_columns]
        if any(mine):
            M = np.diag(np.where(mine, factor, 1.0))
            yield _of_log("unit_mixup", unit, f"in the joint log {says}", M)
    left_handed = "the tracker's frame is left-handed"
    yield _of_tracker("sign_or_convention", "left_handed", left_handed, _MIRROR)
    if case.robot.controller_matrix.shape[1] == case.robot.n:
        says = "the joint log holds the controller's axes under the names of the joints"
        to_joints = case.robot.controller_matrix, case.robot.controller_offset
        yield _of_log("sign_or_convention", "controller_axes", says, *to_joints)
    yield from _columns(case)
    for where, says, robot in _robots(case.robot):
        correct = partial(replace, robot=robot)
        yield _SupposedMistake("sign_or_convention", where, says, correct, correct, single=True)
    yield from _names(case)
    yield from _turned(case)


_MIRROR = np.diag([1.0, -1.0, 1.0])
"""The tracker's y reversed."""


def _of_tracker(name: str, where: str, says: str, A: Array) -> _SupposedMistake:
    """Readings that are meant as A p."""
    return _SupposedMistake(name, where, says, partial(mapped, A), partial(shown.mapped, A))


def _of_log(
    name: str, where: str, says: str, M: Array, q0: Array | float = 0.0, single: bool = False
) -> _SupposedMistake:
    """Joint values that are meant as M q + q0."""
    on_points = partial(shown.logged, M, q0)
    return _SupposedMistake(name, where, says, partial(_logged, M, q0), on_points, single=single)


_TURNS = [np.eye(3)[list(order)] * signs for order in itertools.permutations(range(3))
          for signs in itertools.product((1.0, -1.0), repeat=3)][1:]  # fmt: skip
"""The turns of a frame by multiples of 90 deg, and those of the mirrored one."""


def _turned(case: Case) -> Iterator[_SupposedMistake]:
    """[tool] or [base_frame] in a frame whose axes are others of ours, perhaps with other signs."""
    settings = case.settings
    names = ["load_point", *settings.measured]
    tables = {"tool": {name: settings.tool[name] for name in names if name in settings.tool},
              "base_frame": settings.base_frame}  # fmt: skip
    for table, places in tables.items():
        for turn, how in _as_turned(table) if places else ():
            yield _SupposedMistake(
                "sign_or_convention",
                table,
                f"[{table}] is in another frame{how}",
                partial(with_places, table, moved := _at(turn, places)),
                partial(shown.with_places, table, moved),
                write="; write " + ", ".join(
                    f"{name} = [{', '.join(f'{x:.7g}' for x in at)}]" for name, at in moved.items()
                ) + f" into [{table}]",
                single=True,
            )  # fmt: skip


def _at(turn: Array, places: Mapping[str, Point]) -> dict[str, Point]:
    """Places in the turned frame; 0.0 is added to have no minus zero."""
    return {name: tuple((turn @ at + 0.0).tolist()) for name, at in places.items()}


@cache
def _as_turned(table: str) -> tuple[tuple[Array, str], ...]:
    """Every turn with what it means for a table.

    `, turned by 180 deg about z of the flange: [x, y, z] there is [-x, -y, z] here`.
    """
    maybe, frame = (", maybe the controller's", "the flange") if table == "tool" else ("", "F_b")
    found = []
    for turn in _TURNS:
        signed = (("-" if row.sum() < 0 else "") + "xyz"[int(np.abs(row).argmax())] for row in turn)
        here = ", ".join(signed)
        found.append((turn, f"{maybe}, {_turn(turn, frame)}: [x, y, z] there is [{here}] here"))
    return tuple(found)


def _turn(turn: Array, frame: str) -> str:
    """`turned by 180 deg about z of the flange`, `mirrored`, or both."""
    vector = Rotation.from_matrix(turn * np.linalg.det(turn)).as_rotvec(degrees=True)
    angle = float(np.linalg.norm(vector))
    if not angle:
        return "mirrored"
    along = np.abs(vector) > 1e-6 * angle
    axis = f" about {'xyz'[int(np.flatnonzero(along)[0])]}" if along.sum() == 1 else ""
    sign = "-" if axis and vector.sum() < 0 and angle < 179 else ""
    mirrored = " and mirrored" if np.linalg.det(turn) < 0 else ""
    return f"turned by {sign}{angle:.0f} deg{axis} of {frame}{mirrored}"


def with_places(table: str, places: Mapping[str, Point], case: Case) -> Case:
    """The campaign with other places in one of its tables."""
    settings = case.settings
    moved = {**getattr(settings, table), **places}
    return replace(case, settings=settings.model_copy(update={table: moved}))


def _columns(case: Case) -> Iterator[_SupposedMistake]:
    """Single columns of the joint log that may be wrong."""
    alone, kept = partial(_of_log, single=True), np.eye(len(case.joint_columns))
    for column, joint, mine in zip(case.joint_columns, case.robot.joints, kept, strict=True):
        for ending, unit, factor, says in _LOGGED_ALONE if len(kept) > 1 else ():
            if column.endswith(ending):
                says = f"in the joint log {joint.name} {says}"
                M = np.diag(np.where(mine, factor, 1.0))
                yield alone("unit_mixup", f"{joint.name}_{unit}", says, M)
        says = f"in the joint log {joint.name} has the opposite sign"
        yield alone("sign_or_convention", f"{joint.name}_reversed", says, np.diag(1 - 2 * mine))
    for i, k in itertools.combinations(range(len(kept)), 2):
        one, other = (case.joint_columns[j].rpartition("_") for j in (i, k))
        if one[2] == other[2]:
            says = f"in the joint log {one[0]} and {other[0]} stand in each other's column"
            order = np.arange(len(kept))
            order[[i, k]] = k, i
            yield alone("exchanged", f"{one[0]}/{other[0]} columns", says, kept[order])


def _names(case: Case) -> Iterator[_SupposedMistake]:
    """Permutations of the target names in the whole campaign."""
    for names in itertools.permutations(case.settings.measured):
        if list(names) != case.settings.measured:
            yield _SupposedMistake(
                "label_swap",
                "all groups",
                f"the targets {', '.join(case.settings.measured)} carry the names of "
                f"{', '.join(names)} in every group",
                partial(renamed, true=dict(zip(case.settings.measured, names, strict=True))),
                partial(shown.renamed, names),
            )


def _robots(robot: Robot) -> Iterator[tuple[str, str, Robot]]:
    """Other robots that may have been measured: what is wrong, where, and the robot."""
    for name in SHIPPED:
        other = load(name)
        if name == robot.name or not alike(robot, other):
            continue
        where = differing(robot, other)
        wrong = f"the robot file is wrong in {where}, as {name} shows"
        yield where or name, wrong if where else f"the robot is {name}, not {robot.name}", other
    for where, other in variants(robot):
        yield where, _DH_SAYS.get(where) or f"the robot file is wrong in {where}", other


def mapped(A: Array, case: Case, shift: Array | float = 0.0) -> Case:
    """The campaign with readings A p + shift [m], A (3, 3) orthogonal but for a factor.

    Covariances from the file are in the unit of the readings; others only turn.
    """
    rows, noise = case.readings, case.settings.reading_noise
    at, factor = rows[XYZ].to_numpy(float) @ A.T + shift, np.linalg.norm(A[0])
    own = (rows["covariance_from"] == "file").to_numpy()
    C = A @ covariance.matrices(rows) @ A.T
    six = covariance.flat(C / np.where(own, 1.0, factor**2)[:, None, None])
    if factor != 1 and isinstance(noise, InstrumentNoise):
        six = np.where(own[:, None], six, instrument.beam_covariance(at, noise))
    rows = rows.assign(**dict(zip(XYZ, at.T, strict=True)))
    anchors = {pull: A @ read + shift for pull, read in case.anchors_read.items()}
    return replace(case, readings=with_covariance(rows, six), anchors_read=anchors)


def with_covariance(rows: pd.DataFrame, six: Array) -> pd.DataFrame:
    """Readings with other covariances, given by six numbers each (m, 6) [m^2]."""
    return rows.assign(**dict(zip(covariance.columns(), six.T, strict=True)))


def _logged(M: Array, q0: Array | float, case: Case) -> Case:
    """The campaign with joint values M q + q0."""
    q = case.joints[case.joint_columns].to_numpy(float) @ M.T + q0
    new = dict(zip(case.joint_columns, q.T, strict=True))
    return replace(case, joints=case.joints.assign(**new))


def renamed(case: Case, true: Mapping[str, str], groups: Collection[str] | None = None) -> Case:
    """Readings of some groups, by default of all, with other names of their targets."""
    rows = case.readings
    here = rows["group"].isin(rows["group"] if groups is None else groups)
    target = [true.get(t, t) if h else t for t, h in zip(rows["target"], here, strict=True)]
    return replace(case, readings=rows.assign(target=target))


FAULT = Fault("sign_or_convention", lambda asked: conventions(asked.case), in_files=True)
