"""A target that moved on the effector: its readings are shifted along the line from another target.

Neither the robot nor its table is used to plant it. Joints err by a milliradian at every pose.
"""

import numpy as np
import pytest
from rail_chain import POINTS, stands

from pipeline.geometry.remastered import slipped
from pipeline.geometry.unloaded import Unloaded
from pipeline.machine.cell import Tool
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import load

KR500 = load("kr500_rail")
POSES = 14
NOISE_M = 2e-5
NO_ONE = 1e-6


def read(seed, moved, targets=3):
    """Readings in which `moved` [m], (p, targets), is added along the line from the next target."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(KR500.lower, KR500.upper, (POSES, 7))
    at = stands(q + 1e-3 * rng.standard_normal(q.shape), None, POINTS[:targets])
    along = at - np.roll(at, -1, axis=1) + 1e-12  # of one target there is no line
    at = at + moved[:, :, None] * along / np.linalg.norm(along, axis=2, keepdims=True)
    at = at.reshape(-1, 3) + NOISE_M * rng.standard_normal((targets * POSES, 3))
    none, pose = np.zeros(POSES), np.repeat(np.arange(POSES), targets)
    pulls = Pulls(np.arange(POSES) + 4, none.astype(int), q, np.ones((POSES, 3)), *[none] * 4)
    names = np.array(["P1", "P2", "P3"][:targets], object)
    return Unloaded(
        robot=KR500, tool=Tool(np.array([0.15, 0.0, 0.25]), names, POINTS[:targets]), sag=None,
        pulls=pulls.part(pose), pose=pose, target=np.tile(np.arange(targets), POSES), at=at,
        cov=np.tile(NOISE_M**2 * np.eye(3), (targets * POSES, 1, 1)), rotation=1e-5 * np.eye(3),
        joint_std=np.zeros(7),
    )  # fmt: skip


def found(zeros):
    """Likeliest change, and its p-value."""
    slips = slipped(zeros, zeros.about(np.zeros(zeros.columns.count)))
    return min(slips.items(), key=lambda one: one[1])


def course(share, target, size_m, targets=3):
    """A motion of one target in proportion to `share` of each pose."""
    return size_m * np.asarray(share, float)[:, None] * (np.arange(targets) == target)


@pytest.mark.parametrize(("target", "since", "size_m"), [(2, 5, 3e-4), (0, 9, -2e-4), (1, 3, 4e-4)])
def test_a_target_that_moved_is_found_with_its_pose(target, since, size_m):
    """Though the joints move it five times as far at every pose."""
    zeros = read(1, course(np.arange(POSES) >= since, target, size_m))

    change, p = found(zeros)

    assert (change.target, change.since) == (target, since + 4)
    assert change.before == tuple(range(4, since + 4))
    assert p < NO_ONE


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize("targets", [2, 3])
def test_a_rigid_effector_gives_no_alarm(targets):
    """P-values of the likeliest of all targets and poses, before any correction for their number.

    Of 60 draws the smallest of some nine independent ones is below 1e-4 in one of 20 such tests.
    """
    every = [found(read(seed, np.zeros((POSES, targets)), targets))[1] for seed in range(60)]

    assert min(every) > 1e-6
    assert np.median(every) > 5e-3


@pytest.mark.parametrize("share", [np.arange(POSES) == 4, np.arange(POSES) == 12, np.arange(POSES)])
def test_neither_a_bad_reading_nor_a_creep_is_a_step(share):
    """One pose of one target is off by 1 mm; or a target creeps by 1 mm in all."""
    size_m = 1e-3 / np.max(share)

    assert found(read(2, course(share, 1, size_m)))[1] == 1.0


def test_one_target_has_no_shape():
    """Nothing can be said of it without the robot."""
    zeros = read(3, np.zeros((POSES, 1)), 1)

    assert slipped(zeros, zeros.about(np.zeros(zeros.columns.count))) == {}


def test_with_two_targets_either_may_have_moved():
    """Their distance does not tell which one: both have the same p-value."""
    zeros = read(4, course(np.arange(POSES) >= 6, 0, 5e-4, 2), 2)

    slips = slipped(zeros, zeros.about(np.zeros(zeros.columns.count)))

    assert len(slips) == 2
    assert max(slips.values()) < NO_ONE
