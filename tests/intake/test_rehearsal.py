"""A simulated rehearsal and the campaign measured after it are never confused."""

import tomllib

import pytest

from pipeline.app import cli


@pytest.fixture
def rehearsed(tmp_path, capsys):
    """A project with a rehearsal called hall7."""
    assert (
        cli._exit_code(["--root", str(tmp_path), "simulate", "--name", "hall7", "--poses", "3"])
        == 0
    )
    capsys.readouterr()
    return tmp_path


def said(root, *words):
    """Exit code of a command with the project's root before it."""
    return cli._exit_code(["--root", str(root), *words])


def settings(root):
    """The campaign.toml."""
    return tomllib.loads((root / "data" / "raw" / "hall7" / "campaign.toml").read_text())


def test_init_says_how_to_go_on_after_a_rehearsal(rehearsed, capsys):
    """The way out is one command, and it works."""
    assert said(rehearsed, "init", "hall7") == 2
    err = capsys.readouterr().err
    assert "is a rehearsal" in err
    assert "pipeline remove hall7" in err

    assert said(rehearsed, "remove", "hall7") == 0
    assert said(rehearsed, "init", "hall7") == 0
    assert "simulated" not in settings(rehearsed)


def test_files_of_a_rehearsal_stay_simulated_without_its_campaign_toml(rehearsed, capsys):
    """Rewriting campaign.toml does not make it a measurement."""
    folder = rehearsed / "data" / "raw" / "hall7"
    (folder / "campaign.toml").unlink()

    assert said(rehearsed, "init", "hall7") == 0
    assert "tracker.csv are those of the rehearsal" in capsys.readouterr().err
    assert settings(rehearsed)["simulated"] is True


def test_measured_files_in_the_folder_of_a_rehearsal_are_measured(rehearsed):
    """Bytes other than those simulated: the campaign counts as measured."""
    folder = rehearsed / "data" / "raw" / "hall7"
    (folder / "campaign.toml").unlink()
    for name in ("tracker.csv", "loads.csv", "joints.csv"):
        (folder / name).write_bytes((folder / name).read_bytes() + b"\n")

    assert said(rehearsed, "init", "hall7") == 0
    assert "simulated" not in settings(rehearsed)


def test_the_root_before_the_command_is_that_behind_it(rehearsed, tmp_path, capsys):
    """Both name the same project; the one after the command takes precedence."""
    assert said(rehearsed, "status") == 0
    before = capsys.readouterr().out
    assert cli._exit_code(["status", "--root", str(rehearsed)]) == 0
    assert capsys.readouterr().out == before
    assert cli._exit_code(["--root", "/nowhere", "status", "--root", str(rehearsed)]) == 0
    assert capsys.readouterr().out == before
