"""Names that two places share: the export is rewritten as by one slip at the instrument."""

from functools import cache

import pandas as pd
import pytest
from small_case import asked

from pipeline.answer.inputs import lost_told
from pipeline.faults.exchanged import exchanged
from pipeline.faults.named_twice import named_twice
from pipeline.run import ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

AT = ["file", "line", "pose", "repeat", "state"]


@cache
def files():
    """Six poses with two load steps each, zeros before and after that share one name."""
    plan = Plan(name="twice", seed=5, poses={"count": 6}, pulls={"steps_n": [1500.0, 3000.0]})
    made = dict(simulate(plan).files)
    head, *rows = made["tracker.csv"].decode().splitlines()
    cells = [row.split(",") for row in rows]
    for one in cells:
        if "unloaded" in one[0]:
            one[0] = f"{one[0][:6]}_rep0_unloaded"
    return made, head, cells


def with_names(name):
    """The campaign with each group named by `name` from its name."""
    made, head, cells = files()
    rows = [",".join([name(one[0]), *one[1:]]) for one in cells]
    export = {"tracker.csv": ("\n".join([head, *rows]) + "\n").encode()}
    return ingested(in_memory(made | export), plausible=False)


def with_poses(one, other, kind):
    """Groups of a kind in two poses under each other's name."""
    poses = {f"pose{one:02d}": f"pose{other:02d}", f"pose{other:02d}": f"pose{one:02d}"}
    return with_names(
        lambda group: poses.get(group[:6], group[:6]) + group[6:] if kind in group else group
    )


def test_zeros_that_share_a_name_are_rounds_where_the_pulls_between_bear_another():
    given = with_poses(2, 5, "_loaded")
    assert not len(given.rejected)
    assert given.lost.readings == 0
    assert len(given.readings) == len(files()[2])


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("one", "other"), [(2, 5), (1, 6), (3, 4)])
@pytest.mark.parametrize("kind", ["_loaded", "_unloaded"])
def test_two_poses_whose_groups_bear_each_others_name_are_named(one, other, kind):
    given = with_poses(one, other, kind)
    (found,) = exchanged(given)
    assert f"pose{one:02d}" in found.evidence
    assert f"pose{other:02d}" in found.evidence
    right = with_names(lambda group: group).readings
    moved = found.correct(given).readings
    pd.testing.assert_frame_equal(moved[AT].astype(str), right[AT].astype(str))


@pytest.mark.parametrize(("one", "other", "lost"), [(6, 1, 20), (3, 2, 26)])
def test_a_pose_under_the_name_of_another_is_named_and_said(one, other, lost):
    """Their pulls contradict, and zeros where one pose follows the other."""
    given = with_names(lambda group: group.replace(f"pose{one:02d}", f"pose{other:02d}"))
    (found,) = named_twice(asked(given))
    assert found.name == "exchanged"
    assert f"pose{other:02d}" in found.where
    assert found.correction == f"computed without pose {other}"
    left = found.correct(given)
    assert other not in set(left.readings["pose"].dropna()) | set(left.joints["pose"])
    (told,) = lost_told(given.lost)
    everything = len(files()[2])
    assert told.startswith(f"{lost} of {everything} readings were left out, all of pose {other};")


def shot_again(far_mm, repeats):
    """P1 of some pulls of pose 4 a second time, right after the first, some way off."""
    made, head, cells = files()
    rows = []
    for one in cells:
        rows.append(one)
        if one[1] == "P1" and one[0] in [f"pose04_rep{k}_loaded" for k in repeats]:
            rows.append([*one[:2], f"{float(one[2]) + far_mm:.4f}", *one[3:]])
    export = {"tracker.csv": ("\n".join([head, *(",".join(one) for one in rows)]) + "\n").encode()}
    return ingested(in_memory(made | export), plausible=False)


def test_a_shot_that_was_repeated_on_the_spot_is_no_mistake():
    given = shot_again(0.02, [1])
    assert given.lost.readings == 2
    assert not given.lost.poses
    assert not list(named_twice(asked(given)))
    assert list(named_twice(asked(shot_again(400.0, [1]))))


@pytest.mark.parametrize("repeat", [1, 2])
def test_a_pull_and_the_zeros_under_each_others_name_are_given_their_own(repeat):
    """Both rounds bear the pull's name; the chain, read in a pull alone, shows it."""
    names = [f"pose03_{one}" for one in ("rep0_unloaded", f"rep{repeat}_loaded")]
    other = dict(zip(names, reversed(names), strict=True))
    given = with_names(lambda group: other.get(group, group))
    (found,) = named_twice(asked(given))
    assert (found.name, found.where) == ("exchanged", "/".join(names))
    assert len(found.at) == sum(one[0] in names for one in files()[2])
    right = with_names(lambda group: group).readings
    pd.testing.assert_frame_equal(given.readings[AT].astype(str), right[AT].astype(str))
    assert list(given.readings["group"].astype(str)) == list(right["group"].astype(str))


def test_a_chain_that_hangs_in_every_zero_exchanges_no_name():
    """Its ends are read unloaded everywhere, and once missed in a pull."""
    made, head, cells = files()
    ends = [one for one in cells if one[1].startswith("Pl") and "rep1_loaded" in one[0]]
    slack = [[one[0].replace("rep1_loaded", "rep0_unloaded"), *one[1:]] for one in ends]
    taut = [one for one in cells if not (one[0] == "pose03_rep1_loaded" and one in ends)]
    export = "\n".join([head, *(",".join(one) for one in [*taut, *slack])]) + "\n"
    given = ingested(in_memory(made | {"tracker.csv": export.encode()}), plausible=False)
    assert given.renamed == ()
