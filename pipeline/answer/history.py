"""Two campaigns compared, and all campaigns of a robot over time; pure, from their results."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from typing import Any

import numpy as np
from scipy import special

from pipeline.answer.recommended import TABLE
from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.base.quantities import known

Result = Mapping[str, Any]
"""The object of result.json."""

_SURE = 0.01
"""Probability of a false alarm over all joints of a robot together."""

_DAYS_A_YEAR = 365.25


@dataclass(frozen=True)
class Change:
    """One stiffness in two campaigns, or in two models.

    Attributes:
        name: `k_theta2`.
        before: Stiffness [unit of the joint], None where there is none.
        after: As before.
        percent: Change of the stiffness in percent of before, None where one is missing.
        percent_std: Its standard uncertainty, the two being independent.
        sigmas: Change of the compliance in standard uncertainties of the difference.
        sure: More than chance explains, all joints considered.
    """

    name: str
    before: float | None
    after: float | None
    percent: float | None
    percent_std: float | None
    sigmas: float | None
    sure: bool


@dataclass(frozen=True)
class Trend:
    """One stiffness over the campaigns of a robot.

    Attributes:
        name: `k_theta2`.
        campaigns: How many determine it.
        first_to_last: Change from the first to the last in percent of the first.
        first_to_last_std: Its standard uncertainty.
        p_value: Chance of as much scatter between the campaigns if nothing changed, chi-square.
        percent_a_year: Slope in percent of the mean per year, None below three dated campaigns.
        percent_a_year_std: Its standard uncertainty.
        sure: More than chance explains, all joints considered.
    """

    name: str
    campaigns: int
    first_to_last: float | None
    first_to_last_std: float | None
    p_value: float | None
    percent_a_year: float | None
    percent_a_year_std: float | None
    sure: bool


def ordered(results: Iterable[Result]) -> list[Result]:
    """By date, undated ones last, then by name."""
    return sorted(results, key=lambda r: (r.get("measured") or "9999", str(r.get("campaign"))))


def robots(results: Sequence[Result]) -> dict[str, list[Result]]:
    """Campaigns in order, by robot."""
    out: dict[str, list[Result]] = {}
    for result in ordered(results):
        out.setdefault(str(result.get("robot")), []).append(result)
    return dict(sorted(out.items()))


def trusted(result: Result) -> bool:
    """Whether a campaign's stiffnesses, with their uncertainties, may show a change."""
    reason = (result.get("recommended") or {}).get("reason")
    if reason is None:  # of a version that had joint springs only
        return (result.get("diagnosis") or {}).get("verdict") == "adequate"
    return any(row.reason == reason and row.holds_for_its_readings for row in TABLE)


def previous(result: Result, results: Iterable[Result]) -> Result | None:
    """The last campaign of the same robot that was measured earlier; None if there is none.

    A campaign whose model does not explain its readings does not count.
    """
    now = result.get("measured")
    earlier = [
        other
        for other in results
        if now
        and other.get("robot") == result.get("robot")
        and other.get("measured")
        and other["measured"] < now
        and trusted(other)
    ]
    return ordered(earlier)[-1] if earlier else None


def compliance(joint: Mapping[str, Any]) -> tuple[float, float] | None:
    """Compliance and its standard uncertainty, None where the campaign does not determine it."""
    value, std = joint.get("compliance"), joint.get("compliance_std")
    if not (known(value) and known(std)) or std <= 0 or not joint.get("identifiable", True):
        return None
    return float(value), float(std)


def changes(before: Sequence[Any], after: Sequence[Any], independent: bool = True) -> list[Change]:
    """Joint by joint, how two lists of stiffness entries differ.

    Compliances are compared, because their errors are normal. Two models of one campaign share
    its errors: what they differ by is then not tested (`independent` False).
    """
    pairs = {j.get("name"): j for j in before}
    both = [(pairs[j.get("name")], j) for j in after if j.get("name") in pairs]
    tested = sum(bool(compliance(a) and compliance(b)) for a, b in both)
    limit = float(-special.ndtri(_SURE / 2 / max(tested, 1)))
    return [_change(a, b, limit, independent) for a, b in both]


def _change(a: Mapping[str, Any], b: Mapping[str, Any], limit: float, independent: bool) -> Change:
    name, k_a, k_b = str(b.get("name")), _stiffness(a), _stiffness(b)
    x_a, x_b = compliance(a), compliance(b)
    sigmas = percent = std = None
    if x_a and x_b and independent:
        sigmas = (x_b[0] - x_a[0]) / float(np.hypot(x_a[1], x_b[1]))
    if k_a and k_b:
        percent = 100 * (k_b - k_a) / k_a
        if x_a and x_b and independent:  # ln k = -ln x
            std = 100 * k_b / k_a * float(np.hypot(x_a[1] * k_a, x_b[1] * k_b))
    return Change(name, k_a, k_b, percent, std, sigmas, sigmas is not None and abs(sigmas) > limit)


def _stiffness(joint: Mapping[str, Any]) -> float | None:
    value = joint.get("value")
    return float(value) if known(value) and joint.get("identifiable", True) and value else None


def together(
    before: Sequence[Any], after: Sequence[Any], cov_before: Array, cov_after: Array
) -> tuple[float, int]:
    """Chi-square of all compliances together and its degrees of freedom, correlations included.

    Args:
        before: Stiffness entries, all joints.
        after: As before, of another campaign.
        cov_before: Covariance of the compliances of `before` [SI], shape (n, n).
        cov_after: As before.
    """
    use = [
        i
        for i, (a, b) in enumerate(zip(before, after, strict=True))
        if compliance(a) and compliance(b)
    ]
    if not use:
        return 0.0, 0
    difference = np.array([after[i]["compliance"] - before[i]["compliance"] for i in use])
    cov = (np.asarray(cov_before) + np.asarray(cov_after))[np.ix_(use, use)]
    scale = np.sqrt(np.diag(cov))
    scaled = difference / scale
    return float(scaled @ linear.solve(cov / np.outer(scale, scale), scaled)), len(use)


def chance(chi2: float, dof: int) -> float | None:
    """Probability of a chi-square this large or larger."""
    return float(special.chdtrc(dof, chi2)) if dof > 0 else None


def trends(results: Sequence[Result]) -> list[Trend]:
    """Every stiffness of one robot over its campaigns, which come in order; those trusted count."""
    names = list(dict.fromkeys(j.get("name") for r in results for j in r.get("stiffness") or []))
    counted = [result for result in results if trusted(result)]
    series = {str(name): _series(counted, name) for name in names}
    tested = sum(len(points) > 1 for points in series.values())
    return [_trend(name, points, max(tested, 1)) for name, points in series.items()]


def _series(results: Sequence[Result], name: Any) -> list[tuple[str | None, float, float]]:
    """Date, compliance and its standard uncertainty, of the campaigns that determine it."""
    out = []
    for result in results:
        for joint in result.get("stiffness") or []:
            here = compliance(joint) if joint.get("name") == name else None
            if here:
                out.append((result.get("measured"), *here))
    return out


def _trend(name: str, points: list[tuple[str | None, float, float]], tested: int) -> Trend:
    if len(points) < 2:
        return Trend(name, len(points), None, None, None, None, None, sure=False)
    x, std = np.array([p[1] for p in points]), np.array([p[2] for p in points])
    mean = np.average(x, weights=std**-2)
    p_scatter = chance(float(np.sum(((x - mean) / std) ** 2)), len(x) - 1)
    slope, slope_std = _slope([p[0] for p in points], x, std)
    p_slope = 1.0 if slope is None else float(2 * special.ndtr(-abs(slope) / (slope_std or np.inf)))
    smallest = min(p_scatter if p_scatter is not None else 1.0, p_slope)
    share = (
        None
        if slope is None or slope_std is None
        else (-100 * slope / mean, 100 * slope_std / mean)
    )
    ratio = float(x[0] / x[-1]) if min(x[0], x[-1]) > 0 else None
    return Trend(
        name=name,
        campaigns=len(points),
        first_to_last=100 * (ratio - 1) if ratio else None,
        first_to_last_std=100 * ratio * float(np.hypot(*(std / x)[[0, -1]])) if ratio else None,
        p_value=p_scatter,
        percent_a_year=share[0] if share else None,
        percent_a_year_std=abs(share[1]) if share else None,
        sure=smallest < _SURE / 2 / tested,  # two looks at every joint
    )


def _slope(dates: Sequence[str | None], x: Array, std: Array) -> tuple[float | None, float | None]:
    """Weighted slope of the compliance per year and its standard uncertainty."""
    days = [date.fromisoformat(d[:10]).toordinal() for d in dates if d]
    if len(days) < len(x) or len(set(days)) < 3:
        return None, None
    t = np.array(days) / _DAYS_A_YEAR
    weight = std**-2
    t = t - np.average(t, weights=weight)
    size = float(np.sum(weight * t**2))
    return float(np.sum(weight * t * x) / size), size**-0.5
