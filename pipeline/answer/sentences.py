"""The first screen: the verdict, which model the values are of, why, and what that changes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.answer.findings import Findings
from pipeline.answer.numbers import left_out_mm
from pipeline.answer.recommended import Which
from pipeline.answer.words import because, why
from pipeline.base.quantities import common_prefix, plain, prefixed, with_std
from pipeline.system.estimate import fits
from pipeline.system.system import Estimate

_FAR = 3.0
"""A stiffness that differs by more standard uncertainties between two models is mentioned."""

_TOLD = 3
"""So many of them, those that move most."""

_Json = Mapping[str, Any]


def sentences(found: Findings, answer: _Json) -> list[str]:
    """What an engineer must know first, most important first.

    Args:
        found: All that was found out.
        answer: result.json, but for these sentences.
    """
    springs, other = answer["joint_springs"], _other(found)
    said = [_verdict(found)]
    if other:
        moves = _moved(answer["stiffness"], springs["stiffness"])
        said += [f"Compared with {other}, {move}." for move in moves]
        said += _deflection(answer["test_pose_deflection"], springs["test_pose_deflection"], found)
    return [*said, _rest(found, answer["stiffness"])]


def _other(found: Findings) -> str:
    """What the answer is not: joint springs alone, data as given, both, or nothing."""
    alone = [] if found.row.model == Which.JOINT_SPRINGS else ["joint springs alone"]
    return " and ".join([*alone, *(["the data as given"] if found.mistakes else [])])


def _verdict(found: Findings) -> str:
    """What holds, and which model the values are from."""
    said, values = why(found.facts), because(found.row.reason)
    estimate = found.told.values.fitted.estimate
    if found.mistakes:
        return f"{said} {values}"
    if not fits(estimate) and estimate.p_value is None and found.row.model == Which.JOINT_SPRINGS:
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
    if found.verdict == "adequate":
        return (
            "The joint stiffness model explains the measured deflections"
            f"{_larger_scatter(estimate)}."
        )
    return f"{values} {said}"


def _larger_scatter(estimate: Estimate) -> str:
    """Clause of a model that misses nothing, where readings scatter more than their noise."""
    if estimate.p_value is None or fits(estimate):
        return ""
    factor = float(np.sqrt(estimate.chi2 / estimate.dof))
    return (
        f", but for scatter {factor:.2f} times as large as the noise that is used "
        f"(p = {estimate.p_value:.0e}): take every uncertainty that many times larger"
    )


def _moved(mine: Sequence[_Json], springs: Sequence[_Json]) -> Iterable[str]:
    """Stiffnesses that move by far more than either model's uncertainty."""
    off = []
    for a, b in zip(mine, springs, strict=True):
        if a["value"] and b["value"] and b["compliance_std"]:
            most = max(a["compliance_std"], b["compliance_std"])
            if abs(a["compliance"] - b["compliance"]) > _FAR * most:
                off.append((abs(math.log(a["value"] / b["value"])), a, b))
    far = sorted(off, key=lambda one: -one[0])[:_TOLD]
    if far:
        yield _listed([_move(a, b) for _, a, b in far])


def _move(mine: _Json, springs: _Json) -> str:
    factor, letter = common_prefix([mine["value"]])
    before, after = (
        with_std(one["value"] / factor, one["std"] / factor) for one in (springs, mine)
    )
    return f"{mine['name']} moves from {before} to {after} {prefixed(mine['unit'], letter)}"


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _deflection(mine: Sequence[_Json], springs: Sequence[_Json], found: Findings) -> Iterable[str]:
    """What the model changes at the test pose, at the target that moves most."""
    sizes = [[math.hypot(*(e[f"d{a}_mm"] for a in "xyz")) for e in s] for s in (mine, springs)]
    if not sizes[0] or not np.all(np.isfinite(sizes)):
        return
    k = int(np.argmax(sizes[0]))
    where = "the test pose" if found.where.stated else "the pose of the strongest pull"
    now, before = (plain(size[k]) for size in sizes)
    other = "the same" if now == before else f"{before} mm"
    yield (
        f"At {where}, {mine[k]['target']} is predicted to deflect by {now} mm "
        f"({other} {_instead(found)})."
    )


def _instead(found: Findings) -> str:
    """How the other values beside the answer's were computed."""
    alone = [] if found.row.model == Which.JOINT_SPRINGS else ["with joint springs alone"]
    return ", ".join([*alone, *(["from the data as given"] if found.mistakes else [])])


def _rest(found: Findings, stiffness: Sequence[_Json]) -> str:
    """How many stiffnesses have a value, and how well left-out poses are predicted."""
    good = [entry for entry in stiffness if entry["value"] is not None]
    half = [entry["name"] for entry in good if entry["ci95"][1] is None]
    some = "All" if len(good) == len(stiffness) else f"{len(good)} of {len(stiffness)}"
    lost = [entry["name"] for entry in stiffness if entry["value"] is None]
    limits = f" (not {_listed(lost)})" if lost else ""
    limits += f", {', '.join(half)} without an upper limit" if half else ""
    if not good:
        return "These pulls determine no stiffness."
    error, without = (left_out_mm(one.values.left_out_m) for one in (found.told, found.springs))
    if error is None:
        told = "no pose can be predicted from the others"
    elif without is None or found.told.values is found.springs.values:
        told = f"poses left out of the estimate are predicted to {plain(error)} mm"
    else:
        told = (
            f"poses left out of the estimate are predicted to {plain(error)} mm "
            f"({plain(without)} mm {_instead(found)})"
        )
    return f"{some} stiffnesses are estimated{limits}, and {told}."
