"""The page of constants: each number of the package with value, unit and meaning."""

import pytest

from bench.constants import constants, of, page

SOURCE = '''
LEVER_M = 2 * 5.0
"""Of a turn [m],
at most (Baarda 1968)."""
_FEW: int = -3
"""Rows | poses."""
NAME = "none"
YES = True
'''


def test_a_number_is_told_with_its_unit_and_what_is_no_number_is_not():
    lever, few = of(SOURCE, "system/made.py")
    assert (lever.name, lever.value, lever.unit) == ("LEVER_M", "2 * 5.0", "m")
    assert lever.meaning == "Of a turn, at most (Baarda 1968)."
    assert (few.name, few.value, few.unit, few.meaning) == ("_FEW", "-3", "", "Rows | poses.")


@pytest.mark.whole
def test_every_constant_of_the_package_has_a_sentence_and_a_row_of_the_page():
    told = constants()
    assert not [(one.module, one.name) for one in told if not one.meaning.endswith((".", "..."))]
    rows = [line for line in page().splitlines() if line.startswith("| `")]
    assert len(rows) == len(told) > 500
