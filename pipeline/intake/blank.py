"""Write campaign.toml for the files in a folder, or for a campaign still to be measured."""

from __future__ import annotations

import contextlib
import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from itertools import chain
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, TypeVar

import jinja2

from pipeline.base import files, toml
from pipeline.base.doors import opened
from pipeline.base.errors import InputError, UsageError, listed
from pipeline.base.patterns import natural
from pipeline.base.quantities import plain
from pipeline.base.shown import printable, typed
from pipeline.base.toml import quoted
from pipeline.machine.instrument import sheet
from pipeline.machine.robot import Robot, axes, load
from pipeline.store.campaign import DEEPEST, CampaignFolder, unfit, within

if TYPE_CHECKING:  # it imports the readers
    from pipeline.intake.files import FilesProposal
    from pipeline.intake.which_logs import LogFiles

FOLDER_NAME = "a plain folder name that begins with no dot"

_Value = TypeVar("_Value")

_DEFAULTS = ("tracker*.csv", "tracker*.txt")
"""Patterns for exports where there are none yet."""
_TARGETS = ("P1", "P2", "P3")
_BASE = ("B1", "B2", "B3")
_MANY = 12
"""Maximum number of robots that are described one by one."""
_OWN_ROBOT = "or a robot file of your own in this folder: docs/add-a-robot.md"
_LOGS = ("loads.csv", "joints.csv")
"""Names of the logs where there are none yet."""


@dataclass(frozen=True)
class KnownData:
    """Data that a person knows and no file states; None or missing where still open.

    Attributes:
        robot: A robot that ships, or a robot file.
        unit: Of the exports that do not state it.
        instrument: Type of the tracker.
        sigma_m: Standard uncertainty of one tracker reading per axis [m].
        sigma_n: Standard uncertainty of one scale reading [N].
        mass_sigma_kg: Standard uncertainty of one weight [kg].
        temperature_c: Of rail and base [degC].
        places: Points of [tool] and [base_frame] [m], by name.
        columns: Our names for titles of the logs that state no unit.
        words: Other entries of campaign.toml, by key.
        test_pose: Numbers of [test_pose], by key.
        notes: Data without an entry in campaign.toml.
        source: Where a place comes from that is still to be confirmed, by name.
        simulated: Whether files are those of a rehearsal.
    """

    robot: str | None = None
    unit: str | None = None
    instrument: str | None = None
    sigma_m: float | None = None
    sigma_n: float | None = None
    mass_sigma_kg: float | None = None
    temperature_c: float | None = None
    places: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    columns: Mapping[str, str] = field(default_factory=dict)
    words: Mapping[str, str] = field(default_factory=dict)
    test_pose: Mapping[str, list[float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    source: Mapping[str, str] = field(default_factory=dict)
    simulated: bool = False


@cache
def _template() -> jinja2.Template:
    text = (resources.files(__package__) / "campaign.toml.jinja").read_text("utf-8")
    return jinja2.Template(text, keep_trailing_newline=True)


def write(folder: Path, proposal: FilesProposal, known: KnownData) -> list[str]:
    """Write campaign.toml, and empty logs if there are none; return what is still open.

    What was filled in before, in one that is still open, is kept.

    Args:
        folder: Of the campaign.
        proposal: What its files say.
        known: What a person says.
    """
    from pipeline.reduction.settings import unfilled

    text = _template().render(_words(folder, proposal, known))
    if proposal.nothing and known.robot is not None:
        joints = load(known.robot, folder).joints
        columns = [f"{j.name}_m" if j.prismatic else f"{j.name}_deg" for j in joints]
        files.write(folder / "loads.csv", b"pose,repeat,force_n,branch\n")
        files.write(folder / "joints.csv", f"pose,{','.join(columns)},approach\n".encode())
    if old := open_text(folder):
        text = opened("pipeline.page.entries:carried_over")(old, text)
    files.write(folder / "campaign.toml", text.encode())
    return [f"{name} (line {line})" for line, name in unfilled(text).items()]


def _words(folder: Path, proposal: FilesProposal, known: KnownData) -> dict[str, object]:
    """Variables of the template; None or empty where still open."""
    loads, joints = _LOGS if proposal.nothing else (proposal.loads, proposal.joints)
    return {
        "name": quoted(folder.name),
        "loads": _shown(loads, quoted),
        "joints": _shown(joints, quoted),
        "base": _points(proposal.base or _BASE * proposal.nothing, known),
        "anchors": [
            one
            for one in _points([*dict.fromkeys(chain(*proposal.anchors.values()))], known)
            if one[1]
        ],
        "tool": _points(["load_point", *(proposal.measured or proposal.often or _TARGETS)], known),
        "decimal_commas": [*map(quoted, proposal.decimal_commas)],
        "load_columns": _pairs(_with_answers(proposal.load_columns, known)),
        "axes_of": None if known.robot else next(iter(proposal.joint_columns), None),
        "pulses": _counted(proposal, known.robot),
        "joint_columns": _pairs(_with_answers(_joint_columns(proposal, known.robot), known)),
        "aside": printable(next(iter(proposal.exports), "tracker.csv"), 40),
        "resting": [*_resting(folder, proposal, known.robot)],
        **_of_files(proposal),
        **_of_names(proposal),
        **_of_a_person(known),
    }


def _resting(folder: Path, proposal: FilesProposal, robot: str | None) -> Iterator[str]:
    """What the controller shows at each point of the joint log that is no pose."""
    if robot is None or not proposal.resting:
        return
    columns, names = _joint_columns(proposal, robot), axes.of(load(robot, folder)).names
    for point, values in proposal.resting.items():
        own = {columns.get(title, title.replace(" [", "_")).partition("_")[0]: value
               for title, value in values.items()}  # fmt: skip
        if own.keys() >= {*names}:
            at = ", ".join(f"{own[name]:g}" for name in names)
            yield f"{printable(point, 40)} in {proposal.joints} is [{at}]"


def _of_files(proposal: FilesProposal) -> dict[str, object]:
    from pipeline.intake.offer import mapping_lines

    blind = bool(proposal.loads or proposal.joints or proposal.refused)
    mapping = proposal.offer.hints.mapping if proposal.offer else None
    return {
        "robots": _fitting(proposal),
        "called": _shown(next(iter(proposal.called), None), str),
        "exports": _quoted(proposal.patterns or (() if blind else _DEFAULTS)),
        "by_file": _shown(proposal.by_file, quoted),
        "tracker": _tracker(proposal),
        "mapping": mapping_lines(mapping) if mapping else [],
        "unsure": proposal.unsure,
        "reach": _shown(proposal.reach, plain),
        "refused": [printable(one, 300) for one in not_used(proposal.refused)],
    }


def _of_names(proposal: FilesProposal) -> dict[str, object]:
    names = " or ".join(map(quoted, proposal.names))
    asked = None if proposal.ways else proposal.groups or None
    return {
        "nameless": proposal.nameless,
        "names": names if len(proposal.names) == 1 else None,
        "asked_names": names if len(proposal.names) > 1 else None,
        "group": _shown(next(iter(proposal.ways), None), lambda group: quoted(group.pattern)),
        "asked_group": _shown(asked, lambda names: printable(listed(names), 200)),
        "states": _shown(proposal.group, lambda group: _states(group.state_of)),
        "asked_states": " or ".join(_states(one.state_of) for one in proposal.either),
        "measured": _quoted(proposal.measured),
        "often": _quoted(proposal.often),
        "chain": _quoted(proposal.chain),
        "ways_known": bool(proposal.ways),
        "apart": [
            f"{one} to {two}: {1e3 * m:.2f} mm measured"
            for (one, two), m in proposal.apart_m.items()
        ],
    }


def _of_a_person(known: KnownData) -> dict[str, object]:
    return {
        "robot": _shown(known.robot, quoted),
        "unit": _shown(known.unit, quoted),
        "instrument": _shown(known.instrument, quoted),
        "said": {key: quoted(word) for key, word in known.words.items()},
        "test_pose": [f"{key} = {list(numbers)}" for key, numbers in known.test_pose.items()],
        "notes": known.notes,
        "simulated": known.simulated,
        "sheet": known.instrument is not None and sheet(known.instrument) is not None,
        "sigma_m": _shown(known.sigma_m, "{:.3g}".format),
        "sigma_n": _shown(known.sigma_n, "{:g}".format),
        "mass_sigma_kg": _shown(known.mass_sigma_kg, "{:g}".format),
        "warm": _shown(known.temperature_c, "{:g}".format),
    }


def _shown(value: _Value | None, words: Callable[[_Value], str]) -> str | None:
    """A value in words, None if it is unknown."""
    return None if value is None else words(value)


def _tracker(proposal: FilesProposal) -> list[str]:
    """Entries and open entries of [tracker] for an export that leaves more open than its unit."""
    if proposal.offer is None:
        return []
    asked = {question.about: question for question in proposal.offer.questions}
    lines = []
    for word in ("sheet", "unit", "decimal", "coordinates", "angle", "vertical", "horizontal"):
        value = getattr(proposal.offer.hints, word)
        if word in asked and word != "unit":  # the unit is asked for every export
            answers = " or ".join(quoted(answer.said) for answer in asked[word].answers)
            lines.append(f"# {word} = ?   # {answers}: the export does not say it")
        elif value and word not in asked:
            lines.append(f"{word} = {quoted(value)}")
    if asked.keys() & {"columns", "instrument", "coordinates"}:
        lines.append("# columns = ?   # which column is what is a guess: correct columns in "
                     "[tracker.mapping] below, then remove this line")  # fmt: skip
    return lines


def log_lines(proposal: LogFiles, robot: str | None = None) -> list[str]:
    """Entries of campaign.toml for the one log of a proposal, and for a robot if one is named."""
    table, file = ("scale", proposal.loads) if proposal.loads else ("joints", proposal.joints)
    robot = robot if robot in proposal.joint_columns else None
    columns = _pairs(proposal.load_columns if proposal.loads else _joint_columns(proposal, robot))
    lines = [f"[{table}]", f"file = {quoted(str(file))}"]
    if not columns:
        return lines
    several = table == "joints" and len({str(one) for one in proposal.joint_columns.values()}) > 1
    whose = next(iter(proposal.joint_columns), "") if several and robot is None else ""
    named = f"   # joints as {whose} calls them: name the robot in campaign.toml" if whose else ""
    return [*lines, "", f"[{table}.columns]{named}", *columns]


def not_used(refused: Mapping[str, str]) -> list[str]:
    """A sentence for each file that is not used, for several of an inner folder only one."""
    folders: dict[str, list[str]] = {}
    for name in refused:
        inner = str(PurePosixPath(name).parent)
        folders.setdefault(name if inner == "." else inner, []).append(name)
    return [
        f"{names[0]} is not used: {refused[names[0]]}"
        if len(names) == 1
        else f"{len(names)} files of {inner} are not used, the first is {names[0]}: "
        f"{refused[names[0]]}"
        for inner, names in folders.items()
    ]


def _fitting(proposal: LogFiles) -> str:
    """The robots that a joint log fits, or where robots are listed."""
    if not proposal.robots:
        return f"one of `pipeline robot --list`; {_OWN_ROBOT}"
    first, *others = proposal.joint_columns.values()
    differ = (
        f"; [joints.columns] is for {proposal.robots[0]}: for another remove this file and type "
        "`pipeline init` with --robot"
    ) * any(one != first for one in others)
    return (
        f"{listed(proposal.robots)}: the joint log fits each of them; `pipeline robot --list` has "
        f"all; {_OWN_ROBOT}{differ}"
    )


def described(folder: Path, found: Sequence[str]) -> list[str]:
    """Description of each of some robots, or where all that ship are listed."""
    few = found if len(found) <= _MANY else ()
    shown = [f"{name}: {load(name, folder).description}" for name in few]
    listing = "`pipeline robot --list` lists the robots that ship, with maker and type"
    return shown or [f"{listing}; `--draw robots.svg` with it draws them."]


def log_columns(proposal: FilesProposal, robot: str | None) -> dict[str, str]:
    """Our names for the titles of both logs, separated by bars where they are ambiguous."""
    return {**proposal.load_columns, **_joint_columns(proposal, robot)}


def _with_answers(columns: Mapping[str, str], known: KnownData) -> dict[str, str]:
    """Our names for titles, replaced by those that a person chose."""
    return {title: known.columns.get(title, ours) for title, ours in columns.items()}


def _joint_columns(proposal: LogFiles, robot: str | None) -> Mapping[str, str]:
    """Our names for the titles of the joint log; for the first robot it fits if none is named."""
    first = next(iter(proposal.joint_columns.values()), {})
    return proposal.joint_columns.get(robot, {}) if robot else first


def _counted(proposal: LogFiles, robot: str | None) -> list[tuple[str, str | None]]:
    """Each axis in pulses with their number per degree, None where still open."""
    from pipeline.intake.which_logs import counted_axes

    axes = counted_axes(_joint_columns(proposal, robot))
    return [(_key(axis), _shown(proposal.pulses.get(axis), plain)) for axis in axes]


def _pairs(columns: Mapping[str, str]) -> list[str]:
    """A line for each title, to be filled in where it does not state its unit."""
    return [
        f"# {quoted(title)} = ?   # {ours.replace('|', ' or ')}: the title states no unit"
        if "|" in ours
        else f"{quoted(title)} = {quoted(ours)}"
        for title, ours in columns.items()
    ]


def _states(state_of: Mapping[str, str]) -> str:
    """The words of the states as an inline table, empty if they are ours."""
    if all(own == ours for own, ours in state_of.items()):
        return ""
    return (
        "{ " + ", ".join(f"{quoted(own)} = {quoted(ours)}" for own, ours in state_of.items()) + " }"
    )


def _points(names: Sequence[str], known: KnownData) -> list[tuple[str, str | None]]:
    """Each point with its position, None where still open."""
    found = ((name, known.places.get(name), known.source.get(name)) for name in names)
    return [
        (_key(name), None if at is None else f"{list(at)}{f'   # {why}' if why else ''}")
        for name, at, why in found
    ]


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else quoted(name)


def _quoted(names: Sequence[str]) -> str:
    return ", ".join(map(quoted, names))


def vacant(root: Path, name: str) -> Path:
    """The folder for a campaign of this name; there may be files in it already.

    Raises:
        UsageError: The name cannot name a folder, or there is a campaign in it already that leaves
            nothing open.
    """
    if why := unfit(name):
        raise UsageError(
            f'"{printable(name, 80)}" cannot name a campaign ({why}): use {FOLDER_NAME}'
        )
    folder = root / "data" / "raw" / name
    if (folder / "campaign.toml").exists():
        if _rehearsed(folder):
            raise UsageError(
                f"{folder} is a rehearsal (simulated = true): `pipeline remove {typed(name)}` puts "
                "it away, then type this again; or choose another name"
            )
        if not open_text(folder):
            raise UsageError(
                f"{folder} has a campaign.toml already: `pipeline check {typed(name)}` is next, or "
                f"remove it and type `pipeline init {typed(name)}` again to have it written anew"
            )
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder} is there already: choose another name")
    return folder


def open_text(folder: Path) -> str:
    """Its campaign.toml, if entries of it are still to be filled in; else empty."""
    from pipeline.reduction.settings import unfilled

    path = folder / "campaign.toml"
    text = files.words(path, path.name, toml.LARGEST_TEXT) if path.exists() else ""
    return text if unfilled(text) else ""


def _rehearsed(folder: Path) -> bool:
    """Whether its campaign.toml says that it was simulated."""
    with contextlib.suppress(InputError):
        path = folder / "campaign.toml"
        text = files.words(path, path.name, toml.LARGEST_TEXT)
        return toml.loads(text, path.name).get("simulated") is True
    return False


def simulated(root: Path, name: str, there: Mapping[str, bytes]) -> list[str]:
    """Files unchanged since the rehearsal of this name, by the digests stored with its truth.

    Args:
        root: The project's root.
        name: Of the campaign.
        there: Content of its files by name.
    """
    with contextlib.suppress(OSError, ValueError):
        sealed = json.loads((root / "data" / "processed" / f"{name}.truth.json").read_bytes())
        made = dict(sealed.get("files", {}))
        return [one for one, data in there.items() if made.get(one) == files.sha256(data)]
    return []


def inner(folder: Path) -> Counter[str]:
    """Number of files in each folder within a campaign's, at any depth."""
    names = _names(folder, DEEPEST)
    return Counter(str(name.parent) for name in names if len(name.parts) > 1)


def _names(folder: Path, deepest: int) -> list[PurePosixPath]:
    """Files of a folder and of those within it, none of them hidden."""
    names = map(PurePosixPath, within(folder, deepest)) if folder.is_dir() else ()
    return [name for name in names if not any(part.startswith(".") for part in name.parts)]


def there(root: Path, folder: Path, deepest: int = 1) -> dict[str, bytes]:
    """Content of the files in a folder, except those of other programs; empty if unreadable.

    Logs that `init` made and that were not filled in are left out.

    Args:
        root: The project's root.
        folder: Of the campaign.
        deepest: Depth to which it is read: 1 without the folders within it.
    """
    campaign, found = CampaignFolder(root, folder), {}
    for name in sorted(map(str, _names(folder, deepest)), key=natural):
        if (folder / name).is_file():
            try:
                found[name] = campaign.content(name)
            except InputError:
                found[name] = b""
    return {name: data for name, data in found.items() if not _blank(name, data)}


def _blank(name: str, data: bytes) -> bool:
    return name in _LOGS and data.startswith(b"pose,") and data.count(b"\n") == 1


def brought(folder: Path, robot: str) -> str:
    """Name of a robot in campaign.toml; a robot file elsewhere is copied into the folder."""
    path = Path(robot)
    if path.suffix != ".toml" or not path.is_file() or (folder / robot).is_file():
        return robot
    files.write(folder / path.name, files.read(path, path.name, toml.LARGEST_TEXT))
    return path.name


def known(root: Path, name: str, robot: str) -> Robot:
    """Load the named robot for a campaign that is still to be written.

    Raises:
        UsageError: There is no such robot.
    """
    try:
        return load(robot, root / "data" / "raw" / name)
    except InputError as problem:
        if problem.file != "campaign.toml":
            raise
        raise UsageError(f"--robot: {problem.thing}; {problem.way_out}") from problem
