"""Sentences on readings and files beside the answer: what was done with them, what is odd."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from pipeline.answer import contract
from pipeline.answer.contract import Answer, Carried, Combination
from pipeline.answer.inputs import miss_m
from pipeline.answer.remarks import contradicted
from pipeline.answer.results import CampaignResults
from pipeline.answer.words import capital
from pipeline.base import covariance, doors, linear
from pipeline.base.arrays import Array
from pipeline.base.errors import listed
from pipeline.base.quantities import bracketed, common_prefix, plain, prefixed, with_std
from pipeline.base.tails import chi2_beyond
from pipeline.check.contradictions import along_the_beam, overloaded
from pipeline.diagnosis.facts import EffectSize, FoundCause, UnloadedFacts
from pipeline.machine.effect import Effect, Observation, Pulls
from pipeline.machine.instrument import near, sheet
from pipeline.machine.robot import configure
from pipeline.readers import Faces
from pipeline.reduction.case import Case
from pipeline.reduction.digits import division, rounding
from pipeline.reduction.forces import reading_std
from pipeline.reduction.growth import REFERENCE_C, STEEL
from pipeline.reduction.limits import beyond
from pipeline.reduction.register import XYZ, Registration
from pipeline.reduction.settings import Settings
from pipeline.system import alarms
from pipeline.system.contrasts import repeated_zeros
from pipeline.system.estimate import MISFIT_P
from pipeline.system.family import FAR_OFF
from pipeline.system.fit import Fitted
from pipeline.system.one_pose import OnePose

_APART = 3.0
"""Standard uncertainties between thermometer and reflectors from which they contradict: 0.3 %."""


def findings(found: CampaignResults, whole: Answer, stated: Sequence[str]) -> Iterator[str]:
    """What else is to be known of a campaign of pulls, files first.

    Args:
        found: What is known.
        whole: The answer, all but this.
        stated: What the readings say against what was stated.
    """
    case, fits, settings = found.given.case, whole.registration, found.raw.settings
    base = found.right.reduced.registration
    yield from registration_findings(base, fits, _tracker_drifts(found))
    yield from growth_findings(fits)
    yield from limit_findings(case)
    yield from rounding_findings(case)
    yield from division_findings(case)
    yield from doubt_findings(found.facts.bounds.doubted)
    yield from shot_findings(case, found.given.data.pulls)
    yield from treated_findings(case)
    yield from pose_findings(found.one_pose)
    if not _tracker_drifts(found):
        yield from return_findings(found.right)
    yield from misshapen_findings(found.diagnosis.facts.unloaded)
    yield from contradicted(whole.payloads)
    yield from overloaded(whole.overload)
    yield from path_findings(whole.tolerance, found.right.data.pulls.range_n)
    yield from (joint.finding for joint in whole.stiffness if joint.finding)
    yield from sheet_findings(settings)
    yield from scale_findings(settings)
    yield from along_the_beam(settings, found.right.shape.beam)
    yield from stated
    yield from filter(None, map(enormous, found.diagnosis.causes))
    yield from _of_single_pulls(found, whole)
    yield from combination_sentences(whole.combinations)


def _of_single_pulls(found: CampaignResults, whole: Answer) -> Iterator[str]:
    """Which causes hang on one pull."""
    of = {(effect.name, effect.where): effect for effect in found.told.values.first.effects}
    causes = [one for one in whole.influence if one.name is not None]
    yield from filter(None, (hangs_on(of[str(one.name), one.where], one) for one in causes))


def _tracker_drifts(found: CampaignResults) -> bool:
    """A motion of the tracker, or of the base, from round to round is named."""
    effects = [cause.effect for cause in found.diagnosis.causes]
    return any(isinstance(one, Observation) and one.instrument for one in effects)


def growth_findings(residuals: contract.BaseResiduals | None) -> list[str]:
    """A sentence where the base frame has another length than it should have."""
    grown = residuals.growth if residuals is not None else None
    if grown is None or grown.seen is None or grown.seen_std is None:
        return []
    seen = f"{with_std(1e3 * grown.seen, 1e3 * grown.seen_std)} mm per metre"
    if grown.expected is None:
        # of little probability it weighs next to nothing in the registration
        return [_corrected(grown, seen)] if grown.probability >= 0.5 else []
    if abs(grown.seen - grown.expected) < _APART * np.hypot(grown.seen_std, grown.expected_std):
        return []
    return [
        f"By temperature_c the base frame is longer by {1e3 * grown.expected:.4f} mm per metre, "
        f"and "
        f"by its reflectors by {seen}: the export may be compensated already, or [base_frame] was "
        f"measured at the same temperature."
    ]


def _corrected(grown: contract.Growth, seen: str) -> str:
    """That the base frame has another length than stated, `seen` of its own, and is corrected."""
    assert grown.seen is not None
    sure = "> 99.9" if grown.probability > 0.999 else f"{100 * grown.probability:.3g}"
    warm = abs(grown.seen) < _APART * grown.expected_std  # else no hall is so warm, or so cold
    advice = "state temperature_c" if warm else "check the tracker against a reference length"
    return (
        "The base reflectors differ from [base_frame] by a common scale factor, longer by "
        f"{seen}, as steel {'' if warm else 'would be only '}at "
        f"{REFERENCE_C + grown.seen / STEEL:.1f} °C (probability {sure} %): this is corrected; "
        f"{advice}, or measure [base_frame] again."
    )


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
    worst = registration.table.iloc[int(np.argmax(miss_m(registration)))]
    return [
        f"The base reflectors do not fit their nominal coordinates (p = {residuals.p_value:.1g}): "
        f"{worst['target']} in {worst['group']} is off by {plain(residuals.max_mm, 3)} mm; check "
        f"[base_frame] and whether the tracker or a reflector moved."
    ]


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


_COARSE = 0.1
"""Part of the variance of a reading from which on its rounding is said."""


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


def misshapen_findings(stood: UnloadedFacts) -> list[str]:
    """Sentence on unloaded poses left out because the distances of their reflectors differ."""
    found = () if stood.cells is None else stood.cells.zeros.misshapen.tolist()
    if not found:
        return []
    few = len(found) == 1
    which = f"Pose {found[0]}" if few else f"Poses {listed([str(pose) for pose in found])}"
    return [
        f"{which}, measured unloaded only, {'is' if few else 'are'} left out of the estimate of "
        "the DH parameters: the distances between the reflectors are not those of the other "
        f"poses, so one of the readings is an outlier. Measure {'it' if few else 'them'} again."
    ]


def return_findings(fitted: Fitted) -> list[str]:
    """Sentence on poses whose unloaded reflectors stand elsewhere after a pull than before it.

    chi2 = sum d' C^-1 d over the differences d of the zeros of a pose, C their covariance with the
    noise in use, and with the scatter of the pose where that is more; p < `alarms.READING` over all
    poses.
    """
    data, stated = fitted.data, fitted.reduced.data
    zeros = repeated_zeros(fitted.case.settings, fitted.reduced.placed)
    exact = np.einsum("dii->d", stated.zero_cov)
    if not (stated.noise_stated and len(zeros.pose) and (exact > 0).all()):
        return []  # NaN where no noise is stated
    wider = np.einsum("dii->d", data.zero_cov) / exact
    pose = data.pulls.pose[data.pull]
    noise = {int(k): max(fitted.scatter**2, float(wider[pose == k].max())) for k in np.unique(pose)}
    off, most = [], 0.0
    for k, scale in noise.items():
        mine = (zeros.pose == k) & np.isfinite(zeros.cov).all(axis=(1, 2))
        d, C = zeros.delta[mine], zeros.cov[mine] * scale
        chi2 = float(np.einsum("zi,zij,zj->", d, linear.inverse(C), d))
        if len(d) and chi2_beyond(chi2, d.size) * len(noise) < alarms.READING:
            off.append(str(k))
            most = max(most, float(np.linalg.norm(d, axis=1).max()))
    if not off:
        return []
    return [
        f"The unloaded reflectors did not return in pose{'s' * (len(off) > 1)} {listed(off)}: they "
        f"stand up to {1e3 * most:.2f} mm from where they stood before the pulls, more than noise "
        "explains: a joint slipped, something gave way for good, or the tracker moved. "
        "Displacements are measured from the mean of both readings."
    ]


def against_pulls(force_n: Array, pulled: tuple[float, float] | None) -> list[str]:
    """Sentences of the library on forces [N] beyond those of the pulls; none where it is absent."""
    say = doors.found("pipeline.library.compensate:against_pulls")
    return [] if say is None else say(force_n, pulled)


def path_findings(asked: contract.Tolerance | None, pulled: tuple[float, float]) -> list[str]:
    """A sentence if the path's forces [N] exceed those of the pulls or are far below them."""
    path = None if asked is None else asked.path
    force = None if path is None else path.force_n
    return [] if force is None else against_pulls(np.array(force), pulled)


def combination_sentences(combinations: Sequence[Combination]) -> list[str]:
    """Two sentences per combination: what is determined, and how to separate its members."""
    return [
        f"{listed(one.of)} cannot be distinguished: of their compliances these poses determine "
        f"{one.formula} = {bracketed(one.value, one.std)} {one.unit}."
        + (f" What would separate them best: {one.needs}." if one.needs else "")
        for one in combinations
    ]


_ONE_PULL = 1.0
"""A cause that one pull moves by more of its standard uncertainties hangs on it [1]: without that
pull it is elsewhere than was stated (Cook, Technometrics 19, 1977)."""


_MANY = 10.0
"""Multiple of its typical magnitude from which on a cause is called enormous [1]: typical
magnitudes are estimates and hold to a factor of a few (`Effect.source`), so anything beyond an
order of magnitude is no usual cause."""


def _at_least_typical(one: EffectSize) -> float:
    """Interval end nearer to zero over the typical magnitude [1]; 0 if zero is inside."""
    low, high = one.ci95
    return max(low, -high, 0.0) / one.parameter.typical


def enormous(cause: FoundCause) -> str | None:
    """That a cause is many times its typical magnitude, and what would settle it; else None."""
    most = max(cause.amplitudes, key=_at_least_typical)
    if _at_least_typical(most) <= _MANY:
        return None
    usual, unit = most.parameter.typical, most.parameter.unit
    factor, letter = (1.0, "") if unit == "1" else common_prefix([usual, most.value])
    size = with_std(most.value / factor, most.std / factor)
    shown = "" if unit == "1" else f" {prefixed(unit, letter)}"
    return (
        f"{capital(cause.effect.called)} is {plain(most.times_typical, 2)} times its typical "
        f"magnitude: {most.parameter.name} = {size}{shown}, and "
        f"{plain(usual / factor)}{shown} is typical. "
        f"Another cause may be responsible; what would settle it: {cause.effect.needs}."
    )


def hangs_on(cause: Effect, most: Carried) -> str | None:
    """That a cause rests on one pull; None where it does not.

    Args:
        cause: The cause.
        most: The pull that carries most of it.
    """
    if most.moves_sigmas is not None and most.moves_sigmas <= _ONE_PULL:
        return None
    lost = f"nothing determines {most.what}"
    moves = f"{most.what} moves by {plain(most.moves_sigmas, 2)} of its standard uncertainties"
    return (
        f"{capital(cause.called)} depends on pull {most.repeat} of pose {most.pose} alone: "
        f"without it {lost if most.moves_sigmas is None else moves}; measure that pose again."
    )
