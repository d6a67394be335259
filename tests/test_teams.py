"""The flow on a team's own Prefect server: PostgreSQL behind it, a work pool, another process."""

import contextlib
import glob
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

HERE = Path(__file__).parents[1]
KEPT = HERE / "data" / "raw" / "fanuc_r2000ic"
PORT, BASE_PORT = 24400, 24402
API = f"http://127.0.0.1:{PORT}/api"
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
            running.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                running.wait(30)
            running.kill()
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


def test_a_worker_runs_campaigns_for_a_server_on_postgresql(tmp_path, postgres):
    """`pipeline deploy`, one worker elsewhere: the campaign has its report, PostgreSQL its run."""
    root = tmp_path / "project"
    shutil.copytree(KEPT, root / "data" / "raw" / "a")
    (root / "pipeline.toml").write_text("[service]\nquiet_s = 1\n")
    base = f"postgresql+asyncpg://prefect@127.0.0.1:{BASE_PORT}/postgres"
    settings = {
        "PREFECT_HOME": str(tmp_path / "home"),
        "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
        "DO_NOT_TRACK": "1",
        "PREFECT_SERVER_API_AUTH_STRING": "stiffness:secret",
        "PREFECT_API_AUTH_STRING": "stiffness:secret",
    }
    server = [*PREFECT, "server", "start", "--host", "127.0.0.1", "--port", str(PORT)]
    worker = [*PREFECT, "worker", "start", "--pool", "robots", "--install-policy", "never"]
    log = tmp_path / "server.log"
    with process(*server, log=log, PREFECT_SERVER_DATABASE_CONNECTION_URL=base, **settings):
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
        assert done.stdout == f"PIPELINE_ROOT={root} prefect worker start --pool robots\n"
        settings["PIPELINE_ROOT"] = str(root)
        with process(*worker, log=tmp_path / "worker.log", **settings):
            report = root / "reports" / "a" / "index.html"
            until(report.is_file, 120, tmp_path / "worker.log")
            finished = "select name from flow_run where name = 'a' and state_type = 'COMPLETED'"
            until(lambda: postgres(finished) == ["a"], 30)
