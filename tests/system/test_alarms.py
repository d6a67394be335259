"""The false-alarm budget: its sum, and that every test keeps to its own rate."""

import ast
import math
from pathlib import Path

import numpy as np
import pytest

from pipeline.machine.cell import paper_cell
from pipeline.machine.effects import catalogue
from pipeline.reduction.effector import tool
from pipeline.store.campaign import in_memory
from pipeline.system import alarms
from pipeline.system.detect import threshold
from pipeline.system.linearised import CurrentModel, linearise
from pipeline.system.whitened import whiten

PACKAGE = Path(alarms.__file__).parents[1]


@pytest.mark.parametrize("table", [alarms.OF_PULLS, alarms.OF_POSITIONS, alarms.OF_BOTH])
def test_all_tests_together_accuse_one_clean_campaign_in_a_hundred(table):
    """The sum bounds the total false-alarm rate, however the tests depend on each other (Boole)."""
    assert math.fsum(table.values()) <= alarms.MOST_ALARMS == 0.01


def test_a_campaign_of_both_is_asked_all_that_either_is_and_whether_they_agree():
    """The table of both holds every test of either, none of them twice under one name."""
    assert len(alarms.OF_BOTH) == len(alarms.OF_PULLS) + len(alarms.OF_POSITIONS) + 2
    each = [*alarms.OF_PULLS.values(), *alarms.OF_POSITIONS.values()]
    both = math.fsum([*each, alarms.MISFIT, alarms.GEOMETRY])
    assert math.fsum(alarms.OF_BOTH.values()) == pytest.approx(both, rel=1e-12)


RATES = {
    "SUSPECT", "LACK_OF_FIT", "READING", "DRIFT", "MISFIT", "SCATTER", "COMPONENT", "LAW",
    "GEOMETRY", "LOOSE", "MOVED", "EXCHANGED", "SCALE", "FRAME", "LADDERS", "GREW", "STRUCTURE",
    "ERRING", "TOOL_POINT",
}  # fmt: skip


def test_every_rate_is_used_where_a_test_is_made():
    """A rate that no code uses, or a test with its own rate, would make the sum meaningless."""
    used = set()
    texts = (path.read_text("utf-8") for path in PACKAGE.rglob("*.py"))
    for text in (one for one in texts if "alarms." in one):
        for node in ast.walk(ast.parse(text)):
            named = isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
            if named and node.value.id == "alarms":
                used.add(node.attr)

    assert used == RATES | {"PLANNED"}  # that of one suspect in planning
    counted = {*alarms.OF_PULLS.values(), *alarms.OF_POSITIONS.values()}
    assert counted == {getattr(alarms, rate) for rate in RATES - {"COMPONENT"}}


KNOWN = {
    "pose_moved._ALONE": "takes back what other poses show, too",
    "base_reading._AGREES": "takes back what others contradict",
    "base_reflector._AGREE": "takes back what others contradict",
    "unloaded_geometry._MISFIT": "asks for causes only where positions do not fit",
    "scale_reading._ALIKE": "factors that are one, which takes an accusation back",
    "noise_bounds._CHANCE": "a robot that gives way explains far more",
    "estimate.MISFIT_P": "a remark beside the verdict",
    "unloaded._RARE": "leaves out a pose that no displacement is measured in",
}
"""Probabilities outside the table: none of them accuses a campaign by itself."""


def test_no_test_has_a_rate_of_its_own():
    """A p-value compared with a constant of its file must be in the table or listed above."""
    own = set()
    for room in ("faults", "diagnosis", "system", "geometry"):
        for path in (PACKAGE / room).rglob("*.py"):
            own |= {f"{path.stem}.{name}" for name in _rates(path)}

    assert own <= set(KNOWN)


def _rates(path):
    """Module-level probabilities with which a p-value is compared."""
    tree = ast.parse(path.read_text("utf-8"))
    small = {
        node.targets[0].id
        for node in tree.body
        if isinstance(node, ast.Assign)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, float)
        and 0 < node.value.value <= 0.01
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            said = {name.id for side in sides for name in ast.walk(side) if hasattr(name, "id")}
            chances = any(_chance(side) for side in sides)
            yield from small & said if chances else ()


CHANCES = {"p", "misfit", "chance", "chi2_beyond", "fdtrc", "chdtrc", "p_value", "p_exact"}


def _chance(side):
    """Whether an expression is a p-value."""
    names = {getattr(node, "id", getattr(node, "attr", "")) for node in ast.walk(side)}
    return bool(names & CHANCES) or any(name.endswith("_p") for name in names)


def test_a_rate_of_its_own_would_be_found(tmp_path):
    """The search above finds a new threshold."""
    path = tmp_path / "made.py"
    path.write_text("_RARE = 1e-3\n_M = 1e-3\ndef f(p, x):\n    return p < _RARE and x < _M\n")

    assert set(_rates(path)) == {"_RARE"}


def test_a_planned_suspect_has_the_rate_that_a_measured_one_finds(small_campaign, read_back):
    """The planned rate is the threshold for the whole catalogue of a robot on a rail."""
    raw = in_memory(small_campaign.files)
    cell = paper_cell(raw.robot, tool(raw.settings))
    model = CurrentModel(cell, raw.robot.nominal_compliance, 7)
    seen = linearise(model, read_back(small_campaign).data, catalogue(raw.robot))
    view = whiten(seen, 1.0)
    found = threshold(view, view.base, view.rows_left, np.random.default_rng(1))

    assert found.p == pytest.approx(alarms.PLANNED, rel=0.5)


def test_eight_families_of_readings_are_tested():
    """As many families as the table assumes; a ninth would need an entry.

    Single readings of the scale and exchanged ones share the rate of one family.
    """
    families = (
        "bounds", "base_reading", "base_reflector", "chain", "pose_moved",
        "stale_reading", "simultaneous",
    )  # fmt: skip
    testing = {
        path.stem
        for room in ("faults", "diagnosis", "system")
        for path in (PACKAGE / room).glob("*.py")
        if "alarms.READING" in path.read_text("utf-8")
    }

    # joint_row uses the base as alibi, one_pose what targets were computed from
    assert testing - {"joint_row", "one_pose"} == set(families)
    assert sum(rate == alarms.READING for rate in alarms.OF_PULLS.values()) == len(families)
    parts = alarms.SCALE, alarms.EXCHANGED, alarms.LADDERS
    assert math.fsum(parts) == pytest.approx(alarms.READING, rel=1e-12)
