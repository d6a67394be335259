"""A factor common to all stiffnesses, invisible in residuals, is compared with the robot file."""

import numpy as np
import pytest
import report_sample

from pipeline.answer.contract import CommonFactor
from pipeline.check.contradictions import common_factor, told_factor
from pipeline.machine.robot import load
from pipeline.run import campaign_answer
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory

KR500 = load("kr500_rail")
RANGED = load("kr210_r2700_2")
SEED = 20261123


def said_of(factors, robot=KR500, of=lambda joint: joint.typical_stiffness, std=0.01):
    """Message for joints that are these multiples of the stiffness in the file."""
    one = report_sample.answer().stiffness[0]
    joints = []
    for k, joint in enumerate(robot.joints):
        value = factors[k] * of(joint) if k < len(factors) else None
        known = {"value": value, "std": value and std * value, "identifiable": value is not None}
        joints.append(one.model_copy(update=known))
    return common_factor(robot, joints)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("factor", "said"),
    [(100.0, "100"), (9.81, "9.8"), (4.448, "4.4"), (2.0, "2.0"), (0.5, "0.50"), (0.102, "0.10")],
)
def test_a_factor_of_two_and_more_is_told_whatever_the_specimen(factor, said):
    """With individual deviations of up to 25 %, the factor is within its interval."""
    rng = np.random.default_rng(SEED)
    own = rng.uniform(0.75, 1.25, (200, 7))
    found = [said_of(factor * each) for each in own]

    assert None not in found
    inside = [one.ci95[0] < factor < one.ci95[1] for one in found]
    assert np.mean(inside) > 0.9
    assert f"about {said} times" in told_factor(said_of([factor] * 7))[0]


def test_the_sentence_has_the_factor_and_its_interval_from_low_to_high():
    """In the order in which they are read."""
    fact = CommonFactor(value=2.0, ci95=(1.8, 2.3), joints=7, probability=0.999)

    assert told_factor(fact)[0].startswith("The stiffnesses are about 2.0 times (1.8 to 2.3) those")


def test_another_specimen_is_no_other_unit():
    """Robots of a type differ by tens of per cent, and one joint may be unlike the others."""
    rng = np.random.default_rng(SEED)
    own = rng.uniform(0.75, 1.25, (300, 7))

    assert [said_of(each) for each in own] == [None] * 300
    for factors in ((0.7, 1.0, 1.4), (0.8, 1.1, 5.0), (0.69, 0.7, 0.7), (1, 1, 1, 1, 1, 1, 30)):
        assert said_of(factors) is None


def test_one_joint_and_what_the_file_does_not_state_tell_nothing():
    """Nor what the campaign does not determine."""
    assert said_of([9.81]) is None
    assert said_of([9.81] * 6, load("fanuc_r2000ic")) is None
    assert told_factor(None) == []


def test_a_joint_that_is_hardly_known_counts_little():
    """The rail at ten times its stiffness, uncertain by its own size, changes nothing."""
    one = report_sample.answer().stiffness[0]
    values = np.array([30.0, *[3.0] * 6]) * [joint.stiffness for joint in KR500.joints]
    wide = [1.5, *[0.01] * 6]
    joints = [
        one.model_copy(update={"value": v, "std": w * v, "identifiable": True})
        for v, w in zip(values.tolist(), wide, strict=True)
    ]

    assert common_factor(KR500, joints).value == pytest.approx(3.0, rel=0.02)


def test_a_range_counts_from_its_nearer_end():
    """Within it nothing is reported, beyond it the ratio to its end."""
    lower, upper = (lambda joint, end=end: joint.stiffness_range[end] for end in (0, 1))

    for factors in ([1.0] * 6, [0.3] * 6):
        assert said_of(factors, RANGED, upper) is None
    assert said_of([3.0] * 6, RANGED, upper).value == pytest.approx(3.0)
    assert said_of([1 / 3] * 6, RANGED, lower).value == pytest.approx(1 / 3)


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(("factor", "told"), [(2.5, True), (1.0, False), (30.0, True)])
def test_forces_written_too_large_are_told_on_the_first_screen(factor, told):
    """If no unit explains the factor, the answer reports it as a fact and as a sentence."""
    files = dict(simulate(Plan(name="many", seed=SEED, poses={"count": 8})).files)
    head, *rows = files["loads.csv"].decode().splitlines()
    at = head.split(",").index("force_n")
    cells = [row.split(",") for row in rows]
    for row in cells:
        row[at] = f"{factor * float(row[at]):.4f}"
    files["loads.csv"] = "\n".join([head, *(",".join(row) for row in cells)]).encode()
    found = campaign_answer("many", in_memory(files)).answer
    fact = found.common_factor

    assert (fact is not None) is told
    if fact is not None:
        assert fact.ci95[0] < factor < fact.ci95[1]
        assert told_factor(fact)[0] in found.verdict_sentence
        assert told_factor(fact)[0] in found.findings
        assert "common_factor" in found.as_json()
    else:
        assert "common_factor" not in found.as_json()
