"""Base reflectors: one wrong reading or nominal position, against fits without it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy import optimize, stats
from scipy.spatial.transform import Rotation
from small_case import small

from pipeline.faults import reading
from pipeline.faults.base_reading import ONE_READING, SEVERAL_READINGS, base_outlier, shifts
from pipeline.faults.base_reflector import _freed, base_target
from pipeline.reduction.register import XYZ, agreeing, register
from pipeline.system import alarms

CORNERS = {"B1": [1, -0.5, -0.3], "B2": [1, 15, -0.3], "B3": [-1, 15, 0.2], "B4": [-1, -0.5, 0]}
SIX = ["cxx_m2", "cxy_m2", "cxz_m2", "cyy_m2", "cyz_m2", "czz_m2"]


@pytest.fixture(scope="module")
def case():
    """Four base reflectors read twice, each reading with its own full covariance."""
    made = small(4, base_frame=CORNERS)
    rows = made.readings[made.readings["pose"].isna()].copy()
    rng = np.random.default_rng(1)
    A = 2e-5 * (rng.standard_normal((len(rows), 3, 3)) * 0.3 + np.eye(3))
    C = A @ A.transpose(0, 2, 1)
    rows[SIX] = np.stack([C[:, i, j] for i, j in zip(*np.triu_indices(3), strict=True)]).T
    return next(draws(replace(made, readings=rows), 1, rng))


def spoiled(case, k, off):
    """One base reading shifted [m], tracker's frame."""
    rows = case.readings.copy()
    index = rows.index[rows["pose"].isna()][k]
    rows.loc[index, XYZ] = rows.loc[index, XYZ].to_numpy(float) + off
    return replace(case, readings=rows)


def renamed(case, name, off):
    """One nominal place shifted [m]."""
    base = {n: tuple(np.add(at, off if n == name else 0)) for n, at in CORNERS.items()}
    return replace(case, settings=case.settings.model_copy(update={"base_frame": base}))


def registered(case):
    return register(case.settings, case.readings)


def covariances(case):
    rows = case.readings[case.readings["pose"].isna()]
    C = np.empty((len(rows), 3, 3))
    for (i, j), name in zip(zip(*np.triu_indices(3), strict=True), SIX, strict=True):
        C[:, i, j] = C[:, j, i] = rows[name]
    return rows, C


def test_the_drop_is_that_of_the_tracker_placed_without_the_reading(case):
    """And the shift is the distance of the reading from its nominal place, seen by that tracker."""
    whole = registered(case)
    found = shifts(whole, 1.0, np.arange(len(whole.table)))
    double = shifts(whole, 2.0, np.arange(len(whole.table)))

    assert found.dof == whole.dof == 18
    assert found.rest == pytest.approx(whole.chi2, rel=1e-6)
    for k in (0, 3, 6):
        index = whole.table.index[k]
        less = register(case.settings, case.readings.drop(index))
        assert found.drop[k] == pytest.approx(whole.chi2 - less.chi2, rel=1e-4)
        assert double.drop[k] == pytest.approx(found.drop[k] / 4, rel=1e-9)
        row = case.readings.loc[index]
        seen = less.R @ row[XYZ].to_numpy(float) + less.t - CORNERS[row["target"]]
        assert found.size[k] == pytest.approx(seen, rel=1e-3, abs=1e-9)


def freely(case, name):
    """Sum of squares and shift of a nominal place, estimated by scipy with the tracker's pose."""
    rows, C = covariances(case)
    W = np.linalg.inv(np.linalg.cholesky(C))
    p = rows[XYZ].to_numpy(float)
    nominal = np.array([case.settings.base_frame[n] for n in rows["target"]])
    mine = (rows["target"] == name).to_numpy()[:, None] if name else np.zeros((len(p), 1))
    start = registered(case)

    def left(x):
        # readings are predicted in the tracker's frame, in which their covariances are given
        R = Rotation.from_rotvec(x[:3]).as_matrix() @ start.R
        predicted = (nominal + mine * x[6:] - start.t - x[3:6]) @ R
        return np.einsum("mij,mj->mi", W, p - predicted).ravel()

    got = optimize.least_squares(left, np.zeros(9), jac="3-point", x_scale="jac", xtol=1e-14)
    return 2 * got.cost, got.x[6:]


@pytest.mark.parametrize("name", ["B2", "B4"])
def test_a_free_nominal_place_is_what_scipy_makes_of_it(case, name):
    """All readings of a reflector off by the same, with the tracker's pose estimated."""
    wrong = renamed(case, name, np.array([2e-3, -1e-3, 5e-4]))
    registration = registered(wrong)

    rest, shift = _freed(wrong, registration, name)
    expected, off = freely(wrong, name)

    assert rest == pytest.approx(expected, rel=1e-5)
    assert shift == pytest.approx(off, abs=2e-8)
    which = np.array([int(n[1]) - 1 for n in registration.table["target"]])
    together = shifts(registration, 1.0, which)
    assert registration.chi2 - together.drop[int(name[1]) - 1] == pytest.approx(expected, rel=0.02)


def test_one_reading_that_is_off_is_named(case):
    """0.4 mm for one of eight: place, size, p and the row to be removed."""
    off = np.array([2e-4, -2e-4, 3e-4])
    wrong = spoiled(case, 5, off)
    row = wrong.readings[wrong.readings["pose"].isna()].iloc[5]

    (found,) = base_outlier(registered(wrong), 1.0)

    assert found.where == f"{row['group']}/{row['target']}"
    assert found.size == pytest.approx(np.linalg.norm(off), abs=8e-5)
    assert found.before**2 == pytest.approx(
        registered(wrong).chi2 - register(wrong.settings, wrong.readings.drop(row.name)).chi2,
        rel=1e-3,
    )
    assert found.p_value < alarms.READING
    right = found.correct(wrong)
    assert len(right.readings) == len(wrong.readings) - 1
    assert base_outlier(registered(right), 1.0) == []
    assert base_target(wrong, registered(wrong), 1.0) == []


def test_the_chance_of_a_reading_is_counted_for_all_of_them(case):
    """P for three coordinates, times the number of readings; larger scatter increases it."""
    wrong = spoiled(case, 2, np.array([0.0, 1.6e-4, 0.0]))
    whole = registered(wrong)
    index = whole.table.index[2]
    drop = whole.chi2 - register(wrong.settings, wrong.readings.drop(index)).chi2

    (found,) = base_outlier(whole, 1.0)
    assert found.p_value == pytest.approx(8 * stats.chi2.sf(drop, 3), rel=0.05)
    assert base_outlier(whole, 2.0) == []


def test_the_others_of_its_round_tell_how_noisy_it_was(case):
    """Their squares in standard uncertainties, by scipy's fit and its Jacobian without the reading.

    A coordinate that the fit absorbs tells nothing: those that are left are counted.
    """
    wrong = spoiled(case, 5, np.array([2e-4, -2e-4, 3e-4]))
    rows, C = covariances(wrong)
    kept = np.arange(len(rows)) != 5
    W, p = np.linalg.inv(np.linalg.cholesky(C[kept])), rows[XYZ].to_numpy(float)[kept]
    nominal = np.array([CORNERS[n] for n in rows["target"]])[kept]
    start = registered(case)

    def left(x):
        R = Rotation.from_rotvec(x[:3]).as_matrix() @ start.R
        return np.einsum("mij,mj->mi", W, p - (nominal - start.t - x[3:]) @ R).ravel()

    got = optimize.least_squares(left, np.zeros(6), jac="3-point", x_scale="jac", xtol=1e-14)
    held = np.sum(np.linalg.qr(got.jac)[0].reshape(-1, 18) ** 2, axis=1)
    square = np.sum(got.fun.reshape(-1, 3) ** 2, axis=1)
    mine = (rows["group"] == rows["group"].iloc[5]).to_numpy()[kept]

    (found,) = base_outlier(registered(wrong), 1.0)

    assert np.array(found.near) == pytest.approx(np.c_[square, 3 - held][mine], rel=1e-3)


def test_two_bad_readings_are_both_named(case):
    """And no innocent one between them; both are removed at once."""
    one = spoiled(case, 1, np.array([0.0, 0.0, 6e-4]))
    two = spoiled(one, 6, np.array([0.0, 6e-4, 0.0]))
    rows = two.readings[two.readings["pose"].isna()].iloc[[1, 6]]

    found = base_outlier(registered(two), 1.0)

    assert {m.where for m in found} == {
        f"{g}/{t}" for g, t in zip(rows["group"], rows["target"], strict=True)
    }
    assert [m.size for m in found] == pytest.approx([6e-4, 6e-4], abs=8e-5)
    for read, single in ((one, True), (two, False)):
        asked = SimpleNamespace(
            reduced=SimpleNamespace(registration=registered(read)), spread=(1.0, 0)
        )
        assert [len(test.find(asked)) > 0 for test in (ONE_READING, SEVERAL_READINGS)] == [
            single,
            not single,
        ]
    for mistake in found:
        two = mistake.correct(two)
    assert sorted(set(case.readings.index) - set(two.readings.index)) == sorted(rows.index)
    assert base_outlier(registered(two), 1.0) == []


def at_the_tracker(case, k):
    """The reading is (0, 0, 0), as after a lost lock."""
    return -case.readings[case.readings["pose"].isna()].iloc[k][XYZ].to_numpy(float)


def before(case, k):
    """The reading is the one before, repeated."""
    rows = case.readings[case.readings["pose"].isna()][XYZ].to_numpy(float)
    return rows[k - 1] - rows[k]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("k", range(1, 8))
@pytest.mark.parametrize("off", [at_the_tracker, before, lambda case, k: 2.0, lambda c, k: 2e-2])
def test_a_reading_is_named_however_far_it_is_off(case, k, off):
    """A lost lock, a stale reading, metres and centimetres; size as planted, nothing else."""
    shift = off(case, k) * np.ones(3)
    wrong = spoiled(case, k, shift)
    row = wrong.readings[wrong.readings["pose"].isna()].iloc[k]

    (found,) = base_outlier(registered(wrong), 1.0)

    assert found.where == f"{row['group']}/{row['target']}"
    assert found.size == pytest.approx(np.linalg.norm(shift), abs=2e-4)
    assert base_outlier(registered(found.correct(wrong)), 1.0) == []


def drifted(case, shift):
    """The second round read by a tracker that was displaced [m]."""
    rows = case.readings.copy()
    late = rows["pose"].isna() & (rows["group"] == "base_end")
    rows.loc[late, XYZ] = rows.loc[late, XYZ].to_numpy(float) + shift
    return replace(case, readings=rows)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("k", [1, 6])
@pytest.mark.parametrize("size", [1e-3, 1.0])
def test_beside_a_drift_the_bad_reading_is_named_and_no_other(case, k, size):
    """1.2 mm between the rounds; without a bad reading nothing is accused."""
    late = drifted(case, np.array([8e-4, -8e-4, 4e-4]))
    wrong = spoiled(late, k, size * np.array([0.6, 0.0, 0.8]))
    row = wrong.readings[wrong.readings["pose"].isna()].iloc[k]

    (found,) = base_outlier(registered(wrong), 1.0)

    assert found.where == f"{row['group']}/{row['target']}"
    assert found.size == pytest.approx(size, abs=2e-4)
    assert base_outlier(registered(late), 1.0) == []


def grown(case, kelvin):
    """The reflectors of the last round moved as steel that warms, by K along each axis of F_b."""
    rows, R = case.readings.copy(), registered(case).R
    late = rows["pose"].isna() & (rows["group"] == "base_end")
    at = np.array([CORNERS[name] for name in rows.loc[late, "target"]], float)
    rows.loc[late, XYZ] = rows.loc[late, XYZ].to_numpy(float) + 11.5e-6 * at * kelvin @ R
    return replace(case, readings=rows)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "kelvin", [(6.0, 6.0, 6.0), (12.0, 12.0, 12.0), (0.0, 15.0, 0.0), (0.0, 4.0, 0.0)]
)
def test_a_base_frame_that_grew_with_the_hall_accuses_no_reading(case, kelvin):
    """And of a reading that is off beside that, none but it is named."""
    late = grown(case, kelvin)
    wrong = spoiled(late, 6, np.array([12e-4, 0.0, 16e-4]))
    row = wrong.readings[wrong.readings["pose"].isna()].iloc[6]

    assert base_outlier(registered(late), 1.0) == []
    found = [one.where for one in base_outlier(registered(wrong), 1.0)]
    assert found == [f"{row['group']}/{row['target']}"]


def in_rounds(rounds, course, rng, step_h=0.7):
    """Three base reflectors read in rounds by a tracker that moves as one body.

    Args:
        rounds: How many.
        course: Hours -> share of a motion by 0.7 mm, and as much by a turn at 10 m.
        rng: Draws motion and scatter of 20 um.
        step_h: Time between rounds [h].
    """
    corners = {name: CORNERS[name] for name in ("B1", "B2", "B3")}
    made = small(4, base_frame=corners)
    made = replace(made, settings=made.settings.model_copy(update={"base_frame": corners}))
    rows = made.readings[made.readings["pose"].isna()]
    rows = rows[rows["target"].isin(corners)].drop_duplicates("target")
    start = register(made.settings, made.readings)
    v, w = (7e-4 * one / np.linalg.norm(one) for one in rng.standard_normal((2, 3)))
    every = []
    for k in range(rounds):
        late = rows.assign(group=f"base_{k}", time=rows["time"] + pd.Timedelta(hours=step_h * k))
        at = np.array([corners[name] for name in late["target"]], float)
        at = at + course(step_h * k) * (v + np.cross(w / 10, at))
        scatter = 2e-5 * rng.standard_normal(at.shape)
        late[XYZ] = (at - start.t) @ start.R + scatter
        late[SIX] = 4e-10 * np.array([1, 0, 0, 1, 0, 1])
        every.append(late)
    return replace(made, readings=pd.concat(every, ignore_index=True))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("size", [6e-4, 19.0])
@pytest.mark.parametrize("k", [1, 7, 13, 20])
def test_of_three_reflectors_beside_a_drift_the_one_that_is_off_is_named(k, size):
    """Seven rounds; by a round alone nobody could tell which of three it is."""
    rng = np.random.default_rng(k)
    late = in_rounds(7, lambda hours: hours / 4.2, rng)
    wrong = spoiled(late, k, size * np.array([0.6, 0.0, 0.8]))
    row = wrong.readings.iloc[k]

    (found,) = base_outlier(registered(wrong), 1.0)

    assert found.where == f"{row['group']}/{row['target']}"
    assert found.size == pytest.approx(size, abs=2e-4)
    assert base_outlier(registered(late), 1.0) == []


@pytest.mark.sampled(2)
@pytest.mark.parametrize("k", [1, 4, 8, 13])
def test_a_stale_reading_is_named_though_the_tracker_was_knocked(k):
    """Between any two rounds, of three reflectors: metres are not a motion of a tracker."""
    knocked = in_rounds(5, lambda hours: np.sin(4 * hours), np.random.default_rng(k))
    row = knocked.readings.iloc[k]

    (found,) = base_outlier(registered(spoiled(knocked, k, before(knocked, k))), 1.0)

    assert found.where == f"{row['group']}/{row['target']}"
    assert base_outlier(registered(knocked), 1.0) == []


def test_without_a_stated_noise_only_what_is_grossly_off_is_named(case):
    """The scatter is then that of the consistent readings."""
    rows = case.readings.assign(**dict.fromkeys(SIX, np.nan))
    unknown = replace(case, readings=rows)

    assert base_outlier(registered(spoiled(unknown, 3, 6e-4)), 1.0) == []
    assert len(base_outlier(registered(spoiled(unknown, 3, 2.0)), 1.0)) == 1


@pytest.mark.parametrize("rounds", [1, 2, 12])
def test_the_start_holds_with_fewer_than_half_of_the_readings_bad(rounds):
    """Errors anywhere in the hall; the pose is that without them."""
    rng = np.random.default_rng(rounds)
    corners = np.array([*CORNERS.values(), [0.2, 7.0, 1.1], [-0.7, 4.0, -0.2]], float)
    nominal = np.tile(corners, (rounds, 1))
    R, t = Rotation.random(random_state=3).as_matrix(), np.array([5.0, 2.0, 1.0])
    points = (nominal + 3e-5 * rng.normal(size=nominal.shape) - t) @ R
    bad = rng.permutation(len(points))[: max(len(points) // 2 - 2, 1)]
    points[bad] = rng.uniform(-10, 10, (len(bad), 3))

    agree = agreeing(points, nominal)

    assert sorted(np.flatnonzero(~agree)) == sorted(bad)


def test_without_redundancy_or_stated_noise_nothing_is_said(case):
    """Three reflectors read once determine the tracker, without redundancy."""
    whole = registered(spoiled(case, 1, np.array([0.0, 0.0, 6e-4])))

    assert base_outlier(whole, 1.0)
    assert base_outlier(replace(whole, dof=5), 1.0) == []
    assert base_outlier(replace(whole, chi2=None), 1.0) == []


def draws(case, count, rng, factor=1.0):
    """The same readings drawn anew, each from its own covariance."""
    rows, C = covariances(case)
    start = registered(case)
    nominal = np.array([CORNERS[n] for n in rows["target"]])
    exact = (nominal - start.t) @ start.R
    L = factor * np.linalg.cholesky(C)
    for _ in range(count):
        now = case.readings.copy()
        now.loc[rows.index, XYZ] = exact + np.einsum("mij,mj->mi", L, rng.normal(size=exact.shape))
        yield replace(case, readings=now)


@pytest.mark.whole
def test_clean_draws_are_accused_no_more_often_than_the_rate(case, monkeypatch):
    """40 draws at a rate of one in five: both tests, each knowing its own scatter."""
    monkeypatch.setattr(alarms, "READING", 0.2)
    monkeypatch.setattr(reading, "_SMALLEST_M", 0.0)
    accused, factor = np.zeros(2, int), 1.5
    for one in draws(case, 40, np.random.default_rng(12), factor):
        registration = registered(one)
        accused += [
            bool(base_outlier(registration, factor)),
            bool(base_target(one, registration, factor)),
        ]

    assert 1 <= accused[0] <= stats.binom.ppf(0.999, 40, 0.2)
    assert accused[1] <= stats.binom.ppf(0.999, 40, 0.2)


@pytest.mark.parametrize(("name", "axis"), [("B1", 0), ("B3", 1)])
def test_a_wrong_nominal_place_is_named_with_its_size(case, name, axis):
    """1 mm: the others agree, and the residual sum of squares is theirs."""
    off = 1e-3 * np.eye(3)[axis]
    wrong = renamed(case, name, off)
    registration = registered(wrong)

    (found,) = base_target(wrong, registration, 1.0)

    rest, shift = freely(wrong, name)
    assert found.where == name
    assert found.size == pytest.approx(np.linalg.norm(shift), rel=1e-4)
    assert found.before == pytest.approx(np.sqrt(registration.chi2 - rest), rel=1e-4)
    assert found.after == pytest.approx(np.sqrt(rest), rel=1e-4)
    assert found.p_value < 1e-9
    right = found.correct(wrong)
    assert set(right.settings.base_frame) == set(CORNERS) - {name}
    assert base_target(right, registered(right), 1.0) == []  # three cannot outvote one


def test_the_chance_of_a_nominal_place_is_counted_for_all_of_them(case):
    """Four reflectors, and a scatter of twice the stated one."""
    wrong = renamed(case, "B2", np.array([0.0, 4e-4, 0.0]))
    registration = registered(wrong)

    (found,) = base_target(wrong, registration, 2.0)

    drop = (registration.chi2 - freely(wrong, "B2")[0]) / 4
    assert found.p_value == pytest.approx(4 * stats.chi2.sf(drop, 3), rel=1e-2)
    assert found.before == pytest.approx(np.sqrt(drop), rel=1e-4)


def test_two_places_alike_wrong_are_not_laid_on_one(case):
    """Both are wrong: whichever is removed, the others do not agree."""
    base = {n: tuple(np.add(at, 1e-3 if n in ("B1", "B3") else 0)) for n, at in CORNERS.items()}
    wrong = replace(case, settings=case.settings.model_copy(update={"base_frame": base}))

    assert base_target(wrong, registered(wrong), 1.0) == []


def test_a_weaker_rival_that_would_do_as_well_saves_both(case):
    """A misfit just beyond the limit is explained by several removals."""
    flat = {n: (*at[:2], 0.0) for n, at in CORNERS.items()}
    wrong = renamed(case, "B2", np.array([0.0, 0.0, 0.0]))
    settings = case.settings.model_copy(update={"base_frame": flat})
    start = registered(case)
    rows, C = covariances(case)
    high = {**flat, "B2": (*flat["B2"][:2], 1e-3)}
    seen = (np.array([high[n] for n in rows["target"]]) - start.t) @ start.R
    readings = wrong.readings.copy()
    L = np.linalg.cholesky(C)
    scatter = np.einsum("mij,mj->mi", L, np.random.default_rng(3).normal(size=seen.shape))
    readings.loc[rows.index, XYZ] = seen + scatter
    wrong = replace(wrong, readings=readings, settings=settings)
    registration = registered(wrong)

    assert stats.chi2.sf(registration.chi2, registration.dof) < alarms.READING
    assert base_target(wrong, registration, 1.0) == []


def test_base_reflectors_without_stated_noise_accuse_none(case):
    """Without a stated noise the misfit has no scale."""
    wrong = renamed(case, "B1", np.array([1e-3, 0.0, 0.0]))
    registration = registered(wrong)

    assert base_target(wrong, registration, 1.0)
    assert base_target(wrong, replace(registration, chi2=None), 1.0) == []
    assert base_target(wrong, registration, 40.0) == []


def test_the_others_must_agree_to_a_hundredth(case):
    """Their sum of squares has the redundancy without the reading: 15."""
    whole = registered(spoiled(case, 1, np.array([0.0, 0.0, 1e-3])))
    index = whole.table.index[1]
    rest = register(case.settings, case.readings.drop(index)).chi2
    limit = stats.chi2.isf(0.01, 15)

    assert len(base_outlier(whole, np.sqrt(rest / limit) * 1.01)) == 1
    assert base_outlier(whole, np.sqrt(rest / limit) * 0.99) == []
