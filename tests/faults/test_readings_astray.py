"""How many readings of the base are far off, and what is said of a pose that was read as one."""

import numpy as np
import pandas as pd
import pytest
from small_case import moved, small

from pipeline.faults.base_reading import astray
from pipeline.faults.reading import _bad_pose
from pipeline.machine.six import radius
from pipeline.reduction.register import register


@pytest.fixture(scope="module")
def case():
    """Six poses between two rounds of four base reflectors."""
    return small(3)


@pytest.mark.parametrize(
    ("rows", "least"), [([], 0), ([0], 1), ([5], 1), ([0, 5], 2), ([0, 1, 2, 7], 2)]
)
def test_readings_astray_are_counted_at_least(case, rows, least):
    """By four millimetres each, every way of its own; no motion of the tracker explains them."""
    base, spoilt, rng = case.readings[case.readings["pose"].isna()], case, np.random.default_rng(1)
    for k in base.index[rows]:
        way = rng.standard_normal(3)
        spoilt = moved(spoilt, spoilt.readings.index == k, 4e-3 * way / np.linalg.norm(way))
    registration = register(spoilt.settings, spoilt.readings)
    count, of = astray(registration, 1.0, 10.0)

    assert (least <= count <= len(rows), of) == (True, len(base))
    assert astray(registration, 1000.0, 10.0) == (0, len(base))
    one = case.readings[
        case.readings["pose"].notna() | (case.readings["group"] == base["group"].iloc[0])
    ]
    assert astray(register(case.settings, one), 1.0, 10.0) == (0, 0)


@pytest.mark.parametrize("rivals", [0, 2])
def test_a_bad_pose_is_said_by_its_length_and_its_angle(case, rivals):
    """Rotations at the radius of the targets; one of several where none stands out."""
    groups = [f"pose0{k}_rep1_loaded" for k in range(1, 2 + rivals)]
    rows = [pd.Series({"group": one}) for one in groups]
    size = np.array([3e-3, 0, 4e-3, 0, 1e-3, 0])
    found = _bad_pose(case, rows[0], size, 12.0, 1e-9, rows[1:])

    turned = 1e3 * 1e-3 / radius(case.tool.points)
    assert "is 5.00 mm and" in found.evidence
    assert f"{turned:.3g} mrad" in found.evidence
    assert found.evidence.startswith("one of the poses" if rivals else "the pose pose01")
    assert (found.axes, found.p_value, found.before) == (6, 1e-9, 12.0)
    assert found.size == pytest.approx(np.sqrt(26e-6))
    assert len(found.at) == len(case.settings.measured) * (1 + rivals)
    assert found.instead == tuple(groups[1:])
    assert found.where == groups[0]
