"""Every finding in its sentence, from facts whose numbers all differ.

Sizes are in SI in the facts, and in mm, mrad, h or percent in the sentences, as computed by hand.
"""

from dataclasses import replace
from types import SimpleNamespace as Some

import numpy as np
import pytest

from pipeline.answer import words
from pipeline.answer.words import _FINDINGS
from pipeline.base.arrays import Parameter
from pipeline.diagnosis.bounds import Bounds
from pipeline.diagnosis.facts import ALL_SPRINGS, EffectSize, Facts, FoundCause, PossibleCause
from pipeline.diagnosis.finding import Finding, Verdict
from pipeline.faults.mistake import outlying
from pipeline.machine.effect import Table
from pipeline.machine.effects import tracker_drift
from pipeline.machine.robot import load
from pipeline.machine.robot.dh_parameters import dh_parameters

ROBOT = load("kr500_rail")


def effect(called, where=None, **more):
    """An effect with what a sentence may say of it."""
    of = {"name": called, "where": where, "axis": None, "noun": called, "law": None}
    of |= {"form": "", "element": ""}
    return Some(called=called, signature=f"what {called} does", **of | more)


def cause(called, probability=0.99, where=None, **more):
    """A cause that was found."""
    one = more.pop("effect", None) or effect(called, where)
    return FoundCause(one, probability, **{"amplitudes": (), "p_value": 1e-9} | more)


def gain(before, after, reduction=0.0, ci95=(0.0, 0.0)):
    """Cross-validation errors [m]."""
    return Some(rms_before_m=before, rms_after_m=after, reduction=reduction, ci95=ci95)


def stood(**more):
    """Unloaded reflectors."""
    of = {"effects": (), "corrects": False, "down": None, "tool_m": 0.0, "refuted": False}
    return Some(**of | more)


def facts(**more):
    """Facts, the rest as in a sound campaign."""
    of = {"agreement": None, "causes": (), "moved": (), "base": None, "drift": None}
    return Some(**of | {"gain": None, "outside": None, "remainder": None, "mistakes": ()} | more)


A, B, C = cause("roll"), cause("tilt"), cause("play")
OUT = PossibleCause(effect("ghost"), 0.8)
LOOK = {"worst_target": "P7", "worst_pose": 12, "worst_m": 0.0042}


@pytest.mark.parametrize(
    ("finding", "known", "said"),
    [
        (
            Finding.PREDICTS_WORSE,
            facts(causes=(A,), gain=gain(0.001234, 0.002345)),
            "Something is missing from the model, and no known cause explains it: adding roll, "
            "which fits best, makes predictions worse (cross-validation error 1.23 mm without, "
            "2.34 mm with).",
        ),
        (
            Finding.PREDICTS_WORSE,
            facts(causes=(A, B, C), gain=gain(0.0001, 0.0002)),
            "Something is missing from the model, and no known cause explains it: adding roll, "
            "tilt and play, which together fit best, makes predictions worse (cross-validation "
            "error 0.100 mm without, 0.200 mm with).",
        ),
        (
            Finding.UNCONFIRMED,
            facts(causes=(A,), gain=gain(1, 1, 0.25, (-0.11, 0.52))),
            "roll fits best, but the scatter of the readings is not known, and cross-validation "
            "does not confirm it: the error falls by 25 %, 95 % interval -11 % to 52 %, which may "
            "be chance. No cause is identified.",
        ),
        (
            Finding.UNCONFIRMED,
            facts(causes=(A, B), noisy=True),
            "roll and tilt fit best, but the readings scatter more than stated, and "
            "cross-validation requires four poses. No cause is identified.",
        ),
        (
            Finding.REMAINDER,
            facts(causes=(A, B), outside=OUT, remainder=2.34),
            "roll and tilt fit best, but what is left is 2.3 times the scatter of the readings, "
            "and an effect outside the catalogue explains more: it resembles what ghost does.",
        ),
        (
            Finding.REMAINDER,
            facts(causes=(A,), gain=gain(1, 1, 0.1, (0.0, 0.2)), remainder=1.1),
            "roll fits best, but something remains: neither location nor law is certain.",
        ),
        (
            Finding.REMAINDER,
            facts(causes=(A,)),
            "roll fits best, but something remains: neither location nor law is certain.",
        ),
        (
            Finding.REMAINDER,
            facts(causes=(A,), gain=gain(1, 1, 0.1, (0.01, 0.2)), remainder=9.87),
            "roll explains most, but what is left is 9.9 times the scatter of the readings: a law "
            "differs from that of the catalogue, or something else acts or was misread.",
        ),
        (
            Finding.REMAINDER,
            facts(causes=(A,), gain=gain(1, 1, 0.1, (0.01, 0.2)), remainder=1.2),
            "Besides roll, something remains that no known cause explains.",
        ),
        (
            Finding.OUTSIDE_CATALOGUE,
            facts(causes=(A,), outside=OUT),
            "roll fits best, but an effect outside the catalogue explains more: it resembles what "
            "ghost does.",
        ),
        (
            Finding.OUTSIDE_CATALOGUE_POSSIBLE,
            facts(causes=(A, B), outside=OUT),
            "The data cannot distinguish roll and tilt from an effect outside the catalogue, which "
            "resembles what ghost does.",
        ),
        (
            Finding.GAIN_UNCERTAIN,
            facts(causes=(A, B)),
            "roll and tilt fit, but do not certainly reduce the cross-validation error.",
        ),
        (
            Finding.GAIN_UNCERTAIN,
            facts(causes=(A, cause("tilt", unproven=0.3), C)),
            "tilt fits, but does not certainly reduce the cross-validation error beside roll and "
            "play.",
        ),
        (
            Finding.TWO_LAWS,
            facts(
                causes=tuple(
                    cause("", effect=effect(name, where, axis=axis, element=element))
                    for name, where, axis, element in (
                        ("play", 2, "A1", "gear"),
                        ("step", 4, "A3", "gear"),
                        ("bend", 4, "A3", "gear"),
                    )
                )
            ),
            "Joint 4 (A3) follows no law of the catalogue: play, step and bend fit it only "
            "together.",
        ),
        (
            Finding.RIVALS,
            facts(causes=(A, cause("tilt", 0.7, twins=("x",)), cause("play", 0.5))),
            "roll is certain. The data cannot distinguish between tilt, 70 %, and its twin, from "
            "which no pull can distinguish it; play, 50 %, and a similar cause.",
        ),
        (
            Finding.RIVALS,
            facts(
                causes=(A, B, cause("play", 0.6, rivals=tuple(
                    PossibleCause(effect(name), share)
                    for name, share in (("a", 0.2), ("b", 0.1), ("c", 0.06), ("d", 0.04))
                ))),
            ),
            "roll and tilt are certain. The data cannot distinguish between play, 60 %, and a, "
            "20 %, and b, 10 %, and c, 6 %.",
        ),
        (
            Finding.RIVALS,
            facts(causes=(cause("tilt", 0.5, twins=(ALL_SPRINGS,), missing=0.2),)),
            "The data cannot distinguish between tilt, 40 %, and all joints softer or stiffer in "
            "the same course, which moves every target alike.",
        ),
        (
            Finding.SCALE_SCATTERS,
            facts(scale_ratio=3.0, tracker_ratio=1.3),
            "What the causes leave is scatter only if the scale scatters 3.9 times as much as "
            "stated.",
        ),
        (
            Finding.OFF_THE_TABLE,
            facts(unloaded=stood(miss_m=0.0037, effects=(effect("a"), effect("b")))),
            "The unloaded reflectors are 3.7 mm from where the nominal DH parameters place them, "
            "and adding a and b, which fits best, would make the prediction of other poses worse.",
        ),
        (
            Finding.GEOMETRY_REFUTED,
            facts(unloaded=stood(tool_m=0.052, miss_m=0.011, left_m=0.013)),
            "The targets stand up to 52 mm from their places in [tool]: measure them and the load "
            "point again in the flange frame, and check the unit and the axes of [tool] in "
            "campaign.toml.",
        ),
        (
            Finding.GEOMETRY_REFUTED,
            facts(unloaded=stood(tool_m=0.032, miss_m=0.061, left_m=0.013)),
            "The unloaded targets are 61 mm rms from where the robot file places them (base and "
            "tool fitted), and neither a listed mistake in the files nor a wrong DH parameter "
            "explains it: compare the joint log with the controller, column by column and row by "
            "row, and check that the robot file is that of this robot.",
        ),
        (
            Finding.STANDS_UNEXPLAINED,
            facts(unloaded=stood(remains_m=0.0023, noise_m=0.0001)),
            "The unloaded reflectors are 2.3 mm rms from where the nominal DH parameters place "
            "them (base and tool fitted), 23 times the noise of the readings, and neither DH "
            "parameters nor the arm's weight nor a change during the campaign explains it. "
            "Whatever it is may act on the pulls, too. Check the joint log, [tool] and the robot "
            "file, and [gravity].",
        ),
        (
            Finding.STANDS_UNEXPLAINED,
            facts(
                unloaded=stood(remains_m=0.005, noise_m=1e-4, corrects=True, down=("-x", 0.00031))
            ),
            "The unloaded reflectors are 5.0 mm rms from where the estimated DH parameters place "
            "them (base and tool fitted), 50 times the noise of the readings, and neither DH "
            "parameters nor the arm's weight nor a change during the campaign explains it. "
            "Whatever it is may act on the pulls, too. With gravity along -x of F_b they would be "
            "0.31 mm from there: state its direction in [gravity].",
        ),
        *(
            (
                Finding.ROUGH_TABLE,
                facts(
                    unloaded=stood(
                        gain=gain(0.0012, 0.00034), rough=rough, weighs=weighs, cells=None
                    )
                ),
                f"{first}: in cross-validation the unloaded reflectors are 1.2 mm rms per "
                "coordinate from where the nominal DH parameters place them, and 0.34 mm from "
                f"where the identified ones {sag}.",
            )
            for rough, weighs, first, sag in (
                (True, False, "The robot's DH parameters deviate a little from nominal, none "
                 "certainly by itself", "do"),
                (True, True, "The robot's DH parameters deviate a little from nominal, none "
                 "certainly by itself, and the arm sags under its weight", "and the sag do"),
                (False, True, "The arm sags under its weight", "and the sag do"),
            )
        ),
        (
            Finding.PREDICTS_NOTHING,
            facts(bounds=Bounds(left=0.85, **LOOK)),
            "The model leaves 85 % of the squared displacements: do not predict with it. Look "
            "first at P7 of pose 12, where the model leaves 4.2 mm.",
        ),
        (
            Finding.BEYOND_NOISE,
            facts(bounds=Bounds(tracker=12.0, force=11.0, **LOOK)),
            "The readings of the targets scatter 12 times as much as stated, which no instrument "
            "in working order does: check the stated uncertainty and its unit. Look first at P7 of "
            "pose 12, where the model leaves 4.2 mm.",
        ),
        (
            Finding.BEYOND_NOISE,
            facts(bounds=Bounds(tracker=11.0, force=13.0, stated=False, turn_rad=0.0057, **LOOK)),
            "The readings of the scale scatter 13 times as much as stated, which no instrument in "
            "working order does: check the stated uncertainty and its unit. Look first at P7 of "
            "pose 12, where the model leaves 5.7 mrad.",
        ),
        (
            Finding.BEYOND_NOISE,
            facts(bounds=Bounds(tracker=14.0, stated=False, unit_m=0.0002, **LOOK)),
            "The readings of the targets scatter by 2.8 mm, which no instrument in working order "
            "does: check the stated uncertainty and its unit. Look first at P7 of pose 12, where "
            "the model leaves 4.2 mm.",
        ),
        (
            Finding.SCATTERED,
            facts(
                bounds=Bounds(
                    far=Some(pose=np.array([9, 3, 3, 5, 8, 7]), base=0, count=6), **LOOK
                )
            ),
            "Of the readings in use 6 are more than 10 standard uncertainties from where all "
            "others put them, which no noise explains (pose 3, 5, 7 and 8). Look first at P7 of "
            "pose 12, "
            "where the model leaves 4.2 mm.",
        ),
        (
            Finding.SCATTERED,
            facts(bounds=Bounds(far=Some(pose=np.array([], int), base=1, count=1), **LOOK)),
            "Of the readings in use at least one is more than 10 standard uncertainties from where "
            "all others put them, which no noise explains (1 in the rounds of the base "
            "reflectors).",
        ),
        (
            Finding.SCATTERED,
            facts(bounds=Bounds(far=Some(pose=np.array([4]), base=1, count=2), **LOOK)),
            "Of the readings in use 2 are more than 10 standard uncertainties from where all "
            "others put them, which no noise explains (pose 4; 1 in the rounds of the base "
            "reflectors). "
            "Look first at P7 of pose 12, where the model leaves 4.2 mm.",
        ),
        (
            Finding.MISFIT,
            facts(misfit_p=0.00023),
            "What the model leaves is more than noise (p = 0.0002), and no known cause explains "
            "it.",
        ),
        (
            Finding.SCATTER,
            facts(scatter=(A, B)),
            "Nothing but roll and tilt: the readings scatter more, and the joint springs stay.",
        ),
    ],
)  # fmt: skip
def test_a_finding_is_said_with_its_numbers(finding, known, said):
    """In the units of the reader."""
    assert _FINDINGS[finding](known) == said


@pytest.mark.parametrize(
    ("remainder", "detected", "more"),
    [
        (None, True, " The extended model fits the readings to within their scatter."),
        (1.14, True, " The extended model fits the readings to within their scatter."),
        (
            1.26,
            True,
            " With roll and tilt in the model, 1.3 times the scatter of the readings is left, no "
            "more than the laws of the causes may be in error.",
        ),
        (1.26, False, ""),
    ],
)
def test_identified_causes_are_said_with_their_probability(remainder, detected, more):
    """And with what they leave, unless another finding says that something is unexplained."""
    known = Facts(
        detected=True,
        explains=True,
        causes=(cause("roll", 0.98, missing=0.01), cause("tilt", 0.9996)),
        remainder=remainder,
        bounds=Bounds(left=0.0 if detected else 0.9),
    )
    assert words._identified(known) == (
        "Identified in addition to the joint springs: roll (probability 97 %) and tilt "
        f"(probability over 99.9 %).{more}"
    )


def test_causes_of_one_probability_are_said_together():
    sure = [cause(name, 0.9996) for name in ("roll", "tilt", "sag")]
    known = Facts(detected=True, explains=True, causes=(*sure, cause("play", 0.98)))

    assert words._identified(known).startswith(
        "Identified in addition to the joint springs: roll, tilt and sag (probability over 99.9 % "
        "each); play (probability 98 %). "
    )


def test_laws_of_one_place_are_told_beside_each_other():
    """Each has its share of the probability, unless all depend on the same variable."""
    laws = [effect(name, law=Some(driver=driver)) for name, driver in (("a", 1), ("b", 2))]
    one = cause(
        "",
        0.9,
        effect=laws[0],
        either=(PossibleCause(laws[0], 0.75), PossibleCause(laws[1], 0.25)),
        rivals=(PossibleCause(effect("c"), 0.1),),
        unproven=0.2,
    )
    assert words._or(one) == "a, 54 %, and b, 18 %, and c, 8 %"


@pytest.mark.parametrize(
    ("unit", "value", "std", "said"),
    [
        ("rad", 6.6e-4, 2e-5, "ripple, 660 ± 20 µrad"),
        ("1", 0.51, 0.04, "ripple, 0.510 ± 0.040"),
    ],
)
def test_a_law_is_told_with_its_amplitude(unit, value, std, said):
    """In a unit with a prefix; a pure number without one."""
    size = EffectSize.symmetric(Parameter("h", unit, 1.0, -1.0, 1.0), value, std)
    assert words.law_told(cause("ripple", height=size)) == said
    assert words.law_told(cause("ripple")) == "ripple"


def drift(form="steady", by_order=False, **more):
    """A drift of the tracker by 1.1 mm in 6.5 h, about an axis of no special direction."""
    (one,) = [one for one in tracker_drift.effects(ROBOT) if one.form == form]
    if by_order:
        (one,) = tracker_drift.by_order((one,))
    of = {"moved_m": 0.0011, "hours": 6.5, "turn": np.array([3e-9, 0.0, -4e-9])}
    return Some(effect=one, **of | {"knocked": None, "grown": None} | more)


@pytest.mark.parametrize(
    ("seen", "said"),
    [
        (drift(), "1.1 mm in 6.5 h: drift of the tracker, turning by 18 urad/h"),
        (
            drift("warm-up", turn=np.array([3e-5, 4e-5, 0])),
            "1.1 mm in 6.5 h: drift of the tracker, turning by 50 urad",
        ),
        (
            drift(by_order=True, turn=np.array([3e-5, 4e-5, 0])),
            "1.1 mm in 234 groups of readings, in the order of their rows: drift of the tracker, "
            "turning by 50 urad a group",
        ),
    ],
)
def test_a_tracker_that_moved_is_told_in_hours_or_in_groups(seen, said):
    """5 nrad/s are 18 urad/h; without times a group counts as 100 s."""
    known = facts(drift=seen)
    told = f"The base reflectors moved together by {said}."
    assert _FINDINGS[Finding.TRACKER_MOVED](known) == told
    assert _FINDINGS[Finding.TRACKER_MOVED_OR_KNOCKED](known) == (
        f"{told} As they were read, a tracker that was knocked once would look the same."
    )


def test_a_tracker_that_was_knocked_is_told_with_both_rounds():
    """Between which rounds, and how far."""
    told = _FINDINGS[Finding.TRACKER_KNOCKED](facts(base=drift(knocked=("B1", "B2"))))
    assert told.startswith(
        "Between B1 and B2 the base reflectors moved together by 1.1 mm, as no drift moves them:"
    )


@pytest.mark.parametrize(
    ("growth", "longer", "grew"),
    [((0.0, 1e-5, 4.6e-5), "longer", "grew"), ((0.0, 1e-5, -4.6e-5), "shorter", "shrank")],
)
def test_a_base_that_grew_is_told_by_its_largest_strain(growth, longer, grew):
    """46 um per metre, over 6 m 0.28 mm; steel grows by 11.5 um per metre and kelvin."""
    grown = Some(
        groups=("G1", "G2", "G3"), growth=np.array(growth), std=np.array([0, 1e-6, 2e-6]),
        length_m=6.0,
    )  # fmt: skip
    told = _FINDINGS[Finding.BASE_GREW](facts(base=drift(grown=grown)))
    assert told.startswith(
        f"From G1 to G3 the distances between the base reflectors became {longer} by "
        f"0.0460 ± 0.0020 mm per metre, 0.28 mm over their longest: the base frame {grew}, as "
        "steel does by 4.0 K, or the tracker measured lengths otherwise"
    )


def moved(name, sizes, same=(), probability=0.99):
    """A cause of the unloaded reflectors, with the sizes of its components."""
    parameters = [
        EffectSize.symmetric(Parameter(key, unit, 1e-3, -1, 1), value, std)
        for key, unit, value, std in sizes
    ]
    return cause(name, probability, amplitudes=tuple(parameters), same_robot=same)


MOVED = (
    moved(
        "shift",
        [("t_x", "m", 0.0051, 2e-5), ("w_z", "rad", -4e-4, 3e-5), ("s", "N", 70.0, 2.0)],
    ),
    moved(
        "zero", [("q_x", "rad", 0.0012, 1e-4)],
        (effect("", 3, axis="A2"), effect("", 5)), probability=0.6,
    ),
)  # fmt: skip


def test_where_a_robot_stands_elsewhere_is_told_with_each_size():
    """One component needs no axis; the unit of others is as computed."""
    known = facts(moved=MOVED, unloaded=stood(miss_m=0.0048, left_m=0.00021))
    told = (
        "The unloaded reflectors are 4.8 mm rms from where the nominal DH parameters place them "
        "(base and tool fitted), and 0.21 mm with shift (along x 5.100 ± 0.020 mm, about z "
        "-0.400 ± 0.030 mrad, 70.0 ± 2.0 N) and zero (1.20 ± 0.10 mrad; the same error in joint 3 "
        "(A2) and in joint 5 would give the same robot)."
    )
    assert _FINDINGS[Finding.STANDS_ELSEWHERE](known) == told
    assert _FINDINGS[Finding.STANDS_ELSEWHERE_OR_RIVAL](known) == (
        f"{told} The data cannot distinguish between zero, 60 %, and a similar cause."
    )
    positions = facts(moved=MOVED, unloaded=known.unloaded, agreement=1)
    assert "the DH parameters identified from the positions place" in (
        _FINDINGS[Finding.STANDS_ELSEWHERE](positions)
    )


def test_many_deviating_entries_are_not_listed():
    """Six are; of seven it is said that they are many."""
    every = dh_parameters(ROBOT)
    for count in (6, 7):
        mean = np.where(np.arange(len(every)) < count, 1e-3, 0.0)
        zeros = Some(robot=ROBOT, columns=Some(table=slice(0, len(every))))
        cells = Some(zeros=zeros, mean=mean, covariance=np.eye(len(every)) * 1e-8)
        told = words._deviating(Some(cells=cells))
        assert told.startswith("many of the robot's") == (count == 7)
    assert "deviates" not in told


def same(case):
    """Nothing is corrected."""
    return case


def test_mistakes_are_counted_and_placed():
    """One; one more; five more, of which three are named; the same is not told twice."""
    first = outlying("a", "row 1 is off", "", before=0.0, correct=same)
    more = [
        outlying(f"p{k}", "", "", name="label_swap", before=0.0, correct=same, at=(f"t:{k}", "z"))
        for k in range(5)
    ]
    end = ". Your files are unchanged."
    begin = "The data contain an error: row 1 is off"
    bare = outlying("b", "", "", name="unit_mixup", before=0.0, correct=same)
    places = [f"swapped names of targets at p{k} (t:{k})" for k in range(3)]
    rows = [
        ((first,), ""),
        ((first, bare), "; 1 more error was found: mixed-up unit at b"),
        ((first, bare, bare), "; 2 more errors were found: mixed-up unit at b"),
        ((first, *more[:3]), f"; 3 more errors were found: {words.listed(places)}"),
        ((first, *more[:4]), f"; 4 more errors were found: {', '.join(places)} and 1 more"),
        ((first, *more), f"; 5 more errors were found: {', '.join(places)} and 2 more"),
    ]
    for mistakes, said in rows:
        assert words.mistaken(Facts(mistakes=mistakes)) == f"{begin}{said}{end}"
    odd = outlying("here", "", "", name="new", before=0.0, correct=same)
    assert words.mistaken(Facts(mistakes=(first, odd))).endswith(
        "new at here. Your files are unchanged."
    )


def noise(name, where=None, **entries):
    """A cause of scatter as in the answer."""
    return Some(
        name=name, where=where, parameters=[Some(name=key, value=v) for key, v in entries.items()]
    )


@pytest.mark.parametrize(
    ("one", "said"),
    [
        (
            noise("force_noise", s_force=0.31),
            "The readings of the scale scatter 31 % more than stated: the uncertainties include "
            "it.",
        ),
        (
            noise("heavy_tails", degrees_of_freedom=3.0),
            "Single readings deviate farther than the stated noise allows (heavy tails): they "
            "weigh less, and the uncertainties include it. Where they come from one target, one "
            "pose or one pull, look there.",
        ),
        (
            noise("heavy_tails", "P2", s_target=4.8),
            "The readings of P2 scatter some 5 times as much as those of the other targets: see "
            "that it sits firmly in its nest. They weigh less, and the uncertainties include it.",
        ),
        (
            noise("tracker_wander", s_wander=2.3e-5, correlation_time=6000.0),
            "The instrument wanders by 0.023 mm over some 100 min: the uncertainties include it.",
        ),
        (
            noise("tracker_wander", s_wander=2.3e-5, correlation_time=None),
            "Consecutive rows (no times are given) share an error that wanders by 0.023 mm: the "
            "uncertainties include it.",
        ),
        (noise("tracker_wander", s_wander=None, correlation_time=1.0), None),
        (noise("roll", c=1.0), None),
    ],
)
def test_noise_is_told_by_what_scatters(one, said):
    """Percent, whole multiples, mm and minutes."""
    assert [*words.noise_told([one])] == ([] if said is None else [said])


def test_what_was_examined_is_told_with_the_size_that_shows():
    """Of the whole cell, not of single joints; the first parameter counts."""
    spots = [
        Some(effect=effect(name, where, parameters=[Some(name="c", unit=unit), None]),
             smallest_visible=visible)
        for name, where, unit, visible in (
            ("roll", None, "rad/(N m)", 5.2e-8), ("play", 3, "rad", 1e-3),
            ("bend", "forearm", "m", 2e-4),
        )
    ]  # fmt: skip
    assert words.not_found(spots) == (
        "In brackets the size from which each would have been found in 4 of 5 cases: roll "
        "(52 nrad/(N·m)) and bend (200 µm)."
    )
    assert words.not_found(spots[1:2]) == ""


@pytest.mark.parametrize(
    ("unseen", "beside", "mistakes", "said"),
    [
        (0, (), (), "Nothing detectable in these readings."),
        (0, ("x",), (), "Nothing else detectable in these readings."),
        (
            1,
            (),
            (),
            "Nothing detectable in these readings. 1 other effect could be present at typical "
            "magnitude without being detected; they are listed in the report.",
        ),
        (
            12,
            (),
            (outlying("", "", "", before=0.0, correct=same),),
            "The error in the data that the verdict names; nothing else was detected. 12 other "
            "effects could be present at typical magnitude without being detected; they are listed "
            "in the report.",
        ),
    ],
)
def test_nothing_wrong_is_said_with_what_may_be_hidden(unseen, beside, mistakes, said):
    """Beside noise, beside mistakes, beside blind spots."""
    assert words.wrong(Facts(mistakes=mistakes), unseen, beside) == said
    assert words.clear(Facts(mistakes=mistakes))


def test_what_is_wrong_is_said_of_pulls_and_of_positions():
    """A cause, one that cannot be so large, and what the positions have; mistakes first."""
    pulls = Facts(detected=True, refused=(effect("crack"), effect("gap")))
    both = Facts(detected=True, positions=Facts(misfit_p=1e-9))
    nothing = "Something is missing from the model, and no known cause explains it."
    crack = (
        " Crack and gap would explain the readings better, but only at a size that nothing sound "
        "has: inspect it first."
    )
    misfit = (
        " What the model leaves is more than noise (p = 1e-09), and no known cause explains it."
    )
    rows = ((pulls, nothing + crack), (both, nothing + misfit))
    for known, said in rows:
        assert words.wrong(known, 3) == words.why(known) == said
        assert not words.clear(known)
    slip = outlying("", "x", "", before=0.0, correct=same)
    beside = Facts(detected=True, mistakes=(slip,))
    assert words.wrong(beside, 3) == f"With the data corrected: {nothing}"
    assert words.why(beside) == (
        "The data contain an error: x. Your files are unchanged. The rest holds for the corrected "
        f"data. {nothing}"
    )
    assert words.why(Facts()) == "The joint springs explain what was measured."
    assert words.told_of(both, {Finding.NO_CAUSE_FITS, Finding.MISFIT}) == [nothing]
    assert words.told_of(both, {Finding.MISFIT}) == []


@pytest.mark.parametrize(
    ("pose", "said"),
    [
        ((0.104, -0.987, 0.05, 3012.4, 5), "5 load steps up to 3012 N along (0.10, -0.99, 0.05)"),
        ((1.0, 0.0, -0.006, 87.6, 1), "1 load step of 88 N along (1.00, 0.00, -0.01)"),
    ],
)
def test_load_steps_are_said_with_force_and_direction(pose, said):
    """In whole newtons and hundredths."""
    x, y, z, force, steps = pose
    one = Some(direction=(x, y, z), force_n=force, steps=steps)
    assert words.loads(one) == f"{said} of F_b"
    assert words.at_axis(8.5, "m") == "8.500 m"
    assert words.at_axis(-10.126, "deg") == "-10.13°"
    assert [words.counted([None] * k) for k in (1, 2)] == ["1 combination", "2 combinations"]


def test_a_verdict_is_asked_of_every_finding():
    """Each finding but a mistake has a sentence."""
    assert {*Finding} - {*_FINDINGS} == {Finding.MISTAKE}
    assert Verdict.UNEXPLAINED.severity > Verdict.EXPLAINED.severity


def test_an_entry_of_the_table_is_told_as_it_is_and_as_stated():
    """The joint's zero in degrees, a length in mm: what stands there, and what the file says."""
    every = {one.label: one for one in dh_parameters(ROBOT)}
    for label, nominal, value, std, said in (
        ("joint_offset:3", np.deg2rad(90.0), np.deg2rad(-0.25), np.deg2rad(0.012),
         "q = 89.750 ± 0.012 °, not 90 °"),
        ("link_length:3", 1.25, 0.0025, 0.00012, "q = 1252.50 ± 0.12 mm, not 1250 mm"),
    ):  # fmt: skip
        unit = "rad" if "offset" in label else "m"
        entry = Table(
            name=label, noun="error", place="joint", parameters=(), signature="", needs="",
            source="", letter=every[label], nominal=nominal,
        )  # fmt: skip
        size = EffectSize.symmetric(Parameter("q", unit, 1e-3, -1, 1), value, std)
        assert words._sized(cause("", effect=entry, amplitudes=(size,))) == f"error ({said})"


@pytest.mark.parametrize(
    ("together", "at", "said"),
    [
        ((True, True), 1, "Measure that pose again, all its states in one go"),
        ((True, False), 1, "Check those readings against the measurement record and correct the"),
        ((False,), 2, "Check those readings against the measurement record and correct the"),
        ((False,), 1, "Check that reading against the measurement record and correct the file"),
    ],
)
def test_what_to_correct_of_one_reading_or_of_several(together, at, said):
    """A whole pose only if all are displaced alike; several lines of one mistake are several."""
    lines = ("t:1", "t:2")[:at]
    wrong = tuple(
        outlying("p", "", "", name="outlier", before=0.0, correct=same, at=lines, together=one)
        for one in together
    )
    told = words.correct(Facts(mistakes=wrong))
    assert told.startswith(said)
    assert ("measure them again" in told) == ("those" in said)
    assert told.endswith("; then run the campaign once more. Until then")
    lost = Facts(mistakes=(replace(wrong[0], hopeless=True),))
    assert words.correct(lost).startswith("Measure again what was not measured; then run")


def test_the_worst_known_stiffness_may_be_known_exactly():
    """An uncertainty of nothing is the best, not the worst."""
    each = [Some(value=1e6, relative_std=std) for std in (0.0, 0.1, 0.05)]
    assert words.worst_known(each) is each[1]
    assert words.worst_known([Some(value=1e6, relative_std=None)]) is None
