"""What a tired engineer types, and what the command line answers: sentences, streams, prompts."""

import json
import os
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import report_sample
from test_cli import ENVIRONMENT, HERE, on_a_terminal

from pipeline.app.cli import _exit_code
from pipeline.base.errors import CannotWrite, UsageError
from pipeline.fleet import compare, overview
from pipeline.library.preferences import Service
from pipeline.service import server as service
from pipeline.service import supervisor

SAMPLE = report_sample.answer()
PIPELINE = [sys.executable, "-m", "pipeline"]


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["compare", "a"], 2, "Missing argument 'SECOND'. Try 'pipeline compare --help'."),
        (["--nope"], 2, "No such option: --nope. Try 'pipeline --help'."),
        (["compare", "a", "a"], 2, "a is compared with itself: name another campaign or model."),
        (["compare", "a", "b"], 5, 'there is no campaign "a"; known under data/raw: none.'),
        (["init", "a", "--plan", "p.toml", "--robot", "r"], 2, "the plan names its robot"),
        (["init"], 2, "the campaign has no name: write 'pipeline init NAME'."),
        (["serve", "--cron", "now"], 2, '--cron: "now" is no cron line, such as "0 6 * * 1-5".'),
        (["watch", "--interval", "1"], 2, "--interval: 1.0 should be at least 5."),
        (
            ["simulate", "--name", "a/b"],
            5,
            'name: "a/b" is not a name of letters, digits, dots, hyphens and underscores;',
        ),
        (["simulate", "--name", "a; b"], 5, "digits, dots, hyphens and underscores; correct"),
        (["watch", "--root", "/nowhere"], 2, "there is no folder /nowhere: correct --root."),
        (
            ["simulate", "--effect", "joint_tlt:4"],
            2,
            'there is no effect "joint_tlt:4" on kr500_rail; did you mean joint_tilt:4 or',
        ),
        (["simulate", "--effect", "joint_tilt"], 2, "did you mean joint_tilt:2 or joint_tilt:3"),
        (["simulate", "--effect", "ghost"], 2, "choose from rail_lateral, rail_vertical,"),
        (["simulate", "--step", "-5"], 5, "plan: pulls.steps_n.0: -5.0 should be greater than 0;"),
    ],
)
def test_a_slip_gets_one_sentence(tmp_path, monkeypatch, capsys, words, code, said):
    """What was typed, what is wrong with it and the way out, with a full stop at its end."""
    monkeypatch.chdir(tmp_path)

    assert _exit_code(words) == code
    line = capsys.readouterr().err.strip()
    assert said in line
    assert line.endswith(".")
    assert "\n" not in line


def test_a_word_that_campaign_toml_lacks_is_said_to_be_missing(tmp_path, capsys):
    """And one that it should not have is unknown, with its line."""
    folder = tmp_path / "data" / "raw" / "a"
    folder.mkdir(parents=True)
    (folder / "campaign.toml").write_text("")

    assert _exit_code(["check", "a", "--root", str(tmp_path)]) == 5
    assert "campaign.toml: format: is missing;" in capsys.readouterr().err
    (folder / "campaign.toml").write_text(
        'format = 1\nname = "a"\nrobot = "b"\n[tracker]\nfiles = ["a"]\ncolour = 3\n'
    )
    assert _exit_code(["check", "a", "--root", str(tmp_path)]) == 5
    assert "campaign.toml:6: tracker.colour: unknown key;" in capsys.readouterr().err


def test_the_version_is_that_of_the_package(capsys):
    """`pipeline --version` says what pyproject.toml says."""
    project = tomllib.loads((HERE / "pyproject.toml").read_text("utf-8"))["project"]

    assert _exit_code(["--version"]) == 0
    assert capsys.readouterr().out == f"pipeline {project['version']}\n"


def test_who_stands_in_the_wrong_folder_reads_which(tmp_path, monkeypatch, capsys):
    """The sentence names the whole path, and --root."""
    monkeypatch.chdir(tmp_path)

    assert _exit_code(["run"]) == 5
    said = capsys.readouterr().err
    assert str(tmp_path / "data" / "raw") in said
    assert "--root" in said


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("shell", "code", "said"),
    [
        ("{} robot --list | head -1 > /dev/null; exit ${{PIPESTATUS[0]}}", 0, ""),
        (
            "{} robot --list > /dev/full",
            3,
            "The answer cannot be written (No space left on device)",
        ),
        ("{} robot --list > /dev/full 2> /dev/full", 3, ""),
        ("{} robot --list >&-", 0, ""),
        ("PYTHONIOENCODING=latin-1 {} effects --robot ≠", 5, 'no robot "?'),
    ],
)
def test_what_becomes_of_stdout_is_no_internal_error(shell, code, said):
    """A reader that has gone, a full disk, a closed stream, an old encoding."""
    if "/dev/full" in shell and not Path("/dev/full").exists():
        pytest.skip("this system has no device that is always full")
    command = shell.format(f"'{sys.executable}' -m pipeline")
    done = subprocess.run(
        ["bash", "-c", command],
        cwd=HERE,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )

    assert done.returncode == code, done.stderr
    assert said in done.stderr
    assert "internal error" not in done.stderr


@pytest.mark.whole
def test_init_asks_again_for_what_is_no_size(tmp_path):
    """Words and negative numbers are no uncertainty; a decimal comma is as good as a point."""
    command = [*PIPELINE, "init", "a", "--root", str(tmp_path)]
    _, err, code = on_a_terminal(command, ["", "", "abc", "-0.05", "nan", "0,05", "3"])
    content = tomllib.loads((tmp_path / "data" / "raw" / "a" / "campaign.toml").read_text())

    assert code == 0
    assert err.count("is no number above zero") == 3
    assert content["tracker"]["sigma_m"] == pytest.approx(5e-5)


@pytest.mark.whole
def test_init_asks_for_a_robot_again_before_it_asks_further(tmp_path):
    """A brand name finds its robots; nobody answers three questions in vain, or begins anew."""
    command = [*PIPELINE, "init", "a", "--root", str(tmp_path)]
    _, err, code = on_a_terminal(command, ["KR 500 FORTEC", "kr501", "kr500_rail", "", "", ""])
    before, _, asked = err.partition("kr500_rail_kuka")

    assert code == 0
    assert 'no robot "KR 500 FORTEC"' in before
    assert "did you mean" in before
    assert "Tracker, as" not in before
    assert "Tracker, as" in asked


CTRL_C = """
import signal, subprocess, sys
from pipeline.service.processes import sheltered

child = "import sys, time; print('up', flush=True); sys.stdin.read(); print('whole', flush=True)"
try:
    with sheltered(signal.SIGUSR1):
        process = subprocess.Popen([sys.executable, "-c", child], stdin=subprocess.PIPE)
        process.wait()
except KeyboardInterrupt:
    process.communicate()
    print("stopped", process.returncode, flush=True)
    signal.raise_signal(signal.SIGINT)  # ours again
"""


def test_ctrl_c_is_kept_from_the_processes_that_prefect_starts():
    """Who presses it sees our sentence, not the tracebacks of our servers and workers."""
    process = subprocess.Popen(
        [sys.executable, "-c", CTRL_C],
        cwd=HERE,
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "up\n"
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all of them
    out, err = process.communicate(timeout=60)

    assert out.splitlines() == ["whole", "stopped 0"]
    assert err.count("Traceback") == 2, err  # one interruption, and the second while it is handled
    assert err.strip().endswith("KeyboardInterrupt")


def test_an_end_that_prefect_calls_good_stays_an_interruption():
    """Its runner exits with 0 when it is told to stop; whoever pressed Ctrl-C gets 130."""
    script = (
        "import signal, sys, time; from pipeline.service.processes import sheltered\n"
        "with sheltered(signal.SIGTERM):\n"
        "    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))\n"
        "    print('up', flush=True); time.sleep(30)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script],
        cwd=HERE,
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout.readline() == "up\n"
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)

    assert process.returncode != 0
    assert err.strip().endswith("KeyboardInterrupt")


def test_one_campaign_is_no_history():
    """With nothing to compare the page does not say that nothing has changed."""
    alone = overview.overview([SAMPLE])

    assert alone.verdict == "Nothing to compare yet"
    assert alone.tone == "neutral"


def test_two_models_of_one_campaign_are_not_said_to_be_tested():
    """The note on the test stands only where there is one."""
    joints = SAMPLE.stiffness
    cov = np.diag([1e-18] * len(joints))
    models = overview.comparison(("a", "a:extended"), joints, joints, None)
    campaigns = overview.comparison(("a", "b"), joints, joints, (cov, cov))

    assert "Tested" not in models.sections[0].blocks[0].note
    assert "Tested" in campaigns.sections[0].blocks[0].note


def test_effects_stand_in_columns(capsys):
    """No size runs into its signature, however long its unit."""
    assert _exit_code(["effects", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    bounds = {(one["lower"], one["upper"]) for each in told for one in each["parameters"]}
    assert bounds >= {(None, None), (0.0, None)}
    assert _exit_code(["effects"]) == 0
    lines = capsys.readouterr().out.splitlines()

    assert len(lines) == len(told)
    assert all(f"  {one['signature']}" in line for one, line in zip(told, lines, strict=True))


def test_a_project_is_served_once(tmp_path, monkeypatch):
    """A second service says which process is the first; the note of a dead server is none."""
    note = tmp_path / ".prefect" / "serving.json"
    note.parent.mkdir()
    urls = dict.fromkeys(("page", "api", "reports"), "http://127.0.0.1:9")
    note.write_text(json.dumps(urls))

    assert service.serving(tmp_path) is None
    monkeypatch.setattr(service, "answers", lambda api: api.endswith(":9"))
    assert service.serving(tmp_path) == urls
    with supervisor.alone(tmp_path, Service()):
        said = rf"is served already by process {os.getpid()}: stop that first"
        with pytest.raises(UsageError, match=said), supervisor.alone(tmp_path, Service()):
            pass
    with supervisor.alone(tmp_path, Service()):
        pass


def test_a_password_that_cannot_be_kept_blames_the_disk(tmp_path):
    """A file where Prefect's folder should be: the sentence and exit code of any disk."""
    (tmp_path / ".prefect").write_text("")

    said = "is no folder, move it out of the way"
    with pytest.raises(CannotWrite, match=said):
        supervisor.settled(tmp_path, 24990)


def test_a_comparison_is_told_where_its_page_cannot_be_kept(tmp_path, monkeypatch):
    """The answer comes, then the trouble with the disk, exit code 3."""
    joints = SAMPLE.stiffness
    said = overview.comparison(("a", "a:extended"), joints, joints, None)
    monkeypatch.setattr(compare, "compared", lambda *_: (said, {"stiffness": []}))
    (tmp_path / "reports").write_text("in the way")
    outcome, path = compare.compare(tmp_path, "a", "a:extended")

    assert (outcome.exit_code, path) == (3, None)
    assert "k_theta2" in outcome.text
    assert len(outcome.complaints) == 1
