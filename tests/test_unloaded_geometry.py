"""Causes that the unloaded reflectors show: chosen by fits made up, found in a small cell."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from small_case import asked, small

from pipeline.base.arrays import Parameter
from pipeline.diagnosis import unloaded_geometry as module
from pipeline.diagnosis.facts import NOTHING
from pipeline.diagnosis.unloaded_fit import Fits, fitted, unloaded
from pipeline.diagnosis.unloaded_geometry import as_stiff, corrected, standing
from pipeline.machine.cell import predict
from pipeline.machine.effects import catalogue


def effect(label, lower=-np.inf, upper=np.inf, count=1):
    """A cause by name, with parameters between two bounds."""
    parameters = tuple(Parameter(f"z{k}", "1", 1.0, lower, upper) for k in range(count))
    return SimpleNamespace(label=label, parameters=parameters)


A, B, C, D = (effect(name) for name in "abcd")


class Table:
    """Fits that are given: misfit of each set of causes, and what it leaves [m]."""

    def __init__(self, chi2, left=None, dof=100, values=None, std=0.1):
        self.chi2, self.of_left, self.dof = chi2, left or {}, dof
        self.values, self.std = values or {}, std

    def __call__(self, effects):
        """The fit of some causes; what is not given fits badly."""
        key = "".join(sorted(one.label for one in effects))
        chi2 = self.chi2.get(key, 1e4)
        values = np.array(
            [self.values.get(e.label, 1.0) for e in effects for _ in e.parameters], float
        )
        return SimpleNamespace(
            effects=tuple(effects), chi2=chi2, dof=self.dof, values=values,
            cov=self.std**2 * np.eye(len(values)), p=stats.chi2.sf(chi2, self.dof),
        )  # fmt: skip

    def left(self, effects):
        """What they leave."""
        return self.of_left.get("".join(sorted(one.label for one in effects)), 1e-3)


def chosen(table, *suspects):
    best = module._search(table, table, suspects)
    return best and "".join(sorted(one.label for one in best.effects))


ENOUGH = stats.chi2.isf(1.1e-3, 100)
"""A misfit of 100 degrees of freedom that is just believed, ..."""

TOO_MUCH = stats.chi2.isf(0.9e-3, 100)
"""... and one that is not."""


@pytest.mark.parametrize(
    ("chi2", "said"),
    [
        ({"a": ENOUGH, "b": 500}, "a"),
        ({"a": 500, "b": ENOUGH - 1, "ab": 90}, "b"),
        ({"a": TOO_MUCH, "b": 500, "ab": 90}, "ab"),
        ({"a": 900, "b": 800, "c": 700, "bc": 400, "ab": 90, "ac": 300, "abc": 80}, "abc"),
        ({"a": 900, "abc": 500, "ab": 600, "abcd": 50}, None),
    ],
    ids=["one", "the better", "two", "on the way of least misfit", "four are too many"],
)
def test_the_fewest_causes_that_leave_no_more_than_chance(chi2, said):
    """One, two or three, each joining where it helps most."""
    assert chosen(Table(chi2), A, B, C, D) == said


def test_one_alone_that_leaves_what_any_robot_has_is_believed():
    """Less than 0.3 mm and than 15 % of the misfit; two that do so are not."""
    chi2 = {"a": 400, "b": 600, "ab": 300, "abc": 250}
    for first, alone, said in (
        (3e-3, 2.9e-4, "a"),
        (3e-3, 3.1e-4, None),
        (1.5e-3, 2.2e-4, "a"),
        (1.5e-3, 2.3e-4, None),
    ):
        assert chosen(Table(chi2, {"": first, "a": alone}), A, B, C) == said
    assert chosen(Table({**chi2, "a": 700}, {"": 3e-3, "a": 1e-4, "b": 1e-3}), A, B, C) is None


@pytest.mark.parametrize(
    ("value", "said"), [(-0.29, "a"), (-0.31, None), (1.29, "a"), (1.31, None), (0.5, "a")]
)
def test_a_size_beyond_its_bounds_by_three_sigma_is_no_cause(value, said):
    """Between 0 and 1, uncertain by a tenth."""
    bounded = effect("a", 0.0, 1.0)

    assert chosen(Table({"a": 90}, values={"a": value}), bounded) == said


def test_rivals_have_odds_by_what_they_leave():
    """A misfit larger by 2 ln 3 is three times less likely, and a parameter costs a factor e."""
    wide = effect("c", count=2)
    table = Table({"ad": 50, "bd": 50 + 2 * np.log(3), "cd": 50.0})
    best = table((A, D))

    found = module._rivals(table, best, 0, (A, B, wide, D))

    weights = np.array([1.0, 1 / np.e, 1 / 3])
    assert [one.label for one, _ in found] == ["a", "c", "b"]
    assert [p for _, p in found] == pytest.approx(weights / weights.sum())


def test_where_more_than_scatter_is_left_rivals_are_closer():
    """Four times the scatter: a fourth of the difference counts; who has none is left out."""
    table = Table({"a": 400, "b": 400 + 8 * np.log(3), "c": 2000})

    found = module._rivals(table, table((A,)), 0, (A, B, C))

    assert [(one.label, pytest.approx(p)) for one, p in found] == [("a", 0.75), ("b", 0.25)]


@pytest.fixture(scope="module")
def off():
    """Seven poses of a robot whose third joint has a wrong zero."""
    return asked(small(3, poses={"count": 8}, hidden={"effects": ["joint_offset:3=2x"]}))


@pytest.fixture(scope="module")
def causes(off):
    wanted = ("joint_offset:2", "joint_offset:3", "joint_offset:5", "base_rotation", "rail_roll")
    found = {one.label: one for one in catalogue(off.case.robot)}
    return tuple(found[name] for name in wanted)


@pytest.fixture(scope="module")
def stood(off, causes):
    return standing(off.cell, off.reduced.data, 1.0, causes, np.random.default_rng(1))


def by_label(causes, label):
    return next(one for one in causes if one.label == label)


def test_a_wrong_zero_is_found_with_what_it_is_worth(off, causes, stood):
    """Itself alone, its p the misfit without it, and a gain of refits without each pose."""
    zeros = unloaded(off.cell, off.reduced.data, 1.0)
    mine = by_label(causes, "joint_offset:3")

    assert [one.label for one in stood.effects] == ["joint_offset:3"]
    assert stood.p_values == (pytest.approx(fitted(zeros, ()).p, abs=1e-300),)
    assert stood.miss_m > 3e-4 > stood.left_m
    assert stood.rivals[0][0][0] is mine
    assert stood.gain.of == "unloaded positions"
    assert stood.gain.ci95[0] > 0.5
    before, after = (part.reshape(-1, 3) for part in (stood.gain.before, stood.gain.after))
    for pose in (0, 5):
        out, rest = zeros.pose == pose, zeros.exact.without(pose)
        np.testing.assert_allclose(before[out], zeros.exact.short(fitted(rest, ()))[out], atol=1e-7)
        expected = zeros.exact.short(fitted(rest, (mine,)))[out]
        np.testing.assert_allclose(after[out], expected, atol=2e-6)
    assert stood.gain.chosen == (("joint_offset:3",),) * 8


def test_corrected_data_stand_where_the_causes_put_them(off, causes, stood):
    """The table at the corrected joints is the table with the cause at the logged ones."""
    data = off.reduced.data
    right = corrected(off.cell, data, stood)
    bare = replace(off.cell, effects=())
    effect_, size = stood.effects, stood.fit.values

    now = predict(bare, right.pulls, np.zeros(0)).unloaded
    then = predict(replace(bare, effects=effect_), data.pulls, size).unloaded
    np.testing.assert_allclose(now, then, atol=1e-12)
    moved = right.pulls.q - data.pulls.q
    assert np.flatnonzero(np.abs(moved).max(axis=0)).tolist() == [2]
    np.testing.assert_allclose(moved[:, 2], size[0], rtol=1e-9)
    np.testing.assert_array_equal(right.delta, data.delta)
    assert corrected(off.cell, data, NOTHING) is data


def test_a_turned_base_turns_forces_and_displacements_back(off, causes, stood):
    """What the tracker sees of both is in its own frame: corrected, it is in the robot's."""
    turned = by_label(causes, "base_rotation")
    fit = replace(stood.fit, effects=(turned,), values=np.array([1e-3, -2e-3, 3e-3]))
    found = replace(stood, fit=fit)
    cell = replace(off.cell, effects=(*off.cell.effects, turned))
    x = np.concatenate([off.case.robot.nominal_compliance, fit.values])
    data = off.reduced.data
    seen = predict(cell, data.pulls, x).displacement[data.pull, data.target]

    right = corrected(off.cell, replace(data, delta=seen), found)

    springs = predict(off.cell, right.pulls, x[:7]).displacement[data.pull, data.target]
    np.testing.assert_allclose(right.delta, springs, atol=2e-5 * np.abs(springs).max())
    assert np.abs(seen - springs).max() > 1e-3 * np.abs(springs).max()


def test_a_cause_is_visible_from_where_its_misfit_is_no_chance(off, causes):
    """At the multiple that is told one of both tests is just passed, and the other is."""
    zeros = unloaded(off.cell, off.reduced.data, 1.0)
    table = replace(zeros, at=zeros.stands((), np.zeros(0)))
    told = module._visible(zeros, causes)

    for label in ("joint_offset:3", "joint_offset:5"):
        one = by_label(causes, label)
        size = told[label] * np.array([p.typical for p in one.parameters])
        moved = replace(table, at=table.stands((one,), size))
        left, fit = Fits(moved.exact).left(()), fitted(moved, ())
        beyond = stats.chi2.isf(1e-6, fit.dof) - fit.dof
        nearer = min(left / 3e-4, np.sqrt(fit.chi2 / beyond))
        assert nearer == pytest.approx(1.0, rel=0.02)
    assert told["rail_roll"] == np.inf  # an unloaded robot does not show it


def test_a_robot_on_its_table_is_let_be(causes):
    """Below 0.3 mm nothing is sought; what would be seen is told. Nobody read, nothing is."""
    good = asked(small(3, poses={"count": 8}))
    rng = np.random.default_rng(1)

    found = standing(good.cell, good.reduced.data, 1.0, causes, rng)

    assert found.fit is None
    assert found.miss_m == found.left_m < 3e-4
    assert set(found.visible) == {one.label for one in causes if one.shows_unloaded}
    assert standing(good.cell, good.reduced.data, 1.0, (), rng) is NOTHING
    assert standing(good.cell, good.reduced.data, np.nan, causes, rng) is NOTHING


def test_a_misfit_that_nothing_explains_hides_what_is_left(off, causes):
    """Where the table is off for another reason, one more cause would not be seen.

    Also where the catalogue has two such causes only: three cannot be tried.
    """
    others = tuple(one for one in causes if one.label in ("joint_offset:2", "joint_offset:5"))

    found = standing(off.cell, off.reduced.data, 1.0, others, np.random.default_rng(1))

    assert found.fit is None
    assert found.miss_m == found.left_m > 3e-4
    assert found.visible == {}


@pytest.mark.parametrize(("chance", "said"), [(1e-5, False), (1e-7, True)])
def test_each_cause_must_be_needed(off, monkeypatch, chance, said):
    """Without it the misfit is as improbable as one in a million."""
    table = Table({"": 5e3, "a": stats.chi2.isf(chance, 100), "ab": 90}, {"": 2e-3, "ab": 1e-5})
    monkeypatch.setattr(module, "Fits", lambda _: table)
    monkeypatch.setattr(module, "_visible", lambda *_: {"a": 1.0})
    monkeypatch.setattr(module, "_gain", lambda *_: None)
    suspects = [SimpleNamespace(**vars(one), shows_unloaded=True) for one in (A, B, C)]

    found = standing(off.cell, off.reduced.data, 1.0, suspects, np.random.default_rng(1))

    assert (found.fit is not None) is said
    assert (found.left_m, found.visible) == ((1e-5, {"a": 1.0}) if said else (2e-3, {}))
    if said:
        assert sorted(found.p_values) == [0.0, pytest.approx(chance)]


def test_gravity_bends_the_springs_that_were_identified(off):
    """Stiffnesses from positive compliances that are known; the others stay nominal."""
    value = np.array([1e-8, 2e-7, -1e-7, 4e-7, 5e-7, 6e-7, 7e-7])
    known = np.array([True, True, True, False, True, True, True])

    cell = as_stiff(off.cell, SimpleNamespace(value=value, identifiable=known))

    old = [joint.stiffness for joint in off.cell.robot.joints]
    new = [joint.stiffness for joint in cell.robot.joints]
    assert new == pytest.approx([1e8, 5e6, old[2], old[3], 2e6, 1 / 6e-7, 1 / 7e-7])
