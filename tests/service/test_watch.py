"""By itself: what is new or changed and complete is run once, and changed verdicts are told."""

import http.server
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import report_sample

from pipeline.app.outcome import failed, outcome
from pipeline.base import files
from pipeline.base.errors import CannotWrite, InputError
from pipeline.library import preferences
from pipeline.library.preferences import Notify, Preferences, Service
from pipeline.run import run
from pipeline.service import supervisor, watch
from pipeline.service.server import LastScan, Running
from pipeline.store import campaign as campaigns
from pipeline.store.campaign import find

HERE = Path(__file__).parents[2]
KEPT = HERE / "data" / "raw" / "fanuc_r2000ic"


class Runs:
    """Stands in for the guard: counts, fails when told, and leaves a result behind."""

    def __init__(self, verdict="adequate", compute=None):
        self.of, self.verdict, self.problem = [], verdict, {}
        self.compute = compute or self.made

    def campaign(self, campaign):
        """Run one campaign."""
        self.of.append(campaign.name)
        return outcome(campaign, self.compute)

    def pages(self):
        """Draw nothing."""

    def made(self, campaign):
        """The answer of a campaign."""
        if campaign.name in self.problem:
            raise self.problem[campaign.name]
        answer = report_sample.revised(report_sample.answer(), self.said)
        files.write(campaign.reports / "result.json", json.dumps(answer.as_json()).encode())
        return answer

    def said(self, content):
        """What stands in its result.json."""
        content["verdict_sentence"] = ["Said."]
        content["diagnosis"]["verdict"] = self.verdict


@pytest.fixture
def runs():
    return Runs()


def arrive(root, *names):
    """Copies of the kept campaign under data/raw."""
    for name in names:
        shutil.copytree(KEPT, root / "data" / "raw" / name)
    return root


def look(root, runs, pause=lambda _: None, webhook=None, now=0.0):
    """One look at data/raw: what became of each campaign that was taken."""
    clock = watch.Clock(lambda: now, pause)
    return list(watch.scan(root, Preferences(notify=Notify(webhook=webhook)), runs, clock))


def test_new_campaigns_are_run_once_and_changed_ones_again(tmp_path, runs):
    """The second look takes nothing; a third, after one file was replaced, that campaign."""
    arrive(tmp_path, "a", "b")
    look(tmp_path, runs)
    look(tmp_path, runs)
    (tmp_path / "data/raw/b/forces.csv").write_bytes(b"changed")
    look(tmp_path, runs)

    assert runs.of == ["a", "b", "b"]


def test_a_folder_that_still_grows_waits_for_the_next_look(tmp_path, runs):
    """A file that changes while we wait keeps its campaign back, and no other."""
    arrive(tmp_path, "a", "b")
    growing = tmp_path / "data/raw/a/forces.csv"
    look(tmp_path, runs, pause=lambda _: growing.write_bytes(growing.read_bytes() + b"more"))
    assert runs.of == ["b"]

    look(tmp_path, runs)
    assert runs.of == ["b", "a"]


def test_a_rejected_campaign_is_reported_once_and_stops_nothing(tmp_path, runs):
    """The others run; it is taken again only when its folder changes."""
    arrive(tmp_path, "a", "b")
    runs.problem["a"] = InputError("is empty", "export it again", file="tracker.csv")
    first, _ = look(tmp_path, runs)
    look(tmp_path, runs)

    assert first.exit_code == 5
    assert first.complaints == ["a: tracker.csv: is empty; export it again."]
    assert runs.of == ["a", "b"]
    (tmp_path / "data/raw/a/forces.csv").write_bytes(b"new")
    look(tmp_path, runs)
    assert runs.of == ["a", "b", "a"]


def test_a_file_mended_with_its_old_size_and_time_is_read_again(tmp_path, runs):
    """A copy program restores both; what was rejected, or answered, was the file before."""
    arrive(tmp_path, "a", "b")
    runs.problem["a"] = InputError("is empty", "export it again", file="tracker.csv")
    look(tmp_path, runs)
    for name in "ab":
        path = tmp_path / "data/raw" / name / "forces.csv"
        before = path.stat()
        path.write_bytes(path.read_bytes()[::-1])
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
        assert path.stat()[6:9:2] == before[6:9:2]  # size, and time of the content
    look(tmp_path, runs)
    look(tmp_path, runs)

    assert runs.of == ["a", "b", "a", "b"]


def test_reports_that_cannot_be_looked_at_stop_no_other_campaign(tmp_path, runs):
    """A link to a name that no file system takes refuses every look, as a withdrawn permission."""
    arrive(tmp_path, "a")
    look(tmp_path, runs)
    shutil.rmtree(tmp_path / "reports/a")
    (tmp_path / "reports/a").symlink_to("n" * 300)
    arrive(tmp_path, "b")
    made = look(tmp_path, runs)

    assert runs.of == ["a", "a", "b"]
    assert [one.campaign for one in made if "error" in one.content] == ["a"]
    assert f"{tmp_path}/reports/a" in made[0].complaints[0]


@pytest.mark.parametrize(
    "problem",
    [
        InputError("was away", "try again", passing=True),
        RuntimeError("a server is down"),
        InputError("not valid TOML", "correct that place", file="pipeline.toml"),
    ],
    ids=["a share that was away", "an internal error", "preferences that somebody edits"],
)
def test_what_may_heal_is_tried_after_growing_pauses(tmp_path, runs, problem):
    """A minute, four, sixteen ... a day at most; a changed folder is tried at once."""
    arrive(tmp_path, "a")
    runs.problem["a"] = problem
    due = list(itertools.accumulate([0, 1, 4, 16, 64, 256, 1024, 1440, 1440]))
    tried = []
    for minute in sorted({0, *due, *(minute - 1 for minute in due[2:])}):
        look(tmp_path, runs, now=60.0 * minute)
        tried += [minute] * (len(runs.of) - len(tried))

    assert tried == due
    (tmp_path / "data/raw/a/forces.csv").write_bytes(b"new")
    look(tmp_path, runs, now=60.0 * due[-1])
    assert len(runs.of) == len(due) + 1


def test_a_clock_that_is_set_back_makes_no_pause_longer(tmp_path, runs):
    """Tried in 2033, says the memory; now it is 2026 again."""
    arrive(tmp_path, "a")
    runs.problem["a"] = RuntimeError("a server is down")
    look(tmp_path, runs, now=2e9)
    look(tmp_path, runs, now=1.8e9)

    assert runs.of == ["a", "a"]


def test_new_code_runs_everything_again(tmp_path, runs, monkeypatch):
    """A result of another version of the program is none."""
    arrive(tmp_path, "a")
    look(tmp_path, runs)
    monkeypatch.setattr(watch.campaigns, "code_version", lambda: "another")
    look(tmp_path, runs)
    look(tmp_path, runs)

    assert runs.of == ["a", "a"]


def test_a_lost_report_is_made_again(tmp_path, runs):
    """Who deletes reports/ gets them back with the next look."""
    arrive(tmp_path, "a")
    look(tmp_path, runs)
    shutil.rmtree(tmp_path / "reports")
    look(tmp_path, runs)

    assert runs.of == ["a", "a"]


@pytest.fixture
def hook():
    """A webhook on this machine; what it got, and the status it answers with."""
    got, status = [], [200]

    class Hook(http.server.BaseHTTPRequestHandler):
        def do_POST(self):
            got.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(status[0])
            self.end_headers()

        def log_message(self, format, *args):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Hook) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/hook", got, status
        server.shutdown()


def test_a_changed_verdict_is_told_once(tmp_path, runs, hook):
    """First verdict and every other one reach the webhook; a run that changes nothing does not."""
    address, got, _ = hook
    arrive(tmp_path, "a")
    changed = tmp_path / "data/raw/a/forces.csv"
    for content, verdict in (("1", "adequate"), ("2", "adequate"), ("3", "unexplained")):
        changed.write_text(content)
        runs.verdict = verdict
        look(tmp_path, runs, webhook=address)

    assert [(one["before"], one["verdict"]) for one in got] == [
        (None, "adequate"),
        ("adequate", "unexplained"),
    ]
    assert got[1]["text"] == "a: adequate -> unexplained. Said."
    assert got[1]["report"] == str(tmp_path / "reports" / "a" / "index.html")


def test_what_may_heal_is_told_when_it_did_not(tmp_path, runs, hook):
    """Nobody is called for a share that is away for a minute; after the last try, once."""
    address, got, _ = hook
    arrive(tmp_path, "a")
    runs.problem["a"] = InputError("was away", "try again", passing=True)
    told = []
    for hour in range(4):
        look(tmp_path, runs, webhook=address, now=3600.0 * hour)
        told.append(len(got))

    assert told == [0, 0, 1, 1]
    assert got[0]["verdict"] == "failed"


def test_what_could_not_be_told_is_told_later(tmp_path, runs, hook):
    """A webhook that answers with an error, or nothing, gets the word with the next look."""
    address, got, status = hook
    arrive(tmp_path, "a")
    look(tmp_path, runs, webhook="http://127.0.0.1:9/nobody")
    status[0] = 500
    look(tmp_path, runs, webhook=address)
    status[0] = 200
    look(tmp_path, runs, webhook=address)
    look(tmp_path, runs, webhook=address)

    assert len(got) == 2
    assert runs.of == ["a"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[service]\ninterval_s = 0\n", "service.interval_s: "),
        ("[notify]\nwebhook = 'file:///etc/passwd'\n", "begins with https:// or http://"),
        ("[servise]\n", "servise: "),
        ("no toml", "not valid TOML"),
    ],
)
def test_wrong_preferences_are_named(tmp_path, text, said):
    """pipeline.toml with a wrong word or value is refused, with the word."""
    (tmp_path / "pipeline.toml").write_text(text)

    with pytest.raises(InputError, match=r"^pipeline\.toml:([12]:)? ") as problem:
        preferences.load(tmp_path)
    assert said in str(problem.value)


def test_the_command_line_outdoes_the_preferences(tmp_path):
    """--interval beats interval_s; what is not said stays."""
    (tmp_path / "pipeline.toml").write_text("[service]\ninterval_s = 600\nquiet_s = 9\n")

    assert preferences.load(tmp_path, {"interval_s": 30}).service.interval_s == 30
    assert preferences.load(tmp_path, {"interval_s": 30}).service.quiet_s == 9
    assert preferences.load(tmp_path / "none") == Preferences()


@pytest.mark.whole
def test_watch_runs_what_arrives_until_ctrl_c(tmp_path):
    """A campaign copied while `watch` looks has its report; Ctrl-C ends it with 130."""
    (tmp_path / "data" / "raw").mkdir(parents=True)
    (tmp_path / "pipeline.toml").write_text("[service]\ninterval_s = 5\nquiet_s = 1\n")
    process = subprocess.Popen(
        [sys.executable, "-m", "pipeline", "watch", "--json", "--root", tmp_path],
        cwd=HERE,
        env=os.environ | {"PYTHONPATH": str(HERE)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert "Ctrl-C stops" in process.stderr.readline()
        arrive(tmp_path, "a")
        line = json.loads(process.stdout.readline())
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()

    assert line == find(tmp_path, "a").result()
    assert (tmp_path / "reports" / "a" / "index.html").is_file()
    assert (process.returncode, out) == (130, "")
    assert err.startswith("Interrupted")


@pytest.mark.slow
def test_a_finished_run_is_not_repeated_when_its_memory_was_lost(tmp_path):
    """Killed between run and memory: the next look recognises the result and computes nothing."""
    arrive(tmp_path, "a")
    look(tmp_path, Runs(compute=run))
    campaign = find(tmp_path, "a")
    made = (campaign.reports / "result.json").stat().st_mtime_ns
    (campaign.processed / watch.MEMORY).unlink()
    time.sleep(0.01)
    [again] = look(tmp_path, Runs(compute=run))

    assert (campaign.reports / "result.json").stat().st_mtime_ns == made
    assert again.content == campaign.result()


def test_a_memory_that_is_no_file_is_none(tmp_path, runs):
    """A pipe that nobody writes to, a folder, a number: the campaign is run, and nobody waits."""
    arrive(tmp_path, "a", "b", "c")
    for name, make in (("a", os.mkfifo), ("b", os.mkdir), ("c", lambda path: path.write_text("5"))):
        (tmp_path / "data" / "processed" / name).mkdir(parents=True)
        make(tmp_path / "data" / "processed" / name / watch.MEMORY)
    look(tmp_path, runs)

    assert runs.of == ["a", "b", "c"]


def test_a_look_that_gets_no_further_is_seen(tmp_path, runs):
    """While it is at work it says so with every campaign; at its end it hangs no more."""
    arrive(tmp_path, "a", "b")
    noted = []
    clock = watch.Clock(lambda: 1000.0 + 600.0 * len(runs.of), lambda _: None)
    for _ in watch.scan(tmp_path, Preferences(), runs, clock):
        seen = LastScan.of(tmp_path)
        noted.append((seen.alive, seen.hangs(seen.alive + 900, 900), seen.hangs(1e9, 900)))

    assert noted == [(1600.0, False, True), (2200.0, False, True)]
    assert not LastScan.of(tmp_path).hangs(1e9, 900)


def test_a_page_that_was_not_drawn_is_drawn_by_the_next_look(tmp_path, runs):
    """Where it could not be, or the look was killed before; and then no more."""
    arrive(tmp_path, "a")
    drawn, wrong = [], [failed("overview", CannotWrite("no space left")), None]
    runs.pages = lambda: drawn.append(1) or wrong.pop(0)
    for _ in range(3):
        look(tmp_path, runs)
    assert (runs.of, len(drawn)) == (["a"], 2)

    files.write(tmp_path / "data/processed/look.json", b'{"began": 0.0}')
    wrong.append(None)
    look(tmp_path, runs)
    look(tmp_path, runs)
    assert len(drawn) == 3


def test_no_campaign_keeps_a_service_from_starting(tmp_path):
    """Whatever its folder is called, its tables lie beside the lock and not in its place."""
    for name in ("service.lock", "service.json", "look.json"):
        arrive(tmp_path, name)
    for one in campaigns.every(tmp_path):
        one.processed.mkdir(parents=True)
    with supervisor.alone(tmp_path, Service()):
        assert Running.of(tmp_path).process == os.getpid()


class HandsOut:
    """Leaves campaigns to others; counts what it was asked for."""

    def __init__(self):
        self.of, self.drawn = [], 0

    def campaign(self, campaign):
        """Somebody else is at it."""
        self.of.append(campaign.name)

    def pages(self):
        """Draw."""
        self.drawn += 1


def attend(root, name, runs, seen=None):
    """A campaign that was handed out, as a worker takes it up."""
    campaign = campaigns.find(root, name)
    return watch.attend(campaign, seen or watch.fingerprint(campaign.folder), runs)


def test_what_is_handed_out_is_done_by_who_attends_to_it(tmp_path, runs):
    """Until then every look hands it out again; then none does, and once more the page is drawn."""
    arrive(tmp_path, "a", "b")
    out = HandsOut()
    assert look(tmp_path, out) == []
    assert attend(tmp_path, "a", runs).verdict == "adequate"
    assert attend(tmp_path, "a", runs) is None
    look(tmp_path, out)
    attend(tmp_path, "b", runs)
    look(tmp_path, out)
    look(tmp_path, out)

    assert out.of == ["a", "b", "b"]
    assert runs.of == ["a", "b"]
    assert out.drawn == 3


def test_a_campaign_that_has_changed_since_waits_for_the_next_look(tmp_path, runs):
    """Who was handed the old one does nothing."""
    arrive(tmp_path, "a")
    seen = watch.fingerprint(tmp_path / "data" / "raw" / "a")
    (tmp_path / "data/raw/a/forces.csv").write_bytes(b"changed")

    assert attend(tmp_path, "a", runs, seen) is None
    assert runs.of == []


def test_everybody_sees_whether_somebody_attends_to_a_campaign(tmp_path):
    """While it is worked at, and no longer."""
    arrive(tmp_path, "a")
    campaign, during = campaigns.find(tmp_path, "a"), []

    def made(one):
        during.append(watch.attended(one))
        raise InputError("is empty", "export it again")

    attend(tmp_path, "a", Runs(compute=made))

    assert during == [True]
    assert not watch.attended(campaign)
