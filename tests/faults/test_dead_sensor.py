"""Displacements that no robot makes and forces that no scale shows; dead weights are neither."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from small_case import asked
from test_exchanged import case, files, put_right, table, written

from pipeline.faults import dead_sensor as module
from pipeline.faults.conventions import conventions
from pipeline.faults.dead_sensor import dead
from pipeline.run import campaign_answer
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

RAW = Path(__file__).parents[2] / "data/raw"


def raw(name):
    return {one.name: one.read_bytes() for one in (RAW / name).iterdir()}


def moved(factor):
    """The FANUC campaign, which arrives reduced, with other displacements."""
    head, rows = table(raw("fanuc_r2000ic"), "displacements.csv")
    new = [row[:3] + [repr(factor * float(x)) for x in row[3:]] for row in rows]
    return written(raw("fanuc_r2000ic"), "displacements.csv", head, new)


def still(made, noise_mm, rng, poses=range(100), targets=None):
    """Loaded readings of some poses and targets that repeat the unloaded ones, with noise."""
    head, rows = table(made, "tracker.csv")
    zero, new = {}, []
    for row in rows:
        key = row[0][:6], row[1]
        if row[0].endswith("_unloaded"):
            zero.setdefault(key, np.array(row[2:5], float))
        dead_now = row[0].endswith("_loaded") and int(row[0][4:6]) in poses
        at = zero.get(key) if dead_now and row[1] in (targets or {row[1]}) else None
        off = None if at is None else at + noise_mm * rng.standard_normal(3)
        new.append(row if off is None else row[:2] + [f"{x:.4f}" for x in off] + row[5:])
    return written(made, "tracker.csv", head, new)


def with_forces(made, force):
    head, rows = table(made, "loads.csv")
    return written(made, "loads.csv", head, [[*row[:2], force, *row[3:]] for row in rows])


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("factor", [1e-9, 0.0, 1e-300])
def test_displacements_of_a_dead_sensor(factor):
    """Also in a campaign that arrives reduced: bad data, and no usable value."""
    said = campaign_answer("dead", in_memory(moved(factor))).answer

    assert str(said.diagnosis.verdict) == "bad_data"
    assert [one.name for one in said.diagnosis.causes] == ["dead_sensor"]
    assert "none of these stiffnesses" in " ".join(said.verdict_sentence)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("noise_mm", [0.0, 0.03, 0.1])
def test_readings_without_any_deflection(seed, noise_mm):
    """The effector is read unloaded in every state, with the noise of the instrument or more."""
    made = still(files(seed), noise_mm, np.random.default_rng(seed))
    assert [one.name for one in dead(asked(case(made)))] == ["dead_sensor"]


def lines_read(made, poses, targets):
    """Lines of the loaded readings of some poses and targets of the effector."""
    _, rows = table(made, "tracker.csv")
    wrong = (
        row[0].endswith("_loaded") and int(row[0][4:6]) in poses and row[1] in targets
        for row in rows
    )
    return {f"tracker.csv:{k}" for k, here in enumerate(wrong, start=2) if here}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("poses", [range(1, 3), range(3, 6), range(4, 8)])
@pytest.mark.parametrize("targets", [("P1", "P2", "P3"), ("P2",), ("P1", "P3")])
def test_a_sensor_that_is_dead_in_some_poses(seed, poses, targets):
    """Its lines and no others, whichever poses and targets they are of; the others are used."""
    made = still(files(seed), 0.03, np.random.default_rng(seed), poses, targets)

    found = dead(asked(case(made)))

    assert {one.name for one in found} == {"dead_sensor"}
    assert not any(one.hopeless for one in found)
    assert len(found) == (1 if len(targets) == 3 else len(targets))
    assert {line for one in found for line in one.at} == lines_read(made, poses, targets)
    right = put_right(found, case(made)).readings
    assert len(right) == len(case(made).readings) - len(lines_read(made, poses, targets))


@pytest.mark.parametrize("beside", [0.4, 1.0, 2.5])
def test_poses_beside_a_dead_run_may_be_stiffer_than_the_rest(monkeypatch, beside):
    """Its ends are found by the other readings only as far as these are like their neighbours."""
    rng = np.random.default_rng(4)
    follows = np.repeat([1.0, beside, 0.0, beside, 1.0], [18, 6, 8, 6, 18])
    moved_m = 1e-3 * rng.standard_normal((len(follows), 3))
    delta = follows[:, None] * moved_m + 1e-5 * rng.standard_normal(moved_m.shape)
    monkeypatch.setattr(module, "_as_read", lambda case, data: np.arange(len(data.delta)))
    monkeypatch.setattr(module, "_of_still", lambda case, data, moved, run: run.tolist())

    found = module._still(None, SimpleNamespace(delta=delta, poses=True), moved_m)

    assert found == [np.flatnonzero(follows == 0).tolist()]


def test_displacements_that_are_dead_from_some_pose_on():
    """In a campaign that arrives reduced: these rows are left out, the others are used."""
    head, rows = table(raw("fanuc_r2000ic"), "displacements.csv")
    last = max(int(row[0]) for row in rows)
    new = [row[:3] + ["0.0"] * 3 if int(row[0]) > last // 2 else row for row in rows]
    made = case(written(raw("fanuc_r2000ic"), "displacements.csv", head, new))

    (found,) = dead(asked(made))

    assert (found.name, found.hopeless) == ("dead_sensor", False)
    left = found.correct(made).displacements.to_pandas()
    assert sorted(set(left["pose"])) == [*range(1, last // 2 + 1)]


@pytest.mark.whole
def test_springs_beside_half_dead_readings_are_those_of_the_others():
    """One mistake; no tolerance and no value rests on the dead readings."""
    plan = Plan(name="half", seed=4, poses={"count": 14}, hidden={"stiffness_spread": 0.3})
    made = simulate(plan)
    true = {one["name"]: one["value"] for one in made.truth["stiffness"]}
    wrong = still(dict(made.files), 0.03, np.random.default_rng(4), range(8, 15))

    said = campaign_answer("half", in_memory(wrong)).answer

    assert str(said.diagnosis.verdict) == "bad_data"
    assert [one.name for one in said.diagnosis.causes] == ["dead_sensor"]
    off = [
        abs(one.compliance - 1 / true[one.name]) / one.compliance_std
        for one in said.stiffness
        if one.compliance_std
    ]
    assert len(off) >= 5
    assert max(off) < 4


def with_dead_scale(made, poses, rng):
    """Readings of some poses are a zero of 15 N and its noise."""
    head, rows = table(made, "loads.csv")
    zero = [f"{15 + 2 * one:.2f}" for one in rng.standard_normal(len(rows))]
    shown = [none if int(row[0]) in poses else row[2] for none, row in zip(zero, rows, strict=True)]
    new = [[*row[:2], n, *row[3:]] for n, row in zip(shown, rows, strict=True)]
    return written(made, "loads.csv", head, new)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("poses", [range(1, 3), range(3, 6), range(3, 8)])
def test_a_scale_that_is_dead_in_some_poses(seed, poses):
    """These rows, also if they are most of all, and no pull of other poses."""
    made = case(with_dead_scale(files(seed), poses, np.random.default_rng(seed)))

    (found,) = dead(asked(made))

    assert (found.name, found.where, found.hopeless) == ("dead_sensor", "loads.csv force", False)
    assert set(found.correct(made).loads["pose"]) == set(range(1, 8)) - set(poses)


@pytest.mark.parametrize("factor", [1 / 9.80665, 1e-3])
def test_forces_in_another_unit_are_no_dead_scale(factor):
    """Of all pulls, or of those from pose 4 on: they follow the displacements."""
    head, rows = table(files(2), "loads.csv")
    for first in (1, 4):
        new = [
            [*row[:2], str(float(row[2]) * (factor if int(row[0]) >= first else 1)), *row[3:]]
            for row in rows
        ]
        assert dead(asked(case(written(files(2), "loads.csv", head, new)))) == []


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(10))
def test_one_force_copied_down_the_column(seed):
    """Pulls of 1200, 3000 and 2000 N all logged as 1000 N: every row is named."""
    made = with_forces(files(seed), "1000.00")

    (found,) = dead(asked(case(made)))

    assert found.name == "copied_column"
    assert len(found.at) == 3 * 7
    assert found.hopeless


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("force", ["1200.00", "3000.00"])
def test_no_interval_beside_a_copied_force_misses_what_the_true_forces_give(seed, force):
    """Pulls of three sizes, logged as the smallest or the largest: no value, intervals hold."""
    _, rows = table(files(seed), "loads.csv")
    most = max(float(row[2]) for row in rows)
    made = with_forces(files(seed), force)
    right = campaign_answer("right", in_memory(files(seed))).answer.stiffness
    said = campaign_answer("copied", in_memory(made)).answer

    assert most > 2500
    assert [one.value for one in said.stiffness] == [None] * len(right)
    for one, true in zip(said.stiffness, right, strict=True):
        low, high = one.ci95 or (None, None)
        assert true.value is None or (low or 0.0) < true.value < (high or np.inf)


def test_a_force_copied_into_some_rows_leaves_the_others():
    """From pose 4 on the display was stuck: these pulls are left out."""
    head, rows = table(files(1), "loads.csv")
    new = [[*row[:2], "1987.6" if int(row[0]) > 3 else row[2], *row[3:]] for row in rows]
    made = written(files(1), "loads.csv", head, new)

    (found,) = dead(asked(case(made)))

    assert sorted(set(found.correct(case(made)).loads["pose"])) == [1, 2, 3]
    assert not found.hopeless


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("load", ["weights", "chain"])
def test_the_same_load_in_every_pull_is_no_copy(seed, load):
    """One weight in all poses; a chain always pulled to the same number."""
    pulls = {"load": "weights", "masses_kg": [150.0]} if load == "weights" else {}
    pulls |= {"steps_n": [2000.0], "repeats": 3, "setting_sd_n": 0.0}
    made = dict(simulate(Plan(name="same", seed=seed, poses={"count": 5}, pulls=pulls)).files)
    if load == "chain":
        made = with_forces(made, "2000.00")
    assert dead(asked(case(made))) == []


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(30))
def test_a_clean_campaign_has_no_dead_sensor(seed):
    """Nor one whose robot is three times as stiff as typical."""
    assert dead(asked(case(files(seed)))) == []


def test_campaigns_that_ship_have_no_dead_sensor():
    """Neither the demo nor the one that arrives reduced."""
    assert dead(asked(case(raw("kr500_demo")))) == dead(asked(case(raw("fanuc_r2000ic")))) == []


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("rows", [4, 7])
def test_one_row_of_the_joint_log_copied_down(seed, rows):
    """Its lines, and no usable value if it is copied to all; no unit explains a single point."""
    head, log = table(files(seed), "joints.csv")
    log[:rows] = [[row[0], *log[0][1:]] for row in log[:rows]]
    made = written(files(seed), "joints.csv", head, log)

    (found,) = dead(asked(case(made)))

    assert (found.name, found.hopeless) == ("copied_column", rows == 7)
    assert [int(one.rpartition(":")[2]) for one in found.at] == list(range(2, rows + 2))
    assert conventions(case(made)) == []
    left = set(found.correct(case(made)).joints["pose"])
    assert left == (set(range(rows + 1, 8)) or set(range(1, 8)))
    assert dead(asked(case(files(seed)))) == []


@pytest.mark.parametrize("column", [5, 6])
def test_a_column_copied_over_another(column):
    """Two joints are equal in every row."""
    head, rows = table(files(3), "joints.csv")
    new = [[*row[: column + 1], row[column], *row[column + 2 :]] for row in rows]
    found = dead(asked(case(written(files(3), "joints.csv", head, new))))

    (one,) = found
    names = f"theta{column}/theta{column + 1}"
    assert (one.name, one.where, one.hopeless) == ("copied_column", f"joints.csv {names}", True)
    assert f"theta{column} and theta{column + 1} are equal in every row" in one.evidence
