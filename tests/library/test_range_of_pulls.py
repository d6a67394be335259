"""Pulls beside those of the campaign: within its range, at an end of it, and outside."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.diagnosis.isolability import rich_pulls, rich_tool
from pipeline.library.compensate import against_pulls
from pipeline.machine.cell import load, paper_cell, sensitivity
from pipeline.machine.effect import Elastic
from pipeline.machine.effects import unlisted
from pipeline.machine.robot import load as robot_of

KR500 = robot_of("kr500_rail")
CELL = paper_cell(KR500, rich_tool(np.random.default_rng(36)))
PULLS = rich_pulls(KR500, np.random.default_rng(36), 40)
LINES = (3, "spring", "smooth", "angle", 3)


@pytest.mark.parametrize(
    ("hardest", "said"),
    [
        (400.0, ""),
        (200.0, "check their unit"),
        (2100.0, "not tested"),
        (2000.0 * (1 + 4e-16), ""),
        (1000.0 / 4.4482 * (1 + 4e-16), "check their unit"),
    ],
)
def test_less_than_the_smallest_pull_is_warned_of_only_by_the_ratio_of_units(hardest, said):
    """Pulls of 1 to 2 kN: 400 N are a third of a pull, 200 N may be newtons for pounds."""
    found = " ".join(against_pulls(np.array([10.0, hardest]), (1000.0, 2000.0)))

    assert (said in found) if said else not found


def laws():
    """One law of each part, shape and variable that a pull could show, valid where they pull."""
    every = unlisted.effects(KR500, load(CELL, PULLS, np.zeros(7)))
    kinds = {one.law.family[1:4]: one for one in every if isinstance(one, Elastic)}
    assert len(kinds) > 30
    return list(kinds.values())


def unsure(every, pulls):
    """Whatever of each law is uncertain outside its range: norm [m] at each pull."""
    more = [unlisted.beyond(KR500, one, np.ones(len(one.parameters)))[0] for one in every]
    moved = sensitivity(CELL, pulls, np.zeros(7), more)
    ends = np.cumsum([len(one.parameters) for one in more])[:-1]
    return np.sqrt([(one**2).sum(axis=(1, 2, 3)) for one in np.split(moved, ends, axis=-1)])


def nearly(pulls, size):
    """The same pulls, each number another by this much of itself, upwards or downwards."""
    rng = np.random.default_rng(62)
    wrong = {
        name: getattr(pulls, name) * (1 + size * rng.choice([-1, 1], getattr(pulls, name).shape))
        for name in ("q", "force", "time", "time_zero")
    }
    return replace(pulls, **wrong)


def test_a_pull_of_the_campaign_is_within_its_range_however_it_is_rounded():
    """In the last digits nothing is uncertain, in a fifth printed digit little, of any law."""
    every = laws()
    far = replace(PULLS, q=PULLS.q + 7.0, force=3 * PULLS.force, time=PULLS.time * 3)
    whole = unsure(every, far).max(axis=1, keepdims=True)
    assert (whole > 0).mean() > 0.9

    assert (unsure(every, nearly(PULLS, 1e-15)) <= 1e-9 * whole).all()
    assert (unsure(every, nearly(PULLS, 1e-5)) <= 0.1 * whole).all()


def test_from_a_hundredth_of_the_range_on_a_law_is_as_uncertain_as_large():
    """Joint 3 that much beyond its largest angle: a spring of the amplitude of a line over it."""
    made = unlisted.effects(KR500, load(CELL, PULLS, np.zeros(7)))
    (line,) = [one for one in made if one.law.family == LINES and one.law.order == 1.0]
    q = PULLS.q.copy()
    q[:, 2] = q[:, 2].max() + 0.01 * np.ptp(q[:, 2])
    spring = sensitivity(CELL, replace(PULLS, q=q), np.zeros(7), CELL.effects)[..., 2]

    assert unlisted.beyond(KR500, line, np.array([3e-9]))[1] == pytest.approx(9e-18)
    assert unsure([line], replace(PULLS, q=q))[0] == pytest.approx(
        np.linalg.norm(spring, axis=(1, 2))
    )


@pytest.mark.parametrize(
    ("low", "high", "within", "without"),
    [
        (-1.2, 0.7, [-1.2 * (1 + 4e-16), 0.0, 0.7 * (1 + 4e-16)], [-1.21, 0.71]),
        (3000.0, 3000.0, [3000 * (1 - 4e-16), 3000.0, 3000 * (1 + 4e-16)], [2990.0, 3010.0]),
        (0.0, 0.0, [0.0], [-0.001, 0.001]),
        (0.0, 9.0, [np.nan], [9.1]),
    ],
)
def test_a_range_has_ends_however_its_values_are_rounded(low, high, within, without):
    """Angles, weights all of one size, a joint that never moved, a time that is not known."""
    found = unlisted.outside(np.array([*within, *without]), low, high)

    assert found == pytest.approx([0] * len(within) + [1] * len(without), abs=1e-9)
