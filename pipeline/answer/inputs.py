"""What went in: registration, rejected rows, date and assumptions."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import date

import numpy as np
import pandas as pd
from scipy import special

from pipeline.answer import contract
from pipeline.answer.contract import Input, Rejected
from pipeline.base import covariance, doors, files
from pipeline.base.arrays import Array, Ints
from pipeline.base.errors import listed
from pipeline.base.linear import rms
from pipeline.base.quantities import plain, with_std
from pipeline.machine.effect import Pulls
from pipeline.machine.effects.tracker_drift import GROUP_S
from pipeline.machine.instrument import near, sheet
from pipeline.machine.robot import configure
from pipeline.readers import Faces
from pipeline.reduction._raw_readings import UnusedReadings
from pipeline.reduction.case import Case
from pipeline.reduction.digits import division, rounding
from pipeline.reduction.forces import reading_std
from pipeline.reduction.growth import REFERENCE_C, STEEL, BaseGrowth
from pipeline.reduction.limits import beyond
from pipeline.reduction.pose_of_interest import PoseOfInterest
from pipeline.reduction.register import XYZ, Registration, dated
from pipeline.reduction.settings import Instrument, Scale, Settings, UnitSettings
from pipeline.store.campaign import Raw
from pipeline.system.estimate import MISFIT_P
from pipeline.system.family import FAR_OFF
from pipeline.system.one_pose import OnePose

_WEIGHED = "pipeline.check.torques:weighed"
"""Door of the check: payloads as the joint torques have them."""

_APART = 3.0
"""Standard uncertainties between thermometer and reflectors from which they contradict: 0.3 %."""


def measured_on(settings: Settings, readings: pd.DataFrame | None) -> str | None:
    """The date in campaign.toml, else the first reading's, else a date within the name."""
    if settings.date is not None:
        return settings.date.isoformat()
    if readings is not None and dated(readings["time"]):
        return pd.Timestamp(readings["time"].min()).isoformat()
    found = re.search(r"\b\d{4}-\d{2}-\d{2}\b", settings.name)
    try:
        return date.fromisoformat(found[0]).isoformat() if found else None
    except ValueError:
        return None


def rejected_entries(rejected: pd.DataFrame) -> tuple[Rejected, ...]:
    """What was left out, where it stands and why."""
    return tuple(
        Rejected(file=file, line=None if pd.isna(line) else int(line), reason=reason)
        for file, line, reason in rejected[["file", "line", "reason"]].itertuples(index=False)
    )


def lost_told(lost: UnusedReadings) -> Iterator[str]:
    """How many readings were left out, and which poses as a whole."""
    if not lost.readings:
        return
    poses = f"pose{'s' * (len(lost.poses) > 1)} {listed(map(str, lost.poses))}"
    yield (
        f"{lost.readings} of {lost.of} readings {'were' if lost.readings > 1 else 'was'} left out"
        f"{f', all of {poses}' if lost.poses else ''}; see Rejected rows for file and line of each."
    )


def input_entries(raw: Raw) -> tuple[Input, ...]:
    """Every file that was read, with its hash."""
    return tuple(
        Input(file=name, sha256=files.sha256(content), bytes=len(content))
        for name, content in sorted(raw.files.items())
    )


def registration_entry(registration: Registration) -> contract.BaseResiduals | None:
    """How well the base reflectors fit; None when the readings are in F_b already."""
    if registration.table.empty:
        return None
    miss = _miss_m(registration)
    std = np.sqrt(np.diag(registration.cov))
    chi2, dof = registration.chi2, registration.dof
    return contract.BaseResiduals(
        rms_mm=1e3 * rms(miss),
        max_mm=1e3 * float(miss.max()),
        chi2=chi2,
        dof=dof,
        p_value=None if chi2 is None or dof < 1 else float(special.chdtrc(dof, chi2)),
        rotation_std_rad=tuple(std[:3].tolist()),
        translation_std_m=tuple(std[3:].tolist()),
        growth=_growth_entry(registration.growth),
    )


def _growth_entry(grown: BaseGrowth) -> contract.Growth | None:
    """None where no temperature is stated and the base frame is as long as it should be."""
    if not grown.probability:
        return None
    return contract.Growth(
        value=grown.value,
        std=grown.std,
        expected=grown.expected,
        expected_std=grown.expected_std,
        seen=grown.seen,
        seen_std=None if grown.seen is None else grown.seen_std,
        probability=grown.probability,
    )


def growth_findings(residuals: contract.BaseResiduals | None) -> list[str]:
    """A sentence where the base frame has another length than it should have."""
    grown = residuals.growth if residuals is not None else None
    if grown is None or grown.seen is None or grown.seen_std is None:
        return []
    seen = f"{with_std(1e3 * grown.seen, 1e3 * grown.seen_std)} mm per metre"
    if grown.expected is None:
        sure = "> 99.9" if grown.probability > 0.999 else f"{100 * grown.probability:.3g}"
        warm = abs(grown.seen) < _APART * grown.expected_std  # else no hall is so warm, or so cold
        advice = "state temperature_c" if warm else "check the tracker against a reference length"
        return [
            "The base reflectors differ from [base_frame] by a common scale factor, longer by "
            f"{seen}, as steel {'' if warm else 'would be only '}at "
            f"{REFERENCE_C + grown.seen / STEEL:.1f} °C (probability {sure} %): this is corrected; "
            f"{advice}, or measure [base_frame] again."
        ]
    if abs(grown.seen - grown.expected) < _APART * np.hypot(grown.seen_std, grown.expected_std):
        return []
    return [
        f"By temperature_c the base frame is longer by {1e3 * grown.expected:.4f} mm per metre, "
        f"and "
        f"by its reflectors by {seen}: the export may be compensated already, or [base_frame] was "
        f"measured at the same temperature."
    ]


def _miss_m(registration: Registration) -> Array:
    """How far each base reading is off its nominal [m], shape (k,)."""
    return np.linalg.norm(registration.table[["dx_m", "dy_m", "dz_m"]].to_numpy(), axis=1)


def registration_findings(
    registration: Registration, residuals: contract.BaseResiduals | None, drifts: bool
) -> list[str]:
    """A sentence when the base reflectors disagree by more than chance explains.

    Args:
        registration: How they fit.
        residuals: The same as the answer has it.
        drifts: A drift of the tracker is named: no single reflector is wrong.
    """
    if residuals is None or residuals.p_value is None or residuals.p_value >= MISFIT_P:
        return []
    if drifts:
        return [
            f"The base reflectors do not fit their nominal coordinates (p = "
            f"{residuals.p_value:.1g}): the tracker moved while they were read, see its drift "
            "below."
        ]
    worst = registration.table.iloc[int(np.argmax(_miss_m(registration)))]
    return [
        f"The base reflectors do not fit their nominal coordinates (p = {residuals.p_value:.1g}): "
        f"{worst['target']} in {worst['group']} is off by {plain(residuals.max_mm, 3)} mm; check "
        f"[base_frame] and whether the tracker or a reflector moved."
    ]


def instrument_entry(settings: Settings) -> contract.Measuring | None:
    """The instrument as campaign.toml has it, and what it turned out to measure.

    None where it says nothing, and nothing is found.
    """
    stated = settings.instrument
    if stated == Instrument():
        return None
    day = None if stated.calibrated is None else stated.calibrated.isoformat()
    return contract.Measuring(
        kind=stated.kind,
        measures=stated.measures,
        model=stated.model,
        serial=stated.serial,
        certificate=stated.certificate,
        calibrated=day,
        data_sheet=settings.sheet.source if settings.sheet else None,
    )


def scale_findings(settings: Settings) -> list[str]:
    """A sentence where forces are not what the scale showed."""
    scale = settings.loads_log
    if scale.zero_n == 0 and scale.gain == 1:
        return []
    return [
        f"As [scale] states, {plain(scale.zero_n, 3)} N was taken from every reading of the scale, "
        f"and the rest divided by {plain(scale.gain, 5)}."
    ]


def sheet_findings(settings: Settings) -> list[str]:
    """A sentence where the instrument has no data sheet here and its noise is not stated."""
    instrument, tracker = settings.instrument, settings.tracker
    if instrument.model is None or tracker is None or sheet(instrument.model) is not None:
        return []
    known = tracker.sigma_m is not None or tracker.noise is not None
    if instrument.kind != "laser_tracker" or known:
        return []
    like = near(instrument.model)
    ask = f"did you mean {listed(like)}? If not, state" if like else "state"
    return [
        f'The data sheet of [instrument] model = "{instrument.model}" is not known: {ask} its '
        "noise as [tracker] noise. Readings without an uncertainty of their own rest on repeats "
        "and misfit."
    ]


def unit_entry(settings: Settings) -> contract.Unit | None:
    """Which machine of its type was measured; None where nothing is said."""
    return _unit(settings.robot_unit)


def _unit(unit: UnitSettings | Scale) -> contract.Unit | None:
    repairs = unit.history if isinstance(unit, UnitSettings) else ()
    if not (unit.serial or unit.certificate or unit.calibrated or repairs):
        return None
    day = None if unit.calibrated is None else unit.calibrated.isoformat()
    history = tuple(
        contract.Repaired(date=one.date.isoformat(), joints=one.joints, what=one.what)
        for one in repairs
    )
    return contract.Unit(
        serial=unit.serial, certificate=unit.certificate, calibrated=day, history=history
    )


def identity_entry(
    settings: Settings,
    times: pd.Series[pd.Timestamp] | None,
    pose: Ints,
    force: Array,
    unloaded_only: int = 0,
) -> contract.Identity:
    """What a report is filed by.

    Args:
        settings: campaign.toml.
        times: Of the readings; None where they have none; shown only with their date.
        pose: Pose of each pull, or of each reading of positions, shape (m,).
        force: Of each pull [N], F_b, shape (m, 3), no rows without pulls.
        unloaded_only: Number of poses in which reflectors were read and nothing was pulled.
    """
    known = times if times is not None and dated(times) else None
    size = np.linalg.norm(force, axis=1)
    return contract.Identity(
        first=None if known is None else known.min().isoformat(),
        last=None if known is None else known.max().isoformat(),
        operator=settings.operator,
        temperature_c=settings.temperature_c,
        scale=None if settings.scale is None else _unit(settings.scale),
        poses=len(np.unique(pose)),
        unloaded_only=unloaded_only,
        pulls=len(size),
        force_n=(float(size.min()), float(size.max())) if len(size) else None,
    )


def payload_entries(case: Case) -> tuple[contract.Payload, ...]:
    """Every payload as stated, and as the joint torques have it."""
    stated = tuple(
        contract.Payload(
            name=name,
            stated=contract.Body(
                mass_kg=one.mass_kg,
                mass_std_kg=one.mass_sigma_kg,
                center_m=one.center_m,
                center_std_m=(one.center_sigma_m,) * 3,
            ),
            found=None,
            poses=0,
            p_value=None,
        )
        for name, one in case.settings.payload.items()
    )
    weighed: Callable[[Case, tuple[contract.Payload, ...]], tuple[contract.Payload, ...]] | None
    weighed = doors.found(_WEIGHED)
    return weighed(case, stated) if weighed else stated


def limit_findings(case: Case) -> list[str]:
    """A sentence for the joints that stand a little beyond the limits of the robot file."""
    found = [one for one in beyond(case) if not one.out]
    if not found:
        return []
    worst = max(found, key=lambda one: one.over)
    poses = listed(str(pose) for pose in sorted({one.pose for one in found}))
    return [
        f"The joint log exceeds the joint limits of the robot file in pose {poses}; the "
        f"farthest is {worst.file}:{worst.line}: {worst.said}. They are used: check the limits in "
        "the robot file."
    ]


def rounding_findings(case: Case) -> list[str]:
    """A sentence where the digits of the export are as coarse as its readings scatter."""
    h = rounding(case.readings[XYZ].to_numpy(float))
    if h == 0:
        return []
    variance = float(covariance.matrices(case.readings)[:, 0, 0].mean())
    if not h**2 > _COARSE * variance:
        return []
    return [
        f"The export is rounded to {plain(1e3 * np.sqrt(12) * h, 1)} mm, an uncertainty of "
        f"{plain(1e3 * h, 2)} mm per coordinate, which is included: export more digits."
    ]


_COARSE = 0.1
"""Part of the variance of a reading from which on its rounding is said."""


def division_findings(case: Case) -> list[str]:
    """A sentence where the divisions of the scale are as coarse as its readings scatter."""
    read = case.loads["force_n"].to_numpy(float)
    h, scale = division(read, case.loads["pose"].to_numpy()), case.settings.scale
    stated = reading_std(scale, np.abs(read[np.isfinite(read)])) if scale else np.zeros(1)
    if h == 0 or not h**2 / 12 > _COARSE * float(np.mean(stated**2)):
        return []
    return [
        f"All forces are multiples of {h:.4g} N: each was anywhere within half of that, an "
        f"uncertainty of {plain(h / np.sqrt(12), 2)} N by a uniform law, which is included; equal "
        "readings are no copies. A scale of finer divisions tells more."
    ]


def doubt_findings(doubted: Sequence[str]) -> list[str]:
    """A sentence where readings are far off and stay in use, which tails of the noise allow.

    Args:
        doubted: Where they stand, as of `Bounds`.
    """
    if not doubted:
        return []
    one = len(doubted) == 1
    who, it = ("A reading is", "it") if one else (f"{len(doubted)} readings are", "them")
    return [
        f"{who} more than {FAR_OFF:.0f} standard uncertainties from where all others put {it} "
        f"({listed(list(doubted))}): tails of the noise explain as many, and mistakes of that size "
        f"look the same. {'It stays' if one else 'They stay'} in use with less weight; measure "
        f"{it} again where you rely on the values."
    ]


def shot_findings(case: Case, pulls: Pulls) -> list[str]:
    """Sentences for reflectors that were shot from beyond what [tool.acceptance] states."""
    settings, tool = case.settings, case.tool
    if settings.cell is None or settings.cell.tracker_m is None:
        return []
    poses, first = np.unique(pulls.pose, return_index=True)
    at = configure(case.robot, pulls.q[first])
    out = []
    for name, cone in settings.tool_acceptance.items():
        beam = np.array(settings.cell.tracker_m) - at.points(tool.named[name][None])[:, 0]
        axis = np.array(cone.direction) / np.linalg.norm(cone.direction)
        faced = np.einsum("mij,j->mi", at.flange_axes, axis)
        angle = np.arccos((beam * faced).sum(axis=1) / np.linalg.norm(beam, axis=1))
        over = angle > np.deg2rad(cone.half_angle_deg)
        if not over.any():
            continue
        out.append(
            f"{name} was measured from up to {np.rad2deg(angle.max()):.1f} deg off the direction "
            f"in "
            f"[tool.acceptance], which allows {cone.half_angle_deg:g} deg, in pose "
            f"{listed(map(str, poses[over]))}: its readings are used; correct the direction or "
            "tracker_m if that cannot be."
        )
    return out


def treated_findings(case: Case) -> list[str]:
    """Sentences for exports that were not used as they stand."""
    out = [
        f"The tracker was carried {plain(one.moved_m, 2)} m to another station before {one.group}: "
        "what was read from then on is registered by the base reflectors read there."
        for one in case.stations
    ]
    out += _of_two_faces({one.file: one.faces for one in case.treated if one.faces})
    for file, cell in _alike((one.file, one.untimed) for one in case.treated if one.untimed):
        out.append(
            f"{file} has no times that can be read ({cell}): the order of its groups counts "
            "instead. Export them with hours, minutes and seconds."
        )
    settled = ((one.file, why) for one in case.treated for why in one.settled)
    out += [f"{file} was read with {why}." for file, why in _alike(settled)]
    return [*out, *_not_read(case)]


def _not_read(case: Case) -> Iterator[str]:
    """Sentences for targets that were not read in pulls that are used without them."""
    loaded = case.readings[case.readings["state"] == "loaded"]
    pulls = dict.fromkeys(zip(loaded["pose"], loaded["repeat"], strict=True))
    aside = {one.name.rpartition("/")[2] for one in case.aside}
    for name in (one for one in case.settings.measured if one not in aside):
        own = loaded[loaded["target"] == name]
        without = sorted(pulls.keys() - {*zip(own["pose"], own["repeat"], strict=True)})
        if 0 < len(without) < len(pulls):
            places = listed([f"pose {pose:.0f} pull {pull:.0f}" for pose, pull in without])
            yield f"{name} was not read in {places}: the other targets are used there."


def _of_two_faces(two: Mapping[str, Faces]) -> list[str]:
    """The sentence for exports with readings in two faces, none if there are none."""
    if not two:
        return []
    pairs, single = (sum(getattr(one, n) for one in two.values()) for n in ("pairs", "single"))
    alone = f"; {single} were measured in the second face only" if single else ""
    largest = max(one.largest_m for one in two.values())
    return [
        f"{_first_of([*two])} has readings in two faces: {pairs} pairs are averaged, up to "
        f"{plain(1e3 * largest, 2)} mm apart{alone}."
    ]


def _alike(found: Iterable[tuple[str, str]]) -> Iterator[tuple[str, str]]:
    """Files of which the same is to be said, and what is said of the first.

    Texts are the same up to a bracket or colon: a column without its cell, an answer without what
    supports it.
    """
    kinds: dict[str, list[tuple[str, str]]] = {}
    for file, text in found:
        kinds.setdefault(re.split(r" \(|:", text)[0], []).append((file, text))
    for some in kinds.values():
        yield _first_of([file for file, _ in some]), some[0][1]


def _first_of(files: Sequence[str]) -> str:
    """The first of some files, with the number of the others."""
    others = f", as {len(files) - 1} other file{'s' * (len(files) > 2)}," if files[1:] else ""
    return f"{files[0]}{others}"


def pose_findings(pose: OnePose | None) -> list[str]:
    """A sentence where targets were computed from one pose, and campaign.toml does not say so."""
    if pose is None:
        return []
    return [
        f"The targets keep their distances to {1e6 * pose.kept_m:.2g} um, which is better than "
        f"any instrument measures points, while {plain(1e3 * pose.left_m, 3)} mm of their "
        "displacements remain: they were computed from one measured pose and count as its six "
        'coordinates. Write measures = "poses" into [instrument].'
    ]


def assumptions(raw: Raw, where: PoseOfInterest, has_times: bool = True) -> list[str]:
    """What the numbers rest on apart from the data; `has_times`: of any reading."""
    out = list(raw.robot.assumptions)
    if not has_times:
        out.append(
            "the readings have no times: the order of their rows stands for it, each group "
            f"{GROUP_S:.0f} s after the one before"
        )
    if raw.settings.sheet is not None:
        noise = raw.settings.sheet.noise
        out.append(
            f"the noise of readings that have none of their own is that of a data sheet: "
            f"{1e6 * noise.range_m:.3g} um + {1e6 * noise.range_per_m:.3g} um/m along the beam, "
            f"{1e6 * noise.transverse_m:.3g} um + {1e6 * noise.transverse_per_m:.3g} um/m across "
            f"it, standard uncertainties by {raw.settings.sheet.source}"
        )
    if raw.settings.priors:
        names = listed(sorted(raw.settings.priors), len(raw.settings.priors))
        out.append(f"prior odds and sizes of {names} are estimated from other campaigns: [priors]")
    if not where.stated:
        out.append("campaign.toml has no [test_pose]: the pose of the largest force is used")
    out.append(
        "validation poses lie within 0.25 m and 10 deg of the test pose, or anywhere within the "
        "joint limits, always under the test pose's force"
    )
    return out
