"""`pipeline compensate`: a campaign's model and a path in, offsets out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from pipeline.app.commands._shared import Named, Root, app, fitted
from pipeline.base import files
from pipeline.base.errors import UsageError


@app.command(short_help="Write offsets that cancel the deflection along a path.")
def compensate(
    campaign: Named,
    path: Annotated[
        Path,
        Argument(metavar="PATH", help="CSV: pose, joint values, fx_n, fy_n, fz_n per row."),
    ],
    tip: Annotated[
        tuple[float, float, float] | None,
        Option(help="Tool tip in the flange frame [m]; else the campaign's load point."),
    ] = None,
    output: Annotated[
        Path | None, Option(help="Where to; PATH-compensation.csv beside the path.")
    ] = None,
    root: Root = Path(),
) -> None:
    """Write offsets that cancel the deflection along a path."""
    written, remarks = write(root, campaign, path, tip, output)
    typer.echo(written)
    for line in remarks:
        typer.secho(fitted(line, sys.stderr), err=True)


def write(
    root: Path,
    name: str,
    path: Path,
    tip: tuple[float, float, float] | None = None,
    output: Path | None = None,
) -> tuple[Path, list[str]]:
    """Offsets for a path of poses and forces: the file, and what to know about it.

    Raises:
        UsageError: The campaign has no model yet, or the path is not there.
        InputError: The path cannot be read.
    """
    import numpy as np

    from pipeline.answer.contract import Reason
    from pipeline.prediction import compensate as offsets
    from pipeline.prediction.model import Model
    from pipeline.store import campaign as campaigns

    kept = campaigns.find(root, name).reports / "model.toml"
    if not kept.is_file():
        raise UsageError(f"{name} has no model yet: run `pipeline run {name}` first")
    model = Model.load(kept)
    try:
        data = path.read_bytes()
    except OSError as problem:
        raise UsageError(f"{path} cannot be read ({problem.strerror}): check the path") from problem
    wanted = offsets.read(path.name, data, model.robot)
    found = offsets.compensate(model, wanted, None if tip is None else np.array(tip))
    written = output or path.with_name(f"{path.stem}-compensation.csv")
    files.write(written, offsets.table(model.robot, wanted, found))
    remarks = [found.summary]
    if not Reason(model.recommended["reason"]).holds_for_its_readings:
        remarks.append(
            f"The model of {name} does not fit its own measurements: expect more than is stated."
        )
    return written, remarks
