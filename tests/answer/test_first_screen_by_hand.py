"""Lines of the first screen, each from facts whose numbers all differ, as computed by hand."""

from types import SimpleNamespace as Some

import numpy as np
import pytest
import report_sample

from pipeline.answer import remarks, sentences
from pipeline.answer.conformity import causes_differ, compared
from pipeline.answer.contract import (
    AxisValue,
    Combination,
    OneWay,
    PosePart,
    Reason,
    TargetDeflection,
    TestPose,
    Tip,
    Tolerance,
    ToMeasure,
    Which,
)
from pipeline.answer.words import BECAUSE, DO, DO_DESPITE
from pipeline.diagnosis.facts import Facts, UnloadedFacts
from pipeline.diagnosis.finding import Verdict
from pipeline.faults.mistake import outlying
from pipeline.machine.effect import Elastic
from pipeline.machine.effects import catalogue
from pipeline.machine.robot import load
from pipeline.prediction.decision import Decision

SAMPLE = report_sample.answer().stiffness
RAIL = load("kr500_rail")
FORCE = (300.0, -400.0, 1200.0)  # 1300 N
PASS, OPEN, FAIL = Decision.PASS, Decision.UNDECIDED, Decision.FAIL


def same(case):
    """Nothing is corrected."""
    return case


def mistake(name):
    """A mistake in the data."""
    return outlying("here", "row 7 is off", "", name=name, before=0.0, correct=same)


def joint(k, **more):
    """Joint k of the sample, with other entries."""
    axis = ("E1", "A1", "A2", "A3", "A4", "A5", "A6")[k]
    return SAMPLE[k].model_copy(update={"axis": axis} | more)


def estimate(**more):
    """A fit with noise that is stated and explains it."""
    of = {"p_value": 0.4, "chi2": 90.0, "dof": 100, "residual_std_m": 2.3e-5}
    return Some(**of | {"goodness": Some(tails=False)} | more)


def values(left_out_m=np.nan, effects=(), fit=None, hypotheses=1, beside=()):
    """Values of one model as reported."""
    first = Some(effects=[Some(called=one) for one in effects])
    own = Some(
        fitted=Some(estimate=fit or estimate(), data=Some(tracked=True)),
        first=first,
        hypotheses=[first] * hypotheses,
        left_out_m=np.array([left_out_m]),
    )
    handed = Some(beside_springs=[Some(called=one) for one in beside])
    return Some(values=own, model=Some(hypotheses=[handed] * hypotheses))


def results(reason=Reason.ADEQUATE, model=Which.JOINT_SPRINGS, **more):
    """Results of a campaign without mistakes."""
    of = {
        "facts": Facts(),
        "row": Some(reason=reason, model=model),
        "told": values(),
        "springs": values(),
        "campaign": "kr 500",
    }
    found = Some(**of | more)
    found.mistakes = found.facts.mistakes
    return found


MISTAKEN = Facts(mistakes=(mistake("unit_mixup"),))
CORRECTED = UnloadedFacts(
    1e-3, 1e-5, {}, gain=Some(ci95=(0.9, 1.0), reduction=0.9), rough=True, noise_m=1e-5,
    usual_m=1e-3,
)  # fmt: skip


@pytest.mark.parametrize(
    ("model", "facts", "said"),
    [
        (Which.JOINT_SPRINGS, Facts(), []),
        (Which.EXTENDED, Facts(), ["springs"]),
        (Which.AVERAGED, MISTAKEN, ["springs", "data"]),
        (Which.JOINT_SPRINGS, MISTAKEN, ["data"]),
        (Which.JOINT_SPRINGS, Facts(unloaded=CORRECTED), ["table"]),
        (Which.JOINT_SPRINGS, Facts(positions=Facts()), ["table"]),
        (Which.EXTENDED, Facts(positions=Facts()), ["springs"]),
    ],
)
def test_what_the_answer_is_compared_with(model, facts, said):
    """Joint springs where it has causes, data as given beside mistakes, the table as delivered."""
    found = results(model=model, facts=facts)
    assert sentences._other(found, "springs", "data", "table") == said


@pytest.mark.parametrize(
    ("reason", "model", "fit", "effects", "said"),
    [
        (Reason.ADEQUATE, "joint_springs", {}, (), "Joint springs explain the readings."),
        (Reason.ADEQUATE, "joint_springs", {"dof": 1}, (), "Joint springs explain the readings."),
        (
            Reason.ADEQUATE,
            "joint_springs",
            {"dof": 0},
            (),
            "These pulls leave nothing to test the joint stiffness model with.",
        ),
        (
            Reason.ADEQUATE,
            "joint_springs",
            {"p_value": None, "residual_std_m": 3.456e-3},
            (),
            "The joint stiffness model does not fit as well as a tracker measures: 3.456 mm "
            "remain.",
        ),
        (
            Reason.UNEXPLAINED,
            "extended",
            {"p_value": None, "residual_std_m": 3.456e-3},
            (),
            BECAUSE[Reason.UNEXPLAINED],
        ),
        (
            Reason.TOO_SMALL,
            "averaged",
            {"p_value": None, "residual_std_m": 2e-3},
            (),
            "The joint stiffness model does not fit as well as a tracker measures: 2.000 mm "
            "remain.",
        ),
        (
            Reason.TOO_SMALL,
            "averaged",
            {"p_value": 1e-5, "chi2": 169.0},
            (),
            "Joint springs explain the readings, but their scatter exceeds the noise that is "
            "assumed by a factor of 1.30 (p = 1.0 × 10⁻⁵): multiply every uncertainty by it.",
        ),
        (
            Reason.SPRINGS_UNTOUCHED,
            "joint_springs",
            {},
            ("roll", "tilt"),
            "Joint springs and roll and tilt explain the readings.",
        ),
        (
            Reason.SPRINGS_UNTOUCHED,
            "joint_springs",
            {},
            (),
            "Joint springs explain the readings; what else was identified does not change them.",
        ),
        (
            Reason.RIVALS,
            "averaged",
            {},
            ("roll",),
            "Joint springs alone do not explain the readings, and more than one cause may be true.",
        ),
    ],
)
def test_the_verdict_says_whether_the_model_holds(reason, model, fit, effects, said):
    """Springs alone by their fit, the others by the decision."""
    found = results(reason, model, told=values(effects=effects, fit=estimate(**fit)))
    assert sentences._verdict(found) == said
    found.facts, found.mistakes = MISTAKEN, MISTAKEN.mistakes
    found.given = Some(case=Some(readings=None))
    assert sentences._verdict(found) == (
        "The data contain an error: row 7 is off. Your files are unchanged."
    )


def moved(since=False, elastic=False, probability=0.99):
    """A cause of the unloaded reflectors."""
    facets = [one for one in catalogue(RAIL) if isinstance(one, Elastic)][:1] if elastic else []
    effect = Some(since=since, facets=facets, called="it")
    return Some(probability=probability, effect=effect, twins=(), rivals=())


@pytest.mark.parametrize(
    ("error", "without", "model", "positions", "said"),
    [
        (np.nan, 1e-4, "extended", False, "no pose can be predicted from the others"),
        (2.3e-5, 2.3e-5, "extended", False, "0.0230 mm rms per coordinate"),
        (2.3e-5, np.nan, "extended", False, "0.0230 mm rms per coordinate"),
        (2.3e-5, 4.56e-5, "extended", False,
         "0.0230 mm rms per coordinate (0.0456 mm with joint springs alone)"),
        (2.3e-5, 4.56e-5, "joint_springs", True,
         "0.0230 mm rms per coordinate (0.0456 mm with the geometry of the robot file)"),
    ],
)  # fmt: skip
def test_the_cross_validation_error_is_said_beside_that_of_springs_alone(
    error, without, model, positions, said
):
    """In mm, if both differ as printed."""
    facts = Facts(positions=Facts() if positions else None)
    told, springs = values(error), values(without)
    found = results(model=model, facts=facts, told=told, springs=springs)
    of = "cross-validation error" + " of displacements" * positions
    assert sentences._predicted(found) == (f"{of} {said}" if np.isfinite(error) else said)


def pose(deflection=0.4, std=0.05, budget=(), **more):
    """A test pose with 1300 N."""
    at = (AxisValue(name="E1", value=8.5, unit="m"), AxisValue(name="A1", value=-10.5, unit="deg"))
    of = {"axes": at, "force_n": FORCE, "stated": True}
    return TestPose(deflection_mm=deflection, std_mm=std, budget=budget, **of | more)


@pytest.mark.parametrize(
    ("decision", "d", "u", "source", "said"),
    [
        (PASS, 0.2, 0.01, "tracker", ""),
        (None, 0.2, 0.01, "tracker", ""),
        (
            FAIL,
            0.6,
            0.05,
            "tracker",
            "The deflection is out of tolerance without compensation: reduce the force (at the "
            "test pose to about 900 N), choose other poses, or compensate the path.",
        ),
        (
            FAIL,
            0.6,
            0.4,
            "tracker",
            "The deflection is out of tolerance without compensation: reduce the force, choose "
            "other poses, or compensate the path.",
        ),
        (
            OPEN,
            0.5,
            0.06,
            "tracker",
            "Conformity with the tolerance is undecided: reduce the force (at the test pose to "
            "about 1000 N), compensate the path, or measure more.",
        ),
        (
            OPEN,
            0.5,
            0.06,
            "held_out",
            "Conformity with the tolerance is undecided: reduce the force (at the test pose to "
            "about 1000 N) or compensate the path; more pulls would not lower U, which is the "
            "cross-validation error.",
        ),
        (
            OPEN,
            0.2,
            0.01,
            "tracker",
            "Conformity with the tolerance is undecided, since the possible causes decide "
            "differently: reduce the force, compensate the path, or find out first which cause it "
            "is.",
        ),
    ],
)
def test_what_a_tolerance_asks_for(decision, d, u, source, said):
    """0.5 mm: 1300 N (0.5 - 1.65 u) / d, rounded down to two digits."""
    asked = Tolerance(deflection_mm=0.5, test_pose=decision, path=None)
    at = pose(d, u, (PosePart(source=source, std_mm=u),))
    stated = Some(tolerance=asked, pose=at)
    assert " ".join(sentences._out(results(), stated)) == said
    assert not [*sentences._out(results(Reason.UNEXPLAINED), stated)]
    assert not [*sentences._out(results(), Some(tolerance=None, pose=at))]


@pytest.mark.parametrize(
    ("force", "said"),
    [(999.0, "990"), (1000.0, "1000"), (345.6, "340"), (87.9, "87"), (8.79, "8.7")],
)  # fmt: skip
def test_a_force_is_rounded_down_to_two_digits(force, said):
    """So that with it the tolerance is kept."""
    assert sentences._at_most(force) == said


def doing(reason=Reason.ADEQUATE, model=Which.JOINT_SPRINGS, joints=SAMPLE[:2], at=None, **more):
    """What to do."""
    found = results(reason, model, **more)
    return sentences._to_do(found, Some(mine=Some(stiffness=joints), pose=at or pose()))


def test_what_to_do_with_the_values():
    """To measure more, to use them, to enter nothing for an axis that may be rigid."""
    half = joint(2, ci95=(5e6, None))
    beside = (
        " A controller's table of joint stiffnesses has no entry for {}: correct paths and "
        "programs with `pipeline compensate 'kr 500' PATH`, or enter all effective values of the "
        "first page."
    )
    rigid = (
        " Enter no value for A2 (k_theta3): these pulls cannot distinguish it from a rigid axis."
    )
    adequate, averaged = DO[Reason.ADEQUATE], DO[Reason.RIVALS]
    extended, cause = DO[Reason.CAUSE_IDENTIFIED], Reason.CAUSE_IDENTIFIED
    more = (
        "Measure more poses, or pull harder, before these stiffnesses are used: the deflection "
        "that they predict at the test pose is 0.40 mm, U = 0.42 mm (k = 2)."
    )
    rows = [
        (doing(), adequate),
        (
            doing(joints=[SAMPLE[6]]),
            "Measure more before any stiffness is used: none is determined.",
        ),
        (doing(joints=[SAMPLE[6], SAMPLE[0]]), adequate),
        (doing(at=pose(0.4, 0.2)), adequate),
        (doing(at=pose(0.4, 0.21)), more),
        (doing(Reason.UNEXPLAINED, at=pose(0.4, 0.3)), DO[Reason.UNEXPLAINED]),
        (doing(joints=[SAMPLE[0], half]), adequate + rigid),
        (doing(Reason.UNEXPLAINED, joints=[half]), DO[Reason.UNEXPLAINED]),
        (doing(joints=[half.model_copy(update={"value": None}), SAMPLE[0]]), adequate),
        (
            doing(cause, "extended", told=values(beside=("roll", "tilt"))),
            extended + beside.format("roll and tilt"),
        ),
        (
            doing(Reason.UNEXPLAINED, "extended", told=values(beside=("roll",))),
            DO[Reason.UNEXPLAINED],
        ),
        (
            doing(Reason.RIVALS, "averaged", told=values(beside=("roll",), hypotheses=2)),
            averaged + beside.format("causes other than joint springs"),
        ),
        (
            doing(Reason.RIVALS, "averaged", told=values(beside=("roll",))),
            averaged + beside.format("roll"),
        ),
        (
            doing(cause, "extended", told=values(beside=("roll",), hypotheses=2)),
            extended + beside.format("roll"),
        ),
        (doing(cause, "extended"), DO_DESPITE),
        (
            doing(facts=MISTAKEN, reason=Reason.MISTAKE),
            "Check that against the measurement record and correct the file; then run the "
            f"campaign once more. Until then {DO[Reason.MISTAKE]}",
        ),
        (
            doing(facts=Facts(unloaded=CORRECTED)),
            f"{adequate} Where absolute positions matter, correct the robot's geometry, too: "
            "model.toml holds its DH parameters.",
        ),
        (doing(cause, "extended", facts=Facts(unloaded=CORRECTED)), DO_DESPITE),
        (doing(Reason.SPRINGS_UNTOUCHED), adequate),
        (
            doing(
                Reason.SPRINGS_UNTOUCHED,
                facts=Facts(moved=(moved(probability=0.5),)),
            ),
            f"{adequate} What is open does not change them.",
        ),
        (doing(Reason.RIVALS, facts=Facts(moved=(moved(probability=0.5),))), averaged),
    ]  # fmt: skip
    for told, said in rows:
        assert told == said


def stated(joints, springs=None, **more):
    """What the answer says."""
    mine, other = Some(stiffness=joints), Some(stiffness=springs or joints)
    return Some(**{"mine": mine, "springs": other, "together": ()} | more)


@pytest.mark.parametrize(
    ("model", "effects", "count", "said"),
    [
        ("joint_springs", (), 1, "Joint springs alone, one linear spring for each joint"),
        ("joint_springs", ("roll", "tilt"), 1, "Joint springs and roll and tilt"),
        ("extended", ("roll",), 1, "Joint springs and roll"),
        ("extended", (), 1, "Joint springs and what was identified"),
        ("averaged", ("roll",), 7, "The average over 7 models, weighted by their probability"),
    ],
)
def test_whose_values_they_are(model, effects, count, said):
    """The model, and the data."""
    told = values(effects=effects, hypotheses=count)
    found = results(model=model, told=told)
    assert [*sentences._model(found, stated(SAMPLE))] == [f"{said}, from the data as given."]
    found = results(model=model, told=told, facts=MISTAKEN)
    assert next(sentences._model(found, stated(SAMPLE))) == f"{said}, from the corrected data."
    found = results(told=told, model=model, facts=Facts(unloaded=CORRECTED))
    assert [*sentences._model(found, stated(SAMPLE))][1:] == [
        "They belong to the robot's geometry as estimated from the unloaded reflectors, which "
        "model.toml holds."
    ]


def softer(k, factor, sigmas):
    """Joint k, and the same with another stiffness, so many standard uncertainties of it away."""
    mine = joint(k)
    x = mine.compliance / factor
    std = abs(x - mine.compliance) / sigmas
    other = {"value": mine.value * factor, "compliance": x, "compliance_std": std}
    return mine, mine.model_copy(update=other | {"std": 0.01 * mine.value * factor})


def test_the_three_that_move_most_are_named():
    """By the ratio, up or down, if by more than three standard uncertainties."""
    pairs = [
        softer(0, 1.5, 5.0),
        softer(1, 0.5, 4.0),  # by the factor 2: the most
        softer(2, 1.9, 2.9),  # within three standard uncertainties
        softer(3, 0.8, 9.0),
        softer(4, 1.1, 9.0),  # fourth
    ]
    mine, springs = zip(*pairs, strict=True)
    small = [one.model_copy(update={"compliance_std": 1e-3 * one.compliance_std}) for one in mine]
    said = [*sentences._moved(small, springs)]
    a1, e1, a3 = small[1], small[0], small[3]
    parts = [
        f"A1 (k_theta2) changes from {a1.value * 0.5e-6:.3f} ± {a1.value * 0.5e-8:.3f} to ",
        f"E1 ({e1.name}) changes from {e1.value * 1.5e-6:.1f} ± {e1.value * 1.5e-8:.1f} to ",
        f"A3 ({a3.name}) changes from {a3.value * 0.8e-6:.3f} ± {a3.value * 0.8e-8:.3f} to ",
    ]
    assert len(said) == 1
    at = [said[0].find(part) for part in parts]
    assert at == sorted(at)
    assert min(at) == 0
    assert said[0].count("changes") == 3
    for name in ("A2", "A4"):
        assert f"{name} (" not in said[0]
    found = results(model=Which.EXTENDED)
    assert [*sentences._model(found, stated(small, springs))][1:] == [
        f"Compared with joint springs alone, {said[0]}."
    ]
    assert not [*sentences._moved(mine[:1], mine[:1])]


def test_how_far_compliances_lie_apart():
    """In the larger of both standard uncertainties; nowhere if one is unknown."""
    a, b = joint(0), joint(1)
    a = a.model_copy(update={"compliance": 5.0, "compliance_std": 0.5})
    b = b.model_copy(update={"compliance": 3.0, "compliance_std": 0.25})
    nothing = {"compliance": None}
    assert sentences._sigmas(a, b) == sentences._sigmas(b, a) == pytest.approx(4.0)
    assert sentences._sigmas(a.model_copy(update={"compliance_std": None}), b) == pytest.approx(8)
    assert sentences._sigmas(a, b.model_copy(update={"compliance_std": None})) == 0
    assert sentences._sigmas(a.model_copy(update=nothing), b) == 0
    assert sentences._sigmas(a, b.model_copy(update=nothing)) == 0


E1 = joint(0, value=8.1234e7, std=1.6e6, ci95=(7.8e7, 8.5e7))
A1 = joint(1, value=3.8e6, std=1.2e4, ci95=(3.7e6, 3.9e6))
A2 = joint(2, value=9.9e6, std=1.0, ci95=(5.84e6, None))
A3 = joint(3, value=9.9e6, std=1.0, ci95=(None, None), axis=None)
A6 = joint(6)
MIX = Combination(
    of=("a", "b"), weights=(1.0, 0.5), value=1.0, std=0.1, ci95=(0.8, 1.2), unit="m/N", needs=""
)


@pytest.mark.parametrize(
    ("joints", "together", "known", "said"),
    [
        (
            (E1, A1),
            (),
            True,
            "E1 81.2 ± 1.6 MN/m; A1 3.800 ± 0.012 MN·m/rad (± standard uncertainty).",
        ),
        ((E1, A1), (), False, "E1 81.2 MN/m; A1 3.800 MN·m/rad."),
        (
            (A6, A1, A2, A3),
            (MIX, MIX),
            True,
            "A1 3.800 ± 0.012 MN·m/rad (± standard uncertainty). Not determined, leave the "
            "controller's entry as it is: A6 (k_theta7). No value: A2, stiffer than 5.8 MN·m/rad "
            "and k_theta4. Determined together: 2 combinations.",
        ),
        ((A2,), (), True, "No value: A2, stiffer than 5.8 MN·m/rad."),
    ],
)
def test_what_to_enter(joints, together, known, said):
    """With or without uncertainty; what is not determined, and what may be rigid, apart."""
    assert sentences.entered(joints, together, known=known) == said


@pytest.mark.parametrize(
    ("reason", "joints", "together", "said"),
    [
        (Reason.ADEQUATE, (A6,), (MIX,),
         "These pulls determine no stiffness by itself, but 1 combination of compliances."),
        (Reason.ADEQUATE, (A6,), (),
         "These pulls determine no stiffness and no combination of stiffnesses."),
        (Reason.UNEXPLAINED, (A6,), (MIX,),
         "These pulls determine no stiffness by itself, but 1 combination of compliances."),
        (Reason.UNEXPLAINED, (A1,), (), "Enter no value: the model does not explain the readings."),
        (Reason.ADEQUATE, (A1,), (), "A1 3.800 ± 0.012 MN·m/rad (± standard uncertainty)."),
    ],
)  # fmt: skip
def test_what_a_controller_takes(reason, joints, together, said):
    """Values, or why there are none."""
    found = results(reason)
    say = stated(joints, together=together, effective=(E1,))
    assert sentences._for_controller(found, say) == said
    if reason == Reason.UNEXPLAINED:
        found.told = values(beside=("roll",))
        assert sentences._for_controller(found, say) == said


@pytest.mark.parametrize("left_out", [2.345e-5, np.nan])
def test_effective_values_are_given_beside_a_cause(left_out):
    """Without uncertainties, with their own cross-validation error."""
    found = results(Reason.CAUSE_IDENTIFIED, told=values(beside=("roll",)))
    found.effective = Some(left_out_m=np.array([left_out]))
    error = " With them the cross-validation error is 0.0235 mm rms per coordinate."
    if np.isnan(left_out):
        error = ""
    assert sentences._for_controller(found, stated((A1,), effective=(E1,))) == (
        "Effective values, for a table of joint stiffnesses and nothing else: E1 81.2 MN/m."
        f"{error} They are fitted substitutes, and no uncertainty can be stated for them: joint "
        "springs alone do not explain the readings. The stiffnesses of the joints themselves are "
        "in the table of stiffnesses."
    )


def target(name, x, y, z):
    """Deflection of a target."""
    return TargetDeflection(target=name, dx_mm=x, dy_mm=y, dz_mm=z, std_mm=(0.01, 0.01, 0.01))


SMALL, LARGE = target("P1", 0.3, 0.0, -0.4), target("P2", 0.6, 0.0, -0.8)


@pytest.mark.parametrize(
    ("mine", "springs", "said"),
    [
        ((SMALL, LARGE), (LARGE, SMALL),
         ["P2 deflects by 1.00 mm (0.500 mm with joint springs alone)."]),
        ((SMALL, LARGE), (SMALL, target("P2", 0.0, 1.0, 0.0001)), []),
        ((SMALL,), (), []),
        ((), (), []),
        ((SMALL, target("P2", None, 0.0, 0.0)), (LARGE, LARGE), []),
        ((SMALL, target("P2", None, 0.0, 0.0)), (LARGE, target("P2", None, 0.0, 0.0)), []),
    ],
)  # fmt: skip
def test_what_the_model_changes_where_it_moves_most(mine, springs, said):
    """At the target that deflects most; nothing where it is the same or not known."""
    found = results(model=Which.EXTENDED)
    assert [*sentences._changed(mine, springs, found)] == said


def test_the_test_pose_is_said_with_force_and_deflection():
    """1300 N; the vector in F_b; which pose stands in where none is stated."""
    q = RAIL.from_degrees([8.5, -10, 35, 39, 81, 22, -12.5])
    found = results(right=Some(case=Some(robot=RAIL)), where=Some(q=q))
    own = Some(test_pose_deflection=())
    at = "E1 8.500 m, A1 -10.50° under (300.0, -400.0, 1200) N in the base frame F_b (1300 N)."
    for vector, along, directed in (
        ((0.123456, -0.2, 3.0), -0.54321,
         " It is (0.123, -0.200, 3.00) mm in F_b, -0.5432 mm along the force."),
        (None, 0.1, ""),
        ((0.1, 0.2, 0.3), None, ""),
    ):  # fmt: skip
        for known in (True, False):
            one = pose(vector_mm=vector, along_force_mm=along, stated=known)
            (told,) = sentences._test_pose(found, Some(pose=one, mine=own, springs=own))
            stands = (
                " campaign.toml has no [test_pose], so the pose of the largest force is used (q, "
                "the joints of the robot file, not the controller's axes: 8.5, -10, 35, 39, 81, "
                "22, -12.5)."
            )
            assert told == (
                f"The load point deflects by 0.40 mm, U = 0.10 mm (k = 2), at {at}{directed}"
                f"{'' if known else stands}"
            )


def to_measure(**more):
    """A pose to measure."""
    of = {
        "q": (1.25, -30.5), "q_unit": ("m", "deg"), "anchor_m": (1.0, 2.0, 3.0),
        "direction": (0.0, 0.6, -0.8), "force_n": 2987.0, "steps": 3, "approach": None,
    }  # fmt: skip
    return ToMeasure(**of | more)


AT = "joints at (1.250 m, -30.50°), 3 load steps up to 2987 N along (0.00, 0.60, -0.80) of F_b"


@pytest.mark.parametrize(
    ("after", "said"),
    [
        ((5.43,), "The proposed pose: the causes in question are then 5.4 standard deviations "
         f"apart, and 4.6 are enough. It: {AT}."),
        ((4.6,), "The proposed pose: the causes in question are then 4.6 standard deviations "
         f"apart, and 4.6 are enough. It: {AT}."),
        ((4.5,), "The proposed pose will help but not settle it: the causes in question are then "
         f"4.5 standard deviations apart, and 4.6 are needed. It: {AT}."),
        ((1.2, 3.21, None), "The 3 proposed poses will help but not settle it: the causes in "
         "question are then 3.2 standard deviations apart, and 4.6 are needed. Pose 1: "
         f"{AT}."),
    ],
)  # fmt: skip
def test_proposed_poses_say_what_they_settle(after, said):
    """The most separated of them counts; how the first is pulled."""
    poses = [Some(**dict(to_measure()) | {"sigmas_after": one}) for one in after]
    assert sentences._proposed(poses) == said
    diagnosis = Some(next_poses=poses, next_poses_in=None)
    told = sentences._next(results(), Some(diagnosis=diagnosis))
    assert told == f"{said} Collisions and lines of sight were not checked."
    diagnosis.next_poses_in = "cell"
    assert sentences._next(results(), Some(diagnosis=diagnosis)) == said


def best(after, determines=True):
    """The pose that would determine a joint best."""
    axes = (AxisValue(name="E1", value=2.5, unit="m"), AxisValue(name="A1", value=-7.5, unit="deg"))
    one = dict(to_measure(axes=axes, steps=1))
    return Some(relative_std_after=after, determines=determines, **one)


ONE = "E1 2.500 m, A1 -7.500°, 1 load step of 2987 N along (0.00, 0.60, -0.80) of F_b"
LEVER = "ulls with a lever about its axis"


@pytest.mark.parametrize(
    ("worst", "pose_", "checked", "said"),
    [
        (
            joint(1, relative_std=0.123),
            best(0.045),
            False,
            f"Optional: p{LEVER} would improve A1 (k_theta2) most. Its standard uncertainty is "
            "12 %. With the pose that the report proposes it is expected to be 4.5 %.",
        ),
        (
            joint(0, relative_std=0.123),
            None,
            False,
            f"Optional: pulls along the rail would improve E1 ({SAMPLE[0].name}) most. Its "
            "standard uncertainty is 12 %.",
        ),
        (
            joint(1, relative_std=0.123),
            best(0.1234),
            False,
            "A1 (k_theta2) is known least well, with a standard uncertainty of 12 %; one more pose "
            "would hardly improve it.",
        ),
        (A6, None, False, f"P{LEVER}: A6 (k_theta7) is not determined."),
        (
            A6,
            best(0.34),
            False,
            f"P{LEVER}: A6 (k_theta7) is not determined. One more pose: {ONE}. With it A6 "
            "(k_theta7) is determined, with a standard uncertainty of about 34 % of its typical "
            "compliance. Collisions and lines of sight were not checked.",
        ),
        (
            A6,
            best(0.78, determines=False),
            True,
            f"P{LEVER}: A6 (k_theta7) is not determined. One more pose: {ONE}. This alone will "
            "not determine it: its standard uncertainty is then 78 % of its typical compliance.",
        ),
    ],
)
def test_which_pull_would_gain_most(worst, pose_, checked, said):
    """What is known, and what one more pose makes of it."""
    diagnosis = Some(best_pose=pose_, next_poses_in="cell" if checked else None)
    assert sentences._least_certain(Some(diagnosis=diagnosis), worst) == said


def after(reason=Reason.ADEQUATE, model="joint_springs", facts=None, joints=(A1,), **more):
    """What to measure next."""
    of = {"next_poses": (), "next_poses_in": None, "best_pose": None, "causes": ()}
    diagnosis = Some(**of | {"verdict": Verdict.ADEQUATE} | more)
    found = results(reason, model, facts=facts or Facts())
    return sentences._next(
        found, Some(diagnosis=diagnosis, mine=Some(stiffness=joints), tolerance=None)
    )


def named(needs="a gyroscope", rivals=(), twins=(), probability=0.99):
    """A cause in the answer."""
    return Some(needs=needs, rivals=rivals, twins=twins, probability=probability)


def test_what_to_measure_next():
    """The first that is wrong is measured first; at last what would improve the worst joint."""
    reading = "The readings in question, if no record shows the correct values."
    lost = f"P{LEVER}: A6 (k_theta7) is not determined."
    optional = f"Optional: p{LEVER} would improve A1 (k_theta2) most. Its standard uncertainty is "
    known = joint(1, relative_std=0.031)
    gross = Facts(unloaded=UnloadedFacts(2.0, 2.0, {}))
    missed = (
        "The poses that are missed most, once more and on another day: this tells the machine from "
        "the readings."
    )
    needs = "What would tell which cause it is: a gyroscope."
    rows = [
        (after(facts=Facts(mistakes=(mistake("outlier"),))), reading),
        (after(facts=Facts(mistakes=(mistake("outlier"),)), joints=(A6,)), f"{reading} {lost}"),
        (
            after(facts=Facts(mistakes=(mistake("tool_point"),))),
            "The point in question, in the flange frame.",
        ),
        (
            after(facts=gross),
            "Nothing until the joint log and the robot file agree with the unloaded reflectors: "
            "the readings taken may then do.",
        ),
        (
            after(Reason.SPRINGS_DISAGREE),
            "A known weight hung from the load point in two of the poses: it tells whether the "
            "scale is wrong or the masses are.",
        ),
        (after(Reason.UNEXPLAINED), missed),
        (after(model="averaged", causes=(named(probability=0.9),)), needs),
        (after(model="averaged", causes=(named(rivals=("x",)),)), needs),
        (after(model="averaged", causes=(named(), named("x", twins=("y",)))),
         "What would tell which cause it is: x."),
        (after(causes=(named(rivals=("x",)),), verdict=Verdict.AMBIGUOUS), needs),
        (after(causes=(named(rivals=("x",)),), joints=(known,)),
         f"No question is open. {optional}3.1 %."),
        (after(model="averaged", causes=(named(None, rivals=("x",)),), joints=(known,)),
         f"No question is open. {optional}3.1 %."),
        (after(model="averaged", causes=(named(),), joints=(known,), verdict=Verdict.BAD_DATA),
         f"{optional}3.1 %."),
        (after(joints=(A6,)), f"No question is open. {lost}"),
        (after(joints=()), "Nothing can be proposed: no stiffness is known."),
    ]  # fmt: skip
    for told, said in rows:
        assert told == said


def one_way(value, turns, ci95=(1.0, 2.0)):
    """The stiffness for one sign of the torque."""
    return OneWay(
        value=value, std=None if value is None else 1e-2 * value, ci95=ci95, compliance=None,
        compliance_std=None, axis_turns=turns,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("positive", "negative", "value_of", "of", "said", "other"),
    [
        (
            ("plus", 2.4e6), ("minus", 1.5e6), "positive", "pull",
            "A3 (k_theta4) is 2.400 ± 0.024 MN·m/rad where the pull turns A3 towards plus, and "
            "1.500 ± 0.015 MN·m/rad where it turns A3 towards minus; at the test pose it turns A3 "
            "towards plus.",
            "1.500 ± 0.030",
        ),
        (
            ("minus", 2.4e6), ("plus", 1.5e6), "positive", "total",
            "A3 (k_theta4) is 1.500 ± 0.015 MN·m/rad where the load with the arm's own weight "
            "turns A3 towards plus, and 2.400 ± 0.024 MN·m/rad where it turns A3 towards minus; at "
            "the test pose it turns A3 towards minus.",
            "1.500 ± 0.030",
        ),
        (
            (None, 2.4e6), (None, None), "negative", "pull",
            "A3 (k_theta4) is 2.400 ± 0.024 MN·m/rad where the pull turns joint 4 in its positive "
            "sense, and not determined where it turns joint 4 in its negative sense; at the test "
            "pose it turns joint 4 in its negative sense.",
            "2.400 ± 0.048",
        ),
    ],
)  # fmt: skip
def test_both_stiffnesses_are_said_by_the_way_the_axis_turns(
    positive, negative, value_of, of, said, other
):
    """Towards plus first, whichever torque that is; at the test pose, and the other way."""
    ways = {
        name: one_way(value, turns)
        for name, (turns, value) in (("positive", positive), ("negative", negative))
    }
    both = Some(of=of, value_of=value_of, **ways)
    one = joint(3, by_sign=both)
    assert remarks.both_stiffnesses(one) == said
    assert remarks.other_way(one, 2.0) == f"; {other} MN·m/rad the other way"
    assert remarks.both_stiffnesses(joint(3)) == remarks.other_way(joint(3)) == ""


def body(mass, std, center, center_std):
    """A payload."""
    return Some(mass_kg=mass, mass_std_kg=std, center_m=center, center_std_m=center_std)


def test_a_contradicted_payload_is_told_with_both_bodies():
    """Mass in kg, centre in mm; only if chance explains it in less than one of 1000."""
    found = body(12.3, 0.4, (0.0123, -0.02, 0.3), (0.001, 0.002, 0.004))
    said = body(20.0, 0.5, (0.0, 0.0, 0.25), (0.01, 0.01, 0.01))
    every = [
        Some(name=name, found=one, stated=said, poses=17, p_value=p)
        for name, one, p in (
            ("gun", found, 0.00042), ("a", found, 0.001), ("b", None, 1e-9), ("c", found, None)
        )
    ]  # fmt: skip
    assert remarks.contradicted(every, "sensors") == [
        "The sensors contradict the payload gun: by 17 poses it has 12.30 ± 0.40 kg at (12.3 ± "
        "1.0, -20.0 ± 2.0, 300.0 ± 4.0) mm, and campaign.toml says 20.00 ± 0.50 kg at (0 ± 10, "
        "0 ± 10, 250 ± 10) mm (p = 0.0004); weigh it, or check how it is mounted."
    ]


def test_what_is_wrong_is_said_with_noise_and_what_was_lost():
    """Noise before "nothing else", after what is wrong; contradictions first, losses last."""
    noisy = Some(name="force_noise", where=None, parameters=[Some(name="s_force", value=0.5)])
    lost = Some(absent=("P3",), readings=0, of=9, poses=())
    given = Some(case=Some(lost=lost))
    diagnosis = Some(causes=[noisy], blind_spots=[])
    scale = "The readings of the scale scatter 50 % more than stated: the uncertainties include it."
    absent = (
        "P3 of naming.measured has no reading that could be used; see Rejected rows for readings "
        "under another name."
    )
    for facts, said in (
        (Facts(), (scale, "Nothing else detectable in these readings.")),
        (
            Facts(detected=True),
            ("Something is missing from the model, and no known cause explains it.", scale),
        ),
    ):
        found = results(facts=facts, given=given)
        told = sentences._wrong(found, Some(contradicted=("x",), diagnosis=diagnosis))
        assert told == ("x", *said, absent)


def test_a_robot_that_is_not_as_its_file_says():
    """Misdescribed before changed before sagging; open while a cause is uncertain."""
    rows = [
        ((moved(),), "on a robot that is not as its file says."),
        ((moved(since=True),), "in which something changed once."),
        ((moved(elastic=True),), "on a robot that sags under its own weight."),
        ((moved(elastic=True), moved(since=True)), "in which something changed once."),
        ((moved(since=True), moved()), "on a robot that is not as its file says."),
        ((moved(probability=0.5),), "but what displaces the unloaded reflectors is uncertain."),
    ]
    for causes, said in rows:
        found = results(Reason.WEIGHED_ANEW, Which.EXTENDED, facts=Facts(moved=causes))
        assert sentences._verdict(found).endswith(said)
        found.row.reason = Reason.RIVALS
        assert sentences._of_robot(found) is None
    found = results(Reason.WEIGHED_ANEW, Which.EXTENDED)
    assert sentences._verdict(found).startswith("Joint springs explain the readings, once the")


def test_the_force_that_would_pass_is_that_of_the_test_pose():
    """Of 0.6 mm at 1300 N, 0.5 mm less the guard band."""
    asked = Tolerance(deflection_mm=0.5, test_pose=FAIL, path=None)
    told = sentences._to_force(Some(tolerance=asked, pose=pose(0.6, 0.1)))
    assert told == " (at the test pose to about 720 N)"
    assert sentences._to_force(Some(tolerance=asked, pose=pose(0.6, 0.4))) == ""
    assert Tip(deflection_mm=0.6, std_mm=0.1).expanded_mm == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("decision", "d", "differ"), [(PASS, 0.6, False), (OPEN, 0.6, True), (OPEN, 0.5, False)]
)
def test_causes_differ_only_where_a_decision_is_open(decision, d, differ):
    """Although d and u decide; at the test pose or anywhere along the path."""
    one, fine = Tip(deflection_mm=d, std_mm=0.01), Tip(deflection_mm=0.1, std_mm=0.01)
    asked = Tolerance(deflection_mm=0.5, test_pose=decision, path=None)
    assert causes_differ(asked, one) == differ
    part = Some(decision=decision, deflection_mm=d, std_mm=0.01)
    along = Some(deflection_mm=0.5, test_pose=PASS, path=Some(stretches=[fine_stretch(), part]))
    assert causes_differ(along, fine) == differ


def fine_stretch():
    """A stretch far within the tolerance."""
    return Some(decision=PASS, deflection_mm=0.1, std_mm=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_printed_limits_are_their_printed_sums_to_the_last_digit(seed):
    """In as few digits as show it: each limit within one of the last place of the exact one."""
    rng = np.random.default_rng(seed)
    for d, u in zip(rng.uniform(0.8, 1.2, 60), 10 ** rng.uniform(-3, -1, 60), strict=True):
        low, high = d - 1.65 * u, d + 1.65 * u
        decision = PASS if high <= 1 else FAIL if low > 1 else OPEN
        shown = compared(Tip(deflection_mm=d, std_mm=u), decision, 1.0).split()
        limits = {PASS: [(6, high)], FAIL: [(6, low)], OPEN: [(6, low), (9, high)]}[decision]
        for at, exact in limits:
            places = len(shown[at].partition(".")[2])
            assert abs(float(shown[at]) - exact) <= 10.0**-places
            assert (float(shown[at]) > 1) == (exact > 1)


def test_the_lines_stand_in_the_order_of_a_reader(monkeypatch):
    """Tolerance first, what to measure last; a line of nothing is left out."""
    for name in ("_verdict", "_predicted", "_to_do", "_for_controller", "_next"):
        monkeypatch.setattr(sentences, name, lambda *_, name=name: name)
    for name in ("_out", "_model", "_uncalibrated", "_test_pose", "_wrong"):
        monkeypatch.setattr(sentences, name, lambda *_, name=name: (name, f"{name}2"))
    monkeypatch.setattr(sentences, "tolerated", lambda asked, pose, holds: f"tolerated {holds}")
    monkeypatch.setattr(sentences, "not_found", lambda spots: spots)
    rows = ((Reason.ADEQUATE, "T", True), (Reason.UNEXPLAINED, "T", False))
    for reason, tolerance, holds in (*rows, (Reason.ADEQUATE, None, True)):  # fmt: skip
        found = results(reason, diagnosis=Some(not_found="not found"))
        lines = sentences.first_screen(found, Some(tolerance=tolerance, pose=None))
        assert [(one.about, one.text) for one in lines] == [
            *([("tolerance", f"tolerated {holds}")] if tolerance else []),
            ("verdict", "_verdict _predicted."),
            ("to_do", "_out _out2 _to_do"),
            ("model", "_model _model2"),
            ("numbers", "_for_controller _uncalibrated _uncalibrated2"),
            ("test_pose", "_test_pose _test_pose2"),
            ("wrong", "_wrong"),
            ("wrong", "_wrong2"),
            *([("not_found", "not found")] if holds else []),
            ("next", "_next"),
        ]


def test_a_scale_beside_weights_is_a_scale():
    """One pull by the chain is enough; so is a campaign of which no load is known."""
    for body, said in (([-1, 0], True), ([0, 0], False), ([], True)):
        data = Some(body=np.array(body), scale=Some(gain_sigma=0.0))
        found = results(right=Some(data=data))
        assert bool([*sentences._uncalibrated(found, stated((A1, A6)))]) == said
