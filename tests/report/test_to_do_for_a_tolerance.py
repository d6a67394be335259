"""What a certificate asks to be done for a tolerance."""

import pytest
import report_sample

from pipeline.report.certificate import _by_tolerance


@pytest.mark.parametrize(
    ("reason", "decision", "asked"),
    [
        ("adequate", "pass", []),
        ("adequate", "undecided", ["For the tolerance: reduce the force or measure more."]),
        ("adequate", "fail", ["For the tolerance: reduce the force or compensate the path."]),
        ("unexplained", "fail", []),  # nothing is decided by a model that does not hold
    ],
)
def test_nothing_is_asked_for_a_tolerance_that_no_model_judges(reason, decision, asked):
    def change(content):
        content["recommended"]["reason"] = reason
        content["tolerance"] |= {"test_pose": decision, "path": None}

    answer = report_sample.revised(report_sample.answer(), change)
    assert list(_by_tolerance(answer)) == asked
