"""The residuals of a model give one statistic with its own p-value, in every answer."""

import numpy as np
import pytest
from fit_check import told_by_chi_square
from scipy import stats

from bench.worlds import run
from bench.worlds.cell import build
from bench.worlds.run import asked
from bench.worlds.worlds import WORLDS
from pipeline.machine.robot import load
from pipeline.system.system import Goodness


def answer_to(name, seed):
    """Answer to a campaign of a world, with its hidden causes."""
    world, robot = WORLDS[name], load(WORLDS[name].robot)
    cell = build(robot, world.plan(robot, seed), world.rules, seed, world.secrets)
    _, record, factor = run._recorded(cell, world, seed)
    return asked(run._files(cell, world, record, factor)).answer


@pytest.mark.slow  # test_one_answer checks one campaign of every verdict
@pytest.mark.parametrize("world", ["normal", "student3", "wander10", "memory", "poses_as_points"])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_p_value_is_that_of_the_chi_square_beside_it(world, seed):
    """In each of the three fits of an answer, whatever the hidden causes and the noise."""
    answer = answer_to(world, seed)

    told_by_chi_square(answer)


def test_among_draws_chi_square_has_the_median_of_chi_square():
    """Draws of any scale and tail.

    Half of them are smaller, and p is the fraction that is larger.
    """
    rng = np.random.default_rng(3)
    drawn = 7 * stats.lognorm.rvs(0.5, scale=100, size=4001, random_state=rng)
    middle, high = np.median(drawn), np.quantile(drawn, 0.99)

    assert Goodness.among(middle, 80, drawn).chi2 == pytest.approx(stats.chi2.isf(0.5, 80))
    assert Goodness.among(middle, 80, drawn).p_value == pytest.approx(0.5, abs=1e-3)
    assert Goodness.among(high, 80, drawn).p_value == pytest.approx(0.01, abs=1e-3)
    assert Goodness.among(high, 80, drawn).chi2 > stats.chi2.isf(0.5, 80)


def test_what_is_beyond_the_repeats_is_compared_with_them():
    """F test of the residuals beyond the contrasts; none if there are only contrasts."""
    found = Goodness.beyond(150.0, 100, (20.0, 20), 40.0)

    assert found.p_value == pytest.approx(stats.f.sf(130 / 80, 80, 40))
    assert Goodness.beyond(20.0, 20, (20.0, 20), 40.0).p_value is None
    assert Goodness.untold(20.0, 20).p_value is None
    assert Goodness.of(0.0, 0).p_value == 1.0
