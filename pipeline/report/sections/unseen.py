"""What to measure next, and what these readings cannot see."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.answer.contract import BlindSpot, Cell, JointType, NextPose, Stiffness
from pipeline.base.quantities import common_prefix, plain, prefixed
from pipeline.diagnosis.facts import APART
from pipeline.report import words
from pipeline.report.columns import Cells, number, roughly, said, table_of
from pipeline.report.record import Column, Table, entry

_ARRIVES = {1.0: "carriage arrives with r rising", -1.0: "carriage arrives with r falling"}

_WIDE = 300.0
"""Sizes that differ by more than this factor share no prefix of their unit."""

_Numbered = tuple[int, NextPose]


def next_poses(poses: Sequence[NextPose], cell: Cell | None) -> Table | None:
    """The proposed poses and what each of them would tell apart; None without any."""
    columns: list[Cells[_Numbered]] = [
        number("Pose", lambda one: one[0], str),
        said("Distinguishes", lambda one: " / ".join(map(words.from_label, one[1].separates))),
        number("Pull up to [N]", lambda one: one[1].force_n),
        said("How", lambda one: _how(one[1])),
        number("Separation now [σ]", lambda one: one[1].sigmas_before, roughly),
        number("With this pose [σ]", lambda one: one[1].sigmas_after, roughly),
    ]
    note = (
        "To be pulled in the usual load steps. The two causes are those that stay closest with "
        f"this pose and those above it; below {APART} σ two cannot be distinguished reliably. "
        f"{_settles(poses)}{_fits(cell)}"
    )
    return table_of("next-poses", "What to measure next", columns, enumerate(poses, 1), note)


def _settles(poses: Sequence[NextPose]) -> str:
    """That the poses will not settle it, where they will not."""
    most = max((one.sigmas_after or 0.0 for one in poses), default=0.0)
    return (
        "" if most >= APART else f"These poses will not settle it: they reach {roughly(most)} σ. "
    )


def _fits(cell: Cell | None) -> str:
    """What the poses were checked for, and what they were not."""
    if cell is None:
        return (
            "Whether beams arrive and nothing touches is not checked: campaign.toml has no [cell]."
        )
    kept = f"They keep {', '.join(cell.kept)}." if cell.kept else ""
    left = f"Not checked: {'; '.join(cell.not_checked)}." if cell.not_checked else ""
    return f"{kept} {left}".strip()


def _how(pose: NextPose) -> str:
    where = f"towards ({', '.join(f'{v:.2f}' for v in pose.anchor_m)}) m"
    way = _ARRIVES.get(pose.approach or 0.0)
    return f"{where}, {way}" if way else where


def next_joint_values(poses: Sequence[NextPose], joints: Sequence[Stiffness]) -> Table | None:
    """Their joint values [m] and [deg]; None without any."""
    columns: list[Cells[_Numbered]] = [
        number("Pose", lambda one: one[0], str),
        *(_coordinate(joint, place) for place, joint in enumerate(joints)),
    ]
    return table_of("next-joints", "Joint values of these poses", columns, enumerate(poses, 1))


def _coordinate(joint: Stiffness, place: int) -> Cells[_Numbered]:
    unit = "m" if joint.joint_type is JointType.PRISMATIC else "°"
    title = f"{joint.joint_name} [{unit}]"
    return number(title, lambda one: one[1].q[place], lambda value: plain(value, 4))


def blind_spots(spots: Sequence[BlindSpot]) -> Table | None:
    """Effects that may be there unseen, those of one kind in one row; None without any."""
    alike: dict[tuple[str, str, str, bool], list[BlindSpot]] = {}
    for spot in spots:
        key = (spot.name, spot.unit, spot.needs, spot.smallest_visible is None)
        alike.setdefault(key, []).append(spot)
    columns: list[Cells[list[BlindSpot]]] = [
        said("Effect", lambda group: words.cause(group[0].name, None)),
        said("Where", _places),
        (Column("Smallest detectable size", numeric=True), lambda group: entry(*_smallest(group))),
        said("Why", lambda group: "; ".join(dict.fromkeys(map(_why, group)))),
        said("What would show it", lambda group: group[0].needs),
    ]
    note = "These effects may be present without this campaign detecting them."
    title = "Effects that these readings cannot detect"
    return table_of("blind-spots", title, columns, alike.values(), note)


def _places(group: Sequence[BlindSpot]) -> str:
    places = [str(spot.where).replace("_", " ") for spot in group if spot.where is not None]
    return ", ".join(sorted(places, key=lambda place: (len(place), place)))


def _smallest(group: Sequence[BlindSpot]) -> tuple[str, float | None]:
    """Smallest visible size of effects of one kind, as a range over their places."""
    sizes = sorted(s.smallest_visible for s in group if s.smallest_visible is not None)
    if not sizes:
        return "never detectable", None
    unit = "" if group[0].unit == "1" else group[0].unit
    one_prefix = unit and sizes[-1] <= _WIDE * sizes[0]
    factor, letter = common_prefix(sizes) if one_prefix else (1.0, "")
    shown = dict.fromkeys(plain(size / factor, 2) for size in (sizes[0], sizes[-1]))
    return f"{' to '.join(shown)} {prefixed(unit, letter)}".rstrip(), sizes[0]


def _why(spot: BlindSpot) -> str:
    """Why it is not seen; how far a usual size stays below what would be seen, once per group."""
    if spot.smallest_visible is None:
        return spot.why
    return "at its usual size it stays below what these readings can show"
