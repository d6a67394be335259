"""What is found of the noise, by distributions and matrices of scipy and numpy."""

from dataclasses import replace
from types import SimpleNamespace as Some

import numpy as np
import pandas as pd
import pytest
from made_system import dense, made
from scipy import stats
from scipy.sparse import csr_array

from pipeline.base import linear
from pipeline.machine.cell import Tool, paper_cell, predict
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import configure, load
from pipeline.reduction.measured import Measured
from pipeline.reduction.register import XYZ
from pipeline.reduction.settings import Scale
from pipeline.system import assemble, beam, fit, one_pose, outlying, specimen, wander
from pipeline.system.beam import BeamNoise
from pipeline.system.contrasts import Zeros, _in_poses, _turning
from pipeline.system.family import (
    _FAMILIES,
    _GRID,
    BURSTS,
    FAR_OFF,
    FREEDOM,
    SPELLS,
    Family,
    LoosestTarget,
)
from pipeline.system.noise_shape import NoiseShape, _overstated
from pipeline.system.odds import DECIDES
from pipeline.system.spells import States
from pipeline.system.system import Errors, ScatterRatio
from pipeline.system.variance import Components
from pipeline.system.wander import TIMES_S, Wander

RAIL = load("kr500_rail")
POINTS = np.array([[0.25, 0.0, 0.1], [-0.1, 0.15, 0.0], [-0.1, -0.2, 0.05]])
TOOL = Tool(np.array([0.1, 0, 0.3]), np.array(["P1", "P2", "P3"], object), POINTS)
CELL = paper_cell(RAIL, TOOL)
SPRINGS = RAIL.nominal_compliance


def poses(n, rng):
    """Joint values within the limits, on four metres of the rail."""
    low, high = RAIL.lower.copy(), RAIL.upper.copy()
    low[0], high[0] = 2.0, 6.0
    middle, half = (low + high) / 2, (high - low) / 4
    return middle + half * rng.uniform(-1, 1, size=(n, RAIL.n))


def measured(per_pose=(2, 3, 1), seed=5, noise=2e-5, rigid=False, **more):
    """Pulls of poses 3, 8, 9, each by springs, with noise of each target or of the effector."""
    rng = np.random.default_rng(seed)
    number = np.repeat(np.arange(len(per_pose)), per_pose)
    q = poses(len(per_pose), rng)[number]
    m, t = len(number), len(POINTS)
    pulls = Pulls.at(q, rng.normal(size=(m, 3)) * 800)
    nth = np.arange(m) - np.searchsorted(number, number)
    time = 900.0 * number + 90.0 * nth
    pulls = replace(pulls, pose=3 + 5 * number, repeat=nth + 1, time=time)
    delta = predict(CELL, pulls, SPRINGS).displacement
    if rigid:
        s, w = (rng.normal(size=(m, 1, 3)) * noise for _ in range(2))
        here = configure(RAIL, q).points(POINTS)
        delta = delta + s + np.cross(w / 0.2, here - here.mean(axis=1, keepdims=True))
    else:
        delta = delta + noise * rng.normal(size=delta.shape)
    pull, target = np.repeat(np.arange(m), t), np.tile(np.arange(t), m)
    C = noise**2 * np.eye(3)
    fields = {
        "pulls": pulls, "pull": pull, "target": target, "name": TOOL.targets[target],
        "delta": delta.reshape(-1, 3), "unloaded": configure(RAIL, q).points(POINTS).reshape(-1, 3),
        "loaded_cov": np.tile(C, (m * t, 1, 1)), "zero_cov": np.tile(C / 2, (m * t, 1, 1)),
        "zero": number[pull] * t + target, "reading_std": np.full(m, 2.0),
        "direction_cov": np.zeros((m, 3, 3)), "rotation_cov": np.zeros((3, 3)),
        "scale": Scale(), "noise_stated": True, "joint_std": np.zeros(RAIL.n),
        "zero_times": np.array([[-60.0, 700.0], [850.0, np.nan], [1790.0, 2000.0]])[number],
    }  # fmt: skip
    return Measured(**(fields | more))


# --- tails ----------------------------------------------------------------------------------------


def certain(k, **more):
    """One family without doubt, its core as stated."""
    return replace(Family.stated(), weight=np.eye(_FAMILIES)[k], **more)


def test_the_chance_of_a_distance_is_that_of_its_distribution():
    """Normal: chi-square; Student's: F; bursts: a mixture; each where the others know all."""
    d, known = 4.0, np.zeros((5, 3))
    keys = np.column_stack([np.arange(5), np.zeros(5, int)])
    (normal,) = certain(0).away(d, known, keys)
    assert normal == pytest.approx(stats.chi2.sf(d**2, 3), rel=0.3)
    for k, nu in enumerate(FREEDOM, 1):
        (told,) = certain(k).away(d, known, keys)
        assert told == pytest.approx(stats.f.sf(d**2 / 3, 3, nu), rel=0.05)
    for k, (part, width) in enumerate(BURSTS, 1 + len(FREEDOM)):
        (told,) = certain(k).away(d, known, keys)
        sides = stats.chi2.sf(d**2 / np.array([1.0, width**2]), 3)
        assert told == pytest.approx(sides @ [1 - part, part], rel=0.1)


def test_what_the_others_leave_open_makes_a_distance_likelier():
    """By the axis that is known worst; in a spell the others are as wide."""
    keys, d = np.array([[7, 1], [8, 1]]), 5.0
    others = np.array([[2.0, 0.5, 0.0], [0.3, 0.1, 0.2]])
    step = np.exp(_GRID[np.abs(_GRID).argmin()])  # the grid has no lambda of exactly 1
    (told,) = certain(0).away(d, others, keys)
    widest = np.array([max((step + 2) / 2, step + 0.5, step), step + 0.3])
    assert told == pytest.approx(stats.chi2.sf(d**2 / widest, 3).mean(), rel=0.1)
    states = States.each(keys)
    for k, (_, width) in enumerate(SPELLS, _FAMILIES - len(SPELLS)):
        noisy = np.zeros((_FAMILIES, 2))
        noisy[k] = [0.25, 1.0]
        (told,) = certain(k, states=states, noisy=noisy).away(d, others, keys)
        own = stats.chi2.sf(d**2 / widest, 3)
        wide = width**2 * np.array([max(1.5, 1.5, 1.0), 1.3])
        spell = stats.chi2.sf(d**2 / wide, 3)
        expected = np.mean([0.75 * own[0] + 0.25 * spell[0], spell[1]])
        assert told == pytest.approx(expected, rel=0.1)
    assert len(replace(certain(0), weight=np.full(_FAMILIES, 0.02)).away(d, others, keys)) == (
        _FAMILIES
    )


@pytest.mark.parametrize("k", range(_FAMILIES))
def test_a_family_is_heavy_unless_it_is_the_stated_one(k):
    """Its freedom is that of the likeliest Student distribution; spells are the last ones."""
    one = certain(k)
    assert one.heavy == (0.0 if k == 0 else 1.0)
    assert one.likely_heavy == (k > 0)
    assert one.in_spells == (k >= _FAMILIES - len(SPELLS))
    assert one.rather.weight.tolist() == one.weight.tolist()
    weight = 0.6 * np.eye(_FAMILIES)[0] + 0.4 * np.eye(_FAMILIES)[k]
    assert replace(one, weight=weight).rather.weight.tolist() == np.eye(_FAMILIES)[0].tolist()
    if 0 < k <= len(FREEDOM):
        assert one.freedom == FREEDOM[k - 1]


def test_far_readings_are_as_likely_as_a_binomial_says():
    """The largest over the families; none needs no chance."""
    chances = np.array([1e-3, 2e-2])
    for k, n in ((1, 50), (3, 50), (4, 4)):
        assert outlying._chance(k, n, chances) == pytest.approx(stats.binom.sf(k - 1, n, 2e-2))
    assert outlying._chance(0, 50, chances) == 1.0
    nothing = outlying.OutlyingReadings.none()
    assert (nothing.count, nothing.p_value, nothing.base) == (0, 1.0, 0)
    some = outlying.OutlyingReadings(np.array([1, 1, 2]), np.array([0, 1, 0]), 0.1, 2)
    assert some.count == 5


# --- shape of the noise ---------------------------------------------------------------------------

DATA = measured()
UNSEEN = NoiseShape.unseen(DATA)


def test_the_stated_noise_is_no_finding():
    """All readings alike: as many as displacements and zeros."""
    zeros = len(np.unique(DATA.zero))
    assert UNSEEN.variance.tolist() == [1.0] * (len(DATA.pull) + zeros)
    assert [UNSEEN.likely, UNSEEN.tailed, UNSEEN.wanders, UNSEEN.weighed] == [False] * 4
    assert UNSEEN.loosest is None
    assert UNSEEN.wide_m == pytest.approx(2e-5)
    assert not UNSEEN.differs(UNSEEN)
    assert not replace(UNSEEN, family=Family.stated(True)).likely
    np.testing.assert_array_equal(UNSEEN.on(DATA).loaded_cov, DATA.loaded_cov)


def test_a_finding_is_applied_likely_and_significant():
    """Each of the three is needed, for tails, a loose target and a wander alike."""
    heavy, less, more = certain(2), {"p_value": 1e-2}, {"p_value": 1e-9}
    for chance, weighed in ((less, True), (more, False), (more, True)):
        sure = chance is more and weighed
        one = replace(UNSEEN, family=replace(heavy, **chance), weighed=weighed)
        assert (one.tailed, one.likely) == (sure, True)
        for probability in (0.4, 0.6):
            loose = LoosestTarget(1, 3.0, probability, chance["p_value"])
            slow = replace(UNSEEN.wander, probability=probability, **chance)
            own = replace(Family.stated(), loosest=loose)
            both = replace(UNSEEN, family=own, wander=slow, weighed=weighed)
            assert both.wanders == (sure and probability > 0.5)
            assert (both.loosest is loose) == (sure and probability > 0.5)
            assert both.likely == (probability > 0.5)


def test_the_scatter_has_tails_and_wander_in_it():
    """A reading counts up to the limit of those far off; the wander by its square."""
    variance = np.full(len(UNSEEN.variance), 4.0)
    assert replace(UNSEEN, variance=variance).wide_m == pytest.approx(4e-5)
    slow = replace(UNSEEN.wander, size=3e-5)
    assert replace(UNSEEN, variance=variance, wander=slow).wide_m == pytest.approx(5e-5)
    one = np.where(np.arange(len(variance)) == 0, 1e9, 0.0)
    expected = 2e-5 * np.sqrt(FAR_OFF**2 / 3 / len(variance))
    assert replace(UNSEEN, variance=one).wide_m == pytest.approx(expected)


def test_a_shape_differs_by_what_it_does_to_variances():
    """Those of readings, of the beam and of the wander; a tenth is nothing."""
    n, d = len(UNSEEN.variance), len(DATA.pull)
    for change, differs in ((0.08, False), (0.12, True), (-0.12, True)):
        other = replace(UNSEEN, variance=np.full(n, np.exp(change)))
        assert UNSEEN.differs(other) == other.differs(UNSEEN) == differs
        parts = BeamNoise(1.0, np.full(d, np.exp(change / 2)))
        assert UNSEEN.differs(replace(UNSEEN, beam=parts)) == differs
        if change > 0:  # F F' of this mean variance per axis
            factor = np.zeros((d, 3, 2))
            factor[:, :, 1] = UNSEEN.wander.unit * np.sqrt(change)
            slow = replace(UNSEEN.wander, factor=factor)
            assert UNSEEN.differs(replace(UNSEEN, wander=slow)) == differs
    half = np.where(np.arange(n) < n / 2, np.exp(0.12), 1.0)
    assert not UNSEEN.differs(replace(UNSEEN, variance=half))  # 0.085 rms


@pytest.mark.parametrize("dof", [30, 400])
def test_noise_is_overstated_where_its_likelihood_is_certainly_better(dof):
    """Twice the gain in log likelihood by the residual variance, against the odds that decide."""
    for less in (0.2, 0.5, 0.7, 0.9, 0.99, 1.1):
        rest = less * dof
        drop = stats.norm.logpdf(np.sqrt(less), scale=np.sqrt([less, 1.0])) @ [
            2.0 * dof,
            -2.0 * dof,
        ]
        sure = less < 1 and drop > DECIDES
        found = _overstated(Some(base=Some(dof=dof, rest=rest)))
        assert found == pytest.approx(less if sure else 1.0)


# --- beam and wander ------------------------------------------------------------------------------


def test_parts_of_the_beam_are_put_on_and_taken_off():
    """C u = a^2 s^2 u along the beam and b^2 s^2 across it; the stated ones come back."""
    data = replace(DATA, tracker=np.array([4.0, -3.0, 1.0]))
    across = np.linspace(1.5, 2.5, len(data.pull))
    parts = BeamNoise(0.5, across)
    got = parts.on(data)
    u = data.unloaded - data.tracker
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(u, [0.3, 0.5, 0.8])
    along = np.einsum("di,dij->dj", u, got.loaded_cov)
    np.testing.assert_allclose(along, 0.25 * 4e-10 * u, atol=1e-18)
    np.testing.assert_allclose(
        np.einsum("dij,dj->di", got.zero_cov, v), across[:, None] ** 2 * 2e-10 * v, atol=1e-18
    )
    np.testing.assert_allclose(parts.off(got).loaded_cov, data.loaded_cov, atol=1e-20)
    assert parts.widest == pytest.approx(6.25)
    assert BeamNoise(3.0, across).widest == pytest.approx(9.0)
    assert BeamNoise(0.5, across / 4).widest == 1.0
    other = BeamNoise(0.55, across)
    assert parts.change(other) == pytest.approx(2 * np.log(1.1))
    wider = BeamNoise(0.55, across * np.where(across == across[3], 1.3, 1.0))
    for changed in (wider.change(parts), parts.change(wider)):
        assert changed == pytest.approx(2 * np.log(1.3))
    assert parts.change(parts) == 0.0


def test_prior_odds_of_the_beam_are_those_stated():
    """The density over all ratios and exponents integrates to the odds of another proportion."""
    t = np.linspace(np.log(beam._LEAST), np.log(beam._MOST), 200_001)
    density = np.exp(beam._log_prior(np.exp(t)))
    whole = len(beam._GROWTH) * np.trapezoid(density, t)
    assert whole == pytest.approx((1 - beam._AS_STATED) / beam._AS_STATED, rel=1e-4)
    better = len(beam._GROWTH) * np.trapezoid(np.where(t < 0, density, 0.0), t)
    assert better / whole == pytest.approx(beam._BETTER, rel=1e-4)


def test_a_wander_is_the_covariance_of_displacements_from_their_zeros():
    """K by its definition, pose by pose and pair by pair; none where a time is missing."""
    for time_s in (60.0, 1200.0):
        F, mean = wander.kernel(DATA, time_s)
        K = np.zeros((6, 6))
        for i in range(6):
            for j in range(6):
                if DATA.pulls.pose[i] == DATA.pulls.pose[j]:
                    z = DATA.zero_times[i][np.isfinite(DATA.zero_times[i])]
                    a, b = (np.append(DATA.pulls.time[k], z) for k in (i, j))
                    w = np.append(1.0, np.full(len(z), -1 / len(z)))
                    K[i, j] = w @ np.exp(-np.abs(a[:, None] - b) / time_s) @ w
        assert mean == pytest.approx(np.trace(K) / 6)
        same = DATA.pulls.pose[:, None] == DATA.pulls.pose
        np.testing.assert_allclose(np.where(same, F @ F.T, 0.0), K / mean, atol=1e-12)
    late = DATA.pulls.time.copy()
    late[4] = np.nan
    for less in (
        replace(DATA, pulls=replace(DATA.pulls, time=late)),
        replace(DATA, zero_times=np.where(DATA.zero_times > 1000, np.nan, DATA.zero_times)),
    ):
        F, mean = wander.kernel(less, 60.0)
        assert (np.abs(F).max(), mean) == (0.0, 1.0)


def test_restless_joints_follow_their_torques_and_the_clock():
    """The covariance of two rows is sum_j b_j b_j' rho within a pose, at mean square one."""
    moves = np.random.default_rng(3).normal(size=(3 * len(DATA.pull), 4))
    out = wander.restless(DATA, moves, 120.0).reshape(len(moves), -1)
    time, pose = (np.repeat(one[DATA.pull], 3) for one in (DATA.pulls.time, DATA.pulls.pose))
    rho = np.exp(-np.abs(time[:, None] - time) / 120.0)
    V = (moves @ moves.T) * rho
    same = pose[:, None] == pose
    np.testing.assert_allclose(
        np.where(same, out @ out.T, 0), np.where(same, V, 0) / np.mean(np.diag(V)), atol=1e-10
    )
    late = DATA.pulls.time.copy()
    late[0] = np.nan
    some = wander.restless(replace(DATA, pulls=replace(DATA.pulls, time=late)), moves, 120.0)
    quiet = DATA.pulls.pose[DATA.pull] == DATA.pulls.pose[0]
    assert not some[quiet].any()
    assert some[~quiet].any()


def test_a_wander_of_single_readings_has_its_process():
    """Shift and rotation, each time by itself; what is zero has no columns."""
    process = np.array([[1e-10, 0.0, 4e-10], [0.0, 9e-12, 0.0]])
    slow = replace(Wander.none(DATA), process=process, size=1e-5)
    rng = np.random.default_rng(8)
    times, levers = np.array([0.0, 100.0, 5000.0]), rng.normal(size=(3, 3)) * 5
    F = slow.of_readings(times, levers).reshape(9, -1)
    V = np.zeros((9, 9))
    for i in range(3):
        for j in range(3):
            shift, turn = process @ np.exp(-abs(times[i] - times[j]) / np.array(TIMES_S))
            a, b = (np.cross(np.eye(3), levers[k]) for k in (i, j))  # rows: e x p
            V[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] = shift * np.eye(3) + turn * a.T @ b
    np.testing.assert_allclose(F @ F.T, V, atol=1e-20)
    assert slow.between_poses == pytest.approx(np.sqrt(5e-10))
    assert replace(slow, size=1e-4).between_poses == 1e-4
    none = replace(slow, process=np.zeros((2, 3)))
    assert none.of_readings(times, levers).shape == (3, 3, 0)


# --- common factor, ratios, parts -----------------------------------------------------------------


def joint(low, high=None):
    """An entry of a robot file: a stiffness or a range."""
    return Some(
        stiffness_range=None if high is None else (low, high), typical_stiffness=low,
        stiffness=low if high is None else None,
    )  # fmt: skip


def test_a_common_factor_is_the_posterior_of_a_normal_mean():
    """By integration over the unknown scatter of joints, with its prior as four more of them."""
    off = np.array([0.9, 1.1, 1.0, 1.4, 0.7]) * 3.0
    value = off * np.array([1e6, 2e6, 3e6, 4e6, 5e6])
    joints = [joint(k) for k in (1e6, 2e6, 3e6, 4e6, 5e6)]
    found = specimen.common(value, 1e-9 * value, joints)

    g, s2 = np.linspace(-2, 4, 1501), np.exp(np.linspace(np.log(1e-3), np.log(1e2), 300))
    y = np.log(off)
    square = np.sum((y[:, None] - g) ** 2, axis=0)
    log_p = -0.5 * (5 + 4) * np.log(s2) - 0.5 * (square[:, None] + 4 * 0.25**2) / s2
    p = np.exp(log_p - log_p.max()).sum(axis=1)
    below = np.cumsum(p) / p.sum()
    limit = np.log(1.5)
    low, high = (np.exp(np.interp(x, below, g)) for x in (0.025, 0.975))
    assert found.g == pytest.approx(y.mean())
    assert found.ci95 == pytest.approx((low, high), rel=5e-3)
    assert found.beyond == pytest.approx(1 - np.interp(limit, g, below), abs=2e-3)
    inside = np.interp(limit, g, below) - np.interp(-limit, g, below)
    assert found.within == pytest.approx(inside, abs=2e-3)
    inverse = specimen.common(value / off**2, 1e-10 * value, joints)
    assert inverse.g == pytest.approx(-found.g)
    assert inverse.beyond == pytest.approx(found.beyond)


def test_a_stiffness_in_its_range_is_not_off_and_one_hardly_known_counts_little():
    """Above and below a range by the nearer end; weights are 1 / (tau^2 + u^2)."""
    ranged = [joint(2.0, 4.0)] * 4
    found = specimen.common(np.array([3.0, 2.0, 8.0, 1.0]), np.full(4, 1e-9), ranged)
    assert found.g == pytest.approx((np.log(2) - np.log(2)) / 4, abs=1e-12)
    u = np.array([1e-9, 0.25])
    two = specimen.common(np.array([np.e, 1.0]), u * [np.e, 1.0], [joint(1.0)] * 2)
    assert two.g == pytest.approx(1 / 1.5)
    assert specimen.has_stated_stiffness(joint(1.0))
    assert specimen.has_stated_stiffness(joint(1.0, 2.0))
    assert not specimen.has_stated_stiffness(Some(stiffness=None, stiffness_range=None))


@pytest.mark.parametrize(
    ("force", "known", "scale"),
    [(2.0, "contrasts", 3.0), (2.0, "residuals", 1.0), (0.5, "contrasts", 1.0)],
)
def test_a_scale_scatters_more_where_contrasts_say_so(force, known, scale):
    """Relative to the tracker, whose own ratio is a factor of it."""
    assert ScatterRatio(1.5, 0.1, 0.2, force, 0.1, 0.0, known).scale == scale


def test_a_part_of_a_system_has_its_part_of_the_covariance():
    """V of some rows is the same block of V; errors that touch none of them go."""
    system = made(np.random.default_rng(2))
    rows = np.isin(system.rows.pose, np.unique(system.rows.pose)[:2])
    some = system.part(rows)

    np.testing.assert_allclose(dense(some), dense(system)[np.ix_(rows, rows)], atol=1e-24)
    np.testing.assert_array_equal(some.B, system.B[rows])
    np.testing.assert_array_equal(some.rows.pull, system.rows.pull[rows])
    assert (abs(some.errors.G).sum(axis=0) > 0).all()
    assert some.errors.G.shape[1] == len(some.errors.source) < len(system.errors.source)
    assert system.of_pulls is system
    pull = np.where(rows, system.rows.pull, -1)
    beside = replace(system, rows=replace(system.rows, pull=pull))
    np.testing.assert_array_equal(beside.of_pulls.c, some.c)


def test_two_noises_are_told_apart_by_their_sources():
    """A planted ratio of three; too few rows tell nothing."""
    rng = np.random.default_rng(4)
    system = made(rng, pulls=(4,) * 20, common=False, force_m=0.0)
    n = len(system.c)
    turns = np.arange(n) % 2 == 1
    own = np.where(turns, 3.0, 1.0) * 2e-5 * rng.normal(size=n)
    G = Errors(csr_array(2e-5 * np.eye(n)), np.full(n, "tracker", object), np.zeros(n, bool))
    B = system.B[:, :1]
    one = replace(system, B=B, c=own, errors=G, parameters=system.parameters[:1])
    split = fit._by_kind(one.errors, one.errors, turns.astype(int))
    assert split.source.tolist() == np.where(turns, "turned", "tracker").tolist()
    found = fit._ratio(replace(one, errors=split))
    assert found == pytest.approx(3.0, rel=0.25)
    few = replace(one, errors=split).part(np.arange(n) < 24)
    assert fit._ratio(few) is None
    other = replace(one.errors, source=np.full(n, "registration", object))
    assert "turned" not in fit._by_kind(other, other, turns.astype(int)).source


# --- one pose, sensitivities ----------------------------------------------------------------------


def case_of(data):
    """A campaign whose readings have all digits."""
    readings = pd.DataFrame(np.random.default_rng(1).normal(size=(50, 3)), columns=XYZ)
    return Some(tool=TOOL, robot=RAIL, cell=CELL, readings=readings, data=data)


def test_targets_that_move_as_one_body_were_one_reading():
    """Whatever their common noise; noise of each by itself, or none at all, is no such sign."""
    common = measured((3,) * 3, noise=4e-5, rigid=True)
    found = one_pose.one_pose(case_of(common), common)

    assert found is not None
    assert found.kept_m < 1e-6 < 1e-5 < found.left_m
    own = measured((3,) * 3, noise=4e-5)
    assert one_pose.one_pose(case_of(own), own) is None
    exact = measured((3,) * 3, noise=1e-12)
    assert one_pose.one_pose(case_of(exact), exact) is None
    few = measured((1, 1, 1), noise=4e-5, rigid=True)
    assert one_pose.one_pose(case_of(few), few) is None
    six = Some(tool=replace(TOOL, six=True))
    assert one_pose.one_pose(six, common) is None
    line = Some(tool=replace(TOOL, points=np.outer([0, 1, 2.0], [0.1, 0, 0])))
    assert one_pose.one_pose(line, common) is None


@pytest.mark.parametrize("known", [True, False])
def test_distances_change_by_a_strain_and_not_by_a_motion(known):
    """L e for a small strain e; the rotation is what is left of displacements about their mean."""
    data, e = measured((1, 1, 1)), np.array([1e-5, -2e-5, 0.0])
    here = configure(RAIL, data.pulls.q).points(POINTS)
    w = np.array([2e-5, 0, 1e-5])
    moved = e[:, None, None] * here + np.cross(w, here) + 3e-3
    unloaded = here.reshape(-1, 3) if known else np.full((9, 3), np.nan)
    rows = np.arange(9) < 8  # the third pull lacks a target
    some = replace(
        data, delta=moved.reshape(-1, 3)[rows], unloaded=unloaded[rows], pull=data.pull[rows],
        target=data.target[rows], name=data.name[rows], zero=data.zero[rows],
        loaded_cov=data.loaded_cov[rows], zero_cov=data.zero_cov[rows],
    )  # fmt: skip
    change, turned = one_pose._changes(case_of(some), some)

    pairs = [np.linalg.norm(POINTS[i] - POINTS[j]) for i, j in ((0, 1), (0, 2), (1, 2))]
    np.testing.assert_allclose(change, np.outer(pairs, e[:2]), atol=1e-9)
    about = moved[:2] - moved[:2].mean(axis=1, keepdims=True)
    np.testing.assert_allclose(turned, np.sqrt([np.mean(one**2) for one in about]))
    none = replace(some, delta=some.delta[:2], pull=some.pull[:2], target=some.target[:2])
    change, turned = one_pose._changes(case_of(none), none)
    assert (change.size, turned.size) == (0, 0)


def test_sensitivities_are_differences_of_predictions():
    """By a newton along each axis or along the pull, and by a turned tracker."""
    data = measured()
    here = predict(CELL, data.pulls, SPRINGS).displacement[data.pull, data.target]

    def under(force):
        pulls = replace(data.pulls, force=force)
        return predict(CELL, pulls, SPRINGS).displacement[data.pull, data.target]

    force, (by_axis, by_turn) = data.pulls.force, assemble.by_inputs(CELL, data, SPRINGS)
    for k, axis in enumerate(np.eye(3)):
        np.testing.assert_allclose(by_axis[:, k], (here - under(force + axis)).ravel(), atol=1e-12)
        turn = 1e-6 * axis
        moved = np.cross(turn, data.delta) - (under(force + np.cross(turn, force)) - here)
        np.testing.assert_allclose(by_turn[:, k] * 1e-6, moved.ravel(), atol=1e-14)
    size = np.linalg.norm(force, axis=1)[data.pull]
    np.testing.assert_allclose(  # springs are linear
        assemble.by_force(CELL, data, SPRINGS), (here / size[:, None]).ravel(), rtol=1e-6
    )


def test_zeros_of_whole_poses_are_motions_of_the_effector():
    """A planted shift and rotation; one that lacks a target, or stands elsewhere, is left out."""
    rng = np.random.default_rng(6)
    q = {7: poses(1, rng)[0], 4: poses(1, rng)[0]}
    six = replace(TOOL, six=True)
    cell = replace(CELL, tool=six)
    s, w = rng.normal(size=(2, 3, 3)) * 1e-4
    keys = [(4, 0, 0), (7, 0, 1), (7, 1, 2)]
    rows = []
    for pose, which, k in keys:
        axes = configure(RAIL, q[pose][None]).flange_axes[0]
        levers = (POINTS - POINTS.mean(axis=0)) @ axes.T
        rows += [
            (pose, t, which, s[k] + np.cross(w[k], levers[t]), (1 + t + k) * np.eye(3))
            for t in range(3)
        ]
    rows += [
        (7, 0, 2, np.ones(3), np.eye(3)),
        *((9, t, 0, np.ones(3), np.eye(3)) for t in range(3)),
    ]
    order = rng.permutation(len(rows))
    columns = [np.array([rows[k][c] for k in order]) for c in range(5)]
    found = _in_poses(Zeros(*columns), q, cell)

    L = linear.rms(np.linalg.norm(POINTS - POINTS.mean(axis=0), axis=1))
    assert found.pose.tolist() == [4, 4, 7, 7, 7, 7]
    assert found.which.tolist() == [0, 0, 0, 0, 1, 1]
    assert found.target.tolist() == [0, 1] * 3
    np.testing.assert_allclose(found.delta[::2], s, atol=1e-15)
    np.testing.assert_allclose(found.delta[1::2], L * w, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found.cov[:, 0, 0], np.repeat([2.0, 3.0, 4.0], 2))
    assert not len(_in_poses(Zeros(*columns), {1: q[4]}, cell).pose)


def test_rotations_weigh_by_their_mean_variance():
    """Relative to that of positions."""
    cov = np.array([1.0, 9.0, 3.0, 7.0])[:, None, None] * np.eye(3)
    found = _turning(Some(loaded_cov=cov, target=np.array([0, 1, 0, 1])))
    np.testing.assert_allclose(found, [1.0, 4.0])


def components(scale, p, **more):
    """What contrasts say of tracker and scale."""
    name = np.array(["tracker", "force_reading"], object)
    return Components(name, np.array(scale), np.array([0.1, 0.2]), np.array(p), 50, True, **more)


def test_a_larger_scatter_is_that_of_the_core_beside_tails():
    """Where the tracker's is significant; its p is the larger one, and the scale's stays."""
    one = components([2.0, 3.0], [1e-9, 1e-9])
    core = Some(scale=1.4, std=0.3, p_value=1e-7)
    found = one.beside(Some(core=lambda used: core if used == 2.0 else None))
    assert found.scale.tolist() == [1.4, 3.0]
    assert found.std.tolist() == [0.3, 0.2]
    assert found.p_value.tolist() == [1e-7, 1e-9]
    quiet = components([1.1, 3.0], [0.3, 1e-9])
    assert quiet.beside(None) is quiet
    assert one.of("force_reading") == 3.0
    assert one.replaced.tolist() == one.larger.tolist() == [True, True]
    assert quiet.replaced.tolist() == [False, True]
    assert components([1.1, 1.0], [0.3, 0.5], taken=True).replaced.tolist() == [True, False]
    small = components([0.01, 1.0], [1.0, 0.5], p_smaller=np.array([1e-9, 0.5]))
    assert small.smaller.tolist() == small.replaced.tolist() == [True, False]
    assert not small.larger.any()
    assert not components([1.0, 1.0], [0.5, 0.5]).used
    assert one.left == (1.0, 0.1)
    assert quiet.left == (1.1, 0.1)


def test_a_fit_uses_the_noise_that_contrasts_replace():
    """Over the stated one; tails are not counted as size where they are applied."""
    fitted = fit.Fitted
    for scale, p, used in (([2.0, 1.0], [1e-9, 1.0], 2.0), ([1.1, 3.0], [0.5, 1e-9], 1.0)):
        found = components(scale, p)
        assert fitted.used.fget(Some(noise=found)) == used
        core = Some(scale=1.2, std=0.1, p_value=1e-8)
        for tailed in (True, False):
            shape = Some(tailed=tailed, family=Some(core=lambda _, core=core: core), wide_m=5e-5)
            one = Some(noise=found, shape=shape, reduced=Some(data=DATA))
            expected = 1.2 if tailed and used > 1 else scale[0]
            assert fitted.excess.fget(one).scale[0] == expected
            assert fitted.scatter.fget(one) == pytest.approx(2.5)
