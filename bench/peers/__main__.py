"""`python -m bench.peers`: other tools on the same data, and the tables of docs/peers.md."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from bench.peers import cut, page, run
from pipeline.app import cli

command = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)
KEPT = cut.HERE / "tests/validation"


@command.command()
def peers(
    only: Annotated[
        list[str] | None, typer.Option(help="Trials to run; the others stay as they were.")
    ] = None,
    work: Annotated[Path, typer.Option(help="Where environments and trials are.")] = cut.HERE
    / "build/peers",
    to: Annotated[Path, typer.Option("--page", help="The page.")] = cut.HERE / "docs/peers.md",
    kept: Annotated[Path, typer.Option(help="Where answers of the tools are kept.")] = KEPT,
) -> None:
    """Run every tool on every trial and write the page and the answers that tests hold us to."""
    found = []
    for one in run.outcomes(work.absolute(), typer.echo, only or run.NAMES):
        typer.echo(f"  {one.tool}: {1e3 * one.off.mean():.4f} mm")
        found.append(one)
    kept.mkdir(parents=True, exist_ok=True)
    path = kept / "peers.json"
    before = json.loads(path.read_text("utf-8")) if path.is_file() else None
    made = page.record(found)
    record = (before or {}) | made
    path.write_text(page.dumped(record), "utf-8")
    run.keep(work.absolute(), kept)
    old = to.read_text("utf-8") if to.is_file() else "# Beside other tools\n\n"
    to.write_text(page.placed(old, page.written(record, page.again(made, before))), "utf-8")
    typer.echo(page.again(made, before))


if __name__ == "__main__":
    cli.main(app=command, name="python -m bench.peers")
