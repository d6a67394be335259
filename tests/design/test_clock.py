"""Times of a planned pose, by walking through it with a clock."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_design import ANCHOR, SCATTERS, experiment, inside

from pipeline.design.schedule import READING_S, TIGHTEN_S, pulls_at
from pipeline.machine.robot import load


@pytest.mark.parametrize("steps", [[900.0], [900.0, 1800.0, 2700.0]])
@pytest.mark.parametrize("zeros", [1, 0.5])
def test_pulls_and_zeros_are_when_they_are_read(steps, zeros):
    """The second zero is read when the chain has been slackened after the last of all pulls."""
    robot = load("kr500_rail")
    made = experiment(robot, SCATTERS["paper"])
    made = SimpleNamespace(
        robot=robot,
        load_point=made.load_point,
        points=made.points,
        scale=made.scale,
        scatter=SimpleNamespace(zero=zeros),
    )
    targets, now = len(made.points), 500.0

    def read(count):
        nonlocal now
        times = now + READING_S * np.arange(count)
        now += READING_S * count
        return times.mean()

    zero, pulled = [read(targets)], []
    for _ in steps:
        now += TIGHTEN_S
        pulled.append(read(targets + 2))
    if zeros != 1:
        now += TIGHTEN_S
        zero.append(read(targets))

    q = inside(robot, 1, np.random.default_rng(1))
    found = pulls_at(made, q, ANCHOR, np.ones(1), np.array(steps), np.array([500.0]))

    assert found.time == pytest.approx(pulled)
    assert found.time_zero == pytest.approx(np.full(len(steps), np.mean(zero)))
