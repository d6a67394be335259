"""What `pipeline compensate` does on disk: model and path in, offsets out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.answer.recommended import row_of
from pipeline.base import files
from pipeline.base.errors import UsageError
from pipeline.prediction import compensate as stage
from pipeline.prediction.model import Model
from pipeline.store import campaign as campaigns


@dataclass(frozen=True)
class Compensated:
    """Where the offsets of a path went.

    Attributes:
        path: The CSV file.
        remarks: What to know about it, for stderr.
    """

    path: Path
    remarks: list[str]


def compensate(
    root: Path,
    name: str,
    path: Path,
    tip: tuple[float, float, float] | None = None,
    output: Path | None = None,
) -> Compensated:
    """Offsets for a path of poses and forces, from a campaign's model.

    Raises:
        UsageError: The campaign has no model yet, or the path is not there.
        InputError: The path cannot be read.
    """
    campaign = campaigns.find(root, name)
    kept = campaign.reports / "model.toml"
    if not kept.is_file():
        raise UsageError(f"{name} has no model yet: run `pipeline run {name}` first")
    model = Model.load(kept)
    robot = model.robot
    try:
        data = path.read_bytes()
    except OSError as problem:
        raise UsageError(f"{path} cannot be read ({problem.strerror}): check the path") from problem
    wanted = stage.read(path.name, data, robot)
    found = stage.compensate(model, wanted, None if tip is None else np.array(tip))
    written = output or path.with_name(f"{path.stem}-compensation.csv")
    files.write(written, stage.table(robot, wanted, found))
    remarks = [
        f"{len(wanted.pose)} points: the load moves the tip by up to "
        f"{1e3 * found.deflection.max():.3f} mm; with the offsets the model leaves "
        f"{1e3 * found.left.max():.4f} mm, known to ±{2e3 * found.std.max():.3f} mm (95 %)."
    ]
    if not row_of(model.recommended["reason"]).holds_for_its_readings:
        remarks.append(
            f"The model of {name} does not fit its own measurements: expect more than is stated."
        )
    return Compensated(written, remarks)
