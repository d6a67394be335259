"""A tracker that is knocked, or a robot that moves, between two states of a pose."""

import csv
import io

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_case import asked, screen

from pipeline.answer.words import correct, mistaken
from pipeline.diagnosis.facts import Facts
from pipeline.faults import pose_moved
from pipeline.faults.pose_moved import moved
from pipeline.faults.scale_reading import scale_outliers
from pipeline.reduction.bring import bring
from pipeline.run import campaign_answer, ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.fit import fit

PULLS = {"steps_n": [1000.0, 2000.0, 3000.0], "zero": "before"}


def files(seed=5, **more):
    """A campaign with one zero per pose, before the pulls."""
    plan = Plan(name="knocked", seed=seed, poses={"count": 8}, **{"pulls": PULLS} | more)
    return dict(simulate(plan).files)


def rows_of(made):
    return list(csv.reader(io.StringIO(made["tracker.csv"].decode())))


def written(rows):
    text = io.StringIO()
    csv.writer(text).writerows(rows)
    return text.getvalue().encode()


def knocked(made, group, size_mm=0.6, until=None):
    """All readings from a group on are by a displaced tracker."""
    rows = rows_of(made)
    begun = next(k for k, row in enumerate(rows) if row[0] == group)
    end = len(rows) if until is None else next(k for k, r in enumerate(rows) if r[0] == until)
    R = Rotation.from_rotvec([0, 0, 2e-5]).as_matrix()
    for row in rows[begun:end]:
        at = R @ np.array([float(x) for x in row[2:5]])
        row[2:5] = [f"{x:.5f}" for x in at + np.array([size_mm, -size_mm / 2, size_mm / 3])]
    return made | {"tracker.csv": written(rows)}


def case_of(made):
    return ingested(in_memory(made), plausible=False)


def found(made):
    case = case_of(made)
    return screen(case, bring(case)).findings


GROUPS = [
    "pose04_rep0_unloaded", "pose04_rep1_loaded", "pose04_rep2_loaded", "pose04_rep3_loaded",
    "pose04_rep4_unloaded",
]  # fmt: skip


@pytest.mark.parametrize(("since", "lost"), [(1, GROUPS[:1]), (2, GROUPS[:2]), (3, GROUPS[3:])])
def test_a_knock_between_zeros_before_and_after_leaves_the_smaller_part_out(since, lost):
    """Each part has a zero of its own, from which the pulls that are kept are taken."""
    case = case_of(knocked(files(pulls=PULLS | {"zero": "before_after"}), GROUPS[since]))

    (one,) = moved(asked(case))

    assert one.where == lost[0]
    assert one.size == pytest.approx(0.7e-3, rel=0.3)
    assert "in pose 4 the effector moved" in one.evidence
    left = one.correct(case).readings
    assert list(left[left["pose"] == 4]["group"].unique()) == [g for g in GROUPS if g not in lost]
    assert len(left[left["pose"] != 4]) == len(case.readings[case.readings["pose"] != 4])


def test_a_scale_that_was_not_zeroed_is_no_knock_or_either_where_it_cannot_be_named():
    """All forces of a pose 300 N too large displace its pulls alike, too."""
    made = files()
    rows = list(csv.reader(io.StringIO(made["loads.csv"].decode())))
    for row in rows[1:]:
        row[2] = str(float(row[2]) + 300.0 * (row[0] == "4"))
    given = asked(case_of(made | {"loads.csv": written(rows)}))

    assert moved(given) == []
    assert [one.where for one in scale_outliers(given)] == ["loads.csv pose04"]
    [either] = pose_moved.LAST.find(given)
    assert either.where == "pose04_rep0_unloaded"
    assert either.evidence.endswith("under load")


@pytest.mark.whole
def test_a_knock_between_zero_and_pulls_is_named_with_its_pose():
    """The zero of that pose is left out, and springs are those of the clean campaign."""
    said = campaign_answer("knocked", in_memory(knocked(files(), "pose04_rep1_loaded"))).answer
    case = case_of(files())
    clean = fit(case, bring(case)).estimate

    (cause,) = [one for one in said.diagnosis.causes if one.name == "outlier"]
    assert cause.where == "pose04_rep0_unloaded"
    assert cause.parameters[0].value == pytest.approx(0.7e-3, rel=0.25)
    assert said.diagnosis.verdict == "bad_data"
    assert said.recommended.data == "corrected"
    for one, compliance in zip(said.stiffness, clean.value, strict=True):
        if one.value is not None:
            assert abs(one.compliance - compliance) < 3 * one.compliance_std
    (to_do,) = [one.text for one in said.first_screen if one.about == "to_do"]
    assert to_do.startswith("Measure that pose again")
    assert "in pose 4 the effector moved by 0." in said.first_screen[0].text


def test_a_knock_between_two_pulls_leaves_the_later_ones_out():
    """The pull before it keeps its zero, and is used."""
    case = case_of(knocked(files(), "pose04_rep2_loaded"))

    (one,) = moved(asked(case))

    assert one.where == "pose04_rep2_loaded"
    left = one.correct(case).readings
    assert set(left[left["pose"] == 4]["group"]) == {"pose04_rep0_unloaded", "pose04_rep1_loaded"}


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "hidden", [["joint_lost_motion:3=3x"], [], ["rail_roll=2x"], ["joint_hysteresis:2=3x"]]
)
def test_what_the_machine_does_in_every_pose_is_no_knock(hidden):
    """Offsets that do not depend on the load are left to the diagnosis."""
    assert [one.where for one in found(files(hidden={"effects": hidden}))] == []


@pytest.mark.whole
def test_one_reading_that_is_off_moves_no_pose():
    """The triangle of the effector distinguishes one bad reading from a rigid motion."""
    made = files()
    rows = rows_of(made)
    (row,) = (row for row in rows if row[:2] == ["pose04_rep0_unloaded", "P2"])
    row[2] = f"{float(row[2]) + 1.5:.5f}"

    assert [one.where for one in found(made | {"tracker.csv": written(rows)})] == [
        "pose04_rep0_unloaded/P2"
    ]


def test_a_campaign_that_fits_is_not_asked(monkeypatch):
    """Nothing is computed or reported if the joint springs explain the readings."""
    given = asked(case_of(files()))
    monkeypatch.setattr(pose_moved, "shifted_readings", None)

    assert given.estimate.p_value > 1e-3
    assert moved(given) == []


def test_the_engineer_is_told_to_measure_that_pose_again():
    """No file can be corrected for a knocked tracker."""
    facts = Facts(mistakes=moved(asked(case_of(knocked(files(), "pose04_rep1_loaded")))))

    assert [one.where for one in facts.mistakes] == ["pose04_rep0_unloaded"]
    assert correct(facts).startswith("Measure that pose again")
    assert "in pose 4 the effector moved by 0." in mistaken(facts)


@pytest.mark.whole
def test_a_cause_that_displaces_some_poses_is_no_knock():
    """Most of its effect may be in one pose, but other poses show it too."""
    made = files(1, hidden={"effects": ["link_bending:upper_arm=2x"]})
    said = campaign_answer("bent", in_memory(made)).answer

    assert found(made) == ()
    assert [one.name for one in said.diagnosis.causes] == ["link_bending"]
    assert said.diagnosis.verdict == "explained"


def test_a_knock_is_told_by_the_pulls_that_are_in_use():
    """The first of four pulls has no force in the log; the knock is before the third."""
    pulls = PULLS | {"steps_n": [1000.0, 1700.0, 2400.0, 3000.0]}
    made = knocked(files(pulls=pulls), "pose04_rep3_loaded")
    loads = [line for line in made["loads.csv"].decode().splitlines() if line[:4] != "4,1,"]

    (one,) = moved(asked(case_of(made | {"loads.csv": "\n".join(loads).encode()})))

    assert one.where == "pose04_rep3_loaded"
    assert "between pull 2 and pull 3" in one.evidence
