"""DH parameters: the effect of each, against a modified table."""

import numpy as np
import pytest

from pipeline.machine.robot import configure, load
from pipeline.machine.robot.dh_parameters import changed, dh_parameters, moved, twists


@pytest.mark.parametrize(
    "name", ["kr500_rail", "ur10", "fanuc_r2000ic", "irb6640", "kr210_r2700_2"]
)
def test_a_letter_moves_the_flange_as_the_table_that_has_it(name):
    robot = load(name)
    known = dh_parameters(robot)
    rng = np.random.default_rng(1)
    q = rng.uniform(-1, 1, (5, robot.n))
    here = configure(robot, q)
    point = np.array([[0.1, -0.2, 0.3]])
    before = here.points(point)[:, 0]
    unit = twists(here, known)

    for k, letter in enumerate(known):
        values = np.zeros(len(known))
        values[k] = 1e-6
        after = configure(changed(robot, known, values), q).points(point)[:, 0]
        foreseen = np.cross(unit[:, k, :3], before) + unit[:, k, 3:]
        assert np.allclose((after - before) / 1e-6, foreseen, atol=2e-5), letter.label


@pytest.mark.parametrize("name", ["kr500_rail", "ur10", "irb6640"])  # each convention
def test_a_moved_robot_stands_as_the_one_with_a_changed_table(name):
    robot = load(name)
    known = dh_parameters(robot)
    values = np.random.default_rng(2).normal(0, 1e-2, len(known))

    one, other = moved(robot, known, values), changed(robot, known, values)

    assert one.placement == pytest.approx(other.placement, rel=0, abs=1e-12)
    assert one.flange == pytest.approx(other.flange, rel=0, abs=1e-12)
