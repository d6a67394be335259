"""`pipeline compensate`: correct a path or a robot program by the model of a campaign."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from pipeline.app.commands._shared import Named, Root, fitted
from pipeline.base import files
from pipeline.base.errors import InputError, UsageError, listed
from pipeline.programs._text import LARGEST_PROGRAM
from pipeline.programs.on_disk import (
    CorrectionOptions,
    ForceFrame,
    companion,
    drawn,
    listed_lines,
    spare_input,
    write,
)
from pipeline.programs.predict import predict as predict

_NAMED = "[NAME=]X,Y,Z,A,B,C, as the program writes poses"


_Program = Annotated[
    Path,
    Argument(
        metavar="PATH",
        help="A robot program, or a folder of them: .src or .dat (KUKA), .mod (ABB), .ls "
        "(FANUC), .script (UR). "
        "Or a CSV: pose, and joint values or x_mm,y_mm,z_mm with qw,qx,qy,qz, "
        "A_deg,B_deg,C_deg or W_deg,P_deg,R_deg per row, and fx_n,fy_n,fz_n.",
    ),
]
_Force = Annotated[
    str | None,
    Option(metavar="FX,FY,FZ", help="Force on the robot at the tip [N], the same at every point."),
]
_Forces = Annotated[
    Path | None,
    Option(
        metavar="CSV",
        help="Force at each target of a program: target (or line), fx_n, fy_n, fz_n; none at "
        "what is not in it. Remarks FORCE and CUT in the program say the same.",
    ),
]
_Picture = Annotated[
    Path | None,
    Option(metavar="SVG", help="Draw the deflection before and after, along the program."),
]
_ToolFrame = Annotated[
    list[str] | None, Option(metavar="FRAME", help=f"Tool in the flange frame: {_NAMED}.")
]
_BaseFrame = Annotated[
    list[str] | None,
    Option(metavar="FRAME", help=f"Frame in which the program gives its coordinates: {_NAMED}."),
]
_World = Annotated[
    str | None,
    Option(metavar="FRAME", help="World frame of the controller in F_b; F_b itself if omitted."),
]
_Flange = Annotated[
    str | None,
    Option(
        metavar="FRAME",
        help="Flange frame of the controller in the flange frame of the robot file.",
    ),
]
_Start = Annotated[
    str | None,
    Option(
        metavar="AXES",
        help="Axis values before the first motion [deg], [mm], separated by commas.",
    ),
]
_Tip = Annotated[
    tuple[float, float, float] | None,
    Option(
        help="Point where the force acts, flange frame [m]; by default the tool's origin, or "
        "the campaign's load point if there is no tool."
    ),
]
_Output = Annotated[
    Path | None,
    Option(
        help="Output file; by default a path goes to the report's folder, a program to stdout. "
        "Never in data/raw."
    ),
]
_MaxOffset = Annotated[
    float | None,
    Option(
        metavar="MM",
        help="Largest plausible shift of a target [mm]; if any would move farther, nothing is "
        "written and each is listed with its line.",
    ),
]
_Partial = Annotated[
    bool,
    Option(
        "--partial",
        help="Write a program although motions or points of it cannot be corrected; each is "
        "listed with its line.",
    ),
]


def compensate(
    campaign: Named,
    path: _Program,
    force: _Force = None,
    forces: _Forces = None,
    picture: _Picture = None,
    force_frame: Annotated[
        ForceFrame, Option(help="Frame in which forces are given: base (F_b) or tool.")
    ] = ForceFrame.BASE,
    tool: _ToolFrame = None,
    base: _BaseFrame = None,
    world: _World = None,
    flange: _Flange = None,
    start: _Start = None,
    tip: _Tip = None,
    output: _Output = None,
    partial: _Partial = False,
    max_offset: _MaxOffset = None,
    root: Root = Path(),
) -> None:
    """Correct a path or a robot program for the deflection under load.

    In a program only the coordinates change. Write frames as the program writes poses:
    X,Y,Z,A,B,C (KUKA), X,Y,Z,W,P,R (FANUC), x,y,z,q1,q2,q3,q4 (ABB), all in mm and degrees, or
    x,y,z,rx,ry,rz in m and rad (UR).
    """
    from pipeline.programs.aim import Refusal

    if max_offset is not None and not max_offset > 0:
        raise UsageError(f"--max-offset {max_offset:g}: give a length above 0 in mm")
    given = CorrectionOptions(
        tip=tip,
        force=force,
        frame=force_frame,
        tool=tool or (),
        base=base or (),
        world=world,
        flange=flange,
        start=start,
        partial=partial,
        forces=forces,
        max_offset_mm=max_offset,
    )
    if path.is_dir():
        _folder(root, campaign, path, output, given)
        return
    try:
        remarks = _one(root, campaign, path, output, given, picture)
    except Refusal as wrong:
        for one in listed_lines([str(one) for one in wrong.others]):
            typer.secho(fitted(one, sys.stderr), err=True, fg="red")
        raise
    for line in remarks:
        typer.secho(fitted(line, sys.stderr), err=True)


def _one(
    root: Path,
    campaign: str,
    path: Path,
    output: Path | None,
    given: CorrectionOptions,
    picture: Path | None,
) -> list[str]:
    """Correct one file; return remarks on the result."""
    from pipeline.programs import is_program
    from pipeline.store.campaign import outside_raw

    if not is_program(path.name):
        if picture is not None or given.forces is not None:
            raise UsageError("--picture and --forces are for programs: a path has its own columns")
        written, remarks = write(root, campaign, path, output=output, given=given)
        typer.echo(written)
        return remarks
    if output is not None:
        spare_input(path, output)
    data, remarks, shown = drawn(root, campaign, path, given)
    _put(data, None if output is None else outside_raw(root, output))
    if picture is not None:
        files.write(outside_raw(root, picture), shown.encode())
        typer.echo(picture, err=output is None)
    return remarks


def _may_take(output: Path, programs: Path) -> bool:
    """Whether a folder is new, or a different one from that of the programs."""
    return not output.exists() or (output.is_dir() and not output.samefile(programs))


def _folder(
    root: Path, campaign: str, path: Path, output: Path | None, given: CorrectionOptions
) -> None:
    """Correct every program of a folder into another one, each with its picture.

    Raises:
        InputError: Some programs were rejected; the others are written.
    """
    from pipeline.programs import is_program

    if output is None or not _may_take(output, path):
        raise UsageError("a folder of programs is corrected into another one: give --output FOLDER")
    programs = [one for one in sorted(path.iterdir()) if one.is_file() and is_program(one.name)]
    if not programs:
        raise UsageError(f"{path} has no robot program: .src, .dat, .mod, .ls or .script")
    done = [_within(root, campaign, one, output, given) for one in programs]
    refused = [one.name for one, written in zip(programs, done, strict=True) if not written]
    if refused:
        thing = f"{len(refused)} of {len(programs)} programs are not corrected: {listed(refused)}"
        raise InputError(thing, "correct them as the lines above say, or use --partial")


def _tell(line: str) -> None:
    typer.secho(fitted(line, sys.stderr), err=True)


def _put(data: bytes, output: Path | None) -> None:
    """Write a program to its file, completely or not at all, or to stdout unchanged."""
    if output is None:
        typer.echo(data, nl=False)
    else:
        files.write(output, data)
        typer.echo(output)


_NOTHING = "contains no motion to a target with coordinates"


def _within(root: Path, campaign: str, one: Path, output: Path, given: CorrectionOptions) -> bool:
    """Correct one program into a folder; return whether it is written."""
    try:
        shown = output / f"{one.name}.svg"
        for line in _one(root, campaign, one, output / one.name, given, shown):
            _tell(f"{one.name}: {line}")
    except InputError as problem:
        if problem.thing != _NOTHING or not companion(one):
            _tell(str(problem))
            return False
        _tell(f"{one.name} {_NOTHING}: copied as it is.")  # its companion file has the targets
        files.write(output / one.name, files.read(one, one.name, LARGEST_PROGRAM))
    return True
