"""Read the logs of a campaign: scale, joints, and tables of already reduced campaigns.

All are delimited tables with a header whose column names state the units; campaign.toml may map the
names used by other programs.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools
from pipeline.base.errors import InputError, listed
from pipeline.base.strict import LEAST_FORCE, LEAST_MASS, STANDARD_GRAVITY
from pipeline.machine.robot import Robot
from pipeline.readers._log_table import GroupState as GroupState
from pipeline.readers._log_table import Log as Log
from pipeline.readers._log_table import Quantity as Quantity
from pipeline.readers._log_table import (
    Titled,
    known_columns,
    opened,
    suffixed,
    typed,
    whole_numbers,
)
from pipeline.readers._log_table import once as once
from pipeline.readers._log_table import table as table
from pipeline.readers.export_settings import OWN_LOG, JointForm, LogForm
from pipeline.readers.pose_names import coded

FORCE = {"n": 1.0, "kn": 1e3, "kgf": STANDARD_GRAVITY, "lbf": 0.45359237 * STANDARD_GRAVITY}
"""Units of force [N]; those of weight are converted with standard gravity."""
SCALE = FORCE | {"dan": 10.0} | dict.fromkeys(("kg", "kp"), FORCE["kgf"])
"""Units that a scale may show [N]: one in kilograms shows kilogram-force, formerly kilopond. A
decanewton differs so little from it that no data can tell the two apart."""
MASS = {"kg": 1.0, "g": 1e-3, "lb": 0.45359237}
"""Units of mass [kg]."""
LENGTH = {"m": 1.0, "mm": 1e-3, "in": 0.0254}
"""Units of length [m]."""
_TORQUE = {"nm": 1.0, "knm": 1e3}
"""Units of the torque on a revolute joint [N m]."""
_ON_SLIDE = FORCE | _TORQUE
"""Units of the force on a prismatic joint [N]; a recording calls each of its columns a torque."""
ANGLE = {"deg": np.pi / 180.0, "rad": 1.0}
"""Units of angles [rad]."""
_BRANCH = {
    "up": {
        "up", "auf", "aufwärts", "aufwaerts", "hin", "steigend", "belasten", "belastung", "loading",
        "increasing", "rising", "ascending", "forward", "montée",
    },
    "down": {
        "down", "ab", "abwärts", "abwaerts", "zurück", "zurueck", "rück", "fallend", "entlasten",
        "entlastung", "unloading", "decreasing", "falling", "descending", "back", "return",
        "descente",
    },
}  # fmt: skip
"""Words for the direction in which the turnbuckle was last turned."""
_BRANCH_OF = {word: ours for ours, words in _BRANCH.items() for word in words}


POSE = Quantity("pose", {})
REPEAT = Quantity("repeat", {})
POSE_REPEAT = Quantity("pose_repeat", {}, "name", needed=False)
"""Name of a row that begins with the numbers of its pose and pull: `P01/2 W7`."""
_TIME = Quantity("time", {}, "name", needed=False)
"""Time at which a row was recorded; `check` compares it with the readings."""
REMARK = Quantity("remark", {}, "name", needed=False)
"""Remark of the operator on a row; `check` repeats it."""


def loads(name: str, data: bytes, stated: LogForm = OWN_LOG) -> Log:
    """Read the log of loads: pose, repeat, branch if known, and one kind of load in each row.

    The load is `force` [N], read on a scale in a chain, `mass` [kg] of a weight at the load point
    with `mass_sigma` if known, or the name of a `payload`; a column may be missing if no row uses
    it. With `force_1`, `force_2` ... a row is a pose, each column one of its pulls, hooked to
    `anchor_1`, `anchor_2` ..., and a cell may be empty. Without a column `repeat` the pulls of each
    pose are numbered from 1. A column `group` names the group of tracker readings that belongs to a
    row. With it, a row without a load is the unloaded state of a pose; so is a row of force 0, also
    without it if every pose has one.

    Args:
        name: Name of the file.
        data: Its content.
        stated: [scale] of campaign.toml.

    Raises:
        InputError: The file cannot be read or trusted as a whole.
    """
    wanted = of_loads()
    _, _, force, *other = wanted
    file = opened(name, data, stated, "scale", POSE.stem, has_load)
    named = suffixed(file.titles, other[-1]) is not None
    each = forces_of_pulls(file.titles)
    needed = not each and not any(suffixed(file.titles, q) for q in other[:3])
    wanted[0] = replace(POSE, filled=not named, carried=not (named or each))
    wanted[2] = replace(force, needed=needed, filled=not named)
    tagged = suffixed(file.titles, POSE_REPEAT) is not None
    wanted[0] = replace(wanted[0], needed=not tagged)
    hooks = [Quantity(f"anchor{q.stem[5:]}", {}, "name", needed=False) for q in each]
    wanted_all = [*wanted, *each, *hooks, POSE_REPEAT]
    known_columns(stated, "scale", [*wanted_all, _TIME, REMARK])
    log = _numbered(typed(file, wanted_all, stated, "scale"))
    log = _one_load(_pulls(_a_row_each(_with_units(log, [force, *each], file.titles), each)))
    if "branch" in log.word:
        own = np.array(
            [_BRANCH_OF.get(cell.strip().lower(), cell) for cell in log.word["branch"]],
            dtype=object,
        )
        log = replace(log, word=log.word | {"branch": own})
    reason = "branch is neither up nor down; correct it or leave it empty"
    log = log.where("branch", lambda words: np.isin(words, [*_BRANCH, ""]), reason)
    return once(log, ["pose", "repeat"])


_TAG = re.compile(
    r"(?:[^\W\d_]+[ _.-]*)?0*(?P<pose>[0-9]{1,4})(?P<letters>[^\W\d_]{0,4})[ /_:;,-]+"
    r"(?:[^\W\d_]+[ _.-]*)?0*(?P<repeat>[0-9]{1,3})(?![0-9.,])[^0-9]?.*"
)


def pose_and_repeat(tag: str) -> tuple[int, int] | None:
    """The numbers of pose and pull that a name begins with; None if it does not."""
    if (found := _TAG.fullmatch(tag.strip())) is None:
        return None
    return coded(found["pose"] + found["letters"]) or int(found["pose"]), int(found["repeat"])


def _numbered(log: Log) -> Log:
    """A log whose rows have pose and pull in their name; a row of force 0 needs none."""
    if POSE_REPEAT.stem not in log.word:
        return log
    tags = log.word[POSE_REPEAT.stem]
    found = [pose_and_repeat(tag) for tag in tags]
    pose, repeat = np.array([one or (np.nan, np.nan) for one in found]).reshape(-1, 2).T
    word = {name: column for name, column in log.word.items() if name != POSE_REPEAT.stem}
    log = replace(log, number=log.number | {"pose": pose, "repeat": repeat}, word=word)
    force = log.number.get("force", np.full(len(pose), np.nan))
    zero = np.isnan(pose) & (force < LEAST_FORCE)
    reason = 'does not begin with the numbers of a pose and a pull, as "P01/2"; correct it'
    return log.kept(~zero).only(~np.isnan(pose[~zero]), reason)


def group_name(name: str) -> str:
    """Normalise the name of a group: 7 in a spreadsheet is 007 in an export."""
    return name.lstrip("0") or "0" if name.isdigit() else name


def has_load(titles: Sequence[str]) -> bool:
    """Whether the columns are those of a log of loads."""
    return any(suffixed(titles, q) for q in [*of_loads()[2:6], *forces_of_pulls(titles)])


_OF_PULL = re.compile(r"force_([0-9]{1,3})(_[a-z]+)?")


def forces_of_pulls(titles: Sequence[str]) -> list[Quantity]:
    """Columns with the force of one pull each, `force_2_n`, where a row is a pose."""
    found = (_OF_PULL.fullmatch(title) for title in titles)
    stems = dict.fromkeys(f"force_{one[1]}" for one in found if one)
    return [Quantity(stem, SCALE, needed=False) for stem in stems]


def _with_units(log: Log, forces: Sequence[Quantity], titles: Sequence[str]) -> Log:
    """A column for the unit [N] of each column of forces: `unit`, `unit_1` ..."""
    found = ((q.stem, suffixed(titles, q)) for q in forces)
    units = {stem: SCALE[one[1]] for stem, one in found if one and one[1]}
    each = {f"unit{stem[5:]}": np.full(len(log.line), of) for stem, of in units.items()}
    return replace(log, number=log.number | each)


def _a_row_each(log: Log, each: Sequence[Quantity]) -> Log:
    """A row for each pull of a log with a column for each; an empty cell is none."""
    if not each:
        return log
    for name in {"force", "repeat"} & {*log.number}:
        twice = f"has a {name} beside one column a pull; keep one of the two"
        log = log.where(name, np.isnan, twice)
    pulls = [q.stem.removeprefix("force_") for q in each]
    force = np.column_stack([log.number[f"force_{k}"] for k in pulls])
    unit = np.column_stack([log.number[f"unit_{k}"] for k in pulls])
    there = ~np.isnan(force)
    there[~there.any(axis=1), 0] = True  # a row without any is rejected, not lost
    row, pull = np.nonzero(there)
    repeat = np.array(pulls, dtype=np.float64)
    number = {k: one[row] for k, one in log.number.items()
              if not k.startswith(("force_", "unit_"))}  # fmt: skip
    number |= {"force": force[row, pull], "unit": unit[row, pull], "repeat": repeat[pull]}
    word = {k: one[row] for k, one in log.word.items() if not k.startswith("anchor_")}
    none = np.full(len(log.line), "", dtype=object)
    hooks = [log.word.get(f"anchor_{k}", none) for k in pulls]
    if len(word) < len(log.word):
        word["anchor"] = np.column_stack(hooks)[row, pull]
    return replace(log, number=number, word=word, line=log.line[row])


def of_loads() -> list[Quantity]:
    """Columns of a log of loads.

    In this order: pose, repeat, force; mass, its uncertainty, payload; branch, anchor and group.
    """
    mass = [Quantity(name, MASS, needed=False) for name in ("mass", "mass_sigma")]
    names = ("payload", "branch", "anchor", "group")
    words = [Quantity(name, {}, "name", needed=False) for name in names]
    return [POSE, replace(REPEAT, needed=False), Quantity("force", SCALE), *mass, *words]


def _pulls(log: Log) -> Log:
    """Keep the rows that are pulls, numbered; if there are groups, record the state of each."""
    if "group" in log.word:  # one without a pose is of base reflectors
        log = log.kept(~np.isnan(log.number["pose"]))
    resting = _resting(log)
    log = _counted(log, resting)
    number = log.number | {"resting": resting.astype(float)}
    log = whole_numbers(replace(log, number=number))
    if "group" in log.word:
        log = log.where("group", lambda names: names != "", "names no group; fill it in")
        log = once(log, ["group"])
        columns = (log.number["pose"], log.number["repeat"], log.number["resting"] == 0, log.line)
        states = (
            GroupState(int(p), int(r), bool(up), int(k))
            for p, r, up, k in zip(*columns, strict=True)
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
        InputError: A force is 0, and it is ambiguous whether the row is an unloaded state or a
            pull.
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
            "without a column repeat it is ambiguous whether this row of force 0 is the unloaded "
            "state or a pull, and which pulls the rows after it are",
            "correct or remove the row, or add the column repeat with 0 for the unloaded state",
            file=log.file,
            line=int(log.line[k]),
        )
    return np.zeros(len(zero), dtype=bool)


def _counted(log: Log, resting: Bools) -> Log:
    """Number the rows of a log that has no column repeat: the pulls of each pose from 1.

    Raises:
        InputError: A row cannot be read, and later rows of its pose would be misnumbered.
    """
    if "repeat" in log.number:
        return log
    pose = pd.Series(log.number["pose"])
    if log.rejected and pose.duplicated().any() and "group" not in log.word:
        _, line, reason = log.rejected[0]
        raise InputError(
            f"without a column repeat it is ambiguous which pulls the rows after this one are: "
            f"{reason.partition('; ')[0]}",
            "correct the row, or add the column repeat",
            file=log.file,
            line=line,
        )
    number = pose.groupby([pose, pd.Series(resting)]).cumcount().to_numpy() + ~resting
    return replace(log, number=log.number | {"repeat": np.asarray(number, dtype=np.float64)})


def _one_load(log: Log) -> Log:
    """Keep only rows with exactly one load, above zero.

    Afterwards every kind of load has a column, NaN or empty in rows without it.
    """
    none = np.full(len(log.line), np.nan)
    number = dict.fromkeys(("force", "unit", "mass", "mass_sigma"), none) | log.number
    word = {"payload": np.full(len(none), "", dtype=object)} | log.word
    log = replace(log, number=number, word=word)
    for name, least in (("force", LEAST_FORCE), ("mass", LEAST_MASS), ("mass_sigma", 0.0)):
        small = log.number[name] < least  # NaN, an empty cell, is not
        log = log.only(~small, f"the {name} is not above zero; correct or remove the row")
    loaded = [~np.isnan(log.number[name]) for name in ("force", "mass")]
    count = np.sum([*loaded, log.word["payload"] != ""], axis=0)
    many = "has more than one of force, mass and payload; keep the one that was added in this pull"
    log = log.only(count <= 1, many)
    return log.only(count[count <= 1] == 1, "has no force, mass or payload; fill one of them in")


def joints(
    name: str, data: bytes, robot: Robot, stated: LogForm = OWN_LOG, section: str | None = "joints"
) -> Log:
    """Read the controller's joint log, by the robot's joint names or the controller's axis names.

    Args:
        name: Name of the file.
        data: Its content.
        robot: The robot whose joints they are.
        stated: [joints] of campaign.toml.
        section: Table of campaign.toml that may rename its columns; None for a file outside a
            campaign.

    Returns:
        The log with its poses and a number for each joint of the robot [m] or [rad]; if present
        also the torques `tau1` ... of the joints [N m] or [N], and the `repeat` of each row.

    Raises:
        InputError: A joint is missing; the file cannot be read.
    """
    pulses = stated.pulses if isinstance(stated, JointForm) else {}
    own, axes = (_in_pulses(some, pulses) for some in (own_joints(robot), controller_axes(robot)))
    file = opened(name, data, stated, "joints", POSE.stem, partial(has_joints, robot))
    from_controller = bool(axes) and not _has(file.titles, own) and _has(file.titles, axes)
    wanted = axes if from_controller else own
    approach = Quantity("approach", {}, needed=False)
    torques = [Quantity(f"tau{j}", _ON_SLIDE if "mm" in q.units else _TORQUE, needed=False)
               for j, q in enumerate(wanted, 1)]  # fmt: skip
    others = [approach, replace(REPEAT, needed=False), *torques]
    known_columns(stated, "joints", [POSE, _TIME, REMARK, *own, *axes, *others])
    _pulses_known(file, wanted, pulses)
    log = whole_numbers(typed(file, [POSE, *wanted, *others], stated, section))
    log = _from_zero(log, file, wanted, pulses)
    reason = "approach is neither 1 nor -1; correct it or leave it empty"
    log = log.where("approach", lambda way: np.isin(way, [1, -1, 0]) | np.isnan(way), reason)
    log = once(log, ["pose", *({"repeat"} & {*log.number})], _STILL)
    return _of_joints(log, robot, [one.stem for one in torques]) if from_controller else log


_STILL = 1e-5
"""Largest motion of an axis between two logs of one standstill [rad] or [m]."""
PULSES = "pulses"
"""Unit of joint values that an encoder counts."""
SI = "si"
"""Unit of joint values that are radians or metres, whichever the joint has."""


def _two(pulses: float | tuple[float, float]) -> tuple[float, float]:
    """Pulses per degree or mm, and those at which the axis shows 0."""
    return pulses if isinstance(pulses, tuple) else (pulses, 0.0)


def _in_pulses(
    axes: Sequence[Quantity], pulses: Mapping[str, float | tuple[float, float]]
) -> list[Quantity]:
    """The axes, with pulses as one more unit of each; NaN where their number is not known."""
    per = {q.stem: _two(pulses.get(q.stem, np.nan))[0] for q in axes}
    small = {q.stem: q.units["mm" if q.units is LENGTH else "deg"] for q in axes}
    return [
        replace(q, units={**q.units, SI: 1.0, PULSES: small[q.stem] / (per[q.stem] or np.nan)})
        for q in axes
    ]


def _pulses_known(file: Titled, axes: Sequence[Quantity], pulses: Mapping[str, object]) -> None:
    """Refuse axes in pulses for which it is not stated how many are a degree or a millimetre.

    Raises:
        InputError: There is one.
    """
    counted = [q.stem for q in axes if f"{q.stem}_{PULSES}".lower() in file.titles]
    if lacking := [axis for axis in counted if axis not in pulses]:
        raise InputError(
            f"the values of {listed(lacking)} are encoder pulses, and nothing says how many are a "
            "degree (a millimetre of a sliding axis)",
            f"write it into [joints.pulses] of campaign.toml, as {lacking[0]} = 1570.6, or "
            f"{lacking[0]} = [1570.6, 250] with the pulses at which the axis shows 0",
            file=file.text.name,
            line=file.line,
        )


def _from_zero(
    log: Log,
    file: Titled,
    axes: Sequence[Quantity],
    pulses: Mapping[str, float | tuple[float, float]],
) -> Log:
    """Subtract from axes in pulses the value [m] or [rad] of those at which they show 0."""
    zeros = {
        q.stem: _two(pulses[q.stem])[1] * q.units[PULSES]
        for q in axes
        if q.stem in pulses and f"{q.stem}_{PULSES}".lower() in file.titles
    }
    number = log.number | {axis: log.number[axis] - zero for axis, zero in zeros.items()}
    return replace(log, number=number)


def _of_joints(log: Log, robot: Robot, torques: Sequence[str]) -> Log:
    """Add joint values to a log of controller axes, and convert all torques to those of the joints.

        q = C a + q_0,    tau_a = C' tau,

    with C the `controller_matrix` and q_0 the `controller_offset` of the robot: both do the same
    work.
    """
    axes = np.column_stack([log.number[axis] for axis in robot.controller])
    q = axes @ robot.controller_matrix.T + robot.controller_offset
    number = log.number | {j.name: q[:, k] for k, j in enumerate(robot.joints)}
    if {*torques} <= {*log.number} and len(torques) == robot.n:
        tau = np.column_stack([log.number[one] for one in torques])
        turned = linear.solve(robot.controller_matrix.T, tau.T)
        number |= dict(zip(torques, turned, strict=True))
    return replace(log, number=number)


def of_poses(log: Log) -> Log:
    """The first row of each pose of a joint log; further rows are there only for their torques."""
    first = np.unique(log.number["pose"], return_index=True)[1]
    if len(first) == len(log.line):
        return log
    rows = np.zeros(len(log.line), dtype=bool)
    rows[first] = True
    return log.kept(rows)


def joint_values(log: Log, robot: Robot) -> Array:
    """Joint values of a joint log [m] or [rad], shape (n, joints)."""
    return np.column_stack([log.number[joint.name] for joint in robot.joints])


def own_joints(robot: Robot) -> list[Quantity]:
    """Columns of the robot's joints."""
    return [Quantity(j.name, LENGTH if j.prismatic else ANGLE) for j in robot.joints]


def controller_axes(robot: Robot) -> list[Quantity]:
    """Columns of the controller's axes; those that move a prismatic joint are lengths."""
    axes = zip(robot.controller, robot.slides, strict=True)
    return [Quantity(axis, LENGTH if slides else ANGLE) for axis, slides in axes]


def has_joints(robot: Robot, titles: Sequence[str]) -> bool:
    """Whether the columns include all joints of a robot, or all axes of its controller."""
    return any(_has(titles, one) for one in (own_joints(robot), controller_axes(robot)) if one)


def _has(header: Sequence[str], wanted: Sequence[Quantity]) -> bool:
    return all(suffixed(header, q) for q in wanted)


def displacements(name: str, data: bytes) -> Log:
    """Read displacements of an already reduced campaign: pose, repeat, target, dx, dy, dz [m]."""
    target = Quantity("target", {}, "name")
    axes = [Quantity(axis, LENGTH) for axis in ("dx", "dy", "dz")]
    log = whole_numbers(table(name, data, [POSE, REPEAT, target, *axes]))
    return once(log, ["pose", "repeat", "target"])


def forces(name: str, data: bytes) -> Log:
    """Read base-frame forces of an already reduced campaign: pose, repeat, fx, fy, fz [N]."""
    axes = [Quantity(axis, FORCE) for axis in ("fx", "fy", "fz")]
    log = whole_numbers(table(name, data, [POSE, REPEAT, *axes]))
    size = np.linalg.norm([log.number[axis.stem] for axis in axes], axis=0)
    log = log.only(size >= LEAST_FORCE, "the force is zero; correct or remove the row")
    return once(log, ["pose", "repeat"])


def columns(name: str, data: bytes) -> tuple[str, ...]:
    """Names of the columns in the header of a delimited table."""
    return opened(name, data, OWN_LOG, None, POSE.stem).titles


AXES, TURNS = ("x", "y", "z"), ("rx", "ry", "rz")

TEMPERATURE = {"c": 1.0}
"""Units of temperature [degC]."""


def with_joints(
    name: str, data: bytes, robot: Robot, stated: LogForm, others: list[Quantity]
) -> Log:
    """Read joint values, under the robot's or its controller's names, and further columns.

    Raises:
        InputError: A joint is missing; the file cannot be read.
    """
    own, axes = own_joints(robot), controller_axes(robot)
    file = opened(name, data, stated, "positions", own[0].stem)
    there = [[q for q in kind if suffixed(file.titles, q)] for kind in (own, axes)]
    from_controller = bool(axes) and len(there[1]) > len(there[0])
    known_columns(stated, "positions", [*own, *axes, *others])
    log = typed(file, [*(axes if from_controller else own), *others], stated, "positions")
    return _of_joints(log, robot, ()) if from_controller else log
