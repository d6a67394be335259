"""Predicted positions as CSV: what another program reads back."""

import csv
import io

import numpy as np
import pytest

from pipeline.library.targets import PredictedTargets
from pipeline.programs.points_file import as_csv

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
