"""Correct paths and robot programs on disk, with the model of a campaign and options as typed."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.base import files
from pipeline.base.errors import InputError, UsageError, place
from pipeline.base.shown import typed
from pipeline.programs.program import FINE_M

if TYPE_CHECKING:
    from pipeline.base.arrays import Array
    from pipeline.library.compensate import Compensation
    from pipeline.prediction.model import IdentifiedModel
    from pipeline.programs import Program
    from pipeline.programs.aim import Setting
    from pipeline.programs.correct import Corrected
    from pipeline.programs.forces import Forces
    from pipeline.programs.notation import Form, Notation

_SHOWN = 20
"""Maximum number of lines of a program listed for each kind of remark."""


class ForceFrame(StrEnum):
    """The frame in which a force is given."""

    BASE = "base"
    TOOL = "tool"


@dataclass(frozen=True)
class CorrectionOptions:
    """Options as typed.

    Attributes:
        tip: Point where the force acts, flange frame [m].
        force: Force on the robot [N], three numbers.
        frame: Frame of the forces.
        tool: Tools, in the notation of the program.
        base: Frames of coordinates, likewise.
        world: World frame of the controller in F_b, likewise.
        flange: Flange frame of the controller in that of the robot file, likewise.
        start: Axis values before the first motion [deg], [mm].
        partial: Whether to write a program although some of its motions stay as taught.
        forces: Table of the force at each target of a program.
        max_offset_mm: Largest plausible shift of a target [mm]; None if there is no such limit.
    """

    tip: tuple[float, float, float] | None = None
    force: str | None = None
    frame: ForceFrame = ForceFrame.BASE
    tool: Sequence[str] = ()
    base: Sequence[str] = ()
    world: str | None = None
    flange: str | None = None
    start: str | None = None
    partial: bool = False
    forces: Path | None = None
    max_offset_mm: float | None = None


def write(
    root: Path,
    name: str,
    path: Path,
    tip: tuple[float, float, float] | None = None,
    output: Path | None = None,
    given: CorrectionOptions | None = None,
) -> tuple[Path, list[str]]:
    """Write the offsets of a path of poses and forces; return the file and remarks on it.

    Raises:
        UsageError: The campaign has no model yet, the path does not exist, or an option is invalid.
        InputError: The path cannot be read, or one of its poses cannot be reached.
    """
    from pipeline.programs import cartesian
    from pipeline.store import campaign as campaigns

    model, data = _model(root, name), _content(path)
    given = CorrectionOptions(tip=tip) if given is None else given
    _refuse_answer(path.name, data)
    letters = cartesian.form(path.name, data)
    if letters is None:
        answer, remarks = _joints(model, path, data, given)
    else:
        answer, remarks = _poses(model, path, data, given, letters)
    written = output or campaigns.find(root, name).reports / f"{path.stem}-compensation.csv"
    spare_input(path, written)
    answer = _with_stamp(answer, _stamp(root, name, given, answer.decode()))
    files.write(campaigns.outside_raw(root, written), answer)
    return written, remarks + _misfit(model)


def program(root: Path, name: str, path: Path, given: CorrectionOptions) -> tuple[bytes, list[str]]:
    """A robot program with corrected coordinates, and remarks on it; see `drawn`."""
    data, remarks, _ = drawn(root, name, path, given)
    return data, remarks


def drawn(
    root: Path, name: str, path: Path, given: CorrectionOptions
) -> tuple[bytes, list[str], str]:
    """A robot program with corrected coordinates, remarks on it, and its picture (SVG).

    Raises:
        UsageError: The campaign has no model yet, the program does not exist, or an option is
            invalid.
        InputError: The program cannot be read, or some targets cannot be reached or corrected.
    """
    from pipeline.programs import read, stamp
    from pipeline.programs.correct import correct
    from pipeline.programs.picture import picture

    model, data = _model(root, name), _content(path)
    near = companion(path)
    other = None if near is None else (near.name, _content(near))
    read_ = read(path.name, data, other)
    setting = _setting(given, read_.notation, model)
    force = _acting(given, read_, other)
    found = correct(model, read_, setting, force, given.partial)
    own = (one for one in read_.targets if one.file == read_.file)
    _refuse_far(given, found.found, [(one.name, one.file, one.line) for one in own])
    remarks = _remarks(read_, found)
    if near is not None and any(one.file == near.name for one in read_.targets):
        remarks.append(f"{near.name} has targets of this program, too: correct it as well.")
    text = stamp.stamped(
        path.name, found.program.text, _stamp(root, name, given, found.program.text)
    )
    shown = picture(path.name, found.tips, found.found)
    return text.encode("latin-1"), remarks + _misfit(model), shown


def _acting(
    given: CorrectionOptions, read_: Program, other: tuple[str, bytes] | None
) -> Array | Forces:
    """Force from the command line, else from a table or from the program's own remarks.

    Raises:
        UsageError: No force is given, it is given twice, or cuts are combined with the tool frame.
    """
    from pipeline.programs._text import one_byte_characters
    from pipeline.programs.forces import stated, tabled

    texts = {read_.file: read_.text} | (
        {} if other is None else {other[0]: one_byte_characters(*other)}
    )
    forces = stated(texts, read_.targets)
    if given.forces is not None:
        forces = tabled(given.forces.name, _content(given.forces), read_.targets)
    if given.force is not None and forces is None:
        return _newtons(given.force)
    if forces is None:
        raise UsageError(
            "the program says no forces: give --force FX,FY,FZ [N], --forces TABLE.csv, or write "
            "remarks FORCE and CUT into it (docs/hand-over.md)"
        )
    if given.force is not None:
        raise UsageError("the forces are given twice, for all points and for each: leave out one")
    if forces.cuts and given.frame == ForceFrame.TOOL:
        raise UsageError("a CUT knows its direction by the motion: leave out --force-frame tool")
    return forces


def spare_input(path: Path, output: Path) -> None:
    """Refuse to overwrite the original, or the companion file of a program.

    Raises:
        InputError: `output` is one of them, by whatever name.
    """
    for one in (path, companion(path)):
        if one is not None and output.exists() and output.samefile(one):
            thing = "is the original, which --output would overwrite"
            raise InputError(thing, "write to another file", file=str(output))


def _stamp(root: Path, name: str, given: CorrectionOptions, text: str) -> str:
    """Text of the stamp in a corrected program or table."""
    from pipeline.base.version import __version__
    from pipeline.programs import LARGEST_PROGRAM, stamp

    model = files.read(_kept(root, name), "model.toml", LARGEST_PROGRAM)
    force = "of each point" if given.force is None else f"{given.force} N"
    today = datetime.now(tz=UTC).date().isoformat()
    return stamp.words(__version__, name, model, f"{force} in {given.frame}", today, text)


_STAMPED = "corrected"
"""Title of the column with the stamp in the table of offsets of a path."""


def _with_stamp(table: bytes, stamp: str) -> bytes:
    """A table with the stamp as one more column, the same in each row; no quotes are needed."""
    head, *rows = table.decode().splitlines()
    lines = [f"{head},{_STAMPED}", *(f"{row},{stamp.replace(',', ';')}" for row in rows)]
    return "".join(f"{line}\n" for line in lines).encode()


def _refuse_answer(file: str, data: bytes) -> None:
    """Reject a path that is itself a table of offsets.

    Raises:
        InputError: Its columns show that.
    """
    from pipeline.readers import logs

    if {_STAMPED, "deflection_mm"} & {*logs.columns(file, data)}:
        thing = "is corrected for the load already"
        raise InputError(thing, "correct the original path instead", file=file)


def _remarks(program: Program, found: Corrected) -> list[str]:
    """Remarks on a corrected program."""
    remarks = found.found.remarks
    if found.rounding > FINE_M:
        remarks.append(f"The digits of the program leave up to {1e3 * found.rounding:.4f} mm.")
    remarks += listed_lines(
        [
            f"{place(target.file, target.line)}{target.name}: the robot is at a singularity, and "
            f"{1e3 * left:.3f} mm of the deflection remain."
            for target, left in found.singular
        ]
    )
    left = (*program.left, *program.elsewhere)
    for corrected, stays in ((True, "is not corrected"), (False, "stays as it is")):
        remarks += listed_lines(
            [
                f"{place(one.file, one.line)}{one.why}; it {stays}."
                for one in left
                if one.counts is corrected
            ]
        )
    return remarks


def _kept(root: Path, name: str) -> Path:
    """File of a campaign's model."""
    from pipeline.store import campaign as campaigns

    return campaigns.find(root, name).reports / "model.toml"


def _model(root: Path, name: str) -> IdentifiedModel:
    from pipeline.library.model_file import load

    kept = _kept(root, name)
    if not kept.is_file():
        raise UsageError(f"{name} has no model yet: run `pipeline run {typed(name)}` first")
    return load(kept)


def _content(path: Path) -> bytes:
    from pipeline.programs import LARGEST_PROGRAM

    if not path.exists():
        raise UsageError(f"{path} cannot be read (no such file): check the path")
    return files.read(path, path.name, LARGEST_PROGRAM)


def companion(path: Path) -> Path | None:
    """The companion file of a program; None if there is none."""
    from pipeline.programs import other_suffix

    suffix = other_suffix(path.name) or ""
    both = (path.with_suffix(one) for one in (suffix, suffix.upper()) if one)
    return next((one for one in both if one.is_file()), None)


def _misfit(model: IdentifiedModel) -> list[str]:
    """A warning if the campaign's model does not fit its own readings."""
    from pipeline.answer.contract import Reason

    if Reason(model.recommended["reason"]).holds_for_its_readings:
        return []
    return [
        f"The model of {model.campaign} does not fit its own measurements: expect more than is "
        f"stated."
    ]


def _joints(
    model: IdentifiedModel, path: Path, data: bytes, given: CorrectionOptions
) -> tuple[bytes, list[str]]:
    """Offsets of a path of joint values, and remarks."""
    import numpy as np

    from pipeline.library.compensate import compensate
    from pipeline.programs import joint_path
    from pipeline.programs.notation import KUKA

    wanted = joint_path.read(path.name, data, model.robot, _force(given))
    setting = _setting(given, KUKA, model)
    tool = setting.flange @ setting.tools.get("", np.eye(4))
    tip = tool[:3, 3] if given.tool else None
    if given.frame == ForceFrame.TOOL:
        turned = joint_path.in_base(model.robot, wanted.q, tool, wanted.force)
        wanted = replace(wanted, force=turned)
    found = compensate(model, wanted, tip if setting.tip is None else setting.tip)
    rows = zip(wanted.pose.tolist(), wanted.line, strict=True)
    _refuse_far(given, found, [(f"pose {pose}", path.name, line) for pose, line in rows])
    return joint_path.table(model.robot, wanted, found), found.remarks


def _poses(
    model: IdentifiedModel, path: Path, data: bytes, given: CorrectionOptions, letters: Form
) -> tuple[bytes, list[str]]:
    """Corrected coordinates and offsets of a path of poses, and remarks."""
    from pipeline.programs import cartesian
    from pipeline.programs.aim import aim
    from pipeline.programs.correct import correct_targets
    from pipeline.programs.notation import Notation

    setting = _setting(given, Notation(letters), model, path=True)
    wanted = cartesian.read(path.name, data, model.robot, letters, _force(given))
    aimed = aim(model, wanted.notation, wanted.targets, setting)
    found, values = correct_targets(
        model, wanted.notation, wanted.targets, aimed, wanted.force, setting.in_tool
    )
    _refuse_far(given, found, [(one.name, one.file, one.line) for one in wanted.targets])
    return cartesian.table(model.robot, wanted, values, found), found.remarks


def _refuse_far(
    given: CorrectionOptions, found: Compensation, places: Sequence[tuple[str, str, int]]
) -> None:
    """Refuse corrections larger than the limit given, which a wrong force or tool makes.

    Args:
        given: Options, with the limit.
        found: Offsets of the points.
        places: Name, file and line of each point.

    Raises:
        Refusal: Some points would move farther.
    """
    import numpy as np

    from pipeline.programs.aim import Refusal

    if given.max_offset_mm is None:
        return
    shift_mm = 1e3 * np.linalg.norm(found.shift, axis=1)
    far = [
        InputError(
            f"{name} would move by {size:.3f} mm, more than --max-offset "
            f"{given.max_offset_mm:g} mm",
            "check force, unit, tool and tip, or raise the limit",
            file=file,
            line=line,
        )
        for (name, file, line), size in zip(places, shift_mm.tolist(), strict=True)
        if size > given.max_offset_mm
    ]
    if far:
        raise Refusal(far)


def _force(given: CorrectionOptions) -> Array | None:
    """Force at every point [N], shape (3,); None if each point has its own."""
    return None if given.force is None else _newtons(given.force)


def _newtons(text: str) -> Array:
    """A force [N], shape (3,), from three numbers and an optional unit, N or kN.

    Raises:
        UsageError: It is not three numbers, or has another unit.
    """
    import numpy as np

    from pipeline.readers.logs import FORCE

    numbers, unit = text.rstrip(" ]"), "n"
    if found := re.fullmatch(r"(.*[0-9.])\s*([A-Za-z]+)", numbers):
        numbers, unit = found[1], found[2].lower()
    if unit not in FORCE:
        raise UsageError(f'--force "{text}": give N or kN, as 0,0,-800 or 0,0,-0.8kN')
    return FORCE[unit] * np.array(_numbers("--force", numbers, 3))


def listed_lines(lines: list[str]) -> list[str]:
    """The first lines of many, with the number of the others."""
    more = len(lines) - _SHOWN
    return lines if more <= 1 else [*lines[:_SHOWN], f"... and {more} lines more of this kind."]


def _setting(
    given: CorrectionOptions, notation: Notation, model: IdentifiedModel, path: bool = False
) -> Setting:
    """The options in SI units.

    Args:
        given: Options as typed.
        notation: How frames are written.
        model: Model whose robot has the axes of `--start`, and whose load point is the default tool
            of a path.
        path: Whether a table is corrected; by default, its coordinates are in F_b.
    """
    import numpy as np

    from pipeline.programs.aim import Setting, with_start

    tools, bases = _frames("--tool", given.tool, notation), _frames("--base", given.base, notation)
    tip = None if given.tip is None else np.array(given.tip)
    if path:
        own = np.eye(4)
        own[:3, 3] = model.tool.load_point if tip is None else tip
        tools, bases = {"": own} | tools, {"": np.eye(4)} | bases
    world, flange = (
        np.eye(4) if one is None else _pose(option, one, notation)
        for option, one in (("--world", given.world), ("--flange", given.flange))
    )
    in_tool = given.frame == ForceFrame.TOOL
    setting = Setting(tools, bases, world, flange, tip, in_tool=in_tool)
    if given.start is None:
        return setting
    return with_start(setting, model.robot, _numbers("--start", given.start, None))


def _frames(option: str, given: Sequence[str], notation: Notation) -> dict[str, Array]:
    """Frames by name, in lower case."""
    out = {}
    for one in given:
        name, _, numbers = one.rpartition("=")
        out[name.strip().lower()] = _pose(option, numbers, notation)
    return out


def _pose(option: str, text: str, notation: Notation) -> Array:
    """A frame from its numbers.

    Raises:
        UsageError: They are not numbers, their count is wrong, or a quaternion has zero length.
    """
    try:
        return notation.frame(_numbers(option, text, notation.count))
    except ValueError as problem:
        raise UsageError(f'{option} "{text}": the quaternion has no length') from problem


def _numbers(option: str, text: str, count: int | None) -> list[float]:
    """Numbers separated by commas.

    Raises:
        UsageError: They are not finite numbers, or their count is wrong.
    """
    try:
        found = [float(word) for word in text.split(",")]
    except ValueError as problem:
        raise UsageError(f'{option} "{text}": give numbers with commas between them') from problem
    if not all(map(math.isfinite, found)) or count not in (None, len(found)):
        raise UsageError(f'{option} "{text}": give {count or "only"} finite numbers')
    return found
