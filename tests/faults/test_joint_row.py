"""A wrong row of the joint log: poses aligned by scipy, with and without the pose."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize
from scipy.spatial.transform import Rotation
from small_case import moved, small

from pipeline.faults import joint_row
from pipeline.faults.joint_row import _laid, _moved, _read, wrong_rows
from pipeline.machine.robot import configure
from pipeline.reduction.register import XYZ

OFF = 4e-3
"""Displacement of the reflectors by the wrong row of pose 4, approximately [m]."""


def logged(case, pose, joint, amount):
    """Another value for one joint of one pose."""
    joints = case.joints.copy()
    joints.loc[joints["pose"] == pose, case.joint_columns[joint]] += amount
    return replace(case, joints=joints)


@pytest.fixture(scope="module")
def case():
    """Seven poses of a robot with a tool wrong by 0.2 mm."""
    return small(6, poses={"count": 7}, hidden={"tool_sd_m": 2e-4})


@pytest.fixture(scope="module")
def wrong(case):
    """The rail of pose 4 logged 4 mm too far."""
    return logged(case, 4, 0, OFF)


def by_scipy(case, poses):
    """Sum of squares [m^2], R, t and effector points, from unloaded readings of some poses."""
    rows = case.readings
    rows = rows[(rows["state"] == "unloaded") & rows["target"].isin(case.settings.measured)]
    rows = rows[rows["pose"].isin(poses)]
    every = np.array(sorted(poses))
    target = np.array([case.settings.measured.index(name) for name in rows["target"]])
    at = np.searchsorted(every, rows["pose"].to_numpy(int))
    seen, nominal = rows[XYZ].to_numpy(float), case.tool.points
    frames = configure(case.robot, case.q(every))
    whole = frames.points(nominal)[at, target]
    # initial pose of the tracker: from six points far apart
    turn, _ = Rotation.align_vectors(seen - seen.mean(axis=0), whole - whole.mean(axis=0))
    start, centre = turn.as_matrix(), whole.mean(axis=0)

    def left(x):
        points = frames.points(nominal + x[6:].reshape(-1, 3))[at, target] - centre
        R = Rotation.from_rotvec(x[:3]).as_matrix() @ start
        return (seen - seen.mean(axis=0) - x[3:6] - points @ R.T).ravel()

    got = optimize.least_squares(left, np.zeros(6 + nominal.size), xtol=1e-14, ftol=1e-14)
    R = Rotation.from_rotvec(got.x[:3]).as_matrix() @ start
    t = seen.mean(axis=0) + got.x[3:6] - R @ centre
    return 2 * got.cost, R, t, got.x[6:].reshape(-1, 3), len(seen)


EVERY = [1, 2, 3, 4, 5, 6, 7]


def test_the_table_is_laid_as_scipy_lays_it(wrong):
    """Base and effector points from all poses, and from those that remain."""
    read = _read(wrong)
    for out in ([], [3]):
        kept = [pose for k, pose in enumerate(EVERY) if k not in out]
        found, (_, R, t, off, _) = _laid(read, out), by_scipy(wrong, kept)
        np.testing.assert_allclose(found.R, R, atol=1e-7)
        np.testing.assert_allclose(found.t, t, atol=2e-6)
        np.testing.assert_allclose(found.off, off, atol=1e-7)
        far = read.seen - found.away  # predicted position of every reading
        here = configure(wrong.robot, wrong.q(np.array(EVERY))).points(wrong.tool.points)
        where = here[read.pose, read.target] @ R.T + t
        assert np.abs(far - where).max() < 2e-3


@pytest.mark.parametrize("out", [[], [3]])
def test_a_pose_stands_as_far_off_as_fits_without_it_say(wrong, out):
    """Drop of the sum of squares without it, and residuals of the others, by coordinate."""
    found = _laid(_read(wrong), out)
    kept = [pose for k, pose in enumerate(EVERY) if k not in out]
    whole, *_, n = by_scipy(wrong, kept)

    for k in (0, 3, 5):
        mine = 3 * 6  # three reflectors, two zeros
        if k in out:
            more, *_, count = by_scipy(wrong, EVERY)
            drop, left, dof = more - whole, whole, 3 * n - 15
            assert count == n + 6
        else:
            less, *_ = by_scipy(wrong, [pose for pose in kept if pose != EVERY[k]])
            drop, left, dof = whole - less, less, 3 * n - 15 - mine
        assert found.stands[k] == pytest.approx(np.sqrt(drop / mine), rel=0.01)
        assert found.usual[k] == pytest.approx(np.sqrt(left / dof), rel=0.01)


def test_only_the_wrong_row_stands_apart(wrong, case):
    """Ten times the others, and at least a millimetre."""
    assert np.flatnonzero(_laid(_read(wrong), [3]).apart).tolist() == [3]
    assert not _laid(_read(case), []).apart.any()
    laid = _laid(_read(case), [])
    by_ten = replace(laid, usual=np.full(7, 1e-3), stands=np.linspace(9.7e-3, 10.3e-3, 7))
    assert by_ten.apart.tolist() == [False] * 3 + [False] + [True] * 3
    least = replace(
        laid, usual=np.full(7, 1e-6), stands=1e-3 / np.sqrt(3) * np.linspace(0.9, 1.2, 7)
    )
    assert least.apart.tolist() == [False] * 3 + [True] * 4


def test_a_wrong_row_is_named_with_how_far_it_is_off(wrong):
    """4 mm of the rail: file, pose, size, and a campaign without the pose."""
    (found,) = wrong_rows(wrong)

    line = wrong.joints.loc[wrong.joints["pose"] == 4, "line"].iloc[0]
    assert found.where == "joints.csv pose04"
    assert f"joints.csv:{line}" in found.evidence
    assert found.size == pytest.approx(OFF, rel=0.05)
    assert found.before == pytest.approx(1e3 * found.size)
    assert found.after < 0.5
    right = found.correct(wrong)
    assert 4 not in set(right.joints["pose"]) | set(right.loads["pose"])
    assert set(right.readings["pose"].dropna()) == {1, 2, 3, 5, 6, 7}
    assert right.readings["pose"].isna().sum() == wrong.readings["pose"].isna().sum()
    assert wrong_rows(right) == []


def test_a_weaker_wrong_row_beside_a_gross_one_is_named_when_few_are_wrong(case):
    """At most one of four poses may be wrong: one of seven, two of nine."""
    two = logged(logged(case, 4, 0, OFF), 6, 1, np.deg2rad(1.0))
    assert wrong_rows(two) == []

    nine = small(6, poses={"count": 9})
    two = logged(logged(nine, 4, 0, 20e-3), 6, 1, np.deg2rad(1.0))

    assert [f.where for f in wrong_rows(two)] == ["joints.csv pose04", "joints.csv pose06"]


def test_with_five_poses_no_row_is_tested(case):
    """Five must agree to test a sixth; one reflector does not determine a pose."""
    six = replace(case, readings=case.readings[case.readings["pose"].ne(7).fillna(True)])
    six = logged(six, 4, 0, 20e-3)
    five = replace(six, readings=six.readings[six.readings["pose"].ne(6).fillna(True)])

    assert [f.where for f in wrong_rows(six)] == ["joints.csv pose04"]
    assert wrong_rows(five) == []


def test_readings_that_moved_in_some_states_only_are_no_wrong_row(case):
    """The zeros of a pose are elsewhere but its pulls are not: the log is right."""
    rows = case.readings
    here = (rows["pose"] == 4) & rows["target"].isin(case.settings.measured)
    here = here.fillna(False).to_numpy(bool)
    zeros = here & (rows["state"] == "unloaded").to_numpy()
    one = zeros & (rows["group"] == "pose04_rep0_unloaded").to_numpy()
    shift = np.array([6e-3, -4e-3, 5e-3])

    assert [f.where for f in wrong_rows(moved(case, here, shift))] == ["joints.csv pose04"]
    assert wrong_rows(moved(case, zeros, shift)) == []
    assert wrong_rows(moved(case, one, shift)) == []


def test_where_two_logged_rows_are_alike_the_other_is_told(case):
    """Pose 4 repeats the row of pose 2."""
    joints = case.joints.copy()
    columns = case.joint_columns
    joints.loc[joints["pose"] == 4, columns] = joints.loc[joints["pose"] == 2, columns].to_numpy()

    (found,) = wrong_rows(replace(case, joints=joints))

    assert "repeats that of pose 2" in found.evidence


DUE = np.array([[0.2, 0.05, 0.1], [-0.12, 0.19, 0.1], [-0.1, -0.18, 0.2]])


def turned(angle, shift=(0.0, 0.0, 0.0)):
    return DUE @ Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix().T + np.array(shift)


@pytest.mark.parametrize(
    ("seen", "said"),
    [
        (turned(0.0, (8e-3, 0, 6e-3)), True),
        (turned(0.05, (2e-2, 0, 0)), True),
        (DUE[[1, 0, 2]], False),
        (DUE + np.diag([1.0, 0.0, 0.0]) * 1e-2, False),
        (turned(0.0, (1e-2, 0, 0)) + 4e-3 * np.array([[0, 0, 1], [0, 1, 0], [0, -1, 0]]), False),
        (DUE[:1] + 1e-2, False),
    ],
    ids=["shifted", "turned", "names exchanged", "one reading", "not rigid", "one reflector"],
)
def test_an_effector_moves_as_a_whole_or_not_at_all(seen, said):
    """With its own names, rigidly, and more than one reflector."""
    far = np.linalg.norm(seen - DUE[: len(seen)], axis=1)
    size = float(np.sqrt(np.mean(far**2)))

    assert _moved(seen, DUE[: len(seen)], size, 1e-5) is said


def test_a_rough_robot_is_not_held_to_rigidity():
    """The residual may be ten times that of the other poses."""
    seen = turned(0.0, (1e-2, 0, 0)) + 4e-3 * np.array([[0, 0, 1], [0, 1, 0], [0, -1, 0]])

    assert not _moved(seen, DUE, 1e-2, 1e-5)
    assert _moved(seen, DUE, 1e-2, 1e-3)
    assert not _moved(seen, DUE, 3e-2, 1e-3)  # these moved less than the stated size of the pose


def test_poses_read_last_have_an_alibi_where_the_base_moved_too(wrong, monkeypatch):
    """A tracker knocked before them; not if the base agrees, nor for a pose read earlier."""
    read, p = _read(wrong), [1.0]
    real = joint_row.register
    monkeypatch.setattr(
        joint_row,
        "register",
        lambda *args: replace(real(*args), chi2=1e3 if p[0] < 1e-3 else 0.0),
    )

    assert not joint_row._knocked(wrong, read, [6])
    p[0] = 0.0
    assert joint_row._knocked(wrong, read, [6])
    assert joint_row._knocked(wrong, read, [5, 6])
    assert not joint_row._knocked(wrong, read, [3])
    assert not joint_row._knocked(wrong, read, [4, 6])
    assert not joint_row._knocked(wrong, read, [])
