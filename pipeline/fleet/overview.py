"""Pages over several campaigns: the overview of all of them, and the comparison of two."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING
from urllib.parse import quote

from pipeline.answer.contract import Answer, Cause, Stiffness
from pipeline.base.arrays import Array
from pipeline.base.quantities import (
    common_prefix,
    p_value,
    plain,
    prefixed,
    scaled,
)
from pipeline.diagnosis.average import POSSIBLE
from pipeline.fleet.history import NO_SCATTER, Change, changes, ordered, trusted
from pipeline.fleet.sentences import alarm, chance_told, changed_of, joints_table, of, robots_tables
from pipeline.fleet.trends import Trend, chance, robots, together, trends, within_a_day
from pipeline.fleet.wear_table import RobotWear
from pipeline.report import words
from pipeline.report.record import (
    Block,
    Cells,
    Column,
    Figure,
    Paragraph,
    Report,
    ReportTable,
    Section,
    TableEntry,
    measured_column,
    number_column,
    present,
    roughly,
    section_of,
    table_of,
    unlabelled,
    word_column,
)
from pipeline.report.render import page

if TYPE_CHECKING:
    from pipeline.report.svg import Drawing

# --- all campaigns -------------------------------------------------------------------------


def overview(answers: Sequence[Answer], wear: Sequence[RobotWear] = ()) -> Report:
    """The page over all campaigns: what needs action, their verdicts, each stiffness over time.

    Args:
        answers: Answers of all finished campaigns.
        wear: Every robot over its campaigns; for one that is not followed, campaigns are compared.
    """
    by_robot = robots(answers)
    followed = {one.machine: one for one in wear if one.followed}
    unsaid = {name: _unsaid(own, followed.get(name)) for name, own in by_robot.items()}
    counts = _standing_in_a_hall(by_robot)
    last = {name: own[-1] for name, own in by_robot.items()}
    tables = robots_tables(wear, {name: k for k, name in enumerate(by_robot)}, last, unsaid)
    sections = [
        section_of("robots", "Robots", tables if followed else []),
        section_of("campaigns", "Campaigns", [_campaigns(ordered(answers))]),
        *_sections(by_robot, followed),
    ]
    raised = [*_raised(followed, counts)]
    compared = {name: unsaid[name] for name in counts}
    several = _several(counts)
    verdict, tone = _of_all(bool(raised) or any(compared.values()), several)
    virtual = sum(one.simulated for one in answers)
    return Report(
        kicker="Joint stiffness",
        heading="All campaigns",
        title="Joint stiffness: all campaigns",
        verdict=verdict,
        tone=tone,
        first=unlabelled(
            f"{_counted(len(answers), 'campaign')} on {_counted(len(by_robot), 'robot')}"
            f"{_virtual(virtual, len(answers))}.",
            *raised,
            *_change_sentences(compared, several, bool(raised)),
            *_not_compared(by_robot),
        ),
        sections=present(sections),
        elsewhere="Details are on the page of each campaign.",
    )


def _sections(
    by_robot: Mapping[str, Sequence[Answer]], followed: Mapping[str, RobotWear]
) -> Iterator[Section | None]:
    """Yield one section per robot."""
    for place, (name, own) in enumerate(by_robot.items()):
        yield section_of(f"robot-{place}", name, _robot(place, name, own, followed.get(name)))


def _raised(followed: Mapping[str, RobotWear], counts: Container[str]) -> Iterator[str]:
    """Alarms of the robots in `counts`."""
    for name, one in followed.items():
        if one.alarm and name in counts:
            yield f"{name}: {alarm(one)}"


def _unsaid(own: Sequence[Answer], followed: RobotWear | None) -> list[str]:
    """Joints of a robot that changed between two campaigns and are not covered by an alarm."""
    called = _called(own)
    alarmed = [joint.called for joint in followed.changed] if followed else []
    changed = (called.get(one, one) for one in changed_of(own, followed))
    return [one for one in changed if one not in alarmed]


def _standing_in_a_hall(
    by_robot: Mapping[str, Sequence[Answer]],
) -> Mapping[str, Sequence[Answer]]:
    """The real robots; if there are none, the simulated ones."""
    real = {name: own for name, own in by_robot.items() if not own[0].simulated}
    return real or by_robot


def _virtual(simulated: int, of: int) -> str:
    if not simulated:
        return ""
    if simulated == of:
        return ", all simulated"
    return f", {simulated} of them simulated and kept apart from what was measured"


def _of_all(changed: bool, several: bool) -> tuple[str, str]:
    """Verdict on all campaigns, and its tone."""
    if changed:
        return "A stiffness has changed", "attention"
    if several:
        return "No stiffness has changed", "good"
    return "Nothing to compare yet", "neutral"


def _several(by_robot: Mapping[str, Sequence[Answer]]) -> bool:
    """Whether any robot has two campaigns that can be compared."""
    return any(sum(map(trusted, own)) > 1 for own in by_robot.values())


def _counted(number: int, noun: str) -> str:
    return f"1 {noun}" if number == 1 else f"{number} {noun}s"


def _change_sentences(changed: Mapping[str, list[str]], several: bool, alarms: bool) -> list[str]:
    """Sentences on what changed, by robot, or that nothing did; empty if alarms say it."""
    if any(changed.values()):
        return [
            f"{robot}: {', '.join(names)} changed by more than chance explains; "
            f"look at the history below before relying on an older model."
            for robot, names in changed.items()
            if names
        ]
    if alarms:
        return []
    if several:
        return ["Between campaigns of one robot every stiffness agrees within its uncertainty."]
    return ["A robot's second campaign will show here whether its stiffnesses hold."]


def _not_compared(by_robot: Mapping[str, Sequence[Answer]]) -> list[str]:
    out = [one.campaign for own in by_robot.values() for one in own if not trusted(one)]
    if not out:
        return []
    return [f"Not compared, because no model explains their readings: {', '.join(out)}."]


def _campaigns(answers: Sequence[Answer]) -> ReportTable | None:
    columns: list[Cells[Answer]] = [
        (Column("Campaign"), _linked),
        word_column("Robot", lambda one: one.machine),
        word_column("Measured", lambda one: one.measured and one.measured[:10]),
        word_column("Verdict", lambda one: words.VERDICTS[one.diagnosis.verdict][0]),
        word_column("Identified causes", lambda one: ", ".join(map(_who, one.diagnosis.causes))),
        word_column("Model", words.values_of),
        number_column("Cross-validation error [mm]", _left_out_mm),
    ]
    return table_of("campaigns", "Every campaign with a result", columns, answers)


def _linked(answer: Answer) -> TableEntry:
    return TableEntry(answer.campaign, answer.campaign, f"{quote(answer.campaign)}/index.html")


def _left_out_mm(answer: Answer) -> float | None:
    return answer.validation.held_out_rms_mm if answer.validation else None


def _who(cause: Cause) -> str:
    """A cause, with its likely rivals."""
    rivals = [rival for rival in cause.rivals if rival.probability > POSSIBLE]
    return " or ".join(map(words.placed, (cause, *rivals)))


def _robot(
    place: int, name: str, answers: Sequence[Answer], wear: RobotWear | None
) -> Sequence[Block | None]:
    if wear is not None:
        says = [Paragraph(alarm(wear), "finding")] if wear.alarm else []
        names, called = changed_of(answers, wear), _called(answers)
        says += [
            Paragraph(
                f"{called[one]} differs between campaigns of one day, for certain.", "finding"
            )
            for one in within_a_day(answers)
        ]
        return (*says, joints_table(place, wear), _history_figure(place, name, answers, names))
    if len(answers) < 2:
        return (Paragraph(f"One campaign so far, {answers[0].campaign}."),)
    if sum(map(trusted, answers)) < 2:
        return (
            Paragraph("Fewer than two campaigns whose readings a model explains: no comparison."),
        )
    found, called = trends(answers), _called(answers)
    surely = [
        Paragraph(f"{called[t.name]} changed by more than chance explains.", "finding")
        for t in found
        if t.sure
    ]
    names = changed_of(answers, None)
    return (
        *surely,
        _trend_table(place, found, called),
        _history_figure(place, name, answers, names),
    )


def _called(answers: Sequence[Answer]) -> dict[str, str]:
    """`A1 (k_theta2)` by `k_theta2`, as named by the last campaign that has the joint."""
    return {joint.name: joint.called for one in answers for joint in one.stiffness}


def _trend_table(
    place: int, found: Sequence[Trend], called: Mapping[str, str]
) -> ReportTable | None:
    columns: list[Cells[Trend]] = [
        word_column("Joint", lambda t: called[t.name]),
        number_column("Campaigns", lambda t: t.campaigns, str),
        measured_column("First to last [%]", lambda t: (t.first_to_last, t.first_to_last_std)),
        number_column("Chance of such scatter", lambda t: t.p_value, chance_told),
        word_column("Result", _held),
    ]
    note = (
        "Tested on the compliances, whose errors are normal, at 1 % for all joints together; an "
        "error that all campaigns share, such as the scale's gain, cancels here and is not seen."
    )
    return table_of(f"trend-{place}", "Has a stiffness changed?", columns, found, note)


def _held(trend: Trend) -> str:
    if trend.campaigns < 2:
        return "one value"
    return "changed" if trend.sure else "holds"


def _history_figure(
    place: int, name: str, answers: Sequence[Answer], changed: Sequence[str]
) -> Figure:
    called = _called(answers)
    which = ", ".join(called.get(one, one) for one in changed)
    text = f"{len(answers)} campaigns of {name}. " + (
        f"Changed: {which} in another colour." if changed else "No joint stands out."
    )
    hollow = [one.campaign for one in answers if not trusted(one)]
    if hollow:
        text += f" Hollow and not compared: {', '.join(hollow)}."
    return Figure(
        f"history-{place}",
        "Each stiffness over the campaigns",
        f"{text} Bars are 95 % intervals; they should overlap as long as nothing changes.",
        f"One row per joint with the stiffness of each campaign and its interval. {text}",
    )


SAME_READINGS = (
    "Two models of the same readings share their errors, so what they differ by is no matter of "
    "chance: it is what the richer model takes away from the springs."
)
OF_TWO_KINDS = (
    "Stiffnesses from the arm's own weight are as wrong as the masses of the robot file, those "
    "from pulls as the scale: what they differ by is no change of the machine."
)
NOT_EXPLAINED = (
    "No model explains the readings of {}, so its uncertainties cannot tell whether a stiffness "
    "has changed."
)
NOT_STOOD_FOR = (
    "The answer does not stand for {}, so its uncertainties cannot tell whether a stiffness has "
    "changed: what its model leaves out may look like a change."
)
"""Reasons why two lists of stiffnesses are shown side by side without a test."""
_DAILY = (
    "The robot's campaigns tell what its stiffnesses differ by from day to day; that much counts "
    "as no difference, as in its wear."
)
_OTHER_ROBOTS = "They are of different robots, {} and {}: what differs is no change of one."


# --- comparison of two ----------------------------------------------------------------------


def comparison(
    names: tuple[str, str],
    before: Sequence[Stiffness],
    after: Sequence[Stiffness],
    covariances: tuple[Array, Array] | None,
    not_tested: str = SAME_READINGS,
    models: tuple[str, str] = ("", ""),
    robots: tuple[str, str] = ("", ""),
    scatter: Mapping[str, float] = NO_SCATTER,
) -> Report:
    """Compare two campaigns, or two models of one, joint by joint.

    Args:
        names: Their names.
        before: Stiffnesses of the first.
        after: Stiffnesses of the second.
        covariances: Covariances of their compliances if they are independent; None, as for two
            models of one campaign, if nothing is to be tested.
        not_tested: Why nothing is tested, if so.
        models: Model of the values of each, in words.
        robots: Robots of the two, if they differ.
        scatter: Day-to-day scatter of the robot's stiffnesses [1], by name, if known and the two
            are of different days.
    """
    found = changes(before, after, covariances is not None, scatter)
    called = {joint.name: joint.called for joint in after}
    surely = [called[c.name] for c in found if c.sure]
    verdict, tone, told = ("Not tested", "neutral", not_tested)
    if covariances is not None:
        verdict, tone, told = _differ(surely)
    apart = [_OTHER_ROBOTS.format(*robots)] if robots[0] != robots[1] else []
    daily = [_DAILY] if scatter and covariances is not None else []
    sentences = (told, *apart, *daily, *_together(before, after, covariances))
    title = f"{names[0]} beside {names[1]}"
    each = zip(names, models, strict=True)
    titles = [f"{name}: {model}" if model else name for name, model in each]
    table = _comparison_table(titles, before, found, called)
    return Report(
        kicker="Joint stiffness compared",
        heading=title,
        title=f"Joint stiffness: {title}",
        verdict=verdict,
        tone=tone,
        first=unlabelled(*(sentences if found else ("They have no joint in common.",))),
        sections=present([section_of("joints", "Joint by joint", [table])]),
    )


def _differ(surely: Sequence[str]) -> tuple[str, str, str]:
    """Verdict, tone and sentence on the joints that differ with certainty."""
    if not surely:
        return "They agree", "good", "No stiffness differs by more than chance explains."
    differ = "differs" if len(surely) == 1 else "differ"
    text = f"{', '.join(surely)} {differ} by more than chance explains."
    return "They differ", "attention", text


def _together(
    before: Sequence[Stiffness], after: Sequence[Stiffness], covariances: tuple[Array, Array] | None
) -> Iterator[str]:
    """Test of all joints together, if both have the same joints."""
    if covariances is None or [j.name for j in before] != [j.name for j in after]:
        return
    chi2, dof = together(before, after, *covariances)
    p = chance(chi2, dof)
    if p is not None:
        yield (
            f"All joints together, correlations included: chi² {plain(chi2)} for {dof} "
            f"({p_value(p)})."
        )


def _comparison_table(
    names: Sequence[str],
    before: Sequence[Stiffness],
    found: Sequence[Change],
    called: Mapping[str, str],
) -> ReportTable | None:
    factor, letter = common_prefix(change.before for change in found)
    units = {joint.name: prefixed(joint.unit, letter) for joint in before}

    def in_prefix(value: float | None) -> str:
        return plain(scaled(value, factor), 4)

    columns: list[Cells[Change]] = [
        word_column("Joint", lambda change: called.get(change.name, change.name)),
        number_column(names[0], lambda change: change.before, in_prefix),
        number_column(names[1], lambda change: change.after, in_prefix),
        word_column("Unit", lambda change: units[change.name]),
        measured_column("Change [%]", lambda change: (change.percent, change.percent_std)),
        number_column("Difference of compliance [σ]", lambda change: change.sigmas, roughly),
        word_column("Result", _judged),
    ]
    note = _TESTED if any(change.sigmas is not None for change in found) else ""
    return table_of("comparison", "Stiffness of each joint", columns, found, note)


_TESTED = "Tested on the compliances, whose errors are normal, at 1 % for all joints together."


def _judged(change: Change) -> str:
    if change.sigmas is None:
        return ""
    return "differs" if change.sure else "agrees"


def render_overview(answers: Sequence[Answer], wear: Sequence[RobotWear] = ()) -> bytes:
    """The page over all campaigns as HTML, from their answers and the wear of their robots."""
    report = overview(answers, wear)
    drawings = {figure.name: _draw_robot(figure.name, answers, wear) for figure in report.figures}
    return page(report, {name: drawing.inline for name, drawing in drawings.items()}).encode()


def _draw_robot(name: str, answers: Sequence[Answer], wear: Sequence[RobotWear] = ()) -> Drawing:
    """Draw the history of one robot: `history-0` is that of the first of `robots`."""
    # importing matplotlib takes half a second
    from pipeline.fleet.course import draw_history
    from pipeline.report.svg import drawn

    machine, own = list(robots(answers).items())[int(name.rpartition("-")[2])]
    changed = changed_of(own, of(machine, wear))
    return drawn(name, lambda canvas: draw_history(canvas, own, changed))
