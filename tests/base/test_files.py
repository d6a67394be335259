"""Files that others are writing, and folders that cannot be put in their place."""

import os

import pytest

from pipeline.base import files
from pipeline.base.errors import CannotWrite, InputError


def test_a_file_rewritten_while_it_is_read_is_refused(tmp_path):
    """Also if it is as long as before; reading it again may do."""
    path = tmp_path / "tracker.csv"
    path.write_bytes(b"1.000")
    os.utime(path, ns=(10**18, 10**18))

    def rewritten(_):
        path.write_bytes(b"2.000")

    with pytest.raises(InputError, match="changed while it was read") as refused:
        files.read(path, "tracker.csv", 100, begins=rewritten)
    assert refused.value.passing
    assert files.read(path, "tracker.csv", 100) == b"2.000"


def test_a_folder_that_cannot_be_replaced_is_still_there(tmp_path):
    """A folder without files is never made, so that nothing can take the place of the old one."""
    folder = tmp_path / "raw" / "spring"
    files.place(folder, {"joints.csv": b"1"})

    with pytest.raises(CannotWrite):
        files.place(folder, {})
    assert (folder / "joints.csv").read_bytes() == b"1"
    assert [one.name for one in folder.parent.iterdir()] == ["spring"]
