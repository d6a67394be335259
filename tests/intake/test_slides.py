"""A carriage whose display was written beside the forces, and a joint log of the arm alone."""

from importlib import resources

import pytest

from pipeline.intake._slides import with_slides
from pipeline.machine.robot import load
from pipeline.readers import logs

ROBOT = (resources.files("pipeline.machine.robot") / "kr500_rail_kuka.toml").read_bytes()
ARM = "pose,A1_deg,A2_deg,A3_deg,A4_deg,A5_deg,A6_deg\n0,0,-90,90,0,0,0\n"
ROWS = ["1,10,-80,70,20,30,40", "2,-15,-70,60,10,-40,30", "3,25,-60,80,-20,50,10"]
LOADS = "Posa;Quota slitta [mm];Tiro;Dinamometro [daN]\n" + "".join(
    f"{pose};{at};1;80.5\n;;2;85.5\n" for pose, at in ((1, 3928), (2, 6395), (3, 5641))
)


def files(loads=LOADS, **more):
    arm = ARM + "\n".join([*ROWS, ""])
    return {"arm.toml": ROBOT, "axes.csv": arm.encode(), "loads.csv": loads.encode(), **more}


def test_the_sliding_axis_is_that_of_the_loads():
    """Pose by pose; a row of no pose is left out, and the new log takes the place of the old."""
    found = with_slides(files())
    log = logs.joints("joints.csv", found.made, load("kr500_rail_kuka"))

    assert {*found.files} == {"arm.toml", "loads.csv", "joints.csv"}
    assert log.number["pose"].tolist() == [1, 2, 3]
    assert log.number["E1"].tolist() == pytest.approx([3.928, 6.395, 5.641])
    assert "axes.csv" in found.said[0]
    assert "Quota slitta [mm]" in found.said[0]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (";;2;85.5\n2", ";4000;2;85.5\n2"),  # two values in one pose
        ("Quota slitta [mm]", "Quota slitta"),  # no length
    ],
)
def test_a_column_that_may_be_something_else_is_not_taken(old, new):
    found = with_slides(files(LOADS.replace(old, new, 1)))

    assert found.made is None
    assert "axes.csv" in found.files


def test_a_log_that_was_written_before_is_kept():
    """It may have been corrected."""
    made = with_slides(files()).made.replace(b"3928", b"3929")
    found = with_slides(files(**{"joints.csv": made}))

    assert found.made is None
    assert found.files["joints.csv"] == made
    assert "axes.csv" not in found.files
