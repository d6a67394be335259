"""Twins: effects that no campaign separates, by ranks of matrices computed here."""

from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import linalg
from small_case import asked, small

from pipeline.diagnosis.diagnose import search_task
from pipeline.diagnosis.isolability import Twins, _compare, rich_pulls, rich_tool, twins
from pipeline.machine.cell import baseline, paper_cell, sensitivity
from pipeline.machine.effect import HUNG, PULLED
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load

RNG = np.random.default_rng(30)
B = RNG.standard_normal((60, 4)) * [1e-5, 1e-3, 1e-4, 1e-6]
Z = RNG.standard_normal((60, 6))


def in_base(size=1.0):
    """A column in the span of the springs."""
    return size * (B / np.linalg.norm(B, axis=0)) @ RNG.standard_normal((4, 1))


def compared(**columns):
    """Comparison of effects with these columns; a label may end in a form, `roll_2`."""
    effects = [SimpleNamespace(label=name.partition("_")[0]) for name in columns]
    return _compare(effects, B, dict(enumerate(columns.values())))


def test_what_the_springs_make_too_is_a_stiffness():
    """Any combination of the base, of any size; one that differs by 1e-6 is not."""
    found = compared(
        small=in_base(1e-7), large=in_base(1e3), pair=np.hstack([in_base(), in_base()]),
        near=in_base() + 1e-6 * Z[:, :1],
    )  # fmt: skip

    assert found.of_stiffness == ("small", "large", "pair")
    assert found.unmoved == ()
    assert found.pairs == ()


def test_what_moves_less_than_a_picometre_moves_nothing():
    """At its typical size; ten of them are visible."""
    unit = Z[:, :1] / np.abs(Z[:, 0]).max()

    assert compared(nothing=0.9e-12 * unit, some=1e-11 * unit).unmoved == ("nothing",)


def test_twins_span_the_same_beside_the_springs():
    """In any units and combinations, with any part of the springs; a subspace is no twin."""
    turn = RNG.standard_normal((2, 2))
    found = compared(
        one=1e-5 * Z[:, :1], other=-300.0 * (Z[:, :1] + in_base(5.0)), alone=Z[:, 1:2],
        wide=Z[:, 2:4], mixed=1e-3 * Z[:, 2:4] @ turn + in_base(), half=Z[:, 2:3],
        across=np.hstack([Z[:, 2:3], Z[:, 4:5]]), twice=Z[:, [2, 2]],
    )  # fmt: skip

    assert found.pairs == (("one", "other"), ("wide", "mixed"), ("half", "twice"))
    assert found.of("one") == ("other",)
    assert found.of("mixed") == ("wide",)
    assert found.of("alone") == ()


def test_forms_of_one_cause_are_no_twins_of_each_other_and_one_name():
    """Two similar laws of one cause are not reported; with another cause the pair is, once."""
    same = Z[:, :1]
    found = compared(roll_1=same, roll_2=2 * same, yaw_1=3 * same, yaw_2=same + in_base())

    assert found.pairs == (("roll", "yaw"),)
    assert compared(sag_1=in_base(), sag_2=in_base()).of_stiffness == ("sag",)
    assert Twins((), (("a", "b"), ("c", "a")), ()).of("a") == ("b", "c")


def test_what_differs_by_a_thousandth_can_be_told_apart():
    """Twins are equal to rounding: a small angle depends on the campaign."""
    near = compared(one=Z[:, :1], other=Z[:, :1] + 1e-3 * Z[:, 1:2])

    assert near.pairs == ()


def counted(robot):
    """Twins of a robot's catalogue from principal angles in another random design."""
    rng = np.random.default_rng(77)
    cell, pulls = paper_cell(robot, rich_tool(rng)), rich_pulls(robot, rng, 60)
    x = robot.nominal_compliance * rng.uniform(0.8, 1.3, robot.n)

    def columns(effects):
        Z = sensitivity(cell, pulls, x, effects).reshape(60 * 9, -1)
        return Z * [p.typical for effect in effects for p in effect.parameters]

    springs = linalg.orth(
        columns(baseline(robot)) / np.linalg.norm(columns(baseline(robot)), axis=0)
    )
    unmoved, stiff, left = set(), set(), []
    for effect in catalogue(robot):
        own = columns([effect])
        rest = own - springs @ (springs.T @ own)
        rest -= springs @ (springs.T @ rest)
        if np.abs(own).max() < 1e-11:
            unmoved.add(effect.label)
        elif np.linalg.norm(rest) < 1e-8 * np.linalg.norm(own):
            stiff.add(effect.label)
        else:
            left.append((effect.label, linalg.orth(rest, rcond=1e-7)))
    pairs = {
        frozenset((a, b))
        for (a, one), (b, other) in combinations(left, 2)
        if a != b
        and one.shape == other.shape
        and np.abs(linalg.subspace_angles(one, other)).max() < 1e-5
    }
    return unmoved, stiff, pairs


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["kr500_rail", "fanuc_r2000ic"])
def test_the_twins_of_a_robot_are_those_of_another_design(name):
    """Exactly the same ones with other poses, stiffnesses, tool and algebra."""
    robot = load(name)
    unmoved, stiff, pairs = counted(robot)
    found = twins(robot)

    assert set(found.unmoved) == unmoved
    assert set(found.of_stiffness) == stiff
    assert {frozenset(pair) for pair in found.pairs} == pairs
    assert pairs


def test_weights_beside_pulls_tell_the_gain_of_the_scale_from_the_springs():
    """Nothing else; weights alone say nothing of a scale."""
    robot = load("kr500_rail")
    pulled, both = twins(robot), twins(robot, weighed=True)

    assert {*pulled.of_stiffness} - {*both.of_stiffness} == {"scale_gain"}
    assert both.unmoved == pulled.unmoved


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("every", "asked_for"), [(2, True), (1, False), (99, False)])
def test_the_gain_is_a_suspect_where_weights_hang_beside_pulls(every, asked_for):
    """Every second load is a weight, every one, or none."""
    at = asked(small())
    pulls = at.reduced.data.pulls
    by = np.where(np.arange(1, len(pulls) + 1) % every, PULLED, HUNG)
    data = replace(at.reduced.data, pulls=replace(pulls, by=by))

    task, _ = search_task(at.cell, data, at.estimate)

    assert ("scale_gain" in {one.label for one in task.suspects}) == asked_for


def test_rich_pulls_are_as_varied_as_they_can_be():
    """Four per pose, within the limits and up to them; all directions, branches, approaches."""
    robot = load("kr500_rail")
    pulls = rich_pulls(robot, np.random.default_rng(1), 400)
    q, size = pulls.q[::4], np.linalg.norm(pulls.force, axis=1)

    assert (pulls.q == np.repeat(q, 4, axis=0)).all()
    assert pulls.pose.tolist() == np.repeat(np.arange(100), 4).tolist()
    assert pulls.repeat.tolist() == list(range(4)) * 100
    assert (q >= robot.lower).all()
    assert (q <= robot.upper).all()
    assert (np.ptp(q, axis=0) > 0.9 * (robot.upper - robot.lower)).all()
    assert size.min() > 300
    assert size.max() < 4000
    assert np.ptp(size) > 3000
    mean = pulls.force / size[:, None]
    assert np.cov(mean.T) == pytest.approx(np.eye(3) / 3, abs=0.06)
    assert set(pulls.branch) == set(pulls.approach) == {-1.0, 1.0}
    assert (np.diff(pulls.time) > 0).all()
    for shared in (pulls.approach, pulls.time_zero):
        assert (shared.reshape(100, 4) == shared[::4, None]).all()
