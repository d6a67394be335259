"""Results that were not written to their end, and folders with too many files."""

from contextlib import suppress

import pytest

from pipeline.base.errors import CannotWrite, InputError
from pipeline.store import campaign
from pipeline.store.campaign import CampaignFolder, within


def test_answers_that_were_not_all_written_do_not_count(tmp_path):
    """The manifest of the run before would vouch for them; it is gone before the first is."""
    folder = CampaignFolder(tmp_path, tmp_path / "data" / "raw" / "a")
    folder.publish({"key": "k", "outputs": {}}, {"result.json": b"{}"})
    assert folder.done("k")

    blocked = folder.reports / "index.html"
    blocked.mkdir()
    with suppress(CannotWrite):
        folder.publish({"key": "k", "outputs": {}}, {"other.txt": b"", "index.html": b"<html>"})

    assert blocked.is_dir()
    assert not folder.done("k")


def test_files_are_counted_over_all_folders(tmp_path, monkeypatch):
    """Each of these has fewer than the most that are searched, and all together have more."""
    monkeypatch.setattr(campaign, "MOST_ENTRIES", 5)
    for name in "abc":
        (tmp_path / "one" / name).mkdir(parents=True)
        (tmp_path / "one" / name / "tracker.csv").touch()

    assert sorted(within(tmp_path / "one", 1)) == []
    with pytest.raises(InputError, match="more than 5 files"):
        list(within(tmp_path / "one", 2))
