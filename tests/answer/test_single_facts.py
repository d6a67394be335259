"""Single facts of an answer: largest force, worst point, strongest pull, growth, lines of sight."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
import report_sample
from small_case import small

from bench.as_pinocchio import model
from pipeline.answer.archive import look_of
from pipeline.answer.conformity import _path, largest_force
from pipeline.answer.contract import BaseResiduals, Growth, Tip, Tolerance
from pipeline.answer.contradictions import overload_entry
from pipeline.answer.inputs import growth_findings, shot_findings
from pipeline.machine.effect import Pulls
from pipeline.machine.robot import load
from pipeline.machine.surroundings import Surrounded
from pipeline.prediction.decision import Decision, decide


def test_the_largest_force_just_passes():
    """2 mm under 3 kN, known to 0.1 mm: at that force the decision is about to change."""
    asked = Tolerance(deflection_mm=1.0, test_pose=Decision.FAIL, path=None)
    found = largest_force(asked, Tip(deflection_mm=2.0, std_mm=0.1), 3000.0)

    for part, decision in ((0.999, Decision.PASS), (1.001, Decision.UNDECIDED)):
        assert decide(2.0 * part * found / 3000.0, 0.1, 1.0) == decision
    assert largest_force(asked, Tip(deflection_mm=2.0, std_mm=0.7), 3000.0) is None


def test_a_stretch_is_reported_at_its_largest_deflection():
    rows = pd.DataFrame({"pose": [11, 12, 13], "fx_n": 3.0, "fy_n": 4.0, "fz_n": 0.0,
                         "deflection_m": [1e-3, 3e-3, 2e-3], "std_m": [1e-4, 3e-4, 2e-4],
                         "decision": [Decision.PASS] * 3})  # fmt: skip
    (one,) = _path("part.csv", rows).stretches

    assert (one.first, one.at, one.last, one.points) == (11, 12, 13, 3)
    assert (one.deflection_mm, one.std_mm) == pytest.approx((3.0, 0.3))


def test_a_look_quotes_the_worst_decision():
    """The test pose passes, and the path does not."""

    def passed(content):
        content["tolerance"]["test_pose"] = "pass"
        content["tolerance"]["path"] = report_sample._judged()

    answer = report_sample.revised(report_sample.answer(), passed)
    assert look_of(lambda _, facts: facts, {}, answer)["tolerance"] == "fail"


def test_an_overload_is_that_of_the_strongest_pull():
    robot = load("kr500_rail")
    pulls = Pulls.at(np.zeros((3, robot.n)), np.diag([3e3, -9e4, 2e3]))
    pulls = replace(pulls, repeat=np.array([1, 4, 2]))

    found = overload_entry(robot, pulls)
    assert (found.pose, found.repeat, found.force_n) == (2, 4, 9e4)
    assert found.times == pytest.approx(9e4 / 9.80665 / robot.payload_kg, rel=1e-3)


@pytest.mark.parametrize(("expected_std", "sentences"), [(1e-6, 1), (5e-5, 0)])
def test_a_growth_is_contradicted_beyond_both_uncertainties(expected_std, sentences):
    """Of the thermometer, too: 0.05 mm per metre are much or little."""
    growth = Growth(value=1e-4, std=1e-6, expected=5e-5, expected_std=expected_std, seen=1e-4,
                    seen_std=1e-6, probability=1.0)  # fmt: skip
    fits = BaseResiduals(rms_mm=0.0, max_mm=0.0, chi2=1.0, dof=3, p_value=0.5,
                         rotation_std_rad=(0.0, 0.0, 0.0), translation_std_m=(0.0, 0.0, 0.0),
                         growth=growth)  # fmt: skip

    assert len(growth_findings(fits)) == sentences


@pytest.mark.parametrize(("side", "sentences"), [(1, 0), (-1, 1)])
def test_a_reflector_that_faces_the_tracker_is_shot(side, sentences):
    """Its direction by Pinocchio; one that faces away is reported, with the angle."""
    case, tracker = small(3), np.array([5.0, 7.5, 1.2])
    name = str(case.tool.targets[0])
    q = (case.robot.lower + case.robot.upper) / 2
    built = model(case.robot, {"at": case.tool.named[name]})
    data = built.createData()
    pin.framesForwardKinematics(built, data, q)
    frame = data.oMf[built.getFrameId("at")]
    faces = side * frame.rotation.T @ (tracker - frame.translation)
    stated = Surrounded.model_validate(
        {
            "cell": {"tracker_m": tracker.tolist()},
            "tool.acceptance": {name: {"direction": faces.tolist(), "half_angle_deg": 5.0}},
        }
    )
    update = {"cell": stated.cell, "tool_acceptance": stated.tool_acceptance}
    case = replace(case, settings=case.settings.model_copy(update=update))

    found = shot_findings(case, Pulls.at(q, np.zeros(3)))
    assert len(found) == sentences
    assert all(f"{name} was measured from up to 180.0 deg off" in one for one in found)
