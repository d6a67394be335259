"""A target with a wrong position in campaign.toml: named, and corrected from the readings."""

from dataclasses import replace

import numpy as np
import pytest
from small_case import asked, small

from pipeline.faults.conventions import anchored
from pipeline.faults.entries import wrong_entries
from pipeline.faults.gross_reading import gross
from pipeline.faults.reading import FAULT as READING
from pipeline.faults.tool_point import tool_point
from pipeline.machine.robot import configure
from pipeline.reduction.register import XYZ

OFF = np.array([0.15, -0.14, 0.05])


@pytest.fixture(scope="module")
def case():
    """Six poses with three targets."""
    return small(3)


def wrong(case, **off):
    """[tool] with targets at other positions [m]."""
    tool = {n: tuple(np.add(at, off.get(n, 0.0)).tolist()) for n, at in case.settings.tool.items()}
    return replace(case, settings=case.settings.model_copy(update={"tool": tool}))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("times", [0.02, 0.1, 1.0])
@pytest.mark.parametrize("name", ["P1", "P2", "P3"])
def test_the_target_that_the_readings_contradict_is_identified_and_put_right(case, name, times):
    """From millimetres on, to the scatter of the readings; no reading is then accused."""
    (found,) = tool_point(wrong(case, **{name: times * OFF}))

    right = found.correct(wrong(case, **{name: times * OFF}))
    assert (found.name, found.where) == ("tool_point", name)
    assert found.size == pytest.approx(times * np.linalg.norm(OFF), abs=3e-3)
    assert right.settings.tool[name] == pytest.approx(case.settings.tool[name], abs=3e-3)
    assert tool_point(right) == []
    assert gross(right) == []
    assert READING.find(asked(right)) == []


def test_a_good_tool_and_a_single_bad_reading_are_no_wrong_target(case):
    """Distances are medians over all states."""
    assert tool_point(case) == []
    rows = case.readings.copy()
    hit = (rows["target"] == "P2") & (rows["group"] == "pose02_rep0_unloaded")
    rows.loc[hit, ["x_m", "y_m", "z_m"]] = 0.0

    assert tool_point(replace(case, readings=rows)) == []


def test_two_wrong_targets_are_not_told_apart(case):
    """All distances are wrong: which target is undecidable, and nothing is corrected."""
    assert tool_point(wrong(case, P1=OFF, P2=-OFF[::-1])) == []
    assert tool_point(wrong(case, P1=OFF, P2=OFF)) == []


def test_what_the_uncertainty_of_a_point_allows_is_no_mistake(case):
    """1 mm is left to the findings, and so are 10 mm if 5 mm are stated."""
    assert tool_point(wrong(case, P1=OFF / 200)) == []
    vague = wrong(case, P1=OFF / 20)
    known = case.settings.tool_uncertainty.model_copy(update={"sigma_m": 5e-3})
    settings = vague.settings.model_copy(update={"tool_uncertainty": known})

    assert len(tool_point(vague)) == 1
    assert tool_point(replace(vague, settings=settings)) == []


@pytest.mark.sampled(3)
@pytest.mark.parametrize("since", [3, 4, 5])
@pytest.mark.parametrize("name", ["P1", "P2", "P3"])
def test_a_target_that_moved_on_the_effector_is_not_wrong_in_tool(case, name, since):
    """Four millimetres, along the flange, at a pose in the middle: no place fits all poses."""
    rows, tool = case.readings.copy(), asked(case).reduced
    assert tool is not None
    poses = sorted(set(case.joints["pose"]))
    axes = configure(case.robot, case.q(np.array(poses))).flange_axes
    frame = anchored(case)
    for pose, R in zip(poses, axes, strict=True):
        hit = (rows["target"] == name) & (rows["pose"] == pose)
        if pose >= since:
            rows.loc[hit, XYZ] += frame[0].T @ R @ np.array([2e-3, -2e-3, 2.8e-3])
    assert tool_point(replace(case, readings=rows)) == []
    late = replace(case, readings=rows[(rows["pose"] >= since) | rows["pose"].isna()])
    if since < 5:  # three poses or more, in all of which it is off by as much
        assert [one.where for one in tool_point(late)] == [name]


def known(case, sigma_m, **off):
    """Targets at other positions than stated, with a stated uncertainty [m]."""
    moved = wrong(case, **off)
    stated = case.settings.tool_uncertainty.model_copy(update={"sigma_m": sigma_m})
    settings = moved.settings.model_copy(update={"tool_uncertainty": stated})
    return replace(moved, settings=settings)


def test_a_target_is_held_to_its_stated_uncertainty(case):
    """0.6 mm off: twelve standard uncertainties of 0.05 mm, less than two where none is stated."""
    off = 6e-4 * OFF / np.linalg.norm(OFF)

    (found,) = wrong_entries(known(case, 5e-5, P2=off))

    assert (found.table, found.names) == ("tool", ("P2",))
    assert found.off_m == pytest.approx(6e-4, abs=2e-4)
    assert wrong_entries(wrong(case, P2=off)) == wrong_entries(known(case, 5e-4, P2=off)) == ()


def test_targets_that_are_where_their_uncertainty_allows_are_not_doubted(case):
    """Drawn from the stated uncertainty."""
    for seed, sigma_m in ((1, 5e-5), (2, 5e-5), (3, 1e-3)):
        rng = np.random.default_rng(seed)
        off = {name: sigma_m * rng.standard_normal(3) for name in case.settings.measured}
        assert wrong_entries(known(case, sigma_m, **off)) == ()


def test_readings_that_scatter_widely_contradict_no_target(case):
    """Three quarters of a millimetre in each coordinate, where targets are stated to 0.02 mm."""
    rows = case.readings.copy()
    for seed in (1, 2):
        noise = 7.5e-4 * np.random.default_rng(seed).standard_normal((len(rows), 3))
        rows[XYZ] = case.readings[XYZ].to_numpy(float) + noise
        assert wrong_entries(known(replace(case, readings=rows), 2e-5)) == ()
