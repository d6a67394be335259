"""`python -m bench.worlds`: campaigns as they occur in practice, unlike those of our simulator."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.app import cli
from pipeline.app.commands._shared import Jobs, On, Root
from pipeline.service.executor import InProcesses
from pipeline.service.many import executor

command = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)

BEGIN = "<!-- make worlds writes from here -->"


@command.command()
def worlds(
    world: Annotated[
        list[str] | None,
        typer.Option(help="Worlds or whole exams, several with commas or by repeating; else all."),
    ] = None,
    games: Annotated[int, typer.Option(min=0, help="Games per world.")] = 5,
    first: Annotated[int, typer.Option(min=0, help="Number of the first game.")] = 0,
    cause: Annotated[
        bool, typer.Option("--cause", help="Hide a cause of the league in each.")
    ] = False,
    jobs: Jobs = None,
    on: On = None,
    show: Annotated[bool, typer.Option("--list", help="Say which worlds there are.")] = False,
    seeds: Annotated[Path | None, typer.Option(help="Whole numbers, one per game.")] = None,
    log: Annotated[
        Path | None, typer.Option(help="Where finished games are kept, one JSON line each.")
    ] = None,
    page: Annotated[
        Path | None, typer.Option(help="Markdown page of all games of this code that are kept.")
    ] = None,
    root: Root = Path(),
) -> None:
    """Play campaigns of other noise, blunders, loads, payloads and instruments, and judge them."""
    from bench.worlds.run import SEEDS, contest, fixtures
    from bench.worlds.table import failures, spoken
    from bench.worlds.worlds import WORLDS

    if show:
        for one in WORLDS.values():
            typer.echo(f"{one.exam:12} {one.name:26} {one.says}")
        return
    names = chosen(",".join(world or []))
    wanted = fixtures(names, games, first, cause, seeds or SEEDS)
    kept = log or root / "reports" / "worlds.jsonl"
    played = contest(wanted, kept, executor(jobs, on) or InProcesses())
    for line in [*spoken(played), "", *failures(played)]:
        typer.echo(line)
    if page is not None:
        _write(page, kept)


def chosen(text: str) -> list[str]:
    """Names of worlds; an exam stands for all of its worlds, an empty text for all.

    Raises:
        UsageError: There is no such world.
    """
    from bench.worlds.worlds import EXAMS, WORLDS
    from pipeline.base.errors import UsageError, listed

    asked = text.split(",") if text else list(EXAMS)
    known = {exam: [w.name for w in WORLDS.values() if w.exam == exam] for exam in EXAMS}
    known |= {name: [name] for name in WORLDS}
    unknown = [word for word in asked if word not in known]
    if unknown:
        raise UsageError(f"no world {listed(unknown)}; there are {listed(known, len(known))}")
    return list(dict.fromkeys(name for word in asked for name in known[word]))


def _write(page: Path, log: Path) -> None:
    """Write all games of this code that are kept, in the order of the worlds."""
    from bench.exam import write_between
    from bench.worlds.run import code, kept
    from bench.worlds.table import failures, lines
    from bench.worlds.worlds import WORLDS

    order = list(WORLDS)
    played = sorted(
        kept(log).rows().values(), key=lambda g: (order.index(g.world.partition("+")[0]), g.seed)
    )
    said = [
        f"{len(played)} games (code {code()}). In brackets: count, and 95 % interval after Clopper "
        "and Pearson, as if the intervals of one campaign were independent.",
        *lines(played),
        "",
        *(f"- {line}" for line in failures(played)),
    ]
    write_between(page, BEGIN, "Worlds outside of the simulator", said)


if __name__ == "__main__":
    cli.main(app=command, name="python -m bench.worlds")
