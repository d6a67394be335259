"""Weights and payloads of the rows of a log: their bodies, forces and uncertainties."""

import numpy as np
import pandas as pd
import pytest

from pipeline.machine.effect import HUNG, MOUNTED, PULLED
from pipeline.reduction.settings import PayloadSettings
from pipeline.reduction.weights import PULL, Weights

PAYLOADS = {
    "spindle": PayloadSettings(mass_kg=80, mass_sigma_kg=0.4, center_m=(0, 0, 0.2),
                               center_sigma_m=0.003),
    "gripper": PayloadSettings(mass_kg=30, mass_sigma_kg=0.1, center_m=(0.1, 0, 0.1),
                               center_sigma_m=0.001),
}  # fmt: skip
LOADS = pd.DataFrame(
    {
        "payload": [None, "gripper", None, None, "spindle", None],
        "mass_kg": [np.nan, np.nan, 50.0, 20.0, np.nan, 50.0],
        "mass_sigma_kg": [np.nan, np.nan, 0.05, 0.02, np.nan, 0.05],
    }
)


def test_every_row_has_its_body():
    """Equal weights are one body, and share their error; a chain has none."""
    found = Weights.of(PAYLOADS, LOADS)

    assert found.by.tolist() == [PULLED, MOUNTED, HUNG, HUNG, MOUNTED, HUNG]
    assert found.body[0] == PULL
    assert found.body[1] == 1
    assert found.body[4] == 0
    assert found.body[2] == found.body[5] != found.body[3]
    assert not {found.body[2], found.body[3]} & {0, 1, PULL}
    assert found.mass[1:].tolist() == [30, 50, 20, 80, 50]
    assert found.mass_std[1:].tolist() == [0.1, 0.05, 0.02, 0.4, 0.05]
    assert found.center_std.tolist() == [0, 0.001, 0, 0, 0.003, 0]


def test_a_body_falls_and_a_chain_does_not():
    """M g where something hangs, nothing known where a chain pulls."""
    force = Weights.of(PAYLOADS, LOADS).force(np.array([0.0, 0.0, -9.8]))

    assert np.isnan(force[0]).all()
    assert force[2] == pytest.approx([0.0, 0.0, -490.0])


def test_rows_are_selected_in_all_columns():
    """And their points of action with them."""
    some = Weights.of(PAYLOADS, LOADS).only(np.array([False, True, False, False, True, False]))

    assert some.mass.tolist() == [30, 80]
    assert some.center.tolist() == [[0.1, 0, 0.1], [0, 0, 0.2]]


def test_without_payloads_the_same():
    """A log of weights alone."""
    found = Weights.of({}, LOADS[["mass_kg", "mass_sigma_kg"]].iloc[[2, 3]])

    assert found.by.tolist() == [HUNG, HUNG]
    assert np.isnan(found.center).all()
