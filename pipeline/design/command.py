"""`pipeline design`: which poses to measure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from pipeline.app.commands._shared import AsJson, Root, Steps, at_work
from pipeline.base import files
from pipeline.base.errors import InputError, Interrupted, UsageError
from pipeline.base.language import Language
from pipeline.base.shown import lines, typed

if TYPE_CHECKING:
    from pipeline.base.arrays import Array
    from pipeline.design.finished import FinishedDesign
    from pipeline.design.propose import BoundedPlan


def design(
    problem: Annotated[
        str,
        Argument(metavar="PROBLEM", help="paper_reference, or a problem file ending in .toml."),
    ] = "paper_reference",
    poses: Annotated[int | None, Option(help="Number of poses m_0.")] = None,
    readings: Annotated[int | None, Option(help="Total number of pulls n.")] = None,
    unloaded: Annotated[
        int | None,
        Option(help="Number of additional unloaded poses, to identify the DH parameters."),
    ] = None,
    step: Steps = None,
    anchor: Annotated[
        tuple[float, float, float] | None, Option(help="Fixed position of the anchor in F_b [m].")
    ] = None,
    robot: Annotated[str | None, Option(help="Name of a built-in robot, or a robot file.")] = None,
    criterion: Annotated[
        str | None, Option(help="Optimality criterion: test_pose, workspace, D, A or E.")
    ] = None,
    add_to: Annotated[str | None, Option(help="Propose further poses for this campaign.")] = None,
    name: Annotated[str | None, Option(help="Name of the plan.")] = None,
    seed: Annotated[int, Option(help="Seed of the search.")] = 1,
    rounds: Annotated[
        int, Option(min=1, help="Number of search rounds from new random starts.")
    ] = 2,
    language: Annotated[
        Language, Option(help="Language of the measurement sheet: en, de or fr.")
    ] = Language.EN,
    wanted: Annotated[
        bool | None,
        Option("--write/--no-write", help="Write plan file and sheet; off with --json."),
    ] = None,
    as_json: AsJson = False,
    root: Root = Path(),
) -> None:
    """Choose the poses to measure, and print how close the plan is to the optimum."""
    from pipeline.design import spec as specs
    from pipeline.design.finished import make
    from pipeline.design.library import added_to, problem_of
    from pipeline.design.search import Effort
    from pipeline.library.campaign import load_campaign

    changes = {
        "name": name,
        "robot": robot,
        "plan": {"poses": poses, "readings": readings, "unloaded": unloaded},
        "pull": {"steps_n": step},
        "anchor": anchor and dict(zip(("x_m", "y_m", "z_m"), anchor, strict=True)),
        "criterion": {"kind": criterion},
    }
    asked = problem_of(problem, changes)
    if robot is not None and problem in specs.SHIPPED:
        typer.secho(f"Assumed: {asked.spec.assumptions[0]}.", err=True)
    if add_to:
        asked = added_to(asked, load_campaign(add_to, root=root), name)
    made = make(asked, seed, Effort(rounds=rounds), at_work)
    if wanted or (wanted is None and not as_json):
        again = f" --seed {seed} --rounds {rounds}{_more(add_to, language)}"
        made = write(root, made, seed, again, language)
    typer.echo(made.as_json() if as_json else lines(made.as_text()))
    if made.interrupted:
        raise Interrupted("Interrupted; this is the best plan so far.")


def _more(add_to: str | None, language: Language) -> str:
    """Options of a command that reproduces the plan."""
    more = f" --add-to {typed(add_to)}" if add_to else ""
    return more + (f" --language {language}" if language is not Language.EN else "")


def write(
    root: Path, made: FinishedDesign, seed: int, by: str = "", language: Language = Language.EN
) -> FinishedDesign:
    """Write plan file, measurement sheet and pictures of a design.

    Args:
        root: The project's root: data/plans/NAME.toml and reports/plans/NAME.
        made: The design.
        seed: Of its searches; the curves use it too.
        by: Options with which the problem reproduces this plan.
        language: Of the sheet.

    Raises:
        UsageError: A plan of that name was written by hand.
    """
    from pipeline.design.plan_files import plan_files
    from pipeline.design.planfile import MADE_BY, plan_text, problem_file, problem_text
    from pipeline.machine.robot import SHIPPED
    from pipeline.store.campaign import dump

    name = made.proposal.problem.spec.name
    plan, folder = root / "data" / "plans" / f"{name}.toml", root / "reports" / "plans" / name
    if plan.exists() and not plan.read_text("utf-8").startswith(MADE_BY):
        raise UsageError(f"{plan} was written by hand: choose another --name")
    files.write(plan, plan_text(made.proposal, f"data/plans/{name}.toml", by).encode())
    asked = root / problem_file(f"data/plans/{name}.toml")
    files.write(asked, problem_text(made.proposal.problem.spec).encode())
    content = dump(made.content())
    driven = _programs(made.proposal, at_work)
    robot = made.proposal.problem.robot
    if made.proposal.problem.spec.robot not in SHIPPED:  # next to the plan, which names it
        files.write(plan.parent / Path(made.proposal.problem.spec.robot).name, robot.text.encode())
    for inner, data in plan_files(made.proposal, made.seconds, seed, language).items():
        files.write(folder / inner, data)
    files.write(folder / "design.json", content)
    for inner, data in driven.items():
        files.write(folder / "program" / inner, data)
    programs = [folder / "program" / inner for inner in driven]
    sheets = [folder / f"sheet.{kind}" for kind in ("html", "pdf", "xlsx")]
    return replace(made, written=(plan, *sheets, *programs, asked))


def _programs(proposal: BoundedPlan, tell: Callable[[str], object]) -> dict[str, bytes]:
    """Programs that drive the plan, for the maker of the robot or for all.

    Empty, with a message, where the arm would meet itself or the floor and the problem allows that.

    Raises:
        InputError: It would, and the problem forbids it; with pose and reason.
    """
    import numpy as np

    from pipeline.design.driven import legs, pose_violations
    from pipeline.design.finished import printed
    from pipeline.machine.robot.axes import from_log_units
    from pipeline.programs.for_plan import NO_CELL, brand_of, drive, programs

    problem, measurement = proposal.problem, proposal.measurement
    q, steps, way = _every_pose(proposal)
    zero_after = problem.spec.noise.zero == "before_after"
    q = from_log_units(problem.robot, printed(problem, q))
    ways = legs(problem, q, measurement.anchor)
    wrong = [*pose_violations(problem, q), *(one.sentence for one in ways if one.blocked)]
    if wrong:
        _undriven(wrong, problem.spec.limits.clear_of_itself, tell)
        return {}
    lost = {leg.pose: leg.crossed for leg in ways if leg.crossed}
    for pose, line in lost.items():
        tell(f"On the way to pose {pose} no way keeps {line}: the program says so there.")
    via = [np.zeros((0, problem.robot.n)), *(one.via for one in ways)]
    first = (NO_CELL,) if problem.spec.cell is None else ()
    found = drive(problem.spec.name, problem.robot, q, way, steps, zero_after, via, lost, first)
    return {} if found is None else programs(found, brand_of(problem.robot.description))


def _every_pose(proposal: BoundedPlan) -> tuple[Array, list[list[float]], Array]:
    """Joint values, load steps and approaches of all poses, those without a pull last."""
    import numpy as np

    measurement, beside = proposal.measurement, proposal.unpulled
    steps = [own.tolist() for own in measurement.steps]
    if beside is None:
        return measurement.q, steps, measurement.approach
    way = np.append(measurement.approach, np.resize([1, -1], len(beside.q)))
    return np.concatenate([measurement.q, beside.q]), [*steps, *[[] for _ in beside.q]], way


def _undriven(wrong: Sequence[str], refused: bool, tell: Callable[[str], object]) -> None:
    """Report why a plan cannot be driven.

    Raises:
        InputError: The problem requires that it can.
    """
    if refused:
        raise InputError(
            f"this plan cannot be driven: {'; '.join(wrong[:3])}",
            "try another --seed or --poses, or narrow limits.joints where the arm folds; with "
            "limits.clear_of_itself = false the plan is written without a program",
        )
    for one in wrong:
        tell(f"No program is written: {one}.")
