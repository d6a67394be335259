"""Section on joint stiffnesses, changes since the previous campaign, and the fit of the model."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from pipeline.annex.words import springs_alone
from pipeline.answer.contract import (
    Answer,
    Believed,
    Combination,
    Fit,
    Known,
    Odd,
    Remark,
    SpringBy,
    Stiffness,
    Weighed,
)
from pipeline.answer.remarks import sentence
from pipeline.answer.words import capital
from pipeline.base import doors
from pipeline.base.quantities import (
    MISSING,
    bracketed,
    common_prefix,
    interval,
    p_value,
    plain,
    prefixed,
    probability,
    scaled,
    with_std,
)
from pipeline.report import words
from pipeline.report.figures.catalogue import figures
from pipeline.report.record import (
    Cells,
    Column,
    Paragraph,
    ReportTable,
    Section,
    TableEntry,
    entry,
    measured_column,
    number_column,
    roughly,
    section_of,
    table_of,
    text_entry,
    word_column,
)

_SINCE = "pipeline.fleet.history:since"
"""Door of the fleet: changes since the previous campaign."""

_Change = Any
"""One stiffness in two campaigns, as the fleet compares them."""


def stiffness(answer: Answer, previous: Answer | None, wear: str | None = None) -> Section | None:
    """The tables of stiffnesses with their findings.

    If all campaigns together show what has changed (`wear`), a change since the previous campaign
    is not a finding unless both are of one day: the scatter from day to day exceeds the uncertainty
    of one campaign.
    """
    known, before = doors.found(_SINCE), previous.campaign if previous else ""
    since, same_day = known(previous, answer) if known else ([], False)
    told = wear is None or same_day
    called = {joint.name: joint.called for joint in answer.stiffness}
    return section_of(
        "stiffness",
        "Joint stiffnesses",
        [
            *(Paragraph(finding, "finding") for finding in _findings(answer)),
            *(_changed(change, before, called) for change in since if change.sure and told),
            _stiffness_table(answer, since, before),
            _combinations_table(answer.combinations),
            _springs_by(answer),
            _hypotheses_table(answer.recommended.hypotheses),
            *figures(("stiffness",), answer, {}),
            _compliance_table(answer.stiffness),
            _fit_text(answer.fit),
        ],
    )


def _springs_by(answer: Answer) -> ReportTable | None:
    """Compliances estimated from the arm's weight and from the pulls, if both were measured."""
    both = answer.springs_by
    if both is None:
        return None
    columns: list[Cells[SpringBy]] = [
        word_column("Joint", lambda one: answer.called(one.name)),
        measured_column("By the arm's weight [nrad/(N m), nm/N]", lambda one: _nano(one.by_weight)),
        measured_column("By the pulls [nrad/(N m), nm/N]", lambda one: _nano(one.by_pulls)),
    ]
    note = (
        f"Chi-square of the difference {plain(both.chi2, 3)}, {both.dof} degrees of freedom, "
        f"{p_value(both.p_value)}."
    )
    return table_of("springs_by", "Compliances by weight and by pulls", columns, both.each, note)


def _nano(one: Known | None) -> tuple[float | None, float | None]:
    return (None, None) if one is None else (1e9 * one.value, 1e9 * one.std)


def _findings(answer: Answer) -> Iterator[str]:
    """Findings to act on: those of the whole campaign first, then those of single stiffnesses."""
    own = {joint.finding for joint in answer.stiffness}
    yield from dict.fromkeys(one for one in answer.findings if one not in own)
    yield from remark_sentences(answer.stiffness)
    for joint in answer.stiffness:
        if joint.finding and not joint.remarks:  # written by a version that had the sentence only
            yield joint.finding


def _changed(change: _Change, campaign: str, called: Mapping[str, str]) -> Paragraph:
    return Paragraph(
        f"{called[change.name]} changed by "
        f"{bracketed(change.percent, change.percent_std)} % "
        f"since {campaign}, more than chance explains.",
        "finding",
    )


def _stiffness_table(answer: Answer, since: Sequence[_Change], before: str) -> ReportTable | None:
    factor, letter = common_prefix(joint.value for joint in answer.stiffness)
    columns = [
        *_axis_columns(answer.stiffness),
        *_value_columns(factor, letter),
        *_each_way_columns(answer.stiffness, factor),
        *_nominal_columns(answer.stiffness, factor),
        *_beside_columns(answer, factor),
        *_change_columns(since, before),
    ]
    note = (
        "Stiffness is one over the estimated compliance; its interval is that of the compliance, "
        "inverted, and therefore not symmetric."
    )
    if any(joint.by_sign for joint in answer.stiffness):
        note += _EACH_WAY
    title = f"Stiffness of each joint, {words.values_of(answer)}"
    return table_of("stiffness", title, columns, answer.stiffness, note)


_EACH_WAY = (
    " A joint with a direction-dependent stiffness has both, by the way in which the load "
    "turns the controller's axis (the joint itself where the robot file has no axis); its "
    "stiffness is that of the test pose."
)
"""Note on the columns with a stiffness for each sign of the torque."""

_JOINT: Cells[Stiffness] = (Column("Joint"), lambda j: text_entry(j.name, sort=j.joint))


def _axis_columns(joints: Sequence[Stiffness]) -> list[Cells[Stiffness]]:
    """Column of the controller's axes; none if the robot file maps none."""
    if all(joint.axis is None for joint in joints):
        return []
    return [word_column("Axis", lambda joint: joint.axis)]


def _value_columns(factor: float, letter: str) -> list[Cells[Stiffness]]:
    return [
        _JOINT,
        (Column("Stiffness ± standard uncertainty", numeric=True), lambda j: _value(j, factor)),
        (Column("95 % interval", numeric=True), lambda joint: _interval(joint, factor)),
        word_column("Unit", lambda joint: prefixed(joint.unit, letter)),
        number_column("Relative uncertainty [%]", lambda j: scaled(j.relative_std, 0.01), roughly),
    ]


def _value(joint: Stiffness, factor: float) -> TableEntry:
    if not joint.identifiable:
        return TableEntry("not determined")
    value = scaled(joint.value, factor)
    return entry(with_std(value, scaled(joint.std, factor)), value)


def _interval(joint: Stiffness, factor: float) -> TableEntry:
    if not joint.identifiable:
        return TableEntry(MISSING)
    low, high = (scaled(bound, factor) for bound in joint.ci95)
    return entry(interval((low, high), scaled(joint.std, factor)), low)


def _each_way_columns(joints: Sequence[Stiffness], factor: float) -> list[Cells[Stiffness]]:
    """Columns for joints with a stiffness for each sign of the torque; none without such joints."""
    if all(joint.by_sign is None for joint in joints):
        return []
    return [
        (Column(f"Turned towards {way}", numeric=True), partial(_one_way, way=way, factor=factor))
        for way in ("plus", "minus")
    ]


def _one_way(joint: Stiffness, way: str, factor: float) -> TableEntry:
    """Stiffness under a torque that turns the controller's axis towards `way`.

    If the robot file maps no axis, the joint itself is meant.
    """
    both = joint.by_sign
    if both is None:
        return TableEntry(MISSING)
    against = both.positive.axis_turns == "minus"
    one = both.positive if (way == "plus") != against else both.negative
    value = scaled(one.value, factor)
    return entry(with_std(value, scaled(one.std, factor)), value)


def _nominal_columns(joints: Sequence[Stiffness], factor: float) -> list[Cells[Stiffness]]:
    """Columns of the nominal stiffness and the ratio to it; none if the robot file states none."""
    if all(joint.nominal is None for joint in joints):
        return []
    return [
        number_column("Nominal", lambda joint: joint.nominal, lambda k: plain(scaled(k, factor))),
        measured_column("Of nominal [%]", _of_nominal),
    ]


def _of_nominal(joint: Stiffness) -> tuple[float | None, float | None]:
    if not joint.nominal:
        return None, None
    return scaled(joint.value, joint.nominal / 100), scaled(joint.std, joint.nominal / 100)


def _beside_columns(answer: Answer, factor: float) -> list[Cells[Stiffness]]:
    """Column of joint springs on the data as given; none if the answer gives the same."""
    other = springs_alone(answer)
    if other is None:
        return []
    name, springs = other
    own = {j.name: (scaled(j.value, factor), scaled(j.std, factor)) for j in springs.stiffness}
    return [measured_column(capital(name), lambda joint: own.get(joint.name, (None, None)))]


def _change_columns(since: Sequence[_Change], before: str) -> list[Cells[Stiffness]]:
    own = {change.name: (change.percent, change.percent_std) for change in since}
    title = f"Change since {before} [%]"
    return [measured_column(title, lambda joint: own.get(joint.name, (None, None)))] if own else []


def _combinations_table(combinations: Sequence[Combination]) -> ReportTable | None:
    """Table of the combinations of compliances that are determined where single ones are not."""
    columns: list[Cells[Combination]] = [
        word_column("Combination of compliances", lambda one: one.formula),
        measured_column("Value ± standard uncertainty", lambda one: (one.value, one.std)),
        (Column("95 % interval", numeric=True), _ends),
        word_column("Unit", lambda one: prefixed(one.unit, "")),
        word_column("What would separate them best", lambda one: one.needs),
    ]
    note = (
        "The joints of a row act as one in the poses measured: c is the compliance of a joint, and "
        "only this sum of them is known, whatever each of them is."
    )
    title = "Combinations of compliances that are determined"
    return table_of("combinations", title, columns, combinations, note)


def _ends(one: Combination) -> TableEntry:
    low, high = one.ci95
    return entry(f"{plain(low)} to {plain(high)}", low)


def _hypotheses_table(hypotheses: Sequence[Weighed]) -> ReportTable | None:
    """Table of the hypotheses over which the values are averaged; None for a single model."""
    columns: list[Cells[Weighed]] = [
        word_column(
            "Beside the joint springs", lambda one: " and ".join(map(_believed, one.causes))
        ),
        number_column("Weight", lambda one: one.weight, probability),
    ]
    several = hypotheses if len(hypotheses) > 1 else ()
    return table_of("hypotheses", "What the values are averaged over", columns, several)


def _believed(cause: Believed) -> str:
    name = words.placed(cause) + (f" ({cause.form})" if cause.form else "")
    return name if cause.in_catalogue else f"an effect outside the catalogue that resembles {name}"


def _compliance_table(joints: Sequence[Stiffness]) -> ReportTable | None:
    columns: list[Cells[Stiffness]] = [
        *_axis_columns(joints),
        _JOINT,
        measured_column(
            "Compliance ± standard uncertainty", lambda j: (j.compliance, j.compliance_std)
        ),
        word_column("Unit", lambda joint: prefixed(joint.compliance_unit, "")),
    ]
    shown = joints if any(joint.compliance is not None for joint in joints) else ()
    return table_of("compliance", "Compliances, as estimated", columns, shown)


def _fit_text(fit: Fit) -> Paragraph:
    tested = (
        f" Weighted by the noise, chi² is {plain(fit.chi2, 4)} for {fit.dof} degrees of freedom "
        f"({p_value(fit.p_value)})."
    )
    return Paragraph(
        f"The fit leaves {plain(fit.rms_mm)} mm rms per coordinate."
        f"{'' if fit.p_value is None else tested} {fit.noise_statement} The residual standard "
        f"deviation is {plain(fit.residual_std_mm)} mm."
    )


def remark_sentences(joints: Iterable[Stiffness]) -> list[str]:
    """Remarks on several stiffnesses; one that applies to several alike is made once.

    Remarks on joints that are determined together are left to `check.findings`.
    """
    alike: dict[Any, tuple[Remark, list[Stiffness]]] = {}
    for joint in joints:
        for remark in joint.remarks:
            if remark.odd is Odd.TOGETHER:
                continue
            alike.setdefault((remark, _own(remark, joint)), (remark, []))[1].append(joint)
    return [sentence(remark, those) for remark, those in alike.values()]


def _own(remark: Remark, joint: Stiffness) -> object:
    """Key of what a sentence depends on besides the name: number or type of the joint, or None."""
    if remark.cause is not None:
        return None
    return joint.joint_type if remark.odd in (Odd.MIXED, Odd.NO_LEVER) else joint.joint
