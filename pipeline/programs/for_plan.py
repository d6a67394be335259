"""Robot program that drives a plan and stops at each reading with the name of its group.

It has only joint motions, in the controller's axes, so that neither tool nor base nor arm
configuration needs to be known. On a rail, the carriage first goes to one side of the pose, so that
it arrives from the side that the plan states. KUKA (.src and .dat), ABB (.mod), FANUC (.ls) and UR
(.script).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Bools, Locked
from pipeline.machine.robot import Robot, axes

_ARM = 6
"""Number of arm axes that these languages can write."""

_BESIDE_MM = 100.0
"""Distance beside its pose to which the carriage first goes [mm]; many times the backlash of any
rack."""

_SPEED = 10
"""Joint speed of every motion [%]; low because a person stands there with a chain."""


@dataclass(frozen=True)
class _Stop:
    """A place where the program waits for the operator.

    Attributes:
        group: Name of the group in the tracker.
        todo: What to do there, in a few words of ASCII letters.
    """

    group: str
    todo: str


NO_CELL = _Stop("NOT CHECKED", "floor, walls, chain: go slowly")
"""Warning at the start if the cell is not described."""


@dataclass(frozen=True, eq=False)
class _Drive(Locked):
    """Motions and stops of a plan.

    Attributes:
        name: Name of the plan.
        axes: Axis values of each pose as displayed by the controller, arm first [deg], then
            external axes [mm] or [deg], shape (p, 6 + e).
        rail: Which axes are lengths, shape (6 + e,).
        approach: Direction from which the carriage arrives, 1 or -1; 0 where it does not matter,
            shape (p,).
        stops: Stops at each pose.
        lower: Lower limits of the axes, shape (6 + e,).
        upper: Upper limits, likewise.
        via: Points on the way to each pose, in units of `axes`, shape (k, 6 + e) each.
        first: Warnings shown before anything moves.
    """

    name: str
    axes: Array
    rail: Bools
    approach: Array
    stops: tuple[tuple[_Stop, ...], ...]
    lower: Array
    upper: Array
    via: tuple[Array, ...] = ()
    first: tuple[_Stop, ...] = ()

    def beside(self, pose: int) -> Array | None:
        """Where the carriage goes first; None without a rail or if there is no room."""
        shift = -_BESIDE_MM * self.approach[pose] * np.where(self.rail, 1.0, 0.0)
        at = np.clip(self.axes[pose] + shift, self.lower, self.upper)
        return at if np.abs(at - self.axes[pose]).max() > 0 else None

    def points(self) -> Iterator[tuple[str, Array, tuple[_Stop, ...]]]:
        """Name, axis values and stops of each point in the order of driving."""
        for k, (at, stops) in enumerate(zip(self.axes, self.stops, strict=True)):
            for place, point in enumerate(self.via[k] if self.via else (), 1):
                yield f"v{k + 1:02d}_{place}", point, ()
            if (first := self.beside(k)) is not None:
                yield f"b{k + 1:02d}", first, ()
            yield f"p{k + 1:02d}", at, stops


def programs(drive: _Drive, brand: str | None = None) -> dict[str, bytes]:
    """Programs of a plan by file name; none if the arm has fewer than six axes.

    Args:
        drive: Motions and stops.
        brand: kuka, abb, fanuc or ur; if None, all that can hold the axes of the robot.
    """
    count = drive.axes.shape[1]
    if count < _ARM:
        return {}
    name = _plain(drive.name)
    out: dict[str, bytes] = {}
    for one, (write, most) in _WRITERS.items():
        if brand in (None, one) and count <= most:
            out |= {file: text.encode("ascii") for file, text in write(name, drive).items()}
    return out


def brand_of(description: str) -> str | None:
    """Maker of a robot according to its description; None unless exactly one is named."""
    low = description.lower()
    words = {"kuka": "kuka", "abb": "abb", "fanuc": "fanuc", "universal robots": "ur"}
    found = {brand for word, brand in words.items() if re.search(rf"\b{word}\b", low)}
    return found.pop() if len(found) == 1 else None


def _plain(name: str) -> str:
    """A name valid in all four languages: letters, digits, underscores, first a letter."""
    word = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_") or "plan"
    return (word if word[0].isalpha() else f"p_{word}")[:24]


def _number(value: float, decimals: int = 6) -> str:
    """A decimal number with at least one decimal and no further trailing zeros."""
    text = f"{value:.{decimals}f}".rstrip("0")
    text = f"{text}0" if text.endswith(".") else text
    return text.removeprefix("-") if float(text) == 0 else text


def _krl(name: str, drive: _Drive) -> dict[str, str]:
    names = [f"A{k + 1}" for k in range(_ARM)]
    names += [f"E{k + 1}" for k in range(drive.axes.shape[1] - _ARM)]
    data, lines = [f"DEFDAT {name}"], [f"DEF {name} ( )", "", "BAS(#INITMOV,0)"]
    lines += [f"BAS(#VEL_PTP,{_SPEED})", "BAS(#ACC_PTP,20)", *_krl_stops(drive.first)]
    for point, at, stops in drive.points():
        both = zip(names, at, strict=True)
        values = ",".join(f"{axis} {_number(value)}" for axis, value in both)
        data.append(f"DECL E6AXIS X{point}={{{values}}}")
        lines += ["", f"PTP X{point}", *_krl_stops(stops)]
    return {
        f"{name}.src": "\r\n".join([*lines, "", "END", ""]),
        f"{name}.dat": "\r\n".join([*data, "ENDDAT", ""]),
    }


def _krl_stops(stops: Sequence[_Stop]) -> Iterator[str]:
    for stop in stops:
        yield from (f'MsgNotify("{stop.group}: {stop.todo}")', "WAIT SEC 0", "HALT")


def _rapid(name: str, drive: _Drive) -> dict[str, str]:
    data, lines = list[str](), [*_rapid_stops(drive.first)]
    for point, at, stops in drive.points():
        arm = ",".join(_number(value) for value in at[:_ARM])
        further = [*(_number(value) for value in at[_ARM:]), *["9E9"] * _ARM][:_ARM]
        data.append(f"  CONST jointtarget {point} := [[{arm}],[{','.join(further)}]];")
        lines.append(f"    MoveAbsJ {point}, v100, fine, tool0;")
        lines += _rapid_stops(stops)
    whole = [
        f"MODULE {name}",
        *data,
        f"  PROC {name}_main()",
        f"    VelSet {_SPEED}, 500;",
        *lines,
        "  ENDPROC",
        "ENDMODULE",
        "",
    ]
    return {f"{name}.mod": "\r\n".join(whole)}


def _rapid_stops(stops: Sequence[_Stop]) -> Iterator[str]:
    for stop in stops:
        yield from (f'    TPWrite "{stop.group}:";', f'    TPWrite "{stop.todo[:40]}";')
        yield "    Stop;"


_SHORT = 24
"""Maximum number of characters of a message in a teach pendant program."""


def _tp(name: str, drive: _Drive) -> dict[str, str]:
    steps = [*_tp_stops(drive.first)]
    places: list[str] = []
    for number, (point, at, stops) in enumerate(drive.points(), 1):
        steps.append(f"J P[{number}] {_SPEED}% FINE")
        steps += _tp_stops(stops)
        arm = [f"\tJ{k + 1}= {at[k]:.3f} deg" for k in range(_ARM)]
        units = ("mm" if slides else "deg" for slides in drive.rail[_ARM:])
        more = [
            f"\tE{k}= {x:.3f} {u}" for k, (x, u) in enumerate(zip(at[_ARM:], units, strict=True), 1)
        ]
        rows = ",\n".join([",\t".join(arm[:3]), ",\t".join(arm[3:]), *more])
        places.append(f'P[{number}:"{point}"]{{\n   GP1:\n\tUF : 0, UT : 1,\n{rows}\n}};')
    body = [f"{k:4d}:  {step} ;" for k, step in enumerate(steps, 1)]
    head = [
        f"/PROG  {name.upper()}",
        "/ATTR",
        'COMMENT\t\t= "measurement plan";',
        "DEFAULT_GROUP\t= 1,*,*,*,*;",
        "/MN",
    ]
    return {f"{name.lower()}.ls": "\n".join([*head, *body, "/POS", *places, "/END", ""])}


def _tp_stops(stops: Sequence[_Stop]) -> Iterator[str]:
    for stop in stops:
        yield from (f"!{stop.todo[:30]}", f"MESSAGE[{stop.group[:_SHORT]}]", "PAUSE")


def _urscript(name: str, drive: _Drive) -> dict[str, str]:
    lines = [f"def {name}():", *_popups(drive.first)]
    for point, at, stops in drive.points():
        arm = ", ".join(_number(np.deg2rad(value), 9) for value in at)
        lines += [f"  # {point}", f"  movej([{arm}], a=0.5, v=0.3)"]
        lines += _popups(stops)
    return {f"{name}.script": "\n".join([*lines, "end", ""])}


def _popups(stops: Sequence[_Stop]) -> Iterator[str]:
    for stop in stops:
        yield f'  popup("{stop.todo}", title="{stop.group}", blocking=True)'


_WRITERS: dict[str, tuple[Callable[[str, _Drive], dict[str, str]], int]] = {
    "kuka": (_krl, 2 * _ARM),
    "abb": (_rapid, 2 * _ARM),
    "fanuc": (_tp, _ARM + 3),
    "ur": (_urscript, _ARM),
}
"""Function that writes a program for each maker, and its maximum number of axes."""


def drive(
    name: str,
    robot: Robot,
    q: Array,
    approach: Array,
    steps: Sequence[Sequence[float]],
    zero_after: bool,
    via: Sequence[Array] = (),
    lost: Collection[int] = (),
    first: tuple[_Stop, ...] = (),
) -> _Drive | None:
    """Motions and stops of a plan in the controller's axes; None if the arm has not six axes.

    Args:
        name: Name of the plan.
        robot: Robot of the plan.
        q: Joint values [m] or [rad], shape (p, n), those without a pull last.
        approach: Direction from which the carriage arrives, 1 or -1, shape (p,).
        steps: Load steps of each pose [N]; empty for a pose that is read without a pull.
        zero_after: Whether the unloaded state is read again after the steps.
        via: Joint values of points on the way to each pose, shape (k, n) each; straight if not
            given.
        lost: Numbers, from 1, of poses on whose way the chain or a beam is crossed.
        first: Warnings shown before anything moves.
    """
    mapped = axes.of(robot)
    order = np.argsort(_external(mapped), kind="stable")
    if int(np.sum(~_external(mapped))) != _ARM:
        return None
    lower, upper = _limits(robot, mapped)
    wide = max(2, len(str(len(q))))
    return _Drive(
        name=name,
        axes=axes.displayed(robot, q)[:, order].round(6),
        rail=mapped.slides[order],
        approach=np.asarray(approach),
        stops=tuple(_stops(k, own, zero_after, wide, k in lost) for k, own in enumerate(steps, 1)),
        lower=lower[order],
        upper=upper[order],
        via=tuple(axes.displayed(robot, one)[:, order].round(6) for one in via),
        first=first,
    )


def _external(mapped: axes.Axes) -> Bools:
    """Which axes do not belong to the arm: sliding ones, and those named E1, EX or the like."""
    called = [re.fullmatch(r"(?i)e(x|xt|ax)?_?\d+", name) is not None for name in mapped.names]
    return np.asarray(mapped.slides | np.array(called))


def _limits(robot: Robot, mapped: axes.Axes) -> tuple[Array, Array]:
    """Limits of the axes as displayed; infinite for an axis that moves several joints."""
    k = len(mapped.names)
    lower, upper = np.full(k, -np.inf), np.full(k, np.inf)
    for joint in range(robot.n):
        found = mapped.alone(joint)
        if found is None:
            continue
        axis, ratio = found
        ends = (np.array([robot.lower[joint], robot.upper[joint]]) - mapped.offset[joint]) / ratio
        ends = 1e3 * ends if mapped.slides[axis] else np.rad2deg(ends)
        lower[axis], upper[axis] = ends.min(), ends.max()
    return lower, upper


def _stops(
    pose: int, steps: Sequence[float], zero_after: bool, wide: int = 2, lost: bool = False
) -> tuple[_Stop, ...]:
    """Readings at a pose, with the group names of the measurement sheet.

    Args:
        pose: Number of the pose, from 1.
        steps: Its load steps [N]; negative where the turnbuckle is slackened to the step; empty if
            the pose is only read unloaded.
        zero_after: Whether the unloaded state is read again after the steps.
        wide: Number of digits of the pose number in the name of a group.
        lost: Whether the chain or a beam was crossed on the way.
    """
    group = f"pose{pose:0{wide}d}_rep"
    first = "clear chain and beam, read all" if lost else "chain slack: read all"
    out = [_Stop(f"{group}0_unloaded", first)]
    for k, (before, step) in enumerate(zip([0.0, *steps], steps, strict=False), 1):
        way = "slacken" if step < 0 else "release, tighten" if step == before else "tighten"
        out.append(_Stop(f"{group}{k}_loaded", f"{way} to {abs(step):g} N: read all"))
    if zero_after:
        last = f"{group}{len(steps) + 1}_unloaded"
        out.append(_Stop(last, "chain slack: read all again"))
    return tuple(out)
