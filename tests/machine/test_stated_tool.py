"""A load point that measured reflectors carry, against rigid motions by Pinocchio."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from pipeline.machine.effect import Elastic
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load
from pipeline.positions.positions_estimate import PositionsEstimate
from pipeline.positions.stated_tool import StatedTool

POINTS = {
    "load_point": [0.1, 0.0, 0.2],
    "P1": [0.25, 0.1, 0.12],
    "P2": [-0.15, 0.24, 0.2],
    "P3": [-0.1, -0.22, 0.05],
}
STATED, READ, LEAST = 1e-4, 1e-5, 1e-6


def drawn(rng, names=("P1", "P2", "P3"), std=STATED):
    """A tool on a flange that is not where the table has it: estimate, statement, load point."""
    flange = pin.exp6(np.concatenate([rng.normal(0, 1e-3, 3), rng.normal(0, 1e-3, 3)]))
    at = {name: flange.act(np.array(one)) for name, one in POINTS.items()}
    stated = {name: np.array(one) + rng.normal(0, std, 3) for name, one in POINTS.items()}
    points = {name: at[name] + rng.normal(0, READ, 3) for name in names}
    robot = load("kr210_r2700_2")
    said = PositionsEstimate(
        robot=robot,
        letters=(),
        points=points,
        compliance=robot.nominal_compliance,
        told=np.ones(robot.n, dtype=bool),
        held=(),
        yields=np.zeros(0),
        cov=np.diag(np.r_[robot.nominal_compliance**2, np.full(3 * len(points), READ**2)]),
        unloaded=lambda q: (0 * q, np.zeros((len(q), len(points), 3))),
    )
    return said, StatedTool(stated, std, std), at["load_point"]


@pytest.mark.parametrize("names", [("P1", "P2", "P3"), ("P2",)])
def test_load_point_is_where_measured_reflectors_carry_it(names):
    """Its stated uncertainty holds, and with three reflectors is a tenth of the flange's error."""
    rng, off = np.random.default_rng(4), []
    for _ in range(200):
        said, tool, truth = drawn(rng, names)
        found = said.carrying(tool, LEAST)
        assert list(found.points) == [*names, "load_point"]
        white = np.linalg.cholesky(found.cov[-3:, -3:])
        off.append(np.linalg.solve(white, found.points["load_point"] - truth))
        if len(names) == 3:
            assert np.sqrt(np.diag(found.cov)[-3:]).max() < 1.5 * STATED
    assert np.mean(np.square(off)) == pytest.approx(1.0, abs=0.17)  # four standard errors


def test_load_point_moves_with_errors_of_the_reflectors():
    """A tool read farther out has its load point there, as a rigid body has."""
    said, tool, _ = drawn(np.random.default_rng(1))
    n = 3 * len(said.points)
    outwards = np.tile([0.0, 0.0, 4e-4], len(said.points))
    cov = said.cov.copy()
    cov[-n:, -n:] += np.outer(outwards, outwards)
    found = type(said)(**{**vars(said), "cov": cov}).carrying(tool, LEAST)

    along, own = found.cov[-1, -4], found.cov[-4, -4]
    assert along / own == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("spoilt", ["mistyped", "unstated", "unread"])
def test_load_point_stays_where_reflectors_do_not_tell(spoilt):
    """A reflector 5 mm off its statement, a tool without uncertainty, and one never read."""
    names = () if spoilt == "unread" else ("P1", "P2", "P3")
    said, tool, _ = drawn(np.random.default_rng(3), names)
    if spoilt == "mistyped":
        tool.points["P2"][1] += 5e-3
    if spoilt == "unstated":
        tool = tool._replace(std=0.0)
    assert said.carrying(tool, LEAST) is said


def test_each_element_keeps_its_own_values():
    """One of three parameters between single ones, whatever their order."""
    said, *_ = drawn(np.random.default_rng(1))
    every = {len(one.parameters): one for one in catalogue(said.robot) if isinstance(one, Elastic)}
    single, several = every[1], every[max(every)]
    numbers = {id(single): [7.0], id(several): [*range(len(several.parameters))]}

    for held in ((single, several, single), (several, single), (single,), ()):
        yields = np.array([x for one in held for x in numbers[id(one)]])
        found = replace(said, held=held, yields=yields).effects
        assert tuple(one for one, _ in found) == held
        assert all(list(values) == numbers[id(one)] for one, values in found)


def test_springs_that_are_all_softer_by_one_factor_have_it():
    """1.3 times, whatever one joint is that pulls do not determine; else they contradict it."""
    said, *_ = drawn(np.random.default_rng(1))
    c = said.compliance
    said = replace(said, cov=np.diag(np.append((0.05 * c) ** 2, np.diag(said.cov)[len(c) :])))
    value, cov = 1.3 * c, np.diag((0.02 * c) ** 2)
    known = np.arange(len(c)) != 2
    value[2] = 40 * c[2]

    found = said.common(value, cov, known)
    each = np.hypot(0.02, 1.3 * 0.05)  # of one joint's ratio
    assert found.factor == pytest.approx(1.3, rel=1e-9)
    assert found.std == pytest.approx(each / np.sqrt(known.sum()), rel=1e-6)
    assert (found.chi2, found.dof) == (pytest.approx(0, abs=1e-9), known.sum() - 1)
    value[0] *= 1 + 5 * each / 1.3
    assert 10 < said.common(value, cov, known).chi2 < 30
    assert said.common(value, cov, ~known | (c < 0)).dof == 0
    assert said.common(value, cov, c < 0) is None


def test_a_point_deviates_as_it_was_read_and_an_unread_one_as_the_mean():
    """By name, in any order and number."""
    said, *_ = drawn(np.random.default_rng(1))
    off = np.array([[1.0, 0, 0], [0, 2.0, 0], [0, 0, 3.0]])
    said = replace(said, unloaded=lambda q: (0 * q, q[:, :1, None] * off))
    names = np.array(["P3", "P9", "P1", "P2"], dtype=object)

    found = said.moved(np.outer([1.0, 1.0, 2.0, -1.0], np.ones(6)), names)

    assert found == pytest.approx(np.array([off[2], off.mean(axis=0), 2 * off[0], -off[1]]))


def test_independent_errors_make_up_the_covariance_of_all_that_positions_tell():
    """(F a, K a + W w) of unit errors has C, of any rank; each variant is one of a."""
    rng = np.random.default_rng(5)
    said, *_ = drawn(rng)
    size = np.sqrt(np.diag(said.cov))
    n, k = len(said.compliance), len(size)
    for rank in (k, 9):
        root = size[:, None] * rng.normal(size=(k, rank))
        one = replace(said, cov=root @ root.T)
        F, K, W = one.parts
        whole = np.block([[K, W], [F, np.zeros((k - n, n))]])
        made = whole @ whole.T
        np.testing.assert_allclose(
            made / np.outer(size, size), one.cov / np.outer(size, size), atol=1e-6
        )
        assert F.shape[1] == min(rank, k - n)
        assert len(one.variants) == F.shape[1]
        for a, (_, points) in enumerate(one.variants):
            off = np.concatenate([points[name] - one.points[name] for name in one.points])
            assert off == pytest.approx(F[:, a], abs=1e-12)


def test_springs_without_their_common_factor_are_less_uncertain():
    """V0 = C - f c c' over compliances only, and nothing is subtracted without one."""
    said, *_ = drawn(np.random.default_rng(1))
    c, n = said.compliance, len(said.compliance)

    assert said.springs == n
    np.testing.assert_array_equal(said.apart, said.cov[:n, :n])
    found = replace(said, factor=0.04).apart
    np.testing.assert_allclose(said.cov[:n, :n] - found, 0.04 * np.outer(c, c))
