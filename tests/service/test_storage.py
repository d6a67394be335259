"""Campaigns on object storage, against an S3-compatible server on this machine."""

import contextlib
import http.server
import itertools
import os
import shutil
import socket
import threading
from pathlib import Path

import localbucket
import made_bucket
import pytest
import report_sample

from pipeline.app.cli import _exit_code
from pipeline.app.outcome import outcome
from pipeline.base import files
from pipeline.base.errors import CannotWrite, InputError
from pipeline.library.preferences import Preferences, Storage, load
from pipeline.service import afar, listing
from pipeline.service import sync as mirror
from pipeline.service.afar import Afar
from pipeline.service.storage import Store
from pipeline.service.watch import Clock, scan

KEPT = Path(__file__).parents[2] / "data" / "raw" / "fanuc_r2000ic"
LONG_AGO = 1_700_000_000
AT_ONCE = Clock(pause=lambda _: None)


class Work:
    """Campaigns brought up to date without a process of their own."""

    def __init__(self, compute=None):
        self.compute = compute

    def campaign(self, campaign):
        """One of them."""
        return outcome(campaign, self.compute)

    def pages(self):
        """None to draw."""


@pytest.fixture(autouse=True)
def _near(request, monkeypatch):
    """Storage asked in this process; one of its own takes a second to begin."""
    if "by_a_process" not in request.fixturenames:
        monkeypatch.setattr(mirror, "Afar", Store)


@pytest.fixture
def by_a_process():
    """Storage asked in a process of its own."""


@pytest.fixture
def asked():
    """What the server was asked."""
    return []


@pytest.fixture
def bucket(tmp_path, monkeypatch, asked):
    """A bucket, as the folder that the server keeps it in."""

    class Handler(localbucket.S3Handler):
        data_root = tmp_path / "server"

        def log_message(self, format, *args):
            asked.append(f"{self.command} {self.path.partition('?')[0]}")

    with serving(Handler) as port:
        at(monkeypatch, port)
        here = tmp_path / "server" / "robots"
        here.mkdir(parents=True)
        yield here


@contextlib.contextmanager
def serving(handler):
    """A server of this machine; its port."""
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, args=[0.01], daemon=True).start()
        yield server.server_port
        server.shutdown()


def at(monkeypatch, port):
    """This machine's storage is behind this port."""
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "operator")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "not-for-the-screen")
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")


def upload(bucket, campaign, age_s=0):
    """A campaign into the bucket, as old as LONG_AGO less `age_s`."""
    folder = bucket / "raw" / campaign
    shutil.copytree(KEPT, folder, dirs_exist_ok=True)
    for path in folder.iterdir():
        os.utime(path, (LONG_AGO - age_s,) * 2)
    return folder


WHERE = Storage(raw="s3://robots/raw")


def said(outcomes):
    return [line for outcome in outcomes for line in outcome.complaints]


@pytest.mark.slow
def test_a_campaign_in_a_bucket_is_run_and_its_report_put_back(bucket, asked, tmp_path, capsys):
    """`run` takes it from there and leaves report and tables there; locks and truth stay here."""
    root = tmp_path / "project"
    upload(bucket, "c")
    files.write(
        root / "pipeline.toml",
        b'[storage]\nraw = "s3://robots/raw"\n'
        b'reports = "s3://robots/reports"\nprocessed = "s3://robots/tables"\n',
    )
    files.write(root / "data" / "processed" / "c.truth.json", b"{}")
    code = _exit_code(["run", "--engine", "local", "--root", str(root)])
    there = {path.relative_to(bucket).as_posix() for path in bucket.rglob("*") if path.is_file()}
    put = [line for line in asked if line.startswith("PUT")]
    asked.clear()
    again = _exit_code(["run", "--engine", "local", "--root", str(root)])

    assert (code, again, capsys.readouterr().err) == (0, 0, "")
    assert {"reports/c/index.html", "reports/c/report.pdf", "reports/index.html"} <= there
    assert {"tables/c/40_estimate.parquet", "tables/c/manifest.json"} <= there
    assert not [name for name in there if ".lock" in name or "truth" in name or "storage" in name]
    report = root / "reports" / "c" / "index.html"
    assert (bucket / "reports" / "c" / "index.html").read_bytes() == report.read_bytes()
    assert put
    assert asked == ["GET /robots"]  # the second time: one look, nothing travels


def test_only_changed_answers_are_put_back(bucket, tmp_path):
    """Reports and tables, each once as long as it stays as it is; locks, notes and truth never."""
    where = Storage(reports="s3://robots/reports", processed="s3://robots/tables")
    tables = tmp_path / "data" / "processed"
    for path in (
        "c/40_estimate.parquet",
        "c/manifest.json",
        "c/seen.json",
        "c/.lock",
        "t.truth.json",
    ):
        files.write(tables / path, path.encode())
    files.write(tmp_path / "reports" / "c" / "index.html", b"page")
    assert mirror.publish(tmp_path, where) == []
    found = {path.relative_to(bucket).as_posix() for path in bucket.rglob("*") if path.is_file()}
    (bucket / "reports" / "c" / "index.html").write_bytes(b"theirs")
    files.write(tables / "c" / "40_estimate.parquet", b"newer")
    mirror.publish(tmp_path, where)

    assert found == {
        "reports/c/index.html",
        "tables/c/40_estimate.parquet",
        "tables/c/manifest.json",
    }
    assert (bucket / "reports" / "c" / "index.html").read_bytes() == b"theirs"
    assert (bucket / "tables" / "c" / "40_estimate.parquet").read_bytes() == b"newer"


def test_a_write_that_is_lost_is_told_and_done_again(tmp_path, monkeypatch):
    """The storage says that it has it, and lists it not; what was kept is not put twice."""
    put, lost = [], ["/robots/reports/c/report.pdf", "/robots/reports/c/report.pdf"]

    class Losing(localbucket.S3Handler):
        data_root = tmp_path / "server"

        def _send(self, *args, **kwargs):
            name, _, query = self.path.partition("?")
            if self.command == "POST" and query.startswith("uploadId"):
                put.append(name.rpartition("/")[2])
                if name in lost:
                    lost.remove(name)
                    (self.data_root / name[1:]).unlink()
            super()._send(*args, **kwargs)

    for name in ("c/index.html", "c/report.pdf", "index.html"):
        files.write(tmp_path / "reports" / name, name.encode())
    with serving(Losing) as port:
        at(monkeypatch, port)
        (tmp_path / "server" / "robots").mkdir(parents=True)
        first, second, third = (
            mirror.publish(tmp_path, Storage(reports="s3://robots/reports")) for _ in range(3)
        )

    assert [outcome.exit_code for outcome in (*first, *second, *third)] == [3, 3]
    assert "c/report.pdf cannot be written (it has lost 1 of 3" in said(first)[0]
    assert sorted(put) == ["index.html", "index.html", *["report.pdf"] * 3]
    assert (tmp_path / "server/robots/reports/c/report.pdf").read_bytes() == b"c/report.pdf"


def test_only_what_changed_travels(bucket, asked, tmp_path):
    """One object is put again: it alone is fetched, and an equal one changes no file here."""
    folder = upload(bucket, "c")
    mirror.fetch(tmp_path, WHERE)
    here = tmp_path / "data" / "raw" / "c"
    before = {path.name: path.stat().st_mtime_ns for path in here.iterdir()}
    for path in KEPT.iterdir():
        assert (here / path.name).read_bytes() == path.read_bytes()
    asked.clear()
    (folder / "forces.csv").write_bytes(b"changed")
    os.utime(folder / "joints.csv", (LONG_AGO + 5,) * 2)
    mirror.fetch(tmp_path, WHERE)
    fetched = {line.rpartition("/")[2] for line in asked if "/raw/c/" in line}

    assert fetched == {"forces.csv", "joints.csv"}
    assert (here / "forces.csv").read_bytes() == b"changed"
    assert (here / "joints.csv").stat().st_mtime_ns == before["joints.csv"]


def test_a_change_within_the_second_of_the_copy_is_seen(bucket, tmp_path):
    """Same size, same second: storage shows no difference, so young objects are looked at again."""
    path = upload(bucket, "c") / "forces.csv"
    path.write_bytes(b"one")
    mirror.fetch(tmp_path, WHERE)
    stamp = path.stat().st_mtime
    path.write_bytes(b"two")
    os.utime(path, (stamp, stamp))
    mirror.fetch(tmp_path, WHERE)

    assert (tmp_path / "data/raw/c/forces.csv").read_bytes() == b"two"


def test_a_campaign_that_still_arrives_in_the_bucket_waits(bucket, tmp_path):
    """What grows there while we wait is not run before the next look."""
    folder, runs = upload(bucket, "c"), []

    def compute(campaign):
        runs.append((campaign.folder / "forces.csv").read_bytes())
        return report_sample.answer()

    def growing(_):
        (folder / "forces.csv").write_bytes(b"all of it")

    preferences = Preferences(storage=WHERE)
    assert list(scan(tmp_path, preferences, Work(compute), Clock(pause=growing))) == []
    list(scan(tmp_path, preferences, Work(compute), AT_ONCE))

    assert runs == [b"all of it"]


def test_work_of_this_machine_is_never_replaced(bucket, tmp_path):
    """A campaign of the same name, a copy that was edited: a sentence, and no file moves."""
    upload(bucket, "mine")
    edited = upload(bucket, "edited")
    files.write(tmp_path / "data/raw/mine/campaign.toml", b"format = 1")
    assert len(said(mirror.fetch(tmp_path, WHERE))) == 1
    mine = tmp_path / "data/raw/edited/forces.csv"
    mine.write_bytes(b"mine")
    mirror.fetch(tmp_path, WHERE)  # nothing changed there: nothing to say
    (edited / "forces.csv").unlink()  # not even then
    assert [outcome.campaign for outcome in mirror.fetch(tmp_path, WHERE)] == ["edited", "mine"]
    assert mine.read_bytes() == b"mine"
    (edited / "forces.csv").write_bytes(b"theirs")
    (edited / "joints.csv").write_bytes(b"theirs")
    refused = mirror.fetch(tmp_path, WHERE)

    assert [outcome.campaign for outcome in refused] == ["edited", "mine"]
    assert "is not what was copied from s3://robots/raw; move it" in said(refused)[0]
    assert mine.read_bytes() == b"mine"
    assert (mine.parent / "joints.csv").read_bytes() == (KEPT / "joints.csv").read_bytes()
    assert [path.name for path in (tmp_path / "data/raw/mine").iterdir()] == ["campaign.toml"]


def test_what_vanishes_there(bucket, tmp_path):
    """A file taken out of a campaign goes here, too, and comes back when lost; a campaign stays."""
    folder = upload(bucket, "c")
    mirror.fetch(tmp_path, WHERE)
    here = tmp_path / "data" / "raw" / "c"
    (folder / "README.md").unlink()
    files.write(here / "notes.txt", b"of the operator")
    mirror.fetch(tmp_path, WHERE)
    assert not (here / "README.md").exists()
    assert (here / "notes.txt").exists()

    (here / "forces.csv").unlink()
    mirror.fetch(tmp_path, WHERE)
    assert (here / "forces.csv").exists()
    shutil.rmtree(folder)
    assert mirror.fetch(tmp_path, WHERE) == []
    assert (here / "forces.csv").exists()


def test_a_name_cannot_leave_data_raw(tmp_path, monkeypatch):
    """Objects may be called anything; nothing is written outside of its campaign."""
    names = ["../x/campaign.toml", "a/campaign.toml", "a/../../../b", ".c/campaign.toml"]
    names += ["d\\e/f", "without/forces.csv", "lying-about.csv", "good/campaign.toml"]
    monkeypatch.setattr(Store, "marks", lambda _: dict.fromkeys(names, (1, 0.0)))
    monkeypatch.setattr(Store, "read", lambda *_: b"x")
    (refused,) = mirror.fetch(tmp_path, WHERE)
    found = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")}

    assert {name for name in found if (tmp_path / name).is_file()} == {
        "data/raw/good/campaign.toml",
        "data/processed/storage.json",
    }
    assert refused.campaign == "a"


def test_a_campaign_arrives_whole(bucket, tmp_path, monkeypatch):
    """campaign.toml comes last, for a folder without one is no campaign yet."""
    upload(bucket, "c")
    written, write = [], files.write
    monkeypatch.setattr(
        files, "write", lambda path, data: (written.append(path), write(path, data))
    )
    mirror.fetch(tmp_path, WHERE)

    assert [path.name for path in written if path.parent.name == "c"][-1] == "campaign.toml"


def test_a_storage_that_goes_away_meanwhile_is_told_once(tmp_path, monkeypatch):
    """Not once for each campaign, and no further campaign is asked for."""
    asked = []

    def there(_):
        if asked:
            raise InputError("s3://robots/raw cannot be read", "check", passing=True)
        return {f"{c}/campaign.toml": (1, 0.0) for c in "ab"}

    def away(_, name, mark):
        asked.append(name)
        raise InputError("s3://robots/raw cannot be read", "check", passing=True)

    monkeypatch.setattr(Store, "marks", there)
    monkeypatch.setattr(Store, "read", away)

    assert [outcome.campaign for outcome in mirror.fetch(tmp_path, WHERE)] == ["storage"]
    assert asked == ["a/campaign.toml"]


def test_each_look_puts_answers_back(bucket, tmp_path):
    """`watch` and `serve` do as `run` does."""
    files.write(tmp_path / "reports" / "index.html", b"page")
    preferences = Preferences(storage=Storage(reports="s3://robots/reports"))
    assert list(scan(tmp_path, preferences, Work(), AT_ONCE)) == []

    assert (bucket / "reports" / "index.html").read_bytes() == b"page"


def test_a_key_in_the_address_is_not_shown():
    """Who writes it there has it in pipeline.toml, and nowhere else."""
    assert Store("s3://key:secret@robots/raw?region=x").shown == "s3://robots/raw"


class Closed(http.server.BaseHTTPRequestHandler):
    """A storage that lets nobody in, in the words of S3."""

    def do_GET(self):
        """As S3 answers a wrong key."""
        body = b"<Error><Code>AccessDenied</Code><Message>Access Denied</Message></Error>"
        self.send_response(403)
        self.send_header("Content-Type", "application/xml")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format, *args):
        """Say nothing."""


def test_denied_is_said_in_a_sentence(tmp_path, monkeypatch, capsys):
    """Exit code 5 and the way out on one line, and no key on the screen."""
    (tmp_path / "pipeline.toml").write_text('[storage]\nraw = "s3://robots/raw"\n')
    with serving(Closed) as port:
        at(monkeypatch, port)
        code = _exit_code(["run", "--engine", "local", "--root", str(tmp_path)])
    err = capsys.readouterr().err

    assert code == 5
    assert err.startswith("storage: s3://robots/raw cannot be read (access is denied); give a key")
    assert len(err.splitlines()) == 1
    assert "not-for-the-screen" not in err


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("s3://no-such-bucket/raw", "(there is no such bucket); make it"),
        ("s3://robots/raw?nonsense=1", "Unexpected query parameter"),
        ("nonsense://robots/raw", "Protocol not known: nonsense"),
    ],
)
def test_a_wrong_address_is_said_in_a_sentence(bucket, tmp_path, address, words):
    """The address, what is wrong with it, what to do."""
    [line] = said(mirror.fetch(tmp_path, Storage(raw=address)))

    assert line.startswith(f"storage: {address.partition('?')[0]} cannot be read (")
    assert words in line
    assert said(mirror.publish(tmp_path, Storage(reports=address))) == []  # nothing to put there
    files.write(tmp_path / "reports" / "index.html", b"page")
    [line] = said(mirror.publish(tmp_path, Storage(reports=address)))
    assert "index.html cannot be written (" in line


@pytest.mark.slow
def test_an_unreachable_storage_stops_no_campaign_and_is_told_once(tmp_path, monkeypatch):
    """What is here is run all the same; the next look says nothing new."""
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        at(monkeypatch, nobody.getsockname()[1])
        shutil.copytree(KEPT, tmp_path / "data" / "raw" / "c")
        preferences, work = Preferences(storage=WHERE), Work(lambda _: report_sample.answer())
        first = list(scan(tmp_path, preferences, work, AT_ONCE))
        files.write(tmp_path / "reports" / "c" / "result.json", b"{}")
        second = list(scan(tmp_path, preferences, work, AT_ONCE))

    assert [outcome.campaign for outcome in first] == ["c", "storage"]
    assert "(it cannot be reached); check the network" in said(first[1:])[0]
    assert second == []


def test_an_address_without_a_scheme_is_refused(tmp_path):
    """A folder of this machine is no storage."""
    (tmp_path / "pipeline.toml").write_text('[storage]\nraw = "bucket/raw"\n')

    with pytest.raises(Exception, match=r"storage\.raw: an address looks like s3://bucket/folder"):
        load(tmp_path)


GOOD = {f"raw/{name}/campaign.toml": b"good" for name in ("Aa", "z")}
ODD = {
    "long": {"raw/b/campaign.toml": b"x", f"raw/b/{'x' * 300}": b"x"},
    "almost": {"raw/b/campaign.toml": b"x", f"raw/b/{'x' * 250}": b"x"},
    "long campaign": {f"raw/{'b' * 300}/campaign.toml": b"x"},
    "both": {"raw/b/campaign.toml": b"x", "raw/b/x": b"x", "raw/b/x/y": b"x"},
    "empty": {"raw//campaign.toml": b"x"},
    "empty inside": {"raw/b/campaign.toml": b"x", "raw/b//x": b"x"},
    "dots": {"raw/b/campaign.toml": b"x", "raw/b/../../../x": b"x"},
    "backslash": {"raw/b/campaign.toml": b"x", "raw/b/..\\x": b"x"},
    "line": {"raw/b/campaign.toml": b"x", "raw/b/x\ny": b"x"},
    "escape": {"raw/b\x1b[2J/campaign.toml": b"x"},
}


@pytest.fixture
def made(monkeypatch):
    """Storage with these objects, whatever their names; a function that makes it."""
    with contextlib.ExitStack() as stack:

        def make(objects, **lies):
            at(monkeypatch, stack.enter_context(serving(made_bucket.handler(objects, **lies))))

        yield make


@pytest.mark.parametrize("odd", ODD.values(), ids=ODD)
def test_odd_objects_stop_no_other_campaign(made, tmp_path, odd):
    """Their own campaign is left out with a sentence, and none of its objects is written."""
    made(GOOD | odd)

    (refused,) = mirror.fetch(tmp_path, WHERE)
    here = {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file()}

    assert here == {"data/processed/storage.json", *(f"data/{name}" for name in GOOD)}
    assert refused.exit_code == 5
    assert refused.complaints[0].isprintable()
    assert "rename" in refused.complaints[0]


@pytest.mark.parametrize("name", ["/x/campaign.toml", "b/x\0", "/campaign.toml", "b/\ud800"])
def test_what_no_listing_of_s3_holds_stops_nobody_either(tmp_path, monkeypatch, name):
    """Other drivers may list it: nothing is written outside, and the others are fetched."""
    names = [name, "b/campaign.toml", "z/campaign.toml"]
    monkeypatch.setattr(Store, "marks", lambda _: dict.fromkeys(names, (1, 0.0)))
    monkeypatch.setattr(Store, "read", lambda *_: b"x")
    refused = mirror.fetch(tmp_path, WHERE)

    assert (tmp_path / "data" / "raw" / "z" / "campaign.toml").is_file()
    assert len(refused) == 1 or name == "/x/campaign.toml"
    assert not Path("/x").exists()


def test_an_object_that_nobody_may_read_stops_no_other_campaign(made, tmp_path):
    """As one that was archived, or has a key of its own."""
    made(GOOD | {"raw/b/campaign.toml": b"x"}, refused=["raw/b/campaign.toml"])

    (refused,) = mirror.fetch(tmp_path, WHERE)

    assert refused.campaign == "b"
    assert (tmp_path / "data" / "raw" / "z" / "campaign.toml").read_bytes() == b"good"


def test_more_than_a_campaign_has_is_not_read(made, tmp_path, asked):
    """A service reads a campaign into its memory: it is refused by what the listing tells."""
    many = {f"raw/b/{k}": b"" for k in range(20_001)}
    made(GOOD | many | {"raw/b/campaign.toml": b"x"})

    (refused,) = mirror.fetch(tmp_path, WHERE)

    assert "20002 objects" in refused.complaints[0]
    assert not (tmp_path / "data" / "raw" / "b").exists()


@pytest.mark.slow  # it is asked again and again for some seconds
@pytest.mark.parametrize(
    "answer", [(429, "SlowDown"), (500, "InternalError"), (503, "ServiceUnavailable")]
)
def test_a_storage_that_is_out_of_order_is_waited_for(made, tmp_path, answer):
    """Whether it lists nothing or gives nothing: a sentence that fits, nothing half, then all."""
    objects = GOOD | {"raw/b/campaign.toml": b"x"}
    made(objects, broken={"": answer})
    (nothing,) = mirror.fetch(tmp_path, WHERE)
    made(objects, broken={"raw/b/campaign.toml": answer})
    (one,) = mirror.fetch(tmp_path, WHERE)

    for problem in (nothing, one):
        assert problem.passing
        assert "busy or out of order); run it again in a moment" in said([problem])[0]
    assert {path.parent.name for path in tmp_path.rglob("campaign.toml")} == {"Aa", "z"}
    made(objects)
    assert mirror.fetch(tmp_path, WHERE) == []
    assert (tmp_path / "data" / "raw" / "b" / "campaign.toml").read_bytes() == b"x"


@pytest.mark.parametrize("age_s", [0, 60])
def test_an_old_object_is_not_taken_for_the_new_one(made, tmp_path, age_s):
    """A storage of several machines may list the new one and give the old one for a while."""
    name, old, new = "raw/b/campaign.toml", b"old", b"longer" if not age_s else b"new"
    times = {"times": {name: made_bucket.LONG_AGO + 60}} if age_s else {}
    made(GOOD | {name: old})
    assert mirror.fetch(tmp_path, WHERE) == []
    made(GOOD | {name: old}, listed={name: new}, **times)
    (stale,) = mirror.fetch(tmp_path, WHERE)
    here = tmp_path / "data" / name
    assert stale.campaign == "b"
    assert stale.passing
    assert here.read_bytes() == old
    made(GOOD | {name: new}, **({"changed": times["times"]} | times if times else {}))

    assert mirror.fetch(tmp_path, WHERE) == []
    assert here.read_bytes() == new


def test_an_object_that_is_only_listed_is_asked_for_again(made, tmp_path):
    """Its campaign waits as a whole, the others are copied, and the sentence is about it."""
    name = "raw/b/joints.csv"
    objects = GOOD | {"raw/b/campaign.toml": b"x"}
    made(objects, listed={name: b"y"})
    (stale,) = mirror.fetch(tmp_path, WHERE)

    assert stale.campaign == "b"
    assert stale.passing
    assert "lists what is not there; run it again in a moment" in said([stale])[0]
    assert {path.parent.name for path in tmp_path.rglob("campaign.toml")} == {"Aa", "z"}
    made(objects | {name: b"y"})
    assert mirror.fetch(tmp_path, WHERE) == []
    assert (tmp_path / "data" / name).read_bytes() == b"y"


NEXT = itertools.count(1000)
LIES = {
    "stated longer": {"stated": b"1,2\n" * 9},
    "stated shorter": {"stated": b"1,2\n"},
    "cut": {"given": b"1,2\n1,2"},
    "empty": {"given": b""},
    "cut elsewhere each time": {"given": lambda: (b"1,2\n" * 6)[: next(NEXT) % 9]},
    "another each time": {"given": lambda: b"1,2\n" * 5 + b"%d" % next(NEXT)},
}


@pytest.mark.parametrize("digests", [True, False])
@pytest.mark.parametrize("lie", LIES)
def test_an_object_that_is_not_delivered_as_stated_is_not_taken(made, tmp_path, lie, digests):
    """Neither what is missing nor what was there before it may become a reading."""
    name = "raw/b/forces.csv"
    objects = GOOD | {"raw/b/campaign.toml": b"x", name: b"1,2\n" * 5 + b"3,4\xa5"}
    lies = {how: {name: content} for how, content in LIES[lie].items()}
    made(objects, digests=digests, **lies)
    refused = mirror.fetch(tmp_path, WHERE)
    if lie == "another each time" and not digests:  # nothing says that it is another
        assert refused == []
        return

    (one,) = refused
    assert one.campaign == "b"
    assert one.passing
    assert "forces.csv" in said(refused)[0]
    assert {path.parent.name for path in tmp_path.rglob("campaign.toml")} == {"Aa", "z"}
    made(objects)
    assert mirror.fetch(tmp_path, WHERE) == []
    assert (tmp_path / "data" / name).read_bytes() == objects[name]


def test_a_digest_that_is_none_refuses_no_object(made, tmp_path):
    """As with encryption by a key service: what is the same twice is taken."""
    made(GOOD, stated={name: data[::-1] for name, data in GOOD.items()})

    assert mirror.fetch(tmp_path, WHERE) == []
    assert (tmp_path / "data/raw/z/campaign.toml").read_bytes() == b"good"


def test_half_a_listing_removes_no_copy(made, tmp_path):
    """What is not listed, and there when asked for, was not taken out of its campaign."""
    name, objects = "raw/z/forces.csv", GOOD | {"raw/z/forces.csv": b"1,2"}
    made(objects)
    assert mirror.fetch(tmp_path, WHERE) == []
    made(objects, unlisted=[name])
    (half,) = mirror.fetch(tmp_path, WHERE)

    assert half.passing
    assert "does not list z/forces.csv, which is there" in said([half])[0]
    assert (tmp_path / "data" / name).read_bytes() == b"1,2"


def test_what_a_process_asks_is_what_is_there(bucket):
    """Names of any letters, contents and what a driver complains of come back from there."""
    name, data = "ä\u202e 𝄞/x", bytes(range(256)) * 9
    with Afar(WHERE.raw) as there, Store(WHERE.raw) as here:
        there.write(name, data)
        assert there.marks() == here.marks()
        assert there.read(name, there.marks()[name]) == data
        assert [there.has(name), there.has("y")] == [True, False]
        with pytest.raises(InputError, match="lists what is not there"):
            there.read("y", (1, 0.0))
    wrong = "s3://robots/raw?nonsense=1"
    with Afar(wrong) as there:
        with pytest.raises(InputError, match="Unexpected query parameter"):
            there.marks()
        with pytest.raises(CannotWrite, match="Unexpected query parameter"):
            there.write("x", b"x")


def test_a_listing_without_an_end_is_ended(made, by_a_process, tmp_path, monkeypatch):
    """The storage says each time that there is more: a sentence, and the look goes on."""
    monkeypatch.setattr(afar, "_LISTING_S", 2.0)
    made(GOOD, more=True)

    (endless,) = mirror.fetch(tmp_path, WHERE)

    assert endless.passing
    assert "raw cannot be read (no answer within 2 s and 2 GiB)" in said([endless])[0]
    assert "give a folder that holds campaigns alone" in said([endless])[0]


@pytest.mark.slow
@pytest.mark.parametrize(("lost_s", "copied"), [(300.0, {"Aa", "z"}), (4.0, {"Aa"})])
def test_what_comes_too_slowly_is_not_waited_for(
    made, by_a_process, tmp_path, monkeypatch, lost_s, copied
):
    """Its campaign is left out, and the rest, too, once too much time is lost."""
    monkeypatch.setattr(afar, "_OBJECT_S", 5.0)
    monkeypatch.setattr(afar.Afar, "_left_s", lost_s)
    objects = GOOD | {"raw/b/campaign.toml": b"x" * 999}
    made(objects, slow=["raw/b/campaign.toml"])
    (slow,) = mirror.fetch(tmp_path, WHERE)

    assert slow.passing
    words = "its objects come too slowly" if lost_s < 5 else "b/campaign.toml cannot be read (no"
    assert words in said([slow])[0]
    assert {path.parent.name for path in tmp_path.rglob("campaign.toml")} == copied


def test_a_listing_of_more_than_campaigns_is_refused(made, tmp_path, monkeypatch):
    """It ends, and is longer than what may be worth reading."""
    monkeypatch.setattr(listing, "_MOST", 3)
    made(GOOD | {"raw/z/more": b"", "raw/z/most": b""})

    (long,) = mirror.fetch(tmp_path, WHERE)

    assert "has more than" in said([long])[0]


class Login(http.server.BaseHTTPRequestHandler):
    """A page to log in at, whatever is asked for."""

    def do_GET(self):
        """The page."""
        self.do_HEAD()
        self.wfile.write(b"<html>log in</html>")

    def do_HEAD(self):
        """What comes before it."""
        self.send_response(200)
        self.send_header("Content-Length", "19")
        self.end_headers()

    def log_message(self, format, *args):
        """Say nothing."""


def test_a_page_to_log_in_at_is_no_empty_storage(bucket, tmp_path, monkeypatch):
    """It is told, once it stands between; an empty bucket is none."""
    assert mirror.fetch(tmp_path, WHERE) == []
    with serving(Login) as port:
        at(monkeypatch, port)
        (page,) = mirror.fetch(tmp_path, WHERE)

    assert page.passing
    assert "is no storage: it has whatever it is asked for" in said([page])[0]
    assert "log in to the network" in said([page])[0]


JUNK = [
    b"",
    b"[1]",
    b'{"copied": 1}',
    b'{"copied": {"z/campaign.toml": 5}}',
    b'{"copied": {"z/campaign.toml": []}}',
    b'{"copied": {"z/campaign.toml": [4, 0.0]}}',
    b'{"told": 5}',
    b'{"put": [1]}',
    b'{"other": 1}',
]


@pytest.mark.parametrize("junk", JUNK)
def test_a_damaged_note_is_none(made, tmp_path, junk):
    """What is known of the storage is found out again; the same objects are copies of ours."""
    made(GOOD)
    assert mirror.fetch(tmp_path, WHERE) == []
    (tmp_path / "data" / "processed" / "storage.json").write_bytes(junk)

    assert mirror.fetch(tmp_path, WHERE) == []
    assert mirror.unreported(tmp_path, []) == []
