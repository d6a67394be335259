"""The estimate against textbook formulas on dense matrices, also with poor data."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
from hypothesis import given, settings
from hypothesis import strategies as st
from made_system import dense as whole
from made_system import restricted
from scipy import linalg, optimize, stats

from pipeline.base.arrays import Parameter
from pipeline.machine.cell import Tool, paper_cell, predict
from pipeline.machine.effect import Pulls
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load
from pipeline.reduction.measured import Measured
from pipeline.reduction.settings import Scale
from pipeline.system.assemble import assemble
from pipeline.system.estimate import (
    identifiable,
    identify,
    is_plausible,
    least_squares,
    left_out,
    solve,
    tracker_noise,
)
from pipeline.system.system import Errors, Goodness, RowIndex, System
from pipeline.system.whiten import whitener

X = np.array([1.25e-8, 2.6e-7, 2.1e-6])
TYPICAL = np.array([1.3e-8, 3.0e-7, 2.0e-6])


def system(rng, poses=(6, 9, 3, 6), stated=True):
    """Poses of unequal size, own noise per row, one shared zero per pose, two common errors."""
    pose = np.repeat(np.arange(len(poses)) * 3 + 1, poses)
    M = len(pose)
    B = rng.normal(size=(M, 3)) * 3e-3 / TYPICAL
    own = np.diag(rng.uniform(2e-5, 5e-5, M))
    zero = (pose[:, None] == np.unique(pose)).astype(float) * 3e-5
    common = np.column_stack([B @ X * 2e-3, 1e-5 * rng.normal(size=M)])
    G = np.hstack([own, zero, common])
    source = ["tracker"] * M + ["zero"] * len(poses) + ["force_gain", "registration"]
    shared = np.array([name in ("force_gain", "registration") for name in source])
    rows = RowIndex(pose, np.ones(M, int), np.full(M, "P1", object), np.arange(M) % 3, np.arange(M))
    return System(
        parameters=tuple(Parameter(f"c{k}", "m/N", t, 0.0) for k, t in enumerate(TYPICAL)),
        rows=rows,
        B=B,
        c=B @ X + G @ rng.standard_normal(G.shape[1]),
        errors=Errors(scipy.sparse.csr_array(G), np.array(source, object), shared),
        noise_stated=stated,
    )


def dense(made, keep=slice(None)):
    """x, its covariance and chi2 by the textbook, with V inverted directly."""
    V = (made.errors.G @ made.errors.G.T).toarray()[keep][:, keep]
    B, c = made.B[keep] * TYPICAL, made.c[keep]
    W = np.linalg.inv(V)
    cov = np.linalg.inv(B.T @ W @ B)
    x = cov @ B.T @ W @ c
    r = c - B @ x
    return TYPICAL * x, TYPICAL[:, None] * cov * TYPICAL, r @ W @ r


@pytest.fixture
def rng():
    return np.random.default_rng(17)


def test_whitening_is_the_inverse_root_of_the_whole_covariance(rng):
    """W V W' = I with shared zeros and errors common to all poses."""
    made = system(rng)
    V = (made.errors.G @ made.errors.G.T).toarray()
    white = whitener(made.errors, made.rows.pose)

    assert np.abs(white(white(V).T) - np.eye(len(V))).max() < 1e-12


def test_rows_of_a_pose_need_not_be_neighbours(rng):
    """Shuffled rows give the same estimate."""
    made = system(rng)
    order = rng.permutation(len(made.rows))
    rows = RowIndex(
        *(getattr(made.rows, f)[order] for f in ("pose", "repeat", "target", "axis", "pull"))
    )
    errors = replace(made.errors, G=made.errors.G[order])
    mixed = replace(made, rows=rows, B=made.B[order], c=made.c[order], errors=errors)

    assert solve(mixed, X).value == pytest.approx(solve(made, X).value, rel=1e-10, abs=0)


def test_the_estimate_is_generalised_least_squares(rng):
    """Value, covariance and chi2 are those of the textbook on dense matrices."""
    made = system(rng)
    x, cov, chi2 = dense(made)
    found = solve(made, TYPICAL)

    assert found.value == pytest.approx(x, rel=1e-9, abs=0)
    assert found.cov == pytest.approx(cov, rel=1e-9, abs=0)
    assert found.chi2 == pytest.approx(chi2, rel=1e-9)
    assert found.dof == 24 - 3
    assert found.p_value == pytest.approx(stats.chi2.sf(chi2, 21))


def test_left_out_poses_are_estimated_without_themselves(rng):
    """The closed form equals refitting on the other poses with the textbook."""
    made = system(rng)
    ours = left_out(made)

    for pose in np.unique(made.rows.pose):
        out = made.rows.pose == pose
        x, *_ = dense(made, ~out)
        assert ours[out] == pytest.approx(made.c[out] - made.B[out] @ x, abs=1e-12)


def test_what_only_one_pose_determines_cannot_be_predicted_there(rng):
    """A parameter that acts in one pose only.

    That pose has no left-out residual, the others have.
    """
    made = system(rng)
    B = made.B.copy()
    alone = made.rows.pose == made.rows.pose[0]
    B[~alone, 2] = 0.0

    left = left_out(replace(made, B=B))

    assert np.isnan(left[alone]).all()
    assert np.isfinite(left[~alone]).all()


def test_noise_that_is_not_stated_comes_from_the_residuals(rng):
    """Scaling all error columns changes nothing; intervals are Student's."""
    made = system(rng, stated=False)
    louder = replace(made, errors=replace(made.errors, G=made.errors.G * 2))
    one, two = solve(made, TYPICAL), solve(louder, TYPICAL)

    assert one.std == pytest.approx(two.std, rel=1e-9, abs=0)
    assert one.p_value is None
    assert one.noise_from == "residuals"
    assert one.quantile == pytest.approx(stats.t.ppf(0.975, 21))


def test_a_column_of_rounding_noise_is_not_identifiable_and_spoils_nothing(rng):
    """The others keep their values; the undetermined one has no finite uncertainty."""
    made = system(rng)
    B = made.B.copy()
    B[:, 1] = rng.normal(size=len(B)) * 1e-16 / TYPICAL[1]
    two = replace(made, B=B[:, [0, 2]], parameters=(made.parameters[0], made.parameters[2]))
    found, alone = solve(replace(made, B=B), TYPICAL), solve(two, TYPICAL[[0, 2]])

    assert found.identifiable.tolist() == [True, False, True]
    assert np.isinf(found.std[1])
    assert found.value[[0, 2]] == pytest.approx(alone.value, rel=1e-9, abs=0)
    assert found.std[[0, 2]] == pytest.approx(alone.std, rel=1e-9, abs=0)


def test_fewer_rows_than_unknowns_determine_nothing(rng):
    """Two rows for three unknowns: no value is called identifiable."""
    found = solve(system(rng, poses=(2,)), TYPICAL)

    assert not found.identifiable.any()


def test_twins_are_not_identifiable_and_the_rest_is_given(rng):
    """Two equal columns: neither has a value, the third does."""
    made = system(rng)
    B = made.B.copy()
    B[:, 1] = B[:, 0] * TYPICAL[0] / TYPICAL[1]
    found = solve(replace(made, B=B), TYPICAL)

    assert found.identifiable.tolist() == [False, False, True]


def test_weak_data_are_said_to_be_weak(rng):
    """An unknown whose typical size moves the data by less than a sigma is not identifiable."""
    made = system(rng)
    B = made.B.copy()
    B[:, 0] *= 1e-3
    found = solve(replace(made, B=B, c=made.c + (B - made.B) @ X), TYPICAL)

    assert found.identifiable.tolist() == [False, True, True]
    assert np.isfinite(found.std).all()


def test_a_large_estimate_of_what_hardly_shows_is_scatter():
    """2.6 sigmas suffice at twice the typical size, but not if one sigma is nine typical sizes."""
    typical = np.ones(4)

    told = identifiable(typical, np.array([0.1, 2.6, 23.4, 45.0]), np.array([0.4, 1.0, 9.0, 9.0]))

    assert told.tolist() == [True, True, False, True]


FEW = settings(derandomize=True, max_examples=25, deadline=None)


def shuffled(made, order):
    """The same system with its rows in another order."""
    rows = RowIndex(
        *(getattr(made.rows, f)[order] for f in ("pose", "repeat", "target", "axis", "pull"))
    )
    errors = replace(made.errors, G=made.errors.G[order])
    return replace(made, rows=rows, B=made.B[order], c=made.c[order], errors=errors)


def in_units(made, factor):
    """The same system with the unit of each parameter divided by `factor`."""
    parameters = tuple(
        replace(p, typical=p.typical * f) for p, f in zip(made.parameters, factor, strict=True)
    )
    return replace(made, parameters=parameters, B=made.B / factor)


SIZES = st.lists(st.integers(2, 8), min_size=2, max_size=5)


@FEW
@given(seed=st.integers(0, 10**6), poses=SIZES)
def test_any_campaign_is_solved_as_the_textbook_does(seed, poses):
    """Poses of any sizes, rows shuffled: value, covariance, chi2 and residual of the textbook."""
    rng = np.random.default_rng(seed)
    made = system(rng, (4, *poses))
    made = shuffled(made, rng.permutation(len(made.rows)))
    x, cov, chi2 = dense(made)
    found = solve(made, np.zeros(3))

    assert found.value == pytest.approx(x, rel=1e-7, abs=0)
    unit = np.outer(TYPICAL, TYPICAL)
    assert found.cov / unit == pytest.approx(cov / unit, rel=1e-7, abs=1e-12)
    assert found.chi2 == pytest.approx(chi2, rel=1e-6)
    assert found.residual == pytest.approx(made.c - made.B @ x, abs=1e-12)
    assert found.residual_std_m == pytest.approx(
        np.linalg.norm(made.c - made.B @ x) / np.sqrt(4 + sum(poses) - 3), rel=1e-6
    )


@FEW
@given(
    seed=st.integers(0, 10**6),
    powers=st.tuples(*[st.integers(-6, 6)] * 3),
    stated=st.booleans(),
)
def test_no_answer_depends_on_units_or_order(seed, powers, stated):
    """Other units of the parameters and shuffled rows.

    Values scale, tests and ranks are unchanged.
    """
    rng, factor = np.random.default_rng(seed), 10.0 ** np.array(powers)
    made = system(rng, stated=stated)
    other = shuffled(in_units(made, factor), rng.permutation(len(made.rows)))
    one, two = solve(made, X), solve(other, X * factor)

    assert two.value == pytest.approx(one.value * factor, rel=1e-9, abs=0)
    assert two.std == pytest.approx(one.std * factor, rel=1e-9, abs=0)
    assert two.chi2 == pytest.approx(one.chi2, rel=1e-8)
    assert two.identifiable.tolist() == one.identifiable.tolist()
    for name in ("dof", "noise_from", "quantile"):
        assert getattr(two, name) == getattr(one, name)
    assert (two.p_value, two.residual_std_m) == pytest.approx(
        (one.p_value, one.residual_std_m), rel=1e-8
    )


@pytest.mark.parametrize("stated", [True, False])
def test_rows_in_millimetres_are_the_same_campaign(rng, stated):
    """Readings, model and errors multiplied by a thousand: only the residuals change."""
    made = system(rng, stated=stated)
    errors = replace(made.errors, G=made.errors.G * 1e3)
    one, two = (
        solve(made, X),
        solve(replace(made, B=made.B * 1e3, c=made.c * 1e3, errors=errors), X),
    )

    assert two.value == pytest.approx(one.value, rel=1e-10, abs=0)
    assert two.cov == pytest.approx(one.cov, rel=1e-9, abs=0)
    assert two.chi2 == pytest.approx(one.chi2)
    assert two.p_value == (pytest.approx(one.p_value) if stated else None)
    assert two.residual == pytest.approx(1e3 * one.residual, abs=1e-12)
    assert two.residual_std_m == pytest.approx(1e3 * one.residual_std_m)


def test_twice_the_stated_noise_is_twice_the_uncertainty(rng):
    """The same readings with twice the stated noise: values stay, chi2 falls to a quarter."""
    made = system(rng)
    louder = replace(made, errors=replace(made.errors, G=made.errors.G * 2))
    one, two = solve(made, X), solve(louder, X)

    assert two.value == pytest.approx(one.value, rel=1e-6, abs=0)
    assert two.std == pytest.approx(2 * one.std, rel=1e-6, abs=0)
    assert two.chi2 == pytest.approx(one.chi2 / 4)
    assert one.p_value == pytest.approx(stats.chi2.sf(one.chi2, 21))
    assert two.p_value == pytest.approx(stats.chi2.sf(one.chi2 / 4, 21))
    assert one.quantile == pytest.approx(stats.norm.ppf(0.975))


def test_the_stated_covariance_is_that_of_draws(rng):
    """The errors of one campaign drawn 300 times: estimates scatter as each of them states."""
    made = system(rng)
    G, values = made.errors.G, []
    for _ in range(300):
        c = made.B @ X + G @ rng.standard_normal(G.shape[1])
        values.append(solve(replace(made, c=c), np.zeros(3)).value)
    said = solve(made, np.zeros(3)).cov

    off = np.linalg.solve(np.linalg.cholesky(said / np.outer(X, X)), (np.array(values) / X - 1).T)
    assert np.cov(off) == pytest.approx(np.eye(3), abs=5 * np.sqrt(2 / 300))
    assert off.mean(axis=1) == pytest.approx(np.zeros(3), abs=5 / np.sqrt(300))


def mixed(made):
    """The system with a fourth parameter that is a combination of the first two."""
    extra = Parameter("c3", "m/N", 5e-7, 0.0)
    B = np.column_stack([made.B, made.B @ np.array([2.0, -20.0, 0.0])])
    return replace(made, B=B, parameters=(*made.parameters, extra))


def test_what_nothing_determines_stays_where_it_started(rng):
    """Three of four parameters mix.

    The fit is that of three, and along the combination `start` stays.
    """
    made = system(rng)
    four, sizes = mixed(made), np.append(TYPICAL, 5e-7)
    none = sizes * linalg.null_space(four.B * sizes)[:, 0]
    start, chi2 = sizes * rng.uniform(0.5, 2.0, 4), dense(made)[2]
    found, again = solve(four, start), solve(four, start + 3 * none)

    assert again.value == pytest.approx(found.value + 3 * none, rel=1e-6, abs=0)
    assert solve(four, found.value).value == pytest.approx(found.value, rel=1e-6, abs=0)
    assert found.chi2 == pytest.approx(chi2)
    assert found.dof == 24 - 3
    assert np.isinf(found.std).tolist() == [True, True, False, True]
    assert found.identifiable.tolist() == [False, False, True, False]
    x, cov, _ = dense(made)
    assert found.value[2] == pytest.approx(x[2], rel=1e-6, abs=0)
    assert found.cov[2, 2] == pytest.approx(cov[2, 2], rel=1e-6, abs=0)
    seen = np.array([1.0, 0.0, 0.0, 2.0])  # only c0 + 2 c3 is determined by the rows
    assert seen @ found.value == pytest.approx(x[0], rel=1e-6, abs=0)


def test_without_stated_noise_the_rank_counts_not_the_parameters(rng):
    """s^2 = chi2 / (M - rank): the uncertainty of the third is that with three parameters."""
    made = system(rng, stated=False)
    three, four = solve(made, TYPICAL), solve(mixed(made), np.append(TYPICAL, 5e-7))
    _, cov, chi2 = dense(made)

    assert three.cov == pytest.approx(cov * chi2 / 21, rel=1e-6, abs=0)
    assert four.cov[2, 2] == pytest.approx(cov[2, 2] * chi2 / 21, rel=1e-6, abs=0)
    assert four.quantile == three.quantile == pytest.approx(stats.t.ppf(0.975, 21))
    assert three.chi2 == pytest.approx(21)


def test_noise_found_before_is_not_scaled_again(rng):
    """Errors in metres without a stated noise: the covariance holds, without a p-value."""
    made = replace(system(rng, stated=False), found_m=3e-5)
    found, (x, cov, chi2) = solve(made, TYPICAL), dense(made)

    assert found.value == pytest.approx(x, rel=1e-6, abs=0)
    assert found.cov == pytest.approx(cov, rel=1e-6, abs=0)
    assert found.chi2 == pytest.approx(chi2)
    assert found.p_value is None
    assert found.noise_from == "residuals"
    assert found.quantile == pytest.approx(stats.t.ppf(0.975, 21))


@pytest.mark.parametrize("moved", [1.0, 0.0])
def test_rows_that_fit_exactly_have_no_scatter(rng, moved):
    """One row more than determined parameters and no residual.

    No NaN, and undetermined stays so.
    """
    made = system(rng, poses=(2, 1), stated=False)
    dark = replace(made, B=made.B * [1, 1, 0], c=moved * made.B[:, :2] @ X[:2])
    found = solve(dark, np.zeros(3))

    assert found.value[:2] == pytest.approx(moved * X[:2], rel=1e-6, abs=0)
    assert found.dof == 1
    assert np.isinf(found.std[2])
    assert found.std[:2] == pytest.approx([0, 0], abs=1e-9 * X[0])


@pytest.mark.parametrize(
    ("p_value", "rest_m", "fit"),
    [(0.011, 1.0, True), (0.009, 0.0, False), (None, 0.9e-4, True), (None, 1.1e-4, False)],
)
def test_a_misfit_is_one_in_a_hundred_or_beyond_any_tracker(rng, p_value, rest_m, fit):
    """With stated noise by its p-value; otherwise by whether a tracker could read so poorly."""
    found = solve(system(rng), X)

    assert (
        is_plausible(replace(found, goodness=Goodness(1.0, 1, p_value), residual_std_m=rest_m))
        is fit
    )


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e6])
def test_half_the_size_is_the_limit_of_what_is_known(size):
    """2 u below the typical size or the estimate, whichever is larger, with either sign."""
    value = np.array([0.0, 0.0, 3.0, -3.0, 3.0, -3.0, 20.0, 20.0, -20.0])
    std = np.array([0.49, 0.51, 1.49, 1.49, 1.51, 1.51, 4.9, 5.1, 5.1])
    known = [True, False, True, True, False, False, True, False, False]

    told = identifiable(np.full(9, size), value * size, std * size)

    assert told.tolist() == known


KR500 = load("kr500_rail")
CELL = paper_cell(
    KR500,
    Tool(
        np.array([0.15, 0.0, 0.25]),
        np.array(["P1", "P2", "P3"], object),
        np.array([[0.20, 0.05, 0.12], [-0.12, 0.19, 0.10], [-0.10, -0.18, 0.22]]),
    ),
)


def campaign(cell, values, rng, poses=6, **errors):
    """Exact measurements of a cell, two pulls per pose, with all sources of error stated."""
    m = 2 * poses
    force = rng.standard_normal((m, 3))
    force *= rng.uniform(1000, 4000, (m, 1)) / np.linalg.norm(force, axis=1, keepdims=True)
    q = np.repeat(rng.uniform(KR500.lower, KR500.upper, (poses, KR500.n)), 2, axis=0)
    none = np.zeros(m)
    pulls = Pulls(np.arange(m) // 2, np.arange(m) % 2, q, force, none, none, none, none)
    moved = predict(cell, pulls, values)
    d = 3 * m
    ball = np.broadcast_to(3e-5**2 * np.eye(3), (d, 3, 3))
    target = np.tile(np.arange(3), m)
    stated = {
        "reading_std": np.full(m, 40.0),
        "direction_cov": np.broadcast_to(1e-6 * np.eye(3), (m, 3, 3)),
        "rotation_cov": 1e-8 * np.eye(3),
        "scale": Scale(gain_sigma=5e-3),
    }
    return Measured(
        pulls=pulls, pull=np.repeat(np.arange(m), 3), target=target,
        name=cell.tool.targets[target], delta=moved.displacement.reshape(-1, 3),
        unloaded=moved.unloaded.reshape(-1, 3), loaded_cov=ball, zero_cov=ball,
        zero=np.repeat(np.arange(m) // 2, 3) * 3 + target, noise_stated=True,
        joint_std=np.zeros(KR500.n), **{**stated, **errors},
    )  # fmt: skip


def test_the_weights_are_those_at_the_solution(rng):
    """Force errors grow with the compliances: the weights at the solution use its own errors.

    From half the nominal compliances a single step would use errors half as large.
    """
    truth = KR500.nominal_compliance * rng.uniform(0.7, 1.5, 7)
    data = campaign(CELL, truth, rng)
    data = replace(data, delta=data.delta + 3e-5 * rng.standard_normal(data.delta.shape))
    system_, found = identify(CELL, data, 0.5 * KR500.nominal_compliance)

    at = assemble(CELL, data, found.value)
    V = (at.errors.G @ at.errors.G.T).toarray()
    L = np.linalg.cholesky(V)
    A, y = (np.linalg.solve(L, part) for part in (at.B * truth, at.c))
    x, (square,), *_ = np.linalg.lstsq(A, y)
    assert found.value == pytest.approx(x * truth, rel=1e-7, abs=0)
    assert found.chi2 == pytest.approx(square, rel=1e-7)
    assert found.dof == len(data.pull) * 3 - 7
    assert system_.c == pytest.approx(data.delta.ravel(), abs=1e-15)


@pytest.mark.parametrize("name", ["joint_hardening", "scale_zero"])
def test_a_model_beyond_springs_is_solved_to_the_end(rng, name):
    """A spring that hardens; an error of the force, which scales all springs: the truth is found.

    Without the term that linearises c about the solution, the second would come out wrong.
    """
    effect = next(e for e in catalogue(KR500) if e.name == name)
    cell = CELL.with_effects(effect)
    typical = np.array([p.typical for p in cell.parameters])
    truth = np.append(KR500.nominal_compliance, 0.7 * typical[7:])
    data = campaign(cell, truth, rng)

    _, found = identify(cell, data, np.append(1.5 * KR500.nominal_compliance, 0 * typical[7:]))

    assert found.value / typical == pytest.approx(truth / typical, rel=1e-6, abs=1e-6)
    assert found.chi2 < 1e-6
    assert is_plausible(found)


def test_errors_that_are_common_cost_their_part_of_the_precision(rng):
    """With a scale known to 0.5 %, no number of poses determines a stiffness better than that."""
    data = campaign(CELL, KR500.nominal_compliance, rng)
    quiet = replace(data, loaded_cov=data.loaded_cov * 1e-6, zero_cov=data.zero_cov * 1e-6,
                    reading_std=data.reading_std * 1e-3, direction_cov=data.direction_cov * 1e-6,
                    rotation_cov=data.rotation_cov * 1e-6)  # fmt: skip

    _, found = identify(CELL, quiet, KR500.nominal_compliance)

    assert found.std / found.value == pytest.approx(np.full(7, 5e-3), rel=0.05, abs=0)


UNITS = np.outer(TYPICAL, TYPICAL)
"""Units of a covariance: approx would treat anything below 1e-12 as zero."""


def of_tracker(made):
    """The same with errors of tracker and zeros alone, per metre of an unstated noise."""
    keep = np.isin(made.errors.source, ["tracker", "zero"])
    G = scipy.sparse.csr_array(made.errors.G[:, keep] * 1e5)
    errors = Errors(G, made.errors.source[keep], made.errors.common[keep])
    return replace(made, errors=errors, noise_stated=False)


@pytest.mark.parametrize("loud", [1.0, 30.0])
def test_a_noise_that_nobody_states_is_the_mean_square_of_the_residuals(rng, loud):
    """With only the tracker's errors: s^2 = r'V^-1 r / (M - k)."""
    made = of_tracker(system(rng))
    noisy = replace(made, c=made.B @ X + loud * (made.c - made.B @ X))

    assert tracker_noise(noisy) == pytest.approx(np.sqrt(dense(noisy)[2] / 21), rel=1e-4)


def test_beside_errors_that_are_stated_it_is_where_the_likelihood_is_largest(rng):
    """Stated errors of gain and registration in metres; minimum of the whole likelihood."""
    made = system(rng, stated=False)
    relative = np.where(made.errors.common, 1.0, 1e5)
    G = scipy.sparse.csr_array(made.errors.G @ scipy.sparse.diags_array(relative))
    made = replace(made, errors=replace(made.errors, G=G))

    def loss(log_s):
        V = whole(made, {"tracker": np.exp(log_s), "zero": np.exp(log_s)})
        return restricted(made.B * TYPICAL, made.c, V)

    best = optimize.minimize_scalar(loss, bounds=(-14, -8)).x
    assert tracker_noise(made) == pytest.approx(np.exp(best), rel=1e-3)


def test_exact_data_have_the_least_noise_there_is(rng):
    """Rounding errors, a picometre: no weight is infinite."""
    made = of_tracker(system(rng))

    assert tracker_noise(replace(made, c=made.B @ X)) == 1e-12


def test_a_relative_noise_takes_its_size_from_the_residuals(rng):
    """chi2 equals its degrees of freedom, and the covariance is that of the mean square."""
    made = system(rng, stated=False)
    _, cov, chi2 = dense(made)
    found = solve(made, TYPICAL)

    assert found.chi2 == pytest.approx(21)
    assert found.cov / UNITS == pytest.approx(cov / UNITS * chi2 / 21, rel=1e-9)
    assert found.residual_std_m == pytest.approx(
        np.sqrt(np.sum((made.c - made.B @ found.value) ** 2) / 21)
    )
    stated = solve(replace(made, found_m=3e-5), TYPICAL)
    assert stated.cov / UNITS == pytest.approx(cov / UNITS, rel=1e-9)


def test_undetermined_values_stay_where_they_start(rng):
    """The sum of twins is estimated and their difference is that of the start, in typical sizes."""
    A = rng.standard_normal((20, 3))
    A[:, 1] = A[:, 0] * TYPICAL[0] / TYPICAL[1]
    start = TYPICAL * [3.0, 1.0, 5.0]
    y = A @ (TYPICAL * [2.0, 4.0, 7.0])
    value, cov, chi2, rank = least_squares(A / TYPICAL[2], y / TYPICAL[2], TYPICAL, start)

    assert rank == 2
    assert value / TYPICAL == pytest.approx([4.0, 2.0, 7.0])
    assert chi2 == pytest.approx(0, abs=1e-12)
    assert np.isinf(np.diag(cov)).tolist() == [True, True, False]


def test_twins_cost_one_degree_of_freedom_and_exact_data_no_uncertainty(rng):
    """24 rows, three parameters, two directions; without residuals only twins are undetermined."""
    made = system(rng, stated=False)
    B = made.B.copy()
    B[:, 1] = B[:, 0] * TYPICAL[0] / TYPICAL[1]
    made = replace(made, B=B)
    still = solve(replace(made, c=0 * made.c), 0 * TYPICAL)

    assert solve(made, TYPICAL).dof == 22
    assert still.std.tolist() == [np.inf, np.inf, 0.0]


@pytest.mark.parametrize(("p", "good"), [(0.0101, True), (0.0099, False)])
def test_a_misfit_is_what_chance_makes_once_in_a_hundred(rng, p, good):
    """If noise is stated by its p-value, otherwise by what a tracker can scatter."""
    found = solve(system(rng), TYPICAL)

    untold = replace(found, goodness=Goodness.untold(found.chi2, found.dof))

    assert is_plausible(replace(found, goodness=Goodness(1.0, 1, p))) == good
    assert is_plausible(replace(untold, residual_std_m=0.99e-4))
    assert not is_plausible(replace(untold, residual_std_m=1.01e-4))


def test_left_out_poses_know_neither_units_nor_order(rng):
    """Shuffled rows, or a given whitener, give the same residuals."""
    made = system(rng)
    order = rng.permutation(len(made.rows))
    rows = RowIndex(**{name: value[order] for name, value in vars(made.rows).items()})
    errors = replace(made.errors, G=made.errors.G[order])
    mixed = replace(made, rows=rows, B=made.B[order], c=made.c[order], errors=errors)

    assert left_out(mixed) == pytest.approx(left_out(made)[order], abs=1e-13)
    white = whitener(made.errors, made.rows.pose)
    assert left_out(made, white) == pytest.approx(left_out(made), abs=1e-15)
