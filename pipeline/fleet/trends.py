"""Whether campaigns of one robot agree, if they are too few or undated for an estimate of wear."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from pipeline.answer.contract import Answer, Stiffness
from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.fleet.history import FALSE_ALARM, alike, compliance, day_of, ordered, trusted


@dataclass(frozen=True)
class Trend:
    """One stiffness over the campaigns of a robot.

    Attributes:
        name: `k_theta2`.
        campaigns: Number of campaigns that determine it.
        first_to_last: Change from the first to the last [% of the first].
        first_to_last_std: Its standard uncertainty [%].
        p_value: Probability of at least this scatter between the campaigns without any change, by
            chi-square.
        sure: Whether it is significant, with all joints taken into account.
    """

    name: str
    campaigns: int
    first_to_last: float | None
    first_to_last_std: float | None
    p_value: float | None
    sure: bool


def robots(answers: Sequence[Answer]) -> dict[str, list[Answer]]:
    """Campaigns in order, by machine: robots of one type have different stiffnesses."""
    out: dict[str, list[Answer]] = {}
    for one in ordered(answers):
        out.setdefault(one.machine, []).append(one)
    return dict(sorted(out.items()))


def within_a_day(answers: Sequence[Answer]) -> list[str]:
    """Names of the stiffnesses that differ significantly between campaigns of one robot and day.

    A repair may be the reason; wear and day-to-day scatter are not.
    """
    days: dict[str, list[Answer]] = {}
    for one in answers:
        if one.measured:
            days.setdefault(day_of(one), []).append(one)
    several = [own for own in days.values() if len(own) > 1]
    found = [trend for own in several for trend in trends(own, among=len(several))]
    return list(dict.fromkeys(trend.name for trend in found if trend.sure))


def together(
    before: Sequence[Stiffness], after: Sequence[Stiffness], cov_before: Array, cov_after: Array
) -> tuple[float, int]:
    """Chi-square of all compliances together and its degrees of freedom, correlations included.

    Args:
        before: Stiffnesses of all joints.
        after: Likewise, of another campaign.
        cov_before: Covariance of the compliances of `before` [SI], shape (n, n).
        cov_after: Likewise of `after`.
    """
    both = [(compliance(a), compliance(b)) for a, b in zip(before, after, strict=True)]
    found = {i: b[0] - a[0] for i, (a, b) in enumerate(both) if a and b}
    if not found:
        return 0.0, 0
    use, difference = list(found), np.array(list(found.values()))
    cov = (np.asarray(cov_before) + np.asarray(cov_after))[np.ix_(use, use)]
    scale = np.sqrt(np.diag(cov))
    scaled = difference / scale
    return float(scaled @ linear.solve(cov / np.outer(scale, scale), scaled)), len(use)


def chance(chi2: float, dof: int) -> float | None:
    """Probability of a chi-square this large or larger; None without degrees of freedom."""
    return float(special.chdtrc(dof, chi2)) if dof > 0 else None


@dataclass(frozen=True)
class _Point:
    """Compliance of one joint in one campaign [SI]."""

    x: float
    std: float


def trends(answers: Sequence[Answer], among: int = 1) -> list[Trend]:
    """Whether the campaigns of one robot, in order, agree on each stiffness.

    Campaigns count if they are trusted and of the same kind as the last such campaign. The test is
    corrected for the number of stiffnesses, and for the number `among` of such lists tested.

    This is for campaigns that are too few, or undated, for `pipeline.fleet.wear`.
    """
    names = dict.fromkeys(joint.name for one in answers for joint in one.stiffness)
    counted = [one for one in answers if trusted(one)]
    counted = [one for one in counted if alike(one, counted[-1])]
    series = {name: list(_series(counted, name)) for name in names}
    tested = sum(len(points) > 1 for points in series.values())
    return [_trend(name, points, among * max(tested, 1)) for name, points in series.items()]


def _series(answers: Sequence[Answer], name: str) -> Iterator[_Point]:
    """Compliances of a joint in the campaigns that determine it."""
    for one in answers:
        for joint in one.stiffness:
            here = compliance(joint) if joint.name == name else None
            if here:
                yield _Point(*here)


def _trend(name: str, points: Sequence[_Point], tested: int) -> Trend:
    if len(points) < 2:
        return Trend(name, len(points), None, None, None, sure=False)
    x, std = np.array([p.x for p in points]), np.array([p.std for p in points])
    mean = np.average(x, weights=std**-2)
    p_scatter = chance(float(np.sum(((x - mean) / std) ** 2)), len(x) - 1)
    first_to_last, first_to_last_std = _first_to_last(x, std)
    return Trend(
        name=name,
        campaigns=len(points),
        first_to_last=first_to_last,
        first_to_last_std=first_to_last_std,
        p_value=p_scatter,
        sure=p_scatter is not None and p_scatter < FALSE_ALARM / tested,
    )


def _first_to_last(x: Array, std: Array) -> tuple[float | None, float | None]:
    """Change of the stiffness [%] and its standard uncertainty; None for a negative compliance."""
    if min(x[0], x[-1]) <= 0:
        return None, None
    ratio = float(x[0] / x[-1])
    return 100 * (ratio - 1), 100 * ratio * float(np.hypot(*(std / x)[[0, -1]]))
