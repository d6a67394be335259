"""Sentences of the answer, each made from the facts that it states."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import report_sample

from pipeline.annex.sections.stiffness import remark_sentences
from pipeline.answer.conformity import (
    causes_differ,
    compared,
    expanded,
    largest_force,
    tolerated,
)
from pipeline.answer.contract import (
    JudgedPath,
    Odd,
    PosePart,
    Reason,
    Remark,
    Stretch,
    TestPose,
    Tip,
    Tolerance,
)
from pipeline.answer.remarks import stiffness_text
from pipeline.answer.sentences import (
    _next,
    _of_robot,
    _of_springs,
    _out,
    _to_do,
    _uncalibrated,
    _without,
    _wrong,
    joint_to_pull,
)
from pipeline.answer.words import correct, drifted, mistaken, noise_told, wrong
from pipeline.diagnosis.bounds import Bounds
from pipeline.diagnosis.facts import (
    CrossValidation,
    EffectSize,
    Facts,
    FoundCause,
    UnloadedFacts,
)
from pipeline.diagnosis.verdict import verdict
from pipeline.faults.mistake import outlying
from pipeline.machine.effects import base_moved, tracker_drift
from pipeline.machine.robot import load
from pipeline.machine.robot.dh_parameters import dh_parameters
from pipeline.positions.catalogue_causes import OTHER_MASSES, CatalogueCause
from pipeline.positions.facts import _listed
from pipeline.prediction.decision import Decision
from pipeline.report.certificate import _by_tolerance


def path(*parts):
    """A path of stretches: decision, first and last pose, largest deflection [mm]."""
    stretches = tuple(
        Stretch(
            deflection_mm=mm,
            std_mm=0.02,
            decision=decision,
            first=first,
            last=last,
            points=last - first + 1,
            at=last,
        )
        for decision, first, last, mm in parts
    )
    points = sum(one.points for one in stretches)
    return JudgedPath(
        file="part.csv",
        points=points,
        force_n=(250.0, 900.0),
        decision=Decision.FAIL,
        stretches=stretches,
    )


def test_few_stretches_are_told_and_many_are_counted():
    """An engineer reads four stretches; of forty the numbers of points."""
    good, bad = Decision.PASS, Decision.FAIL
    few = path((good, 1, 4, 0.1), (bad, 5, 5, 0.41))
    many = path(*((bad if k % 2 else good, 2 * k, 2 * k + 1, 0.1 * k) for k in range(6)))

    said = tolerated(Tolerance(deflection_mm=0.25, test_pose=good, path=few))
    assert said == (
        "campaign.toml allows a deflection of 0.25 mm; decision rule of ISO 14253-1, guard "
        "band 1.65 u. Test pose: pass. part.csv: pass at poses 1 to 4 and fail at pose 5; at pose "
        "5 up to 0.410 mm, U = 0.040 mm (k = 2): 0.410 - 1.65 × 0.020 = 0.377 mm is above 0.25 mm."
    )
    said = tolerated(Tolerance(deflection_mm=0.25, test_pose=None, path=many))
    assert "Test pose" not in said
    assert "of 12 points 6 pass and 6 fail" in said


@pytest.mark.parametrize(
    ("d", "u", "decision", "said"),
    [
        (2.22043, 0.06061, "fail", "2.2204 - 1.65 × 0.0606 = 2.1204 mm is above 2.12 mm"),
        (2.0, 0.05, "pass", "2.000 + 1.65 × 0.050 = 2.083 mm is at most 2.12 mm"),
        (
            2.1,
            0.0612,
            "undecided",
            "2.100 ± 1.65 × 0.061 is 1.999 mm to 2.201 mm, on both sides of 2.12 mm",
        ),
        (2.5, 0.0612, "undecided", "the possible causes decide differently"),
        (2.5, None, "undecided", ""),
    ],
)
def test_a_decision_is_stated_with_its_guard_band(d, u, decision, said):
    """In digits that show it: 2.220 - 1.65 × 0.061 would be 2.119 mm, and no failure."""
    one, asked = Tip(deflection_mm=d, std_mm=u), Decision(decision)
    tolerance = Tolerance(deflection_mm=2.12, test_pose=asked, path=None)
    coarse = compared(Tip(deflection_mm=2000.0, std_mm=151.0), Decision.PASS, 2500.0)

    assert coarse == "2000 + 1.65 × 151 = 2249 mm is at most 2500 mm"
    assert compared(one, asked, 2.12) == said
    assert causes_differ(tolerance, one) == ("causes" in said)
    assert "does not explain" in compared(one, asked, 2.12, holds=False)


def test_no_decision_is_printed_of_a_model_that_does_not_explain_the_readings():
    """One sentence that says why, and nothing to do about the force."""
    asked = Tolerance(deflection_mm=0.25, test_pose=Decision.UNDECIDED, path=None)
    found, stated = (
        SimpleNamespace(row=SimpleNamespace(reason=Reason.UNEXPLAINED)),
        SimpleNamespace(
            tolerance=asked,
            pose=TestPose(deflection_mm=0.1, std_mm=0.1, axes=(), force_n=(0, 0, 1.0), stated=True),
        ),
    )
    said = tolerated(asked, holds=False)

    assert said == (
        "campaign.toml allows a deflection of 0.25 mm; conformity is undecided, since the model "
        "does not explain the readings."
    )
    assert not [*_out(found, stated)]
    found.row.reason = Reason.ADEQUATE
    assert next(_out(found, stated)).startswith("Conformity with the tolerance is undecided")


@pytest.mark.parametrize("source", ["tracker", "held_out"])
def test_more_pulls_are_advised_only_where_they_lower_the_uncertainty(source):
    """U is never below the cross-validation error, on the first screen and on the certificate."""
    asked = Tolerance(deflection_mm=0.25, test_pose=Decision.UNDECIDED, path=None)
    found = SimpleNamespace(row=SimpleNamespace(reason=Reason.ADEQUATE))
    pose = TestPose(
        deflection_mm=0.24, std_mm=0.1, axes=(), force_n=(0, 0, 1.0), stated=True,
        budget=(PosePart(source=source, std_mm=0.1),),
    )  # fmt: skip
    said = " ".join(_out(found, SimpleNamespace(tolerance=asked, pose=pose)))
    answer = report_sample.answer().model_copy(update={"tolerance": asked, "test_pose": pose})

    assert ("measure more" in said) == (source == "tracker")
    assert ("more pulls would not lower U" in said) == (source == "held_out")
    assert ("measure more" in " ".join(_by_tolerance(answer))) == (source == "tracker")


def test_a_reading_that_is_left_out_is_said_to_be():
    """Its true value, once in the file, still moves the values; exchanged rows are corrected."""
    left = outlying("", "", "", name="outlier", before=0.0, correct=same)
    swapped = outlying("", "", "", name="exchanged", before=0.0, correct=same)

    assert "not replaced" in " ".join(_without(SimpleNamespace(mistakes=(swapped, left))))
    assert not [*_without(SimpleNamespace(mistakes=(swapped,)))]


@pytest.mark.parametrize(
    ("deflection", "decision", "force"),
    [(2.0, Decision.FAIL, 0.8 / 2.0 * 1000), (0.85, Decision.UNDECIDED, 0.8 / 0.85 * 1000)],
)
def test_the_force_that_would_pass_is_said(deflection, decision, force):
    """T = 0.965 mm with u = 0.1 mm leaves 0.8 mm, in proportion to 1 kN."""
    asked = Tolerance(deflection_mm=0.965, test_pose=decision, path=None)
    tip = Tip(deflection_mm=deflection, std_mm=0.1)

    assert largest_force(asked, tip, 1000.0) == pytest.approx(force)
    assert largest_force(asked.model_copy(update={"test_pose": Decision.PASS}), tip, 1e3) is None
    assert largest_force(asked, tip.model_copy(update={"std_mm": 0.75}), 1e3) is None


@pytest.mark.parametrize(
    ("gain", "body", "value", "said"),
    [
        (0.0, [-1, -1], 3e6, True),
        (0.002, [-1, -1], 3e6, False),
        (0.0, [0, 1], 3e6, False),  # weights need no scale
        (0.0, [-1, -1], None, False),
    ],
)
def test_uncertainties_without_the_calibration_of_the_scale_say_so(gain, body, value, said):
    """A gain is in no residual: who does not state it reads too small an uncertainty."""
    data = SimpleNamespace(body=np.array(body), scale=SimpleNamespace(gain_sigma=gain))
    found = SimpleNamespace(right=SimpleNamespace(data=data))
    stated = SimpleNamespace(mine=SimpleNamespace(stiffness=[SimpleNamespace(value=value)]))

    assert bool(list(_uncalibrated(found, stated))) == said


def test_what_nobody_knows_has_no_expanded_uncertainty():
    """A stiffness that is not determined acts there."""
    said = expanded(Tip(deflection_mm=0.4, std_mm=None))

    assert said.startswith("0.400 mm, with unknown uncertainty")
    assert expanded(Tip(deflection_mm=0.4231, std_mm=0.0331)) == "0.423 mm, U = 0.066 mm (k = 2)"


def test_further_mistakes_are_told_with_file_and_line():
    """What and where of three, the others counted."""

    def same(case):
        return case

    mistakes = tuple(
        outlying(f"g{k}/P1", f"row {k} is off", "", before=0.0, correct=same, at=(f"t:{k}",))
        for k in range(7)
    )

    told = mistaken(Facts(mistakes=mistakes))

    each = ", ".join(f"outlying reading at g{k}/P1 (t:{k})" for k in (1, 2, 3))
    assert f"row 0 is off; 6 more errors were found: {each} and 3 more." in told


@pytest.mark.parametrize(
    ("moved", "data", "model", "decision", "said"),
    [
        (0.76, "as_given", "extended", None, "What would tell which cause it is: the base again."),
        (1.0, "as_given", "extended", Decision.PASS, "No question is open. Optional: "),
        (1.0, "as_given", "extended", Decision.UNDECIDED, "Optional: "),
        (1.0, "corrected", "joint_springs", None, "Optional: "),
    ],
)
def test_no_question_is_open_only_where_the_verdict_has_none(moved, data, model, decision, said):
    """A cause of the unloaded reflectors is uncertain; it is certain; a file is to be corrected.

    And a tolerance that is undecided is a question.
    """
    cause = SimpleNamespace(
        probability=moved, twins=(), effect=SimpleNamespace(since=True, called="it"), rivals=()
    )
    wrong = (outlying("", "", "", name="unit_mixup", before=0.0, correct=same),)
    facts = Facts(moved=(cause,), mistakes=wrong if data == "corrected" else ())
    joint = report_sample.answer().stiffness[0].model_copy(update={"value": 8e7, "axis": "E1"})
    own = SimpleNamespace(needs="the base again", rivals=(), twins=(), probability=moved)
    diagnosis = SimpleNamespace(best_pose=None, next_poses=(), next_poses_in=None, causes=[own])
    found = SimpleNamespace(
        facts=facts,
        mistakes=facts.mistakes,
        row=SimpleNamespace(reason=Reason.WEIGHED_ANEW, model=model),
    )
    diagnosis.verdict = verdict(facts)
    asked = decision and Tolerance(deflection_mm=0.25, test_pose=decision, path=None)
    own = SimpleNamespace(stiffness=[joint])
    stated = SimpleNamespace(diagnosis=diagnosis, mine=own, tolerance=asked)

    assert _next(found, stated).startswith(said)
    assert (_of_robot(found).do.startswith("Find out first")) == (moved < 0.95)


def test_beside_what_was_not_measured_nothing_is_judged():
    """A dead sensor explains every finding of the data that it spoilt."""
    lost = outlying("", "the sensor was dead", "", name="dead_sensor", before=0.0, correct=same)
    facts = Facts(mistakes=(replace(lost, hopeless=True),), bounds=Bounds(determined=False))
    diagnosis = SimpleNamespace(next_poses=("one",), causes=(), blind_spots=())
    found, stated = SimpleNamespace(facts=facts), SimpleNamespace(diagnosis=diagnosis)
    stated.contradicted = ["The stiffnesses are 140 times those of the robot file."]

    (said,) = _wrong(found, stated)
    assert said == "The error in the data that the verdict names; nothing else can be judged."
    assert _next(found, stated) == "What was not measured."
    assert "No stiffness is determined" in wrong(facts, 0)


def noise(name, value):
    """A cause of scatter as in the answer."""
    one = SimpleNamespace(name="s_tracker", value=value)
    return SimpleNamespace(name=name, parameters=[one])


def test_noise_that_is_a_cause_is_said_and_nothing_else_is():
    """The first screen does not say that nothing was detected of what it lists as a cause."""
    (said,) = noise_told([noise("tracker_noise", 0.5425)])

    assert said == (
        "The readings of the tracker scatter 54 % more than stated: the uncertainties include it."
    )
    assert wrong(Facts(), 0, [said]) == "Nothing else detectable in these readings."


def test_tails_of_one_target_are_said_with_its_name():
    """The reader looks at one nest, not at all single readings."""
    entry = SimpleNamespace(name="s_target", value=4.8)
    (said,) = noise_told([SimpleNamespace(name="heavy_tails", where="P2", parameters=[entry])])

    assert said.startswith("The readings of P2 scatter some 5 times as much as those of the other")


@pytest.mark.parametrize(("miss", "off"), [(3.7e-4, True), (3.1e-5, False)])
def test_unloaded_positions_that_are_off_are_said_beside_the_displacements(miss, off):
    """0.37 mm rms at a noise of 0.03 mm: a ripple of an encoder, or waves of the rail."""
    facts = Facts(unloaded=UnloadedFacts(miss, miss, {}, noise_m=3e-5, usual_m=3e-4))
    said = wrong(facts, 0)

    assert said.startswith(
        "Nothing detectable in the displacements under load. Unloaded, the reflectors are 0.37 mm "
        "rms from where the nominal DH parameters place them (base and tool fitted), 12 times"
        if off
        else "Nothing detectable in these readings."
    )


def test_tables_that_disagree_beside_mistakes_are_no_other_robot():
    """Shuffled positions leave an estimate that the pulls contradict: one robot all the same."""
    agreement = SimpleNamespace(table_p=1e-6, p=1.0)
    facts = Facts(unloaded=UnloadedFacts(1e-4, 1e-4, {}), agreement=agreement)
    beside = replace(facts, mistakes=(outlying("", "x", "", before=0.0, correct=same),))

    assert "not of one robot" in wrong(facts, 0)
    assert "not of one robot" not in wrong(beside, 0)
    assert "not completely corrected" in wrong(beside, 0)


def same(case):
    """Nothing is corrected."""
    return case


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("outlier",), "Check that reading against the measurement record"),
        (("outlier", "outlier"), "Check those readings against the measurement record"),
        (("tool_point",), "Measure that point again and correct campaign.toml"),
        (("unit_mixup",), "Check that against the measurement record"),
        (("outlier", "unit_mixup"), "Check that against the measurement record"),
    ],
)
def test_what_to_do_about_a_mistake_depends_on_what_is_wrong(names, said):
    """A reading is looked up or read again, a point is measured, a unit is corrected."""
    wrong_data = [
        outlying("here", "wrong", "right", name=name, before=9.0, correct=same) for name in names
    ]
    facts = Facts(mistakes=tuple(wrong_data))

    assert correct(facts).startswith(said)
    assert correct(facts).endswith("run the campaign once more. Until then")


@pytest.mark.parametrize(
    ("open_", "mistake", "holds", "value", "asked"),
    [
        (False, "", True, 8e7, True),
        (True, "", True, None, False),
        (False, "outlier", True, 8e7, False),
        (False, "tool_point", True, 8e7, False),
        (False, "unit_mixup", True, 8e7, True),
        (False, "outlier", True, None, True),
        (False, "", False, None, False),
    ],
)
def test_a_joint_is_pulled_where_nothing_is_to_be_measured_before(
    open_, mistake, holds, value, asked
):
    """A cause in question, a doubted reading or point and what no model explains come first."""
    joint = report_sample.answer().stiffness[0].model_copy(update={"value": value})
    diagnosis = SimpleNamespace(next_poses=("one",) if open_ else (), causes=(), verdict="adequate")
    row = SimpleNamespace(
        model="joint_springs", reason=SimpleNamespace(holds_for_its_readings=holds)
    )
    wrong_data = (
        (outlying("here", "wrong", "right", name=mistake, before=9.0, correct=same),)
        if mistake
        else ()
    )
    found = SimpleNamespace(mistakes=wrong_data, row=row)

    assert (joint_to_pull(found, diagnosis, [joint]) is joint) == asked


def test_joints_share_a_remark_only_if_all_of_its_words_hold_for_each():
    """What to do depends on whether a joint slides or turns, and a compliance is each joint's."""
    rail, first, second = report_sample.answer().stiffness[:3]

    def said(odd, *joints):
        remark = {"remarks": (Remark(odd=odd),)}
        return remark_sentences(joint.model_copy(update=remark) for joint in joints)

    alone, both = said(Odd.NO_LEVER, rail, first, second)
    assert alone.startswith(f"{rail.called} is not identifiable: ")
    assert both.startswith(f"Each of {first.called} and {second.called} is not identifiable: ")
    assert "part along the joint" in alone
    assert "torque on the joint" in both
    each = said(Odd.MAY_BE_ZERO, first, second)
    assert [one.partition(" has")[0] for one in each] == [first.called, second.called]


@pytest.mark.parametrize(
    ("off", "said"),
    [
        ({}, "The robot's DH parameters deviate a little from nominal, none certainly by itself:"),
        (
            {"joint_offset:4": 2e-4},
            "Of the robot's DH parameters the zero of joint 4 (A3) (0.20 mrad) deviates from "
            "nominal, the others by no more than their uncertainty explains:",
        ),
        (
            {"link_length:3": -1e-3, "joint_offset:4": 2e-4},
            "Of the robot's DH parameters the length of joint 3 (A2) (-1.0 mm) and the zero of "
            "joint 4 (A3) (0.20 mrad) deviate from nominal,",
        ),
        (None, "Many of the robot's DH parameters deviate a little from nominal, none far more"),
    ],
)
def test_what_deviates_in_a_rough_table_is_named(off, said):
    """Entries beyond three standard uncertainties, if these are few; std is 0.02 mm or mrad."""
    robot = load("kr500_rail")
    every = dh_parameters(robot)
    mean = np.array([3e-4 if off is None else off.get(one.label, 4e-5) for one in every])
    at = SimpleNamespace(table=slice(0, len(every)))
    zeros = SimpleNamespace(robot=robot, columns=at, weighs=False)
    cells = SimpleNamespace(zeros=zeros, mean=mean, covariance=np.eye(len(every)) * 2e-5**2)
    gain = CrossValidation(np.full(3, 1e-3), np.full(3, 1e-5), 0.99, (0.9, 1.0), ())
    facts = Facts(unloaded=UnloadedFacts(1e-3, 1e-5, {}, cells=cells, gain=gain, rough=True))

    assert wrong(facts, 0).startswith(said)


@pytest.mark.parametrize(
    ("form", "values", "said"),
    [
        ("warm-up", (3e-4, 0.0, -4e-4), "0.43 mm in 2.0 h, settling with a time constant of 1 h; "),
        ("steady", (3e-9, 0.0, 4e-9), "0.036 mm in 2.0 h, steadily; "),
    ],
)
def test_a_drift_is_told_with_its_size_and_its_hours(form, values, said):
    """0.5 mm (1 - e^-2), and 5 nm/s for two hours; none without times."""
    drifts = [one for one in tracker_drift.effects(load("kr500_rail")) if one.form == form]
    sizes = tuple(
        EffectSize.symmetric(p, v, 1e-6) for p, v in zip(drifts[0].parameters, values, strict=True)
    )
    base = SimpleNamespace(effect=drifts[0], hours=2.0)

    assert drifted(FoundCause(drifts[0], 1.0, sizes, 0.0), base) == said
    by_order = tracker_drift.by_order(drifts)
    assert not any(drifted(FoundCause(one, 1.0, sizes, 0.0), base) for one in by_order)


def test_each_component_of_a_motion_is_called_by_its_axis():
    """Millimetres and milliradians of one motion, each along or about its axis."""
    moved = base_moved.since((1, 2), 3)
    values = (-5.8e-3, 1e-4, 0.0, 0.0, 0.0, -4e-4)
    sizes = [
        EffectSize.symmetric(p, v, 2e-5) for p, v in zip(moved.parameters, values, strict=True)
    ]
    rigid = FoundCause(moved, 1.0, tuple(sizes), 0.0)
    facts = Facts(moved=(rigid,), unloaded=UnloadedFacts(2e-3, 3e-5, {}))

    said = wrong(facts, 0)

    assert "(along x -5.800 ± 0.020 mm, along y 0.100 ± 0.020 mm, along z " in said
    assert "about z -0.400 ± 0.020 mrad)" in said


def test_links_of_other_masses_have_a_sentence_without_a_drift():
    """Their moments are those of the arm: the effect has no parameter of its own."""
    robot = load("kr500_rail")
    cause = CatalogueCause("gravity_sag", None, OTHER_MASSES, ())

    assert drifted(_listed(cause, robot), None) == ""


@pytest.mark.parametrize(
    ("tails", "said"),
    [
        (False, ", but their scatter exceeds the noise that is assumed by a factor of 2.00 "
                "(p = 0.0025): multiply every uncertainty by it."),
        (True, ", though even noise with such tails rarely leaves so much (p = 0.0025)."),
    ],
)  # fmt: skip
def test_no_uncertainty_is_multiplied_by_tails_that_it_includes(tails, said):
    """Chi-squared of readings far off says nothing of the others, which they weigh less than."""
    left = SimpleNamespace(
        dof=100, chi2=400.0, p_value=0.0025, goodness=SimpleNamespace(tails=tails)
    )

    assert _of_springs(left, False) == f"Joint springs explain the readings{said}"


@pytest.mark.parametrize(
    ("limits", "said"),
    [((2.17e8, None), "above 0.22 GN/m (95 %)"), ((1.0e9, 2.0e9), "1.31 ± 0.34 GN/m")],
)
def test_a_stiffness_that_may_be_rigid_is_a_lower_limit(limits, said):
    """Beside a symmetric ± of three times the value nobody would know how stiff it is at least."""
    one = SimpleNamespace(value=1.31e9, std=0.34e9, ci95=limits)

    assert stiffness_text(one, "N/m") == said


@pytest.mark.parametrize(("std_mm", "used"), [(0.05, True), (19.0, False)])
def test_stiffnesses_whose_prediction_is_all_uncertainty_are_not_to_be_used(std_mm, used):
    found = SimpleNamespace(
        row=SimpleNamespace(reason=Reason.ADEQUATE, model=None),
        facts=Facts(),
        told=SimpleNamespace(
            model=SimpleNamespace(hypotheses=[SimpleNamespace(beside_springs=())])
        ),
        mistakes=(),
        both=None,
    )
    joint = SimpleNamespace(value=3.8e6, ci95=(3.7e6, 3.9e6), called="A1")
    stated = SimpleNamespace(
        mine=SimpleNamespace(stiffness=[joint]), pose=Tip(deflection_mm=1.0, std_mm=std_mm)
    )
    text = _to_do(found, stated)
    assert ("Use these stiffnesses" in text) == used
    assert ("1 mm, U = 38 mm (k = 2)" in text) != used
