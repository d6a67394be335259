"""Forces that pulls should have had: planted errors in linear pulls, searches against all cases."""

from dataclasses import replace
from itertools import combinations, permutations
from types import SimpleNamespace as Some

import numpy as np
import pandas as pd
import pytest
from scipy import optimize, stats
from scipy.spatial.transform import Rotation

from pipeline.faults import dead_sensor, exchanged_pulls, scale_rows, unit_since
from pipeline.faults.assignment import Ring, _cycles, assigned, lines, misplacement, rings, shift
from pipeline.faults.base_names import _alike, _miss
from pipeline.faults.exchanged import _square
from pipeline.faults.exchanged_ladders import _Normal, _tried
from pipeline.faults.exchanged_pulls import PullMoves, ordered
from pipeline.faults.typing_errors import _TENS, factor, intended
from pipeline.readers.logs import FORCE

X = np.array([0.8, 1.3, 1.1])
NOISE = 2e-5


def pulls(m=24, seed=2, noise=NOISE, scatter=0.0):
    """Pulls of six poses by springs X in typical sizes, three targets each, and the true forces."""
    rng = np.random.default_rng(seed)
    G = rng.normal(size=(m, 9, 3)) * 1e-6
    force = rng.uniform(600, 3000, m)
    y = force[:, None] * (G @ X) * (1 + scatter * rng.normal(size=(m, 1)))
    y = y + noise * rng.normal(size=y.shape)
    return PullMoves(np.arange(m), y, G, force, np.full(m, 2.0), max(noise, 1e-6))


MOVED = pulls()
EXACT = pulls(noise=0.0)


def test_compliances_are_those_on_which_most_pulls_agree():
    """Exact ones of exact pulls; nearly so beside a wrong force; the inverse of all forces."""
    np.testing.assert_allclose(EXACT.solved(EXACT.force), X, rtol=1e-6)
    wrong = EXACT.force * np.where(np.arange(24) == 5, 10.0, 1.0)
    np.testing.assert_allclose(EXACT.solved(wrong), X, rtol=3e-2)
    np.testing.assert_allclose(EXACT.solved(wrong / 4), 4 * EXACT.solved(wrong), rtol=1e-2)
    order = np.random.default_rng(1).permutation(24)
    np.testing.assert_allclose(EXACT.only(order).solved(wrong[order]), EXACT.solved(wrong))


def test_the_force_that_is_due_is_that_of_a_fit_to_each_pull():
    """By numpy, with its standard uncertainty; a pull that moves nothing tells no force."""
    due, std = MOVED.due(X)
    for k in range(24):
        g = MOVED.G[k] @ X
        expected = np.linalg.lstsq(g[:, None], MOVED.y[k], rcond=None)[0][0]
        assert due[k] == pytest.approx(expected)
        assert std[k] == pytest.approx(NOISE / np.linalg.norm(g))
    still = replace(MOVED, G=MOVED.G * (np.arange(24) > 0)[:, None, None])
    assert still.due(X)[0][0] == 0.0
    assert still.due(X)[1][0] == pytest.approx(NOISE * still.force.max() / 1e-6)
    some = MOVED.only(np.array([3, 1]))
    assert some.pull.tolist() == [3, 1]
    np.testing.assert_array_equal(some.G, MOVED.G[[3, 1]])
    assert (some.noise, len(some.std)) == (NOISE, 2)
    p = stats.chi2.sf(MOVED.least, 1) * 24**2
    assert stats.chi2.sf(some.least, 1) * 4 == pytest.approx(p, rel=1e-6)


def test_what_springs_usually_leave_is_a_fraction_and_the_noise():
    """The median fraction, at least three thousandths; chi-square of a force by all three parts.

    Noise is no fraction: weak pulls, of which it is much, do not make all others unlike.
    """
    moved = pulls(scatter=0.04)
    whole = np.mean(moved.y**2, axis=1)
    weak = np.arange(len(whole)) > 13
    square = NOISE**2 + np.where(weak, 0.3, 0.02) ** 2 * whole
    np.testing.assert_allclose(moved.usual(square), NOISE**2 + 0.02**2 * whole)
    np.testing.assert_allclose(moved.usual(0 * square), NOISE**2 + 9e-6 * whole)
    np.testing.assert_allclose(moved.usual(0 * square + NOISE**2), NOISE**2 + 9e-6 * whole)
    order = np.arange(24)
    fit = exchanged_pulls._beside(moved, X, order)
    due, own = moved.due(X)
    off = np.abs(due / moved.force - 1)
    assert fit.model == pytest.approx(1.4826 * np.median(off))
    assert fit.left == pytest.approx(off.mean())
    for i, j in ((0, 0), (3, 7), (23, 2)):
        variance = own[j] ** 2 + 4.0 + (fit.model * moved.force[j]) ** 2
        assert fit.cost[i, j] == pytest.approx((moved.force[i] - due[j]) ** 2 / variance)
    assert exchanged_pulls._beside(EXACT, X, order).model == pytest.approx(0.003)


def test_displacements_across_a_force_are_no_displacements_by_it():
    """A bad reading contradicts no force: its column costs nothing."""
    y = EXACT.y.copy()
    g = EXACT.G[5] @ X
    across = np.cross(g[:3], [1.0, 2, 3])
    y[5, :3] += 40 * np.linalg.norm(y[5]) * across / np.linalg.norm(across)
    fit = exchanged_pulls._beside(replace(EXACT, y=y), X, np.arange(24))
    assert not fit.cost[:, 5].any()
    assert fit.cost[:, 4].any()


@pytest.mark.parametrize(
    "true",
    [
        {0: 3, 3: 0},
        {2: 9, 9: 15, 15: 2},
        {k: (k + 1) % 24 for k in range(24)},
        {k: k + 1 for k in range(10, 23)} | {23: 10},
    ],
)
def test_forces_in_other_rows_are_put_back(true):
    """Two, three in a ring, all by one, and all from some row on."""
    logged = EXACT.force.copy()
    for here, there in true.items():  # the number of pull `there` stands in row `here`
        logged[here] = EXACT.force[there]
    moved = replace(EXACT, force=logged)
    given = ordered(moved, np.arange(24))
    least = moved.least
    found = [exchanged_pulls.ordering(several, 24) for several in fitting(moved, given, least)]
    right = np.arange(24)
    for here, there in true.items():
        right[there] = here
    assert any((order == right).all() for order in found)
    np.testing.assert_allclose(moved.force[right], EXACT.force)
    assert not fitting(EXACT, ordered(EXACT, np.arange(24)), least)


def fitting(moved, given, least):
    """Moves after which everything fits that is moved."""
    every = exchanged_pulls._orders(moved, given, least, np.arange(24))
    return [one for one in every if one and exchanged_pulls._fitting(moved, one, least)]


def test_an_exchange_has_to_change_a_force_and_be_wrong_at_both_ends():
    """Three per cent are nothing; where one fits as it is, a number was mistyped."""
    force = EXACT.force.copy()
    force[1] = 1.02 * force[0]
    near = replace(EXACT, force=force)
    assert not exchanged_pulls._changes(near, Ring((0, 1)))
    assert exchanged_pulls._changes(
        replace(near, force=np.where(np.arange(24) == 1, 1.1, 1.0)), Ring((0, 1))
    )
    cost = np.array([[9.0, 0, 0], [0, 2.0, 0], [0, 0, 9.0]])
    assert exchanged_pulls._both(Some(cost=cost), Ring((0, 2)), 5.0)
    assert not exchanged_pulls._both(Some(cost=cost), Ring((0, 1)), 5.0)
    assert exchanged_pulls._both(Some(cost=cost), Ring((0, 1, 2)), 5.0)


def test_springs_with_forces_of_two_poses_exchanged_leave_what_numpy_leaves():
    """By V = s^2 I + u^2 g g' of each pull; a zero of the scale of its own, by all other pulls."""
    normal = _Normal.of(MOVED)
    assert normal.dof == 24 * 9 - 3
    half = []
    for g in MOVED.G @ MOVED.solved(MOVED.force):
        values, R = np.linalg.eigh(NOISE**2 * np.eye(9) + 4.0 * np.outer(g, g))
        half.append(R @ np.diag(values**-0.5) @ R.T)
    W, y = np.array(half), np.einsum("mij,mj->mi", half, MOVED.y)

    def fitted(force, some=slice(None)):
        A = (force[:, None, None] * (W @ MOVED.G))[some].reshape(-1, 3)
        x = np.linalg.lstsq(A, y[some].ravel(), rcond=None)[0]
        return x, np.sum((y[some].ravel() - A @ x) ** 2)

    for force in (MOVED.force, MOVED.force[::-1]):
        assert normal.left(force) == pytest.approx(fitted(force)[1], rel=1e-6)
    mine = np.arange(24) % 6 == 2
    shifted = MOVED.force + 150.0 * mine
    x = fitted(shifted, ~mine)[0]
    g = (W @ MOVED.G @ x)[mine]
    off = np.sum(shifted[mine, None] * g**2 - g * y[mine]) / np.sum(g**2)
    assert off == pytest.approx(150.0, abs=20)
    found = normal.another_zero(shifted, np.array([mine]))
    assert found[0] == pytest.approx(fitted(shifted - off * mine)[1], rel=1e-6)


def test_two_poses_of_as_many_pulls_are_exchanged_pull_by_pull():
    """Every pair of them, and nothing else moves."""
    pose = np.array([1, 1, 1, 2, 2, 2, 4, 4, 4, 5, 5])
    each = _tried(None, pose)
    assert len(each) >= 3
    for one in each:
        assert sorted(one) == [*range(11)]
        assert (one[one] == np.arange(11)).all()
        assert len({*pose[one != np.arange(11)].tolist()}) == 2


# --- rows of the scale ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "rows"),
    [("kgf", range(9, 24)), ("lbf", range(5, 14)), ("kn", range(16, 24)), ("kgf", [3, 4, 12, 20])],
)
def test_rows_in_another_unit_are_those_that_were_planted(unit, rows):
    """Up to an end, between others, or here and there."""
    wrong = np.isin(np.arange(24), [*rows])
    logged = EXACT.force / np.where(wrong, FORCE[unit], 1.0)
    found = scale_rows._in_unit(replace(EXACT, force=logged), np.arange(24) // 4)

    assert found.wrong.tolist() == wrong.tolist()
    assert found.factor == pytest.approx(FORCE[unit], rel=0.03)
    np.testing.assert_allclose(
        found.right(replace(EXACT, force=logged)).force, EXACT.force, rtol=0.03
    )
    assert scale_rows._in_unit(EXACT, np.arange(24) // 4) is None
    one = EXACT.force / np.where(np.arange(24) == 7, FORCE[unit], 1.0)
    assert scale_rows._in_unit(replace(EXACT, force=one), np.arange(24) // 4) is None


@pytest.mark.parametrize(
    ("wrong", "ends", "words"),
    [
        ("0011", (True, False, True), "from l:3 on"),
        ("1100", (True, True, False), "up to l:2"),
        ("0110", (True, False, False), "from l:2 to l:3"),
        ("1010", (False, True, False), "in 2 rows"),
        ("1001", (False, True, True), "in 2 rows"),
        ("1111", (True, True, True), "from l:1 on"),
        ("0101", (False, False, True), "in 2 rows"),
    ],
)
def test_rows_in_succession_are_said_by_their_ends(wrong, ends, words):
    """Up to the first or last row of the file, or in between."""
    mask = np.array([one == "1" for one in wrong])
    change = scale_rows._Change(mask, "kgf", 1)
    assert change.ends == ends
    at = tuple(f"l:{k + 1}" for k in np.flatnonzero(mask))
    assert scale_rows._said(at, *ends) == words
    assert replace(change, sign=-1).factor == pytest.approx(1 / change.factor)
    assert change.instead == ("dan",)
    assert replace(change, unit="lbf").instead == ()


@pytest.mark.parametrize(
    ("copied", "late"), [([4, 9], []), ([4, 9, 15], []), ([4, 9], [5]), ([4, 12], [5, 6])]
)
def test_numbers_of_the_row_before_are_found(copied, late):
    """And what follows them one row late; a load that was pulled again is none."""
    logged = EXACT.force.copy()
    for k in (*copied, *late):
        logged[k] = EXACT.force[k - 1]
    found = scale_rows._copied(replace(EXACT, force=logged))
    assert np.flatnonzero(found).tolist() == sorted([*copied, *late])
    again = EXACT.force.copy()
    again[[5, 11]] = again[[4, 10]]
    y = again[:, None] * (EXACT.G @ X)
    assert not scale_rows._copied(replace(EXACT, force=again, y=y)).any()
    assert not scale_rows._copied(EXACT).any()


# --- assignments ----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_contents_are_assigned_as_the_best_of_all_permutations(seed):
    """Each cycle by itself, from its least member on."""
    cost = np.random.default_rng(seed).uniform(0, 10, (6, 6))
    place = optimize.linear_sum_assignment(cost)[1]
    best = min(permutations(range(6)), key=lambda one: sum(cost[k, p] for k, p in enumerate(one)))
    assert place.tolist() == list(best)
    order = assigned(cost)  # which content belongs in each place
    assert sorted(order) == [*range(6)]
    assert sum(cost[order[k], k] for k in range(6)) == pytest.approx(
        sum(cost[k, p] for k, p in enumerate(best))
    )
    cycles = _cycles(place)
    assert sorted(k for one in cycles for k in one) == [*range(6)]
    for one in cycles:
        assert one[0] == min(one)
        assert [place[k] for k in one] == [*one[1:], one[0]]


def test_a_move_is_worth_its_threshold():
    """Two that fit each other's place much better; neither alone, nor where one then fits badly."""
    cost = np.array([[90.0, 1, 90], [1, 90, 90], [90, 90, 1]])
    assert rings(cost, 10.0, 5.0) == [Ring((0, 1))]
    assert rings(cost, 100.0, 5.0) == []
    assert rings(np.where(cost == 1, 6.0, cost), 10.0, 5.0) == []
    assert rings(cost[:1, :1], 10.0, 5.0) == []
    ended = np.full((5, 5), 900.0)
    for k in range(4):
        ended[k, k + 1] = 1.0
    (ring,) = rings(ended, 10.0, 5.0)
    assert (ring.members, ring.ended) == ((0, 1, 2, 3, 4), True)
    assert ring.moves == [(0, 1), (1, 2), (2, 3), (3, 4)]
    assert ring.by_one


def test_rings_are_said_by_their_arrangement():
    """One place late or early, with or without a last one that belongs nowhere."""
    order = np.arange(5)
    for step, way, rest in ((1, "early", "those of the last"), (-1, "late", "those of the first")):
        for ended, where in ((True, "belong nowhere"), (False, "belong to the")):
            ring = shift(order, step, ended)
            assert ring.by_one
            assert len(ring.moves) == 5 - ended
            assert all(there - here in (step, -4 * step) for here, there in ring.moves)
            said = misplacement(ring, "row")
            assert said.startswith(f"one row too {way}; {rest} {where}")
    assert misplacement(Ring((0, 1)), "row") == "in each other's place"
    assert misplacement(None, "row") == "in each other's place"
    assert not Ring((0, 2, 1, 4)).by_one
    assert Ring((0, 2)).among(np.array([7, 8, 9])).members == (7, 9)
    assert Ring((0, 1)).where(["b", "a"]) == "a/b"
    assert Ring((0, 1, 2)).where(["b", "a", "c"]) == "a/c off by one"


def test_lines_are_joined_where_they_follow_each_other():
    """Of one file; of very many only some are named."""
    assert lines(["l:8", "l:9", "l:10", "l:12", "k:13"]) == "l:8–10, l:12, k:13"
    assert lines(["l:3"]) == "l:3"
    every = [f"l:{k}" for k in range(1, 19, 2)]
    assert lines(every) == ", ".join(every[:6]) + " and 3 more lines"
    assert lines(["whole", "l:4", "l:5"]) == "whole, l:4–5"
    assert lines(["l:4", "l:4", "k:2", "l:4"]) == "l:4, k:2"  # both ends of a chain by its row


def test_names_of_base_reflectors_are_tried_if_their_distances_agree():
    """All permutations within six centimetres, as a search over all of them finds; each a miss."""
    rng = np.random.default_rng(4)
    nominal = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [0.3, 0.2, 1.5]])
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn = turn * np.sign(np.linalg.det(turn))
    seen = nominal[[1, 0, 2, 3, 4]] @ turn.T + [4.0, 5, 6]

    def apart(at):
        return np.array([np.linalg.norm(at[i] - at[j]) for i, j in combinations(range(5), 2)])

    fits = {
        one for one in permutations(range(5))
        if (np.abs(apart(nominal[list(one)]) - apart(seen)) < 0.06).all()
    }  # fmt: skip
    assert {*_alike(seen, nominal)} == fits
    assert (1, 0, 2, 3, 4) in fits
    assert _miss(seen, nominal, (1, 0, 2, 3, 4)) == pytest.approx(0.0, abs=1e-9)
    assert _miss(seen, nominal, range(5)) > 0.1
    off = seen.copy()
    off[2] += [0.03, 0, 0]
    best = optimize.minimize(
        lambda v: np.sum((seen_by(v, off) - nominal[[1, 0, 2, 3, 4]]) ** 2), start(turn), tol=1e-14
    )
    assert _miss(off, nominal, (1, 0, 2, 3, 4)) == pytest.approx(np.sqrt(best.fun / 5), rel=1e-3)


def seen_by(v, points):
    """Points after a rotation vector and a shift."""
    return Rotation.from_rotvec(v[:3]).apply(points) + v[3:]


def start(turn):
    """The motion back, nearly."""
    return np.append(Rotation.from_matrix(turn.T).as_rotvec(), -turn.T @ [4.0, 5, 6])


# --- sensors and units ----------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_the_run_of_greatest_sum_is_that_of_all_runs(seed):
    """None where every term is negative."""
    gain = np.random.default_rng(seed).normal(size=9)
    runs = [(i, j) for i in range(10) for j in range(i, 10)]
    best = max(gain[i:j].sum() for i, j in runs)
    found = dead_sensor._greatest(gain)
    assert gain[found].sum() == pytest.approx(best)
    assert gain[dead_sensor._greatest(-np.abs(gain))].size == 0


def test_a_dead_run_is_cut_by_how_the_others_follow():
    """Twenty displacements that follow by half, of which five in a row are nothing."""
    rng = np.random.default_rng(1)
    due = rng.uniform(1, 2, 20)
    for b in (0.5, 0.15, 3.0):
        seen = b * due * (1 + 0.1 * rng.normal(size=20))
        seen[7:12] = 0.01 * rng.normal(size=5)
        run, least = next(dead_sensor._dead_runs(due, seen))
        assert (run.start, run.stop) == (7, 12)
        others = np.delete(np.arange(20), np.arange(7, 12))
        follows = seen[others].sum() / due[others].sum()
        assert least == pytest.approx(max(1 / 30, follows / 10), rel=0.2)


def test_displacements_are_unrelated_if_they_follow_by_no_tenth():
    """Of nine coordinates at least; exact zeros, or noise about them."""
    rng = np.random.default_rng(2)
    moved = rng.normal(size=(12, 3)) * 1e-3
    noise = rng.normal(size=(12, 3))
    assert dead_sensor._unrelated(moved, np.zeros((12, 3)))
    assert dead_sensor._unrelated(moved, 1e-5 * noise)
    assert not dead_sensor._unrelated(moved, moved)
    assert not dead_sensor._unrelated(moved, 0.5 * moved + 1e-5 * noise)
    assert not dead_sensor._unrelated(moved, 2e-2 * noise)  # farther than any robot
    assert not dead_sensor._unrelated(moved[:2], np.zeros((2, 3)))
    assert dead_sensor._unrelated(moved[:3], np.zeros((3, 3)))
    assert not dead_sensor._unrelated(1e-2 * moved, np.zeros((12, 3)))  # nothing was due


@pytest.mark.parametrize("n", [4, 10, 40])
def test_readings_follow_others_beyond_four_standard_errors_of_a_correlation(n):
    """By the t of scipy's correlation; whatever offset and factor."""
    rng = np.random.default_rng(n)
    for share in (0.0, 0.5, 0.9, 0.99):
        g = rng.normal(size=n)
        f = 30 + 5 * (share * g + np.sqrt(1 - share**2) * rng.normal(size=n))
        r = stats.pearsonr(f, g).statistic
        t = r * np.sqrt((n - 2) / (1 - r**2))
        assert dead_sensor._correlated(f, g) == dead_sensor._correlated(-f, g) == (abs(t) > 4)
    assert dead_sensor._correlated(2 * g + 1, g)
    assert not dead_sensor._correlated(np.ones(n), g)


def test_a_group_is_too_small_by_the_ratio_of_its_spread():
    """Root of the summed variances; of a target read twice the first counts."""
    places = {"a": (0, 0, 0), "b": (0.3, 0, 0), "c": (0, 0.4, 0), "d": (0, 0, 0.5)}
    at = np.array([places[k] for k in "abcd"])
    names = np.array([*"abcd"], object)
    for f in (1.0, 25.4, 1e-3):
        assert unit_since._too_small(places, names, at / f + 7.0) == pytest.approx(f)
    twice = np.vstack([at[:3] / 10, [9.0, 9, 9]])
    assert unit_since._too_small(places, np.array([*"abca"], object), twice) == pytest.approx(10)
    assert np.isnan(unit_since._too_small(places, np.array(["a", "a", "x"], object), at[:3]))


@pytest.mark.parametrize(
    ("wrong", "first"),
    [("000111", 3), ("001111", 2), ("011111", None), ("000011", 4), ("000001", None),
     ("000000", None), ("001011", None), ("111111", None), ("110000", None)],
)  # fmt: skip
def test_a_unit_changes_once_with_two_rows_on_either_side(wrong, first):
    """From a row on all are wrong, and all before are right."""
    mask = np.array([one == "1" for one in wrong])
    assert unit_since._from(mask, ~mask) == first
    unknown = ~mask & (np.arange(6) != 0)
    assert unit_since._from(mask, unknown) is None


@pytest.mark.parametrize("first", [5, 6, 7, 8])
def test_the_row_of_a_group_at_which_the_unit_changes_is_found(first):
    """Back from the group in which all are wrong, to the rows nearer to the others as read."""
    rng = np.random.default_rng(3)
    at = np.array([2.0, 3.0, 4.0]) + 0.2 * rng.normal(size=(12, 3))
    scaled = np.arange(12) >= first
    rows = pd.DataFrame(np.where(scaled[:, None], at / 25.4, at), columns=["x_m", "y_m", "z_m"])
    rows["group"] = np.repeat(["a", "b", "c"], 4)
    wrong = rows["group"] == "c"
    found = unit_since._in_mid_group(rows, wrong, rows.index, 25.4)
    assert found.tolist() == scaled.tolist()
    assert wrong.sum() == 4  # the given one stays as it was


def test_groups_are_held_against_all_poses_by_their_mean_square():
    """Targets that were not read do not count."""
    rng = np.random.default_rng(5)
    placed, table = rng.normal(size=(3, 4, 3)), rng.normal(size=(2, 4, 3))
    placed[1, 2] = np.nan
    found = _square(placed, table)
    for g in range(3):
        for p in range(2):
            d = np.sum((placed[g] - table[p]) ** 2, axis=1)
            assert found[g, p] == pytest.approx(d[np.isfinite(d)].mean())


def test_a_typing_error_is_the_nearest_that_fits():
    """Factors of ten by their names; a gain in tenths, but no whole one."""
    for ten in _TENS:
        number, slip = intended(1234.5, 1234.5 * ten * 1.001, 0.01 * 1234.5 * ten)
        assert number == pytest.approx(1234.5 * ten)
        assert slip == "the decimal point in the wrong place"
    for tenths in (3, 7, 12, 15, 25):
        times = tenths / 10
        assert factor(1000.0 * times, 1000.0, 1.0) == times
        assert factor(1000.0 * times, 1030.0, 1.0) is None
    for whole in (0, 1, 2, 3):
        assert factor(1000.0 * whole, 1000.0, 1.0) is None
    assert factor(1000.0, 0.0, 1.0) is None
    assert factor(-500.0, 1000.0, 1.0) is None


@pytest.mark.parametrize(
    ("sizes", "turned", "pose", "noise", "unlike"),
    [
        ([1.0, 2.0, 4.0, 8.0], 0.0, [1, 1, 1, 1], 1e-5, True),
        ([1.0, 1.1, 1.2, 1.25], 0.0, [1, 1, 1, 1], 1e-5, False),
        ([1.0, 2.0, 4.0, 8.0], 0.5, [1, 1, 1, 1], 1e-5, False),
        ([1.0, 2.0, 4.0, 8.0], 0.0, [1, 1, 2, 2], 1e-5, False),
        ([1.0, 2.0, 4.0, 8.0], 0.0, [1, 1, 1, 1], 1e-3, False),
        ([1.0, 1.0, 1.0, 8.0], 0.0, [1, 1, 1, 1], 1e-5, False),
        ([1.0, 1.0, 4.0, 8.0], 0.0, [1, 1, 1, 1], 1e-5, True),
    ],
)  # fmt: skip
def test_equal_forces_along_one_chain_move_a_robot_alike(sizes, turned, pose, noise, unlike):
    """By a third at most; other directions, other poses and what the noise hides do not count."""
    angle = turned * np.arange(4)
    force = 1000 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    delta = 1e-3 * np.outer(np.repeat(sizes, 2), [0.6, 0.0, 0.8])
    C = np.tile(noise**2 / 2 * np.eye(3), (8, 1, 1))
    data = Some(
        delta=delta, pull=np.repeat(np.arange(4), 2), loaded_cov=C, zero_cov=C, noise_stated=True,
        pulls=Lengthy(pose=np.array(pose), force=force),
    )  # fmt: skip
    size = np.linalg.norm(force, axis=1)
    assert dead_sensor._unlike(data, np.arange(4), size) == unlike


class Lengthy(Some):
    """Pulls, as many as poses."""

    def __len__(self):
        """Their number."""
        return len(self.pose)


@pytest.mark.parametrize(("noise", "model"), [(1e-7, 0.05), (3e-5, 1e-3)])
def test_states_of_a_pose_put_back_are_off_by_their_usual_misfit(noise, model, monkeypatch):
    """Zero and a pull exchanged; then each is off by about one, whichever makes the scatter."""
    rng, after = np.random.default_rng(9), []
    zero = np.array([True, False, False, False])
    names = [(f"g{k}", k) for k in range(4)]
    for _ in range(25):
        due = np.outer([0.0, 1.0, 1.6, 2.2], rng.normal(size=9)) * 1e-3
        off = model * rng.normal(size=(4, 9)) * np.sqrt(np.mean(due**2, axis=1))[:, None]
        Y = rng.normal(size=9) + due + off + noise * rng.normal(size=(4, 9))
        Y[[0, 2]] = Y[[2, 0]]
        states = Y, due, zero, names
        monkeypatch.setattr(exchanged_pulls, "_whole_states", lambda *_, states=states: states)
        ((ring, told, before, left),) = exchanged_pulls._in_pose(None, None, {}, noise, model)
        assert ({*ring.members}, told) == ({0, 2}, names)
        assert before > 10 * left
        after.append(left)
        Y[[0, 2]] = Y[[2, 0]]
        assert not [*exchanged_pulls._in_pose(None, None, {}, noise, model)]
    assert 0.4 < np.median(after) < 2.0
