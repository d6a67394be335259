"""An effect is one file and one line: an invented one works from simulator to report.

Its name is nowhere else, so that any code that knows effects by name fails here.
"""

import numpy as np
import pytest
from conftest import without_drawings

from pipeline.answer.contract import Which
from pipeline.base.arrays import Parameter
from pipeline.diagnosis.isolability import twins
from pipeline.library import model_file
from pipeline.machine import effects
from pipeline.machine.effect import Elastic, linear
from pipeline.machine.effects._anatomy import carriage
from pipeline.machine.robot import load
from pipeline.machine.robot.configuration import rotation_about
from pipeline.report import words
from pipeline.run import run
from pipeline.simulate import Plan, revised, simulate
from pipeline.simulate.hidden import as_text
from pipeline.store.campaign import find

ASLANT = np.array([1.0, 1.5, 0.8]) / np.linalg.norm([1.0, 1.5, 0.8])


def screw(loaded):
    """The carriage rotates about an axis oblique to the rail, shape (m, 1, 6)."""
    here = carriage(loaded)
    return rotation_about(here, np.broadcast_to(ASLANT, here.shape))[:, None]


def bracket(robot):
    """An effect that is not in the catalogue."""
    return (
        Elastic(
            name="zigzag_bracket",
            where=None,
            noun="give of the zigzag bracket",
            place="bracket",
            parameters=(Parameter("c_zigzag", "rad/(N m)", 1e-8, 0.0, 5e-7),),
            signature="all reflectors turn about an axis aslant to the rail",
            needs="a dial gauge on the bracket",
            source="made up",
            carrier=(1,),
            twists=screw,
            response=linear,
        ),
    )


@pytest.fixture
def catalogued(monkeypatch):
    """One line added to the catalogue."""
    monkeypatch.setattr(effects, "CATALOGUE", (*effects.CATALOGUE, bracket))
    for known in (words.nouns, twins):
        known.cache_clear()
    yield
    for known in (words.nouns, twins):
        known.cache_clear()


@pytest.mark.whole
def test_a_made_up_effect_goes_from_simulator_to_report(catalogued, tmp_path):
    """Planted by name, identified with its size, named by its noun, delivered with its value."""
    plan = revised(
        Plan(name="zigzag", seed=4),
        {
            "poses": {"count": 14},
            "pulls": {"steps_n": [1000.0, 2000.0, 3000.0, 1500.0]},
            "hidden": {"effects": ["zigzag_bracket=2x"], "stiffness_spread": 0.2},
        },
    )
    folder = tmp_path / "data" / "raw" / "zigzag"
    folder.mkdir(parents=True)
    for name, content in simulate(plan).files.items():
        (folder / name).write_bytes(content)

    found = find(tmp_path, "zigzag")
    with without_drawings():
        answer = run(found)

    (cause,) = answer.diagnosis.causes
    assert answer.diagnosis.verdict == "explained"
    assert (cause.name, cause.where, cause.location) == ("zigzag_bracket", None, "bracket")
    (size,) = cause.parameters
    assert size.value == pytest.approx(2e-8, abs=4 * size.std)
    assert answer.recommended.model == Which.EXTENDED
    page = (found.reports / "index.html").read_text("utf-8")
    assert "give of the zigzag bracket" in page
    assert "a dial gauge on the bracket" in page
    model = model_file.load(found.reports / "model.toml")
    assert model.hypotheses[0].value[-1] == pytest.approx(size.value, abs=size.std)
    assert "zigzag_bracket" in as_text(load("kr500_rail"))
