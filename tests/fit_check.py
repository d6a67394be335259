"""Properties of every fit in an answer, whatever the hidden causes and the noise."""

import pytest
from scipy import stats

ALONE = "rest on the noise stated for the readings."


def told_by_chi_square(answer):
    """Check each p-value of result.json against its chi-square; return the number of checks."""
    fits = [one["fit"] for one in (answer, answer["joint_springs"], answer["extended"]) if one]
    for fit in fits:
        chi2, dof, p = fit["chi2"], fit["dof"], fit["p_value"]
        if fit["noise_statement"].endswith(ALONE):
            assert p == pytest.approx(stats.chi2.sf(chi2, dof), rel=1e-6, abs=1e-300)
        if fit["noise_from"] == "stated":
            assert (p <= 0.5) == (chi2 >= stats.chi2.isf(0.5, dof)) or abs(p - 0.5) < 1e-3
            assert (p > 0.2) or chi2 > dof
            assert (p < 0.05) or chi2 < 1.5 * dof
    return sum(fit["noise_from"] == "stated" for fit in fits)
