"""The two reflectors on the chain: bad readings, and the normal behaviour of a chain."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from pipeline.faults import chain as module
from pipeline.faults.chain import chain_gross, chain_outlier
from pipeline.reduction.register import XYZ
from pipeline.run import ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory
from pipeline.system import alarms

SIGMA_M = 3e-5
STEPS = (1000.0, 1600.0, 2300.0, 3000.0)
TOOL = np.array([[0.2, 0.0, 0.1], [-0.1, 0.2, 0.1], [-0.1, -0.2, 0.2]])


@cache
def case():
    """A campaign except for the readings of the chain."""
    plan = Plan(poses={"count": 8}, pulls={"steps_n": [1500.0, 3000.0]})
    files = simulate(plan, np.random.default_rng(4)).files
    return ingested(in_memory(files), plausible=False)


def read(
    rng,
    poses=10,
    steps=STEPS,
    sag_n=0.0,
    stretch_m=0.0,
    hung_m=0.0,
    back_m=0.0,
    softens=0.0,
    fixed=False,
    sigma_m=SIGMA_M,
    gives=1.0,
    nearer_m=None,
):
    """A campaign of chains in a room: anchor, load point that gives way, links between them.

    Args:
        rng: Draws the room and the scatter.
        poses: Number of poses.
        steps: Force of each pull [N].
        sag_n: Weight of the chain; it droops by a quarter of that over the force.
        stretch_m: How much nearer its ends stand under no force than under 3 kN.
        hung_m: How much the distance differs from pose to pose, standard deviation.
        back_m: How much less the load point gives way in the last pull of a pose.
        softens: How much more it gives way under 3 kN than in proportion to the force [1].
        fixed: Whether the far end stays where it is, as at an anchor, however far the near one
            comes.
        sigma_m: Scatter of a reading per axis, also as stated.
        gives: How far the load point gives way, over what it usually does.
        nearer_m: How much nearer its ends were fixed in the second half of the pulls of one pose,
            which go towards another anchor in every pose; None for one anchor a pose.
    """
    rows, loads = [], []
    hung = 0.6 + hung_m * rng.standard_normal(poses)
    for pose in range(poses):
        load = rng.uniform([6.0, -2, -2], [10.0, 2, 2])
        anchor = load + rng.uniform(1.5, 6) * _unit(rng.standard_normal(3))
        give = gives * rng.uniform(1e-3, 5e-3) * rng.standard_normal(3)
        for k, force in enumerate(steps):
            if nearer_m is not None and k == len(steps) // 2:
                anchor = load + rng.uniform(1.5, 6) * _unit(rng.standard_normal(3))
                hung[pose] -= nearer_m * (pose == poses // 2)
            late = back_m * (k == len(steps) - 1) * _unit(give)
            moved = give * force / 3000 * (1 + softens * force / 3000) - late
            at = load + moved
            u = _unit(anchor - at)
            droop = sag_n / (4 * force) * np.cross(u, [0.6, 0.8, 0.0])
            length = hung[pose] + stretch_m * force / 3000
            ends = np.array([at + 0.15 * (u + droop), at + (0.15 + length) * _unit(u + droop)])
            if fixed:
                ends[1] = load + (0.15 + hung[pose]) * _unit(anchor - load)
            ends += sigma_m * rng.standard_normal((2, 3))
            group = f"pose{pose + 1:02d}_rep{k + 1}_loaded"
            loads.append((pose + 1, k + 1, force + 2 * rng.standard_normal()))
            points = [*ends, *(load + moved + TOOL + sigma_m * rng.standard_normal((3, 3)))]
            for name, point in zip(("Pl1", "Pl2", "P1", "P2", "P3"), points, strict=True):
                rows.append((group, name, pose + 1, k + 1, "loaded", *point))
    readings = pd.DataFrame(rows, columns=["group", "target", "pose", "repeat", "state", *XYZ])
    for name in (c for c in case().readings.columns if c not in readings):
        readings[name] = sigma_m**2 if name in ("cxx_m2", "cyy_m2", "czz_m2") else 0.0
    return replace(
        case(),
        readings=readings,
        loads=pd.DataFrame(loads, columns=["pose", "repeat", "force_n"]),
    )


def _unit(v):
    return v / np.linalg.norm(v)


def spoiled(given, group, target, off):
    """The same with one reading shifted by a vector [m]."""
    readings = given.readings.copy()
    row = (readings["group"] == group) & (readings["target"] == target)
    readings.loc[row, XYZ] = readings.loc[row, XYZ].to_numpy(float) + off
    return replace(given, readings=readings)


CHAINS = [
    {},
    {"sag_n": 60.0},
    {"stretch_m": 4e-4},
    {"hung_m": 5e-2},
    {"hung_m": 5e-2, "stretch_m": 4e-4, "back_m": 5e-4},
    {"steps": (1500.0, 3000.0), "hung_m": 5e-2},
    {"steps": (3000.0,), "poses": 30},
    {"back_m": 5e-4, "sag_n": 30.0},
    {"steps": (900.0, 1900.0, 3000.0, 1900.0), "softens": 2.0},
    {"fixed": True},
    {"fixed": True, "hung_m": 5e-2, "steps": (1500.0, 3000.0)},
    {"nearer_m": 0.0},
]


@pytest.mark.sampled(5)
@pytest.mark.parametrize("seeds", [range(4), range(4, 8), range(8, 12)])
@pytest.mark.parametrize("chain", CHAINS)
def test_a_good_chain_is_not_accused(chain, seeds):
    """Chains sag and stretch, hang differently in every pose, and load points return late."""
    for seed in seeds:
        assert not chain_outlier(read(np.random.default_rng([seed, 9]), **chain))


@pytest.mark.parametrize("nearer_m", [0.018, 2e-3, 3e-4])
def test_a_chain_may_be_hung_differently_towards_another_anchor(nearer_m):
    """Its ends were fixed nearer for two pulls; a bad reading of another pose is still named."""
    for seed in range(3):
        given = read(np.random.default_rng(seed), nearer_m=nearer_m)
        assert not chain_outlier(given)
        (found,) = chain_outlier(spoiled(given, "pose02_rep1_loaded", "Pl2", [3e-3, 2e-3, -2e-3]))
        assert found.where.startswith("pose02_rep1_loaded")


@pytest.mark.parametrize("nearer_m", [0.1, 0.024, 3e-3])
def test_a_far_end_that_stands_in_both_pulls_of_a_pose_is_no_bad_reading(nearer_m):
    """Two pulls show no course of a length; one that is bad in one of them is still named."""
    for seed in range(3):
        given = read(np.random.default_rng(seed), steps=(1500.0, 3000.0), gives=2.0)
        rows = given.readings.set_index(["group", "target"])[XYZ]
        near, first, second = (
            rows.loc[f"pose04_rep{k}_loaded", end].to_numpy(float)
            for k, end in ((1, "Pl1"), (1, "Pl2"), (2, "Pl2"))
        )
        off = -nearer_m * _unit(first - near)
        given = spoiled(given, "pose04_rep1_loaded", "Pl2", off)
        given = spoiled(given, "pose04_rep2_loaded", "Pl2", first + off - second)

        assert not chain_gross(given)
        assert not chain_outlier(given)
        (found,) = chain_outlier(spoiled(given, "pose02_rep1_loaded", "Pl2", [3e-3, 2e-3, -2e-3]))
        assert found.where.startswith("pose02_rep1_loaded")


@pytest.mark.parametrize("pulls", [[2], [3, 4]])
@pytest.mark.parametrize("turn_rad", [2e-3, 2e-2])
def test_a_chain_that_swings_about_the_load_point_is_no_bad_reading(pulls, turn_rad):
    """It went to another place, 2 cm beside; a bad reading of another pose is still named."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        given = read(rng, steps=(800.0, 1400.0, 1900.0, 2500.0, 3000.0))
        rows = given.readings.set_index(["group", "target"])[XYZ]
        v = turn_rad * _unit(rng.standard_normal(3))
        for pull in pulls:
            group = f"pose04_rep{pull}_loaded"
            near, far = (rows.loc[group, end].to_numpy(float) for end in ("Pl1", "Pl2"))
            load = near - 0.15 * _unit(far - near)
            for end, at in (("Pl1", near), ("Pl2", far)):
                given = spoiled(given, group, end, np.cross(v, at - load))

        assert not chain_outlier(given)
        (found,) = chain_outlier(spoiled(given, "pose02_rep1_loaded", "Pl2", [3e-3, 2e-3, -2e-3]))
        assert found.where == "pose02_rep1_loaded/Pl2"


@pytest.mark.parametrize(("along", "off_m"), [(1.0, 1.2e-4), (0.0, 2e-4)])
def test_what_turns_no_force_by_more_than_a_scale_scatters_is_not_named(along, off_m):
    """However certain it is: by a tracker of 2 micrometres, an end is off by 60 to 100 of them."""
    given = read(np.random.default_rng(5), sigma_m=2e-6, gives=0.05)
    rows = given.readings.set_index(["group", "target"])[XYZ]
    u = _unit(
        np.subtract(*(rows.loc[("pose04_rep2_loaded", k)].to_numpy() for k in ("Pl2", "Pl1")))
    )
    way = u if along else _unit(np.cross(u, [0.1, 0.2, 0.9]))

    small, large = (
        chain_outlier(spoiled(given, "pose04_rep2_loaded", "Pl1", size * way))
        for size in (off_m, 3 * off_m)
    )

    assert not small
    assert [f.where for f in large] == ["pose04_rep2_loaded/Pl1"]


@pytest.mark.sampled(5)
@pytest.mark.parametrize("end", ["Pl1", "Pl2"])
@pytest.mark.parametrize(
    ("chain", "along"),
    [
        ({}, 0.0),
        ({}, 1.0),
        ({"hung_m": 5e-2, "stretch_m": 4e-4}, 0.0),
        ({"hung_m": 5e-2, "stretch_m": 4e-4}, 1.0),
        ({"fixed": True}, 1.0),
    ],
)
def test_a_bad_reading_of_the_chain_is_named(end, chain, along):
    """One end is off by 1 mm, along the chain or across it."""
    given = read(np.random.default_rng(5), **chain)
    rows = given.readings.set_index(["group", "target"])[XYZ]
    at = [rows.loc[("pose04_rep2_loaded", name)].to_numpy(float) for name in ("Pl1", "Pl2")]
    u = _unit(at[1] - at[0])
    across = _unit(np.cross(u, [0.1, 0.2, 0.9]))

    found = chain_outlier(
        spoiled(given, "pose04_rep2_loaded", end, 1e-3 * (u if along else across))
    )

    assert [f.where for f in found] == [f"pose04_rep2_loaded/{end}"]
    assert found[0].size == pytest.approx(1e-3, rel=0.25)
    assert found[0].p_value < 1e-3


def test_a_pull_whose_force_was_set_aside_is_not_held_against_the_others():
    """How far a fixed end and the robot come apart without a force, no other pull says."""
    given = read(np.random.default_rng(7), fixed=True)
    of = given.loads
    for pose in of["pose"].unique():
        known = ~(of["pose"].eq(pose) & of["repeat"].isin([1, 3]))
        assert not chain_outlier(replace(given, loads=of[known]))


def test_two_pulls_of_a_pose_tell_it_by_all_others():
    """With two pulls in a pose the distance shows which pull is bad, but not which end."""
    given = read(np.random.default_rng(6), steps=(1500.0, 3000.0))
    rows = given.readings.set_index(["group", "target"])[XYZ]
    at = [rows.loc[("pose03_rep1_loaded", name)].to_numpy(float) for name in ("Pl1", "Pl2")]

    found = chain_outlier(spoiled(given, "pose03_rep1_loaded", "Pl2", 8e-4 * _unit(at[1] - at[0])))

    assert [f.where for f in found] == ["pose03_rep1_loaded/Pl1-Pl2"]


def ends(rng, poses=6, pulls=4, sigma=SIGMA_M, stated=True, hung_m=0.0):
    """Both ends of a chain as arrays, linear in the force in each pose, with scatter."""
    m = poses * pulls
    pose = np.repeat(np.arange(poses), pulls)
    force = np.tile(np.linspace(900.0, 3000.0, pulls), poses) + 20 * rng.standard_normal(m)
    start = rng.uniform(-3, 3, (poses, 3))[pose]
    u = rng.standard_normal((poses, 3))
    u = (u / np.linalg.norm(u, axis=1, keepdims=True))[pose]
    give = 2e-3 * rng.standard_normal((poses, 3))[pose] * force[:, None] / 3000
    give -= np.sum(give * u, axis=1, keepdims=True) * u
    length = 0.6 + 1e-4 * force / 3000 + (hung_m * rng.standard_normal(poses))[pose]
    std = (np.linspace(0.7, 1.4, m) if stated else np.ones(m)) * sigma * np.sqrt(2)
    far = start + length[:, None] * u + give + 0.5 * std[:, None] * rng.standard_normal((m, 3))
    far += (np.sqrt(1 - 0.25) * std * rng.standard_normal(m))[:, None] * u
    group = np.array([f"pose{p:02d}_{k}" for k, p in enumerate(pose)], object)
    at = np.stack([start, far], axis=1)
    std = std if stated else np.ones(m)
    return module._Chain(
        group, pose, force, at, std, stated, give=np.full(m, np.nan), free=np.ones(m, bool)
    )


def longer(given, k, by):
    """The far end of one pull shifted along the chain [m], or by a vector."""
    at = given.ends.copy()
    at[k, 1] += by * _unit(at[k, 1] - at[k, 0]) if np.isscalar(by) else by
    return replace(given, ends=at)


def lengths_without(given, k, poses=False):
    """Length of pull k minus the prediction from the others.

    Sums of squares with and without it.
    """
    length = np.linalg.norm(given.ends[:, 1] - given.ends[:, 0], axis=1)
    one = np.ones((len(length), 1))
    if poses:
        one = (given.pose[:, None] == np.unique(given.pose)).astype(float)
    X = np.hstack([one, given.force[:, None] / 3000]) / given.std[:, None]
    y = length / given.std
    rest = np.arange(len(y)) != k
    x, *_ = np.linalg.lstsq(X[rest], y[rest], rcond=None)
    whole = y - X @ np.linalg.lstsq(X, y, rcond=None)[0]
    dof = int(rest.sum()) - np.linalg.matrix_rank(X[rest])
    off = (y[k] - X[k] @ x) * given.std[k]
    return off, whole @ whole, np.sum((y[rest] - X[rest] @ x) ** 2), dof


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("hung_m", [0.0, 2e-2])
def test_a_distance_is_held_against_a_fit_to_the_others(stated, hung_m):
    """Deleted residual, its value in sigmas, and its p-value times the number of pulls."""
    given = longer(ends(np.random.default_rng(3), stated=stated, hung_m=hung_m), 9, -5e-4)

    found = module._distance(given)

    off, whole, left, dof = lengths_without(given, 9, poses=hung_m > 0)
    variance = max(left / dof, 1.0) if stated else left / dof
    assert found.pull == 9
    assert found.size == pytest.approx(abs(off), rel=1e-6)
    assert found.sigmas == pytest.approx(np.sqrt((whole - left) / variance), rel=1e-6)
    chance = 24 * stats.f.sf((whole - left) / variance, 1, dof)
    assert found.p_value == pytest.approx(chance, rel=1e-4)


@pytest.mark.parametrize("hung_m", [0.0, 2e-2])
@pytest.mark.parametrize("k", [3, 14, 22])
def test_pulls_towards_an_anchor_take_no_part_in_distances(k, hung_m):
    """As if they had not been measured, however long; a pull keeps its number."""
    rng = np.random.default_rng(6)
    given = longer(ends(rng, hung_m=hung_m), k, 7e-4)
    free = np.isin(np.arange(24) % 8, [1, 4]) | (np.arange(24) == k) | (rng.random(24) < 0.7)
    for anchored in np.flatnonzero(~free):
        given = longer(given, anchored, 1.5)
    kept = {name: getattr(given, name)[free] for name in ARRAYS}

    found, alone = (
        module._distance(replace(given, free=free)),
        module._distance(replace(given, **kept, free=np.ones(free.sum(), bool))),
    )

    assert found.pull == k
    assert np.flatnonzero(free)[alone.pull] == k
    assert (found.size, found.sigmas) == pytest.approx((alone.size, alone.sigmas), rel=1e-9)
    assert found.p_value == pytest.approx(alone.p_value, rel=1e-6)
    assert found.size == pytest.approx(7e-4, abs=2e-4)


ARRAYS = ("group", "pose", "force", "ends", "std", "give")


def test_of_two_pulls_of_a_pose_the_one_unlike_all_is_told():
    """How the chain was hung is known only from the other one; all other poses decide."""
    rng = np.random.default_rng(8)
    given = ends(rng, poses=12, pulls=2)
    assert module._distance(longer(given, 7, 6e-4)).pull == 7
    assert module._distance(longer(given, 6, 6e-4)).pull == 6


def test_nothing_short_is_reported():
    """For a chain known to a micrometre, 0.14 mm are significant but too small, 0.17 are not."""
    given = ends(np.random.default_rng(4), sigma=1e-6)

    assert module._distance(longer(given, 5, 1.4e-4)) is None
    assert module._distance(longer(given, 5, 1.7e-4)).pull == 5


def across(given, k, by):
    """The far end of one pull shifted across the chain [m]."""
    u = _unit(given.ends[k, 1] - given.ends[k, 0])
    return longer(given, k, by * _unit(np.cross(u, [0.3, 0.5, 0.8])))


def test_a_direction_is_held_against_a_fit_to_the_others():
    """Two transverse coordinates, linear within each pose; scatter common to all."""
    given = across(ends(np.random.default_rng(5)), 13, 3e-3)
    pulls = np.arange(24)

    p, apart, size, sigmas = module._turns(given, pulls, given.force)

    u = given.ends[:, 1] - given.ends[:, 0]
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    squares, gone, off = np.zeros(24), np.zeros(24), np.zeros(24)
    for pose in range(6):
        here = np.flatnonzero(given.pose == pose)
        mean = _unit(u[here].sum(axis=0))
        first = _unit(np.cross(mean, [0.2, -0.7, 0.4]))
        w = u[here] @ np.stack([first, np.cross(mean, first)], axis=1)
        X = np.stack([np.ones(4), given.force[here]], axis=1)
        whole = np.sum((w - X @ np.linalg.lstsq(X, w, rcond=None)[0]) ** 2)
        for k, pull in enumerate(here):
            rest = np.arange(4) != k
            x = np.linalg.lstsq(X[rest], w[rest], rcond=None)[0]
            squares[pull], gone[pull] = whole, np.sum((w[rest] - X[rest] @ x) ** 2)
            off[pull] = np.linalg.norm(w[k] - X[k] @ x)
    total, drop = squares[::4].sum(), squares - gone
    dof = 2 * 24 - 6 * 4 - 2
    variance = (total - drop) / dof
    np.testing.assert_allclose(size, off, rtol=1e-5)
    np.testing.assert_allclose(sigmas, np.sqrt(drop / variance), rtol=1e-5)
    np.testing.assert_allclose(p, stats.f.sf(drop / 2 / variance, 2, dof), rtol=1e-4)
    np.testing.assert_allclose(apart, np.sqrt(drop / 2 / (gone / 2)), rtol=1e-4)
    found = module._direction(given)
    assert found.pull == 13
    other = module._turns(given, pulls, 1 / given.force)
    assert found.p_value == pytest.approx(24 * max(p[13], other[0][13]), rel=1e-6)
    assert found.size == pytest.approx(min(size[13], other[2][13]), rel=1e-6)
    assert found.sigmas == pytest.approx(min(sigmas[13], other[3][13]), rel=1e-6)


def test_directions_of_poses_with_fewer_than_four_known_pulls_are_not_tested():
    """Three pulls are one too few; one of them without a force does not count."""
    good = ends(np.random.default_rng(5))
    bad = across(good, 13, 3e-3)
    force = bad.force.copy()
    force[15] = np.nan

    assert module._direction(bad).pull == 13
    assert module._direction(replace(bad, force=force)) is None
    assert module._direction(across(ends(np.random.default_rng(5), pulls=3), 10, 3e-3)) is None
    assert module._direction(across(ends(np.random.default_rng(5), sigma=1e-6), 13, 1e-4)) is None


@pytest.mark.whole
def test_clean_draws_of_a_chain_are_accused_no_more_often_than_the_rate(monkeypatch):
    """200 chains, distances and directions at a rate of a fifth each."""
    monkeypatch.setattr(alarms, "READING", 0.4)
    for name in ("_SHORT_M", "_MATTERS_RAD", "_APART"):
        monkeypatch.setattr(module, name, 0.0)
    rng, accused = np.random.default_rng(6), np.zeros(2)
    for _ in range(200):
        given = ends(rng, stated=False)
        accused += [module._distance(given) is not None, module._direction(given) is not None]

    # within four sigma of the rate above, and no test inactive
    assert (accused <= 40 + 4 * np.sqrt(32)).all()
    assert accused[0] >= 20


def test_the_end_that_moved_is_told_where_one_stands_out_three_times_as_much():
    """By the distance of each from the linear course of the others in its pose."""
    given = ends(np.random.default_rng(7))
    at = given.ends.copy()
    at[13, 0] += [1e-3, 0, 0]
    at[13, 1] += [0, 0.5e-3, 0]
    both = replace(given, ends=at)
    one = replace(given, ends=np.stack([at[:, 0], given.ends[:, 1]], axis=1))
    here = [12, 14, 15]
    X = np.stack([np.ones(24), given.force], axis=1)
    course = np.linalg.lstsq(X[here], at[here, 0], rcond=None)[0]

    end, off = module._end(one, 13)

    assert end == 0
    assert off == pytest.approx(np.linalg.norm(at[13, 0] - X[13] @ course), rel=1e-9)
    assert module._end(both, 13) is None
    assert (
        module._end(replace(one, force=np.where(np.arange(24) == 15, np.nan, one.force)), 13)
        is None
    )


def test_two_alike_bad_pulls_are_not_told_apart_from_the_chain():
    """Two of eight pulls longer by the same: neither contradicts the others sufficiently."""
    given = ends(np.random.default_rng(9), poses=2)
    assert module._distance(longer(given, 2, 1.5e-3)).pull == 2
    assert module._distance(longer(longer(given, 2, 1.5e-3), 5, 1.5e-3)) is None


@pytest.mark.parametrize("pull", [13, 18])
def test_a_pull_far_off_by_its_direction_is_told_before_one_hardly_off_by_its_distance(
    pull, monkeypatch
):
    """One end 10 mm off across the chain; along it the same or another end by 0.6 mm."""
    given = longer(across(ends(np.random.default_rng(5)), 13, 1e-2), pull, 6e-4)
    monkeypatch.setattr(module, "_read", lambda *_: given)

    (found,) = chain_outlier(case())

    assert given.group[13] in found.where
    assert found.axes == (3 if pull == 13 else 2)
    near = module._distance(given)
    assert (near.pull, near.axes) == (pull, 1)
    assert found.before > 2 * near.sigmas


def test_what_a_direction_adds_to_a_distance_is_counted_with_its_axes():
    """Root sum of squares: neither alone would give this size."""
    given = longer(across(ends(np.random.default_rng(5)), 13, 5e-4), 13, 4e-4)
    near = module._distance(given)

    both, told = module._with_direction(given, near, ("Pl1", "Pl2"))

    laws = [module._turns(given, np.arange(24), course)[3][13] for course in _courses(given)]
    assert both.axes == 3
    assert both.sigmas == pytest.approx(np.sqrt(near.sigmas**2 + min(laws) ** 2))
    assert both.p_value == near.p_value
    assert "Pl1 and Pl2 are" in told
    assert re.search(r"deviates by 0\.\d+ ± 0\.\d+ mrad from that of the other pulls", told)
    alone = replace(given, force=np.full(24, np.nan))
    assert module._with_direction(alone, near, ("Pl1", "Pl2"))[0] == near


def _courses(given):
    return given.force, 1 / given.force


def test_of_two_bad_pulls_the_worse_is_named_first():
    """Distance before direction, the larger before the smaller, the other after its removal."""
    given = read(np.random.default_rng(10))
    rows = given.readings.set_index(["group", "target"])[XYZ]
    for group, off in (("pose04_rep2_loaded", 2e-3), ("pose07_rep3_loaded", 1e-3)):
        at = [rows.loc[(group, name)].to_numpy(float) for name in ("Pl1", "Pl2")]
        given = spoiled(given, group, "Pl2", off * _unit(at[1] - at[0]))

    (first,) = chain_outlier(given)
    (second,) = chain_outlier(first.correct(given))

    assert first.where == "pose04_rep2_loaded/Pl2"
    assert second.where == "pose07_rep3_loaded/Pl2"
    assert chain_outlier(second.correct(first.correct(given))) == []
    few = given.readings["pose"] < 3
    assert chain_outlier(replace(given, readings=given.readings[few])) == []


def test_the_law_that_accuses_a_pull_less_is_believed(monkeypatch):
    """One pull is unlikely by one law only, another by both: the first is not reported."""
    given = ends(np.random.default_rng(5))
    by_force, by_sag = (np.full((4, 24), 0.5), np.full((4, 24), 0.5))
    by_force[:, 3], by_sag[:, 3] = (1e-12, 9, 2e-3, 12), (0.2, 9, 2e-3, 12)
    by_force[:, 8], by_sag[:, 8] = (1e-8, 7, 1e-3, 8), (1e-7, 6, 3e-3, 9)
    laws = [by_force, by_sag]
    monkeypatch.setattr(module, "_turns", lambda _, pulls, course: tuple(laws[int(course[0] < 1)]))

    found = module._direction(given)

    assert (found.pull, found.sigmas, found.size) == (8, 8, 1e-3)
    assert found.p_value == pytest.approx(24e-7)
    by_sag[1, 8] = 4.9  # within its own pose it hardly deviates by one of them
    assert module._direction(given) is None


@pytest.mark.sampled(2)
@pytest.mark.parametrize("off", [0.2, 2.0])
@pytest.mark.parametrize("end", ["Pl1", "Pl2"])
def test_an_end_that_no_chain_reaches_is_named_whatever_the_scale_says(end, off):
    """Metres, or the position of the tracker.

    A chain hung 5 cm longer in each pose is not accused.
    """
    rng = np.random.default_rng(8)
    good = read(rng, hung_m=0.05, stretch_m=2e-3)
    rows = good.readings.copy()
    hit = (rows["group"] == "pose04_rep2_loaded") & (rows["target"] == end)
    rows.loc[hit, XYZ] = rows.loc[hit, XYZ].to_numpy(float) + off * np.array([0.6, -0.64, 0.48])

    (found,) = chain_gross(replace(good, readings=rows))

    assert found.where == f"pose04_rep2_loaded/{end}"
    assert found.size == pytest.approx(off, rel=0.01)
    assert chain_gross(good) == []
    assert chain_gross(found.correct(replace(good, readings=rows))) == []


def test_a_near_anchor_is_no_mistake_of_the_pulls_towards_it():
    """Of six anchors, five are 2.5 m away and one 1.5 m; each is pulled to in three poses."""
    rng = np.random.default_rng(6)
    case = read(rng, poses=6, steps=STEPS[:3])
    rows = case.readings.copy()
    u = np.array([_unit(one) for one in rng.standard_normal((6, 3))])
    anchors = [8.0, 0, 0] + np.array([1.5, *[2.5] * 5])[:, None] * u
    for (pose, k), here in rows.groupby(["pose", "repeat"]):
        which = (pose + k) % 6
        at = [8.0, 0, 0] + 0.02 * rng.standard_normal(3) + 0.15 * u[which]
        for name, place in (("Pl1", at), ("Pl2", anchors[which])):
            rows.loc[here.index[here["target"] == name], XYZ] = place

    assert chain_gross(replace(case, readings=rows)) == []
    assert chain_outlier(replace(case, readings=rows)) == []


def test_both_ends_of_a_pull_are_named_where_both_are_far_off():
    """The pull is removed once, and both readings are named."""
    case = read(np.random.default_rng(10))
    rows = case.readings.copy()
    here = rows["group"] == "pose05_rep1_loaded"
    for end, off in (("Pl1", [1.0, 0, 0]), ("Pl2", [0, 0.4, 0])):
        hit = here & (rows["target"] == end)
        rows.loc[hit, XYZ] = rows.loc[hit, XYZ].to_numpy(float) + off

    found = chain_gross(replace(case, readings=rows))

    assert [one.where.split("/")[1] for one in found] == ["Pl1", "Pl2"]
    assert [one.size for one in found] == pytest.approx([1.0, 0.4], abs=0.01)


def test_two_ends_of_one_pose_are_named_and_the_other_pulls_stay():
    """The position of the tracker is read twice; one after the other, and nothing else."""
    case = read(np.random.default_rng(9))
    rows = case.readings.copy()
    groups = ["pose04_rep2_loaded", "pose04_rep3_loaded"]
    rows.loc[rows["group"].isin(groups) & (rows["target"] == "Pl2"), XYZ] = 0.0
    wrong, named = replace(case, readings=rows), []
    while found := chain_gross(wrong):
        named += [found[0].where.split("/")[0]]
        wrong = found[0].correct(wrong)

    assert sorted(named) == groups
