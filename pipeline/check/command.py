"""`pipeline check`."""

from __future__ import annotations

from pathlib import Path

import typer

from pipeline.app.commands._shared import AsJson, Named, Root, show


def check(campaign: Named, as_json: AsJson = False, root: Root = Path()) -> None:
    """Check a campaign without computing it: what would be used, and what looks wrong."""
    from pipeline.app.outcome import named
    from pipeline.check import report

    outcome = named(root, campaign, report.check)
    show(outcome, as_json)
    raise typer.Exit(outcome.exit_code)
