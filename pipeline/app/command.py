"""Commands for measured campaigns: `run` and `report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from pipeline.app.commands._shared import (
    AsJson,
    Jobs,
    On,
    Root,
    open_it,
    several,
    show,
)
from pipeline.base.errors import MISFIT, UsageError, worst
from pipeline.base.language import Language
from pipeline.base.shown import lines


def run(
    campaigns: Annotated[
        list[str] | None,
        Argument(
            metavar="CAMPAIGN",
            help="Name of a folder in data/raw, or a path; all campaigns if omitted.",
        ),
    ] = None,
    as_json: AsJson = False,
    engine: Annotated[
        str | None, Option(help="prefect or local; --jobs and --on imply local.")
    ] = None,
    jobs: Jobs = None,
    on: On = None,
    force: Annotated[
        bool, Option("--force", help="Compute again even if nothing has changed.")
    ] = False,
    strict: Annotated[
        bool,
        Option(
            "--strict",
            help="Exit with code 4 if the model does not fit, the tolerance is not certainly met, "
            "or a stiffness is not determined.",
        ),
    ] = False,
    root: Root = Path(),
) -> None:
    """Process new or changed campaigns, write their reports and print where they are."""
    from pipeline.app import shell

    if engine not in (None, "prefect", "local"):
        raise UsageError(f'there is no engine "{engine}": use prefect or local')
    together = several(jobs, on)
    if together and engine == "prefect":
        raise UsageError(
            "--jobs and --on do without Prefect: leave out --engine, or see docs/teams.md for "
            "several of Prefect's workers"
        )
    codes = []
    for outcome in shell.run_all(
        root, campaigns or [], engine or shell.usual_engine(), force, together
    ):
        codes += [outcome.exit_code, MISFIT if strict and outcome.misfit else 0]
        show(outcome, as_json)
    raise typer.Exit(worst(codes))


def report(
    campaign: Annotated[
        str | None,
        Argument(
            metavar="CAMPAIGN", help="Name or path; the overview of all campaigns if omitted."
        ),
    ] = None,
    form: Annotated[str, Option("--format", help="html, pdf, json or text.")] = "html",
    opened: Annotated[bool, Option("--open", help="Open it in the browser or viewer.")] = False,
    language: Annotated[
        Language | None,
        Option(help="Of a further certificate: en, de or fr, in a folder below the report's."),
    ] = None,
    root: Root = Path(),
) -> None:
    """Bring a campaign's report up to date and say where it is; with --format text, print it."""
    from pipeline.app import shell

    if form not in ("html", "pdf", "json", "text"):
        raise UsageError(f'there is no format "{form}": use html, pdf, json or text')
    if language and form in ("json", "text"):
        raise UsageError(f"{form} is in English alone: leave --language out, or ask for pdf")
    if form == "text":
        if campaign is None:
            raise UsageError("name the campaign whose report you want as text")
        typer.echo(lines(shell.report_text(root, campaign)), nl=False)
        return
    path = shell.report(root, campaign, form, language)
    typer.echo(path)
    if opened:
        open_it(path)
