"""Finished campaigns: which one is the previous, and which stiffnesses have changed."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy import special

from pipeline.answer.archive import Finished, read, with_digest
from pipeline.answer.contract import Answer, Stiffness
from pipeline.base import files
from pipeline.base.errors import UsageError
from pipeline.store.campaign import CampaignFolder, dump

NO_SCATTER: Mapping[str, float] = MappingProxyType({})

FALSE_ALARM = 0.01
"""False-alarm probability over all joints of a robot together [1]."""


@dataclass(frozen=True)
class Change:
    """One stiffness in two campaigns, or in two models.

    Attributes:
        name: Name, `k_theta2`.
        before: First stiffness [unit of the joint]; None if it has no value.
        after: Second stiffness, likewise.
        percent: Change relative to `before` [%]; None if one is missing.
        percent_std: Standard uncertainty of `percent` for independent campaigns, else None.
        sigmas: Change of the compliance in standard uncertainties of the difference; None where it
            is not tested.
        sure: Whether the change is significant at `FALSE_ALARM` for all joints together.
    """

    name: str
    before: float | None
    after: float | None
    percent: float | None
    percent_std: float | None
    sigmas: float | None
    sure: bool


def ordered(answers: Iterable[Answer]) -> list[Answer]:
    """Sort answers by date, undated ones last, and then by name."""
    return sorted(answers, key=lambda one: (one.measured or "9999", one.campaign))


def trusted(answer: Answer) -> bool:
    """Whether a campaign's stiffnesses and uncertainties are valid for comparisons."""
    return answer.recommended.reason.holds_for_its_readings


def alike(a: Answer, b: Answer) -> bool:
    """Whether the stiffnesses of two campaigns are comparable.

    Those from the arm's own weight have the relative error of the masses in the robot file, those
    from pulls that of the scale; a difference between the two kinds is not a change of the machine.
    """
    return a.of_positions == b.of_positions


def previous(answer: Answer, answers: Iterable[Answer]) -> Answer | None:
    """The last comparable campaign of the same machine that was measured earlier, or None.

    Undated campaigns and campaigns whose values are not valid (`trusted`) do not count.
    """
    now = answer.measured
    earlier = [
        other
        for other in answers
        if other.machine == answer.machine
        and alike(other, answer)
        and _precedes(other.measured, now)
        and trusted(other)
    ]
    return ordered(earlier)[-1] if earlier else None


def _precedes(day: str | None, now: str | None) -> bool:
    """Whether a campaign was measured before another by their dates; False if one has none."""
    return bool(day and now) and str(day) < str(now)


def of_one_day(a: Answer, b: Answer) -> bool:
    """Whether two campaigns are of one day, so that day-to-day scatter does not apply."""
    return bool(a.measured and b.measured) and day_of(a) == day_of(b)


def day_of(answer: Answer) -> str:
    """The day of a campaign, from the date or time of its answer."""
    return str(answer.measured)[:10]


def compliance(joint: Stiffness) -> tuple[float, float] | None:
    """Compliance and its standard uncertainty; None if the campaign does not determine it."""
    value, std = joint.compliance, joint.compliance_std
    if value is None or std is None or std <= 0 or not joint.identifiable:
        return None
    return value, std


def changes(
    before: Sequence[Stiffness],
    after: Sequence[Stiffness],
    independent: bool = True,
    scatter: Mapping[str, float] = NO_SCATTER,
) -> list[Change]:
    """Differences between two lists of stiffnesses, joint by joint.

    Compliances are tested, because their errors are normally distributed. Two models of one
    campaign share its errors, so that their differences are not tested (`independent` False).

    Args:
        before: Stiffnesses of the first campaign or model.
        after: Stiffnesses of the second.
        independent: Whether the two share no errors.
        scatter: Relative standard deviation of a stiffness from day to day [1], by name, if known
            from the campaigns of the robot.
    """
    pairs = {joint.name: joint for joint in before}
    both = [
        (pairs[joint.name], _on_side_of(pairs[joint.name], joint))
        for joint in after
        if joint.name in pairs
    ]
    tested = sum(bool(compliance(a) and compliance(b)) for a, b in both)
    limit = float(-special.ndtri(FALSE_ALARM / 2 / max(tested, 1)))
    return [_change(a, b, limit, independent, scatter.get(b.name, 0.0)) for a, b in both]


def _on_side_of(before: Stiffness, after: Stiffness) -> Stiffness:
    """The later stiffness, for the sign of the torque to which the earlier one refers.

    The load may turn a joint differently at the test poses of the two campaigns.
    """
    mine, its = before.by_sign, after.by_sign
    if mine is None or its is None or mine.value_of == its.value_of:
        return after
    one = its.positive if mine.value_of == "positive" else its.negative
    names = ("value", "std", "ci95", "compliance", "compliance_std")
    return after.model_copy(update={name: getattr(one, name) for name in names})


def _change(a: Stiffness, b: Stiffness, limit: float, independent: bool, scatter: float) -> Change:
    k_a, k_b = _stiffness(a), _stiffness(b)
    x_a, x_b = _on_a_day(compliance(a), scatter), _on_a_day(compliance(b), scatter)
    sigmas = percent = std = None
    if x_a and x_b and independent:
        sigmas = (x_b[0] - x_a[0]) / float(np.hypot(x_a[1], x_b[1]))
    if k_a and k_b:
        percent = 100 * (k_b - k_a) / k_a
        if x_a and x_b and independent:  # ln k = -ln x
            std = 100 * k_b / k_a * float(np.hypot(x_a[1] * k_a, x_b[1] * k_b))
    sure = sigmas is not None and abs(sigmas) > limit
    return Change(b.name, k_a, k_b, percent, std, sigmas, sure)


def _on_a_day(found: tuple[float, float] | None, scatter: float) -> tuple[float, float] | None:
    """A compliance, with the day-to-day scatter [1] added to its standard uncertainty."""
    return found and (found[0], float(np.hypot(found[1], scatter * found[0])))


def _stiffness(joint: Stiffness) -> float | None:
    return joint.value if joint.identifiable and joint.value else None


def since(previous: Answer | None, answer: Answer) -> tuple[list[Change], bool]:
    """Changes since the robot's previous campaign, and whether both are of one day.

    There are none if the two cannot be compared.
    """
    if previous is None or not trusted(answer):
        return [], False
    return changes(previous.stiffness, answer.stiffness), of_one_day(previous, answer)


def finished(root: Path, tell: Callable[[str], object] = str) -> list[Finished]:
    """Campaigns with a finished result, sorted by name; their raw folders may no longer exist.

    Args:
        root: Root of the project.
        tell: Called with a sentence on each campaign that is omitted because this version cannot
            read its result.
    """
    out = []
    for campaign, _ in _with_manifest(root):
        try:
            out.append(with_digest(campaign))
        except UsageError as problem:
            tell(str(problem))
    return out


def _with_manifest(root: Path) -> Iterator[tuple[CampaignFolder, dict[str, Any]]]:
    for path in sorted((root / "reports").glob("*/result.json")):
        campaign = CampaignFolder(root, root / "data" / "raw" / path.parent.name)
        manifest = campaign.manifest()
        if manifest is not None:  # the folder of a campaign that was run by path is elsewhere
            yield CampaignFolder(root, root / manifest.get("source", campaign.folder)), manifest


def earlier(campaign: CampaignFolder, answer: Answer) -> Answer | None:
    """The answer to the same robot's previous finished campaign; None without one.

    Candidates are chosen by their manifests, and read from the latest day backwards, to avoid
    reading the hundreds of campaigns of a whole plant.
    """
    by_day: dict[str, list[CampaignFolder]] = {}
    for other, manifest in _with_manifest(campaign.root):
        day = manifest.get("measured", _LONG_AGO)
        alike = all(manifest.get(key, said) == said for key, said in _machine(answer).items())
        if alike and _precedes(day, answer.measured):
            by_day.setdefault(day, []).append(other)
    found = _readable(by_day.pop(_LONG_AGO, []))
    for day in sorted(by_day, reverse=True):
        found += _readable(by_day[day])
        last = previous(answer, found)
        if last is not None and str(last.measured) >= day:
            return last
    return previous(answer, found)


def _readable(campaigns: list[CampaignFolder]) -> list[Answer]:
    found = []
    for one in campaigns:
        with contextlib.suppress(UsageError):
            found.append(read(one))
    return found


_LONG_AGO = "0000"
"""Date assumed for a manifest of an earlier version, which did not contain one."""


def about(answer: Answer) -> dict[str, str | None]:
    """Entries of the manifest by which `earlier` selects campaigns without reading answers."""
    return _machine(answer) | {"measured": answer.measured}


def _machine(answer: Answer) -> dict[str, str | None]:
    return {"robot": answer.robot, "machine": answer.machine}


def mark(before: Answer | None) -> str | None:
    """Digest of the part of the previous answer on which a report depends; None without one."""
    if before is None:
        return None
    stiffness = [joint.model_dump(mode="json") for joint in before.stiffness]
    return files.sha256(dump([before.campaign, stiffness]))
