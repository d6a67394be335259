"""What is typed behind `pipeline watch --live` reaches the campaign that is judged."""

from pathlib import Path

import pytest

from pipeline.app.cli import _exit_code
from pipeline.service.command import _LIVE_S


@pytest.mark.parametrize(("typed", "every_s"), [([], _LIVE_S), (["--interval", "7.5"], 7.5)])
@pytest.mark.parametrize("as_json", [False, True])
def test_live_has_campaign_root_and_interval(tmp_path, monkeypatch, typed, every_s, as_json):
    """The judging itself runs until Ctrl-C, and is replaced by a record of what it is given."""
    given = []
    monkeypatch.setattr("pipeline.live.command.live", lambda *words: given.append(words))
    words = ["watch", "hall", "--live", *typed, *(["--json"] if as_json else [])]

    assert _exit_code([*words, "--root", str(tmp_path)]) == 0
    assert given == [("hall", Path(tmp_path), every_s, as_json)]


@pytest.mark.parametrize("words", [["--live"], ["hall"]])
def test_a_campaign_and_live_belong_together(tmp_path, capsys, words):
    """One without the other is refused with the way out."""
    assert _exit_code(["watch", *words, "--root", str(tmp_path)]) > 1
    assert "give both" in capsys.readouterr().err
