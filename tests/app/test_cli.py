"""The command line as people and programs meet it: words, exit codes, interruption."""

import contextlib
import io
import json
import os
import pty
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest
from first_poses import written

from pipeline.app import cli
from pipeline.run import run
from pipeline.service import doctor
from pipeline.store import campaign as campaigns

HERE = Path(__file__).parents[2]
DATA = HERE / "data" / "raw"
ENVIRONMENT = os.environ | {"PYTHONPATH": str(HERE), "COLUMNS": "100"}


def pipeline(root, *arguments, **more):
    """Run the command line as a user does."""
    return subprocess.run(
        [sys.executable, "-m", "pipeline", *arguments, "--root", root],
        capture_output=True,
        text=True,
        cwd=HERE,
        env=ENVIRONMENT,
        timeout=120,
        check=False,
        **more,
    )


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["run", "--engine", "airflow"], 2, 'there is no engine "airflow"'),
        (["compensate", "kr500_demo", "path.csv"], 2, "run 'pipeline run kr500_demo' first"),
        (["run", "nowhere", "--engine", "local"], 5, 'there is no campaign "nowhere"'),
        (["init", "../escape"], 2, "cannot name a campaign"),
        (["deploy", "--pool", "robots"], 2, "PREFECT_API_URL is not set"),
        (["run", "--no-such-option"], 2, "--no-such-option"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_sentence(
    tmp_path, capsys, monkeypatch, arguments, code, said
):
    """One line on stderr, nothing on stdout but the campaign's name, the documented exit code."""
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    shutil.copytree(DATA / "kr500_demo", tmp_path / "data" / "raw" / "kr500_demo")
    found = cli._exit_code([*arguments, "--root", str(tmp_path)])
    err = capsys.readouterr().err

    assert found == code
    assert said in err
    assert len(err.splitlines()) == 1


@pytest.mark.usefixtures("unseen")
def test_strict_turns_a_misfit_into_exit_code_4(tmp_path, capsys):
    """Without --strict a verdict is no error."""
    written(tmp_path / "data" / "raw" / "a")
    words = ["run", "--engine", "local", "a", "--root", str(tmp_path)]
    plain, said = cli._exit_code(words), capsys.readouterr().out
    strict, again = cli._exit_code([*words, "--strict"]), capsys.readouterr().out

    assert (plain, strict) == (0, 4)
    assert said == again != ""


@pytest.mark.slow
def test_a_run_stopped_by_ctrl_c_leaves_nothing_that_counts(tmp_path):
    """Exit code 130, one sentence, no manifest and no half-written file; the next run finishes."""
    shutil.copytree(DATA / "kr500_demo", tmp_path / "data" / "raw" / "a")
    process = subprocess.Popen(
        [sys.executable, "-m", "pipeline", "run", "--engine", "local", "--root", tmp_path],
        cwd=HERE,
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    processed = tmp_path / "data" / "processed" / "a"
    began = time.monotonic()
    while not (processed / "10_readings.parquet").is_file():  # in the midst of the run
        assert time.monotonic() - began < 60
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)

    assert (process.returncode, out) == (130, "")
    assert err.splitlines() == ["Interrupted; run it again to go on, nothing half-written counts."]
    assert not (processed / "manifest.json").exists()
    campaign = campaigns.find(tmp_path, "a")
    run(campaign)
    assert campaign.done(campaign.read().key)
    assert not [path for path in tmp_path.rglob(".*") if path.name != ".lock"]


def on_a_terminal(command, answers):
    """Run a command whose stdin is a terminal; its stdout and exit code."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        command,
        stdin=theirs,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=HERE,
        env=ENVIRONMENT,
    )
    os.close(theirs)
    os.write(ours, "".join(f"{answer}\n" for answer in answers).encode())
    out, err = process.communicate(timeout=60)
    with contextlib.suppress(OSError):
        os.close(ours)
    return out, err, process.returncode


@pytest.mark.whole
def test_a_bar_shows_on_the_terminal_and_stdout_stays_data(tmp_path):
    """With a terminal for stderr and a pipe for stdout: the bar there, one JSON line each here."""
    for name in ("a", "b"):
        (tmp_path / "data" / "raw" / name).mkdir(parents=True)
        (tmp_path / "data" / "raw" / name / "campaign.toml").write_text("format = 1\n")
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "pipeline", "run", "--json", "--root", tmp_path]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=theirs, text=True, cwd=HERE, env=ENVIRONMENT
    )
    os.close(theirs)
    shown = b""
    with contextlib.suppress(OSError):  # how a terminal says that nobody is left
        while more := os.read(ours, 65536):
            shown += more
    out, _ = process.communicate(timeout=60)
    os.close(ours)

    assert [json.loads(line)["campaign"] for line in out.splitlines()] == ["a", "b"]
    assert b"1/2" in shown
    assert b"b: campaign.toml: " in shown


@pytest.mark.whole
def test_init_asks_on_a_terminal(tmp_path):
    """Name, robot and the two uncertainties go into campaign.toml; stdout is the folder."""
    command = [sys.executable, "-m", "pipeline", "init", "--root", str(tmp_path)]
    out, err, code = on_a_terminal(command, ["hall-3", "fanuc_r2000ic", "", "0.05", "4"])
    folder = tmp_path / "data" / "raw" / "hall-3"
    content = tomllib.loads((folder / "campaign.toml").read_text())

    assert (code, out.strip()) == (0, str(folder))
    assert "Standard uncertainty of one tracker reading" in err
    assert content["robot"] == "fanuc_r2000ic"
    assert content["tracker"]["sigma_m"] == pytest.approx(5e-5)
    assert content["scale"]["sigma_n"] == 4.0


def test_init_without_a_terminal_asks_nothing(tmp_path, capsys, monkeypatch):
    """A script gets the defaults, and a sentence where the name is missing."""
    monkeypatch.setattr("sys.stdin", io.StringIO())
    named, said = cli._exit_code(["init", "a", "--root", str(tmp_path)]), capsys.readouterr()
    nameless, why = cli._exit_code(["init", "--root", str(tmp_path)]), capsys.readouterr()

    assert named == 0
    assert "copy them there and type 'pipeline init a' again" in said.err
    lines = (tmp_path / "data/raw/a/campaign.toml").read_text("utf-8").splitlines()
    at = next(k for k, line in enumerate(lines, 1) if line.lstrip("# ").startswith("sigma_n"))
    assert f"sigma_n (line {at})" in said.err
    assert said.err.endswith("fill it in, then: pipeline check a\n")
    assert nameless == 2
    assert "pipeline init NAME" in why.err


def test_doctor_names_what_is_missing_and_the_way_out(tmp_path, monkeypatch):
    """A library too new, one that is not there, a project without campaigns."""
    monkeypatch.setattr(
        doctor.installed,
        "requires",
        lambda _: ["numpy<1", "no-such-library>=2", "scipy", "x; extra == 'dev'"],
    )
    found = {finding.what: finding for finding in doctor.examine(tmp_path)}

    assert not found["numpy"].good
    assert "python -m pip install 'numpy<1'" in found["numpy"].text
    assert found["no-such-library"].text == (
        "is missing; python -m pip install 'no-such-library>=2'"
    )
    assert "scipy" not in found
    assert "x" not in found
    assert (found["campaigns"].good, found["campaigns"].needed) == (False, False)


@pytest.mark.whole
def test_doctor_answers_programs(tmp_path):
    """One JSON object per line, whatever was found."""
    done = pipeline(tmp_path, "doctor", "--json")

    assert done.returncode in (0, 2)
    assert {"what", "good", "said", "needed"} == set(json.loads(done.stdout.splitlines()[0]))


def test_serve_prints_a_unit_for_systemd(tmp_path):
    """It runs this Python on this folder, says when it is ready, and is watched."""
    done = pipeline(tmp_path, "serve", "--unit")
    lines = done.stdout.splitlines()

    assert done.returncode == 0
    assert f"ExecStart={sys.executable} -P -m pipeline serve --root {tmp_path}" in lines
    assert {"Type=notify", "WatchdogSec=120", "Restart=always", "UMask=0027"} <= set(lines)
    blank = tmp_path / "a folder"
    blank.mkdir()
    refused = pipeline(blank, "serve", "--unit")
    assert refused.returncode == 2
    assert "systemd" in refused.stderr


@pytest.mark.parametrize(("words", "code"), [(["--help"], 0), (["run", "--no-such-option"], 2)])
def test_a_library_that_waits_for_ever_does_not_keep_the_process(words, code):
    """As Prefect does for a server that is silent; what it has started is ended all the same."""
    waiting = (
        "import atexit, sys, threading; from pipeline.app import cli; cli._FAREWELL_S = 0.1\n"
        "atexit.register(print, 'ended', flush=True)\n"
        "threading._register_atexit(threading.Event().wait)\n"
        f"sys.argv[1:] = {words!r}; cli.main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", waiting],
        capture_output=True,
        text=True,
        env=ENVIRONMENT,
        timeout=60,
        check=False,
    )

    assert done.returncode == code
    assert done.stdout.endswith("ended\n")
