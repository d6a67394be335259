"""Fractions of a second in a time."""

from datetime import datetime

import pytest

from pipeline import readers


@pytest.mark.parametrize(
    ("cell", "microseconds"),
    [("08:00:08.5", 500_000), ("08:00:08.25", 250_000), ("08:00:08.005", 5_000)],
)
def test_a_fraction_of_a_second_counts_from_its_first_digit(cell, microseconds):
    """.5 is half a second, in a file whose other times have none."""
    rows = [f"P1;03.11.2026 {cell};1;2;3", "P2;03.11.2026 08:00:09;1;2;3"]
    text = "\n".join(["Name;Time;X [mm];Y [mm];Z [mm]", *rows])
    export = readers.read("t", text.encode())

    first, second = export.time.to_pylist()
    assert first == datetime(2026, 11, 3, 8, 0, 8, microseconds)
    assert second == datetime(2026, 11, 3, 8, 0, 9)
