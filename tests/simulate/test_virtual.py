"""`pipeline simulate` on disk: complete folders, sealed truth, no accidental overwriting."""

import json
import os

import pytest

from pipeline.app import cli
from pipeline.base import files
from pipeline.base.errors import CannotWrite, InputError, UsageError
from pipeline.machine.robot import load
from pipeline.simulate.command import write

FEW = {"name": "few", "poses": {"count": 2}}


def test_a_campaign_appears_whole_and_its_truth_elsewhere(tmp_path):
    """The raw folder has four files, the truth is with the tables, and nothing else remains."""
    folder, sealed = write(tmp_path, None, FEW)

    assert sorted(p.name for p in folder.iterdir()) == [
        "campaign.toml", "joints.csv", "loads.csv", "tracker.csv",
    ]  # fmt: skip
    assert sealed == tmp_path / "data" / "processed" / "few.truth.json"
    assert json.loads(sealed.read_text())["campaign"] == "few"
    assert sorted(p.name for p in (tmp_path / "data").iterdir()) == ["processed", "raw"]


def test_a_campaign_is_not_overwritten_by_accident(tmp_path):
    """A second campaign of the same name is refused, and replaced as a whole with --force."""
    folder, _ = write(tmp_path, None, FEW)
    (folder / "note.txt").write_text("measured by hand")
    before = (folder / "tracker.csv").read_bytes()
    with pytest.raises(UsageError, match="there already"):
        write(tmp_path, None, FEW | {"seed": 2})
    assert (folder / "tracker.csv").read_bytes() == before
    write(tmp_path, None, FEW | {"seed": 2}, force=True)

    assert (folder / "tracker.csv").read_bytes() != before
    assert not (folder / "note.txt").exists()


def test_an_interrupted_replacement_leaves_the_old_campaign(tmp_path, monkeypatch):
    """A disk that fails half-way leaves the folder unchanged."""
    folder, _ = write(tmp_path, None, FEW)
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    real = files.write

    def failing(path, data):
        if path.name == "loads.csv":
            raise OSError(28, "no space left on device")
        real(path, data)

    monkeypatch.setattr(files, "write", failing)
    with pytest.raises(CannotWrite, match="no space"):
        write(tmp_path, None, FEW | {"seed": 2}, force=True)

    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before
    assert sorted(p.name for p in (tmp_path / "data").iterdir()) == ["processed", "raw"]


def test_a_replacement_that_cannot_take_its_place_gives_it_back(tmp_path, monkeypatch):
    """If the new folder cannot be moved in, the old one is restored."""
    folder, _ = write(tmp_path, None, FEW)
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    real = os.rename

    def refusing(old, new):
        if old.name == "new":
            raise OSError(13, "permission denied")
        real(old, new)

    monkeypatch.setattr(os, "rename", refusing)
    with pytest.raises(CannotWrite, match="permission"):
        write(tmp_path, None, FEW | {"seed": 2}, force=True)

    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before


def test_the_truth_is_kept_away_from_raw_files(tmp_path):
    """A truth file under data/raw is refused before anything is written."""
    with pytest.raises(UsageError, match="keep the truth away"):
        write(tmp_path, None, FEW, truth=tmp_path / "data" / "raw" / "few" / "truth.json")

    assert not (tmp_path / "data").exists()


def test_the_command_line_says_more_than_the_plan(tmp_path, capsys):
    """Options override the plan file, including noise models."""
    plan = tmp_path / "plan.toml"
    plan.write_text('name = "mine"\nposes.count = 2\n[tracker]\nsigma_m = 1e-5\n')
    words = f"simulate {plan} --root {tmp_path} --seed 7 --noise paper --digits 3 --step 900"
    with pytest.raises(SystemExit) as done:
        cli.main(words.split())
    toml = (tmp_path / "data" / "raw" / "mine" / "campaign.toml").read_text()
    truth = json.loads((tmp_path / "data" / "processed" / "mine.truth.json").read_text())

    assert done.value.code == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / "data" / "raw" / "mine")
    assert 'noise = "paper"' in toml
    assert "sigma_m" not in toml
    assert (truth["plan"]["seed"], truth["plan"]["pulls"]["steps_n"]) == (7, [900.0])


def test_exact_readings_are_the_plan_without_its_noise(tmp_path):
    """--exact writes every digit without scatter, whatever noise is stated."""
    changes = FEW | {"scale": {"gain_sigma": 0.01}}
    folder, sealed = write(tmp_path, None, changes, noise="instrument", exact=True)
    truth = json.loads(sealed.read_text())

    assert "range_m" in (folder / "campaign.toml").read_text()
    assert truth["tracker"]["noise_scale"] == truth["scale"]["noise_scale"] == 0.0
    for pull, line in zip(
        truth["pulls"], (folder / "loads.csv").read_text().splitlines()[1:], strict=True
    ):
        shown = float(line.split(",")[2])
        assert sum(f * f for f in pull["force_n"]) ** 0.5 == pytest.approx(shown, rel=1e-14)


@pytest.mark.parametrize(
    ("changes", "noise", "said"),
    [
        ({"name": "../up"}, None, "name"),
        ({"poses": {"count": 0}}, None, r"poses\.count"),
        ({"hidden": {"effects": ["rail_rol"]}}, None, "rail_roll"),
        ({"hidden": {"effects": ["rail_roll=big"]}}, None, "2x for twice"),
        ({"robot": "kr501"}, None, "kr500_rail"),
        ({}, "loud", "paper, instrument"),
    ],
)
def test_a_slip_is_answered_with_what_is_possible(tmp_path, changes, noise, said):
    """A wrong word is answered with the valid ones, and nothing is written."""
    with pytest.raises((UsageError, InputError), match=said):
        write(tmp_path, None, FEW | changes, noise)

    assert not (tmp_path / "data").exists()


def test_a_users_robot_travels_with_its_campaign(tmp_path):
    """A robot file given by path is copied into the raw folder that refers to it."""
    own = tmp_path / "own.toml"
    text = load("kr500_rail").text.replace('name = "kr500_rail"', 'name = "own"')
    own.write_text(text)
    plan = tmp_path / "plan.toml"
    plan.write_text('name = "few"\nrobot = "own.toml"\nposes.count = 2\n')
    folder, _ = write(tmp_path, plan, {})

    assert (folder / "robot.toml").read_text() == text
    assert 'robot = "robot.toml"' in (folder / "campaign.toml").read_text()
