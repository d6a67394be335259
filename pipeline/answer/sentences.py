"""The first screen: the verdict, which model the values are of, why, and what that changes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from pipeline.answer.contract import Combination, Deflection, Stiffness, Values, Which
from pipeline.answer.findings import Findings
from pipeline.answer.numbers import left_out_mm
from pipeline.answer.words import BECAUSE, listed, why
from pipeline.base.quantities import common_prefix, plain, prefixed, scaled, with_std
from pipeline.system.estimate import fits
from pipeline.system.system import Estimate

_FAR = 3.0
"""A stiffness that differs by more standard uncertainties between two models is mentioned."""

_TOLD = 3
"""So many of them, those that move most."""


def sentences(
    found: Findings, mine: Values, springs: Values, together: Sequence[Combination]
) -> list[str]:
    """What an engineer must know first, most important first.

    Args:
        found: All that was found out.
        mine: The values that the answer stands for.
        springs: Those of the joint springs on the data as given.
        together: What is determined of several joints together.
    """
    said = [_verdict(found)]
    if other := _other(found, "joint springs alone", "the data as given"):
        moves = _moved(mine.stiffness, springs.stiffness)
        said += [f"Compared with {' and '.join(other)}, {move}." for move in moves]
        said += _deflection(mine.test_pose_deflection, springs.test_pose_deflection, found)
    return [*said, _rest(found, mine.stiffness, together)]


def _other(found: Findings, springs: str, data: str) -> list[str]:
    """What the answer is not, in these words: joint springs alone, data as given, or neither."""
    alone = [] if found.row.model == Which.JOINT_SPRINGS else [springs]
    return [*alone, *([data] if found.mistakes else [])]


def _verdict(found: Findings) -> str:
    """What holds, and which model the values are from."""
    said, values = why(found.facts), BECAUSE[found.row.reason]
    fitted = found.told.values.fitted
    estimate, good = fitted.estimate, fits(fitted.estimate, fitted.data.tracked)
    if found.mistakes:
        return f"{said} {values}"
    if not good and estimate.p_value is None and found.row.model == Which.JOINT_SPRINGS:
        left = 1e3 * estimate.residual_std_m
        return (
            f"The joint stiffness model does not fit as well as a tracker measures: {left:.3f} mm "
            f"remain. {said}"
        )
    if found.verdict == "unexplained":
        return (
            "The joint stiffness model does not explain the measured deflections: do not rely on "
            f"the stated uncertainties. {said}"
        )
    if found.verdict == "adequate" and estimate.dof < 1:
        return "These pulls leave nothing to test the joint stiffness model with."
    if found.verdict == "adequate":
        return (
            "The joint stiffness model explains the measured deflections"
            f"{'' if good else _larger_scatter(estimate)}."
        )
    return f"{values} {said}"


def _larger_scatter(estimate: Estimate) -> str:
    """Clause of a model that misses nothing, where readings scatter more than their noise."""
    if estimate.p_value is None:
        return ""
    factor = float(np.sqrt(estimate.chi2 / estimate.dof))
    return (
        f", but for scatter {factor:.2f} times as large as the noise that is used "
        f"(p = {estimate.p_value:.0e}): take every uncertainty that many times larger"
    )


def _moved(mine: Sequence[Stiffness], springs: Sequence[Stiffness]) -> Iterable[str]:
    """Stiffnesses that move by far more than either model says that they may be off."""
    off = []
    for a, b in zip(mine, springs, strict=True):
        if a.value and b.value and _sigmas(a, b) > _FAR:
            off.append((abs(math.log(a.value / b.value)), a, b))
    far = sorted(off, key=lambda one: -one[0])[:_TOLD]
    if far:
        yield listed([_move(a, b) for _, a, b in far])


def _sigmas(a: Stiffness, b: Stiffness) -> float:
    """How far two compliances lie apart, in the larger of their standard uncertainties."""
    if a.compliance is None or b.compliance is None:
        return 0.0
    most = max(a.compliance_std or 0.0, b.compliance_std or 0.0)
    return abs(a.compliance - b.compliance) / most if b.compliance_std else 0.0


def _move(mine: Stiffness, springs: Stiffness) -> str:
    factor, letter = common_prefix([mine.value])
    before, after = (
        with_std(scaled(one.value, factor), scaled(one.std, factor)) for one in (springs, mine)
    )
    return f"{mine.name} moves from {before} to {after} {prefixed(mine.unit, letter)}"


def _deflection(
    mine: Sequence[Deflection], springs: Sequence[Deflection], found: Findings
) -> Iterable[str]:
    """What the model changes at the test pose, at the target that moves most."""
    sizes = [[one.size_mm for one in those if one.size_mm is not None] for those in (mine, springs)]
    if not sizes[0] or not len(sizes[0]) == len(sizes[1]) == len(mine):
        return
    k = int(np.argmax(sizes[0]))
    where = "the test pose" if found.where.stated else "the pose of the strongest pull"
    now, before = (plain(size[k]) for size in sizes)
    other = "the same" if now == before else f"{before} mm"
    yield (
        f"At {where}, {mine[k].target} is predicted to deflect by {now} mm "
        f"({other} {_instead(found)})."
    )


def _instead(found: Findings) -> str:
    """How the other values beside the answer's were computed."""
    return ", ".join(_other(found, "with joint springs alone", "from the data as given"))


def _rest(found: Findings, stiffness: Sequence[Stiffness], together: Sequence[Combination]) -> str:
    """How many stiffnesses have a value, and how well left-out poses are predicted."""
    if any(joint.value is not None for joint in stiffness):
        return f"{_estimated(stiffness, together)}, and {_predicted(found)}."
    if together:
        many = f"{len(together)} combination{'s' * (len(together) > 1)}"
        return f"These pulls determine no stiffness by itself, but {many} of compliances."
    return "These pulls determine no stiffness and no combination of stiffnesses."


def _estimated(stiffness: Sequence[Stiffness], together: Sequence[Combination]) -> str:
    good = [joint for joint in stiffness if joint.value is not None]
    lost = [joint.name for joint in stiffness if joint.value is None]
    half = [joint.name for joint in good if joint.ci95[1] is None]
    some = f"{len(good)} of {len(stiffness)}" if lost else "All"
    limits = f" (not {listed(lost)})" if lost else ""
    limits += f", {', '.join(half)} without an upper limit" if half else ""
    mixed = (
        f", and {len(together)} combination{'s' * (len(together) > 1)} of them" if together else ""
    )
    return f"{some} stiffnesses are estimated{limits}{mixed}"


def _predicted(found: Findings) -> str:
    """How far poses that were left out are missed, also by the values beside the answer's."""
    error, without = (left_out_mm(one.values.left_out_m) for one in (found.told, found.springs))
    if error is None:
        return "no pose can be predicted from the others"
    told = f"poses left out of the estimate are predicted to {plain(error)} mm"
    if without is None or found.told.values is found.springs.values:
        return told
    return f"{told} ({plain(without)} mm {_instead(found)})"
