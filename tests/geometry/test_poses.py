"""Other instruments: cameras and arms of unknown noise, 6D poses as one quantity."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.base.errors import InputError
from pipeline.diagnosis.unloaded_geometry import from_unloaded
from pipeline.geometry.roughness import cells, products
from pipeline.machine import six
from pipeline.machine.effects import catalogue
from pipeline.reduction.bring import bring
from pipeline.reduction.register import XYZ
from pipeline.reduction.settings import parse
from pipeline.run import campaign_answer, ingested
from pipeline.simulate import Plan, simulate
from pipeline.store.campaign import in_memory
from pipeline.system.fit import apart, fit
from pipeline.system.one_pose import as_measured, one_pose

SIX = {"kind": "camera", "measures": "poses", "sigma_m": 5e-5, "sigma_rad": 2e-4, "stated": False}


def made(seed=3, poses=10, **more):
    """Files of a campaign."""
    plan = Plan(name="s", seed=seed, poses={"count": poses}, **more)
    return dict(simulate(plan).files)


def case_of(files):
    """As ingested."""
    return ingested(in_memory(files))


def silent(files):
    """The same without any statement about its instrument."""
    text = re.sub(r"\[instrument\]\n(?:\w+ = .*\n)+", "", files["campaign.toml"].decode())
    return dict(files, **{"campaign.toml": text.encode()})


def test_the_six_coordinates_are_shift_and_turn_of_a_rigid_motion():
    """For any targets, several columns at once; what is not a rigid motion is removed."""
    rng = np.random.default_rng(1)
    levers = rng.standard_normal((5, 4, 3))
    levers -= levers.mean(axis=1, keepdims=True)
    s, w = rng.standard_normal((2, 5, 3))
    moved = s[:, None] + np.cross(w[:, None], levers)
    loose = rng.standard_normal((5, 4, 3))
    part = six.coordinates(levers, loose, 2.0)
    rigid = part[:, 0, None] + np.cross(part[:, 1, None] / 2, levers)

    assert six.coordinates(levers, moved, 0.5) == pytest.approx(np.stack([s, 0.5 * w], axis=1))
    both = np.stack([moved, 2 * moved], axis=-1)
    assert six.coordinates(levers, both, 0.5)[..., 1] == pytest.approx(
        2 * np.stack([s, 0.5 * w], axis=1)
    )
    assert np.linalg.norm(loose - rigid) < np.linalg.norm(loose)
    assert np.sum((loose - rigid) * rigid) == pytest.approx(0, abs=1e-9)


@pytest.fixture(scope="module")
def answer():
    """Answer for sixteen 6D poses of a robot as delivered."""
    return campaign_answer("six", in_memory(made(poses=16, tracker=SIX))).answer


@pytest.mark.whole
def test_a_6d_campaign_is_adequate_and_its_springs_are_right(answer):
    """Six rows per pull, noise from repeats and residuals if not stated."""
    files = made(poses=16, tracker=SIX)
    quiet = campaign_answer("six", in_memory(silent(files))).answer
    case = case_of(files)
    x = case.robot.nominal_compliance
    off = [
        (joint.compliance - true) / joint.compliance_std
        for joint, true in zip(answer.stiffness, x, strict=True)
    ]

    assert answer.diagnosis.verdict == quiet.diagnosis.verdict == "adequate"
    assert answer.fit.dof == 16 * 3 * 6 - 7
    assert 0.7 < answer.fit.chi2 / answer.fit.dof < 1.4
    assert np.abs(off).max() < 4
    assert sum(joint.identifiable for joint in answer.stiffness) >= 6
    assert [j.compliance for j in quiet.stiffness] == [j.compliance for j in answer.stiffness]
    assert not any("one measured pose" in line for line in answer.findings)
    assert any("one measured pose" in line for line in quiet.findings)


@pytest.mark.slow
def test_intervals_of_6d_campaigns_cover():
    """95 % intervals hold the truth.

    With three targets as three readings they hold it less often.
    """
    inside = []
    for seed in range(24):
        case = case_of(made(seed, 8, tracker=SIX | {"sigma_rad": 3e-4}))
        found = fit(case, bring(case)).estimate
        z = (found.value - case.robot.nominal_compliance) / found.std
        inside += (np.abs(z) < found.quantile)[found.identifiable].tolist()

    assert len(inside) > 110
    assert np.mean(inside) > 0.90


@pytest.mark.sampled(1)
@pytest.mark.parametrize("turned", [0.4, 2.5])
def test_rotations_of_unstated_noise_are_weighed_by_their_own(turned):
    """Their noise relative to that of positions is found, from repeated zeros."""
    point = case_of(silent(made(poses=2, tracker=SIX)))
    size = six.radius(point.tool.points)
    case = case_of(silent(made(poses=16, tracker=SIX | {"sigma_rad": turned * 5e-5 / size})))
    case, reduced, _ = as_measured(case, bring(case))
    start = case.robot.nominal_compliance
    data = apart(case.settings, case.cell, reduced.placed, reduced.data, start)
    variance = np.einsum("dii->d", data.loaded_cov)

    assert variance[0::2] == pytest.approx(np.einsum("dii->d", reduced.data.loaded_cov)[0::2])
    assert np.sqrt(variance[1::2] / variance[0::2]) == pytest.approx(turned, rel=0.35)
    grown = [np.trace(data.zero_cov[1]) / np.trace(reduced.data.zero_cov[1])]
    assert grown == pytest.approx([variance[1] / variance[0]])


@pytest.mark.sampled(1)
@pytest.mark.parametrize("stated", [True, False])
def test_targets_that_are_read_one_by_one_are_not_taken_for_a_pose(stated):
    """Nor in data without scatter; a 6D pose is recognised whatever else is stated."""
    points = case_of(made(tracker={"sigma_m": 1e-5, "stated": stated}))
    still = {"noise_scale": 0.0, "digits": "full", "stated": stated}
    exact = case_of(made(tracker=still, scale={"noise_scale": 0.0, "gain_error": 0.0}))
    pose = case_of(silent(made(tracker=SIX | {"stated": stated})))
    case, reduced, found = as_measured(pose, bring(pose))

    assert one_pose(points, bring(points).data) is None
    assert one_pose(exact, bring(exact).data) is None
    assert found is not None
    assert found.kept_m < 3e-6
    assert case.settings.instrument.measures == "poses"
    assert set(reduced.data.name) == {"position", "rotation"}


@pytest.mark.parametrize("turn_deg", [20, 90, 180])
def test_one_reading_that_is_far_off_makes_no_pose_of_the_others(turn_deg):
    """Rotated about the line of the other two, it keeps its distances but turns the pose far."""
    case = case_of(made(tracker={"sigma_m": 1e-5}))
    rows = case.readings.copy()
    group = rows.loc[rows["state"] == "loaded", "group"].iloc[20]
    at = rows[rows["group"] == group].set_index("target")[list(XYZ)].astype(float)
    one, two, three = (at.loc[name].to_numpy() for name in ("P1", "P2", "P3"))
    along = np.deg2rad(turn_deg) * (three - two) / np.linalg.norm(three - two)
    hit = (rows["group"] == group) & (rows["target"] == "P1")
    rows.loc[hit, list(XYZ)] = two + Rotation.from_rotvec(along).apply(one - two)
    wrong = replace(case, readings=rows)

    assert one_pose(wrong, bring(wrong).data) is None


def test_the_rotation_of_a_pose_has_its_own_uncertainty():
    """At the radius of the targets; that of the position is that of a reading."""
    files = made(tracker=SIX | {"stated": True})
    case = case_of(files)
    data = bring(case).data
    tool = np.array([p for name, p in Plan(name="s").tool.items() if name != "load_point"])
    size = np.sqrt(np.mean(np.sum((tool - tool.mean(axis=0)) ** 2, axis=1)))
    plain_case = replace(case, settings=case.settings.model_copy(
        update={"instrument": case.settings.instrument.model_copy(update={"sigma_rad": None})}
    ))  # fmt: skip
    alike = bring(plain_case).data

    assert data.loaded_cov[0] == pytest.approx(5e-5**2 * np.eye(3))
    assert data.loaded_cov[1] == pytest.approx((size * 2e-4) ** 2 * np.eye(3))
    assert data.zero_cov[1] == pytest.approx((size * 2e-4) ** 2 / 2 * np.eye(3))
    assert alike.loaded_cov[1] == pytest.approx(5e-5**2 * np.eye(3))


@pytest.mark.whole
@pytest.mark.sampled(2)
@pytest.mark.parametrize(("kind", "verdict"), [
    ("laser_tracker", "unexplained"), ("camera", "adequate"), ("arm", "adequate"),
    ("unknown", "adequate"),
])  # fmt: skip
def test_only_a_laser_tracker_is_held_to_what_trackers_can(kind, verdict):
    """With one target and one zero, only residuals determine the noise, here 0.25 mm."""
    tool = {name: at for name, at in Plan(name="s").tool.items() if name in ("load_point", "P1")}
    files = made(tool=tool, pulls={"zero": "before"},
                 tracker={"kind": kind, "sigma_m": 2.5e-4, "stated": False})  # fmt: skip
    answer = campaign_answer("kind", in_memory(files)).answer

    assert answer.fit.noise_from == "residuals"
    assert answer.diagnosis.verdict == verdict
    assert ("tracker measures" in answer.fit.noise_statement) is (kind == "laser_tracker")


def test_a_rotation_without_a_position_is_asked_about():
    """sigma_rad without sigma_m would silently have no effect."""
    files = made(tracker=SIX | {"stated": True})
    text = re.sub(rb"(?m)^sigma_m.*\n", b"", files["campaign.toml"])

    with pytest.raises(InputError, match=r"sigma_rad.*state \[tracker\] sigma_m"):
        campaign_answer("turned", in_memory(files | {"campaign.toml": text}))


BAD = {
    "no such kind": ('kind = "theodolite"', "laser_tracker"),
    "too few targets": ('measures = "poses"', "three targets in [tool] that are not on one line"),
    "points do not turn": ("sigma_rad = 1e-4", 'measures = "poses"'),
}


@pytest.mark.parametrize("name", BAD)
def test_an_instrument_that_cannot_be_is_refused(name):
    """The message lists the possible ones."""
    said, told = BAD[name]
    text = 'format = 1\nname = "x"\nrobot = "kr500_rail"\n[tracker]\nfiles = ["t.csv"]\n'
    text += f"[instrument]\n{said}\n[naming]\nmeasured = ['P1', 'P2']\n"
    text += "[tool]\nload_point = [0, 0, 0]\nP1 = [0, 0, 1]\nP2 = [0, 1, 0]\n"

    with pytest.raises(InputError, match=re.escape(told)):
        parse(text)


@pytest.mark.whole
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "hidden", ["link_twist:5=5e-3", "link_length:4=0.02", "joint_offset:3=3e-3"]
)
def test_a_wrong_entry_of_the_table_is_identified_from_6d_poses(answer, hidden):
    """Also its size, and springs rest on the corrected DH parameters as on right ones."""
    name, _, rest = hidden.partition(":")
    joint, _, size = rest.partition("=")
    files = made(poses=16, tracker=SIX, hidden={"effects": [hidden]})
    said = campaign_answer("six", in_memory(files)).answer
    (cause,) = said.diagnosis.causes
    (found,) = cause.parameters
    springs = zip(said.stiffness, answer.stiffness, strict=True)

    assert (cause.name, cause.where) == (name, int(joint))
    assert found.value == pytest.approx(float(size), abs=4 * found.std)
    assert found.std < 5e-5
    assert said.recommended.table == "estimated"
    assert all(abs(a.compliance - b.compliance) < 0.5 * b.compliance_std for a, b in springs)
    before, after = said.diagnosis.unloaded_off_mm
    assert after < 0.05 < 1 < before
    assert answer.recommended.table == "as_delivered"


def test_positions_and_rotations_of_6d_poses_are_weighed_by_what_is_stated_of_each():
    """An inaccurate rotation says nothing about a parameter that only rotates the effector."""
    stds = []
    for rad in (1e-5, 1e-2):
        tracker = SIX | {"stated": True, "sigma_rad": rad}
        data = case_of(made(poses=16, tracker=tracker))
        reduced = bring(data)
        stood = from_unloaded(data.cell, reduced.data, 1.0, catalogue(data.robot))
        zeros = stood.cells.zeros
        k = zeros.columns.table.start + [one.label for one in zeros.letters].index("joint_offset:6")
        alone = cells(zeros, products(zeros.about(np.zeros(zeros.columns.count))))
        stds.append(np.sqrt(alone.covariance[k, k]))
        size = six.radius(data.tool.points)
        ratio = np.einsum("pii->p", zeros.errors[1::2]) / np.einsum("pii->p", zeros.errors[0::2])
        assert ratio == pytest.approx(np.full(16, (size * rad / SIX["sigma_m"]) ** 2))

    assert stds[1] > 2 * stds[0]


@pytest.mark.whole
def test_without_noise_6d_poses_give_the_entry_back():
    """To 1e-9: the rows hold for a rotation of any size once linearised at the solution."""
    still = SIX | {"stated": True}
    plan = Plan(name="s", seed=3, poses={"count": 16}, tracker=still,
                hidden={"effects": ["link_twist:5=0.02"]}).without_noise()  # fmt: skip
    case = case_of(dict(simulate(plan).files))
    stood = from_unloaded(case.cell, bring(case).data, 0.1, catalogue(case.robot))

    (one,) = stood.causes
    assert one.effect.label == "link_twist:5"
    assert one.value[0] == pytest.approx(0.02, abs=2e-9)
