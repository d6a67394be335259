"""`pipeline robot`: the robots that ship, or a robot file from a URDF."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from pipeline.base import files
from pipeline.base.errors import InputError, UsageError

if TYPE_CHECKING:
    from pipeline.exchange.agreement import UrdfAgreement

_LARGEST = 2**24
"""Maximum size of a URDF [byte]; that of a humanoid has a hundredth of it."""

_TABLES = (".csv", ".txt", ".xlsx", ".xlsm")
"""Extensions of files that may hold the table of a robot."""

_FAR_M = 1e-6
"""Largest difference between a robot file and its URDF [m]; beyond it the conversion is wrong, as
the ten digits of a URDF are a nanometre on any robot."""


def robot(
    file: Annotated[
        Path | None,
        Argument(
            metavar="FILE",
            help="URDF of the robot, or a table: theta, d, a, alpha, or axes by point and "
            "direction; with --list part of a name, kuka; with --rail also a name or robot file.",
        ),
    ] = None,
    base: Annotated[str | None, Option(help="Link whose frame is the base frame F_b.")] = None,
    flange: Annotated[str | None, Option(help="Link whose frame is the flange frame.")] = None,
    output: Annotated[
        Path | None, Option(help="Robot file to write (.toml); stdout if omitted.")
    ] = None,
    payload: Annotated[
        float | None, Option(help="Rated payload [kg], which a URDF or a table does not state.")
    ] = None,
    every: Annotated[
        bool, Option("--list", help="List the robots that ship, with maker and variant.")
    ] = False,
    shown: Annotated[
        str | None,
        Option("--show", metavar="NAME", help="Print the robot file of one, to start from."),
    ] = None,
    rail: Annotated[
        str | None,
        Option(
            metavar="AXIS",
            help="Put an arm on a rail along this axis of F_b: x, y, -x or -y, for growing E1.",
        ),
    ] = None,
    turn: Annotated[
        float, Option(help="With --rail: angle from F_b to the arm's base about z [deg].")
    ] = 0.0,
    foot: Annotated[
        str, Option(metavar="X,Y,Z", help="With --rail: the arm's foot in F_b at E1 = 0 [m].")
    ] = "0,0,0",
    draw: Annotated[
        Path | None,
        Option(metavar="FILE.svg", help="With --list or --show: draw them, from the side."),
    ] = None,
) -> None:
    """List the robots that ship, show one or put it on a rail, or make a robot file from a URDF."""
    if every or shown is not None:
        _of_ours(str(file or "") if every else shown or "", every, draw)
        return
    if draw is not None:
        raise UsageError("--draw draws robots that ship: add --list, or --show NAME")
    _refuse(output, ".toml", "a robot file")
    text, said = _arm(file, base, flange, payload, rail is not None)
    text = text if rail is None else _with_rail(text, str(file), rail, turn, foot)
    _given(text, output)
    typer.secho(said or _flange(text, str(file)), err=True)


def _arm(
    file: Path | None, base: str | None, flange: str | None, payload: float | None, railed: bool
) -> tuple[str, str]:
    """The text of a robot file, and how it agrees with its URDF, in a sentence; empty without one.

    Raises:
        UsageError: Neither a robot that ships, nor a file of one, nor a URDF with its links.
    """
    name = str(file or "")
    if railed and not name.lower().endswith((".urdf", *_TABLES)):
        return _with_payload(_shipped(name), payload), ""
    if file is not None and file.suffix.lower() in _TABLES:
        return _of_table(file, payload), ""
    if file is None or base is None or flange is None:
        raise UsageError(
            "give a URDF with --base and --flange, or a table as .csv, .txt or .xlsx, or --list, "
            "or --show NAME for a robot that ships, or NAME --rail AXIS"
        )
    text, found = made(file, base, flange, payload)
    return text, (
        f"Largest difference from the URDF by Pinocchio at {found.configurations} configurations: "
        f"{found.position_m:.1e} m, {found.angle_rad:.1e} rad."
    )


def _with_payload(text: str, payload_kg: float | None) -> str:
    from pipeline.base import toml

    if payload_kg is None:
        return text
    return toml.dumps({**toml.loads(text, "robot"), "payload_kg": payload_kg})


def _of_table(file: Path, payload: float | None) -> str:
    """A robot file of a table."""
    from pipeline.exchange.from_table import robot_file

    missing = InputError("there is no such file", "check the path", file=str(file))
    return robot_file(files.read(file, file.name, _LARGEST, missing), file.name, payload)


def _flange(text: str, name: str) -> str:
    """Where the flange of a robot file is with all axes at 0, in a sentence."""
    import numpy as np

    from pipeline.machine.robot.configuration import configure
    from pipeline.machine.robot.mdh import parse

    arm = parse(text, name)
    at_zero = arm.controller_offset if arm.controller else np.zeros(arm.n)
    x, y, z = (1e3 * configure(arm, at_zero[None]).flange_origin[0]).round(1) + 0.0
    return (
        f"With all axes at 0 the flange is at {x:g}, {y:g}, {z:g} mm in F_b: compare this and one "
        "more pose with the panel of the controller."
    )


def _of_ours(name: str, every: bool, draw: Path | None) -> None:
    """List, show or draw the robots whose name contains a part, or the one with this name."""
    if draw is not None:
        typer.echo(_drawn(draw, name, every))
    else:
        typer.echo("\n".join(_listing(name)) if every else _shipped(name))


def _with_rail(text: str, name: str, way: str, turn_deg: float, foot: str) -> str:
    """The robot file of an arm, on a rail.

    Raises:
        UsageError: There is no such axis, or the foot is no three numbers.
    """
    from pipeline.exchange.on_rail import WAYS, on_rail
    from pipeline.machine.robot.mdh import parse

    try:
        x, y, z = map(float, foot.split(","))
    except ValueError:
        raise UsageError(f'--foot "{foot}" is no x,y,z in metres: write 0,0,0.57') from None
    if way not in WAYS:
        raise UsageError(f'--rail "{way}" is no axis of F_b: use {", ".join(WAYS)}')
    return on_rail(parse(text, name), way, turn_deg, (x, y, z))


def _given(text: str, output: Path | None) -> None:
    """Print the text, or write it to a file and print the file's name."""
    if output is None:
        typer.echo(text, nl=False)
    else:
        files.write(output, text.encode())
        typer.echo(output)


def _refuse(output: Path | None, suffix: str, kind: str) -> None:
    """Refuse an output file that exists or has another extension than its kind.

    Raises:
        UsageError: It does.
    """
    if output is None:
        return
    if output.suffix != suffix:
        raise UsageError(f"{output} does not end in {suffix}, as {kind} does")
    if output.exists():
        raise UsageError(f"{output} is there already: choose another name")


def _drawn(path: Path, part: str, every: bool) -> Path:
    """Draw the robots whose name contains a part, or the one with this name, into a new file."""
    from pipeline.exchange.drawn import drawing
    from pipeline.machine.robot import load

    _refuse(path, ".svg", "a drawing")
    if not every:
        _shipped(part)
    names = _like(part) if every else [part]
    files.write(path, drawing([load(name) for name in names]).encode())
    return path


def _like(part: str) -> list[str]:
    """Names of the robots that ship and contain this part.

    Raises:
        UsageError: None does.
    """
    from pipeline.machine.robot.mdh import meant

    names = meant(part)
    if not names:
        raise UsageError(f'no robot that ships is like "{part}": `pipeline robot --list` has all')
    return names


def _listing(part: str = "") -> list[str]:
    """Table of the robots that ship: name, maker and variant, controller axes, rated payload.

    Raises:
        UsageError: No name contains this part.
    """
    from pipeline.machine.robot import axes, load

    rows = []
    for name in _like(part):
        one = load(name)
        payload = "" if one.payload_kg is None else f"{one.payload_kg:g} kg"
        rows.append((name, one.description, " ".join(axes.of(one).names), payload))
    wide = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(f"{c:{w}}" for c, w in zip(row, wide, strict=True)).rstrip() for row in rows]


def _shipped(name: str) -> str:
    """The robot file of a robot that ships, or the one at this path.

    Raises:
        UsageError: There is none with this name.
    """
    from pipeline.base import toml
    from pipeline.machine.robot import SHIPPED, load
    from pipeline.machine.robot.mdh import no_robot

    if name.endswith(".toml") and Path(name).is_file():
        return files.words(Path(name), name, toml.LARGEST_TEXT)
    if name not in SHIPPED:
        unknown = no_robot(name, None)
        raise UsageError(f"{unknown.thing}; {unknown.way_out}")
    return load(name).text.rstrip("\n")


def made(
    path: Path, base: str, flange: str, payload_kg: float | None = None
) -> tuple[str, UrdfAgreement]:
    """Make the text of a robot file from a URDF, and determine its difference from the URDF.

    Raises:
        InputError: The file is not a URDF, has no such chain, or a robot file cannot represent it.
    """
    import numpy as np

    from pipeline.base import toml
    from pipeline.exchange import urdf
    from pipeline.exchange.agreement import agreement
    from pipeline.exchange.from_urdf import robot_file
    from pipeline.machine.robot.mdh import parse

    missing = InputError("there is no such file", "check the path", file=str(path))
    source = files.words(path, path.name, _LARGEST, missing)
    content = robot_file(urdf.read(source, path.name), base, flange, path.name, payload_kg)
    text = toml.dumps(content)
    built = parse(text, path.name)
    found = agreement(built, source, base, flange, path.name, np.random.default_rng(0))
    if not found.position_m < _FAR_M:
        raise InputError(
            f"the table made of it is {found.position_m:.1e} m off",
            "report it with the file",
            file=path.name,
        )
    return text, found
