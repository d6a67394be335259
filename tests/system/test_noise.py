"""The scatter on which a diagnosis is based, against fits and the whole likelihood."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from made_system import TYPICAL, dense, made, restricted
from scipy import optimize, stats

from pipeline.reduction.bring import bring
from pipeline.run import ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.estimate import identify
from pipeline.system.fit import beside_everything
from pipeline.system.noise_shape import shape
from pipeline.system.scatter import TOLERATED_FACTOR, scatter

UNKNOWN = (1.0, np.inf)
"""Result of contrasts that determine nothing."""


def view(system, suspects=None):
    """Whitened campaign: springs, two common errors, suspects."""
    more = np.zeros((len(system.c), 0)) if suspects is None else suspects
    root = np.linalg.inv(np.linalg.cholesky(dense(system)))
    A = root @ np.column_stack([system.B * TYPICAL, more, system.c])
    return SimpleNamespace(
        A=A,
        base=np.arange(3),
        springs=3,
        first=5,
        rows_left=len(system.c) - 3,
        typical=np.concatenate([TYPICAL, [np.nan, np.nan], np.ones(more.shape[1])]),
        raw=np.column_stack([system.B, more, system.c]),
    )


def drawn(seed, **how):
    """A campaign of ten poses with force errors as large as those of the tracker."""
    return made(np.random.default_rng(seed), pulls=(4,) * 10, force_m=6e-5, common=False, **how)


@pytest.mark.parametrize("found", [0.9, 1.25, 1.45])
def test_contrasts_that_tell_are_believed(found):
    """Scale, its uncertainty, and the p-value if the noise were the largest tolerated."""
    system = drawn(1)
    got = scatter(view(system), system, (found, 0.04))
    dof = 1 / (2 * 0.04**2)

    assert got.known_from == "contrasts"
    assert got.tracker == found
    assert got.tracker_std == pytest.approx(0.04 * found)
    assert got.tracker_p == pytest.approx(stats.chi2.sf(dof * (found / 1.3) ** 2, dof))
    assert (got.tracker_p < 0.5) == (found > TOLERATED_FACTOR)


def test_residuals_tell_where_contrasts_cannot():
    """Their root mean square in stated units, with the degrees of freedom of the joint springs."""
    system = drawn(2, scales=(1.6, 6.0))
    got = scatter(view(system), system, UNKNOWN)
    A = view(system).A
    r = A[:, -1] - A[:, :3] @ np.linalg.lstsq(A[:, :3], A[:, -1], rcond=None)[0]
    dof = len(system.c) - 3

    assert got.known_from == "residuals"
    assert got.tracker == pytest.approx(np.sqrt(r @ r / dof))
    assert got.tracker_std == pytest.approx(got.tracker / np.sqrt(2 * dof))
    assert got.tracker_p == pytest.approx(stats.chi2.sf(r @ r / 1.69, dof))
    assert (got.force, got.force_std, got.force_p) == (1.0, 0.0, 1.0)


@pytest.mark.parametrize(("stated", "least"), [(True, 0.01), (False, 1e-7)])
def test_no_instrument_scatters_less_than_its_least(stated, least):
    """A hundredth of the stated noise, or 1e-4 mm; p is that of the stated noise."""
    system = replace(drawn(3), noise_stated=stated)
    quiet = scatter(view(system), system, (1e-9, 0.05))
    loud = scatter(view(system), system, (5.0, 0.05))

    assert quiet.tracker == least
    assert quiet.tracker_p == 1.0
    assert (loud.tracker_p < 1e-6) == stated


@pytest.mark.parametrize("tracker", [1.0, 2.0])
def test_the_scale_has_the_scatter_that_the_whole_likelihood_gives_it(tracker):
    """Factor over the tracker's, uncertainty from the curvature, p from the ratio, by brute force.

    Residuals that suspects explain do not count as scatter of the scale.
    """
    suspects = np.random.default_rng(9).normal(size=(120, 2)) * 1e-3
    system = drawn(4, scales=(tracker, 3.5 * tracker))
    system = replace(system, c=system.c + suspects @ np.array([1.0, -2.0]))
    got = scatter(view(system, suspects), system, (tracker, 0.03))
    X = np.column_stack([system.B * TYPICAL, suspects])

    def loss(t):
        stated = {"tracker": tracker, "zero": tracker, "force_reading": tracker * np.exp(t)}
        return restricted(X, system.c, dense(system, stated))

    tried = [loss(np.log(factor)) for factor in (1.0, 1.4, 2.0, 3.0, 5.0, 8.0, 13.0)]
    best = optimize.minimize_scalar(loss, bounds=(0, 3)).x
    curvature = (loss(best + 0.1) - 2 * loss(best) + loss(best - 0.1)) / 0.1**2

    assert got.force == pytest.approx(np.exp(best), rel=1e-3)
    assert got.force_std == pytest.approx(np.exp(best) * np.sqrt(2 / curvature), rel=1e-2)
    assert np.log(got.force_p) == pytest.approx(
        np.log(stats.chi2.sf(tried[0] - min(tried), 1) / 2), rel=1e-4
    )
    assert abs(got.force - 3.5) < 4 * got.force_std


def test_a_scale_as_good_as_stated_is_left_alone():
    """In none of 60 campaigns do the weights change: the rate is one in a thousand."""
    said = [scatter(view(one), one, (1.0, 0.05)) for one in map(drawn, range(100, 160))]

    assert [(one.force, one.force_std, one.force_p) for one in said] == [(1.0, 0.0, 1.0)] * 60


def test_a_scale_far_worse_than_stated_is_always_found():
    """All of 15 campaigns with three times the scatter are found; their mean is the truth."""
    found = [
        scatter(view(one), one, (1.0, 0.05))
        for one in (drawn(seed, scales=(1.0, 3.0)) for seed in range(200, 215))
    ]

    assert all(one.force_p < 1e-3 for one in found)
    off = [(one.force - 3.0) / one.force_std for one in found]
    assert abs(np.mean(off)) < 1.0
    assert 0.4 < np.std(off) < 1.8


def exact(system):
    """Predictions of its springs, and rounding that could be taken for scatter of the scale."""
    force = system.errors.G[:, system.errors.source == "force_reading"]
    rounding = force @ np.random.default_rng(0).standard_normal(force.shape[1]) * 1e-4
    errors = replace(system.errors, G=system.errors.G * 1e-5)
    return replace(system, c=system.B @ TYPICAL + rounding, errors=errors)


def test_exact_data_say_nothing_of_the_scale():
    """Residuals below 1e-5 of the displacements do not count as scatter."""
    system = exact(drawn(5))
    got = scatter(view(system), system, (1.0, 0.05))

    assert (got.force, got.force_std, got.force_p) == (1.0, 0.0, 1.0)


@pytest.mark.parametrize(("left", "told"), [(11, True), (10, True), (9, False)])
def test_nothing_is_said_of_the_scale_from_fewer_than_ten_degrees_of_freedom(left, told):
    """120 rows minus 3 springs and many suspects, with an implausibly large scatter left."""
    rng = np.random.default_rng(7)
    system = drawn(6)
    force = system.errors.G.toarray()[:, system.errors.source == "force_reading"]
    loud = replace(system, c=force @ rng.standard_normal(force.shape[1]) * 1e3)
    got = scatter(view(loud, rng.normal(size=(120, 117 - left))), loud, (1.0, 0.05))

    assert (got.force_p < 1.0) == told


@pytest.mark.parametrize("seed", range(8))
def test_few_readings_do_not_lose_the_scale_of_their_noise(seed):
    """Three poses pulled once, by an instrument that is better than stated.

    Each reading judges the others; how large they are all together, the sum of squares says.
    """
    plan = Plan(
        poses={"count": 3},
        pulls={"steps_n": [2500]},
        tracker={"noise_scale": 0.6},
        hidden={"stiffness_spread": 0.25},
    )
    files = simulate(plan, np.random.default_rng(seed)).files
    case = ingested(in_memory(files), plausible=False)
    data = bring(case).data
    estimate = identify(case.cell, data, case.robot.nominal_compliance)[1]

    found = shape(beside_everything(case.cell, data, estimate.value), ())

    assert np.mean(found.variance) >= 0.5 * min(1.0, estimate.chi2 / estimate.dof) * (1 - 1e-9)
