"""Games of our own: machines of the league, measured with noise of several families.

The machine shares no formula with the catalogue (`bench/league`). The last pose of each plan is
never measured: only the judge knows the effect of the test force there.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.exam import seeds as seeds_of
from bench.league.hidden import SECRETS
from bench.league.hidden_effect import Secret
from bench.league.outside_catalogue import STRANGE
from bench.league.play import Plan
from bench.league.run import ABLE, largest, shown_in
from bench.open_league import truth as truths
from bench.open_league.truth import Cause, Prediction, Stiffness, Truth
from bench.worlds.cell import Cell, build, random_plan
from bench.worlds.files import raw
from bench.worlds.noise import Bursts, Noise, Student, Wander, White
from bench.worlds.worlds import PULLED, STATED
from pipeline.base.arrays import Array
from pipeline.design.poses import default_anchors, draw_poses
from pipeline.diagnosis.isolability import twins
from pipeline.library.folders import replace_folder
from pipeline.machine.robot import Robot, load

SEEDS = Path(__file__).with_name("seeds.txt")
"""Seed k is the first 60 bits of SHA-256 of `open league k`, so that it was not chosen."""

NOISES: dict[str, Noise] = {
    "normal": White(),
    "Student t, 3": Student(3),
    "bursts": Bursts(),
    "wander over 10 min": Wander(1, 10),
}
KINDS = {"clean": 6, "one cause": 6, "two causes": 3, "outside the catalogue": 3}
"""Number of games of each kind in every eighteen."""

TIMES = 2.0
"""Size of a cause relative to the smallest at which linear theory distinguishes it from all others
[1]."""

STRANGE_SIZE = (0.7, 2.5)
"""Sizes of causes outside the catalogue, in typical sizes."""

HELD = 2
"""Index of the load step at the withheld pose at which the full test force acts."""

Hidden = list[tuple[Secret, float]]


@dataclass(frozen=True)
class Fixture:
    """One game before it is drawn.

    Attributes:
        name: Name of its folder.
        kind: Key of `KINDS`.
        noise: Key of `NOISES`.
        seed: Seed of everything.
    """

    name: str
    kind: str
    noise: str
    seed: int


def fixtures(count: int, seeds: Path = SEEDS) -> list[Fixture]:
    """A number of games, with kinds and noises in turn, so that each kind occurs with each noise.

    Raises:
        InputError: The file contains fewer seeds.
    """
    order = [kind for kind, n in KINDS.items() for _ in range(n)]
    kinds = [order[(7 * k) % len(order)] for k in range(count)]  # 7 and 18 are coprime: all in turn
    noises = list(NOISES)
    return [
        Fixture(f"game{k + 1:03d}", kind, noises[k // 2 % len(noises)], seed)
        for k, (kind, seed) in enumerate(zip(kinds, seeds_of(seeds, 0, count), strict=True))
    ]


def draw(fixture: Fixture, games: Path) -> None:
    """Write a campaign and its truth.json into `games`."""
    robot = load("kr500_rail")
    plan = _with_test_pose(robot, random_plan(robot, PULLED, fixture.seed), fixture.seed)
    hidden = _hidden(fixture, robot, plan)
    whole = build(robot, plan, PULLED, fixture.seed, hidden)
    force = whole.test_force
    cell = replace(_measured(whole), test_q=plan.q[-1])
    rng = np.random.default_rng([fixture.seed, 3])
    record = np.round(cell.local + NOISES[fixture.noise](cell.hours, cell.local, rng), 7)
    content = raw(cell, record, STATED, (), 1.0, True)
    content["campaign.toml"] = content["campaign.toml"].replace(
        b'name = "game"', f'name = "{fixture.name}"'.encode()
    )
    replace_folder(games / fixture.name, content)
    truths.write(games / fixture.name / "truth.json", _truth(fixture, whole, force))


def _with_test_pose(robot: Robot, plan: Plan, seed: int) -> Plan:
    """Add a reachable pose that is not measured; joint values rounded as in campaign.toml."""
    rng, anchors = np.random.default_rng([seed, 7]), default_anchors(robot)
    q = draw_poses(robot, plan.tool, anchors, np.zeros(1, int), rng)
    q = np.where(robot.prismatic, np.round(q, 6), np.deg2rad(np.round(np.rad2deg(q), 6)))
    return plan.further(q, anchors[:1], 1.0)


def _measured(whole: Cell) -> Cell:
    """The same machine and day without the last pose."""
    last = len(whole.plan.q)
    stays = whole.course.pose < last - 1
    slots = [
        k for k, slot in enumerate(whole.slots) if not slot.group.startswith(f"pose{last:02d}")
    ]
    rows = ("pose", "repeat", "time", "branch", "approach", "q")
    course = replace(whole.course, **{name: getattr(whole.course, name)[stays] for name in rows})
    return replace(
        whole,
        slots=tuple(whole.slots[k] for k in slots),
        points=whole.points[slots],
        course=course,
        scale=whole.scale[stays],
    )


def _deflection(whole: Cell, force: Array) -> Array:
    """Displacements due to a force at the load point at the withheld pose, F_b, shape (t, 3) [m].

    Of the machine alone: errors of scale and tracker do not enter.
    """
    one, course = whole.one, whole.course
    q = course.q + one.joint_shift
    steps = np.array(whole.rules.steps)[course.repeat]
    acts = steps[:, None] * force
    (rest, _), (bent, _) = (
        one.machine.settle(q, whole.tool[1:], whole.tool[0], f) for f in (0 * acts, acts)
    )
    at = np.flatnonzero((course.pose == course.pose.max()) & (course.repeat == HELD))
    return np.asarray((bent - rest)[at[0]])


def _hidden(fixture: Fixture, robot: Robot, plan: Plan) -> Hidden:
    rng = np.random.default_rng([fixture.seed, 4])
    if fixture.kind == "clean":
        return []
    if fixture.kind == "outside the catalogue":
        return [(STRANGE[rng.integers(len(STRANGE))], float(rng.uniform(*STRANGE_SIZE)))]
    return list(_of_catalogue(fixture, robot, plan, rng))


def _of_catalogue(
    fixture: Fixture, robot: Robot, plan: Plan, rng: np.random.Generator
) -> Iterator[tuple[Secret, float]]:
    """One or two causes in different parts of the cell, each at twice its identifiable size."""
    innocent = _measured(build(robot, plan, PULLED, fixture.seed))
    record = innocent.local + White()(innocent.hours, innocent.local, rng)
    known, most = shown_in(raw(innocent, record, STATED, (), 1.0, True), rng), largest(robot)
    sizes = {name: TIMES * known.named.get(name, np.inf) for name in ABLE}
    sensible = [name for name in ABLE if sizes[name] <= most.get(name, np.inf)]
    places: set[str] = set()
    for name in rng.permutation(sensible).tolist():
        if SECRETS[name].place in places:
            continue
        places.add(SECRETS[name].place)
        yield SECRETS[name], sizes[name]
        if len(places) == (2 if fixture.kind == "two causes" else 1):
            return


def _truth(fixture: Fixture, whole: Cell, force: Array) -> Truth:
    robot = whole.robot
    q = np.where(robot.prismatic, whole.plan.q[-1], np.rad2deg(whole.plan.q[-1]))
    deflection = _deflection(whole, np.round(force, 2))
    return Truth(
        salt=secrets.token_hex(16),
        kind=fixture.kind,
        noise=fixture.noise,
        stiffness=tuple(
            Stiffness(name=f"k_{joint.name}", value=k)
            for joint, k in zip(robot.joints, whole.stiffness.tolist(), strict=True)
        ),
        causes=_causes(whole),
        predictions=(
            Prediction(
                name="test_pose",
                q=tuple(np.round(q, 6).tolist()),
                force_n=tuple(np.round(force, 2).tolist()),
                deflection_m=dict(zip(("P1", "P2", "P3"), deflection.tolist(), strict=True)),
            ),
        ),
    )


def _causes(whole: Cell) -> tuple[Cause, ...]:
    same = twins(whole.robot)
    return tuple(
        Cause(
            name=name,
            where=int(where) if where.isdigit() else where or None,
            accept=same.of(hidden["label"]),
            listed=hidden["label"] in ABLE,
            amplitudes=hidden["amplitudes"],
        )
        for hidden in whole.amplitudes
        for name, _, where in [str(hidden["label"]).partition(":")]
    )
