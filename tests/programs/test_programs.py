"""Robot programs of four makers: corrected, nothing else changed, and right on a robot that bends.

The programs are made by `made_programs`, the robot that carries them out by `bending_robot`.
"""

import re
from decimal import Decimal

import numpy as np
import pinocchio as pin
import pytest
from bending_robot import BendingRobot
from made_programs import Abb, Fanuc, Kuka, Ur, frame, on_a_rail

from pipeline.library import model_file
from pipeline.machine.cell import Tool, paper_cell
from pipeline.machine.robot import load
from pipeline.prediction import model as handover
from pipeline.prediction.model import IdentifiedModel
from pipeline.programs.on_disk import CorrectionOptions, program

TIP = np.array([0.1, 0.0, 0.2])
FORCE = {"ur10e": [30.0, -20.0, -40.0]}
ROBOTS = {
    "kuka": (Kuka, load("kr210_r2700_2"), load("kr500_rail")),
    "abb": (Abb, load("irb6640"), on_a_rail("irb6640", "track")),
    "fanuc": (Fanuc, load("fanuc_r2000ic"), on_a_rail("fanuc_r2000ic")),
    "ur": (Ur, load("ur10e"), load("ur10e")),
}


class Known:
    """Springs that are known to a thousandth."""

    def __init__(self, robot):
        self.value = np.array([1 / joint.typical_stiffness for joint in robot.joints])
        self.cov = np.diag((1e-3 * self.value) ** 2)


def identified(root, robot):
    """A campaign of a robot after its run, as `compensate` finds it; its springs are exact."""
    folder = root / "data" / "raw" / robot.name
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "campaign.toml").touch()
    reports = root / "reports" / robot.name
    reports.mkdir(parents=True, exist_ok=True)
    cell = paper_cell(robot, Tool.of({"load_point": TIP, "P1": TIP}))
    reason = {"model": "joint_springs", "data": "as_given", "reason": "adequate"}
    part = handover.part(1.0, cell, Known(robot))
    model = IdentifiedModel(robot.name, "adequate", reason, (part,), None, 1e-5)
    (reports / "model.toml").write_text(model_file.dumps(model), "utf-8")
    return BendingRobot(robot, 1 / Known(robot).value)


def off(bending, made, letters, point, numbers, force):
    """How far the loaded tool is from where the point was taught [m], and in turn [rad]."""
    tool = frame(letters, made.tools[point.tool]) if point.tool else pin.SE3(np.eye(3), TIP)
    wanted, commanded = (
        standing(bending, made, letters, point, one, tool) for one in (point.numbers, numbers)
    )
    there = bending.flange(wanted) * tool
    here = bending.loaded(commanded, force, tool.translation) * tool
    return np.linalg.norm(here.translation - there.translation), np.linalg.norm(
        pin.log3(there.rotation.T @ here.rotation)
    )


def standing(bending, made, letters, point, numbers, tool):
    """Joint values that a controller takes for the numbers of a point."""
    if point.kind != "joint":
        base = frame(letters, made.bases[point.base])
        return bending.commanded(base * frame(letters, numbers) * tool.inverse(), point.q)
    axes = np.array(numbers) * (1.0 if letters == "vector" else np.pi / 180)
    robot = bending.robot
    given = [1e-3 * point.external, *axes] if robot.prismatic.any() else axes
    return robot.controller_matrix @ np.array(given) + robot.controller_offset


def unstamped(data):
    """A corrected program without what it says of itself, which has to be there."""
    remark = rb"(?:[;!#] Corrected for the load by|[ \d]*:  !\|)[^\r\n]*[\r\n]+"
    plain = re.sub(remark, b"", data)
    assert plain != data
    return plain


FEW, MORE = list(range(8)), range(8, 30)
"""Programs of each maker in every run of the tests, and in the slow ones."""


def decimals(text):
    """Decimals of a number; of its mantissa where it has an exponent."""
    return len(re.split("[eE]", text)[0].partition(".")[2])


def step(text, kind, k, letters):
    """How far half a unit of the last digit of a number moves the tip [m]."""
    last = 10.0 ** Decimal(text).as_tuple().exponent / 2
    if kind == "joint":
        return 3.5 * last * (1.0 if letters == "vector" else np.pi / 180)
    return last * (1.0 if letters == "vector" else 1e-3) if k < 3 else 0.0


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", FEW + [pytest.param(k, marks=pytest.mark.slow) for k in MORE])
@pytest.mark.parametrize("maker", ROBOTS)
def test_only_coordinates_differ_and_they_cancel_the_deflection(maker, seed, tmp_path):
    """Every other byte stays; on the bending robot the corrected program is where it was taught."""
    make, *robots = ROBOTS[maker]
    robot = robots[seed % 2]
    bending = identified(tmp_path, robot)
    made = make(seed, robot, bending).make()
    force = np.array(FORCE.get(robot.name, [600.0, -800.0, -900.0]))
    given = CorrectionOptions(force=",".join(map(str, force)), partial=True, **made.options)
    for name in made.files:
        (tmp_path / name).write_bytes(made.data(name))
    corrected = 0
    for name in made.files:
        data, _ = program(tmp_path, robot.name, tmp_path / name, given)
        data = unstamped(data)
        found, before = made.numbers(name, data), made.numbers(name, made.data(name))

        assert found is not None, data.decode(made.encoding)
        for k, texts in found.items():
            point = made.points[k]
            old = [decimals(one) for one in before[k]]
            new = [decimals(one) for one in texts]
            assert all(b == a or a < b <= 6 for a, b in zip(old, new, strict=True)), texts
            numbers = [float(text) for text in texts]
            letters = make.letters
            raw, _ = off(bending, made, letters, point, point.numbers, force)
            left, turn = off(bending, made, letters, point, numbers, force)
            rounding = sum(step(t, point.kind, i, letters) for i, t in enumerate(texts))
            assert raw > 2e-4
            assert left < 0.01 * raw + rounding, (before[k], texts)
            assert turn < 1e-4
            corrected += 1

    assert corrected == len(made.points)
