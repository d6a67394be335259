"""The evidence: against quadrature of its integral in one and two dimensions."""

import numpy as np
import pytest
from scipy import integrate, stats

from pipeline.system.evidence import _EVERY, _SHARES, Scores, _evidence, _log_share
from pipeline.system.score_tests import by_products
from pipeline.system.yielding import Yielding

DOF = 400
REST = 410.0
"""Residual sum of squares of the base, in standard uncertainties."""


def likelihood(G, h, z):
    """(r(z)'r(z) / r(0)'r(0))^(-dof/2): likelihood of a suspect of size z with free scatter."""
    drop = 2 * h @ z - z @ G @ z
    return (1 - drop / REST) ** (-DOF / 2)


def ends(lower, upper, width):
    """Limits beyond which the integrand is negligible."""
    far = 9 * min(width, 2.5)
    return max(lower, -far), min(upper, far)


def integral(G, h, lower, upper, width):
    """Mean likelihood under a normal prior of one width, truncated at the bounds, by quadrature."""
    prior = [stats.truncnorm(a / width, b / width, scale=width) for a, b in zip(lower, upper)]  # noqa: B905
    spans = [ends(a, b, width) for a, b in zip(lower, upper)]  # noqa: B905
    best = np.linalg.solve(G + np.eye(len(h)) / width**2, h)
    if len(h) == 1:
        value, _ = integrate.quad(
            lambda z: likelihood(G, h, np.array([z])) * prior[0].pdf(z),
            *spans[0], points=np.clip(best, *spans[0]), limit=400,
        )  # fmt: skip
        return value
    grid = [np.linspace(*span, 401) for span in spans]
    step = np.prod([axis[1] - axis[0] for axis in grid])
    z = np.stack(np.meshgrid(*grid, indexing="ij"), -1).reshape(-1, 2)
    drop = 2 * z @ h - np.einsum("ni,ij,nj->n", z, G, z)
    weight = np.prod([p.pdf(z[:, k]) for k, p in enumerate(prior)], axis=0)
    return float(np.sum((1 - drop / REST) ** (-DOF / 2) * weight) * step)


def by_quadrature(G, h, lower, upper):
    """Log of the mean over the widths of the prior, by their shares."""
    return np.log(_SHARES @ [integral(G, h, lower, upper, width) for width in _EVERY])


@pytest.mark.parametrize("size", [60.0, 200.0, 1000.0])
def test_a_cause_of_any_size_keeps_the_evidence_of_its_fit(size):
    """Hundred standard uncertainties in all, at a multiple of the size that is usual: broken."""
    G = np.array([[(100 / size) ** 2]])
    h, free = G[:, 0] * size, np.full((1, 1), np.inf)
    rest = 100.0**2 + DOF
    found = _evidence(G[None], h[None], rest, DOF, 0 * free.clip(0, 1), free)

    assert found[0] == pytest.approx(0.5 * DOF * np.log(rest / DOF), abs=20)


@pytest.mark.parametrize(("rest", "dof"), [(0.0, DOF), (1e-30, 0), (0.0, 0)])
def test_data_that_leave_nothing_give_a_number(rest, dof):
    """The base fits exactly, or no row is left: no evidence for any suspect."""
    G, h, bound = np.array([[[9.0]]]), np.zeros((1, 1)), np.full((1, 1), np.inf)
    found = _evidence(G, h, rest, dof, 0 * bound.clip(0, 1), bound)

    assert np.isfinite(found).all()
    assert found[0] < 0


@pytest.mark.sampled(5)
@pytest.mark.parametrize("strength", [0.3, 3.0, 12.0])
@pytest.mark.parametrize("size", [-0.05, 0.0, 0.5, 1.5])
@pytest.mark.parametrize("bounds", [(-np.inf, np.inf), (0.0, np.inf), (-1.0, 2.0)])
def test_one_parameter_has_the_evidence_of_its_integral(strength, size, bounds):
    """Weak and strong, absent, typical and large, with and without physical bounds."""
    G, h = np.array([[strength**2]]), np.array([strength**2 * size])
    found = _evidence(G[None], h[None], REST, DOF, *np.array(bounds)[:, None, None])

    expected = by_quadrature(G, h, *[[b] for b in bounds])
    assert found[0] == pytest.approx(expected, abs=0.05 + 0.02 * abs(expected))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("correlation", [0.0, 0.7])
@pytest.mark.parametrize("size", [(0.0, 0.0), (0.6, 0.3), (1.0, -0.5)])
def test_two_parameters_have_the_evidence_of_their_integral(correlation, size):
    """A tilt about two axes: free in both senses, equal or not."""
    G = 25.0 * np.array([[1.0, correlation], [correlation, 1.0]])
    h, free = G @ np.array(size), np.full((1, 2), np.inf)
    found = _evidence(G[None], h[None], REST, DOF, -free, free)

    expected = by_quadrature(G, h, [-np.inf] * 2, [np.inf] * 2)
    assert found[0] == pytest.approx(expected, abs=0.05 + 0.02 * abs(expected))


def test_an_impossible_size_has_no_evidence():
    """Data that clearly demand a negative spring are evidence against it.

    By quadrature and as scored. So far outside the bounds, the normal tail does not measure by how
    much.
    """
    G, h = np.array([[900.0]]), np.array([-0.4 * 900.0])
    found = _evidence(G[None], h[None], REST, DOF, np.zeros((1, 1)), np.full((1, 1), np.inf))

    assert by_quadrature(G, h, [0.0], [np.inf]) < -3
    assert found[0] < -3


def with_scatter(g, h, rest, dof, width):
    """Evidence ratio of one free parameter, with the scatter s also integrated out, over u = ln s.

    p(y | z, s) p(s) is s^-dof exp(-(rest - 2 h z + g z^2) / 2 s^2) / s, and z | s ~ N(0, s^2 w^2).
    """
    u = np.linspace(-1.6, 3.0, 401)[:, None]
    far = min(9 * width, 60.0)  # the likelihood is narrower than the largest widths
    z = np.linspace(-far, far, 1201)
    s = np.sqrt(rest / dof) * np.exp(u)
    square = rest - 2 * h * z * s + g * (z * s) ** 2
    joint = np.exp(-dof * u - square / (2 * s**2)) * stats.norm.pdf(z, scale=width)
    alone = np.exp(-dof * u - rest / (2 * s**2))
    return joint.sum() * (z[1] - z[0]) / alone.sum()


@pytest.mark.parametrize(("g", "h"), [(4.0, 0.0), (4.0, 5.0), (0.5, -2.0)])
def test_a_scatter_that_is_not_known_is_integrated_out(g, h):
    """With few degrees of freedom, where it matters: the exact integral over size and scatter."""
    rest, dof = 15.0, 12
    free = np.full((1, 1), np.inf)
    found = _evidence(np.array([[[g]]]), np.array([[h]]), rest, dof, -free, free)
    expected = _SHARES @ [with_scatter(g, h, rest, dof, width) for width in _EVERY]

    assert found[0] == pytest.approx(np.log(expected), abs=1e-5)


def scores(A, at, bounds=None):
    """Suspects in addition to the first two columns of A, the last of which is y."""
    found = by_products(A.T @ A, np.arange(2), at, len(A) - 2)
    free = np.full(at.shape, np.inf)
    return Scores(**vars(found), bounds=np.stack([-free, free]) if bounds is None else bounds)


@pytest.fixture
def rows():
    """Sixty rows: a base of two columns, four more, and y that contains the third."""
    rng = np.random.default_rng(19)
    A = rng.standard_normal((60, 7))
    A[:, -1] += 0.6 * A[:, 2]
    return A


def test_rows_have_the_evidence_of_their_densities(rows):
    """For two columns: ratio of the densities of y with base and scatter integrated out.

    With V = I + w^2 D D' that is |V|^-1/2 |X'V^-1X|^-1/2 (r'V^-1r)^-dof/2, Student's form.
    """
    found = scores(rows, np.array([[2, 3]]))
    X, D, y = rows[:, :2], rows[:, 2:4], rows[:, -1]

    def log_density(V):
        W = np.linalg.inv(V)
        b = np.linalg.solve(X.T @ W @ X, X.T @ W @ y)
        r = y - X @ b
        log = np.linalg.slogdet(V)[1] + np.linalg.slogdet(X.T @ W @ X)[1]
        return -0.5 * log - 0.5 * 58 * np.log(r @ W @ r)

    alone = log_density(np.eye(60))
    ratios = [np.exp(log_density(np.eye(60) + w**2 * D @ D.T) - alone) for w in _EVERY]
    assert found.log_evidence[0] == pytest.approx(np.log(_SHARES @ ratios), abs=1e-6)


def test_what_the_base_explains_is_no_evidence(rows):
    """A combination of the base has evidence 1; together with another column it changes nothing."""
    rows[:, 3] = rows[:, 0] - 2 * rows[:, 1]
    found = scores(rows, np.array([[3, -1], [2, -1], [2, 3]])).log_evidence

    assert found[0] == pytest.approx(0.0, abs=1e-6)
    assert found[1] > 1
    assert found[2] == pytest.approx(found[1], abs=1e-6)


def test_suspects_are_judged_each_by_itself(rows):
    """The evidence of a suspect does not depend on the other suspects."""
    at = np.array([[2, 3], [4, -1], [5, 3]])
    together = scores(rows, at).log_evidence

    for i in range(3):
        assert together[i] == pytest.approx(scores(rows, at[[i]]).log_evidence[0])


def test_an_exact_explanation_has_evidence_without_end_but_finite(rows):
    """A column of 1e12 standard uncertainties that explains all of y."""
    rows[:, 2] *= 1e12
    rows[:, -1] = rows[:, 2]
    found = scores(rows, np.array([[2, -1], [3, -1]])).log_evidence

    assert np.isfinite(found).all()
    assert found[0] > 100 + found[1]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_spring_that_can_only_give_way_is_believed_on_that_side(side, rows):
    """If the estimate is well inside a one-sided bound, the prior is half as wide: ln 2."""
    bounds = np.sort(np.array([0.0, side * np.inf])).reshape(2, 1, 1)
    rows[:, -1] *= side
    free = scores(rows, np.array([[2]])).log_evidence[0]

    assert scores(rows, np.array([[2]]), bounds).log_evidence[0] == pytest.approx(
        free + np.log(2), abs=0.01
    )
    assert scores(rows, np.array([[2]]), -bounds[::-1]).log_evidence[0] < free - 3


@pytest.mark.parametrize("size", [3.0, 6.0, 9.0])
def test_what_would_make_a_compliance_negative_is_bounded_there(size):
    """Six typical sizes less, 6 - z >= 0, is the same as a largest size of six."""
    G, h, free = np.array([[[4.0]]]), np.array([[4.0 * size]]), np.full((1, 1), np.inf)
    rest = REST + 4.0 * size**2
    least = Yielding(np.array([6.0]), np.array([[-1.0]]), np.zeros(1))

    found = _evidence(G, h, rest, DOF, -free, free, yielding=least)
    assert found == pytest.approx(_evidence(G, h, rest, DOF, -free, 6.0 + 0 * h))


def test_bounds_hold_for_the_parameter_that_has_them(rows):
    """Of two parameters the second must not be negative; the first is free."""
    at = np.array([[2, 3]])
    rows[:, -1] -= 0.8 * rows[:, 3]
    swapped = np.array([[3, 2]])
    second, first = (
        np.stack([np.where(np.array([[0, 1]]) == k, 0.0, -np.inf), np.full((1, 2), np.inf)])
        for k in (1, 0)
    )

    against = scores(rows, at, second).log_evidence[0]
    assert against < scores(rows, at, first).log_evidence[0] - 3
    assert scores(rows, swapped, first).log_evidence[0] == pytest.approx(against)


@pytest.mark.parametrize(
    ("low", "high"), [(-1.0, 1.0), (0.5, np.inf), (6.0, 7.0), (-7.0, -6.0), (30.0, 31.0)]
)
def test_the_share_between_bounds_is_the_integral_of_the_density(low, high):
    """By quadrature relative to the density at the nearer bound; alike on both sides."""
    mean, scatter = 3.0, 0.2
    bounds = np.array([[low], [high]]) * scatter + mean
    found = _log_share(*bounds, mean, scatter)[0]
    peak = min(max(low, 0.0), high)
    whole, _ = integrate.quad(lambda x: np.exp((peak**2 - x**2) / 2), low, high)
    assert found == pytest.approx(np.log(whole / np.sqrt(2 * np.pi)) - peak**2 / 2, rel=1e-9)
    mirrored = 2 * mean - bounds[::-1]
    assert _log_share(*mirrored, mean, scatter)[0] == pytest.approx(found, rel=1e-9)
