"""Campaigns of positions and pulls of one robot, from their files to one answer."""

import numpy as np
import pytest
from mixed_campaign import LOAD_POINT, mixed

import pipeline
from pipeline.base.errors import InputError
from pipeline.base.linear import rigid
from pipeline.reduction.settings import parse


@pytest.fixture(scope="module")
def made():
    """An arm without stated masses: from its weight alone, springs are undetermined."""
    return mixed(5, poses=50, masses=False)


@pytest.fixture(scope="module")
def found(made):
    """Its answer."""
    return pipeline.identify(pipeline.load_campaign(made.encoded()))


@pytest.mark.whole
def test_one_answer_has_springs_table_and_positions(found):
    """Nothing is wrong, and it says which springs come from what."""
    answer = found.answer

    assert answer.diagnosis.verdict in ("adequate", "explained")
    assert answer.springs_by.joined
    assert answer.springs_by.lighter > 0
    assert not answer.of_positions
    assert answer.recommended.table == "estimated"
    assert {one.name for one in answer.geometry} >= {"joint_offset", "link_length"}
    assert answer.position_steps
    assert answer.test_pose is not None
    assert "the pulls tell how heavy the arm is" in " ".join(answer.verdict_sentence)


@pytest.mark.whole
def test_springs_hold_and_are_known_no_worse_than_by_either_kind(made, found):
    """The truth is within four standard uncertainties, none of which is larger than alone."""
    for joint, one, c in zip(
        found.answer.stiffness, found.answer.springs_by.each, made.compliance, strict=True
    ):
        assert abs(joint.compliance - c) < 4 * joint.compliance_std
        for alone in (one.by_weight, one.by_pulls):
            assert alone is None or joint.compliance_std < 1.001 * alone.std


@pytest.mark.whole
def test_weight_alone_knows_no_spring_of_an_arm_of_unknown_mass(found):
    """Nothing is said of a spring by the weight, or no more than its order of magnitude."""
    for one in found.answer.springs_by.each:
        assert one.by_pulls.std < 0.1 * one.by_pulls.value
        assert one.by_weight is None or one.by_weight.std > 0.9 * one.by_weight.value


@pytest.mark.whole
def test_gain_of_the_sag_is_of_a_coordinate(found):
    """As that of all causes: below the mean distance, which no rms of distances is."""
    sag = next(one for one in found.answer.diagnosis.causes if one.name == "gravity_sag")
    without, with_ = found.answer.position_steps[1:3]

    assert 0.5 < sag.gain.held_out_rms_before_mm / without.between_mm < 0.9
    assert 0.5 < sag.gain.held_out_rms_after_mm / with_.between_mm < 0.9


@pytest.mark.whole
def test_pulls_act_on_the_deflected_robot_of_the_positions(found):
    """No error of second order is left, and table and tool err as the positions tell."""
    sources = {one.source for joint in found.answer.stiffness for one in joint.budget}

    assert found.answer.model.equilibrium == "deformed"
    assert "second_order" not in sources
    assert "positions" in sources


def said(made, table=None):
    """The answer to a campaign, or to one kind of its readings."""
    return pipeline.identify(pipeline.load_campaign(made.encoded(table))).answer


@pytest.mark.whole
@pytest.mark.parametrize("wrist", [0.0, 0.1, 3.0])
def test_an_assumed_mass_is_no_evidence_against_springs(wrist):
    """A wrist of another weight than usual, read by a good instrument: nothing disagrees."""
    made = mixed(103, masses=False, noise=5e-6, weight=np.array([1, 1, 1, wrist, wrist, wrist]))
    answer = said(made)

    assert answer.diagnosis.verdict in ("adequate", "explained")
    assert answer.springs_by.joined
    for joint, c in zip(answer.stiffness, made.compliance, strict=True):
        assert abs(joint.compliance - c) < 4 * joint.compliance_std
    told = " ".join(answer.verdict_sentence)
    assert "as the robot file states" not in told


@pytest.mark.whole
def test_usual_sizes_of_an_element_are_no_evidence_for_it():
    """The forearm does not bend; the weight calls for it only while its prior is narrow."""
    made = mixed(137448704, poses=59, pulled=9, masses=False, noise=1e-5, weight=1.2)
    answer = said(made)

    assert {one.name for one in answer.diagnosis.causes} == {"gravity_sag"}
    for joint, one in zip(answer.stiffness, said(made, "positions").stiffness, strict=True):
        assert joint.compliance_std < 1.02 * one.compliance_std


@pytest.mark.whole
def test_pulls_tell_by_how_much_an_arm_is_lighter():
    """Of two arms that differ by their weight alone, to a tenth."""
    light, heavy = (said(mixed(7, masses=False, weight=w)).springs_by.lighter for w in (0.5, 1.5))

    assert light / heavy == pytest.approx(3.0, rel=0.1)


@pytest.mark.whole
def test_no_sag_bounds_no_stiffness_where_masses_are_not_stated():
    """A weightless arm, or one whose controller compensates its sag, may have any springs."""
    answer = said(mixed(11, poses=80, masses=False, weight=0.0), "tracker")

    assert answer.diagnosis.verdict == "adequate"
    for joint in answer.stiffness:
        assert joint.value is None
        assert joint.ci95 == (None, None)
    told = " ".join(answer.verdict_sentence)
    assert "No sag is visible" in told
    assert "stiffer than" not in told


@pytest.mark.whole
def test_positions_are_predicted_with_the_springs_of_both(made, found):
    """Unloaded and under a force at the load point, against Pinocchio, to three uncertainties."""
    rng = np.random.default_rng(9)
    low, high = np.array(found.model.robot.lower), np.array(found.model.robot.upper)
    q = np.clip(rng.uniform(-0.8, 0.8, (12, 6)) + np.array([0, -1.2, 0.5, 0, 0, 0]), low, high)
    anchor = np.array([0.0, 0.0, -500.0])  # so far away that its direction does not change
    R, t = np.eye(3), np.zeros(3)
    for size in (0.0, 2000.0):
        force = np.tile([0.0, 0.0, -size], (len(q), 1))
        told = found.positions.predict(q, force)
        flange = [made.machine.flange(one, (size, LOAD_POINT, anchor)) for one in q]
        at = np.array([made.tool @ T[:3, :3].T + T[:3, 3] for T in flange])
        if not size:  # the position of F_b depends on the instrument only
            R, t = rigid(told.position_m.reshape(-1, 3), at.reshape(-1, 3))
        off = told.position_m @ R.T + t - at
        assert np.sqrt(np.mean((off / told.std_m) ** 2)) < 1.3
        assert np.abs(off).max() < 1e-4


@pytest.mark.whole
def test_masses_of_the_file_that_are_off_do_not_spoil_predictions_under_load():
    """An arm 6 % heavier than in its file: the pulls show it, and springs and sag are separated."""
    made = mixed(6, poses=40, weight=1.06)
    found = pipeline.identify(pipeline.load_campaign(made.encoded()))
    assert found.answer.diagnosis.verdict == "adequate"
    for joint, c in zip(found.answer.stiffness, made.compliance, strict=True):
        assert abs(joint.compliance - c) < 4 * joint.compliance_std

    rng = np.random.default_rng(2)
    q = rng.uniform(-0.8, 0.8, (10, 6)) + np.array([0, -1.2, 0.5, 0, 0, 0])
    pull = 2500.0, LOAD_POINT, np.array([0.0, 0.0, -500.0])
    force = np.tile([0.0, 0.0, -pull[0]], (len(q), 1))
    moved, truth = (
        found.positions.predict(q, force).position_m - found.positions.predict(q).position_m,
        np.array([on_flange(made, one, pull) - on_flange(made, one) for one in q]),
    )
    assert np.abs(moved - truth).max() < 0.02 * np.abs(truth).max()


def on_flange(made, q, pull=None):
    """Targets of a simulated machine [m], (t, 3)."""
    T = made.machine.flange(q, pull)
    return made.tool @ T[:3, :3].T + T[:3, 3]


@pytest.mark.whole
def test_a_joint_mastered_anew_between_positions_and_pulls_is_found():
    """The pulls' log of joint 5 reads 0.1 degrees more than that of the positions."""
    made = mixed(8, poses=40).files
    head, *rows = made["joints.csv"].splitlines()
    moved = [row.split(",") for row in rows]
    for row in moved:
        row[5] = f"{float(row[5]) + 0.1:.6f}"
    files = made | {"joints.csv": "\n".join([head, *map(",".join, moved)]) + "\n"}
    found = pipeline.identify(
        pipeline.load_campaign({name: text.encode() for name, text in files.items()})
    ).answer.diagnosis

    assert found.verdict != "adequate"
    assert {"stands_elsewhere", "tables_disagree"} & set(found.reasons)


def test_both_blocks_are_read_and_each_needs_its_own():
    """Keys of both may be combined; a scale without a tracker makes no pulls."""
    text = mixed(1, poses=2, pulled=1).files["campaign.toml"]
    said = parse(text)

    assert not said.of_positions
    assert said.positions.named == ["poses.csv"]
    assert said.tracker.files == ["tracker.csv"]
    with pytest.raises(InputError, match=r"\[scale\] beside \[positions\]"):
        parse(
            text.replace('[tracker]\nfiles = ["tracker.csv"]\n', "[instrument]\n").replace(
                "[instrument]\nsigma_m = 2e-05\n", ""
            )
        )
    with pytest.raises(InputError, match="load_point"):
        parse(text.replace("load_point", "elsewhere"))
