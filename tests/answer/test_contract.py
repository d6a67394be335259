"""result.json conforms to its description in docs/."""

import json
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import stats

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


def nodes(one):
    """Every object in an answer, itself included."""
    if isinstance(one, dict):
        yield one
    for part in one.values() if isinstance(one, dict) else one if isinstance(one, list) else ():
        yield from nodes(part)


def test_every_number_is_one_that_its_name_can_have(answer):
    """Probabilities, p-values and shares, uncertainties, intervals about their values."""
    for one in nodes(answer.as_json()):
        for name in one.keys() & {"p_value", "probability", "weight", "share", "smallest_p"}:
            assert one[name] is None or 0 <= one[name] <= 1
        assert all((one[name] or 0) >= 0 for name in one.keys() & {"std", "std_mm", "rms_mm"}
                   if not isinstance(one[name], list))  # fmt: skip
        if {"ci95", "value"} <= one.keys() and one["value"] is not None:
            low, high = one["ci95"]
            assert low is None or low < one["value"]
            assert high is None or one["value"] < high


def test_springs_agree_with_their_compliances_and_budgets(answer):
    """Value and compliance are inverse; the parts of a budget add up in squares to the whole."""
    for model in (answer, answer.joint_springs, answer.extended):
        for one in model.stiffness:
            assert one.value * one.compliance == pytest.approx(1, rel=1e-9)
            assert one.std / one.value == pytest.approx(one.relative_std, rel=1e-9)
            assert one.compliance_std / one.compliance == pytest.approx(one.relative_std, rel=1e-2)
            parts = {part.source: (part.std / one.std) ** 2 for part in one.budget}
            assert parts == pytest.approx({part.source: part.share for part in one.budget})
            assert sum(parts.values()) == pytest.approx(1, abs=1e-6)


def test_the_test_pose_agrees_with_itself(answer):
    """Length, direction and uncertainty of the deflection, each from its parts."""
    pose = answer.test_pose
    along = np.dot(pose.vector_mm, pose.force_n) / np.linalg.norm(pose.force_n)

    assert pose.deflection_mm == pytest.approx(np.linalg.norm(pose.vector_mm), rel=1e-9)
    assert pose.along_force_mm == pytest.approx(along, rel=1e-9)
    assert pose.std_mm**2 == pytest.approx(sum(part.std_mm**2 for part in pose.budget), rel=1e-6)


def test_models_and_data_agree(answer):
    """One cause of one parameter that is identified: degrees of freedom, values, table, gain."""
    (cause,) = answer.diagnosis.causes
    (springs, both) = (one.fit for one in (answer.joint_springs, answer.extended))

    assert springs.dof - both.dof == len(cause.parameters) == 1
    assert springs.dof == 3 * 3 * 36 - 7
    for fit in (springs, both):
        assert fit.p_value == pytest.approx(stats.chi2.sf(fit.chi2, fit.dof), rel=1e-6)
    assert (answer.stiffness, answer.fit) == (answer.extended.stiffness, both)
    assert answer.recommended.model == "extended"
    assert answer.recommended.table == "as_delivered"  # no parameter of the table was changed
    assert sum(one.weight for one in answer.recommended.hypotheses) == pytest.approx(1, abs=1e-9)
    assert {one.name for one in answer.recommended.hypotheses[0].causes} == {cause.name}
    gain = cause.gain
    assert gain.reduction == pytest.approx(
        1 - gain.held_out_rms_after_mm / gain.held_out_rms_before_mm, rel=1e-9
    )
    assert gain.held_out_rms_after_mm == pytest.approx(answer.validation.held_out_rms_mm)
    assert (answer.identity.poses, answer.identity.pulls) == (12, 36)
    assert abs(cause.parameters[0].value - 2e-8) < 4 * cause.parameters[0].std
