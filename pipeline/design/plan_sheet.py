"""The measurement sheet: what the operator sets up, drives to, pulls and writes down, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import itemgetter

import numpy as np

from pipeline.annex.words import Axes, axes_of, from_twins, size
from pipeline.answer.contract import LEAST_CONTROLLED
from pipeline.answer.words import capital
from pipeline.base.arrays import Array
from pipeline.base.quantities import MM, percent, plain
from pipeline.design.control import Control
from pipeline.design.curves import ByAnchor, BySize
from pipeline.design.discriminate import Detectability
from pipeline.design.finished import cell_lines, worth_unpulled
from pipeline.design.information import station
from pipeline.design.measurement import Measurement
from pipeline.design.problem import Problem, with_steps
from pipeline.design.propose import BoundedPlan
from pipeline.design.pull import branches
from pipeline.design.schedule import pulls_at
from pipeline.machine.cell import paper_cell, predict
from pipeline.machine.robot import Joint, Robot, axes
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
    entry,
    number_column,
    present,
    roughly,
    section_of,
    table_of,
    unlabelled,
    word_column,
)

_BEFORE = (
    "Fix the anchor, mount the effector, measure its points and put them into campaign.toml. Read "
    "the base reflectors before the first pose and after the last."
)
_AT_EACH = (
    "At every pose: read the reflectors unloaded, then tighten or slacken the chain to each step "
    "in the order given, and read the scale, the reflectors and both ends of the chain."
)
_AFTER = "Release the chain before the next pose and read the unloaded reflectors once more."


@dataclass(frozen=True, eq=False)
class SheetExtras:
    """Content in addition to the plan itself.

    Attributes:
        sights: Detectability of every cause.
        sizes: Best figures by number of poses and readings, where computed.
        anchors: Best figures by position of the anchor, where computed.
        controls: Control of the readings by each other, the least controlled first.
    """

    sights: list[Detectability]
    sizes: BySize | None = None
    anchors: ByAnchor | None = None
    controls: Sequence[Control] = ()


def sheet(proposal: BoundedPlan, extras: SheetExtras, seconds: float) -> Report:
    """The report of a plan.

    Args:
        proposal: The plan.
        extras: Content in addition to it.
        seconds: Duration of the search.
    """
    problem, measurement = proposal.problem, proposal.measurement
    name = problem.spec.name
    return Report(
        kicker=f"Measurement sheet · {problem.robot.name}",
        heading=name,
        title=f"Measurement sheet {name} for {problem.robot.name}",
        verdict=f"{problem.spec.plan.readings} readings in {len(measurement.q)} poses",
        tone="good" if proposal.certificate is not None else "attention",
        first=unlabelled(_worth(proposal), _visibility(extras.sights)),
        sections=present(
            [
                _setting_up(problem, measurement),
                _driving(problem, measurement),
                *_pulling(problem, measurement),
                _reading_only(proposal),
                _telling(proposal, extras),
                _seeing(extras.sights, axes_of(problem.robot)),
                _controlling(problem, extras.controls),
                _assumptions(problem),
                _annex(problem, measurement),
            ]
        ),
        run_time=f"{seconds:.1f} s",
        elsewhere=f"The same sheet is in sheet.html and sheet.pdf, to be filled in and read "
        f"back in sheet.xlsx, the numbers in design.json, the plan in data/plans/{name}.toml.",
    )


def _worth(proposal: BoundedPlan) -> str:
    """The figure of a plan and its certificate, in one sentence."""
    criterion, certificate = proposal.problem.criterion, proposal.certificate
    text = f"The {criterion.meaning} is {_figure(proposal, proposal.figure)}"
    if certificate is None:
        return f"{text}; the search was interrupted before any bound was known."
    bound = _figure(proposal, certificate.figure)
    pure = ""
    if proposal.mixed is not None:
        ratio = proposal.figure / proposal.plan.figure
        pure = (
            f", {plain(ratio, 3)} times that of the best plan found for this alone: the price of "
            f"the power to diagnose"
        )
    share = percent(certificate.figure / proposal.plan.figure, 4)
    whose = "this one" if proposal.mixed is None else "the best plan for this alone"
    return f"{text}{pure}. No plan can be below {bound}: {whose} is {share} efficient."


def _figure(proposal: BoundedPlan, value: float) -> str:
    in_m = proposal.problem.criterion.unit == "m"
    return f"{plain(MM * value, 4)} mm" if in_m else plain(value, 4)


def _visibility(sights: list[Detectability]) -> str:
    noticed = sum(sight.detected_from <= 1 for sight in sights)
    named = sum(sight.named_from <= 1 for sight in sights)
    return (
        f"Of {len(sights)} causes that the model may lack, each of its typical magnitude, it "
        f"would detect "
        f"{noticed} and name {named}."
    )


def _setting_up(problem: Problem, measurement: Measurement) -> Section | None:
    spec = problem.spec
    rows = [
        ("Robot", problem.robot.name),
        ("Anchor of the chain, F_b [m]", ", ".join(f"{x:.3f}" for x in measurement.anchor)),
        ("Load point, flange frame [m]", _point(spec.tool["load_point"])),
        *((f"Reflector {n}, flange frame [m]", _point(spec.tool[n])) for n in spec.targets),
        ("Tracker, F_b [m], as planned", _point(spec.noise.tracker_position_m)),
        ("Chain reflectors", "Pl1 near the effector, Pl2 near the anchor, both on the chain"),
    ]
    todo = [_BEFORE, _AT_EACH, *([_AFTER] if spec.noise.zero == "before_after" else [])]
    columns = [word_column("What", itemgetter(0)), word_column("Value", itemgetter(1))]
    table = table_of("setup", "Set-up", columns, rows)
    once = table_of(
        "once",
        "To write down once",
        [word_column("What", str), (Column("Value"), lambda _: TableEntry("_" * 24))],
        _ONCE,
    )
    return section_of("setup", "Set up", [*map(Paragraph, todo), table, once])


_ONCE = (
    "Date",
    "Operator",
    "Temperature of base and robot [degC], at the begin and at the end",
    "Weight that hangs at the load point all the time [kg]",
    "Serial numbers of robot, tracker and scale",
    "Standard uncertainty of the scale, by its certificate [N]",
)
"""Data that campaign.toml asks for and that cannot be recovered afterwards."""


def _point(at: tuple[float, float, float]) -> str:
    return ", ".join(f"{x:g}" for x in np.round(at, 4))


def _driving(problem: Problem, measurement: Measurement) -> Section | None:
    """The poses, in the axes of the controller."""
    robot, poses = problem.robot, range(len(measurement.q))
    at = station(problem.experiment, measurement.q, measurement.anchor)
    carriage: Cells[int] = word_column("Carriage", lambda k: _way(measurement.approach[k]))
    columns = [
        _POSE,
        *_shown(robot, measurement.q),
        *([carriage] if robot.prismatic[0] else []),
        _of_pose("Chain [m]", at.chain_m, 2),
        _of_pose("Flange z [m]", at.configuration.flange_origin[:, 2], 2),
    ]
    table = table_of("axes", "Axes, as the controller shows them", columns, poses)
    return section_of("poses", "Drive", [table])


def _shown(robot: Robot, q: Array) -> list[Cells[int]]:
    """A column for each axis of the controller, mm and degrees, of poses (m, n)."""
    mapped, values = axes.of(robot), axes.displayed(robot, q)
    units = ["mm" if slides else "deg" for slides in mapped.slides]
    each = zip(mapped.names, units, values.T, strict=True)
    return [_of_pose(f"{name} [{unit}]", column, 2) for name, unit, column in each]


def _annex(problem: Problem, measurement: Measurement) -> Section | None:
    """The same poses by the joints of the robot file, where these differ from the axes."""
    robot = problem.robot
    if not robot.controller:
        return None
    q = _in_degrees(robot, measurement.q)
    names = [f"{j.name} [{'m' if j.prismatic else 'deg'}]" for j in robot.joints]
    columns = [_POSE, *(_of_pose(n, own, 3) for n, own in zip(names, q.T, strict=True))]
    note = "In the robot file, result.json and plan; nobody has to type these at the controller."
    table = table_of("joint_values", "Joint values of the robot file", columns, range(len(q)), note)
    return section_of("annex", "Annex", [table])


_POSE: Cells[int] = number_column("Pose", lambda k: k + 1, str)


def _of_pose(title: str, values: Array, decimals: int) -> Cells[int]:
    """A column of numbers, one for each pose or pull."""
    return number_column(title, lambda k: float(values[k]), f"{{:.{decimals}f}}".format)


def _way(approach: float) -> str:
    return "r rising" if approach > 0 else "r falling"


def _in_degrees(robot: Robot, q: Array) -> Array:
    """Joint values [m] or [rad], shape (..., n), in [m] or [deg]."""
    return np.where(robot.prismatic, q, np.rad2deg(q))


def _pulling(problem: Problem, measurement: Measurement) -> list[Section | None]:
    moved = expected(problem, measurement)
    return [_pose(problem, measurement, pose, moved) for pose in range(len(measurement.q))]


def _pose(
    problem: Problem, measurement: Measurement, pose: int, moved: list[Array]
) -> Section | None:
    name = f"Pose {pose + 1}"
    figure = Figure(
        f"pose-{pose + 1}",
        f"{name} from the side and from above",
        f"{name} as it should look: chain from the effector to the anchor.",
        f"Line drawing of {name.lower()} from the side and from above, with rail, floor, arm, "
        f"reflectors, chain and anchor.",
        held=True,
    )
    drive = Paragraph(_drive_to(problem.robot, measurement, pose))
    log = _log(problem, pose, measurement.steps[pose], moved)
    back = _read_back(problem.robot, pose)
    return section_of(f"pose{pose + 1}", name, [drive, figure, back, log])


def _reading_only(proposal: BoundedPlan) -> Section | None:
    """Poses without a pull, one row each."""
    if (found := proposal.unpulled) is None:
        return None
    robot, first = proposal.problem.robot, len(proposal.measurement.q) + 1
    often = "twice" if proposal.problem.spec.noise.zero == "before_after" else "once"
    columns: list[Cells[int]] = [
        word_column("Pose", lambda k: first + k),
        *_shown(robot, found.q),
        word_column(
            "Group in the tracker", lambda k: f"pose{first + k:02d}_rep0_unloaded", code=True
        ),
    ]
    return section_of(
        "unpulled",
        "Unloaded poses",
        [
            Paragraph(
                f"Remove the chain and measure every reflector {often} at these poses. They "
                f"identify the DH parameters, not the stiffnesses: {worth_unpulled(found)}."
            ),
            table_of(
                "unpulled",
                "Poses to measure",
                columns,
                range(len(found.q)),
            ),
        ],
    )


def _drive_to(robot: Robot, measurement: Measurement, pose: int) -> str:
    mapped, values = axes.of(robot), axes.displayed(robot, measurement.q[pose])
    units = ("mm" if slides else "deg" for slides in mapped.slides)
    places = ", ".join(
        f"{name} {value:.2f} {unit}"
        for name, value, unit in zip(mapped.names, values, units, strict=True)
    )
    if not robot.prismatic[0]:
        return f"Drive to {places}."
    return f"Drive to {places}; the carriage arrives with {_way(measurement.approach[pose])}."


def expected(problem: Problem, measurement: Measurement) -> list[Array]:
    """Displacement of every reflector in every pull at nominal stiffness, (s, t) [m] each."""
    cell, out = paper_cell(problem.robot, problem.tool), []
    for q, way, steps in zip(measurement.q, measurement.approach, measurement.steps, strict=True):
        experiment = with_steps(problem, steps)
        pulls = pulls_at(
            experiment, q[None], measurement.anchor, np.array([way]), steps, np.zeros(1)
        )
        d = predict(cell, pulls, problem.experiment.scale).displacement
        out.append(np.linalg.norm(d, axis=-1))
    return out


def _log(problem: Problem, pose: int, steps: Array, moved: list[Array]) -> ReportTable | None:
    group, turned = f"pose{pose + 1:02d}_rep", turnings(steps)
    columns: list[Cells[int]] = [
        number_column("Pull", lambda k: k + 1, str),
        word_column("Turnbuckle", lambda k: turned[k]),
        _of_pose("Step [N]", np.abs(steps), 0),
        (Column("Scale reads [N]"), _blank),
        (Column("Time"), _blank),
        word_column(
            f"Expected |d| of {', '.join(problem.spec.targets)} [mm]",
            lambda k: ", ".join(f"{MM * x:.2f}" for x in moved[pose][k]),
        ),
        word_column("Group in the tracker", lambda k: f"{group}{k + 1}_loaded", code=True),
    ]
    note = f"Unloaded before: group {group}0_unloaded."
    if problem.spec.noise.zero == "before_after":
        note += f" Unloaded after: {group}{len(steps) + 1}_unloaded."
    return table_of(f"log-{pose + 1}", "To write down", columns, range(len(steps)), note)


def turnings(steps: Array) -> list[str]:
    """Action with the turnbuckle for each load step of a pose."""
    ways, size = branches(steps), np.abs(steps)
    up = ["tighten to", *("release, tighten to" if a == b else "tighten to" for a, b in
                          pairwise(size))]  # fmt: skip
    return [one if way > 0 else "slacken to" for one, way in zip(up, ways, strict=True)]


def _read_back(robot: Robot, pose: int) -> ReportTable | None:
    """Boxes for the axes as the controller shows them once the robot stands there."""
    columns: list[Cells[int]] = [
        *((Column(name), _short) for name in axes.of(robot).names),
        (Column("Arrived by hand from"), _blank),
    ]
    return table_of(f"read-back-{pose + 1}", "Axes read back", columns, range(1))


def _short(_: int) -> TableEntry:
    return TableEntry("_" * 8)


def _blank(_: int) -> TableEntry:
    return TableEntry("_" * 12)


def _telling(proposal: BoundedPlan, extras: SheetExtras) -> Section | None:
    columns: list[Cells[tuple[Joint, float]]] = [
        word_column("Stiffness", lambda one: f"k_{one[0].name}"),
        number_column("Relative standard uncertainty", itemgetter(1), percent),
        word_column("So", lambda one: _verdict(one[1])),
    ]
    table = table_of(
        "joints",
        "Expected uncertainty of the stiffnesses",
        columns,
        zip(proposal.problem.robot.joints, proposal.relative_std, strict=True),
        "At nominal stiffness and the stated noise; below 50 % the report calls it identifiable.",
    )
    cell = [Paragraph(f"{capital(one)}.") for one in cell_lines(proposal)]
    curves = _curves(proposal, extras)
    blocks = [Paragraph(_worth(proposal)), _search_note(proposal), *cell, table, *curves]
    return section_of("worth", "What it will tell", blocks)


def _verdict(std: float) -> str:
    if std < 0.5:
        return "identifiable"
    return "weak: known to better than its own size only" if std < 1 else "not identifiable"


def _search_note(proposal: BoundedPlan) -> Paragraph | None:
    certificate = proposal.certificate
    if certificate is None:
        return None
    return Paragraph(
        f"The bound comes from the continuous design and the general equivalence theorem. Its "
        f"worst direction was searched numerically, from {certificate.starts} starts of which "
        f"{percent(certificate.agreeing)} ended at the highest peak; the bound holds as far as "
        f"no higher peak was missed. The best continuous design found has "
        f"{_figure(proposal, certificate.continuous)}."
    )


def _curves(proposal: BoundedPlan, extras: SheetExtras) -> list[Block]:
    what = capital(proposal.problem.criterion.meaning)
    out: list[Block] = []
    if extras.sizes is not None:
        text = f"{what} of the best plan found, by poses and readings."
        out.append(Figure("size", "More poses, more readings", text, f"Curves: {text}"))
    if extras.anchors is not None:
        axis = "xyz"[extras.anchors.axis]
        text = (
            f"{what} against {axis} of the anchor: with the poses of this "
            f"plan, and with poses chosen anew for each place."
        )
        out.append(Figure("anchor", "Where the anchor may stand", text, f"Two curves: {text}"))
    return out


def _seeing(sights: list[Detectability], axes: Axes) -> Section | None:
    columns: list[Cells[Detectability]] = [
        word_column("Cause", lambda sight: from_twins(sight.name, axes)),
        (Column("Noticed from", numeric=True), lambda sight: _times(sight.detected_from)),
        (Column("Named from", numeric=True), lambda sight: _times(sight.named_from)),
        word_column("Hardest to tell from", lambda sight: from_twins(sight.rival, axes)),
        word_column(
            "What would settle it", lambda sight: "" if sight.named_from <= 1 else sight.needs
        ),
    ]
    table = table_of(
        "sights",
        "Smallest sizes, in multiples of the typical magnitude",
        columns,
        sorted(sights, key=lambda sight: sight.named_from),
        "Noticed: in 80 % of the cases at 1 % false alarms for all causes together. Named: 4.6 "
        "standard uncertainties away from what any rival can explain. Twins count as one cause.",
    )
    visibility = _visibility(sights)
    figure = Figure(
        "sights", "What the plan can see", visibility, f"Range chart of the causes. {visibility}"
    )
    return section_of(
        "sights", "What it will and will not see", [Paragraph(visibility), figure, table]
    )


def _controlling(problem: Problem, controls: Sequence[Control]) -> Section | None:
    """Uncontrolled observations and those of least redundancy: to be taken twice."""
    if not controls:
        return None
    joints = problem.robot.joints
    columns: list[Cells[Control]] = [
        word_column("Reading", _reading),
        number_column("Redundancy", lambda one: one.r, roughly),
        word_column("Minimal detectable bias", lambda one: size(one.visible, _UNIT[one.source])),
        number_column("Moves by [σ]", lambda one: one.moves, roughly),
        word_column("Which", lambda one: f"k_{joints[one.most - 1].name}"),
    ]
    worst = max(controls, key=lambda one: one.moves)
    text = (
        f"An error that would go unnoticed does most harm in the {_reading(worst)}: up to "
        f"{size(worst.visible, _UNIT[worst.source])} of it remains undetected and shifts "
        f"k_{joints[worst.most - 1].name} by {plain(worst.moves, 2)} standard uncertainties."
    )
    if not np.isfinite(worst.moves):
        text = f"The {_reading(worst)} is an uncontrolled observation: take it twice."
    note = (
        "Redundancy is the part of an error that the residuals show, 0 to 1. The minimal "
        "detectable bias is found in 80 % of the cases at 0.1 % false alarms; the last two "
        "columns say what it would move most. Readings of chain and base are no part of a plan."
    )
    title = "Readings of least redundancy"
    table = table_of("control", title, columns, controls[:LEAST_CONTROLLED], note)
    return section_of("control", "Uncontrolled observations", [Paragraph(text), table])


_UNIT = {"tracker": "m", "zero": "m", "force_reading": "N"}


def _reading(one: Control) -> str:
    if one.source == "force_reading":
        return f"scale reading of pull {one.pull} in pose {one.pose}"
    when = f"under pull {one.pull}" if one.pull else "in the unloaded state"
    return f"reading of {one.target} {when} in pose {one.pose}"


def _times(size: float) -> TableEntry:
    return entry(plain(size, 2) if np.isfinite(size) else "no size", min(size, 1e9))


def _assumptions(problem: Problem) -> Section | None:
    sentences = [*problem.spec.assumptions, *problem.robot.assumptions] or ["none"]
    table = table_of("assumptions", "Assumptions", [word_column("Assumption", str)], sentences)
    return section_of("assumptions", "Assumptions", [table])
