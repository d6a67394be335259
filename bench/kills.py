"""`python -m bench.kills serve|pool|dask`: kill each process in turn while campaigns arrive.

At the end it counts the campaigns without a report (lost) and those computed again although they
had one (doubled), and checks that all reports are the same bytes.
"""

from __future__ import annotations

import contextlib
import glob
import itertools
import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import typer

from bench.bench_service import PLAN, family, free_port
from pipeline.app import cli
from pipeline.base import files
from pipeline.simulate import simulate

HERE = Path(__file__).parents[1]
LOOK_S = 0.5
"""Interval at which processes and reports are examined [s]."""
REST_S = (20.0, 60.0)
"""Shortest and longest time between two kills [s]."""
DRAIN_S = 3600.0
"""Time allowed for all campaigns to finish after the last kill [s]; one killed three times waits
for 16 minutes."""

Words = list[str]
Makes = Callable[[], Words]


@dataclass
class World:
    """Processes that are kept alive, as by a system's init, and the processes that they start.

    Attributes:
        root: Root of the project.
        own: Command of each process, by kind.
        inner: Part of the command line that identifies each kind of child process.
        environment: Environment of all processes.
        completed: Function that counts the completed Prefect runs of each campaign.
        unkilled: Kinds that are not killed.
        rests_s: Pause before a process is restarted [s], by kind.
        begun: Number of times that a process of each kind was started again.
    """

    root: Path
    own: dict[str, Makes]
    inner: dict[str, str]
    environment: dict[str, str] = field(default_factory=dict)
    completed: Callable[[], Counter[str]] = Counter
    unkilled: frozenset[str] = frozenset()
    rests_s: dict[str, float] = field(default_factory=dict)
    _alive: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)
    _ended: dict[str, float] = field(default_factory=dict)
    begun: Counter[str] = field(default_factory=Counter)

    def keep(self) -> None:
        """Start the processes that are not running."""
        for kind, makes in self.own.items():
            running = self._alive.get(kind)
            if running is not None and running.poll() is None:
                continue
            now = time.monotonic()
            if now - self._ended.setdefault(
                kind, 0.0 if running is None else now
            ) < self.rests_s.get(kind, 1.0):
                continue
            del self._ended[kind]
            with (self.root / f"{kind}.log").open("ab") as log:
                self._alive[kind] = subprocess.Popen(
                    makes(), cwd=self.root, env=self.environment, stdin=subprocess.DEVNULL,
                    stdout=log, stderr=log, start_new_session=True,
                )  # fmt: skip
            self.begun[kind] += 1

    @property
    def kinds(self) -> list[str]:
        """Kinds of the processes that are killed."""
        return [kind for kind in (*self.own, *self.inner) if kind not in self.unkilled]

    def of(self, kind: str) -> list[int]:
        """Running processes of a kind."""
        if kind in self.own:
            running = self._alive.get(kind)
            return [running.pid] if running and running.poll() is None else []
        below = {one for running in self._alive.values() for one in family(running.pid)}
        return [one for one in below if self.inner[kind] in _command(one)]

    def end(self) -> None:
        """End all processes, the last one first."""
        for running in reversed([*self._alive.values()]):
            everyone = family(running.pid)
            running.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                running.wait(30)
            for one in everyone:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(one, signal.SIGKILL)
            running.wait()


def _command(process: int) -> str:
    with contextlib.suppress(OSError):
        return (
            Path(f"/proc/{process}/cmdline")
            .read_bytes()
            .replace(b"\0", b" ")
            .decode(errors="replace")
        )
    return ""


@dataclass
class Audit:
    """Reports as seen from outside.

    Attributes:
        root: Root of the project.
        there: Modification time of each campaign's manifest when last seen [ns].
        doubled: How often each manifest was written again.
    """

    root: Path
    there: dict[str, int] = field(default_factory=dict)
    doubled: Counter[str] = field(default_factory=Counter)

    def look(self) -> None:
        """Examine every manifest, which is the last file written."""
        for path in (self.root / "data" / "processed").glob("robot*/manifest.json"):
            with contextlib.suppress(OSError):
                put, name = path.stat().st_mtime_ns, path.parent.name
                if self.there.setdefault(name, put) != put:
                    self.doubled[name] += 1
                    self.there[name] = put


def _name(number: int) -> str:
    return f"robot{number:04d}"  # which no hash of an input contains by chance


def arrive(raw: Path, name: str, content: dict[str, bytes], rng: random.Random) -> None:
    """Copy a campaign as people do: file by file, campaign.toml at a random place among them."""
    folder = raw / name
    folder.mkdir()
    for file in rng.sample(sorted(content), len(content)):
        (folder / file).write_bytes(content[file])


def _killed(world: World, kind: str, rng: random.Random, log: Path) -> bool:
    """Kill one process of a kind, if there is one."""
    there = world.of(kind)
    if not there:
        return False
    victim = rng.choice(sorted(there))
    words = _command(victim)[:120]
    with contextlib.suppress(ProcessLookupError):
        os.kill(victim, signal.SIGKILL)
        with log.open("a") as said:
            said.write(f"{time.time():.1f} {kind} {victim} {words}\n")
        return True
    return False


def attacked(world: World, minutes: float, campaigns: int, seed: int) -> dict[str, object]:
    """Let campaigns arrive evenly, kill processes in turn, then wait until all are finished."""
    rng, audit = random.Random(seed), Audit(world.root)
    content, kills = dict(simulate(PLAN).files), Counter[str]()
    raw, log = world.root / "data" / "raw", world.root / "kills.log"
    began = time.monotonic()
    end, came = began + 60 * minutes, 0
    turn, due = itertools.cycle(world.kinds), began + REST_S[1]
    kind, given_up, said = next(turn), due + 60, ""
    while (now := time.monotonic()) < end:
        world.keep()
        audit.look()
        while came < campaigns and now - began >= came * 60 * minutes / campaigns:
            arrive(raw, _name(came), content, rng)
            came += 1
        if now >= due:
            if _killed(world, kind, rng, log):
                kills[kind] += 1
            elif now < given_up:  # this kind starts when there is work for it
                time.sleep(0.1)
                continue
            kind, due = next(turn), now + rng.uniform(*REST_S)
            given_up = due + 60
        said = _shown(f"{sum(kills.values())} kills, {len(audit.there)} of {came}", said)
        time.sleep(LOOK_S)
    _drained(world, audit, came)
    return _told(world, audit, came, kills)


def _shown(now: str, before: str) -> str:
    """Print the progress if it has changed."""
    if now != before:
        print(f"\r{now}", end="", flush=True)
    return now


def _drained(world: World, audit: Audit, came: int) -> None:
    until = time.monotonic() + DRAIN_S
    while len(audit.there) < came and time.monotonic() < until:
        world.keep()
        audit.look()
        time.sleep(LOOK_S)
    for _ in range(120):  # to detect runs that are started again
        world.keep()
        audit.look()
        time.sleep(LOOK_S)


def _told(world: World, audit: Audit, came: int, kills: Counter[str]) -> dict[str, object]:
    names = [_name(k) for k in range(came)]
    results = {name: world.root / "reports" / name / "result.json" for name in names}
    said = {
        p.read_bytes().replace(name.encode(), b"c") for name, p in results.items() if p.is_file()
    }
    completed = world.completed()
    return {
        "kills": dict(kills),
        "begun again": dict(world.begun),
        "came": came,
        "lost": [name for name in names if not results[name].is_file()],
        "doubled": dict(audit.doubled),
        "completed twice": {name: n for name, n in completed.items() if n > 1},
        "kinds of result.json": len(said),
        "half-written": len(files.leftovers(world.root)),
    }


# --- worlds --------------------------------------------------------------------------------------


def _clean() -> dict[str, str]:
    ours = {"PYTHONPATH": str(HERE), "OMP_NUM_THREADS": "1"}
    return {
        k: v for k, v in os.environ.items() if not k.startswith(("PREFECT_", "PIPELINE_"))
    } | ours


def _pipeline(*words: object) -> Words:
    return [sys.executable, "-P", "-m", "pipeline", *map(str, words)]


@contextlib.contextmanager
def serve(root: Path) -> Iterator[World]:
    """`pipeline serve`, restarted when it ends, as by its systemd unit."""
    port = free_port()

    def completed() -> Counter[str]:
        question = (
            "select name from flow_run where state_type = 'COMPLETED' and name like 'robot____'"
        )
        found: Counter[str] = Counter()
        for base in (root / ".prefect").glob("prefect.db*"):
            with (
                contextlib.suppress(sqlite3.Error),
                contextlib.closing(sqlite3.connect(base)) as kept,
            ):
                found.update(name for (name,) in kept.execute(question))
        return found

    inner = {
        "server": "pipeline.service.gate",
        "schedule": "pipeline.service.schedule",
        "scan": "spawn_main",
        "worker": "pipeline.service.worker",
    }
    own = {"serve": lambda: _pipeline("serve", "--root", root, "--port", port)}
    yield World(root, own, inner, _clean(), completed)


def programs() -> Path | None:
    """Folder of PostgreSQL's server programs."""
    found = sorted(glob.glob("/usr/lib/postgresql/*/bin"))
    found += [str(Path(path).parent) for path in [shutil.which("initdb")] if path]
    return Path(found[0]) if found else None


@contextlib.contextmanager
def pool(root: Path) -> Iterator[World]:
    """A team's server on PostgreSQL and two workers of a pool."""
    port, base_port, bin_ = free_port(), 24880, programs()
    if bin_ is None:
        raise typer.BadParameter("a pool needs PostgreSQL: apt-get install postgresql")
    data = Path(tempfile.mkdtemp(prefix="postgres-"))
    user: Words = []
    if os.geteuid() == 0:
        shutil.chown(data, "postgres")
        user = ["runuser", "-u", "postgres", "--"]
    initdb = [*user, str(bin_ / "initdb"), "-D", str(data), "-U", "prefect", "-A", "trust"]
    subprocess.run(initdb, check=True, capture_output=True, cwd="/")
    at = ["-h", "127.0.0.1", "-p", str(base_port)]
    postgres = [*user, str(bin_ / "postgres"), "-D", str(data), "-k", str(data), *at]
    environment = _clean() | {
        "PREFECT_HOME": str(root / ".prefect"),
        "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
        "DO_NOT_TRACK": "1",
        "PREFECT_SERVER_API_AUTH_STRING": "stiffness:secret",
        "PREFECT_API_AUTH_STRING": "stiffness:secret",
        "PREFECT_API_URL": f"http://127.0.0.1:{port}/api",
        "PREFECT_SERVER_DATABASE_CONNECTION_URL": f"postgresql+asyncpg://prefect@127.0.0.1:{base_port}/postgres",
        "PIPELINE_ROOT": str(root),
    }
    prefect = [sys.executable, "-P", "-m", "prefect"]
    worker = [
        *prefect,
        "worker",
        "start",
        "--pool",
        "robots",
        "--install-policy",
        "never",
        "--limit",
        "1",
    ]

    def completed() -> Counter[str]:
        question = (
            "select name from flow_run where state_type = 'COMPLETED' and tags @> '[\"campaign\"]'"
        )
        asked = ["psql", *at, "-U", "prefect", "-At", "-c", question, "postgres"]
        said = subprocess.run(asked, capture_output=True, text=True, check=False).stdout
        return Counter(said.split())

    own: dict[str, Makes] = {
        "database": lambda: postgres,
        "server": lambda: [*prefect, "server", "start", "--host", "127.0.0.1", "--port", str(port)],
        "worker1": lambda: worker,
        "worker2": lambda: worker,
    }
    world = World(root, own, {"flow": "prefect.engine", "guarded": "pipeline.service.worker"},
                  environment, completed, unkilled=frozenset({"database"}))  # fmt: skip
    deploy = _pipeline("deploy", "--root", root, "--pool", "robots", "--interval", "15")
    for _ in range(60):
        world.keep()
        time.sleep(3)
        if (
            subprocess.run(deploy, env=environment, capture_output=True, check=False).returncode
            == 0
        ):
            break
    try:
        yield world
    finally:
        world.end()
        shutil.rmtree(data, ignore_errors=True)


@contextlib.contextmanager
def dask(root: Path) -> Iterator[World]:
    """A scheduler, two workers, and `pipeline run --on` repeatedly, as by cron."""
    address = f"tcp://127.0.0.1:{free_port()}"
    command = [sys.executable, "-P", "-m", "dask"]
    options = ["--no-dashboard", "--host", "127.0.0.1"]
    room = root / "room"
    room.mkdir()
    worker = [*command, "worker", address, "--nthreads", "1", "--no-nanny", *options,
              "--local-directory", str(room)]  # fmt: skip
    own: dict[str, Makes] = {
        "scheduler": lambda: [
            *command,
            "scheduler",
            *options,
            "--port",
            address.rpartition(":")[2],
        ],
        "worker1": lambda: worker,
        "worker2": lambda: worker,
        "run": lambda: _pipeline("run", "--root", root, "--on", address),
    }
    yield World(root, own, {}, _clean(), rests_s={"run": 10.0})


WORLDS = {"serve": serve, "pool": pool, "dask": dask}
command = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)


@command.command()
def kills(
    where: Annotated[Literal["serve", "pool", "dask"], typer.Argument()],
    minutes: Annotated[float, typer.Option(help="How long campaigns arrive.")] = 60.0,
    campaigns: Annotated[int, typer.Option(help="How many arrive.")] = 300,
    seed: Annotated[int, typer.Option(help="Of the moments of the kills.")] = 1,
    root: Annotated[Path | None, typer.Option(help="An empty folder that is kept.")] = None,
) -> None:
    """Kill each process in turn while campaigns arrive, and count what is lost or done twice.

    With either the exit code is 1.
    """
    place = root or Path(tempfile.mkdtemp(prefix="kills-"))
    (place / "data" / "raw").mkdir(parents=True)
    (place / "pipeline.toml").write_text("[service]\ninterval_s = 10\nquiet_s = 1\n")
    with WORLDS[where](place) as world:
        try:
            made = attacked(world, minutes, campaigns, seed)
        finally:
            world.end()
    print()
    typer.echo(json.dumps({"where": where, "seed": seed, **made}, indent=1))
    if (
        made["lost"]
        or made["doubled"]
        or made["completed twice"]
        or made["kinds of result.json"] != 1
    ):
        raise typer.Exit(1)


if __name__ == "__main__":
    cli.main(app=command, name="python -m bench.kills")
