"""A whitened campaign: every result against generalised least squares on whole matrices."""

from dataclasses import replace

import numpy as np
import pytest
from made_system import generalised
from scipy import linalg, stats
from scipy.spatial.transform import Rotation

from pipeline.machine.cell import load, paper_cell
from pipeline.machine.effects import catalogue
from pipeline.machine.robot.configuration import torque
from pipeline.reduction.effector import tool
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.linearised import CurrentModel, linearise
from pipeline.system.whitened import by_pose_drop, of_laws, whiten, with_laws

SUSPECTS = (
    ("rail_roll", ""),
    ("joint_hardening:3", "cubic"),
    ("joint_hardening:2", "cubic"),
    ("compensator", "one harmonic"),
    ("joint_hardening:3", "high knee"),
    ("joint_lost_motion:3", "wide"),
    ("base_rotation", ""),
)
"""Two laws and a lost motion of one gear, another gear, and suspects of one to three columns."""

HARDENING, KIN = 1, [4, 5]
"""A law of a gear, and the other laws of the same gear."""

NOISE = 1.3


def seen(campaign, data, accepted=()):
    """A campaign linearised at joint springs and some accepted suspects."""
    raw = in_memory(campaign.files)
    every = {(effect.label, effect.form): effect for effect in catalogue(raw.robot)}
    suspects = tuple(every[name] for name in SUSPECTS)
    cell = paper_cell(raw.robot, tool(raw.settings))
    mine = [suspects[i] for i in accepted]
    more = [p.typical / 2 for effect in mine for p in effect.parameters]
    values = np.append(raw.robot.nominal_compliance, more)
    return linearise(CurrentModel(cell.with_effects(*mine), values, 7, accepted), data, suspects)


@pytest.fixture(scope="module")
def given(small_campaign, read_back):
    """A small campaign linearised with one law of a gear accepted."""
    return seen(small_campaign, read_back(small_campaign).data, (HARDENING,))


@pytest.fixture(scope="module")
def view(given):
    """The same whitened, with noise a third larger than stated, that of the scale by a half."""
    return whiten(given, NOISE, 1.5)


def parts(given, force_noise=1.0, doubt=None):
    """Covariance of each pose's own errors and of the common ones, with one law uncertain."""
    G = given.errors.G.toarray() * np.where(
        given.errors.source == "force_reading", force_noise, 1.0
    )
    own, common = G * ~given.errors.common, G * given.errors.common
    own, common = own @ own.T, common @ common.T
    if doubt is not None:
        moved = given.Z[:, HARDENING] * given.model.values[7]
        same_pull = given.rows.pull[:, None] == given.rows.pull
        own = own + min(doubt, 0.05) ** 2 * np.outer(moved, moved) * same_pull
        for other in (5, 6):  # columns of the other laws of the gear
            column = given.Z[:, other] / np.linalg.norm(given.Z[:, other])
            common = common + doubt**2 * (moved @ moved) * np.outer(column, column)
    return own, common


def columns(given, suspects=(), springs=True):
    """Columns of springs and suspects in typical sizes."""
    mine = [7 * [True] if springs else 7 * [False]]
    size = [p.typical for p in given.model.cell.parameters[:7]]
    for i, effect in enumerate(given.suspects):
        mine.append([i in suspects] * len(effect.parameters))
        size += [p.typical for p in effect.parameters]
    return (np.hstack([given.B, given.Z]) * size)[:, np.concatenate(mine)]


@pytest.mark.parametrize(
    ("force_noise", "doubt"), [(1.0, None), (1.5, None), (1.5, 0.3), (1, 0.02)]
)
def test_every_suspect_is_generalised_least_squares(given, force_noise, doubt):
    """Size, drop, rest and degrees of freedom with the whole V, own errors `noise` times larger.

    An uncertain law is uncertain in each pull by a twentieth at most, and in all pulls together
    along the other laws of its gear.
    """
    laws = [] if doubt is None else [(HARDENING, doubt)]
    view = whiten(given, NOISE, force_noise, laws)
    own, common = parts(given, force_noise, doubt)
    V = NOISE**2 * own + common
    found = view.beside(view.base)
    _, _, rest = generalised(columns(given, [HARDENING]), given.y, V)

    assert found.rest == pytest.approx(rest, rel=1e-6)
    assert found.dof == view.rows_left - 1 == len(given.y) - 8
    for i, effect in enumerate(given.suspects):
        if i != HARDENING:
            X = np.hstack([columns(given, [HARDENING]), columns(given, [i], springs=False)])
            b, _, chi2 = generalised(X, given.y, V)
            k = len(effect.parameters)
            assert found.drop[i] == pytest.approx(rest - chi2, rel=1e-4, abs=1e-6)
            assert found.size[i, :k] == pytest.approx(b[8:], rel=1e-4)
    assert found.rank[HARDENING] == 0


@pytest.mark.parametrize(("suspect", "joint"), [(HARDENING + 1, 2), (3, 3)])
def test_no_size_may_make_a_spring_yield_against_its_load(view, given, suspect, joint):
    """The compliance left in the pull where there is least, with springs estimated beside it."""
    plain, effect = view.beside(np.arange(view.first)), given.suspects[suspect]
    mine, joints = view.columns([suspect]), np.arange(view.first)
    typical = np.array([p.typical for p in effect.parameters])
    loaded = load(given.model.cell, given.data.pulls, given.model.values)
    tau = torque(effect.screws(loaded), loaded.load_point, loaded.force)
    h = 1e-3 * tau
    slope = (effect.response(loaded, tau + h) - effect.response(loaded, tau - h)) / (2 * h)

    def left(z):
        c = view.A[:, -1] - view.A[:, mine] @ z
        spring = np.linalg.lstsq(view.A[:, joints], c, rcond=None)[0][joint - 1]
        return (spring * view.typical[joint - 1] + slope @ (typical * z)) * tau[:, 0] ** 2

    o, n = (getattr(plain.yielding, name)[suspect] for name in ("offset", "normal"))
    z = plain.size[suspect, : len(typical)]
    for size in (z, z + 1.0):
        assert np.abs(left(size) - (o + n[: len(typical)] @ size)).min() < 1e-5 * o
    assert not np.isfinite(plain.yielding.offset[0])  # the roll changes no other spring


def test_groups_of_suspects_are_tried_together(view, given):
    """All columns of two suspects at once, in addition to springs alone."""
    own, common = parts(given, 1.5)
    V = NOISE**2 * own + common
    both = np.concatenate([view.columns([3]), view.columns([0])])[None]
    found = view.beside(np.arange(view.first), among=both)
    _, _, less = generalised(columns(given), given.y, V)
    _, _, more = generalised(columns(given, [0, 3]), given.y, V)

    assert found.drop[0] == pytest.approx(less - more, rel=1e-5)
    assert found.dof == len(given.y) - 7
    assert found.bounds is None


def test_columns_of_a_suspect_are_where_its_parameters_are(view, given):
    """After springs and common errors, in the order of the suspects, with physical bounds."""
    r = int(given.errors.common.sum())
    first = 7 + r

    assert (view.springs, view.common, view.first) == (7, r, first)
    assert view.columns([3, 6]).tolist() == [first + k for k in (3, 4, 7, 8, 9)]
    assert view.base.tolist() == [*range(first), first + 1]
    assert view.at[3].tolist() == [first + 3, first + 4, -1]
    assert view.A[: len(given.y), view.columns([0])].any()
    for i, effect in enumerate(given.suspects):
        for k, p in enumerate(effect.parameters):
            assert view.bounds[:, i, k].tolist() == [p.lower / p.typical, p.upper / p.typical]
    assert np.isinf(view.bounds[:, 0, 1:]).all()


@pytest.mark.parametrize("doubt", [None, 0.3])
def test_spread_is_the_uncertainty_of_each_row(given, doubt):
    """`noise` times the stated uncertainty; that of a law counts as far as it is per pull."""
    laws = [] if doubt is None else [(HARDENING, doubt)]
    own, common = parts(given, 2.0, doubt)[0], parts(given)[1]

    assert whiten(given, NOISE, 2.0, laws).spread == pytest.approx(
        NOISE * np.sqrt(np.diag(own + common))
    )


def test_errors_with_laws_have_the_covariance_that_weighs(given):
    """G G' of all errors; those of the law itself per pull, those of the same gear in all pulls."""
    louder = replace(given.errors, G=given.errors.G * 2)
    errors = with_laws(given, louder, [(HARDENING, 0.3)])
    own, common = parts(replace(given, errors=louder), 1.0, 0.3)
    law = errors.source == "law"

    assert (errors.G @ errors.G.T).toarray() == pytest.approx(own + common, rel=1e-9, abs=1e-20)
    assert errors.common[law].sum() == len(KIN)
    assert (~errors.common[law]).sum() == given.rows.pull.max() + 1


def test_an_element_may_sit_elsewhere_by_its_tolerance(small_campaign, read_back):
    """A carriage that rolls: six errors of all pulls, in proportion to size and tolerance."""
    rolls = seen(small_campaign, read_back(small_campaign).data, (0,))
    twice = replace(rolls, model=replace(rolls.model, values=rolls.model.values * ([1] * 7 + [2])))

    one, other = (
        with_laws(each, each.errors, [(0, tolerance)])
        for each, tolerance in ((rolls, 0.02), (twice, 0.01))
    )

    seat = one.source == "seat"
    moved = rolls.Z[:, 0] * rolls.model.values[7]
    assert seat.sum() == 6
    assert one.common[seat].all()
    size = np.linalg.norm(one.G[:, seat].toarray(), axis=0) / np.linalg.norm(moved)
    assert 0.005 < size.max() < 0.06  # turned by 20 mrad, or shifted by 2 % of its lever
    np.testing.assert_allclose(
        one.G[:, seat].toarray(),
        other.G[:, seat].toarray(),
        rtol=0.05,
        atol=1e-2 * np.abs(moved).max() * 0.02,
    )


def test_a_law_at_its_best_within_tolerance_errs_in_all_pulls_alike(given):
    """The scatter of single pulls stays that of the readings."""
    laws = [(HARDENING, 0.3)]
    best, plain = whiten(given, NOISE, 1.5, laws, in_each=False), whiten(given, NOISE, 1.5)
    assert best.spread == pytest.approx(plain.spread)
    assert best.common == plain.common + len(KIN)
    assert best.common == whiten(given, NOISE, 1.5, laws).common


def test_a_law_that_is_accepted_is_no_doubt_about_another(small_campaign, read_back):
    """Two laws of a gear estimated together: each may be the third, of which neither says more."""
    both = seen(small_campaign, read_back(small_campaign).data, (HARDENING, KIN[1]))

    errors = with_laws(both, both.errors, [(HARDENING, 0.3), (KIN[1], 0.2)])

    found = errors.G[:, (errors.source == "law") & errors.common].toarray()
    third = both.Z[:, 5] / np.linalg.norm(both.Z[:, 5])  # the compensator has two columns
    sizes = [0.3 * np.linalg.norm(both.Z[:, HARDENING]) * abs(both.model.values[7]),
             0.2 * np.linalg.norm(both.Z[:, 6]) * abs(both.model.values[8])]  # fmt: skip
    np.testing.assert_allclose(found, np.outer(third, sizes), rtol=1e-9, atol=1e-15)


def test_a_law_is_uncertain_in_each_pull_by_a_part_of_what_it_moves(small_campaign, read_back):
    """All parameters of each cause move the pull together, by its own tolerance."""
    data, causes = read_back(small_campaign).data, (3, HARDENING)
    both = seen(small_campaign, data, causes)
    mine = [both.suspects[i] for i in causes]

    errors = of_laws(both.model.cell, data, both.model.values, mine, both.suspects)

    size = [len(one.parameters) for one in mine]
    assert size == [2, 1]
    moved = (both.Z[:, 3:5] @ both.model.values[7:9], both.Z[:, HARDENING] * both.model.values[9])
    own = errors.G[:, ~errors.common].toarray()
    parts = zip((min(one.tolerance, 0.05) for one in mine), moved, strict=True)  # 5 % at most
    V = sum(part**2 * np.outer(d, d) for part, d in parts)
    V = V * (both.rows.pull[:, None] == both.rows.pull)
    np.testing.assert_allclose(own @ own.T, V, rtol=1e-9, atol=1e-15 * V.max())
    assert np.abs(moved[0]).max() > 0


def without(given, pose, suspects, force_noise=1.5):
    """Residuals of a pose by a fit to the other poses [m], and chi2 of that fit."""
    own, common = parts(given, force_noise)
    V = NOISE**2 * own + common
    out, X = given.rows.pose == pose, columns(given, suspects)
    b, _, chi2 = generalised(X[~out], given.y[~out], V[~out][:, ~out])
    return given.y[out] - X[out] @ b, chi2


@pytest.mark.parametrize("suspects", [[HARDENING], [HARDENING, 3], []])
def test_each_pose_is_predicted_by_a_fit_without_it(view, given, suspects):
    """Residuals of a left-out pose, from refits with the whole V, and from products."""
    base = np.concatenate([np.arange(view.first), view.columns(suspects)])
    left = view.left_out(base)

    for index, pose in enumerate(np.unique(given.rows.pose)):
        out = given.rows.pose == pose
        truth, _ = without(given, pose, suspects)
        assert left[out] == pytest.approx(truth, abs=1e-9)
        predicted = view.predicted(base, view.without(index), out)
        assert given.y[out] - predicted == pytest.approx(truth, abs=1e-9)
    assert view.poses == len(np.unique(given.rows.pose))


def test_suspects_are_tried_without_a_pose(view, given):
    """Fewer rows: fewer degrees of freedom, and the sum of squares of the other poses."""
    pose = np.unique(given.rows.pose)[2]
    rows = int(np.sum(given.rows.pose == pose))
    found = view.beside(view.base, view.without(2), rows)

    assert found.rest == pytest.approx(without(given, pose, [HARDENING])[1], rel=1e-6)
    assert found.drop[3] == pytest.approx(
        found.rest - without(given, pose, [HARDENING, 3])[1], rel=1e-4
    )
    assert found.dof == len(given.y) - rows - 8


def by_pose(given, own, rows):
    """Rows whitened with each pose's own errors, pose by pose."""
    out = np.zeros(rows.shape)
    for pose in np.unique(given.rows.pose):
        mine = given.rows.pose == pose
        out[mine] = linalg.solve_triangular(
            np.linalg.cholesky(own[mine][:, mine]), rows[mine], lower=True
        )
    return out


def each(key, columns):
    """All columns separately for each value of a key."""
    return np.hstack([columns * (key == one)[:, None] for one in np.unique(key)])


def remains(X, y):
    """Residual sum of squares of numpy's fit, and its degrees of freedom."""
    b, _, rank, _ = np.linalg.lstsq(X, y, rcond=1e-9)
    return float(np.sum((y - X @ b) ** 2)), len(y) - rank


def loose(given):
    """Motion of each reflector alone along the axes of F_b and of the flange, per kilonewton."""
    data, rows = given.data, given.rows
    points = load(given.model.cell, data.pulls, given.model.values).points
    tool = given.model.cell.tool.points
    size = np.linalg.norm(data.pulls.force, axis=1) / 1000
    out = np.zeros((len(rows), len(tool), 6))
    for row, (pull, axis) in enumerate(zip(rows.pull, rows.axis, strict=True)):
        turn, _ = Rotation.align_vectors(
            points[pull] - points[pull].mean(axis=0), tool - tool.mean(axis=0)
        )
        along = np.hstack([np.eye(3)[axis], turn.as_matrix()[axis]])
        out[row, data.target[row // 3]] = along * size[pull]
    return out.reshape(len(rows), -1)


@pytest.mark.parametrize("moved_m", [0.0, 5e-5, 3e-4])
def test_scatter_is_what_no_rigid_motion_makes(given, moved_m):
    """Free motions of each pull, by fits; a compliant reflector is excluded and reported."""
    size = np.linalg.norm(given.data.pulls.force, axis=1)[given.rows.pull] / 1000
    at = (np.repeat(given.data.target, 3) == 1) & (given.rows.axis == 2)
    soft = replace(given, y=given.y + moved_m * size * at)
    view = whiten(soft, NOISE, 1.5)
    own, _ = parts(given, 1.5)
    motions, y = (by_pose(given, own, a) for a in (each(given.rows.pull, soft.motions), soft.y))
    square, dof = remains(motions, y)
    less, left = remains(np.hstack([motions, by_pose(given, own, loose(given))]), y)
    F = (square - less) / (dof - left) / (less / left)
    p = stats.f.sf(F, dof - left, left)

    assert np.log(view.soft_p) == pytest.approx(np.log(p), rel=1e-4)
    assert (p < 1e-4) == (moved_m > 1e-4)
    if p < 1e-4:
        square, dof = less, left
    assert view.scatter == pytest.approx(square / NOISE**2, rel=1e-6)
    assert view.scatter_dof == dof
    assert view.tells_scatter


def test_one_reflector_tells_no_scatter(read_back):
    """Any of its motions is one of a rigid effector."""
    one = {
        "poses": {"count": 5},
        "tool": {"load_point": [0.15, 0.0, 0.25], "P1": [0.2, 0.05, 0.12]},
    }
    campaign = simulate(Plan.model_validate({"name": "one", **one}))
    view = whiten(seen(campaign, read_back(campaign).data), 1.0)

    assert (view.scatter, view.scatter_dof, view.soft_p) == (0.0, 0, 1.0)
    assert not view.tells_scatter


@pytest.mark.parametrize("accepted", [[], [HARDENING]])
def test_what_a_free_stiffness_of_each_pose_takes_is_told_by_fits(view, given, accepted):
    """From the residual after the best estimate of common errors.

    Rank minus springs and accepted.
    """
    own, common = parts(given, 1.5)
    V = NOISE**2 * own + common
    X = columns(given, accepted)
    b, *_ = generalised(X, given.y, V)
    left = given.y - X @ b
    residual = left - common @ np.linalg.solve(V, left)
    size = np.linalg.norm(given.data.pulls.force, axis=1)[given.rows.pull, None]
    free = by_pose(given, own, each(given.rows.pose, given.motions * size))
    r = by_pose(given, own, residual) / NOISE
    after, dof = remains(free, r)
    base = np.concatenate([np.arange(view.first), view.columns(accepted)])
    drop, found_dof = by_pose_drop(view, base)

    assert drop == pytest.approx(r @ r - after, rel=1e-5)
    assert found_dof == len(r) - dof - 7 - len(accepted)
    assert view.free.dof == dof


def test_springs_are_free_stiffnesses_of_poses_with_two_anchors(small_campaign, read_back):
    """Every other pull turned: what joint springs do is among what a pose is free to do."""
    data = read_back(small_campaign).data
    turns = np.where(np.arange(len(data.pulls.force)) % 2, 1.5, 0.0)[:, None] * [0.6, 0.0, 0.8]
    force = Rotation.from_rotvec(turns).apply(data.pulls.force.copy())
    view = whiten(seen(small_campaign, replace(data, pulls=replace(data.pulls, force=force))), 1.0)

    for spring in view.A[: len(view.rows), :7].T:
        assert view.free.against(spring).rest < 0.01 * (spring @ spring)


def test_exact_data_leave_rounding_and_no_more(given):
    """Without residuals, the sum of squares is the minimum per degree of freedom."""
    exact = replace(given, y=given.B @ given.model.values[:7])
    view = whiten(exact, 1.0)

    assert view.beside(np.arange(view.first)).rest == pytest.approx(1e-4 * view.rows_left)
