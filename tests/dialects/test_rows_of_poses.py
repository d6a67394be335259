"""Rows of a joint log that count other stops than the measured poses, in the shipped campaign."""

from pathlib import Path

import pytest

from pipeline.base.errors import InputError
from pipeline.check.findings import treated_findings
from pipeline.run import ingested
from pipeline.store.campaign import in_memory

FOLDER = Path(__file__).parents[2] / "data" / "raw" / "kr500_demo"
FILES = {path.name: path.read_bytes() for path in FOLDER.iterdir() if path.is_file()}
HEAD, *ROWS = FILES["joints.csv"].decode().splitlines()
STOPS = [row.partition(",")[2] for row in ROWS]
HOME, TRIAL = "4,0,0,0,0,90,0,1", "2.5,-60,20,30,40,-50,60,1"


def counted(stops):
    """The campaign with stops numbered in their order."""
    lines = [HEAD, *(f"{k},{one}" for k, one in enumerate(stops, 1)), ""]
    return ingested(in_memory({**FILES, "joints.csv": "\n".join(lines).encode()}))


@pytest.fixture(scope="module")
def clean():
    return ingested(in_memory(FILES))


def of_poses(case):
    """Pose and joint values of each row."""
    return case.joints[["pose", *case.joint_columns]].to_numpy().tolist()


@pytest.mark.parametrize(
    ("stops", "left"),
    [
        ([HOME, *STOPS, HOME], "lines 2, 19 as of no measured pose, and"),
        ([*STOPS[:6], STOPS[5], *STOPS[6:]], "line 8 as of no measured pose, and"),
        ([*STOPS[:9], TRIAL, *STOPS[9:]], "line 11 as of no measured pose, and"),
        ([HOME, *STOPS[:3], HOME, *STOPS[3:8], STOPS[7], *STOPS[8:]], "lines 2, 6, 12 as"),
    ],
)
def test_rows_of_other_stops_belong_to_no_pose(clean, stops, left):
    """The poses have the joint values that they have without them; the log is named."""
    case = counted(stops)

    assert of_poses(case) == of_poses(clean)
    assert any(one.startswith(f"joints.csv was read with {left}") for one in treated_findings(case))


def test_a_stop_that_was_forgotten_among_others_shifts_none(clean):
    """The pose without a row is left out, and the poses behind it have their own."""
    case = counted([HOME, *STOPS[:11], *STOPS[12:], TRIAL])

    assert of_poses(case) == [one for one in of_poses(clean) if one[0] != 12]


def test_further_rows_behind_the_measured_poses_change_nothing(clean):
    """Poses that are still to be measured shift none, and nothing is said."""
    case = counted([*STOPS, HOME, TRIAL])

    assert of_poses(case) == of_poses(clean)
    assert not [one for one in treated_findings(case) if "joints.csv" in one]


def test_two_rows_that_may_be_one_pose_are_asked_about():
    """A second stop half a millimetre beside the pose may be where it was measured."""
    *first, turn, way = STOPS[5].split(",")
    near = ",".join([*first[:-1], str(float(first[-1]) + 0.05), turn, way])
    with pytest.raises(InputError, match="lines 8 and 9 may both be the row of pose 6"):
        counted([HOME, *STOPS[:5], near, *STOPS[5:]])
