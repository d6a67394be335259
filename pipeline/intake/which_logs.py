"""Which files of a new campaign are logs, and the meaning of their columns."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np

from pipeline.base.errors import InputError
from pipeline.intake import log_columns
from pipeline.intake._contents import contents, mark_of
from pipeline.intake._prose import is_prose
from pipeline.intake._pulses import in_pulses, per_degree
from pipeline.intake._sheet import sheet
from pipeline.machine.robot import SHIPPED, Robot, load
from pipeline.machine.robot.mdh import parse as parse_robot
from pipeline.readers import logs
from pipeline.readers._text import is_workbook, text
from pipeline.readers.export_settings import OWN_LOG, LogForm
from pipeline.readers.logs import Log
from pipeline.reduction import limits


@dataclass(frozen=True)
class LogFiles:
    """The logs among some files.

    Attributes:
        loads: Log of the loads, None if there is none.
        joints: Joint log, None if there is none.
        robots: Robots whose joints the log has; those that ship, and files in the folder.
        load_columns: Our names for the columns of the loads, by their titles; without those that
            have ours; several, separated by bars, where a title does not state its unit.
        joint_columns: The same for the joint log, by robot.
        decimal_commas: Logs in which every comma might be a thousands separator, while all other
            files of the folder have decimal commas.
        pulses: Pulses per degree of the axes of the joint log, as far as a file has them.
        refused: Why a file is not used.
    """

    loads: str | None = None
    joints: str | None = None
    robots: tuple[str, ...] = ()
    load_columns: dict[str, str] = field(default_factory=dict)
    joint_columns: dict[str, dict[str, str]] = field(default_factory=dict)
    decimal_commas: tuple[str, ...] = ()
    pulses: dict[str, float] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)


_Reading = Callable[[Robot, LogForm], Log]


def propose_logs(files: Mapping[str, bytes]) -> LogFiles:
    """Find the logs among some files; of several of loads the one with most rows.

    A workbook may be both, and an export, too, with one sheet for each.

    Args:
        files: Content by name; TOML files are taken for robots.
    """
    robots = dict(_robots(files))
    makers = _makers(files)
    proposal = LogFiles()
    for name, data in files.items():
        if _may_be_log(name, data):
            proposal = _with_log(proposal, name, files, robots, makers)
    found = pulses_among(files, proposal)
    return replace(proposal, decimal_commas=_with_commas(files, proposal), pulses=found)


def pulses_among(files: Mapping[str, bytes], logged: LogFiles) -> dict[str, float]:
    """Pulses per degree of the axes of the joint log, from any of some files."""
    return per_degree(files, counted_axes(next(iter(logged.joint_columns.values()), {})))


def _with_log(
    proposal: LogFiles,
    name: str,
    files: Mapping[str, bytes],
    robots: Mapping[str, Robot],
    makers: frozenset[str],
) -> LogFiles:
    """The logs with a file that may be one, or both in a workbook; refused if no robot fits."""
    data, rows = files[name], partial(_rows, files, robots)
    fits = _having(name, data, robots, makers)
    form = _loads(name, data) if not fits or is_workbook(data) else None
    if fits := fits or ({} if form else dict(_by_number(name, data, robots))):
        columns = {robot: form.columns for robot, form in fits.items()}
        new = {"joints": name, "robots": tuple(fits), "joint_columns": columns}
        proposal = _added(proposal, name, new, proposal.joints, rows)
    if form:
        new = {"loads": name, "load_columns": form.columns}
        return _added(proposal, name, new, proposal.loads, rows)
    if fits or not (axes := log_columns.titles_of_axes(name, data)):
        return proposal
    return replace(proposal, refused=proposal.refused | {name: _no_joint_log(name, data, axes)})


def _no_joint_log(name: str, data: bytes, axes: Sequence[str]) -> str:
    """Why titles of axes do not make a joint log: no column of poses, or no robot."""
    try:
        log_columns.refuse_without_poses(name, data)
    except InputError as problem:
        return (
            f"{problem.thing}, and rows are not joined by their times; {problem.way_out}, and type "
            "`pipeline init` again"
        )
    return (
        f"seems to be a joint log ({axes[0]} to {axes[-1]}), but no robot that ships and none in "
        "this folder has these axes; bring yours as a robot file (docs/add-a-robot.md), and type "
        "`pipeline init` again"
    )


def counted_axes(columns: Mapping[str, str]) -> tuple[str, ...]:
    """The axes of a joint log whose columns are in pulses."""
    end = f"_{logs.PULSES}"
    return tuple(ours.removesuffix(end) for ours in columns.values() if ours.endswith(end))


def _with_commas(files: Mapping[str, bytes], proposal: LogFiles) -> tuple[str, ...]:
    """Logs whose decimal mark only the other files of the folder show: a comma in all of them."""
    marks = {name: _mark(name, files[name]) for name in (proposal.loads, proposal.joints) if name}
    if "?" not in marks.values():
        return ()
    others = [k for k in files if k not in marks and not k.endswith(".toml")]
    shown = {*marks.values(), *(_mark(name, files[name]) for name in others)}
    return tuple(k for k in marks if marks[k] == "?") if shown - {"", "?"} == {","} else ()


def _mark(name: str, data: bytes) -> str:
    """The decimal mark of a table; `?` if commas leave it open, empty if it has none."""
    with contextlib.suppress(InputError):
        found = None if is_workbook(data) else sheet(text(name, data))
        if found is not None and found.delimiter != ",":
            try:
                numbers = [one for one in contents(found) if one.kind == "number"]
                return mark_of(numbers, found.lines)
            except InputError:
                return "?"
    return ""


def _may_be_log(name: str, data: bytes) -> bool:
    try:
        if name.endswith(".toml") or is_prose(name, data):
            return False
        return log_columns.may_be_log(name, data)
    except InputError:
        return is_workbook(data)  # several of its sheets may qualify: each log looks for its own


def _added(
    proposal: LogFiles,
    name: str,
    new: Mapping[str, Any],
    earlier: str | None,
    rows: Callable[[str, Mapping[str, Any]], int],
) -> LogFiles:
    """The logs with one more; of two of a kind that with fewer rows is refused, else the later."""
    if earlier is None:
        return replace(proposal, **new)
    if rows(name, new) > rows(earlier, vars(proposal)):
        proposal, name, earlier = replace(proposal, **new), earlier, name
    return replace(proposal, refused=proposal.refused | {name: f"{earlier} is such a log, too"})


def _rows(
    files: Mapping[str, bytes], robots: Mapping[str, Robot], name: str, found: Mapping[str, Any]
) -> int:
    """Number of rows of a log of loads that can be read; 1 for a joint log if it can be."""
    with contextlib.suppress(InputError):
        if name == found.get("loads"):
            form = log_columns.settled(found["load_columns"])
            return len(logs.loads(name, files[name], form).line)
        robot, columns = next(iter(found["joint_columns"].items()))
        form = log_columns.settled(columns)
        return min(len(logs.joints(name, files[name], robots[robot], form).line), 1)
    return 0


def _robots(files: Mapping[str, bytes]) -> Iterator[tuple[str, Robot]]:
    """Robots in the folder, then those that ship."""
    yield from _own(files)
    for name in SHIPPED:
        yield name, load(name)


def brought(files: Mapping[str, bytes]) -> tuple[str, ...]:
    """The robot files among some files."""
    return tuple(name for name, _ in _own(files))


def _own(files: Mapping[str, bytes]) -> Iterator[tuple[str, Robot]]:
    for name, data in files.items():
        if name.endswith(".toml"):
            with contextlib.suppress(InputError):
                yield name, parse_robot(data.decode("utf-8", "replace"), name)


_OF_MAKERS = {
    "ABB": r"\b(joint|rob)target\b|(?<![A-Z])IRB[ _-]?\d{3,4}",
    "KUKA": r"\bE6AXIS\b|^&ACCESS\b|(?<![A-Z])KR[ _-]?\d{2,4}(?!\d)",
    "FANUC": r"^/PROG\b|(?<![A-Z])(R-[12]000|M-?\d{2,3}[iI][A-C])",
    "Yaskawa": r"^/JOB\b|(?<![A-Z])GP[ _-]?\d{2,3}(?!\d)",
}
"""What shows the maker of a robot: words of its programs, type names in remarks and file names."""
_LOOKED_AT = 4000
"""Number of bytes of each file in which it is looked for."""


def _shown(files: Mapping[str, bytes]) -> str:
    """Names and first lines of the files."""
    texts = (f"{name}\n{data[:_LOOKED_AT].decode('latin-1')}" for name, data in files.items()
             if not name.endswith(".toml"))  # fmt: skip
    return "\n".join(texts)


_BETWEEN = "[./_ -]?"
"""What may be between the letters of a type."""


_OF_ABB = re.compile("rob[0-9]_(?=[0-9])")
"""What stands for IRB in configurations of ABB: ROB1_6700_200/2.60."""


def called(files: Mapping[str, bytes], robots: Iterable[str]) -> tuple[str, ...]:
    """The robots whose type is in names or first lines of files: IRB 6700-235/2.65.

    A longer name takes precedence over one that is part of it.
    """
    text = _OF_ABB.sub("irb", _shown(files).lower())
    keys = {key: key.replace("_", "") for key in robots}
    found = {  # a word of its own, whatever is between its letters
        key: one
        for key, one in keys.items()
        if re.search(rf"(?<![^\W_]){_BETWEEN.join(one)}(?![^\W_])", text)
    }
    return tuple(
        key for key, one in found.items() if not any(one in o and o != one for o in found.values())
    )


def _makers(files: Mapping[str, bytes]) -> frozenset[str]:
    """The makers that names and first lines of files show."""
    text = _shown(files)
    return frozenset(
        maker for maker, words in _OF_MAKERS.items() if re.search(words, text, re.MULTILINE)
    )


def _having(
    name: str, data: bytes, robots: Mapping[str, Robot], makers: frozenset[str]
) -> dict[str, LogForm]:
    """Robots all of whose joints a log has, with the entries needed for its columns.

    Those of the folder come first, then those of the makers that files show, then those whose names
    of axes are in the log, then those that can take all its poses.
    """
    found, rank = {}, {}
    read = _read_once(name, data)
    meant = cache(partial(log_columns.understood_joints, name, data))  # a file is looked at once
    others = cache(partial(log_columns.has_other_axes, name, data))  # for all with the same axes
    for key, robot in robots.items():
        axes = log_columns.axes_of(robot)
        form = _form(partial(read, robot), partial(meant, axes))
        if form and not (key in SHIPPED and others(axes)):
            called = not form.columns or log_columns.are_called(form, robot)
            fitting = _possible(read, robot, form)
            shown = robot.description.partition(" ")[0] in makers
            rank[key] = not key.endswith(".toml"), not shown, not called, not fitting
            counted = None if fitting else in_pulses(name, data, robot, form)
            found[key] = counted or _in_units_of(form, fitting)
    return {key: found[key] for key in sorted(found, key=rank.__getitem__)}


def _read_once(name: str, data: bytes) -> _Reading:
    """`logs.joints` of a file, which robots with the same axes and the same controller share."""
    kept: dict[tuple[object, ...], Log | InputError] = {}

    def read(robot: Robot, form: LogForm) -> Log:
        axes = (
            *((j.name, j.prismatic) for j in robot.joints),
            *zip(robot.controller, robot.slides, strict=True),
        )
        matrices = robot.controller_matrix.tobytes(), robot.controller_offset.tobytes()
        key = axes, matrices, form.model_dump_json()
        if key not in kept:
            try:
                kept[key] = logs.joints(name, data, robot, form)
            except InputError as problem:
                kept[key] = problem
        found = kept[key]
        if isinstance(found, InputError):
            raise found
        return found

    return read


def _in_units_of(form: LogForm, fitting: Sequence[LogForm]) -> LogForm:
    """For titles that state no unit, the unit that keeps all poses within the robot's limits.

    If several do, those remain; if none does, all but pulses.
    """
    entries = {title: {one.columns[title] for one in fitting} for title in form.columns}
    left = {
        title: "|".join(one for one in ours.split("|") if one in entries[title])
        or ours.replace(f"|{ours.partition('_')[0]}_{logs.PULSES}", "")
        for title, ours in form.columns.items()
    }
    return form.model_copy(update={"columns": left})


def _by_number(
    name: str, data: bytes, robots: Mapping[str, Robot]
) -> Iterator[tuple[str, LogForm]]:
    """Robots that can take every row of numbers of a log as a pose, in one order of the columns."""
    read = _read_once(name, data)
    for key, robot in robots.items():
        with contextlib.suppress(InputError):
            ways = log_columns.numbered_joints(name, data, robot)
            able = ((form, _possible(read, robot, form)) for form in ways)
            fitting = [(form, some) for form, some in able if some]
            if len(fitting) == 1:
                yield key, _in_units_of(*fitting[0])


def _possible(read: _Reading, robot: Robot, form: LogForm) -> list[LogForm]:
    """The log in each of the possible units in which the robot can take all poses."""
    open_ones = {ours for ours in form.columns.values() if "|" in ours}
    units = [{one.rpartition("_")[2] for one in ours.split("|")} for ours in open_ones]
    fitting = []
    for choice in product(*sorted({tuple(sorted(some)) for some in units})):
        columns = {title: _in_one_of(ours, choice) for title, ours in form.columns.items()}
        chosen = form.model_copy(update={"columns": columns})
        with contextlib.suppress(InputError):
            if not limits.impossible(read(robot, chosen), robot):
                fitting.append(chosen)
    return fitting


def _in_one_of(ours: str, units: Sequence[str]) -> str:
    """Of several names that differ by unit the one with one of these units."""
    return next((one for one in ours.split("|") if one.rpartition("_")[2] in units), ours)


def _loads(name: str, data: bytes) -> LogForm | None:
    """Entries needed for the columns of a log of loads, None if it is not one."""
    return _form(partial(logs.loads, name, data), partial(log_columns.understood_loads, name, data))


def unsure(
    name: str | None, files: Mapping[str, bytes], columns: Mapping[str, str]
) -> tuple[str, ...]:
    """Quantities of a log of loads whose uncertainty only a person knows.

    Force, if nothing can be read.
    """
    with contextlib.suppress(InputError):
        log = logs.loads(name, files[name], log_columns.settled(columns)) if name else None
        if log is not None and len(log.line):
            given = {kind: ~np.isnan(log.number[kind]) for kind in ("force", "mass")}
            given["mass"] &= np.isnan(log.number["mass_sigma"])
            return tuple(kind for kind, rows in given.items() if rows.any())
    return ("force",)


def _form(read: Callable[[LogForm], Log], meant: Callable[[], LogForm | None]) -> LogForm | None:
    """How a log is read: as ours, else by the meaning of its titles; None if it is not one.

    An unreadable row, or an ambiguous decimal mark, does not make it another kind of file.
    """
    try:
        return OWN_LOG if _readable(read, OWN_LOG) else meant()
    except InputError:
        return None


def _readable(read: Callable[[LogForm], Log], form: LogForm) -> bool:
    """Whether a log can be read; one without rows counts."""
    try:
        read(form)
    except InputError as problem:
        return "only a header" in problem.thing
    return True
