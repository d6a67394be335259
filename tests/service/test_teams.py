"""The flow on a team's own Prefect server: PostgreSQL behind it, a work pool, another process."""

import base64
import contextlib
import glob
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

import pytest

HERE = Path(__file__).parents[2]
KEPT = HERE / "data" / "raw" / "fanuc_r2000ic"
PORT, BASE_PORT = 24400, 24402
API = f"http://127.0.0.1:{PORT}/api"
CAMPAIGNS = int(os.environ.get("TEAM_CAMPAIGNS", "20"))
"""How many two workers share; another number for a longer look."""
PREFECT = [sys.executable, "-m", "prefect"]

pytestmark = [pytest.mark.slow, pytest.mark.prefect, pytest.mark.xdist_group("prefect")]


def programs():
    """Folder of PostgreSQL's server programs."""
    found = sorted(glob.glob("/usr/lib/postgresql/*/bin")) + [
        str(Path(path).parent) for path in [shutil.which("initdb")] if path
    ]
    if not found:
        pytest.skip("no PostgreSQL server on this machine: apt-get install postgresql")
    return Path(found[0])


@contextlib.contextmanager
def process(*command, log, **environment):
    """A process until the end of the block, its words in a file."""
    with log.open("wb") as kept:
        running = subprocess.Popen(
            command,
            cwd=HERE,
            env=clean() | {"PYTHONPATH": str(HERE)} | environment,
            stdout=kept,
            stderr=kept,
            start_new_session=True,
        )
        try:
            yield running
        finally:
            # `runuser` hands no signal on: PostgreSQL would keep its port
            os.killpg(running.pid, signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                running.wait(30)
            with contextlib.suppress(ProcessLookupError):
                os.killpg(running.pid, signal.SIGKILL)
            running.wait()


def clean():
    return {k: v for k, v in os.environ.items() if not k.startswith(("PREFECT_", "PIPELINE_"))}


def until(there, seconds, log=None):
    began = time.monotonic()
    while not there():
        assert time.monotonic() - began < seconds, log.read_text() if log else ""
        time.sleep(0.5)


@pytest.fixture
def postgres(tmp_path):
    """A PostgreSQL of our own on this machine; how to ask it."""
    # pytest's own folders are for their owner only, and PostgreSQL refuses to run as root
    bin_, data = programs(), Path(tempfile.mkdtemp(prefix="postgres-"))
    as_user = []
    if os.geteuid() == 0:
        shutil.chown(data, "postgres")
        as_user = ["runuser", "-u", "postgres", "--"]
    subprocess.run(
        [*as_user, bin_ / "initdb", "-D", data, "-U", "prefect", "-A", "trust"],
        check=True,
        capture_output=True,
        cwd="/",
    )
    server = [*as_user, bin_ / "postgres", "-D", data, "-k", data]
    server += ["-h", "127.0.0.1", "-p", str(BASE_PORT)]

    def ask(question):
        command = ["psql", "-h", "127.0.0.1", "-p", str(BASE_PORT), "-U", "prefect", "-At"]
        done = subprocess.run(
            [*command, "-c", question, "postgres"], capture_output=True, text=True, check=False
        )
        return done.stdout.split() if done.returncode == 0 else None

    log = tmp_path / "pg.log"
    with process(*server, log=log):
        until(lambda: ask("select 1"), 60, log)
        yield ask
    shutil.rmtree(data)


def answers():
    with contextlib.suppress(OSError), urllib.request.urlopen(f"{API}/health", timeout=2):
        return True
    return False


SERVER = [*PREFECT, "server", "start", "--host", "127.0.0.1", "--port", str(PORT)]
WORKER = [*PREFECT, "worker", "start", "--pool", "robots", "--install-policy", "never"]


@pytest.fixture
def team(tmp_path, postgres):
    """A Prefect server on PostgreSQL, and the project that is deployed on it: its environment."""
    root = tmp_path / "project"
    (root / "data" / "raw").mkdir(parents=True)
    (root / "pipeline.toml").write_text("[service]\nquiet_s = 1\n")
    base = f"postgresql+asyncpg://prefect@127.0.0.1:{BASE_PORT}/postgres"
    settings = {
        "PREFECT_HOME": str(tmp_path / "home"),
        "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
        "DO_NOT_TRACK": "1",
        "PREFECT_SERVER_API_AUTH_STRING": "stiffness:secret",
        "PREFECT_API_AUTH_STRING": "stiffness:secret",
    }
    log = tmp_path / "server.log"
    with process(*SERVER, log=log, PREFECT_SERVER_DATABASE_CONNECTION_URL=base, **settings):
        until(answers, 120, log)
        settings["PREFECT_API_URL"] = API
        done = subprocess.run(
            [sys.executable, "-m", "pipeline", "deploy", "--pool", "robots", "--interval", "15"],
            cwd=root,
            env=clean() | {"PYTHONPATH": str(HERE)} | settings,
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.returncode, done.stderr) == (0, "")
        command = "prefect worker start --pool robots --limit 2"
        assert done.stdout == f"cd / && PIPELINE_ROOT={root} {command}\n"
        yield root, settings | {"PIPELINE_ROOT": str(root)}


def family(process):
    """A process and all that it has started, and that these have."""
    out, waiting = [], [process]
    while waiting:
        out.append(waiting.pop())
        for task in Path(f"/proc/{out[-1]}/task").glob("*"):
            with contextlib.suppress(OSError):
                waiting += map(int, (task / "children").read_text().split())
    return out


def at_work(process):
    """Whether one of a worker's processes holds a campaign."""
    for one in family(process):
        with contextlib.suppress(OSError):
            opened = [os.path.realpath(fd) for fd in Path(f"/proc/{one}/fd").iterdir()]
            if any(name.endswith("/.attended") for name in opened):
                return True
    return False


def runs(ask, columns="name, state_type", order="1"):
    """What PostgreSQL holds of the runs of campaigns."""
    tagged = "tags @> '[\"campaign\"]'"
    return ask(f"select {columns} from flow_run where {tagged} order by {order}")


@pytest.mark.timeout(max(5400, 90 * CAMPAIGNS))
def test_two_workers_share_campaigns_and_one_is_killed(tmp_path, team, postgres):
    """Its machine goes down in the middle: each campaign has one run that ends, and a report."""
    root, settings = team
    names = [f"robot{k:03d}" for k in range(CAMPAIGNS)]  # no digest of an input holds such a name
    for name in names:
        shutil.copytree(KEPT, root / "data" / "raw" / name)
    logs = [tmp_path / f"worker{k}.log" for k in range(2)]
    with contextlib.ExitStack() as stack:
        both = [
            stack.enter_context(process(*WORKER, "--limit", "2", log=log, **settings))
            for log in logs
        ]
        results = root / "reports"
        until(lambda: list(results.glob("*/result.json")) and at_work(both[0].pid), 600, logs[0])
        for one in reversed(family(both[0].pid)):
            with contextlib.suppress(ProcessLookupError):
                os.kill(one, signal.SIGKILL)

        def ended():
            return runs(postgres) == [f"{name}|COMPLETED" for name in names]

        until(ended, 60 + 60 * CAMPAIGNS, logs[1])
        until((results / "index.html").is_file, 120, logs[1])
    said = [(results / name / "result.json").read_bytes() for name in names]
    alike = zip(said, names, strict=True)
    assert len({one.replace(name.encode(), b"c") for one, name in alike}) == 1
    assert max(map(int, runs(postgres, "run_count"))) == 2, "nobody was killed at work"


@pytest.mark.timeout(1800)
def test_a_worker_runs_campaigns_for_a_server_on_postgresql(tmp_path, team, postgres):
    """`pipeline deploy`, one worker elsewhere: each campaign a run, and another when it changes."""
    root, settings = team
    raw = root / "data" / "raw"
    shutil.copytree(KEPT, raw / "a")
    shutil.copytree(KEPT, raw / "broken")
    (raw / "broken" / "joints.csv").write_bytes(b"no table at all")
    with process(*WORKER, "--limit", "2", log=tmp_path / "worker.log", **settings):
        report = root / "reports" / "a" / "index.html"
        until(report.is_file, 240, tmp_path / "worker.log")
        until(lambda: runs(postgres) == ["a|COMPLETED", "broken|FAILED"], 120)
        until((root / "reports" / "index.html").is_file, 120)
        text = (raw / "a" / "campaign.toml").read_text("utf-8")
        (raw / "a" / "campaign.toml").write_text(text + "\n# another look\n", "utf-8")
        again = ["a|COMPLETED", "a|COMPLETED", "broken|FAILED"]
        until(lambda: runs(postgres) == again, 240, tmp_path / "worker.log")


def asked(path, content):
    """What the team's server answers."""
    head = {
        "Content-Type": "application/json",
        "Authorization": f"Basic {base64.b64encode(b'stiffness:secret').decode()}",
    }
    data = json.dumps(content).encode()
    with urllib.request.urlopen(urllib.request.Request(API + path, data, head)) as answer:
        return json.loads(answer.read())


@pytest.mark.timeout(1800)
def test_a_look_whose_worker_was_killed_before_it_began_stops_no_other(tmp_path, team, postgres):
    """What the worker has told the server stays: the look is pending, and nobody is at it."""
    root, settings = team
    shutil.copytree(KEPT, root / "data" / "raw" / "a")
    looks = {"flows": {"name": {"any_": ["scan-campaigns"]}}}
    until(lambda: asked("/flow_runs/filter", looks), 120)
    left = min(asked("/flow_runs/filter", looks), key=lambda run: run["expected_start_time"])
    asked(f"/flow_runs/{left['id']}/set_state", {"state": {"type": "PENDING"}})
    with process(*WORKER, "--limit", "2", log=tmp_path / "worker.log", **settings):
        until((root / "reports" / "a" / "result.json").is_file, 400, tmp_path / "worker.log")
        gone = f"select state_type from flow_run where id = '{left['id']}'"
        until(lambda: postgres(gone) == ["CRASHED"], 300, tmp_path / "worker.log")
