"""A growing folder: complete lines only, and no file that an editor has open."""

import pytest

from pipeline.base.errors import InputError
from pipeline.live import complete_lines


def test_a_line_that_is_still_being_written_waits(tmp_path):
    (tmp_path / "tracker.csv").write_bytes(b"group,target\npose01,P1\npose01,P")

    assert complete_lines.snapshot(tmp_path) == {"tracker.csv": b"group,target\npose01,P1\n"}


def test_a_first_line_without_an_end_is_no_table_yet():
    assert complete_lines.whole_lines("tracker.csv", b"group,tar") == b""


@pytest.mark.parametrize("name", ["log.xlsx", "campaign.toml"])
def test_a_file_that_no_instrument_appends_to_is_read_whole(name):
    assert complete_lines.whole_lines(name, b"PK\x03\x04 no line") == b"PK\x03\x04 no line"


def test_carriage_returns_end_lines_as_well():
    assert complete_lines.whole_lines("a.txt", b"one\rtwo\rthr") == b"one\rtwo\r"


def test_locks_of_spreadsheets_are_no_files_of_the_campaign(tmp_path):
    for name in ("~$log.xlsx", ".hidden", "log.csv.tmp", "log.csv~"):
        (tmp_path / name).write_bytes(b"x")

    assert complete_lines.snapshot(tmp_path) == {}


def test_a_folder_of_thousands_of_files_is_no_campaign(tmp_path, monkeypatch):
    monkeypatch.setattr(complete_lines, "_MOST", 2)
    for k in range(3):
        (tmp_path / f"{k}.csv").write_bytes(b"")

    with pytest.raises(InputError, match="holds 3 files"):
        complete_lines.snapshot(tmp_path)
