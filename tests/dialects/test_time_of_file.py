"""Times of files whose rows have none: the moment in their headings."""

import pytest

from pipeline import readers
from pipeline.answer import contract
from pipeline.answer.words import noise_told
from pipeline.dialects.times_of_day import on_days
from pipeline.readers import ExportSettings

BY_FILE = ExportSettings(groups="files", unit="mm")


def group(name, *heading):
    rows = [f"{k}\t{k},1\t{k},2\t{k * k},3" for k in range(1, 4)]
    text = "\n".join([*(f"# {line}" for line in heading), "#", "Name\tX\tY\tZ", *rows, ""])
    return readers.read(f"day/{name}.txt", text.encode(), BY_FILE)


def times(exports):
    return {n: str(one.time[0].as_py()) for n, one in on_days(exports, None).items()}


@pytest.mark.parametrize(
    ("line", "time"),
    [
        ("Exportiert: 11.03.2025 08:23:00", "2025-03-11 08:23:00"),
        ("Gemessen am 11.03.2025, 08:23", "2025-03-11 08:23:00"),
        ("saved 2025-03-11T08:23:00", "2025-03-11 08:23:00"),
        ("relevé;23/10/2024 09:04:31", "2024-10-23 09:04:31"),
        ("mesuré le 08/10/2024 09:04:31", "1900-01-01 09:04:31"),  # August or October
        ("version 11.03.2025 of the program", "None"),
        ("IP 10.0.11.03 08:23:00", "None"),
    ],
)
def test_a_moment_above_the_rows_is_their_time(line, time):
    found = group("P1", "Job: RTH-2214", line)

    assert {str(one) for one in found.time.to_pylist()} == {time}
    assert bool(found.settled) == (time != "None")


def test_two_moments_are_none():
    """The day of the job and that of the export: which of them is the measurement is not said."""
    found = group("P1", "Job: 10.03.2025 17:00:00", "Export: 11.03.2025 08:23:00")

    assert found.time.null_count == len(found.time)


@pytest.mark.parametrize(("groups", "times"), [(None, 0), ("files::groups", 2)])
def test_groups_in_one_file_have_a_common_time_if_it_is_one_of_several(groups, times):
    text = b"# 11.03.2025 08:23:00\nGroup;Target;X [mm];Y [mm];Z [mm]\nA;1;1;2;3\nB;1;1;2;4\n"

    found = readers.read("all.txt", text, ExportSettings(groups=groups))

    assert len(found.time) - found.time.null_count == times


def test_files_written_at_once_have_no_times():
    """Nine readings take longer than the four seconds in which the files were written."""
    late = {k: group(k, f"Exportiert: 11.03.2025 17:30:0{k}") for k in range(1, 4)}
    own = {k: group(k, f"Exportiert: 11.03.2025 08:{k}3:00") for k in range(1, 4)}

    assert {*times(late).values()} == {"None"}
    assert "all written at once" in on_days(late, None)[1].settled[0]
    assert times(own)[2] == "2025-03-11 08:23:00"


@pytest.mark.parametrize(
    ("seconds", "words"), [(300.0, "The instrument"), (None, "Consecutive rows")]
)
def test_a_wander_names_no_duration_without_a_clock(seconds, words):
    size = contract.Amplitude(name="s_wander", value=1e-4, std=None, unit="m")
    time = contract.Amplitude(name="correlation_time", value=seconds, std=None, unit="s")
    cause = contract.Cause.model_construct(name="tracker_wander", parameters=(size, time))
    (said,) = noise_told([cause])

    assert said.startswith(words)
    assert (" min" in said) == (seconds is not None)
