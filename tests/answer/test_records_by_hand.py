"""Records of the answer from hand-made facts with distinct values: none may take another's place.

Facts are in SI, records in mm, degrees or SI by the names of their keys.
"""

import datetime
from dataclasses import replace
from types import SimpleNamespace as Some

import numpy as np
import pandas as pd
import pytest

from pipeline.answer import amounts, diagnosis, inputs, recommended, stiffness, values
from pipeline.answer.contract import Amplitude, Odd
from pipeline.base.arrays import Parameter
from pipeline.diagnosis.average import Dependence, Springs
from pipeline.diagnosis.facts import (
    Determining,
    EffectSize,
    Facts,
    FoundCause,
    Misfit,
    NamelessEqual,
    PossibleCause,
    ProposedPose,
    SeparatingPose,
    SoleCause,
    Unnoticed,
)
from pipeline.faults.mistake import outlying
from pipeline.machine.effects import catalogue
from pipeline.machine.law import Law
from pipeline.machine.robot import load
from pipeline.reduction.settings import Instrument, Scale, UnitSettings

RAIL, UR = load("kr500_rail"), load("ur10")
EVERY = {one.label: one for one in catalogue(RAIL)}
ROLL, TILT = EVERY["rail_roll"], EVERY["joint_tilt:2"]


def size(value, std, unit="rad/(N m)", meaning="compliance of {joint}"):
    """A parameter with an interval of its own."""
    parameter = Parameter("c_x", unit, 2.0, -100.0, 100.0, meaning=meaning)
    return EffectSize(parameter, value, std, (value - 3 * std, value + 4 * std))


def cross(before, after, reduction, ci95, of="displacements"):
    """A cross-validation."""
    return Some(rms_before_m=before, rms_after_m=after, reduction=reduction, ci95=ci95, of=of)


def test_a_cause_is_recorded_with_all_that_was_found_of_it():
    """Its sizes, rivals, gain and what it may be instead; shares of what is in the catalogue."""
    nameless = PossibleCause(TILT, 0.2)
    one = FoundCause(
        ROLL, 0.9, (size(8.0, 0.5), size(-9.0, 0.25)), 1e-7,
        rivals=(PossibleCause(TILT, 0.06), PossibleCause(ROLL, 0.04)),
        unnamed=nameless,
        as_good=(NamelessEqual(TILT, 0.31, (0.21, 0.41), 7.5),),
        twins=("x", "y"),
        gain=cross(3.1e-5, 2.2e-5, 0.29, (0.1, 0.4)),
        test_pose_change_m=1.7e-4,
    )  # fmt: skip
    entry = diagnosis.cause_entry(one)

    assert (entry.name, entry.where, entry.axis) == ("rail_roll", None, None)
    assert (entry.location, entry.form) == (ROLL.location, None)
    assert entry.probability == pytest.approx(0.8 * 0.9)
    assert [(p.value, p.std, p.ci95) for p in entry.parameters] == [
        (8.0, 0.5, (6.5, 10.0)), (-9.0, 0.25, (-9.75, -8.0))
    ]  # fmt: skip
    assert {(p.name, p.unit, p.meaning) for p in entry.parameters} == {
        ("c_x", "rad/(N m)", "compliance of joint None")
    }
    assert entry.p_value == 1e-7
    assert entry.times_typical == pytest.approx(4.5)
    assert [(r.name, r.where, r.axis) for r in entry.rivals] == [
        ("joint_tilt", 2, "A1"), ("rail_roll", None, None)
    ]  # fmt: skip
    assert [r.probability for r in entry.rivals] == pytest.approx([0.048, 0.032])
    outside = entry.outside_catalogue
    assert (outside.probability, outside.looks_like, outside.where) == (0.2, "joint_tilt", 2)
    (good,) = outside.as_good
    assert (good.name, good.where, good.reduction) == ("joint_tilt", 2, 0.31)
    assert (good.ci95, good.times_typical) == ((0.21, 0.41), 7.5)
    assert (entry.twins, entry.signature, entry.needs) == (("x", "y"), ROLL.signature, ROLL.needs)
    gain = entry.gain
    assert gain.held_out_rms_before_mm == pytest.approx(0.031)
    assert gain.held_out_rms_after_mm == pytest.approx(0.022)
    assert (gain.reduction, gain.ci95, gain.of) == (0.29, (0.1, 0.4), "displacements")
    assert gain.test_pose_change_mm == pytest.approx(0.17)
    assert entry.law is None

    bare = diagnosis.cause_entry(FoundCause(TILT, 0.7, (size(8.0, 0.5, meaning=""),), 0.01))
    assert (bare.name, bare.where, bare.axis) == ("joint_tilt", 2, "A1")
    assert (bare.location, bare.form) == (TILT.location, TILT.form or None)
    assert bare.parameters[0].meaning == "size"
    assert (bare.gain, bare.outside_catalogue, bare.rivals) == (None, None, ())
    axis = diagnosis.cause_entry(FoundCause(TILT, 0.7, (size(8.0, 0.5),), 0.01))
    assert axis.parameters[0].meaning == "compliance of A1"
    unknown = diagnosis.cause_entry(FoundCause(TILT, 0.7, (size(8.0, 0.5),), 0.01, missing=0.4))
    assert unknown.probability == pytest.approx(0.42)
    assert unknown.outside_catalogue.probability == pytest.approx(0.4)
    assert (unknown.outside_catalogue.looks_like, unknown.outside_catalogue.where) == (None, None)
    unmoved = FoundCause(TILT, 0.7, (size(8.0, 0.5),), 0.01, gain=cross(1e-3, 2e-3, -1.0, (-2, 0)))
    assert diagnosis.cause_entry(unmoved).gain.test_pose_change_mm is None


@pytest.mark.parametrize(
    ("where", "part", "source", "joint", "source_joint"),
    [
        (4, "spring", 4, 4, None),
        (4, "spring", 3, 4, 3),
        (4, "spring", 0, 4, None),
        ("rail", "drive", 0, 1, None),
        ("rail", "roll", 0, None, None),
        ("tracker", "", 2, None, 2),
    ],
)
def test_an_unlisted_law_is_recorded_by_what_it_depends_on(
    where, part, source, joint, source_joint
):
    """Another joint only where it is another; the drive of the rail is joint 1."""
    second = Law(where, part, "smooth", "angle", source, 3.0, -1.0, 2.0)
    law = Law(where, part, "periodic", "angle", source, 2.0, -1.5, 2.5, more=second)
    of = Some(
        name="law", where=where, axis="A3", law=law, location="x", signature="s", needs="n",
        called="ripple",
    )  # fmt: skip
    both = (PossibleCause(of, 0.75), PossibleCause(Some(law=None), 0.25))
    entry = diagnosis.cause_entry(FoundCause(of, 0.99, (size(8.0, 0.5),), 0.01, either=both))
    told = entry.law

    assert entry.form == "periodic"
    assert (told.kind, told.variable, told.part) == ("periodic", "angle", part or None)
    assert (told.joint, told.source_joint, told.order) == (joint, source_joint, 2.0)
    assert (told.range, told.text) == ((-1.5, 2.5), "ripple")
    (one,) = told.either
    assert (one.variable, one.part, one.source_joint) == ("angle", part, source_joint)
    assert [(shape.kind, shape.order) for shape in one.shapes] == [("periodic", 2), ("smooth", 3)]
    assert one.probability == 0.75


def proposed(**more):
    """A pose to measure, its numbers with more digits than are proposed."""
    of = {
        "q": np.array([8.54321, *np.deg2rad([-10.12346, 35.0, 39.0, 81.0, 22.0, -12.5])]),
        "anchor": np.array([1.23456, -2.34567, 0.12349]),
        "force": np.array([100.0, 1818.3, -2422.4]),
        "steps": 4,
        "approach": -1.0,
    }
    return ProposedPose(**of | more)


def test_a_proposed_pose_is_recorded_as_it_is_to_be_measured():
    """M and degrees to four places, mm of the anchor, whole newtons, the unit direction."""
    one = SeparatingPose(("a", "b"), proposed(), 1.25, 4.75, 3)
    entry = diagnosis._pose(one, RAIL)

    assert entry.q == (8.5432, -10.1235, 35, 39, 81, 22, -12.5)
    assert entry.q_unit == ("m", *["deg"] * 6)
    assert entry.anchor_m == (1.235, -2.346, 0.123)
    assert entry.direction == (0.033, 0.6, -0.799)
    assert (entry.force_n, entry.steps, entry.approach) == (3031.0, 4, -1.0)  # 3030.56 N
    assert (entry.separates, entry.pose) == (("a", "b"), 3)
    assert (entry.sigmas_before, entry.sigmas_after) == (1.25, 4.75)
    assert [axis.name for axis in entry.axes] == list(RAIL.controller)
    arm = SeparatingPose(("a", "b"), proposed(q=np.zeros(6)), 1.25, 4.75, 3)
    assert diagnosis._pose(arm, UR).approach is None
    assert diagnosis._pose(arm, UR).q_unit == ("deg",) * 6


@pytest.mark.parametrize(
    ("value", "relative", "after", "before_", "after_", "determines"),
    [
        (1e6, 0.12, 0.2, 0.12, 0.12 * 0.2 / 0.8, True),
        (1e6, None, 0.2, None, None, True),
        (None, 0.12, 0.2, 0.8, 0.2, True),
        (None, None, 0.49, 0.8, 0.49, True),
        (None, None, 0.51, 0.8, 0.51, False),
        (1e6, 0.12, 0.51, 0.12, 0.12 * 0.51 / 0.8, True),
    ],
)
def test_the_best_pose_scales_to_the_uncertainty_of_the_answer(
    value, relative, after, before_, after_, determines
):
    """Of a joint with a value; of others in typical sizes, determined below one half."""
    each = [Determining(proposed(), 7.0, 7.0), Determining(proposed(steps=9), 0.8, after)]
    joint = Some(joint=2, name="k_theta2", value=value, relative_std=relative)
    entry = diagnosis.best_pose(Some(determining=each), RAIL, joint)

    assert (entry.name, entry.steps, entry.determines) == ("k_theta2", 9, determines)
    assert entry.relative_std_before == before_
    assert entry.relative_std_after == (None if after_ is None else pytest.approx(after_))
    assert diagnosis.best_pose(Some(determining=()), RAIL, joint) is None
    assert diagnosis.best_pose(Some(determining=each), RAIL, None) is None


def test_a_diagnosis_is_recorded_field_by_field():
    """Twelve probabilities and four lengths, all different."""
    blind = Unnoticed(TILT, "too soft", 3e-3, 7.0)
    found = Some(
        facts=Facts(),
        causes=(),
        alone=(SoleCause(TILT, 0.61, 0.33, (0.11, 0.44)),),
        stood_off_m=(1.1e-3, 2.2e-4),
        blind_spots=(blind,),
        not_found=(Unnoticed(ROLL, "", None, np.inf),),
        next_poses=(),
        refused=("crack",),
        misfits=(Misfit("rail", 0.7, 0.01),),
        lack_of_fit=(0.021, 0.032),
        remainder=(0.043, 0.054, 0.065),
        threshold=0.076,
        clues=(Some(p_value=0.4), Some(p_value=0.087), Some(p_value=0.5)),
        rough=1.23,
        scatter=Some(tracker=1.4, tracker_std=0.14, force=0.9, known_from="zeros"),
        equilibrium="deformed",
        noise_floor_m=3.3e-5,
    )
    entry = diagnosis.diagnosis_of_good_data(found, RAIL)

    assert (entry.verdict, entry.why) == (
        "adequate",
        "The joint springs explain what was measured.",
    )
    assert entry.reasons == ("nothing",)
    assert entry.unloaded_off_mm == pytest.approx((1.1, 0.22))
    (alone,) = entry.alone
    assert (alone.name, alone.where, alone.axis) == ("joint_tilt", 2, "A1")
    assert (alone.probability, alone.reduction, alone.ci95) == (0.61, 0.33, (0.11, 0.44))
    (spot,), (other,) = entry.blind_spots, entry.not_found
    first = TILT.parameters[0]
    assert (spot.name, spot.why, spot.smallest_visible) == ("joint_tilt", "too soft", 3e-3)
    assert (spot.parameter, spot.unit, spot.typical) == (first.name, first.unit, first.typical)
    assert (spot.needs, other.name, other.smallest_visible) == (TILT.needs, "rail_roll", None)
    assert entry.refused == ("crack",)
    (misfit,) = entry.misfit_sits_at
    assert (misfit.place, misfit.share, misfit.p_value) == ("rail", 0.7, 0.01)
    told = entry.detection
    assert (told.threshold_p, told.smallest_p, told.remainder_over_scatter) == (0.076, 0.087, 1.23)
    assert (told.lack_of_fit_p.poses, told.lack_of_fit_p.pulls) == (0.021, 0.032)
    left = told.remainder_p
    assert (left.poses, left.pulls, left.further_cause) == (0.043, 0.054, 0.065)
    scatter = entry.scatter
    assert (scatter.tracker_over_stated, scatter.tracker_over_stated_std) == (1.4, 0.14)
    assert (scatter.scale_over_tracker, scatter.known_from) == (0.9, "zeros")
    assert (entry.equilibrium, entry.noise_floor_mm) == ("deformed", pytest.approx(0.033))
    mistaken = diagnosis.diagnosis_of_good_data(found, RAIL, Facts(misfit_p=1e-9))
    assert (mistaken.verdict, mistaken.reasons) == ("unexplained", ("misfit",))


def fitted(**more):
    """A fit with noise found in the data."""
    family = Some(freedom=3.5, p_value=0.0011)
    wander = Some(size=2.2e-5, std=3.3e-6, time_s=780.0, p_value=0.0022)
    beam = Some(found=(1.5, 0.7), std=(0.1, 0.2), p_value=0.0033, better=True)
    shape = Some(
        beam=beam, family=family, wander=wander, loosest=None, tailed=True, wanders=True,
        weighed=False,
    )  # fmt: skip
    noise = Some(
        name=("tracker", "force_reading"),
        scale=np.array([1.3, 0.8]),
        std=np.array([0.25, np.inf]),
        p_value=np.array([0.01, 0.9]),
        dof=77,
        stated=True,
        larger=np.array([True, True]),
    )
    of = {"noise": noise, "shape": shape, "scatter": 1.21, "estimate": Some(noise_from="stated")}
    settings = Some(measured={"P2": "nest 2"})
    return Some(**of | {"case": Some(settings=settings)} | more)


def test_the_noise_that_was_found_is_recorded_beside_the_stated_one():
    """Factors with standard uncertainties of their own size; undetermined ones are not recorded."""
    entry = diagnosis.noise_entry(fitted())
    assert (entry.from_, entry.used_over_stated, entry.contrasts) == ("stated", 1.21, 77)
    assert [one.name for one in entry.components] == ["tracker", "along_beam", "across_beam"]
    assert [one.found_over_stated for one in entry.components] == [1.3, 1.5, 0.7]
    assert [one.std for one in entry.components] == pytest.approx([0.325, 0.15, 0.14])
    assert [one.p_value for one in entry.components] == [0.01, 0.0033, 0.0033]
    bare = fitted()
    bare.noise.stated, bare.shape.beam.better = False, False
    entry = diagnosis.noise_entry(bare)
    assert (entry.used_over_stated, len(entry.components)) == (None, 1)


def test_noise_that_is_larger_joins_the_causes():
    """Its excess over the stated; heavy tails, a wander, or one loose target instead of tails."""
    right = fitted()
    names = [diagnosis._noisy(right.noise, k) for k in (0, 1)]
    assert [one.name for one in names] == ["tracker_noise", "force_noise"]
    first, second = (one.parameters[0] for one in names)
    assert (first.name, first.unit, second.name) == ("s_tracker", "1", "s_force")
    assert (first.value, first.std) == pytest.approx((0.3, 0.325))
    assert second.value == pytest.approx(-0.2)
    assert first.meaning == "noise of the tracker beyond that stated"
    assert second.meaning == "noise of the scale beyond that stated"
    assert [one.p_value for one in names] == [0.01, 0.9]
    odds = -np.e * 0.01 * np.log(0.01)
    assert names[0].probability == pytest.approx(1 / (1 + odds))

    tails, wander = diagnosis._shaped(right, True)
    assert (tails.name, tails.p_value, tails.where) == ("heavy_tails", 0.0011, None)
    assert (tails.parameters[0].name, tails.parameters[0].value) == ("degrees_of_freedom", 3.5)
    assert (wander.name, wander.p_value) == ("tracker_wander", 0.0022)
    assert [(p.name, p.value, p.std, p.unit) for p in wander.parameters] == [
        ("s_wander", 2.2e-5, 3.3e-6, "m"), ("correlation_time", 780.0, None, "s")
    ]  # fmt: skip
    assert diagnosis._shaped(right, False)[1].parameters[1].value is None
    for scatter, stated, count in ((0.9, True, 1), (0.9, False, 2), (1.0, True, 1), (1.1, True, 2)):
        right.scatter, right.noise.stated = scatter, stated
        assert len(diagnosis._shaped(right, True)) == count
    right.shape.wanders = False
    right.shape.loosest = Some(width=4.4, p_value=0.0044, target="P2")
    (loose,) = diagnosis._shaped(right, True)
    assert (loose.name, loose.where, loose.p_value) == ("heavy_tails", "nest 2", 0.0044)
    assert (loose.parameters[0].name, loose.parameters[0].value) == ("s_target", 4.4)
    right.shape.loosest, right.shape.tailed = None, False
    assert diagnosis._shaped(right, True) == []


def test_the_gain_of_corrected_data_is_that_of_their_residuals(monkeypatch):
    """One minus after over before; unknown where nothing was predicted."""
    monkeypatch.setattr(diagnosis, "left_out", lambda system: np.array([system]))
    slip = Some(
        name="outlier", where="p/P1", p_value=None, size=3e-3, size_unit="m", instead=(), at=(),
        since=None, evidence="e", correction="c", before=1.0, after=0.0, unit="mm",
    )  # fmt: skip
    found = Some(mistakes=(slip,), given=Some(system=4e-3), right=Some(system=1e-3))
    (entry,) = diagnosis._data_causes(found)
    gain = entry.gain
    assert (gain.held_out_rms_before_mm, gain.held_out_rms_after_mm) == pytest.approx((4, 1))
    assert (gain.reduction, gain.test_pose_change_mm, gain.ci95) == (
        pytest.approx(0.75),
        None,
        None,
    )
    (size_,) = entry.parameters
    assert (size_.name, size_.value, size_.unit, entry.where) == ("size", 3e-3, "m", "p/P1")
    assert entry.probability == 1.0
    for before, after in ((np.nan, 1e-3), (4e-3, np.nan), (0.0, 1e-3)):
        found.given.system, found.right.system = before, after
        assert diagnosis._data_causes(found)[0].gain.reduction is None
    assert diagnosis._data_causes(Some(mistakes=())) == ()


@pytest.mark.parametrize(
    ("name", "unit", "value", "std", "told", "rough"),
    [
        ("c", "rad/(N m)", 5.16e-8, 3.8e-9, "51.6 ± 3.8 nrad/(N·m)", "52 nrad/(N·m)"),
        ("v", "m/s", 4.2e-8, 1e-9, "151.2 ± 3.6 µm/h", "150 µm/h"),
        ("w", "rad/s", 1e-8, None, "36.0 µrad/h", "36 µrad/h"),
        ("s", "1", 0.123, 0.012, "12.3 ± 1.2 %", "12 %"),
        ("degrees_of_freedom", "1", 3.51, 0.12, "3.51 ± 0.12", "3.5"),
        ("size", "1", 1000.0, None, "1000", "1000"),
        ("m", "kg", 12.3, 0.45, "12.30 ± 0.45 kg", "12 kg"),
        ("t", "s", 1234.0, None, "1230 s", "1200 s"),
        ("m", "m", None, 1.0, "–", None),
    ],
)  # fmt: skip
def test_amounts_are_told_in_the_units_of_people(name, unit, value, std, told, rough):
    """Prefixes, hours and percent; kilograms and seconds as they are."""
    one = Amplitude(name=name, value=value, std=std, unit=unit)
    assert amounts.amount(one) == told
    if rough is not None:
        assert amounts.roughly(one) == rough
        for evidence, of in ((None, ""), (1, " of the error in t.csv")):
            cause = Some(parameters=(one,), evidence=evidence, where="t.csv")
            assert [*amounts.sizes(cause)] == [f"size{of}: {told}"]


def device(serial=None, certificate=None, calibrated=None):
    """What campaign.toml says of a scale or a machine."""
    return {"serial": serial, "certificate": certificate, "calibrated": calibrated}


DAY = datetime.date(2025, 3, 4)


@pytest.mark.parametrize(
    ("date", "times", "name", "day"),
    [
        (DAY, ["2024-05-06"], "x", "2025-03-04"),
        (None, ["2024-05-07 08:09:10", "2024-05-06 23:00:00"], "2023-01-01", "2024-05-06T23:00:00"),
        (None, None, "cell 4, 2023-01-02 night", "2023-01-02"),
        (None, None, "cell 4, 2023-13-02", None),
        (None, None, "order 12023-01-02", None),
        (None, None, "cell", None),
    ],
)
def test_the_day_is_stated_read_or_named(date, times, name, day):
    """The first of these three that there is."""
    readings = None if times is None else pd.DataFrame({"time": pd.to_datetime(times)})
    assert inputs.measured_on(Some(date=date, name=name), readings) == day


def test_machine_scale_and_instrument_are_recorded_as_stated():
    """Each with its own serial number, certificate and day; nothing where nothing is said."""
    repair = Some(date=datetime.date(2024, 1, 2), joints=(2, 3), what="gear")
    unit = UnitSettings.model_construct(**device("s1", "c1", DAY), history=(repair,))
    entry = inputs._unit(unit)
    assert (entry.serial, entry.certificate, entry.calibrated) == ("s1", "c1", "2025-03-04")
    (one,) = entry.history
    assert (one.date, one.joints, one.what) == ("2024-01-02", (2, 3), "gear")
    for only in (
        {"serial": "s"}, {"certificate": "c"}, {"calibrated": DAY}, {"history": (repair,)}
    ):  # fmt: skip
        assert inputs._unit(UnitSettings.model_construct(**device() | {"history": ()} | only))
    assert inputs._unit(UnitSettings()) is None
    assert inputs._unit(Scale(serial="s2")).history == ()
    assert inputs._unit(Scale()) is None

    of = {"kind": "arm", "measures": "poses", "model": "m", **device("s3", "c3", DAY)}
    told = inputs._instrument_entry(Some(instrument=Instrument(**of), sheet=None))
    assert told.model_dump() == {**of, "calibrated": "2025-03-04"}
    sheeted = Some(instrument=Instrument(model="m"), sheet=Some(source="leaflet"))
    told = inputs._instrument_entry(sheeted)
    assert (told.data_sheet, told.calibrated, told.kind) == ("leaflet", None, "laser_tracker")
    assert inputs._instrument_entry(Some(instrument=Instrument(), sheet=None)) is None


def test_a_report_is_filed_by_first_and_last_reading_poses_and_forces():
    """Poses are counted once; the smallest and the largest force."""
    settings = Some(operator="B. Hand", temperature_c=21.5, scale=Scale(serial="s"))
    times = pd.Series(pd.to_datetime(["2025-03-04 10:00", "2025-03-04 09:00", "2025-03-05 08:00"]))
    force = np.array([[0.0, 3.0, 4.0], [0.0, 0.0, 2.0], [10.0, 0.0, 0.0]])
    entry = inputs.identity_entry(settings, times, np.array([4, 4, 9]), force, 3)
    assert (entry.first, entry.last) == ("2025-03-04T09:00:00", "2025-03-05T08:00:00")
    assert (entry.operator, entry.temperature_c, entry.scale.serial) == ("B. Hand", 21.5, "s")
    assert (entry.poses, entry.pulls, entry.unloaded_only) == (2, 3, 3)
    assert entry.force_n == (2.0, 10.0)
    settings.scale = None
    bare = inputs.identity_entry(settings, None, np.array([1, 2]), np.zeros((0, 3)))
    assert (bare.first, bare.last, bare.scale, bare.force_n) == (None, None, None, None)
    assert (bare.poses, bare.pulls, bare.unloaded_only) == (2, 0, 0)


def test_payloads_are_recorded_as_stated(monkeypatch):
    """One uncertainty of the centre for all three coordinates."""
    monkeypatch.setattr(inputs.doors, "found", lambda door: None)
    gun = Some(mass_kg=12.5, mass_sigma_kg=0.3, center_m=(0.1, 0.2, 0.3), center_sigma_m=0.004)
    (one,) = inputs.payload_entries(Some(settings=Some(payload={"gun": gun})))
    assert one.model_dump() == {
        "name": "gun",
        "stated": {
            "mass_kg": 12.5, "mass_std_kg": 0.3, "center_m": (0.1, 0.2, 0.3),
            "center_std_m": (0.004, 0.004, 0.004),
        },
        "found": None, "poses": 0, "p_value": None,
    }  # fmt: skip


def test_what_was_left_out_has_its_line_if_it_has_one():
    """A whole file has none."""
    table = pd.DataFrame({"reason": ["a", "b"], "line": [7.0, np.nan], "file": ["t", "u"]})
    assert [(one.file, one.line, one.reason) for one in inputs.rejected_entries(table)] == [
        ("t", 7, "a"), ("u", None, "b")
    ]  # fmt: skip


def test_what_the_numbers_rest_on_is_listed():
    """In the order in which a reader meets it; only what applies."""
    last = (
        "validation poses lie within 0.25 m and 10 deg of the test pose, or anywhere within the "
        "joint limits, always under the test pose's force"
    )
    noise = Some(range_m=1.1e-5, range_per_m=2.2e-6, transverse_m=3.3e-5, transverse_per_m=4.4e-6)
    sheet = Some(noise=noise, source="leaflet")
    full = Some(
        robot=Some(assumptions=("a", "b")), settings=Some(sheet=sheet, priors={"y": 1, "x": 1})
    )
    assert inputs.assumptions(full, Some(stated=False), False) == [
        "a",
        "b",
        "the readings have no times: the order of their rows stands for it, each group 100 s after "
        "the one before",
        "the noise of readings that have none of their own is that of a data sheet: 11 um + 2.2 "
        "um/m along the beam, 33 um + 4.4 um/m across it, standard uncertainties by leaflet",
        "prior odds and sizes of x, y are estimated from other campaigns: [priors]",
        "campaign.toml has no [test_pose]: the pose of the largest force is used",
        last,
    ]  # fmt: skip
    bare = Some(robot=Some(assumptions=()), settings=Some(sheet=None, priors={}))
    assert inputs.assumptions(bare, Some(stated=True)) == [last]


def test_registration_has_no_chance_without_degrees_of_freedom():
    """Nor without chi-squared; the growth is recorded where there may be any."""
    table = pd.DataFrame({"dx_m": [1e-3], "dy_m": [0.0], "dz_m": [0.0]})
    grown = Some(
        value=1.0, std=2.0, expected=3.0, expected_std=4.0, seen=5.0, seen_std=6.0, probability=0.7
    )
    rows = ((4.0, 0), (None, 3), (4.0, 1))
    for (chi2, dof), p in zip(rows, (None, None, 0.0455), strict=True):
        one = inputs.registration_entry(
            Some(table=table, cov=np.eye(6), chi2=chi2, dof=dof, growth=grown)
        )
        assert one.p_value == (None if p is None else pytest.approx(p, abs=1e-4))
        assert (one.chi2, one.dof) == (chi2, dof)
    assert one.growth.model_dump() == vars(grown)
    grown.seen = None
    assert inputs._growth_entry(grown).seen_std is None
    grown.probability = 0.0
    assert inputs._growth_entry(grown) is None


def test_the_fit_of_a_model_is_recorded(monkeypatch):
    """In mm; the neglected second order at the known springs, at nominal ones elsewhere."""
    asked = {}

    def second(cell, data, x):
        asked["x"] = x
        return np.array([3e-5, -4e-5])

    monkeypatch.setattr(values, "second_order", second)
    cell = Some(parameters=[None] * 3, robot=Some(nominal_compliance=np.array([7.0, 8.0, 9.0])))
    estimate = Some(
        residual=np.array([3e-3, 4e-3]), chi2=55.0, dof=44, p_value=0.33, noise_from="stated",
        residual_std_m=2.5e-5, identifiable=np.array([True, True, False, True]),
        value=np.array([1.0, -2.0, 3.0, 4.0]), goodness=Some(tails=False),
    )  # fmt: skip
    one = Some(case=Some(cell=cell), data=Some(tracked=True), scatter=1.5,
               noise=Some(stated=True), shape=Some(weighed=False))  # fmt: skip
    fit = values._fit_entry(one, estimate)

    assert (fit.rms_mm, fit.second_order_rms_mm) == pytest.approx(
        (np.sqrt(12.5), np.sqrt(12.5) / 100)
    )
    assert (fit.chi2, fit.dof, fit.p_value, fit.noise_from) == (55.0, 44, 0.33, "stated")
    assert fit.residual_std_mm == pytest.approx(0.025)
    assert asked["x"].tolist() == [1.0, 8.0, 9.0]
    assert fit.noise_statement == (
        "Uncertainties, chi-squared and its p-value rest on the noise stated for the readings."
    )


@pytest.mark.parametrize(
    ("noise_from", "stated", "weighed", "p", "tails", "said"),
    [
        ("stated", True, True, 0.1, False,
         "Uncertainties rest on the scatter found in the readings, 1.3 times the noise stated; "
         "chi-squared and its p-value rest on the noise stated for the readings."),
        ("stated", True, False, None, True,
         "Uncertainties, chi-squared and its p-value rest on the noise stated for the readings. "
         "Nothing is left beside these that could test the model."),
        ("replicates", True, False, 0.1, True,
         "Uncertainties, chi-squared and its p-value rest on the noise found in the data, 1.3 "
         "times the noise stated for the readings: repeated zeros and pulls, and the effector's "
         "own triangle. Its p-value is that of noise with the tails that the readings show."),
        ("replicates", False, True, 0.1, False,
         "Uncertainties, chi-squared and its p-value rest on the noise found in the data: repeated "
         "zeros and pulls, and the effector's own triangle."),
        ("residuals", False, False, None, False,
         "No noise is stated, so every uncertainty rests on the residuals' own scatter of 0.023 "
         "mm; there is no independent test of the model."),
    ],
)  # fmt: skip
def test_where_the_noise_is_from_is_said(noise_from, stated, weighed, p, tails, said):
    """And what rests on it."""
    one = Some(
        scatter=1.31,
        noise=Some(stated=stated),
        shape=Some(weighed=weighed),
        data=Some(tracked=True),
    )
    estimate = Some(
        noise_from=noise_from, p_value=p, residual_std_m=2.3e-5, goodness=Some(tails=tails)
    )
    assert values._noise_statement(one, estimate) == said
    if noise_from == "residuals":
        estimate.residual_std_m = 5e-3
        assert values._noise_statement(one, estimate).endswith(
            "scatter of 5.000 mm; there is no independent test of the model; a laser tracker "
            "measures better than that, so the model does not fit as well as a tracker measures."
        )


def test_deflections_of_targets_and_left_out_positions_are_in_millimetres():
    """Of six target positions the mean, the rms and the 95 % quantile of their distances."""
    moved = np.array([[1e-3, -2e-3, 3e-3], [4e-3, 5e-3, -6e-3]])
    model = Some(
        tool=Some(targets=("P1", "P2")), deflection=lambda q, force: (moved, 0.1 * abs(moved))
    )
    one, two = values._deflection_entries(model, Some(q=0, force=0))
    assert (one.target, one.dx_mm, one.dy_mm, one.dz_mm) == ("P1", 1.0, -2.0, 3.0)
    assert (two.target, two.dx_mm, two.dy_mm, two.dz_mm) == ("P2", 4.0, 5.0, -6.0)
    assert two.std_mm == pytest.approx((0.4, 0.5, 0.6))

    off = np.zeros((21, 3))
    off[:, 1] = -1e-3 * np.arange(21)
    given = Some(
        validation=Some(model_copy=lambda update: update), model_copy=lambda update: update
    )
    distances = values.with_positions(given, Some(gain=Some(after=off.ravel())))
    held = distances["validation"]["held_out_position_mm"]
    assert (held.mean, held.p95) == pytest.approx((10.0, 19.0))
    assert held.rms == pytest.approx(np.sqrt(np.mean(np.arange(21) ** 2)))
    assert values.with_positions(given, Some(gain=None)) is given
    bare = Some(validation=None)
    assert values.with_positions(bare, Some(gain=Some(after=off))) is bare


def test_shares_of_hypotheses_are_weighted_variances(monkeypatch):
    """Each source's share of each hypothesis' own variance, times its probability."""
    split = {
        1: Some(source=np.array(["a", "b"]), share=np.array([[0.25, 0.0, 9.0], [0.75, 1.0, 9.0]])),
        2: Some(source=np.array(["a"]), share=np.array([[1.0, 0.0, 9.0]])),
    }
    monkeypatch.setattr(stiffness, "budget", lambda system, estimate: split[system])
    hypotheses = [
        Some(weight=0.75, system=1, estimate=Some(cov=np.diag([4.0, np.inf, 5.0]))),
        Some(weight=0.25, system=2, estimate=Some(cov=np.diag([8.0, np.inf, 5.0]))),
    ]
    parts = stiffness._parts(hypotheses, 2)
    assert parts["a"] == pytest.approx([0.75 * 0.25 * 4 + 0.25 * 8, 0.0])
    assert parts["b"] == pytest.approx([0.75 * 0.75 * 4, np.inf])


@pytest.mark.parametrize(
    ("identifiable", "lost", "odd", "others"),
    [
        (True, (False, False), Odd.DEPENDS, ("p", "q")),
        (False, (False, False), Odd.SCATTERED, ("p", "q")),
        (True, (False, True), Odd.LOST, ("q",)),
        (True, (True, True), Odd.LOST, ("p", "q")),
    ],
)
def test_a_spring_that_depends_on_the_cause_is_remarked(identifiable, lost, odd, others):
    """Lost beside a rival before all else; then whether it is determined all the same."""
    on = [Dependence(3, "c", rival, gone) for rival, gone in zip("pq", lost, strict=True)]
    told = stiffness._dependence("c", on, identifiable)
    assert (told.odd, told.cause, told.others) == (odd, "c", others)
    joint = Some(identifiable=identifiable)
    every = [*stiffness._remarks(joint, Odd.TOGETHER, on, ("k_x",))]
    assert [one.odd for one in every] == ([] if any(lost) else [Odd.TOGETHER]) + [odd]
    (first,) = stiffness._remarks(joint, Odd.TOGETHER, (), ("k_x",))
    assert first.others == ("k_x",)
    (first,) = stiffness._remarks(joint, Odd.MIXED, (), ("k_x",))
    assert first.others == ()
    two = [*on, Dependence(3, "d", "r", False)]
    assert [one.cause for one in stiffness._remarks(joint, None, two, ())] == ["c", "d"]


def springs(value, std, known=(True, True), cov=None):
    """Compliances, their intervals 3 standard uncertainties down and 4 up."""
    x, u = np.array(value), np.array(std)
    of = np.diag(u**2) if cov is None else cov
    return Springs(x, of, x - 3 * u, x + 4 * u, np.array(known))


@pytest.mark.parametrize(("turns", "way"), [(1, "plus"), (-1, "minus"), (0, None)])
def test_one_of_two_stiffnesses_is_the_inverse_of_its_compliance(turns, way):
    """With its own interval; no value where it is unknown or negative."""
    found = springs([4.0, 0.5], [0.25, 0.05])
    one = stiffness._one_way(found, 1, turns)
    assert (one.value, one.std) == pytest.approx((2.0, 0.2))
    assert one.ci95 == pytest.approx((1 / 0.7, 1 / 0.35))
    assert (one.compliance, one.compliance_std, one.axis_turns) == (0.5, 0.05, way)
    for odd in (springs([4, -5.0], [0.25, 0.5]), springs([4.0, 5], [0.2, 0.5], (True, False))):
        one = stiffness._one_way(odd, 1, turns)
        assert (one.value, one.std) == (None, None)
    lost = stiffness._one_way(springs([4.0, 5], [0.2, np.inf], (True, False)), 1, turns)
    assert lost.compliance is None


@pytest.mark.parametrize(("form", "of"), [("total", "total"), ("", "pull")])
@pytest.mark.parametrize(("sign", "value_of"), [(1.0, "positive"), (-1.0, "negative")])
@pytest.mark.parametrize("sense", [1, -1])
def test_both_stiffnesses_are_recorded_by_the_sign_of_the_torque(
    monkeypatch, form, of, sign, value_of, sense
):
    """Which turns the axis which way, how they correlate, and which holds at the test pose."""
    cov = np.array([[0.04, 0.03], [0.03, 0.25]])
    found = springs([4.0, 5.0], [0.2, 0.5], cov=cov)
    monkeypatch.setattr(stiffness, "two_sided", lambda first: {2: 9})
    monkeypatch.setattr(stiffness.sides, "at_pose", lambda *args: {2: sign})
    monkeypatch.setattr(stiffness, "each_way", lambda hypotheses, joint: found)
    monkeypatch.setattr(stiffness.axes, "sense", lambda robot, joint: sense)
    effects = (Some(where=2, form="x"), Some(where=3, form=form))
    first = Some(cell=None, estimate=Some(value=None), effects=effects)
    both = stiffness._by_sign(Some(robot=None), [first], Some(q=None, force=None))[2]
    assert (both.positive.compliance, both.negative.compliance) == (4.0, 5.0)
    turned = ["plus", "minus"][::sense]
    assert [both.positive.axis_turns, both.negative.axis_turns] == turned
    assert both.correlation == pytest.approx(0.3)
    assert (both.of, both.value_of) == (of, value_of)


def test_partners_of_a_spring_are_the_others_of_its_combinations(monkeypatch):
    """Of all combinations, sorted, without itself; none where all are determined."""
    mixes = [Some(of=np.array([3, 1])), Some(of=np.array([1, 0]))]
    monkeypatch.setattr(stiffness, "information", lambda hypotheses: None)
    monkeypatch.setattr(stiffness, "together", lambda *args: mixes)
    found = springs([1.0, 1.0, 1.0, 1.0], [0.1] * 4, (False, False, True, False))
    assert stiffness._partners([], found) == [[1], [0, 3], [], [1]]
    sure = springs([1.0, 1.0], [0.1] * 2)
    assert stiffness._partners([], sure) == [[], []]


@pytest.mark.parametrize(
    ("causes", "hypotheses", "tested"),
    [
        ([("displacements",)], 1, True),
        ([("unloaded positions",)], 1, False),
        ([(None,), ("displacements",)], 1, True),
        ([(None,)], 1, False),
        ([], 1, False),
    ],
)
def test_left_out_residuals_are_those_of_causes_chosen_anew(
    monkeypatch, causes, hypotheses, tested
):
    """Where they were tested on displacements; else those of the first hypothesis."""
    monkeypatch.setattr(recommended, "left_out", lambda system: system)
    found = Some(
        causes=[Some(gain=of and Some(of=of)) for (of,) in causes],
        left_out_after_m="anew",
        hypotheses=[Some(system="first"), Some(system="second")],
    )
    assert recommended._left_out(found) == ("anew" if tested else "first")


def test_a_decision_is_based_on_the_verdict_of_the_data_without_mistakes():
    """Every entry from its own fact."""
    slip = outlying("", "", "", before=0.0, correct=None)
    open_ = Facts(misfit_p=1e-9)
    both = (Some(effects=()), Some(effects=("x",)))

    def basis(facts, found=(), small=()):
        return recommended.DecisionBasis.of(facts, Some(hypotheses=found, too_small=small))

    assert basis(Facts()) == recommended.DecisionBasis(False, "adequate", False, False, False)
    one = basis(Facts(mistakes=(slip,)), both[1:], (1,))
    assert one == recommended.DecisionBasis(True, "adequate", True, False, True, True)
    two = basis(open_, both)
    assert two == recommended.DecisionBasis(False, "unexplained", True, True, False)
    lost = basis(Facts(mistakes=(replace(slip, hopeless=True),)))
    assert (lost.verdict, lost.mistakes, lost.disagree) == ("unexplained", True, False)
    apart = Some(p=1e-9, table_p=1.0)
    assert basis(Facts(agreement=apart)).disagree
    assert not basis(replace(open_, agreement=apart)).disagree
    assert not basis(open_).disagree
