"""`pipeline effects`: the causes of misfit that the diagnosis knows."""

from __future__ import annotations

from typing import Annotated

import typer
from typer import Option

from pipeline.app.commands._shared import AsJson


def effects(
    robot: Annotated[str, Option(help="Name of a built-in robot, or a robot file.")] = "kr500_rail",
    as_json: AsJson = False,
) -> None:
    """List the causes of misfit that the diagnosis knows, with magnitudes and signatures."""
    from pipeline.machine.effects import listing
    from pipeline.machine.robot import load

    machine = load(robot)
    typer.echo(listing.as_json(machine) if as_json else listing.as_text(machine))
