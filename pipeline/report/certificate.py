"""The first page (certificate): verdict, what to do, robot, stiffnesses, data for filing."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np

from pipeline.answer.amounts import amount
from pipeline.answer.contract import About, Answer, Cause, Data, Placed, Reason, Stiffness, Which
from pipeline.answer.pose_budget import lowered_by_pulls
from pipeline.answer.remarks import other_way
from pipeline.answer.words import DO, DO_DESPITE, capital
from pipeline.base import doors
from pipeline.base.appearance import PLAIN, Appearance
from pipeline.base.files import sha256
from pipeline.base.language import Say, translated
from pipeline.base.quantities import (
    MISSING,
    common_prefix,
    percent,
    plain,
    prefixed,
    scaled,
    with_std,
    with_uncertainty,
)
from pipeline.diagnosis.finding import Finding, Verdict
from pipeline.machine.effect import in_place
from pipeline.prediction.decision import Decision
from pipeline.report import words
from pipeline.report.beside_nominal import drawn_as, stand
from pipeline.report.figures.catalogue import figures
from pipeline.report.record import Certificate, Item, StiffnessBar
from pipeline.report.summaries import Tables, interval
from pipeline.store.campaign import dump

_MOST_FOUND = 24
"""Maximum number of words about an error in the data here; the page below has the full text."""

_MOST_MISTAKES = 4
"""Maximum number of errors in the data that are told, each with its line and what fits instead."""

_MOST_CAUSES = 2
"""Maximum number of causes listed."""

_MOST_NEXT = 30
"""Maximum number of words on what to measure next; the page below also gives the pose."""

_DIGEST = 16
"""Number of hexadecimal digits of the digest that are printed."""


def certificate(
    answer: Answer, tables: Tables, say: Say = str, look: Appearance = PLAIN
) -> Certificate:
    """Certificate of a campaign, which an engineer files.

    Args:
        answer: The answer to the campaign.
        tables: Tables of the report by name.
        say: Translates a text into the language of the certificate.
        look: Logo and further lines of the house.
    """
    say = words.by_axis(answer, say)
    pictures = {one.name: translated(one, say) for one in figures(_PICTURES, answer, tables)}
    bars, nominal = _bars(answer)
    compared = nominal is not None
    return Certificate(
        found=found(answer, say),
        to_do=say(" ".join((*_by_tolerance(answer), to_do(answer), *_to_controller(answer)))),
        measure=_measure(answer, say),
        tolerance=say(_unjudged(answer)),
        picture=pictures.get("certificate"),
        gauge=pictures.get("gauge"),
        bars=translated(bars, say),
        nominal=nominal,
        beside=say("Of nominal" if compared else "Uncertainty"),
        note=say(_note(answer, compared) if bars else _NO_TABLE),
        filed=(
            *(filed(answer, say) if (filed := doors.found(_IDENTITY)) else ()),
            *(Item(name, text) for name, text in look.fields),
        ),
        logo=look.logo,
        digest=digest(answer),
        sign=tuple(map(say, Certificate.sign)),
    )


_IDENTITY = "pipeline.annex.identity:items"
_PICTURES = ("certificate", "gauge")


def digest(answer: Answer) -> str:
    """First digits of what `sha256sum result.json` prints."""
    return sha256(dump(answer.as_json()))[:_DIGEST]


# --- what is found, and what to do ----------------------------------------------------------------


def found(answer: Answer, say: Say = str) -> str:
    """One sentence on what is wrong: mistakes in the data, else the causes, else the verdict."""
    mistakes = [one.evidence.sentence for one in answer.diagnosis.causes if one.evidence]
    if mistakes:
        return _mistaken(mistakes, say)
    causes, fits = answer.diagnosis.causes, answer.diagnosis.verdict == "adequate"
    for reason in answer.diagnosis.reasons if not causes else ():
        if reason in _OF_UNLOADED and (fits or reason is not Finding.ROUGH_TABLE):
            return say(_OF_UNLOADED[reason])
    if not causes:
        return say(_NOTHING.get(str(answer.diagnosis.verdict), ""))
    return f"{capital(say(_listed(causes)))}{say(_gain(answer))}."


def _mistaken(sentences: Sequence[str], say: Say) -> str:
    """The first `_MOST_MISTAKES` errors in the data, and the number of further ones."""
    each = [_cut(say(_LINES.sub(_FIRST, one))) for one in sentences[:_MOST_MISTAKES]]
    left = len(sentences) - len(each)
    more = say(f" (and {left} more)") if left else ""
    return f"{_begun('; '.join(each))}{more}."


_OF_UNLOADED = {
    Finding.STANDS_UNEXPLAINED: "The unloaded reflectors do not stand where the robot file places "
    "them.",
    Finding.ROUGH_TABLE: "Joint springs explain the readings; unloaded, the robot deviates a "
    "little from its nominal geometry.",
}
_NOTHING = {
    "adequate": "Nothing detectable is wrong.",
    "unexplained": "No known cause explains what the model leaves.",
}


_LINES = re.compile(r" \(([^\s(),]+:\d+)(?:,| and) [^()]*\)")
"""Several lines of a file in brackets..."""

_FIRST = r" (\1 ...)"
"""... are replaced by the first of them."""


def _begun(text: str) -> str:
    """Capitalise a text unless it begins with the name of a file or a group."""
    return text if re.search(r"[\d._/]", text.split(" ")[0].rstrip(".,:;")) else capital(text)


def _cut(text: str) -> str:
    """Cut a sentence of more than `_MOST_FOUND` words after its last clause that fits."""
    parts = text.split()
    if len(parts) <= _MOST_FOUND:
        return text
    ends = [k for k, one in enumerate(parts[:_MOST_FOUND], 1) if one[-1] in ",:;"]
    kept = " ".join(parts[: max(ends, default=_MOST_FOUND)]).rstrip(" ,:;")
    return re.sub(r"[:;] \S+ \S+$", "", kept)


def _listed(causes: Sequence[Cause]) -> str:
    """The first `_MOST_CAUSES` causes, and the number of further ones."""
    more = len(causes) - _MOST_CAUSES
    return "; ".join([*map(_cause, causes[:_MOST_CAUSES]), *[f"{more} more"] * (more > 0)])


def _cause(one: Cause) -> str:
    """A cause with its likeliest rival or, without rivals, with its size if that is one number."""
    if one.rivals:
        return f"{words.placed(one)} or {_rival(one, one.rivals[0])}"
    size = f", {amount(one.parameters[0])}" if len(one.parameters) == 1 else ""
    return f"{words.placed(one)}{size}"


def _rival(one: Cause, other: Placed) -> str:
    """A rival in words; only its place if it is the same effect in another joint."""
    if other.name == one.name and isinstance(other.where, int):
        return in_place(other.where, other.name, other.axis).removeprefix(" in ")
    return words.placed(other)


def _gain(answer: Answer) -> str:
    """Error at held-out poses without and with the causes; empty if it does not decrease.

    Without causes means joint springs alone; for positions, nominal geometry.
    """
    without, beside = "joint springs", "the cause"
    both = (answer.joint_springs.validation, answer.validation)
    before, after = (one.held_out_rms_mm if one else None for one in both)
    if len(answer.diagnosis.causes) > 1 or answer.diagnosis.causes[0].rivals:
        beside = "the causes"
    if answer.of_positions:
        without = "nominal geometry"
        before, after = (answer.position_steps[k].between_mm for k in (0, -1))
    if before is None or after is None or after >= before:
        return ""
    return (
        f"; error at poses held out: {plain(before, 2)} mm with {without}, {plain(after, 2)} mm "
        f"with {beside}"
    )


def to_do(answer: Answer) -> str:
    """What to do with the values; for positions the sentence of the first screen, if it has one."""
    reason, corrected = answer.recommended.reason, answer.recommended.data is Data.CORRECTED
    if answer.diagnosis.verdict == Verdict.AMBIGUOUS and reason == Reason.WEIGHED_ANEW:
        reason = Reason.CAUSE_DOUBTFUL
    sentence = _OPEN.get(reason, DO[reason])
    if reason is Reason.CAUSE_IDENTIFIED and not _acting(answer):
        sentence = DO_DESPITE
    if answer.of_positions:
        every = (one.text for one in answer.first_screen if one.about == About.TO_DO)
        sentence = _NO_VALUE if corrected else next(every, sentence)
    if corrected or sentence[0].islower():
        return f"Correct the files; until then {sentence}"
    return sentence


_OPEN = {
    Reason.RIVALS: "Until the cause is known, predict with averaged values.",
    Reason.CAUSE_DOUBTFUL: "Until the cause is certain, predict with the likeliest one.",
    Reason.MISTAKE_AND_CAUSE: "predict with the model from the corrected data.",
    Reason.MISTAKE_AND_RIVALS: "predict with the model from the corrected data.",
}
"""What to do, in fewer words than on the page below."""

_NO_VALUE = "enter none of these values into a controller."


def _unjudged(answer: Answer) -> str:
    """Why no tolerance is judged; empty if one is."""
    if answer.tolerance is not None:
        return ""
    if answer.of_positions:
        return "Not judged: no load was applied."
    return "Not judged: none is stated in campaign.toml."


def _measure(answer: Answer, say: Say = str) -> str:
    """What to measure next: the first sentences of that line of the first screen."""
    line = next((one.text for one in answer.first_screen if one.about == About.NEXT), "")
    every = say(" ".join(one for one in _ENDS.split(line) if not _UNCERTAINTY.search(one)))
    kept: list[str] = []
    for sentence in _ENDS.split(every):
        room = _MOST_NEXT - sum(len(one.split()) for one in kept)
        if kept and len(sentence.split()) > room:
            clause = sentence.split("; ")[0]
            if clause != sentence and len(clause.split()) <= room and not re.search(r"\d", clause):
                kept.append(f"{clause}.")
            break
        kept.append(sentence)
    return " ".join(kept)


_UNCERTAINTY = re.compile(r"standard uncertainty|it is expected to be")
"""Sentences on the uncertainty of the joint, which is in the table below."""

_ENDS = re.compile(r"(?<=\.) (?=[A-ZÀÉÜ])")
"""The space between two sentences."""


def _to_controller(answer: Answer) -> Iterator[str]:
    """Instruction to enter effective values, if a controller cannot represent the model."""
    if _substituted(answer):
        yield "Enter all values of the last column."


def _by_tolerance(answer: Answer) -> Iterator[str]:
    """What to do if the tolerance is not kept or undecided."""
    holds = answer.recommended.reason.holds_for_its_readings
    worst = answer.tolerance.worst if answer.tolerance and holds else None
    if worst is Decision.UNDECIDED and lowered_by_pulls(answer.test_pose):
        yield "For the tolerance: reduce the force or measure more."
    elif worst in (Decision.FAIL, Decision.UNDECIDED):
        yield "For the tolerance: reduce the force or compensate the path."


# --- the stiffnesses ------------------------------------------------------------------------------


def _bars(answer: Answer) -> tuple[tuple[StiffnessBar, ...], float | None]:
    """One bar per joint and the nominal value's place along them, 0 to 1 (None without nominals).

    There are no bars if no stiffness has a value.
    """
    joints, units = answer.stiffness, _units(answer)
    enter = _entered(answer, units)
    if not any(one.value is not None for one in (*joints, *_taken(answer))):
        return (), None
    compared = [one for one in joints if one.value is not None and one.nominal]
    tracks, nominal = (_beside_nominal(compared), True) if compared else (_rough(joints), False)
    at = tracks.pop("", None)
    bars = tuple(
        StiffnessBar(
            name=_name(one),
            value=_value(one, units),
            beside=stand(one).said if one.value is not None else MISSING,
            enter=enter.get(one.name, ""),
            track=tracks.get(one.name),
        )
        for one in joints
    )
    return bars, at[1] if nominal and at else None


def _name(joint: Stiffness) -> str:
    """The controller's name of the axis, or the joint's; a long one follows that of the drawing."""
    name, drawn = joint.axis or joint.joint_name, drawn_as(joint)
    return name if name == drawn else f"{drawn} {name}"


_Tracks = dict[str, tuple[float, float, float]]


def _beside_nominal(joints: Sequence[Stiffness]) -> _Tracks:
    """Lower limit, value and upper limit of each joint along the bar, 0 to 1.

    The entry with the empty name is the nominal value.
    """
    nominal = np.array([one.nominal for one in joints], dtype=float)
    share, low, high = interval(joints, nominal / 100)
    left, right = (
        float(np.clip(end, *ends))
        for end, ends in ((low.min(), (50, 90)), (np.max(high), (110, 150)))
    )
    ends = np.clip((np.array([low, share, high]) - left) / (right - left), 0.0, 1.0)
    tracks = {one.name: tuple(ends[:, k].tolist()) for k, one in enumerate(joints)}
    middle = (100 - left) / (right - left)
    return tracks | {"": (middle, middle, middle)}


def _rough(joints: Sequence[Stiffness]) -> _Tracks:
    """Bars centred on the middle, with lengths proportional to the relative uncertainty."""
    size = {one.name: min(one.relative_std or 0.0, 1.0) for one in joints if one.value is not None}
    most = max(size.values(), default=0.0) or 1.0
    return {name: (0.5 - 0.5 * s / most, 0.5, 0.5 + 0.5 * s / most) for name, s in size.items()}


_Units = dict[str, tuple[float, str]]


def _units(answer: Answer) -> _Units:
    """Factor and letter of the SI prefix by unit.

    All joints of a unit share a prefix, so that no value is misread by a factor of a thousand.
    """
    every = (*answer.stiffness, *_taken(answer))
    return {
        unit: common_prefix([one.value for one in every if one.unit == unit])
        for unit in {one.unit for one in every}
    }


def _value(joint: Stiffness, units: _Units) -> str:
    """`3.797 ± 0.018 MN·m/rad` with ± U; a lower bound if the joint may be rigid."""
    if joint.value is None:
        return "not determined"
    (factor, letter), (least, most) = units[joint.unit], joint.ci95
    unit = prefixed(joint.unit, letter)
    if most is None and least:
        return f"above {plain(least / factor, 2)} {unit}"
    return f"{with_std(joint.value / factor, scaled(joint.std, factor / 2))} {unit}"


_SUBSTITUTES = (
    Reason.CAUSE_AND_RIVALS,
    Reason.CAUSE_IDENTIFIED,
    Reason.CAUSE_DOUBTFUL,
    Reason.RIVALS,
    Reason.MISTAKE_AND_CAUSE,
    Reason.MISTAKE_AND_RIVALS,
)
"""Reasons of a recommendation for which a controller is given the values of joint springs alone:
effective stiffnesses, which absorb part of the cause."""


_OF_THE_MEASUREMENT = ("force", "metrology", "noise")
"""Locations of causes that falsify readings and deflect no robot: nothing makes up for them."""


def _acting(answer: Answer) -> set[str]:
    """Causes of the answer's model that deflect the robot, without those too small to name.

    Such a one stands beside all that was identified, a rival in its place.
    """
    aside = {c.name for c in answer.diagnosis.causes if c.location in _OF_THE_MEASUREMENT}
    sets = [{c.name for c in one.causes} for one in answer.recommended.hypotheses]
    return {name for one in sets if not one > sets[0] for name in one} - aside


def _substituted(answer: Answer) -> bool:
    """Whether effective stiffnesses replace the values in a controller; only for pulls."""
    recommended, acting = answer.recommended, _acting(answer)
    beside = recommended.reason in _SUBSTITUTES and recommended.model is not Which.JOINT_SPRINGS
    return beside and bool(acting) and not answer.of_positions


def enterable(answer: Answer) -> bool:
    """Whether any of the values may be used."""
    corrected = answer.of_positions and answer.recommended.data is Data.CORRECTED
    return answer.recommended.reason.holds_for_its_readings and not corrected


def _taken(answer: Answer) -> Sequence[Stiffness]:
    """Stiffnesses to enter into a controller; none if no value may be used."""
    if not enterable(answer):
        return ()
    if not _substituted(answer):
        return answer.stiffness
    corrected = answer.recommended.data is Data.CORRECTED
    return answer.effective if corrected else answer.joint_springs.stiffness


def _entered(answer: Answer, units: _Units) -> dict[str, str]:
    """Entry for the controller, by name of the stiffness."""
    none = {one.name: "do not enter" for one in answer.stiffness}
    return none | {one.name: _rounded(one, units) for one in _taken(answer)}


def _rounded(joint: Stiffness, units: _Units) -> str:
    """A value rounded as its uncertainty allows; `no value` for a joint that may be rigid."""
    if joint.value is None:
        return "leave as it is"
    if joint.ci95[1] is None:
        return "no value"
    factor, letter = units[joint.unit]
    value, u = joint.value / factor, scaled(joint.std, factor / 2)
    shown = plain(value) if u is None else with_uncertainty(value, u)[0]
    return f"{shown} {prefixed(joint.unit, letter)}"


def _note(answer: Answer, compared: bool) -> str:
    """What ± and the bars mean, and what to enter into a controller."""
    bar = "Bars: 95 % interval, as a share of nominal (line)."
    if not compared:
        widest = max((one.relative_std or 0.0 for one in answer.stiffness), default=0.0)
        bar = f"Bars: relative U, the longest {percent(2 * widest)}." if widest else ""
    both = (
        f"{_name(one)}: {_value(one, _units(answer))}{other_way(one, _COVERAGE)}."
        for one in answer.stiffness
        if one.by_sign
    )
    enter = _EFFECTIVE if _substituted(answer) else ()
    return " ".join(filter(None, (_PLUS_MINUS, bar, *both, *enter)))


_COVERAGE = 2.0
"""Standard uncertainties in U [1]."""


_PLUS_MINUS = "Everywhere on this page ± is the expanded uncertainty U (k = 2, about 95 %)."
_EFFECTIVE = (
    "A controller has no entry for the cause.",
    "The last column has effective values, which make up for it as far as joint springs can.",
    "They belong together: enter all of them, also where the stiffness itself is not determined.",
    "Where programs are corrected for the deflection, enter none.",
)
_NO_TABLE = "No stiffness is determined: enter none into the controller."
"""Text in place of the table of stiffnesses."""
