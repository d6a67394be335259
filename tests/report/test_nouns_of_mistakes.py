"""What causes are called."""

import pytest

from pipeline.faults import FAULTS
from pipeline.report import words


@pytest.mark.parametrize("name", sorted({fault.name for fault in FAULTS}))
def test_every_mistake_has_a_noun(name):
    """None is shown by its name in result.json, and none twice."""
    nouns = words.nouns()

    assert " " in nouns[name]
    assert list(nouns.values()).count(nouns[name]) == 1
