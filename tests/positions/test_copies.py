"""Copies of residuals without a law must be as large as the noise from which residuals arise."""

from types import SimpleNamespace

import numpy as np
import pytest
from made_positions import made, weightless
from scipy import stats

from pipeline.machine.robot import load
from pipeline.positions import catalogue_causes
from pipeline.positions import law_tests as law_tests_module
from pipeline.positions.calibrate import ModelStructure
from pipeline.positions.cross_validation import LeftOutPoses, partings
from pipeline.positions.initial import begin
from pipeline.positions.joint_laws import LawSearchData, _of_own_angles
from pipeline.positions.law_tests import _as_noise, flips, gumbel, law_tests
from pipeline.positions.laws import JointLaw
from pipeline.positions.scatter import start
from pipeline.system.alarms import LAW

POSES, ROWS, KNOWN, DRAWS = 30, 9, 60, 300


def test_residuals_of_few_poses_are_made_as_large_as_noise():
    """With 270 readings, 60 parameters take a fifth of the noise, which is restored by pose.

    Otherwise a law found in noise exceeds copies that are all a fifth too small.
    """
    rng = np.random.default_rng(4)
    X = rng.normal(size=(POSES * ROWS, KNOWN)) * rng.uniform(0.2, 3.0, (POSES * ROWS, 1))
    hat = X @ np.linalg.pinv(X)
    blocks = np.stack([hat[k : k + ROWS, k : k + ROWS] for k in range(0, len(hat), ROWS)])
    noise = rng.normal(size=(DRAWS, len(hat)))
    left = (noise - noise @ hat).reshape(DRAWS, POSES, ROWS)
    copied = np.array([_as_noise(blocks, one) for one in left])

    assert np.mean(left**2) == pytest.approx(1 - KNOWN / len(hat), abs=0.02)
    assert np.mean(copied**2, axis=(0, 2)) == pytest.approx(1.0, abs=0.15)
    assert np.mean(copied**2) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("poses", [30, 45, 90, 400])
def test_copies_of_few_poses_differ(poses):
    """A copy and its mirror image give the same T: blocks of eight of 30 poses make eight."""
    rng = np.random.default_rng(6)
    signs = flips(made(poses, rng), rng)
    kinds = np.unique(signs * signs[:, :1], axis=0)

    assert len(kinds) > 0.99 * len(signs)


def rippling(q):
    """A wave of 60 microradians in each joint, 16 periods per turn."""
    return 6e-5 * np.sin(16.0 * q + np.arange(6))


def test_waves_do_not_hide_themselves_in_the_copies():
    """The ripples of all six joints are significant at once."""
    rng = np.random.default_rng(3)
    robot, readings = load("ur10"), made(120, rng, rippling)
    data = LawSearchData(readings, weightless(120), (np.nan, np.nan), start(robot, None))
    found = data.identify(begin(robot, readings, {}), ModelStructure(springs=False))
    laws = [JointLaw(j, "periodic", "angle", j, n) for j in range(1, 7) for n in range(4, 65)]

    tests = law_tests(found, flips(readings, rng), laws)

    sure = {one.joint for one in tests if one.p < LAW and one.law.order == 16}
    assert sure == {1, 2, 3, 4, 5, 6}


def _searched(ripple, seed, laws):
    """Data of a UR10 with ripples, its estimate without laws, tests of these, and the copies."""
    rng = np.random.default_rng(seed)
    robot, readings = load("ur10"), made(120, rng, ripple)
    data = LawSearchData(readings, weightless(120), (np.nan, np.nan), start(robot, None))
    found = data.identify(begin(robot, readings, {}), ModelStructure(springs=False))
    return data, found, law_tests(found, flips(readings, rng), laws, [False] * 6), rng


def _waves(orders):
    return [JointLaw(j, "periodic", "angle", j, float(n)) for j in range(1, 7) for n in orders]


@pytest.mark.parametrize(("order", "seen"), [(7.0, True), (7.5, False)])
def test_an_error_that_repeats_itself_each_turn_need_not_stand_out_of_all_orders(order, seen):
    """T of 26 is rare among some seventy waves of what turns with a joint, not among 3000."""

    def ripple(q):
        return 1.0e-5 * np.sin(order * q) * (np.arange(6) == 3)

    tests = _searched(ripple, 3, _waves(np.arange(4, 130, 0.25)))[2]

    of = next(one for one in tests if one.law and (one.joint, one.law.order) == (4, order))
    assert (of.p < LAW) == seen


@pytest.mark.whole
def test_two_waves_that_no_curve_of_few_poses_contains_take_its_place():
    """Neither wave explains half of the curve."""

    def both(q):
        return 6e-5 * (np.sin(12 * q) + np.cos(7 * q + 1)) * (np.arange(6) == 2)

    data, found, clues, rng = _searched(both, 5, _waves(np.arange(4, 65, 0.5)))
    judge = LeftOutPoses(partings(data.readings, rng, False), rng)

    found, _ = _of_own_angles(data, found, clues, judge)

    assert found.wanted.curves == ()
    laws = found.mechanism.laws
    parts = np.split(found.mechanism.amplitudes, np.cumsum([law.amplitudes for law in laws])[:-1])
    size = {law.order: float(np.linalg.norm(part)) for law, part in zip(laws, parts, strict=True)}
    assert size[12.0] == pytest.approx(6e-5, rel=0.2)
    assert size[7.0] == pytest.approx(6e-5, rel=0.2)


def test_the_largest_of_copies_have_the_extreme_value_distribution_of_a_library():
    """The likeliest location and scale are those that scipy finds, also of few unequal values."""
    rng = np.random.default_rng(4)
    for most in (rng.gumbel(2.0, 0.3, 200), np.append(np.zeros(499), 1.0)):
        assert gumbel(most) == pytest.approx(stats.gumbel_r.fit(most), rel=1e-9)


@pytest.mark.parametrize(("T", "named"), [(14.0, False), (40.0, True)])
def test_what_vanished_counts_among_what_was_tried(T, named, monkeypatch):
    """Of 30 waves one is left: in the copies, those that vanished explain nothing."""
    size = {"x": np.zeros((60, 200))}
    monkeypatch.setattr(law_tests_module, "score", lambda *_: SimpleNamespace(**size))
    monkeypatch.setattr(catalogue_causes, "precision", lambda *_: (None, None))
    draws = stats.chi2(2).rvs(201, random_state=5)

    def explained(_, __, at, ___):
        return np.concatenate([[T], draws[1:]]) if at[0] == 0 else 1e-9 * np.roll(draws, at[0])

    monkeypatch.setattr(catalogue_causes, "_explained", explained)
    found = SimpleNamespace(solution=SimpleNamespace(x=np.zeros(60)), mechanism=None, known=None)
    groups = [slice(2 * k, 2 * k + 2) for k in range(30)]

    first, *others = catalogue_causes.chances(found, groups, np.ones((200, 50)))

    assert first >= min(1.0, 30 * stats.chi2(2).sf(T)) * (1 - 1e-9)
    assert (first < LAW) is named
    assert min(others) == 1.0
