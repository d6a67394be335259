"""Reading and writing: all or nothing, and what is said of a file that cannot be used."""

import errno
import os
import re
import stat
from pathlib import Path

import pytest

from pipeline.base import files
from pipeline.base.errors import CannotWrite, InputError


def test_a_file_is_replaced_whole_and_nothing_is_left_beside_it(tmp_path: Path) -> None:
    """Folders are made on the way; permissions follow the umask, as of any program."""
    path = tmp_path / "a" / "b" / "c.bin"
    before = os.umask(0o027)
    try:
        files.write(path, b"old")
        files.write(path, b"new")
    finally:
        os.umask(before)

    assert path.read_bytes() == b"new"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert [one.name for one in path.parent.iterdir()] == ["c.bin"]


def test_a_write_that_fails_leaves_the_old_file_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk is full at the last moment: old content, no leftover, and a way out."""
    path = tmp_path / "c.bin"
    files.write(path, b"old")

    def full(*paths: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(files.os, "replace", full)
    with pytest.raises(CannotWrite, match=r"No space left.*free some space"):
        files.write(path, b"new")
    assert path.read_bytes() == b"old"
    assert [one.name for one in tmp_path.iterdir()] == ["c.bin"]


@pytest.mark.parametrize(
    ("number", "says"),
    [
        (errno.ENOSPC, "cannot be written (full); free some space"),
        (errno.EDQUOT, "cannot be written (full); free some space"),
        (errno.EACCES, "x cannot be used (full); get the permission"),
        (errno.EROFS, "x cannot be used (full); get the permission"),
        (errno.EIO, None),
    ],
)
def test_only_what_the_user_can_change_is_said(number: int, says: str | None) -> None:
    """A full or closed disk; any other error is one of the program."""
    found = files.refused(OSError(number, "full", "x"))

    assert (found is None) if says is None else (says in str(found))
    assert files.refused(ValueError("x")) is None


def test_a_file_in_the_way_of_a_folder_is_named(tmp_path: Path) -> None:
    """The one above that is no folder, not the file that was to be written."""
    (tmp_path / "a").write_bytes(b"")
    with pytest.raises(CannotWrite, match=f"{re.escape(str(tmp_path / 'a'))} is no folder"):
        files.write(tmp_path / "a" / "b" / "c", b"")


def test_only_unfinished_files_are_swept(tmp_path: Path) -> None:
    """At any depth; files with other names and folders stay."""
    kept = ("a.csv", ".hidden", ".a.csv.1234567", "in/b.csv")
    gone = (".a.csv.12345678", "in/.b.csv.abcdef01")
    for name in (*kept, *gone):
        files.write(tmp_path / name, b"")
    (tmp_path / ".c.12345678").mkdir()

    assert {str(one.relative_to(tmp_path)) for one in files.leftovers(tmp_path)} == {*gone}
    files.sweep(tmp_path)
    left = {str(one.relative_to(tmp_path)) for one in tmp_path.rglob("*") if one.is_file()}
    assert left == {*kept}
    assert (tmp_path / ".c.12345678").is_dir()


def test_a_file_is_read_up_to_its_bound(tmp_path: Path) -> None:
    """As many bytes as allowed, and not one more; its first bytes are looked at before the rest."""
    path, seen = tmp_path / "a.csv", []
    path.write_bytes(b"x" * 5000)

    assert files.read(path, "a.csv", 5000, begins=seen.append) == b"x" * 5000
    assert seen == [b"x" * 4096]
    with pytest.raises(InputError, match=r"^a\.csv: has .* more than .* that are read"):
        files.read(path, "a.csv", 4999)


def test_what_cannot_be_read_is_said_with_its_name(tmp_path: Path) -> None:
    """Missing, a folder, a pipe, a name with a null byte; none of these is tried again."""
    os.mkfifo(tmp_path / "pipe")
    own = InputError("the file is gone", "copy it", file="b")
    for name, said in (
        ("b", "no such file"),
        ("", "cannot be read"),
        ("pipe", "a device or a pipe"),
    ):
        with pytest.raises(InputError, match=f"^its name: .*{said}") as wrong:
            files.read(tmp_path / name, "its name", 10**6)
        assert not wrong.value.passing
    with pytest.raises(InputError) as wrong:
        files.read(tmp_path / "b\0", "b", 10, own)
    assert wrong.value is own


def test_a_file_that_grows_while_it_is_read_is_tried_again(tmp_path: Path) -> None:
    """A row is added, or one replaced, between the first bytes and the last."""
    path = tmp_path / "a.csv"
    for more in (b"abcdef", b"xyz"):
        path.write_bytes(b"abc")
        os.utime(path, ns=(0, 0))
        with pytest.raises(InputError, match="changed while it was read") as wrong:
            files.read(path, "a.csv", 10, begins=lambda _, more=more: path.write_bytes(more))
        assert wrong.value.passing


def test_a_text_is_utf8_with_or_without_a_mark() -> None:
    """The mark is no part of it; another encoding is refused with the way out."""
    for data in ("ä1".encode(), "ä1".encode("utf-8-sig")):
        assert files.text(data, "a") == "ä1"
    with pytest.raises(InputError, match="a: is not UTF-8; save it as UTF-8"):
        files.text("ä".encode("latin-1"), "a")


def test_a_hash_is_that_of_the_standard() -> None:
    """FIPS 180-2, appendix B.1."""
    assert files.sha256(b"abc").startswith("ba7816bf8f01cfea414140de5dae2223")
