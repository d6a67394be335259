"""Commands across campaigns: questions to all, what is common in them, two beside each other."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from pipeline.app.commands._shared import AsJson, Named, Root, open_it, show
from pipeline.base.errors import UsageError, worst


def status(as_json: AsJson = False, root: Root = Path()) -> None:
    """List the campaigns in data/raw: new, changed or done, with their verdicts."""
    from pipeline.app.shell import no_campaign
    from pipeline.fleet.states import states

    codes = []
    for outcome in states(root):
        codes.append(outcome.exit_code)
        show(outcome, as_json)
    if not codes:
        typer.secho(str(no_campaign(root)), err=True)
    raise typer.Exit(worst(codes))


def query(
    sql: Annotated[
        str | None,
        Argument(
            metavar="SQL", help='"SELECT ..."; lists the tables and their columns if omitted.'
        ),
    ] = None,
    form: Annotated[
        str | None,
        Option("--format", help="table, csv, json or xlsx; csv where stdout is no terminal."),
    ] = None,
    output: Annotated[
        Path | None, Option(metavar="FILE", help="Write to this file; its suffix sets the format.")
    ] = None,
    root: Root = Path(),
) -> None:
    """Query all finished campaigns in SQL; tables and examples are in docs/query.md."""
    from pipeline.fleet import query as asking

    wanted = _format(form, output, asking.FORMATS)
    found = asking.described() if sql is None else asking.ask(root, sql)
    if output is not None:
        from pipeline.store.campaign import outside_raw

        asking.save(found, wanted, outside_raw(root, output))
        typer.echo(output)
    elif wanted == "table":
        asking.show(found)
    else:
        typer.echo(asking.written(found, wanted), nl=False)


def _format(form: str | None, output: Path | None, known: tuple[str, ...]) -> str:
    """As asked, or by the end of the file's name; else what suits a person or a program."""
    usual = "table" if sys.stdout.isatty() else "csv"
    wanted = form or (usual if output is None else output.suffix[1:].lower())
    if wanted not in known:
        raise UsageError(f'there is no format "{wanted}": use {", ".join(known)}')
    if wanted == "table" and output is not None:
        raise UsageError("a table is for the terminal: write FILE.csv, FILE.json or FILE.xlsx")
    if wanted == "xlsx" and output is None:
        raise UsageError("a workbook needs a file: add --output FILE.xlsx")
    return wanted


def priors(
    robot: Annotated[
        str, Option(help="Name of the built-in robot whose causes are listed.")
    ] = "kr500_rail",
    root: Root = Path(),
) -> None:
    """Estimate from all campaigns how common and how large causes are, for campaign.toml."""
    from pipeline.fleet import experience as learning

    typer.echo(learning.toml(learning.learnt(root, robot)), nl=False)


def compare(
    first: Annotated[
        str,
        Argument(
            metavar="FIRST", help="A campaign; one of its models as NAME:joints or NAME:extended."
        ),
    ],
    second: Annotated[
        str, Argument(metavar="SECOND", help="Another campaign, or another model of the same one.")
    ],
    as_json: AsJson = False,
    opened: Annotated[bool, Option("--open", help="Open the page in the browser.")] = False,
    root: Root = Path(),
) -> None:
    """Compare the stiffnesses of two campaigns, or of two models of one campaign."""
    from pipeline.fleet import compare as comparing

    outcome, path = comparing.compare(root, first, second)
    show(outcome, as_json)
    if path is None:
        raise typer.Exit(outcome.exit_code)
    typer.secho(path, err=True)
    if opened:
        open_it(path)


def remove(campaign: Named, root: Root = Path()) -> None:
    """Take a campaign out of every page and table.

    Its results are deleted, its folder is moved from data/raw to data/removed.
    """
    from pipeline.fleet import pages

    kept = pages.remove(root, campaign)
    typer.echo("nothing measured was there" if kept is None else kept)
