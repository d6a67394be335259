"""What to measure next: the poses, what each would tell apart or determine, and their axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pipeline.answer.contract import (
    Answer,
    AxisValue,
    BestPose,
    CellLimits,
    JointType,
    NextPose,
    Stiffness,
    ToMeasure,
)
from pipeline.answer.words import loads
from pipeline.base.quantities import percent, plain
from pipeline.diagnosis.facts import APART
from pipeline.report import words
from pipeline.report.columns import Cells, number, roughly, said, table_of
from pipeline.report.record import ReportTable, present

_ARRIVES = {
    1.0: "carriage approaches in the positive direction",
    -1.0: "carriage approaches in the negative direction",
}

_Numbered = tuple[int, NextPose]
_Best = tuple[int, BestPose]
_Placed = tuple[int, ToMeasure]


def to_measure(answer: Answer) -> tuple[ReportTable | None, ...]:
    """Everything that is proposed."""
    found = answer.diagnosis
    poses: Sequence[ToMeasure] = found.next_poses or present([found.best_pose])
    return (
        next_poses(found.next_poses, found.next_poses_in, answer.axes),
        best_pose(found.best_pose, found.next_poses_in, answer.stiffness),
        next_joint_values(poses, answer.stiffness),
    )


def next_poses(
    poses: Sequence[NextPose], cell: CellLimits | None, axes: words.Axes
) -> ReportTable | None:
    """The proposed poses and what each of them would tell apart; None without any."""
    columns: list[Cells[_Numbered]] = [
        number("Pose", lambda one: one[0], str),
        said("Distinguishes", lambda one: _pair(one[1], axes)),
        said("Pull", lambda one: _how(one[1])),
        number("Separation now [σ]", lambda one: one[1].sigmas_before, roughly),
        number("With this pose [σ]", lambda one: one[1].sigmas_after, roughly),
    ]
    note = (
        "The direction is that of the force on the robot in F_b; the load steps are those of the "
        "campaign. The two causes are those that stay closest with this pose and those above it; "
        f"below {APART} σ two cannot be distinguished reliably. "
        f"{_settles(poses)}{_fits(cell)}"
    )
    return table_of("next-poses", "What to measure next", columns, enumerate(poses, 1), note)


def _pair(pose: NextPose, axes: words.Axes) -> str:
    return " / ".join(words.from_label(label, axes) for label in pose.separates)


def _settles(poses: Sequence[NextPose]) -> str:
    """That the poses will not settle it, where they will not."""
    most = max((one.sigmas_after or 0.0 for one in poses), default=0.0)
    return (
        "" if most >= APART else f"These poses will not be enough: they reach {roughly(most)} σ. "
    )


def _fits(cell: CellLimits | None) -> str:
    """What the poses were checked for, and what they were not."""
    if cell is None:
        return "Lines of sight and collisions are not checked: campaign.toml has no [cell]."
    kept = f"They keep {', '.join(cell.kept)}." if cell.kept else ""
    left = f"Not checked: {'; '.join(cell.not_checked)}." if cell.not_checked else ""
    return f"{kept} {left}".strip()


def _how(pose: ToMeasure) -> str:
    anchor = f"chain to ({', '.join(f'{v:.2f}' for v in pose.anchor_m)}) m"
    return "; ".join(present((loads(pose), anchor, _ARRIVES.get(pose.approach or 0.0))))


def best_pose(
    pose: BestPose | None, cell: CellLimits | None, joints: Sequence[Stiffness]
) -> ReportTable | None:
    """The pose that would determine the joint that is known worst; None without one."""
    called = {joint.name: joint for joint in joints}
    columns: list[Cells[_Best]] = [
        number("Pose", lambda one: one[0], str),
        said("For", lambda one: called[one[1].name].called),
        said("Pull", lambda one: _how(one[1])),
        said("Standard uncertainty now", lambda one: _known(one[1], called[one[1].name])),
        said("With this pose", lambda one: percent(one[1].relative_std_after)),
    ]
    note = (
        "The direction is that of the force on the robot in F_b; the load steps are those of the "
        f"campaign. {_worth(pose, called)}{_fits(cell)}"
    )
    rows = [] if pose is None else [(1, pose)]
    return table_of("best-pose", "What to measure next", columns, rows, note)


def _known(pose: BestPose, joint: Stiffness) -> str:
    return "not determined" if joint.value is None else percent(pose.relative_std_before)


def _worth(pose: BestPose | None, called: Mapping[str, Stiffness]) -> str:
    """What the percentages are of, and whether one pose is enough."""
    if pose is None or called[pose.name].value is not None:
        return ""
    alone = "" if pose.determines else "This pose alone does not determine it. "
    return f"Relative to the typical compliance, as the joint has no value yet. {alone}"


def next_joint_values(
    poses: Sequence[ToMeasure], joints: Sequence[Stiffness]
) -> ReportTable | None:
    """Where axes or joints stand in them [m] and [deg]; None without any."""
    first = poses[0].axes if poses else ()
    places = range(len(first or joints))
    columns: list[Cells[_Placed]] = [
        number("Pose", lambda one: one[0], str),
        *(_of_axis(first[k], k) if first else _of_joint(joints[k], k) for k in places),
    ]
    which = "this pose" if len(poses) == 1 else "these poses"
    title = f"Axis values of {which}" if first else f"Joint values of {which}"
    return table_of("next-joints", title, columns, enumerate(poses, 1))


def _of_axis(axis: AxisValue, place: int) -> Cells[_Placed]:
    title = f"{axis.name} [{'m' if axis.unit == 'm' else '°'}]"
    return number(title, lambda one: one[1].axes[place].value, lambda value: plain(value, 4))


def _of_joint(joint: Stiffness, place: int) -> Cells[_Placed]:
    unit = "m" if joint.joint_type is JointType.PRISMATIC else "°"
    title = f"{joint.joint_name} [{unit}]"
    return number(title, lambda one: one[1].q[place], lambda value: plain(value, 4))
