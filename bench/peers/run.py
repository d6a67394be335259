"""Every tool on every trial, each in separate processes whose time is measured."""

from __future__ import annotations

import csv
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.peers import arm as arms
from bench.peers import cut, judge

FOREIGN = Path(__file__).parent / "foreign"
PIPELINE = (sys.executable, "-m", "pipeline")
OURS = "this project"
NOMINAL, DH, LEARNED = "nominal DH table", "DH least squares", "DH, then a Gaussian process"
PAPER, RIGID = "the paper's method", "rigid robot"
LEFT_OUT = 5
"""Exit code of `pipeline` if it has finished and left out readings that it found wrong."""


@dataclass(frozen=True)
class Outcome:
    """Result of one tool at the held-out poses.

    Attributes:
        trial: Name of the trial.
        tool: The tool, with what it estimates.
        off: Distance of each target from its prediction [m], shape (m,).
        cluster: Cluster of each, shape (m,).
        seconds: CPU time from Python's start to the prediction [s].
    """

    trial: str
    tool: str
    off: np.ndarray
    cluster: np.ndarray
    seconds: float


def timed(words: list[str | Path] | tuple[str | Path, ...]) -> float:
    """Run a command on one thread, in the project's folder; return its CPU time [s].

    Raises:
        RuntimeError: It failed; with its last lines of output.
    """
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    one = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}
    done = subprocess.run(
        [str(word) for word in words],
        capture_output=True,
        text=True,
        cwd=cut.HERE,
        env={**os.environ, **one, "MPLBACKEND": "Agg"},
    )
    if done.returncode not in (0, LEFT_OUT):
        raise RuntimeError(f"{' '.join(map(str, words))}\n{done.stderr[-2000:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


NAMES = tuple(one.name for one in (*cut.TRIALS, *cut.LOADS))


def outcomes(
    work: Path, say: Callable[[str], None], names: Sequence[str] = NAMES
) -> Iterator[Outcome]:
    """Results of the trials of these names, in a fresh folder."""
    shutil.rmtree(work / "trials", ignore_errors=True)
    root = work / "trials/root"
    for trial in (one for one in cut.TRIALS if one.name in names):
        say(trial.said)
        yield from _positions(trial, root, work)
    for trial in (one for one in cut.LOADS if one.name in names):
        say(trial.said)
        yield from _loads(trial, root, work / "trials")


def _positions(trial, root, work):
    folder = work / "trials" / trial.name
    seen = cut.positions(trial, root, folder)
    cluster = cut.clusters(trial, len(seen))

    def outcome(tool: str, told: np.ndarray, seconds: float) -> Outcome:
        return Outcome(trial.name, tool, judge.distances(told, seen, lay=True), cluster, seconds)

    spent = timed([*PIPELINE, "run", trial.name, "--engine", "local", "--root", root])
    for tool, model in ((NOMINAL, "nominal"), (OURS, "recommended")):
        told = folder / f"{model}.csv"
        words = ["predict", trial.name, folder / "poses.csv", "--model", model, "--output", told]
        more = timed([*PIPELINE, *words, "--root", root])
        yield outcome(tool, _targets(told, 1)[:, 0], spent + more if tool == OURS else np.nan)
    for tool, module in ((DH, "dh"), (LEARNED, "learned")):
        seconds = timed([sys.executable, "-m", f"bench.peers.{module}", trial.robot, folder])
        yield outcome(tool, np.loadtxt(folder / f"{module}.csv", delimiter=","), seconds)
    oriented = "phix" in (folder / "train.csv").read_text().partition("\n")[0] and not np.isnan(
        np.loadtxt(folder / "train.csv", delimiter=",", skiprows=1, max_rows=1)[3]
    )
    for six in (False, True) if oriented else (False,):
        for springs in (False, True):
            told = folder / f"figaroh{'_six' * six}{'_springs' * springs}.csv"
            _settings(folder, six, springs)
            python = work / "figaroh/bin/python"
            words = [FOREIGN / "figaroh_run.py", folder, told, *(["springs"] * springs)]
            seconds = timed([python, *words])
            tool = f"FIGAROH{', with orientations' * six}{', with springs' * springs}"
            yield outcome(tool, np.loadtxt(told, delimiter=","), seconds)


def _settings(folder: Path, six: bool, springs: bool) -> None:
    said = (FOREIGN / "figaroh.yaml").read_text("utf-8")
    for word, value in (("SPRINGS", springs), ("ORIENTED", six)):
        said = said.replace(word, str(value).lower())
    (folder / "figaroh.yaml").write_text(said.replace("FOLDER", str(folder)), "utf-8")


def _targets(path: Path, targets: int) -> np.ndarray:
    """Positions written by `pipeline predict` [m], shape (m, targets, 3)."""
    with path.open(encoding="utf-8") as file:
        rows = [[float(row[k]) for k in ("x_m", "y_m", "z_m")] for row in csv.DictReader(file)]
    return np.array(rows).reshape(-1, targets, 3)


def _loads(trial, root, folder):
    told: dict[str, list[np.ndarray]] = {}
    seen, pose, seconds = [], [], {OURS: 0.0, PAPER: 0.0}
    for fold in range(trial.folds):
        held = cut.loads(trial, fold, root, folder)
        name = f"{trial.name}_{fold}"
        t = len(held.points)
        seconds[OURS] += timed([*PIPELINE, "run", name, "--engine", "local", "--root", root])
        out = folder / f"{name}_ours.csv"
        words = ["predict", name, folder / f"{name}.csv", "--output", out, "--root", root]
        seconds[OURS] += timed([*PIPELINE, *words])
        at = _targets(out, t)
        told.setdefault(OURS, []).append((at[1::2] - at[::2]).reshape(-1, 3))
        out, train = folder / f"{name}_paper.csv", root / "data/raw" / name
        words = ["-m", "bench.peers.springs", trial.robot, train, folder / f"{name}_test", out]
        seconds[PAPER] += timed([sys.executable, *words])
        told.setdefault(PAPER, []).append(np.loadtxt(out, delimiter=",").reshape(-1, 3))
        told.setdefault(RIGID, []).append(np.zeros((held.moved.size // 3, 3)))
        seen.append(held.moved.reshape(-1, 3))
        pose.append(np.repeat(held.pose, t))
    cluster = np.unique(np.concatenate(pose), return_inverse=True)[1]
    for tool, parts in told.items():
        off = judge.distances(np.concatenate(parts), np.concatenate(seen), lay=False)
        yield Outcome(trial.name, tool, off, cluster, seconds.get(tool, np.nan))


FRAMES = ("ur5", "ur10", "fanuc_r2000ic")
"""Robots for which pybotics computes the flange frame; it supports revolute joints only."""


def keep(work: Path, kept: Path) -> None:
    """Store results of other tools: FIGAROH's UR5, and frames by pybotics.

    Args:
        work: Folder with the environments and the trials.
        kept: Folder of the results.
    """
    for name in ("figaroh.csv", "figaroh.txt"):
        if (found := work / "trials/ur5_fifth" / name).is_file():
            shutil.copy(found, kept / f"ur5_{name}")
    rng = np.random.default_rng(20260802)  # arbitrary joint values
    for name in FRAMES:
        arm = arms.read(next(t.robot for t in (*cut.TRIALS, *cut.LOADS) if t.robot.stem == name))
        q = rng.uniform(-np.pi, np.pi, (40, len(arm.table)))
        table, joints, out = (work / f"trials/{name}_{k}.csv" for k in ("table", "q", "frames"))
        np.savetxt(table, arm.table, fmt="%.17g", delimiter=",")
        np.savetxt(joints, q, fmt="%.17g", delimiter=",")
        timed([work / "pybotics/bin/python", FOREIGN / "pybotics_fk.py", table, joints, out])
        rows = np.hstack([q, np.loadtxt(out, delimiter=",")])
        np.savetxt(kept / f"{name}_frames_pybotics.csv", rows, fmt="%.17g", delimiter=",")
