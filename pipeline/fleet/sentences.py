"""Wear of robots in words and tables: what needs action first, and each joint with its interval."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from urllib.parse import quote

from pipeline.answer.contract import Answer
from pipeline.base.errors import listed
from pipeline.base.quantities import MISSING, bracketed, p_value, plain, with_std
from pipeline.fleet.trends import trends, within_a_day
from pipeline.fleet.wear_table import JointWear, RobotWear
from pipeline.report import words
from pipeline.report.record import (
    Cells,
    Column,
    ReportTable,
    TableEntry,
    entry,
    measured_column,
    number_column,
    table_of,
    word_column,
)

_AS_ONE = 3
"""Minimum number of joints that change alike, if they are all joints, to suspect the scale."""


def fleet_sentences(answer: Answer, wear: Sequence[RobotWear]) -> str | None:
    """What a campaign's page states about all campaigns of its robot.

    None if they are too few, so that the page compares with the previous one; empty if there is no
    alarm, or if a later campaign states it.
    """
    own = of(answer.machine, wear)
    if own is None or not own.followed:
        return None
    return alarm(own) if own.alarm and own.campaign == answer.campaign else ""


def of(machine: str, wear: Sequence[RobotWear]) -> RobotWear | None:
    """The robot of this name; None if there is none."""
    return next((one for one in wear if one.machine == machine), None)


def changed_of(answers: Sequence[Answer], wear: RobotWear | None) -> list[str]:
    """Names of the stiffnesses of one robot that have changed.

    Wear is estimated from day to day; differences between campaigns of one day are tested as by
    `compare`.
    """
    if wear is not None and wear.followed:
        worn = [joint.name for joint in wear.changed]
        return list(dict.fromkeys([*worn, *within_a_day(answers)]))
    return [trend.name for trend in trends(answers) if trend.sure]


def alarm(robot: RobotWear) -> str:
    """The alarm of a robot in one sentence, without the robot's name."""
    if robot.alarm is None:
        return ""
    how = _step(robot) if robot.alarm.kind == "step" else _trend(robot)
    return f"{how}{_standing(robot)}."


def _trend(robot: RobotWear) -> str:
    changed = [one for one in robot.changed if one.percent_a_year is not None]
    if not changed:
        return "The stiffnesses have changed together, more than chance explains"
    names = listed([one.called for one in changed], len(changed))
    sizes = ", ".join(bracketed(abs(one.percent_a_year or 0.0), one.std) for one in changed)
    grows = "grows" if len(changed) == 1 else "grow"
    scale = ""
    if len(changed) >= _AS_ONE and len(changed) == len(robot.joints):
        scale = "; all joints alike may be the scale: have it checked first"
    return (
        f"{names} {grows} {_which_way(changed)} by {sizes} % a year, more than chance explains"
        f"{scale}"
    )


def _which_way(changed: Sequence[JointWear]) -> str:
    ways = {(one.percent_a_year or 0.0) < 0 for one in changed}
    return "softer or stiffer" if len(ways) > 1 else "softer" if ways == {True} else "stiffer"


def _step(robot: RobotWear) -> str:
    assert robot.alarm is not None
    changed = [one.called for one in robot.changed]
    who = listed(changed, len(changed)) if changed else "the stiffnesses"
    return (
        f"{who[0].upper() if not changed else who[0]}{who[1:]} changed at once after campaign "
        f"{robot.alarm.after}, more than chance explains; a repair belongs into "
        f"[[robot_unit.history]] of campaign.toml, anything else needs a look at the joint"
    )


def _standing(robot: RobotWear) -> str:
    assert robot.alarm is not None
    if robot.alarm.confirmed:
        return f" (since campaign {robot.alarm.raised})"
    return (
        f" (raised by campaign {robot.alarm.raised}; later ones do not confirm it: measure again)"
    )


# --- all robots ------------------------------------------------------------------------------


def robots_tables(
    wear: Sequence[RobotWear],
    places: Mapping[str, int],
    last: Mapping[str, Answer],
    changed: Mapping[str, Sequence[str]],
) -> list[ReportTable | None]:
    """One table for each type of robot, those that need action first.

    Args:
        wear: All robots.
        places: Number of each robot's section on the page, by machine.
        last: The newest answer of each, whether or not it counts.
        changed: Joints of each that have changed, as displayed.
    """
    types = dict.fromkeys(one.robot for one in wear)
    return [
        _of_type(robot, [one for one in wear if one.robot == robot], places, last, changed)
        for robot in types
    ]


def _of_type(
    robot: str,
    own: Sequence[RobotWear],
    places: Mapping[str, int],
    last: Mapping[str, Answer],
    changed: Mapping[str, Sequence[str]],
) -> ReportTable | None:
    def urgency(one: RobotWear) -> int:
        return _urgency(one, changed.get(one.machine, ()))

    columns: list[Cells[RobotWear]] = [
        (Column("Robot"), lambda one: _section(one, places)),
        (Column("To do"), lambda one: TableEntry(_to_do(one, changed), float(urgency(one)))),
        word_column("Alarm since", lambda one: one.alarm and one.alarm.raised),
        (Column("Last campaign"), lambda one: _page(one.campaign)),
        word_column("Measured", lambda one: one.last.isoformat()),
        word_column("Verdict of the newest", lambda one: _verdict(last.get(one.machine))),
        *(_a_joint(k, joint.axis or joint.name) for k, joint in enumerate(own[0].joints)),
        number_column("Chance of such change", lambda one: one.p_value, chance_told),
    ]
    ranked = sorted(own, key=lambda one: (urgency(one), one.p_value or 1.0, one.machine))
    note = (
        "E1, A1: change of the stiffness in percent a year ± standard uncertainty; negative is "
        "softer, "
        "* what the alarm is about; intervals stand with each robot below. All joints are tested "
        "together at each campaign, with a false alarm in a hundred years of a robot at most."
    )
    return table_of(f"robots-{robot}", f"Robots of type {robot}", columns, ranked, note)


def _a_joint(k: int, name: str) -> Cells[RobotWear]:
    def cell(one: RobotWear) -> TableEntry:
        joint = one.joints[k]
        text = with_std(joint.percent_a_year, joint.std) if one.followed else MISSING
        mark = " *" if joint.changed else ""
        return TableEntry(f"{text}{mark}", joint.percent_a_year if one.followed else None)

    return Column(f"{name} [%/year]", numeric=True), cell


def _section(one: RobotWear, places: Mapping[str, int]) -> TableEntry:
    place = places.get(one.machine)
    link = "" if place is None else f"#robot-{place}"
    return TableEntry(one.serial or one.robot, one.machine, link)


def _page(campaign: str) -> TableEntry:
    return TableEntry(campaign, campaign, f"{quote(campaign)}/index.html")


def _verdict(answer: Answer | None) -> str:
    return "" if answer is None else words.VERDICTS[answer.diagnosis.verdict][0]


def chance_told(p: float | None) -> str:
    """`p = 0.33`; a dash without a test."""
    return MISSING if p is None else p_value(p)


def _urgency(one: RobotWear, changed: Sequence[str]) -> int:
    """Rank of the action needed, 0 first."""
    if one.alarm is not None:
        return 0 if one.alarm.confirmed else 1
    if changed:
        return 1
    return 3 if one.followed else 2


def _to_do(one: RobotWear, changed: Mapping[str, Sequence[str]]) -> str:
    if one.alarm is None:
        if names := changed.get(one.machine):
            return f"see what happened to {', '.join(names)} between two campaigns"
        return "nothing" if one.followed else "measure: too few days"
    names = ", ".join(joint.axis or joint.name for joint in one.changed) or "all joints"
    return f"inspect {names}" if one.alarm.confirmed else f"measure again: {names}"


# --- one robot -------------------------------------------------------------------------------


def joints_table(place: int, robot: RobotWear) -> ReportTable | None:
    """Wear of each joint of one robot."""
    columns: list[Cells[JointWear]] = [
        word_column("Joint", lambda joint: joint.called),
        measured_column("Change of stiffness [%/year]", lambda j: (j.percent_a_year, j.std)),
        (Column("95 % interval [%/year]", numeric=True), _interval),
        measured_column("Given its type [%/year]", lambda j: (j.expected, j.expected_std)),
        number_column("Day-to-day scatter [%]", lambda j: j.scatter, lambda s: plain(s, 2)),
        word_column("Result", lambda joint: "changed" if joint.changed else "holds"),
    ]
    note = (
        f"From {robot.campaigns} campaigns; chance of so much change in all joints together: "
        f"{chance_told(robot.p_value)}. Given its type: with what the {robot.robots} "
        f"{'robot' if robot.robots == 1 else 'robots'} of the type say of it. Scatter: what a "
        f"stiffness differs by from day to day beyond its uncertainty. An error that all campaigns "
        f"share, such as the scale's gain, cancels here and is not seen."
    )
    title = f"Wear of each joint of {robot.serial or robot.robot}"
    return table_of(f"wear-{place}", title, columns, robot.joints, note)


def _interval(joint: JointWear) -> TableEntry:
    if joint.low is None or joint.high is None:
        return entry(MISSING)
    return entry(f"{plain(joint.low, 2)} to {plain(joint.high, 2)}", joint.low)
