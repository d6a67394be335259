"""What to measure next, and what these readings cannot see."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from pipeline.answer.contract import (
    AxisValue,
    BestPose,
    BlindSpot,
    CellLimits,
    JointType,
    NextPose,
    Stiffness,
    ToMeasure,
)
from pipeline.answer.words import loads, unnoticed
from pipeline.base.quantities import common_prefix, percent, plain, prefixed
from pipeline.diagnosis.facts import APART
from pipeline.report import words
from pipeline.report.columns import Cells, number, roughly, said, table_of
from pipeline.report.record import Block, Column, Paragraph, ReportTable, entry, present

_ARRIVES = {
    1.0: "carriage approaches in the positive direction",
    -1.0: "carriage approaches in the negative direction",
}

_WIDE = 300.0
"""Sizes that differ by more than this factor share no prefix of their unit."""

_Numbered = tuple[int, NextPose]
_Best = tuple[int, BestPose]
_Placed = tuple[int, ToMeasure]


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


def blind_spots(spots: Sequence[BlindSpot]) -> list[Block]:
    """Effects that may be there unseen, those of one kind in one row; nothing without any.

    How many there are is the sentence of the first screen.
    """
    if not spots:
        return []
    never = [spot for spot in spots if spot.smallest_visible is None]
    small = [spot for spot in spots if spot.smallest_visible is not None]
    return list(present([Paragraph(f"{unnoticed(len(spots))}."), _never(never), _small(small)]))


_Group = list[BlindSpot]


def _never(spots: Sequence[BlindSpot]) -> ReportTable | None:
    columns: list[Cells[_Group]] = [
        *_who(),
        said("Why", lambda group: "; ".join(dict.fromkeys(spot.why for spot in group))),
        said("What would reveal it", lambda group: group[0].needs),
    ]
    title = "Effects that these readings cannot detect at any magnitude"
    return table_of("blind-spots-never", title, columns, _alike(spots))


def _small(spots: Sequence[BlindSpot]) -> ReportTable | None:
    columns: list[Cells[_Group]] = [
        *_who(),
        _sizes("Typical magnitude", lambda spot: spot.typical),
        _sizes("Minimal detectable magnitude", lambda spot: spot.smallest_visible),
        said("What would reveal it", lambda group: group[0].needs),
    ]
    title = "Effects that these readings detect only above their typical magnitude"
    note = "An effect of the minimal detectable magnitude is detected in 80 % of the cases."
    return table_of("blind-spots", title, columns, _alike(spots), note)


def _alike(spots: Sequence[BlindSpot]) -> Iterable[_Group]:
    alike: dict[tuple[str, str, str], _Group] = {}
    for spot in spots:
        alike.setdefault((spot.name, spot.unit, spot.needs), []).append(spot)
    return alike.values()


def _who() -> list[Cells[_Group]]:
    return [
        said("Effect", lambda group: words.cause(group[0].name, None)),
        said("Where", lambda group: ", ".join(map(_place, sorted(group, key=_order)))),
    ]


def _place(spot: BlindSpot) -> str:
    """`A5`, `joint 6` where no axis is mapped, `upper arm`, or nothing."""
    if isinstance(spot.where, int):
        return spot.axis or f"joint {spot.where}"
    return (spot.where or "").replace("_", " ")


def _order(spot: BlindSpot) -> tuple[int, str]:
    place = str(spot.where)
    return len(place), place


def _sizes(title: str, size: Callable[[BlindSpot], float | None]) -> Cells[_Group]:
    """A column of sizes, those of one kind as a range over their places."""
    return Column(title, numeric=True), lambda group: entry(*_range(group, size))


def _range(group: _Group, size: Callable[[BlindSpot], float | None]) -> tuple[str, float | None]:
    sizes = sorted(one for one in map(size, group) if one is not None)
    unit = "" if group[0].unit == "1" else group[0].unit
    one_prefix = unit and sizes[-1] <= _WIDE * sizes[0]
    factor, letter = common_prefix(sizes) if one_prefix else (1.0, "")
    shown = dict.fromkeys(plain(value / factor, 2) for value in (sizes[0], sizes[-1]))
    return f"{' to '.join(shown)} {prefixed(unit, letter)}".rstrip(), sizes[0]
