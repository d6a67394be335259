"""Correct the targets of a path or a program for the load on the tool."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Locked
from pipeline.base.errors import InputError
from pipeline.library.compensate import Compensation, compensate
from pipeline.machine.robot import Robot, axes, configure
from pipeline.prediction.model import IdentifiedModel
from pipeline.prediction.path import Path
from pipeline.programs.aim import Aimed, Refusal, Setting, aim, target_error, worst_limit
from pipeline.programs.forces import Forces, tips_of
from pipeline.programs.joint_path import in_base
from pipeline.programs.notation import Notation
from pipeline.programs.program import Program, Target, Uncorrected

_LEFT = 0.01
"""Part of a deflection that may remain [1]. Newton's iteration leaves 1e-6, and stiffnesses are
known to some per cent; more remains only where the joints cannot move the tool in its direction."""
_LEAST_M = 1e-6
"""Deflection that may remain in any case [m]; no tracker resolves less."""


@dataclass(frozen=True, eq=False)
class Corrected(Locked):
    """A program with corrected coordinates.

    Attributes:
        program: The corrected program.
        found: Offsets of its targets.
        rounding: Largest position error of the tip due to the digits of the program [m].
        singular: Targets whose deflection the joints cannot cancel, with what remains of it [m].
        tips: Point where the force acts at each of its targets, F_b [m], shape (m, 3).
    """

    program: Program
    found: Compensation
    rounding: float
    singular: tuple[tuple[Target, float], ...]
    tips: Array


def correct(
    model: IdentifiedModel,
    program: Program,
    setting: Setting,
    force: Array | Forces,
    partial: bool = False,
) -> Corrected:
    """Correct a program for the load, completely or not at all.

    Sliding joints stay where the program puts them; only the arm corrects.

    Args:
        model: The identified model.
        program: The program.
        setting: Frames and start that the program does not contain.
        force: Force on the robot at the tip [N], shape (3,), or that at each target.
        partial: Whether to correct what can be corrected while other motions stay as taught.

    Raises:
        Refusal: Some targets cannot be reached or corrected, or some motions would stay as taught.
    """
    if (standing := [_motion_error(one) for one in _left_standing(program)]) and not partial:
        raise Refusal(standing)
    aimed = aim(model, program.notation, program.targets, setting, program)
    if isinstance(force, Forces):
        forces = force.at(model.robot, aimed)
    else:
        forces = np.tile(force, (len(aimed.q), 1))
    found, values = correct_targets(
        model, program.notation, program.targets, aimed, forces, setting.in_tool
    )
    own = [k for k, target in enumerate(program.targets) if target.file == program.file]
    left = _uncorrected(program.targets, found, own)
    if left and not partial:
        raise Refusal([_stuck_error(*one) for one in left])
    return Corrected(
        program.written({program.targets[k].place: values[k].tolist() for k in own}),
        found.part(own),
        _rounding(model.robot, program, aimed, values, own),
        tuple(left),
        tips_of(model.robot, aimed)[0][own],
    )


def _uncorrected(
    targets: Sequence[Target], found: Compensation, own: Sequence[int]
) -> list[tuple[Target, float]]:
    """Joint targets whose deflection the joints cannot cancel, and what remains of it [m]."""
    stuck = _stuck(found)
    joint = [k for k in own if targets[k].kind == "joint" and stuck[k]]
    return [(targets[k], float(found.left[k])) for k in joint]


def _left_standing(program: Program) -> list[Uncorrected]:
    """Motions that go to where they were taught although corrected points are elsewhere."""
    return [one for one in (*program.left, *program.elsewhere) if one.counts]


_PARTIAL = "teach a point with coordinates, or accept that it stays as it is with --partial"


def _motion_error(one: Uncorrected) -> InputError:
    """Error for a motion that would stay as taught."""
    return InputError(f"{one.why}; it cannot be corrected", _PARTIAL, file=one.file, line=one.line)


def _stuck_error(target: Target, left: float) -> InputError:
    """Error for a joint target whose deflection the joints cannot cancel."""
    thing = f"the robot is at a singularity, and {1e3 * left:.3f} mm of the deflection would remain"
    return target_error(target, thing, "teach it elsewhere, or accept that with --partial")


def correct_targets(
    model: IdentifiedModel,
    notation: Notation,
    targets: Sequence[Target],
    aimed: Aimed,
    force: Array,
    in_tool: bool,
) -> tuple[Compensation, list[Array]]:
    """Offsets that correct targets while the sliding joints keep their values, and the new numbers.

    Args:
        model: The identified model.
        notation: How the targets are written.
        targets: The targets.
        aimed: Their joint values, frames and tools.
        force: Forces on the robot [N], shape (m, 3).
        in_tool: Whether forces are in the tool frames rather than in F_b.

    Raises:
        Refusal: Some of them cannot be corrected.
    """
    if in_tool:
        force = in_base(model.robot, aimed.q, aimed.tool, force)
    found = _held(model, targets, aimed, force)
    wrong = _refused(model.robot, targets, aimed, found)
    if wrong:
        raise Refusal(wrong)
    return found, _moved(model.robot, notation, targets, aimed, found)


def _held(
    model: IdentifiedModel, targets: Sequence[Target], aimed: Aimed, force: Array
) -> Compensation:
    """Offsets that leave the sliding joints where they are; forces (m, 3) in F_b."""
    tips, which = np.unique(aimed.tip, axis=0, return_inverse=True)
    which = which.ravel()
    parts, order = [], []
    for k, tip in enumerate(tips):
        rows = np.flatnonzero(which == k)
        lines = tuple(targets[row].line for row in rows.tolist())
        file = targets[rows[0]].file
        path = Path(rows, aimed.q[rows], force[rows], True, file, lines)
        parts.append(compensate(model, path, tip, model.robot.prismatic))
        order.append(rows)
    return Compensation.joined(parts).part(np.argsort(np.concatenate(order)))


def _stuck(found: Compensation) -> Bools:
    """Whether more of the deflection remains than is allowed, shape (m,)."""
    least = np.maximum(_LEFT * found.deflection, _LEAST_M)
    return np.asarray(found.left > least)


def _refused(
    robot: Robot, targets: Sequence[Target], aimed: Aimed, found: Compensation
) -> list[InputError]:
    """Errors of corrected targets: singular poses, joints beyond their limits."""
    out = []
    stuck = _stuck(found)
    for k, target in enumerate(targets):
        if stuck[k] and target.kind == "cartesian":
            thing = (
                f"the robot is at a singularity and cannot move the tool against "
                f"{1e3 * found.left[k]:.3f} mm of its deflection"
            )
            out.append(target_error(target, thing, "move the target, or turn the tool a little"))
        elif worst := worst_limit(robot, aimed.q[k] + found.joints[k]):
            out.append(
                target_error(target, f"corrected, {worst}", "move the target away from the limit")
            )
    return out


def _moved(
    robot: Robot,
    notation: Notation,
    targets: Sequence[Target],
    aimed: Aimed,
    found: Compensation,
) -> list[Array]:
    """New numbers of corrected targets, in the unit of the program."""
    of = axes.of(robot)
    turned = of.moved(found.joints)[:, ~of.slides] / notation.angle
    before, after = (_flanges(robot, q) for q in (aimed.q, aimed.q + found.joints))
    motion = after @ linear.solve(before, np.broadcast_to(np.eye(4), before.shape))
    out = []
    for k, target in enumerate(targets):
        old = np.array(target.values)
        if target.kind == "joint":
            out.append(old + turned[k])
        else:
            world = aimed.world[k]
            frame = linear.solve(world, motion[k] @ world @ notation.frame(target.values))
            out.append(notation.values(frame, target.values))
    return out


def _flanges(robot: Robot, q: Array) -> Array:
    """Poses of the flange in F_b, shape (m, 4, 4)."""
    at = configure(robot, q)
    frames = np.tile(np.eye(4), (len(q), 1, 1))
    frames[:, :3, :3], frames[:, :3, 3] = at.flange_axes, at.flange_origin
    return frames


def _rounding(
    robot: Robot, program: Program, aimed: Aimed, values: Sequence[Array], own: Sequence[int]
) -> float:
    """Largest position error of the tip due to the digits that are written [m]."""
    of, worst = axes.of(robot), 0.0
    for k in own:
        target = program.targets[k]
        off = np.array(program.rounded(target, values[k].tolist())) - values[k]
        if target.kind == "cartesian":
            away = program.notation.length * np.linalg.norm(off[:3])
        else:
            turn = np.zeros(len(of.names))
            turn[~of.slides] = program.notation.angle * off
            q = aimed.q[k] + np.stack([np.zeros(robot.n), of.matrix @ turn])
            both = configure(robot, q).points(aimed.tip[k][None])[:, 0]
            away = np.linalg.norm(both[1] - both[0])
        worst = max(worst, float(away))
    return worst
