"""`pipeline compensate`: a campaign's model and a path or a robot program in, corrected out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from pipeline.app.commands._shared import Named, Root, app, fitted
from pipeline.app.corrected import Frame, Given, listed_lines, program, write
from pipeline.base import files

_NAMED = "[NAME=]X,Y,Z,A,B,C, as the program writes poses"


@app.command(short_help="Correct a path or a robot program for the deflection under load.")
def compensate(
    campaign: Named,
    path: Annotated[
        Path,
        Argument(
            metavar="PATH",
            help="A robot program: .src or .dat (KUKA), .mod (ABB), .ls (FANUC), .script (UR). "
            "Or a CSV: pose, and joint values or x_mm,y_mm,z_mm with qw,qx,qy,qz, "
            "A_deg,B_deg,C_deg or W_deg,P_deg,R_deg per row, and fx_n,fy_n,fz_n.",
        ),
    ],
    force: Annotated[
        str | None,
        Option(metavar="FX,FY,FZ", help="Force on the robot at the tip [N], for every point."),
    ] = None,
    force_frame: Annotated[
        Frame, Option(help="The frame of all forces: F_b (base) or that of the tool.")
    ] = Frame.BASE,
    tool: Annotated[
        list[str] | None, Option(metavar="FRAME", help=f"Tool in the flange frame: {_NAMED}.")
    ] = None,
    base: Annotated[
        list[str] | None,
        Option(metavar="FRAME", help=f"Frame that the coordinates stand in: {_NAMED}."),
    ] = None,
    world: Annotated[
        str | None, Option(metavar="FRAME", help="World of the controller in F_b; F_b itself.")
    ] = None,
    flange: Annotated[
        str | None,
        Option(metavar="FRAME", help="Flange of the controller in that of the robot file."),
    ] = None,
    start: Annotated[
        str | None,
        Option(metavar="AXES", help="Axes before the first motion [deg], [mm], with commas."),
    ] = None,
    tip: Annotated[
        tuple[float, float, float] | None,
        Option(
            help="Where the force acts in the flange frame [m]; else the tool's origin, and "
            "without a tool the campaign's load point."
        ),
    ] = None,
    output: Annotated[
        Path | None,
        Option(
            help="Where to; else the folder of the report for a path, stdout for a program. Never "
            "under data/raw."
        ),
    ] = None,
    root: Root = Path(),
) -> None:
    """Correct a path or a robot program for the deflection under load.

    Of a program only the coordinates change. Frames are written as the program writes poses:
    X,Y,Z,A,B,C (KUKA), X,Y,Z,W,P,R (FANUC), x,y,z,q1,q2,q3,q4 (ABB), all in mm and degrees, or
    x,y,z,rx,ry,rz in m and rad (UR).
    """
    from pipeline.prediction.aim import Refused
    from pipeline.programs import dialect
    from pipeline.store.campaign import outside_raw

    given = Given(tip, force, force_frame, tool or (), base or (), world, flange, start)
    try:
        if not dialect(path.name):
            written, remarks = write(root, campaign, path, output=output, given=given)
            typer.echo(written)
        else:
            data, remarks = program(root, campaign, path, given)
            _put(data, None if output is None else outside_raw(root, output))
    except Refused as wrong:
        for one in listed_lines([str(one) for one in wrong.others]):
            typer.secho(fitted(one, sys.stderr), err=True, fg="red")
        raise
    for line in remarks:
        typer.secho(fitted(line, sys.stderr), err=True)


def _put(data: bytes, output: Path | None) -> None:
    """A program to its file, whole or not at all, or to stdout as it is."""
    if output is None:
        typer.echo(data, nl=False)
    else:
        files.write(output, data)
        typer.echo(output)
