"""A unit that changes in mid-file: the first such row, and the intended numbers."""

from dataclasses import replace

import numpy as np
import pytest
from small_case import asked, small
from test_exchanged import PULLS, case, files, same, table, written

from pipeline.answer.diagnosis import mistake_entry
from pipeline.faults.conventions import symbol
from pipeline.faults.exchanged import misplaced
from pipeline.faults.mistake import lines_of
from pipeline.faults.scale_rows import scale_rows
from pipeline.faults.unit_since import unit_since
from pipeline.simulate import simulate
from pipeline.simulate.plan import Plan

NEWTONS = {"kgf": 9.80665, "lbf": 4.4482216152605, "kn": 1000.0, "dan": 10.0}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("unit", NEWTONS)
def test_forces_in_another_unit_from_some_row_on(seed, unit):
    """Anywhere except in the first and last rows: unit, line and forces."""
    first = int(np.random.default_rng(seed).integers(3, PULLS - 3))
    head, rows = table(files(seed), "loads.csv")
    new = [
        [*row[:2], repr(float(row[2]) / NEWTONS[unit]) if k >= first else row[2], *row[3:]]
        for k, row in enumerate(rows)
    ]
    made = written(files(seed), "loads.csv", head, new)

    (found,) = scale_rows(asked(case(made)))

    assert found.name == "unit_mixup"
    assert found.where in ({unit, "kgf", "dan"} if unit in ("kgf", "dan") else {unit})
    assert found.since == f"loads.csv:{first + 2}"
    assert found.at == tuple(f"loads.csv:{k + 2}" for k in range(first, PULLS))
    if found.where == unit:
        same(found.correct(case(made)), case(files(seed)))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", [8, *range(8), 9])
@pytest.mark.parametrize("unit", ["kgf", "kn", "lbf"])
def test_forces_in_another_unit_up_to_some_row(seed, unit):
    """Fewer or more than half of them: those are wrong, not the others by the inverse."""
    last = int(np.random.default_rng(seed).integers(3, PULLS - 3))
    head, rows = table(files(seed), "loads.csv")
    new = [
        [*row[:2], repr(float(row[2]) / NEWTONS[unit]) if k < last else row[2], *row[3:]]
        for k, row in enumerate(rows)
    ]
    made = written(files(seed), "loads.csv", head, new)

    (found,) = scale_rows(asked(case(made)))

    assert (found.name, found.where, found.since) == ("unit_mixup", unit, None)
    assert found.at == tuple(f"loads.csv:{k + 2}" for k in range(last))
    assert (
        f"up to loads.csv:{last + 1} the numbers of the scale are {symbol(unit)}" in found.evidence
    )
    same(found.correct(case(made)), case(files(seed)))


@pytest.mark.parametrize("unit", ["kgf", "lbf"])
def test_forces_of_some_rows_in_another_unit(unit):
    """Rows 6 to 8 in it: none of the others; where kgf may be daN, they are left out."""
    head, rows = table(files(2), "loads.csv")
    new = [
        [*row[:2], repr(float(row[2]) / NEWTONS[unit]) if 5 <= k < 8 else row[2], *row[3:]]
        for k, row in enumerate(rows)
    ]
    made = written(files(2), "loads.csv", head, new)

    (found,) = scale_rows(asked(case(made)))

    assert found.where == unit or {found.where, *found.instead} == {"kgf", "dan"}
    assert (found.at, found.since) == (tuple(f"loads.csv:{k}" for k in (7, 8, 9)), None)
    assert "from loads.csv:7 to loads.csv:9 the numbers of the scale" in found.evidence
    if unit == "lbf":
        same(found.correct(case(made)), case(files(2)))
    else:
        assert len(found.correct(case(made)).loads) == PULLS - 3


def test_forces_of_rows_here_and_there_in_another_unit():
    """Nine of 21 rows: these, and no more."""
    head, rows = table(files(2), "loads.csv")
    odd = [0, 2, 3, 7, 8, 11, 14, 17, 19]
    for k in odd:
        rows[k][2] = repr(float(rows[k][2]) / NEWTONS["lbf"])
    made = case(written(files(2), "loads.csv", head, rows))

    (found,) = scale_rows(asked(made))

    assert (found.where, found.since) == ("lbf", None)
    assert found.at == tuple(f"loads.csv:{k + 2}" for k in odd)
    assert "in 9 rows the numbers of the scale are lbf" in found.evidence
    same(found.correct(made), case(files(2)))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(12))
def test_weak_pulls_that_agree_in_either_unit_are_no_others(seed):
    """All forces in kgf: no part of the rows is in another unit than the rest, which is weak."""
    plan = Plan(
        name="weak",
        seed=seed,
        poses={"count": 12},
        pulls={"steps_n": [60.0, 1200.0, 3000.0, 2000.0]},
        hidden={"stiffness_spread": 0.3},
    )
    right = dict(simulate(plan).files)
    head, rows = table(right, "loads.csv")
    new = [[*row[:2], repr(float(row[2]) / NEWTONS["kgf"]), *row[3:]] for row in rows]

    assert scale_rows(asked(case(written(right, "loads.csv", head, new)))) == []


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", [906, *range(940, 951)])
def test_two_poses_that_agree_as_logged_are_in_one_unit(seed):
    """Six pulls of two poses do not determine all springs: they agree in other units as well."""
    files = simulate(Plan(name="two", seed=seed, poses={"count": 2})).files

    assert scale_rows(asked(case(dict(files)))) == []


@pytest.mark.parametrize("copies", [[4, 10, 17], [1, 5, 6, 7, 13, 14]])
def test_forces_copied_from_the_row_before(copies):
    """Each row has what the one before it should read, three in succession or not."""
    head, rows = table(files(2), "loads.csv")
    force = [row[2] for row in rows]
    for k in copies:
        rows[k][2] = force[k - 1]
    made = case(written(files(2), "loads.csv", head, rows))

    (found,) = scale_rows(asked(made))

    assert found.name == "copied_column"
    assert found.at == tuple(f"loads.csv:{k + 2}" for k in copies)
    assert len(found.correct(made).loads) == PULLS - len(copies)


def test_another_zero_of_the_scale_is_no_unit():
    """Some of these forces are too small by the factor of a unit."""
    right = case(files(2))
    loads = right.loads
    off = loads["force_n"].where(loads["pose"].isin([3, 4]), 0.0).min()
    low = loads["force_n"].where(~loads["pose"].isin([3, 4]), loads["force_n"] - 0.775 * off)
    assert scale_rows(asked(replace(right, loads=loads.assign(force_n=low)))) == []


@pytest.mark.sampled(1)
@pytest.mark.parametrize("pose", [2, 5, 8])
def test_forces_of_one_pose_that_are_ten_times_too_large(pose):
    """Newtons below a title in kilograms: they outweigh no other pull."""
    right = small(4, poses={"count": 15})
    force, mine = right.loads["force_n"], right.loads["pose"] == pose
    loads = right.loads.assign(force_n=force.where(~mine, force * NEWTONS["kgf"]))

    (found,) = scale_rows(asked(replace(right, loads=loads)))

    assert (found.where, found.since, found.at) == ("n", None, lines_of(right.loads[mine]))
    assert np.allclose(found.correct(replace(right, loads=loads)).loads["force_n"], force)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("base", [False, True])
@pytest.mark.parametrize(("unit", "factor"), [("inch", 25.4), ("m", 1000.0)])
def test_coordinates_in_another_unit_from_some_pose_on(unit, factor, base):
    """The last round of the base with them or still right: unit, line and coordinates."""
    head, rows = table(files(3), "tracker.csv")
    first = next(k for k, row in enumerate(rows) if "pose05" in row[0])
    last = len(rows) if base else next(k for k, row in enumerate(rows) if row[0] == "base_end")
    new = [
        [*row[:2], *(repr(float(x) / factor) for x in row[2:5]), *row[5:]]
        if first <= k < last
        else row
        for k, row in enumerate(rows)
    ]
    made = written(files(3), "tracker.csv", head, new)

    (found,) = unit_since(asked(case(made)))

    assert (found.name, found.where) == ("unit_mixup", unit)
    assert found.since == f"tracker.csv:{first + 2}"
    assert found.at == tuple(f"tracker.csv:{k + 2}" for k in range(first, last))
    same(found.correct(case(made)), case(files(3)))


def test_coordinates_in_another_unit_in_some_poses_have_no_row_since_which():
    """Poses 3 and 4 in inches: their groups, and none of the others."""
    head, rows = table(files(3), "tracker.csv")
    wrong = [k for k, row in enumerate(rows) if row[0][:6] in ("pose03", "pose04")]
    new = [
        [*row[:2], *(repr(float(x) / 25.4) for x in row[2:5]), *row[5:]] if k in wrong else row
        for k, row in enumerate(rows)
    ]
    made = written(files(3), "tracker.csv", head, new)

    (found,) = unit_since(asked(case(made)))

    assert (found.where, found.since) == ("inch", None)
    assert found.at == tuple(f"tracker.csv:{k + 2}" for k in wrong)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(10))
def test_joint_values_in_radians_from_some_row_on(seed):
    """Among degrees: the rows are named, and each pose has its own joint values again."""
    head, rows = table(files(seed), "joints.csv")
    new = [
        row[:2] + [f"{np.deg2rad(float(x)):.9f}" for x in row[2:8]] + row[8:] if k > 3 else row
        for k, row in enumerate(rows)
    ]
    made = written(files(seed), "joints.csv", head, new)

    (found,) = unit_since(asked(case(made)))

    assert (found.where, found.since) == ("rad", "joints.csv:6")
    same(found.correct(case(made)), case(files(seed)))


def test_where_nothing_tells_no_pose_is_in_its_place():
    """If the effector is nowhere near its readings, the log proves no unit."""
    given = case(files(0))
    turned = {name: 57.3 * given.joints[name] for name in given.joint_columns[1:7]}

    assert misplaced(given) == frozenset()
    assert misplaced(replace(given, joints=given.joints.assign(**turned))) is None


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(30))
def test_a_clean_campaign_changes_no_unit(seed):
    """Whatever the hidden effects of its machine."""
    assert unit_since(asked(case(files(seed)))) == []
    assert scale_rows(asked(case(files(seed)))) == []


def test_coordinates_in_another_unit_from_the_middle_of_a_group_on():
    """The chain's second reflector of a pull is the first in inches: no error of the chain."""
    head, rows = table(files(3), "tracker.csv")
    first = next(k for k, row in enumerate(rows) if row[1] == "Pl2" and "pose05" in row[0])
    new = [
        [*row[:2], *(repr(float(x) / 25.4) for x in row[2:5]), *row[5:]] if k >= first else row
        for k, row in enumerate(rows)
    ]
    made = written(files(3), "tracker.csv", head, new)

    (found,) = unit_since(asked(case(made)))

    assert (found.where, found.since) == ("inch", f"tracker.csv:{first + 2}")
    same(found.correct(case(made)), case(files(3)))


@pytest.mark.parametrize("column", [5, 6])
def test_the_sign_of_a_joint_changes_in_mid_file(column):
    """From the third row on: the line, the joint and the values of its column."""
    head, rows = table(files(3), "joints.csv")
    new = [
        [*row[:column], repr(-float(row[column])), *row[column + 1 :]] if k >= 3 else row
        for k, row in enumerate(rows)
    ]
    made = written(files(3), "joints.csv", head, new)

    (found,) = unit_since(asked(case(made)))

    assert (found.name, found.where) == ("sign_or_convention", f"theta{column}_reversed")
    assert found.since == "joints.csv:5"
    same(found.correct(case(made)), case(files(3)))


def test_of_two_units_that_hardly_differ_both_are_stated():
    """A kilogram-force is 2 % less than ten newtons, and the factor is that of the better one."""
    head, rows = table(files(3), "loads.csv")
    for k, row in enumerate(rows):
        row[2] = repr(float(row[2]) / (10.0 if k >= 12 else 1.0))
    given = case(written(files(3), "loads.csv", head, rows))
    (found,) = scale_rows(asked(given))
    assert (found.where, found.instead) == ("dan", ("kgf",))
    assert "the numbers of the scale are daN or kgf and were read as N" in found.evidence
    same(found.correct(given), case(files(3)))
    entry = mistake_entry(found, None)
    assert entry.probability == entry.rivals[0].probability == 0.5
    assert (entry.where, entry.rivals[0].where) == ("dan", "kgf")
