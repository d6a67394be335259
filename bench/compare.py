"""`python -m bench.compare BASE`: does a change of the code change a number?

Sixty campaigns are made once, by the present tree. BASE and the present tree answer the same files,
each in a process of its own, and whatever differs in result.json is listed. A change that claims to
leave the numbers alone is held to that here, at 1e-9; tests/bench/test_frozen.py holds ten of the
campaigns to numbers that were written down, at 1e-6, and `--freeze` writes these anew.

This is a bench tool, and its exit codes are its own: 0 when nothing differs, 1 when something does,
2 when it cannot be carried out as typed.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import io
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tarfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from fnmatch import fnmatch
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from bench.bench_screening import plan as plan_of
from bench.league.hidden import SECRETS
from bench.league.play import drawn, play
from bench.league.run import Fixture, League, _sizes, fixtures, largest
from pipeline.machine.robot import load
from pipeline.run import campaign_answer
from pipeline.service.executor import InProcesses
from pipeline.simulate import revised, simulate
from pipeline.simulate.blunders import UNITS
from pipeline.store.campaign import dump, find, in_memory

TREE = Path(__file__).resolve().parents[1]
FILE = TREE / "tests" / "golden" / "frozen.json.gz"
SKIPPED = ("versions", "inputs")
"""Parts of result.json that describe its origin, not the results."""

# --- the campaigns -------------------------------------------------------------------------------

SEED = 2026
"""Seed of all campaigns: the league's, and the first of the simulator's."""

KEPT = ("kr500_demo", "fanuc_r2000ic")
KINDS = ("clean", "single", "pair", "strange", "doubtful")
EACH = 8
"""Number of games of each kind."""

SIMULATED: Mapping[str, Mapping[str, Any]] = {
    **{f"unit_mixup:{unit}": {} for unit in UNITS},
    "sign_or_convention:controller_axes": {},
    "sign_or_convention:left_handed": {},
    "sign_or_convention:pull_reversed": {},
    "sign_or_convention:d_5": {},
    "sign_or_convention:modified_dh": {},
    "label_swap": {},
    "outlier": {},
    "rail_roll": {"tracker": {"dialect": "spatialanalyzer"}},
    "joint_tilt:3": {"tracker": {"stated": False}},
    "link_bending:forearm": {"hidden": {"equilibrium": "deformed"}},
    "scale_zero": {"pulls": {"repeats": 2}},
    "tracker_drift": {"pulls": {"zero": "before"}},
    "gravity_sag": {"robot": "kr500_rail_kuka"},
    "tool_point": {},
}
"""What is planted in a campaign of the simulator, and how its plan differs from the others."""


@dataclass(frozen=True)
class Kept:
    """A campaign under data/raw.

    Attributes:
        folder: Its name.
    """

    folder: str

    def files(self) -> dict[str, bytes]:
        """Content of the files that its campaign.toml names."""
        return dict(find(TREE, self.folder).read().files)


@dataclass(frozen=True)
class Game:
    """A game of the league; sizes are given, so that they do not depend on the pipeline.

    Attributes:
        secrets: Label, and size in typical sizes.
        seed: Seed of machine and noise.
        plan: Seed of the plan.
    """

    secrets: Sequence[tuple[str, float]]
    seed: Sequence[int]
    plan: Sequence[int]

    def files(self) -> dict[str, bytes]:
        """Content of its raw folder."""
        robot, rules = load("kr500_rail"), League().rules
        plan = drawn(robot, np.random.default_rng(self.plan), rules)
        secrets = [(SECRETS[label], size) for label, size in self.secrets]
        return play(robot, plan, secrets, np.random.default_rng(self.seed), rules).files


@dataclass(frozen=True)
class Simulated:
    """A campaign of the simulator with one blunder or cause.

    Attributes:
        effect: The blunder or cause.
        seed: Seed of its plan.
        changes: Changes of its plan.
    """

    effect: str
    seed: int
    changes: Mapping[str, Any]

    def files(self) -> dict[str, bytes]:
        """Content of its raw folder."""
        return dict(simulate(revised(plan_of(self.effect, self.seed), dict(self.changes))).files)


Recipe = Kept | Game | Simulated
RECIPES = {kind.__name__.lower(): kind for kind in (Kept, Game, Simulated)}


def keys() -> list[str]:
    """Names of all campaigns."""
    return [*KEPT, *(f"{kind}{i}" for kind in KINDS for i in range(1, EACH + 1)), *SIMULATED]


def recipe(key: str) -> Recipe:
    """How a campaign is made."""
    if key in KEPT:
        return Kept(key)
    if key in SIMULATED:
        return Simulated(key, SEED + list(SIMULATED).index(key), SIMULATED[key])
    return _game(key[:-1], int(key[-1]) - 1)


def _game(kind: str, number: int) -> Game:
    """One of `EACH` games taken evenly from the league, or the next valid one after it."""
    league, robot = League(seed=SEED), load("kr500_rail")
    these, most = _fixtures(kind), largest(robot)
    # shifted by one game each time: the league repeats its list of causes, and an even step would
    # meet the same ones again
    first = number * len(these) // EACH + number
    for one in these[first:] + these[:first]:
        plan = drawn(robot, np.random.default_rng(one.plan), league.rules)
        sizes = [float(size) for size in _sizes(one, plan, league, robot)]
        secrets = list(zip(one.secrets, sizes, strict=True))
        if all(size <= most.get(label, np.inf) for label, size in secrets):
            return Game(secrets, one.seed, one.plan)
    raise LookupError(f"the league plays no more games of kind {kind}")


@cache
def _fixtures(kind: str) -> list[Fixture]:
    return [one for one in fixtures(League(seed=SEED)) if one.kind == kind]


def digest(files: Mapping[str, bytes]) -> str:
    """SHA-256 over names and content."""
    parts = [f"{name}:{hashlib.sha256(data).hexdigest()}" for name, data in sorted(files.items())]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


# --- two answers, side by side -------------------------------------------------------------------

Place = tuple[str | int, ...]
"""Keys and indices that lead to a value."""

Leaf = Any


@dataclass(frozen=True)
class Tolerance:
    """Difference of two numbers up to which they count as equal.

    Attributes:
        relative: Relative to the larger one; for p values, to the larger logarithm or 1.
        rounding: Pattern of a path -> absolute difference that counts as rounding there.
    """

    relative: float
    rounding: Mapping[str, float]

    def apart(self, path: Place, one: float, other: float) -> float:
        """Relative difference of two numbers, 0 if it is within the tolerance."""
        if one == other or abs(one - other) <= self._rounding(path):
            return 0.0
        size = _log_apart(one, other) if is_p(path) else _apart(one, other)
        return size if size > self.relative else 0.0

    def _rounding(self, path: Place) -> float:
        where = pattern(path)
        found = [most for form, most in self.rounding.items() if re.search(form, where)]
        return max(found, default=0.0)


def _apart(one: float, other: float) -> float:
    return abs(one - other) / max(abs(one), abs(other))


def _log_apart(one: float, other: float) -> float:
    if min(one, other) <= 0:
        return math.inf
    logs = math.log(one), math.log(other)
    return abs(logs[0] - logs[1]) / max(1.0, *map(abs, logs))


EXACT = Tolerance(1e-9, {})
"""For two versions of the code on one processor."""

FROZEN = Tolerance(
    1e-6,
    {
        r"_mm(\[\])?$": 1e-9,  # a millionth of a micrometre, where a deflection crosses zero
        r"^geometry.*\.value$": 1e-15,  # [m] or [rad], of an entry that is zero
        r"\.probability$": 1e-12,
        r"\.share$": 1e-9,
        r" \[%\]$": 1e-7,
    },
)
"""For one version on different processors and numbers of threads. A contribution or a probability
of rounding size is negligible relative to the total, which is 1 or 100 %."""


@dataclass(frozen=True)
class Kind:
    """What a place contains that is not a single value.

    Attributes:
        text: `an object`, `a list of 3`.
    """

    text: str


ABSENT = Kind("absent")


def _shown(leaf: Leaf) -> str:
    return leaf.text if isinstance(leaf, Kind) else json.dumps(leaf, ensure_ascii=False)


@dataclass(frozen=True)
class Difference:
    """One place where two answers differ.

    Attributes:
        path: The place.
        before: Content in the first answer; `ABSENT` if there is none.
        after: Likewise in the second.
        size: Relative difference of numbers, infinite for everything else.
    """

    path: Place
    before: Leaf
    after: Leaf
    size: float

    def __str__(self) -> str:
        size = "" if math.isinf(self.size) else f"  ({self.size:.2g})"
        return f"{spelled(self.path)}: {_shown(self.before)} -> {_shown(self.after)}{size}"


def is_p(path: Place) -> bool:
    """Whether the value at a place is a p value."""
    return any(part == "p_value" or str(part).endswith("_p") for part in path)


def spelled(path: Place) -> str:
    """`diagnosis.causes[0].p_value`."""
    words = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return words.removeprefix(".") or "the whole answer"


def pattern(path: Place) -> str:
    """`diagnosis.causes[].p_value`."""
    return re.sub(r"\[\d+\]", "[]", spelled(path))


def flat(content: Any, path: Place = ()) -> Iterator[tuple[Place, Leaf]]:
    """Every place of an answer with its content."""
    if isinstance(content, dict):
        yield path, Kind("an object")
        for name, value in content.items():
            if path or name not in SKIPPED:
                yield from flat(value, (*path, name))
    elif isinstance(content, list):
        yield path, Kind(f"a list of {len(content)}")
        for i, value in enumerate(content):
            yield from flat(value, (*path, i))
    else:
        yield path, content


def differences(
    before: Mapping[Place, Leaf], after: Mapping[Place, Leaf], tolerance: Tolerance
) -> list[Difference]:
    """Where two flat answers differ; what is missing as a whole is listed once."""
    found = []
    for path in dict.fromkeys((*before, *after)):
        one, other = before.get(path, ABSENT), after.get(path, ABSENT)
        if ABSENT in (one, other) and path and not _same_parent(before, after, path[:-1]):
            continue
        size = _size(path, one, other, tolerance)
        if size:
            found.append(Difference(path, one, other, size))
    return found


def _same_parent(before: Mapping[Place, Leaf], after: Mapping[Place, Leaf], parent: Place) -> bool:
    """Whether the container of a place is the same on both sides, or absent on both."""
    return bool(before.get(parent, ABSENT) == after.get(parent, ABSENT))


def _size(path: Place, one: Leaf, other: Leaf, tolerance: Tolerance) -> float:
    if _number(one) and _number(other):
        return tolerance.apart(path, one, other)
    return 0.0 if type(one) is type(other) and one == other else math.inf


def _number(leaf: Leaf) -> bool:
    return isinstance(leaf, int | float) and not isinstance(leaf, bool)


@dataclass(frozen=True)
class Same:
    """A part of the answer with different places in the two trees, `--same OLD=NEW`.

    Attributes:
        text: As typed; the common name of both places.
        places: Old and new path; None stands for every index.
    """

    text: str
    places: tuple[tuple[str | None, ...], tuple[str | None, ...]]

    def moved(self, path: Place, side: int) -> Place | None:
        """The path under the common name; None if it is not within that part."""
        place = self.places[side]
        here = path[: len(place)]
        if len(here) < len(place):
            return None
        fits = (
            isinstance(got, int) if want is None else got == want
            for want, got in zip(place, here, strict=True)
        )
        if not all(fits):
            return None
        return (self.text, *(got for got in here if isinstance(got, int)), *path[len(place) :])


def same(text: str) -> Same:
    """`OLD=NEW`, with `[]` for every element of a list: `stiffness=joint_springs.stiffness`."""
    old, equals, new = text.partition("=")
    if not (old and equals and new):
        raise argparse.ArgumentTypeError(f'"{text}" is not OLD=NEW')
    return Same(text, (_parts(old), _parts(new)))


def _parts(text: str) -> tuple[str | None, ...]:
    return tuple(part or None for part in text.replace("[]", ".").split("."))


def placed(answer: Any, sames: Sequence[Same], side: int) -> dict[Place, Leaf]:
    """A flat answer, with moved parts under their common name.

    Containers of only such parts are left out.
    """
    stays, moves = {}, {}
    for path, leaf in flat(answer):
        there = next((there for one in sames if (there := one.moved(path, side))), None)
        if there is None:
            stays[path] = leaf
        else:
            moves[path] = (there, leaf)
    above = {higher for path in moves for higher in _above(path)}
    held = {higher for path in stays if path not in above for higher in _above(path)}
    left = {path: leaf for path, leaf in stays.items() if path not in above or path in held}
    return left | dict(moves.values())


def _above(path: Place) -> Iterator[Place]:
    return (path[:k] for k in range(len(path)))


# --- two trees -----------------------------------------------------------------------------------

RUNNER = """
import json, sys
from pathlib import Path

import pipeline

tree, raw, out = (Path(word).resolve() for word in sys.argv[1:])
if tree not in Path(pipeline.__file__).resolve().parents:
    sys.exit(f"pipeline comes from {pipeline.__file__}, not from {tree}")

if (tree / "pipeline" / "store").is_dir():
    from pipeline.store.campaign import in_memory
    from pipeline.base.errors import PipelineError
else:  # from before the files had rooms; an editable install would lend those of another tree
    from pipeline.campaign import in_memory
    from pipeline.errors import PipelineError
import pipeline.run

answered = getattr(pipeline.run, "campaign_answer", None) or pipeline.run.answered


def outcome(folder):
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    try:
        answer = answered(folder.name, in_memory(files)).answer
        answer = answer if isinstance(answer, dict) else answer.as_json()  # of an earlier tree
        return json.dumps({"answer": answer}, allow_nan=False)
    except PipelineError as problem:
        return json.dumps({"error": {"type": type(problem).__name__, "text": str(problem)}})
    except Exception as problem:
        return json.dumps({"crash": f"{type(problem).__name__}: {problem}"})


for folder in sorted(raw.iterdir()):
    (out / f"{folder.name}.json").write_text(outcome(folder), "utf-8")
"""
"""Run in either tree, also in one without this file; arguments: tree, raw files, answers."""


class CannotCompare(Exception):
    """BASE is not available, or a tree cannot be run."""


def checked_out(base: str, to: Path) -> None:
    """Extract the package as of a commit, without a worktree."""
    command = ["git", "-C", str(TREE), "archive", base, "pipeline"]
    done = subprocess.run(command, capture_output=True, check=False)
    if done.returncode:
        raise CannotCompare(done.stderr.decode().strip())
    with tarfile.open(fileobj=io.BytesIO(done.stdout)) as tar:
        tar.extractall(to, filter="data")


def copied(to: Path) -> None:
    """Copy the present package, so that later edits are not compared."""
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(TREE / "pipeline", to / "pipeline", ignore=ignored)


def outcomes(tree: Path, raw: Path, out: Path) -> dict[str, Any]:
    """Outcomes of a tree for all campaigns under `raw`."""
    out.mkdir()
    one_thread = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", RUNNER, str(tree), str(raw), str(out)],
        env={**os.environ, **one_thread, "PYTHONPATH": str(tree)},
        cwd=tree,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise CannotCompare(f"the tree under {tree.name} cannot be run:\n{done.stderr}")
    return {path.stem: json.loads(path.read_text("utf-8")) for path in out.iterdir()}


def made(key: str) -> tuple[str, dict[str, bytes]]:
    """A campaign's name and raw files."""
    return key, recipe(key).files()


def compared(
    base: str, asked: Sequence[str], sames: Sequence[Same], jobs: int
) -> dict[str, list[Difference]]:
    """Differences between BASE and the present tree, by campaign."""
    began = time.perf_counter()
    with TemporaryDirectory() as name:
        room = Path(name)
        trees = [room / "base", room / "present"]
        checked_out(base, trees[0])
        copied(trees[1])
        _write(room / "raw", asked, jobs)
        print(f"{len(asked)} campaigns made in {time.perf_counter() - began:.0f} s", flush=True)
        with ThreadPoolExecutor(jobs) as pool:
            work = [(tree, room / "raw", room / f"of_{tree.name}") for tree in trees]
            before, after = pool.map(lambda each: outcomes(*each), work)
    print(f"answered by both trees after {time.perf_counter() - began:.0f} s", flush=True)
    _known(sames, before, after)
    return {key: _against(before[key], after[key], sames) for key in asked}


def _write(raw: Path, asked: Sequence[str], jobs: int) -> None:
    for done in InProcesses(jobs).results(made, asked):
        key, files = done.result
        (raw / key).mkdir(parents=True)
        for name, content in files.items():
            (raw / key / name).write_bytes(content)


def _known(sames: Sequence[Same], *sides: Mapping[str, Any]) -> None:
    """Reject a part that no answer has, as a typing error."""
    for one in sames:
        for side, found in enumerate(sides):
            paths = (path for each in found.values() for path, _ in flat(each.get("answer")))
            if not any(one.moved(path, side) for path in paths):
                where = ("BASE", "the present tree")[side]
                raise CannotCompare(f"--same {one.text}: no answer of {where} has that part")


def _against(
    before: Mapping[str, Any], after: Mapping[str, Any], sames: Sequence[Same]
) -> list[Difference]:
    """Differences of two outcomes; if only one is an answer, that is the difference."""
    if before.keys() == after.keys() == {"answer"}:
        old, new = placed(before["answer"], sames, 0), placed(after["answer"], sames, 1)
        return differences(old, new, EXACT)
    one, other = (_outcome(each) for each in (before, after))
    return [] if one == other else [Difference((), one, other, math.inf)]


def _outcome(said: Mapping[str, Any]) -> Leaf:
    return Kind("an answer") if "answer" in said else said


def told(found: Mapping[str, Sequence[Difference]], log: Path | None = None) -> int:
    """Print the differences by pattern with the largest of each; return their number."""
    every = [(key, one) for key, those in found.items() for one in those]
    groups: dict[str, list[tuple[str, Difference]]] = {}
    for key, one in every:
        groups.setdefault(pattern(one.path), []).append((key, one))
    for where, members in sorted(groups.items()):
        key, worst = max(members, key=lambda each: each[1].size)
        print(f"{len(members):6}  {where}\n        {key}  {worst}")
    touched = sum(bool(those) for those in found.values())
    print(f"{len(every)} differences in {touched} of {len(found)} campaigns")
    if log:
        log.write_text("".join(f"{key}  {one}\n" for key, one in every), "utf-8")
    return len(every)


# --- frozen answers -------------------------------------------------------------------------------

CHOSEN = (
    "kr500_demo",
    "fanuc_r2000ic",
    "clean2",
    "single2",
    "pair4",
    "strange5",
    "strange8",
    "doubtful4",
    "unit_mixup:kgf",
    "outlier",
)
"""Campaigns of tests/bench/test_frozen.py: good and bad ones of every kind, whose numbers agree to
3e-7 on processors of different kinds. Some others do not agree: the search for lost motion or
hysteresis may end 1e-4 away, and for exact twins rounding decides which comes first."""


def answer_of(key: str, files: Mapping[str, bytes]) -> dict[str, Any]:
    """result.json of the present tree."""
    answer: dict[str, Any] = json.loads(
        dump(campaign_answer(key, in_memory(files)).answer.as_json())
    )
    return answer


def frozen() -> dict[str, Any]:
    """Campaign -> recipe, digest of its raw files and answer, as frozen."""
    held: dict[str, Any] = json.loads(gzip.decompress(FILE.read_bytes()))
    return held


def thawed(held: Mapping[str, Any]) -> Recipe:
    """The recipe in an entry of `frozen`."""
    ((kind, content),) = held["recipe"].items()
    return RECIPES[kind](**content)


def freeze() -> None:
    """Write the answers of the present tree, and print where they differ from the frozen ones."""
    before = frozen() if FILE.exists() else {}
    after = {key: _entry(key, before.get(key)) for key in CHOSEN}
    pairs = {key: (before[key]["answer"], after[key]["answer"]) for key in after if key in before}
    told({k: differences(dict(flat(a)), dict(flat(b)), FROZEN) for k, (a, b) in pairs.items()})
    text = json.dumps(after, indent=0, ensure_ascii=False, allow_nan=False)
    FILE.write_bytes(gzip.compress(text.encode(), mtime=0))
    print(f"{len(after)} campaigns written to {FILE.relative_to(TREE)}")


def _entry(key: str, held: Mapping[str, Any] | None) -> dict[str, Any]:
    """Entry of a campaign, as originally drawn even if the catalogue has grown since."""
    how = recipe(key) if held is None else thawed(held)
    files = how.files()
    answer = {k: v for k, v in answer_of(key, files).items() if k not in SKIPPED}
    kind = {type(how).__name__.lower(): asdict(how)}
    return {"recipe": kind, "raw": digest(files), "answer": _rounded(answer)}


def _rounded(content: Any) -> Any:
    """Ten digits of every number, four more than are compared."""
    if isinstance(content, dict):
        return {name: _rounded(value) for name, value in content.items()}
    if isinstance(content, list):
        return [_rounded(value) for value in content]
    return float(f"{content:.10g}") if isinstance(content, float) else content


# --- the command ---------------------------------------------------------------------------------


def _wanted(forms: Iterable[str]) -> list[str]:
    """Campaigns selected by name or pattern such as `single*`; all without a selection."""
    forms = list(forms)
    unknown = [form for form in forms if not any(fnmatch(key, form) for key in keys())]
    if unknown:
        raise CannotCompare(f"no campaign {', '.join(unknown)}; there are {', '.join(keys())}")
    return [key for key in keys() if not forms or any(fnmatch(key, form) for form in forms)]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.compare", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("base", nargs="?", metavar="BASE", help="the commit to compare with")
    parser.add_argument("--jobs", type=int, choices=(1, 2), default=2, help="processes at a time")
    parser.add_argument("--only", nargs="+", default=[], metavar="KEY", help="these campaigns only")
    parser.add_argument(
        "--same", type=same, action="append", default=[], metavar="OLD=NEW",
        help="a part of the answer that has moved; causes[].gain=causes[].worth within lists",
    )  # fmt: skip
    parser.add_argument("--log", type=Path, metavar="FILE", help="write every difference there")
    parser.add_argument("--freeze", action="store_true", help="write tests/golden anew instead")
    asked = parser.parse_args()
    if bool(asked.base) == asked.freeze:
        parser.error("name a commit to compare with, or --freeze")
    return asked


def main() -> int:
    """Compare or freeze; return the exit code."""
    asked = _arguments()
    if asked.freeze:
        freeze()
        return 0
    try:
        found = compared(asked.base, _wanted(asked.only), asked.same, asked.jobs)
    except CannotCompare as problem:
        print(problem, file=sys.stderr)
        return 2
    return int(told(found, asked.log) > 0)


if __name__ == "__main__":
    sys.exit(main())
