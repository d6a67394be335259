"""The measurement sheet as a workbook: filled in at the robot, put next to the export, read as log.

Its sheets `pulls` and `axes` are the log of loads and the joint log, with titles that the readers
recognise; `set-up` holds entries of campaign.toml by their keys, for `pipeline init`.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import xlsxwriter

from pipeline.base.arrays import Array
from pipeline.base.language import Say
from pipeline.base.quantities import MM
from pipeline.design.finished import printed
from pipeline.design.plan_sheet import expected, turnings
from pipeline.design.propose import BoundedPlan
from pipeline.design.pull import branches
from pipeline.machine.robot import axes
from pipeline.machine.robot.axes import from_log_units

_Row = list[Any]

_PULLS = (
    "Write what the scale shows into the yellow cells; leave a pull empty that was not made. A "
    "comma is as good as a point."
)
_AXES = (
    "The axes are those of the plan: overwrite what the controller shows otherwise once the robot "
    "stands there. Approach: 1 where the carriage arrived with r rising, -1 with r falling."
)
_SET_UP = (
    "Fill in the yellow cells; the unit may be changed. Copy this workbook and the tracker's "
    "export into data/raw/NAME, then type: pipeline init NAME"
)
_BASE = ("B1", "B2", "B3", "B4")


def book(proposal: BoundedPlan, say: Say = str) -> bytes:
    """Content of sheet.xlsx.

    Args:
        proposal: The plan.
        say: Translates its texts; keys and names of its sheets are the same in all languages.
    """
    out = io.BytesIO()
    with xlsxwriter.Workbook(out, {"in_memory": True}) as made:
        styles = {
            "bold": made.add_format({"bold": True, "text_wrap": True, "valign": "top"}),
            "open": made.add_format({"bg_color": "#FFF3B0", "border": 1}),
            "free": made.add_format({"bg_color": "#FFF3B0", "border": 1, "num_format": "0.000###"}),
        }
        _put(made, styles, say, "set-up", _SET_UP, _SET_UP_TITLES, list(_set_up(proposal)), (3, 9))
        titles, rows, first = _pulls(proposal)
        _put(made, styles, say, "pulls", _PULLS, titles, rows, (first, first + 3))
        titles, rows = _axes(proposal)
        _put(made, styles, say, "axes", _AXES, titles, rows, (2, len(titles)))
    return out.getvalue()


def _widen(page: Any, titles: Sequence[str], rows: Sequence[_Row]) -> None:
    """Set the columns as wide as their content."""
    for column, title in enumerate(titles):
        cells = [title.split(" (")[0], *(row[column] for row in rows if column < len(row))]
        widest = max(len(str(one)) for one in cells if one is not None)
        page.set_column(column, column, min(60, max(9, widest + 1)))


def _words(cell: Any) -> bool:
    """Whether a cell contains words; numbers keep their decimal points, to be read back."""
    return isinstance(cell, str) and any(map(str.isalpha, cell))


def _put(
    made: xlsxwriter.Workbook,
    styles: dict[str, Any],
    say: Say,
    name: str,
    text: str,
    titles: Sequence[str],
    rows: Sequence[_Row],
    free: tuple[int, int],
) -> None:
    """Add a sheet: instructions, titles, rows; columns `free[0]` to before `free[1]` are open."""
    page = made.add_worksheet(name)
    titles = list(map(say, titles))
    rows = [[say(one) if _words(one) else one for one in row] for row in rows]
    page.write(0, 0, say(text))
    page.write_row(2, 0, titles, styles["bold"])
    for k, row in enumerate(rows, 3):
        page.write_row(k, 0, row)
        for column in range(*free):
            value = row[column] if column < len(row) else None
            page.write(k, column, value, styles["free" if value is not None else "open"])
    _widen(page, titles, rows)
    page.freeze_panes(3, 1)
    page.set_landscape()
    page.fit_to_pages(1, 0)
    page.repeat_rows(2)


def _pulls(proposal: BoundedPlan) -> tuple[list[str], list[_Row], int]:
    """Titles, a row for each pull, and the first column to be filled in."""
    problem, measurement = proposal.problem, proposal.measurement
    after = problem.spec.noise.zero == "before_after"
    moved = expected(problem, measurement)
    wide = max(2, len(str(len(measurement.q))))
    rows: list[_Row] = []
    for pose, steps in enumerate(measurement.steps):
        group, ways, todo = f"pose{pose + 1:0{wide}d}_rep", branches(steps), turnings(steps)
        for k, step in enumerate(np.abs(steps)):
            beside = [f"{group}0_unloaded before"] if k == 0 else []
            if after and k == len(steps) - 1:
                beside.append(f"{group}{k + 2}_unloaded after")
            far = ", ".join(f"{MM * x:.2f}" for x in moved[pose][k])
            way = "up" if ways[k] > 0 else "down"
            texts = [f"{todo[k]} {step:g} N", f"{group}{k + 1}_loaded", "; ".join(beside), far]
            rows.append([pose + 1, k + 1, way, *texts])
    titles = [
        *("Pose", "Repeat", "Branch", "Turnbuckle", "Group in the tracker", "Read unloaded"),
        f"Expected |d| of {', '.join(problem.spec.targets)} (mm)",
        *("Force [N]", "Clock", "Remark"),
    ]
    return titles, rows, len(titles) - 3


def _axes(proposal: BoundedPlan) -> tuple[list[str], list[_Row]]:
    """Titles, and a row for each pose, including those without a pull."""
    problem, (q, way) = proposal.problem, proposal.stands()
    robot = problem.robot
    mapped = axes.of(robot)
    shown: Array = axes.displayed(robot, from_log_units(robot, printed(problem, q))).round(6)
    units = ["mm" if slides else "deg" for slides in mapped.slides]
    named = [f"{name} [{unit}]" for name, unit in zip(mapped.names, units, strict=True)]
    ends = [[int(one)] if robot.prismatic[0] else [] for one in way]
    wide = max(2, len(str(len(proposal.measurement.q))))
    rows = [
        [k, f"pose{k:0{wide}d}_rep0_unloaded", *at, *end]
        for k, (at, end) in enumerate(zip(shown.tolist(), ends, strict=True), 1)
    ]
    arrived = ["Approach"] if robot.prismatic[0] else []
    return ["Pose", "Unloaded group", *named, *arrived, "Arrived by hand from", "Remark"], rows


_SET_UP_TITLES = ("Key", "What", "Unit", "Value", "", "", "", "", "")


def _set_up(proposal: BoundedPlan) -> Iterator[_Row]:
    """Keys of campaign.toml, description, unit and known value; a row without key is a note."""
    spec = proposal.problem.spec
    yield ["date", "Date", "", None]
    yield ["operator", "Operator", "", None]
    yield ["temperature_c", "Temperature of base and robot at the begin", "degC", None]
    yield ["", "Temperature of base and robot at the end", "degC", None]
    yield ["", "Weight that hangs at the load point all the time", "kg", None]
    yield ["robot", "Robot, or its file, which then lies beside this workbook", "", spec.robot]
    yield ["robot_unit.serial", "Serial number of the robot", "", None]
    yield ["instrument.model", "Tracker, as Leica AT960", "", None]
    yield ["instrument.serial", "Its serial number", "", None]
    yield ["scale.serial", "Serial number of the scale", "", None]
    yield ["scale.sigma_n", "Standard uncertainty of the scale, by its certificate", "N", None]
    for name in ("load_point", *spec.targets):
        planned = ", ".join(f"{x:g}" for x in np.round(spec.tool[name], 4))
        text = f"{name} in the flange frame, x y z as measured (planned: {planned} m)"
        yield [f"tool.{name}", text, "m", None]
    for name in _BASE:
        yield [f"base_frame.{name}", f"Base reflector {name} in F_b, x y z", "m", None]
    for first in spec.test_pose[:1]:
        text = "Test pose: mm and deg" if first.key == "axes" else "Test pose: m and deg"
        yield [f"test_pose.{first.key}", text, "", *first.said]
        yield ["test_pose.force_n", "Force there, F_b", "N", *first.force_n]
