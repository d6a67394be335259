"""What to measure next: poses, what each would distinguish or determine, and axis values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pipeline.annex.words import Axes, from_label
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
from pipeline.diagnosis.facts import SEPARATED
from pipeline.report.record import (
    Cells,
    ReportTable,
    number_column,
    present,
    roughly,
    table_of,
    word_column,
)

_ARRIVES = {
    1.0: "carriage approaches in the positive direction",
    -1.0: "carriage approaches in the negative direction",
}

_Numbered = tuple[int, NextPose]
_Best = tuple[int, BestPose]
_Placed = tuple[int, ToMeasure]


def to_measure(answer: Answer) -> tuple[ReportTable | None, ...]:
    """Tables of all proposed poses."""
    found = answer.diagnosis
    poses: Sequence[ToMeasure] = found.next_poses or present([found.best_pose])
    return (
        next_poses(found.next_poses, found.next_poses_in, answer.axes),
        best_pose(found.best_pose, found.next_poses_in, answer.stiffness),
        next_joint_values(poses, answer.stiffness),
    )


def next_poses(
    poses: Sequence[NextPose], cell: CellLimits | None, axes: Axes
) -> ReportTable | None:
    """The proposed poses, and the causes that each would distinguish; None without any."""
    columns: list[Cells[_Numbered]] = [
        number_column("Pose", lambda one: one[0], str),
        word_column("Distinguishes", lambda one: _pair(one[1], axes)),
        word_column("Pull", lambda one: _how(one[1])),
        number_column("Separation now [σ]", lambda one: one[1].sigmas_before, roughly),
        number_column("With this pose [σ]", lambda one: one[1].sigmas_after, roughly),
    ]
    note = (
        "The direction is that of the force on the robot in F_b; the load steps are those of the "
        "campaign. The two causes are those that stay closest with this pose and those above it; "
        f"below {SEPARATED} σ two cannot be distinguished reliably. "
        f"{_settles(poses)}{_fits(cell)}"
    )
    return table_of("next-poses", "What to measure next", columns, enumerate(poses, 1), note)


def _pair(pose: NextPose, axes: Axes) -> str:
    return " / ".join(from_label(label, axes) for label in pose.separates)


def _settles(poses: Sequence[NextPose]) -> str:
    """Warning if the proposed poses will not distinguish the causes; else empty."""
    most = max((one.sigmas_after or 0.0 for one in poses), default=0.0)
    return (
        ""
        if most >= SEPARATED
        else f"These poses will not be enough: they reach {roughly(most)} σ. "
    )


def _fits(cell: CellLimits | None) -> str:
    """Limits of the cell that the poses respect, and those that were not checked."""
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
    """The pose that would determine the least certain joint; None without one."""
    called = {joint.name: joint for joint in joints}
    columns: list[Cells[_Best]] = [
        number_column("Pose", lambda one: one[0], str),
        word_column("For", lambda one: called[one[1].name].called),
        word_column("Pull", lambda one: _how(one[1])),
        word_column("Standard uncertainty now", lambda one: _known(one[1], called[one[1].name])),
        word_column("With this pose", lambda one: percent(one[1].relative_std_after)),
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
    """Reference of the percentages for a joint without a value, and whether one pose is enough."""
    if pose is None or called[pose.name].value is not None:
        return ""
    alone = "" if pose.determines else "This pose alone does not determine it. "
    return f"Relative to the typical compliance, as the joint has no value yet. {alone}"


def next_joint_values(
    poses: Sequence[ToMeasure], joints: Sequence[Stiffness]
) -> ReportTable | None:
    """Axis or joint values of the proposed poses [m, deg]; None without poses."""
    first = poses[0].axes if poses else ()
    places = range(len(first or joints))
    columns: list[Cells[_Placed]] = [
        number_column("Pose", lambda one: one[0], str),
        *(_of_axis(first[k], k) if first else _of_joint(joints[k], k) for k in places),
    ]
    which = "this pose" if len(poses) == 1 else "these poses"
    title = f"Axis values of {which}" if first else f"Joint values of {which}"
    return table_of("next-joints", title, columns, enumerate(poses, 1))


def _of_axis(axis: AxisValue, place: int) -> Cells[_Placed]:
    title = f"{axis.name} [{'m' if axis.unit == 'm' else '°'}]"
    return number_column(title, lambda one: one[1].axes[place].value, lambda value: plain(value, 4))


def _of_joint(joint: Stiffness, place: int) -> Cells[_Placed]:
    unit = "m" if joint.joint_type is JointType.PRISMATIC else "°"
    title = f"{joint.joint_name} [{unit}]"
    return number_column(title, lambda one: one[1].q[place], lambda value: plain(value, 4))
