"""`python -m bench.cliff`: many wrong readings in one campaign, from one to a fifth of them.

Of the loaded readings of `kr500_demo` 1 to 30 of 144 are shifted by 1, 4 or 20 mm in random
directions, twenty campaigns each. What must not be is a verdict that something fits while shifted
readings are in the estimate; what should be is that they are named by their lines in the file.
"""

from __future__ import annotations

import csv
import io
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from scipy import stats

from bench import exam
from bench.exam import Kept
from bench.worlds.run import SEEDS
from pipeline.answer.contract import Answer
from pipeline.app import cli
from pipeline.app.commands._shared import Jobs, On, Root
from pipeline.run import campaign_answer
from pipeline.service.executor import InProcesses
from pipeline.service.many import executor
from pipeline.store.campaign import in_memory

CAMPAIGN = Path(__file__).resolve().parents[1] / "data" / "raw" / "kr500_demo"
MANY = (1, 4, 10, 20, 30)
SIZES_MM = (1.0, 4.0, 20.0)
EACH = 20
GREEN = ("adequate", "explained")

command = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)


@dataclass(frozen=True)
class Spoilt:
    """One campaign before it is played.

    Attributes:
        many: How many readings are shifted.
        size_mm: By how much [mm].
        seed: Seed of which, and in which direction.
    """

    many: int
    size_mm: float
    seed: int

    @property
    def key(self) -> str:
        """Its name among the finished ones."""
        return f"{self.many} {self.size_mm:g} {self.seed}"


@dataclass(frozen=True)
class Row:
    """What came of it.

    Attributes:
        many, size_mm: As of `Spoilt`.
        verdict: The verdict.
        named: Shifted readings that the answer names by their lines.
        accused: Readings that it names and that were not shifted.
    """

    many: int
    size_mm: float
    verdict: str
    named: int
    accused: int

    @property
    def silent(self) -> bool:
        """Something is said to fit, and more than one shifted reading is in the estimate."""
        return self.verdict in GREEN and self.many - self.named > 1


@command.command()
def cliff(
    each: Annotated[int, typer.Option(min=1, help="Campaigns of each number and size.")] = EACH,
    minutes: Annotated[float, typer.Option(help="No campaign is begun after these.")] = np.inf,
    jobs: Jobs = None,
    on: On = None,
    log: Annotated[Path | None, typer.Option(help="Where finished ones are kept.")] = None,
    root: Root = Path(),
) -> None:
    """Shift readings of a campaign, and count which are named and which verdicts are silent."""
    kept = Kept(log or root / "reports" / "cliff.jsonl", code(), exam.JSON)
    seeds = exam.seeds(SEEDS, 0, each)
    wanted = [Spoilt(*one) for one in product(MANY, SIZES_MM, seeds)]
    wanted.sort(key=lambda one: seeds.index(one.seed))
    at = executor(jobs, on) or InProcesses()
    played = exam.contest(wanted, play, lambda one: one.key, code, kept, at, minutes)
    rows = [Row(**one) for one in played]
    for line in table(rows):
        typer.echo(line)
    if any(row.silent for row in rows):
        raise typer.Exit(1)


def code() -> str:
    """Hash of all that a campaign depends on."""
    made = [Path(__file__), *sorted(CAMPAIGN.glob("*.*"))]
    return exam.code_of([*exam.package("app", "report", "design", "page", "annex"), *made])


def play(one: Spoilt) -> dict[str, object]:
    """Shift readings, and see which the answer names."""
    given = {path.name: path.read_bytes() for path in CAMPAIGN.iterdir() if path.is_file()}
    given["tracker.csv"], lines = shifted(given["tracker.csv"], one)
    answer = campaign_answer("cliff", in_memory(given)).answer
    named = _named(answer)
    return asdict(
        Row(
            one.many,
            one.size_mm,
            str(answer.diagnosis.verdict),
            len(named & lines),
            len(named - lines),
        )
    )


def shifted(tracker: bytes, one: Spoilt) -> tuple[bytes, set[int]]:
    """The export with shifted readings, and their lines."""
    rng = np.random.default_rng([one.seed, one.many, int(one.size_mm)])
    head, *rows = csv.reader(io.StringIO(tracker.decode()))
    at = [head.index(f"{axis}_mm") for axis in "xyz"]
    group, target = head.index("group"), head.index("target")
    loaded = [
        number
        for number, row in enumerate(rows)
        if row[group].endswith("_loaded") and not row[target].startswith("Pl")
    ]
    chosen = rng.choice(loaded, one.many, replace=False)
    for number in chosen:
        way = rng.standard_normal(3)
        moved = np.array([rows[number][k] for k in at], float)
        moved += one.size_mm * way / np.linalg.norm(way)
        for k, value in zip(at, moved, strict=True):
            rows[number][k] = f"{value:.4f}"
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([head, *rows])
    return out.getvalue().encode(), {int(number) + 2 for number in chosen}


def _named(answer: Answer) -> set[int]:
    """Lines of the export that mistakes name."""
    out: set[int] = set()
    for cause in answer.diagnosis.causes:
        for place in cause.readings if cause.evidence else ():
            file, _, lines = place.partition(":")
            first, _, last = lines.partition("-")
            if file == "tracker.csv":
                out |= set(range(int(first), int(last or first) + 1))
    return out


def table(rows: list[Row]) -> list[str]:
    """A row for each number of readings, and the sums."""
    out = ["shifted  campaigns  named            accused  verdicts"]
    for many in MANY:
        some = [row for row in rows if row.many == many]
        if some:
            out.append(f"{many:7d}  {len(some):9d}  {_share(some):15}  {_verdicts(some)}")
    silent, count = sum(row.silent for row in rows), len(rows)
    most = stats.beta.ppf(0.95, silent + 1, count - silent) if silent < count else 1.0
    return [*out, f"silent {silent} of {count} (below {100 * most:.1f} % with 95 %)"]


def _share(rows: list[Row]) -> str:
    return f"{sum(row.named for row in rows)} of {sum(row.many for row in rows)}"


def _verdicts(rows: list[Row]) -> str:
    kinds = sorted({row.verdict for row in rows})
    said = (f"{kind} {sum(row.verdict == kind for row in rows)}" for kind in kinds)
    return f"{sum(row.accused for row in rows):7d}  {', '.join(said)}"


if __name__ == "__main__":
    cli.main(app=command, name="python -m bench.cliff")
