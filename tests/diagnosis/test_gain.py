"""Cross-validation: every pose left out and refitted by numpy."""

from dataclasses import replace

import numpy as np
import pytest
from linear_campaign import EACH, FREE, POSES, SPRINGS, made, suspect, task_of
from scipy import stats

from pipeline.base.bootstrap import interval
from pipeline.diagnosis.gain import _choose, alone, as_good, beside, gain

SUSPECTS = (suspect("a", FREE), suspect("b", FREE, FREE), suspect("a", FREE), suspect("d", FREE))
POSE = np.repeat(np.arange(POSES), EACH)


@pytest.fixture(scope="module")
def truth():
    return made(np.random.default_rng(1), SUSPECTS, {1: [1.5, -1.0], 3: [1.0]})


def left_out(truth, *causes):
    """Residuals c - B x [m] of each pose, estimated without it; B excludes the shared error."""
    X, y = truth.columns(*causes), truth.y
    top = np.column_stack([truth.B * 3e-8, *(
        truth.Z[i] * [p.typical for p in truth.suspects[i].parameters] for i in causes
    )])  # fmt: skip
    out = np.zeros(len(truth.c))
    for pose in range(POSES):
        kept = np.append(pose != POSE, True)
        x = np.linalg.lstsq(X[kept], y[kept], rcond=None)[0]
        mine = pose == POSE
        out[mine] = truth.c[mine] - top[mine] @ np.delete(x, SPRINGS)
    return out


def by_loops(before, after, draws, rng):
    """Reduction of the rms, and its interval from poses resampled one by one."""
    out = []
    for _ in range(draws):
        drawn = [np.flatnonzero(p == POSE) for p in rng.choice(POSES, POSES)]
        rows = np.concatenate(drawn)
        out.append(1 - np.sqrt(np.mean(after[rows] ** 2)) / np.sqrt(np.mean(before[rows] ** 2)))
    return np.percentile(out, [2.5, 97.5])


def test_one_cause_alone_is_worth_what_refits_say(truth):
    """Each alone in addition to the springs, in the requested order."""
    view, rng = truth.view(), np.random.default_rng(3)
    before = left_out(truth)

    found = alone(view, [(3, 0.4), (1, 0.6)], rng)

    assert [(one.effect.label, one.probability) for one in found] == [("d", 0.4), ("b", 0.6)]
    for one, suspect_ in zip(found, (3, 1), strict=True):
        after = left_out(truth, suspect_)
        expected = 1 - np.sqrt(np.mean(after**2) / np.mean(before**2))
        assert one.reduction == pytest.approx(expected, rel=1e-6)
        low, high = by_loops(before, after, 2000, np.random.default_rng(4))
        assert one.ci95 == pytest.approx((low, high), abs=0.02)


def test_the_gain_is_that_of_causes_chosen_without_each_pose(truth):
    """Both are chosen in every fold: residuals are those of refits with both."""
    case = task_of(truth)

    found = gain(case, truth.view(), truth.view((1, 3)), 1e-3, np.random.default_rng(5))

    assert all(set(one) == {"b", "d"} for one in found.chosen)
    assert len(found.chosen) == POSES
    np.testing.assert_allclose(found.before, left_out(truth), rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found.after, left_out(truth, 1, 3), rtol=1e-6, atol=1e-12)
    assert found.rms_before_m == pytest.approx(np.sqrt(np.mean(found.before**2)))
    assert found.reduction == pytest.approx(1 - found.rms_after_m / found.rms_before_m)
    assert found.of == "displacements"


def test_a_cause_beside_another_gains_what_refits_without_it_lose(truth):
    """Not what both gain together: shares of the same error do not add up to more than all."""
    rng = np.random.default_rng(5)

    found = beside(truth.view((1, 3)), (1,), rng)

    np.testing.assert_allclose(found.before, left_out(truth, 1), rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found.after, left_out(truth, 1, 3), rtol=1e-6, atol=1e-12)
    assert found.reduction == pytest.approx(1 - found.rms_after_m / found.rms_before_m)


def test_each_cause_must_improve_predictions_beside_the_others():
    """The two that act do; one that does not act is worth as much as drawn refits say."""
    truth = made(np.random.default_rng(1), SUSPECTS, {1: [15.0, -10.0], 3: [10.0]})
    view, rng = truth.view((1, 2, 3)), np.random.default_rng(6)
    rest = {1: (2, 3), 3: (1, 2), 2: (1, 3)}

    found = {one: view.unproven(view.columns(others), rng) for one, others in rest.items()}

    assert found[1] == found[3] == 0.0
    low = by_loops(left_out(truth, 1, 3), left_out(truth, 1, 2, 3), 2000, rng)[0]
    assert low < 0
    assert 0.15 < found[2] <= 0.5


def test_a_cause_that_one_pose_alone_called_for_is_not_chosen_without_it(truth):
    """An effect in pose 2 only is useless for the others, and does not improve its prediction."""
    rng = np.random.default_rng(7)
    Z = truth.Z[3].copy()
    Z[POSE != 2] *= 1e-3
    c = made(rng, SUSPECTS, {}).c * 0 + truth.B @ np.full(SPRINGS, 4e-8)
    c = c + np.linalg.solve(truth.W, rng.standard_normal(len(c))) + 3.0 * Z[:, 0] * 2e-8
    once = replace(truth, Z=(*truth.Z[:3], Z), c=c)

    found = gain(task_of(once), once.view(), once.view((3,)), 1e-3, rng)

    assert found.chosen[2] == ()
    assert all(one == ("d",) for k, one in enumerate(found.chosen) if k != 2)
    assert found.after[POSE == 2] == pytest.approx(found.before[POSE == 2])
    np.testing.assert_allclose(found.after[POSE == 2], left_out(once)[POSE == 2], rtol=1e-6)


def test_a_choice_stops_at_the_limit_at_its_number_and_in_one_form(truth):
    """A p above the limit does not join, nor a third of at most two, nor a second form."""
    case, view = task_of(truth), truth.view()

    assert _choose(case, view, view.M, 2, 1e-3, 0) in ((1, 3), (3, 1))
    assert len(_choose(case, view, view.M, 1, 1e-3, 0)) == 1
    assert _choose(case, view, view.M, 3, 1e-3, 0) in ((1, 3), (3, 1))
    assert _choose(case, view, view.M, 3, 0.0, 0) == ()
    twice = made(np.random.default_rng(1), SUSPECTS, {0: [2.0], 2: [2.0]})
    chosen = _choose(task_of(twice), twice.view(), twice.view().M, 3, 1e-3, 0)
    assert len({SUSPECTS[i].label for i in chosen}) == len(chosen) == 1


def test_the_interval_of_equal_poses_is_a_point():
    """If each pose improves by the same factor, resampling makes no difference."""
    r = np.tile(np.array([1.0, -2.0, 3.0]), 4)

    reduction, (low, high) = interval(r, 0.25 * r, np.repeat(np.arange(4), 3), RNG())

    assert reduction == pytest.approx(0.75)
    assert (low, high) == (pytest.approx(0.75), pytest.approx(0.75))
    assert interval(0 * r, r, np.repeat(np.arange(4), 3), RNG())[0] < -1e9


def RNG():
    return np.random.default_rng(1)


def test_the_interval_of_unequal_poses_is_that_of_loops():
    """2.5 and 97.5 percentiles, resampling whole poses."""
    rng = np.random.default_rng(2)
    before = rng.standard_normal(POSES * EACH) * np.repeat(rng.uniform(0.5, 3, POSES), EACH)
    after = before * np.repeat(rng.uniform(0.3, 1.2, POSES), EACH)

    _, ci = interval(before, after, POSE, rng)

    assert ci == pytest.approx(tuple(by_loops(before, after, 4000, rng)), abs=0.02)


def test_a_cause_is_chosen_by_its_chance_in_the_poses_that_stay():
    """The p-value of its F test without the pose, from two fits to the other rows."""
    truth = made(np.random.default_rng(9), SUSPECTS, {3: [0.45]})
    kept = np.append(POSE != 0, True)
    squares = []
    for causes in ((), (3,)):
        X, y = truth.columns(*causes)[kept], truth.y[kept]
        squares.append(np.sum((y - X @ np.linalg.lstsq(X, y, rcond=None)[0]) ** 2))
    dof = 72 - EACH - SPRINGS - 1
    p = stats.f.sf((squares[0] - squares[1]) / (squares[1] / dof), 1, dof)

    def chosen(limit):
        got = gain(task_of(truth), truth.view(), truth.view((3,)), limit, RNG())
        return got.chosen[0]

    assert chosen(1.001 * p) == ("d",)
    assert chosen(0.999 * p) == ()


@pytest.mark.parametrize(("place", "label"), [(2, "x"), (4, "z")])
def test_what_has_no_name_and_predicts_as_well_is_told(place, label):
    """A cause at three typical sizes, an unnamed similar one, and an unrelated one."""
    several = tuple(suspect(name, FREE) for name in "abxyz")
    alike = made(
        np.random.default_rng(5), several, {0: [3.0], 1: [1.0]},
        alike={place: (0, 0.02), 6 - place: (1, 0.02)},
    )  # fmt: skip
    view = alike.view((0, 1))

    (one,) = as_good(view, 0, 2, np.random.default_rng(6))

    without, instead = left_out(alike, 1), left_out(alike, 1, place)
    assert one.effect.label == label
    assert one.reduction == pytest.approx(
        1 - np.sqrt(np.mean(instead**2) / np.mean(without**2)), rel=1e-6
    )
    x = np.linalg.lstsq(alike.columns(1, place), alike.y, rcond=None)[0]
    assert one.times_typical == pytest.approx(abs(x[-1]), rel=1e-6)
    assert one.ci95[0] > 0
