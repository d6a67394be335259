"""`python -m bench.open_league.solvers NAME FOLDER ...`: one entry's answers, a line each."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from pipeline.app import cli

command = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)


class Solver(StrEnum):
    """The solver; `ours` is `pipeline run` without report and tables on disk."""

    OURS = "ours"
    LEAST_SQUARES = "least-squares"
    LASSO = "lasso"
    STEPWISE = "stepwise"
    BONFERRONI = "stepwise-bonferroni"


@command.command()
def solve(
    solver: Solver,
    folders: Annotated[list[Path], typer.Argument(help="Folders of campaigns.")],
) -> None:
    """Solve campaigns, and print what result.json would say of each."""
    answers = _solver(solver)
    for folder in folders:
        begun = time.process_time()
        said = answers(folder)
        spent = round(time.process_time() - begun, 2)
        said |= {"campaign": folder.name, "cpu_s": spent}
        typer.echo(json.dumps(said, allow_nan=False))


def _solver(solver: Solver) -> Callable[[Path], dict[str, object]]:
    if solver == Solver.OURS:
        return _ours
    from bench.open_league.solvers.problem import problem

    by = _others(solver)
    return lambda folder: by(problem(folder))


def _ours(folder: Path) -> dict[str, object]:
    from bench.open_league.solvers.problem import content
    from pipeline.run import campaign_answer
    from pipeline.store.campaign import in_memory

    return campaign_answer(folder.name, in_memory(content(folder))).answer.as_json()


def _others(solver: Solver) -> Callable[..., dict[str, object]]:
    if solver == Solver.LASSO:
        from bench.open_league.solvers import lasso  # scikit-learn is an extra

        return lasso.solve
    if solver == Solver.LEAST_SQUARES:
        from bench.open_league.solvers import least_squares

        return least_squares.solve
    from bench.open_league.solvers import stepwise

    return partial(stepwise.solve, bonferroni=solver == Solver.BONFERRONI)


if __name__ == "__main__":
    cli.main(app=command, name="python -m bench.open_league.solvers")
