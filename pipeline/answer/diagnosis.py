"""`diagnosis` and `noise`: mistakes in the data first, then what the model misses."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from pipeline.answer import contract
from pipeline.answer.conformity import axis_values
from pipeline.answer.contract import Equilibrium, NoiseFrom, Predicted
from pipeline.answer.recommended import left_out_mm
from pipeline.answer.results import CampaignResults
from pipeline.answer.words import law_told, why
from pipeline.base import doors
from pipeline.base.tails import at_most
from pipeline.diagnosis.facts import (
    Diagnosed,
    EffectSize,
    Facts,
    FoundCause,
    ProposedPose,
    SeparatingPose,
    SoleCause,
    Unnoticed,
)
from pipeline.diagnosis.verdict import findings, verdict
from pipeline.faults.mistake import Mistake
from pipeline.machine.effect import Effect
from pipeline.machine.law import Law
from pipeline.machine.robot import Robot
from pipeline.reduction.register import timed
from pipeline.system.estimate import left_out
from pipeline.system.family import LoosestTarget
from pipeline.system.fit import Fitted
from pipeline.system.variance import NAMES, Components

_LIMITS = "pipeline.design.room:cell_limits"
"""Door of the design: what the poses were checked for that it proposes."""


def diagnosis_entry(found: CampaignResults) -> contract.Diagnosis:
    """`diagnosis`: mistakes in the data first, then what the diagnosis says of the corrected data.

    Scatter that the repeats have found already joins the causes.
    """
    entry = diagnosis_of_good_data(found.diagnosis, found.right.case.robot, found.facts)
    named = {cause.name for cause in entry.causes}
    noise = found.right.excess
    larger = np.flatnonzero(noise.larger).tolist()
    noisy = [_noisy(noise, i) for i in larger if NAMES[noise.name[i]] not in named]
    noisy += _shaped(found.right, timed(found.right.case.readings))
    causes = (*_data_causes(found), *entry.causes, *noisy)
    return entry.model_copy(update={"causes": causes, "next_poses_in": _cell(found)})


def _cell(found: CampaignResults) -> contract.CellLimits | None:
    """What the next poses were checked for; None where nobody says what stands around them."""
    case, limits = found.right.case, doors.found(_LIMITS)
    stated: contract.CellLimits | None = (
        limits(case.robot, case.tool, case.settings) if limits else None
    )
    return stated


def diagnosis_of_good_data(
    diagnosis: Diagnosed, robot: Robot, whole: Facts | None = None
) -> contract.Diagnosis:
    """What the diagnosis says of data without mistakes.

    Args:
        diagnosis: The diagnosis.
        robot: The robot.
        whole: What the verdict follows from; that of the diagnosis alone unless stated.
    """
    facts, (before_m, after_m) = whole or diagnosis.facts, diagnosis.stood_off_m
    return contract.Diagnosis(
        verdict=verdict(facts),
        why=why(facts),
        reasons=tuple(row.finding for row in findings(facts)),
        causes=tuple(map(cause_entry, diagnosis.causes)),
        alone=tuple(map(_alone, diagnosis.alone)),
        unloaded_off_mm=(1e3 * before_m, 1e3 * after_m),
        blind_spots=tuple(map(_blind, diagnosis.blind_spots)),
        not_found=tuple(map(_blind, diagnosis.not_found)),
        next_poses=tuple(_pose(proposal, robot) for proposal in diagnosis.next_poses),
        refused=diagnosis.refused,
        misfit_sits_at=tuple(contract.MisfitPlace(**asdict(one)) for one in diagnosis.misfits),
        detection=_detection(diagnosis),
        scatter=contract.Scatter(
            tracker_over_stated=diagnosis.scatter.tracker,
            tracker_over_stated_std=diagnosis.scatter.tracker_std,
            scale_over_tracker=diagnosis.scatter.force,
            known_from=diagnosis.scatter.known_from,
        ),
        equilibrium=Equilibrium(diagnosis.equilibrium),
        noise_floor_mm=diagnosis.noise_floor_m * 1e3,
    )


def _detection(diagnosis: Diagnosed) -> contract.Detection:
    poses, pulls = diagnosis.lack_of_fit
    left_poses, left_pulls, further = diagnosis.remainder
    return contract.Detection(
        threshold_p=diagnosis.threshold,
        smallest_p=min((clue.p_value for clue in diagnosis.clues), default=None),
        lack_of_fit_p=contract.PosesPulls(poses=poses, pulls=pulls),
        remainder_over_scatter=diagnosis.rough,
        remainder_p=contract.Remainder(poses=left_poses, pulls=left_pulls, further_cause=further),
    )


def placed(effect: Effect) -> dict[str, Any]:
    """Name, place and law of an effect."""
    return _at(effect) | {"form": effect.law.kind if effect.law else effect.form or None}


def _at(effect: Effect) -> dict[str, Any]:
    """Name and place of an effect."""
    return {"name": effect.name, "where": effect.where, "axis": effect.axis}


def cause_entry(cause: FoundCause) -> contract.Cause:
    """A cause that the data call for."""
    effect = cause.effect
    return contract.Cause(
        **placed(effect),
        location=effect.location,
        probability=cause.stated(cause.probability),
        parameters=tuple(_amplitude(effect, one) for one in cause.told),
        p_value=cause.p_value,
        times_typical=cause.largest.times_typical,
        rivals=tuple(
            contract.Rival(**_at(r.effect), probability=cause.stated(r.probability))
            for r in cause.rivals
        ),
        outside_catalogue=_unnamed(cause),
        twins=cause.twins,
        signature=effect.signature,
        needs=effect.needs,
        gain=_gain(cause),
        law=None if effect.law is None else _law(effect, effect.law, cause),
    )


def _law(effect: Effect, law: Law, cause: FoundCause) -> contract.UnlistedLaw:
    """What nobody listed, in the form of campaigns of positions."""
    return contract.UnlistedLaw(
        kind=law.kind,
        variable=law.variable,
        part=law.part or None,
        joint=law.where if isinstance(law.where, int) else 1 if law.part == "drive" else None,
        source_joint=_source(law),
        order=law.order,
        range=(law.low, law.high),
        text=law_told(cause),
        either=tuple(
            _one_law(one.effect.law, one.probability) for one in cause.either if one.effect.law
        ),
    )


def _one_law(law: Law, probability: float) -> contract.OneLaw:
    return contract.OneLaw(
        variable=law.variable,
        part=law.part,
        source_joint=_source(law),
        shapes=tuple(contract.LawShape(kind=one.kind, order=one.order) for one in law.shapes),
        probability=probability,
    )


def _source(law: Law) -> int | None:
    """Joint whose angle or torque it is a law of, where that is another."""
    return law.source if law.source and law.source != law.where else None


def _amplitude(effect: Effect, one: EffectSize) -> contract.Amplitude:
    joint = effect.axis or f"joint {effect.where}"
    return contract.Amplitude(
        name=one.parameter.name,
        value=one.value,
        std=one.std,
        unit=one.parameter.unit,
        ci95=one.ci95,
        meaning=one.parameter.meaning.format(joint=joint) or "size",
    )


def _unnamed(cause: FoundCause) -> contract.Unnamed | None:
    if cause.unnamed is None and not cause.outside:
        return None
    one = cause.unnamed.effect if cause.unnamed else None
    as_good = tuple(
        contract.AsGood(
            **_at(other.effect),
            reduction=other.reduction,
            ci95=other.ci95,
            times_typical=other.times_typical,
        )
        for other in cause.as_good
    )
    return contract.Unnamed(
        probability=cause.outside,
        looks_like=one.name if one else None,
        where=one.where if one else None,
        as_good=as_good,
    )


def _alone(one: SoleCause) -> contract.Alone:
    return contract.Alone(
        **placed(one.effect),
        probability=one.probability,
        reduction=one.reduction,
        ci95=one.ci95,
    )


def _gain(cause: FoundCause) -> contract.Gain | None:
    if cause.gain is None:
        return None
    change = cause.test_pose_change_m
    return contract.Gain(
        held_out_rms_before_mm=cause.gain.rms_before_m * 1e3,
        held_out_rms_after_mm=cause.gain.rms_after_m * 1e3,
        reduction=cause.gain.reduction,
        ci95=cause.gain.ci95,
        of=Predicted(cause.gain.of),
        test_pose_change_mm=None if change is None else change * 1e3,
    )


def _blind(spot: Unnoticed) -> contract.BlindSpot:
    first = spot.effect.parameters[0]
    return contract.BlindSpot(
        **_at(spot.effect),
        why=spot.why,
        smallest_visible=spot.smallest_visible,
        parameter=first.name,
        unit=first.unit,
        typical=first.typical,
        needs=spot.effect.needs,
    )


def _pose(proposal: SeparatingPose, robot: Robot) -> contract.NextPose:
    return contract.NextPose(
        **_to_measure(proposal.at, robot),
        separates=proposal.separates,
        sigmas_before=proposal.before,
        sigmas_after=proposal.after,
        pose=proposal.poses,
    )


def _to_measure(pose: ProposedPose, robot: Robot) -> dict[str, Any]:
    """Fields of `contract.ToMeasure`."""
    q = np.where(robot.prismatic, pose.q, np.rad2deg(pose.q))
    return {
        "q": tuple(round(float(v), 4) for v in q),
        "q_unit": tuple("m" if j.prismatic else "deg" for j in robot.joints),
        "anchor_m": tuple(round(float(v), 3) for v in pose.anchor),
        "direction": tuple(round(float(v), 3) for v in pose.force / pose.force_n),
        "force_n": round(round(pose.force_n, 3), 0),  # read as 3032.50, and rounded anywhere alike
        "steps": pose.steps,
        "approach": pose.approach if robot.joints[0].prismatic else None,
        "axes": axis_values(robot, np.asarray(pose.q, float)) if robot.controller else (),
    }


def best_pose(
    diagnosis: Diagnosed, robot: Robot, joint: contract.Stiffness | None
) -> contract.BestPose | None:
    """The pose that would determine a joint best; None where none is known.

    Uncertainties scale from those of the joint springs to those of the answer.
    """
    if not diagnosis.determining or joint is None:
        return None
    found = diagnosis.determining[joint.joint - 1]
    now = joint.relative_std if joint.value is not None else found.before
    after = None if now is None else now * found.after / found.before
    return contract.BestPose(
        **_to_measure(found.at, robot),
        name=joint.name,
        relative_std_before=now,
        relative_std_after=after,
        determines=joint.value is not None or found.after < _DETERMINED,
    )


_DETERMINED = 0.5
"""Standard uncertainty below which a joint has a value, in typical sizes: `identifiable`."""


def _data_causes(found: CampaignResults) -> tuple[contract.Cause, ...]:
    """The mistakes in the data, as causes."""
    if not found.mistakes:
        return ()
    before, after = (left_out_mm(left_out(one.system)) for one in (found.given, found.right))
    gain = contract.Gain(
        held_out_rms_before_mm=before,
        held_out_rms_after_mm=after,
        reduction=1 - after / before if before and after is not None else None,
        ci95=None,
        test_pose_change_mm=None,
    )
    return tuple(mistake_entry(one, gain) for one in found.mistakes)


def mistake_entry(one: Mistake, gain: contract.Gain | None) -> contract.Cause:
    """A mistake in the data; `gain` is what putting right all of them is worth.

    It and those of which one may be wrong instead share its probability.
    """
    share = (1 - (one.p_value or 0.0)) / (1 + len(one.instead))
    size = contract.Amplitude(name="size", value=one.size, std=None, unit=one.size_unit)
    return contract.Cause(
        name=one.name,
        where=int(one.where) if one.where.isdigit() else one.where,
        probability=share,
        parameters=() if one.size is None else (size,),
        p_value=one.p_value,
        rivals=tuple(
            contract.Rival(name=one.name, where=other, probability=share) for other in one.instead
        ),
        gain=gain,
        readings=tuple(dict.fromkeys(one.at)),
        since=one.since,
        evidence=contract.Evidence(
            sentence=one.evidence,
            correction=one.correction,
            before=one.before,
            after=one.after,
            unit=one.unit,
        ),
    )


def noise_entry(right: Fitted) -> contract.FoundNoise:
    """The noise found in the data beside the stated one, and along and across the beam."""
    found, beam = right.noise, right.shape.beam
    parts = zip(("along_beam", "across_beam"), beam.found, beam.std, strict=True)
    return contract.FoundNoise(
        from_=NoiseFrom(right.estimate.noise_from),
        used_over_stated=right.scatter if found.stated else None,
        contrasts=found.dof,
        components=(
            *(
                contract.NoiseComponent(
                    name=name,
                    found_over_stated=float(found.scale[i]),
                    std=float(found.std[i] * found.scale[i]),
                    p_value=float(found.p_value[i]),
                )
                for i, name in enumerate(found.name)
                if np.isfinite(found.std[i])
            ),
            *(
                contract.NoiseComponent(
                    name=name, found_over_stated=scale, std=std * scale, p_value=beam.p_value
                )
                for name, scale, std in parts
                if beam.better
            ),
        ),
    )


def _shaped(right: Fitted, has_times: bool) -> list[contract.Cause]:
    """Tails heavier than stated, and a wander of the instrument, beside a model that fits.

    A wander by which the readings still scatter less than stated is within the statement.

    Without times the order of rows is the clock, and how long it wanders is not known.
    """
    found, family, wander = right.shape, right.shape.family, right.shape.wander
    beyond = not right.noise.stated or right.scatter > 1
    freedom = contract.Amplitude(
        name="degrees_of_freedom",
        value=family.freedom,
        std=None,
        unit="1",
        meaning="degrees of freedom of the readings' distribution",
    )
    size = contract.Amplitude(
        name="s_wander",
        value=wander.size,
        std=wander.std,
        unit="m",
        meaning="wander of the instrument",
    )
    time = contract.Amplitude(
        name="correlation_time",
        value=wander.time_s if has_times else None,
        std=None,
        unit="s",
        meaning="time over which it wanders",
    )
    tails = _noise_cause("heavy_tails", family.p_value, (freedom,))
    slow = _noise_cause("tracker_wander", wander.p_value, (size, time))
    loosest = [] if found.loosest is None else [_loosest(found.loosest, right)]
    tailed, wanders = found.tailed and not loosest, found.wanders and beyond
    return [*loosest, *(one for there, one in ((tailed, tails), (wanders, slow)) if there)]


def _loosest(one: LoosestTarget, right: Fitted) -> contract.Cause:
    """Tails that come from a single target, with its name."""
    width = contract.Amplitude(
        name="s_target",
        value=one.width,
        std=None,
        unit="1",
        meaning="scatter of the target over that of the others",
    )
    return _noise_cause(
        "heavy_tails", one.p_value, (width,), right.case.settings.measured[one.target]
    )


_SOURCE_OF = {"force": "scale"}
"""What scatters, where the component has another name."""


def _noisy(found: Components, i: int) -> contract.Cause:
    """A noise component that is larger than stated, as a cause."""
    name, p = found.name[i], float(found.p_value[i])
    word = name.split("_")[0]
    excess = contract.Amplitude(
        name=f"s_{word}",
        value=float(found.scale[i]) - 1,
        std=float(found.std[i] * found.scale[i]),
        unit="1",
        meaning=f"noise of the {_SOURCE_OF.get(word, word)} beyond that stated",
    )
    return _noise_cause(NAMES[name], p, (excess,))


def _noise_cause(
    name: str, p: float, parameters: tuple[contract.Amplitude, ...], where: str | None = None
) -> contract.Cause:
    return contract.Cause(
        name=name,
        where=where,
        probability=at_most(p),
        parameters=parameters,
        p_value=p,
        rivals=(),
        gain=None,
    )
