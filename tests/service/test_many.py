"""Several campaigns at a time: the answers of one after another, whoever computes them."""

import contextlib
import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import ClassVar

import pytest
from conftest import without_pages
from filelock import FileLock, Timeout
from first_poses import written

from pipeline.app import cli
from pipeline.app.shell import run_all
from pipeline.base.errors import InputError
from pipeline.fleet.states import states
from pipeline.service import many
from pipeline.service.executor import InProcesses, InThisProcess
from pipeline.store.campaign import find

HERE = Path(__file__).parents[2]
KEPT = HERE / "data" / "raw" / "fanuc_r2000ic"
OWN = ("run_time_s",)


@dataclass(frozen=True)
class Afar(InProcesses):
    """Processes that are treated as if they did not see the folder."""

    near: ClassVar[bool] = False


def project(root, small):
    """A good campaign, the same with another scale, a broken one."""
    raw = root / "data" / "raw"
    shutil.copytree(KEPT, raw / "good")
    shutil.copytree(KEPT, raw / "broken")
    (raw / "broken" / "joints.csv").write_bytes(b"no table at all")
    for name, content in small.files.items():
        (raw / "small" / name).parent.mkdir(parents=True, exist_ok=True)
        (raw / "small" / name).write_bytes(content)
    return root


def made(root):
    """Everything that a run has left, but the times that it took."""
    found = {}
    for path in (p for top in ("reports", "data/processed") for p in (root / top).rglob("*")):
        name = path.relative_to(root).as_posix()
        if path.suffix in (".parquet", ".urdf") or path.name in ("result.json", "rejection.json"):
            found[name] = path.read_bytes()
        elif path.name == "manifest.json":
            content = json.loads(path.read_bytes())
            found[name] = {k: content[k] for k in ("key", "source", "verdict", "robot", "previous")}
            found[name]["outputs"] = sorted(content["outputs"])
    return found


def told(outcomes):
    return sorted((o.campaign, json.dumps(o.content), o.exit_code, o.misfit) for o in outcomes)


@pytest.fixture(scope="module")
def plain(tmp_path_factory, small_campaign):
    """Three campaigns, one after another: what is told of them and what they leave."""
    root = project(tmp_path_factory.mktemp("plain"), small_campaign)
    return told(run_all(root, [], "local", force=False)), made(root)


@pytest.mark.parametrize(
    "executor",
    [
        pytest.param(InProcesses(2), id="jobs", marks=pytest.mark.slow),
        pytest.param(Afar(2), id="afar", marks=pytest.mark.slow),
    ],
)
def test_several_at_a_time_answer_as_one_after_another(executor, tmp_path, plain, small_campaign):
    """Byte by byte, tables, answers and complaints; a second run has nothing to do."""
    root = project(tmp_path, small_campaign)

    assert told(run_all(root, [], "local", False, partial(many.outcomes, executor))) == plain[0]
    assert made(root) == plain[1]
    stamps = {p: p.stat().st_mtime_ns for p in root.rglob("result.json")}
    assert told(run_all(root, [], "local", False, partial(many.outcomes, executor))) == plain[0]
    assert {p: p.stat().st_mtime_ns for p in root.rglob("result.json")} == stamps
    assert [o.content["state"] for o in states(root)] == ["rejected", "done", "done"]


def test_any_number_of_processes_may_be_asked_for():
    """There are never more than campaigns."""
    assert [*InProcesses(2**64).results(str, [])] == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--jobs", "2", "--on", "tcp://127.0.0.1:1"], "give one of them"),
        (["--jobs", "2", "--engine", "prefect"], "do without Prefect"),
        pytest.param(
            ["--on", "tcp://127.0.0.1:1"],
            "no Dask scheduler answers at tcp://127.0.0.1:1",
            marks=pytest.mark.slow,  # it is waited for
        ),
        (["--on", "nonsense://"], "no Dask scheduler answers at nonsense://"),
    ],
)
def test_what_cannot_be_meant_is_a_sentence(words, said, tmp_path, capsys):
    """Exit code 2 and the way out."""
    if "--on" in words and "--jobs" not in words:
        pytest.importorskip("distributed", reason="pip install 'rail-stiffness[cluster]'")
    shutil.copytree(KEPT, tmp_path / "data" / "raw" / "a")

    code = cli._exit_code(["run", *words, "--root", str(tmp_path)])

    assert code == 2
    assert said in capsys.readouterr().err


def held(parcel):
    """Whether somebody holds the campaign while it is computed elsewhere."""
    lock = Path(os.environ["MANY_ROOT"]) / "data" / "processed" / parcel.name / ".lock"
    try:
        FileLock(lock).acquire(timeout=0)
    except Timeout:
        with without_pages():
            return many.computed(parcel)
    raise AssertionError(f"{lock} is not held")


@pytest.mark.whole
def test_a_campaign_is_locked_while_it_is_computed_elsewhere(tmp_path, monkeypatch):
    """And free afterwards; named twice, it is computed once."""
    shutil.copytree(KEPT, tmp_path / "data" / "raw" / "a")
    monkeypatch.setenv("MANY_ROOT", str(tmp_path))
    monkeypatch.setattr(many, "computed", held)

    first, second = many.outcomes(Afar(2), tmp_path, ["a", "data/raw/../raw/a"][:1] * 2)

    assert (first.exit_code, second.exit_code) == (0, 0)
    assert first.content == second.content
    FileLock(tmp_path / "data" / "processed" / "a" / ".lock").acquire(timeout=0)


class NearlyHere(InThisProcess):
    """This process, as if it did not see the folder."""

    near = False


def test_a_worker_with_other_code_is_refused(tmp_path, monkeypatch):
    """Nothing of it is kept, and the sentence says which machine it is."""
    shutil.copytree(KEPT, tmp_path / "data" / "raw" / "a")
    real = many.computed
    monkeypatch.setattr(many, "computed", lambda p: real(many.Parcel(p.name, "0" * 64, p.files)))

    (refused,) = many.outcomes(NearlyHere(), tmp_path, ["a"])

    assert refused.exit_code == 2
    assert "requirements.lock" in refused.complaints[0]
    assert not (tmp_path / "reports").exists()


def _changed(made, name, content):
    return replace(made, reports=made.reports | {name: content})


def _sealed(made, name="", content=b"", **entries):
    """With another answer and other entries of its manifest, whole by its own checksums."""
    reports = made.reports | ({name: content} if name else {})
    tables = {k: v for k, v in made.processed.items() if k != "manifest.json"}
    manifest = json.loads(made.processed["manifest.json"]) | entries
    manifest["outputs"] = {
        f"{folder}/a/{k}": sha256(v).hexdigest()
        for folder, inside in (("data/processed", tables), ("reports", reports))
        for k, v in inside.items()
    }
    kept = tables | {"manifest.json": json.dumps(manifest).encode()}
    return replace(made, processed=kept, reports=reports)


def _of_others(made, **changes):
    result = json.loads(made.reports["result.json"]) | changes
    text = json.dumps(result, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    return _sealed(made, "result.json", text.encode())


LIES = {
    "of other files, sealed": lambda made: _of_others(made, inputs=[]),
    "of another name, sealed": lambda made: _of_others(made, campaign="b"),
    "of other libraries, sealed": lambda made: _of_others(made, versions={"numpy": "1"}),
    "in no time, sealed": lambda made: _sealed(made, run_time_s=float("inf")),
    "a file outside, sealed": lambda made: _sealed(made, "../../../outside", b"x"),
    "an absolute name, sealed": lambda made: _sealed(made, "/x", b"x"),
    "no number, sealed": lambda made: _sealed(
        made, "result.json", made.reports["result.json"].replace(b"{", b'{"x": NaN,', 1)
    ),
    "a manifest without end": lambda made: replace(
        made, processed=made.processed | {"manifest.json": b"[" * 10**5}
    ),
    "of another campaign": lambda made: replace(
        made, processed={k: v.replace(b'"key": "', b'"key": "0') for k, v in made.processed.items()}
    ),
    "one digit changed": lambda made: _changed(
        made, "result.json", made.reports["result.json"].replace(b"1", b"2", 1)
    ),
    "cut": lambda made: _changed(made, "model.toml", made.reports["model.toml"][:-1]),
    "an answer missing": lambda made: replace(
        made, reports={k: v for k, v in made.reports.items() if k != "model.toml"}
    ),
    "one too many": lambda made: _changed(made, "../../../outside", b"x"),
    "no manifest": lambda made: replace(made, processed={}),
    "a manifest of nothing": lambda made: replace(made, processed={"manifest.json": b"[]"}),
    "nothing": lambda _: None,
    "no result at all": lambda _: {"key": 1},
}


@pytest.fixture(scope="module")
def honest(tmp_path_factory):
    """What a worker makes of the kept campaign."""
    root = tmp_path_factory.mktemp("honest")
    written(root / "data" / "raw" / "a")
    raw = find(root, "a").read()
    with without_pages():
        return many.computed(many.Parcel("a", raw.key, dict(raw.files)))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("lie", [None, *LIES])
def test_what_a_worker_has_not_made_of_it_is_not_kept(tmp_path, monkeypatch, honest, lie):
    """Of another campaign, or changed on its way: a sentence, and no file; the true one is kept."""
    written(tmp_path / "data" / "raw" / "a")
    monkeypatch.setattr(many, "computed", lambda _: LIES[lie](honest) if lie else honest)

    (done,) = many.outcomes(NearlyHere(), tmp_path, ["a"])

    assert done.exit_code == (6 if lie else 0)
    assert ("not what is to be made" in "".join(done.complaints)) is bool(lie)
    assert (tmp_path / "reports").exists() is not bool(lie)
    assert not (tmp_path / "outside").exists()


@pytest.mark.parametrize(
    ("problem", "code", "said"),
    [
        (ValueError("three is odd"), 6, r"its worker failed (ValueError: three is odd); run it"),
        (RecursionError("deep"), 6, "run it without --on"),
        (OSError(errno.EIO, "no disk"), 6, "run it without --on"),
        (OSError(errno.ENOSPC, "No space left"), 3, "No space left"),
        (MemoryError(), 6, "needs more memory"),
        (InputError("is odd", "correct it", file="x.csv"), 5, "x.csv: is odd; correct it"),
    ],
)
def test_an_error_of_a_worker_is_no_error_of_this_machine(
    tmp_path, monkeypatch, problem, code, said
):
    """Whether its machine or the program is to blame shows where the campaign is run here."""
    written(tmp_path / "data" / "raw" / "a")

    def fails(_):
        raise problem

    monkeypatch.setattr(many, "computed", fails)
    (done,) = many.outcomes(NearlyHere(), tmp_path, ["a"])

    assert done.exit_code == code
    assert said in done.complaints[0]
    assert not (tmp_path / "reports").exists()


def test_what_a_manifest_states_is_known_here(tmp_path, monkeypatch, honest):
    """A worker's word on code, verdict, machine and language is not taken."""
    written(tmp_path / "data" / "raw" / "a")
    wrong = {"code": "0", "versions": 1, "verdict": 5, "robot": [], "machine": {}, "measured": 2,
             "language": "xx", "fields": "x", "look": 3, "wear": [1]}  # fmt: skip
    monkeypatch.setattr(many, "computed", lambda _: _sealed(honest, **wrong))

    (done,) = many.outcomes(NearlyHere(), tmp_path, ["a"])

    true = json.loads(honest.processed["manifest.json"])
    kept = find(tmp_path, "a").manifest()
    assert done.exit_code == 0
    assert {k: kept.get(k) for k in wrong} == {k: true[k] for k in wrong} | {"look": None}


def working(process, root):
    """A process that holds a campaign, as soon as one does."""
    locks = {str(folder / ".lock") for folder in (root / "data" / "processed").glob("*")}
    while process.poll() is None:
        for pid in children(process.pid):
            with contextlib.suppress(FileNotFoundError):  # a file is closed while it is listed
                if locks & {os.path.realpath(fd) for fd in Path(f"/proc/{pid}/fd").iterdir()}:
                    return pid
        time.sleep(0.02)
    raise AssertionError("it ended before anybody was seen at work")


def children(pid):
    return [
        int(word)
        for task in Path(f"/proc/{pid}/task").iterdir()
        for word in (task / "children").read_text().split()
    ]


def alive(group):
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.fixture
def at_work(tmp_path):
    """Four campaigns, two at a time: the command, and one of its processes at work."""
    for name in NAMES:
        shutil.copytree(KEPT, tmp_path / "data" / "raw" / name)
        (tmp_path / "data" / "processed" / name).mkdir(parents=True)
    command = [sys.executable, "-m", "pipeline", "run", "--jobs", "2", "--json", "--root", tmp_path]
    process = subprocess.Popen(
        command, cwd=HERE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    )
    yield process, working(process, tmp_path)
    process.kill()


NAMES = [f"c{k}" for k in range(4)]
in_proc = pytest.mark.skipif(not Path("/proc").is_dir(), reason="finds processes in /proc")


@pytest.mark.slow
@in_proc
def test_a_worker_that_is_killed_costs_nothing(at_work):
    """Each campaign is told once, with the answer of the others, which have the same files."""
    process, worker = at_work
    os.kill(worker, signal.SIGKILL)

    out, err = process.communicate(timeout=300)

    assert (process.returncode, err) == (0, b"")
    said = [json.loads(line) for line in out.splitlines()]
    names = [one.pop("campaign") for one in said]
    assert sorted(names) == NAMES
    rest = [
        json.dumps(one).replace(f"compensate {name} ", "compensate NAME ")
        for name, one in zip(names, said, strict=True)
    ]
    assert set(rest) == {rest[0]}


@pytest.mark.slow
@in_proc
def test_ctrl_c_ends_all_of_them(at_work):
    """Exit code 130, one sentence, no process that goes on."""
    process, _ = at_work
    os.killpg(process.pid, signal.SIGINT)

    _, err = process.communicate(timeout=60)

    assert process.returncode == 130
    assert len(err.splitlines()) == 1
    end = time.monotonic() + 20
    while alive(process.pid) and time.monotonic() < end:
        time.sleep(0.1)
    assert not alive(process.pid)
