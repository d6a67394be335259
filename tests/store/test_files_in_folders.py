"""Files of a campaign that a glob finds in its folders."""

import pytest

from pipeline.store.campaign import CampaignFolder


@pytest.mark.parametrize("glob", ["*.csv", "day1/*.csv", "day1/tracker/*.csv", "*/*/*.csv"])
def test_a_glob_finds_files_as_deep_as_it_says(tmp_path, glob):
    for one in ("a.csv", "day1/b.csv", "day1/tracker/c.csv"):
        path = tmp_path / one
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")
    folder = CampaignFolder(tmp_path.parent, tmp_path)

    (found,) = folder._matching([glob])
    assert found.count("/") == glob.count("/")
