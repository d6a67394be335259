"""When a result may be used again, and when a rejection is remembered."""

from contextlib import suppress
from pathlib import Path

import pytest

from pipeline.base.errors import InputError
from pipeline.store import campaign
from pipeline.store.campaign import CampaignFolder, in_memory

DEMO = Path(__file__).parents[2] / "data" / "raw" / "kr500_demo"


def test_another_version_of_a_library_is_another_result(monkeypatch):
    """The key, by which a run is skipped, changes with any library that numbers depend on."""
    files = {path.name: path.read_bytes() for path in DEMO.iterdir() if path.is_file()}
    before, now = in_memory(files).key, campaign.versions()
    assert in_memory(files).key == before

    monkeypatch.setattr(campaign, "versions", lambda: now | {"scipy": "0.1"})
    assert in_memory(files).key != before


@pytest.mark.parametrize("passing", [True, False])
def test_what_passes_is_tried_again(tmp_path, passing):
    """A file that was still growing is no rejection of the campaign; a wrong row is one."""
    folder = CampaignFolder(tmp_path, tmp_path / "data" / "raw" / "a")
    with suppress(InputError), folder.remembering("key"):
        raise InputError("changed while it was read", "run again", passing=passing)

    assert (folder.rejection("key") is None) is passing
    assert folder.rejection("another key") is None
