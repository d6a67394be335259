"""Where the robots of a type stand: trends of their joints, alarms, and what their type adds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.base.arrays import Array, Bools
from pipeline.fleet.wear.alarm import Kind, Look, looks
from pipeline.fleet.wear.hierarchy import Type, hierarchy
from pipeline.fleet.wear.machine import FEWEST, Machine
from pipeline.fleet.wear.scatter import STATED, Scatter, scatter
from pipeline.fleet.wear.trend import Trends, trends

_CONFIRMS = 0.05
"""An alarm is confirmed as long as the newest look has a smaller p."""


_CERTAIN = 3.0
"""Standard uncertainties from zero at which a mean compliance is one [1]."""


@dataclass(frozen=True)
class _Joint:
    """Wear of one joint; numbers are of its stiffness, negative where it grows softer.

    Attributes:
        change: Per year, relative to its mean [1/year]; None where it is not determined.
        std: Its standard uncertainty.
        low: Lower end of its 95 % interval.
        high: Upper end.
        expected: The same given the other robots of its type, too.
        expected_std: Its standard uncertainty.
        changed: The alarm is about this joint.
    """

    change: float | None
    std: float | None
    low: float | None
    high: float | None
    expected: float
    expected_std: float
    changed: bool


@dataclass(frozen=True)
class Standing:
    """One robot.

    Attributes:
        name: Which one.
        campaigns: How many count, the last of them last.
        joints: Wear of each.
        look: What its campaigns say together; None where they are too few.
        raised: The look that raised the alarm, the first since the last repair; None without one.
    """

    name: str
    campaigns: tuple[str, ...]
    joints: tuple[_Joint, ...]
    look: Look | None
    raised: Look | None

    @property
    def confirmed(self) -> bool:
        """The newest campaigns still speak for the alarm."""
        return bool(self.raised and self.look and self.look.p_value < _CONFIRMS)

    @property
    def tells(self) -> Look | None:
        """The look that says what the alarm is about; None without one.

        The newest has seen most; where it sees nothing any more the first keeps its word.
        """
        if self.raised is None or self.look is None:
            return None
        return self.look if self.look.p_value < self.raised.allowed else self.raised


@dataclass(frozen=True, eq=False)
class Fleet:
    """All robots of one type.

    Attributes:
        robots: In the order in which they came.
        scatter: From day to day.
        type: What they have in common.
    """

    robots: tuple[Standing, ...]
    scatter: Scatter
    type: Type


def fleet(machines: Sequence[Machine], stated: float = STATED) -> Fleet:
    """All robots of a type, of which there is one at least.

    Args:
        machines: The robots.
        stated: Expected day-to-day scatter of a stiffness [1].
    """
    found = scatter(machines, stated)
    kind = hierarchy(machines, found)
    robots = [_standing(one, found, kind.values[r], kind.covs[r]) for r, one in enumerate(machines)]
    return Fleet(tuple(robots), found, kind)


def _standing(machine: Machine, found: Scatter, value: Array, cov: Array) -> Standing:
    seen = looks(machine, found)
    raised = next((one for one in seen if one.alarm), None)
    own, sized = trends(machine, found), _sized(machine)
    names = tuple(visit.campaign for visit in machine.visits)
    bare = Standing(machine.name, names, (), seen[-1] if seen else None, raised)
    blamed = _blamed(bare.tells, own)
    enough = len(machine.t) >= FEWEST
    joints = tuple(
        _joint(own, value, cov, j, enough and bool(sized[j]), changed=j in blamed)
        for j in range(machine.joints)
    )
    return replace(bare, joints=joints)


def _sized(machine: Machine) -> Bools:
    """Joints whose mean compliance is certain enough to be a hundred per cent, shape (n,)."""
    variance = np.array([np.diag(visit.cov) for visit in machine.visits])
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = np.where(machine.seen, 1 / variance, 0.0).sum(axis=0)
        return np.asarray(machine.reference * np.sqrt(weight) > _CERTAIN)


def _blamed(look: Look | None, own: Trends) -> tuple[int, ...]:
    """Which joints an alarm is about: of a group those whose own trend is certain, if any is."""
    if look is None or look.kind is Kind.STEP:
        return look.joints if look else ()
    sure = tuple(j for j in look.joints if abs(own.value[j]) > own.half[j])
    return sure or look.joints


def _joint(own: Trends, value: Array, cov: Array, j: int, enough: bool, changed: bool) -> _Joint:
    """A compliance that grows is a stiffness that falls, to first order by the same part."""
    n = len(own.value)
    expected, spread = float(-value[n + j]), float(np.sqrt(cov[n + j, n + j]))
    if not (enough and np.isfinite(own.value[j])):
        return _Joint(None, None, None, None, expected, spread, changed)
    change, half = float(-own.value[j]), float(own.half[j])
    return _Joint(
        change, float(own.std[j]), change - half, change + half, expected, spread, changed
    )
