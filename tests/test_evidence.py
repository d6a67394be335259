"""The evidence alone: against quadrature of its integral in one and two dimensions."""

import numpy as np
import pytest
from scipy import integrate, stats

from pipeline.system.evidence import WIDTHS, _evidence

DOF = 400
REST = 410.0
"""Sum of squares that the base leaves, in standard uncertainties."""


def likelihood(G, h, z):
    """(r(z)'r(z) / r(0)'r(0))^(-dof/2): of the residual with a suspect of size z, scatter free."""
    drop = 2 * h @ z - z @ G @ z
    return (1 - drop / REST) ** (-DOF / 2)


def ends(lower, upper, width):
    """Where the integrand is more than nothing."""
    return max(lower, -9 * width), min(upper, 9 * width)


def integral(G, h, lower, upper, width):
    """Mean likelihood under a normal prior of one width that ends at the bounds, by quadrature."""
    prior = [stats.truncnorm(a / width, b / width, scale=width) for a, b in zip(lower, upper)]  # noqa: B905
    spans = [ends(a, b, width) for a, b in zip(lower, upper)]  # noqa: B905
    best = np.linalg.solve(G + np.eye(len(h)) / width**2, h)
    if len(h) == 1:
        value, _ = integrate.quad(
            lambda z: likelihood(G, h, np.array([z])) * prior[0].pdf(z),
            *spans[0], points=np.clip(best, *spans[0]), limit=400,
        )  # fmt: skip
        return value
    grid = [np.linspace(*span, 1201) for span in spans]
    step = np.prod([axis[1] - axis[0] for axis in grid])
    z = np.stack(np.meshgrid(*grid, indexing="ij"), -1).reshape(-1, 2)
    drop = 2 * z @ h - np.einsum("ni,ij,nj->n", z, G, z)
    weight = np.prod([p.pdf(z[:, k]) for k, p in enumerate(prior)], axis=0)
    return float(np.sum((1 - drop / REST) ** (-DOF / 2) * weight) * step)


def by_quadrature(G, h, lower, upper):
    """Log of the mean over the prior's widths."""
    return np.log(np.mean([integral(G, h, lower, upper, width) for width in WIDTHS]))


@pytest.mark.parametrize("strength", [0.3, 3.0, 12.0])
@pytest.mark.parametrize("size", [-0.05, 0.0, 0.5, 1.5])
@pytest.mark.parametrize("bounds", [(-np.inf, np.inf), (0.0, np.inf), (-1.0, 2.0)])
def test_one_parameter_has_the_evidence_of_its_integral(strength, size, bounds):
    """Weak and strong, absent, usual and large, with and without physical bounds."""
    G, h = np.array([[strength**2]]), np.array([strength**2 * size])
    found = _evidence(G[None], h[None], REST, DOF, *np.array(bounds)[:, None, None])

    expected = by_quadrature(G, h, *[[b] for b in bounds])
    assert found[0] == pytest.approx(expected, abs=0.05 + 0.02 * abs(expected))


@pytest.mark.parametrize("correlation", [0.0, 0.7])
@pytest.mark.parametrize("size", [(0.0, 0.0), (0.6, 0.3), (1.0, -0.5)])
def test_two_parameters_have_the_evidence_of_their_integral(correlation, size):
    """A tilt about two axes: free to either side, alike or not."""
    G = 25.0 * np.array([[1.0, correlation], [correlation, 1.0]])
    h, free = G @ np.array(size), np.full((1, 2), np.inf)
    found = _evidence(G[None], h[None], REST, DOF, -free, free)

    expected = by_quadrature(G, h, [-np.inf] * 2, [np.inf] * 2)
    assert found[0] == pytest.approx(expected, abs=0.05 + 0.02 * abs(expected))


def test_an_impossible_size_has_no_evidence():
    """Data that call surely for a negative spring speak against it, by quadrature and as scored.

    So far outside the bounds the normal tail is no measure of how much.
    """
    G, h = np.array([[900.0]]), np.array([-0.4 * 900.0])
    found = _evidence(G[None], h[None], REST, DOF, np.zeros((1, 1)), np.full((1, 1), np.inf))

    assert by_quadrature(G, h, [0.0], [np.inf]) < -3
    assert found[0] < -3
