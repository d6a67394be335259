"""Paths of poses: corrected tables, right on a robot that bends."""

import io

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from bending_robot import BendingRobot
from made_programs import frame, letters_of
from test_programs import TIP, identified

from pipeline.app import cli
from pipeline.base.errors import InputError
from pipeline.machine.robot import load
from pipeline.programs.aim import Refusal
from pipeline.programs.on_disk import CorrectionOptions, ForceFrame, write

ROBOT = load("kr500_rail")
FORCE = np.array([600.0, -800.0, -900.0])
TITLES = {
    "quaternion": ["qw", "qx", "qy", "qz"],
    "abc": ["A_deg", "B_deg", "C_deg"],
    "wpr": ["W_deg", "P_deg", "R_deg"],
}
TOOL = pin.SE3(pin.exp3(np.array([0.2, -0.3, 0.4])), np.array([0.05, -0.1, 0.35]))
BASE = pin.SE3(pin.exp3(np.array([0.1, 0.2, -0.5])), np.array([0.5, 2.0, 0.3]))
START = "3000,10,-70,100,20,40,-30"


def joints(count=6):
    """Joint values along a path, shape (count, 7)."""
    t = np.linspace(0, 1, count)[:, None]
    axes = np.deg2rad([10, -70, 100, 20, 40, -30]) + 0.2 * t * np.array([1, -1, 1, 2, -1, 1])
    return np.hstack([3.0 + t, axes]) @ ROBOT.controller_matrix.T + ROBOT.controller_offset


def numbers(pose, letters):
    """A pose as the options write it, in mm and degrees."""
    return [*(1e3 * pose.translation), *letters_of(pose.rotation, letters)]


def option(pose, letters):
    """The same as text."""
    return ",".join(repr(float(value)) for value in numbers(pose, letters))


def table(bending, letters, tool, base, **more):
    """A path of poses, its carriage in metres, its force in columns."""
    q = joints()
    rows = [numbers(base.inverse() * bending.flange(one) * tool, letters) for one in q]
    out = pd.DataFrame(rows, columns=["x_mm", "y_mm", "z_mm", *TITLES[letters]])
    out.insert(0, "pose", range(1, len(q) + 1))
    out["E1_m"] = q[:, 0]
    for name, value in zip(("fx_n", "fy_n", "fz_n"), FORCE, strict=True):
        out[name] = value
    return out.assign(**more)


@pytest.fixture
def correct(tmp_path):
    """Correct a table with the model of a KR500 on its rail; the answer as a table."""
    bending = identified(tmp_path, ROBOT)

    def corrected(rows, **given):
        (tmp_path / "path.csv").write_text(rows.to_csv(index=False))
        written, remarks = write(
            tmp_path,
            ROBOT.name,
            tmp_path / "path.csv",
            given=CorrectionOptions(**{"start": START} | given),
        )
        answer = pd.read_csv(io.BytesIO(written.read_bytes()))
        assert answer.pop("corrected").str.startswith("Corrected for the load by pipeline").all()
        return answer, remarks

    corrected.bending, corrected.root = bending, tmp_path
    return corrected


def left(bending, found, letters, tool, base):
    """How far the loaded tool is from the path when the corrected poses are commanded [m]."""
    out = []
    for q, row in zip(joints(), found.iloc, strict=True):
        values = row[["x_mm", "y_mm", "z_mm", *map(str.lower, TITLES[letters])]].to_numpy(float)
        wanted = base * frame(letters, values) * tool.inverse()
        here = bending.loaded(bending.commanded(wanted, q), FORCE, tool.translation) * tool
        out.append(np.linalg.norm(here.translation - (bending.flange(q) * tool).translation))
    return np.array(out)


def test_no_row_of_a_path_moves_farther_than_is_plausible(correct):
    """Each row beyond --max-offset is refused with its line; its shift is the deflection."""
    rows = table(correct.bending, "abc", pin.SE3.Identity(), pin.SE3.Identity())
    found, _ = correct(rows)
    limit = found["deflection_mm"].median()
    beyond = np.flatnonzero(found["deflection_mm"] > limit)

    with pytest.raises(Refusal) as refused:
        correct(rows, max_offset_mm=limit)
    assert [one.line for one in (*refused.value.others, refused.value)] == (beyond + 2).tolist()
    joint_rows = pd.DataFrame(
        joints(), columns=[f"{j.name}_{'m' if j.prismatic else 'rad'}" for j in ROBOT.joints]
    )
    forces = rows[["fx_n", "fy_n", "fz_n"]]
    with pytest.raises(Refusal, match=r"path\.csv:7: pose 6 would move by"):
        correct(pd.concat([rows["pose"], joint_rows, forces], axis=1), max_offset_mm=1e-3)


@pytest.mark.parametrize("letters", TITLES)
def test_corrected_poses_are_where_the_path_is(correct, letters):
    """In any letters, with a tool and a frame: the loaded tool follows the path to micrometres."""
    given = {"tool": [option(TOOL, letters)], "base": [option(BASE, letters)]}
    found, remarks = correct(table(correct.bending, letters, TOOL, BASE), **given)

    assert (found["deflection_mm"] > 0.5).all()
    assert left(correct.bending, found, letters, TOOL, BASE).max() < 1e-5
    assert "6 points: the load moves the tip by up to" in remarks[0]
    assert (found["d_r1_m"] == 0).all()


def test_without_a_tool_the_load_point_is_the_tip(correct):
    """As of a path of joint values: coordinates are those of the campaign's load point in F_b."""
    tool = pin.SE3(np.eye(3), TIP)
    rows = table(correct.bending, "abc", tool, pin.SE3.Identity())
    found, _ = correct(rows)
    shift = found[["x_mm", "y_mm", "z_mm"]].to_numpy() - rows[["x_mm", "y_mm", "z_mm"]].to_numpy()

    assert left(correct.bending, found, "abc", tool, pin.SE3.Identity()).max() < 1e-5
    assert shift == pytest.approx(found[["dx_mm", "dy_mm", "dz_mm"]].to_numpy(), abs=5e-3)


def test_units_are_those_of_the_titles(correct):
    """Metres and radians in, metres and radians out: the same correction."""
    rows = table(correct.bending, "abc", TOOL, BASE)
    given = {"tool": [option(TOOL, "abc")], "base": [option(BASE, "abc")]}
    usual, _ = correct(rows, **given)
    other = rows.rename(columns={f"{a}_mm": f"{a}_m" for a in "xyz"})
    other = other.rename(columns={f"{a}_deg": f"{a}_rad" for a in "ABC"})
    other[["x_m", "y_m", "z_m"]] *= 1e-3
    other[["A_rad", "B_rad", "C_rad"]] = np.deg2rad(other[["A_rad", "B_rad", "C_rad"]])
    found, _ = correct(other, **given)

    assert found[["x_m", "y_m", "z_m"]].to_numpy() == pytest.approx(
        1e-3 * usual[["x_mm", "y_mm", "z_mm"]].to_numpy(), abs=2e-7
    )
    assert found["b_rad"].to_numpy() == pytest.approx(np.deg2rad(usual["b_deg"]), abs=2e-7)


def test_axes_in_the_table_say_which_configuration_is_meant(correct):
    """Beside the pose they are where it is looked for; without them and a start it is asked."""
    rows = table(correct.bending, "abc", TOOL, BASE)
    given = {"tool": [option(TOOL, "abc")], "base": [option(BASE, "abc")], "start": None}
    axes = (joints() - ROBOT.controller_offset) @ np.linalg.inv(ROBOT.controller_matrix).T
    near = {f"A{k}_deg": np.rad2deg(axes[:, k]) + 2.0 for k in range(1, 7)}
    found, _ = correct(rows.assign(**near), **given)

    assert left(correct.bending, found, "abc", TOOL, BASE).max() < 1e-5
    with pytest.raises(Refusal, match=r"path.csv:7: pose 6: .* arm configurations reach it"):
        correct(rows, **given)


def test_a_constant_force_and_one_in_the_tool_frame(correct):
    """--force stands for three columns, in either frame; both at once are refused."""
    rows = table(correct.bending, "abc", TOOL, BASE)
    given = {"tool": [option(TOOL, "abc")], "base": [option(BASE, "abc")]}
    usual, _ = correct(rows, **given)
    bare = rows.drop(columns=["fx_n", "fy_n", "fz_n"])
    constant, _ = correct(bare, force="600,-800,-900", **given)
    turned = [(correct.bending.flange(q) * TOOL).rotation.T @ FORCE for q in joints()]
    in_tool, _ = correct(
        bare.assign(**dict(zip(("fx_n", "fy_n", "fz_n"), np.transpose(turned), strict=True))),
        frame=ForceFrame.TOOL,
        **given,
    )

    pd.testing.assert_frame_equal(constant, usual)
    pd.testing.assert_frame_equal(in_tool, usual, atol=2e-6)
    with pytest.raises(InputError, match=r"path.csv: has forces of its own; leave --force away"):
        correct(rows, force="1,2,3", **given)
    with pytest.raises(InputError, match="there is no column fx_n"):
        correct(bare, **given)


def test_a_path_of_joints_takes_a_constant_force_in_the_tool_frame(correct):
    """The same offsets as from columns in F_b that mean it."""
    q = joints()
    names = [joint.name for joint in ROBOT.joints]
    rows = pd.DataFrame(np.hstack([q[:, :1], np.rad2deg(q[:, 1:])]), range(1, 7),
                        [f"{names[0]}_m", *(f"{name}_deg" for name in names[1:])])  # fmt: skip
    rows = rows.rename_axis("pose").reset_index()
    local = np.array([0.0, 300.0, -900.0])
    turned = np.array([(correct.bending.flange(one) * TOOL).rotation @ local for one in q])
    given = {"tool": [option(TOOL, "abc")], "start": None}
    found, _ = correct(rows, force="0,300,-900", frame=ForceFrame.TOOL, **given)
    usual, _ = correct(
        rows.assign(fx_n=turned[:, 0], fy_n=turned[:, 1], fz_n=turned[:, 2]), **given
    )

    pd.testing.assert_frame_equal(found, usual, atol=2e-6)
    assert found["deflection_mm"].min() > 0.3
    moved = q + np.hstack(
        [found[["d_r1_m"]], np.deg2rad(found[[f"d_{name}_deg" for name in names[1:]]])]
    )
    for one, other, force in zip(q, moved, turned, strict=True):
        there = correct.bending.flange(one) * TOOL
        here = correct.bending.loaded(other, force, TOOL.translation) * TOOL
        assert np.linalg.norm(here.translation - there.translation) < 1e-5


def test_every_row_out_of_reach_is_said_and_nothing_is_written(correct, capsys):
    """Exit code 5, a line of the file for each, no file beside the path."""
    rows = table(correct.bending, "abc", TOOL, BASE)
    rows.loc[[1, 3], "x_mm"] += 9000.0
    (correct.root / "path.csv").write_text(rows.to_csv(index=False))
    words = ["compensate", ROBOT.name, str(correct.root / "path.csv"), "--start", START]
    words += ["--tool", option(TOOL, "abc"), "--base", option(BASE, "abc")]
    code = cli._exit_code([*words, "--root", str(correct.root)])
    seen = capsys.readouterr()

    assert code == 5
    assert [line.split(": ")[0] for line in seen.err.splitlines()] == ["path.csv:3", "path.csv:5"]
    assert "the robot cannot reach it" in seen.err
    assert not (correct.root / "path-compensation.csv").exists()


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        (lambda rows: rows.drop(columns="A_deg"), r"path.csv: has places without orientation; add"),
        (lambda rows: rows.drop(columns="E1_m"), "there is no column E1_m"),
        (lambda rows: rows.assign(B_deg=["1", "2", "x", "4", "5", "6"]), r"path.csv:4: "),
        (lambda rows: rows.iloc[:0], "no row in it"),
    ],
)
def test_a_path_with_a_hole_is_refused(correct, change, wrong):
    """What is missing is named with file and line."""
    with pytest.raises(InputError, match=wrong):
        correct(change(table(correct.bending, "abc", TOOL, BASE)))


def test_the_truth_of_these_tests_bends(correct):
    """The robot that carries the paths out gives way by a millimetre, and by nothing unloaded."""
    robot = BendingRobot(ROBOT, correct.bending.stiffness)
    q = joints()[0]
    moved = robot.loaded(q, FORCE, TIP).translation - robot.flange(q).translation

    assert 3e-4 < np.linalg.norm(moved) < 5e-3
    assert robot.loaded(q, 0 * FORCE, TIP).translation == pytest.approx(robot.flange(q).translation)
