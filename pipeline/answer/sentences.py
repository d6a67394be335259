"""The first screen: the verdict, what to do, which model, and what is asked of it, line by line."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.answer import remarks
from pipeline.answer.conformity import causes_differ, expanded, largest_force, tolerated
from pipeline.answer.contract import (
    About,
    BestPose,
    Combination,
    Diagnosis,
    Line,
    NextPose,
    Reason,
    Stiffness,
    TargetDeflection,
    TestPose,
    Tolerance,
    ToMeasure,
    Values,
    Which,
)
from pipeline.answer.inputs import lost_told
from pipeline.answer.pose_budget import lowered_by_pulls
from pipeline.answer.recommended import left_out_mm
from pipeline.answer.results import CampaignResults
from pipeline.answer.words import (
    DO,
    DO_DESPITE,
    HOLDS,
    at_axis,
    capital,
    clear,
    correct,
    counted,
    listed,
    loads,
    mistaken,
    noise_told,
    not_found,
    worst_known,
    wrong,
)
from pipeline.base.quantities import (
    common_prefix,
    p_value,
    percent,
    plain,
    prefixed,
    scaled,
    with_std,
    with_uncertainty,
)
from pipeline.base.shown import typed
from pipeline.diagnosis.facts import SEPARATED, Facts
from pipeline.diagnosis.finding import Verdict
from pipeline.diagnosis.verdict import CERTAIN, verdict
from pipeline.faults.mistake import in_common
from pipeline.prediction.decision import Decision
from pipeline.system.estimate import is_plausible
from pipeline.system.system import Estimate

_FAR = 3.0
"""A stiffness that differs by more standard uncertainties between two models is mentioned."""

_TOLD = 3
"""So many of them, those that move most."""

_WITH_THEM = "With them the cross-validation error is"

_SPRINGS_ALONE, _AS_GIVEN = "joint springs alone", "the data as given"
_ON_DELIVERED = "the geometry of the robot file"


@dataclass(frozen=True)
class FirstScreen:
    """What the first screen is about.

    Attributes:
        mine: The values that the answer stands for.
        springs: Those of the joint springs on the data as given.
        effective: Joint springs on the data on which the answer rests, for a controller.
        together: Combinations of compliances that are determined.
        diagnosis: What is wrong, and what to measure next.
        pose: The test pose.
        tolerance: What is decided by a tolerance; None without one.
        contradicted: Sentences on what was stated and the readings contradict.
    """

    mine: Values
    springs: Values
    effective: Sequence[Stiffness]
    together: Sequence[Combination]
    diagnosis: Diagnosis
    pose: TestPose
    tolerance: Tolerance | None
    contradicted: Sequence[str] = ()


def first_screen(found: CampaignResults, stated: FirstScreen) -> tuple[Line, ...]:
    """What an engineer must know first, most important first.

    Args:
        found: All that was found out.
        stated: What the answer says.
    """
    lines: list[tuple[About, str]] = [
        (
            About.TOLERANCE,
            tolerated(stated.tolerance, stated.pose, holds=_holds(found))
            if stated.tolerance
            else "",
        ),
        (About.VERDICT, f"{_verdict(found)} {capital(_predicted(found))}."),
        (About.TO_DO, " ".join((*_out(found, stated), _to_do(found, stated)))),
        (About.MODEL, " ".join(_model(found, stated))),
        (About.NUMBERS, " ".join((_for_controller(found, stated), *_uncalibrated(found, stated)))),
        (About.TEST_POSE, " ".join(_test_pose(found, stated))),
        *((About.WRONG, one) for one in _wrong(found, stated)),
        (About.NOT_FOUND, not_found(found.diagnosis.not_found) if _holds(found) else ""),
        (About.NEXT, _next(found, stated)),
    ]
    return tuple(Line(about=about, text=text) for about, text in lines if text)


def _holds(found: CampaignResults) -> bool:
    """Whether the answer's values explain the readings."""
    return found.row.reason.holds_for_its_readings


def _wrong(found: CampaignResults, stated: FirstScreen) -> tuple[str, ...]:
    """What is wrong, and after it, or before "nothing else", what the noise does; what is lost."""
    if found.facts.hopeless:
        return ("The error in the data that the verdict names; nothing else can be judged.",)
    noisy = tuple(noise_told(stated.diagnosis.causes))
    unseen, others = len(stated.diagnosis.blind_spots), (*stated.contradicted, *noisy)
    sentence = wrong(found.facts, unseen, others)
    rest = (*noisy, sentence) if clear(found.facts) else (sentence, *noisy)
    return (*stated.contradicted, *rest, *lost_told(found.given.case.lost))


def _other(found: CampaignResults, springs: str, data: str, delivered: str) -> list[str]:
    """What the answer is not, in these words: joint springs alone, data as given, or neither.

    Joint springs on the table as delivered, where the answer has them on the estimated one.
    """
    alone = [] if found.row.model == Which.JOINT_SPRINGS else [springs]
    if not alone and (found.facts.unloaded.corrects or found.facts.positions is not None):
        alone = [delivered]
    return [*alone, *([data] if found.mistakes else [])]


def _verdict(found: CampaignResults) -> str:
    """Whether the model holds."""
    fitted, reason = found.told.values.fitted, found.row.reason
    estimate, good = fitted.estimate, is_plausible(fitted.estimate, fitted.data.tracked)
    alone = found.row.model == Which.JOINT_SPRINGS or reason == Reason.TOO_SMALL
    if found.mistakes:
        shared = in_common(found.facts.mistakes, found.given.case.readings)
        return f"{mistaken(found.facts)}{f' {shared}' if shared else ''}"
    if alone and not good and estimate.p_value is None:
        left = 1e3 * estimate.residual_std_m
        return (
            f"The joint stiffness model does not fit as well as a tracker measures: {left:.3f} mm "
            "remain."
        )
    return _of_springs(estimate, good) if reason in _SPRINGS else _of_reason(found)


_SPRINGS = (Reason.ADEQUATE, Reason.TOO_SMALL)
"""For which the springs alone are given."""


def _of_reason(found: CampaignResults) -> str:
    """Whether a model of more than springs holds."""
    if found.row.reason == Reason.SPRINGS_UNTOUCHED and (beside := found.told.values.first.effects):
        return f"Joint springs and {listed([one.called for one in beside])} explain the readings."
    robot = _of_robot(found)
    return robot.holds if robot else HOLDS[found.row.reason]


def _open(found: CampaignResults) -> bool:
    """Whether the verdict is that more than one cause may be true."""
    return verdict(found.facts) is Verdict.AMBIGUOUS


@dataclass(frozen=True)
class _OfRobot:
    """What is said where joint springs hold on a robot that is not as its file says.

    Attributes:
        applies: Whether it is so, by the facts.
        holds: Whether the model holds.
        do: What to do with the values.
    """

    applies: Callable[[Facts], object]
    holds: str
    do: str


_UNDECIDED = _OfRobot(
    lambda _: True,
    "Joint springs explain the readings, but what displaces the unloaded reflectors is uncertain.",
    "Find out first which cause it is: the stiffnesses belong to the robot with the one that is "
    "named.",
)

_OF_ROBOT = (
    _OfRobot(
        lambda facts: facts.misdescribed,
        "Joint springs explain the readings on a robot that is not as its file says.",
        "Check type and file of the robot first. The stiffnesses belong to the corrected "
        "geometry, which model.toml holds; correct the robot file.",
    ),
    _OfRobot(
        lambda facts: facts.changed,
        "Joint springs explain the readings, in which something changed once.",
        f"{DO[Reason.ADEQUATE]} They allow for the change during the campaign. Positions of "
        "before and after it do not belong together.",
    ),
    _OfRobot(
        lambda facts: facts.moved,
        "Joint springs explain the readings on a robot that sags under its own weight.",
        f"{DO[Reason.ADEQUATE]} Where absolute positions matter, the arm's own weight moves "
        "them: a campaign of positions identifies how.",
    ),
)
"""The first that applies is said."""


def _of_robot(found: CampaignResults) -> _OfRobot | None:
    if found.row.reason != Reason.WEIGHED_ANEW:
        return None
    if _open(found):
        return _UNDECIDED
    return next((one for one in _OF_ROBOT if one.applies(found.facts)), None)


def _of_springs(estimate: Estimate, good: bool) -> str:
    """Whether joint springs alone hold."""
    if estimate.dof < 1:
        return "These pulls leave nothing to test the joint stiffness model with."
    return f"Joint springs explain the readings{'' if good else _larger_scatter(estimate)}."


def _larger_scatter(estimate: Estimate) -> str:
    """Clause of a model that misses nothing, where readings scatter more than their noise."""
    if estimate.p_value is None:
        return ""
    chance = p_value(estimate.p_value)
    if estimate.goodness.tails:  # single readings far off, which the uncertainties include
        return f", though even noise with such tails rarely leaves so much ({chance})"
    factor = float(np.sqrt(estimate.chi2 / estimate.dof))
    return (
        f", but their scatter exceeds the noise that is assumed by a factor of {factor:.2f} "
        f"({chance}): multiply every uncertainty by it"
    )


def _predicted(found: CampaignResults) -> str:
    """The cross-validation error, also of the values beside the answer's."""
    error, without = (left_out_mm(one.values.left_out_m) for one in (found.told, found.springs))
    if error is None:
        return "no pose can be predicted from the others"
    of = "" if found.facts.positions is None else " of displacements"
    text = f"cross-validation error{of} {plain(error)} mm rms per coordinate"
    if without is None or plain(without) == plain(error):
        return text
    return f"{text} ({plain(without)} mm {_instead(found)})"


def _instead(found: CampaignResults) -> str:
    """How the other values beside the answer's were computed."""
    return ", ".join(
        _other(found, f"with {_SPRINGS_ALONE}", f"from {_AS_GIVEN}", f"with {_ON_DELIVERED}")
    )


def _out(found: CampaignResults, stated: FirstScreen) -> Iterator[str]:
    """What a tolerance that is not kept asks for, before all else; nothing without a model."""
    asked = stated.tolerance if _holds(found) else None
    worst = None if asked is None else asked.worst
    if worst is Decision.FAIL:
        yield (
            "The deflection is out of tolerance without compensation: reduce the force"
            f"{_to_force(stated)}, choose other poses, or compensate the path."
        )
    elif worst is Decision.UNDECIDED:
        assert asked is not None
        differ = causes_differ(asked, stated.pose)
        why = ", since the possible causes decide differently" if differ else ""
        force = _to_force(stated)
        way = f"Conformity with the tolerance is undecided{why}: reduce the force{force}"
        if differ:
            yield f"{way}, compensate the path, or find out first which cause it is."
        elif lowered_by_pulls(stated.pose):
            yield f"{way}, compensate the path, or measure more."
        else:
            yield (
                f"{way} or compensate the path; more pulls would not lower U, which is the "
                "cross-validation error."
            )


def _to_force(stated: FirstScreen) -> str:
    """`, at the test pose to 330 N`, where such a force would pass."""
    assert stated.tolerance is not None
    full = math.hypot(*stated.pose.force_n)
    least = largest_force(stated.tolerance, stated.pose, full)
    return "" if least is None else f" (at the test pose to about {_at_most(least)} N)"


def _at_most(force_n: float) -> str:
    """A force in two digits, never more than it is."""
    step = 10.0 ** (math.floor(math.log10(force_n)) - 1)
    return plain(step * math.floor(force_n / step), 2)


def _to_do(found: CampaignResults, stated: FirstScreen) -> str:
    """What to do with the values, and what of the model no controller takes."""
    stiffness = stated.mine.stiffness
    if more := _to_measure(found, stated):
        return more
    beside = [one.called for one in found.told.model.hypotheses[0].beside_springs]
    if beside and found.row.model == Which.AVERAGED and len(found.told.model.hypotheses) > 1:
        beside = ["causes other than joint springs"]
    text = " ".join((_do(found), *_unfit(found, stiffness)))
    if not beside or not _holds(found):
        return text
    return (
        f"{text} A controller's table of joint stiffnesses has no entry for {listed(beside)}: "
        f"correct paths and programs with `pipeline compensate {typed(found.campaign)} PATH`, or "
        "enter all effective values of the first page."
    )


def _to_measure(found: CampaignResults, stated: FirstScreen) -> str:
    """What to measure before any of the values is used; empty if they serve."""
    if all(joint.value is None for joint in stated.mine.stiffness):
        return "Measure more before any stiffness is used: none is determined."
    d, u = stated.pose.deflection_mm, stated.pose.expanded_mm
    if _holds(found) and d and u and u > d:
        return (
            "Measure more poses, or pull harder, before these stiffnesses are used: the deflection "
            f"that they predict at the test pose is {expanded(stated.pose)}."
        )
    return ""


def _do(found: CampaignResults) -> str:
    """What to do with the values."""
    if robot := _of_robot(found):
        return robot.do
    stood = found.facts.unloaded
    if stood.corrects and not stood.unexplained and found.row.reason in _SPRINGS:
        return (
            f"{DO[Reason.ADEQUATE]} Where absolute positions matter, correct the robot's geometry, "
            f"too: model.toml holds its DH parameters{_SAG * stood.weighs}."
        )
    first = found.told.model.hypotheses[0]
    despite = found.row.reason == Reason.CAUSE_IDENTIFIED and not first.beside_springs
    sentence = DO_DESPITE if despite else DO[found.row.reason]
    if _open(found) and found.row.reason == Reason.SPRINGS_UNTOUCHED:
        sentence = f"{sentence} {_UNTOUCHED}"
    return f"{correct(found.facts)} {sentence}" if found.mistakes else sentence


_UNTOUCHED = "What is open does not change them."

_SAG = ", and a campaign of positions identifies the sag"


def _unfit(found: CampaignResults, stiffness: Sequence[Stiffness]) -> Iterator[str]:
    """Stiffnesses that are no number to enter, where the others are."""
    half = [joint.called for joint in stiffness if joint.value and joint.ci95[1] is None]
    if half and _holds(found):
        yield (
            f"Enter no value for {listed(half)}: these pulls cannot distinguish it from a rigid "
            "axis."
        )


def _model(found: CampaignResults, stated: FirstScreen) -> Iterator[str]:
    """Whose values they are, and what that moves."""
    effects = [one.called for one in found.told.values.first.effects]
    count = len(found.told.values.hypotheses)
    whose = {
        Which.JOINT_SPRINGS: f"Joint springs and {listed(effects)}"
        if effects
        else "Joint springs alone, one linear spring for each joint",
        Which.EXTENDED: f"Joint springs and {listed(effects or ['what was identified'])}",
        Which.AVERAGED: f"The average over {count} models, weighted by their probability",
    }[found.row.model]
    yield f"{whose}, from the {'corrected data' if found.mistakes else 'data as given'}."
    yield from _without(found)
    yield from _table(found.facts)
    yield from filter(None, map(remarks.both_stiffnesses, stated.mine.stiffness))
    if other := _other(found, _SPRINGS_ALONE, _AS_GIVEN, _ON_DELIVERED):
        for move in _moved(stated.mine.stiffness, stated.springs.stiffness):
            yield f"Compared with {' and '.join(other)}, {move}."


def _without(found: CampaignResults) -> Iterator[str]:
    """That a wrong reading is left out, so that its true value still moves the values."""
    if any(one.name == "outlier" for one in found.mistakes):
        yield (
            "A reading that is an error is left out of the corrected data, not replaced: once the "
            "file has its true value, the values will move within their uncertainty."
        )


def _table(facts: Facts) -> Iterator[str]:
    """Which geometry the values belong to, where it is not that of the robot file."""
    if facts.unloaded.corrects:
        yield (
            "They belong to the robot's geometry as estimated from the unloaded reflectors, which "
            "model.toml holds."
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
    return f"{mine.called} changes from {before} to {after} {prefixed(mine.unit, letter)}"


def _for_controller(found: CampaignResults, stated: FirstScreen) -> str:
    """What a controller takes: joint springs, which alone make up for a cause as far as they can.

    Values that were estimated beside a cause are too stiff without it.
    """
    if not _holds(found) or not found.told.model.hypotheses[0].beside_springs:
        return _numbers(found, stated.mine.stiffness, stated.together)
    error = left_out_mm(found.effective.left_out_m)
    left = "" if error is None else f" {_WITH_THEM} {plain(error)} mm rms per coordinate."
    said = entered(stated.effective, (), known=False)
    return (
        f"Effective values, for a table of joint stiffnesses and nothing else: {said}{left} They "
        "are fitted substitutes, and no uncertainty can be stated for them: joint springs alone do "
        "not explain the readings. The stiffnesses of the joints themselves are in the table of "
        "stiffnesses."
    )


def _uncalibrated(found: CampaignResults, stated: FirstScreen) -> Iterator[str]:
    """That the uncertainties lack the calibration of the scale, where nobody stated it."""
    data = found.right.data
    chain = len(data.body) == 0 or bool((data.body < 0).any())
    known = any(joint.value is not None for joint in stated.mine.stiffness)
    if chain and known and data.scale.gain_sigma == 0:
        yield (
            "The uncertainties do not include the calibration of the scale, of which campaign.toml "
            "states nothing (gain_sigma): a scale that reads 1 % high makes every stiffness 1 % "
            "high."
        )


def _numbers(
    found: CampaignResults, stiffness: Sequence[Stiffness], together: Sequence[Combination]
) -> str:
    """Every stiffness as the controller names its axis, and those that have no value."""
    good = [joint for joint in stiffness if joint.value is not None]
    if not good and together:
        return (
            f"These pulls determine no stiffness by itself, but {counted(together)} of compliances."
        )
    if not good:
        return "These pulls determine no stiffness and no combination of stiffnesses."
    if not _holds(found):
        return "Enter no value: the model does not explain the readings."
    return entered(stiffness, together)


def entered(
    stiffness: Sequence[Stiffness], together: Sequence[Combination], *, known: bool = True
) -> str:
    """Stiffnesses to enter, those that are not determined, and those without an upper limit.

    Args:
        stiffness: The joints.
        together: Combinations that are determined.
        known: Whether the model holds, so that the values have an uncertainty.
    """
    good = [joint for joint in stiffness if joint.value is not None]
    lost = [joint.called for joint in stiffness if joint.value is None]
    half = [joint for joint in good if joint.ci95[1] is None]
    whole = [joint for joint in good if joint.ci95[1] is not None]
    return " ".join(
        (
            *([_each(whole, known=known)] if whole else []),
            *(
                [f"Not determined, leave the controller's entry as it is: {listed(lost)}."]
                if lost
                else []
            ),
            *([f"No value: {listed([_stiffer(one) for one in half])}."] if half else []),
            *([f"Determined together: {counted(together)}."] if together else []),
        )
    )


def _each(joints: Sequence[Stiffness], *, known: bool) -> str:
    """Each with its standard uncertainty, or rounded to it."""
    text = "; ".join(_number(joint, known=known) for joint in joints)
    return f"{text} (± standard uncertainty)." if known else f"{text}."


def _stiffer(joint: Stiffness) -> str:
    """`E1, stiffer than 58 MN/m`."""
    least = joint.ci95[0]
    if not least:
        return str(joint.axis or joint.name)
    factor, letter = common_prefix([least])
    size = f"{plain(scaled(least, factor), 2)} {prefixed(joint.unit, letter)}"
    return f"{joint.axis or joint.name}, stiffer than {size}"


def _number(joint: Stiffness, *, known: bool) -> str:
    """`A1 3.800 ± 0.012 MN·m/rad`, or `A1 3.800 MN·m/rad`."""
    factor, letter = common_prefix([joint.value])
    value, std = scaled(joint.value, factor), scaled(joint.std, factor)
    shown = with_std(value, std)
    if not known and value is not None and std is not None:
        shown, _ = with_uncertainty(value, std)
    return f"{joint.axis or joint.name} {shown} {prefixed(joint.unit, letter)}"


def _test_pose(found: CampaignResults, stated: FirstScreen) -> Iterator[str]:
    """The pose, its force and what that does; what the recommended model changes there."""
    pose = stated.pose
    x, y, z = (plain(part, 4) for part in pose.force_n)
    axes = ", ".join(f"{one.name} {at_axis(one.value, one.unit)}" for one in pose.axes)
    none = "" if pose.stated else _stands_in(found)
    yield (
        f"The load point deflects by {expanded(pose)}, at {axes} under ({x}, {y}, {z}) N in the "
        f"base frame F_b ({plain(math.hypot(*pose.force_n), 4)} N).{_directed(pose)}{none}"
    )
    yield from _changed(
        stated.mine.test_pose_deflection, stated.springs.test_pose_deflection, found
    )


def _directed(pose: TestPose) -> str:
    """The deflection as a vector, and its part along the force."""
    if pose.vector_mm is None or pose.along_force_mm is None:
        return ""
    x, y, z = (plain(part, 3) for part in pose.vector_mm)
    along = plain(pose.along_force_mm, 4)
    return f" It is ({x}, {y}, {z}) mm in F_b, {along} mm along the force."


def _stands_in(found: CampaignResults) -> str:
    """Which pose it is where campaign.toml has none, as [test_pose] wants it."""
    q = np.where(found.right.case.robot.prismatic, found.where.q, np.rad2deg(found.where.q))
    return (
        " campaign.toml has no [test_pose], so the pose of the largest force is used (q, the "
        "joints of the "
        f"robot file, not the controller's axes: {', '.join(f'{one:.5g}' for one in q)})."
    )


def _changed(
    mine: Sequence[TargetDeflection], springs: Sequence[TargetDeflection], found: CampaignResults
) -> Iterator[str]:
    """What the model changes at the target that moves most; nothing where it changes nothing."""
    sizes = [[one.size_mm for one in those if one.size_mm is not None] for those in (mine, springs)]
    if not sizes[0] or not len(sizes[0]) == len(sizes[1]) == len(mine):
        return
    k = int(np.argmax(sizes[0]))
    now, before = (plain(size[k]) for size in sizes)
    if now != before:
        yield f"{mine[k].target} deflects by {now} mm ({before} mm {_instead(found)})."


def _next(found: CampaignResults, stated: FirstScreen) -> str:
    """What to measure next, and whether that would settle what is open."""
    poses = stated.diagnosis.next_poses
    if found.facts.hopeless:
        return "What was not measured."
    if poses:
        return f"{_proposed(poses)}{_unchecked(stated)}"
    if again := _again(found):
        joint = joint_to_pull(found, stated.diagnosis, stated.mine.stiffness)
        return f"{again} {_least_certain(stated, joint)}" if joint else again
    if found.facts.unloaded.refuted:
        return (
            "Nothing until the joint log and the robot file agree with the unloaded reflectors: "
            "the readings taken may then do."
        )
    if found.row.reason == Reason.SPRINGS_DISAGREE:
        return (
            "A known weight hung from the load point in two of the poses: it tells whether the "
            "scale is wrong or the masses are."
        )
    if not _holds(found):
        return (
            "The poses that are missed most, once more and on another day: this tells the machine "
            "from the readings."
        )
    needs = _needs(found, stated.diagnosis)
    if needs:
        return f"What would tell which cause it is: {needs[0]}."
    worst = joint_to_pull(found, stated.diagnosis, stated.mine.stiffness)
    if worst is None:
        return "Nothing can be proposed: no stiffness is known."
    return f"{f'{_NONE_OPEN} ' * _settled_all(stated)}{_least_certain(stated, worst)}"


def _settled_all(stated: FirstScreen) -> bool:
    """Whether neither the verdict nor a tolerance leaves a question open."""
    asked = None if stated.tolerance is None else stated.tolerance.worst
    sure = stated.diagnosis.verdict in (Verdict.ADEQUATE, Verdict.EXPLAINED)
    return sure and asked is not Decision.UNDECIDED


def _again(found: CampaignResults) -> str:
    """What is wrong and has to be measured once more; nothing where a file is to be corrected."""
    kinds = {one.name for one in found.mistakes}
    if "outlier" in kinds:
        return "The readings in question, if no record shows the correct values."
    return "The point in question, in the flange frame." if "tool_point" in kinds else ""


def _needs(found: CampaignResults, diagnosis: Diagnosis) -> list[str]:
    """What would part causes that no pull does."""
    if found.row.model != Which.AVERAGED and diagnosis.verdict != Verdict.AMBIGUOUS:
        return []
    return [
        one.needs
        for one in diagnosis.causes
        if one.needs and (one.rivals or one.twins or one.probability < CERTAIN)
    ]


def joint_to_pull(
    found: CampaignResults, diagnosis: Diagnosis, stiffness: Sequence[Stiffness]
) -> Stiffness | None:
    """The joint that the next pull is for; None where other things are to be measured first.

    These are poses that decide between causes, readings in question, unless a joint has no value,
    poses that no model explains, and what parts causes that no pull does.
    """
    worst = worst_known(stiffness)
    if diagnosis.next_poses or worst is None:
        return None
    if _again(found):
        return worst if worst.value is None else None
    return worst if _holds(found) and not _needs(found, diagnosis) else None


def _proposed(poses: Sequence[NextPose]) -> str:
    """How the first proposed pose is pulled, and whether all of them settle what is open."""
    most = max(one.sigmas_after or 0.0 for one in poses)
    count = "The proposed pose" if len(poses) == 1 else f"The {len(poses)} proposed poses"
    first = f"{'Pose 1' if len(poses) > 1 else 'It'}: {_pulled(poses[0])}."
    if most >= SEPARATED:
        return (
            f"{count}: the causes in question are then {plain(most, 2)} standard deviations "
            f"apart, and {SEPARATED} are enough. {first}"
        )
    return (
        f"{count} will help but not settle it: the causes in question are then "
        f"{plain(most, 2)} standard deviations apart, and {SEPARATED} are needed. {first}"
    )


def _unchecked(stated: FirstScreen) -> str:
    """That nobody knows whether a proposed pose can be reached, where campaign.toml has no cell."""
    if stated.diagnosis.next_poses_in is not None:
        return ""
    return " Collisions and lines of sight were not checked."


def _pulled(pose: ToMeasure) -> str:
    """Where the robot stands and how it is pulled there."""
    at = ", ".join(f"{axis.name} {at_axis(axis.value, axis.unit)}" for axis in pose.axes)
    return f"{at or _joints(pose)}, {loads(pose)}"


def _joints(pose: ToMeasure) -> str:
    """The joints of a robot whose file maps no axes."""
    values = [at_axis(value, unit) for value, unit in zip(pose.q, pose.q_unit, strict=True)]
    return f"joints at ({', '.join(values)})"


def _least_certain(stated: FirstScreen, worst: Stiffness) -> str:
    """Which pulls would gain most, and what one such pose would settle."""
    best, pulls = stated.diagnosis.best_pose, remarks.WORK[worst.joint_type]
    after = "" if best is None else f" {_settled(best, worst)}"
    if worst.value is None:
        more = f" One more pose: {_pulled(best)}.{after}{_unchecked(stated)}" if best else ""
        return f"{capital(pulls)}: {worst.called} is not determined.{more}"
    known = percent(worst.relative_std)
    if best is not None and percent(best.relative_std_after) == known:
        return (
            f"{worst.called} is known least well, with a standard uncertainty of {known}; one more "
            "pose would hardly improve it."
        )
    first = f"Optional: {pulls} would improve {worst.called} most."
    return " ".join([first, f"Its standard uncertainty is {known}."]) + after


_NONE_OPEN = "No question is open."


def _settled(best: BestPose, joint: Stiffness) -> str:
    """What the best pose makes of the uncertainty of a joint."""
    after = percent(best.relative_std_after)
    if joint.value is not None:
        return f"With the pose that the report proposes it is expected to be {after}."
    if best.determines:
        return (
            f"With it {joint.called} is determined, with a standard uncertainty of about {after} "
            "of its typical compliance."
        )
    return (
        f"This alone will not determine it: its standard uncertainty is then {after} of its "
        "typical compliance."
    )
