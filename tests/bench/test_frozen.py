import pytest

from bench.compare import FROZEN, answer_of, differences, digest, flat, frozen, thawed

HELD = frozen()

LONG = ("pair4", "clean2", "outlier", "single2", "strange5", "strange8", "doubtful4")
"""Of kinds of which another is held in `make whole`, or `bench.compare` plays eight."""

SHIPPED = "kr500_demo"
"""Held in every run of the tests."""


def marks(key):
    """When an answer is computed."""
    return [pytest.mark.slow] if key in LONG else [pytest.mark.whole] * (key != SHIPPED)


@pytest.mark.parametrize("key", [pytest.param(one, marks=marks(one)) for one in HELD])
def test_a_campaign_gets_the_answer_that_was_written_down(key):
    """Numbers agree to a millionth, p values in their logarithm, words to the letter."""
    held = HELD[key]
    files = thawed(held).files()
    now = answer_of(key, files)

    assert digest(files) == held["raw"], "the raw files are others: what makes them has changed"
    found = differences(dict(flat(held["answer"])), dict(flat(now)), FROZEN)
    assert not found, "\n".join(map(str, found))
