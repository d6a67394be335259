"""Single readings: effect of a shift by repeated reduction, and its cost by leaving it out."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from small_case import asked, moved, small, uneven, where

from pipeline.faults import reading
from pipeline.faults.mistake import left_out
from pipeline.faults.reading import (
    bad_reading,
    lock_lost,
    outliers,
    shifted_readings,
    smallest,
)
from pipeline.machine.robot import configure
from pipeline.system import alarms
from pipeline.system.contrasts import stacked
from pipeline.system.score_tests import ScoreTests


@pytest.fixture(scope="module")
def given():
    """A campaign with one, two and three zeros to a pose, under test."""
    return asked(uneven(small(3)))


@pytest.fixture(scope="module")
def shifted(given):
    """Its readings as suspects."""
    return shifted_readings(given.case, given.reduced, given.zeros, given.system, given.estimate)


def rows_of(given, shifted, k):
    """Row of reading k in the table of readings, from the tables alone."""
    one, case = shifted.readings, given.case
    rows = case.readings[case.readings["pose"] == one.pose[k]]
    rows = rows[rows["target"] == case.settings.measured[one.target[k]]]
    if one.pull[k] >= 0:
        repeat = given.reduced.data.pulls.repeat[one.pull[k]]
        return rows.index[(rows["state"] == "loaded") & (rows["repeat"] == repeat)][0]
    return rows[rows["state"] == "unloaded"].sort_values("time").index[one.nth[k]]


def by_reducing_again(given, shifted, k):
    """Effect of a shift of one metre of a reading along each axis of F_b, (rows, 3)."""
    R = given.reduced.registration.R
    which = given.case.readings.index == rows_of(given, shifted, k)
    columns = []
    for axis in np.eye(3):
        other = asked(moved(given.case, which, R.T @ axis))
        # the same springs: only the readings differ
        delta = (other.reduced.data.delta - given.reduced.data.delta).ravel()
        stack = stacked(
            given.system, given.estimate.residual + delta, given.reduced.data, other.zeros,
            given.cell,
        )  # fmt: skip
        columns.append(stack.c - shifted.stack.c)
    return np.stack(columns, axis=1)


def dense(shifted):
    """Inverse Cholesky factor of the whole covariance of the rows."""
    G = shifted.stack.errors.G.toarray()
    return np.linalg.inv(np.linalg.cholesky(G @ G.T))


def left(X, y):
    """Residual sum of squares of numpy's least squares."""
    X = X / np.where(np.abs(X).max(axis=0) > 0, np.abs(X).max(axis=0), 1.0)
    return float(np.sum((y - X @ np.linalg.lstsq(X, y, rcond=1e-12)[0]) ** 2))


def test_every_reading_that_makes_a_row_is_a_suspect_once(given, shifted):
    """Every unloaded and loaded reading of a measured target that enters a row, and no other."""
    rows = given.case.readings
    rows = rows[rows["target"].isin(given.case.settings.measured) & rows["pose"].notna()]

    found = [rows_of(given, shifted, k) for k in range(len(shifted.readings.pose))]

    assert sorted(found) == sorted(rows.index)
    assert set(shifted.readings.of) == {1, 2, 3}


def test_a_shift_moves_the_rows_as_reducing_again_does(given, shifted):
    """Loaded readings, single zeros, and the first, second and last zero of three."""
    one = shifted.readings
    flat = shifted.blocks.rows(np.swapaxes(shifted.D, 1, 2))  # (reading, rows of its pose, 3)
    zeros = np.flatnonzero((one.pull < 0) & (one.target == 1) & (one.pose < 4))
    loaded = np.flatnonzero((one.pull >= 0) & (one.target == 2))[3]
    white = shifted.white
    assert sorted(one.of[zeros]) == [1, 2, 2, 3, 3, 3]
    for k in [*zeros[1:], loaded]:
        expected = white.by_pose(by_reducing_again(given, shifted, k))
        here = white.blocks.index == shifted.blocks.index[k]
        found = np.zeros_like(expected)
        found[here] = flat[k][white.blocks.place[here]]
        assert np.abs(found - expected).max() < 1e-7 * np.abs(expected).max()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("k", [0, 7, 13, 30, 41])
def test_the_drop_is_that_of_the_fit_without_the_reading(given, shifted, k):
    """Of a loaded reading by deleting its rows, of any by fitting its shift, with the whole V."""
    one = shifted.readings
    B = np.zeros((len(shifted.stack.c), given.system.B.shape[1]))
    B[: len(given.system.B)] = given.system.B
    found = shifted.beside(shifted.springs(given.system))
    W, c = dense(shifted), shifted.stack.c
    D = by_reducing_again(given, shifted, k)
    scale = np.abs(B).max(axis=0) + 1e-300
    before, after = left(W @ (B / scale), W @ c), left(W @ np.hstack([B / scale, D]), W @ c)
    assert found.rest == pytest.approx(before, rel=1e-6)
    assert found.drop[k] == pytest.approx(before - after, rel=1e-5)
    assert found.dof == len(c) - 7
    shift = np.linalg.lstsq(W @ np.hstack([B / scale, D]), W @ c, rcond=None)[0][-3:]
    assert found.size[k] == pytest.approx(shift, rel=1e-4, abs=1e-9)
    if one.pull[k] >= 0:
        kept = np.abs(D).max(axis=1) < 1e-6
        G = shifted.stack.errors.G.toarray()[kept]
        fewer = np.linalg.inv(np.linalg.cholesky(G @ G.T))
        assert found.drop[k] == pytest.approx(
            before - left(fewer @ (B[kept] / scale), fewer @ c[kept]), rel=1e-5
        )


def rigid(given, stack):
    """Six rigid motions of the effector about the origin of F_b in every row, (rows, 6)."""
    poses = np.unique(stack.pose)
    at = configure(given.case.robot, given.case.q(poses)).points(given.cell.tool.points)
    p = at[np.searchsorted(poses, stack.pose), stack.target]
    turn = np.stack([np.cross(axis, p) for axis in np.eye(3)], axis=2)
    n = np.arange(len(p))
    return np.hstack([np.eye(3)[stack.axis], turn[n, stack.axis]])


def own(shifted):
    """Inverse factor of the covariance without errors that poses share."""
    G = shifted.stack.errors.G.toarray()[:, ~shifted.stack.errors.common]
    return np.linalg.inv(np.linalg.cholesky(G @ G.T))


def test_a_free_stiffness_of_every_pose_is_what_dense_fits_make_of_it(given, shifted):
    """Six motions of each pose proportional to its force; zeros do not move."""
    stack = shifted.stack
    force = np.linalg.norm(given.reduced.data.pulls.force, axis=1)
    share = np.where(stack.pull < 0, 0.0, force[stack.pull])
    motions = rigid(given, stack) * share[:, None]
    X = np.hstack([motions * (stack.pose == pose)[:, None] for pose in np.unique(stack.pose)])
    W = own(shifted)
    base = shifted.poses_free(given.reduced.data)
    found = shifted.beside(base)

    before = left(W @ X, W @ stack.c)
    assert base.rest == pytest.approx(before, rel=1e-5)
    assert base.dof == len(stack.c) - np.linalg.matrix_rank(W @ X / np.abs(W @ X).max(axis=0))
    for k in (2, 20):
        D = by_reducing_again(given, shifted, k) * force.max()
        after = left(W @ np.hstack([X, D]), W @ stack.c)
        assert found.drop[k] == pytest.approx(before - after, rel=1e-4)


def test_free_pulls_are_what_dense_fits_make_of_them(given, shifted):
    """Six motions in each pull; rows between zeros belong to none."""
    stack = shifted.stack
    motions = rigid(given, stack)
    X = np.hstack(
        [motions * (stack.pull == pull)[:, None] for pull in range(int(stack.pull.max()) + 1)]
    )
    W = own(shifted)
    base = shifted.pulls_free(given.reduced.data)

    assert base.rest == pytest.approx(left(W @ X, W @ stack.c), rel=1e-5)
    assert base.dof == len(stack.c) - 6 * (int(stack.pull.max()) + 1)


def freer(normal, drop):
    """A freer model with this sensitivity to a shift along x, and this drop."""
    N = np.zeros((1, 3, 3))
    N[0, 0, 0] = normal
    g = np.array([[np.sqrt(drop * normal), 0.0, 0.0]])
    return ScoreTests(N, g, np.full((1, 3), normal), 1000.0, 50)


@pytest.mark.parametrize(
    ("normal", "drop", "seen", "said"),
    [
        (400.0, 101.0, False, True),
        (400.0, 99.0, False, False),
        (15.9, 0.0, False, True),
        (15.9, 15.9, True, False),
        (16.1, 0.0, False, False),
        (16.1, 4.1, True, True),
    ],
)
def test_a_freer_model_confirms_a_quarter_of_what_it_must_see(normal, drop, seen, said):
    """A shift of one: the expected drop there, and the fraction found."""
    unit = np.array([1.0, 0.0, 0.0])
    assert reading.confirmed(freer(normal, drop), 0, unit, 1.0, seen) is said
    assert reading.confirmed(freer(4 * normal, 4 * drop), 0, unit, 4.0, seen) is said
    assert reading.confirmed(freer(normal / 4, drop), 0, 2 * unit, 1.0, seen) is said


def find(case):
    found = reading.FAULT.find(asked(case))
    return found[0] if found else None


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("group", "target"),
    [
        ("pose04_rep1_loaded", "P2"),
        ("pose02_rep9_unloaded", "P1"),
        ("pose02_rep0_unloaded", "P3"),
    ],
)
def test_a_planted_shift_is_found_with_its_size(group, target):
    """0.6 mm of a loaded reading, of the third zero and of the first of a pose."""
    case = uneven(small(5))
    off = 6e-4 * np.array([2.0, -1.0, 2.0]) / 3

    found = find(moved(case, where(case, group, target), off))

    assert found.where == f"{group}/{target}"
    assert found.size == pytest.approx(6e-4, abs=4 * 3e-5 * np.sqrt(1.5))
    assert found.p_value < alarms.READING
    assert found.before > 8
    right = found.correct(case).readings
    assert len(right) == len(case.readings) - 1
    assert not ((right["group"] == group) & (right["target"] == target)).any()


def test_all_that_are_off_are_named_at_once():
    """A fifth of all loaded readings, 0.5 to 1.5 mm in any direction: all of them, no other."""
    case = small(7)
    rows, rng = case.readings, np.random.default_rng(3)
    own = (rows["state"] == "loaded") & rows["target"].isin(case.settings.measured)
    spoilt = rng.choice(rows.index[own], int(own.sum()) // 5, replace=False)
    for k in spoilt:
        way = rng.standard_normal(3)
        off = rng.uniform(5e-4, 1.5e-3) * way / np.linalg.norm(way)
        case = moved(case, rows.index == k, off)

    found = reading.FAULT.find(asked(case))

    names = {f"{rows.loc[k, 'group']}/{rows.loc[k, 'target']}" for k in spoilt}
    assert {one.where for one in found} == names
    assert len(spoilt) == 7
    for one in found:
        case = one.correct(case)
    assert find(case) is None


@pytest.mark.whole
def test_clean_draws_are_accused_no_more_often_than_the_rate(given, shifted, monkeypatch):
    """600 draws from the stated covariance: Bonferroni's bound holds, within a factor of three."""
    G = shifted.stack.errors.G
    rng, base = np.random.default_rng(8), shifted.springs(given.system)
    prior = shifted.white.with_priors
    smallest_p = []
    for _ in range(600):
        now = shifted.beside(base.against(prior(G @ rng.standard_normal(G.shape[1]))))
        best = int(np.argmax(now.drop))
        smallest_p.append(len(now.drop) * float(now.p(1.0, np.inf)[best]))
    share = np.mean(np.array(smallest_p) < 0.1)

    assert 0.04 < share < 0.1 + 3 * np.sqrt(0.1 * 0.9 / 600)

    # and the test itself, at a rate that a few campaigns can check
    monkeypatch.setattr(alarms, "READING", 0.2)
    monkeypatch.setattr(reading, "_SMALLEST_M", 0.0)
    accused = 0
    for _ in range(25):
        noise = shifted.stack.errors.G @ rng.standard_normal(G.shape[1])
        residual = noise[: len(given.system.B)]
        zeros = replace(given.zeros, delta=noise[len(given.system.B) :].reshape(-1, 3))
        estimate = replace(given.estimate, residual=residual)
        accused += bool(
            outliers(
                SimpleNamespace(
                    case=given.case, reduced=given.reduced, zeros=zeros, system=given.system,
                    estimate=estimate, cell=given.cell,
                )
            )
        )  # fmt: skip
    assert accused <= stats.binom.ppf(0.999, 25, 0.2)


def test_two_readings_alike_off_in_one_pull_are_no_single_one():
    """All three reflectors of a pull move together: not a single reading."""
    case = small(9)
    for target in ("P1", "P2", "P3"):
        case = moved(case, where(case, "pose03_rep1_loaded", target), [4e-4, 3e-4, -2e-4])

    assert find(case) is None


def test_nothing_below_the_smallest_is_reported(monkeypatch):
    """A significant shift of 0.07 mm in exact data is too small to be named, 0.09 mm is not."""
    case = small(11, tracker={"sigma_m": 2e-6})
    for off, named in ((7e-5, False), (9e-5, True)):
        found = find(moved(case, where(case, "pose04_rep1_loaded", "P2"), [off, 0, 0]))
        assert (found is not None) is named


def test_the_papers_tail_counts_where_any_covariance_is_the_papers(given):
    """Eq. (18) scatters along one direction by 0.03 mm: 4.9 times that, times the scale found."""
    placed = given.reduced.placed
    mixed = placed.assign(covariance_from=["paper"] + ["stated"] * (len(placed) - 1))

    assert smallest(placed, 3.0) == 8e-5
    assert smallest(mixed, 2.0) == pytest.approx(4.9 * 2 * reading.instrument.PAPER_SIGMA_M)


def test_a_finding_says_group_file_line_and_size(given):
    """What is needed to find it in the export, and the one row to remove."""
    row = given.reduced.placed.iloc[20]

    found = bad_reading(row, "all other readings", 1.5e-3, 12.34, 3.0)

    assert found.where == f"{row['group']}/{row['target']}"
    assert f"({row['file']}:{row['line']}) is 1.50 mm off" in found.evidence
    assert "12.3 standard deviations" in found.evidence
    assert (found.size, found.before, found.p_value) == (1.5e-3, 12.34, 1)
    left_over = found.correct(given.case).readings
    lost = given.case.readings.drop(left_over.index)
    assert lost[["group", "target"]].to_numpy().tolist() == [[row["group"], row["target"]]]


def test_metres_are_said_in_metres_and_thousands_of_sigmas_need_no_digits(given):
    """Nobody reads 123279.1 standard deviations."""
    row = given.reduced.placed.iloc[20]

    found = bad_reading(row, "all other readings", 4.98758, 123279.13)

    assert "is 4.99 m off" in found.evidence
    assert "more than 1000 standard deviations" in found.evidence


@pytest.mark.parametrize("recorded", [0.0, 1e-3])
def test_a_lost_lock_is_said_to_be_one(given, recorded):
    """The recorded value is (0, 0, 0), which is named as such."""
    row = given.reduced.placed.iloc[20]
    found = bad_reading(row, "all other readings", 5.0, 1e5)
    here = given.case.readings["line"] == row["line"]
    rows = given.case.readings.copy()
    rows.loc[here, ["x_m", "y_m", "z_m"]] = [0.0, recorded, 0.0]

    told = lock_lost(found, replace(given.case, readings=rows))

    assert told.evidence.startswith(found.evidence)
    assert ("after a lost lock" in told.evidence) is (recorded == 0.0)
    assert "lost" not in lock_lost(found, given.case).evidence


def test_only_the_line_of_its_own_file_goes(given):
    """Two files with the same line numbers."""
    rows = given.case.readings.assign(file=lambda t: t["file"].astype(str))
    rows.loc[rows.index[:50], "file"] = "other.csv"
    rows.loc[rows.index[60], "line"] = rows.loc[rows.index[5], "line"]

    kept = left_out(replace(given.case, readings=rows), [f"other.csv:{rows['line'].iloc[5]}"])

    assert set(rows.index) - set(kept.readings.index) == {rows.index[5]}


@pytest.mark.whole
def test_a_reading_stands_out_of_a_model_that_does_not_fit():
    """3 mm beside a backlash of four times the typical size, which alone accuses no reading."""
    spread = asked(small(3, hidden={"effects": ["rail_backlash=4x"]}))
    case = moved(spread.case, where(spread.case, "pose04_rep1_loaded", "P2"), [0, 3e-3, 0])

    found = find(case)

    assert found.where == "pose04_rep1_loaded/P2"
    assert found.size == pytest.approx(3e-3, rel=0.1)
    assert find(spread.case) is None


@pytest.mark.sampled(2)
@pytest.mark.parametrize("targets", [("P1", "P2"), ("P1", "P2", "P3")])
@pytest.mark.parametrize("alone", [False, True])
def test_several_of_one_pull_are_bad_unless_the_effector_moved(targets, alone):
    """Shifts that are not a rigid motion are of readings; a rigid motion is of the pull.

    If all three are off, one may be, with a motion of the pull in addition: that explains as much.
    """
    case, rng = small(9), np.random.default_rng(5)
    for target in ("P1", "P2", "P3") if not alone else targets:
        off = rng.uniform(-1e-3, 1e-3, 3) if alone else [6e-4, 3e-4, -5e-4]
        case = moved(case, where(case, "pose03_rep1_loaded", target), off)

    found = {one.where for one in reading.FAULT.find(asked(case))}

    true = {f"pose03_rep1_loaded/{t}" for t in targets} if alone else set()
    assert found <= true
    assert found == true or (found and len(targets) == 3)


def test_a_force_that_is_wrong_is_no_bad_reading():
    """All readings of its pull are right: the pull is named, and two bad readings with it."""
    case = small(13)
    loads = case.loads.copy()
    at = loads.index[(loads["pose"] == 2) & (loads["repeat"] == 1)]
    loads.loc[at, "force_n"] *= 1.3
    case = moved(replace(case, loads=loads), where(case, "pose05_rep2_loaded", "P1"), [0, 1e-3, 0])
    case = moved(case, where(case, "pose04_rep1_loaded", "P3"), [1e-3, 0, 0])

    found = {one.where for one in reading.FAULT.find(asked(case))}

    assert found == {"pose05_rep2_loaded/P1", "pose04_rep1_loaded/P3"}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("group", ["rep0_unloaded", "rep1_loaded", "rep3_unloaded"])
def test_an_effector_that_moved_as_one_is_no_bad_reading(group):
    """All three targets of a pull, or of either zero, shifted by the same vector."""
    case = small(9)
    for target in ("P1", "P2", "P3"):
        case = moved(case, where(case, f"pose03_{group}", target), [6e-4, 3e-4, -5e-4])

    assert reading.FAULT.find(asked(case)) == []


@pytest.mark.parametrize(("target", "state"), [("P2", "rep1_loaded"), ("P1", "rep0_unloaded")])
def test_a_zero_and_the_one_pull_read_from_it_are_named_together(target, state):
    """Only their difference is known: both lines are named, and neither is used."""
    case = small(3, poses={"count": 9}, pulls={"steps_n": [3000.0], "zero": "before"})
    case = moved(case, where(case, f"pose04_{state}", target), [2e-3, -1e-3, 1e-3])

    (found,) = outliers(asked(case))

    groups = ["pose04_rep0_unloaded", "pose04_rep1_loaded"]
    rows = case.readings[case.readings["group"].isin(groups) & (case.readings["target"] == target)]
    assert set(found.at) == {f"{f}:{n}" for f, n in zip(rows["file"], rows["line"], strict=True)}
    assert "nothing tells which" in found.evidence
    assert len(case.readings) - len(found.correct(case).readings) == 2


def test_a_zero_that_several_pulls_are_read_from_is_named_alone():
    """Three pulls distinguish it from each of them."""
    case = small(3, poses={"count": 9}, pulls={"steps_n": [1e3, 3e3, 2e3], "zero": "before"})
    case = moved(case, where(case, "pose04_rep0_unloaded", "P1"), [2e-3, -1e-3, 1e-3])

    (found,) = outliers(asked(case))

    assert found.where == "pose04_rep0_unloaded/P1"
    assert len(found.at) == 1


@pytest.mark.parametrize("target", ["P1", "P3"])
def test_of_two_pulls_that_are_off_the_pulls_are_named_and_their_zero_stated(target):
    """The zero and one of them would do as well, but for the larger error that is then left."""
    case = uneven(small(3))  # pose 3 has one zero
    off = {f"pose03_rep{k + 1}_loaded": 0.02 * np.eye(3)[k] for k in range(2)}
    for group, shift in off.items():
        case = moved(case, where(case, group, target), shift)

    found = outliers(asked(case))

    assert {one.where for one in found} == {f"{group}/{target}" for group in off}
    for one in found:
        assert [f"/{target}" in name for name in one.instead] == [True] * len(one.instead)
        assert any("unloaded" in name for name in one.instead)
