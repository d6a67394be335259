"""Exchanged groups and rows: files are rewritten, and the right order is found again."""

from dataclasses import replace
from functools import cache, lru_cache

import numpy as np
import pytest
from anchored_campaign import Anchored
from small_case import asked

from pipeline.faults import screen
from pipeline.faults.assignment import Ring, in_words, misplacement, rings
from pipeline.faults.base_names import base_names
from pipeline.faults.conventions import conventions
from pipeline.faults.exchanged import exchanged
from pipeline.faults.exchanged_pulls import _happens, exchanged_pulls, misfit
from pipeline.faults.labels import CHAIN
from pipeline.faults.scale_rows import scale_rows
from pipeline.reduction.bring import bring
from pipeline.run import ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

SEEDS = range(10)
"""Campaigns of each kind of game."""

POSES = 7


@cache
def files(seed):
    """A campaign of seven poses with three load steps, of a machine other than the paper's."""
    odd = {"effects": ["joint_lost_motion:2"]} if seed % 2 else {}
    plan = Plan(
        name="right", seed=seed, poses={"count": POSES}, hidden={"stiffness_spread": 0.3, **odd}
    )
    return dict(simulate(plan).files)


def case(made):
    return _case(frozenset(made.items()))


@lru_cache(100)
def _case(made):
    """As ingested; most tests compare a campaign with what it was before it was spoilt."""
    return ingested(in_memory(dict(made)), plausible=False)


def table(made, name):
    head, *rows = made[name].decode().splitlines()
    return head, [row.split(",") for row in rows]


def written(made, name, head, rows):
    return made | {name: ("\n".join([head, *(",".join(row) for row in rows)]) + "\n").encode()}


def reordered(made, name, columns, order):
    """A log whose row i has the cells of row `order[i]` in some columns."""
    head, rows = table(made, name)
    new = [list(row) for row in rows]
    for i, k in enumerate(order):
        for column in columns:
            new[i][column] = rows[k][column]
    return written(made, name, head, new)


def regrouped(made, names, effector_only=False):
    """The export with the coordinates of some groups exchanged."""
    head, rows = table(made, "tracker.csv")
    of = {(row[0], row[1]): row[2:5] for row in rows}
    names = names | {b: a for a, b in names.items()}
    new = [
        row[:2] + of[names[row[0]], row[1]] + row[5:]
        if row[0] in names
        and (names[row[0]], row[1]) in of
        and not (effector_only and "l" in row[1])
        else row
        for row in rows
    ]
    return written(made, "tracker.csv", head, new)


def zeros(made, pose):
    """The unloaded groups of a pose."""
    names = dict.fromkeys(row[0] for row in table(made, "tracker.csv")[1])
    return [name for name in names if name.startswith(f"pose{pose:02d}") and "unloaded" in name]


def swapped(count, one, other):
    order = list(range(count))
    order[one], order[other] = other, one
    return order


def put_right(found, given):
    for one in found:
        given = one.correct(given)
    return given


def same(mine, right):
    """Whether two campaigns are equal, readings matched by what was read at the same place.

    The unit in which a log was written is no part of what it says.
    """
    for name, key in (("joints", ["pose"]), ("loads", ["pose", "repeat"])):
        aside = ["line", "file", *(["unit_n"] if name == "loads" else [])]
        a, b = (getattr(one, name).drop(columns=aside) for one in (mine, right))
        a, b = (one.sort_values(key).reset_index(drop=True) for one in (a, b))
        assert np.allclose(
            a.select_dtypes("number").to_numpy(float),
            b.select_dtypes("number").to_numpy(float),
            equal_nan=True,
        ), name
    assert stands(mine) == stands(right)


def stands(one):
    """What was read where, with pose and state."""
    rows = one.readings
    at = rows[["x_m", "y_m", "z_m"]].round(9).itertuples(index=False, name=None)
    names = ["group", "target", "pose", "repeat", "state"]
    said = rows[names].astype(str).itertuples(index=False, name=None)
    return sorted(zip(said, at, strict=True))


def told(found, made):
    """The lines named by mistakes, with their text in the files."""
    for one in found:
        for place in one.at:
            file, line = place.rsplit(":", 1)
            yield made[file].decode().splitlines()[int(line) - 1]


# --- rows of the joint log, groups of poses -------------------------------------------------------


@pytest.mark.parametrize(
    ("members", "words"),
    [
        ((2, 3), "pose02 and pose03"),
        ((2, 3, 4), "pose02 to pose04 (3)"),
        ((35, 54, 8), "pose08, pose35 and pose54"),
        ((9, 1, 7, 3, 20, 30, 40, 50), "pose01, pose03, pose07, pose09, pose20, pose30 and 2 more"),
    ],
)
def test_only_neighbours_are_said_as_a_range(members, words):
    """Three single poses are not all of those between the first and the last."""
    assert in_words(Ring(members), [f"pose{k:02d}" for k in members]) == words


def test_members_among_some_places_are_off_by_one_only_if_these_are_neighbours():
    """The first three of the misplaced poses, which are poses 8, 35 and 54, or 8 to 10."""
    assert misplacement(Ring((0, 1, 2)).among(np.array([8, 35, 54])), "pose") == (
        "in each other's place"
    )
    assert misplacement(Ring((0, 1, 2)).among(np.array([8, 9, 10])), "pose").startswith("one pose")


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", ["two", "off by one", "back by one", "shuffled"])
def test_rows_of_the_joint_log_are_put_back(seed, kind):
    """Two of them, all shifted by one, or shuffled: each pose has its own joint values again.

    So it has its own torques, which are logged in the same rows.
    """
    rng = np.random.default_rng(seed)
    one, other = rng.choice(POSES, 2, replace=False).tolist()
    order = {
        "two": swapped(POSES, one, other),
        "off by one": [*range(1, POSES), 0],
        "back by one": [POSES - 1, *range(POSES - 1)],
        "shuffled": rng.permutation(POSES).tolist(),
    }[kind]
    made = reordered(files(seed), "joints.csv", range(1, 9), order)

    found = exchanged(case(made))

    assert {one.name for one in found} == {"exchanged"}
    stand = {"off by one": "one row too early", "back by one": "one row too late"}.get(kind, "in ")
    assert all(f" stand {stand}" in one.evidence for one in found)
    rows, a3 = case(made).joints, case(made).joint_columns[3]
    torques = rows[["pose"]].assign(tau3=rows[a3])
    right = put_right(found, replace(case(made), torques=torques))
    same(right, case(files(seed)))
    assert right.torques.sort_values("pose")["tau3"].tolist() == right.joints[a3].tolist()
    wrong = {i + 1 for i, k in enumerate(order) if i != k}
    assert {int(row.split(",")[0]) for row in told(found, made)} == wrong


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_joint_log_without_its_first_row(seed):
    """Every pose has the row of the next one; pose 1 has none, and is left out.

    The torques of the last row, of a pose without readings, go with it.
    """
    head, rows = table(files(seed), "joints.csv")
    made = written(
        files(seed), "joints.csv", head, [[str(k), *row[1:]] for k, row in enumerate(rows[1:], 1)]
    )

    rows, a3 = case(made).joints, case(made).joint_columns[3]
    torques = rows[["pose"]].assign(tau3=rows[a3])
    right = put_right(exchanged(case(made)), replace(case(made), torques=torques))

    q = case(files(seed)).joints.set_index("pose")[right.joint_columns]
    mine = right.joints.set_index("pose")[right.joint_columns]
    assert sorted(mine.index) == [2, 3, 4, 5, 6]
    assert right.torques.set_index("pose")["tau3"].to_dict() == mine[a3].to_dict()
    assert np.allclose(mine, q.loc[mine.index])
    assert 1 not in set(right.readings["pose"].dropna())


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", ["pulls", "effector", "one pull", "zero"])
def test_groups_of_two_poses_are_put_back(seed, kind):
    """All pulls with or without the chain, one pull, or one zero: assigned to the right pose."""
    one, other = np.random.default_rng(seed).choice(POSES, 2, replace=False) + 1
    groups = {f"pose{one:02d}_rep{k}_loaded": f"pose{other:02d}_rep{k}_loaded" for k in (1, 2, 3)}
    if kind == "one pull":
        groups = {f"pose{one:02d}_rep1_loaded": f"pose{other:02d}_rep3_loaded"}
    if kind == "zero":
        groups = {zeros(files(seed), one)[1]: zeros(files(seed), other)[1]}
    made = regrouped(files(seed), groups, effector_only=kind == "effector")

    found = exchanged(case(made))

    assert [one.name for one in found] == ["exchanged"]
    same(put_right(found, case(made)), case(files(seed)))
    named = {row.split(",")[0] for row in told(found, made)}
    assert named == {*groups, *groups.values()}
    assert len(found[0].at) == 2 * len(groups) * (5 if kind in ("pulls", "one pull") else 3)


# --- forces, states of a pose ---------------------------------------------------------------------

PULLS = 3 * POSES


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", ["two", "steps", "off by one", "back by one"])
@pytest.mark.parametrize("seed", SEEDS)
def test_rows_of_the_loads_are_put_back(seed, kind):
    """Two of different steps, in one pose or not, or all shifted: each pull has its force again."""
    rng = np.random.default_rng(seed)
    one, other = rng.choice(POSES, 2, replace=False).tolist()
    order = {
        "two": swapped(PULLS, 3 * one, 3 * other + 1),
        "steps": swapped(PULLS, 3 * one, 3 * one + 1),
        "off by one": [*range(1, PULLS), 0],
        "back by one": [PULLS - 1, *range(PULLS - 1)],
    }[kind]
    made = reordered(files(seed), "loads.csv", [2], order)

    found = exchanged_pulls(asked(case(made)))

    assert [one.name for one in found] == ["exchanged"]
    same(put_right(found, case(made)), case(files(seed)))
    rows = [row for row in told(found, made) if "," in row and row[0].isdigit()]
    assert len(rows) == sum(i != k for i, k in enumerate(order))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("part", [0.9, 1.15, 3.0])
def test_one_mistyped_force_is_no_exchange(seed, part):
    """Another row may have nearly the same number; the value stays in its row."""
    head, rows = table(files(seed), "loads.csv")
    k = 3 * (seed % POSES) + 1
    rows[k][2] = f"{part * float(rows[k][2]):.2f}"
    made = written(files(seed), "loads.csv", head, rows)
    assert exchanged_pulls(asked(case(made))) == []


@pytest.mark.sampled(2)
@pytest.mark.parametrize("first", range(PULLS - 2))
def test_a_force_copied_over_three_rows_is_no_exchange(first):
    """What two of them should read is in no other row."""
    order = [first if first < i < first + 3 else i for i in range(PULLS)]
    given = case(reordered(files(0), "loads.csv", [2], order))
    few = replace(given, loads=given.loads[lambda t: t["pose"].between(*_three(first))])
    for copied in scale_rows(asked(few)):
        assert copied.name == "copied_column"
        few = copied.correct(few)
    assert exchanged_pulls(asked(few)) == []


def _three(first):
    """Three poses around a pull of the log, which is numbered from 0."""
    begin = int(np.clip(first // 3, 1, POSES - 2))
    return begin, begin + 2


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", SEEDS)
def test_two_steps_name_the_groups_that_may_be_meant_instead(seed):
    """Exchanging the groups or the rows of two steps is equivalent: all lines are named."""
    pair = {"pose04_rep1_loaded": "pose04_rep2_loaded"}
    made = regrouped(files(seed), pair)

    (found,) = exchanged_pulls(asked(case(made)))

    assert found.where == "pose04_rep1_loaded/pose04_rep2_loaded"
    lines = list(told([found], made))
    assert len(lines) == 2 + 10
    assert sum(line.startswith("4,") for line in lines) == 2
    f = found.correct(case(made)).loads.set_index(["pose", "repeat"])["force_n"]
    given = case(made).loads.set_index(["pose", "repeat"])["force_n"]
    assert (f[4, 1], f[4, 2]) == (given[4, 2], given[4, 1])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("which", [0, 1])
def test_an_unloaded_group_and_a_pull_are_put_back(seed, which):
    """The zero before or after the pulls has the readings of the effector under load."""
    made = regrouped(files(seed), {zeros(files(seed), 3)[which]: "pose03_rep2_loaded"})

    found = exchanged_pulls(asked(case(made)))

    assert [one.where for one in found] == [
        "/".join(sorted([zeros(files(seed), 3)[which], "pose03_rep2_loaded"]))
    ]
    same(put_right(found, case(made)), case(files(seed)))
    assert len(found[0].at) == 6


# --- base reflectors ------------------------------------------------------------------------------

EVEN = {"B1": (0.6, -0.5, -0.30), "B2": (0.6, 18.5, -0.30), "B3": (-0.6, 18.5, -0.28)}
LAYOUTS = {
    "a rectangle": EVEN | {"B4": (-0.6, -0.5, -0.28)},
    "uneven": {"B1": (0.6, -0.5, -0.3), "B2": (0.9, 17.1, 0.4), "B3": (-0.6, 18.5, -0.28),
               "B4": (-1.3, 2.5, 0.1)},
    "three": {"B1": (0.6, -0.5, -0.3), "B2": (0.9, 17.1, 0.4), "B3": (-1.3, 2.5, 0.1)},
}  # fmt: skip


@pytest.mark.sampled(4)
@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("order", [(1, 0, 2, 3), (2, 1, 0, 3), (1, 2, 3, 0), (2, 3, 0, 1)])
def test_places_of_base_reflectors_are_put_back(layout, order):
    """Two exchanged, or all shifted by one or two, whether or not distances determine it."""
    base = LAYOUTS[layout]
    names = list(base)
    order = [k % len(names) for k in order[: len(names)]]
    if sorted(order) != list(range(len(names))):
        order = [1, 2, 0]
    plan = Plan(name="base", seed=2, base_frame=base, poses={"count": 4})
    right = case(simulate(plan).files)
    stated = {name: base[names[k]] for name, k in zip(names, order, strict=True)}
    given = right.settings.model_copy(update={"base_frame": stated})

    (found,) = base_names(case_with(right, given))

    assert found.name == "label_swap"
    assert found.correct(case_with(right, given)).settings.base_frame == base
    assert base_names(right) == []


def case_with(given, settings):
    return replace(given, settings=settings)


# --- nothing is wrong -----------------------------------------------------------------------------


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(30))
def test_a_clean_campaign_has_nothing_exchanged(seed):
    """Also with equal repeats, or a machine other than the paper's."""
    given = case(files(seed))
    assert exchanged(given) == exchanged_pulls(asked(given)) == base_names(given) == []


@pytest.mark.parametrize("seed", range(3))
def test_what_is_equal_cannot_be_exchanged(seed):
    """Equal rows of the joint log, or equal forces in other rows: nothing is reported."""
    made = reordered(files(seed), "joints.csv", range(1, 9), [0, 1, 2, 3, 4, 5, 5])
    assert exchanged(case(made)) == []
    _, rows = table(files(seed), "loads.csv")
    alike = [k for k, row in enumerate(rows) if row[1] == "1"]
    made = reordered(files(seed), "loads.csv", [2], swapped(PULLS, *alike[:2]))
    assert exchanged_pulls(asked(case(made))) == []


# --- the assignment -------------------------------------------------------------------------------


def test_a_move_must_be_worth_it_and_end_well():
    """A gain below the threshold moves nothing.

    A bad result rejects one ring, but not the others.
    """
    cost = np.array([[9.0, 0, 50, 50], [0, 9, 50, 50], [50, 50, 40, 3], [50, 50, 6, 40]])
    assert rings(cost, 10, 10) == [Ring((2, 3))]
    assert rings(cost, 5, 5) == [Ring((0, 1))]
    assert rings(cost, 5, 10) == [Ring((0, 1)), Ring((2, 3))]
    assert rings(np.zeros((3, 3)), 1, 1) == rings(np.zeros((1, 1)), 1, 1) == []


def test_a_row_too_few_leaves_one_without_a_place():
    """Each of four belongs one place later: the last has no place, and the first is empty."""
    cost = np.full((4, 4), 1e6)
    cost[[0, 1, 2], [1, 2, 3]] = 0.0
    (found,) = rings(cost, 10, 10)
    assert found == Ring((0, 1, 2, 3), ended=True)
    assert found.moves == [(0, 1), (1, 2), (2, 3)]
    assert found.by_one
    assert rings(cost[:3, :3], 10, 10) == []


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("step", [1, -1])
def test_forces_that_are_off_by_one_from_some_row_on(seed, step):
    """A line lost or duplicated in mid-file: all following rows are shifted back together."""
    since = 9 + seed % 4
    order = [*range(since), *(min(k + step, PULLS - 1) for k in range(since, PULLS))]
    made = reordered(files(seed), "loads.csv", [2], order)

    found = exchanged_pulls(asked(case(made)))

    assert len(found) == 1
    true, right = case(files(seed)).loads, put_right(found, case(made)).loads
    both = right.merge(true, on=["pose", "repeat"])
    assert both["force_n_x"].to_numpy() == pytest.approx(both["force_n_y"].to_numpy(), rel=0.05)
    assert len(both) >= PULLS - 1


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", SEEDS)
def test_forces_in_any_order_are_put_back(seed):
    """Each pull has the force of its step again, and every row that was wrong is named."""
    order = np.random.default_rng(seed).permutation(PULLS).tolist()
    made = reordered(files(seed), "loads.csv", [2], order)

    found = exchanged_pulls(asked(case(made)))

    true = case(files(seed)).loads["force_n"].to_numpy(float)
    given = case(made).loads["force_n"].to_numpy(float)
    right = put_right(found, case(made)).loads["force_n"].to_numpy(float)
    assert right == pytest.approx(true, rel=0.05)
    named = {int(row.split(",")[0]) * 10 + int(row.split(",")[1]) for row in told(found, made)}
    loads = case(made).loads
    key = loads["pose"].to_numpy(int) * 10 + loads["repeat"].to_numpy(int)
    assert set(key[np.abs(given / true - 1) > 0.1].tolist()) <= named


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", SEEDS)
def test_two_columns_of_the_joint_log_are_put_back(seed):
    """Any two revolute joints have exchanged values in all poses."""
    one, other = np.random.default_rng(seed).choice(range(2, 8), 2, replace=False).tolist()
    head, rows = table(files(seed), "joints.csv")
    for row in rows:
        row[one], row[other] = row[other], row[one]
    made = written(files(seed), "joints.csv", head, rows)

    (found,) = conventions(case(made))

    assert found.name == "exchanged"
    assert {int(row.split(",")[0]) for row in told([found], made)} == set(range(1, POSES + 1))
    same(found.correct(case(made)), case(files(seed)))


@pytest.mark.parametrize("targets", [1, 3])
def test_pulls_of_two_poses_that_are_all_there_is(targets):
    """The base reflectors reveal them, however few poses there are."""
    tool = {"load_point": (0.15, 0.0, 0.25), "P1": (0.2, 0.05, 0.12)}
    more = {"P2": (-0.12, 0.19, 0.10), "P3": (-0.10, -0.18, 0.22)} if targets > 1 else {}
    plan = Plan(name="two", seed=4, tool=tool | more, poses={"count": 2})
    right = dict(simulate(plan).files)
    made = regrouped(right, {"pose01_rep1_loaded": "pose02_rep1_loaded"})

    (found,) = exchanged(case(made))

    assert found.where == "pose01_rep1_loaded/pose02_rep1_loaded"
    same(found.correct(case(made)), case(right))
    assert exchanged(case(right)) == []


def test_a_bad_reading_tells_of_no_force():
    """One target is off in two pulls as if forces were exchanged: neither row is accused."""
    given = case(files(0))
    rows, xyz = given.readings, ["x_m", "y_m", "z_m"]
    new = rows[xyz].to_numpy(float).copy()
    group, target = rows["group"].astype(str), rows["target"].astype(str)
    measured, force = given.settings.measured, given.loads.set_index(["pose", "repeat"])["force_n"]
    for pose, repeat, meant in ((2, 1, force[5, 2]), (5, 2, force[2, 1])):
        moved = {}
        for name in measured:
            mine = (target == name).to_numpy()
            at = np.flatnonzero((group == f"pose{pose:02d}_rep{repeat}_loaded").to_numpy() & mine)
            zero = ((rows["pose"] == pose) & (rows["state"] == "unloaded")).to_numpy() & mine
            moved[name] = at, rows[xyz].to_numpy(float)[at] - new[zero].mean(axis=0)
        whole = sum(np.sum(d**2) for _, d in moved.values())
        at, d = moved["P1"]
        new[at] += (meant / force[pose, repeat] - 1) * whole / np.sum(d**2) * d

    spoilt = replace(given, readings=rows.assign(**dict(zip(xyz, new.T, strict=True))))

    assert exchanged_pulls(asked(spoilt)) == []


@pytest.mark.parametrize(
    ("members", "most", "happens"),
    [
        ((3, 9), False, True),  # two entries
        ((0, 4, 1, 5, 2, 6), False, True),  # all rows of one pose for all of another
        ((0, 5, 10, 14), False, False),  # a few rows of many poses
        ((0, 5, 10, 14), True, True),  # the same among most rows that stand elsewhere
    ],
)
def test_a_ring_of_few_rows_of_many_poses_is_no_exchange(members, most, happens):
    """A cause produces such rings in the poses it affects; no error in a log does."""
    pose = np.repeat(np.arange(4), 4)

    assert _happens(Ring(members), pose, most) is happens


def with_chain_turned(made, pose):
    """The ends of the chain under each other's name in all pulls of a pose."""
    head, rows = table(made, "tracker.csv")
    ends = {"Pl1": "Pl2", "Pl2": "Pl1"}
    here = f"pose{pose:02d}"
    new = [[row[0], ends.get(row[1], row[1]) if row[0][:6] == here else row[1]] for row in rows]
    return written(
        made, "tracker.csv", head, [one + row[2:] for one, row in zip(new, rows, strict=True)]
    )


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("seed", "pose"), [(3, 1), (2, 4)])
@pytest.mark.parametrize("late", [False, True], ids=["chain first", "chain last"])
def test_a_chain_that_is_turned_in_a_pose_exchanges_no_states(seed, pose, late, monkeypatch):
    """In whatever order it is asked: what spoils the pulls beside the others is dropped."""
    faults = [one for one in screen.FAULTS if one is not CHAIN]
    monkeypatch.setattr(screen, "FAULTS", [*faults, CHAIN] if late else [CHAIN, *faults])
    bad = case(with_chain_turned(files(seed), pose))
    got = screen.files_of(bad, bring(bad))
    assert [one.where for one in got.findings] == [
        f"pose{pose:02d}_rep{k}_loaded" for k in (1, 2, 3)
    ]
    assert {one.name for one in got.findings} == {"label_swap"}
    right = case(files(seed)).readings
    assert (got.case.readings["target"].astype(str) == right["target"].astype(str)).all()
    assert misfit(got.case) == misfit(case(files(seed)))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("pose", range(1, POSES + 1))
def test_a_chain_that_is_turned_in_one_pull_exchanges_no_states(pose):
    """As if its pull and the unloaded state were exchanged, but the other pulls say otherwise."""
    head, rows = table(files(3), "tracker.csv")
    ends, group = {"Pl1": "Pl2", "Pl2": "Pl1"}, f"pose{pose:02d}_rep1_loaded"
    turned = [[a, ends.get(b, b) if a == group else b, *c] for a, b, *c in rows]
    assert turned != rows
    assert exchanged_pulls(asked(case(written(files(3), "tracker.csv", head, turned)))) == []


@pytest.mark.parametrize("other", ["pose07_rep2", "pose08_rep1"])
def test_exchanged_groups_accuse_no_rows_of_the_loads_that_name_their_anchors(other):
    """The ends of their chains follow from the anchors: they are read in no group."""
    files = Anchored.of(12).files()
    lines = files["tracker.csv"].decode().splitlines()
    pair = [f"{other}_loaded", "pose02_rep2_loaded"]
    here = [k for k, line in enumerate(lines) if line.split(",")[0] in pair]
    turn = {pair[0]: pair[1], pair[1]: pair[0]}
    for k in here:
        group, rest = lines[k].split(",", 1)
        lines[k] = f"{turn[group]},{rest}"
    files["tracker.csv"] = "\n".join(lines).encode()
    case = ingested(in_memory(files), plausible=False)

    (found,) = exchanged(case)

    assert sorted(found.at) == sorted(f"tracker.csv:{k + 1}" for k in here)
    right = found.correct(case).readings
    chain = right[right["target"].isin(["Pl1", "Pl2"]) & right["group"].isin(pair)]
    assert {*chain["file"]} == {"loads.csv"}
    assert len(chain) == 4
