"""What to measure next, and what these readings cannot see."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.base.quantities import common_prefix, known, plain, prefixed
from pipeline.report import words
from pipeline.report.record import Column, Table, entry, text_entry


def next_poses(poses: list[Any]) -> Table | None:
    """The proposed poses and what each of them would tell apart; None without any."""
    rows = [
        (
            entry(str(number), number),
            text_entry(" / ".join(words.from_label(str(n)) for n in p.get("separates") or [])),
            entry(plain(_size(p.get("force_n"))), _size(p.get("force_n"))),
            text_entry(_how(p)),
            entry(plain(p.get("sigmas_before"), 2), p.get("sigmas_before")),
            entry(plain(p.get("sigmas_after"), 2), p.get("sigmas_after")),
        )
        for number, p in enumerate(poses, 1)
    ]
    columns = (
        Column("Pose", numeric=True),
        Column("Tells apart"),
        Column("Pull up to [N]", numeric=True),
        Column("How"),
        Column("Separation now [σ]", numeric=True),
        Column("With this pose [σ]", numeric=True),
    )
    note = (
        "To be pulled in the usual load steps. The two causes are those that stay closest with "
        "this pose and those above it; below 4.6 σ two are not told apart reliably."
    )
    return Table("next-poses", "What to measure next", columns, tuple(rows), note) if rows else None


def _how(pose: Mapping[str, Any]) -> str:
    anchor = pose.get("anchor_m")
    where = f"towards ({', '.join(f'{v:.2f}' for v in anchor)}) m" if anchor else ""
    way = {1.0: "carriage arrives with r rising", -1.0: "carriage arrives with r falling"}
    return ", ".join(part for part in (where, way.get(pose.get("approach") or 0.0, "")) if part)


def _size(force: Any) -> float | None:
    """Size of a force given as a number or as three components [N]."""
    if isinstance(force, Sequence) and not isinstance(force, str):
        return math.hypot(*(float(f) for f in force))
    return float(force) if known(force) else None


def next_joint_values(poses: list[Any], joints: list[Any]) -> Table | None:
    """Their joint values [m] and [deg]; None when these are not all of one robot."""
    rows = []
    for number, pose in enumerate(poses, 1):
        q = pose.get("q") or []
        rows.append((entry(str(number), number), *[entry(plain(v, 4), v) for v in q]))
    if not rows or len({len(row) for row in rows}) != 1:
        return None
    columns = [Column("Pose", numeric=True)]
    for j in range(len(rows[0]) - 1):
        one = joints[j] if j < len(joints) else {}
        unit = "m" if one.get("joint_type") == "prismatic" or one.get("unit") == "N/m" else "°"
        columns.append(Column(f"{_coordinate(one, j)} [{unit}]", numeric=True))
    return Table("next-joints", "Joint values of these poses", tuple(columns), tuple(rows))


def _coordinate(joint: Mapping[str, Any], index: int) -> str:
    return str(joint.get("name") or f"q{index + 1}").removeprefix("k_")


def blind_spots(spots: list[Any]) -> Table | None:
    """Effects that may be there unseen, those of one kind in one row; None without any."""
    alike: dict[tuple[str, str, str, bool], list[Any]] = {}
    for spot in spots:
        never = spot.get("smallest_visible") is None
        key = (str(spot.get("name")), str(spot.get("unit") or ""), str(spot.get("needs")), never)
        alike.setdefault(key, []).append(spot)
    rows = [
        (
            text_entry(words.cause(name, None)),
            text_entry(_places(group)),
            entry(*_smallest(group, unit)),
            text_entry("; ".join(dict.fromkeys(_why(s) for s in group))),
            text_entry(needs),
        )
        for (name, unit, needs, _), group in alike.items()
    ]
    columns = (
        Column("Effect"),
        Column("Where"),
        Column("Smallest size seen", numeric=True),
        Column("Why"),
        Column("What would show it"),
    )
    note = "These effects may be there without this campaign showing them."
    title = "What these readings cannot see"
    return Table("blind-spots", title, columns, tuple(rows), note) if rows else None


def _places(group: list[Any]) -> str:
    places = [s["where"] for s in group if s.get("where") is not None]
    return ", ".join(sorted((str(p).replace("_", " ") for p in places), key=lambda p: (len(p), p)))


def _smallest(group: list[Any], unit: str) -> tuple[str, float | None]:
    """Smallest visible size of effects of one kind, as a range over their places."""
    sizes = sorted(s["smallest_visible"] for s in group if known(s.get("smallest_visible")))
    if not sizes:
        return "never visible", None
    wide = sizes[-1] > 300 * sizes[0]
    factor, letter = (1.0, "") if unit in ("", "1") or wide else common_prefix(sizes)
    shown = list(dict.fromkeys(plain(size / factor, 2) for size in (sizes[0], sizes[-1])))
    name = "" if unit in ("", "1") else f" {prefixed(unit, letter)}"
    return f"{' to '.join(shown)}{name}", sizes[0]


def _why(spot: Mapping[str, Any]) -> str:
    """Why it is not seen; how far a usual size stays below what would be seen, once per group."""
    size, typical = spot.get("smallest_visible"), spot.get("typical")
    if known(size) and known(typical):
        return "a usual size stays below what these readings can show"
    return str(spot.get("why") or "")
