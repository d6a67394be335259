"""The command line around a campaign: names, exit codes, disks, locks, what is said and how."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import without_pages
from filelock import FileLock
from first_poses import written

from pipeline.answer import archive
from pipeline.answer.contract import Rejected
from pipeline.app import cli
from pipeline.app.outcome import sentences
from pipeline.base import files
from pipeline.base.errors import CannotWrite, worst
from pipeline.simulate import Plan, simulate
from pipeline.store import campaign as campaigns

PROJECT = Path(__file__).parents[2]
KEPT = PROJECT / "data" / "raw" / "fanuc_r2000ic"


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A project with one campaign that is done."""
    root = tmp_path_factory.mktemp("finished")
    written(root / "data" / "raw" / "c")
    with without_pages():
        assert cli._exit_code(["run", "--engine", "local", "--root", str(root)]) == 0
    return root


@pytest.fixture
def done(finished, tmp_path):
    """A copy of that project."""
    return shutil.copytree(finished, tmp_path / "project")


@pytest.fixture
def fresh(tmp_path):
    """A project with one campaign that was never run."""
    shutil.copytree(KEPT, tmp_path / "data" / "raw" / "c")
    return tmp_path


@pytest.fixture
def say(capsys):
    """Type a command; its exit code, stdout and stderr."""

    def typed(root, *words):
        capsys.readouterr()
        code = cli._exit_code([*words, "--root", str(root)])
        return code, *capsys.readouterr()

    return typed


def edit(path, old, new):
    """Replace some text that is there."""
    text = path.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new), "utf-8")


@pytest.mark.whole
def test_a_folder_of_the_same_name_elsewhere_replaces_nothing(done, say, tmp_path):
    """It is refused with the way out, for as long as the first folder is there."""
    other = shutil.copytree(KEPT, tmp_path / "elsewhere" / "c")
    edit(other / "campaign.toml", "format = 1", "format = 1 # another measurement")
    before = {p: p.read_bytes() for p in (done / "reports").rglob("*") if p.is_file()}

    code, _, err = say(done, "run", str(other), "--engine", "local")
    shutil.rmtree(done / "data" / "raw" / "c")

    assert code == 5
    assert "rename one of the two folders" in err
    assert {p: p.read_bytes() for p in (done / "reports").rglob("*") if p.is_file()} == before
    with campaigns.find(done, str(other)).locked():
        pass


@pytest.mark.parametrize("command", ["run", "check"])
def test_a_campaign_has_the_name_of_its_folder_however_it_is_typed(
    command, fresh, say, monkeypatch
):
    """`.`, a path and the name give the same word in a failure as in a success."""
    folder = fresh / "data" / "raw" / "c"
    (folder / "joints.csv").unlink()
    monkeypatch.chdir(folder)

    for typed in (".", "../c/", str(folder), "c"):
        code, out, err = say(fresh, command, typed, "--json")

        assert code == 5
        assert json.loads(out)["campaign"] == "c"
        assert err.startswith("c: ")


def test_an_empty_name_is_told(fresh, say):
    """Nobody hears of a folder without campaign.toml whose name is empty."""
    code, _, err = say(fresh, "run", "", "--engine", "local")

    assert code == 5
    assert "name of the campaign is empty" in err


@pytest.mark.whole
def test_who_waits_says_so_and_ctrl_c_has_a_sentence(fresh):
    """A real process behind the lock of another run: it says what it waits for; SIGINT is 130."""
    lock = fresh / "data" / "processed" / "c" / ".lock"
    lock.parent.mkdir(parents=True)
    command = [sys.executable, "-m", "pipeline", "run", "c", "--engine", "local", "--root", fresh]
    with FileLock(lock):
        waiting = subprocess.Popen(command, cwd=PROJECT, stderr=subprocess.PIPE, text=True)
        first = waiting.stderr.readline()
        waiting.send_signal(signal.SIGINT)
        rest = waiting.communicate(timeout=60)[1]

    assert first == "c: another run is processing this campaign; waiting for it.\n"
    assert waiting.returncode == 130
    assert rest.splitlines() == ["Interrupted; run it again to go on, nothing half-written counts."]


@pytest.mark.whole
def test_who_waited_looks_again_before_computing(done, monkeypatch):
    """What the other run finished meanwhile is taken as it is."""
    from pipeline import run

    campaign = campaigns.find(done, "c")
    answers = [None, "found after waiting"]
    monkeypatch.setattr(archive, "done", lambda campaign, key: answers.pop(0))
    monkeypatch.setattr(campaigns.CampaignFolder, "_acquired_late", lambda self, lock: True)

    assert run.run(campaign) == "found after waiting"


@pytest.mark.parametrize(
    ("codes", "code"),
    [([5, 1, 0], 1), ([0, 5, 4], 5), ([4, 0], 4), ([0, 0], 0), ([], 0), ([5, 3], 3), ([3, 1], 1)],
)
def test_the_exit_code_is_the_gravest(codes, code):
    """Our own fault before a disk before rejected input before a misfit."""
    assert worst(codes) == code


def test_status_of_nothing_says_so(tmp_path, say):
    """An empty project is no error, and no silence."""
    code, out, err = say(tmp_path, "status")

    assert (code, out) == (0, "")
    assert "there is no campaign" in err
    assert "pipeline init" in err


@pytest.mark.whole
def test_status_of_a_campaign_that_cannot_be_read_is_5(done, say):
    """Its sentence comes with the exit code of `run`, and with what its report is worth."""
    edit(done / "data" / "raw" / "c" / "campaign.toml", "format = 1", "format = 9")
    code, out, err = say(done, "status")

    assert code == 5
    assert "c: rejected" in out
    assert "index.html is of an earlier input" in err


@pytest.mark.whole
def test_a_report_of_an_earlier_input_is_told(done, say):
    """By `status` when the input changed, by `run` when it was rejected."""
    report = str(done / "reports" / "c" / "index.html")
    assert say(done, "status")[1].rstrip().endswith(report)
    joints = done / "data" / "raw" / "c" / "joints.csv"
    joints.write_text("no table at all")

    code, out, _ = say(done, "status")
    ran, line, err = say(done, "run", "--engine", "local", "--json")

    assert (code, ran) == (0, 5)
    assert "changed" in out
    assert out.rstrip().endswith(f"{report} (of an earlier input or program)")
    assert f"{report} is of an earlier input" in err
    assert json.loads(line)["earlier_report"] == report


@pytest.mark.whole
def test_status_remembers_why_the_last_run_rejected_these_files(done, say):
    """Until one of them changes or a result comes."""
    joints = done / "data" / "raw" / "c" / "joints.csv"
    good = joints.read_text()
    joints.write_text("no table at all")
    ran, _, said = say(done, "run", "--engine", "local")
    code, out, err = say(done, "status")
    joints.write_text("no table at all, but another one")
    other = say(done, "status")
    joints.write_text(good)
    again = say(done, "run", "--engine", "local")

    assert (ran, code) == (5, 5)
    assert "rejected" in out
    assert err == said
    assert (other[0], again[0], say(done, "status")[0]) == (0, 0, 0)
    assert "changed" in other[1]


def test_a_finished_project_is_only_read(done, say):
    """`run` with nothing to do and `status` write nothing, not even a lock."""
    for lock in done.rglob(".lock"):
        lock.unlink()
    before = {p: p.stat().st_mtime_ns for p in done.rglob("*")}

    assert say(done, "run")[0] == 0
    assert say(done, "status")[0] == 0
    assert {p: p.stat().st_mtime_ns for p in done.rglob("*")} == before


@pytest.mark.parametrize("engine", ["local", "prefect"])
def test_a_file_in_the_way_of_our_folders_is_named(engine, fresh, say):
    """Exit 3, one sentence with the file and the way out, no request to report it."""
    (fresh / "data" / "processed").write_text("")
    (fresh / ".prefect").write_text("")
    code, _, err = say(fresh, "run", "--engine", engine)

    assert code == 3
    way = "data/processed" if engine == "local" else ".prefect"
    assert f"{fresh / way} is no folder, move it out of the way" in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("number", "way_out"),
    [(errno.ENOSPC, "free some space"), (errno.EACCES, "permission"), (errno.EROFS, "--root")],
)
def test_a_disk_that_refuses_has_a_way_out(number, way_out, tmp_path, monkeypatch):
    """The path that was to be written, what the system says, and what to do."""

    def refuse(handle):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(CannotWrite, match=way_out) as told:
        files.write(tmp_path / "a" / "b.txt", b"x")

    assert str(tmp_path / "a" / "b.txt") in str(told.value)
    assert list((tmp_path / "a").iterdir()) == []


def test_a_lock_that_cannot_be_made_is_no_crash(fresh, say, monkeypatch):
    """A folder without the permission to write."""

    def refuse(self, *given, **named):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(FileLock, "acquire", refuse)
    code, _, err = say(fresh, "run", "--engine", "local")

    assert code == 3
    assert "get the permission" in err


@pytest.mark.parametrize(
    "odd", [b"[]", b"{}", b"7", b'{"key": 1, "outputs": {}}', b'{"key": "x"}', b"\xff\xfe", b"{"]
)
def test_an_odd_manifest_counts_as_none(odd, done, say):
    """Whoever edited it gets a new run, not a crash."""
    (done / "data" / "processed" / "c" / campaigns.MANIFEST).write_bytes(odd)
    campaign = campaigns.find(done, "c")

    assert campaign.manifest() is None
    assert not campaign.done("x")
    assert say(done, "status")[0] == 0


def test_a_robot_file_in_another_encoding_is_told(fresh, say):
    """The file and the way out."""
    folder = fresh / "data" / "raw" / "c"
    edit(folder / "campaign.toml", '"fanuc_r2000ic"', '"mine.toml"')
    (folder / "mine.toml").write_bytes("description = 'Größe'".encode("latin-1"))
    code, _, err = say(fresh, "check", "c")

    assert code == 5
    assert "mine.toml: is not UTF-8; save it as UTF-8." in err


def test_init_with_an_unknown_robot_blames_the_option(tmp_path, say):
    """There is no campaign.toml yet that could be wrong."""
    code, _, err = say(tmp_path, "init", "new", "--robot", "nope")

    assert code == 2
    assert '--robot: there is no robot "nope"' in err
    assert "campaign.toml" not in err
    assert not (tmp_path / "data").exists()


def test_init_takes_the_names_that_run_takes(tmp_path, say):
    """Blanks and quotes are fine in a folder's name, and in its campaign.toml."""
    code, out, _ = say(tmp_path, "init", 'cell 7 "new"')
    folder = Path(out.strip())

    assert code == 0
    assert folder.name == 'cell 7 "new"'
    assert campaigns.find(tmp_path, folder.name).content("campaign.toml")
    assert "base_frame" not in say(tmp_path, "check", folder.name)[2]
    for wrong in ("a/b", ".a", "", " ", "a\nb", ".."):
        assert say(tmp_path, "init", wrong)[0] == 2


TEST_POSES = {
    "too few joints": ("[1, 2, 3]", "[0, 0, 1]", "has 3 values"),
    "outside": ("[850, 0, 0, 0, 0, 0, 0]", "[0, 0, 1]", "r1 = 850 m, outside its limits 0 to"),
    "no force": ("[0, 0, 0, 0, 0, 0]", "[0, 0, 0]", "force must be greater than zero"),
}


@pytest.mark.parametrize("command", ["run", "check"])
@pytest.mark.parametrize("name", TEST_POSES)
def test_an_impossible_test_pose_is_refused(name, command, fresh, say):
    """By `check` as by `run`, never clipped and never divided by."""
    q, force, words = TEST_POSES[name]
    folder = fresh / "data" / "raw" / "c"
    edit(folder / "campaign.toml", '"fanuc_r2000ic"\n\n', '"kr500_rail"\n\n')
    with (folder / "campaign.toml").open("a") as settings:
        settings.write(f"\n[test_pose]\nq = {q}\nforce_n = {force}\n")
    engine = ["--engine", "local"] if command == "run" else []
    code, _, err = say(fresh, command, "c", *engine)

    assert code == 5
    assert words in err


def test_a_word_for_digits_is_answered_in_words(tmp_path, say):
    """Nobody hears of a constrained-int."""
    code, _, err = say(tmp_path, "simulate", "--digits", "two")

    assert code == 5
    assert 'tracker.digits: "two" is neither a number from 0 to 15 nor full' in err


def raw(root, change):
    """A KR500 campaign with a change of one of its files."""
    given = dict(simulate(Plan(name="c", poses={"count": 8})).files)
    name, old, new = change
    assert old in given[name]
    given[name] = given[name].replace(old, new, 1)
    folder = root / "data" / "raw" / "c"
    for file, content in given.items():
        files.write(folder / file, content)


@pytest.mark.whole
def test_a_missing_load_is_told_once(tmp_path, say):
    """Five readings hang on one row of loads.csv: one sentence and a count."""
    loads = dict(simulate(Plan(name="c", poses={"count": 8})).files)["loads.csv"]
    row = next(line for line in loads.splitlines(keepends=True) if line.startswith(b"3,2,"))
    raw(tmp_path, ("loads.csv", row, b""))
    code, _, err = say(tmp_path, "check", "c")
    first, more = err.splitlines()

    assert code == 5
    assert "pose 3 repeat 2 has no force in loads.csv" in first
    assert more == "c: tracker.csv: ... and 4 more lines like this"


def test_reasons_that_differ_in_numbers_are_counted():
    """Three are told, the rest is a number; other reasons and other files stand by themselves."""
    said = [("t.csv", k, f"pose {k} is odd") for k in range(1, 18)]
    said += [("t.csv", 40, "not a number"), ("u.csv", 1, "pose 1 is odd")]
    rows = [Rejected(file=file, line=line, reason=reason) for file, line, reason in said]

    assert sentences(rows) == [
        "t.csv:1: pose 1 is odd",
        "t.csv:2: pose 2 is odd",
        "t.csv:3: pose 3 is odd",
        "t.csv: ... and 14 more lines like this",
        "t.csv:40: not a number",
        "u.csv:1: pose 1 is odd",
    ]


def test_kinds_that_fit_no_screen_are_counted():
    """The four with most rows are told in their order, all others in one line."""
    kinds = {"a": 1, "b": 3, "c": 2, "d": 9, "e": 1, "f": 5}
    said = [(f"{kind} is odd", count) for kind, count in kinds.items()]
    rows = [Rejected(file="t.csv", line=1, reason=one) for one, n in said for _ in range(n)]

    assert sentences(rows) == [
        "t.csv:1: b is odd", "t.csv: ... and 2 more lines like this",
        "t.csv:1: c is odd", "t.csv: ... and 1 more line like this",
        "t.csv:1: d is odd", "t.csv: ... and 8 more lines like this",
        "t.csv:1: f is odd", "t.csv: ... and 4 more lines like this",
        "... and 2 more lines of 2 other kinds; --json has them",
    ]  # fmt: skip
