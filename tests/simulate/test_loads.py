"""Loads of a virtual robot: steps, weights, payloads, and their own errors."""

import numpy as np
import pytest

from pipeline.machine.effect import HUNG, MOUNTED, PULLED
from pipeline.simulate.library import plan_for
from pipeline.simulate.loads import run

G = 9.80665


def loads(poses=2, seed=3, **changes):
    """The loads of the default plan with these changes."""
    return run(plan_for(None, changes), poses, np.random.default_rng(seed))


def test_a_chain_is_tightened_and_slackened_as_its_steps_say():
    """Repeated in every pose; a scale has no mass that could be wrong."""
    found = loads(pulls={"steps_n": [500.0, 1000.0, 800.0], "repeats": 2})

    assert found.count.tolist() == [6, 6]
    assert found.shown.tolist() == [500.0, 1000.0, 800.0] * 4
    assert found.branch.tolist() == [1, 1, -1] * 4
    assert (found.by == PULLED).all()
    assert (found.heavier == 1).all()


def test_a_weight_is_wrong_by_the_same_mass_whenever_it_hangs():
    """One error for each mass, of the stated size, and none where none is stated."""
    pulls = {"load": "weights", "masses_kg": [50.0, 100.0], "repeats": 2}
    found = loads(pulls=pulls | {"mass_sigma_kg": 0.5})
    off = (found.heavier - 1) * found.shown / G

    assert (found.by == HUNG).all()
    assert found.shown[:2] == pytest.approx([50 * G, 100 * G])
    assert off.reshape(-1, 2) == pytest.approx(np.tile(off[:2], (4, 1)))
    assert (np.abs(off[:2]) < 2.5).all()
    assert off[0] != off[1]
    assert loads(pulls=pulls).heavier == pytest.approx(1.0)


def test_each_payload_is_mounted_in_turn():
    """Its centre is off by one error, the same in every pose."""
    payload = {
        "light": {"mass_kg": 100.0, "center_m": [0.0, 0.0, 0.2]},
        "heavy": {"mass_kg": 300.0, "center_m": [0.0, 0.0, 0.3], "center_sigma_m": 0.01},
    }
    found = loads(poses=3, payload=payload, pulls={"load": "payloads", "repeats": 1})

    assert found.what == ("light", "heavy") * 3
    assert (found.by == MOUNTED).all()
    assert found.acts_at[::2] == pytest.approx(np.tile([0, 0, 0.2], (3, 1)))
    assert (found.acts_at[1::2] == found.acts_at[1]).all()
    assert 0 < np.abs(found.acts_at[1] - [0, 0, 0.3]).max() < 0.05
