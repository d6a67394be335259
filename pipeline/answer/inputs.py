"""What went in: registration, rejected rows, date and assumptions."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from datetime import date
from typing import Any

import numpy as np
import pandas as pd
from scipy import special

from pipeline.answer import contract
from pipeline.answer.contract import Input, Line, Rejected
from pipeline.base import doors, files
from pipeline.base.arrays import Array, Ints
from pipeline.base.errors import listed
from pipeline.base.linear import rms
from pipeline.faults.mistake import Mistake, lines_of
from pipeline.machine.effects.tracker_drift import GROUP_S
from pipeline.reduction._raw_readings import UnusedReadings
from pipeline.reduction.case import Case
from pipeline.reduction.growth import BaseGrowth
from pipeline.reduction.pose_of_interest import PoseOfInterest
from pipeline.reduction.register import Registration, dated
from pipeline.reduction.settings import Instrument, Scale, Settings, UnitSettings
from pipeline.store.campaign import Raw, versions

_WEIGHED = "pipeline.check.torques:weighed"
"""Door of the check: payloads as the joint torques have them."""


def of_campaign(
    campaign: str, raw: Raw, settings: Settings, lines: tuple[Line, ...]
) -> dict[str, Any]:
    """What every answer says of its campaign, files and machine, whatever was measured.

    Args:
        campaign: Name of its folder.
        raw: Its files.
        settings: campaign.toml, as the readings were used.
        lines: The first screen.
    """
    return {
        "format": 1,
        "campaign": campaign,
        "name": raw.settings.name,
        "robot": raw.robot.name,
        "simulated": raw.settings.simulated,
        "verdict_sentence": tuple(line.text for line in lines),
        "first_screen": lines,
        "instrument": _instrument_entry(settings),
        "robot_unit": _unit(settings.robot_unit),
        "inputs": _input_entries(raw),
        "versions": versions(),
    }


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


def left_out_entries(given: Case, right: Case, mistakes: Sequence[Mistake]) -> tuple[Rejected, ...]:
    """Rows that are not in the corrected data, each with the evidence for the mistake in it."""
    why = {at: one.evidence for one in mistakes for at in one.at}
    pairs = (given.readings, right.readings), (given.loads, right.loads)
    lost = dict.fromkeys(at for all_, kept in pairs for at in _gone(all_, kept))
    places = (at.rpartition(":") for at in lost)
    return tuple(
        Rejected(file=file, line=int(line), reason=why.get(f"{file}:{line}", _WITH_IT))
        for file, _, line in places
    )


_WITH_IT = "a reading of its pull, or its pose, is left out, without which it says nothing"


def _gone(given: pd.DataFrame, kept: pd.DataFrame) -> list[str]:
    """Lines of a table that another one lacks: `file:line`."""
    if len(kept) >= len(given):
        return []
    still = set(lines_of(kept))
    return [at for at in lines_of(given) if at not in still]


def lost_told(lost: UnusedReadings) -> Iterator[str]:
    """Targets without a reading; how many readings were left out, and which poses as a whole."""
    if lost.absent:
        have = "have" if len(lost.absent) > 1 else "has"
        none = f"{listed(lost.absent)} of naming.measured {have} no reading that could be used"
        yield f"{none}; see Rejected rows for readings under another name."
    if not lost.readings:
        return
    poses = f"pose{'s' * (len(lost.poses) > 1)} {listed(map(str, lost.poses))}"
    yield (
        f"{lost.readings} of {lost.of} readings {'were' if lost.readings > 1 else 'was'} left out"
        f"{f', all of {poses}' if lost.poses else ''}; see Rejected rows for file and line of each."
    )


def _input_entries(raw: Raw) -> tuple[Input, ...]:
    """Every file that was read, with its hash."""
    return tuple(
        Input(file=name, sha256=files.sha256(content), bytes=len(content))
        for name, content in sorted(raw.files.items())
    )


def registration_entry(registration: Registration) -> contract.BaseResiduals | None:
    """How well the base reflectors fit; None when the readings are in F_b already."""
    if registration.table.empty:
        return None
    miss = miss_m(registration)
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


def miss_m(registration: Registration) -> Array:
    """How far each base reading is off its nominal [m], shape (k,)."""
    return np.linalg.norm(registration.table[["dx_m", "dy_m", "dz_m"]].to_numpy(), axis=1)


def _instrument_entry(settings: Settings) -> contract.Measuring | None:
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


def _unit(unit: UnitSettings | Scale) -> contract.Unit | None:
    """Which machine or scale of its type was used; None where nothing is said."""
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
