"""What leaves the pipeline: the answer to a campaign, whose dump is result.json."""

from __future__ import annotations

from pipeline.answer import contract
from pipeline.answer.contract import Answer
from pipeline.answer.diagnosis import diagnosis_entry, noise_entry
from pipeline.answer.findings import Findings, Told
from pipeline.answer.fit import fit_entry
from pipeline.answer.inputs import (
    assumptions,
    input_entries,
    measured_on,
    registration_entry,
    registration_findings,
    rejected_entries,
)
from pipeline.answer.prediction import deflection_entries, validation_entry
from pipeline.answer.recommended import Values
from pipeline.answer.sentences import sentences
from pipeline.answer.stiffness import budget_entries, stiffness_entries
from pipeline.answer.words import because
from pipeline.machine.effect import Effect, Observation
from pipeline.machine.effects import catalogue
from pipeline.reduction.pose_of_interest import Where
from pipeline.store.campaign import versions


def answer(found: Findings) -> Answer:
    """The answer to a campaign."""
    given, raw, where = found.given, found.raw, found.where
    values, springs = _values_entry(found.told, where), _values_entry(found.springs, where)
    return Answer(
        format=1,
        campaign=found.campaign,
        name=raw.settings.name,
        robot=raw.settings.robot,
        measured=measured_on(raw.settings, given.reduced.shown["readings"]),
        verdict_sentence=tuple(sentences(found, values, springs)),
        recommended=_recommended_entry(found),
        stiffness=values.stiffness,
        fit=values.fit,
        validation=values.validation,
        test_pose_deflection=values.test_pose_deflection,
        diagnosis=diagnosis_entry(found),
        joint_springs=springs,
        extended=_extended_entry(found),
        budget=budget_entries(values.stiffness),
        noise=noise_entry(found.right.noise, found.right.estimate),
        rejected=rejected_entries(given.case.rejected),
        findings=(*_registration_findings(found), *_said_of(values)),
        registration=registration_entry(given.reduced.registration),
        model=contract.Forward(
            equilibrium=contract.Equilibrium(found.told.values.first.cell.equilibrium)
        ),
        assumptions=tuple(assumptions(raw, where)),
        inputs=input_entries(raw),
        versions=versions(),
    )


def _said_of(values: contract.Values) -> list[str]:
    """What there is to know of the stiffnesses."""
    return [joint.finding for joint in values.stiffness if joint.finding]


def _registration_findings(found: Findings) -> list[str]:
    """What there is to know of the base reflectors."""
    drifts = any(
        isinstance(cause.effect, Observation) and cause.effect.instrument
        for cause in found.diagnosis.causes
    )
    return registration_findings(found.given.reduced.registration, drifts)


def _recommended_entry(found: Findings) -> contract.Recommended:
    """Which values stand at the top, and why."""
    row = found.row
    return contract.Recommended(
        model=row.model,
        data=row.data,
        reason=row.reason,
        why=because(row.reason),
        hypotheses=_hypothesis_entries(found.told.values),
    )


def _values_entry(told: Told, where: Where) -> contract.Values:
    """Stiffnesses, fit, validation and deflection at the test pose of one model."""
    values = told.values
    fitted, left = values.fitted, values.left_out_m
    return contract.Values(
        stiffness=stiffness_entries(fitted.case.cell, values.hypotheses),
        fit=fit_entry(fitted.case.cell, fitted.data, values.first.estimate),
        validation=None if told.checked is None else validation_entry(told.checked, left, where),
        test_pose_deflection=deflection_entries(told.model, where),
    )


def _hypothesis_entries(values: Values) -> tuple[contract.Weighed, ...]:
    """What the values are averaged over, with the weight of each."""
    known = {effect.label for effect in catalogue(values.fitted.case.robot)}
    return tuple(
        contract.Weighed(
            weight=one.weight,
            causes=tuple(_believed(effect, effect.label in known) for effect in one.effects),
        )
        for one in values.hypotheses
    )


def _believed(effect: Effect, known: bool) -> contract.Believed:
    return contract.Believed(
        name=effect.name, where=effect.where, form=effect.form or None, in_catalogue=known
    )


def _extended_entry(found: Findings) -> contract.Extended | None:
    """`extended`: the identified causes' own fit; None without causes."""
    own = found.extended
    if own is None:
        return None
    fitted = own.fitted
    model = own.model(found.campaign, found.verdict, found.row)
    return contract.Extended(
        stiffness=stiffness_entries(fitted.case.cell, own.hypotheses),
        fit=fit_entry(fitted.case.cell, fitted.data, own.first.estimate),
        test_pose_deflection=deflection_entries(model, found.where),
    )
