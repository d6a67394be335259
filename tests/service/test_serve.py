"""`pipeline serve` as people run it: its own process, Prefect's server, campaigns that arrive."""

import base64
import contextlib
import functools
import http.server
import json
import os
import re
import shutil
import signal
import socket
import socketserver
import sqlite3
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest
from get_browser import browser_path

from bench.bench_service import family, free_port
from pipeline.library.preferences import Service
from pipeline.service import supervisor
from pipeline.service.processes import alive

HERE = Path(__file__).parents[2]
KEPT = HERE / "data" / "raw" / "fanuc_r2000ic"
INTERVAL_S = 15
TEN = [f"c{k}" for k in range(10)]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.prefect,
    pytest.mark.xdist_group("prefect"),
]


@contextlib.contextmanager
def serving(root, port, stop=signal.SIGINT, command="serve", cwd=HERE, script=None):
    """`pipeline serve` until the end of the block; then the signal, and its exit code.

    It is started in the folder `cwd`, as a script where one is given.
    """
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("PREFECT_", "PIPELINE_"))}
    said = cwd / root / "said.txt"
    program = ["-m", "pipeline"] if script is None else [script]
    words = ["--port", str(port)] if command == "serve" else []
    with said.open("wb") as kept:
        process = subprocess.Popen(
            [sys.executable, *program, command, "--root", root, *words],
            cwd=cwd,
            env=clean | {"PYTHONPATH": str(HERE)},
            stdout=kept,
            stderr=kept,
        )
    ready = b"  the reports" if command == "serve" else b"Ctrl-C stops"
    try:
        until(lambda: process.poll() is not None or ready in said.read_bytes(), 150)
        yield process
        process.send_signal(stop)
        process.wait(timeout=60)
    finally:
        process.kill()
        process.wait()


def until(there, seconds):
    """Wait until it is there; how long it took [s]."""
    began = time.monotonic()
    while not there():
        assert time.monotonic() - began < seconds
        time.sleep(0.5)
    return time.monotonic() - began


def runs(root):
    """Name and state of every campaign's flow runs, from Prefect's own database."""
    question = (
        "select r.name, r.state_type from flow_run r join flow f on f.id = r.flow_id "
        "where f.name = 'identify-stiffness' order by r.name"
    )
    with contextlib.closing(sqlite3.connect(root / ".prefect" / "prefect.db")) as base:
        return base.execute(question).fetchall()


def reported(root, *names):
    return all((root / "reports" / name / "index.html").is_file() for name in names)


def test_serve_runs_what_arrives_and_survives_being_killed(tmp_path):
    """One in time, ten at once with a broken one among them, killed and started again."""
    raw, port = tmp_path / "data" / "raw", free_port()
    raw.mkdir(parents=True)
    (tmp_path / "pipeline.toml").write_text(f"[service]\ninterval_s = {INTERVAL_S}\nquiet_s = 2\n")
    with serving(tmp_path, port, stop=signal.SIGKILL):
        shutil.copytree(KEPT, raw / "first")
        until(lambda: reported(tmp_path, "first"), INTERVAL_S + 60)
        page = f"http://127.0.0.1:{port + 1}/first/index.html"
        with urllib.request.urlopen(page, timeout=10) as answer:
            assert b"stiffness" in answer.read()
        for name in (*TEN, "broken"):
            shutil.copytree(KEPT, raw / name)
        (raw / "broken" / "joints.csv").write_bytes(b"no table at all")
        until(lambda: reported(tmp_path, "c1"), 120)
    with serving(tmp_path, port) as process:
        until(lambda: reported(tmp_path, *TEN), 300)
        time.sleep(2 * INTERVAL_S)
    finished = [name for name, state in runs(tmp_path) if state == "COMPLETED"]

    assert process.returncode == 130
    assert finished == sorted([*TEN, "first"])
    assert ("broken", "FAILED") in runs(tmp_path)
    assert not reported(tmp_path, "broken")
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), timeout=2)


def running(*words):
    """Processes in whose command line all these words stand."""
    out = []
    for line in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            said = line.read_bytes().decode(errors="replace")
            if all(str(word) in said for word in words):
                out.append(int(line.parent.name))
    return out


def asked(port, path, body=None, **headers):
    """Status of an answer of Prefect's API."""
    data = None if body is None else json.dumps(body).encode()
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    request = urllib.request.Request(
        f"http://127.0.0.1:{port}{path}", data, {"Content-Type": "application/json"} | named
    )
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:
            return answer.status
    except urllib.error.HTTPError as refused:
        return refused.code


def project(root, *names):
    """A project whose service looks every few seconds, with copies of the kept campaign."""
    raw = root / "data" / "raw"
    raw.mkdir(parents=True)
    (root / "pipeline.toml").write_text("[service]\ninterval_s = 5\nquiet_s = 0\n")
    for name in names:
        shutil.copytree(KEPT, raw / name)
    return raw


EVIL = """
<img src="{page}/api/health"><iframe src="{reports}/a/index.html"></iframe>
<script>
const body = JSON.stringify({{parameters: {{root: "/other"}}}});
const said = [];
async function attempt(address, how) {{
  try {{
    const answer = await fetch(address, how);
    said.push(answer.type + " " + answer.status + " " + (await answer.text()).slice(0, 20));
  }} catch (problem) {{ said.push("nothing"); }}
}}
(async () => {{
  await attempt("{page}/api/flow_runs/filter", {{method: "POST", body,
    headers: {{"Content-Type": "application/json"}}}});
  await attempt("{page}/api/deployments/filter", {{method: "POST", body, mode: "no-cors"}});
  await attempt("{reports}/a/index.html", {{}});
  await attempt("{reports}/a/index.html", {{mode: "no-cors"}});
  document.title = said.join(" | ");
}})();
</script>
"""
"""What a foreign page would try."""


def test_a_foreign_page_drives_nothing(tmp_path):
    """In a real browser, against a live service: reads nothing, starts nothing."""
    raw, port = project(tmp_path, "a"), free_port()
    foreign = tmp_path / "foreign"
    foreign.mkdir()
    with serving(tmp_path, port):
        until(lambda: reported(tmp_path, "a"), 90)
        page, reports = (f"http://127.0.0.1:{p}" for p in (port, port + 1))
        (foreign / "index.html").write_text(EVIL.format(page=page, reports=reports))
        with evil(foreign) as (address, browser):
            shown = browser.new_page()
            shown.goto(address)
            shown.wait_for_function("document.title", timeout=30_000)
            said = shown.title()
            frame = shown.frames[1].content()
            own = browser.new_page()
            own.goto(f"{reports}/a/index.html")
            whose = own.title()
        password = (tmp_path / ".prefect" / "password").read_text()
        basic = f"Basic {base64.b64encode(password.encode()).decode()}"
        question = ("/api/deployments/filter", {})
        statuses = [
            asked(port, *question),
            asked(port, *question, Authorization=basic, Origin="http://evil.example"),
            asked(port, *question, Authorization=basic, Host="evil.example"),
            asked(port, *question, Authorization=basic),
        ]

    assert said.split(" | ")[0] == "nothing"
    assert "stiffness" not in said + frame
    assert all(part in ("nothing", "opaque 0 ") for part in said.split(" | "))
    assert "tiffness" in whose
    assert statuses == [401, 403, 403, 200]
    assert (tmp_path / ".prefect" / "password").stat().st_mode & 0o077 == 0
    assert raw.is_dir()


def test_a_printed_link_lets_its_browser_in(tmp_path):
    """Prefect's page asks for no password there; a second browser it asks. No link in a journal."""
    project(tmp_path, "a")
    port = free_port()
    with serving(tmp_path, port):
        until(lambda: reported(tmp_path, "a"), 90)
        link = f"http://127.0.0.1:{port}/enter/{supervisor.key(tmp_path)}"
        with evil(tmp_path) as (_, browser):
            shown = browser.new_page()
            shown.goto(link)
            shown.get_by_text("Logout").first.wait_for(timeout=60_000)
            first = browser.new_page()
            first.goto(f"http://127.0.0.1:{port + 1}/")
            standing = first.inner_text("body")
            other = browser.new_context().new_page()
            used = other.goto(link).status
            other.goto(f"http://127.0.0.1:{port}/")
            other.get_by_text("Login").first.wait_for(timeout=60_000)
            refused = other.get_by_text("Logout").count()

    assert (used, refused) == (403, 0)
    assert "Looks at data/raw: the last was at" in standing
    assert "/enter/" not in (tmp_path / "said.txt").read_text()


@contextlib.contextmanager
def evil(folder):
    """A page of another origin, and a browser."""
    path = browser_path()
    if path is None:
        pytest.skip("no browser: install chromium (`apt-get install chromium`) or set BROWSER_PATH")
    from playwright.sync_api import sync_playwright

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, format, *args):
            pass

    handler = functools.partial(Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=path)
            yield f"http://localhost:{server.server_port}/", browser
            browser.close()
        server.shutdown()


def test_serve_outlives_its_server(tmp_path):
    """Prefect's server killed, then the schedule: each is started again, said once, and works."""
    raw, port = project(tmp_path), free_port()
    with serving(tmp_path, port) as process:
        for word, name in (("pipeline.service.gate", "a"), ("pipeline.service.schedule", "b")):
            [victim] = [one for one in running(word) if one in family(process.pid)]
            os.kill(victim, signal.SIGKILL)
            shutil.copytree(KEPT, raw / name)
            until(lambda name=name: reported(tmp_path, name), 150)
        said = (tmp_path / "said.txt").read_text().splitlines()
        everyone = family(process.pid)

    assert process.returncode == 130
    assert sum("Prefect's server ended" in line for line in said) == 1
    assert sum("The schedule ended" in line for line in said) >= 1
    assert "Traceback" not in "\n".join(said)
    until(lambda: not any(map(alive, everyone)), 15)


@pytest.mark.parametrize("stop", [signal.SIGTERM, signal.SIGKILL])
def test_nothing_outlives_serve(tmp_path, stop):
    """Stopped or killed in the middle of a campaign, it leaves no process and no lock."""
    project(tmp_path, *TEN)
    with serving(tmp_path, free_port(), stop=stop) as process:
        until(lambda: running("pipeline.service.worker", tmp_path), 90)
        time.sleep(2)
        everyone = family(process.pid)

    assert len(everyone) >= 5
    assert process.returncode == {signal.SIGTERM: 0, signal.SIGKILL: -9}[stop]
    until(lambda: not any(map(alive, everyone)), 15)
    with supervisor.alone(tmp_path, Service()):
        pass


def test_two_services_on_one_root_are_one(tmp_path):
    """Whichever comes second says so, and does nothing."""
    project(tmp_path)
    with serving(tmp_path, free_port()):
        for command in ("watch", "serve"):
            second = subprocess.run(
                [sys.executable, "-m", "pipeline", command, "--root", tmp_path],
                cwd=HERE,
                env=os.environ | {"PYTHONPATH": str(HERE)},
                capture_output=True,
                text=True,
                timeout=60,
                check=False,
            )

            assert second.returncode == 2
            assert "is served already by process" in second.stderr


def odd(raw):
    """Folders of each odd kind; the names of those that are campaigns to be rejected."""
    for name in ("loop", "huge", "deep", "pipe", "proc", "text", "seen"):
        shutil.copytree(KEPT, raw / name)
    (raw / "loop" / "x").symlink_to("x")
    (raw / "huge" / "campaign.toml").write_bytes(b"a = [" * 100_000)
    (raw / "deep" / "campaign.toml").write_text("a = " + "[" * 900 + "]" * 900)
    (raw / "pipe" / "joints.csv").unlink()
    os.mkfifo(raw / "pipe" / "joints.csv")
    (raw / "proc" / "joints.csv").unlink()
    (raw / "proc" / "joints.csv").symlink_to("/proc/self/environ")
    (raw / "text" / "campaign.toml").write_bytes(b"\xff\xfe\0")
    shutil.copytree(KEPT, raw / os.fsdecode(b"zip\xff\xe9"))
    shutil.copytree(KEPT, raw / "index.html")
    shutil.copytree(KEPT, raw / "new\nline")
    (raw / "empty").mkdir()
    (raw / "file").write_text("no folder")
    memory = raw.parent / "processed" / "seen" / "seen.json"
    memory.parent.mkdir(parents=True)
    memory.write_text('{"print": 5, "attempts": "many"}')
    return {"huge", "deep", "pipe", "proc", "text"}


HOOKS = (
    "http://127.0.0.1:9/",
    "http://127.0.0.1:{port}/mute",
    "http://127.0.0.1:{port}/garbage",
    "http://127.0.0.1:{port}/long",
    "http://127.0.0.1:{port}/moved",
    "http://no.such.host.example/",
)


@contextlib.contextmanager
def bad_hook():
    """A server that answers no HTTP, too much of it, a redirect, or never."""

    class Bad(socketserver.StreamRequestHandler):
        def handle(self):
            path = self.rfile.readline().split()[1]
            if path == b"/mute":
                time.sleep(5)
            with contextlib.suppress(OSError):
                if path == b"/garbage":
                    self.wfile.write(b"\0\1 no HTTP at all\r\n\r\n")
                if path == b"/long":
                    self.wfile.write(b"HTTP/1.1 200 OK\r\nX: " + b"x" * 100_000 + b"\r\n\r\n")
                if path == b"/moved":
                    self.wfile.write(b"HTTP/1.1 302 Found\r\nLocation: /login\r\n\r\n")

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Bad) as server:
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server.server_address[1]
        server.shutdown()


@pytest.mark.parametrize("command", ["serve", "watch"])
def test_odd_folders_stop_nobody(tmp_path, command):
    """One of each odd kind, and a good campaign among them: that one is run, they are told."""
    raw = project(tmp_path)
    rejected = odd(raw)
    shutil.copytree(KEPT, raw / "good")
    with serving(tmp_path, free_port(), command=command, stop=signal.SIGTERM) as process:
        until(lambda: reported(tmp_path, "good", "loop", "seen"), 240)
        until(lambda: all(f"{name}: " in told(tmp_path) for name in rejected), 120)
        time.sleep(12)
        assert process.poll() is None
        lines = [line.split(" ", 2)[-1] for line in told(tmp_path).splitlines()]  # without the time

    assert process.returncode == 0
    assert "Traceback" not in "\n".join(lines)
    assert all(sum(line.startswith(f"{name}: ") for line in lines) == 1 for name in rejected)


def told(root):
    """What stands on the screen."""
    return (root / "said.txt").read_text()


@pytest.mark.parametrize("hook", HOOKS)
def test_a_bad_webhook_stops_nobody(tmp_path, hook):
    """Whatever it answers, campaigns go on being run."""
    raw = project(tmp_path, "a")
    with bad_hook() as port:
        toml = tmp_path / "pipeline.toml"
        toml.write_text(toml.read_text() + f"[notify]\nwebhook = '{hook.format(port=port)}'\n")
        with serving(tmp_path, free_port(), command="watch", stop=signal.SIGTERM) as process:
            until(lambda: reported(tmp_path, "a"), 90)
            shutil.copytree(KEPT, raw / "b")
            until(lambda: reported(tmp_path, "b"), 90)
            assert process.poll() is None
    memory = json.loads((tmp_path / "data/processed/a/seen.json").read_bytes())

    assert memory["told"] is None
    assert "Traceback" not in told(tmp_path)


@pytest.fixture
def small_disk(tmp_path):
    """A disk of its own of 96 MiB; mounting one takes an administrator."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=96m", "tmpfs", disk], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("this user may not mount a disk")
    yield disk
    subprocess.run(["umount", "-l", disk], check=True)


@pytest.mark.parametrize("command", ["serve", "watch"])
def test_a_full_disk_is_said_and_waited_for(small_disk, command):
    """No room for a minute while a campaign arrives: one line; with room again, its report."""
    raw = project(small_disk, "a")
    with serving(small_disk, free_port(), command=command, stop=signal.SIGTERM) as process:
        until(lambda: reported(small_disk, "a"), 120)
        said = small_disk / "said.txt"
        shutil.copytree(KEPT, raw / "b")
        with contextlib.suppress(OSError), (small_disk / "filler").open("wb") as filler:
            while True:
                filler.write(b"0" * 65536)
        time.sleep(60)
        assert process.poll() is None
        assert not reported(small_disk, "b")
        (small_disk / "filler").unlink()
        until(lambda: reported(small_disk, "b"), 300)
        assert process.poll() is None

    assert process.returncode == 0
    assert b"Traceback" not in said.read_bytes()


CLOCK = r"""
#define _GNU_SOURCE
#include <fcntl.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>
int clock_gettime(clockid_t which, struct timespec *t) {
    int result = syscall(SYS_clock_gettime, which, t);
    int file = open(getenv("CLOCK_AHEAD"), O_RDONLY);
    char said[32] = {0};
    if (which == CLOCK_REALTIME && file >= 0 && read(file, said, 31) > 0) t->tv_sec += atol(said);
    if (file >= 0) close(file);
    return result;
}
time_t time(time_t *t) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (t) *t = now.tv_sec;
    return now.tv_sec;
}
int gettimeofday(struct timeval *restrict t, void *restrict zone) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    t->tv_sec = now.tv_sec;
    t->tv_usec = now.tv_nsec / 1000;
    return 0;
}
"""
"""A clock that is as many seconds ahead as stand in a file, before the one of the system."""


def test_a_clock_that_is_set_back_stops_nothing(tmp_path, monkeypatch):
    """By a day, while it serves: what arrives then is run, by processes of the new time."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler for a clock of our own")
    raw, port = project(tmp_path, "a"), free_port()
    ahead, library = tmp_path / "ahead", tmp_path / "clock.so"
    ahead.write_text("86400")
    (tmp_path / "clock.c").write_text(CLOCK)
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, tmp_path / "clock.c"], check=True)
    monkeypatch.setenv("CLOCK_AHEAD", str(ahead))
    monkeypatch.setenv("LD_PRELOAD", str(library))
    with serving(tmp_path, port):
        monkeypatch.delenv("LD_PRELOAD")
        until(lambda: reported(tmp_path, "a"), 120)
        ahead.write_text("0")
        shutil.copytree(KEPT, raw / "b")
        until(lambda: reported(tmp_path, "b"), 180)

    assert "The clock was set back" in told(tmp_path)


def test_what_stands_still_is_started_again(tmp_path):
    """A schedule that is stopped, no error and no answer: campaigns are run again minutes later."""
    raw, port = project(tmp_path, "a"), free_port()
    with serving(tmp_path, port) as process:
        until(lambda: reported(tmp_path, "a"), 120)
        [still] = [
            one for one in running("pipeline.service.schedule") if one in family(process.pid)
        ]
        os.kill(still, signal.SIGSTOP)
        shutil.copytree(KEPT, raw / "b")
        until(lambda: reported(tmp_path, "b"), 360)

    assert "The schedule answers no more" in told(tmp_path)
    assert not alive(still)


def test_a_damaged_database_stops_nobody(tmp_path):
    """Damaged before the service starts and while it runs: it goes on with another, and says so."""
    raw = project(tmp_path, "a")
    base = tmp_path / ".prefect" / "prefect.db"
    base.parent.mkdir(mode=0o700)
    base.write_bytes(os.urandom(20000))
    with serving(tmp_path, free_port()):
        until(lambda: reported(tmp_path, "a"), 150)
        with base.open("r+b") as file:
            file.write(os.urandom(2**20))
        shutil.copytree(KEPT, raw / "b")
        until(lambda: reported(tmp_path, "b"), 360)

    assert told(tmp_path).count("cannot be read") == 2
    assert len(list(base.parent.glob("prefect.db.damaged-*[0-9]"))) == 2


@pytest.mark.parametrize("left", ["", "pipeline", "a b:c\n"])
def test_half_a_password_is_none(tmp_path, monkeypatch, left):
    """As a full disk leaves it: a new one, for its owner only, and the service works."""
    project(tmp_path)
    path = tmp_path / ".prefect" / "password"
    path.parent.mkdir()
    path.write_text(left)
    monkeypatch.setattr(os, "environ", dict(os.environ))
    urls = supervisor.settled(tmp_path, free_port())
    new = path.read_text()

    assert urls["api"].startswith("http://127.0.0.1:")
    assert re.fullmatch(r"pipeline:[\w-]{22}", new)
    assert path.stat().st_mode & 0o077 == 0
