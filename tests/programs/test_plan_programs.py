"""Programs that drive a plan, read again by our readers of programs and by plain patterns."""

import re

import numpy as np
import pytest

from pipeline.machine.robot import load
from pipeline.programs import read
from pipeline.programs.for_plan import brand_of, drive, programs

ROBOTS = {
    "kr210_r2700_2": ("kuka", "abb", "fanuc", "ur"),
    "irb6640": ("kuka", "abb", "fanuc", "ur"),
    "ur10e": ("kuka", "abb", "fanuc", "ur"),
    "kr500_rail": ("kuka", "abb", "fanuc"),
}
SUFFIX = {"kuka": ".src", "abb": ".mod", "fanuc": ".ls", "ur": ".script"}


def drawn(name, seed, poses=5):
    """A plan at random: joint values, ways of approach, steps."""
    robot, rng = load(name), np.random.default_rng(seed)
    q = rng.uniform(robot.lower, robot.upper, (poses, robot.n))
    q = np.where(robot.prismatic, q.round(6), np.deg2rad(np.rad2deg(q).round(6)))
    steps = [[1200.0, 2400.0, -1200.0]] * (poses - 1) + [[]]
    return robot, q, rng.choice([-1, 1], poses), steps


def axes_of(robot, q):
    """By the robot file's own words, q = C a + q_0: arm first, lengths in mm behind it."""
    a = np.linalg.solve(robot.controller_matrix, (q - robot.controller_offset).T).T
    slides = np.array([name.startswith("E") for name in robot.controller])
    return np.hstack([np.rad2deg(a[:, ~slides]), 1e3 * a[:, slides]])


def parsed(files, suffix):
    """Targets of a program as our readers of taught programs see it."""
    name = next(file for file in files if file.endswith(suffix))
    if suffix != ".src":
        return read(name, files[name])
    beside = name.replace(".src", ".dat")
    return read(beside, files[beside], (name, files[name]))


@pytest.mark.sampled(20)
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("name", "brand"), [(n, b) for n, own in ROBOTS.items() for b in own])
def test_a_program_says_the_poses_of_its_plan_to_the_last_digit(name, brand, seed):
    """Sixty programs of four languages; nothing in them is left unread, and order is kept."""
    robot, q, way, steps = drawn(name, seed)
    made = drive("plan 1", robot, q, way, steps, zero_after=True)
    files = programs(made, brand)
    found = parsed(files, SUFFIX[brand])
    expected = axes_of(robot, q)
    rail = expected.shape[1] > 6
    if rail:  # each pose has a point beside it, from which the carriage arrives
        beside = expected - 100.0 * way[:, None] * (np.arange(7) == 6)
        low, high = 1e3 * robot.lower[0], 1e3 * robot.upper[0]
        beside[:, 6] = np.clip(beside[:, 6], low, high)
        expected = np.stack([beside, expected], axis=1).reshape(-1, 7)
    digits = {"fanuc": 3, "ur": 9}.get(brand, 6)
    wanted = np.deg2rad(expected) if brand == "ur" else expected

    assert len(found.targets) == len(wanted)
    assert not found.left
    assert not found.elsewhere
    values = np.array([[*one.values, *one.external[: len(one.external)]] for one in found.targets])
    assert np.abs(values[:, : wanted.shape[1]] - wanted).max() <= 0.6 * 10.0**-digits
    assert {one.kind for one in found.targets} == {"joint"}


@pytest.mark.parametrize("brand", SUFFIX)
def test_it_stops_once_for_each_group_of_the_sheet(brand):
    """As many stops as groups, in the order of measuring, each with the name of its group."""
    robot, q, way, steps = drawn("kr210_r2700_2", 9)
    files = programs(drive("p", robot, q, way, steps, zero_after=True), brand)
    text = files["p" + SUFFIX[brand]].decode()
    stop = {"kuka": r"^HALT", "abb": r"^ +Stop;", "fanuc": r"PAUSE ;", "ur": r"blocking=True\)"}
    groups = re.findall(r"pose\d\d_rep\d_(?:un)?loaded", text)
    wanted = [
        f"pose{k:02d}_rep{n}_{'unloaded' if n in (0, 4) else 'loaded'}"
        for k in range(1, 5)
        for n in range(5)
    ] + ["pose05_rep0_unloaded", "pose05_rep1_unloaded"]

    assert groups == wanted
    assert len(re.findall(stop[brand], text, re.MULTILINE)) == len(wanted)
    assert "slacken to 1200 N" in text
    assert max(map(len, text.splitlines())) < 255
    assert text.isascii()


def test_a_controller_gets_programs_of_its_own_language():
    """By the words of the robot's description; all of them where it does not say."""
    robot, q, way, steps = drawn("irb6640", 3)
    made = drive("p", robot, q, way, steps, zero_after=False)

    assert brand_of(robot.description) == "abb"
    assert brand_of("six axes on the floor") is None
    assert [*programs(made, "abb")] == ["p.mod"]
    assert {name.partition(".")[2] for name in programs(made)} == {
        "src",
        "dat",
        "mod",
        "ls",
        "script",
    }


def test_seven_axes_are_no_program_for_a_ur():
    """Its controller has six."""
    robot, q, way, steps = drawn("kr500_rail", 4)

    assert not programs(drive("p", robot, q, way, steps, zero_after=True), "ur")
