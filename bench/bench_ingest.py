"""A million readings from the bytes of an export to displacements, compared with bare parsing."""

import statistics
import threading
import time
from collections.abc import Callable

import numpy as np
import pyarrow as pa
from pyarrow import csv

from bench.reduced import reduce
from pipeline import readers
from pipeline.readers import catalogue
from pipeline.reduction.bring import conformed, to_displacements
from pipeline.run import ingested
from pipeline.simulate import Plan
from pipeline.store.campaign import Raw, in_memory

READERS = catalogue()

POSES, PULLS = 10_000, 19
TARGETS = ("P1", "P2", "P3", "Pl1", "Pl2")
BASE = {"B1": (0.6, -0.5, -0.3), "B2": (0.6, 18.5, -0.3), "B3": (-0.6, 18.5, -0.28)}
RUNS = 5


INSTRUMENT = "noise = { range_m = 8e-6, transverse_m = 7.5e-6, transverse_per_m = 3e-6 }"


def run() -> list[tuple[str, float, str]]:
    """Times relative to `pyarrow.csv.read_csv` on the same bytes; memory in GB.

    The bare parser knows the time format, so that both sides convert times to timestamps.
    """
    files, toml = _campaign()
    export = files["tracker.csv"]
    raw = in_memory(files | {"campaign.toml": toml.encode()})
    beams = toml.replace("sigma_m = 3e-5", INSTRUMENT)
    with_beams = in_memory(files | {"campaign.toml": beams.encode()})
    aim = "times bare reading, aim 3"
    out = [
        _row("plain CSV to readings", export),
        _row("SpatialAnalyzer to readings", _spatial_analyzer(export), 3),
    ]
    for what, work in (
        ("with every check", lambda: ingested(raw)),
        ("and reduced to forces and displacements", lambda: _displacements(raw)),
        ("the same with a covariance for every beam", lambda: _displacements(with_beams)),
        ("and joined to the arrays of the estimator", lambda: reduce(raw, conformed)),
    ):
        wall, cpu = _times(work, export)
        out.append((f"1e6 readings {what}", wall, f"{aim}; in CPU time {cpu:.2f}"))
    peak = _peak_gb(lambda: reduce(raw, conformed))
    return [*out, ("peak memory", peak, "GB for the whole process, aim 2")]


def _displacements(raw: Raw) -> object:
    return to_displacements(ingested(raw), conformed)


def _row(what: str, data: bytes, header: int = 1) -> tuple[str, float, str]:
    wall, cpu = _times(lambda: readers.read("tracker", data), data, header)
    return (
        what,
        wall,
        f"times bare reading of {len(data) / 1e6:.0f} MB, aim 3; in CPU time {cpu:.2f}",
    )


def _times(ours: Callable[[], object], data: bytes, header: int = 1) -> tuple[float, float]:
    """Ratios of wall time and of CPU time; the latter is less affected by other processes."""
    options = csv.ReadOptions(skip_rows=header, autogenerate_column_names=True)
    times = csv.ConvertOptions(timestamp_parsers=[csv.ISO8601, " %m/%d/%y %H:%M:%S"])

    def bare() -> object:
        return csv.read_csv(pa.BufferReader(data), options, convert_options=times)

    ours(), bare()
    pairs = [(_seconds(ours), _seconds(bare)) for _ in range(RUNS)]
    wall, cpu = zip(*([a / b for a, b in zip(*pair, strict=True)] for pair in pairs), strict=True)
    return statistics.median(wall), statistics.median(cpu)


def _seconds(work: Callable[[], object]) -> tuple[float, float]:
    """Wall and CPU time of one call [s]."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - wall, time.process_time() - cpu


def _peak_gb(work: Callable[[], object]) -> float:
    """Peak resident memory while `work` runs [GB]; tracemalloc does not see Arrow's memory."""
    seen, done = [0.0], threading.Event()

    def watch() -> None:
        while not done.is_set():
            with open("/proc/self/statm") as statm:
                seen.append(int(statm.read().split()[1]) * 4096 / 1e9)
            time.sleep(0.005)

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        work()
    finally:
        done.set()
        watcher.join()
    return max(seen)


def _campaign() -> tuple[dict[str, bytes], str]:
    """Many poses with many pulls, each of five targets; only the format matters here."""
    tool = Plan(name="bench").tool
    chain = {"Pl1": (0.15, 0.0, 0.25), "Pl2": (0.15, 0.0, -0.35)}
    points = np.array([{**tool, **chain}[name] for name in TARGETS])
    offset = np.random.default_rng(20261103).uniform(-5, 5, (POSES, 3))
    lines = ["group,target,x_mm,y_mm,z_mm,time"]
    stamp = "2026-11-03T08:00:00"
    lines += [f"base,{b},{x:.4f},{y:.4f},{z:.4f},{stamp}" for b, (x, y, z) in _mm(BASE).items()]
    for pose in range(POSES):
        for pull in range(PULLS + 1):
            group = f"pose{pose + 1:05d}_rep{pull}_{'loaded' if pull else 'unloaded'}"
            at = ((points + offset[pose] + pull * 1e-4) * 1e3).tolist()
            clock = (
                f"2026-11-{3 + pose // 1440:02d}T{pose // 60 % 24:02d}:{pose % 60:02d}:{pull:02d}"
            )
            lines += [
                f"{group},{name},{x:.4f},{y:.4f},{z:.4f},{clock}"
                for name, (x, y, z) in zip(TARGETS, at, strict=True)
            ]
    loads = [
        "pose,repeat,force_n",
        *(f"{p + 1},{r + 1},900" for p in range(POSES) for r in range(PULLS)),
    ]
    angles = ",".join(f"theta{k}_deg" for k in range(2, 8))
    joints = [
        f"pose,r1_m,{angles}",
        *(f"{p + 1},5.3,-37.3,50,10,20,30,-82.2" for p in range(POSES)),
    ]
    toml = "\n".join(
        [
            'format = 1\nname = "bench"\nrobot = "kr500_rail"\n[tracker]\nfiles = ["tracker.csv"]',
            "sigma_m = 3e-5\n[base_frame]",
            *(f"{name} = {list(at)}" for name, at in BASE.items()),
            "[scale]\nsigma_n = 2.0\n[tool]",
            *(f"{name} = {list(at)}" for name, at in tool.items()),
        ]
    )
    files = {"tracker.csv": lines, "loads.csv": loads, "joints.csv": joints}
    return {name: "\n".join([*text, ""]).encode() for name, text in files.items()}, toml


def _mm(points: dict[str, tuple[float, float, float]]) -> dict[str, list[float]]:
    return {name: [1e3 * value for value in at] for name, at in points.items()}


def _spatial_analyzer(plain: bytes) -> bytes:
    """The same readings in the format of SpatialAnalyzer."""
    export = readers.read("tracker.csv", plain)
    written = readers.OutgoingReadings(
        export.group.to_pylist(),
        export.target.to_pylist(),
        export.position,
        export.time.to_pylist(),
    )
    return READERS["spatialanalyzer"].write(written, "mm", 4)
