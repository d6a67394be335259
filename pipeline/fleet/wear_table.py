"""The table `wear`: changes of each joint, from the campaigns of all robots of one type.

Campaigns count only if their recommended model explains the readings as given, and if they are
dated. Two campaigns of a robot that begin at the same second are the same readings computed twice:
the one whose name comes last counts.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, time
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.answer.contract import called
from pipeline.base.arrays import Array
from pipeline.diagnosis.finding import Verdict
from pipeline.fleet.wear.machine import Machine, Repair, Visit
from pipeline.fleet.wear.scatter import STATED
from pipeline.fleet.wear.state import Fleet, RobotState
from pipeline.fleet.wear.state import fleet as fleet_of

_F64, _STR, _INT = pa.float64(), pa.string(), pa.int64()
_COUNTS = (Verdict.ADEQUATE, Verdict.EXPLAINED, Verdict.AMBIGUOUS)
_MOST = 60
"""Maximum number of campaigns of a robot that are used, the newest ones."""

_EPOCH = date(1970, 1, 1)
_YEAR = 365.25
"""Length of a year [d]."""


def column(name: str, kind: pa.DataType, unit: str, meaning: str) -> pa.Field:
    """One column; values may be null if an answer does not have them."""
    return pa.field(name, kind, True, {"unit": unit, "meaning": meaning})


WEAR = pa.schema(
    [
        column("campaign", _STR, "1", "the last campaign of the robot that counts"),
        column("robot_serial", _STR, "1", "serial number of the robot; null where nobody says"),
        column("joint", _INT, "1", "number, from 1"),
        column("name", _STR, "1", "k_r1, k_theta2, ..."),
        column("axis", _STR, "1", "of the controller, A1 or E1; null where none moves it alone"),
        column("campaigns", _INT, "1", "how many of the robot count"),
        column("first", pa.date32(), "1", "day of the first of them"),
        column("last", pa.date32(), "1", "day of the last"),
        column("percent_a_year", _F64, "%/year", "change of the stiffness; negative: softer"),
        column("std", _F64, "%/year", "standard uncertainty"),
        column("low", _F64, "%/year", "lower end of the 95 % interval"),
        column("high", _F64, "%/year", "upper end of it"),
        column("expected", _F64, "%/year", "the same given the other robots of its type, too"),
        column("expected_std", _F64, "%/year", "standard uncertainty of that"),
        column("alarm", _STR, "1", "of the robot: trend or step; null: none"),
        column("changed", pa.bool_(), "1", "the alarm is about this joint"),
        column("raised", _STR, "1", "campaign that raised the alarm"),
        column("after", _STR, "1", "campaign after which a step came"),
        column("confirmed", pa.bool_(), "1", "the newest campaigns still speak for the alarm"),
        column("p_value", _F64, "1", "chance of so much change in all joints; null: too few"),
        column("allowed", _F64, "1", "p_value below which the newest campaign raises an alarm"),
        column("scatter", _F64, "%", "day-to-day scatter of this joint, standard deviation"),
        column("scatter_common", _F64, "%", "the same of all joints alike"),
        column("scatter_stated", pa.bool_(), "1", "no campaign tells the scatter yet"),
        column("robots", _INT, "1", "how many of the type count"),
        column("type_percent_a_year", _F64, "%/year", "mean change over the robots of the type"),
        column("type_std", _F64, "%/year", "standard uncertainty of that"),
        column("type_spread", _F64, "%", "by which stiffnesses of specimens differ"),
        column("type_guessed", pa.bool_(), "1", "too few robots tell how specimens differ"),
    ]
)

READ = ("campaigns", "stiffness", "covariance", "repairs")
"""Tables from which it is made, in the order of `History`."""

_Rows = Sequence[Mapping[str, Any]]

_Repaired = tuple[date, int | None]
"""Day and number of the joint, None for all."""


@dataclass(frozen=True)
class History:
    """Rows of the tables in `READ`, of all robots of one type."""

    campaigns: _Rows
    stiffness: _Rows
    covariance: _Rows
    repairs: _Rows


@dataclass(frozen=True)
class JointWear:
    """One joint of a robot, from its row [%/year], scatter [%]; negative is softer."""

    name: str
    percent_a_year: float | None
    std: float | None
    low: float | None
    high: float | None
    expected: float
    expected_std: float
    scatter: float
    changed: bool
    axis: str | None = None

    @property
    def called(self) -> str:
        """`A1 (k_theta2)`, as `Stiffness.called`."""
        return called(self.name, self.axis)


@dataclass(frozen=True)
class _Alarm:
    """Alarm of a robot.

    Attributes:
        kind: trend or step.
        raised: Campaign that raised it.
        after: Campaign after which a step occurred.
        confirmed: Whether the newest campaigns still support it.
    """

    kind: str
    raised: str
    after: str | None
    confirmed: bool


@dataclass(frozen=True)
class RobotWear:
    """One robot over its campaigns, from the table.

    Attributes:
        robot: Type of the robot.
        serial: Its serial number; None if not stated.
        campaign: The last campaign that counts.
        campaigns: Number of campaigns that count.
        last: Day of the last one.
        joints: Wear of each joint.
        alarm: Alarm; None if there is none.
        p_value: Probability of the change of all joints together by chance; None if the campaigns
            are too few.
        robots: Number of robots of its type.
    """

    robot: str
    serial: str | None
    campaign: str
    campaigns: int
    last: date
    joints: tuple[JointWear, ...]
    alarm: _Alarm | None
    p_value: float | None
    robots: int

    @property
    def machine(self) -> str:
        """Name as of `Answer.machine`."""
        return f"{self.robot}, serial number {self.serial}" if self.serial else self.robot

    @property
    def followed(self) -> bool:
        """Whether there are enough campaigns to separate trends from day-to-day scatter."""
        return self.p_value is not None

    @property
    def changed(self) -> tuple[JointWear, ...]:
        """Joints concerned by the alarm."""
        return tuple(one for one in self.joints if one.changed)


def robots(robot: str, found: _Rows) -> list[RobotWear]:
    """Robots from the rows of one type."""
    by_serial: dict[str | None, list[Mapping[str, Any]]] = {}
    for row in found:
        by_serial.setdefault(row["robot_serial"], []).append(row)
    return [_robot(robot, own) for own in by_serial.values()]


def _robot(robot: str, own: Sequence[Mapping[str, Any]]) -> RobotWear:
    one = own[0]
    alarm = (
        None
        if one["alarm"] is None
        else _Alarm(one["alarm"], one["raised"], one["after"], one["confirmed"])
    )
    names = JointWear.__dataclass_fields__
    joints = tuple(JointWear(**{name: row[name] for name in names if name in row}) for row in own)
    rest = {name: one[name] for name in ("campaign", "campaigns", "last", "p_value", "robots")}
    return RobotWear(robot=robot, serial=one["robot_serial"], joints=joints, alarm=alarm, **rest)


# --- making the table ------------------------------------------------------------------------


def rows(history: History, scatter: float | None = None) -> list[dict[str, Any]]:
    """One row for each joint of each robot with a campaign that counts.

    Args:
        history: All campaigns of the type.
        scatter: Expected day-to-day scatter of a stiffness [1], if stated.
    """
    names, axes = _names(history), _axes(history)
    known = _Known.of(history, names)
    by_serial = _followed(history, known)
    if not by_serial:
        return []
    repairs = _repairs(history)
    machines = [
        known.machine(serial, list(own.values()), repairs.get(serial, ()))
        for serial, own in by_serial.items()
    ]
    found = fleet_of(machines, STATED if scatter is None else scatter)
    return [
        row
        for own, machine, one in zip(by_serial.values(), machines, found.robots, strict=True)
        for row in _of_robot(names, axes, own.values(), machine, one, found)
    ]


def _followed(history: History, known: _Known) -> dict[str | None, dict[object, Mapping[str, Any]]]:
    """Dated campaigns that count, by robot; of the same readings only the last by name."""
    out: dict[str | None, dict[object, Mapping[str, Any]]] = {}
    for row in sorted(history.campaigns, key=lambda row: str(row["campaign"])):
        if row["verdict"] in _COUNTS and row["measured"] and row["campaign"] in known.cov:
            out.setdefault(row["robot_serial"], {})[_readings(row)] = row
    return {serial: _newest(own) for serial, own in out.items()}


def _newest(own: Mapping[object, Mapping[str, Any]]) -> dict[object, Mapping[str, Any]]:
    """The newest campaigns of a robot; the cost grows with the square of their number."""
    return dict(sorted(own.items(), key=lambda item: item[1]["measured"])[-_MOST:])


def _readings(row: Mapping[str, Any]) -> object:
    """Key that repeated computations of the same readings share; a mere date identifies nothing."""
    at: datetime = row["measured"]
    return row["campaign"] if at.time() == time() else at


def _names(history: History) -> list[str]:
    """Names of the stiffnesses in the order of the joints."""
    order = {row["joint"]: row["name"] for row in history.stiffness}
    return [order[joint] for joint in sorted(order)]


def _axes(history: History) -> dict[str, str | None]:
    """Axis of the controller by name of the stiffness, from the campaign with the last name."""
    rows = sorted(history.stiffness, key=lambda row: str(row["campaign"]))
    return {row["name"]: row["axis"] for row in rows}


def _compliances(rows: _Rows, n: int) -> dict[str, Array]:
    """Compliances of each campaign by its recommended model, NaN if not determined, shape (n,)."""
    found: dict[str, Array] = {}
    for row in rows:
        if row["model"] == "recommended" and row["identifiable"]:
            value = np.nan if row["compliance"] is None else row["compliance"]
            found.setdefault(row["campaign"], np.full(n, np.nan))[row["joint"] - 1] = value
    return found


def _covariances(rows: _Rows, names: Sequence[str]) -> dict[str, Array]:
    """Covariance of the compliances of each campaign, NaN if not stated, shape (n, n)."""
    place, n = {name.removeprefix("k_"): k for k, name in enumerate(names)}, len(names)
    found: dict[str, Array] = {}
    for row in rows:
        i, j = (place.get(row[key].removeprefix("c_")) for key in ("parameter", "other"))
        if i is not None and j is not None:
            found.setdefault(row["campaign"], np.full((n, n), np.nan))[i, j] = row["covariance"]
    return found


@dataclass(frozen=True)
class _Known:
    """Compliances of campaigns and their covariances, by name of the campaign."""

    x: Mapping[str, Array]
    cov: Mapping[str, Array]

    @classmethod
    def of(cls, history: History, names: Sequence[str]) -> _Known:
        """Collect both; campaigns without a covariance are omitted from `cov`."""
        x = _compliances(history.stiffness, len(names))
        cov = _covariances([row for row in history.covariance if row["campaign"] in x], names)
        for campaign, own in cov.items():
            x[campaign][~np.isfinite(np.diag(own))] = np.nan
        return cls(x, cov)

    def machine(self, serial: str | None, own: _Rows, told: Iterable[_Repaired]) -> Machine:
        """One robot with the repairs that its campaigns state."""
        n = len(self.x[own[0]["campaign"]])
        repairs = [
            Repair(_year(day), tuple(range(n)) if joint is None else (joint - 1,))
            for day, joint in sorted(told, key=str)
            if joint is None or joint <= n
        ]
        visits = [
            Visit(
                row["campaign"],
                _year(row["measured"].date()),
                self.x[row["campaign"]],
                self.cov[row["campaign"]],
            )
            for row in own
        ]
        return Machine.of(serial or "", visits, repairs)


def _repairs(history: History) -> dict[str | None, set[_Repaired]]:
    """Repairs of each robot; the same repair stated by several campaigns, valid or not, is one."""
    serials = {row["campaign"]: row["robot_serial"] for row in history.campaigns}
    found: dict[str | None, set[_Repaired]] = {}
    for row in history.repairs:
        found.setdefault(serials[row["campaign"]], set()).add((row["day"], row["joint"]))
    return found


def _year(day: date) -> float:
    return (day - _EPOCH).days / _YEAR


def _of_robot(
    names: Sequence[str],
    axes: Mapping[str, str | None],
    own: Any,
    machine: Machine,
    found: RobotState,
    fleet: Fleet,
) -> list[dict[str, Any]]:
    """Rows of one robot."""
    days = {row["campaign"]: row["measured"].date() for row in own}
    serial = next(row["robot_serial"] for row in own)
    n, look, raised, tells = machine.joints, found.look, found.raised, found.tells
    shared = {
        "campaign": found.campaigns[-1],
        "robot_serial": serial,
        "campaigns": len(found.campaigns),
        "first": days[found.campaigns[0]],
        "last": days[found.campaigns[-1]],
        "alarm": tells and str(tells.kind),
        "raised": raised and raised.campaign,
        "after": tells and tells.after,
        "confirmed": found.confirmed if raised else None,
        "p_value": look and look.p_value,
        "allowed": look and look.allowed,
        "scatter_common": _percent(fleet.scatter.std[n]),
        "scatter_stated": fleet.scatter.campaigns <= 0,
        "robots": fleet.type.robots,
        "type_guessed": fleet.type.guessed,
    }
    spread, variance = np.diag(fleet.type.between), np.diag(fleet.type.cov)
    return [
        shared
        | {
            "joint": j + 1,
            "name": name,
            "axis": axes[name],
            "percent_a_year": _percent(one.change),
            "std": _percent(one.std),
            "low": _percent(one.low),
            "high": _percent(one.high),
            "expected": _percent(one.expected),
            "expected_std": _percent(one.expected_std),
            "changed": one.changed,
            "scatter": _percent(fleet.scatter.std[j]),
            "type_percent_a_year": _percent(-fleet.type.mean[n + j]),
            "type_std": _percent(np.sqrt(variance[n + j])),
            "type_spread": _percent(np.sqrt(spread[j])),
        }
        for j, (name, one) in enumerate(zip(names, found.joints, strict=True))
    ]


def _percent(value: float | None) -> float | None:
    return None if value is None else 100 * float(value)
