"""Folders as other people hand them over: letters, lists and exports beside each other."""

from pipeline.intake._prose import PROSE, is_prose
from pipeline.intake.files import propose

LETTER = b"""Hello everybody,

enclosed is everything from yesterday, the tracker files and the log of the scale.
The reflectors are in the flange frame, measured in the drawing office last week:
    R1  X 160  Y 120  Z 205
    R2  X -150  Y 135  Z 205
A1 about -Z   A2 about +Y   A3 about +Y   A4 about -X   A5 about +Y   A6 about -X
The truck was in the hall during the break, I believe it touched nothing.
Pose 12 was taken from the second spot, and the force is in the log only.
"""
LOG = b"pose,repeat,force_n,remark\n" + b"".join(
    b"%d,1,%d,somebody stopped beside the robot here\n" % (k, 700 + k) for k in range(1, 9)
)


def test_a_letter_is_neither_log_nor_export():
    """Though it names axes, poses, forces and some points."""
    found = propose({"letter.txt": LETTER, "loads.csv": LOG})

    assert found.refused == {"letter.txt": PROSE}
    assert (found.loads, found.joints, found.exports) == ("loads.csv", None, ())


def test_a_log_with_long_remarks_is_no_letter():
    assert not is_prose("loads.csv", LOG)
    assert not is_prose("p.src", b"&ACCESS RVP\nDEF STIFF( )\nPTP {A1 0,A2 -90,A3 90}\nEND\n")
