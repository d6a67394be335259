"""`pipeline serve` as people run it: its own process, Prefect's server, campaigns that arrive."""

import contextlib
import os
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

HERE = Path(__file__).parents[1]
KEPT = HERE / "data" / "raw" / "fanuc_r2000ic"
INTERVAL_S = 15
TEN = [f"c{k}" for k in range(10)]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.prefect,
    pytest.mark.xdist_group("prefect"),
]


def free_port():
    """A port with a free one behind it."""
    for port in range(24200, 24400, 2):
        with contextlib.suppress(OSError), socket.socket() as a, socket.socket() as b:
            a.bind(("127.0.0.1", port))
            b.bind(("127.0.0.1", port + 1))
            return port
    raise RuntimeError("no two free ports")


@contextlib.contextmanager
def serving(root, port, stop=signal.SIGINT):
    """`pipeline serve` until the end of the block; then the signal, and its exit code."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("PREFECT_", "PIPELINE_"))}
    said = root / "said.txt"
    with said.open("wb") as kept:
        process = subprocess.Popen(
            [sys.executable, "-m", "pipeline", "serve", "--root", root, "--port", str(port)],
            cwd=HERE,
            env=clean | {"PYTHONPATH": str(HERE)},
            stdout=kept,
            stderr=kept,
        )
    try:
        until(lambda: process.poll() is not None or b"Ctrl-C stops" in said.read_bytes(), 150)
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
