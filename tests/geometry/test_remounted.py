"""Targets that are taken off and put on again between two series."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_geometry import TOOL, made, stands
from test_position_facts import ROBOT, TURN

from pipeline.geometry.initial import begin
from pipeline.geometry.remounted import remounted

STRAIGHT = Rotation.identity()
HOLDER = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.15, 0.05]])
"""Targets from the point of the tool, flange frame [m]."""


def two_series(shift=(0.0, 0.0, 0.0), turn=STRAIGHT, six=False, still=False, m=40):
    """Readings of two days; on the second the targets stand elsewhere on the flange.

    Args:
        shift: Motion of the targets [m], shape (3,), or of each of them, (3, 3).
        turn: Rotation of the targets about the point of the tool.
        six: A single 6D target instead of three points.
        still: On the second day the flange keeps its orientation.
    """
    rng = np.random.default_rng(5)
    readings = made(2 * m, rng, noise=0.0)
    q = readings.q.copy()
    if still:
        q[m:, [0, 4, 5]] = [0.4, 1.2, -0.3]
        q[m:, 3] = 0.7 - q[m:, 1] - q[m:, 2]
    at, axes = stands(q, 1e-5 * rng.standard_normal(q.shape))
    second = np.arange(2 * m) >= m
    points = np.stack([TOOL + HOLDER, TOOL + turn.apply(HOLDER) + np.array(shift)])[
        second.astype(int)
    ]
    flange = axes @ TURN.T
    every = at[:, None] + np.einsum("mij,mtj->mti", flange, points - TOOL)
    every[second] = every[second] @ Rotation.from_euler("z", 0.8).as_matrix().T + [3.0, 1.0, 0.2]
    shown = np.where(second[:, None, None], turn.as_matrix(), np.eye(3))
    tips = flange @ shown
    tips[second] = Rotation.from_euler("z", 0.8).as_matrix() @ tips[second]
    count = 1 if six else 3
    return replace(
        readings,
        q=q,
        series=second.astype(np.int64),
        names=np.array(["monday", "friday"], dtype=object),
        targets=np.array(list("ABC")[:count], dtype=object),
        six=np.full(count, six),
        at=(every + 2e-5 * rng.standard_normal(every.shape))[:, :count],
        turn=np.tile(tips[:, None], (1, count, 1, 1)),
    )


@pytest.mark.parametrize(
    ("shift", "turn", "six"),
    [
        ((0.04, -0.02, 0.01), Rotation.identity(), False),
        ((0.0, 0.0, 0.0), Rotation.from_euler("z", 90, degrees=True), False),
        (((0.0, 0.0, 0.0), (0.0, 0.03, 0.0), (0.0, 0.0, 0.0)), Rotation.identity(), False),
        ((0.0, 0.0, 0.0), Rotation.from_euler("x", 3, degrees=True), True),
    ],
    ids=["shifted", "turned", "one of three", "6D, turned in its place"],
)
def test_a_holder_put_on_again_is_another_one(shift, turn, six):
    """All of its targets are others in that series, where they were put within 3 mm."""
    given = two_series(np.array(shift), turn, six)
    count = given.at.shape[1]
    readings, points, found = remounted(ROBOT, given, {})

    (one,) = found
    assert one.series in {("friday",), ("monday",)}
    assert len(readings.targets) == 2 * count
    first = begin(ROBOT, readings, points).tool[:, :3, 3]
    by_name = dict(zip(readings.targets, first, strict=True))
    moved = np.array([by_name[new] - by_name[new[0]] for new in one.targets])
    there = (turn.apply(HOLDER) - HOLDER + shift)[:count]
    sign = 1 if one.series == ("friday",) else -1
    np.testing.assert_allclose(moved, sign * there, atol=3e-3)


@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.0), (1e-3, 0.0, 0.0)])
@pytest.mark.parametrize("six", [False, True])
def test_what_a_table_as_delivered_explains_is_no_other_holder(shift, six):
    given = two_series(np.array(shift), six=six)
    readings, points, found = remounted(ROBOT, given, {})
    assert readings is given
    assert not points
    assert not found


@pytest.mark.parametrize("six", [False, True])
def test_a_series_at_one_orientation_does_not_hide_where_the_targets_are(six):
    """Its poses fit any points of the flange; those of the other day tell which.

    It is the longer one, from which the points used to be taken.
    """
    given = two_series(still=True, six=six)
    given = given.part(np.r_[0:15, 40:80])
    readings, points, found = remounted(ROBOT, given, {})
    assert not found
    tool = begin(ROBOT, readings, points).tool[:, :3, 3]
    np.testing.assert_allclose(tool, (TOOL + HOLDER)[: len(tool)], atol=3e-3)
