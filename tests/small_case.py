"""Small campaigns for tests of a single layer: a case, its screening, shifted readings."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.faults.fault import Screening
from pipeline.faults.screen import Screened, ScreeningBase, files_of, singles_of
from pipeline.reduction.bring import Reduced
from pipeline.reduction.case import Case
from pipeline.reduction.register import XYZ
from pipeline.run import ingested
from pipeline.simulate import Plan, revised, simulate
from pipeline.store.campaign import in_memory

PLAN = Plan(name="small", poses={"count": 6}, pulls={"steps_n": [1500.0, 3000.0]})


def small(seed: int = 3, **changes: Any) -> Case:
    """Six poses, each pulled twice, two zeros; as ingested."""
    made = simulate(revised(PLAN, changes), np.random.default_rng(seed))
    return ingested(in_memory(made.files), plausible=False)


def uneven(case: Case) -> Case:
    """A third zero in pose 2, later than all else in it, and only one zero in pose 3."""
    rows = case.readings
    zeros = rows[(rows["state"] == "unloaded") & (rows["pose"] == 2)].drop_duplicates("target")
    late = pd.Timedelta(seconds=1) + rows["time"][rows["pose"] == 2].max() - zeros["time"].min()
    more = zeros.assign(
        group="pose02_rep9_unloaded", line=zeros["line"] + 100_000, time=zeros["time"] + late
    )
    first = rows[(rows["state"] == "unloaded") & (rows["pose"] == 3)]
    lost = first.index[first["time"] > first["time"].median()]
    rows = pd.concat([rows.drop(lost), more], ignore_index=True)
    return replace(case, readings=rows)


def moved(case: Case, rows: np.ndarray, off: np.ndarray) -> Case:
    """The case with some readings shifted [m], tracker's frame."""
    readings = case.readings.copy()
    readings.loc[rows, XYZ] = readings.loc[rows, XYZ].to_numpy(float) + off
    return replace(case, readings=readings)


def where(case: Case, group: str, target: str) -> np.ndarray:
    """The rows of a reading, as a mask for `moved`."""
    rows = case.readings
    return ((rows["group"] == group) & (rows["target"] == target)).to_numpy()


def asked(case: Case) -> Screening:
    """The case under test with the paper's model."""
    return Screening(case, case.cell, case.robot.nominal_compliance)


def screen(case: Case, reduced: Reduced, beside: ScreeningBase | None = None) -> Screened:
    """All mistakes, from those of whole files to those of single readings."""
    files = files_of(case, reduced)
    return singles_of(files, None if files.findings else reduced, beside)
