"""Joint values in encoder pulses: of a job and of a table, converted or refused in a sentence."""

import numpy as np
import pytest

from pipeline.base.errors import InputError
from pipeline.intake.files import propose
from pipeline.machine.robot import load
from pipeline.readers import logs
from pipeline.readers.export_settings import JointForm

PER_DEGREE = dict(zip("SLURBT", (1570.6, 1591.1, 1581.0, 1163.4, 1024.0, 682.7), strict=True))
DEGREES = [[-55.8, 21.6, -10.9, 89.1, 94.7, -117.7], [32.3, 5.4, -7.8, 2.7, 91.0, 146.4]]
ROBOT = load("gp180")
COUNTS = [[round(x * k) for x, k in zip(row, PER_DEGREE.values(), strict=True)] for row in DEGREES]
JOB = "\r\n".join(
    ["/JOB", "//NAME A", "//POS", "///NPOS 2,0,0,0,0,0", "///POSTYPE PULSE", "///PULSE",
     *(f"C{k:05d}={','.join(map(str, row))}" for k, row in enumerate(COUNTS)), "//INST", "NOP", ""]
).encode()  # fmt: skip
TABLE = "\n".join(
    ["No.,S,L,U,R,B,T", *(",".join(map(str, [k, *r])) for k, r in enumerate(COUNTS, 1)), ""]
).encode()


def degrees(name, data, **form):
    log = logs.joints(name, data, ROBOT, JointForm(**form))
    return log.number["pose"], np.rad2deg(np.column_stack([log.number[axis] for axis in "SLURBT"]))


@pytest.mark.parametrize(("name", "data"), [("a.jbi", JOB), ("log.csv", TABLE)])
def test_pulses_are_known_by_their_size_and_asked_for(name, data):
    """Points of a job count from 0, poses from 1; a zero in pulses is taken off."""
    said = propose({name: data})
    columns = said.joint_columns["gp180"]

    assert said.joints == name
    assert {f"{axis}_pulses" for axis in "SLURBT"} <= {*columns.values()}
    pose, found = degrees(name, data, columns=columns, pulses=PER_DEGREE)
    assert pose.tolist() == [1, 2]
    assert np.abs(found - DEGREES).max() < 1e-3
    off = PER_DEGREE | {"S": (PER_DEGREE["S"], 15706)}
    _, other = degrees(name, data, columns=columns, pulses=off)
    assert np.allclose(found[:, 0] - other[:, 0], 10.0)
    with pytest.raises(InputError, match=r"S, L, U, R, B, T are encoder pulses.*joints\.pulses"):
        degrees(name, data, columns=columns)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("between", ["   ", ";", "\t"])
def test_pulses_are_found_in_a_column_of_a_table(between):
    """Beside the dimensions of the robot."""
    rows = [[axis, "-90", "325.0", f"{axis}-90", "0.0", str(k)] for axis, k in PER_DEGREE.items()]
    lines = [between.join(row) for row in [["軸", "α", "a", "θ", "d", "パルス/度"], *rows]]
    text = "\n".join(["パルス換算(6軸)", "", *lines, "", "S 3.0E6  L 2.5E6"])

    assert propose({"log.csv": TABLE, "寸法.txt": text.encode()}).pulses == PER_DEGREE


def test_a_list_of_pulses_per_degree_is_found_and_degrees_stay_degrees():
    """From the parameters of the robot, in a file beside the log."""
    words = "Pulses per degree:\n" + "\n".join(f"{axis}  {k}" for axis, k in PER_DEGREE.items())
    plain = "\n".join(
        ["No.,S,L,U,R,B,T", *(",".join(map(str, [k, *r])) for k, r in enumerate(DEGREES, 1)), ""]
    )

    assert propose({"log.csv": TABLE, "param.txt": words.encode()}).pulses == PER_DEGREE
    assert propose({"log.csv": TABLE}).pulses == {}
    columns = propose({"log.csv": plain.encode()}).joint_columns["gp180"]
    assert columns["S"] == "S_deg"
