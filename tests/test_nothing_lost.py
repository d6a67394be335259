"""Killed, disk full, two at once, read-only, still being written: nothing is lost."""

import os
import subprocess
import sys

import pytest

from bench.bench_kill import PLAN, Victim, survived
from pipeline.base.errors import InputError
from pipeline.base.files import leftovers
from pipeline.fleet.pages import refresh
from pipeline.run import run
from pipeline.simulate import simulate
from pipeline.store.campaign import find

COMMAND = [sys.executable, "-m", "pipeline"]


@pytest.fixture
def victim(tmp_path):
    with Victim(tmp_path, PLAN) as one:
        yield one


@pytest.fixture
def folder(tmp_path):
    """The raw folder of the same campaign, without a process that runs it."""
    folder = tmp_path / "data" / "raw" / "killed"
    folder.mkdir(parents=True)
    for name, content in simulate(PLAN).files.items():
        (folder / name).write_bytes(content)
    return folder


@pytest.mark.slow
def test_a_killed_run_leaves_nothing_behind(victim):
    """Kill -9 at five moments of a run: the next run gives the same result.json."""
    said = list(survived(victim, [0.1, 0.3, 0.5, 0.7, 0.9]))

    assert [good for _, good in said] == [True] * 5
    assert sum(status == 9 for status, _ in said) >= 3
    run(find(victim.root, "killed"), force=True)
    assert not victim.leftovers


@pytest.mark.whole
@pytest.mark.usefixtures("folder", "unseen")
def test_what_a_killed_run_left_goes_though_nothing_is_computed(tmp_path):
    """The answer is kept, half-written files are removed, but not while another run works."""
    one = find(tmp_path, "killed")
    run(one)
    begun = [one.reports / ".index.html.abcd1234", one.processed / ".40_estimate.parquet.x_y_z_12"]
    for path in begun:
        path.write_bytes(b"half")
    with one.locked():
        begun[0].write_bytes(b"half")
        refresh(tmp_path)
        assert leftovers(tmp_path) == begun[:1]
    begun[1].write_bytes(b"half")
    refresh(tmp_path)

    assert not leftovers(tmp_path)


@pytest.mark.whole
@pytest.mark.usefixtures("folder", "unseen")
def test_a_full_disk_leaves_the_old_answer(tmp_path):
    """No file may grow beyond 20 kB: one sentence, exit code 3, the answer unchanged."""
    one = find(tmp_path, "killed")
    before = run(one)
    limited = "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000)); "
    limited += "from pipeline.app.cli import main; main(sys.argv[1:])"
    command = [sys.executable, "-c", limited, "run", "killed", "--engine", "local", "--force"]
    done = subprocess.run(
        [*command, "--root", str(tmp_path)], capture_output=True, text=True, check=False
    )

    assert done.returncode == 3
    assert "Traceback" not in done.stderr
    assert "cannot be written" in done.stderr
    assert not leftovers(tmp_path)
    assert run(one).as_json() == one.result() == before.as_json()


@pytest.mark.usefixtures("folder")
@pytest.mark.slow  # test_shell has one that waits
def test_two_runs_at_once_agree(tmp_path):
    """The second waits for the first and uses its result."""
    command = [*COMMAND, "run", "killed", "--engine", "local", "--json", "--root", str(tmp_path)]
    both = [
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    said = [process.communicate()[0] for process in both]

    assert [process.returncode for process in both] == [0, 0]
    assert said[0] == said[1] != ""


@pytest.mark.slow
@pytest.mark.usefixtures("unseen")
def test_raw_files_stay_as_they_are(folder, tmp_path):
    """A run reads the raw folder and never writes there, so that it may be read-only."""
    before = {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in folder.iterdir()}
    for path in [*folder.iterdir(), folder]:
        path.chmod(path.stat().st_mode & ~0o222)
    try:
        run(find(tmp_path, "killed"))
    finally:
        folder.chmod(0o755)

    after = {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in folder.iterdir()}
    assert after == before


def test_a_file_that_grows_while_it_is_read_is_refused(folder, tmp_path, monkeypatch):
    """The exporter is still writing: the message says to come back later."""
    path = folder / "tracker.csv"
    whole = os.path.getsize(path)
    look = os.fstat

    def slow(opened):
        if os.path.samestat(look(opened), path.stat()):
            with path.open("ab") as file:
                file.write(b"pose01_rep9_loaded,P1,1,2,3,2026-11-03T08:00:08\n")
        return look(opened)

    monkeypatch.setattr(os, "fstat", slow)

    with pytest.raises(InputError, match=r"tracker.csv: changed while it was read") as refused:
        run(find(tmp_path, "killed"))

    assert refused.value.passing
    assert os.path.getsize(path) > whole
