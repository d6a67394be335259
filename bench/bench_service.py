"""`watch` and `serve` over 300 campaigns: whether memory stays constant and nothing accumulates."""

import contextlib
import os
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from pipeline.simulate import Plan, simulate

CAMPAIGNS = int(os.environ.get("SERVICE_CAMPAIGNS", "300"))
"""Number of campaigns; a smaller one for a first look."""
CHUNK = 8
"""Number of campaigns per process of the service; peak memory is taken over as many."""
PLAN = Plan(name="small", poses={"count": 7}, pulls={"steps_n": [3000.0]})
HERE = Path(__file__).parents[1]


def family(process: int) -> list[int]:
    """A process and all its descendants."""
    parents: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            parent = int(stat.read_text().rpartition(")")[2].split()[1])
            parents.setdefault(parent, []).append(int(stat.parent.name))
    out, waiting = [], [process]
    while waiting:
        out.append(waiting.pop())
        waiting += parents.get(out[-1], [])
    return out


def memory_mib(process: int) -> float:
    """Memory of a process and all its descendants, shared pages counted once [MiB]."""
    total = 0
    for one in family(process):
        with contextlib.suppress(OSError):
            for line in Path(f"/proc/{one}/smaps_rollup").read_text().splitlines():
                total += int(line.split()[1]) if line.startswith("Pss:") else 0
    return total / 1024


def free_port() -> int:
    """A free port followed by another free one."""
    for port in range(24600, 24800, 2):
        with contextlib.suppress(OSError), socket.socket() as a, socket.socket() as b:
            a.bind(("127.0.0.1", port))
            b.bind(("127.0.0.1", port + 1))
            return port
    raise RuntimeError("no two free ports")


@contextlib.contextmanager
def serving(root: Path, command: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run `pipeline watch` or `serve` during the block."""
    words = ["--port", str(free_port())] if command == "serve" else []
    with (root / "said.txt").open("wb") as said:
        process = subprocess.Popen(
            [sys.executable, "-m", "pipeline", command, "--root", root, *words],
            cwd=HERE,
            env=os.environ | {"PYTHONPATH": str(HERE)},
            stdout=said,
            stderr=said,
        )
        try:
            yield process
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(60)


def reported(root: Path) -> int:
    """Number of campaigns with a report."""
    return sum(1 for _ in (root / "reports").glob("*/index.html"))


def played(root: Path, command: str) -> tuple[float, float]:
    """Peak memory around the tenth campaign, and around the last [MiB]."""
    files, raw = simulate(PLAN).files, root / "data" / "raw"
    raw.mkdir(parents=True)
    (root / "pipeline.toml").write_text("[service]\ninterval_s = 5\nquiet_s = 0\n")
    for k in range(CAMPAIGNS):
        folder = raw / f"c{k:03d}"
        folder.mkdir()
        for name, content in files.items():
            (folder / name).write_bytes(content)
    most: dict[int, float] = {}
    with serving(root, command) as process:
        until = time.monotonic() + 60 + 30 * CAMPAIGNS
        while (done := reported(root)) < CAMPAIGNS and time.monotonic() < until:
            most[done] = max(most.get(done, 0.0), memory_mib(process.pid))
            print(f"\r  {command}: {done} of {CAMPAIGNS}, {most[done]:.0f} MiB", end="", flush=True)
            time.sleep(0.5)
    print()
    early = max(mib for done, mib in most.items() if 10 - CHUNK < done <= 10)
    late = max(mib for done, mib in most.items() if done >= CAMPAIGNS - CHUNK)
    return early, late


def runs(root: Path) -> str:
    """Number of flow runs in Prefect's database by state."""
    with contextlib.closing(sqlite3.connect(root / ".prefect" / "prefect.db")) as base:
        question = "select state_name, count(*) from flow_run group by 1 order by 1"
        return ", ".join(f"{count} {state}" for state, count in base.execute(question))


def run() -> list[tuple[str, float, str]]:
    """Memory after the last campaign relative to that after the tenth."""
    out = []
    for command in ("watch", "serve"):
        root = Path(tempfile.mkdtemp(prefix="service-"))
        early, late = played(root, command)
        done, comment = reported(root), f"{early:.0f} and {late:.0f} MiB"
        if command == "serve":
            comment += f"; Prefect: {runs(root)}"
        out.append(
            (f"{command}: memory, campaign {done} / 10", late / early, f"aim <= 1.2; {comment}")
        )
        shutil.rmtree(root)
    return out
