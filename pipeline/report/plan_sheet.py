"""The measurement sheet: what the operator sets up, drives to, pulls and writes down, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.base.quantities import percent, plain
from pipeline.design.curves import ByAnchor, BySize
from pipeline.design.discriminate import Sight
from pipeline.design.information import station
from pipeline.design.measurement import Measurement
from pipeline.design.problem import Problem, with_steps
from pipeline.design.propose import Proposal
from pipeline.design.schedule import pulls_at
from pipeline.machine.cell import paper_cell, predict
from pipeline.machine.effect import branches
from pipeline.machine.robot import Robot
from pipeline.report import words
from pipeline.report.record import (
    Block,
    Column,
    Entry,
    Figure,
    Report,
    Section,
    Table,
    Text,
    entry,
    text_entry,
)

MM = 1e3
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
class Extras:
    """What is shown beside the plan itself.

    Attributes:
        sights: What the plan sees of every cause.
        sizes: Best figures by number of poses and readings, where computed.
        anchors: Best figures by place of the anchor, where computed.
    """

    sights: list[Sight]
    sizes: BySize | None = None
    anchors: ByAnchor | None = None


def sheet(proposal: Proposal, extras: Extras, seconds: float) -> Report:
    """Everything that is said about a plan.

    Args:
        proposal: The plan.
        extras: What is shown beside it.
        seconds: How long the search took.
    """
    problem, measurement = proposal.problem, proposal.measurement
    name = problem.spec.name
    return Report(
        kicker=f"Measurement sheet · {problem.robot.name}",
        heading=name,
        title=f"Measurement sheet {name} for {problem.robot.name}",
        verdict=f"{problem.spec.plan.readings} readings in {len(measurement.q)} poses",
        tone="good" if proposal.certificate is not None else "attention",
        sentences=(worth(proposal), _visibility(extras.sights)),
        sections=(
            _setting_up(problem, measurement),
            _driving(problem, measurement),
            *_pulling(problem, measurement),
            _telling(proposal, extras),
            _seeing(extras.sights),
            _assumptions(proposal),
        ),
        run_time=f"{seconds:.1f} s",
        elsewhere=f"The same stands in sheet.html and sheet.pdf, the numbers in design.json, the "
        f"plan in data/plans/{name}.toml.",
    )


def worth(proposal: Proposal) -> str:
    """The figure of a plan and its certificate, in one sentence."""
    criterion, certificate = proposal.problem.criterion, proposal.certificate
    said = f"The {criterion.meaning} is {_figure(proposal, proposal.figure)}"
    if certificate is None:
        return f"{said}; the search was interrupted before any bound was known."
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
    return f"{said}{pure}. No plan can be below {bound}: {whose} is {share} efficient."


def _figure(proposal: Proposal, value: float) -> str:
    in_m = proposal.problem.criterion.unit == "m"
    return f"{plain(MM * value, 4)} mm" if in_m else plain(value, 4)


def _visibility(sights: list[Sight]) -> str:
    noticed = sum(sight.detected_from <= 1 for sight in sights)
    named = sum(sight.named_from <= 1 for sight in sights)
    return (
        f"Of {len(sights)} causes that the model may lack, each of its usual size, it would notice "
        f"{noticed} and name {named}."
    )


def _setting_up(problem: Problem, measurement: Measurement) -> Section:
    spec = problem.spec
    anchor = ", ".join(f"{x:.3f}" for x in measurement.anchor)
    rows = [
        ("Robot", spec.robot),
        ("Anchor of the chain, F_b [m]", anchor),
        ("Load point, flange frame [m]", _point(spec.tool["load_point"])),
        *((f"Reflector {n}, flange frame [m]", _point(spec.tool[n])) for n in spec.targets),
        ("Tracker, F_b [m], as planned", _point(spec.noise.tracker_position_m)),
        ("Chain reflectors", "Pl1 near the effector, Pl2 near the anchor, both on the chain"),
    ]
    todo = [_BEFORE, _AT_EACH, *([_AFTER] if spec.noise.zero == "before_after" else [])]
    table = Table(
        "setup",
        "Set-up",
        (Column("What"), Column("Value")),
        tuple((text_entry(a), text_entry(b)) for a, b in rows),
    )
    return Section("setup", "Set up", (*(Text(line) for line in todo), table))


def _point(at: tuple[float, float, float]) -> str:
    return ", ".join(f"{x:g}" for x in np.round(at, 4))


def _driving(problem: Problem, measurement: Measurement) -> Section:
    robot = problem.robot
    at = station(problem.experiment, measurement.q, measurement.anchor)
    q = np.where(robot.prismatic, measurement.q, np.rad2deg(measurement.q))
    names = [f"{j.name} [{'m' if j.prismatic else 'deg'}]" for j in robot.joints]
    rail = bool(robot.prismatic[0])
    rows = [
        (
            _number(number + 1),
            *(_cell(value, 3) for value in q[number]),
            *((text_entry(_way(measurement.approach[number])),) if rail else ()),
            _cell(at.chain_m[number], 2),
            _cell(at.configuration.flange_origin[number, 2], 2),
        )
        for number in range(len(q))
    ]
    columns = [
        Column("Pose", True),
        *(Column(name, True) for name in names),
        *((Column("Carriage"),) if rail else ()),
        Column("Chain [m]", True),
        Column("Flange z [m]", True),
    ]
    blocks: list[Block] = [Table("poses", "Joint values", tuple(columns), tuple(rows))]
    if robot.controller:
        blocks.append(_axes(problem, q))
    return Section("poses", "Drive", tuple(blocks))


def _way(approach: float) -> str:
    return "r rising" if approach > 0 else "r falling"


def _turned(robot: Robot, q: Array) -> Array:
    """Joint values (m, n) [m] or [deg] as the controller shows them."""
    offset = np.where(robot.prismatic, robot.controller_offset, np.rad2deg(robot.controller_offset))
    return linear.solve(robot.controller_matrix, (q - offset).T).T


def _axes(problem: Problem, q: Array) -> Table:
    """The same poses in the controller's own axes."""
    robot = problem.robot
    rows = [
        (_number(number), *(_cell(value, 3) for value in row))
        for number, row in enumerate(_turned(robot, q), 1)
    ]
    columns = (Column("Pose", True), *(Column(name, True) for name in robot.controller))
    note = "In the axes of the controller; rail in m, the others in degrees."
    return Table("axes", "Controller axes", columns, tuple(rows), note)


def _pulling(problem: Problem, measurement: Measurement) -> list[Section]:
    moved, robot = expected(problem, measurement), problem.robot
    shown = np.where(robot.prismatic, measurement.q, np.rad2deg(measurement.q))
    names = robot.controller or tuple(joint.name for joint in robot.joints)
    shown = _turned(robot, shown) if robot.controller else shown
    out = []
    for number, steps in enumerate(measurement.steps):
        name = f"Pose {number + 1}"
        figure = Figure(
            f"pose-{number + 1}",
            f"{name} from the side and from above",
            f"{name} as it should look: chain from the effector to the anchor.",
            f"Line drawing of {name.lower()} from the side and from above, with rail, floor, arm, "
            f"reflectors, chain and anchor.",
        )
        drive = Text(_drive_to(measurement, number, names, shown[number], robot))
        log = _log(problem, number, steps, moved)
        out.append(Section(f"pose{number + 1}", name, (drive, figure, log)))
    return out


def _drive_to(
    measurement: Measurement, number: int, names: Sequence[str], values: Array, robot: Robot
) -> str:
    units = ("m" if slides else "deg" for slides in robot.prismatic)
    places = ", ".join(
        f"{name} {value:.3f} {unit}" for name, value, unit in zip(names, values, units, strict=True)
    )
    if not robot.prismatic[0]:
        return f"Drive to {places}."
    return f"Drive to {places}; the carriage arrives with {_way(measurement.approach[number])}."


def expected(problem: Problem, measurement: Measurement) -> list[Array]:
    """Displacement of every reflector in every pull by the nominal stiffnesses, (s, t) [m] each."""
    cell, out = paper_cell(problem.robot, problem.tool), []
    for q, way, steps in zip(measurement.q, measurement.approach, measurement.steps, strict=True):
        experiment = with_steps(problem, steps)
        pulls = pulls_at(
            experiment, q[None], measurement.anchor, np.array([way]), steps, np.zeros(1)
        )
        d = predict(cell, pulls, problem.experiment.scale).displacement
        out.append(np.linalg.norm(d, axis=-1))
    return out


def _log(problem: Problem, number: int, steps: Array, moved: list[Array]) -> Table:
    rows = []
    for k, (step, way) in enumerate(zip(steps, branches(steps), strict=True)):
        shown = ", ".join(f"{MM * x:.2f}" for x in moved[number][k])
        group = f"pose{number + 1:02d}_rep{k + 1}_loaded"
        again = k > 0 and way > 0 and abs(step) == abs(steps[k - 1])
        turned = "release, tighten to" if again else "tighten to" if way > 0 else "slacken to"
        blank = Entry("_" * 12)
        rows.append(
            (
                _number(k + 1),
                text_entry(turned),
                _cell(abs(step), 0),
                blank,
                blank,
                text_entry(shown),
                text_entry(group),
            )
        )
    columns = (
        Column("Pull", True),
        Column("Turnbuckle"),
        Column("Step [N]", True),
        Column("Scale reads [N]"),
        Column("Time"),
        Column(f"Expected |d| of {', '.join(problem.spec.targets)} [mm]"),
        Column("Group in the tracker", code=True),
    )
    note = f"Unloaded before: group pose{number + 1:02d}_rep0_unloaded."
    if problem.spec.noise.zero == "before_after":
        note += f" Unloaded after: pose{number + 1:02d}_rep{len(steps) + 1}_unloaded."
    return Table(f"log-{number + 1}", "To write down", columns, tuple(rows), note)


def _telling(proposal: Proposal, extras: Extras) -> Section:
    problem = proposal.problem
    joints = zip(problem.robot.joints, proposal.relative_std, strict=True)
    rows = [
        (text_entry(f"k_{joint.name}"), entry(percent(std), std), text_entry(_verdict(std)))
        for joint, std in joints
    ]
    table = Table(
        "joints",
        "Expected uncertainty of the stiffnesses",
        (Column("Stiffness"), Column("Relative standard uncertainty", True), Column("So")),
        tuple(rows),
        "At nominal stiffness and the stated noise; below 50 % the report calls it identifiable.",
    )
    blocks: list[Block] = [Text(worth(proposal)), *_search_note(proposal), table]
    return Section("worth", "What it will tell", (*blocks, *_curves(proposal, extras)))


def _verdict(std: float) -> str:
    if std < 0.5:
        return "identifiable"
    return "weak: known to better than its own size only" if std < 1 else "not identifiable"


def _search_note(proposal: Proposal) -> list[Text]:
    certificate = proposal.certificate
    if certificate is None:
        return []
    return [
        Text(
            f"The bound comes from the continuous design and the general equivalence theorem. Its "
            f"worst direction was searched numerically, from {certificate.starts} starts of which "
            f"{percent(certificate.agreeing)} ended at the highest peak; the bound holds as far as "
            f"no higher peak was missed. The best continuous design found has "
            f"{_figure(proposal, certificate.continuous)}."
        )
    ]


def _curves(proposal: Proposal, extras: Extras) -> list[Block]:
    what = proposal.problem.criterion.meaning
    out: list[Block] = []
    if extras.sizes is not None:
        said = f"{what[0].upper()}{what[1:]} of the best plan found, by poses and readings."
        out.append(Figure("size", "More poses, more readings", said, f"Curves: {said}"))
    if extras.anchors is not None:
        axis = "xyz"[extras.anchors.axis]
        said = (
            f"{what[0].upper()}{what[1:]} against {axis} of the anchor: with the poses of this "
            f"plan, and with poses chosen anew for each place."
        )
        out.append(Figure("anchor", "Where the anchor may stand", said, f"Two curves: {said}"))
    return out


def _seeing(sights: list[Sight]) -> Section:
    order = sorted(sights, key=lambda sight: sight.named_from)
    rows = [
        (
            text_entry(words.from_twins(sight.name)),
            entry(_times(sight.detected_from), min(sight.detected_from, 1e9)),
            entry(_times(sight.named_from), min(sight.named_from, 1e9)),
            text_entry(words.from_twins(sight.rival)),
            text_entry("" if sight.named_from <= 1 else sight.needs),
        )
        for sight in order
    ]
    table = Table(
        "sights",
        "Smallest sizes, in multiples of the usual size",
        (
            Column("Cause"),
            Column("Noticed from", True),
            Column("Named from", True),
            Column("Hardest to tell from"),
            Column("What would settle it"),
        ),
        tuple(rows),
        "Noticed: in 80 % of the cases at 1 % false alarms for all causes together. Named: 4.6 "
        "standard uncertainties away from what any rival can explain. Twins count as one cause.",
    )
    said = _visibility(sights)
    figure = Figure("sights", "What the plan can see", said, f"Range chart of the causes. {said}")
    return Section("sights", "What it will and will not see", (Text(said), figure, table))


def _times(size: float) -> str:
    return plain(size, 2) if np.isfinite(size) else "no size"


def _assumptions(proposal: Proposal) -> Section:
    problem = proposal.problem
    said = [*problem.spec.assumptions, *problem.robot.assumptions]
    rows = tuple((text_entry(line),) for line in said) or ((text_entry("none"),),)
    table = Table("assumptions", "Assumptions", (Column("Assumption"),), rows)
    return Section("assumptions", "Assumptions", (table,))


def _number(value: int) -> Entry:
    return entry(str(value), value)


def _cell(value: float, decimals: int) -> Entry:
    return entry(f"{value:.{decimals}f}", value)
