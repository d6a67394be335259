"""The logs beside the tracker exports: scale, joints, and tables of already reduced campaigns.

All are delimited tables with a header whose column names carry the units; campaign.toml may say
what others call them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings, sifted
from pipeline.base.errors import InputError, at, listed
from pipeline.base.strict import LEAST_FORCE, LEAST_MASS, STANDARD_GRAVITY
from pipeline.machine.robot import Robot
from pipeline.readers import _log_words
from pipeline.readers._cells import is_number
from pipeline.readers._delimited import rows
from pipeline.readers._layout import Field, Kind, Layout, Rows
from pipeline.readers._log_form import OURS, LogForm, Titled, opened, understood

_Rejection = tuple[str, int | None, str]
"""File, line and reason of what was left out."""

FORCE = {"n": 1.0, "kn": 1e3, "kgf": STANDARD_GRAVITY, "lbf": 0.45359237 * STANDARD_GRAVITY}
"""Units of force [N]; those of weight with standard gravity."""
_SCALE = FORCE | {"dan": 10.0} | dict.fromkeys(("kg", "kp"), FORCE["kgf"])
"""What a scale may show: one in kilograms shows kilogram-force, the old kilopond. Decanewtons are
so near to it that no data tell the two apart."""
MASS = {"kg": 1.0, "g": 1e-3, "lb": 0.45359237}
"""Units of mass [kg]."""
LENGTH = {"m": 1.0, "mm": 1e-3, "in": 0.0254}
"""Units of length [m]."""
_FORCE_OF = {True: FORCE, False: {"nm": 1.0, "knm": 1e3}}
"""Units of what drives a sliding joint [N], and of what turns another [N m]."""
ANGLE = {"deg": np.pi / 180.0, "rad": 1.0}
"""Units of angles [rad]."""
BEYOND = 2**31
"""Poses and pulls are numbered below it: tables hold them in 32 bits."""
LIMIT_SLACK = 1e-9
"""How far a joint may seem beyond its limit [m] or [rad]: degrees are rounded when converted."""
_LARGEST = 1e7
"""Of lengths, angles and forces [SI], whatever unit was mistaken for whatever other."""
_BRANCHES = ("up", "down")


class State(NamedTuple):
    """What was read in a group: a state of a pose, and the line of the log that says so."""

    pose: int
    repeat: int
    loaded: bool
    line: int


@dataclass(frozen=True, eq=False)
class Log(Locked):
    """Rows of a log.

    Attributes:
        file: Its name.
        number: Numeric columns in SI by name, each shape (n,); NaN where a cell is empty.
        word: Columns of words by name, each shape (n,).
        line: Line of each row, shape (n,).
        rejected: What could not be read.
        states: What groups of readings are, by the names that the log has for them.
    """

    file: str
    number: dict[str, Array]
    word: dict[str, Strings]
    line: Ints
    rejected: tuple[_Rejection, ...]
    states: dict[str, State] = field(default_factory=dict)

    def only(self, good: Bools, reason: str) -> Log:
        """The rows that are good; the others are rejected, all for one reason."""
        return self.without(dict.fromkeys(np.flatnonzero(~good).tolist(), reason))

    def where(self, name: str, good: Callable[[Any], Bools], reason: str) -> Log:
        """The rows whose cell of a column, where there is such a column, is good."""
        column = (self.number | self.word).get(name)
        return self if column is None else self.only(good(column), reason)

    def without(self, why: Mapping[int, str]) -> Log:
        """All rows but some, which are rejected, each for its reason."""
        if not why:
            return self
        good = np.ones(len(self.line), dtype=bool)
        good[list(why)] = False
        left_out = tuple((self.file, int(self.line[k]), why[k]) for k in sorted(why))
        return replace(self.kept(good), rejected=self.rejected + left_out)

    def kept(self, good: Bools) -> Log:
        """Some of the rows; nothing is said of the others."""
        number, word = sifted(self.number, good), sifted(self.word, good)
        return replace(self, number=number, word=word, line=self.line[good])


@dataclass(frozen=True)
class Quantity:
    """A column to look for.

    Attributes:
        stem: Its name without unit.
        units: Factor to SI by unit suffix; empty for a number without unit.
        kind: `number` or `name`.
        needed: Whether the table must have it.
        filled: Whether every row of a table that must have it has to.
    """

    stem: str
    units: Mapping[str, float]
    kind: Kind = "number"
    needed: bool = True
    filled: bool = True


POSE = Quantity("pose", {})
_REPEAT = Quantity("repeat", {})
_TIME = Quantity("time", {}, "name", needed=False)
"""When a row was taken: `check` holds it against the readings."""


def loads(name: str, data: bytes, said: LogForm = OURS) -> Log:
    """What loads the robot: pose, repeat, branch where known, and in each row one of three.

    `force` [N] of a scale in a chain, `mass` [kg] of a weight at the load point with `mass_sigma`
    where it is known, or the name of a `payload`; a column may be missing where no row has it.
    Without a column `repeat` the pulls of each pose are counted from 1. A column `group` says in
    which group of the tracker's readings a row was read. A row without a load, then, or of force 0
    in every pose, is its unloaded state.

    Args:
        name: Name of the file.
        data: Its content.
        said: [scale] of campaign.toml.

    Raises:
        InputError: The file cannot be read or trusted as a whole.
    """
    wanted = _of_loads()
    _, _, force, *other = wanted
    kinds = [force, *other[:3]]
    file = opened(name, data, said, "scale", POSE.stem,
                  lambda titles: any(_suffixed(titles, q) for q in kinds))  # fmt: skip
    named = _suffixed(file.titles, other[-1]) is not None
    needed = not any(_suffixed(file.titles, q) for q in other[:3])
    wanted[0] = replace(POSE, filled=not named)
    wanted[2] = replace(force, needed=needed, filled=not named)
    _known(said, "scale", [*wanted, _TIME])
    log = _one_load(_pulls(_table(file, wanted, said, "scale")))
    if "branch" in log.word:
        own = np.array([_log_words.branch(cell) for cell in log.word["branch"]], dtype=object)
        log = replace(log, word=log.word | {"branch": own})
    reason = "branch is neither up nor down; correct it or leave it empty"
    log = log.where("branch", lambda words: np.isin(words, [*_BRANCHES, ""]), reason)
    return once(log, ["pose", "repeat"])


def group_name(name: str) -> str:
    """A group as a log and an export have it in common: 7 in a spreadsheet is 007 in the other."""
    return name.lstrip("0") or "0" if name.isdigit() else name


def _of_loads() -> list[Quantity]:
    """Pose, repeat, force; mass, its uncertainty, payload; branch and group."""
    mass = [Quantity(name, MASS, needed=False) for name in ("mass", "mass_sigma")]
    words = [Quantity(name, {}, "name", needed=False) for name in ("payload", "branch", "group")]
    return [POSE, replace(_REPEAT, needed=False), Quantity("force", _SCALE), *mass, *words]


def _pulls(log: Log) -> Log:
    """The rows that are pulls, each with its number; what the groups are that all rows name."""
    if "group" in log.word:  # one without a pose is of base reflectors
        log = log.kept(~np.isnan(log.number["pose"]))
    resting = _resting(log)
    log = _counted(log, resting)
    number = log.number | {"resting": resting.astype(float)}
    log = _whole_numbers(replace(log, number=number))
    if "group" in log.word:
        log = log.where("group", lambda names: names != "", "names no group; fill it in")
        log = once(log, ["group"])
        columns = (log.number["pose"], log.number["repeat"], log.number["resting"] == 0, log.line)
        states = (
            State(int(p), int(r), bool(up), int(k)) for p, r, up, k in zip(*columns, strict=True)
        )
        names = map(group_name, log.word["group"].tolist())
        log = replace(log, states=dict(zip(names, states, strict=True)))
    resting = log.number["resting"] != 0
    number = {name: column for name, column in log.number.items() if name != "resting"}
    word = {name: column for name, column in log.word.items() if name != "group"}
    return replace(log, number=number, word=word).kept(~resting)


def _resting(log: Log) -> Bools:
    """The rows of an unloaded state, shape (n,).

    Raises:
        InputError: A force is 0, and nobody knows whether it is the unloaded state or a pull.
    """
    none = np.full(len(log.line), np.nan)
    given = np.stack([log.number.get(name, none) for name in ("force", "mass")])
    payload = log.word.get("payload", np.full(len(none), "", dtype=object)) != ""
    empty: Bools = np.asarray(np.isnan(given).all(axis=0) & ~payload)
    zero: Bools = np.asarray(~empty & ~payload & (np.nan_to_num(given) == 0.0).all(axis=0))
    if "group" in log.word:
        return zero | empty
    if "repeat" in log.number:
        return zero & (log.number["repeat"] == 0)
    pose = pd.Series(log.number["pose"])
    poses = set(pose)
    if len(poses) > 1 and set(pose[zero]) == poses:
        return zero
    for k in np.flatnonzero(zero & pose.duplicated(keep="last").to_numpy())[:1]:
        raise InputError(
            "without a column repeat nobody knows whether this row of force 0 is the unloaded "
            "state or a pull, and which pulls the rows after it are",
            "correct or remove the row, or add the column repeat with 0 for the unloaded state",
            file=log.file,
            line=int(log.line[k]),
        )
    return np.zeros(len(zero), dtype=bool)


def _counted(log: Log, resting: Bools) -> Log:
    """A log with a number for each row, where it has none: of a pose's pulls from 1.

    Raises:
        InputError: A row cannot be read, and others of its pose may stand behind it.
    """
    if "repeat" in log.number:
        return log
    pose = pd.Series(log.number["pose"])
    if log.rejected and pose.duplicated().any() and "group" not in log.word:
        _, line, reason = log.rejected[0]
        raise InputError(
            f"without a column repeat nobody knows which pulls the rows after this one are: "
            f"{reason.partition('; ')[0]}",
            "correct the row, or add the column repeat",
            file=log.file,
            line=line,
        )
    number = pose.groupby([pose, pd.Series(resting)]).cumcount().to_numpy() + ~resting
    return replace(log, number=log.number | {"repeat": np.asarray(number, dtype=np.float64)})


def _one_load(log: Log) -> Log:
    """Only rows with one load, above zero; every kind is a column then, NaN or empty where not."""
    none = np.full(len(log.line), np.nan)
    number = dict.fromkeys(("force", "mass", "mass_sigma"), none) | log.number
    word = {"payload": np.full(len(none), "", dtype=object)} | log.word
    log = replace(log, number=number, word=word)
    for name, least in (("force", LEAST_FORCE), ("mass", LEAST_MASS)):
        small = log.number[name] < least  # NaN, an empty cell, is not
        log = log.only(~small, f"the {name} is not above zero; correct or remove the row")
    loaded = [~np.isnan(log.number[name]) for name in ("force", "mass")]
    count = np.sum([*loaded, log.word["payload"] != ""], axis=0)
    many = "has more than one of force, mass and payload; keep the one that was added in this pull"
    log = log.only(count <= 1, many)
    return log.only(count[count <= 1] == 1, "has no force, mass or payload; fill one of them in")


def joints(name: str, data: bytes, robot: Robot, said: LogForm = OURS) -> Log:
    """The controller's joint log, by the names of the robot's joints or of its controller's axes.

    Args:
        name: Name of the file.
        data: Its content.
        robot: Whose joints they are.
        said: [joints] of campaign.toml.

    Returns:
        The log with its poses and a number for each joint of the robot [m] or [rad]; where it has
        them the torques `tau1` ... of the joints [N m] or [N], and the `repeat` of each row.

    Raises:
        InputError: A joint is missing; the file cannot be read.
    """
    own, axes = _own(robot), _controller(robot)
    kinds = [names for names in (own, axes) if names]
    file = opened(name, data, said, "joints", POSE.stem,
                  lambda titles: any(_has(titles, one) for one in kinds))  # fmt: skip
    from_controller = bool(axes) and not _has(file.titles, own) and _has(file.titles, axes)
    wanted = axes if from_controller else own
    approach = Quantity("approach", {}, needed=False)
    torques = [Quantity(f"tau{j}", _FORCE_OF[q.units is LENGTH], needed=False)
               for j, q in enumerate(wanted, 1)]  # fmt: skip
    repeat = replace(_REPEAT, needed=False)
    others = [approach, repeat, *torques]
    _known(said, "joints", [POSE, _TIME, *own, *axes, *others])
    log = _whole_numbers(_table(file, [POSE, *wanted, *others], said, "joints"))
    reason = "approach is neither 1 nor -1; correct it or leave it empty"
    log = log.where("approach", lambda way: np.isin(way, [1, -1, 0]) | np.isnan(way), reason)
    log = once(log, ["pose", *({"repeat"} & {*log.number})])
    if not from_controller:
        return log
    axes_q = np.column_stack([log.number[axis.stem] for axis in axes])
    q = axes_q @ robot.controller_matrix.T + robot.controller_offset
    number = log.number | {j.name: q[:, k] for k, j in enumerate(robot.joints)}
    if {one.stem for one in torques} <= {*log.number} and len(axes) == robot.n:
        tau = np.column_stack([log.number[one.stem] for one in torques])
        turned = linear.solve(robot.controller_matrix.T, tau.T)  # both do the same work
        number |= {one.stem: tau for one, tau in zip(torques, turned, strict=True)}
    return replace(log, number=number)


def may_be_log(name: str, data: bytes) -> bool:
    """Whether a file has a line with a title for the number of a pose; one look, at all sheets.

    Raises:
        InputError: It is no text, or several sheets have one.
    """

    def poses(titles: Sequence[str]) -> dict[str, str] | None:
        return {} if _log_words.has_poses(titles) else None

    return understood(name, data, "scale", poses) is not None


def understood_loads(name: str, data: bytes) -> LogForm | None:
    """What [scale] may say of a log of loads with the titles of others; None where it is none."""
    units = {"force": tuple(_SCALE), "mass": tuple(MASS)}
    form = understood(name, data, "scale", lambda titles: _log_words.of_loads(titles, units))
    if form is None or "branch" not in form.columns.values():
        return form
    left = {title: ours for title, ours in form.columns.items() if ours != "branch"}
    without = LogForm(columns=left)
    try:
        lost = [len(loads(name, data, settled(one)).rejected) for one in (form, without)]
    except InputError:  # a decimal mark that has to be asked, say: no row tells anything yet
        return form
    return form if lost[0] == lost[1] else without


def settled(form: LogForm) -> LogForm:
    """A form as it can be read: of several names for a title, which differ by unit, the first."""
    columns = {title: ours.partition("|")[0] for title, ours in form.columns.items()}
    return form.model_copy(update={"columns": columns})


def understood_joints(name: str, data: bytes, robot: Robot) -> LogForm | None:
    """What [joints] may say of a joint log with the titles of others; None where it is none."""
    axes = _controller(robot) or _own(robot)
    slides = [q.units is LENGTH for q in axes]
    names, units = [q.stem for q in axes], ([*LENGTH], [*ANGLE])
    return understood(
        name, data, "joints", lambda titles: _log_words.of_joints(titles, names, slides, units)
    )


def numbered_joints(name: str, data: bytes, robot: Robot) -> list[LogForm]:
    """What [joints] may say of a log with as many columns of numbers as joints.

    Whatever their titles, the columns are in the order of the joints; one that slides may stand
    behind those that turn. Nothing is said yet of whether the robot can take the poses.

    Raises:
        InputError: The file cannot be read.
    """
    form = understood(name, data, "joints", _log_words.pose_alone)
    if form is None:
        return []
    file = opened(name, data, form, "joints", POSE.stem)
    fields = tuple(Field(str(k), "name", False) for k in range(len(file.titles)))
    read = rows(file.text, Layout(fields, file.delimiter, file.first, table="joints"))
    cells = [set(read.columns[one.name].cast(pa.string()).to_pylist()) for one in fields]
    titles = [
        written
        for written, title, some in zip(file.written, file.titles, cells, strict=True)
        if title not in (POSE.stem, _REPEAT.stem, "approach") and some and all(map(is_number, some))
    ]
    axes = _controller(robot) or _own(robot)
    if len(titles) != len(axes) or not _log_words.in_order(titles):
        return []
    behind = sorted(axes, key=lambda q: q.units is LENGTH)
    orders = [axes] if behind == axes else [axes, behind]
    return [
        form.model_copy(update={"columns": form.columns | _as_called(titles, one)})
        for one in orders
    ]


def _as_called(titles: Sequence[str], axes: Sequence[Quantity]) -> dict[str, str]:
    """Our names for titles, with bars between them where they state no unit."""
    return {
        title: "|".join(f"{q.stem}_{u}" for u in _log_words.stated_unit(title, [*q.units]))
        for title, q in zip(titles, axes, strict=True)
    }


def of_poses(log: Log) -> Log:
    """The first row of each pose of a joint log; further ones are there for their torques."""
    first = np.unique(log.number["pose"], return_index=True)[1]
    if len(first) == len(log.line):
        return log
    rows = np.zeros(len(log.line), dtype=bool)
    rows[first] = True
    return log.kept(rows)


def joint_values(log: Log, robot: Robot) -> Array:
    """Joint values of a joint log [m] or [rad], shape (n, joints)."""
    return np.column_stack([log.number[joint.name] for joint in robot.joints])


def _own(robot: Robot) -> list[Quantity]:
    """The robot's joints."""
    return [Quantity(j.name, LENGTH if j.prismatic else ANGLE) for j in robot.joints]


def _controller(robot: Robot) -> list[Quantity]:
    """The controller's axes; those that move a sliding joint are lengths."""
    slides = robot.prismatic.astype(float) @ np.abs(robot.controller_matrix) > 0
    axes = zip(robot.controller, slides, strict=True)
    return [Quantity(axis, LENGTH if slide else ANGLE) for axis, slide in axes]


def _has(header: Sequence[str], wanted: Sequence[Quantity]) -> bool:
    return all(_suffixed(header, q) for q in wanted)


def displacements(name: str, data: bytes) -> Log:
    """Displacements of an already reduced campaign: pose, repeat, target, dx, dy, dz [m]."""
    target = Quantity("target", {}, "name")
    axes = [Quantity(axis, LENGTH) for axis in ("dx", "dy", "dz")]
    log = _whole_numbers(table(name, data, [POSE, _REPEAT, target, *axes]))
    return once(log, ["pose", "repeat", "target"])


def forces(name: str, data: bytes) -> Log:
    """Forces of an already reduced campaign: pose, repeat, fx, fy, fz [N] in the base frame."""
    axes = [Quantity(axis, FORCE) for axis in ("fx", "fy", "fz")]
    log = _whole_numbers(table(name, data, [POSE, _REPEAT, *axes]))
    size = np.linalg.norm([log.number[axis.stem] for axis in axes], axis=0)
    log = log.only(size >= LEAST_FORCE, "the force is zero; correct or remove the row")
    return once(log, ["pose", "repeat"])


def table(name: str, data: bytes, wanted: Sequence[Quantity]) -> Log:
    """The wanted columns of a delimited table with a header, in SI; the first names its rows.

    Raises:
        InputError: Empty, a needed column is missing, or it has no unit.
    """
    return _table(opened(name, data, OURS, None, wanted[0].stem), wanted, OURS, None)


def _table(file: Titled, wanted: Sequence[Quantity], said: LogForm, where: str | None) -> Log:
    """The same of a log whose header was found, and that a table of campaign.toml may describe."""
    name, titles = file.text.name, file.titles
    with at(name):
        with at(line=file.line):
            there = [(q, *column) for q in wanted if (column := _column(titles, q, where))]
        known = {title: Field(title, q.kind, q.needed and q.filled) for q, title, _ in there}
        other = {title: Field(title, "any" if title else "blank", False) for title in titles}
        fields = tuple((other | known)[title] for title in titles)
        layout = Layout(fields, file.delimiter, file.first, said.decimal, table=where)
        log = _log(name, rows(file.text, layout), there)
        early = tuple((name, line, reason) for line, reason in file.above)
        log = replace(log, rejected=early + log.rejected)
        if not len(log.line) + len(log.rejected):
            raise InputError("there is no row in it, nothing but a header", "export it again")
    return _possible(log, [q.stem for q in wanted if q.units])


def _known(said: LogForm, where: str, quantities: Sequence[Quantity]) -> None:
    """Every name that campaign.toml gives a column is one of ours.

    Raises:
        InputError: One is not.
    """
    names = [name for q in quantities for name in _names(q)]
    for title, ours in said.columns.items():
        if ours.lower() not in {name.lower() for name in names}:
            raise InputError(
                f'[{where}.columns] calls "{title}" {ours}, which is no column of ours',
                f"there are {listed(names, most=40)}",
                file="campaign.toml",
            )


def _log(file: str, read: Rows, columns: Sequence[tuple[Quantity, str, float]]) -> Log:
    """A table in SI; of each quantity the title of its column, and the factor."""
    number = {q.stem: read.floats(title) * si for q, title, si in columns if q.kind == "number"}
    words = {q.stem: read.columns[title] for q, title, _ in columns if q.kind == "name"}
    word = {k: w.cast(pa.string()).to_numpy(zero_copy_only=False) for k, w in words.items()}
    rejected = tuple((file, line, reason) for line, reason in read.rejected)
    return Log(file, number, word, read.line, rejected)


def _possible(log: Log, names: Sequence[str]) -> Log:
    """Only rows with values that an instrument may show."""
    for name in names:
        reason = f"{name} is larger than any instrument shows; correct or remove the row"
        log = log.where(name, lambda values: ~(np.abs(values) > _LARGEST), reason)
    return log


def unknown(name: str, data: bytes, said: LogForm) -> tuple[str, ...]:
    """Titles of a log of loads that are no name of ours, as written."""
    ours = {one for q in _of_loads() for one in (*map(str.lower, _names(q)), q.stem)}
    file = opened(name, data, said, "scale", POSE.stem)
    both = zip(file.titles, file.written, strict=True)
    return tuple(written for title, written in both if title and title not in ours)


def columns(name: str, data: bytes) -> tuple[str, ...]:
    """Names of the columns in the header of a delimited table."""
    return opened(name, data, OURS, None, POSE.stem).titles


def _names(q: Quantity) -> list[str]:
    """What the column of a quantity may be called."""
    return [f"{q.stem}_{unit}" for unit in q.units] or [q.stem]


def _suffixed(titles: Sequence[str], q: Quantity) -> tuple[str, str | None] | None:
    """The column of a quantity and the unit in its name: `x_mm`, `mm`; None where it has none."""
    of_unit = {f"{q.stem}_{unit}".lower(): unit for unit in q.units} | {q.stem.lower(): None}
    return next(((name, of_unit[name]) for name in titles if name in of_unit), None)


def _column(titles: Sequence[str], q: Quantity, where: str | None) -> tuple[str, float] | None:
    """The column of a quantity and its factor to SI, or None where it has none and needs none."""
    found = _suffixed(titles, q)
    mapped = (
        f", or say what it is in [{where}.columns] of campaign.toml, as `pipeline inspect` proposes"
        if where
        else ""
    )
    if found is None and q.needed:
        raise InputError(
            f"there is no column {_names(q)[0]} among {listed(titles)}",
            f"add it to the header and to every row{mapped}",
        )
    if found and q.units and found[1] is None:
        raise InputError(
            f"column {found[0]} does not say its unit",
            f"call it {' or '.join(_names(q))}{mapped}",
        )
    return (found[0], q.units[found[1]] if found[1] else 1.0) if found else None


def _whole_numbers(log: Log) -> Log:
    """Only rows whose pose and repeat are whole numbers, not negative."""

    def whole(values: Array) -> Bools:
        return (values >= 0) & (values == np.round(values)) & (values < BEYOND)

    for name in ("pose", "repeat"):
        log = log.where(name, whole, f"{name} is not a whole number; correct or remove the row")
    return log


def once(log: Log, key: Sequence[str]) -> Log:
    """Rows whose key comes once: equal ones are kept once, contradicting ones not at all."""
    rows = pd.DataFrame({**log.number, **log.word})
    twice = rows[rows.duplicated(list(key), keep=False)]
    why: dict[int, str] = {}
    for _, same in twice.groupby(list(key), sort=False):
        agree = len(same.drop_duplicates()) == 1
        line = log.line[same.index]
        reason = (
            f"repeats line {line[0]}; remove it"
            if agree
            else f"lines {listed(map(str, line))} contradict each other; keep the right one"
        )
        why |= dict.fromkeys(same.index[agree:].tolist(), reason)
    return log.without(why)
