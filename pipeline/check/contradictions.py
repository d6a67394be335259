"""What readings and forces contradict of campaign.toml and the robot file: facts and sentences."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pipeline.answer.contract import CommonFactor, Overload, Stiffness
from pipeline.answer.results import AgainstStated, CampaignResults
from pipeline.base.errors import place
from pipeline.base.quantities import plain
from pipeline.base.toml import line_of
from pipeline.faults.entries import DoubtfulEntry, wrong_entries
from pipeline.machine.effect import Pulls
from pipeline.machine.instrument import sheet
from pipeline.machine.robot import Robot, rating
from pipeline.reduction.case import Case
from pipeline.reduction.settings import Settings
from pipeline.system.beam import BeamNoise
from pipeline.system.specimen import SURE, common, has_stated_stiffness
from pipeline.system.variance import Components


def against_stated(found: CampaignResults, joints: Sequence[Stiffness]) -> AgainstStated:
    """What the readings say against what was stated.

    Args:
        found: What is known of the campaign.
        joints: The stiffnesses of the answer.
    """
    text = found.raw.files["campaign.toml"].decode("utf-8", "replace")
    factor = common_factor(found.raw.robot, joints)
    sentences = [
        *overstated(found.raw.settings, found.right.noise),
        *entry_findings(found.right.case, text),
        *told_factor(factor),
    ]
    overload = overload_entry(found.raw.robot, found.right.reduced.data.pulls)
    return AgainstStated(sentences, factor, overload)


def entry_findings(case: Case, text: str) -> list[str]:
    """A sentence on a wrong entry, with its line; one per candidate if several are possible.

    Args:
        case: The campaign, with the mistakes in its readings corrected.
        text: Its campaign.toml.
    """
    if case.settings.tracker is None:
        return []
    found = wrong_entries(case)
    return [
        f"{place('campaign.toml', line_of(text, one.path))}{contradicted(text, one, found)}."
        for one in found
    ]


def contradicted(text: str, one: DoubtfulEntry, found: Sequence[DoubtfulEntry]) -> str:
    """How the readings contradict an entry, and what to do."""
    if not one.names:
        unit = {"in": "inches"}.get(str(one.unit), one.unit)
        return f"[{one.table}] is in {unit}, as the distances as read show; write it in metres"
    if len(one.names) == 2:
        line = line_of(text, [one.table, one.names[1]])
        return (
            f"{one.names[0]} and {one.names[1]} (line {line}) in [{one.table}] have each other's "
            "coordinates; exchange them"
        )
    where = ", ".join(f"{x:.4f}" for x in one.found)
    other = [" and ".join(rival.names) or rival.table for rival in found if rival is not one]
    maybe = f" (or {' or '.join(other)})" if other else ""
    return (
        f"{one.names[0]} in [{one.table}] is {in_mm(one.off_m)} from where the readings place it"
        f"{maybe}: about [{where}], ± {in_mm(float(one.std.max()))}; measure it again, and correct "
        "the line"
    )


def in_mm(metres: float) -> str:
    """A length [m] in mm, to three significant digits."""
    return f"{plain(1e3 * metres, 3)} mm"


_FEWEST = 2
"""Minimum number of joints for a common factor; the ratio of a single joint may have other
reasons."""


def common_factor(robot: Robot, joints: Sequence[Stiffness]) -> CommonFactor | None:
    """The common factor of all stiffnesses, if it exceeds the variation between specimens.

    Args:
        robot: The robot, with the stiffnesses stated in its file.
        joints: The stiffnesses of the answer.
    """
    both = [
        (float(one.value), one.std or 0.0, joint)
        for one, joint in zip(joints, robot.joints, strict=True)
        if one.identifiable and one.value and has_stated_stiffness(joint)
    ]
    if len(both) < _FEWEST:
        return None
    value, std, known = zip(*both, strict=True)
    found = common(np.array(value), np.array(std), known)
    if found.beyond < SURE:
        return None
    return CommonFactor(
        value=float(np.exp(found.g)), ci95=found.ci95, joints=len(both), probability=found.beyond
    )


def told_factor(fact: CommonFactor | None) -> list[str]:
    """A sentence on the common factor; none without one."""
    if fact is None:
        return []
    low, high = (plain(end, 2) for end in fact.ci95)
    return [
        f"The stiffnesses are about {plain(fact.value, 2)} times ({low} to {high}) those of the "
        "robot file, all of them alike: check the unit of the force column and the scale, or the "
        "stiffnesses in the file; a factor common to all forces shows in no residual."
    ]


def overload_entry(robot: Robot, pulls: Pulls) -> Overload | None:
    """The strongest pull, if the robot could not hold it; None also if no payload is stated."""
    force = np.linalg.norm(pulls.force, axis=1)
    if not len(force):
        return None
    hardest = int(force.argmax())
    times = rating.payloads(robot, float(force[hardest]))
    if robot.payload_kg is None or times is None or times <= rating.ABSURD:
        return None
    return Overload(
        pose=int(pulls.pose[hardest]),
        repeat=int(pulls.repeat[hardest]),
        force_n=float(force[hardest]),
        payload_kg=robot.payload_kg,
        times=times,
    )


def overloaded(fact: Overload | None) -> list[str]:
    """A sentence on an overload; none without one."""
    if fact is None:
        return []
    return [
        f"The hardest pull, {plain(fact.force_n)} N in pose {fact.pose}, is {plain(fact.times, 2)} "
        f"times the weight of the {fact.payload_kg:g} kg that the robot carries: check the "
        "unit of the loads, and whether campaign.toml names the right robot."
    ]


def overstated(settings: Settings, found: Components) -> list[str]:
    """A sentence on each noise component that is stated much larger than the scatter found."""
    return [
        _TOLD[found.name[i]](settings, float(found.scale[i]))
        for i in np.flatnonzero(found.smaller).tolist()
    ]


def _tracker(settings: Settings, scale: float) -> str:
    tables = {"tracker": settings.tracker, "displacements": settings.displacements}
    said = next(((name, one.sigma_m) for name, one in tables.items() if one and one.sigma_m), None)
    if said is None:
        return (
            f"The readings scatter {plain(1 / scale, 2)} times less than their stated noise: every "
            "interval rests on the scatter that was found. Correct the stated one; is it in "
            "another unit?"
        )
    name, sigma_m = said
    return (
        f"[{name}] sigma_m states {plain(1e3 * sigma_m)} mm, and repeated readings scatter by "
        f"{plain(1e3 * scale * sigma_m, 2)} mm: every interval rests on the latter. Correct "
        "sigma_m, which is in metres."
    )


def _force(settings: Settings, scale: float) -> str:
    setting = settings.loads_log
    parts = {
        f"{plain(setting.sigma_n)} N": setting.sigma_n,
        f"{setting.sigma_rel:.3%}": setting.sigma_rel,
    }
    stated = " and ".join(part for part, size in parts.items() if size)
    return (
        f"[scale] states {stated} for a reading, and its readings scatter at least "
        f"{plain(1 / scale, 2)} times less: every interval rests on that. Correct sigma_n, which "
        "is in newtons, or sigma_rel, which is relative."
    )


_TOLD: dict[str, Callable[[Settings, float], str]] = {"tracker": _tracker, "force_reading": _force}


def along_the_beam(settings: Settings, found: BeamNoise) -> list[str]:
    """A sentence if the scatter along the beam is less than the one value stated for all axes."""
    if not found.better:
        return []
    along, across = found.found
    angles = f"{plain(across, 2)} times as much" if abs(across - 1) >= _SOME else "as stated"
    return [
        f"Along the beam the tracker scatters {plain(1 / along, 2)} times less than stated, "
        f"across it {angles}: every reading is weighed by both.{_both_parts(settings)}"
    ]


def _both_parts(settings: Settings) -> str:
    """How to state both parts, where one value is stated for all axes."""
    model = settings.instrument.model
    if settings.reading_noise is not None:
        return ""
    if model is None:
        way = "give its type as [instrument] model, or both parts as [tracker] noise"
    elif sheet(model) is None:
        way = "give both parts as [tracker] noise"
    else:
        way = "leave out [tracker] sigma_m: the data sheet of the [instrument] model has both"
    return f" To state them yourself, {way}."


_SOME = 0.05
"""Relative difference of two standard uncertainties from which on they are reported as different
[1]; none is stated more accurately."""
