"""Shifted readings: as many as asked for, by as much, in the lines that are said; and the count."""

import numpy as np
import pytest

from bench.cliff import CAMPAIGN, Row, Spoilt, shifted, table


@pytest.mark.parametrize("many", [1, 30])
def test_so_many_loaded_readings_are_shifted_by_so_much(many):
    tracker = (CAMPAIGN / "tracker.csv").read_bytes()

    spoilt, lines = shifted(tracker, Spoilt(many, 4.0, 7))

    pairs = zip(tracker.decode().splitlines(), spoilt.decode().splitlines(), strict=True)
    differ = {n: (old, new) for n, (old, new) in enumerate(pairs, start=1) if old != new}
    assert set(differ) == lines
    assert len(lines) == many
    for old, new in differ.values():
        a, b = (np.array(line.split(",")[2:5], float) for line in (old, new))
        assert np.linalg.norm(b - a) == pytest.approx(4.0, abs=1e-3)
        assert "_loaded,P" in new


def test_silent_is_what_fits_with_more_than_one_reading_left_in():
    rows = [
        Row(4, 1.0, "adequate", 2, 0),
        Row(4, 1.0, "adequate", 3, 0),
        Row(4, 1.0, "unexplained", 0, 1),
        Row(10, 1.0, "bad_data", 10, 0),
    ]

    said = table(rows)

    assert said[1].split()[:6] == ["4", "3", "5", "of", "12", "1"]
    assert said[-1].startswith("silent 1 of 4")
