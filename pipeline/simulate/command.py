"""`pipeline simulate`: from a plan to a raw folder, with the truth elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from pipeline.app.commands._shared import AsJson, Root, Steps, at_work
from pipeline.base import files
from pipeline.base.errors import UsageError
from pipeline.base.shown import typed

_PlanFile = Annotated[
    Path | None,
    Argument(metavar="PLAN", help="Plan file; without it the plan of the demo."),
]
_Load = Annotated[str | None, Option(help="How loads are applied: chain, weights or payloads.")]
_Noise = Annotated[
    str | None,
    Option(help="Tracker noise: paper, instrument, or a standard deviation per axis [m]."),
]
_NoiseScale = Annotated[float | None, Option(help="Ratio of true to stated tracker noise.")]
_Exact = Annotated[bool, Option("--exact", help="No noise, and all digits in the export.")]
_Spread = Annotated[
    float | None,
    Option(help="Largest relative deviation of the true stiffnesses from nominal."),
]
_Effects = Annotated[
    list[str] | None,
    Option(
        help="Hidden cause, NAME[:where][=size], with the size in SI units or as a multiple of "
        "its typical magnitude, such as 2x; repeat the option for more."
    ),
]
_Dialect = Annotated[str | None, Option(help="Format of the tracker export.")]
_Truth = Annotated[
    Path | None,
    Option(help="Where to write the true values; data/processed/NAME.truth.json if omitted."),
]


def simulate(
    plan: _PlanFile = None,
    plan_file: Annotated[Path | None, Option("--plan", help="The same, as an option.")] = None,
    name: Annotated[str | None, Option(help="Name of the campaign.")] = None,
    robot: Annotated[str | None, Option(help="Name of a built-in robot, or a robot file.")] = None,
    seed: Annotated[int | None, Option(help="Seed of all random draws.")] = None,
    poses: Annotated[int | None, Option(help="Number of feasible poses to draw.")] = None,
    load: _Load = None,
    step: Steps = None,
    repeats: Annotated[int | None, Option(help="Number of runs through the load steps.")] = None,
    noise: _Noise = None,
    noise_scale: _NoiseScale = None,
    exact: _Exact = False,
    spread: _Spread = None,
    effect: _Effects = None,
    dialect: _Dialect = None,
    unit: Annotated[str | None, Option(help="Unit of length in the export: mm, m or in.")] = None,
    digits: Annotated[str | None, Option(help="Number of decimals in the export, or full.")] = None,
    truth: _Truth = None,
    force: Annotated[bool, Option("--force", help="Replace an existing campaign.")] = False,
    root: Root = Path(),
) -> None:
    """Simulate the raw files of a campaign; the true values go to a separate file."""
    changes = {
        "name": name,
        "robot": robot,
        "seed": seed,
        "poses": {"count": poses},
        "pulls": {"load": load, "steps_n": step, "repeats": repeats},
        "tracker": {
            "noise_scale": noise_scale,
            "dialect": dialect,
            "unit": unit,
            "digits": digits,
        },
        "hidden": {"stiffness_spread": spread, "effects": effect},
    }
    folder, sealed = write(root, plan or plan_file, changes, noise, exact, truth, force)
    typer.echo(folder)
    typer.secho(f"truth: {sealed}", err=True)
    at_work(f"Next: pipeline run {typed(folder.name)}")


def write(
    root: Path,
    plan: Path | None,
    changes: dict[str, Any],
    noise: str | None = None,
    exact: bool = False,
    truth: Path | None = None,
    force: bool = False,
) -> tuple[Path, Path]:
    """Simulate a campaign and put it under data/raw; return its folder, and the file of the truth.

    Args:
        root: The project's root.
        plan: A plan file, or None for the default plan.
        changes: Changes of the plan from the command line, in its structure; None is no change.
        noise: `paper`, `instrument`, or a standard uncertainty per axis in m.
        exact: Readings without noise, all digits written.
        truth: File of the truth, data/processed/<name>.truth.json when not given.
        force: Replace a campaign of the same name.

    Raises:
        UsageError: The campaign exists already, or the truth would lie in a raw folder.
        InputError: The plan cannot be carried out.
    """
    from pipeline.library.folders import replace_folder
    from pipeline.simulate.library import carried_out, plan_for
    from pipeline.store.campaign import dump

    wanted = plan_for(plan, changes, noise, exact)
    raw = (root / "data" / "raw").resolve()
    sealed = (truth or root / "data" / "processed" / f"{wanted.name}.truth.json").resolve()
    if sealed.is_relative_to(raw):
        raise UsageError(f"{sealed} lies under {raw}: keep the truth away from the raw files")
    folder = raw / wanted.name
    if folder.exists() and not force:
        raise UsageError(f"{folder} is there already: choose another --name, or use --force")
    made = carried_out(wanted, plan)
    digests = {inner: files.sha256(data) for inner, data in made.files.items()}
    files.write(sealed, dump({**made.truth, "files": digests}))
    replace_folder(folder, made.files)
    return root / "data" / "raw" / wanted.name, sealed


def prepare(folder: Path, plan: Path) -> None:
    """Make the folder of a campaign that will measure a plan: all but forces and tracker export.

    Raises:
        InputError: The plan cannot be carried out, or the name cannot name a campaign.
    """
    from pipeline.machine.robot import load
    from pipeline.simulate import prepared
    from pipeline.simulate.library import plan_for

    wanted = plan_for(plan, {"name": folder.name})
    for inner, data in prepared(wanted, load(wanted.robot, plan.parent)).items():
        files.write(folder / inner, data)


def effects(
    robot: Annotated[str, Option(help="Name of a built-in robot, or a robot file.")] = "kr500_rail",
    as_json: AsJson = False,
) -> None:
    """List the causes of misfit that the diagnosis knows, with magnitudes and signatures."""
    from pipeline.machine.robot import load
    from pipeline.simulate import hidden

    machine = load(robot)
    typer.echo(hidden.as_json(machine) if as_json else hidden.as_text(machine))
