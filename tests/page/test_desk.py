"""The folder of a campaign as a page fills it: names, archives, what has changed."""

import io
import os
import subprocess
import zipfile
from concurrent.futures import ThreadPoolExecutor

import pytest

from pipeline.base.errors import UsageError
from pipeline.page import desk as module
from pipeline.page.desk import Desk, named


@pytest.fixture
def desk(tmp_path):
    made = Desk(tmp_path, "hall")
    made.folder.mkdir(parents=True)
    return made


def archive(**inside):
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as made:
        for name, content in inside.items():
            made.writestr(name.replace("!", "/"), content)
    return data.getvalue()


@pytest.mark.parametrize(
    "name",
    [
        "",
        ".env",
        "..",
        "a/b",
        "a\\b",
        "a\0b",
        "a\nb",
        "x" * 121,
        "a.",
        "a ",
        "\u202egpj.exe",
        'a"b',
    ],
)
def test_a_name_that_is_none_is_refused(name):
    """Nothing leaves the folder, hides in it, or reads otherwise than it is."""
    with pytest.raises(UsageError, match="plain name"):
        named(name)


def test_two_campaigns_do_not_read_alike(tmp_path):
    """A name with its accents apart, or in capitals, is one for some systems, and for people."""
    Desk(tmp_path, "\u00c9lan").begun()
    Desk(tmp_path, "\u00c9lan").begun()
    for alike in ("E\u0301lan", "\u00e9lan"):
        with pytest.raises(UsageError, match="another campaign is called \u00c9lan: open it"):
            Desk(tmp_path, alike).begun()


@pytest.mark.parametrize(
    "name", ["tracker.csv", "Zugkraft Halle 7.xlsx", "Müller.txt", "a..b", "P1 (2).csv"]
)
def test_names_that_people_give_are_names(name):
    """Blanks, umlauts, brackets."""
    assert named(name) == name


def test_a_file_that_is_dropped_twice_is_there_once(desk):
    """The same bytes are nothing new; others of that name are asked about."""
    assert desk.taken("a.csv", b"1") == ["a.csv"]
    assert desk.taken("a.csv", b"1") == []
    assert desk.taken("m\u00e4.csv", b"1") == ["m\u00e4.csv"]
    for name in ("a.csv", "A.CSV", "ma\u0308.csv"):  # a, with dots of its own
        with pytest.raises(UsageError, match="replace it"):
            desk.taken(name, b"2")
    desk.removed("m\u00e4.csv")
    assert desk.taken("a.csv", b"2", instead=True) == ["a.csv"]

    assert (desk.folder / "a.csv").read_bytes() == b"2"
    assert desk.names() == ["a.csv"]


def test_two_tabs_do_not_replace_each_others_file(desk):
    """Both drop one name at once: one is taken, the other is asked, ten times."""
    with ThreadPoolExecutor(2) as tabs:
        for k in range(10):
            both = [tabs.submit(desk.taken, f"{k}.csv", bytes([n]) * 10**6) for n in range(2)]
            asked = [isinstance(one.exception(), UsageError) for one in both]

            assert sorted(asked) == [False, True]


def test_files_lie_however_deep(desk):
    """Below 1200 folders, more than a function of Python may call itself."""
    at = os.open(desk.folder, os.O_RDONLY)
    for _ in range(1200):
        os.mkdir("d", dir_fd=at)
        at, above = os.open("d", os.O_RDONLY, dir_fd=at), at
        os.close(above)
    os.close(at)
    try:
        assert desk.taken("a.csv", b"1") == ["a.csv"]
        assert desk.names() == ["a.csv"]
    finally:
        subprocess.run(["rm", "-rf", desk.folder / "d"], check=True)  # Python's own calls itself


def test_a_campaign_toml_of_megabytes_is_neither_taken_nor_read(desk):
    """A page of it would keep all others waiting."""
    with pytest.raises(UsageError, match="more than 1 MB"):
        desk.taken("campaign.toml", b"#" * (2**20 + 1))
    (desk.folder / "campaign.toml").write_bytes(b"#" * (2**20 + 1))
    with pytest.raises(UsageError, match="more than 1 MB"):
        desk.text()


def test_an_archive_is_its_files(desk):
    """Without their folders, what systems add, and archives within it."""
    data = archive(
        **{"x!a.csv": "1", "x!y!b.csv": "2", "__MACOSX!x": "3", ".DS_Store": "4", "in.zip": "5"}
    )

    assert sorted(desk.taken("all.ZIP", data)) == ["a.csv", "b.csv"]
    assert desk.names() == ["a.csv", "b.csv"]


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"no archive", "cannot be unpacked"),
        (archive(**{"a.csv": "0" * 200_000})[:-300], "cannot be unpacked"),
        (archive(**{"x!a.csv": "1", "y!A.csv": "2"}), "two files"),
        (archive(**{f"f{k}.csv": "1" for k in range(501)}), "500 files"),
        (archive(**{"a.csv": b"\0" * 3_000_000}), "more than 1 MB"),
        (archive(**{f"{k}.csv": b"\0" * 600_000 for k in "ab"}), "more than 1 MB"),
    ],
    ids=["no archive", "cut", "names alike", "many", "one too large", "two too large"],
)
def test_an_archive_that_is_none_leaves_nothing(desk, monkeypatch, data, why):
    """Damaged, ambiguous, or growing beyond all bounds as it is unpacked."""
    monkeypatch.setattr(module, "MOST_BYTES", 2**20)

    with pytest.raises(UsageError, match=why):
        desk.taken("bomb.zip", data)
    assert desk.names() == []


def test_what_an_archive_says_of_its_sizes_is_not_believed(desk, monkeypatch):
    """Sizes are counted as it is read."""
    monkeypatch.setattr(module, "MOST_BYTES", 2**20)
    data = bytearray(archive(**{"a.csv": b"\0" * 3_000_000}))
    true = (3_000_000).to_bytes(4, "little")
    data = bytes(data).replace(true, (10).to_bytes(4, "little"))

    with pytest.raises(UsageError):
        desk.taken("liar.zip", data)
    assert desk.names() == []


def test_a_link_is_no_file_of_the_campaign(desk, tmp_path):
    """What it leads to is neither shown nor read nor removed."""
    (tmp_path / "secret").write_text("x")
    (desk.folder / "secret").symlink_to(tmp_path / "secret")

    assert desk.names() == []
    with pytest.raises(UsageError, match="no file"):
        desk.removed("secret")


def test_a_change_elsewhere_is_not_overwritten(desk):
    """Two windows, or the terminal: who wrote last is not undone without a word."""
    desk.taken("campaign.toml", b"a = 1\n")
    seen = desk.digest("campaign.toml")
    desk.written("a = 2\n", seen)

    with pytest.raises(UsageError, match="changed elsewhere"):
        desk.written("a = 3\n", seen)
    assert desk.text() == "a = 2\n"


def test_any_change_is_seen(desk):
    """Content, name, one more, one less."""
    desk.taken("a.csv", b"1")
    seen = {desk.digest()}
    for change in (
        lambda: desk.taken("b.csv", b"1"),
        lambda: desk.taken("b.csv", b"2", instead=True),
        lambda: desk.removed("a.csv"),
        lambda: (desk.folder / "b.csv").rename(desk.folder / "c.csv"),
    ):
        change()
        assert desk.digest() not in seen
        seen.add(desk.digest())


def test_files_of_folders_below_belong_to_the_campaign(desk, tmp_path):
    """A campaign that was begun in the terminal: a change in `FARO/` is a change."""
    below = desk.folder / "FARO" / "day 1"
    below.mkdir(parents=True)
    (below / "P01.txt").write_text("1")
    (desk.folder / ".git").mkdir()
    (desk.folder / ".git" / "config").write_text("x")
    (desk.folder / "out").symlink_to(tmp_path)
    before = desk.digest()

    assert desk.names() == ["FARO/day 1/P01.txt"]
    assert desk.file("FARO/day 1/P01.txt") == below / "P01.txt"
    with pytest.raises(UsageError, match="no file"):
        desk.file("FARO/../out")
    (below / "P01.txt").write_text("2")
    assert desk.digest() != before
    desk.copied(Desk(tmp_path, "other"))
    assert Desk(tmp_path, "other").names() == desk.names()
