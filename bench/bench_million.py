"""Cost of a whole run in one process with a million readings, depending on where they are.

The demo campaign of the simulator, with a tracker that reads its base reflectors all the time: in
many rounds, as a drift program does (`rounds`), or in a single group (`one group`).
"""

import resource
import subprocess
import sys
import tempfile
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from bench.reduced import reduce
from pipeline.reduction.bring import conformed
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

PROJECT = Path(__file__).parents[1]
MANY = 1_000_000
SIGMA_MM = 0.03
"""Standard uncertainty of a reading per axis [mm], as stated by the demo."""


def run() -> list[tuple[str, float, str]]:
    """CPU seconds and memory of `run --engine local`, each in its own process."""
    out = []
    for what in ("rounds", "one group"):
        with tempfile.TemporaryDirectory() as root:
            write(Path(root) / "data/raw/million", MANY, what)
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            asked = [sys.executable, "-m", "pipeline", "run", "million", "--engine", "local"]
            began = datetime.now()
            done = subprocess.run([*asked, "--root", root], cwd=PROJECT, capture_output=True)
            wall = (datetime.now() - began).total_seconds()
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
        user, system = after.ru_utime - before.ru_utime, after.ru_stime - before.ru_stime
        comment = f"s of processor, {system:.0f} s of them in the kernel; wall {wall:.0f} s, aim 60"
        out.append((f"a million readings, {what}, exit {done.returncode}", user + system, comment))
        out.append(("largest so far", after.ru_maxrss / 1e6, "GB, aim 2"))
    return out


def write(folder: Path, many: int, what: str) -> None:
    """Write the demo campaign with `many` more readings of its base reflectors."""
    files = dict(simulate(Plan(name="million")).files)
    first, *_, last = (line for line in files["tracker.csv"].decode().splitlines()[1:])
    begin, end = (datetime.fromisoformat(line.rsplit(",", 1)[1]) for line in (first, last))
    raw = in_memory(files)
    seen = reduce(raw, conformed).registration
    nominal = np.array(list(raw.settings.base_frame.values()))
    places = 1e3 * (nominal - seen.t) @ seen.R
    noise = np.random.default_rng(20261103).normal(0.0, SIGMA_MM, (many, 3))
    step = (end - begin) / many
    names, rows = list(raw.settings.base_frame), []
    for k, at in enumerate(noise):
        name, (x, y, z) = names[k % len(names)], places[k % len(places)] + at
        group = "base_watch" if what == "one group" else f"base_{k // len(places):06d}"
        time = (begin + timedelta(seconds=1) + k * step).isoformat(timespec="milliseconds")
        rows.append(f"{group},{name},{x:.4f},{y:.4f},{z:.4f},{time}\n")
    files["tracker.csv"] += "".join(rows).encode()
    folder.mkdir(parents=True)
    for name, data in files.items():
        (folder / name).write_bytes(data)


if __name__ == "__main__":  # python -m bench.bench_million FOLDER [READINGS] [rounds|one group]
    write(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else MANY, sys.argv[-1])
