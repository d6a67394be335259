"""DH parameters from unloaded reflectors: against dense conditioning of normal vectors.

The chain of the KR500 is multiplied here; covariances are those of all readings together.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from rail_chain import LETTERS, POINTS, stands
from scipy import special

from pipeline.geometry.roughness import (
    SuspectUnknowns,
    cells,
    left_out,
    products,
    same,
    straight,
    unrefined,
)
from pipeline.geometry.unloaded import FIXED_STD, Unloaded, off, unloaded
from pipeline.machine.cell import Tool
from pipeline.machine.effect import Pulls
from pipeline.machine.effects.gravity_sag import effects as gravity_sag
from pipeline.machine.robot import load
from pipeline.reduction.idle import Idle
from pipeline.reduction.measured import Measured
from pipeline.reduction.settings import Scale

KR500 = load("kr500_rail")
SAG = next(facet for facet in gravity_sag(KR500)[0].facets if hasattr(facet, "geometry"))
TOOL = Tool(np.array([0.15, 0.0, 0.25]), np.array(["P1", "P2", "P3"], object), POINTS)
POSES = 11
TURN = np.diag([2e-5, 3e-5, 1e-5]) @ np.array([[1, 0.4, 0], [0, 1, -0.3], [0, 0, 1.0]])


@cache
def poses():
    """Joint values of the log, shape (p, 7)."""
    return np.random.default_rng(3).uniform(KR500.lower, KR500.upper, (POSES, 7))


@cache
def noise():
    """Covariances of the readings with arbitrary axes, shape (3 p, 3, 3) [m^2]."""
    half = np.random.default_rng(4).standard_normal((3 * POSES, 3, 3)) + 2 * np.eye(3)
    return 4e-10 * half @ half.swapaxes(1, 2)


def read(seed, wrong=None, joints=0.0):
    """The measurements of a robot with some entries off; tool, place and turn are off, too.

    Args:
        seed: Of all draws.
        wrong: Entries that are off.
        joints: Error of each joint at each pose [rad], and half as much on the rail [m].
    """
    rng = np.random.default_rng(seed)
    size = joints * np.array([0.5, 1, 1, 1, 1, 1, 1])
    points = POINTS + 2e-4 * rng.standard_normal((3, 3))
    at = stands(poses() + size * rng.standard_normal((POSES, 7)), wrong, points).reshape(-1, 3)
    at = at + np.cross(TURN @ rng.standard_normal(3), at) + rng.standard_normal(3)
    at = at + (np.linalg.cholesky(noise()) @ rng.standard_normal((3 * POSES, 3, 1)))[..., 0]
    none, d = np.zeros(POSES), 3 * POSES
    q = poses()
    pulls = Pulls(np.arange(POSES) + 4, none.astype(int), q, np.ones((POSES, 3)), *[none] * 4)
    return Measured(
        pulls=pulls, pull=np.repeat(np.arange(POSES), 3), target=np.tile(np.arange(3), POSES),
        name=np.tile(TOOL.targets, POSES), delta=np.zeros((d, 3)), unloaded=at,
        loaded_cov=noise(), zero_cov=noise(), zero=np.arange(d), reading_std=none + 1,
        direction_cov=np.zeros((POSES, 3, 3)), rotation_cov=TURN @ TURN.T, scale=Scale(),
        noise_stated=True, joint_std=np.zeros(7),
    )  # fmt: skip


def of(data, sag=None, scale=1.0):
    return unloaded(KR500, TOOL, sag, data, scale)


def estimated(zeros, free=()):
    """Estimate about the nominal table."""
    rows = zeros.about(np.zeros(zeros.columns.count))
    return cells(zeros, products(rows), free), rows


def coarse(zeros, free=()):
    """The same before the grid is refined."""
    rows = zeros.about(np.zeros(zeros.columns.count))
    return unrefined(zeros, products(rows), free)


def by_hand(data, rough, transmission, pose=None):
    """Estimates of all entries by conditioning one long normal vector on what was read.

    Args:
        data: The measurements.
        rough: Roughness of lengths [m] and of angles [rad].
        transmission: Error of the joints over 0.1 mrad and 0.05 mm.
        pose: One that is left out, and predicted.

    Returns:
        The entries, their covariance, log likelihood; or what the pose is missed by.
    """
    here, e = stands(poses()).reshape(-1), 1e-6
    columns = [np.tile(axis, 3 * POSES) for axis in np.eye(3)]
    std = [10.0] * 3
    turned = np.stack([np.cross(axis, here.reshape(-1, 3)).ravel() for axis in np.eye(3)], 1)
    root = np.linalg.cholesky(data.rotation_cov)
    columns += list((turned @ root).T)
    std += [1.0] * 3
    for k in range(9):
        points = POINTS + e * np.eye(9)[k].reshape(3, 3)
        columns.append((stands(poses(), None, points).ravel() - here) / e)
    std += [5e-3] * 9
    columns += list(turned.T)  # how the rail lies in F_b is an angle of the table
    std += [rough[1]] * 3
    for letter in LETTERS:
        ahead, behind = (stands(poses(), {letter.label: s * e}).ravel() for s in (1, -1))
        columns.append((ahead - behind) / (2 * e))
        std.append(rough[int(letter.turns)])
    X, P = np.array(columns).T, np.diag(np.square(std))
    V = np.zeros((9 * POSES, 9 * POSES))
    for i, C in enumerate(noise()):
        V[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = C
    for j in range(7):
        size = transmission * (5e-5 if j == 0 else 1e-4)
        for i in range(POSES):
            q = poses()[i : i + 1]
            z = np.zeros(9 * POSES)
            turn = e * np.eye(7)[j]
            z[9 * i : 9 * i + 9] = ((stands(q + turn) - stands(q - turn)) / (2 * e)).ravel()
            V += size**2 * np.outer(z, z)
    y = data.unloaded - here.reshape(-1, 3)
    y = (y - y.mean(axis=0)).ravel()  # where F_b is costs digits
    if pose is not None:
        out = np.repeat(np.arange(POSES) == pose, 9)
        prior = X @ P @ X.T
        gain = prior[np.ix_(out, ~out)] @ np.linalg.inv((prior + V)[np.ix_(~out, ~out)])
        return (y[out] - gain @ y[~out]).reshape(-1, 3)
    total = V + X @ P @ X.T
    inverse = np.linalg.inv(total)
    x, cov = P @ X.T @ inverse @ y, P - P @ X.T @ inverse @ X @ P
    log = -0.5 * (y @ inverse @ y + np.linalg.slogdet(total)[1])
    return x[18:], cov[18:, 18:], log


def cell_of(found, rough_mm, rough_mrad, transmission):
    """Index of a cell of the grid."""
    rough = np.isclose(found.rough, [1e-3 * rough_mm, 1e-3 * rough_mrad]).all(axis=1)
    (at,) = np.flatnonzero(rough & np.isclose(found.transmission, transmission))
    return int(at)


ROUGH = {"link_length:4": 3e-4, "link_twist:5": -2e-4, "joint_offset:3": 4e-4}


@pytest.mark.parametrize("scales", [(0.1, 0.1, 1.0), (1.0, 0.01, 0.1)])
def test_estimates_and_likelihoods_are_those_of_one_long_normal_vector(scales):
    """For some sizes of roughness and of joint errors."""
    data = read(5, ROUGH, joints=1e-4)
    zeros = of(data)
    found = coarse(zeros)
    k = cell_of(found, *scales)
    length, angle, transmission = scales
    x, cov, log = by_hand(data, (1e-3 * length, 1e-3 * angle), transmission)
    _, _, other = by_hand(data, (1e-4, 1e-3), 0.1)
    where = zeros.columns.table

    std = np.sqrt(np.diag(cov))  # the differences by hand are accurate to four digits
    assert (found.x[k, where] - x) / std == pytest.approx(np.zeros(len(x)), abs=1e-3)
    assert found.cov[k, where, where] / np.outer(std, std) == pytest.approx(
        cov / np.outer(std, std), abs=1e-3
    )
    apart = found.log[k] - found.log[cell_of(found, 0.1, 1.0, 0.1)]
    assert apart == pytest.approx(log - other, abs=0.05, rel=1e-3)


def test_a_suspect_that_is_freed_is_one_of_a_wide_prior():
    """The likelihood derived from the covariance is that of a separate solution, either way."""
    zeros = of(read(6, {"link_length:4": 4e-3}, joints=1e-4), SAG)
    found = coarse(zeros)
    where = zeros.columns
    k = where.table.start + [letter.label for letter in LETTERS].index("link_length:4")
    for columns, wide in (
        ((k,), 0.1),
        (tuple(range(where.loose.start, where.loose.stop)), 0.1),
        (tuple(range(where.masses.start, where.masses.stop)), 10.0),
    ):
        one = SuspectUnknowns("it", columns, wide)
        again = coarse(zeros, (one,))
        at = found.std[:, list(columns)]
        assert found.with_std(one, wide) == pytest.approx(again.log, rel=1e-5, abs=1e-2)
        assert again.with_std(one, at) == pytest.approx(found.log, rel=1e-5, abs=1e-2)


def test_unknowns_of_one_suspect_share_one_size():
    """Its evidence is the mean over sizes that are equally likely in their logarithm, 0.1 to 100.

    Planted bug: a prior of 100 mrad for each of three turns costs them ten e-folds more.
    """
    zeros = of(read(6, {"link_length:4": 4e-3}, joints=1e-4), SAG)
    found, where = coarse(zeros), zeros.columns.loose
    sizes = np.geomspace(1e-4, 0.1, 13)
    one = SuspectUnknowns("it", tuple(range(where.start, where.stop)), sizes[-1])
    each = [coarse(zeros, (replace(one, wide=size),)) for size in sizes]
    logs = np.array([special.logsumexp(grid.log + grid.width) for grid in each])

    mean = special.logsumexp(logs) - np.log(len(sizes))
    assert found.evidence(one) == pytest.approx(mean, abs=0.5)
    assert each[-1].log_evidence == pytest.approx(mean, abs=0.5)
    assert found.evidence(replace(one, tries=20)) == pytest.approx(mean - np.log(20), abs=0.5)


def test_a_pose_that_is_left_out_is_predicted_by_the_others():
    """All nine rows of it at once, with unknown errors of its joints."""
    data = read(7, ROUGH, joints=1e-4)
    found, rows = estimated(of(data))
    cell = found.best
    missed = left_out(found, rows).reshape(POSES, 3, 3)
    for pose in (0, 6):
        alone = by_hand(data, found.rough[cell], found.transmission[cell], pose)
        assert missed[pose] == pytest.approx(alone, abs=2e-7 + 1e-3 * np.abs(alone).max())


@pytest.mark.parametrize(("label", "size"), [("link_length:4", 0.05), ("link_twist:3", 5e-3)])
def test_without_noise_the_entry_comes_back(label, size):
    """To 1e-9, linearised at the robot's true geometry: no second-order error."""
    data = read(8)
    at = stands(poses(), {label: size}).reshape(-1, 3)
    zeros = of(replace(data, unloaded=at))
    k = zeros.columns.table.start + [letter.label for letter in LETTERS].index(label)
    std = np.full(zeros.columns.count, FIXED_STD)
    std[[0, 1, 2, k]] = 10.0
    x = np.zeros(zeros.columns.count)
    for _ in range(4):
        rows = zeros.about(x)
        X, y = rows.D.reshape(-1, len(x)), rows.y.ravel()
        used = [0, 1, 2, k]
        x = np.zeros(len(x))
        x[used] = np.linalg.lstsq(X[:, used], y, rcond=None)[0]

    assert x[k] == pytest.approx(size, abs=1e-9)
    assert off(zeros, x) < 1e-12


def test_offsets_along_parallel_axes_are_one():
    """Axes 3 and 4 of the KR500 are parallel: an error of either offset has the same effect."""
    zeros = of(read(9))
    _, rows = estimated(zeros)
    sums = products(rows)
    start = zeros.columns.table.start
    at = {x.label: SuspectUnknowns(x.label, (start + k,), 0.1) for k, x in enumerate(zeros.letters)}

    assert same(zeros, sums, at["link_offset:3"], at["link_offset:4"])
    assert not same(zeros, sums, at["link_offset:3"], at["link_offset:5"])
    assert not same(zeros, sums, at["link_length:3"], at["link_length:4"])
    # what only defines F_b or the tool is a twin of nothing
    assert not same(zeros, sums, at["link_length:4"], at["link_offset:2"])
    assert not same(zeros, sums, at["link_offset:2"], at["joint_offset:7"])


@pytest.mark.slow
def test_estimates_scatter_as_stated():
    """DH errors of 0.3 mm and mrad throughout, joint errors: thirty robots, every parameter."""
    rng, pulls = np.random.default_rng(10), []
    for seed in range(30):
        wrong = {letter.label: 3e-4 * float(rng.standard_normal()) for letter in LETTERS}
        zeros = of(read(seed, wrong, joints=1e-4))
        found, _ = estimated(zeros)
        where = zeros.columns.table
        off_by = found.mean[where] - np.array(list(wrong.values()))
        pulls.append(off_by / np.sqrt(np.diag(found.covariance)[where]))
    assert np.std(pulls) == pytest.approx(1.0, abs=0.1)
    assert np.mean(np.abs(pulls) < 1.96) == pytest.approx(0.95, abs=0.03)


def test_the_table_as_it_is_has_its_own_estimate():
    """Only position, stated rotation and tool: the effect of a wrong length remains."""
    zeros = of(read(11, {"link_length:4": 0.02}))
    rows = zeros.about(np.zeros(zeros.columns.count))
    plain = straight(zeros, products(rows))

    assert (
        not plain.mean[zeros.columns.table].any()
        or np.abs(plain.mean[zeros.columns.table]).max() < 1e-6
    )
    assert off(zeros, plain.mean) > 5e-3


def test_positions_that_are_not_known_are_left_out():
    """An unknown zero is one row less; with three poses there is no estimate."""
    data = read(2)
    lost = data.unloaded.copy()
    lost[4, 1] = np.nan
    fewer = of(replace(data, unloaded=lost))
    assert isinstance(fewer, Unloaded)
    assert len(fewer.at) == 3 * POSES - 1
    found, _ = estimated(fewer)
    assert np.isfinite(found.mean).all()

    for some, there in ((4, True), (3, False)):
        few = np.where((np.arange(3 * POSES) < 3 * some)[:, None], data.unloaded, np.nan)
        assert (of(replace(data, unloaded=few)) is not None) is there
    assert of(data, scale=np.inf) is None


def test_a_stated_zero_is_rough_by_what_is_stated():
    """Only joint zeros, and only those stated."""
    data = replace(read(2), joint_std=np.array([0, 2e-3, 0, 0, 0, 0, 0]))
    zeros = of(data)
    stated = {x.label: s for x, s in zip(zeros.letters, zeros.stated, strict=True) if s}

    assert stated == {"joint_offset:2": 2e-3}
    usual = dict(zip([x.label for x in zeros.letters], zeros.usual(), strict=True))
    assert usual["joint_offset:2"] == pytest.approx(np.hypot(2e-3, 2e-4))
    assert usual["link_length:4"] == pytest.approx(2e-4)


def test_no_reading_repeats_better_than_the_air_lets_it():
    """As stated times the scatter squared, or a micrometre rms where that is more."""
    data = read(2)
    fine = replace(data, zero_cov=1e-6 * noise())

    np.testing.assert_allclose(of(data, scale=2.0).cov, 4 * noise())
    found = of(fine).cov
    assert np.einsum("zii->z", found).mean() / 3 == pytest.approx(1e-12, rel=1e-9, abs=0.0)
    np.testing.assert_allclose(found / found[0, 0, 0], noise() / noise()[0, 0, 0])


def without_pulls(data, poses):
    """The same measurements without the pulls of some poses."""
    gone = np.isin(data.pulls.pose[data.pull], poses)
    mine, kept = data.pull[gone], np.flatnonzero(~np.isin(data.pulls.pose, poses))
    idle = Idle(data.pulls.part(mine), data.target[gone], data.unloaded[gone], data.zero_cov[gone])
    of_row = np.searchsorted(kept, data.pull[~gone])
    rows = ("target", "name", "delta", "unloaded", "loaded_cov", "zero_cov")
    return replace(
        data, idle=idle, pull=of_row, pulls=data.pulls.part(kept),
        reading_std=data.reading_std[kept], direction_cov=data.direction_cov[kept],
        zero=np.unique(data.zero[~gone], return_inverse=True)[1],
        **{name: getattr(data, name)[~gone] for name in rows},
    )  # fmt: skip


def test_a_pose_tells_the_table_whether_something_was_pulled_or_not():
    """Estimates and covariance are equal; without these poses they are not."""
    data = read(12, {"link_length:4": 3e-3}, joints=1e-4)
    some = without_pulls(data, [5, 9, 14])
    all_of_them, same_ones, fewer = (
        estimated(of(one))[0] for one in (data, some, replace(some, idle=None))
    )

    np.testing.assert_allclose(same_ones.mean, all_of_them.mean, atol=1e-12)
    np.testing.assert_allclose(same_ones.covariance, all_of_them.covariance, atol=1e-14)
    assert np.abs(fewer.mean - all_of_them.mean).max() > 1e-5


@pytest.mark.parametrize(("off_m", "left"), [(0.0, []), (2e-3, [9]), (5.0, [9])])
def test_a_pose_without_pull_whose_reflectors_kept_no_distance_is_left_out(off_m, left):
    data = without_pulls(read(13), [5, 9, 14])
    at = data.idle.at.copy()
    (spoilt,) = np.flatnonzero((data.idle.pulls.pose == 9) & (data.idle.target == 1))
    at[spoilt] += off_m * np.array([0.5, 0.7, -0.5])

    zeros = of(replace(data, idle=replace(data.idle, at=at)))

    assert zeros.misshapen.tolist() == left
    assert zeros.poses == POSES - len(left)


@pytest.mark.slow
def test_sound_poses_without_pull_are_rarely_left_out():
    """300 poses in 100 campaigns; one campaign in a thousand loses a pose by chance."""
    assert sum(len(of(without_pulls(read(s), [5, 9, 14])).misshapen) for s in range(100)) <= 1
