"""Exports with suffixes in capitals."""

import pytest

from pipeline.live.complete_lines import whole_lines


@pytest.mark.parametrize("name", ["TRACKER.CSV", "Pose01.Txt", "joints.log"])
def test_a_table_waits_for_its_last_line_whatever_the_case_of_its_suffix(name):
    assert whole_lines(name, b"pose,x\n1,2\n2,") == b"pose,x\n1,2\n"
