"""A sliding axis that the joint log lacks, from the log of loads.

A carriage may have a controller of its own, whose display a person reads. Both logs number the
poses; the column is the only one of lengths that the log of loads has besides what it is read for.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from pipeline.base.errors import InputError
from pipeline.dialects._cells import is_number
from pipeline.intake import _log_words, log_columns
from pipeline.intake.which_logs import LogFiles, propose_logs
from pipeline.machine.robot import Robot
from pipeline.machine.robot.mdh import parse
from pipeline.readers.export_settings import LogForm
from pipeline.readers.logs import LENGTH

MADE = "joints.csv"
"""Name of the joint log that is written."""


@dataclass(frozen=True)
class WithSlides:
    """The files of a campaign with a joint log that has all axes.

    Attributes:
        files: Content by name, without the log that lacks an axis.
        made: Content of the joint log to be written, None if there is none.
        said: What was done, a sentence each.
    """

    files: dict[str, bytes]
    made: bytes | None = None
    said: list[str] = field(default_factory=list)


def with_slides(files: Mapping[str, bytes]) -> WithSlides:
    """A joint log with the sliding axis of the only robot file, if the log of loads has that."""
    files, robots = dict(files), dict(_railed(files))
    logged = propose_logs(files) if len(robots) == 1 else LogFiles()
    log, loads = logged.joints, logged.loads
    if not (log and loads) or {*robots} & {*logged.robots}:
        return WithSlides(files)
    (robot,) = robots
    axes = _turning(robots[robot])
    titles = log_columns.understood_joints(log, files[log], axes)
    column = _column_of_lengths(loads, files[loads], logged.load_columns)
    if titles is None or column is None or log == MADE:
        return WithSlides(files)
    data = files.pop(log)
    if MADE in files:  # written before, and maybe corrected
        return WithSlides(files)
    title, slide = column
    (name,) = {*log_columns.axes_of(robots[robot])[0]} - {*axes[0]}
    (unit,) = _log_words.stated_unit(title, [*LENGTH])
    table = log_columns.cells_of_joints(log, data, axes)
    made = "\n".join([*_joined(table, titles, f"{name}_{unit}", slide), ""]).encode()
    return WithSlides(files | {MADE: made}, made, [
        f"{MADE} was written: the joint values of {log}, and as the sliding axis of {robot}, which "
        f'that lacks, the column "{title}" of {loads}; confirm it.'
    ])  # fmt: skip


def _railed(files: Mapping[str, bytes]) -> Iterator[tuple[str, Robot]]:
    """Robot files in the folder with one axis that slides."""
    for name, data in files.items():
        if name.endswith(".toml"):
            try:
                robot = parse(data.decode("utf-8", "replace"), name)
            except InputError:
                continue
            if robot.prismatic.sum() == 1:
                yield name, robot


def _turning(robot: Robot) -> log_columns.Axes:
    names, slides = log_columns.axes_of(robot)
    turn = tuple(name for name, slide in zip(names, slides, strict=True) if not slide)
    return turn, (False,) * len(turn)


def _column_of_lengths(
    name: str, data: bytes, columns: Mapping[str, str]
) -> tuple[str, dict[str, str]] | None:
    """Title of the only other column of lengths, and its value in each pose; None if ambiguous."""
    cells = log_columns.cells_of_loads(name, data)
    pose = next((title for title, ours in columns.items() if ours == "pose"), "pose")
    found: dict[str, dict[str, str]] = {}
    for title, own in cells.items():
        if title not in columns and len(_log_words.stated_unit(title, [*LENGTH])) == 1:
            value = _by_pose(_filled(cells.get(pose, ())), _filled(own))
            found |= {title: value} if len({*value.values()}) > 1 else {}
    return next(iter(found.items())) if len(found) == 1 else None


def _filled(cells: Sequence[str]) -> list[str]:
    """Cells with the value above where they are empty."""
    out: list[str] = []
    for cell in cells:
        out.append(cell or (out[-1] if out else ""))
    return out


def _by_pose(poses: Sequence[str], values: Sequence[str]) -> dict[str, str]:
    """The value of each pose; empty if one has two, or one is no number."""
    pairs = {*zip(poses, values, strict=False)}
    plain = len(pairs) == len({*poses}) and all(map(is_number, values))
    return {pose.lstrip("0"): value for pose, value in pairs} if plain else {}


def _joined(
    table: Mapping[str, Sequence[str]], form: LogForm, title: str, slide: Mapping[str, str]
) -> Iterator[str]:
    """Lines of the joint log with the further column; poses that have no value are left out."""
    pose = next((one for one, ours in form.columns.items() if ours == "pose"), "pose")
    yield ";".join([*table, title])
    for row in zip(*table.values(), strict=True):
        number = dict(zip(table, row, strict=True))[pose].lstrip("0")
        if number in slide:
            yield ";".join([*row, slide[number]])
