"""Chance that a reading repeats another one to the last digit."""

from dataclasses import replace

import numpy as np
import pytest
from small_case import asked, small, where

from pipeline.faults import stale_reading
from pipeline.faults.stale_reading import repeated
from pipeline.tables import XYZ

DIGIT_M = 1e-7
"""Last digit of the simulated export, a tenth of a micrometre [m]."""


def test_equal_digits_are_as_improbable_as_the_last_one_is_narrow(monkeypatch):
    """P = h / (sqrt(4 pi) s) along each axis, times the pairs of groups within all poses."""
    case = small(3)
    rows = case.readings.copy()
    first, copy = (where(case, f"pose04_rep{k}_loaded", "P1") for k in (1, 2))
    rows.loc[copy, XYZ] = rows.loc[first, XYZ].to_numpy(float)
    case = replace(case, readings=rows)
    monkeypatch.setattr(stale_reading, "odd_forces", lambda _: {})
    (found,) = repeated(asked(case))

    stated = np.sqrt(rows.loc[copy, ["cxx_m2", "cyy_m2", "czz_m2"]].to_numpy(float)[0])
    still = rows[(rows["state"] == "unloaded") | rows["pose"].isna()].assign(
        pose=rows["pose"].fillna(-1)
    )
    each = [one[XYZ].to_numpy(float) for _, one in still.groupby(["pose", "target"], observed=True)]
    std = np.minimum(stated, np.median(np.abs(np.vstack([b[1:] - b[:-1] for b in each]))))
    groups = rows.drop_duplicates("group").assign(at=lambda one: one["pose"].fillna(-1))
    each = groups.groupby("at").size()
    pairs = (each * (each - 1) / 2).sum()
    assert found.where == "pose04_rep2_loaded/P1"
    assert found.p_value == pytest.approx(pairs * np.prod(DIGIT_M / (np.sqrt(4 * np.pi) * std)))
