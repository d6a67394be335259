"""Names exchanged between two reflectors of one state: planted, found and corrected."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from small_case import asked

from bench.fuzz.catalogue import case as spoilt
from pipeline.faults.base_names import base_names
from pipeline.faults.chain import chain_gross, chain_outlier
from pipeline.faults.conventions import aligned
from pipeline.faults.labels import CHAIN, FAULT, chain_distances
from pipeline.run import ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

XYZ = ["x_m", "y_m", "z_m"]
PLAN = Plan(name="good", seed=11, poses={"count": 5}, pulls={"steps_n": [1500.0, 3000.0]})


def labels(case):
    """What both tests of names find, of the effector's reflectors and of the chain's."""
    return [*FAULT.find(asked(case)), *CHAIN.find(asked(case))]


@cache
def good():
    """A campaign of five poses, two pulls in each, in which nothing is wrong."""
    return ingested(in_memory(simulate(PLAN).files), plausible=False)


def written(group, names):
    """The campaign with targets of some groups renamed."""
    rows = good().readings
    mine = rows["group"].isin([group] if isinstance(group, str) else group)
    said = [names.get(t, t) if m else t for t, m in zip(rows["target"], mine, strict=True)]
    return replace(good(), readings=rows.assign(target=said))


def moved(group, target, by):
    """The campaign with one reading displaced [m]."""
    rows = good().readings.copy()
    row = (rows["group"] == group) & (rows["target"] == target)
    assert row.sum() == 1
    rows.loc[row, XYZ] = rows.loc[row, XYZ].to_numpy(float) + by
    return replace(good(), readings=rows)


def test_where_the_joint_log_is_wrong_no_name_is_doubted():
    """A column read with the wrong factor displaces reflectors by hundreds of millimetres."""
    for factor in (np.pi / 180, 0.5, 1.2):
        joints = good().joints.copy()
        joints["theta4_rad"] *= factor
        assert labels(replace(good(), joints=joints)) == []


RING, BACK = {"P1": "P2", "P2": "P3", "P3": "P1"}, {"P1": "P3", "P3": "P2", "P2": "P1"}


@pytest.mark.parametrize(
    ("group", "names"),
    [
        ("pose02_rep0_unloaded", {"P1": "P2", "P2": "P1"}),
        ("pose02_rep0_unloaded", RING),
        ("pose02_rep0_unloaded", BACK),
        ("pose05_rep2_loaded", {"P1": "P3", "P3": "P1"}),
        ("pose05_rep2_loaded", BACK),
        ("pose05_rep2_loaded", {"Pl1": "Pl2", "Pl2": "Pl1"}),
    ],
    ids=["two", "ring", "ring back", "two loaded", "ring loaded", "chain"],
)
def test_names_exchanged_in_one_state_are_found_and_put_back(group, names):
    """Unloaded or loaded, two or three of them: each reading gets its own name again."""
    bad = written(group, names)

    (found,) = labels(bad)

    assert (found.name, found.where) == ("label_swap", group)
    right = found.correct(bad).readings
    assert (right["target"].astype(str) == good().readings["target"].astype(str)).all()
    assert found.before > found.after
    assert all(name in found.evidence for name in names)
    raw = simulate(PLAN).files["tracker.csv"].decode().splitlines()
    told = [raw[int(at.removeprefix("tracker.csv:")) - 1] for at in found.at]
    assert len(told) == len(names)
    assert all(group in line for line in told)
    assert {name for name in names for line in told if name in re.split(r"\W+", line)} == {*names}
    assert f"({', '.join(found.at)})" in found.evidence


@pytest.mark.parametrize("names", [{"B1": "B3", "B3": "B1"}, {"B1": "B2", "B2": "B3", "B3": "B1"}])
def test_base_reflectors_misnamed_in_one_round_are_put_back_there(names):
    """In the last of two rounds alone; the other round and [base_frame] are left as they are."""
    rounds = good().readings.loc[good().readings["pose"].isna(), "group"].unique()
    assert len(rounds) > 1
    bad = written(rounds[-1], names)

    (found,) = base_names(bad)

    assert (found.name, found.where) == ("label_swap", f"{rounds[-1]} {'-'.join(sorted(names))}")
    assert len(found.at) == len(names)
    right = found.correct(bad)
    assert right.settings == bad.settings
    assert (right.readings["target"].astype(str) == good().readings["target"].astype(str)).all()


def test_good_names_are_left_alone():
    """Nothing is found if nothing is wrong; two poses are told by the base reflectors alone."""
    assert labels(good()) == base_names(good()) == []
    few = good().joints["pose"] <= 2
    assert labels(replace(good(), joints=good().joints[few])) == []
    bad = written("pose02_rep0_unloaded", {"P1": "P2", "P2": "P1"})
    bad = replace(bad, joints=good().joints[few])
    assert [one.where for one in labels(bad)] == ["pose02_rep0_unloaded"]
    bare = bad.settings.model_copy(update={"base_frame": {}})
    assert labels(replace(bad, settings=bare)) == []


def test_two_states_are_two_findings():
    """Each with its own names, and each is corrected separately."""
    bad = written(["pose01_rep1_loaded", "pose04_rep0_unloaded"], {"P2": "P3", "P3": "P2"})

    found = labels(bad)

    assert [one.where for one in found] == ["pose01_rep1_loaded", "pose04_rep0_unloaded"]
    (left,) = labels(found[0].correct(bad))
    assert left.where == "pose04_rep0_unloaded"
    assert labels(found[1].correct(found[0].correct(bad))) == []


def test_a_reading_that_is_only_off_is_no_exchange():
    """Half a metre from everything, or twenty millimetres from its place: left to another test."""
    assert labels(moved("pose03_rep0_unloaded", "P1", [0.5, 0.5, 0.5])) == []
    assert labels(moved("pose03_rep0_unloaded", "P1", [0.01, -0.01, 0.014])) == []


def test_a_chain_that_is_the_wrong_way_round_everywhere_is_no_exchange():
    """If the ends are named that way in most groups, that is the convention."""
    loaded = [g for g in good().readings["group"].unique() if g.endswith("_loaded")]
    swap = {"Pl1": "Pl2", "Pl2": "Pl1"}

    assert labels(written(loaded, swap)) == []
    assert labels(written(loaded[:-3], swap)) == []
    assert {one.where for one in labels(written(loaded[:3], swap))} == set(loaded[:3])


def test_an_exchange_leaves_the_ends_as_far_apart_as_they_are():
    """And hung as in the other pulls: one displaced end is not an exchange."""
    table = chain_distances(good(), *aligned(good())).set_index("group")
    group = table.index[0]
    rows = good().readings.set_index(["group", "target"])
    near, far = (rows.loc[(group, end), XYZ].to_numpy(float) for end in ("Pl1", "Pl2"))
    gap = float(np.linalg.norm(far - near))
    along = (far - near) / gap

    assert labels(moved(group, "Pl1", (gap + 0.04) * along)) == []
    assert labels(moved(group, "Pl1", 3 * gap * along)) == []
    assert labels(moved(group, "Pl1", (2 * gap + 0.04) * along)) == []
    assert labels(moved(group, "Pl1", (2 * gap + 0.02) * along)) == []
    (found,) = labels(written([group], {"Pl1": "Pl2", "Pl2": "Pl1"}))
    assert found.before > found.after


@pytest.fixture
def at_several_places():
    """The campaign with the far end of four pulls fixed nearer by, along the straight chain."""
    rows = good().readings.copy()
    groups = [f"pose0{k}_rep1_loaded" for k in (1, 2, 3, 5)]
    for group, share in zip(groups, (0.4, 0.6, 0.75, 0.5), strict=True):
        near, far = (
            rows.index[(rows["group"] == group) & (rows["target"] == one)][0] for one in ENDS
        )
        a, b = (rows.loc[k, XYZ].to_numpy(float) for k in (near, far))
        rows.loc[far, XYZ] = a + share * (b - a)
    return replace(good(), readings=rows), groups


ENDS = ("Pl1", "Pl2")


def test_ends_that_are_fixed_elsewhere_along_the_chain_are_no_mistake(at_several_places):
    """Their line passes the load point as all do; a reading off that line is still named."""
    case, groups = at_several_places
    assert [*labels(case), *chain_gross(case), *chain_outlier(case)] == []

    rows = case.readings.copy()
    rows.loc[(rows["group"] == groups[1]) & (rows["target"] == "Pl2"), XYZ] += [0.0, 0.4, 0.5]
    (found,) = chain_gross(replace(case, readings=rows))
    assert found.where.startswith(groups[1])


def test_without_readings_of_a_chain_nothing_is_named():
    """As where payloads alone load the robot."""
    rows = good().readings
    case = replace(good(), readings=rows[~rows["target"].isin(ENDS)])
    assert [*labels(case), *chain_gross(case), *chain_outlier(case)] == []


def test_ends_that_are_fixed_elsewhere_may_be_exchanged(at_several_places):
    """Their distance is unlike the others, but they are on one line with the load point."""
    case, groups = at_several_places
    rows = case.readings
    other = dict(zip(ENDS, ENDS[::-1], strict=True))
    names = rows["target"].where(rows["group"] != groups[2], rows["target"].replace(other))
    (found,) = labels(replace(case, readings=rows.assign(target=names)))
    assert found.where == groups[2]
    assert "the names Pl1 and Pl2" in found.evidence


def test_an_exchange_puts_every_reading_that_it_renames_in_its_place():
    """Two wrong readings, one of which happens to be at the other's place, are not an exchange."""
    group, rows = "pose03_rep1_loaded", good().readings.set_index(["group", "target"])
    p1, p2 = (rows.loc[(group, end), XYZ].to_numpy(float) for end in ("P1", "P2"))
    both = good().readings.copy()
    here = both["group"] == group
    both.loc[here & (both["target"] == "P2"), XYZ] = p1 + np.array([0.005, 0.0, 0.0])
    both.loc[here & (both["target"] == "P1"), XYZ] = p1 + np.array([0.9, -0.3, 0.2])

    assert labels(replace(good(), readings=both)) == []
    swapped = written([group], {"P1": "P2", "P2": "P1"})
    assert [one.where for one in labels(swapped)] == [group]
    assert np.linalg.norm(p1 - p2) > 0.1


def test_a_target_and_an_end_of_the_chain_may_be_exchanged():
    """The end then hangs as it does in the other pulls."""
    group = "pose03_rep1_loaded"

    (found,) = labels(written([group], {"P1": "Pl1", "Pl1": "P1"}))

    assert found.where == group
    assert "Pl1" in found.evidence


def test_the_readings_are_aligned_though_some_are_misnamed():
    """Or displaced by half a metre: the rigid motion is that of the good readings."""
    R, t = aligned(good())
    swap = {"P1": "P2", "P2": "P1"}
    other = aligned(written(["pose02_rep0_unloaded", "pose04_rep0_unloaded"], swap))

    assert other[0] == pytest.approx(R, abs=1e-4)
    assert other[1] == pytest.approx(t, abs=1e-3)
    away = aligned(moved("pose03_rep0_unloaded", "P1", [0.5, 0.5, 0.5]))
    assert away[0] == pytest.approx(R, abs=1e-4)
    assert away[1] == pytest.approx(t, abs=1e-3)
    assert pytest.approx(np.eye(3)) == R @ R.T


def test_distances_of_the_chain_are_from_the_load_point():
    """Loaded groups only, in metres; unknown without an alignment."""
    table = chain_distances(good(), *aligned(good()))
    rows = good().readings
    assert sorted(table["group"]) == sorted(g for g in rows["group"].unique() if "_loaded" in g)
    ends = rows[rows["target"].isin(["Pl1", "Pl2"])].groupby("group")[XYZ]
    apart = ends.agg(np.ptp).pow(2).sum(axis=1).pow(0.5).loc[table["group"]]
    assert (table["far"] - table["near"]).to_numpy() == pytest.approx(apart.to_numpy(), rel=0.05)
    bare = good().settings.model_copy(update={"base_frame": {}})
    assert aligned(replace(good(), joints=good().joints[:2], settings=bare)) is None


def test_an_end_of_the_chain_that_is_named_in_a_round_of_the_base_is_no_exchange():
    """A round has no pose: a target and a base reflector, and an end of the chain, are mixed up."""
    mixed = ingested(in_memory(dict(spoilt(110946).files)), plausible=False)

    assert {one.name for one in labels(mixed)} <= {"label_swap"}


def test_chain_ends_exchanged_in_one_of_two_poses_are_named():
    """The base reflectors say where the load point was."""
    groups = ["pose02_rep1_loaded", "pose02_rep2_loaded"]
    bad = written(groups, {"Pl1": "Pl2", "Pl2": "Pl1"})
    few = replace(bad, joints=bad.joints[bad.joints["pose"] <= 2])

    assert [(one.name, one.where) for one in labels(few)] == [("label_swap", g) for g in groups]
