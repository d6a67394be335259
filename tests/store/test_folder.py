"""A campaign's folder: which files it has, when its results are valid, and what is refused."""

import json
import os
import shutil
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pytest
from filelock import FileLock

from pipeline.base.errors import CannotWrite, InputError, UsageError
from pipeline.service.current import current
from pipeline.store import campaign as store
from pipeline.store.campaign import CampaignFolder, find, in_memory, unfit

DEMO = Path(__file__).parents[2] / "data" / "raw" / "kr500_demo"
ANSWERS = {"result.json": b'{"verdict": "explained"}\n', "in/page.html": b"<p>"}


@pytest.fixture
def folder(tmp_path: Path) -> CampaignFolder:
    """A copy of the demo in a root of its own."""
    there = tmp_path / "data" / "raw" / "demo"
    shutil.copytree(DEMO, there)
    return CampaignFolder(tmp_path, there)


def changed(folder: CampaignFolder, old: str, new: str) -> None:
    """Replace words of campaign.toml."""
    path = folder.folder / "campaign.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_what_campaign_toml_names_is_read_once(folder: CampaignFolder) -> None:
    """Its files and no other, robot and key as from memory."""
    (folder.folder / "notes.csv").write_bytes(b"not named")
    raw = folder.read()
    whole = {one.name: one.read_bytes() for one in DEMO.iterdir() if one.is_file()}

    assert dict(raw.files) == whole
    assert raw.settings == folder.settings()
    assert raw.robot.name == "kr500_rail"
    assert raw.key == in_memory(whole).key
    with pytest.raises(InputError, match=r"^campaign\.toml:\d+: thing"), raw.placing():
        raise InputError("thing", "way", key=("tool", "P1"))


@pytest.mark.parametrize("file", ["campaign.toml", "joints.csv", "loads.csv", "tracker.csv"])
def test_a_result_is_valid_for_the_bytes_of_every_file(folder: CampaignFolder, file: str) -> None:
    """One more line in any of them is another key."""
    before = folder.read().key
    path = folder.folder / file
    path.write_bytes(path.read_bytes() + b"\n")

    assert folder.read().key != before


def test_a_robot_of_its_own_is_read_from_the_folder(folder: CampaignFolder) -> None:
    """Gravity of campaign.toml acts on it; without its file the robots that ship are listed."""
    own = folder.read().robot.text
    (folder.folder / "arm.toml").write_text(own)
    changed(folder, '"kr500_rail"', '"arm.toml"')
    raw = folder.read()

    assert raw.files["arm.toml"] == own.encode()
    assert raw.robot.gravity == pytest.approx(raw.settings.gravity.vector)
    (folder.folder / "arm.toml").unlink()
    with pytest.raises(InputError, match=r"^campaign\.toml"):
        folder.read()


@pytest.mark.parametrize("file", ["joints.csv", "loads.csv"])
def test_a_missing_file_is_named(folder: CampaignFolder, file: str) -> None:
    """With the way out."""
    (folder.folder / file).unlink()
    with pytest.raises(InputError, match=f"^{file}: the file is missing; copy it into demo"):
        folder.read()


def test_a_file_outside_the_folder_is_not_read(folder: CampaignFolder) -> None:
    """By a link; one within the folder is followed."""
    outside = folder.root / "outside.csv"
    shutil.copy(folder.folder / "loads.csv", outside)
    (folder.folder / "loads.csv").rename(folder.folder / "other.csv")
    (folder.folder / "loads.csv").symlink_to("other.csv")
    assert folder.content("loads.csv") == outside.read_bytes()
    (folder.folder / "loads.csv").unlink()
    (folder.folder / "loads.csv").symlink_to(outside)

    with pytest.raises(InputError, match="leads out of the campaign's folder"):
        folder.content("loads.csv")
    with pytest.raises(InputError, match="cannot be displayed"):
        folder.content("a\x1b")


def test_files_are_found_by_name_and_by_glob_in_order(folder: CampaignFolder) -> None:
    """First the order of the patterns, then by name; a name that is not there is left out."""
    for name in ("b10.txt", "b2.txt", "in/b3.txt"):
        (folder.folder / name).parent.mkdir(exist_ok=True)
        (folder.folder / name).write_bytes(b"x")

    assert folder._matching(["tracker.csv", "none.csv", "b*.txt"]) == [
        *("tracker.csv", "b10.txt", "b2.txt")
    ]
    assert folder._matching(["**/b*.txt"]) == ["b10.txt", "b2.txt", "in/b3.txt"]
    assert sorted(store.within(folder.folder, 1)) == [
        *("b10.txt", "b2.txt", "campaign.toml", "joints.csv", "loads.csv", "tracker.csv")
    ]
    assert "in/b3.txt" in store.within(folder.folder, 2)
    assert list(store.within(folder.folder, 0)) == []


def test_a_folder_with_too_many_files_is_refused(
    folder: CampaignFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files and folders count, those of inner folders too."""
    (folder.folder / "in").mkdir()
    for name in ("a", "b"):
        (folder.folder / "in" / name).touch()
    monkeypatch.setattr(store, "MOST_ENTRIES", 7)
    with pytest.raises(InputError, match="more than 7 files"):
        list(store.within(folder.folder, 2))
    assert len(list(store.within(folder.folder, 1))) == 4
    monkeypatch.setattr(store, "MOST_ENTRIES", 8)
    assert len(list(store.within(folder.folder, 2))) == 6


@pytest.mark.parametrize(
    ("name", "good"),
    [
        ("spring 2026", True),
        ("ä", True),
        ("a" * 120, True),
        ("a" * 121, False),
        ("ä" * 61, False),
        ("", False),
        (" ", False),
        (".a", False),
        ("-a", False),
        ("a/b", False),
        ("a\\b", False),
        ("a\x1b", False),
        ("plans", False),
        ("Fleet", False),
        ("x.HTML", False),
        ("plans2", True),
        ("x.html2", True),
    ],
)
def test_some_names_cannot_be_campaigns(tmp_path: Path, name: str, good: bool) -> None:
    """What shows badly, is hidden, too long, or is a name of ours; its results lie apart."""
    assert (unfit(name) is None) is good
    if good:
        one = CampaignFolder(tmp_path, tmp_path / "data" / "raw" / name)
        assert one.processed == tmp_path / "data" / "processed" / name
        assert one.reports == tmp_path / "reports" / name
        one.fit()


def test_results_of_an_unfit_folder_lie_in_one_with_a_dot(tmp_path: Path) -> None:
    """Each its own; and it is refused when it is read."""
    odd, other = (CampaignFolder(tmp_path, tmp_path / name) for name in ("-a", "-b"))

    assert odd.reports.name.startswith(".odd-")
    assert odd.reports.name == odd.processed.name != other.reports.name
    with pytest.raises(InputError, match=r"^campaign\.toml: .*rename the folder"):
        odd.read()


def finished(folder: CampaignFolder, key: str = "key") -> None:
    """Finish a run with a table and two answers."""
    pose = pa.field("pose", pa.int32(), nullable=False)
    promise = pa.schema([pose], {"table": "t", "key": "pose"})
    kept = folder.keep("01_t", pd.DataFrame({"more": [1.5, 2.5], "pose": [4, 7]}), promise)
    assert list(kept) == ["pose"]
    assert kept["pose"].tolist() == [4, 7]
    folder.finish(key, ANSWERS, {"seconds": 3})


def test_a_finished_run_is_valid_until_one_of_its_outputs_changes(folder: CampaignFolder) -> None:
    """For its key; tables and answers, each by its content."""
    assert folder.manifest() is None
    assert not folder.done("key")
    finished(folder)
    manifest = folder.manifest()

    assert folder.done("key")
    assert not folder.done("another")
    assert manifest["seconds"] == 3
    assert manifest["source"] == folder.source == "data/raw/demo"
    assert sorted(manifest["outputs"]) == [
        "data/processed/demo/01_t.parquet",
        "reports/demo/in/page.html",
        "reports/demo/result.json",
    ]
    assert sorted(folder.answers(manifest)) == sorted(ANSWERS)
    assert folder.result() == {"verdict": "explained"}
    assert folder.result_text() == ANSWERS["result.json"]
    for name in manifest["outputs"]:
        path = folder.root / name
        data = path.read_bytes()
        path.write_bytes(data + b" ")
        assert not folder.done("key")
        path.unlink()
        assert not folder.done("key")
        path.write_bytes(data)
        assert folder.done("key")


def test_a_folder_is_current_if_its_last_run_had_its_content(folder: CampaignFolder) -> None:
    """Before, and after a change, it is not; a rejection is raised, except one that passes."""
    assert not current(folder)
    finished(folder, folder.read().key)
    assert current(folder)
    changed(folder, "sigma_n = 2.0", "sigma_n = 3.0")
    assert not current(folder)
    (folder.folder / "loads.csv").unlink()
    with pytest.raises(InputError, match="missing"):
        current(folder)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"[]",
        b"{}",
        b'{"outputs": []}',
        b'{"key": 1, "outputs": {}}',
        b'{"key": "a", "outputs": {"b": 1}}',
    ],
)
def test_a_damaged_manifest_is_none(folder: CampaignFolder, content: bytes) -> None:
    """Whatever it contains."""
    folder.processed.mkdir(parents=True)
    (folder.processed / "manifest.json").write_bytes(content)

    assert folder.manifest() is None
    assert not folder.done("key")


def test_answers_are_invalid_while_they_are_replaced(
    folder: CampaignFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk is full at the second answer: no manifest says that they belong together."""
    finished(folder)
    write = store.files.write

    def full(path: Path, data: bytes) -> None:
        if path.name == "page.html":
            raise CannotWrite("full.")
        write(path, data)

    monkeypatch.setattr(store.files, "write", full)
    with pytest.raises(CannotWrite):
        folder.finish("key", ANSWERS, {})
    assert folder.manifest() is None


def test_without_a_result_the_way_to_one_is_said(folder: CampaignFolder) -> None:
    """With the name as it is typed."""
    with pytest.raises(UsageError, match="demo has no result: run `pipeline run demo` first"):
        folder.result()


def test_a_rejection_is_remembered_until_a_run_succeeds(folder: CampaignFolder) -> None:
    """With file, line and way out, for its key."""
    with pytest.raises(InputError), folder.remembering("key"):
        raise InputError("thing", "way", file="a.csv", line=3)
    kept = folder.rejection("key")
    assert str(kept) == "a.csv:3: thing; way."
    assert folder.rejection("other") is None
    with folder.remembering("key"):
        pass
    assert folder.rejection("key") is None


def test_a_lock_is_waited_for_only_if_it_is_held(folder: CampaignFolder) -> None:
    """Whoever holds it sweeps what a killed run left, in tables and reports; nobody else does."""
    finished(folder)
    left = [folder.processed / ".a.12345678", folder.reports / ".b.12345678"]
    for path in left:
        path.write_bytes(b"")
    with folder.locked() as waited:
        assert waited is False
        assert not any(path.exists() for path in left)
        assert FileLock(folder.processed / ".lock").lock_file


def test_results_of_another_folder_are_not_replaced(folder: CampaignFolder, tmp_path: Path) -> None:
    """As long as it is there: the same name in two places, under one root."""
    finished(folder)
    other = tmp_path / "elsewhere" / "demo"
    shutil.copytree(DEMO, other)
    second = CampaignFolder(tmp_path, other)

    with pytest.raises(InputError, match="rename one of the two folders"), second.locked():
        pass
    with folder.locked():
        pass
    shutil.rmtree(folder.folder)
    with second.locked():
        pass
    assert second.source == "elsewhere/demo"
    assert CampaignFolder(tmp_path / "data", other).source == other.resolve().as_posix()


def test_a_campaign_is_found_by_name_or_path(
    folder: CampaignFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Others are listed; a folder without campaign.toml is told apart from none."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data" / "raw" / "empty").mkdir()
    (tmp_path / "data" / "raw" / ".hidden").mkdir()
    shutil.copy(DEMO / "campaign.toml", tmp_path / "data" / "raw" / ".hidden")
    shutil.copytree(DEMO, tmp_path / "data" / "raw" / "b")

    assert find(tmp_path, "demo").folder == folder.folder
    assert find(tmp_path, "data/raw/b").name == "b"
    assert [one.name for one in store.every(tmp_path)] == ["b", "demo"]
    assert store.every(tmp_path / "none") == []
    for name, said in (
        ("empty", "empty has no campaign.toml; write one"),
        ("demi", 'no campaign "demi"; known under data/raw: b, demo'),
        (" ", "name of the campaign is empty"),
    ):
        with pytest.raises(InputError, match=said):
            find(tmp_path, name)
    assert store.label("data/raw/b/") == "b"
    assert store.label("") == ""


def test_two_links_are_one_campaign_and_one_that_leads_out_is_refused(
    folder: CampaignFolder, tmp_path: Path
) -> None:
    """Within data/raw a link is resolved."""
    raw = tmp_path / "data" / "raw"
    (raw / "again").symlink_to("demo")
    shutil.copytree(DEMO, tmp_path / "outside")
    (raw / "out").symlink_to(tmp_path / "outside")

    assert [one.name for one in store.every(tmp_path)] == ["demo", "out"]
    assert find(tmp_path, "again").name == "demo"
    with pytest.raises(InputError, match="out is a link that leads out of data/raw"):
        find(tmp_path, "out").read()
    assert find(tmp_path, str(tmp_path / "outside")).read().settings.name == "kr500_demo"


def test_measurements_are_not_overwritten(tmp_path: Path) -> None:
    """Nothing below data/raw, however it is written; anywhere else."""
    assert store.outside_raw(tmp_path, tmp_path / "data" / "out") == tmp_path / "data" / "out"
    for inside in (tmp_path / "data" / "raw" / "a", tmp_path / "x" / ".." / "data" / "raw" / "a"):
        with pytest.raises(UsageError, match="lies under data/raw"):
            store.outside_raw(tmp_path, inside)


def test_what_is_dumped_is_recalled(tmp_path: Path) -> None:
    """UTF-8, one final newline; never NaN; nothing of a file that is none."""
    path = tmp_path / "a.json"
    path.write_bytes(store.dump({"ä": [1.5, None]}))

    assert path.read_bytes().endswith(b"}\n")
    assert store.recalled(path) == {"ä": [1.5, None]} == json.loads(path.read_text("utf-8"))
    assert store.recalled(tmp_path / "none.json") is None
    path.write_bytes(b"{")
    assert store.recalled(path) is None
    with pytest.raises(ValueError, match="JSON"):
        store.dump({"a": float("nan")})


def test_other_code_is_another_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Content and names of all files of a package, of any kind; what Python caches does not."""
    monkeypatch.setattr(store, "__file__", str(tmp_path / "store" / "campaign.py"))
    version, seen = store.code_version.__wrapped__, []
    for name, content in (("a.py", "1"), ("a.py", "2"), ("in/b.toml", "2"), ("in/c.toml", "2")):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(content)
        seen.append(version())
    (tmp_path / "in" / "__pycache__").mkdir()
    (tmp_path / "in" / "__pycache__" / "b.pyc").write_text("3")

    assert version() == seen[-1]
    assert len({*seen}) == 4
    assert {"pipeline", "numpy", "pin", "matplotlib"} <= {*store.versions()}


def test_a_share_that_is_gone_is_said_and_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not an empty list, as a project without campaigns has."""

    def gone(path: Path) -> list[str]:
        raise PermissionError(13, "Permission denied")

    assert store.every(tmp_path) == []
    monkeypatch.setattr(store.os, "listdir", gone)
    with pytest.raises(InputError, match=r"cannot be listed \(Permission denied\)") as wrong:
        store.every(tmp_path)
    assert wrong.value.passing


@pytest.mark.parametrize(("name", "said"), [("demo", "demo"), ("in", "in/")])
def test_a_folder_that_cannot_be_listed_is_named(
    folder: CampaignFolder, name: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The campaign itself, or the one in it."""
    (folder.folder / "in").mkdir()
    scandir = os.scandir

    def closed(path: Path) -> object:
        if path.name == name:
            raise PermissionError(13, "Permission denied")
        return scandir(path)

    monkeypatch.setattr(store.os, "scandir", closed)
    with pytest.raises(InputError, match="cannot be listed") as wrong:
        list(store.within(folder.folder, 2))
    assert wrong.value.file == said


def test_a_linked_folder_is_not_entered(folder: CampaignFolder, tmp_path: Path) -> None:
    """It counts as a file; what is in it does not."""
    (tmp_path / "far").mkdir()
    (tmp_path / "far" / "a.csv").touch()
    (folder.folder / "link").symlink_to(tmp_path / "far")

    found = list(store.within(folder.folder, 3))
    assert "link" in found
    assert not any(name.startswith("link/") for name in found)
