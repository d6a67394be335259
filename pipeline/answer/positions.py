"""The answer to a campaign of absolute positions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import pandas as pd

from pipeline.answer import contract
from pipeline.answer.contract import (
    About,
    Answer,
    Data,
    JointType,
    Line,
    NoiseFrom,
    Predicted,
    Reason,
    Which,
)
from pipeline.answer.geometry import KNOWN, table_combinations, table_entries
from pipeline.answer.inputs import (
    identity_entry,
    input_entries,
    instrument_entry,
    measured_on,
    rejected_entries,
    unit_entry,
)
from pipeline.answer.remarks import contradicted
from pipeline.answer.sentences import entered
from pipeline.answer.words import BECAUSE, capital
from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.base.linear import rms
from pipeline.base.quantities import p_value, percent, plain
from pipeline.base.tails import chi2_beyond
from pipeline.diagnosis.finding import Verdict
from pipeline.diagnosis.verdict import STANDS_M, Row, of_positions
from pipeline.geometry.identify import Identified
from pipeline.geometry.mechanism import layout
from pipeline.geometry.named import NamedLaw
from pipeline.geometry.scatter import START
from pipeline.geometry.study import Stage, Step, Study
from pipeline.geometry.worth import Parting
from pipeline.machine.effect import in_place
from pipeline.machine.robot import Joint, Robot
from pipeline.machine.robot.axes import alone
from pipeline.store.campaign import Raw, versions

_QUANTILE = 1.959964
"""Of 95 % intervals: there are thousands of readings."""

UNLISTED = "unlisted_law"


def answer(campaign: str, raw: Raw, found: Study, rejected: pd.DataFrame) -> Answer:
    """The answer to a campaign of positions.

    Args:
        campaign: Its name.
        raw: Its files.
        found: What was identified.
        rejected: Table REJECTED.
    """
    last, springs = found.stages[-1], _stage(found, Step.SPRINGS)
    causes = tuple(_cause(law, raw.robot) for law in found.laws)
    row = of_positions(last.mean(Parting.BETWEEN), bool(causes))
    model = Which.EXTENDED if causes else Which.JOINT_SPRINGS
    reason = Reason.CAUSE_IDENTIFIED if causes else Reason.ADEQUATE
    why = _WHY[bool(causes)]
    if row.verdict is Verdict.UNEXPLAINED:
        reason, why = Reason.UNEXPLAINED, BECAUSE[Reason.UNEXPLAINED]
    lines = tuple(_first_screen(campaign, found, raw.robot, len(rejected)))
    shown = last if causes else springs
    values, payloads = _values(shown), payload_entries(shown.found)
    known = contract.Believed
    return Answer(
        format=1,
        campaign=campaign,
        name=raw.settings.name,
        robot=raw.robot.name,
        simulated=raw.settings.simulated,
        measured=measured_on(raw.settings, None),
        verdict_sentence=tuple(line.text for line in lines),
        first_screen=lines,
        recommended=contract.Recommended(
            model=model,
            data=Data.AS_GIVEN,
            table=contract.Table.ESTIMATED,
            reason=reason,
            why=why,
            hypotheses=(
                contract.Weighed(
                    weight=1.0,
                    causes=tuple(
                        known(name=UNLISTED, where=law.joint, form=law.kind, in_catalogue=False)
                        for law in found.laws
                    ),
                ),
            ),
        ),
        **dict(values),
        payloads=payloads,
        diagnosis=_diagnosis(found, row, causes, lines[0].text),
        joint_springs=_values(springs),
        extended=_extended(last) if causes else None,
        budget=(),
        noise=contract.Noise(from_=_noise_from(last.found), contrasts=0, components=()),
        rejected=rejected_entries(rejected),
        findings=(*contradicted(payloads, "positions"), *_instrument(found)),
        registration=None,
        instrument=instrument_entry(raw.settings),
        robot_unit=unit_entry(raw.settings),
        identity=identity_entry(
            raw.settings, None, np.arange(len(shown.found.readings)), np.zeros((0, 3))
        ),
        geometry=letter_entries(shown.found),
        geometry_combinations=letter_combinations(shown.found),
        position_steps=tuple(_step(one) for one in found.stages),
        model=contract.Forward(equilibrium=contract.Equilibrium.UNDEFORMED),
        assumptions=(*raw.robot.assumptions, *_ASSUMED),
        inputs=input_entries(raw),
        versions=versions(),
    )


def payload_entries(found: Identified) -> tuple[contract.Payload, ...]:
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
        told = poses > 0 and free.any()
        std = np.where(free, np.sqrt(np.diag(cov[at, at])), 0.0)
        stated = np.append(bodies.mass[k], bodies.centre[k])
        out.append(
            contract.Payload(
                name=name,
                stated=_body(stated, bodies.std[k]),
                found=_body(stated + off, std) if told else None,
                poses=poses if told else 0,
                p_value=_chance(off[free], bodies.std[k][free], cov[at, at][np.ix_(free, free)])
                if told
                else None,
            )
        )
    return tuple(out)


def _chance(off: Array, std: Array, cov: Array) -> float:
    """Chance of being so far from what is stated, by what the readings tell of it."""
    share, along = linear.directions(np.eye(len(off)) - cov / std / std[:, None])
    told = share > _TOLD
    z = along.T[told] @ (off / std)
    return float(chi2_beyond(float(np.sum(z**2 / share[told])), int(told.sum())))


_TOLD = 0.01
"""Part of a stated variance that the readings have to take away to tell something."""


def _body(values: Array, std: Array) -> contract.Body:
    """Mass and centre (4,) with their standard uncertainties."""
    (mass, x, y, z), (u, a, b, c) = values.tolist(), std.tolist()
    return contract.Body(mass_kg=mass, mass_std_kg=u, center_m=(x, y, z), center_std_m=(a, b, c))


_WHY = {
    True: "Laws of the joints were identified that reduce the cross-validation error: the model "
    "includes them with DH parameters and springs.",
    False: "DH parameters and springs predict held-out poses as well as any other model that was "
    "tried.",
}

_ASSUMED = (
    "gravity acts along -z of the robot's base, unless campaign.toml states otherwise",
    "stiffnesses come from the weight of the links in the robot file; an error of these weights is "
    "an error of the stiffnesses",
    "each joint has an error at each pose that no model describes, estimated from the readings; "
    "it is included "
    "in the uncertainty of every prediction",
)


def _stage(found: Study, step: Step) -> Stage:
    return next(one for one in found.stages if one.step is step)


def _values(stage: Stage) -> contract.Values:
    return contract.Values(
        stiffness=stiffness_entries(stage.found),
        fit=_fit(stage.found),
        validation=_validation(stage),
        test_pose_deflection=(),
    )


def _extended(stage: Stage) -> contract.Extended:
    return contract.Extended(
        stiffness=stiffness_entries(stage.found), fit=_fit(stage.found), test_pose_deflection=()
    )


def stiffness_entries(found: Identified) -> tuple[contract.Stiffness, ...]:
    """One record per joint, from what the arm's own weight does to it."""
    part, robot = layout(found.mechanism).compliance, found.mechanism.table
    value, var = found.solution.x[part], np.diag(found.solution.cov)[part]
    before = found.known.std[part] ** 2
    return tuple(
        _stiffness(number, joint, axis, float(x), float(np.sqrt(v)), bool(v < KNOWN * b))
        for number, (joint, axis, x, v, b) in enumerate(
            zip(robot.joints, alone(robot), value, var, before, strict=True), 1
        )
    )


def _stiffness(
    number: int, joint: Joint, axis: str | None, x: float, std: float, known: bool
) -> contract.Stiffness:
    has_value = known and x > 0
    return contract.Stiffness(
        joint=number,
        joint_name=joint.name,
        name=f"k_{joint.name}",
        unit=joint.stiffness_unit,
        value=1 / x if has_value else None,
        std=std / x**2 if has_value else None,
        ci95=_interval(x, std) if known else (None, None),
        identifiable=known,
        joint_type=JointType.PRISMATIC if joint.prismatic else JointType.REVOLUTE,
        axis=axis,
        compliance=x if known else None,
        compliance_std=std if known else None,
        compliance_unit=joint.compliance_unit,
        relative_std=std / x if has_value else None,
        nominal=joint.stiffness,
        finding=_about(joint, x, known),
        budget=(),
    )


def _interval(x: float, std: float) -> tuple[float | None, float | None]:
    """95 % limits of a stiffness by those of its compliance; None where that may be zero."""
    low, high = x - _QUANTILE * std, x + _QUANTILE * std
    return (1 / high if high > 0 else None, 1 / low if low > 0 else None)


def _about(joint: Joint, x: float, known: bool) -> str | None:
    if not known:
        return f"k_{joint.name} is not determined: the weight of the arm hardly turns that joint."
    if x <= 0:
        return (
            f"k_{joint.name} comes out negative: something else moves that joint with the weight; "
            "hang a known load on the flange."
        )
    return None


def letter_entries(found: Identified) -> tuple[contract.Letter, ...]:
    """The robot's table as found."""
    mechanism, known = found.mechanism, found.known
    k = len(mechanism.values)
    return table_entries(
        mechanism.table,
        mechanism.values,
        np.diag(found.solution.cov)[:k],
        np.array([known.roughness(letter.turns) for letter in mechanism.letters]),
        known.std[:k],
    )


def letter_combinations(found: Identified) -> tuple[contract.TableCombination, ...]:
    """What is determined of several entries of the robot's table together."""
    k = len(found.mechanism.values)
    cov = found.solution.cov[:k, :k]
    return table_combinations(letter_entries(found), cov, cov, found.known.std[:k])


def _fit(found: Identified) -> contract.Fit:
    e = found.rows.y - found.rows.along(found.solution.x)
    seen = found.linear.read
    held = float(np.sum(found.rows.variance(found.solution.cov).diagonal(axis1=1, axis2=2)))
    off = found.left.reshape(len(e), -1, 6)[..., :3][seen.reshape(len(e), -1, 6)[..., :3]]
    std = 1e3 * found.scatter.position
    return contract.Fit(
        rms_mm=1e3 * rms(off),
        chi2=float(np.sum(e**2)),
        dof=round(float(seen.sum()) - held),
        p_value=None,
        noise_from=_noise_from(found),
        residual_std_mm=std,
        second_order_rms_mm=None,
        noise_statement=f"A coordinate scatters by {plain(std, 2)} mm, "
        + ("as stated" if found.scatter.stated else "found from the residuals")
        + "; the error of each joint at each pose is estimated separately.",
    )


def _noise_from(found: Identified) -> NoiseFrom:
    return NoiseFrom.STATED if found.scatter.stated else NoiseFrom.RESIDUALS


def _validation(stage: Stage) -> contract.Validation:
    off = 1e3 * stage.errors[Parting.BETWEEN]
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


def _step(stage: Stage) -> contract.PositionStep:
    mm = {parting: 1e3 * stage.mean(parting) for parting in stage.errors}
    return contract.PositionStep(
        model=stage.step.value,
        between_mm=mm[Parting.BETWEEN],
        space_mm=mm[Parting.SPACE],
        series_mm=mm.get(Parting.SERIES),
    )


def _cause(law: NamedLaw, robot: Robot) -> contract.Cause:
    slides = robot.prismatic[law.joint - 1]
    return contract.Cause(
        name=UNLISTED,
        where=law.joint,
        location=f"joint {law.joint}",
        form=law.kind,
        probability=1.0,
        parameters=(
            contract.Amplitude(
                name="amplitude",
                value=law.amplitude,
                std=law.std,
                unit="m" if slides else "rad",
                ci95=(law.amplitude - _QUANTILE * law.std, law.amplitude + _QUANTILE * law.std),
            ),
        ),
        p_value=law.p,
        rivals=(),
        gain=contract.Gain(
            held_out_rms_before_mm=1e3 * law.gain.before,
            held_out_rms_after_mm=1e3 * law.gain.after,
            reduction=law.gain.reduction,
            ci95=law.gain.ci95,
            of=Predicted.POSITIONS,
            test_pose_change_mm=None,
        ),
        law=contract.Law(
            kind=law.kind,
            variable="position" if law.variable == "angle" and slides else law.variable,
            joint=law.joint,
            source_joint=None if law.source == law.joint else law.source,
            order=law.order,
            range=law.range,
            text=text_of(law, robot),
        ),
    )


def text_of(law: NamedLaw, robot: Robot) -> str:
    """The law in one sentence."""
    slides = bool(robot.prismatic[law.joint - 1])
    unit = "mm" if slides else "mrad"
    size = f"{plain(1e3 * law.amplitude, 2)} {unit}"
    turn = "per metre" if slides else "per turn"
    moves = f"{_called(robot, law.joint)} {'slides' if slides else 'turns'}"
    if law.kind == "periodic":
        return f"{moves} with a ripple of {plain(law.order, 3)} {turn}, {size}"
    if law.kind == "coupling":
        other = _called(robot, law.source or law.joint)
        return f"{moves} with {other}, {plain(law.order, 2)} {turn} of that, {size}"
    if law.variable == "angle":
        way = "its place" if slides else "its angle"
        return f"{moves} by a smooth error over {way}, {size} in amplitude"
    if law.since is not None:
        series, pose = law.since
        where = f"pose {pose} of series {series}" if series else f"pose {pose}"
        whole = f"{plain(2e3 * law.amplitude, 2)} {unit}"
        return f"{_called(robot, law.joint)} stands {whole} elsewhere from {where} on"
    if law.kind == "step":
        return f"{moves} to the other side as its torque changes sign, by {size} each way"
    return f"{moves} with {_OF[law.variable]}, {size}"


def _called(robot: Robot, joint: int) -> str:
    """`joint 3 (A2)`."""
    return in_place(joint, axis=alone(robot)[joint - 1]).removeprefix(" in ")


_OF = {
    "torque": "the square or cube of its torque",
    "temperature": "the temperature of the air",
    "time": "the time since the series began",
}


def _instrument(found: Study) -> Iterator[str]:
    """When the instrument moved, and what was made of it."""
    for one in found.moved:
        where = f"pose {one.pose} of series {one.series}" if one.series else f"pose {one.pose}"
        yield (
            f"From {where} on the instrument sees the robot's base "
            f"{plain(1e3 * one.shift_m, 2)} mm and {plain(1e3 * one.turn_rad, 2)} mrad from where "
            f"it was ({p_value(one.p)}): the instrument moved, or the base. These poses count "
            "as a series of their own, with a frame of their own."
        )


def _first_screen(campaign: str, found: Study, robot: Robot, left_out: int) -> Iterator[Line]:
    """The first screen, line by line as for a campaign of pulls.

    Args:
        campaign: Its name.
        found: What was identified.
        robot: As delivered.
        left_out: How many rows were rejected.
    """
    stiffness = stiffness_entries(found.stages[-1].found)
    lines = (
        (About.VERDICT, _predicted(found)),
        (About.TO_DO, _to_do(campaign, found)),
        (About.MODEL, _model(found)),
        (About.NUMBERS, f"{entered(stiffness, ())} They come from the arm's own weight."),
        (About.TOLERANCE, _NOT_JUDGED),
        (About.WRONG, " ".join(_wrong(found, robot, left_out))),
        (About.NEXT, " ".join(_next(found, stiffness))),
    )
    return (Line(about=about, text=text) for about, text in lines)


def _predicted(found: Study) -> str:
    first, last = (1e3 * found.stages[k].mean(Parting.BETWEEN) for k in (0, -1))
    return (
        f"Targets of held-out poses are predicted to {plain(last, 2)} mm on average, and to "
        f"{plain(first, 2)} mm with the nominal DH parameters.{_refuted(last)}"
    )


def _refuted(left_mm: float) -> str:
    if not left_mm > 1e3 * STANDS_M:
        return ""
    return (
        f" That is more than {plain(1e3 * STANDS_M, 1)} mm: the joint log and the positions do not "
        "belong together. Compare them row by row and column by column, check units, and do not "
        "use these values."
    )


def _to_do(campaign: str, found: Study) -> str:
    """What to do with the values, and what of them no controller takes."""
    laws = bool(found.laws)
    if found.stages[-1].mean(Parting.BETWEEN) > STANDS_M:
        return "Use none of these values; put the files right and run again."
    said = (
        "Use DH parameters, springs and laws together"
        if laws
        else "Use the identified DH parameters with their springs"
    )
    beside = " A controller's table has no entry for the laws." if laws else ""
    return (
        f"{said}: predict the positions of targets at other joint values with `pipeline predict "
        f"{campaign} poses.csv`.{beside}"
    )


def _model(found: Study) -> str:
    """What the model holds, and what each part of it is worth."""
    steps = list(pairwise(found.stages))
    said = [
        f"{now.step.value} {percent(1 - now.mean(Parting.BETWEEN) / before.mean(Parting.BETWEEN))}"
        for before, now in steps
        if now.found is not before.found
    ]
    parts = "table, springs under the arm's weight"
    whose = f"{parts} and laws of the joints" if found.laws else parts.replace(", ", " and ")
    return (
        f"{capital(whose)}, from the data as given. Each part reduces the cross-validation error "
        f"of the model before it: {', '.join(said)}."
    )


_NOT_JUDGED = (
    "Not decided: no load was applied, so these readings do not show how far the robot deflects "
    "under process forces."
)


def _wrong(found: Study, robot: Robot, left_out: int) -> Iterator[str]:
    if found.laws:
        first, count = capital(text_of(found.laws[0], robot)), len(found.laws)
        of = "a law" if count == 1 else f"the largest of {count} laws"
        yield f"{first}: {of} outside the catalogue."
    yield from _instrument(found)
    erring = _erring(found, robot)
    if erring:
        yield erring
    elif not (found.laws or found.moved or left_out):
        yield "Nothing detectable in these readings."
    if left_out:
        rows = "1 row of the files was" if left_out == 1 else f"{left_out} rows of the files were"
        yield f"{rows} left out; see Rejected rows for file and line of each."


def _erring(found: Study, robot: Robot) -> str | None:
    """The joint that moves the targets most from pose to pose beyond all laws, if unusually."""
    joints, Z = found.final.scatter.joints, found.final.linear.Z
    usual = np.where(robot.prismatic, START[True], START[False])
    positions = Z.reshape(len(Z), -1, 6, Z.shape[2])[:, :, :3]
    moves = np.mean(np.sum(positions**2, axis=2), axis=(0, 1)) * joints**2
    worst = int(np.argmax(moves))
    if joints[worst] < _UNUSUAL * usual[worst] or moves[worst] < _SHARE * moves.sum():
        return None
    unit = "mm" if robot.prismatic[worst] else "mrad"
    return (
        f"{capital(_called(robot, worst + 1))} errs by {plain(1e3 * joints[worst], 2)} {unit} from "
        f"pose to pose (standard deviation; usual is {plain(1e3 * usual[worst], 2)}), which no law "
        "that was tried explains: backlash, a slipping encoder, several effects that hide each "
        "other, or poses that are not those of the joint log."
    )


_UNUSUAL = 2.0
"""Error of a joint at a pose from which on it is said, over the usual one."""
_SHARE = 0.25
"""Part of what joints that err move the targets by, squared, from which on one is said."""


def _next(found: Study, stiffness: Sequence[contract.Stiffness]) -> Iterator[str]:
    last = found.stages[-1]
    apart = Parting.SERIES if Parting.SERIES in last.errors else Parting.SPACE
    of = {Parting.SERIES: "a whole series", Parting.SPACE: "a tenth of joint space"}[apart]
    yield (
        f"Poses at the joint angles that you will use: where {of} is held out, the error is "
        f"{plain(1e3 * last.mean(apart), 2)} mm; expect as much where nothing was measured."
    )
    if any(joint.value is None for joint in stiffness):
        yield "Known loads on the flange determine the stiffnesses that the arm's weight does not."


def _diagnosis(
    found: Study, row: Row, causes: Sequence[contract.Cause], why: str
) -> contract.Diagnosis:
    first, last = found.stages[0], found.stages[-1]
    none = contract.PosesPulls(poses=None, pulls=None)
    return contract.Diagnosis(
        verdict=row.verdict,
        why=why,
        reasons=(row.finding,),
        causes=tuple(causes),
        alone=(),
        unloaded_off_mm=(1e3 * first.mean(Parting.BETWEEN), 1e3 * last.mean(Parting.BETWEEN)),
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
