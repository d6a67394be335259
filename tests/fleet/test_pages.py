"""Pages of all campaigns: what a killed run left is removed when they are brought up to date."""

from pathlib import Path

from filelock import FileLock

from pipeline.fleet import pages
from pipeline.store.campaign import CampaignFolder


def test_what_a_killed_run_left_is_removed_where_nobody_runs(tmp_path: Path) -> None:
    """In tables and reports, but not while somebody holds the campaign's lock."""
    folder = CampaignFolder(tmp_path, tmp_path / "data" / "raw" / "demo")
    left = [folder.processed / ".a.12345678", folder.reports / ".b.12345678"]
    for path in left:
        path.parent.mkdir(parents=True)
        path.write_bytes(b"")
    with FileLock(folder.processed / ".lock"):
        pages.tidy(folder)
        assert all(path.exists() for path in left)

    pages.tidy(folder)

    assert not any(path.exists() for path in left)
