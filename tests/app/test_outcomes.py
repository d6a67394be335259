"""What an outcome says of a report that is already there, and whether trying again may help."""

import pytest

from pipeline.app.outcome import EARLIER, Outcome, dated, failed
from pipeline.base.errors import InputError
from pipeline.store.campaign import CampaignFolder


@pytest.mark.parametrize("passing", [True, False])
def test_a_file_that_still_grows_may_be_tried_again(passing):
    """And what is wrong with a row stays wrong."""
    problem = InputError("changed while it was read", "run again", file="a.csv", passing=passing)

    assert failed("spring", problem).passing is passing


@pytest.fixture
def campaign(tmp_path):
    """A campaign with a report."""
    folder = CampaignFolder(tmp_path, tmp_path / "data" / "raw" / "spring")
    folder.reports.mkdir(parents=True)
    (folder.reports / "index.html").write_text("")
    return folder


def test_a_report_of_which_rows_were_rejected_is_not_an_old_one(campaign):
    made = Outcome("spring", {"verdict": "adequate"}, "spring: done", exit_code=5)

    assert dated(campaign, lambda _: made) == made


def test_after_a_failure_the_report_is_of_an_earlier_input(campaign):
    def rejected(_):
        raise InputError("the file is empty", "export it again", file="tracker.csv")

    found = dated(campaign, rejected)
    assert found.exit_code == 5
    assert found.content["earlier_report"].endswith("index.html")
    assert found.complaints[-1].endswith(f"is {EARLIER}.")
