import pytest

from bench.compare import FROZEN, answer_of, differences, digest, flat, frozen, thawed

HELD = frozen()

LONG = ("pair4", "clean2", "outlier", "single2", "strange5", "strange8", "doubtful4")
"""Of kinds of which another is held in every run of the tests, or `bench.compare` plays eight."""


@pytest.mark.parametrize(
    "key", [pytest.param(one, marks=[pytest.mark.slow] * (one in LONG)) for one in HELD]
)
def test_a_campaign_gets_the_answer_that_was_written_down(key):
    """Numbers agree to a millionth, p values in their logarithm, words to the letter."""
    held = HELD[key]
    files = thawed(held).files()
    now = answer_of(key, files)

    assert digest(files) == held["raw"], "the raw files are others: what makes them has changed"
    found = differences(dict(flat(held["answer"])), dict(flat(now)), FROZEN)
    assert not found, "\n".join(map(str, found))
