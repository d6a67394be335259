"""The first page of the reports: every folder of data/raw, and what the service does with it."""

import os
import re
import time
from datetime import datetime

import pytest
from test_watch import Runs, arrive, look

from pipeline.base import files
from pipeline.base.errors import InputError
from pipeline.library.preferences import Preferences
from pipeline.service import doctor, server, supervisor, watch
from pipeline.service.status import FolderState, folder_statuses, now
from pipeline.store.campaign import dump, find


def states(root):
    return {one.name: one.state for one in folder_statuses(root)}


@pytest.fixture
def hall(tmp_path):
    """One of each: done, rejected, tried again, without campaign.toml, changed since, new."""
    arrive(tmp_path, "done", "wrong", "broken", "changed")
    runs = Runs()
    runs.problem["wrong"] = InputError("is empty", "export it again", file="tracker.csv")
    runs.problem["broken"] = RuntimeError("a server is down")
    look(tmp_path, runs, now=time.time())
    (tmp_path / "data/raw/changed/forces.csv").write_bytes(b"new")
    (tmp_path / "data/raw/half <b>").mkdir()
    (tmp_path / "data/raw/.qqq").mkdir()
    arrive(tmp_path, "new")
    return tmp_path


def test_every_folder_is_told(hall):
    """What calls for somebody comes first."""
    assert states(hall) == {
        "wrong": FolderState.REJECTED,
        "broken": FolderState.FAILED,
        "half <b>": FolderState.INCOMPLETE,
        "changed": FolderState.WAITING,
        "new": FolderState.WAITING,
        "done": FolderState.DONE,
    }
    assert next(one.name for one in folder_statuses(hall)) == "wrong"


def test_links_hide_nothing(hall):
    """A circle ends no list; a link to a campaign is that one; one to nowhere is rejected."""
    raw = hall / "data/raw"
    (raw / "circle").symlink_to("circle")
    (raw / "again").symlink_to("done")
    (raw / "nowhere").mkdir()
    (raw / "nowhere/campaign.toml").symlink_to("gone.toml")
    found = states(hall)

    assert found["half <b>"] == FolderState.INCOMPLETE
    assert found["nowhere"] == FolderState.WAITING
    assert not {"again", "circle"} & {*found}
    with pytest.raises(InputError, match=r"campaign\.toml") as refused:
        find(hall, "nowhere").read()
    assert "init" not in str(refused.value)


def test_what_cannot_be_listed_is_not_empty(hall):
    """A share that is gone: told once, and on the page and by `doctor` as long as it is so."""
    raw, away = hall / "data/raw", hall / "away"
    raw.rename(away)
    raw.symlink_to("raw")  # in a circle
    told = [look(hall, Runs(), now=time.time()) for _ in range(2)]
    known = {one.what: one for one in doctor.examine(hall)}["campaigns"]

    assert [line.split(" (")[0] for one in told[0] for line in one.complaints] == [
        f"service: {raw} cannot be listed"
    ]
    assert told[1] == []
    assert (known.good, known.needed) == (False, True)
    assert f"{raw} cannot be listed" in known.text
    assert f"{raw} cannot be listed" in now(hall).decode()
    with pytest.raises(InputError, match="cannot be listed"):
        find(hall, "new")


def test_the_page_says_why_and_when(hall):
    """The reason of a rejection, the time of the look, when what failed is tried again; escaped."""
    with supervisor.alone(hall, Preferences().service):
        shown = now(hall).decode()
    began = datetime.fromtimestamp(server.LastScan.of(hall).began)

    assert "tracker.csv: is empty; export it again" in shown
    assert f"the last was at {began.isoformat(' ', 'seconds')}" in shown
    assert re.search(r"tried 1 times, again at \d\d:\d\d:\d\d", shown)
    assert "1 rejected, 1 tried again" in shown
    assert "half &lt;b&gt;" in shown
    assert "half <b>" not in shown
    assert "qqq" not in shown


def test_the_one_at_work_is_told_while_it_is(tmp_path):
    """From before it is begun to its end, and no other."""
    arrive(tmp_path, "a", "b")
    seen = []

    class Looking(Runs):
        def campaign(self, campaign):
            seen.append(states(tmp_path))
            return super().campaign(campaign)

    look(tmp_path, Looking(), now=time.time())

    assert seen[0] == {"a": FolderState.RUNNING, "b": FolderState.WAITING}
    assert seen[1] == {"a": FolderState.DONE, "b": FolderState.RUNNING}
    assert set(states(tmp_path).values()) == {FolderState.DONE}


def test_one_that_was_handed_out_runs(tmp_path):
    """Whoever works at it."""
    (campaign,) = watch.campaigns.every(arrive(tmp_path, "a"))
    with watch._attending(campaign):
        assert states(tmp_path) == {"a": FolderState.RUNNING}


def test_a_page_of_nothing_and_of_odd_names(tmp_path):
    """No project, a name that is no text, a look that was noted by an earlier version."""
    assert b"No campaign yet" in now(tmp_path)
    (tmp_path / "data/raw").mkdir(parents=True)
    os.mkdir(os.fsencode(tmp_path / "data" / "raw") + b"/odd\xff")
    files.write(tmp_path / "data/processed" / server.LOOKED, dump({"began": 1.0, "ended": 2.0}))

    assert b"odd" in now(tmp_path)
