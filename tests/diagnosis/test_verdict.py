"""The verdict: a test for every row of its table, and for relations between subjects."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.answer.diagnosis import cause_entry
from pipeline.answer.words import why, wrong
from pipeline.check.findings import enormous
from pipeline.diagnosis.agreement import SpringAgreement
from pipeline.diagnosis.bounds import Bounds
from pipeline.diagnosis.cause_search import Replacement
from pipeline.diagnosis.causes import missing
from pipeline.diagnosis.diagnose import _refused
from pipeline.diagnosis.facts import (
    NO_UNLOADED,
    CrossValidation,
    EffectSize,
    Facts,
    FoundCause,
    PossibleCause,
    UnloadedFacts,
)
from pipeline.diagnosis.finding import Finding, Verdict
from pipeline.diagnosis.verdict import TABLE, findings, of_both, verdict
from pipeline.machine.effects import catalogue, unlisted
from pipeline.machine.law import parse
from pipeline.machine.robot import load
from pipeline.system.outlying import OutlyingReadings

ROBOT = load("kr500_rail")
EFFECTS = {(effect.label, effect.form): effect for effect in catalogue(ROBOT)}


def effect(label):
    """The first form of an effect."""
    return next(one for (name, _), one in EFFECTS.items() if name == label)


def test_a_cause_has_what_neither_a_stranger_nor_a_misfit_takes():
    """The larger of both is outside the catalogue; cause, rivals and that sum to one."""
    roll, pitch = effect("rail_roll"), effect("rail_pitch")
    one = replace(cause("rail_roll", 0.7), rivals=(PossibleCause(pitch, 0.3),))

    assert (one.outside, one.stated(0.7)) == (0.0, 0.7)
    for stranger, left, outside in ((0.2, 0.0, 0.2), (0.2, 0.9, 0.9), (0.6, 0.5, 0.6)):
        now = replace(one, unnamed=PossibleCause(roll, stranger), missing=left)
        assert now.outside == outside
        told = cause_entry(now)
        every = (told, *told.rivals, told.outside_catalogue)
        assert told.probability == pytest.approx(0.7 * (1 - outside))
        assert sum(one.probability for one in every) == pytest.approx(1.0)

    left = cause_entry(replace(one, missing=0.9)).outside_catalogue
    assert (left.probability, left.looks_like) == (0.9, None)
    assert cause_entry(one).outside_catalogue is None


def test_only_causes_whose_gain_is_uncertain_are_said_to_have_none_for_certain():
    """Each of those that may not reduce the error, beside the one that does."""
    both = (cause("rail_roll"), replace(cause("rail_pitch"), unproven=0.2))
    facts = Facts(detected=True, causes=both, gain=gain(0.6, 0.5), explains=True)

    assert wrong(facts, 0) == (
        "Pitch of the carriage fits, but does not certainly reduce the cross-validation error "
        "beside roll of the carriage about the rail."
    )


@pytest.mark.parametrize(
    ("chances", "explains", "misfit", "expected"),
    [
        ((0.4, 0.6, 0.5), True, 0.2, 0.0),
        ((0.4, 0.6, 0.5), False, 0.5, 0.2),  # o / (o + 1)
        ((1e-3, 0.6, 0.5), False, 0.2, 0.25 / (0.25 + 1e-3 * np.e * np.log(1e3))),
        ((0.4, 1e-9, 0.5), False, 0.2, 1.0),
        ((0.4, 0.6, 1e-8), False, 0.2, 0.99992),  # one in fifty thousand among 50 suspects
        ((0.4, 0.6, 0.5), True, 1e-5, 0.9988),
    ],
)
def test_what_rejects_the_model_with_the_causes_gives_what_is_missing_a_share(
    chances, explains, misfit, expected
):
    """The smallest p of the residuals, at prior odds of one in four; none if no test rejects."""
    poses, pulls, further = chances
    found = SimpleNamespace(
        explains=explains,
        left=further,
        lack=SimpleNamespace(p_poses=poses, p_pulls=pulls),
        threshold=SimpleNamespace(independent=50.0),
    )

    assert missing(found, misfit) == pytest.approx(expected, rel=1e-3, abs=1e-6)


def cause(label, probability=0.99, **more):
    """A cause as the diagnosis returns it."""
    one = effect(label)
    size = tuple(EffectSize.symmetric(p, p.typical, p.typical / 9) for p in one.parameters)
    return FoundCause(one, probability, size, 1e-9, **more)


def test_a_name_that_predicts_nothing_is_a_candidate():
    """Beside another that does: neither verdict nor probability of an identified one."""
    weak = cause("joint_tilt:3", unproven=0.4)
    facts = replace(FOUND, causes=(*FOUND.causes, weak), gain=gain(0.5, 0.4))

    assert verdict(facts) is Verdict.AMBIGUOUS
    assert weak.stated(weak.probability) == pytest.approx(0.6 * 0.99)


def gain(reduction, low):
    """Gain of causes at left-out poses: errors of 1 mm before."""
    before = np.full(6, 1e-3)
    return CrossValidation(before, before * (1 - reduction), reduction, (low, 0.9), ())


def drift(undecided):
    """Result of the base reflectors for a tracker that rotated."""
    return SimpleNamespace(
        effect=effect("tracker_drift"), undecided=undecided, turn=np.array([0, 0, 1e-8]),
        moved_m=4e-4, hours=2.0,
    )  # fmt: skip


KNOCKED = SimpleNamespace(knocked=("first", "last"), moved_m=2.1e-3, grown=None)
GREW = SimpleNamespace(
    knocked=None,
    grown=SimpleNamespace(
        groups=("first", "last"), growth=np.array([0, 8e-5]), std=np.array([0, 3e-6]), length_m=18
    ),
)
ROLL = (cause("rail_roll"),)
FOUND = Facts(detected=True, explains=True, causes=ROLL, gain=gain(0.5, 0.3), remainder=1.0)
STRANGE = PossibleCause(effect("rail_pitch"), 0.6)
MISTAKE = SimpleNamespace(evidence="the reading a/P1 is 9 mm off")
MISPLACED = replace(NO_UNLOADED, miss_m=2e-3, left_m=1e-4)
USELESS = replace(
    MISPLACED, gain=gain(-0.1, -0.3), causes=(SimpleNamespace(effect=ROLL[0].effect),)
)
SINCE = replace(
    USELESS, causes=(SimpleNamespace(effect=replace(ROLL[0].effect, form="since pose 4")),)
)
TILTS = (cause("joint_tilt:5", 0.6, rivals=(PossibleCause(effect("joint_tilt:6"), 0.4),)),)
GEAR = (cause("joint_hardening:3"), cause("joint_lost_motion:3"))

APART = SpringAgreement(40.0, 5, np.ones((6, 2)), np.ones((6, 2)), None)

ROWS = {
    Finding.MISTAKE: (Facts(mistakes=(MISTAKE,)), Verdict.BAD_DATA),
    Finding.TRACKER_MOVED: (Facts(drift=drift(undecided=False)), Verdict.EXPLAINED),
    Finding.TRACKER_MOVED_OR_KNOCKED: (Facts(drift=drift(undecided=True)), Verdict.AMBIGUOUS),
    Finding.TRACKER_KNOCKED: (Facts(base=KNOCKED), Verdict.AMBIGUOUS),
    Finding.BASE_GREW: (Facts(base=GREW), Verdict.EXPLAINED),
    Finding.STANDS_ELSEWHERE: (
        Facts(unloaded=MISPLACED, moved=(cause("joint_offset:3"),)),
        Verdict.EXPLAINED,
    ),
    Finding.STANDS_ELSEWHERE_OR_RIVAL: (
        Facts(unloaded=MISPLACED, moved=(cause("joint_offset:3", 0.9),)),
        Verdict.AMBIGUOUS,
    ),
    Finding.GEOMETRY_REFUTED: (
        Facts(unloaded=replace(MISPLACED, miss_m=0.42, left_m=0.39)),
        Verdict.UNEXPLAINED,
    ),
    Finding.ROUGH_TABLE: (
        Facts(unloaded=replace(MISPLACED, gain=gain(0.9, 0.8), rough=True)),
        Verdict.ADEQUATE,
    ),
    Finding.STANDS_UNEXPLAINED: (
        Facts(unloaded=UnloadedFacts(1e-3, 1.1e-3, {}, noise_m=3e-5, usual_m=3e-4)),
        Verdict.UNEXPLAINED,
    ),
    Finding.TABLES_DISAGREE: (
        Facts(agreement=replace(APART, chi2=0.0, table_p=1e-4)),
        Verdict.UNEXPLAINED,
    ),
    Finding.REFLECTORS_LOOSE: (replace(FOUND, loose_p=1e-6), Verdict.UNEXPLAINED),
    Finding.NO_CAUSE_FITS: (Facts(detected=True), Verdict.UNEXPLAINED),
    Finding.PREDICTS_WORSE: (replace(FOUND, gain=gain(-0.1, -0.5)), Verdict.UNEXPLAINED),
    Finding.UNCONFIRMED: (
        replace(FOUND, gain=gain(0.1, -0.1), scatter_told=False),
        Verdict.UNEXPLAINED,
    ),
    Finding.REMAINDER: (replace(FOUND, explains=False, remainder=2.0), Verdict.UNEXPLAINED),
    Finding.OUTSIDE_CATALOGUE: (replace(FOUND, outside=STRANGE), Verdict.UNEXPLAINED),
    Finding.GAIN_UNCERTAIN: (replace(FOUND, gain=gain(0.1, -0.1)), Verdict.AMBIGUOUS),
    Finding.TWO_LAWS: (replace(FOUND, causes=GEAR), Verdict.AMBIGUOUS),
    Finding.RIVALS: (replace(FOUND, causes=TILTS), Verdict.AMBIGUOUS),
    Finding.OUTSIDE_CATALOGUE_POSSIBLE: (
        replace(FOUND, outside=replace(STRANGE, probability=0.1)),
        Verdict.AMBIGUOUS,
    ),
    Finding.SCALE_SCATTERS: (replace(FOUND, scale_ratio=4.0), Verdict.AMBIGUOUS),
    Finding.BEYOND_CERTIFICATE: (Facts(beyond_certificate=True), Verdict.UNEXPLAINED),
    Finding.OFF_THE_TABLE: (replace(FOUND, unloaded=USELESS), Verdict.UNEXPLAINED),
    Finding.CAUSE_IDENTIFIED: (FOUND, Verdict.EXPLAINED),
    Finding.MISFIT: (Facts(stated_p=1e-5, misfit_p=3e-4), Verdict.UNEXPLAINED),
    Finding.SCATTER: (Facts(scatter=(cause("tracker_noise"),)), Verdict.EXPLAINED),
    Finding.BEYOND_A_TRACKER: (Facts(beyond_a_tracker=True), Verdict.UNEXPLAINED),
    Finding.SPRINGS_DISAGREE: (
        replace(FOUND, agreement=APART),
        Verdict.UNEXPLAINED,
    ),
    Finding.NOTHING: (Facts(), Verdict.ADEQUATE),
    Finding.NOTHING_DETERMINED: (
        replace(FOUND, bounds=Bounds(determined=False)),
        Verdict.UNEXPLAINED,
    ),
    Finding.PREDICTS_NOTHING: (Facts(bounds=Bounds(left=0.26)), Verdict.UNEXPLAINED),
    Finding.BEYOND_NOISE: (
        replace(FOUND, bounds=Bounds(force=11.0, worst_pose=3, worst_target="P1", worst_m=4e-4)),
        Verdict.UNEXPLAINED,
    ),
    Finding.SCATTERED: (
        Facts(bounds=Bounds(far=OutlyingReadings(np.array([4, 2]), np.array([0, 1]), 1e-5))),
        Verdict.UNEXPLAINED,
    ),
}


@pytest.mark.parametrize("finding", ROWS)
def test_each_row_gives_its_verdict_and_a_sentence(finding):
    """The finding alone decides, and its sentence begins and ends as expected."""
    facts, expected = ROWS[finding]

    assert finding in [row.finding for row in findings(facts)]
    assert verdict(facts) is expected
    said = why(facts)
    assert said[0].isupper()
    assert said.endswith(".")
    assert "_" not in said, "a machine's name in a sentence"


def of_joint_5(*laws):
    """A cause that follows one of some laws, each with its share."""
    every = [(unlisted.effect(ROBOT, parse("5", form)), share) for form, share in laws]
    either = tuple(PossibleCause(one, share) for one, share in every)
    return FoundCause(either[0].effect, 1.0, (), 1e-9, either=either)


CREEP, SLIP = "creep smooth time 0 1 0 9 0 False", "slips step torque 5 1 -9 9 4 False"
WAVE = "spring periodic angle 5 {} -9 9 0 False"


@pytest.mark.parametrize(
    ("cause", "expected", "said"),
    [
        (of_joint_5((CREEP, 0.88), (SLIP, 0.12)), Verdict.AMBIGUOUS, "12 %"),
        (of_joint_5((CREEP, 0.96), (SLIP, 0.04)), Verdict.EXPLAINED, "over 99.9 %"),
        (of_joint_5((WAVE.format(2), 0.6), (WAVE.format(6), 0.4)), Verdict.EXPLAINED, "over 99.9"),
    ],
)
def test_laws_of_one_place_that_depend_on_different_things_are_rivals(cause, expected, said):
    """Creep and slip are; waves of different orders predict alike where they were taught."""
    facts = replace(FOUND, causes=(cause,))

    assert verdict(facts) is expected
    assert said in wrong(facts, 0)


def test_what_fits_only_at_an_impossible_size_is_said_to():
    """It is no cause, but where to look: reported once, after the findings."""
    left = replace(FOUND, explains=False, remainder=2.0)
    tilt = effect("joint_tilt:5")

    said = why(replace(left, refused=(tilt,)))

    assert said.startswith(why(left))
    assert "Tilt of the bearing in joint 5 (A4) would explain the readings better" in said
    assert why(replace(Facts(), refused=(tilt,))) == why(Facts()), "nothing was found"


def test_only_what_is_likeliest_in_a_place_is_impossible_there():
    """Rejected labels that another cause beats are not reported, nor what was accepted later."""
    likely, other = Replacement("a", 0, 0.9), Replacement("b", 1, 0.1)
    a, b = SimpleNamespace(label="a"), SimpleNamespace(label="b")
    case = SimpleNamespace(suspects=(a, b))

    def found(rivals=(), single=(), accepted=()):
        return SimpleNamespace(rivals=rivals, single=single, refused=("a", "b"), accepted=accepted)

    assert _refused(case, found(((likely, other),))) == (a,)
    assert _refused(case, found(single=(other,))) == ()
    assert _refused(case, found(((likely, other),), accepted=(0,))) == ()


def test_a_cause_needs_a_certain_gain_where_nobody_knows_the_scatter():
    """With the interval above zero it is identified, otherwise it is not even named."""
    sure = replace(FOUND, gain=gain(0.1, 0.01), scatter_told=False)

    assert sure.helps
    assert verdict(sure) is Verdict.EXPLAINED
    assert not replace(sure, gain=gain(0.1, -0.01)).helps
    assert replace(sure, gain=gain(0.1, -0.01), scatter_told=True).helps


def test_every_finding_stands_in_one_row():
    """No finding without a row, none with two, none without a test."""
    names = [row.finding for rows in TABLE for row in rows]

    assert sorted(names) == sorted(Finding)
    assert set(ROWS) == set(Finding)


def test_the_most_severe_finding_decides_and_all_are_told():
    """A moved tracker is reported with a cause with rivals, which leaves the campaign open."""
    both = replace(ROWS[Finding.RIVALS][0], drift=drift(undecided=False))

    assert verdict(both) is Verdict.AMBIGUOUS
    assert why(both).index("base reflectors moved") < why(both).index("cannot distinguish between")
    assert verdict(replace(both, mistakes=(MISTAKE,))) is Verdict.BAD_DATA
    assert why(replace(both, mistakes=(MISTAKE,))).startswith("The data contain an error")


@pytest.mark.parametrize("kind", ["positions", "pulls"])
@pytest.mark.parametrize("worse", [Finding.RIVALS, Finding.MISFIT, Finding.GEOMETRY_REFUTED])
def test_the_worse_of_positions_and_pulls_decides(kind, worse):
    """A campaign of both has the worse of the two verdicts, with its reason."""
    bad, said = ROWS[worse]
    one, other = (FOUND, bad) if kind == "positions" else (bad, FOUND)
    both = replace(one, positions=other)

    assert verdict(both) is said
    assert worse in [row.finding for row in of_both(both)]
    assert why(bad) in why(both)


def test_springs_that_disagree_take_green_away():
    """Each kind of readings alone is fine; the difference is reported with its chi-square."""
    apart = replace(FOUND, positions=FOUND, agreement=APART)

    assert verdict(replace(apart, agreement=replace(APART, chi2=4.0))) is Verdict.EXPLAINED
    assert verdict(apart) is Verdict.UNEXPLAINED
    assert "chi-square 40" in why(apart)
    assert "5 degrees of freedom" in why(apart)


def test_nothing_is_told_of_displacements_that_hold_nothing():
    """With a drift, displacements explained by springs are not mentioned."""
    assert "joint springs explain" not in why(Facts(drift=drift(undecided=False)))
    assert "joint springs explain" in why(Facts())


@pytest.mark.parametrize(
    ("facts", "finding"),
    [
        (replace(FOUND, outside=STRANGE, gain=gain(-0.1, -0.5)), Finding.PREDICTS_WORSE),
        (replace(FOUND, causes=TILTS, scale_ratio=4.0), Finding.RIVALS),
        (replace(FOUND, causes=TILTS, unloaded=USELESS), Finding.RIVALS),
        (Facts(beyond_certificate=True, unloaded=USELESS), Finding.BEYOND_CERTIFICATE),
        (replace(FOUND, causes=(cause("joint_tilt:5", twins=("joint_tilt:6",)),)), Finding.RIVALS),
        (replace(FOUND, gain=gain(0.0, -0.1)), Finding.PREDICTS_WORSE),
        (Facts(scale_ratio=4.0), Finding.NOTHING),
        (Facts(beyond_a_tracker=True, moved=(cause("joint_offset:3"),)), Finding.NOTHING),
        (Facts(beyond_a_tracker=True, drift=drift(undecided=False)), Finding.NOTHING),
        (Facts(unloaded=SINCE), Finding.OFF_THE_TABLE),
        (Facts(unloaded=SINCE, drift=drift(undecided=False)), Finding.NOTHING),
        (Facts(unloaded=USELESS, drift=drift(undecided=False)), Finding.OFF_THE_TABLE),
        (replace(FOUND, loose_p=2e-4), Finding.CAUSE_IDENTIFIED),
        (Facts(scatter=(cause("tracker_noise"),), beyond_certificate=True), Finding.SCATTER),
    ],
)
def test_of_two_findings_on_the_displacements_the_first_is_told(facts, finding):
    """Rows are in the order of importance."""
    assert findings(facts)[-1].finding is finding


@pytest.mark.parametrize(
    ("times", "std", "told"), [(26, 4, True), (26, 9, False), (-26, 4, True), (9, 0.1, False)]
)
def test_a_cause_certainly_many_times_its_usual_size_is_said_to_be(times, std, told):
    """An offset of 26 times the usual 5 mm is reported; one possibly below ten times is not."""
    one = effect("load_point_offset")
    sizes = [EffectSize.symmetric(p, p.typical, p.typical) for p in one.parameters]
    sizes[1] = EffectSize.symmetric(one.parameters[1], times * 5e-3, std * 5e-3)
    found = FoundCause(one, 0.99, tuple(sizes), 1e-9)

    said = enormous(found)

    assert found.largest.times_typical == pytest.approx(abs(times))
    assert (said is not None) == told
    if said is not None:
        assert "is 26 times its typical magnitude: dl_y = " in said
        assert "5.00 mm is typical" in said
        assert one.needs in said


def test_what_makes_the_same_robot_is_named_as_the_controller_does():
    """Offsets along parallel axes: each joint with its axis, if the robot file has one."""
    one, other = (replace(effect(f"joint_offset:{k}"), axis=f"A{k - 1}") for k in (3, 4))
    off = cause("joint_offset:3", twins=("joint_offset:4",), same_robot=(other,))
    facts = Facts(moved=(replace(off, effect=one),), unloaded=MISPLACED)

    assert "the same error in joint 4 (A3) would give the same robot" in why(facts)


@pytest.mark.parametrize(
    "kept",
    [
        Bounds(tracker=10.0, force=10.0, left=0.25),
        Bounds(far=OutlyingReadings(np.array([4]), np.array([0]), 1e-9)),
        Bounds(far=OutlyingReadings(np.array([4, 5]), np.array([0, 0]), 1e-3)),
    ],
    ids=["at the bound", "one reading", "as many as tails throw"],
)
def test_what_keeps_the_bounds_is_adequate(kept):
    """Ten times the stated noise, a quarter unexplained, or one reading without a name."""
    assert verdict(Facts(bounds=kept)) is Verdict.ADEQUATE


def test_a_cause_is_no_excuse_for_noise_that_cannot_be():
    """The identified cause is reported, and that it is not the whole explanation."""
    said = why(replace(FOUND, bounds=Bounds(tracker=17.0, worst_pose=11, worst_target="P1")))

    assert "Identified in addition to the joint springs" in said
    assert "scatter 17 times as much as stated" in said
    assert "P1 of pose 11" in said


@pytest.mark.parametrize(
    ("noisy", "due"), [(False, Verdict.EXPLAINED), (True, Verdict.UNEXPLAINED)]
)
def test_few_noisy_poses_confirm_no_cause(noisy, due):
    """Without cross-validation, a cause rests on the stated noise, which must then hold."""
    assert verdict(replace(FOUND, gain=None, noisy=noisy)) is due
