"""Variance components against the dense restricted likelihood and draws."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
from made_system import TYPICAL, dense, made, restricted
from scipy import optimize, stats

from pipeline.machine.cell import paper_cell
from pipeline.reduction.bring import conformed as promised
from pipeline.run import reduce, tool
from pipeline.simulate import Plan, revised, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.estimate import identify
from pipeline.system.restricted import Blocks, maximum
from pipeline.system.system import Rows
from pipeline.system.variance import (
    Components,
    noise,
    resting_on,
    variance_components,
)

PLAN = Plan(name="noise", seed=5)


def found(plan, files=None):
    """The noise components of a simulated campaign."""
    return reduced(plan, files)[0]


def reduced(plan, files=None):
    """Noise components, measurements, system and estimate of a simulated campaign."""
    raw = in_memory(files or simulate(plan).files)
    kept = {}

    def keep(name, table, promise):
        kept[name] = promised(name, table, promise)
        return kept[name]

    data = reduce(raw, keep).data
    cell = paper_cell(raw.robot, tool(raw.settings))
    system, estimate = identify(cell, data, raw.robot.nominal_compliance)
    result = noise(raw.settings, cell, kept["21_placed"], data, system, estimate)
    return result, data, system, estimate


LOUD = made(
    np.random.default_rng(41), pulls=(4,) * 8, force_m=9e-5, scales=(1.5, 2.5), common=False
)
"""A system with springs, whose tracker and scale scatter more than stated."""


def test_components_of_a_models_residuals_are_those_of_the_whole_matrix():
    """Large displacements that the springs explain do not hide the scatter beside them."""
    result = variance_components(LOUD)

    def loss(log_scale):
        tracker, force = np.exp(log_scale)
        scale = {"tracker": tracker, "zero": tracker, "force_reading": force}
        return restricted(LOUD.B * TYPICAL, LOUD.c, dense(LOUD, scale))

    best = optimize.minimize(loss, np.zeros(2), method="Nelder-Mead", options={"xatol": 1e-5})
    assert result.name.tolist() == ["tracker", "force_reading"]
    assert result.scale == pytest.approx(np.exp(best.x), rel=1e-3)
    assert result.larger[1]
    assert (np.abs(np.log(result.scale / [1.5, 2.5])) < 4 * result.std).all()
    assert (result.std < 0.3).all()
    assert result.dof == len(LOUD.c) - 3


def test_other_fixed_effects_are_taken_in_place_of_the_springs():
    """Columns that a design gives: as many degrees of freedom fewer, and what they explain."""
    rng = np.random.default_rng(2)
    more = np.hstack([LOUD.B * TYPICAL, rng.normal(size=(len(LOUD.c), 2))])
    shifted = replace(LOUD, c=LOUD.c + more @ np.array([0.0, 0.0, 0.0, 3e-3, -5e-3]))
    plain, other = (variance_components(one, more) for one in (LOUD, shifted))

    assert plain.dof == other.dof == len(LOUD.c) - 5
    assert other.scale == pytest.approx(plain.scale, rel=1e-5)
    assert other.std == pytest.approx(plain.std, rel=1e-4)


def test_one_component_is_found_beside_the_other_as_stated():
    """Asked for the scale alone, it takes all that the tracker as stated leaves over."""
    result = variance_components(LOUD, names=("force_reading",))

    def loss(t):
        return restricted(LOUD.B * TYPICAL, LOUD.c, dense(LOUD, {"force_reading": np.exp(t)}))

    best = optimize.minimize_scalar(loss, bounds=(-1, 3)).x
    assert result.name.tolist() == ["force_reading"]
    assert result.of("force_reading") == pytest.approx(np.exp(best), rel=1e-3)


def without(source):
    """The loud system with nothing stated of one source."""
    factor = np.where(LOUD.errors.source == source, 0.0, 1.0)
    G = scipy.sparse.csr_array(LOUD.errors.G @ scipy.sparse.diags_array(factor))
    return replace(LOUD, errors=replace(LOUD.errors, G=G))


def test_a_source_that_states_nothing_is_no_component():
    """An uncertainty of zero can be multiplied by nothing: scale 1, infinite uncertainty, p 1."""
    result = variance_components(without("force_reading"))

    assert result.of("force_reading") == 1.0
    assert np.isinf(result.std[1])
    assert result.p_value[1] == 1.0
    assert np.isfinite(result.std[0])


def test_a_scale_that_is_known_to_a_half_only_is_not_told():
    """Forces that move less than the tracker scatters: as stated, and nobody knows better."""
    weak = made(np.random.default_rng(0), (2,) * 8, 1.5e-5, common=False)
    blocks = Blocks.of(weak, weak.B * TYPICAL, [("tracker", "zero"), ("force_reading",)])
    _, std, _ = maximum(blocks, np.array([True, True]))
    result = variance_components(weak)

    assert 0.5 < std[1] < 5
    assert result.of("force_reading") == 1.0
    assert np.isinf(result.std[1])
    assert result.p_value[1] == 1.0


@pytest.mark.parametrize(("rows", "told"), [(15, True), (14, False)])
def test_fewer_than_twelve_contrasts_determine_nothing(rows, told):
    """Rows less three springs."""
    first = np.arange(rows)
    taken = {name: value[first] for name, value in vars(LOUD.rows).items()}
    errors = replace(LOUD.errors, G=LOUD.errors.G[first])
    few = replace(LOUD, rows=Rows(**taken), B=LOUD.B[first], c=30 * LOUD.c[first], errors=errors)
    result = variance_components(few)

    assert np.isfinite(result.std).any() == told
    assert told or result.scale.tolist() == [1.0, 1.0]


def test_a_scale_in_metres_is_no_larger_than_a_noise_that_nobody_states():
    """Without a stated noise: metres, no p-value, and what is found is used; the rest as ever."""
    stated = variance_components(LOUD)
    result = variance_components(replace(LOUD, noise_stated=False, found_m=2e-5))

    assert result.scale == pytest.approx(stated.scale * [2e-5, 1.0])
    assert result.p_value[0] == 1.0
    assert result.p_value[1] == pytest.approx(stated.p_value[1])
    assert result.replaced.tolist() == [True, True]
    assert result.left == (1.0, result.std[0])


def told(p, std, stated=True):
    """A tracker's and a scale's component."""
    name = np.array(["tracker", "force_reading"], object)
    return Components(name, np.array([1.2, 1.4]), np.array(std), np.array(p), 99, stated)


@pytest.mark.parametrize(
    ("found", "replaced", "left"),
    [
        (told([0.5, 0.5], [0.1, 0.2]), [False, False], 1.2),
        (told([0.0031, 0.0029], [0.1, 0.2]), [False, True], 1.2),
        (told([0.0029, 0.5], [0.1, 0.2]), [True, False], 1.0),
        (told([1.0, 0.5], [0.1, 0.2], stated=False), [True, False], 1.0),
        (told([1.0, 0.5], [np.inf, 0.2], stated=False), [False, False], 1.0),
    ],
)
def test_what_is_larger_beyond_chance_or_not_stated_is_replaced(found, replaced, left):
    """At three in a thousand; what is left of the tracker's then is one."""
    assert found.replaced.tolist() == replaced
    assert found.used == any(replaced)
    assert found.left == (left, found.std[0])


def components(replaced, std):
    """A tracker and a scale with a tenth more noise than stated, one of them beyond doubt."""
    p = [1e-9 if name == replaced else 0.4 for name in ("tracker", "force_reading")]
    name = np.array(["tracker", "force_reading"], object)
    return Components(name, np.array([1.1, 1.1]), np.array(std), np.array(p), 900, True, 80.0, 90)


def test_of_two_components_the_less_certain_counts():
    """Both replaced, known to 5 and 25 %: eight degrees of freedom."""
    _, _, _, estimate = reduced(revised(PLAN, {"poses": {"count": 4}}))
    both = replace(components("tracker", [0.05, 0.25]), p_value=np.array([1e-9, 1e-9]))

    assert resting_on(estimate, both).quantile == pytest.approx(stats.t.ppf(0.975, 8))
