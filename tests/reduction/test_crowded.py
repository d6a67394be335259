"""A pose with pulls by the hundred: computed up to a bound, refused beyond it at once."""

import csv
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from pipeline.app.cli import _exit_code

KEPT = Path(__file__).parents[2] / "data" / "raw" / "fanuc_r2000ic"


@pytest.fixture
def crowded(tmp_path):
    """A function that pulls so often in the first pose of the kept campaign."""

    def make(pulls):
        rng = np.random.default_rng(3)
        folder = tmp_path / "data" / "raw" / "m"
        shutil.copytree(KEPT, folder)
        for name, first in (("displacements.csv", 3), ("forces.csv", 2)):
            head, *rows = csv.reader((folder / name).read_text("utf-8").splitlines())
            (one,) = [row for row in rows if row[0] == "1"]
            more = [
                [
                    one[0],
                    str(k + 1),
                    *one[2:first],
                    *(
                        f"{float(c) * (1 + k / pulls) + rng.normal(0, 3e-5):.9f}"
                        for c in one[first:]
                    ),
                ]
                for k in range(pulls)
            ]
            with (folder / name).open("w", newline="") as file:
                csv.writer(file).writerows([head, *more, *(r for r in rows if r[0] != "1")])
        return tmp_path

    return make


def test_more_pulls_than_are_computed_are_refused_at_once(crowded, capsys):
    """500 took longer than anybody waits."""
    root, began = crowded(500), time.monotonic()

    assert _exit_code(["run", "m", "--engine", "local", "--root", str(root)]) == 5
    assert time.monotonic() - began < 60
    assert "pose 1 has 500 displacements" in capsys.readouterr().err


@pytest.mark.slow
def test_a_hundred_pulls_in_a_pose_are_computed(crowded, unseen):
    """In a time that grows little faster than their number, against the same pose with a fifth."""
    taken = []
    for pulls in (20, 100):
        root, began = crowded(pulls), time.process_time()
        assert _exit_code(["run", "m", "--engine", "local", "--root", str(root)]) == 0
        taken.append(time.process_time() - began)
        shutil.rmtree(root / "data")

    assert taken[1] < 5**1.25 * taken[0], taken
