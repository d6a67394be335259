"""What a campaign of positions hands over: its answer, tables to show, and models."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline import tables
from pipeline.answer.contract import Answer
from pipeline.answer.results import CampaignAnswer
from pipeline.base import doors
from pipeline.base.arrays import Array
from pipeline.base.quantities import plain
from pipeline.faults.mistake import Mistake
from pipeline.machine.cell import Tool, paper_cell
from pipeline.positions import answer as of_positions
from pipeline.positions.answer import PositionsResults
from pipeline.positions.calibrate import Calibration
from pipeline.positions.mechanism import layout
from pipeline.positions.position_readings import (
    dated_beside,
    exchanged_beside,
    implausible_outliers,
    outliers,
    wrong_entries,
)
from pipeline.positions.position_rows import PositionSheet, position_rows
from pipeline.positions.positioned import Positioned, as_read, schema, usable
from pipeline.positions.study import Study, study
from pipeline.prediction.model import IdentifiedModel, ModelHypothesis
from pipeline.reduction.bring import Keep, Step
from pipeline.store.campaign import Raw

_SEED = 20261123
"""Of its draws: another one moves numbers within what they say of their scatter."""

_MODEL = "positions.npz"
"""What `pipeline predict` reads."""

_KEPT = "pipeline.library.kinematic_model:written"
"""Door of the library: what it will read again of a model of positions."""

_ANNEX = "pipeline.annex.figure_tables:of_positions"
"""Tables of the figures behind the first page."""


def identify_positions(name: str, raw: Raw, keep: Keep, step: Step) -> PositionsResults:
    """From the tables of positions to what they say."""
    rows, rejects = step(as_read)(raw.settings, raw.robot, raw.files)
    given = PositionSheet(raw.robot, raw.settings, rows)
    wrong, sheet = step(position_rows)(given)
    read = usable(raw.settings, raw.robot, sheet.rows, rejects)
    found = _studied(raw, read, step)
    if dated := dated_beside(given, wrong, found):
        wrong, sheet = dated
        read = usable(raw.settings, raw.robot, sheet.rows, rejects)
        found = _studied(raw, read, step)
    late, sheet = exchanged_beside(PositionSheet(raw.robot, raw.settings, read.table), found)
    if late:  # a table as delivered shows decimetres, the identified one a millimetre
        read = usable(raw.settings, raw.robot, sheet.rows, rejects)
        found = _studied(raw, read, step)
    keep("10_positions", read.table, schema(raw.robot))
    off = outliers(found, read.table)
    rejected = keep("13_rejected", _rejected(read, off), tables.REJECTED)
    mistakes = (*wrong, *late, *wrong_entries(found), *implausible_outliers(off, found))
    return PositionsResults.of(name, raw, found, mistakes, rejected)


def conclude(results: PositionsResults, keep: Keep, step: Step) -> CampaignAnswer:
    """The end of a campaign of nothing but positions."""
    found, given = results.found, of_positions.answer(results)
    pictured = doors.found(_ANNEX)
    shown = {
        "rejected": results.rejected,
        **(pictured(found, keep, step) if pictured else {}),
    }
    model = _model(results.campaign, found.final, given)
    return CampaignAnswer(given, shown, model, model_file(results))


def model_file(
    results: PositionsResults, pulls: IdentifiedModel | None = None, joined: bool = False
) -> dict[str, bytes]:
    """What `pipeline predict` reads, by name.

    Args:
        results: What the positions say.
        pulls: The model of the same robot estimated from pulls; None if there were none.
        joined: Whether it was estimated jointly with the positions.
    """
    kept = doors.found(_KEPT)
    if kept is None:
        return {}
    settings = results.raw.settings
    tip = None if settings.of_positions else np.array(settings.tool["load_point"])
    return {_MODEL: kept(results.campaign, results.found.final, tip, pulls, joined)}


def _studied(raw: Raw, read: Positioned, step: Step) -> Study:
    settings = raw.settings.positions
    return step(study)(
        raw.robot,
        read.readings,
        read.weights,
        {one: np.array(at) for one, at in raw.settings.tool.items()},
        None if settings is None else settings.sigma_m,
        raw.robot.roughness,
        np.random.default_rng(_SEED),
    )


def _rejected(read: Positioned, off: Sequence[Mistake]) -> pd.DataFrame:
    """What was left out when it was read, and the readings that are off."""
    bad = [
        (
            *at.rsplit(":", 1),
            f"this reading is {plain(one.before, 3)} mm from where all others put its target",
        )
        for one in off
        for at in one.at
    ]
    outlying = pd.DataFrame(bad, columns=["file", "line", "reason"])
    return pd.concat([read.rejected, outlying.astype({"line": "int64"})], ignore_index=True)


def _model(name: str, found: Calibration, given: Answer) -> IdentifiedModel:
    """Corrected table and springs; the uncertainty of what is not determined is infinite."""
    mechanism, part = found.mechanism, layout(found.mechanism).compliance
    points = mechanism.tool[:, :3, 3]
    cell = paper_cell(mechanism.robot, Tool(points[0], found.readings.targets, points))
    cov: Array = found.cov[part, part].copy()
    known = np.array([one.identifiable for one in given.stiffness])
    cov[~known], cov[:, ~known] = 0.0, 0.0
    cov[~known, ~known] = np.inf
    one = ModelHypothesis(1.0, cell, mechanism.compliance, cov)
    recommended = given.recommended
    return IdentifiedModel(
        name,
        str(given.diagnosis.verdict),
        {
            "model": str(recommended.model),
            "data": str(recommended.data),
            "reason": str(recommended.reason),
        },
        (one,),
        known,
    )
