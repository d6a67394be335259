"""Changes in mid-campaign, against penalised least squares of all poses at once.

The rows are drawn: no robot is needed to know by how much another column lowers a sum of squares.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from pipeline.geometry.remastered import _courses, _drops, _gains, _what, changes
from pipeline.geometry.unloaded import MidChange, PoseRows
from pipeline.machine.effects.tracker_drift import LAWS

RNG = np.random.default_rng(17)
P, R, N, TARGETS = 9, 8, 2, 2
SHIFT, LOOSE, TOOL = slice(0, 3), slice(9, 12), slice(3, 9)
K = 12
STD = np.array([10.0] * 3 + [0.5] * 6 + [2.0] * 3)
ORDER = RNG.permutation(P)


def zeros(turned: bool = False, timed: bool = True) -> SimpleNamespace:
    """Poses 20 to 28, read every ten minutes in `ORDER`, with one reading each."""
    clock = np.empty(P)
    clock[ORDER] = 100.0 + 600.0 * np.arange(P)
    pulls = SimpleNamespace(
        pose=20 + np.arange(P), time_zero=clock if timed else np.full(P, np.nan)
    )
    return SimpleNamespace(
        columns=SimpleNamespace(shift=SHIFT, loose=LOOSE, tool=TOOL), pose=np.arange(P), poses=P,
        robot=SimpleNamespace(n=N), tool=SimpleNamespace(points=np.zeros((TARGETS, 3))),
        turned=np.eye(3) if turned else None, pulls=pulls,
    )  # fmt: skip


def rows(y: np.ndarray) -> PoseRows:
    """Drawn columns of a sliding and a turning joint; the joints' errors are as large as noise."""
    rng = np.random.default_rng(5)
    half = 0.2 * rng.normal(size=(P, R, R)) + np.eye(R)
    Z = 1e4 * rng.normal(size=(P, R, N))
    place = np.arange(P)[:, None], np.arange(3) + np.zeros((P, 1), int)
    slides = np.array([True, False])
    return PoseRows(y, rng.normal(size=(P, R, K)), Z, half @ half.swapaxes(1, 2), place, slides)


def whitened(of: PoseRows, transmission: float) -> np.ndarray:
    """W with W'W the inverse covariance of all rows: noise, and each joint's error at its pose."""
    V = np.zeros((P * R, P * R))
    for i in range(P):
        at = slice(R * i, R * i + R)
        V[at, at] = of.N[i] + sum(
            (transmission * usual) ** 2 * np.outer(of.Z[i, :, j], of.Z[i, :, j])
            for j, usual in enumerate((5e-5, 1e-4))
        )
    return np.linalg.cholesky(np.linalg.inv(V)).T


def least(of: PoseRows, transmission: float, more: np.ndarray) -> float:
    """Sum of squares of y - D x - more a over noise and prior, a free, by numpy."""
    W = whitened(of, transmission)
    X = np.vstack([W @ of.D.reshape(-1, K) * STD, np.eye(K)])
    if more.size:
        X = np.hstack([X, np.vstack([W @ more, np.zeros((K, more.shape[1]))])])
    y = np.r_[W @ of.y.ravel(), np.zeros(K)]
    x = np.linalg.lstsq(X, y, rcond=None)[0]
    return float(np.sum((y - X @ x) ** 2))


def found(of: PoseRows, sizes: list[float], log: list[float]) -> SimpleNamespace:
    """Estimates of cells with these errors of the joints and likelihoods."""
    x, cov = [], []
    for size in sizes:
        W = whitened(of, size)
        X = np.vstack([W @ of.D.reshape(-1, K), np.diag(1 / STD)])
        cov.append(np.linalg.inv(X.T @ X))
        x.append(cov[-1] @ X.T @ np.r_[W @ of.y.ravel(), np.zeros(K)])
    return SimpleNamespace(
        transmission=np.array(sizes), log=np.array(log), x=np.array(x), cov=np.array(cov),
        unrefined=None,
    )  # fmt: skip


def columns(of: PoseRows, joint: int, target: int | None) -> np.ndarray:
    """Motions at every pose of a joint, the whole robot or a target, shape (p, r, u)."""
    if target is not None:
        return of.D[:, :, 3 + 3 * target : 6 + 3 * target]
    if joint:
        return of.Z[:, :, joint - 1 : joint]
    return np.concatenate([of.D[:, :, SHIFT], of.D[:, :, LOOSE]], axis=2)


def drop(of: PoseRows, size: float, joint: int, target: int | None, share: np.ndarray) -> float:
    """What a change in the poses of `share` lowers the sum of squares by."""
    more = (share[:, None, None] * columns(of, joint, target)).reshape(P * R, -1)
    return least(of, size, np.zeros((P * R, 0))) - least(of, size, more)


WAYS = [(0, None, False), (1, None, False), (1, None, True), (2, None, False), (2, None, True),
        (0, 0, False), (0, 1, False)]  # fmt: skip
"""Joint, target, and whether the joint is off before the change."""


def test_what_may_have_changed_is_the_robot_each_joint_both_ways_and_each_target() -> None:
    """With six, one and three unknowns; targets of one 6D pose do not move by themselves."""
    every = _what(zeros())

    assert [(one.joint, one.target, one.early) for one in every] == WAYS
    assert [one.unknowns for one in every] == [6, 1, 1, 1, 1, 3, 3]
    assert [(one.joint, one.target) for one in _what(zeros(turned=True))] == [
        (joint, None) for joint, target, _ in WAYS if target is None
    ]


def test_a_change_adds_to_the_poses_that_are_off() -> None:
    """A joint stands behind its log, before or since; robot and targets are moved since."""
    pulls = SimpleNamespace(pose=np.array([4, 7, 5, 9]))
    before = (4, 5)

    assert MidChange(3, before, 7).share(pulls).tolist() == [-1, 0, -1, 0]
    assert MidChange(3, before, 7, slipped=True).share(pulls).tolist() == [0, -1, 0, -1]
    assert MidChange(0, before, 7).share(pulls).tolist() == [0, 1, 0, 1]
    assert MidChange(0, before, 7, target=1).share(pulls).tolist() == [0, 1, 0, 1]


def test_courses_of_an_instrument_go_by_the_clock_or_by_the_number() -> None:
    """Steady and warming up from the first pose on; without times only a steady one is known."""
    timed = _courses(zeros(), ORDER)
    since = 600.0 * np.arange(P)

    assert timed[list(LAWS).index("steady")] == pytest.approx(since)
    hour = timed[list(LAWS).index("warm-up")]
    assert hour == pytest.approx(1 - np.exp(-since / 3600))
    assert len(timed) == len(LAWS)
    by_number = _courses(zeros(timed=False), np.arange(P))
    np.testing.assert_allclose(by_number, [np.arange(P) / (P - 1)])


def test_a_change_is_worth_what_it_lowers_the_sum_of_squares_by() -> None:
    """Of each thing behind each pose in time, and of the courses of all poses."""
    of = rows(RNG.normal(size=(P, R)))
    T = _drops(zeros(), of, found(of, [0.7], [0.0]), 0, ORDER)

    assert T.shape == (P + len(LAWS), len(WAYS))
    for k, (joint, target, early) in enumerate(WAYS):
        for n in (1, 4, 7):
            off = np.isin(np.arange(P), ORDER[:n]) == early
            expected = drop(of, 0.7, joint, target, off.astype(float))
            assert T[n - 1, k] == pytest.approx(expected, rel=1e-6, abs=1e-6)
        clock = np.empty(P)
        clock[ORDER] = np.arange(P)
        steady = drop(of, 0.7, joint, target, clock)
        assert T[P + list(LAWS).index("steady"), k] == pytest.approx(steady, rel=1e-6, abs=1e-6)


def test_the_errors_of_the_joints_are_those_that_suit_a_change_best() -> None:
    """The likeliest cell of each size: 2 log L and the drop are added, the largest sum counts."""
    of = rows(3 * RNG.normal(size=(P, R)))
    sizes, log = [0.1, 2.0, 0.1, 2.0], [-40.0, -31.0, -35.0, -30.0]
    G = _gains(zeros(), of, found(of, sizes, log), ORDER)

    for k, (joint, target, early) in enumerate(WAYS):
        off = (np.isin(np.arange(P), ORDER[:5]) == early).astype(float)
        each = [2 * best + drop(of, size, joint, target, off) for size, best in
                ((0.1, -35.0), (2.0, -30.0))]  # fmt: skip
        assert G[4, k] == pytest.approx(max(each) + 60.0, rel=1e-6, abs=1e-6)


def asked(joint: int, target: int | None, share: np.ndarray, T: float) -> tuple[MidChange, ...]:
    """What is asked about where only one thing moved, as far as it takes for this T."""
    unit = np.arange(1.0, columns(rows(np.zeros((P, R))), joint, target).shape[2] + 1)
    y = share[:, None] * (columns(rows(np.zeros((P, R))), joint, target) @ unit)
    y = y * np.sqrt(T / drop(rows(y), 1.0, joint, target, share))
    return changes(zeros(), rows(y), found(rows(y), [1.0], [0.0]))


@pytest.mark.parametrize(("joint", "target", "early"), WAYS)
@pytest.mark.parametrize("before", [2, 5, 7])
def test_a_change_is_asked_about_with_its_poses(
    joint: int, target: int | None, early: bool, before: int
) -> None:
    """Beside the likeliest ones of all else, one of each; not if it is nearer than five sigmas."""
    first = ORDER[:before]
    off = (np.isin(np.arange(P), first) == early).astype(float)
    freedom = 6 if not joint and target is None else 1 if joint else 3
    limit = stats.chi2.isf(stats.chi2.sf(25, 1), freedom)
    every = asked(joint, target, off, limit * 1.02)

    told = [(one.joint, one.target) for one in every]
    assert told == [(0, None), (1, None), (2, None), (0, 0), (0, 1)]
    (one,) = (one for one in every if (one.joint, one.target) == (joint, target))
    assert one.before == tuple(sorted(20 + first))
    assert one.since == 20 + ORDER[before]
    assert one.early == early
    assert asked(joint, target, off, limit * 0.98) == ()


def test_a_steady_motion_of_the_whole_is_no_change() -> None:
    """Nor is anything asked of three poses."""
    clock = np.empty(P)
    clock[ORDER] = np.arange(P)
    assert asked(0, None, clock, 400.0) == ()
    few = SimpleNamespace(pose=np.arange(3), pulls=SimpleNamespace(
        pose=np.arange(3), time_zero=np.arange(3.0)))  # fmt: skip
    assert changes(few, None, None) == ()
