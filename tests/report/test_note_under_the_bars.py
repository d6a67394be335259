"""Sentences of the certificate against the numbers beside them."""

import re

import numpy as np
import pytest
import report_sample

from pipeline.answer.contract import PositionStep
from pipeline.report.certificate import _bars, _note, found
from pipeline.report.summaries import interval


def test_the_longest_bar_is_the_largest_u_of_the_table():
    """Without nominal values the note states U, as the column of values does: ± over value."""

    def unknown(content):
        for joint in content["stiffness"]:
            joint["nominal"] = None

    answer = report_sample.revised(report_sample.answer(), unknown)
    pairs = (re.match(r"([\d.]+)\s±\s([\d.]+)", bar.value) for bar in _bars(answer)[0])
    most = max(float(pair[2]) / float(pair[1]) for pair in pairs if pair)

    said = re.search(r"relative U, the longest ([\d.]+)\s%", _note(answer, False))
    assert float(said[1]) == pytest.approx(100 * most, rel=0.05)


def test_the_error_with_the_causes_is_that_of_the_last_step():
    """Positions: nominal geometry against the model that is recommended, not one on the way."""
    answer = report_sample.answer()
    cause = answer.diagnosis.causes[0]
    steps = tuple(
        PositionStep(model=model, between_mm=mm, space_mm=mm, series_mm=None)
        for model, mm in (("nominal table", 0.95), ("corrected table", 0.41), ("laws", 0.087))
    )
    diagnosis = answer.diagnosis.model_copy(
        update={"causes": (cause.model_copy(update={"evidence": None}),)}
    )
    of_positions = answer.model_copy(update={"position_steps": steps, "diagnosis": diagnosis})

    said = found(of_positions)
    assert "0.95 mm with nominal geometry, 0.087 mm with" in said


def test_an_interval_without_an_upper_limit_has_none():
    """In the unit of each joint; a spring that may be rigid is endless upwards, no other is."""
    first, second, third = report_sample.answer().stiffness[:3]
    joints = [
        first.model_copy(update={"value": 4.0, "ci95": (2.0, 6.0)}),
        second.model_copy(update={"value": 50.0, "ci95": (30.0, None)}),
        third.model_copy(update={"value": None, "ci95": (None, None)}),
    ]

    found = interval(joints, np.array([2.0, 10.0, 1.0]))

    assert found[:, 0].tolist() == [2.0, 1.0, 3.0]
    assert found[:, 1].tolist() == [5.0, 3.0, np.inf]
    assert np.isnan(found[:2, 2]).all()
    assert interval(joints[:1], 2.0)[:, 0].tolist() == [2.0, 1.0, 3.0]
