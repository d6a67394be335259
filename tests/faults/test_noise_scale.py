"""Scatter of readings: normal draws of known size, with bad ones among them."""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse
from scipy import integrate, stats

from pipeline.faults import fault as module
from pipeline.faults.fault import noise_scale
from pipeline.system.system import Errors, RowIndex


class Contrasts(SimpleNamespace):
    """Independent contrasts of several poses with a stated standard uncertainty [m] each."""


def contrasts(draws, stated=1.0):
    n = len(draws)
    stated = np.broadcast_to(stated, n)
    none = np.zeros(n, np.int64)
    rows = RowIndex(np.arange(n) % max(n // 20, 1), none, np.full(n, "", object), none, none)
    G = scipy.sparse.csr_array(scipy.sparse.diags_array(stated))
    errors = Errors(G, np.full(n, "tracker", object), np.zeros(n, bool))
    return Contrasts(rows=rows, c=draws, errors=errors)


@pytest.fixture
def scale_of(monkeypatch):
    """`noise_scale` of the given contrasts."""

    def scale(draws, stated=1.0):
        made = contrasts(draws, stated)
        monkeypatch.setattr(module, "pure_error", lambda *_: made)
        return noise_scale(None, SimpleNamespace(residual=None, dof=33), None, None, None)

    return scale


def test_readings_without_scatter_leave_the_stated_scale(scale_of):
    """Half of the contrasts are exactly zero: 1, where a mean of none would be NaN."""
    assert scale_of(np.zeros(40))[0] == 1.0
    assert scale_of(np.r_[np.zeros(30), np.full(10, 1e-3)])[0] == 1.0


@pytest.mark.parametrize("true", [1.3, 4.0])
def test_the_scatter_is_found_over_the_stated_one(scale_of, true):
    """4 000 draws, each with its own standard uncertainty: to 3 %, three sigma of the result."""
    rng = np.random.default_rng(2)
    stated = rng.uniform(1e-6, 1e-4, 4000)

    found, count = scale_of(true * stated * rng.standard_normal(4000), stated)

    assert found == pytest.approx(true, rel=0.035)
    assert count == 4000


def test_the_scatter_of_exact_quantiles_is_exact(scale_of):
    """For quantiles of a normal the fixed point is its standard deviation, to a thousandth."""
    grid = stats.norm.ppf((np.arange(4001) + 0.5) / 4001)

    found, _ = scale_of(2.0 * grid)

    cut = integrate.quad(lambda z: z**2 * stats.norm.pdf(z), -3, 3)[0] / (1 - 2 * stats.norm.sf(3))
    assert cut == pytest.approx(0.9733, abs=1e-4)
    assert found == pytest.approx(2.0, rel=1e-3)


def test_a_few_bad_readings_do_not_count(scale_of):
    """Twelve of 400 are off by a hundred sigma: the scatter changes by less than a twentieth."""
    rng = np.random.default_rng(4)
    draws = 1.5 * rng.standard_normal(400)
    clean, _ = scale_of(draws)
    draws[:12] = 100.0

    found, count = scale_of(draws)

    assert found == pytest.approx(clean, rel=0.05)
    assert count == 400


def test_a_modest_certificate_makes_no_outliers(scale_of):
    """Readings that scatter half as much as stated count as stated."""
    assert scale_of(0.5 * np.random.default_rng(5).standard_normal(300))[0] == 1.0


def test_too_few_contrasts_say_nothing(scale_of):
    """Eleven contrasts are not used, twelve are; below that the stated noise holds."""
    draws = 3.0 * np.random.default_rng(6).standard_normal(12)

    assert scale_of(draws[:11]) == (1.0, 33)
    found, count = scale_of(draws)
    assert found > 1.5
    assert count == 12
