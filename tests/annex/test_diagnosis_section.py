"""Sentences of the section of causes."""

from types import SimpleNamespace

import pytest

from pipeline.annex.sections.diagnosis import _probability_sentence


@pytest.mark.parametrize(("outside", "beside"), [(0.99995, True), (0.02, False), (None, False)])
def test_a_probability_beside_what_is_missing_is_said_to_be_that(outside, beside):
    """5e-5 of a cause that is there means that it does not explain everything."""
    other = None if outside is None else SimpleNamespace(probability=outside)
    chance = 0.95 if outside is None else 1 - outside
    cause = SimpleNamespace(probability=chance, p_value=1e-9, outside_catalogue=other)

    said = _probability_sentence(cause)

    assert said.startswith("Its probability is") is not beside
    assert ("beside what is missing" in said) is beside
