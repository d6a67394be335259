"""`combinations`: determined combinations of compliances, and how to separate their members."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.answer.contract import Combination
from pipeline.answer.recommended import ModelValues
from pipeline.answer.words import listed
from pipeline.base.quantities import bracketed
from pipeline.diagnosis.average import information, together
from pipeline.machine.robot import Robot
from pipeline.system.combinations import Motion, parting


def combination_entries(values: ModelValues) -> tuple[Combination, ...]:
    """One record per combination that is determined of joints that are not determined singly."""
    fitted, n = values.fitted, values.fitted.case.robot.n
    alone = values.found.identifiable[:n]
    if n - int(alone.sum()) < 2:
        return ()
    N = information(values.hypotheses)
    joints = fitted.case.robot.joints
    out = []
    for one in together(values.hypotheses, N, alone):
        motion = parting(fitted.case.cell, fitted.system, fitted.data.pulls, N, one.of)
        out.append(
            Combination(
                of=tuple(f"k_{joints[j].name}" for j in one.of),
                weights=tuple(one.weights.tolist()),
                value=one.value,
                std=one.std,
                ci95=(one.low, one.high),
                unit=joints[int(one.of[0])].compliance_unit,
                needs=_needs(fitted.case.robot, motion),
            )
        )
    return tuple(out)


def _needs(robot: Robot, motion: Motion) -> str:
    """The motion of a joint that would best separate the members of a combination, in words."""
    joint, unit = robot.joints[motion.joint], "deg"
    to, low, high = (float(np.rad2deg(one)) for one in (motion.to, motion.low, motion.high))
    if joint.prismatic:
        to, low, high, unit = motion.to, motion.low, motion.high, "m"
    at, before, after = (f"{round(one, 1):g}" for one in (to, low, high))
    so_far = f"at {before} {unit}" if before == after else f"from {before} to {after} {unit}"
    return f"the same pulls in poses with {joint.name} at {at} {unit} (so far {so_far})"


def combination_sentences(combinations: Sequence[Combination]) -> list[str]:
    """Two sentences per combination: what is determined, and how to separate its members."""
    return [
        f"{listed(one.of)} cannot be distinguished: of their compliances these poses determine "
        f"{one.formula} = {bracketed(one.value, one.std)} {one.unit}. What "
        f"would separate them best: {one.needs}."
        for one in combinations
    ]
