"""Commands about measured campaigns."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from pipeline.app.commands._shared import AsJson, Named, Root, app, at_work, open_it, show
from pipeline.base.errors import MISFIT, UsageError, worst
from pipeline.base.shown import lines


@app.command(short_help="Make the folder of a new campaign.")
def init(
    name: Annotated[
        str | None, Argument(metavar="NAME", help="Of the new campaign and its folder.")
    ] = None,
    robot: Annotated[str | None, Option(help="A robot that ships, or a robot file.")] = None,
    plan: Annotated[
        Path | None, Option(help="Plan file: its poses, steps and tool are filled in.")
    ] = None,
    root: Root = Path(),
) -> None:
    """Make the folder of a new campaign; asks on a terminal."""
    from pipeline.app import blank

    ask = sys.stdin.isatty()
    if name is None and not ask:
        raise UsageError("the campaign has no name: write `pipeline init NAME`")
    if name is None:
        name = str(typer.prompt(f"Name of the campaign ({blank.NAME})", err=True))
    folder = blank.vacant(root, name)
    if plan is None:
        _blank(root, name, robot, ask)
    elif robot is None:
        from pipeline.app.commands.simulate import prepare

        prepare(folder, plan)
        typer.echo(folder)
    else:
        raise UsageError("the plan names its robot: leave out --robot, or --plan")


def _blank(root: Path, name: str, robot: str | None, ask: bool) -> None:
    """A folder to be filled in by hand, with what is known or asked."""
    from pipeline.app import blank

    if robot is None and ask:
        robot = typer.prompt(f"Robot ({blank.robots()}, or a file)", "kr500_rail", err=True)
    robot = robot or "kr500_rail"
    blank.known(root, name, robot)
    sizes = {
        key: _size(f"{what} [{unit}]", default) if ask else default
        for key, (what, unit, default) in blank.ASKED.items()
    }
    typer.echo(blank.init(root, name, robot, **sizes))
    at_work(
        f"Fill in campaign.toml, copy the files it names beside it, then: pipeline check {name}"
    )


def _size(question: str, default: float) -> float:
    """A number above zero, asked until it is one; a decimal comma is as good as a point."""
    while True:
        answer = str(typer.prompt(question, f"{default:g}", err=True))
        with contextlib.suppress(ValueError):
            if 0 < (size := float(answer.replace(",", "."))) < float("inf"):
                return size
        typer.echo(f'"{answer}" is no number above zero.', err=True)


@app.command(short_help="Read a campaign, say what would be used and what is wrong.")
def check(campaign: Named, as_json: AsJson = False, root: Root = Path()) -> None:
    """Read a campaign, say what would be used and what is wrong; compute nothing."""
    from pipeline.app import shell

    outcome = shell.check(root, campaign)
    show(outcome, as_json)
    raise typer.Exit(outcome.exit_code)


@app.command(short_help="Say what a tracker export is, and what is wrong with it.")
def inspect(
    file: Annotated[Path, Argument(metavar="FILE", help="A tracker export.")],
    unit: Annotated[str | None, Option(help="mm, m or in, where the export does not say.")] = None,
    as_json: AsJson = False,
    csv: Annotated[
        bool, Option("--csv", help="Print the readings in SI, for a spreadsheet.")
    ] = False,
) -> None:
    """Say what a tracker export is: dialect, unit, coordinates, times, what is wrong with it."""
    from pipeline.app import shell

    if unit not in (None, "mm", "m", "in"):
        raise UsageError(f'there is no unit "{unit}": use mm, m or in')
    outcome = shell.inspect(file, unit, csv)
    show(outcome, as_json)
    raise typer.Exit(outcome.exit_code)


@app.command(short_help="Compute what is new or changed, and write the reports.")
def run(
    campaigns: Annotated[
        list[str] | None,
        Argument(
            metavar="CAMPAIGN", help="Name under data/raw, or a path; all when none is named."
        ),
    ] = None,
    as_json: AsJson = False,
    engine: Annotated[str, Option(help="prefect or local.")] = "prefect",
    force: Annotated[bool, Option("--force", help="Compute even if nothing changed.")] = False,
    strict: Annotated[
        bool, Option("--strict", help="Exit 4 when the model does not fit or a joint is open.")
    ] = False,
    root: Root = Path(),
) -> None:
    """Compute what is new or changed, write the reports and say where they are."""
    from pipeline.app import shell

    if engine not in ("prefect", "local"):
        raise UsageError(f'there is no engine "{engine}": use prefect or local')
    codes = []
    for outcome in shell.run_all(root, campaigns or [], engine, force):
        codes += [outcome.exit_code, MISFIT if strict and outcome.misfit else 0]
        show(outcome, as_json)
    raise typer.Exit(worst(codes))


@app.command(short_help="List the campaigns: new, changed or done, with verdicts.")
def status(as_json: AsJson = False, root: Root = Path()) -> None:
    """List the campaigns under data/raw: new, changed or done, with their verdicts."""
    from pipeline.app import shell

    codes = []
    for outcome in shell.status(root):
        codes.append(outcome.exit_code)
        show(outcome, as_json)
    if not codes:
        typer.secho(str(shell.no_campaign(root)), err=True)
    raise typer.Exit(worst(codes))


@app.command(short_help="Open or print a report, or the page over all of them.")
def report(
    campaign: Annotated[
        str | None,
        Argument(metavar="CAMPAIGN", help="Name or path; without it the page over all campaigns."),
    ] = None,
    form: Annotated[str, Option("--format", help="html, pdf, json or text.")] = "html",
    opened: Annotated[bool, Option("--open", help="Open it.")] = False,
    root: Root = Path(),
) -> None:
    """Bring a campaign's report up to date and say where it is; with --format text, print it."""
    from pipeline.app import shell

    if form not in ("html", "pdf", "json", "text"):
        raise UsageError(f'there is no format "{form}": use html, pdf, json or text')
    if form == "text":
        if campaign is None:
            raise UsageError("name the campaign whose report you want as text")
        typer.echo(lines(shell.report_text(root, campaign)), nl=False)
        return
    path = shell.report(root, campaign, form)
    typer.echo(path)
    if opened:
        open_it(path)


@app.command(short_help="Say how two campaigns, or two models of one, differ.")
def compare(
    first: Annotated[
        str,
        Argument(metavar="FIRST", help="A campaign, or campaign:joints, campaign:extended."),
    ],
    second: Annotated[str, Argument(metavar="SECOND", help="Another one, or another model of it.")],
    as_json: AsJson = False,
    opened: Annotated[bool, Option("--open", help="Open the page.")] = False,
    root: Root = Path(),
) -> None:
    """Say how the stiffnesses of two campaigns, or of two models of one, differ."""
    from pipeline.app import compare as comparing

    outcome, path = comparing.compare(root, first, second)
    show(outcome, as_json)
    if path is None:
        raise typer.Exit(outcome.exit_code)
    typer.secho(path, err=True)
    if opened:
        open_it(path)
