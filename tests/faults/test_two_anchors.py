"""Pulls of a pose towards two anchors: each is compared with those towards its own."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.faults import chain as module

SIGMA_M = 3e-5
PARTITIONS = [(1, 1), (2, 1), (2, 2), (3, 1), (1, 3)]
WHERE = {"one pose": (2,), "some poses": (1, 4, 5), "all poses": tuple(range(10))}
EVERY = [(partition, where) for partition in PARTITIONS for where in WHERE]


def chain(seed, partition, where, others=4):
    """Ten poses, those of `where` pulled towards two anchors, all others towards one.

    The load point yields by 4 mm under 3 kN; the ends are 0.15 and 0.95 m from it.
    """
    rng = np.random.default_rng([seed, *partition, len(where)])
    pose, force, ends = [], [], []
    for p in range(10):
        load = rng.uniform([6.0, -2, -2], [10.0, 2, 2])
        ways = rng.standard_normal((2, 3))
        ways = [ways[0], ways[1] - ways[1] @ ways[0] / (ways[0] @ ways[0]) * ways[0]]
        count = partition if p in where else (others,)
        towards = np.repeat(np.arange(len(count)), count)
        steps = (1000.0, 2600.0, 2800.0, 3000.0, 1800.0)[: len(towards)]
        for way, f in zip(towards, steps, strict=True):
            u = ways[way] / np.linalg.norm(ways[way])
            at = load + 4e-3 * f / 3000 * (u + 0.5 * np.cross(u, [0.6, 0.8, 0.0]))
            u = load + 3.0 * u - at
            u = u / np.linalg.norm(u)
            ends.append(at + np.array([0.15, 0.95])[:, None] * u)
            pose.append(p + 1)
            force.append(f)
    m = len(pose)
    return module._Chain(
        group=np.array([f"pull{k}" for k in range(m)], object),
        pose=np.array(pose),
        force=np.array(force),
        ends=np.array(ends) + SIGMA_M * rng.standard_normal((m, 2, 3)),
        std=np.full(m, np.sqrt(2) * SIGMA_M),
        stated=True,
        give=np.full(m, np.nan),
        free=np.ones(m, bool),
    )


def moved(given, pull, end, off):
    """The same with a reading of one end shifted by a vector [m]."""
    ends = given.ends.copy()
    ends[pull, end] += off
    return replace(given, ends=ends)


@pytest.mark.sampled(5)
@pytest.mark.parametrize(("partition", "where"), EVERY)
def test_no_pull_is_off_because_others_of_its_pose_go_elsewhere(partition, where):
    for seed in range(3):
        given = chain(seed, partition, WHERE[where])
        assert module._direction(given) is module._distance(given) is None


@pytest.mark.parametrize(("partition", "where"), EVERY)
def test_a_bad_end_is_found_beside_a_second_anchor(partition, where):
    """By a few millimetres along the chain, in a pose of two anchors: the last pull of the pose."""
    given = chain(5, partition, WHERE[where])
    pull = np.flatnonzero(given.pose == WHERE[where][0] + 1)[-1]
    along = given.ends[pull, 1] - given.ends[pull, 0]

    for end in (0, 1):
        assert module._distance(moved(given, pull, end, 4e-3 * along)).pull == pull


@pytest.mark.parametrize("partition", [(2, 1), (2, 2), (3, 1)])
def test_a_chain_that_is_turned_is_found_among_poses_of_two_anchors(partition):
    """An end 3 mm to the side, in a pose of one anchor, or in four pulls towards one of two."""
    wide = chain(6, (4, 1), WHERE["all poses"])
    for given, pull in ((chain(6, partition, WHERE["some poses"]), 1), (wide, 7)):
        side = np.cross(given.ends[pull, 1] - given.ends[pull, 0], [0.3, 0.5, 0.8])
        bad = moved(given, pull, 1, 3e-3 * side / np.linalg.norm(side))
        assert module._direction(bad).pull == pull
        assert np.linalg.norm(module._misses(bad, pull)[1]) > 2e-3


@pytest.mark.parametrize("end", [0, 1])
def test_a_bad_end_is_no_anchor(end):
    """Far to the side, one end alone: the pull stays with those of its pose."""
    given = chain(7, (4,), WHERE["one pose"])
    bad = moved(given, 5, end, np.array([0.3, -0.4, 0.2]))
    assert (bad.towards == given.towards).all()
    assert module._direction(bad).pull == 5
