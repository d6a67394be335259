"""Register the tracker in F_b from readings of base reflectors, and place all readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from scipy import special
from scipy.spatial.transform import Rotation

from pipeline.base import covariance, linear
from pipeline.base.arrays import Array, Bools, Locked
from pipeline.base.errors import InputError
from pipeline.machine.effects.tracker_drift import GROUP_S
from pipeline.readers._iso import NO_YEAR
from pipeline.readers.reflector_sets import GROSS_DISTANCE_M
from pipeline.reduction._index import run
from pipeline.reduction.course import CONTRADICTED, Course, course
from pipeline.reduction.growth import BaseGrowth, by_temperature, with_reflectors
from pipeline.reduction.settings import BASE_REFLECTORS, ONE_LINE, Settings
from pipeline.tables import XYZ as XYZ

_OFF = ["dx_m", "dy_m", "dz_m"]

_STEPS = 20
"""Maximum number of Gauss-Newton steps; from the closed form three or four suffice."""
_STILL = 1e-15
"""Step below which the iteration has converged [m or rad]; it changes no number of the size of a
hall."""
_WORSE = 1 + 1e-9
"""Ratio of chi2 after a step to that before beyond which the step is halved [1]; more than
rounding."""
_ONE_PLACE = 1e-9
"""Second width of the readings over the first of the nominal points below which all are on one line
[1]."""
_REFLECTOR_M = 1e-2
"""Minimum distance of two reflectors [m]: the smallest ones have a diameter of half an inch."""
_FEW = 15
"""Maximum number of readings for which every triple is tried."""
_TRIALS = 500
"""Number of triples tried for more readings: with half of the readings good, 1 triple in 8 is
good."""
_JUDGES = 10_000
"""Maximum number of readings, evenly spaced, by which a triple is judged: they give the fraction of
near readings to a hundredth."""
_SPREAD = np.array([0.8191725134, 0.6710436067, 0.5497004779])
"""Steps that fill a cube evenly: powers of 1 / x where x^4 = x + 1 (a Kronecker sequence)."""


@dataclass(frozen=True, eq=False)
class Registration(Locked):
    """The tracker's pose in F_b: p_b = (R p_t + t) / (1 + g), g the growth of the base frame.

    Attributes:
        R: Rotation from the tracker's frame into F_b, shape (3, 3).
        t: Origin of the tracker in F_b [m], shape (3,).
        cov: Covariance of (rotation vector in F_b [rad], shift at `centre` [m]), shape (6, 6).
        centre: Centre of the base reflectors in F_b [m], shape (3,).
        table: Table REGISTRATION, residuals of every base reading; empty without a base frame.
        chi2: Weighted sum of squared residuals; None without stated noise or base frame.
        dof: Coordinates minus six, and minus one for an estimated growth.
        from_scatter: Whether `cov` is scaled by the residuals instead of resting on a stated noise.
        growth: Growth of the base frame relative to its stated size, see `growth`.
        nominal_std: Standard uncertainty per axis of the nominal positions [m].
        course: What the base frame changed by from round to round, which is corrected; None if a
            motion of the tracker or chance explains its rounds.
    """

    R: Array
    t: Array
    cov: Array
    centre: Array
    table: pd.DataFrame
    chi2: float | None
    dof: int
    from_scatter: bool = False
    growth: BaseGrowth = field(default_factory=BaseGrowth)
    nominal_std: float = 0.0
    course: Course | None = None

    @property
    def weighing(self) -> Array:
        """Covariance of every base reading about its nominal position [m^2], shape (m, 3, 3)."""
        return _about_nominal(self.table, self.nominal_std)

    @property
    def tracker(self) -> Array:
        """Position of the tracker in F_b [m], shape (3,)."""
        return np.asarray(self.t / (1 + self.growth.value))

    def into_base_frame(self, points: Array) -> Array:
        """Transform points of the tracker's frame (m, 3) into F_b [m]."""
        return (points @ self.R.T + self.t) / (1 + self.growth.value)


def register(settings: Settings, readings: pd.DataFrame) -> Registration:
    """Fit the tracker's pose as `_registered` does, as in the first round where rounds part.

    Args:
        settings: The campaign; `base_frame` has the nominal coordinates [m].
        readings: Table READINGS.

    Raises:
        InputError: Fewer than three reflectors, all of them on one line, or a reading with a
            singular covariance.
    """
    found = _registered(settings, readings)
    grown = course(found.table, found.R) if len(found.table) else None
    if grown is None:
        return found
    grown = grown.seen_from(found.R, found.t, 1 + found.growth.value)
    still = _registered(settings, grown.as_in_first(readings, seconds(readings)))
    return replace(still, course=grown, dof=still.dof - grown.unknowns)


def _registered(settings: Settings, readings: pd.DataFrame) -> Registration:
    """Fit the tracker's pose to the nominal base reflectors by weighted least squares.

    It minimises sum_i r_i' (R C_i R')^-1 r_i, r_i = (1 + g) n_i - (R p_i + t) [m]: n_i the nominal
    position, g the growth of the base frame (zero where no temperature is stated and the reflectors
    agree without), p_i the reading and C_i its covariance [m^2] in the tracker's frame.
    Gauss-Newton from the unweighted closed form (Kabsch, Acta Cryst. A32, 1976; Umeyama, IEEE
    Trans. PAMI 13, 1991). cov = (D' W D)^-1, times chi2 / dof where the noise is not stated or the
    misfit is improbable (p < `CONTRADICTED`; Birge, Physical Review 40, 1932). Without [base_frame]
    the readings are in F_b already.

    Args:
        settings: The campaign; `base_frame` has the nominal coordinates [m].
        readings: Table READINGS.

    Raises:
        InputError: Fewer than three reflectors, all of them on one line, or a reading with a
            singular covariance.
    """
    _uncertain(readings)
    base = readings.assign(time_s=seconds(readings))[readings["pose"].isna()]
    base = base[base["target"].isin(list(settings.base_frame))]
    if not settings.base_frame:
        nothing = base.assign(dx_m=0.0, dy_m=0.0, dz_m=0.0)
        zero = np.zeros(3)
        return Registration(np.eye(3), zero, np.zeros((6, 6)), zero, nothing, None, 0)
    nominal = np.array([settings.base_frame[target] for target in base["target"]]).reshape(-1, 3)
    points = base[XYZ].to_numpy()
    _enough(base, nominal)
    C = _about_nominal(base, settings.base_std)
    stated = bool(covariance.known(covariance.numbers(base)).all())
    R, t, cov, chi2, centre = _fit(points, nominal, C)
    dof = 3 * len(base) - 6
    grown = by_temperature(settings.temperature_c)
    if grown.expected is not None or (stated and _contradicted(chi2, dof)):
        grown = with_reflectors(grown, stated, *_white(R, t, points, nominal, C))
    if grown.value:
        R, t, cov, chi2, centre = _fit(points, (1 + grown.value) * nominal, C)
        centre = centre / (1 + grown.value)
        dof -= round(grown.determined)
    from_scatter = not stated or _contradicted(chi2, dof)
    if from_scatter:
        cov = cov * (chi2 / dof)  # reflectors that disagree register it less well
    cov[3:, 3:] += grown.std**2 * np.outer(centre, centre)
    bare = base.assign(dx_m=0.0, dy_m=0.0, dz_m=0.0)
    found = Registration(
        R, t, cov, centre, bare, chi2 if stated else None, dof, from_scatter, grown,
        settings.base_std,
    )  # fmt: skip
    return replace(found, table=_with_residuals(base, found.into_base_frame(points), nominal))


def _about_nominal(table: pd.DataFrame, std: float) -> Array:
    """Covariance of base readings about their nominal positions, C_i + n s^2 1 [m^2], (m, 3, 3).

    The error of a position, s, is common to its n readings: their mean, which alone registers the
    tracker, then has C / n + s^2 1. Where no noise is known, both are part of the scatter.
    """
    C = covariance.weighing(table)
    if not std or not covariance.known(covariance.numbers(table)).all():
        return C
    count = table.groupby("target")["target"].transform("size").to_numpy(float)
    return np.asarray(C + (count * std**2)[:, None, None] * np.eye(3))


def _contradicted(chi2: float, dof: int) -> bool:
    """Whether the base reflectors disagree by more than their stated uncertainties."""
    return bool(special.chdtrc(dof, chi2) < CONTRADICTED)


def _white(
    R: Array, t: Array, points: Array, nominal: Array, C: Array
) -> tuple[Array, Array, Array]:
    """Residuals, nominal positions and columns of a motion of the tracker, whitened; (3 m, ...)."""
    placed = points @ R.T + t
    W = linear.whitening(R @ C @ R.T)
    D = _motions(placed - placed.mean(axis=0))
    r, n = ((W @ rows[..., None]).ravel() for rows in (nominal - placed, nominal))
    return r, n, (W @ D).reshape(-1, 6)


def _with_residuals(table: pd.DataFrame, placed: Array, nominal: Array) -> pd.DataFrame:
    """Table REGISTRATION: base readings in F_b and their residuals [m]."""
    columns = np.hstack([placed, placed - nominal]).T
    return table.assign(**dict(zip([*XYZ, *_OFF], columns, strict=True)))


def agreed(registration: Registration) -> tuple[Registration, Bools]:
    """The registration without base readings that are grossly off, and which readings agree, (m,).

    It starts from the triple of reflectors whose rigid motion minimises the sum of the (m + 3) / 2
    smallest squared distances (least trimmed squares, Rousseeuw, J. Am. Stat. Assoc. 79, 1984), so
    that fewer than half of the readings may lie anywhere. Readings nearer than `GROSS_DISTANCE_M`
    are then fitted as in `register`; residuals are given for all readings.

    Args:
        registration: The registration with all readings.
    """
    table = registration.table
    placed = table[XYZ].to_numpy(float)
    nominal = placed - table[_OFF].to_numpy(float)
    grown = 1 + registration.growth.value
    points = (grown * placed - registration.t) @ registration.R
    agree = agreeing(points, grown * nominal)
    if agree.all() or not apart(nominal[agree]):
        return registration, np.ones_like(agree)  # too few agree to identify the others
    C = registration.weighing
    R, t, cov, chi2, centre = _fit(points[agree], grown * nominal[agree], C[agree])
    stated, dof = registration.chi2 is not None, registration.dof - 3 * int((~agree).sum())
    from_scatter = not stated or _contradicted(chi2, dof)
    found = replace(
        registration,
        R=R,
        t=t,
        cov=cov * (chi2 / dof) if from_scatter and dof else cov,
        centre=centre / grown,
        chi2=chi2 if stated else None,
        dof=dof,
        from_scatter=from_scatter,
    )
    return replace(
        found, table=_with_residuals(table, found.into_base_frame(points), nominal)
    ), agree


def agreeing(points: Array, nominal: Array) -> Bools:
    """Which readings are near their reflectors according to the best triple of them, shape (m,).

    Args:
        points: Readings in the frame of the tracker [m], shape (m, 3).
        nominal: Nominal positions of their reflectors [m], F_b, shape (m, 3).
    """
    m = len(points)
    every: Any = combinations(range(m), 3)
    if m > _FEW:
        every = (m * (np.arange(1, _TRIALS + 1)[:, None] * _SPREAD % 1)).astype(int)
    triples = [list(one) for one in every if apart(nominal[list(one)])]
    if not triples:
        return np.ones(m, dtype=bool)
    motions = [linear.rigid(points[one], nominal[one]) for one in triples]
    some = slice(None, None, -(-m // _JUDGES))
    away = np.array([_away(points[some], nominal[some], *motion) for motion in motions])
    near = np.sort(away**2, axis=1)[:, : (away.shape[1] + 3) // 2].sum(axis=1)
    return np.asarray(_away(points, nominal, *motions[int(np.argmin(near))]) < GROSS_DISTANCE_M)


def _away(points: Array, nominal: Array, R: Array, t: Array) -> Array:
    """Distance of each transformed point from its nominal position [m], shape (m,)."""
    return np.asarray(np.linalg.norm(nominal - points @ R.T - t, axis=1))


def apart(nominal: Array) -> bool:
    """Whether points determine a rigid motion."""
    if len(nominal) < BASE_REFLECTORS:
        return False
    spread = linear.extent(nominal)
    return bool(spread[1] > ONE_LINE * max(spread[0], _REFLECTOR_M))


def place(registration: Registration, readings: pd.DataFrame) -> pd.DataFrame:
    """Table PLACED: the readings of the poses transformed into F_b, with their covariances."""
    rows = run(np.flatnonzero(readings["pose"].notna().to_numpy()))
    poses, since = readings.iloc[rows], seconds(readings)[rows]
    if registration.course is not None:
        poses = registration.course.as_in_first(poses, since)
    R, t = registration.R, registration.t
    moved = R @ np.array([poses[axis].to_numpy() for axis in XYZ])
    moved += t[:, None]
    C = covariance.turned(covariance.numbers(poses), R)
    if registration.growth.value:
        grown = 1 + registration.growth.value
        moved, C = moved / grown, [column / grown**2 for column in C]
    new = {
        **{name: poses[name].to_numpy().astype(np.int32) for name in ("pose", "repeat")},
        **dict(zip(XYZ, moved, strict=True)),
        **dict(zip(covariance.columns(), C, strict=True)),
        "time_s": since,
    }
    kept = {name: poses[name] for name in poses.columns if name not in new}
    return pd.DataFrame(kept | new, index=poses.index, copy=False)


def seconds(readings: pd.DataFrame) -> Array:
    """Seconds after the first reading, NaN for a reading without a time, shape (n,).

    If no reading has a time, the order of rows serves as clock: `GROUP_S` times the number of the
    group in reading order.
    """
    if not timed(readings):
        group = readings["group"].astype("category").cat.codes.to_numpy()
        return GROUP_S * np.cumsum(np.append(0, group[1:] != group[:-1]))
    since = readings["time"].to_numpy("datetime64[us]") - readings["time"].min().to_datetime64()
    return np.asarray(since / np.timedelta64(1, "s"), dtype=float)


def timed(readings: pd.DataFrame) -> bool:
    """Whether any reading has a time."""
    return not len(readings) or bool(readings["time"].notna().any())


def dated(times: pd.Series[pd.Timestamp]) -> bool:
    """Whether any time is known, with its date."""
    return bool(times.notna().any()) and times.min().year > NO_YEAR


def _uncertain(readings: pd.DataFrame) -> None:
    """Refuse readings with zero uncertainty, which would outweigh all others.

    Raises:
        InputError: A covariance is singular.
    """
    without = covariance.singular(covariance.numbers(readings)) if len(readings) else np.zeros(0)
    if without.any():
        first = readings.iloc[int(np.argmax(without))]
        raise InputError(
            f"the uncertainty of {first['target']} is zero in some direction",
            "export the readings with their uncertainties, or state [tracker] sigma_m",
            file=str(first["file"]),
            line=int(first["line"]),
        )


def read_apart(names: Sequence[str], points: Array, nominal: Array, file: str, line: int) -> None:
    """Check that readings of base reflectors are those of different ones.

    Args:
        names: Of the reflectors.
        points: Their readings [m], shape (n, 3).
        nominal: Their positions in F_b [m], one each.
        file: Of the first reading.
        line: Of the first reading.

    Raises:
        InputError: They are all in one place or on one line.
    """
    if linear.extent(points)[1] <= _ONE_PLACE * linear.extent(nominal)[0]:
        raise InputError(
            f"the base reflectors {', '.join(names)} were all read in one place or on one line",
            "export the readings again, these are no coordinates of different reflectors",
            file=file,
            line=line,
        )


def _enough(base: pd.DataFrame, nominal: Array) -> None:
    names = sorted(set(base["target"]))
    if len(names) < BASE_REFLECTORS:
        raise InputError(
            f"only {len(names)} base reflectors were measured ({', '.join(names) or 'none'})",
            f"measure at least {BASE_REFLECTORS} that stand in [base_frame]",
            file="campaign.toml",
            key=["base_frame"],
        )
    spread = linear.extent(nominal)
    if spread[0] <= _REFLECTOR_M:
        raise InputError(
            f"the base reflectors {', '.join(names)} are all in one place",
            "give each its own nominal coordinates in [base_frame], in metres",
            file="campaign.toml",
            key=["base_frame"],
        )
    if spread[1] <= ONE_LINE * spread[0]:
        raise InputError(
            f"the base reflectors {', '.join(names)} lie on one line",
            "add one beside that line, or the tracker's roll about it stays unknown",
            file="campaign.toml",
            key=["base_frame"],
        )


def _fit(points: Array, nominal: Array, C: Array) -> tuple[Array, Array, Array, float, Array]:
    """Rotation, translation, their covariance, chi2 and centre, as in `Registration`."""
    R, t = linear.rigid(points, nominal)
    size, best = 1.0, (R, t, _gauss_newton(R, t, points, nominal, C))
    for _ in range(_STEPS):
        R, t, (step, cov, chi2, centre) = best
        turn = Rotation.from_rotvec(size * step[:3]).as_matrix()
        R, t = turn @ R, turn @ (t - centre) + centre + size * step[3:]
        if np.abs(size * step).max() < _STILL:
            break
        found = _gauss_newton(R, t, points, nominal, C)
        if found[2] <= _WORSE * chi2:
            size, best = 1.0, (R, t, found)
        else:  # from a wrong unit the whole step may lead anywhere
            size /= 2
    return R, t, cov, chi2, centre


def _gauss_newton(
    R: Array, t: Array, points: Array, nominal: Array, C: Array
) -> tuple[Array, Array, float, Array]:
    """One step (rotation, shift at the centre), its covariance, chi2 and the centre.

    (w, s) = N^-1 sum_i D_i' W_i r_i with N = sum_i D_i' W_i D_i, W_i = (R C_i R')^-1 and
    D_i (w, s) = w x (R p_i + t - p) + s, p the centre of the placed readings; w [rad], s [m], F_b.
    """
    placed = points @ R.T + t
    centre = placed.mean(axis=0)
    D = _motions(placed - centre)
    W = covariance.alike(C, lambda own: linear.inverse(R @ own @ R.T))
    residual = nominal - placed
    N = np.einsum("mia,mij,mjb->ab", D, W, D)
    step = linear.solve(N, np.einsum("mia,mij,mj->a", D, W, residual))
    chi2 = float(np.einsum("mi,mij,mj->", residual, W, residual))
    return step, linear.inverse(N), chi2, centre


def _motions(lever: Array) -> Array:
    """Motion of points with these levers [m] per rotation [rad] and shift [m], shape (m, 3, 6)."""
    shifts = np.broadcast_to(np.eye(3), (len(lever), 3, 3))
    return np.concatenate([linear.turning(lever), shifts], axis=2)
