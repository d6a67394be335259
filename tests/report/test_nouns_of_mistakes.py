"""What causes are called."""

import re
from pathlib import Path

import pytest

import pipeline.faults
from pipeline.report import words

SOURCES = sorted(Path(pipeline.faults.__file__).parent.glob("*.py"))
NAMES = {name for one in SOURCES for name in re.findall(r'name="(\w+)"', one.read_text())}


@pytest.mark.parametrize("name", sorted({fault.name for fault in pipeline.faults.FAULTS} | NAMES))
def test_every_mistake_has_a_noun(name):
    """None is shown by its name in result.json, and none twice."""
    nouns = words.nouns()

    assert " " in nouns[name]
    assert list(nouns.values()).count(nouns[name]) == 1
