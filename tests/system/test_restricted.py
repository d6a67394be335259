"""The restricted likelihood by pose against the whole matrix, and its maximum."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
from made_system import TYPICAL, dense, made, restricted
from scipy import optimize, stats

from pipeline.base.arrays import Parameter
from pipeline.system.restricted import PaddedRows, lowest, maximum
from pipeline.system.system import Errors, RowIndex, System

GROUPS = [("tracker", "zero"), ("force_reading",)]
SYSTEM = made(np.random.default_rng(31), pulls=(3, 2, 4, 3, 3), scales=(1.4, 2.0))
B = SYSTEM.B * TYPICAL
M = len(SYSTEM.c)
BOTH = np.array([True, True])


def whole(log_scale, system=SYSTEM, X=B):
    """The same by the textbook, with V as one matrix."""
    tracker, force = np.exp(log_scale)
    scale = {"tracker": tracker, "zero": tracker, "force_reading": force}
    return restricted(X, system.c, dense(system, scale))


def one_way(y, pose, sigma=1.0):
    """Rows with independent errors of one size only."""
    n = len(y)
    return System(
        parameters=(Parameter("mean", "m", 1.0),),
        rows=RowIndex(pose, pose, np.full(n, "P", object), pose * 0, pose),
        B=np.ones((n, 1)),
        c=y,
        errors=Errors(
            scipy.sparse.csr_array(sigma * np.eye(n)),
            np.full(n, "tracker", object),
            np.zeros(n, bool),
        ),
        noise_stated=True,
    )


@pytest.mark.parametrize("common", [True, False])
def test_the_loss_is_the_restricted_likelihood_of_the_whole_matrix(common):
    """Up to a constant: differences between scales, with and without errors common to all poses."""
    system = SYSTEM if common else made(np.random.default_rng(8), common=False)
    X = system.B * TYPICAL
    blocks = PaddedRows.of(system, X, GROUPS)
    start = blocks.whole(np.zeros(2)) - whole(np.zeros(2), system, X)

    for log_scale in np.random.default_rng(1).uniform(-1, 1, (6, 2)):
        expected = whole(log_scale, system, X)
        assert blocks.whole(log_scale) - start == pytest.approx(expected, abs=1e-6)
        own, rest = blocks.loss(log_scale)
        assert own.sum() + rest == pytest.approx(blocks.whole(log_scale))


def test_one_crowded_pose_is_no_padding_of_the_others():
    """The same likelihood; the covariances kept are those of each pose, of its own size."""
    system = made(np.random.default_rng(8), pulls=(3, 24, 2, 3))
    blocks = PaddedRows.of(system, system.B * TYPICAL, GROUPS)
    scales = np.array([[0.0, 0.0], [0.6, -0.4]])
    expected = np.subtract(*(whole(t, system, system.B * TYPICAL) for t in scales))
    rows = np.unique(system.rows.pose, return_counts=True)[1]

    assert np.subtract(*(blocks.whole(t) for t in scales)) == pytest.approx(expected, abs=1e-6)
    assert sum(group.parts[0].size for group in blocks.together) == (rows**2).sum()


def test_the_part_of_a_pose_is_its_own_density():
    """log|V_p| + r'V_p^-1 r of its rows and its own errors, r from ordinary least squares.

    The size of the displacements does not affect how much the scatter of poses differs.
    """
    blocks = PaddedRows.of(SYSTEM, B, GROUPS)
    unit = np.sqrt(np.mean(SYSTEM.c**2))
    V = dense(SYSTEM, {"force_reading": np.exp(0.4)}, common=False)
    own, _ = blocks.loss(np.array([0.0, 0.4]))
    r = SYSTEM.c - B @ np.linalg.lstsq(B, SYSTEM.c, rcond=None)[0]

    for pose, found in zip(np.unique(SYSTEM.rows.pose), own, strict=True):
        mine = pose == SYSTEM.rows.pose
        here, y = V[mine][:, mine], r[mine]
        log = np.linalg.slogdet(here / unit**2)[1]
        assert found == pytest.approx(log + y @ np.linalg.solve(here, y))


def test_sources_that_no_component_names_stay_as_stated():
    """For the force alone, the scale is the component; tracker and zeros are the rest."""
    blocks = PaddedRows.of(SYSTEM, B, GROUPS[1:])
    found = [blocks.whole(np.array([t])) for t in (0.0, 0.8)]

    assert found[1] - found[0] == pytest.approx(
        whole(np.array([0.0, 0.8])) - whole(np.zeros(2)), abs=1e-6
    )


def test_dependent_fixed_effects_count_once():
    """A twin in any unit: the same likelihood and the same degrees of freedom."""
    twin = np.column_stack([B, 1e3 * (B[:, 0] - B[:, 1])])
    plain, twice = (PaddedRows.of(SYSTEM, X, GROUPS) for X in (B, twin))
    scales = np.array([[0.0, 0.0], [0.5, -0.3]])
    change = [np.subtract(*(blocks.whole(t) for t in scales)) for blocks in (plain, twice)]

    assert plain.dof == twice.dof == M - 3
    assert change[1] == pytest.approx(change[0])


def test_nothing_is_estimated_where_there_are_no_fixed_effects():
    """Without fixed effects and common errors the likelihood is that of the data themselves."""
    system = made(np.random.default_rng(8), common=False)
    blocks = PaddedRows.of(system, np.zeros((len(system.c), 0)), GROUPS)
    unit = np.sqrt(np.mean(system.c**2))
    V = dense(system)

    assert blocks.dof == len(system.c)
    expected = np.linalg.slogdet(V / unit**2)[1] + system.c @ np.linalg.solve(V, system.c)
    assert blocks.whole(np.zeros(2)) == pytest.approx(expected)


def test_errors_that_leave_a_direction_without_scatter_are_impossible():
    """One zero for all rows of a pose and no tracker: V is singular, and the loss undefined."""
    keep = SYSTEM.errors.source != "tracker"
    errors = Errors(
        SYSTEM.errors.G[:, keep], SYSTEM.errors.source[keep], SYSTEM.errors.common[keep]
    )
    blocks = PaddedRows.of(replace(SYSTEM, errors=errors), B, GROUPS[1:])

    assert blocks.whole(np.zeros(1)) == np.inf


def test_the_rough_scale_is_the_root_of_mean_squares():
    """Residuals of the fixed effects over the sum of all components, both summed over the rows."""
    blocks = PaddedRows.of(SYSTEM, B, GROUPS)
    r = SYSTEM.c - B @ np.linalg.lstsq(B, SYSTEM.c, rcond=None)[0]
    stated = np.trace(dense(SYSTEM, common=False))

    assert np.exp(2 * blocks.rough) == pytest.approx(r @ r / stated)
    alone = np.trace(dense(SYSTEM, {"tracker": 0.0, "zero": 0.0}, common=False))
    rough = PaddedRows.of(SYSTEM, B, GROUPS[1:]).rough
    assert np.exp(2 * rough) == pytest.approx(r @ r / alone)


def test_one_component_has_the_scale_of_its_mean_square():
    """s^2 = r'r / (n - 1), u(ln s) = 1 / sqrt(2 (n - 1)) if poses agree; p of the textbook."""
    pose = np.repeat(np.arange(10), 4)
    y = 0.7 * np.tile([1.0, -1.0, 1.0, -1.0], 10)  # all poses alike, about a mean of zero
    (t,), (std,), (p,) = maximum(PaddedRows.of(one_way(y, pose), np.ones((40, 1)), [("tracker",)]),
                                 np.array([True]))  # fmt: skip
    total, dof = y @ y, 39
    ratio = total - dof - dof * np.log(total / dof)

    assert np.exp(2 * t) == pytest.approx(total / dof, rel=1e-3)
    assert std == pytest.approx(1 / np.sqrt(2 * dof), rel=1e-3)
    assert p == pytest.approx(1 - stats.chi2.sf(ratio, 1) / 2, rel=1e-3)


@pytest.mark.parametrize("loud", [3.0, 6.0])
def test_poses_that_scatter_unlike_each_other_make_the_scale_less_sure(loud):
    """White's sandwich of squared scores of the poses, written out for one component."""
    pose, size = np.repeat(np.arange(8), 5), np.ones(8)
    size[0] = loud
    y = np.repeat(size, 5) * np.tile([1.2, -1.1, 1.0, -1.3, 1.1], 8)
    blocks = PaddedRows.of(one_way(y, pose), np.zeros((40, 0)), [("tracker",)])
    (t,), (std,), (p,) = maximum(blocks, np.array([True]))
    squares = np.array([np.sum(y[pose == k] ** 2) for k in range(8)])
    square = squares.sum() / 40
    scores = 2 * 5 - 2 * squares / square
    sandwich = scores @ scores / (4 * 40) ** 2
    longer = sandwich * (2 * 40)
    ratio = squares.sum() - 40 - 40 * np.log(square)

    assert longer > 2
    assert np.exp(2 * t) == pytest.approx(square, rel=1e-3)
    assert std == pytest.approx(np.sqrt(sandwich), rel=1e-3)
    assert p == pytest.approx(stats.chi2.sf(ratio / longer, 1) / 2, rel=2e-2)


def test_two_scales_are_where_the_whole_likelihood_is_largest():
    """Found by another method on the whole matrix; curvature there by differences."""
    t, std, p = maximum(PaddedRows.of(SYSTEM, B, GROUPS), BOTH)
    found = optimize.minimize(whole, np.zeros(2), method="Nelder-Mead", options={"xatol": 1e-5})
    h = 0.02 * np.eye(2)
    H = [
        [
            (
                whole(found.x + a + b) - whole(found.x + a - b)
                - whole(found.x - a + b) + whole(found.x - a - b)
            ) / (4 * 0.02**2)
            for b in h
        ]
        for a in h
    ]  # fmt: skip

    assert t == pytest.approx(found.x, abs=1e-3)
    information = np.sqrt(2 * np.diag(np.linalg.inv(H)))
    assert (std > 0.995 * information).all()
    assert (std < 2 * information).all()
    longer = (std / information) ** 2
    for k in range(2):
        other = optimize.minimize_scalar(
            lambda s, k=k: whole(np.insert(np.array([s]), k, 0.0)), bounds=(-2, 3)
        ).fun
        tail = stats.chi2.sf((other - found.fun) / longer[k], 1) / 2
        assert p[k] == pytest.approx(tail if t[k] > 0 else 1 - tail, rel=0.03)


def test_a_component_that_is_not_asked_stays_as_stated():
    """Of two components one is estimated, with the other at its stated size."""
    (t,), _, (p,) = maximum(PaddedRows.of(SYSTEM, B, GROUPS), np.array([False, True]))
    found = optimize.minimize_scalar(lambda s: whole(np.array([0.0, s])), bounds=(-2, 3))
    ratio = whole(np.zeros(2)) - found.fun

    assert t == pytest.approx(found.x, abs=1e-3)
    assert p < 0.5
    assert stats.chi2.isf(2 * p, 1) <= ratio * 1.01  # poses that differ only lower it


def test_a_component_that_is_not_there_has_no_uncertainty():
    """Forces without scatter: how small it is remains unknown, and the tracker is still found."""
    rng = np.random.default_rng(12)
    quiet = made(rng, pulls=(3, 3, 3, 3, 3, 3), force_m=1e-7, scales=(1.0, 1.0))
    t, std, p = maximum(PaddedRows.of(quiet, quiet.B * TYPICAL, GROUPS), BOTH)

    assert np.isinf(std[1])
    assert np.isfinite(std[0])
    assert abs(t[0]) < 4 * std[0]
    assert p[1] > 0.05


@pytest.mark.whole
def test_what_is_claimed_of_scales_holds_for_drawn_campaigns():
    """100 campaigns: unbiased, with true uncertainties and uniform p-values.

    The mean lies within three standard errors of the truth, and the spread of errors over their
    claimed uncertainty is known to 7 %.
    """
    rng = np.random.default_rng(77)
    t, std, p = [], [], []
    for _ in range(100):
        drawn = made(rng, pulls=(3, 3, 3, 3, 3, 3, 3, 3), force_m=1e-4, common=False)
        found = maximum(PaddedRows.of(drawn, drawn.B * TYPICAL, GROUPS), BOTH)
        for kept, one in zip((t, std, p), found, strict=True):
            kept.append(one)
    off = np.array(t) / np.array(std)

    assert np.abs(np.mean(t, axis=0)).max() < 3 * np.max(np.std(t, axis=0)) / 10 + 0.02
    assert (off.std(axis=0) > 0.75).all()
    assert (off.std(axis=0) < 1.3).all()
    assert np.mean(np.array(p) < 0.1) == pytest.approx(0.1, abs=0.07)
    assert np.mean(np.array(p) > 0.9) == pytest.approx(0.1, abs=0.07)


def test_the_lowest_place_of_a_valley_is_found():
    """In a curved valley the minimum; in one that falls for ever, four from the start."""

    def bent(x):
        a, b = x[0] - 0.3, x[1] + 0.5 - 0.4 * x[0]
        return np.array([np.cosh(2 * a)]), np.cosh(b) + a * b

    def falling(x):
        return np.array([x[0], 0.0]), 0.0

    assert lowest(bent, np.array([1.5, -1.5])) == pytest.approx([0.3, -0.38], abs=1e-3)
    assert lowest(falling, np.array([0.2])) == pytest.approx([-3.8])
    assert lowest(falling, np.zeros(0)).shape == (0,)


def test_a_valley_that_rounding_ends_is_left_where_it_is_still_known():
    """Below 1 the loss is not a number, as of rows whose noise is zero."""

    def broken(x):
        return np.array([x[0] if x[0] > 1 else np.nan]), 0.0

    found = lowest(broken, np.array([2.0]))

    assert np.isfinite(found).all()
    assert found[0] < 2.0
