"""Tails of chi-squared, and where libraries work."""

import os

import numpy as np
import pytest
from scipy import stats

from pipeline.base import environment
from pipeline.base.tails import CHI2_95, NORMAL_95, chi2_below, chi2_beyond


def test_tails_are_those_of_scipy():
    """Also far out, and at the ends: nothing below zero, no answer without degrees of freedom."""
    chi2, dof = np.array([0.5, 3.0, 40.0, 900.0]), np.array([1.0, 4.0, 7.0, 30.0])

    assert chi2_below(chi2, dof) == pytest.approx(stats.chi2.cdf(chi2, dof), rel=1e-10)
    assert chi2_beyond(chi2, dof) == pytest.approx(stats.chi2.sf(chi2, dof), rel=1e-10)
    assert (chi2_below(-1e-12, 3), chi2_beyond(-1e-12, 3)) == (0.0, 1.0)
    assert np.isnan(chi2_below(1.0, 0))
    assert np.isnan(chi2_beyond(1.0, 0))


def test_quantiles_are_those_of_the_tables():
    """To the digits that are printed."""
    assert round(stats.norm.ppf(0.975), 2) == NORMAL_95
    assert round(stats.chi2.ppf(0.95, 1), 2) == CHI2_95


def test_libraries_read_nothing_of_the_current_folder(tmp_path, monkeypatch):
    """They work elsewhere, and the folder is the same afterwards, also after an error."""
    monkeypatch.chdir(tmp_path)
    with environment.elsewhere():
        assert os.getcwd() == environment.NOBODYS
    with pytest.raises(KeyError), environment.elsewhere():
        raise KeyError

    assert os.getcwd() == str(tmp_path)


def test_a_variable_is_missing_for_a_while(monkeypatch):
    """With its value for whoever needs it; one that was not there does not appear."""
    monkeypatch.setenv("SOME_PROXY", "here")
    with environment.without("SOME_PROXY") as value:
        assert value == "here"
        assert "SOME_PROXY" not in os.environ
    with environment.without("NO_SUCH") as value:
        assert value is None

    assert os.environ["SOME_PROXY"] == "here"
    assert "NO_SUCH" not in os.environ
