"""Predicted positions as CSV: what another program reads back."""

import csv
import io

import numpy as np
import pytest

from pipeline.base.errors import InputError
from pipeline.library.targets import PredictedTargets
from pipeline.machine.robot import load
from pipeline.programs.points_file import as_csv, read_points

NAMES = np.array(['P "1"', "tool, 2"], dtype=object)


def predicted(moved=0.0):
    """Two rows of two targets; the second turns by a tenth about z."""
    at = np.arange(12.0).reshape(2, 2, 3) / 7
    turn = np.tile(np.eye(3), (2, 2, 1, 1))
    turn[:, 1, :2, :2] = [[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]]
    cov = np.tile(np.diag([4e-10] * 3 + [9e-10] * 3), (2, 2, 1, 1))
    return PredictedTargets(at, turn, cov, np.full((2, 2, 3), moved), np.full((2, 2, 3), 1e-5))


def read(text):
    """Rows by title."""
    return list(csv.DictReader(io.StringIO(text)))


def test_positions_and_names_come_back():
    """To a nanometre, row by row, whatever stands in a name; without loads there is no motion."""
    rows = read(as_csv(NAMES, np.zeros(2, bool), predicted()))

    assert [one["target"] for one in rows] == [*NAMES, *NAMES]
    assert [one["row"] for one in rows] == ["1", "1", "2", "2"]
    found = [[float(one[f"{axis}_m"]) for axis in "xyz"] for one in rows]
    assert found == pytest.approx(predicted().at.reshape(4, 3), abs=1e-9)
    assert float(rows[0]["std_x_m"]) == pytest.approx(2e-5)
    assert "dx_m" not in rows[0]
    assert "rz_rad" not in rows[0]


def test_orientation_is_empty_where_a_target_has_none():
    """A reflector beside a probe, and the motion under load of both."""
    first, second, *_ = read(as_csv(NAMES, np.array([False, True]), predicted(2e-4)))

    assert first["rz_rad"] == first["std_rz_rad"] == ""
    assert float(second["rz_rad"]) == pytest.approx(0.1)
    assert float(second["std_rz_rad"]) == pytest.approx(3e-5)
    assert float(first["dx_m"]) == pytest.approx(2e-4)


@pytest.mark.parametrize(("angle", "refused"), [(184.9, False), (187.0, True), (-187.0, True)])
def test_nothing_is_predicted_far_beyond_a_limit(angle, refused):
    """The first joint turns by 185 degrees; a controller's limit may be a degree more."""
    robot = load("kr500_rail")
    titles = [f"{one.name}_{'m' if one.prismatic else 'deg'}" for one in robot.joints]
    row = "2,{},0,0,0,0,0"
    data = "\n".join([",".join(titles), row.format(0), row.format(angle)]).encode()
    if refused:
        with pytest.raises(InputError, match="beyond the limits") as told:
            read_points("q.csv", data, robot, ())
        assert (told.value.file, told.value.line) == ("q.csv", 3)
    else:
        q = read_points("q.csv", data, robot, ())[0]
        assert q[1, 1] == pytest.approx(np.deg2rad(angle))
