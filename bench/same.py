"""`python -m bench.same`: is a campaign's answer the same wherever it is computed?

Campaigns are drawn from a seed and made once: clean ones of the fuzzer, blunders and effects of the
simulator, secrets of the league. Each is answered by a process that runs as it is, and by one of
another `KINDS` in turn. Kept for each: whether result.json is equal byte by byte, whether all that
people act on is (verdict, causes, first sentences, rounded stiffnesses), and the largest relative
difference of a number.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import locale
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from multiprocessing import connection, get_context
from pathlib import Path
from typing import Any

import numpy as np

from bench.compare import FROZEN, SIMULATED, Game, Simulated, differences, flat
from bench.exam import JSON, Kept, code_of, package
from bench.fuzz import bases
from bench.league.hidden import SECRETS
from pipeline.answer.remarks import stiffness_text
from pipeline.base.errors import PipelineError
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load
from pipeline.run import campaign_answer
from pipeline.service.executor import InProcesses, InThisProcess, in_order
from pipeline.store.campaign import dump, in_memory

SEED = 42
"""Seed of all campaigns."""

PLAIN = {"PYTHONHASHSEED": "0", "LC_ALL": "C", "TZ": "UTC", "OPENBLAS_NUM_THREADS": "1"}
_NO_V4 = "X86_V4 AVX512_ICL AVX512_SPR"
_JOBS = "SAME_JOBS"
KINDS: Mapping[str, Mapping[str, str]] = {
    "four jobs": {_JOBS: "4"},
    "without AVX2": {
        "NPY_DISABLE_CPU_FEATURES": f"X86_V3 {_NO_V4}",
        "OPENBLAS_CORETYPE": "Nehalem",
    },
    "east": {
        "PYTHONHASHSEED": "1",
        "LC_ALL": "de_DE.UTF-8",
        "TZ": "Asia/Kathmandu",
        "OPENBLAS_NUM_THREADS": "2",
    },
    "without AVX-512": {"NPY_DISABLE_CPU_FEATURES": _NO_V4, "OPENBLAS_CORETYPE": "Haswell"},
    "summer time": {"PYTHONHASHSEED": "random", "LC_ALL": "C.UTF-8", "TZ": "Europe/Berlin"},
}
"""Environments that differ from `PLAIN`; with `_JOBS`, so many processes answer at once."""

Files = Mapping[str, bytes]
Said = dict[str, Any]


def drawn(number: int) -> tuple[str, Files]:
    """What a campaign contains, in words, and its files."""
    rng = np.random.default_rng([SEED, number])
    seed = int(rng.integers(2**31))
    if number % 3 == 0:
        name = bases.NAMES[rng.integers(len(bases.NAMES))]
        return name, bases.made(name, seed)
    if number % 3 == 1:
        effects = [*SIMULATED, *(one.label for one in catalogue(load("kr500_rail")))]
        effect = effects[rng.integers(len(effects))]
        return effect, Simulated(effect, seed, SIMULATED.get(effect, {})).files()
    labels = sorted(SECRETS)
    secret = (labels[rng.integers(len(labels))], float(rng.uniform(0.5, 4.0)))
    words = f"{secret[0]} times {secret[1]:.2g}"
    return words, Game([secret], [seed, 1], [seed, 2]).files()


def _serve(line: connection.Connection) -> None:
    """Answer the campaigns received until the connection is closed."""
    with contextlib.suppress(locale.Error):
        locale.setlocale(locale.LC_ALL, "")
    jobs = int(os.environ.get(_JOBS, "1"))
    many = InProcesses(jobs) if jobs > 1 else InThisProcess()
    with contextlib.suppress(EOFError):
        while True:
            first, *more = in_order(many, _answered, [line.recv()] * jobs)
            line.send(first if all(one == first for one in more) else {"jobs": [first, *more]})


def _answered(files: Files) -> Said:
    try:
        answer = campaign_answer("same", in_memory(files)).answer
        content: Said = json.loads(dump(answer.as_json()))
        return content | {"rounded": [stiffness_text(one, one.unit) for one in answer.stiffness]}
    except PipelineError as problem:
        return {"refused": str(problem)}
    except Exception as problem:  # counts, and the next one is played
        return {"crash": f"{type(problem).__name__}: {problem}"}


@contextlib.contextmanager
def _process(kind: Mapping[str, str]) -> Iterator[connection.Connection]:
    """A process in an environment of this kind."""
    before = dict(os.environ)
    spawn = get_context("spawn")
    ours, theirs = spawn.Pipe()
    process = spawn.Process(target=_serve, args=(theirs,))
    os.environ |= PLAIN | kind
    try:
        process.start()
    finally:
        os.environ.clear()
        os.environ |= before
    theirs.close()
    try:
        yield ours
    finally:
        ours.close()
        process.kill()
        process.join()


def _acted_on(said: Said) -> list[Any]:
    """What people act on."""
    if "diagnosis" not in said:
        return [said]
    found = said["diagnosis"]
    causes = [(one["name"], one.get("place"), one.get("where")) for one in found["causes"]]
    return [found["verdict"], causes, said["verdict_sentence"], said["rounded"]]


def _verdict(said: Said) -> str:
    return str(said["diagnosis"]["verdict"]) if "diagnosis" in said else str(next(iter(said)))


def row(source: str, kind: str, one: Said, other: Said) -> dict[str, Any]:
    """Two answers to one campaign, compared."""
    apart = differences(dict(flat(one)), dict(flat(other)), FROZEN)
    numbers = [each for each in apart if np.isfinite(each.size)]
    worst = max(numbers, key=lambda each: each.size, default=None)
    return {
        "source": source,
        "kind": kind,
        "verdict": _verdict(one),
        "bytes": dump(one) == dump(other),
        "acted_on": _acted_on(one) == _acted_on(other),
        "words": [str(each)[:300] for each in apart if not np.isfinite(each.size)][:9],
        "apart": 0.0 if worst is None else worst.size,
        "worst": "" if worst is None else str(worst),
    }


def play(first: int, campaigns: int, minutes: float, kept: Kept[dict[str, Any]]) -> None:
    """Play the campaigns that are not kept yet, until the time is up."""
    until, done = time.monotonic() + 60 * minutes, kept.rows()
    with contextlib.ExitStack() as stack:
        lines = {name: stack.enter_context(_process(kind)) for name, kind in KINDS.items()}
        plain = stack.enter_context(_process({}))
        for number in range(first, first + campaigns):
            if f"{number:05}" in done or time.monotonic() > until:
                continue
            source, files = drawn(number)
            kind = [*KINDS][number // 3 % len(KINDS)]
            said = []
            for line in (plain, lines[kind]):
                line.send(files)
                said.append(line.recv())
            kept.add(f"{number:05}", row(source, kind, *said))


def table(rows: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """What came of it, by kind, and each campaign in which something differs that counts."""
    for kind in KINDS:
        those = [one for one in rows.values() if one["kind"] == kind]
        beyond = [sum(one["apart"] > size for one in those) for size in (1e-6, 1e-5, 1e-4)]
        verdicts = ", ".join(f"{n} {v}" for v, n in Counter(o["verdict"] for o in those).items())
        yield (
            f"{kind}: {len(those)} campaigns ({verdicts}); {sum(o['bytes'] for o in those)} equal "
            f"byte by byte, {sum(o['acted_on'] for o in those)} in all that people act on; "
            f"numbers beyond 1e-6, 1e-5, 1e-4 in {beyond}"
        )
    for number, one in rows.items():
        if not one["acted_on"] or one["verdict"] == "crash":
            yield f"{number} {one['source']} ({one['kind']}): {one['words'] or one['worst']}"


def main() -> None:
    """Play, and print the table; exit code 1 if anything that people act on differs."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--first", type=int, default=0, help="number of the first campaign")
    words.add_argument("--campaigns", type=int, default=500)
    words.add_argument("--minutes", type=float, default=1e9, help="begin no campaign after that")
    words.add_argument("--log", type=Path, default=Path("build/same.jsonl"))
    asked = words.parse_args()
    code = code_of([*package("locale"), Path(__file__)])
    kept = Kept(asked.log, code, JSON)
    play(asked.first, asked.campaigns, asked.minutes, kept)
    rows = kept.rows()
    print(*table(rows), sep="\n")
    sys.exit(not all(one["acted_on"] for one in rows.values()))


if __name__ == "__main__":
    main()
