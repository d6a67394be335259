"""Unloaded readings linearised: against forward kinematics and differences, column by column."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation
from test_rows_by_hand import KR500, POINTS, read

from pipeline.geometry import unloaded as module
from pipeline.geometry.arm_weight import usual
from pipeline.geometry.unloaded import FIXED_STD, MidChange, _misshapen, _Shape, reach, unloaded
from pipeline.machine.effects import gravity_sag
from pipeline.machine.robot import configure
from pipeline.machine.robot.dh_parameters import changed
from pipeline.reduction.idle import Idle

CHANGES = (
    MidChange(3, (1, 2), 3),
    MidChange(0, (1, 2, 3), 4),
    MidChange(5, (1, 2, 3), 4, slipped=True),
    MidChange(0, (1,), 2, target=1),
)
BEFORE = {0: 2, 1: 3, 2: 3, 3: 1}
"""Poses before each of them."""


def full(**more):
    """Readings of two targets in five poses, with everything that may displace them."""
    rng = np.random.default_rng(41)
    zeros = read(5, 2)
    (sag,) = gravity_sag.effects(KR500)
    of = {
        "sag": sag.acts[0],
        "changes": CHANGES,
        "beside": 1e-4 * rng.normal(size=(10, 3, 2)),
        "place": np.array([0.3, -0.2, 0.1]),
        "rotation": 1e-4 * np.array([[1.0, 0, 0], [0.5, 2.0, 0], [0.2, 0.3, 3.0]]),
        "joint_std": 1e-4 * np.arange(1.0, 8.0),
    }
    return replace(zeros, **of | more)


def stands(zeros, x):
    """Where the targets are by forward kinematics, (z, 3)."""
    where, pulls = zeros.columns, zeros.pulls
    robot = changed(zeros.robot, zeros.letters, x[where.table])
    masses = np.array([p.typical for p in zeros.sag.parameters]) * x[where.masses]
    q = zeros.sag.geometry(zeros.robot, pulls, masses).copy()
    at = where.changes.start
    late = {k: (pulls.pose > n).astype(float) for k, n in BEFORE.items()}
    d3, whole, d5, target = x[at], x[at + 1 : at + 7], x[at + 7], x[at + 8 : at + 11]
    q[:, 2] -= (1 - late[0]) * d3
    q[:, 4] -= late[2] * d5
    here = configure(robot, q)
    points = (zeros.tool.points + x[where.tool].reshape(-1, 3))[zeros.target]
    p = here.flange_origin + np.einsum("zij,zj->zi", here.flange_axes, points)
    R = Rotation.from_rotvec(zeros.rotation @ x[where.turn] + x[where.loose]).as_matrix()
    p = p @ R.T
    out = p + zeros.place + x[where.shift] + np.einsum("zir,r->zi", zeros.beside, x[where.beside])
    out = out + late[1][:, None] * (whole[:3] + np.cross(whole[3:], p))
    moved = np.einsum("ij,zjk,k->zi", R, here.flange_axes, target)
    return out + (late[3] * (zeros.target == 1))[:, None] * moved


def drawn(zeros):
    """Unknowns of the size that they may have."""
    rng, where = np.random.default_rng(43), zeros.columns
    x = 1e-3 * rng.normal(size=where.count)
    x[where.turn], x[where.masses] = rng.normal(size=3), [0.6, 1.4]
    x[where.beside] = rng.normal(size=2)
    return x


def test_residuals_are_those_of_the_forward_kinematics():
    """At any unknowns: the table, the tool, F_b, masses, changes and what stands beside."""
    zeros = full()
    x = drawn(zeros)
    np.testing.assert_allclose(zeros.seen(x), zeros.at - stands(zeros, x), atol=1e-12)
    assert zeros.columns.count == 3 + 3 + 6 + len(zeros.letters) + 3 + 2 + 0 + 2 + 11
    assert module.off(zeros, x) == pytest.approx(np.sqrt(np.mean(zeros.seen(x) ** 2)))


def test_columns_are_the_derivatives_of_the_positions():
    """By central differences; masses and moments act by the springs as delivered."""
    zeros = full()
    x = 0.1 * drawn(zeros)
    rows = zeros.about(x)
    D = rows.D[rows.place]
    where = zeros.columns
    parts = [getattr(where, name) for name in vars(where)]
    ends = {k for one in parts if one.stop > one.start for k in (one.start, one.stop - 1)}
    table = range(where.table.start, where.table.stop, 6)
    for k in sorted({*ends, *table, where.changes.start + 1, where.changes.start + 7}):
        h = 1e-5 * np.eye(len(x))[k]
        own = (stands(zeros, x + h) - stands(zeros, x - h)) / 2e-5
        np.testing.assert_allclose(D[:, :, k], own, atol=3e-3 * np.abs(own).max() + 1e-9)


def test_joints_move_the_targets_as_their_log_says():
    """Derivatives by the joint values, turned with F_b."""
    zeros = full(changes=(), sag=None, beside=np.zeros((0, 3, 0)))
    x = np.zeros(zeros.columns.count)
    x[zeros.columns.loose] = [0.3, -0.2, 0.5]
    rows = zeros.about(x)
    Z = rows.Z[rows.place]
    R = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    for j in range(7):
        h = 1e-6 * np.eye(7)[j]
        ahead, behind = (
            configure(KR500, zeros.pulls.q + s * h).points(POINTS[:2])[np.arange(10), zeros.target]
            for s in (1, -1)
        )
        np.testing.assert_allclose(Z[:, :, j], (ahead - behind) / 2e-6 @ R.T, atol=1e-7)
    usual_std = np.array([5e-5, *[1e-4] * 6])
    for size in (0.5, 2.0):
        C = rows.cov(size)
        for p in range(5):
            Zs = rows.Z[p] * size * usual_std
            np.testing.assert_allclose(C[p], rows.N[p] + Zs @ Zs.T, atol=1e-18)


def test_rows_of_a_pose_are_its_readings_in_their_order():
    """Missing rows are zero, with variances of one."""
    zeros = read(3, 2)
    keep = np.array([0, 1, 3, 4, 5])
    some = replace(
        zeros, pulls=zeros.pulls.part(keep), pose=zeros.pose[keep], target=zeros.target[keep],
        at=zeros.at[keep], cov=zeros.cov[keep],
    )  # fmt: skip
    rows = some.about(np.zeros(some.columns.count))
    assert rows.y.shape == (3, 6)
    assert not rows.y[1, 3:].any()
    assert not rows.D[1, 3:].any()
    np.testing.assert_array_equal(rows.N[1, 3:, 3:], np.eye(3))
    whole = zeros.about(np.zeros(zeros.columns.count))
    np.testing.assert_allclose(rows.y[1, :3], whole.y[1, 3:])
    np.testing.assert_array_equal(rows.N[0][:3, :3], zeros.cov[0])
    np.testing.assert_array_equal(rows.N[0][3:, 3:], zeros.cov[1])
    np.testing.assert_array_equal(rows.N[1][:3, :3], zeros.cov[3])
    assert not rows.N[0][:3, 3:].any()


def test_a_pose_that_was_read_as_one_has_position_and_rotation():
    """Of all targets together: a turn about the flange moves the mean, and is seen in metres."""
    turned = np.stack([(k + 1) * 1e-10 * np.eye(3) for k in range(4)])
    zeros = replace(read(4, 3), turned=turned)
    x = np.zeros(zeros.columns.count)
    rows, where = zeros.about(x), zeros.columns
    assert rows.y.shape == (4, 6)
    assert zeros.read.tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    each = zeros.at.reshape(4, 3, 3)
    size = np.sqrt(np.mean(np.sum((POINTS - POINTS.mean(0)) ** 2, axis=1)))
    mean = configure(KR500, zeros.pulls.q[::3]).points(POINTS).mean(axis=1)
    np.testing.assert_allclose(rows.y[:, :3], each.mean(axis=1) - mean, atol=1e-12)
    np.testing.assert_allclose(rows.D[:, :3, where.shift], [np.eye(3)] * 4, atol=1e-12)
    np.testing.assert_allclose(rows.D[:, 3:, where.shift], 0.0, atol=1e-12)
    np.testing.assert_allclose(rows.D[:, 3:, where.loose], [size * np.eye(3)] * 4, atol=1e-9)
    for p in range(4):
        lever = np.stack([np.cross(axis, mean[p]) for axis in np.eye(3)], axis=1)
        np.testing.assert_allclose(rows.D[p, :3, where.loose], lever, atol=1e-9)
    np.testing.assert_array_equal(rows.N[2][:3, :3], zeros.cov[6])
    np.testing.assert_array_equal(rows.N[2][3:, 3:], turned[2])
    assert zeros.dof == 3 * 8 - 3 - 6
    assert read(4, 3).dof == 3 * 12 - 3 - 9
    assert read(4, 2).dof == 3 * 8 - 3 - 6


def test_priors_are_those_that_are_stated():
    """What is free is wide, what is held is narrow; lengths and angles as delivered."""
    zeros, where = full(), full().columns
    std = zeros.held()
    assert std[where.shift].tolist() == [10.0] * 3
    assert std[where.turn].tolist() == [1.0] * 3
    assert std[where.beside].tolist() == [1.0] * 2
    assert std[where.tool].tolist() == [5e-3] * 6
    assert std[where.masses] == pytest.approx([1e-5] * 2)
    for rest in (where.table, where.loose, where.changes):
        assert set(std[rest].tolist()) == {FIXED_STD}
    assert full(tool_std=0.02).held()[where.tool].tolist() == [0.02] * 6
    links = read(3, 2, weighs=True)
    assert set(links.held()[links.columns.links].tolist()) == {1.0}

    stated, delivered = zeros.stated, zeros.usual()
    for letter, own, one in zip(zeros.letters, stated, delivered, strict=True):
        known = 1e-4 * letter.joint if letter.name == "joint_offset" else 0.0
        assert own == pytest.approx(known)
        assert one == pytest.approx(np.hypot(2e-4, known))
    rough = replace(KR500, roughness=(3e-4, 7e-4))
    own = replace(zeros, robot=rough, joint_std=np.zeros(0))
    assert own.usual() == pytest.approx(np.where(zeros.turns, 7e-4, 3e-4))
    assert not own.stated.any()


def test_masses_changes_and_turns_are_taken_from_their_places():
    """In kilograms; changes in the order in which they stand; rotations of two origins."""
    zeros = full()
    x, where = drawn(zeros), zeros.columns
    typical = [p.typical for p in zeros.sag.parameters]
    assert zeros.masses(x) == pytest.approx([0.6 * typical[0], 1.4 * typical[1]])
    assert full(sag=None).masses(x).tolist() == []
    first = where.changes.start
    assert [(one, at.start - first, at.stop - first) for one, at in zeros.changed] == [
        (CHANGES[0], 0, 1), (CHANGES[1], 1, 7), (CHANGES[2], 7, 8), (CHANGES[3], 8, 11)
    ]  # fmt: skip
    expected = zeros.rotation @ x[where.turn] + x[where.loose]
    np.testing.assert_allclose(zeros.base_turn(x), expected)
    end = zeros.at_end
    np.testing.assert_array_equal(end[:, where.table], np.eye(len(zeros.letters)))
    labels = [letter.label for letter in zeros.letters]
    rest = end.copy()
    rest[:, where.table] = 0.0
    assert np.argwhere(rest).tolist() == [[labels.index("joint_offset:5"), first + 7]]
    assert rest.sum() == -1.0
    rail = full(changes=(MidChange(1, (1,), 2, slipped=True),))
    assert "joint_offset:1" not in labels
    assert rail.at_end[:, where.changes.start].tolist() == [0.0] * len(labels)


def test_links_deflect_the_joints_by_the_work_of_their_weight():
    """Compliance times the derivative of the potential energy, of links of usual size."""
    zeros = read(2, 2, weighs=True)
    q = zeros.pulls.q[:1]
    size = np.sqrt(sum(part**2 for part in usual(KR500)))
    size[-1] += KR500.payload_kg * np.array([1.0, 0.2, 0.2, 0.2])
    found = zeros._by_links(q)[0].reshape(7, 7, 4)

    def energy(q):
        here = configure(KR500, q[None])
        each = np.concatenate([here.origin[0][:, None], here.axes[0].swapaxes(1, 2)], axis=1)
        return -(each @ KR500.gravity) * size

    for j in range(7):
        h = 1e-5 * np.eye(7)[j]
        torque = -(energy(q[0] + h) - energy(q[0] - h)) / 2e-5
        expected = KR500.nominal_compliance[j] * torque
        np.testing.assert_allclose(found[j], expected, atol=1e-6 * np.abs(expected).max() + 1e-12)
    none = replace(zeros, robot=replace(KR500, payload_kg=None))
    assert np.isfinite(none._by_links(q)).all()
    assert read(2, 2)._bent(q).shape == (1, 7, 0)


def test_combinations_of_links_are_those_that_move_the_reflectors(monkeypatch):
    """Orthonormal, uncorrelated in the readings, and each moves them by more than a micrometre."""
    zeros = read(5, 3, weighs=True)
    V = zeros._principal
    np.testing.assert_allclose(V.T @ V, np.eye(V.shape[1]), atol=1e-9)
    here = configure(KR500, zeros.pulls.q)
    points = here.points(POINTS)[np.arange(15), zeros.target]
    Z = reach(here.twists, points[:, None])[:, :3]
    moved = (Z @ zeros._by_links(zeros.pulls.q)).reshape(45, -1)
    squares = (moved @ V).T @ (moved @ V)
    assert np.sqrt(np.diag(squares) / 15).min() > 1e-6
    correlated = squares / np.sqrt(np.outer(np.diag(squares), np.diag(squares)))
    np.testing.assert_allclose(correlated, np.eye(len(squares)), atol=1e-4)
    every = np.linalg.svd(moved, compute_uv=False) / np.sqrt(15)
    assert V.shape[1] == np.sum(every > 1e-6)
    for k in (2, 5):
        monkeypatch.setattr(module, "_UNMOVED_M", np.sqrt(every[k] * every[k + 1]))
        assert replace(zeros)._principal.shape[1] == k + 1


def test_screws_move_targets_and_turn_them():
    """V + w x p, and w below it, for each target."""
    rng = np.random.default_rng(4)
    screws, at = rng.normal(size=(2, 4, 6)), rng.normal(size=(2, 3, 3))
    found = reach(screws, at).reshape(2, 3, 6, 4)
    for m, t, k in np.ndindex(2, 3, 4):
        w, v = screws[m, k, :3], screws[m, k, 3:]
        np.testing.assert_allclose(found[m, t, :3, k], v + np.cross(w, at[m, t]))
        np.testing.assert_array_equal(found[m, t, 3:, k], w)


def measured(zeros, idle=None, repeats=2):
    """Measurements with each zero that many times, one of them not known."""
    d = np.repeat(np.arange(len(zeros.target)), repeats)
    at = zeros.at[d].copy()
    return SimpleNamespace(
        zero=d, unloaded=at, pulls=zeros.pulls, pull=d, target=zeros.target[d],
        zero_cov=zeros.cov[d], idle=idle, rotation_cov=4e-10 * np.eye(3),
        joint_std=1e-4 * np.ones(7), tool_std=3e-4, stance=None,
    )  # fmt: skip


def test_unloaded_positions_are_those_of_each_zero():
    """Once each; scaled by the scatter found, or by what no instrument is better than."""
    zeros = read(5, 2)
    data = measured(zeros)
    data.unloaded[data.zero == 3] = np.nan
    found = unloaded(KR500, zeros.tool, None, data, 1.5)
    kept = np.array([0, 1, 2, 4, 5, 6, 7, 8, 9])
    np.testing.assert_array_equal(found.at, zeros.at[kept])
    assert found.pose.tolist() == zeros.pose[kept].tolist()
    assert found.target.tolist() == zeros.target[kept].tolist()
    np.testing.assert_allclose(found.cov, 2.25 * zeros.cov[kept])
    np.testing.assert_allclose(found.rotation @ found.rotation.T, 4e-10 * np.eye(3))
    assert (found.tool_std, found.joint_std.tolist()) == (3e-4, [1e-4] * 7)
    assert found.beside.shape == (9, 3, 0)
    where = configure(KR500, found.pulls.q).points(POINTS[:2])[np.arange(9), found.target]
    np.testing.assert_allclose(found.place, (found.at - where).mean(axis=0), atol=1e-15)

    exact = unloaded(KR500, zeros.tool, None, data, 1e-9)
    rms = np.sqrt(np.mean(np.einsum("zii->zi", exact.cov)))
    assert rms == pytest.approx(module.STILL_M)
    assert unloaded(KR500, zeros.tool, None, data, np.inf) is None
    three = read(3, 2)
    assert unloaded(KR500, three.tool, None, measured(three), 1.0) is None
    assert unloaded(KR500, three.tool, None, measured(read(4, 2)), 1.0) is not None
    grown = SimpleNamespace(parting=lambda at, time: np.ones((len(at), 3, 4)))
    assert unloaded(KR500, zeros.tool, None, data, 1.0, grown).beside.shape == (9, 3, 4)
    data.stance = SimpleNamespace(errors=lambda q, names: 2 * np.ones((len(q), 3, 5)))
    both = unloaded(KR500, zeros.tool, None, data, 1.0, grown).beside
    assert both[0, 0].tolist() == [2.0] * 5 + [1.0] * 4


def test_poses_without_a_pull_are_read_unless_their_shape_is_off():
    """Behind those with pulls; one with a target moved by a millimetre is left out."""
    zeros = read(7, 3)
    pulled, rest = np.arange(12), np.arange(12, 21)
    idle = Idle(zeros.pulls.part(rest), zeros.target[rest], zeros.at[rest].copy(), zeros.cov[rest])
    idle.at.flags.writeable = True
    part = replace(
        zeros, pulls=zeros.pulls.part(pulled), pose=zeros.pose[pulled],
        target=zeros.target[pulled], at=zeros.at[pulled], cov=zeros.cov[pulled],
    )  # fmt: skip
    found = unloaded(KR500, zeros.tool, None, measured(part, idle), 1.0)
    np.testing.assert_array_equal(found.at, zeros.at)
    assert found.misshapen.tolist() == []
    off = replace(idle, at=idle.at + np.eye(9)[4][:, None] * [1e-3, 0.0, 0.0])
    found = unloaded(KR500, zeros.tool, None, measured(part, off), 1.0)
    keep = np.r_[pulled, 12, 13, 14, 18, 19, 20]
    np.testing.assert_array_equal(found.at, zeros.at[keep])
    assert found.misshapen.tolist() == [zeros.pulls.pose[15]]
    np.testing.assert_array_equal(found.cov, zeros.cov[keep])
    assert found.pulls.pose.tolist() == zeros.pulls.pose[keep].tolist()

    turned = np.stack([1e-10 * np.eye(3)] * 7)
    whole = Idle(zeros.pulls, zeros.target, zeros.at, zeros.cov, turned)
    found = unloaded(KR500, zeros.tool, None, measured(part, whole), 2.0)
    np.testing.assert_array_equal(found.at, zeros.at)
    np.testing.assert_allclose(found.turned, 4 * turned)
    off = np.zeros(found.columns.count)
    start = replace(found, place=np.zeros(3)).seen(off)[::2]
    np.testing.assert_allclose(found.place, start.mean(axis=0), atol=1e-15)


@pytest.mark.parametrize(("scale", "poses"), [(1.0, 3), (2.0, 3), (1.0, 9)])
def test_the_shape_of_a_pose_is_tested_by_chi_squared(scale, poses):
    """At one in a thousand for all poses together, in the scatter that was found."""
    std = 1e-5
    shape = _Shape(np.full((2, 2), np.nan), np.full((2, 2), np.nan))
    shape.mean.flags.writeable = shape.variance.flags.writeable = True
    shape.mean[0, 1], shape.variance[0, 1] = 0.5, 3 * std**2
    limit = stats.chi2.isf(1e-3 / poses, 1)
    for share, out in ((0.999, []), (1.001, [7])):
        far = np.sqrt(share * limit * 5 * std**2) * scale
        at = np.zeros((2 * poses, 3))
        at[1::2, 0] = 0.5
        at[1, 0] = 0.5 + far
        pulls = SimpleNamespace(pose=np.repeat(7 + np.arange(poses), 2))
        idle = SimpleNamespace(
            pulls=pulls, target=np.tile([0, 1], poses), at=at,
            cov=np.tile(std**2 * np.eye(3), (2 * poses, 1, 1)),
        )  # fmt: skip
        assert _misshapen(idle, shape, scale).tolist() == out
