"""The first page: verdict, what to do, the robot, its stiffnesses, what the answer is filed by."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np

from pipeline.answer.contract import About, Answer, Cause, Data, Reason, Stiffness, Which
from pipeline.answer.nouns import amount
from pipeline.answer.words import DO, capital
from pipeline.base.files import sha256
from pipeline.base.language import Say, said
from pipeline.base.look import PLAIN, Look
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
from pipeline.prediction.decision import Decision
from pipeline.report import words
from pipeline.report.figures.catalogue import figures
from pipeline.report.figures.certificate import stand
from pipeline.report.figures.stiffness import interval
from pipeline.report.record import Bar, Certificate, Item
from pipeline.report.sections.identity import NAMES, rows
from pipeline.report.summaries import Tables
from pipeline.store.campaign import dump

_MOST_FOUND = 24
"""So many words of an error in the data are told here; all of them stand on the page below."""

_MOST_CAUSES = 2
"""So many causes are named here."""

_MOST_NEXT = 30
"""So many words of what to measure next; the page below has the pose, too."""

_DIGEST = 16
"""Digits of the digest that are printed."""


def certificate(answer: Answer, tables: Tables, say: Say = str, look: Look = PLAIN) -> Certificate:
    """What an engineer files of a campaign, in a language, with what the house adds."""
    pictures = {one.name: said(one, say) for one in figures(_PICTURES, answer, tables)}
    bars, nominal = _bars(answer)
    compared = nominal is not None
    return Certificate(
        found=found(answer, say),
        to_do=say(" ".join((*_by_tolerance(answer), to_do(answer), *_to_controller(answer)))),
        measure=measure(answer, say),
        tolerance=say(unjudged(answer)),
        picture=pictures.get("certificate"),
        gauge=pictures.get("gauge"),
        bars=said(bars, say),
        nominal=nominal,
        beside=say("Of nominal" if compared else "Uncertainty"),
        note=say(_note(answer, compared)),
        filed=(
            *(Item(say(name), text if name in NAMES else say(text)) for name, text in rows(answer)),
            *(Item(name, text) for name, text in look.fields),
        ),
        logo=look.logo,
        digest=digest(answer),
        sign=tuple(map(say, Certificate.sign)),
    )


_PICTURES = ("certificate", "gauge")


def digest(answer: Answer) -> str:
    """The first digits of what `sha256sum result.json` prints."""
    return sha256(dump(answer.as_json()))[:_DIGEST]


# --- what is found, and what to do ----------------------------------------------------------------


def found(answer: Answer, say: Say = str) -> str:
    """What is wrong, in a sentence."""
    mistakes = [one.evidence.sentence for one in answer.diagnosis.causes if one.evidence]
    if mistakes:
        more = say(f" (and {len(mistakes) - 1} more)") if len(mistakes) > 1 else ""
        return f"{_begun(_cut(say(_LINES.sub(_FIRST, mistakes[0]))))}{more}."
    causes = answer.diagnosis.causes
    if not causes:
        return say(_NOTHING.get(str(answer.diagnosis.verdict), ""))
    return f"{capital(say(_listed(causes)))}{say(_gain(answer))}."


_NOTHING = {
    "adequate": "Nothing detectable is wrong.",
    "unexplained": "No known cause explains what the model leaves.",
}


_LINES = re.compile(r" \(([^\s(),]+:\d+)(?:,| and) [^()]*\)")
"""More than one line of a file, in brackets..."""

_FIRST = r" (\1 ...)"
"""... of which the first is told."""


def _begun(text: str) -> str:
    """With a capital, but for the name of a file or a group."""
    return text if re.search(r"[\d._/]", text.split(" ")[0].rstrip(".,:;")) else capital(text)


def _cut(text: str) -> str:
    """The first clauses of a long sentence."""
    told = text.split()
    if len(told) <= _MOST_FOUND:
        return text
    ends = [k for k, one in enumerate(told[:_MOST_FOUND], 1) if one[-1] in ",:;"]
    kept = " ".join(told[: max(ends, default=_MOST_FOUND)]).rstrip(",:;")
    return re.sub(r"[:;] \S+ \S+$", "", kept)


def _listed(causes: Sequence[Cause]) -> str:
    """The first causes, and how many more there are."""
    more = len(causes) - _MOST_CAUSES
    rest = [f"{more} more"] if more > 0 else []
    return "; ".join([*map(_cause, causes[:_MOST_CAUSES]), *rest])


def _cause(one: Cause) -> str:
    """A cause with its size, or with what else it may be."""
    if one.rivals:
        return f"{words.placed(one)} or {words.placed(one.rivals[0])}"
    size = f", {amount(one.parameters[0])}" if len(one.parameters) == 1 else ""
    return f"{words.placed(one)}{size}"


def _gain(answer: Answer) -> str:
    """By how much poses left out are predicted better than by joint springs alone."""
    both = (answer.joint_springs.validation, answer.validation)
    before, after = (one.held_out_rms_mm if one else None for one in both)
    if answer.of_positions:
        before, after = (answer.position_steps[k].between_mm for k in (0, -1))
    if before is None or after is None or after >= before:
        return ""
    return f"; error at poses left out {plain(before, 2)} → {plain(after, 2)} mm"


def to_do(answer: Answer) -> str:
    """What to do with the values; those of positions are more than a controller takes."""
    reason, corrected = answer.recommended.reason, answer.recommended.data is Data.CORRECTED
    said = _OPEN.get(reason, DO[reason])
    if answer.of_positions:
        every = (one.text for one in answer.first_screen if one.about == About.TO_DO)
        said = _NO_VALUE if corrected else next(every, said)
    if corrected or said[0].islower():
        return f"Correct the files; until then {said}"
    return said


_OPEN = {
    Reason.RIVALS: (
        "Find out first which cause it is; until then predict with the averaged values."
    ),
    Reason.CAUSE_DOUBTFUL: "Find out first whether it is this cause; until then predict with it.",
}
"""What to do where a cause is open, in fewer words than below."""

_NO_VALUE = "enter none of these values into a controller."


def unjudged(answer: Answer) -> str:
    """Why nothing is said of a tolerance; empty where it is."""
    if answer.tolerance is not None:
        return ""
    if answer.of_positions:
        return "Not judged: no load was applied."
    return "Not judged: none is stated in campaign.toml."


def measure(answer: Answer, say: Say = str) -> str:
    """What to measure next: the first sentences of what the page below says of it."""
    every = say(next((one.text for one in answer.first_screen if one.about == About.NEXT), ""))
    told: list[str] = []
    for sentence in re.split(r"(?<=\.) (?=[A-ZÀÉÜ])", every):
        room = _MOST_NEXT - sum(len(one.split()) for one in told)
        if told and len(sentence.split()) > room:
            clause = sentence.split("; ")[0]
            if clause != sentence and len(clause.split()) <= room and not re.search(r"\d", clause):
                told.append(f"{clause}.")
            break
        told.append(sentence)
    return " ".join(told)


def _to_controller(answer: Answer) -> Iterator[str]:
    """What of the model no controller takes."""
    if _substituted(answer):
        yield "Correct programs (`pipeline compensate`) or enter the last column."


def _by_tolerance(answer: Answer) -> Iterator[str]:
    """What a tolerance that is not kept asks for."""
    worst = answer.tolerance.worst if answer.tolerance else None
    if worst is Decision.FAIL:
        yield "Reduce the force or compensate the path."
    elif worst is Decision.UNDECIDED:
        yield "Reduce the force or measure more."


# --- the stiffnesses ------------------------------------------------------------------------------


def _bars(answer: Answer) -> tuple[tuple[Bar, ...], float | None]:
    """One for each joint, and where the nominal value stands along them."""
    joints, enter = answer.stiffness, _entered(answer)
    compared = [one for one in joints if one.value is not None and one.nominal]
    tracks, nominal = (_beside_nominal(compared), True) if compared else (_rough(joints), False)
    at = tracks.pop("", None)
    bars = tuple(
        Bar(
            name=one.axis or one.joint_name,
            value=_value(one),
            beside=stand(one).said if one.value is not None else MISSING,
            enter=enter.get(one.name, ""),
            track=tracks.get(one.name),
        )
        for one in joints
    )
    return bars, at[1] if nominal and at else None


_Tracks = dict[str, tuple[float, float, float]]


def _beside_nominal(joints: Sequence[Stiffness]) -> _Tracks:
    """Limits and value of each as a share of the width, nominal under the empty name."""
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
    """Bars about the middle, as long as each is uncertain."""
    size = {one.name: min(one.relative_std or 0.0, 1.0) for one in joints if one.value is not None}
    most = max(size.values(), default=0.0) or 1.0
    return {name: (0.5 - 0.5 * s / most, 0.5, 0.5 + 0.5 * s / most) for name, s in size.items()}


def _value(joint: Stiffness) -> str:
    """`3.797 ± 0.009 MN·m/rad`, or why there is none."""
    if joint.value is None:
        return "not determined"
    factor, letter = common_prefix([joint.value])
    value, std = scaled(joint.value, factor), scaled(joint.std, factor)
    return f"{with_std(value, std)} {prefixed(joint.unit, letter)}"


_SUBSTITUTES = (
    Reason.CAUSE_AND_RIVALS,
    Reason.CAUSE_IDENTIFIED,
    Reason.CAUSE_DOUBTFUL,
    Reason.RIVALS,
)
"""Reasons for which a controller takes the joint springs alone, which make up for the cause."""


def _substituted(answer: Answer) -> bool:
    """Whether a controller takes others in place of the values; pulls alone give such."""
    said = answer.recommended
    beside = said.reason in _SUBSTITUTES and said.model is not Which.JOINT_SPRINGS
    return beside and not answer.of_positions


def _entered(answer: Answer) -> dict[str, str]:
    """What a controller takes, by name of the stiffness."""
    corrected = answer.of_positions and answer.recommended.data is Data.CORRECTED
    if corrected or not answer.recommended.reason.holds_for_its_readings:
        return {one.name: "none" for one in answer.stiffness}
    of = answer.joint_springs if _substituted(answer) else answer
    return {one.name: _rounded(one) for one in of.stiffness}


def _rounded(joint: Stiffness) -> str:
    """A value in the digits that its uncertainty allows; none for one that may be rigid."""
    if joint.value is None:
        return "leave as it is"
    if joint.ci95[1] is None:
        return "no value"
    factor, letter = common_prefix([joint.value])
    value, std = joint.value / factor, scaled(joint.std, factor)
    shown = plain(value) if std is None else with_uncertainty(value, std)[0]
    return f"{shown} {prefixed(joint.unit, letter)}"


def _note(answer: Answer, compared: bool) -> str:
    """What ± and the bars are, and what a controller takes."""
    bar = "Bars: 95 % interval, as a share of nominal (line)."
    if not compared:
        widest = max((one.relative_std or 0.0 for one in answer.stiffness), default=0.0)
        bar = f"Bars: relative uncertainty, the longest {percent(widest)}." if widest else ""
    enter = _EFFECTIVE if _substituted(answer) else ""
    return " ".join(filter(None, (_PLUS_MINUS, bar, enter)))


_PLUS_MINUS = "Values ± one standard uncertainty (k = 1)."
_EFFECTIVE = (
    "A controller has no entry for the cause: its values are effective ones, which make up for it "
    "as far as joint springs can."
)
