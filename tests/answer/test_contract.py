"""result.json conforms to its description in docs/."""

import json
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from bench import schema
from pipeline.answer.contract import Answer, Drawn, Fit, TargetDeflection
from pipeline.run import campaign_answer
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def answer():
    """The answer to a small campaign whose carriage rolls."""
    plan = Plan(
        name="rolls",
        seed=3,
        poses={"count": 12},
        pulls={"steps_n": [1000.0, 2000.0, 3000.0]},
        hidden={"effects": ["rail_roll=2x"]},
    )
    return campaign_answer("rolls", in_memory(simulate(plan).files)).answer


def test_the_schema_and_the_table_of_keys_are_those_of_the_types():
    """docs/result.schema.json and docs/answer.md agree with the types of the code."""
    page = (DOCS / "answer.md").read_text("utf-8")

    assert (DOCS / "result.schema.json").read_text("utf-8") == schema.schema()
    assert page == schema.page(page)
    for key in ("recommended", "joint_springs", "diagnosis.verdict", "stiffness[].ci95"):
        assert f"| `{key}` |" in page


def test_an_answer_is_its_own_dump(answer):
    """Read into the types and written again, result.json is the same object."""
    text = json.dumps(answer.as_json(), allow_nan=False)

    assert Answer.model_validate_json(text) == answer
    assert json.dumps(Answer.model_validate_json(text).as_json()) == text


def test_what_is_no_number_leaves_as_null(answer):
    """Infinite or undefined, in a list or by name: null in the answer, and nowhere else."""
    given = dict(answer.fit) | {"chi2": float("nan"), "residual_std_mm": np.float64(np.inf)}
    fit = Fit(**given)
    drawn = Drawn(test_pose={"P1": np.nan, "P2": 1.0}, global_={})
    moved = dict(answer.test_pose_deflection[0]) | {"dx_mm": np.nan, "std_mm": (np.inf, 1.0, 2.0)}

    assert (fit.chi2, fit.residual_std_mm, fit.rms_mm) == (None, None, answer.fit.rms_mm)
    assert drawn.test_pose == {"P1": None, "P2": 1.0}
    assert TargetDeflection(**moved).std_mm == (None, 1.0, 2.0)
    assert TargetDeflection(**moved).size_mm is None
    with pytest.raises(ValidationError):
        Fit(**given | {"dof": np.nan})


@pytest.mark.parametrize(
    "spoil",
    [
        lambda a: a["stiffness"][0].pop("unit"),
        lambda a: a["stiffness"][0].update(value=float("nan")),
        lambda a: a["diagnosis"].update(verdict="splendid"),
        lambda a: a.update(surprise=1),
        lambda a: a["recommended"].update(model="guessed"),
        lambda a: a["diagnosis"]["causes"][0].update(probability=1.5),
    ],
)
def test_what_breaks_the_promise_is_found(answer, spoil):
    """A missing key, an invalid number, an unknown word."""
    broken = answer.as_json()
    spoil(broken)

    with pytest.raises(ValidationError):
        Answer.model_validate_json(json.dumps(broken))
