"""A reading stored twice under two names, and a lost lock, from the file to the finding."""

import csv
import io

import numpy as np
import pytest
from small_case import asked, screen

from pipeline.faults.stale_reading import repeated, stale
from pipeline.reduction.bring import bring
from pipeline.run import ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

PLAN = Plan(name="stale", poses={"count": 6}, pulls={"steps_n": [1000.0, 2000.0, 3000.0]})


@pytest.fixture(scope="module")
def files():
    """A clean campaign."""
    return simulate(PLAN, np.random.default_rng(5)).files


def written(files, wrong):
    """The campaign with changed rows of the export: index of a row -> coordinates [mm]."""
    rows = list(csv.reader(io.StringIO(files["tracker.csv"].decode())))
    for (group, target), of in wrong.items():
        (k,) = (k for k, row in enumerate(rows) if row[:2] == [group, target])
        rows[k][2:5] = ["0", "0", "0"] if of is None else rows[k + of][2:5]
    text = io.StringIO()
    csv.writer(text).writerows(rows)
    changed = {**files, "tracker.csv": text.getvalue().encode()}
    return ingested(in_memory(changed), plausible=False)


def named(case):
    return {one.where for one in screen(case, bring(case)).findings}


@pytest.mark.whole
def test_a_stale_end_of_a_chain_is_named_though_its_pull_is_left_out(files):
    """Pl2 repeats Pl1: file and line; the pull is not used."""
    case = written(files, {("pose03_rep2_loaded", "Pl2"): -1})

    (found,) = stale(case)

    assert found.where == "pose03_rep2_loaded/Pl2"
    assert "repeats that of Pl1" in found.evidence
    line = int(found.evidence.split("tracker.csv:")[1].split(")")[0])
    assert files["tracker.csv"].decode().splitlines()[line - 1].startswith("pose03_rep2_loaded,Pl2")
    assert found.correct(case) is case
    assert named(case) == {"pose03_rep2_loaded/Pl2"}
    assert stale(written(files, {})) == []


@pytest.mark.whole
def test_a_stale_target_is_named_once_by_where_it_stands(files):
    """It stays in the campaign until the tests of readings find it."""
    case = written(files, {("pose03_rep2_loaded", "P2"): -1})

    assert len(case.stale) == 1
    assert stale(case) == []
    assert named(case) == {"pose03_rep2_loaded/P2"}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("target", ["P1", "P2", "P3"])
@pytest.mark.parametrize("group", ["pose01_rep0_unloaded", "pose05_rep1_loaded"])
def test_a_failed_lock_is_no_wrong_unit(files, group, target):
    """Metres from its triangle in one state of many: the unit of the file is right."""
    assert named(written(files, {(group, target): None})) == {f"{group}/{target}"}


def again(files, group, of, targets, digits=None):
    """Targets of a group repeat those of an earlier one, in an export with fewer digits."""
    rows = list(csv.reader(io.StringIO(files["tracker.csv"].decode())))
    before = {row[1]: row[2:5] for row in rows if row[0] == of}
    for row in rows:
        if row[0] == group and row[1] in targets:
            row[2:5] = before[row[1]]
    if digits is not None:
        for row in rows[1:]:
            row[2:5] = [f"{float(x):.{digits}f}" for x in row[2:5]]
    text = io.StringIO()
    csv.writer(text).writerows(rows)
    changed = {**files, "tracker.csv": text.getvalue().encode()}
    return ingested(in_memory(changed), plausible=False)


EVERY = ("P1", "P2", "P3", "Pl1", "Pl2")


@pytest.mark.sampled(1)
@pytest.mark.parametrize("targets", [EVERY, ("P2",)])
def test_a_state_that_was_stored_twice_is_named_reading_by_reading(files, targets):
    """The force of that pull is right: nothing else is accused, and the later state is left out."""
    case = again(files, "pose03_rep2_loaded", "pose03_rep1_loaded", targets)

    found = screen(case, bring(case))

    assert {one.where for one in found.findings} == {f"pose03_rep2_loaded/{t}" for t in targets}
    assert all("repeats that of pose03_rep1_loaded" in one.evidence for one in found.findings)
    left = found.case.readings
    assert not ((left["group"] == "pose03_rep2_loaded") & left["target"].isin(targets)).any()


def test_equal_digits_say_nothing_where_they_are_few(files):
    """To 0.01 mm one target repeats itself by chance; five at once do not."""
    one = again(files, "pose03_rep2_loaded", "pose03_rep1_loaded", ("P2",), digits=2)
    five = again(files, "pose03_rep2_loaded", "pose03_rep1_loaded", EVERY, digits=2)

    assert repeated(asked(one)) == []
    assert {found.where for found in repeated(asked(five))} >= {
        f"pose03_rep2_loaded/{t}" for t in EVERY
    }


@pytest.mark.parametrize(("digits", "copies"), [(4, 0), (6, 5)])
def test_equal_digits_are_judged_by_the_scatter_of_the_file(files, digits, copies):
    """Metres read as millimetres: to 0.1 mm readings are equal by chance, to 1 um copies only."""
    rows = list(csv.reader(io.StringIO(files["tracker.csv"].decode())))
    for row in rows[1:]:
        row[2:5] = [f"{1e-3 * float(x):.{digits}f}" for x in row[2:5]]
    text = io.StringIO()
    csv.writer(text).writerows(rows)
    metres = {**files, "tracker.csv": text.getvalue().encode()}

    case = again(metres, "pose03_rep2_loaded", "pose03_rep1_loaded", EVERY)

    assert len(repeated(asked(case))) == copies


def test_base_reflectors_copied_from_the_first_round_are_named(files):
    """A motion of the tracker can then not be detected."""
    case = again(files, "base_end", "base_start", ("B1", "B2", "B3"))

    assert {found.where for found in repeated(asked(case))} == {f"base_end/B{k}" for k in (1, 2, 3)}


def test_data_without_noise_repeat_themselves(files):
    """For simulated data this is possible; readings with noise do not repeat themselves."""
    still = simulate(PLAN.without_noise(), np.random.default_rng(5)).files
    case = again(still, "pose03_rep2_loaded", "pose03_rep1_loaded", EVERY)

    assert repeated(asked(case)) == []
    assert repeated(asked(written(files, {}))) == []


def copied(files, source, copy):
    """The campaign with the readings of one group repeated under another name."""
    rows = list(csv.reader(io.StringIO(files["tracker.csv"].decode())))
    at = {(row[0], row[1]): k for k, row in enumerate(rows)}
    names = [target for group, target in at if group == copy and (source, target) in at]
    return written(files, {(copy, t): at[source, t] - at[copy, t] for t in names})


@pytest.mark.parametrize(
    ("source", "copy"),
    [
        ("pose03_rep3_loaded", "pose03_rep2_loaded"),
        ("pose03_rep2_loaded", "pose03_rep3_loaded"),
        ("pose05_rep1_loaded", "pose02_rep1_loaded"),
        ("pose02_rep1_loaded", "pose05_rep1_loaded"),
        ("pose02_rep1_loaded", "pose05_rep0_unloaded"),
    ],
)
def test_a_state_stored_under_another_name_is_the_copy(files, source, copy):
    """Its force or pose does not belong to it, whichever of both comes first."""
    found = repeated(asked(copied(files, source, copy)))

    assert {one.where.partition("/")[0] for one in found} == {copy}
    assert {one.where.partition("/")[2] for one in found} >= {"P1", "P2", "P3"}


@pytest.mark.parametrize("digits", [1, 2])
def test_an_anchor_that_stands_still_repeats_itself_by_chance(files, digits):
    """The far end of the chain is read at one place in many poses: equal digits are no copies."""
    rows = list(csv.reader(io.StringIO(files["tracker.csv"].decode())))
    rng, at = np.random.default_rng(8), {(row[0], row[1]): row for row in rows}
    ends = [key for key in at if key[1] == "Pl2"]
    place = np.array([float(x) for x in at[ends[0]][2:5]])
    new = {key: place + rng.normal(0, 0.01, 3) for key in ends}
    for key, row in at.items():
        if key in new:
            row[2:5] = [f"{x:.{digits}f}" for x in new[key]]
        elif key[0] != rows[0][0]:
            row[2:5] = [f"{float(x):.{digits}f}" for x in row[2:5]]
    text = io.StringIO(newline="")
    csv.writer(text).writerows(rows)
    changed = {**files, "tracker.csv": text.getvalue().encode()}

    found = repeated(asked(ingested(in_memory(changed), plausible=False)))

    assert not [one.where for one in found if one.where.endswith("/Pl2")]


def test_an_anchor_read_once_stands_for_every_pose(files):
    """Its reading is copied to all groups, with all digits; no pull is left out for that."""
    rows = list(csv.reader(io.StringIO(files["tracker.csv"].decode())))
    ends = [row for row in rows if row[1] == "Pl2"]
    for row in ends[1:]:
        row[2:5] = ends[0][2:5]
    text = io.StringIO(newline="")
    csv.writer(text).writerows(rows)
    changed = {**files, "tracker.csv": text.getvalue().encode()}

    found = repeated(asked(ingested(in_memory(changed), plausible=False)))

    assert not found
