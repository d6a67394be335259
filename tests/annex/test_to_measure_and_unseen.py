"""What to measure next, and what these readings could not show."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import report_sample

from pipeline.annex.sections.to_measure import best_pose, next_joint_values, next_poses
from pipeline.annex.sections.unseen import blind_spots
from pipeline.answer.contract import (
    AxisValue,
    BestPose,
    NextPose,
    ToMeasure,
)
from pipeline.answer.sentences import (
    _least_certain,
    _proposed,
)
from pipeline.answer.words import unnoticed, wrong
from pipeline.diagnosis.facts import Facts


def pose(before, after):
    """A proposed pose."""
    return NextPose(
        separates=("joint_tilt:5", "link_bending:forearm"),
        q=(1.0,) * 7,
        q_unit=("m", *["deg"] * 6),
        anchor_m=(1.0, 2.0, 0.0),
        direction=(0.6, 0.8, 0.0),
        force_n=3000.0,
        steps=3,
        approach=None,
        sigmas_before=before,
        sigmas_after=after,
        pose=1,
    )


def test_poses_that_will_not_settle_it_are_said_not_to():
    """On the first screen and below the table; 4.6 standard deviations are enough."""
    weak, strong = [pose(0.3, 1.0), pose(0.3, 2.1)], [pose(0.3, 12.0)]

    assert "help but not settle it" in _proposed(weak)
    assert "2.1 standard deviations" in _proposed(weak)
    assert "These poses will not be enough: they reach 2.1 σ." in next_poses(weak, None, {}).note
    assert "4.6 are enough" in _proposed(strong)
    assert "not settle" not in next_poses(strong, None, {}).note


def test_a_label_is_called_as_the_controller_calls_its_axis():
    """In the table of the next poses, whose values are those of the controller's axes."""
    axes = tuple(AxisValue(name=f"A{k}", value=10.0 * k, unit="deg") for k in (1, 2))
    one = pose(0.3, 12.0).model_copy(update={"axes": axes})

    told = next_poses([one], None, {5: "A4"}).rows[0][1].text
    table = next_joint_values([one], ())

    assert told == "tilt of the bearing in joint 5 (A4) / bending of the link in the forearm"
    assert [column.title for column in table.columns] == ["Pose", "A1 [°]", "A2 [°]"]
    assert [cell.text for cell in table.rows[0]] == ["1", "10.00", "20.00"]


def test_what_went_unnoticed_is_counted_once():
    """The first screen and the section below it have one number, that of all rows together."""
    spots = report_sample.answer().diagnosis.blind_spots
    again = spots[1].model_copy(update={"where": 4, "axis": "A3", "smallest_visible": 6.4e-5})

    said, never, small = blind_spots((*spots, again))

    assert (
        said.text == "3 other effects could be present at typical magnitude without being detected."
    )
    assert f"{unnoticed(3)}; they are listed" in wrong(Facts(), 3)
    assert [row[0].text for row in never.rows] == ["wrong gain of the spring scale"]
    assert [cell.text for cell in small.rows[0][1:4]] == [
        "joint 3, A3",
        "10 µrad",
        "32 to 64 µrad",
    ]


def best(**more):
    """The pose that would determine a joint best."""
    own = {name: getattr(pose(0.3, 1.0), name) for name in ToMeasure.model_fields}
    own |= {"name": "k_r1", "relative_std_before": 0.4, "relative_std_after": 0.12}
    return BestPose(**own | {"determines": True} | more)


@pytest.mark.parametrize(
    ("value", "determines", "said"),
    [
        (8e7, True, "With the pose that the report proposes it is expected to be 12 %."),
        (None, True, "standard uncertainty of about 12 % of its typical compliance. Collisions"),
        (None, False, "This alone will not determine it: its standard uncertainty is then 12 %"),
    ],
)
def test_the_pose_for_a_joint_says_how_to_pull_and_what_it_settles(value, determines, said):
    """Axes, load steps, force and its direction, where a joint has no value; else it is optional.

    And that one pose is not enough, if it is not.
    """
    answer = report_sample.answer()
    joint = answer.stiffness[0].model_copy(update={"value": value, "axis": "E1"})
    at = (AxisValue(name="E1", value=2.5, unit="m"), AxisValue(name="A1", value=-30.0, unit="deg"))
    diagnosis = SimpleNamespace(best_pose=best(axes=at, determines=determines), next_poses_in=None)
    sentence = _least_certain(SimpleNamespace(diagnosis=diagnosis), joint)

    place = "E1 2.500 m, A1 -30.00°, 3 load steps up to 3000 N along (0.60, 0.80, 0.00)"
    assert (place in sentence) == (value is None)
    assert said in sentence
    table = best_pose(best(determines=determines), None, [joint])
    assert "3 load steps up to 3000 N along (0.60, 0.80, 0.00) of F_b" in table.rows[0][2].text
    assert ("does not determine it" in table.note) == (not determines)


def test_a_pose_that_improves_nothing_is_not_recommended():
    """Its uncertainty, as printed, is the same with and without; nothing is optional then."""
    joint = report_sample.answer().stiffness[0].model_copy(update={"value": 8e7, "axis": "E1"})

    def said(after):
        pose = best(relative_std_after=after * joint.relative_std)
        found = SimpleNamespace(diagnosis=SimpleNamespace(best_pose=pose, next_poses_in=None))
        return _least_certain(found, joint)

    assert "Optional" in said(0.5)
    assert "Optional" not in said(0.9999)
    assert "one more pose would hardly improve it" in said(0.9999)
