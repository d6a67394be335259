"""Sentences about a result: what each finding and each reason says, in the English of the field.

Facts come as types (`Facts`, `Finding`, `Reason`); no sentence made here is ever read by the code.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import groupby

import numpy as np

from pipeline.answer import contract
from pipeline.answer.amounts import roughly
from pipeline.answer.contract import About, Combination, Reason, Stiffness, ToMeasure
from pipeline.base.arrays import Parameter
from pipeline.base.doors import opened
from pipeline.base.quantities import (
    common_prefix,
    percent,
    plain,
    prefixed,
    probability,
    with_std,
)
from pipeline.diagnosis.average import POSSIBLE
from pipeline.diagnosis.facts import (
    ALL_SPRINGS,
    Drift,
    EffectSize,
    Facts,
    FoundCause,
    PossibleCause,
    UnloadedFacts,
    Unnoticed,
)
from pipeline.diagnosis.finding import WRONG_LAW, Finding, Verdict
from pipeline.diagnosis.verdict import certain, findings, outside_likelier, two_laws
from pipeline.faults.mistake import Mistake
from pipeline.machine.effect import Table, in_place
from pipeline.machine.effects.tracker_drift import (
    GROUP_S,
    HOUR_S,
    PER_GROUP,
    WARM_UP_H,
    amount,
)
from pipeline.machine.robot import Robot, axes
from pipeline.machine.robot.dh_parameters import dh_parameters
from pipeline.reduction.growth import STEEL
from pipeline.system.family import FAR_OFF

_NOTICED = 1.15
"""Remainder ratio above which what is left is more than chance, and stated [1]:
a chi-squared a third above its expectation."""


_RIVALS = 3
"""So many rivals of one cause are listed in a sentence."""


_SPRINGS_DISAGREE = "pipeline.positions.disagreement:springs_disagree"
_TABLES_DISAGREE = "pipeline.positions.disagreement:tables_disagree"
"""Doors of the positions: findings that only they have."""


_PLACES, _FURTHER = 4, 3
"""So many places, and further errors with what and where, are told in a sentence."""


def why(facts: Facts) -> str:
    """What the verdict rests on: every finding in a sentence, but for "nothing" beside others."""
    sentences = _told(facts) or _FINDINGS[Finding.NOTHING](facts)
    return (
        f"{mistaken(facts)} The rest holds for the corrected data. {sentences}"
        if facts.mistakes
        else sentences
    )


def capital(text: str) -> str:
    """The text with its first letter as a capital."""
    return text[:1].upper() + text[1:]


def listed(words: Sequence[str]) -> str:
    """One after the other, with "and" before the last."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def counted(combinations: Sequence[Combination]) -> str:
    """`1 combination`, `2 combinations`."""
    return f"{len(combinations)} combination{'s' * (len(combinations) > 1)}"


MISTAKES = {
    "outlier": "outlying reading",
    "unit_mixup": "mixed-up unit",
    "label_swap": "swapped names of targets",
    "exchanged": "exchanged groups or rows",
    "dead_sensor": "column that no sensor wrote",
    "copied_column": "force that was copied down its column",
    "tool_point": "wrong tool point",
    "loose_target": "target that gives way with the pull",
    "tracker_moved": "tracker that was moved",
    "sign_or_convention": "wrong sign or axis convention",
}
"""Mistakes in the data as nouns, by their names in result.json."""


def mistaken(facts: Facts) -> str:
    """The first mistake in the data, a few more by name and place, and how many more there are."""
    first, *more = facts.mistakes
    were = "1 more error was" if len(more) == 1 else f"{len(more)} more errors were"
    others = f"; {were} found: {_some([*dict.fromkeys(map(_shortly, more))])}" if more else ""
    return f"The data contain an error: {first.evidence}{others}. Your files are unchanged."


def _shortly(one: Mistake) -> str:
    """`outlying reading at pose03/P2 (tracker.csv:18)`."""
    line = f" ({one.at[0]})" if one.at else ""
    return f"{MISTAKES.get(one.name, one.name)} at {one.where}{line}"


def _some(places: Sequence[str]) -> str:
    """The first of them, and how many more there are."""
    more = len(places) - _FURTHER
    return listed([*places[:_FURTHER], *([f"{more} more"] if more > 0 else [])])


def wrong(facts: Facts, unseen: int, besides: Sequence[str] = ()) -> str:
    """What is wrong, in a sentence, mistakes in the data apart, which the verdict tells.

    Args:
        facts: What was found.
        unseen: How many causes would not have shown at their typical magnitude.
        besides: Sentences on what was found besides, on what was stated or the noise.
    """
    others = _told(facts)
    if others:
        return f"With the data corrected: {others}" if facts.mistakes else others
    also = f" {unnoticed(unseen)}; they are listed in the report." if unseen else ""
    where, stood = "these readings", facts.unloaded
    if stood.off:
        where = "the displacements under load"
        also += (
            f" Unloaded, the reflectors are {plain(1e3 * stood.remains_m, 2)} mm rms from where "
            f"{'the estimated DH parameters' if stood.corrects else _of_table(facts)} place them "
            f"(base and tool fitted), {plain(stood.remains_m / stood.noise_m, 2)} times the noise: "
            "the stiffnesses do not depend on it, absolute positions do."
        )
    nothing = f"Nothing {'else ' if besides else ''}detectable in {where}."
    if facts.mistakes:
        nothing = "The error in the data that the verdict names; nothing else was detected."
    return f"{nothing}{also}"


def clear(facts: Facts) -> bool:
    """Whether nothing is wrong but what the data have, if anything."""
    return not _told(facts)


def noise_told(causes: Sequence[contract.Cause]) -> Iterator[str]:
    """What was found of the noise that makes up for no cause, a sentence each."""
    for cause in causes:
        entries = {one.name: one.value for one in cause.parameters}
        if cause.name in _SCATTERS:
            share = percent(next(iter(entries.values())))
            yield (
                f"{_SCATTERS[cause.name]} scatter {share} more than stated: the uncertainties "
                "include it."
            )
        elif cause.name == "heavy_tails":
            yield f"{_tailed(cause)} weigh less, and the uncertainties include it{_where(cause)}."
        elif cause.name == "tracker_wander" and (size := entries["s_wander"]) is not None:
            time = entries["correlation_time"]
            over = "" if time is None else f" over some {plain(time / 60, 2)} min"
            who = "Consecutive rows (no times are given) share an error that" * (time is None)
            yield (
                f"{who or 'The instrument'} wanders by {plain(1e3 * size, 2)} mm{over}: the "
                "uncertainties include it."
            )


def _tailed(cause: contract.Cause) -> str:
    """Which readings have tails."""
    if cause.where is None:
        return "Single readings deviate farther than the stated noise allows (heavy tails): they"
    times = plain(cause.parameters[0].value, 1)
    return (
        f"The readings of {cause.where} scatter some {times} times as much as those of the other "
        "targets: see that it sits firmly in its nest. They"
    )


def _where(cause: contract.Cause) -> str:
    if cause.where is not None:
        return ""
    return ". Where they come from one target, one pose or one pull, look there"


_SCATTERS = {
    "tracker_noise": "The readings of the tracker",
    "force_noise": "The readings of the scale",
}


def unnoticed(count: int) -> str:
    """How many causes would not have shown at their typical magnitude."""
    causes = "1 other effect" if count == 1 else f"{count} other effects"
    return f"{causes} could be present at typical magnitude without being detected"


def not_found(spots: Sequence[Unnoticed]) -> str:
    """What of the whole cell was examined and not found, with the size that would have shown."""
    whole = [one for one in spots if not isinstance(one.effect.where, int)]
    shown = [f"{one.effect.called} ({_from(one)})" for one in whole]
    if not shown:
        return ""
    return (
        "In brackets the size from which each would have been found in 4 of 5 cases: "
        f"{listed(shown)}."
    )


def _from(spot: Unnoticed) -> str:
    """`52 nrad/(N·m)`, of its first parameter."""
    first = spot.effect.parameters[0]
    return roughly(
        contract.Amplitude(name=first.name, value=spot.smallest_visible, std=None, unit=first.unit)
    )


def _told(facts: Facts) -> str:
    """Every finding but mistakes and "nothing", in sentences."""
    found: list[Finding] = [row.finding for row in findings(facts)]
    others = [one for one in found if one not in (Finding.NOTHING, Finding.MISTAKE)]
    labels = [capital(_FINDINGS[one](facts)) for one in others]
    return " ".join(
        [
            *labels,
            *(
                [_impossible(facts)]
                if labels and facts.refused and not facts.unloaded.refuted
                else []
            ),
            *([] if facts.positions is None else filter(None, [_told(facts.positions)])),
        ]
    )


def told_of(facts: Facts, asked: Collection[Finding]) -> list[str]:
    """Those of some findings that hold, in sentences."""
    holding = [row.finding for row in findings(facts) if row.finding in asked]
    return [capital(_FINDINGS[one](facts)) for one in holding]


def _impossible(facts: Facts) -> str:
    """What fits best, and cannot be so large."""
    named = listed([effect.called for effect in facts.refused])
    return (
        f"{capital(named)} would explain the readings better, but only at a size that nothing "
        "sound has: inspect it first."
    )


def _identified(facts: Facts) -> str:
    names, left = _names(facts.causes), facts.remainder
    first = f"Identified in addition to the joint springs: {_likely(facts.causes, facts.base)}"
    if any(row.verdict is Verdict.UNEXPLAINED for row in findings(facts)):
        return f"{first}."
    if left is None or left < _NOTICED:
        return f"{first}. The extended model fits the readings to within their scatter."
    return (
        f"{first}. With {names} in the model, {left:.1f} times the scatter of the readings is "
        "left, no more than the laws of the causes may be in error."
    )


def _predicts_worse(facts: Facts) -> str:
    assert facts.gain is not None
    nearest = "which fits best" if len(facts.causes) == 1 else "which together fit best"
    return (
        "Something is missing from the model, and no known cause explains it: adding "
        f"{_names(facts.causes)}, {nearest}, makes predictions worse (cross-validation error "
        f"{plain(1e3 * facts.gain.rms_before_m, 3)} mm without, "
        f"{plain(1e3 * facts.gain.rms_after_m, 3)} mm with)."
    )


def _unconfirmed(facts: Facts) -> str:
    if facts.gain is None:
        return (
            f"{_names(facts.causes)} fit{_ending(facts)} best, but the readings scatter more than "
            "stated, and cross-validation requires four poses. No cause is identified."
        )
    low, high = facts.gain.ci95
    return (
        f"{_names(facts.causes)} fit{_ending(facts)} best, but the scatter of the readings "
        "is not known, and cross-validation does not confirm it: the error falls by "
        f"{percent(facts.gain.reduction)}, 95 % interval {percent(low)} to {percent(high)}, which "
        "may be chance. No cause is identified."
    )


def _remainder(facts: Facts) -> str:
    """Causes that come nearest and do not explain the data."""
    names, s = _names(facts.causes), _ending(facts)
    left = facts.remainder or 1.0
    much = f"what is left is {left:.1f} times the scatter of the readings"
    rest = much if left > _NOTICED else "something remains"
    if outside_likelier(facts):
        return f"{names} fit{s} best, but {rest}, and {_looks_like(facts)}"
    if facts.gain is None or facts.gain.ci95[0] <= 0:
        return f"{names} fit{s} best, but {rest}: neither location nor law is certain."
    if left > WRONG_LAW:
        return (
            f"{names} explain{s} most, but {rest}: a law differs from that of the catalogue, or "
            "something else acts or was misread."
        )
    return f"Besides {names}, something remains that no known cause explains."


def _looks_like(facts: Facts) -> str:
    assert facts.outside is not None
    return (
        "an effect outside the catalogue explains more: it resembles "
        f"{facts.outside.effect.signature}."
    )


def _outside_possible(facts: Facts) -> str:
    assert facts.outside is not None
    return (
        f"The data cannot distinguish {_names(facts.causes)} from an effect outside the "
        f"catalogue, which "
        f"resembles {facts.outside.effect.signature}."
    )


def _rivals(facts: Facts) -> str:
    sure = [cause for cause in facts.causes if certain(cause)]
    first = f"{_names(sure)} {'is' if len(sure) == 1 else 'are'} certain. " if sure else ""
    open_ = "; ".join(_or(cause) for cause in facts.causes if not certain(cause))
    return f"{first}The data cannot distinguish between {open_}."


def law_told(cause: FoundCause) -> str:
    """A law that nobody listed, with its amplitude."""
    return sized(cause.effect.called, cause.height) if cause.height else cause.effect.called


def sized(called: str, size: EffectSize) -> str:
    """`ripple of 3 per turn in joint 4 (A4), 0.66 ± 0.02 mrad`."""
    unit = size.parameter.unit
    factor, letter = (1.0, "") if unit == "1" else common_prefix([size.value])
    shown = "" if unit == "1" else f" {prefixed(unit, letter)}"
    return f"{called}, {with_std(size.value / factor, size.std / factor)}{shown}"


def _or(cause: FoundCause) -> str:
    """A cause and what it could be instead, with their probabilities."""
    one_law = (PossibleCause(cause.effect, 1.0),)
    laws = cause.either if cause.of_one_driver < 1 else one_law
    mine, *others = (
        f"{effect.called}, {100 * cause.stated(share):.0f} %"
        for effect, share in (
            *((one.effect, cause.probability * one.probability) for one in laws),
            *((one.effect, one.probability) for one in cause.rivals[:_RIVALS]),
        )
    )
    twin = "its twin, from which no pull can distinguish it" if cause.twins else "a similar cause"
    if ALL_SPRINGS in cause.twins:
        twin = "all joints softer or stiffer in the same course, which moves every target alike"
        others = [twin, *others]
    return ", and ".join([mine, *(others or [twin])])


def _off_the_table(facts: Facts) -> str:
    names = " and ".join(effect.called for effect in facts.unloaded.effects)
    return (
        f"The unloaded reflectors are {plain(1e3 * facts.unloaded.miss_m, 2)} mm from where "
        f"{_of_table(facts)} place them, and adding {names}, which fits best, would make the "
        f"prediction of other poses worse."
    )


def _stands_elsewhere(facts: Facts) -> str:
    before, after = (plain(1e3 * x, 2) for x in (facts.unloaded.miss_m, facts.unloaded.left_m))
    return (
        f"The unloaded reflectors are {before} mm rms from where {_of_table(facts)} place "
        f"them (base and tool fitted), and {after} mm with "
        f"{listed([_sized(one) for one in facts.moved])}."
    )


def _geometry_refuted(facts: Facts) -> str:
    stood = facts.unloaded
    if stood.tool_m > max(stood.miss_m, stood.left_m):
        return (
            f"The targets stand up to {plain(1e3 * stood.tool_m, 2)} mm from their places in "
            "[tool]: measure them and the load point again in the flange frame, and check the unit "
            "and the axes of [tool] in campaign.toml."
        )
    return (
        f"The unloaded targets are {plain(1e3 * facts.unloaded.miss_m, 2)} mm rms from where "
        "the robot file places them (base and tool fitted), and neither a listed mistake in the "
        "files nor a wrong DH parameter explains it: compare the joint log with the controller, "
        "column by column and row by row, and check that the robot file is that of this robot."
    )


def _of_table(facts: Facts) -> str:
    """Where pulls have their table from."""
    if facts.agreement is None:
        return "the nominal DH parameters"
    return "the DH parameters identified from the positions"


def _stands_unexplained(facts: Facts) -> str:
    stood = facts.unloaded
    whose = "the estimated DH parameters" if stood.corrects else _of_table(facts)
    sentence = (
        f"The unloaded reflectors are {plain(1e3 * stood.remains_m, 2)} mm rms from where {whose} "
        f"place them (base and tool fitted), {stood.remains_m / stood.noise_m:.0f} times the noise "
        "of the readings, and neither DH parameters nor the arm's weight nor a change during the "
        "campaign explains it. Whatever it is may act on the pulls, too."
    )
    if stood.down is None:
        return f"{sentence} Check the joint log, [tool] and the robot file, and [gravity]."
    axis, left_m = stood.down
    return (
        f"{sentence} With gravity along {axis} of F_b they would be {plain(1e3 * left_m, 2)} mm "
        "from there: state its direction in [gravity]."
    )


def _rough_table(facts: Facts) -> str:
    gain = facts.unloaded.gain
    assert gain is not None
    before, after = 1e3 * gain.rms_before_m, 1e3 * gain.rms_after_m
    rough, weighs = facts.unloaded.rough, facts.unloaded.weighs
    both = [*[_deviating(facts.unloaded)] * rough, *["the arm sags under its weight"] * weighs]
    return (
        f"{capital(', and '.join(both))}: in cross-validation "
        f"the unloaded reflectors are {plain(before, 2)} mm rms per coordinate from where "
        f"the nominal DH parameters place them, and {plain(after, 2)} mm from where the identified "
        f"ones {'and the sag do' if weighs else 'do'}."
    )


LETTERS = {
    "link_length": "length",
    "link_offset": "offset",
    "link_twist": "twist",
    "link_turn": "turn",
    "axis_tilt": "tilt of the axis",
    "joint_offset": "zero",
}
"""Entries of a robot's table in words."""

_SURE = 3.0
"""Standard uncertainties beyond which one entry of a table deviates by itself [1]."""

_FEW = 6
"""So many entries that deviate are named; of more it is said that they are many."""


def _deviating(stood: UnloadedFacts) -> str:
    """Which entries of a rough table deviate: those that do so by themselves, if these are few."""
    unsure = "the robot's DH parameters deviate a little from nominal, none certainly by itself"
    if (found := stood.cells) is None:
        return unsure
    at = found.zeros.columns.table
    off, std = found.mean[at], np.sqrt(np.diag(found.covariance)[at])
    every = dh_parameters(found.zeros.robot)
    sure = np.flatnonzero(np.abs(off) > _SURE * std).tolist()
    if len(sure) > _FEW:
        return (
            "many of the robot's DH parameters deviate a little from nominal, none far more than "
            "the others"
        )
    if not sure:
        return unsure
    units = {False: "mm", True: "mrad"}
    named = [
        f"the {LETTERS[every[k].name]} of {_joint_of(found.zeros.robot, every[k].joint)} "
        f"({plain(1e3 * off[k], 2)} {units[every[k].turns]})"
        for k in sure
    ]
    return (
        f"of the robot's DH parameters {listed(named)} deviate{'s' * (len(sure) == 1)} from "
        "nominal, the others by no more than their uncertainty explains"
    )


def _joint_of(robot: Robot, joint: int) -> str:
    """`joint 3 (A2)`."""
    return in_place(joint, axis=axes.alone(robot)[joint - 1]).removeprefix(" in ")


_THOUSANDTHS = {"m": (1e3, "mm"), "rad": (1e3, "mrad")}
"""In which unit the size of an error of the geometry is read..."""

_ENTRIES = {"m": (1e3, "mm"), "rad": (180 / np.pi, "°")}
"""... and in which an entry of a robot's table."""


def _sized(cause: FoundCause) -> str:
    """A cause with its size, and where else it may be without another robot."""
    sizes = []
    for one in cause.amplitudes:
        unit = one.parameter.unit
        if isinstance(cause.effect, Table):
            factor, letter = _ENTRIES[unit]
            stands = with_std(factor * (cause.effect.nominal + one.value), factor * one.std)
            stated = f"{factor * cause.effect.nominal:.7g}"
            sizes.append(f"{one.parameter.name} = {stands} {letter}, not {stated} {letter}")
            continue
        factor, letter = _THOUSANDTHS.get(unit, (1.0, unit))
        of = _axis(one.parameter) if len(cause.amplitudes) > 1 else ""
        sizes.append(f"{of}{with_std(factor * one.value, factor * one.std)} {letter}")
    same = [in_place(twin.where, twin.name, twin.axis).strip() for twin in cause.same_robot]
    also = f"; the same error {listed(same)} would give the same robot" if same else ""
    return f"{cause.effect.called} ({', '.join(sizes)}{also})"


def _axis(parameter: Parameter) -> str:
    """`along x ` or `about x ` before one component of a motion."""
    _, _, axis = parameter.name.rpartition("_")
    way = {"m": "along", "rad": "about"}.get(parameter.unit)
    return f"{way} {axis} " if way and axis in ("x", "y", "z") else ""


def _tracker_moved(facts: Facts) -> str:
    assert facts.drift is not None
    return (
        f"The base reflectors moved together by {plain(1e3 * facts.drift.moved_m, 2)} mm in "
        f"{_lasting(facts.drift)}: {facts.drift.effect.called}, turning by {_turn(facts.drift)}."
    )


def _tracker_knocked(facts: Facts) -> str:
    assert facts.base is not None
    assert facts.base.knocked is not None
    first, then = facts.base.knocked
    return (
        f"Between {first} and {then} the base reflectors moved together by "
        f"{plain(1e3 * facts.base.moved_m, 2)} mm, as no drift moves them: the tracker was "
        "knocked, or rounds of base reflectors stand in each other's place. Which poses were "
        "read from where nobody can tell; a displacement within a pose hardly depends on it."
    )


def _base_grew(facts: Facts) -> str:
    assert facts.base is not None
    assert facts.base.grown is not None
    grown = facts.base.grown
    most = int(np.argmax(np.abs(grown.growth)))
    value, std = grown.growth[most], grown.std[most]
    return (
        f"From {grown.groups[0]} to {grown.groups[most]} the distances between the base reflectors "
        f"became {'longer' if value > 0 else 'shorter'} by {with_std(1e3 * abs(value), 1e3 * std)} "
        f"mm per metre, {plain(1e3 * abs(value) * grown.length_m, 2)} mm over their longest: the "
        f"base frame {'grew' if value > 0 else 'shrank'}, as steel does by "
        f"{plain(abs(value) / STEEL, 2)} K, or the tracker measured lengths otherwise (temperature "
        "and pressure of its beam). Base reflectors alone cannot distinguish between the two. "
        "Readings are corrected for it in proportion to time; the stiffnesses hardly depend on it."
    )


def _lasting(drift: Drift) -> str:
    """Between the first and the last reading."""
    if drift.effect.parameters[0].unit == PER_GROUP:
        return (
            f"{drift.hours * HOUR_S / GROUP_S:.0f} groups of readings, in the order of their rows"
        )
    return f"{plain(drift.hours, 2)} h"


def _turn(drift: Drift) -> str:
    turn = 1e6 * float(np.linalg.norm(drift.turn))
    per = {"m/s": (HOUR_S, " urad/h"), PER_GROUP: (1.0, " urad a group")}
    times, unit = per.get(drift.effect.parameters[0].unit, (1.0, " urad"))
    return f"{turn * times:.2g}{unit}"


def _joint(facts: Facts, where: int | str | None) -> str:
    """`Joint 3 (A2)`, of which causes are."""
    cause = next(cause.effect for cause in facts.causes if cause.effect.where == where)
    return capital(in_place(where, axis=cause.axis).removeprefix(" in "))


def _names(causes: Sequence[FoundCause]) -> str:
    return listed([cause.effect.called for cause in causes])


def _gain_uncertain(facts: Facts) -> str:
    """Of which causes it is uncertain that they reduce the error: all, if none by itself is."""
    unproven = [one for one in facts.causes if one.unproven > 0]
    sure = [one for one in facts.causes if unproven and one.unproven <= 0]
    open_, beside = unproven or facts.causes, f" beside {_names(sure)}" if sure else ""
    fits = "fits, but does" if len(open_) == 1 else "fit, but do"
    return f"{_names(open_)} {fits} not certainly reduce the cross-validation error{beside}."


def _likely(causes: Sequence[FoundCause], base: Drift | None) -> str:
    """The same with their probabilities, equal ones said once, and how far a drift went."""
    said = []
    for (drift, p), alike in groupby(
        causes, lambda one: (drifted(one, base), probability(one.stated(one.probability)))
    ):
        names = [one.effect.called for one in alike]
        said.append(f"{listed(names)} ({drift}probability {p}{' each' * (len(names) > 1)})")
    return listed(said) if len(said) == len(causes) else "; ".join(said)


def drifted(cause: FoundCause, base: Drift | None) -> str:
    """`1.1 mm in 6.5 h, settling with a time constant of 1 h; `, for a drift in time only."""
    effect = cause.effect
    if base is None or effect.name != base.effect.name:
        return ""
    if effect.parameters[0].unit == PER_GROUP:
        return ""
    far = np.linalg.norm([one.value for one in cause.amplitudes])
    far_mm = 1e3 * float(far * amount(effect, np.array(base.hours * HOUR_S)))
    hours = WARM_UP_H.get(effect.form)
    how = f"settling with a time constant of {hours:g} h" if hours else "steadily"
    return f"{plain(far_mm, 2)} mm in {plain(base.hours, 2)} h, {how}; "


def _ending(facts: Facts) -> str:
    """Of the verb whose subject the causes are."""
    return "s" if len(facts.causes) == 1 else ""


def _predicts_nothing(facts: Facts) -> str:
    return (
        f"The model leaves {plain(100 * facts.bounds.left, 2)} % of the squared displacements: do "
        f"not predict with it. {_look_first(facts)}"
    )


def _beyond_noise(facts: Facts) -> str:
    bounds = facts.bounds
    tracker = bounds.tracker >= bounds.force
    times = f"{plain(bounds.tracker if tracker else bounds.force, 2)} times as much as stated"
    if tracker and not bounds.stated:
        times = f"by {plain(1e3 * bounds.unit_m * bounds.tracker, 2)} mm"
    of = "targets" if tracker else "scale"
    return (
        f"The readings of the {of} scatter {times}, which no instrument in working order does: "
        f"check the stated uncertainty and its unit. {_look_first(facts)}"
    )


def _scattered(facts: Facts) -> str:
    left = facts.bounds.far
    poses = sorted(set(left.pose.tolist()))[:_PLACES]
    places = [f"pose {listed([str(pose) for pose in poses])}"] if poses else []
    places += [f"{left.base} in the rounds of the base reflectors"] if left.base else []
    first = f" {_look_first(facts)}" if poses else ""
    count = f"{left.count} are" if left.count > 1 else "at least one is"
    return (
        f"Of the readings in use {count} more than {FAR_OFF:.0f} standard uncertainties "
        f"from where all others put them, which no noise explains ({'; '.join(places)}).{first}"
    )


def _look_first(facts: Facts) -> str:
    bounds = facts.bounds
    left = f"{plain(1e3 * bounds.worst_m, 2)} mm"
    if bounds.turn_rad is not None:
        left = f"{plain(1e3 * bounds.turn_rad, 2)} mrad"
    return (
        f"Look first at {bounds.worst_target} of pose {bounds.worst_pose}, where the model leaves "
        f"{left}."
    )


_FINDINGS: Mapping[Finding, Callable[[Facts], str]] = {
    Finding.TRACKER_MOVED: _tracker_moved,
    Finding.TRACKER_MOVED_OR_KNOCKED: lambda facts: (
        f"{_tracker_moved(facts)} As they were read, a tracker that was knocked once would look "
        "the same."
    ),
    Finding.TRACKER_KNOCKED: _tracker_knocked,
    Finding.BASE_GREW: _base_grew,
    Finding.STANDS_ELSEWHERE: _stands_elsewhere,
    Finding.STANDS_ELSEWHERE_OR_RIVAL: lambda facts: (
        f"{_stands_elsewhere(facts)} The data cannot distinguish between "
        f"{'; '.join(_or(one) for one in facts.moved if not certain(one))}."
    ),
    Finding.REFLECTORS_LOOSE: lambda _: (
        "The reflectors move against each other under load: a loose nest or a soft effector."
    ),
    Finding.NO_CAUSE_FITS: lambda _: (
        "Something is missing from the model, and no known cause explains it."
    ),
    Finding.PREDICTS_WORSE: _predicts_worse,
    Finding.UNCONFIRMED: _unconfirmed,
    Finding.REMAINDER: _remainder,
    Finding.OUTSIDE_CATALOGUE: lambda facts: (
        f"{_names(facts.causes)} fit{_ending(facts)} best, but {_looks_like(facts)}"
    ),
    Finding.GAIN_UNCERTAIN: _gain_uncertain,
    Finding.TWO_LAWS: lambda facts: (
        f"{_joint(facts, two_laws(facts))} follows no law of the catalogue: "
        f"{_names(facts.causes)} fit it only together."
    ),
    Finding.RIVALS: _rivals,
    Finding.OUTSIDE_CATALOGUE_POSSIBLE: _outside_possible,
    Finding.SCALE_SCATTERS: lambda facts: (
        "What the causes leave is scatter only if the scale scatters "
        f"{plain(facts.scale_ratio * facts.tracker_ratio, 2)} times as much as stated."
    ),
    Finding.BEYOND_CERTIFICATE: lambda _: (
        "The residuals are larger than an error of any certificate would explain."
    ),
    Finding.OFF_THE_TABLE: _off_the_table,
    Finding.GEOMETRY_REFUTED: _geometry_refuted,
    Finding.TABLES_DISAGREE: lambda facts: str(opened(_TABLES_DISAGREE)(facts)),
    Finding.ROUGH_TABLE: _rough_table,
    Finding.STANDS_UNEXPLAINED: _stands_unexplained,
    Finding.MISFIT: lambda facts: (
        f"What the model leaves is more than noise (p = {facts.misfit_p:.1g}), and no known cause "
        "explains it."
    ),
    Finding.BEYOND_A_TRACKER: lambda _: "No known cause explains the misfit.",
    Finding.CAUSE_IDENTIFIED: _identified,
    Finding.SCATTER: lambda facts: (
        f"Nothing but {' and '.join(cause.effect.noun for cause in facts.scatter)}: the readings "
        "scatter more, and the joint springs stay."
    ),
    Finding.NOTHING_DETERMINED: lambda _: (
        "No stiffness is determined: the targets move with the load by no more than readings and "
        "forces are uncertain. Check whether the robot was pulled in the loaded readings, and "
        "whether the forces belong to them."
    ),
    Finding.PREDICTS_NOTHING: _predicts_nothing,
    Finding.SPRINGS_DISAGREE: lambda facts: str(opened(_SPRINGS_DISAGREE)(facts)),
    Finding.BEYOND_NOISE: _beyond_noise,
    Finding.SCATTERED: _scattered,
    Finding.NOTHING: lambda _: "The joint springs explain what was measured.",
}
"""All but a mistake in the data, which is told before everything else."""

BECAUSE: Mapping[Reason, str] = {
    Reason.MISTAKE_AND_RIVALS: (
        "All values are from the corrected data, averaged by probability over the models that "
        "may hold."
    ),
    Reason.MISTAKE_AND_CAUSE: (
        "All values are from the corrected data and include what was identified beside the "
        "joint springs."
    ),
    Reason.MISTAKE_AND_UNEXPLAINED: (
        "All values are from the corrected data, which the joint springs do not explain, and "
        "no known cause does: do not rely on the stated uncertainties."
    ),
    Reason.MISTAKE_SPRINGS_UNTOUCHED: (
        "All values are from the corrected data; what else was identified does not change the "
        "joint springs."
    ),
    Reason.MISTAKE: "All values are from the corrected data.",
    Reason.MISTAKE_AND_TOO_SMALL: (
        "All values are from the corrected data, and their uncertainties hold what causes too "
        "small to name may change."
    ),
    Reason.WEIGHED_ANEW: (
        "Joint springs explain the deflections; the values rest on the robot's geometry, or on the "
        "scatter of the scale, as it was identified."
    ),
    Reason.CAUSE_AND_RIVALS: (
        "Joint springs alone do not explain the readings; the values below include what "
        "was identified, averaged by probability over the laws it may have and over what else may "
        "be true."
    ),
    Reason.CAUSE_IDENTIFIED: (
        "Joint springs alone do not explain the readings; the values below include what "
        "was identified."
    ),
    Reason.RIVALS: (
        "Joint springs alone do not explain the readings, and more than one cause may be true: "
        "the values are averaged over them by probability, and each interval covers every cause "
        f"with a probability above {100 * POSSIBLE:.0f} %."
    ),
    Reason.CAUSE_DOUBTFUL: (
        "Joint springs alone do not explain the readings; the values below include the "
        "likeliest cause."
    ),
    Reason.SPRINGS_UNTOUCHED: "What was identified does not change the joint springs.",
    Reason.SPRINGS_DISAGREE: (
        "Joint springs explain pulls and positions each by itself, but not by the same "
        "stiffnesses: do not rely on the stated uncertainties."
    ),
    Reason.UNEXPLAINED: (
        "Joint springs do not explain the readings, nor do known causes explain all that is left: "
        "do not rely on the stated uncertainties."
    ),
    Reason.ADEQUATE: "Joint springs explain the readings.",
    Reason.TOO_SMALL: (
        "Joint springs explain the readings; the uncertainties hold what causes too small to name "
        "may change."
    ),
}

HOLDS = {
    **BECAUSE,
    Reason.WEIGHED_ANEW: (
        "Joint springs explain the readings, once the geometry of the robot, or the scatter of the "
        "scale, is as it was identified."
    ),
    **dict.fromkeys(
        (Reason.CAUSE_AND_RIVALS, Reason.CAUSE_IDENTIFIED),
        "Joint springs alone do not explain the readings; with what was identified they do.",
    ),
    Reason.RIVALS: (
        "Joint springs alone do not explain the readings, and more than one cause may be true."
    ),
    Reason.CAUSE_DOUBTFUL: (
        "Joint springs alone do not explain the readings; with the likeliest cause the model does."
    ),
    Reason.SPRINGS_UNTOUCHED: (
        "Joint springs explain the readings; what else was identified does not change them."
    ),
}
"""Whether the model holds, where the data hold no mistake and there is something to say."""

_AGAIN = "; then run the campaign once more. Until then"

_CORRECT: Mapping[str, str] = {
    "outlier": (
        "Check {one} against the measurement record and correct the file, or measure {it} "
        f"again{_AGAIN}"
    ),
    "exchanged": (
        "Check against the measurement record which of them belongs where and correct the file"
        f"{_AGAIN}"
    ),
    "loose_target": f"Fasten that target, and measure the pulls again{_AGAIN}",
    "tool_point": f"Measure that point again and correct campaign.toml{_AGAIN}",
    **dict.fromkeys(
        ("mounted_turned", "joint_offset", "link_length", "link_offset"),
        "Check that entry against the data sheet or the controller and correct the robot file"
        f"{_AGAIN}",
    ),
}


def correct(facts: Facts) -> str:
    """What to do about the mistakes in the data, up to what to use until then."""
    if facts.hopeless:
        return f"Measure again what was not measured{_AGAIN}"
    if all(one.together for one in facts.mistakes):
        return f"Measure that pose again, all its states in one go{_AGAIN}"
    kinds = {"tool_point" if one.entry else one.name for one in facts.mistakes}
    if len(kinds) == 1 and kinds <= _CORRECT.keys():
        several = len(facts.mistakes) > 1 or len(facts.mistakes[0].at) > 1
        number = ("those readings", "them") if several else ("that reading", "it")
        return _CORRECT[kinds.pop()].replace("{one}", number[0]).replace("{it}", number[1])
    return f"Check that against the measurement record and correct the file{_AGAIN}"


DO: Mapping[Reason, str] = {
    Reason.ADEQUATE: "Use these stiffnesses.",
    Reason.TOO_SMALL: "Use these stiffnesses.",
    Reason.SPRINGS_UNTOUCHED: "Use these stiffnesses.",
    Reason.WEIGHED_ANEW: "Use these stiffnesses with what was identified beside them.",
    Reason.CAUSE_IDENTIFIED: "Predict with the extended model, which includes what was identified.",
    Reason.CAUSE_AND_RIVALS: "Predict with the extended model, which includes what was identified.",
    Reason.RIVALS: (
        "Use the averaged values with their intervals, which cover every cause with a probability "
        f"above {100 * POSSIBLE:.0f} %, or find out first which cause it is."
    ),
    Reason.CAUSE_DOUBTFUL: (
        "Predict with the model that includes the likeliest cause, or find out first whether it is "
        "the one."
    ),
    Reason.SPRINGS_DISAGREE: (
        "Enter none of these stiffnesses into a controller before scale and masses are checked."
    ),
    Reason.UNEXPLAINED: (
        "Enter none of these stiffnesses into a controller; find out first what the model misses."
    ),
    Reason.MISTAKE: "use the values from the corrected data.",
    Reason.MISTAKE_AND_TOO_SMALL: "use the values from the corrected data.",
    Reason.MISTAKE_SPRINGS_UNTOUCHED: "use the values from the corrected data.",
    Reason.MISTAKE_AND_CAUSE: (
        "use the values from the corrected data, which include what was identified."
    ),
    Reason.MISTAKE_AND_RIVALS: (
        "use the averaged values from the corrected data with their intervals."
    ),
    Reason.MISTAKE_AND_UNEXPLAINED: (
        "enter none of these stiffnesses into a controller: what the model misses is not known."
    ),
}
"""What to do with the values; with a mistake in the data, after `correct`."""

DO_DESPITE = (
    "Use these stiffnesses: they allow for what was identified, which is in the measurement."
)
"""The same where an identified cause falsifies readings and deflects no robot."""

ABOUT: Mapping[About, str] = {
    About.VERDICT: "Verdict",
    About.TO_DO: "What to do",
    About.MODEL: "Model to use",
    About.NUMBERS: "For the controller",
    About.TOLERANCE: "Tolerance",
    About.TEST_POSE: "Test pose",
    About.WRONG: "Findings",
    About.NOT_FOUND: "Examined and not found",
    About.NEXT: "What to measure next",
}
"""What a line of the first screen is about."""


def worst_known(stiffness: Sequence[Stiffness]) -> Stiffness | None:
    """The first without a value, else the one with the largest relative uncertainty."""
    lost = [joint for joint in stiffness if joint.value is None]
    known = [joint for joint in stiffness if joint.relative_std is not None]
    return next(iter(lost), max(known, key=lambda one: one.relative_std or 0.0, default=None))


def at_axis(value: float, unit: str) -> str:
    """Where an axis stands."""
    return f"{plain(value, 4)} m" if unit == "m" else f"{plain(value, 4)}°"


def loads(pose: ToMeasure) -> str:
    """`5 load steps up to 3012 N along (0.10, -0.99, 0.05) of F_b`."""
    along = ", ".join(f"{part:.2f}" for part in pose.direction)
    force = f"1 load step of {pose.force_n:.0f} N"
    if pose.steps > 1:
        force = f"{pose.steps} load steps up to {pose.force_n:.0f} N"
    return f"{force} along ({along}) of F_b"
