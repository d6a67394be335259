"""Whole folders put in their place at once."""

import os
import shutil
from pathlib import Path

import pytest

from pipeline.library.folders import replace_folder

ELSEWHERE = Path("/dev/shm")


def test_a_folder_on_a_disk_of_its_own_is_filled(tmp_path):
    """As data/raw on a server's share is; nothing is left beside it."""
    if not ELSEWHERE.is_dir() or ELSEWHERE.stat().st_dev == tmp_path.stat().st_dev:
        pytest.skip("there is no second file system here")
    share = ELSEWHERE / f"raw-{os.getpid()}"
    share.mkdir()
    try:
        (tmp_path / "raw").symlink_to(share)
        for content in (b"1", b"2"):
            replace_folder(tmp_path / "raw" / "spring", {"joints.csv": content, "deep/a": b""})

        assert (share / "spring" / "joints.csv").read_bytes() == b"2"
        assert [one.name for one in share.iterdir()] == ["spring"]
    finally:
        shutil.rmtree(share)


def test_a_folder_is_placed_whole(tmp_path: Path) -> None:
    """The old content is gone, nothing else is beside it."""
    for content in ({"a": b"1", "in/b": b"2"}, {"a": b"3"}):
        replace_folder(tmp_path / "f", content)

        found = {
            str(one.relative_to(tmp_path / "f")): one.read_bytes()
            for one in (tmp_path / "f").rglob("*")
            if one.is_file()
        }
        assert found == content
        assert [one.name for one in tmp_path.iterdir()] == ["f"]
