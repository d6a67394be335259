"""`pipeline predict`: positions of a campaign's targets at other joint values."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from pipeline.app.commands._shared import Named, Root
from pipeline.base import files
from pipeline.base.errors import InputError, UsageError
from pipeline.base.shown import typed


class PredictionModel(StrEnum):
    """The model used for prediction."""

    RECOMMENDED = "recommended"
    JOINT_SPRINGS = "joint_springs"
    NOMINAL = "nominal"


def predict(
    campaign: Named,
    file: Annotated[
        Path,
        Argument(
            metavar="FILE.csv",
            help="Joint values, with columns as in joints.csv; also fx_n, fy_n, fz_n, payload.",
        ),
    ],
    model: Annotated[
        PredictionModel, Option(help="Identified model, or the nominal robot.")
    ] = PredictionModel.RECOMMENDED,
    output: Annotated[Path | None, Option(help="CSV file to write; stdout if omitted.")] = None,
    root: Root = Path(),
) -> None:
    """Predict the absolute positions of a campaign's targets, in F_b, with their uncertainty."""
    table = predicted(root, campaign, file, model)
    if output is None:
        typer.echo(table, nl=False)
    else:
        from pipeline.store.campaign import outside_raw

        files.write(outside_raw(root, output), table.encode())
        typer.echo(output)


def predicted(
    root: Path, name: str, file: Path, model: PredictionModel = PredictionModel.RECOMMENDED
) -> str:
    """Predictions as CSV, rows of `row,target,x_m,...` as in docs/campaign.md.

    Raises:
        UsageError: The campaign has no such model yet, or the file cannot be read.
        InputError: The content of the file or one of its rows is invalid.
    """
    import numpy as np

    from pipeline.library import model_file, target_model
    from pipeline.programs.points_file import as_csv, read_points, under_pulls
    from pipeline.store import campaign as campaigns

    reports = campaigns.find(root, name).reports
    kept, pulled = reports / "positions.npz", reports / "model.toml"
    if not (kept.is_file() or pulled.is_file()):
        raise UsageError(
            f"{name} has no model yet: it has one once `pipeline run {typed(name)}` is done"
        )
    try:
        data = file.read_bytes()
    except OSError as problem:
        raise UsageError(f"{file} cannot be read ({problem.strerror}): check the path") from problem
    if kept.is_file():
        missing = InputError("there is no such file", "run the campaign again", file=str(kept))
        one = target_model.loads(
            files.read(kept, str(kept), target_model.LARGEST_MODEL, missing), str(kept)
        )
        as_asked = {
            PredictionModel.NOMINAL: target_model.nominal,
            PredictionModel.JOINT_SPRINGS: target_model.springs,
        }
        chosen = as_asked.get(model, lambda same: same)(one)
        rows = read_points(file.name, data, chosen.mechanism.table, chosen.payloads)
        return as_csv(chosen.targets, chosen.six, target_model.predict(chosen, *rows))
    if model is not PredictionModel.RECOMMENDED:
        raise UsageError(f"{name} is a campaign of pulls: only its recommended model is kept")
    held = model_file.load(pulled)
    q, force, *_ = read_points(file.name, data, held.robot, ())
    targets = held.tool.targets
    return as_csv(targets, np.zeros(len(targets), dtype=bool), under_pulls(held, q, force))
