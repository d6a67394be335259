"""Section on what the joint springs leave out: causes, rivals and gain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from pipeline.annex.sections.to_measure import to_measure
from pipeline.annex.sections.unseen import blind_spots, not_found
from pipeline.annex.words import Axes, at, label
from pipeline.answer.amounts import sizes
from pipeline.answer.contract import (
    Alone,
    Answer,
    AsGood,
    Cause,
    Evidence,
    Gain,
    Predicted,
    Rival,
    Unnamed,
)
from pipeline.answer.words import capital, listed
from pipeline.base.quantities import p_value, percent, plain, probability
from pipeline.diagnosis.finding import Verdict
from pipeline.report import words
from pipeline.report.figures.catalogue import figures
from pipeline.report.record import (
    Block,
    Cells,
    Paragraph,
    ReportTable,
    Section,
    number_column,
    section_of,
    table_of,
    word_column,
)
from pipeline.report.summaries import Tables

_RATHER = 0.5
"""Probability of something outside the catalogue above which that of a cause is said to be without
it [1]: the model that it belongs to is more likely wrong than right."""

_WORTH_SAYING = 0.01
"""Probability of a cause outside the catalogue from which on it is mentioned [1]."""

_TITLES = {
    Verdict.ADEQUATE: "What this campaign shows and cannot show",
    Verdict.EXPLAINED: "What joint springs alone leave out",
    Verdict.AMBIGUOUS: "What joint springs alone leave out",
    Verdict.UNEXPLAINED: "What the model misses",
    Verdict.BAD_DATA: "What is wrong with the data",
}

_ALIKE = 3
"""Maximum number of laws listed that predict as well in place of a cause."""


def diagnosis(answer: Answer, tables: Tables) -> Section | None:
    """The causes, their gain, what to measure next, and effects that may be present unnoticed."""
    found = answer.diagnosis
    shared = _shared_gains(found.causes)
    several = sum(one.evidence is None and one.gain is not None for one in found.causes) > 1
    it = "it in the model beside the other causes" if several else "it in the model"
    blocks: list[Block | None] = [Paragraph(found.why)]
    for place, one in enumerate(found.causes, 1):
        blocks += _cause(place, one, answer.axes, "" if one.gain in shared else it)
    blocks += [
        _alone(found.alone),
        *(Paragraph(said) for said in shared.values() if said),
        *figures(("motion", "laws", "evidence", "separability"), answer, tables),
        *to_measure(answer),
        not_found(found.not_found),
        *blind_spots(found.blind_spots),
    ]
    return section_of("diagnosis", _TITLES[found.verdict], blocks)


def _shared_gains(causes: Sequence[Cause]) -> dict[Gain, str]:
    """Gains that several causes have together, each with its sentences."""
    said = dict[Gain, str]()
    for gain in {one.gain: None for one in causes if one.gain is not None}:
        places = [place for place, one in enumerate(causes, 1) if one.gain == gain]
        first = causes[places[0] - 1]
        how = "corrected" if first.evidence else "in the model"
        if len(places) > 1:
            said[gain] = _gain_sentences(f"causes {listed(list(map(str, places)))} {how}", first)
    return said


def _cause(place: int, one: Cause, axes: Axes, gains: str) -> list[Block | None]:
    facts = [
        _evidence_sentences(one.evidence) if one.evidence else "",
        f"How it shows: {one.signature}." if one.signature else "",
        _probability_sentence(one),
        _unnamed_sentence(one.outside_catalogue, axes) if one.outside_catalogue else "",
        _size_sentence(one),
        _gain_sentences("it corrected" if one.evidence else gains, one) if gains else "",
        f"What would settle it: {one.needs}." if one.needs else "",
    ]
    return [
        Paragraph(f"Cause {place}: {words.placed(one)} ({label(one)}).", "finding"),
        Paragraph(" ".join(fact for fact in facts if fact)),
        _rivals(place, one.rivals),
    ]


def _alone(single: Sequence[Alone]) -> ReportTable | None:
    """Table of the likeliest causes, with the gain of each as the only one in the model."""
    columns: list[Cells[Alone]] = [
        word_column("Cause", words.placed),
        word_column("Name", label),
        number_column("Probability", lambda one: one.probability, probability),
        number_column("Cross-validation error falls by", lambda one: one.reduction, percent),
        word_column("95 % interval", lambda one: " to ".join(map(percent, one.ci95))),
    ]
    better = [one for one in single if one.reduction is None or one.reduction > 0]
    return table_of("alone", "Each cause by itself", columns, better)


def _unnamed_sentence(other: Unnamed, axes: Axes) -> str:
    """Probability that no known cause is present, and laws that predict equally well."""
    sentences = []
    if other.probability >= _WORTH_SAYING:
        chance = probability(other.probability)
        like = other.looks_like and at(other.looks_like, other.where, axes)
        looks = f"; it resembles {like}" if like else ""
        sentences.append(f"The probability that it is none of the known causes is {chance}{looks}.")
    if other.as_good:
        alike = listed([_as_good(one) for one in other.as_good[:_ALIKE]])
        sentences.append(
            f"Laws outside the catalogue that predict equally well in its place: {alike}."
        )
    return " ".join(sentences)


def _as_good(one: AsGood) -> str:
    low, high = map(percent, one.ci95)
    return (
        f"{words.placed(one)} (cross-validation error {percent(one.reduction)} less, {low} to "
        f"{high}; at {plain(one.times_typical, 2)} times the typical magnitude)"
    )


def _evidence_sentences(evidence: Evidence) -> str:
    """Evidence for a mistake in the data, and the correction used."""
    return " ".join(f"{capital(s)}." for s in (evidence.sentence, evidence.correction) if s)


def _probability_sentence(one: Cause) -> str:
    alone = f"; without it, such readings would occur by chance with {p_value(one.p_value)}"
    chance = probability(one.probability)
    known = "" if one.p_value is None else alone
    other = one.outside_catalogue
    if other and other.probability > _RATHER:
        return (
            f"That it, and nothing outside the catalogue, is there has a probability of {chance}"
            f"{known}. It may act beside what is missing, which no model here has."
        )
    return f"Its probability is {chance}{known}."


def _size_sentence(one: Cause) -> str:
    text = "; ".join(sizes(one))
    return f"{capital(text)}." if text else ""


def _gain_sentences(how: str, one: Cause) -> str:
    """Gain with a cause in the model, a mistake corrected, or several of them."""
    return (
        ""
        if one.gain is None
        else " ".join((*_error_falls(how, one.gain), *_test_pose_changes(one.gain)))
    )


def _error_falls(how: str, gain: Gain) -> Iterator[str]:
    """Relative decrease of the cross-validation error and its final value.

    If the relative decrease is unknown, the initial value is stated instead. The error of the joint
    springs that is stated with the verdict is weighted by their own noise; the relative decrease
    compares both models with the same weights, so that the two initial errors differ in the third
    digit.
    """
    before, after = gain.held_out_rms_before_mm, gain.held_out_rms_after_mm
    if before is None or after is None or after >= before:
        return
    of = " of the unloaded positions" if gain.of is Predicted.UNLOADED_POSITIONS else ""
    falls = f"from {plain(before)} mm" if gain.reduction is None else _share(gain)
    yield f"With {how} the cross-validation error{of} falls {falls} to {plain(after)} mm."


def _share(gain: Gain) -> str:
    """Relative decrease of the error, with its 95 % interval if that is known."""
    low, high = gain.ci95 or (None, None)
    sure = "" if low is None else f" (95 % interval {percent(low)} to {percent(high)})"
    return f"by {percent(gain.reduction)}{sure}"


def _test_pose_changes(gain: Gain) -> Iterator[str]:
    change = gain.test_pose_change_mm
    if change is not None:
        moved = "The vector of the predicted deflection at the test pose changes by"
        yield f"{moved} {plain(change)} mm."


def _rivals(place: int, rivals: Sequence[Rival]) -> ReportTable | None:
    columns: list[Cells[Rival]] = [
        word_column("Alternative", words.placed),
        word_column("Name", label),
        number_column("Probability", lambda one: one.probability, probability),
    ]
    return table_of(f"rivals-{place}", f"Alternatives to cause {place}", columns, rivals)
