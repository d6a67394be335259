"""Commands ahead of a measurement: what to measure, and what can be seen in it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.app.commands._shared import AsJson, Root, app, at_work
from pipeline.base.errors import Interrupted


@app.command(short_help="Choose the poses to measure.")
def design(
    problem: Annotated[
        str,
        typer.Argument(
            metavar="PROBLEM", help="paper_reference, or a problem file ending in .toml."
        ),
    ] = "paper_reference",
    poses: Annotated[int | None, typer.Option(help="Number of poses, m_0.")] = None,
    readings: Annotated[int | None, typer.Option(help="Pulls in all, n.")] = None,
    step: Annotated[
        list[float] | None, typer.Option(help="Load step [N]; repeat it for more, up and down.")
    ] = None,
    anchor: Annotated[
        tuple[float, float, float] | None, typer.Option(help="Anchor in F_b [m], fixed there.")
    ] = None,
    robot: Annotated[str | None, typer.Option(help="A robot that ships, or a robot file.")] = None,
    criterion: Annotated[str | None, typer.Option(help="test_pose, workspace, D, A or E.")] = None,
    add_to: Annotated[
        str | None, typer.Option(help="Propose further poses for this campaign.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the plan.")] = None,
    seed: Annotated[int, typer.Option(help="Determines the plan.")] = 1,
    rounds: Annotated[int, typer.Option(min=1, help="Rounds of new starts.")] = 2,
    write: Annotated[
        bool | None,
        typer.Option("--write/--no-write", help="Plan file and sheet; not with --json."),
    ] = None,
    as_json: AsJson = False,
    root: Root = Path(),
) -> None:
    """Choose the poses to measure, and say how near they are to the best that could be."""
    from pipeline.app import planning
    from pipeline.store import campaign as campaigns

    changes = {
        "name": name,
        "robot": robot,
        "plan": {"poses": poses, "readings": readings},
        "pull": {"steps_n": step},
        "anchor": dict(zip(("x_m", "y_m", "z_m"), anchor, strict=True)) if anchor else None,
        "criterion": {"kind": criterion},
    }
    campaign = campaigns.find(root, add_to) if add_to else None
    made = planning.run(problem, changes, seed, rounds, at_work, campaign)
    if write or (write is None and not as_json):
        made = planning.write(root, made, seed)
    typer.echo(made.as_json() if as_json else made.as_text())
    if made.interrupted:
        raise Interrupted("Interrupted; this is the best plan so far.")


@app.command(short_help="Write a raw campaign of a virtual cell.")
def simulate(
    plan: Annotated[
        Path | None,
        typer.Argument(metavar="PLAN", help="Plan file; without it the plan of the demo."),
    ] = None,
    plan_file: Annotated[
        Path | None, typer.Option("--plan", help="The same, as an option.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the campaign.")] = None,
    robot: Annotated[str | None, typer.Option(help="A robot that ships, or a robot file.")] = None,
    seed: Annotated[int | None, typer.Option(help="Determines every byte.")] = None,
    poses: Annotated[int | None, typer.Option(help="Draw so many feasible poses.")] = None,
    step: Annotated[
        list[float] | None, typer.Option(help="Load step [N]; repeat it for more, up and down.")
    ] = None,
    repeats: Annotated[int | None, typer.Option(help="Runs through the steps.")] = None,
    noise: Annotated[
        str | None, typer.Option(help="paper, instrument, or metres per axis.")
    ] = None,
    noise_scale: Annotated[
        float | None, typer.Option(help="True over stated scatter of the tracker.")
    ] = None,
    exact: Annotated[bool, typer.Option("--exact", help="No noise, all digits.")] = False,
    spread: Annotated[
        float | None, typer.Option(help="True stiffnesses are off by up to this fraction.")
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(help="NAME[:where][=size], size in SI or like 2x; repeat it for more."),
    ] = None,
    dialect: Annotated[str | None, typer.Option(help="Form of the tracker export.")] = None,
    unit: Annotated[str | None, typer.Option(help="Unit of the export: mm, m or in.")] = None,
    digits: Annotated[str | None, typer.Option(help="Decimals in the export, or full.")] = None,
    truth: Annotated[
        Path | None, typer.Option(help="Truth file; data/processed/NAME.truth.json.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a campaign.")] = False,
    root: Root = Path(),
) -> None:
    """Write a raw campaign of a virtual cell; what is true in it goes to a file elsewhere."""
    from pipeline.app import virtual

    changes = {
        "name": name,
        "robot": robot,
        "seed": seed,
        "poses": {"count": poses},
        "pulls": {"steps_n": step, "repeats": repeats},
        "tracker": {
            "noise_scale": noise_scale,
            "dialect": dialect,
            "unit": unit,
            "digits": digits,
        },
        "hidden": {"stiffness_spread": spread, "effects": effect},
    }
    written = virtual.write(root, plan or plan_file, changes, noise, exact, truth, force)
    typer.echo(written.folder)
    typer.secho(f"truth: {written.truth}", err=True)
    at_work(f"Next: pipeline run {written.folder.name}")


@app.command(short_help="List the causes that a diagnosis knows.")
def effects(
    robot: Annotated[str, typer.Option(help="A robot that ships, or a robot file.")] = "kr500_rail",
    as_json: AsJson = False,
) -> None:
    """List the causes that a diagnosis knows, with their sizes and signatures."""
    from pipeline.machine.effects import listing
    from pipeline.machine.robot import load

    machine = load(robot)
    typer.echo(listing.as_json(machine) if as_json else listing.as_text(machine))
