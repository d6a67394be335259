"""Spells of noise: sums over all spans, against their enumeration."""

from itertools import combinations

import numpy as np
import pytest

from pipeline.system.spells import States

KEYS = np.array([(4, 1), (4, -1), (4, 2), (4, 2), (6, -1), (6, 1), (9, 3), (4, 3)])
"""Pose and pull of readings: four states, two, and one."""


def spans(count):
    """First state of each spell of a pose, and the one after its last."""
    return (
        [(0, 1)]
        if count == 1
        else [s for s in combinations(range(count + 1), 2) if s[1] > s[0] + 1]
    )


@pytest.fixture
def gains():
    """Of each reading, for two laws."""
    return np.random.default_rng(1).normal(0, 2, (2, len(KEYS)))


def test_a_spell_covers_successive_states(gains):
    """Likelihood ratio and probability of every state, each span enumerated."""
    states, share = States.each(KEYS), np.array([0.2, 0.05])
    keys = sorted({(int(p), int(k)) for p, k in KEYS})

    for law, u in enumerate(share):
        ratio, noisy = 0.0, {}
        for pose in (4, 6, 9):
            mine = [key for key in keys if key[0] == pose]
            g = [gains[law][(key == KEYS).all(axis=1)].sum() for key in mine]
            each = {(a, b): u * np.exp(sum(g[a:b])) for a, b in spans(len(mine))}
            each = {span: value / len(each) for span, value in each.items()}
            whole = 1 - u + sum(each.values())
            ratio += np.log(whole)
            for k, key in enumerate(mine):
                noisy[key] = sum(v for (a, b), v in each.items() if a <= k < b) / whole

        assert states.ratio(gains, share)[law] == pytest.approx(ratio)
        assert states.noisy(gains, share)[law] == pytest.approx([noisy[key] for key in keys])


def test_readings_of_no_pose_are_of_no_state():
    """As those of the base are."""
    states = States.each(KEYS)

    assert states.among(np.array([[4, 2], [-1, -1]])).sum(axis=0).tolist() == [1, 0]
    assert States.none().among(KEYS).shape == (0, len(KEYS))
