"""The answer to a campaign of absolute positions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pandas as pd

from pipeline.answer import contract
from pipeline.answer.contract import About, Answer, Line, NoiseFrom, Reason
from pipeline.answer.diagnosis import cause_entry, mistake_entry, placed
from pipeline.answer.inputs import (
    identity_entry,
    measured_on,
    of_campaign,
    rejected_entries,
)
from pipeline.answer.recommended import DecisionBasis, DecisionRow, decide
from pipeline.answer.remarks import contradicted
from pipeline.answer.sentences import entered
from pipeline.answer.stiffness import stiffness_entry
from pipeline.answer.words import (
    BECAUSE,
    capital,
    clear,
    correct,
    law_told,
    listed,
    mistaken,
    sized,
    why,
    wrong,
)
from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.base.linear import rms
from pipeline.base.quantities import p_value, percent, plain, with_std
from pipeline.base.tails import NORMAL_95, chi2_beyond
from pipeline.diagnosis.average import Springs
from pipeline.diagnosis.facts import Facts, FoundCause
from pipeline.diagnosis.verdict import findings, verdict
from pipeline.faults.mistake import Mistake
from pipeline.geometry.unloaded import START
from pipeline.machine.effect import in_place
from pipeline.machine.robot import Joint, Robot
from pipeline.machine.robot.axes import alone
from pipeline.machine.robot.weight import weighs
from pipeline.positions.calibrate import Calibration
from pipeline.positions.cross_validation import Partition
from pipeline.positions.estimate import determined_joints as by_weight
from pipeline.positions.facts import facts_of
from pipeline.positions.mechanism import layout
from pipeline.positions.pose_errors import unusual
from pipeline.positions.position_rows import farther_than_real
from pipeline.positions.remarks import remarks
from pipeline.positions.study import ModelStage, StageResult, Study
from pipeline.positions.table_entries import table_combinations, table_entries
from pipeline.store.campaign import Raw


@dataclass(frozen=True, eq=False)
class PositionsResults:
    """All that a run found out about a campaign of positions.

    Attributes:
        campaign: Its name.
        raw: Its files.
        found: What was identified from the data without mistakes.
        facts: What the verdict follows from, mistakes included.
        row: Which values the answer gives, and why.
        rejected: Table REJECTED.
    """

    campaign: str
    raw: Raw
    found: Study
    facts: Facts
    row: DecisionRow
    rejected: pd.DataFrame

    @classmethod
    def of(
        cls,
        campaign: str,
        raw: Raw,
        found: Study,
        mistakes: tuple[Mistake, ...],
        rejected: pd.DataFrame,
    ) -> PositionsResults:
        """With its facts, and the row of the one table of decisions that holds for them."""
        facts = facts_of(found, raw.robot, mistakes)
        rest = verdict(replace(facts, mistakes=()))
        row = decide(DecisionBasis(bool(mistakes), rest, bool(facts.causes), rivals=False))
        return cls(campaign, raw, found, facts, row, rejected)

    def ending(self, found: Study) -> PositionsResults:
        """The same with another estimate of the whole model."""
        return PositionsResults.of(
            self.campaign, self.raw, found, self.facts.mistakes, self.rejected
        )

    @property
    def usable(self) -> bool:
        """Whether a controller may have the values."""
        return self.row.reason.holds_for_its_readings and not self.facts.mistakes


def answer(results: PositionsResults) -> Answer:
    """The answer to a campaign of positions."""
    raw, found, row = results.raw, results.found, results.row
    last, springs = found.stages[-1], _stage(found, ModelStage.SPRINGS)
    lines = tuple(_first_screen(results))
    values, payloads = _values(last), payload_entries(last.found)
    rejected = rejected_entries(results.rejected)
    return Answer(
        **of_campaign(results.campaign, raw, raw.settings, lines),
        measured=measured_on(raw.settings, None),
        recommended=contract.Recommended(
            model=row.model,
            data=row.data,
            table=contract.TableSource.ESTIMATED,
            reason=row.reason,
            why=_WHY.get(row.reason, BECAUSE[row.reason]),
            hypotheses=(
                contract.Weighed(
                    weight=1.0,
                    causes=tuple(
                        contract.Believed(**placed(one.effect), in_catalogue=one.effect.law is None)
                        for one in results.facts.causes
                    ),
                ),
            ),
        ),
        **dict(values),
        payloads=payloads,
        diagnosis=_diagnosis(results, lines[0].text),
        joint_springs=_values(springs),
        extended=_extended(last) if results.facts.causes else None,
        budget=(),
        noise=contract.FoundNoise(from_=_noise_from(last.found), contrasts=0, components=()),
        rejected=rejected,
        findings=(
            *(f"{capital(one)}." for one in farther_than_real(_nominal_m(found))),
            *(f"{one}." for one in remarks(raw.settings, last.found.readings)),
            *contradicted(payloads, "positions"),
            *_untested(payloads),
            *_instrument(found),
        ),
        registration=None,
        identity=identity_entry(
            raw.settings, None, np.arange(len(last.found.readings)), np.zeros((0, 3))
        ),
        geometry=_letter_entries(last.found),
        geometry_combinations=_letter_combinations(last.found),
        position_steps=tuple(_step(one) for one in found.stages),
        model=contract.Forward(equilibrium=contract.Equilibrium.UNDEFORMED),
        assumptions=(
            *raw.robot.assumptions,
            *_ASSUMED,
            *(() if last.found.wanted.moments else (_STATED,)),
        ),
    )


def payload_entries(found: Calibration) -> tuple[contract.Payload, ...]:
    """Every payload as stated, and as springs and positions together have it.

    With d = estimate - stated, u the stated standard uncertainties and C the covariance after the
    readings, z = d / u is N(0, S = 1 - C / (u u')) where what is stated is right: p is that of
    z' S^-1 z, over the directions of which the readings tell something.
    """
    bodies, where = found.weights.payloads, layout(found.mechanism).payload
    cov = found.solution.cov[where, where]
    out = []
    for k, name in enumerate(bodies.names):
        at, off = slice(4 * k, 4 * k + 4), found.mechanism.payload[k]
        poses = int(np.sum(found.weights.carried == k + 1))
        free = bodies.std[k] > 0
        determined = poses > 0 and free.any()
        std = np.where(free, np.sqrt(np.diag(cov[at, at])), 0.0)
        stated = np.append(bodies.mass[k], bodies.centre[k])
        out.append(
            contract.Payload(
                name=name,
                stated=_body(stated, bodies.std[k]),
                found=_body(stated + off, std) if determined else None,
                poses=poses if determined else 0,
                p_value=_chance(off[free], bodies.std[k][free], cov[at, at][np.ix_(free, free)])
                if determined
                else None,
            )
        )
    return tuple(out)


def _chance(off: Array, std: Array, cov: Array) -> float:
    """Chance of being so far from what is stated, by what the readings tell of it."""
    share, along = linear.directions(np.eye(len(off)) - cov / std / std[:, None])
    determined = share > _TOLD
    z = along.T[determined] @ (off / std)
    return float(chi2_beyond(float(np.sum(z**2 / share[determined])), int(determined.sum())))


_TOLD = 0.01
"""Part of a stated variance that the readings have to take away to tell something."""


def _untested(payloads: Sequence[contract.Payload]) -> Iterator[str]:
    """A sentence on each payload whose mass is found as stated because the readings do not tell."""
    for one in payloads:
        if one.found is not None and one.stated.mass_std_kg > 0:
            told = by_readings(one.stated.mass_kg, one.stated.mass_std_kg, one.found)
            yield from () if told is None else (_not_told(one, *told),)


def by_readings(mass_kg: float, std_kg: float, found: contract.Body) -> tuple[float, float] | None:
    """Mass and standard uncertainty by the readings alone [kg]; None if they test what is stated.

    With the share s of the stated variance u^2 that the readings take away, d = estimate - stated,

        mass = stated + d / s,   std = u sqrt((1 - s) / s)

    Args:
        mass_kg: Stated mass.
        std_kg: Its stated standard uncertainty u.
        found: The payload by springs, positions and what is stated together.
    """
    share = 1 - (found.mass_std_kg / std_kg) ** 2
    if share > _TOLD:
        return None
    if share < _ROUNDED:
        return mass_kg, np.inf
    off = found.mass_kg - mass_kg
    return mass_kg + off / share, std_kg * float(np.sqrt((1 - share) / share))


_ROUNDED = 1e-6
"""Part of a stated variance that is lost in rounding [1]."""


def _not_told(one: contract.Payload, mass_kg: float, std_kg: float) -> str:
    told = f"by themselves they put it at {with_std(mass_kg, std_kg)} kg"
    if std_kg > one.stated.mass_kg:
        told = "they hardly tell it"
    return (
        f"These readings do not test the stated mass of the payload {one.name}, "
        f"{with_std(one.stated.mass_kg, one.stated.mass_std_kg)} kg: {told}, and the stiffnesses "
        "rest on the stated one."
    )


def _body(values: Array, std: Array) -> contract.Body:
    """Mass and centre (4,) with their standard uncertainties."""
    (mass, x, y, z), (u, a, b, c) = values.tolist(), std.tolist()
    return contract.Body(mass_kg=mass, mass_std_kg=u, center_m=(x, y, z), center_std_m=(a, b, c))


_WHY = {
    Reason.CAUSE_IDENTIFIED: "Laws of the joints were identified that reduce the cross-validation "
    "error: the model includes them with DH parameters and springs.",
    Reason.ADEQUATE: "DH parameters and springs predict held-out poses as well as any other model "
    "that was tried.",
    Reason.UNEXPLAINED: "Neither DH parameters nor springs nor any known cause explains the "
    "readings: do not rely on the stated uncertainties.",
}
"""Where it is another one than of pulls."""

_STATED = (
    "stiffnesses come from the weight of the links in the robot file; an error of these weights is "
    "an error of the stiffnesses"
)
_ASSUMED = (
    "gravity acts along -z of the robot's base, unless campaign.toml states otherwise",
    "each joint has an error at each pose that no model describes, estimated from the readings; "
    "it is included "
    "in the uncertainty of every prediction",
)


def _stage(found: Study, step: ModelStage) -> StageResult:
    return next(one for one in found.stages if one.step is step)


def _values(stage: StageResult) -> contract.Values:
    return contract.Values(
        stiffness=_stiffness_entries(stage.found),
        fit=_fit(stage.found),
        validation=_validation(stage),
        test_pose_deflection=(),
    )


def _extended(stage: StageResult) -> contract.Extended:
    return contract.Extended(
        stiffness=_stiffness_entries(stage.found), fit=_fit(stage.found), test_pose_deflection=()
    )


def _stiffness_entries(found: Calibration) -> tuple[contract.Stiffness, ...]:
    """One record per joint, from what the arm's own weight does to it."""
    part, robot = layout(found.mechanism).compliance, found.mechanism.table
    x, cov = found.solution.x[part], found.cov[part, part]
    std = np.sqrt(np.diag(cov))
    known = by_weight(found.mechanism, found.known, x, std**2)
    springs = Springs(x, cov, x - NORMAL_95 * std, x + NORMAL_95 * std, known)
    return tuple(
        _stiffness_of(one, _about(joint, float(x[k]), bool(known[k]), found.wanted.moments))
        for k, joint in enumerate(robot.joints)
        for one in [stiffness_entry(joint, springs, k, (), alone(robot)[k])]
    )


def _stiffness_of(one: contract.Stiffness, finding: str | None) -> contract.Stiffness:
    """A stiffness with what is to be known of it; a compliance that is not determined is none."""
    nothing = {} if one.identifiable else _UNKNOWN
    return one.model_copy(update={"finding": finding, **nothing})


_UNKNOWN = {"compliance": None, "compliance_std": None, "ci95": (None, None)}


def _about(joint: Joint, x: float, known: bool, any_weight: bool) -> str | None:
    name = f"k_{joint.name}"
    if not known and any_weight:
        return f"{name} is not determined: how heavy what that joint carries is, is not known."
    if not known:
        return f"{name} is not determined: the weight of the arm hardly turns that joint."
    if x <= 0:
        return (
            f"{name} comes out negative: something else moves that joint with the weight; "
            "hang a known load on the flange."
        )
    return None


def _letter_entries(found: Calibration) -> tuple[contract.TableLetter, ...]:
    """The robot's table as found."""
    mechanism, known = found.mechanism, found.known
    k = len(mechanism.values)
    return table_entries(
        mechanism.table,
        mechanism.values,
        np.diag(found.cov)[:k],
        np.array([known.roughness(letter.turns) for letter in mechanism.letters]),
        known.std[:k],
    )


def _letter_combinations(found: Calibration) -> tuple[contract.TableCombination, ...]:
    """What is determined of several entries of the robot's table together."""
    k = len(found.mechanism.values)
    cov = found.cov[:k, :k]
    return table_combinations(_letter_entries(found), cov, cov, found.known.std[:k])


def _fit(found: Calibration) -> contract.Fit:
    e = found.rows.y - found.rows.along(found.solution.x)
    seen = found.linear.read
    effective = float(np.sum(found.rows.variance(found.solution).diagonal(axis1=1, axis2=2)))
    off = found.left.reshape(len(e), -1, 6)[..., :3][seen.reshape(len(e), -1, 6)[..., :3]]
    std = 1e3 * found.scatter.position
    return contract.Fit(
        rms_mm=1e3 * rms(off),
        chi2=float(np.sum(e**2)),
        dof=round(float(seen.sum()) - effective),
        p_value=None,
        noise_from=_noise_from(found),
        residual_std_mm=std,
        second_order_rms_mm=None,
        noise_statement=f"A coordinate scatters by {plain(std, 2)} mm, "
        + ("as stated" if found.scatter.stated else "found from the residuals")
        + "; the error of each joint at each pose is estimated separately.",
    )


def _noise_from(found: Calibration) -> NoiseFrom:
    return NoiseFrom.STATED if found.scatter.stated else NoiseFrom.RESIDUALS


def _validation(stage: StageResult) -> contract.Validation:
    off = 1e3 * stage.errors[Partition.BETWEEN]
    off = off[np.isfinite(off)]
    none = contract.Drawn(test_pose={}, global_={})
    return contract.Validation(
        test_pose={},
        global_={},
        held_out_rms_mm=rms(off) / np.sqrt(3.0),
        independent=none,
        poses=len(stage.found.readings),
        test_pose_stated=False,
        held_out_position_mm=contract.HeldOutPosition(
            mean=float(off.mean()), rms=rms(off), p95=float(np.quantile(off, 0.95))
        ),
    )


def _step(stage: StageResult) -> contract.PositionStep:
    mm = {parting: 1e3 * stage.mean(parting) for parting in stage.errors}
    return contract.PositionStep(
        model=stage.step.value,
        between_mm=mm[Partition.BETWEEN],
        space_mm=mm[Partition.SPACE],
        series_mm=mm.get(Partition.SERIES),
    )


def _called(robot: Robot, joint: int) -> str:
    """`joint 3 (A2)`."""
    return in_place(joint, axis=alone(robot)[joint - 1]).removeprefix(" in ")


def _nominal_m(found: Study) -> float:
    """Distance of targets of held-out poses from the robot as delivered [m], a mean."""
    return found.stages[0].mean(Partition.BETWEEN)


def _instrument(found: Study) -> Iterator[str]:
    """When the instrument or a target moved, and what was made of it."""
    for one in found.moved:
        where = f"pose {one.pose} of series {one.series}" if one.series else f"pose {one.pose}"
        shift, turn = 1e3 * one.shift_m, 1e3 * one.turn_rad
        yield (
            f"From {where} on target {one.target} stands {plain(shift, 2)} mm from where it was on "
            f"the effector ({p_value(one.p)}). Its readings since count as those of another target."
            if one.target
            else f"From {where} on the instrument sees the robot's base {plain(shift, 2)} mm and "
            f"{plain(turn, 2)} mrad from where it was ({p_value(one.p)}): the instrument moved, or "
            "the base. These poses count as a series of their own, with a frame of their own."
        )


def _first_screen(results: PositionsResults) -> Iterator[Line]:
    """The first screen, line by line as for a campaign of pulls."""
    stiffness = _stiffness_entries(results.found.stages[-1].found)
    lines = (
        (About.VERDICT, _verdict(results)),
        (About.TO_DO, _to_do(results)),
        (About.MODEL, _model(results)),
        (About.NUMBERS, _numbers(results, stiffness)),
        (About.TOLERANCE, _NOT_JUDGED),
        (About.WRONG, " ".join(_wrong(results))),
        (About.NEXT, " ".join(_next(results, stiffness))),
    )
    return (Line(about=about, text=text) for about, text in lines)


def _verdict(results: PositionsResults) -> str:
    """The mistakes, or that nothing explains the readings, and how well they are predicted."""
    first, last = (1e3 * results.found.stages[k].mean(Partition.BETWEEN) for k in (0, -1))
    predicted = (
        f"Targets of held-out poses are predicted to {plain(last, 2)} mm on average, and to "
        f"{plain(first, 2)} mm with the nominal DH parameters."
    )
    if results.facts.mistakes:
        return f"{mistaken(results.facts)} {predicted}"
    if not results.row.reason.holds_for_its_readings:
        return f"{_WHY[Reason.UNEXPLAINED]} {predicted}"
    return predicted


def _to_do(results: PositionsResults) -> str:
    """What to do with the values, and what of them no controller takes."""
    if results.facts.mistakes:
        return f"{correct(results.facts)} enter none of these values into a controller."
    if not results.row.reason.holds_for_its_readings:
        return "Use none of these values; find out first what the model misses, and run again."
    causes = results.facts.causes
    acting = len(causes) > len(_changed_zeros(causes))
    beside = " A controller's table has no entry for the causes." if acting else ""
    those = "DH parameters, springs and causes together" if beside else _ALONE
    return (
        f"Use {those}: predict the positions of targets at other joint values with `pipeline "
        f"predict {results.campaign} poses.csv`.{beside}"
    )


_ALONE = "the identified DH parameters with their springs"


def _numbers(results: PositionsResults, stiffness: Sequence[contract.Stiffness]) -> str:
    """What a controller may have: nothing from wrong readings, or from unexplained ones."""
    if results.usable:
        return " ".join([entered(stiffness, ()), *_by_weight(results, stiffness)])
    if results.facts.mistakes:
        return "None until the files are put right: what the values rest on is corrected data."
    return "Enter no value: the model does not explain the readings."


def _by_weight(results: PositionsResults, stiffness: Sequence[contract.Stiffness]) -> Iterator[str]:
    """What the weight has to do with the stiffnesses."""
    if any(joint.value is not None for joint in stiffness):
        yield "They come from the arm's own weight."
    if results.found.final.wanted.moments and _sags(results) and not weighs(results.raw.robot):
        yield _SAGS


def _sags(results: PositionsResults) -> bool:
    return any(one.effect.name == "gravity_sag" for one in results.facts.causes)


_SAGS = "How far each joint sags is seen, but without stated masses no stiffness follows from it."
_NO_SAG = "No sag is visible: the arm is weightless or balanced, or its controller compensates it."


def _model(results: PositionsResults) -> str:
    """What the model holds, and what each part of it is worth."""
    steps = list(pairwise(results.found.stages))
    between = Partition.BETWEEN
    gains = [
        (now.step.value, percent(gain), gain)
        for before, now in steps
        if now.found is not before.found
        for gain in [1 - now.mean(between) / before.mean(between)]
    ]
    each = [f"{part} by {size}" for part, size, gain in gains if gain > 0]
    idle = [part for part, _, gain in gains if gain <= 0]
    parts = ["table", "springs under the arm's weight"]
    listed_, laws = (_those(results.facts.causes, law) for law in (False, True))
    parts += ["causes of the catalogue"] if listed_ else []
    whose = listed([*parts, *(["laws of the joints"] if laws else [])])
    corrected = results.row.data == contract.Data.CORRECTED
    data = "the corrected data" if corrected else "the data as given"
    return (
        f"{capital(whose)}, from {data}. The cross-validation error "
        f"falls with each part: {', '.join(each)}"
        f"{f'; with {listed(idle)} it does not fall' if idle else ''}."
    )


_NOT_JUDGED = (
    "Not decided: no load was applied, so these readings do not show how far the robot deflects "
    "under process forces."
)


def _wrong(results: PositionsResults) -> Iterator[str]:
    facts, beside = results.facts, list(besides_causes(results))
    if facts.moved or not results.row.reason.holds_for_its_readings:
        yield wrong(facts, 0)
    elif facts.causes:
        yield from _named(facts.causes)
    if clear(facts):
        yield from _nothing_else(results, beside)
    if results.usable and results.found.final.wanted.moments and not _sags(results):
        yield _NO_SAG
    yield from beside


def _nothing_else(results: PositionsResults, beside: Sequence[str]) -> Iterator[str]:
    """What is said where no finding calls for more."""
    if results.facts.mistakes and _erring(results.found, results.raw.robot) is None:
        yield wrong(results.facts, 0)
    elif not (results.facts.causes or beside):
        yield "Nothing detectable in these readings."


def besides_causes(results: PositionsResults) -> Iterator[str]:
    """What is wrong beside causes: the instrument, a joint, rows that were left out."""
    left_out = len(results.rejected)
    yield from _instrument(results.found)
    yield from filter(None, [_erring(results.found, results.raw.robot)])
    if left_out:
        rows = "1 row of the files was" if left_out == 1 else f"{left_out} rows of the files were"
        yield f"{rows} left out; see Rejected rows for file and line of each."


def _named(causes: Sequence[FoundCause]) -> Iterator[str]:
    """What of the catalogue acts, zeros that changed, and the largest law outside of it."""
    known, laws = (_those(causes, law) for law in (False, True))
    zeros = _changed_zeros(known)
    if known := [one for one in known if not one.effect.since]:  # moves are told by themselves
        those = listed([one.effect.called for one in known])
        yield f"Besides the joint springs, {those} {'act' if len(known) > 1 else 'acts'}."
    for one in zeros:
        yield (
            f"{capital(sized(one.effect.called, one.amplitudes[0]))}: the table and predictions "
            "are those of the robot since."
        )
    if laws:
        of = "a law" if len(laws) == 1 else f"the largest of {len(laws)} laws"
        yield f"{capital(law_told(laws[0]))}: {of} outside the catalogue."


def _changed_zeros(causes: Sequence[FoundCause]) -> list[FoundCause]:
    """Joints referenced anew, or slipped, in mid-campaign: the identified table holds them."""
    return [one for one in causes if one.effect.name == "joint_offset"]


def _those(causes: Sequence[FoundCause], law: bool) -> list[FoundCause]:
    """The causes that are laws nobody listed, or those that are not."""
    return [one for one in causes if (one.effect.law is not None) == law]


def _erring(found: Study, robot: Robot) -> str | None:
    """What moves the targets from pose to pose beyond all laws, if unusually."""
    errs = unusual(found)
    if errs is None:
        return None
    if errs.carriage is not None and errs.on_rail:
        shift, turn = (1e3 * float(one.max()) for one in np.split(errs.carriage, 2))
        return (
            f"The carriage errs by {plain(shift, 2)} mm and {plain(turn, 2)} mrad from pose to "
            "pose (largest standard deviations of a direction), which neither a smooth rail nor "
            "joints explain: a rail that is not straight over lengths shorter than from one "
            "station to the next, or a carriage that is loose on it."
        )
    worst = errs.joints[0]
    joints, usual = found.final.scatter.joints[worst], START[bool(robot.prismatic[worst])]
    unit = "mm" if robot.prismatic[worst] else "mrad"
    also = "" if errs.carriage is None else _CARRIAGE
    return (
        f"{capital(_called(robot, worst + 1))} errs by {plain(1e3 * joints, 2)} {unit} from "
        f"pose to pose (standard deviation; usual is {plain(1e3 * usual, 2)}), which no law "
        "that was tried explains: backlash, a slipping encoder, several effects that hide each "
        "other, or poses that are not those of the joint log"
        f"{also}."
    )


_CARRIAGE = (
    "; these poses do not tell it from a carriage that is loose, or on a rail that is not straight "
    "over lengths shorter than from one station to the next"
)


def _next(results: PositionsResults, stiffness: Sequence[contract.Stiffness]) -> Iterator[str]:
    last = results.found.stages[-1]
    if results.facts.mistakes:
        yield "Nothing until the files are put right: the readings taken may then do."
        return
    if not results.row.reason.holds_for_its_readings:
        yield _AGAIN
        return
    apart = Partition.SERIES if Partition.SERIES in last.errors else Partition.SPACE
    of = {Partition.SERIES: "a whole series", Partition.SPACE: "a tenth of joint space"}[apart]
    yield (
        f"Poses at the joint angles that you will use: where {of} is held out, the error is "
        f"{plain(1e3 * last.mean(apart), 2)} mm; expect as much where nothing was measured."
    )
    if any(joint.value is None for joint in stiffness):
        yield "Known loads on the flange determine the stiffnesses that the arm's weight does not."


_AGAIN = "Nothing until the readings are explained: those taken may then do."


def _diagnosis(results: PositionsResults, first_line: str) -> contract.Diagnosis:
    """`diagnosis`: mistakes in the data first, then the laws."""
    found, facts = results.found, results.facts
    first, last = found.stages[0], found.stages[-1]
    causes = (
        *(mistake_entry(one, None) for one in facts.mistakes),
        *(cause_entry(one) for one in (*facts.moved, *facts.causes)),
    )
    none = contract.PosesPulls(poses=None, pulls=None)
    return contract.Diagnosis(
        verdict=verdict(facts),
        why=first_line if clear(facts) and not facts.mistakes else why(facts),
        reasons=tuple(one.finding for one in findings(facts)),
        causes=causes,
        alone=(),
        unloaded_off_mm=(1e3 * first.mean(Partition.BETWEEN), 1e3 * last.mean(Partition.BETWEEN)),
        blind_spots=(),
        next_poses=(),
        refused=(),
        misfit_sits_at=(),
        detection=contract.Detection(
            threshold_p=None,
            smallest_p=min((law.p for law in found.laws), default=None),
            lack_of_fit_p=none,
            remainder_over_scatter=None,
            remainder_p=contract.Remainder(poses=None, pulls=None, further_cause=None),
        ),
        scatter=contract.Scatter(
            tracker_over_stated=None,
            tracker_over_stated_std=None,
            scale_over_tracker=None,
            known_from="residuals",
        ),
        equilibrium=contract.Equilibrium.UNDEFORMED,
        noise_floor_mm=1e3 * last.found.scatter.position,
    )
