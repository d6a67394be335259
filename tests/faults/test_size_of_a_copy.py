"""A copied row of the joint log: the size of the finding, in its unit."""

import csv
import itertools
from pathlib import Path

import numpy as np
from test_exchanged import case, table, written

from pipeline.faults.dead_sensor import _one_pose

RAW = Path(__file__).parents[2] / "data/raw/kr500_demo"


def test_poses_that_one_row_was_copied_into_are_apart_in_millimetres():
    """As the export has it, in mm: no less than the largest distance, nor than its diagonal."""
    made = {one.name: one.read_bytes() for one in RAW.iterdir()}
    head, rows = table(made, "joints.csv")
    rows[:4] = [[row[0], *rows[0][1:]] for row in rows[:4]]
    copied = {f"pose{int(row[0]):02d}" for row in rows[:4]}

    (found,) = _one_pose(case(written(made, "joints.csv", head, rows)))

    at = {}
    for row in csv.DictReader(made["tracker.csv"].decode().splitlines()):
        if row["group"][:6] in copied and "unloaded" in row["group"]:
            x, y, z = (float(v) for k, v in row.items() if k in ("x_mm", "y_mm", "z_mm"))
            at.setdefault(row["target"], []).append((x, y, z))
    apart = max(
        np.linalg.norm(np.subtract(a, b))
        for places in at.values()
        for a, b in itertools.combinations(places, 2)
    )
    assert found.unit == "mm"
    assert 0.99 * apart < found.before < 3**0.5 * apart
