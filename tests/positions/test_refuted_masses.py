"""Masses of a robot file are refuted as rarely as stated where they hold, and where they do not."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from pipeline.positions import study
from pipeline.positions.catalogue_causes import CatalogueCause
from pipeline.positions.cross_validation import NO_GAIN
from pipeline.positions.study import _of_masses, _Weighed

MEAN = np.array([[300.0, 20.0, -8.0, 4.0], [90.0, -3.0, 12.0, 6.0]])
STD = 0.05 * np.abs(MEAN)


def estimated(rng, off=0.0, readings=6, noise=1.0):
    """Moments of two links, `off` standard deviations from the file and as many at random, read."""
    truth = (MEAN + STD * (rng.standard_normal(MEAN.shape) + off)).ravel()
    X = rng.standard_normal((readings, MEAN.size)) / STD.ravel()
    y = X @ truth + noise * rng.standard_normal(readings)
    mean, std = MEAN.ravel(), STD.ravel()
    cov = np.linalg.inv(X.T @ X / noise**2 + np.diag(std**-2))
    x = mean + cov @ X.T @ (y - X @ mean) / noise**2
    nothing = np.zeros(0)
    mechanism = SimpleNamespace(
        values=nothing, tool=nothing, frames=nothing, compliance=nothing, payload=nothing,
        yields=nothing, moments=MEAN, loose=True, amplitudes=nothing, curves=(),
    )  # fmt: skip
    return SimpleNamespace(
        mechanism=mechanism,
        wanted=SimpleNamespace(moments=False),
        solution=SimpleNamespace(x=x, cov=cov),
        known=SimpleNamespace(mean=mean, std=std),
    )


@pytest.mark.parametrize(("readings", "noise"), [(6, 1.0), (6, 3.0), (40, 1.0)])
def test_masses_that_hold_are_refuted_as_often_as_stated(readings, noise):
    """Of 200 clean robots, also where the readings tell of few combinations, or hardly of any."""
    rng = np.random.default_rng(5)
    p = [_of_masses(estimated(rng, 0.0, readings, noise)) for _ in range(200)]

    assert stats.kstest(p, "uniform").pvalue > 0.01
    assert np.sum(np.array(p) < 0.05) <= stats.binom.ppf(0.995, 200, 0.05)


def test_masses_five_standard_deviations_off_are_refuted():
    """Every one of twenty."""
    rng = np.random.default_rng(6)

    assert all(_of_masses(estimated(rng, 5.0)) < 1e-4 for _ in range(20))


def test_readings_that_tell_of_no_mass_refute_none():
    """However far the estimate is off, it is the prior's."""
    rng = np.random.default_rng(7)

    assert _of_masses(estimated(rng, 5.0, noise=1e3)) == 1.0


@pytest.mark.parametrize("amounts", [(), ("M_theta2",)])
def test_masses_of_which_nothing_is_known_are_no_cause(monkeypatch, amounts):
    """Noise of 20 mm refutes what a robot file states, and leaves every torque uncertain."""
    sag = CatalogueCause("gravity_sag", None, "moments", amounts)
    monkeypatch.setattr(study, "weight", lambda _: sag)

    found = _Weighed(None, 1e-9, (NO_GAIN, NO_GAIN)).causes(None, "other masses")

    assert [(one.form, one.p) for one in found] == [("other masses", 1e-9)] * len(amounts)
