"""The budget of false alarms: its sum, and that every test keeps to its own part."""

import ast
import math
from pathlib import Path

import numpy as np
import pytest

from pipeline.machine.cell import paper_cell
from pipeline.machine.effects import catalogue
from pipeline.run import tool
from pipeline.store.campaign import in_memory
from pipeline.system import alarms
from pipeline.system.detect import threshold
from pipeline.system.linearised import Model, linearise
from pipeline.system.whitened import whiten

PACKAGE = Path(alarms.__file__).parents[1]


def test_all_tests_together_accuse_one_clean_campaign_in_a_hundred():
    """The sum bounds what chance does, however the tests depend on each other (Boole)."""
    assert math.fsum(alarms.ACCUSING.values()) <= alarms.MOST == 0.01


def test_every_rate_is_used_where_a_test_is_made():
    """A rate that no code reads, or a test with a rate of its own, would make the sum a fiction."""
    used = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            named = isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
            if named and node.value.id == "alarms":
                used.add(node.attr)

    rates = {
        "SUSPECT",
        "LACK_OF_FIT",
        "READING",
        "DRIFT",
        "EXCHANGED",
        "SCALE",
        "MISFIT",
        "SCATTER",
        "COMPONENT",
    }
    assert used == rates | {"PLANNED"}  # that of one suspect, where nothing is measured yet


def test_a_planned_suspect_has_the_rate_that_a_measured_one_finds(small_campaign, read_back):
    """The whole catalogue of a robot on a rail, tested in one campaign: its threshold."""
    raw = in_memory(small_campaign.files)
    cell = paper_cell(raw.robot, tool(raw.settings))
    model = Model(cell, raw.robot.nominal_compliance, 7)
    seen = linearise(model, read_back(small_campaign).data, catalogue(raw.robot))
    view = whiten(seen, 1.0)
    found = threshold(view, view.base, view.rows_left, np.random.default_rng(1))

    assert found.p == pytest.approx(alarms.PLANNED, rel=0.5)


def test_eight_families_of_readings_are_tested():
    """As many as there are entries of the table: a ninth needs a line there.

    Single readings of the scale and exchanged ones share the rate of one family.
    """
    families = (
        "reading", "lost_pull", "base_reading", "base_reflector", "chain", "pose_moved",
        "stale_reading",
    )  # fmt: skip
    testing = {
        path.stem
        for path in (PACKAGE / "faults").glob("*.py")
        if "alarms.READING" in path.read_text("utf-8")
    }

    assert testing - {"joint_row"} == set(families)  # joint_row asks the base for its alibi
    assert sum(rate == alarms.READING for rate in alarms.ACCUSING.values()) == len(families)
    assert alarms.SCALE + alarms.EXCHANGED == alarms.READING
