"""An answer that comes too late, and an object that changes within a second."""

import json
import subprocess
import sys
import time
from dataclasses import asdict
from multiprocessing.connection import Pipe

import pytest

from pipeline.app.outcome import Outcome
from pipeline.library.preferences import Service, Storage
from pipeline.service import guard, sync
from pipeline.service.guard import Guard, _Worker
from pipeline.store.campaign import CampaignFolder

ANSWERS = f"""
import json, os, sys, time
from multiprocessing.connection import Connection
line = Connection(int(sys.argv[1]))
while True:
    name = os.path.basename(json.loads(line.recv_bytes())["folder"])
    time.sleep(0.02 if name == "slow" else 0.0)
    line.send_bytes(json.dumps({asdict(Outcome("NAME", {}, ""))!r} | {{"campaign": name}}).encode())
"""


@pytest.fixture
def answering(monkeypatch):
    """Workers that compute nothing, and are late with the campaign `slow`."""

    def start(self):
        ours, theirs = Pipe()
        words = [sys.executable, "-I", "-S", "-c", ANSWERS, str(theirs.fileno())]
        process = subprocess.Popen(words, pass_fds=[theirs.fileno()], start_new_session=True)
        theirs.close()
        self._worker = _Worker(process, ours)
        return self._worker

    monkeypatch.setattr(Guard, "_start", start)


def test_a_late_answer_is_not_that_of_the_next_campaign(answering, tmp_path):
    """The slow process is ended; the next campaign has its own answer, by another one."""
    limits = Service.model_construct(**Service().model_dump() | {"limit_s": 0.001})
    with Guard(tmp_path, "local", limits) as made:
        slow = made.campaign(CampaignFolder(tmp_path, tmp_path / "slow"))
        made.limits = Service()
        quick = made.campaign(CampaignFolder(tmp_path, tmp_path / "quick"))

    assert (slow.campaign, slow.exit_code) == ("slow", 6)
    assert (quick.campaign, quick.exit_code) == ("quick", 0)
    assert guard._TAKES > 1


class Bucket:
    """Objects with times in whole seconds."""

    shown = "s3://robots/raw"

    def __init__(self, content, put):
        self.content, self.put = content, put

    def __enter__(self):
        return self

    def __exit__(self, *_):
        """Nothing was opened."""

    def marks(self):
        """Size and time of each."""
        return {name: (len(data), self.put) for name, data in self.content.items()}

    def read(self, name, mark):
        """The content as it is now."""
        return self.content[name]


@pytest.mark.parametrize("age_s", [0.0, 3600.0])
def test_an_object_that_may_still_change_is_read_again(tmp_path, monkeypatch, age_s):
    """Two uploads in one second have one size and one time; an old object is read once."""
    put = float(int(time.time())) - age_s
    bucket = Bucket({"a/campaign.toml": b"x = 1", "a/loads.csv": b"100"}, put)
    monkeypatch.setattr(sync, "Afar", lambda url: bucket)
    where = Storage(raw="s3://robots/raw")
    assert sync.fetch(tmp_path, where) == []
    bucket.content["a/loads.csv"] = b"200"

    assert sync.fetch(tmp_path, where) == []

    here = (tmp_path / "data" / "raw" / "a" / "loads.csv").read_bytes()
    assert here == (b"200" if age_s == 0 else b"100")
    assert json.loads((tmp_path / "data" / "processed" / "storage.json").read_text())
