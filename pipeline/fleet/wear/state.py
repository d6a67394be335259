"""State of the robots of a type: trends of joints, alarms, and estimates given the type."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.base.arrays import Array, Bools
from pipeline.fleet.wear.alarm import ChangeKind, InterimTest, interim_tests
from pipeline.fleet.wear.hierarchy import RobotType, hierarchy
from pipeline.fleet.wear.machine import FEWEST, Machine
from pipeline.fleet.wear.scatter import STATED, DayToDayVariances, scatter
from pipeline.fleet.wear.trend import Trends, trends

_CONFIRMS = 0.05
"""Limit of p in the newest look below which an alarm is confirmed [1]."""


_CERTAIN = 3.0
"""Smallest ratio of a mean compliance to its standard uncertainty for relative changes to be stated
[1]."""


@dataclass(frozen=True)
class _Joint:
    """Wear of one joint, in terms of its stiffness; negative is softer.

    Attributes:
        change: Relative change [1/year]; None if it is not determined.
        std: Its standard uncertainty [1/year].
        low: Lower end of its 95 % interval [1/year].
        high: Upper end [1/year].
        expected: Relative change given the other robots of its type as well [1/year].
        expected_std: Its standard uncertainty [1/year].
        changed: Whether the alarm concerns this joint.
    """

    change: float | None
    std: float | None
    low: float | None
    high: float | None
    expected: float
    expected_std: float
    changed: bool


@dataclass(frozen=True)
class RobotState:
    """State of one robot.

    Attributes:
        name: Which robot.
        campaigns: Names of the campaigns that count, the last of them last.
        joints: Wear of each joint.
        look: Newest test of all joints together; None if campaigns are too few.
        raised: The look that raised the alarm, the first since the last repair; None without one.
    """

    name: str
    campaigns: tuple[str, ...]
    joints: tuple[_Joint, ...]
    look: InterimTest | None
    raised: InterimTest | None

    @property
    def confirmed(self) -> bool:
        """Whether the newest campaigns still support the alarm."""
        return bool(self.raised and self.look and self.look.p_value < _CONFIRMS)

    @property
    def tells(self) -> InterimTest | None:
        """The look that determines what the alarm is about; None without an alarm.

        The newest uses most data; if it is no longer significant, the first one remains.
        """
        if self.raised is None or self.look is None:
            return None
        return self.look if self.look.p_value < self.raised.allowed else self.raised


@dataclass(frozen=True, eq=False)
class Fleet:
    """All robots of one type.

    Attributes:
        robots: In the order given.
        scatter: Day-to-day scatter.
        type: Distribution over the robots.
    """

    robots: tuple[RobotState, ...]
    scatter: DayToDayVariances
    type: RobotType


def fleet(machines: Sequence[Machine], stated: float = STATED) -> Fleet:
    """State of all robots of a type, at least one.

    Args:
        machines: The robots.
        stated: Expected day-to-day scatter of a stiffness [1].
    """
    found = scatter(machines, stated)
    kind = hierarchy(machines, found)
    robots = [_standing(one, found, kind.values[r], kind.covs[r]) for r, one in enumerate(machines)]
    return Fleet(tuple(robots), found, kind)


def _standing(machine: Machine, found: DayToDayVariances, value: Array, cov: Array) -> RobotState:
    seen = interim_tests(machine, found)
    raised = next((one for one in seen if one.alarm), None)
    own, sized = trends(machine, found), _sized(machine)
    names = tuple(visit.campaign for visit in machine.visits)
    bare = RobotState(machine.name, names, (), seen[-1] if seen else None, raised)
    concerned = _concerned(bare.tells, own)
    enough = len(machine.t) >= FEWEST
    joints = tuple(
        _joint(own, value, cov, j, enough and bool(sized[j]), changed=j in concerned)
        for j in range(machine.joints)
    )
    return replace(bare, joints=joints)


def _sized(machine: Machine) -> Bools:
    """Joints whose mean compliance is certain enough to serve as 100 %, shape (n,)."""
    variance = np.array([np.diag(visit.cov) for visit in machine.visits])
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = np.where(machine.seen, 1 / variance, 0.0).sum(axis=0)
        return np.asarray(machine.reference * np.sqrt(weight) > _CERTAIN)


def _concerned(look: InterimTest | None, own: Trends) -> tuple[int, ...]:
    """Joints concerned by an alarm; for a trend, those whose own trend is significant, if any."""
    if look is None or look.kind is ChangeKind.STEP:
        return look.joints if look else ()
    sure = tuple(j for j in look.joints if abs(own.value[j]) > own.half[j])
    return sure or look.joints


def _joint(own: Trends, value: Array, cov: Array, j: int, enough: bool, changed: bool) -> _Joint:
    """Wear of joint j; its stiffness and compliance change oppositely, to first order."""
    n = len(own.value)
    expected, spread = float(-value[n + j]), float(np.sqrt(cov[n + j, n + j]))
    if not (enough and np.isfinite(own.value[j])):
        return _Joint(None, None, None, None, expected, spread, changed)
    change, half = float(-own.value[j]), float(own.half[j])
    return _Joint(
        change, float(own.std[j]), change - half, change + half, expected, spread, changed
    )
