"""Effects of the catalogue, other than joint springs, that deflect under the arm's own weight.

Virtual joint v of an effect with the screw s_v moves by its parameter times the effect's response
to s_v . W, with W the wrench of the weight that it carries: as under a pull, with the weight in
place of the pull or in addition to it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import chain, pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.base.arrays import Array, Ints
from pipeline.geometry.arm_weight import carried_by
from pipeline.machine.effect import Effect, Elastic, Loaded, Pulls
from pipeline.machine.effects import catalogue
from pipeline.machine.effects._anatomy import arm, turning
from pipeline.machine.robot import Configuration, Robot
from pipeline.machine.robot.rating import relative
from pipeline.machine.robot.weight import weighs, work

_NAMES = {"rail_roll", "rail_pitch", "rail_yaw", "rail_lateral", "rail_vertical", "pedestal_tilt",
          "joint_tilt", "link_bending"}  # fmt: skip
"""Linear springs other than those of the joints."""

_BEARINGS = 3
"""Number of rotary joints, counted from the base, whose bearings may tilt: moments across those of
the wrist are smaller by a factor of tens."""


def yielding(robot: Robot, tau: Array | None = None) -> tuple[Elastic, ...]:
    """The effects that act on positions, each in the first form that the weight can excite.

    Args:
        robot: The robot.
        tau: Torque of its weight on each joint [N m], shape (m, n), which selects the laws of its
            gears; none are included by default.
    """
    carry, out = turning(robot)[:_BEARINGS], dict[str, Elastic]()
    for effect in catalogue(robot):
        if not isinstance(effect, Elastic) or effect.name not in _NAMES:
            continue
        if effect.name != "joint_tilt" or effect.where in carry:
            out.setdefault(effect.label, effect)
    for effect in () if tau is None else _gears(robot, tau):
        out.setdefault(effect.label, effect)
    return tuple(out.values())


def called(robot: Robot, names: Sequence[Sequence[str]]) -> tuple[Elastic, ...]:
    """Elements by label and form, from those of `yielding`."""
    each_way = np.array([[-1.0], [1.0]]) * np.ones(robot.n)
    every = (*yielding(robot), *_gears(robot, each_way))
    known = {(one.label, one.form): one for one in every}
    return tuple(known[label, form] for label, form in names)


_BY_WEIGHT = "weight"
"""Part of the form of a gear law by the weight's torque alone, where masses or a balancer are
unknown, so that a pull's torque cannot be added to it."""


def by_weight_alone(effect: Effect) -> bool:
    """Whether this is a gear law by the weight's torque alone."""
    return effect.element == "gear" and _BY_WEIGHT in effect.form


def other_forms(robot: Robot, tau: Array, one: Elastic) -> tuple[Elastic, ...]:
    """The other forms of a gear law, arguments as of `yielding`."""
    every = _gears(robot, tau) if one.element == "gear" else ()
    return tuple(e for e in every if e.label == one.label and e.form != one.form)


def balanced(robot: Robot) -> int | None:
    """The joint that may have a balancer: the shoulder of an arm for heavy loads."""
    joints = arm(robot)
    return joints[0] if joints and relative(robot) >= _BALANCED else None


_BALANCED = 0.2
"""Payload over that of a KR 500 from which on arms have a balancer [1]: some 100 kg, by data sheets
of KUKA (KR 90 and up), ABB (IRB 6600 and up) and FANUC (M-900)."""


def _gears(robot: Robot, tau: Array) -> Iterator[Elastic]:
    """Gear laws of the joints that the weight loads; by the total torque where that is known."""
    known, shoulder = weighs(robot), balanced(robot)
    for effect in catalogue(robot):
        if not isinstance(effect, Elastic) or not effect.under_weight or not _shown(effect, tau):
            continue
        told = known and effect.where != shoulder
        if ("total" in effect.form) == told:
            yield effect if told else _alone(effect)


def _alone(effect: Elastic) -> Elastic:
    """A law of the pull's torque turned into one of the weight's."""
    form = effect.form.replace("pull", "")
    return replace(effect, form=f"{form}, {_BY_WEIGHT}" if form else _BY_WEIGHT)


def _shown(effect: Elastic, tau: Array) -> bool:
    """Whether torques of the weight (m, n) excite a gear law."""
    mine = tau[:, effect.carrier[0] - 1]
    largest = float(np.abs(mine).max())
    each_way = effect.side is None or min(mine.max(), -mine.min()) > _EACH_WAY * largest
    return each_way and largest > LOADED * float(np.abs(tau).max())


_EACH_WAY = 0.1
"""Minimum torque in the weaker direction over the largest one [1], from which two stiffnesses can
be distinguished."""

LOADED = 1e-3
"""Torque of the weight over the largest of any joint, below which a joint counts as
unloaded [1]."""


def sizes(effects: Sequence[Elastic]) -> Array:
    """Typical magnitude of each parameter, shape (e,)."""
    return np.array([one.typical for effect in effects for one in effect.parameters], dtype=float)


def _each(numbers: Iterable[Sequence[int]]) -> Ints:
    """Numbers of all effects, concatenated."""
    return np.array([*chain.from_iterable(numbers)], dtype=np.int64)


class Virtual:
    """Virtual joints of effects at m poses.

    Attributes:
        screws: Unit screws in F_b, shape (m, v, 6).
        carrier: Joint from 1 that carries each, shape (v,).
        bears: Joint from 1 from which on the weight loads each, shape (v,).
        parameter: Index of the parameter of each, shape (v,).
    """

    def __init__(self, effects: Sequence[Elastic], here: Configuration) -> None:
        self._effects, self._loaded = effects, _loaded(here)
        own = [effect.screws(self._loaded) for effect in effects]
        self._ends = np.cumsum([0, *(screws.shape[1] for screws in own)]).tolist()
        before = np.cumsum([0, *(len(effect.parameters) for effect in effects)])
        self.screws = np.concatenate([np.zeros((len(here.q), 0, 6)), *own], axis=1)
        self.carrier = _each(effect.carrier for effect in effects).clip(1)
        bears = ([e.bears] * len(e.carrier) if e.bears else e.carrier for e in effects)
        self.bears = _each(bears).clip(1)
        self.parameter = _each(e.parameter_of for e in effects)
        self.parameter += np.repeat(before[:-1], np.diff(self._ends))
        self._alone = np.repeat(
            np.array([*map(by_weight_alone, effects)], bool), np.diff(self._ends)
        )

    def answers(self, tau: Array) -> Array:
        """Motion of each per unit of its parameter under torques (m, v), shape (m, v)."""
        parts = [
            effect.under_weight(tau[:, a:b])
            if effect.under_weight
            else effect.response(self._loaded, tau[:, a:b])
            for effect, (a, b) in zip(self._effects, pairwise(self._ends), strict=True)
        ]
        return np.concatenate([tau[:, :0], *parts], axis=1)

    def torques(self, wrenches: Array, weight: Array, balancer: Array) -> Array:
        """Torque on each virtual joint, shape (m, v).

        Args:
            wrenches: Wrench that each joint carries, of weight and force, shape (m, n, 6).
            weight: Wrench of the weight alone, shape (m, n, 6).
            balancer: Torque of a balancer on each joint [N m], shape (m, n).
        """
        own = wrenches[..., 3:] - np.pad(wrenches[:, 1:, 3:], ((0, 0), (0, 1), (0, 0)))
        tau = work(self.screws, wrenches[:, self.bears - 1])
        for one, body, part in self._between:
            tau[:, one] += part * work(self.screws[:, one], self._hung(own[:, body], one))
        alone = self._alone
        tau[:, alone] = work(self.screws[:, alone], weight[:, self.bears[alone] - 1])
        tau[:, alone] += balancer[:, self.carrier[alone] - 1]
        return np.asarray(tau)

    def slopes(self, tau: Array) -> Array:
        """Derivative of each of `answers` by its own torque, arguments and shape as there."""
        step = _STEP * np.maximum(np.abs(tau), 1.0)
        return np.asarray((self.answers(tau + step) - self.answers(tau - step)) / (2 * step))

    def by_balancer(self, tau: Array, values: Array) -> Array:
        """Motion of each joint's gear laws by the weight, per unit of a balancer's torque, (m, n).

        Args:
            tau: Torques, as of `torques`, shape (m, v).
            values: Parameters of the effects.
        """
        slopes = self.slopes(tau) * values[self.parameter] * self._alone
        joints = np.arange(1, self._loaded.configuration.q.shape[1] + 1)
        return np.asarray(slopes @ (self.carrier[:, None] == joints))

    def by_moments(self, unit: Array) -> Array:
        """Derivatives of `torques` by mass and first moment of each link.

        Args:
            unit: Wrench per unit of each at the poses, shape (m, n, 4, 6).

        Returns:
            Shape (m, v, 4 n).
        """
        torques = carried_by(self.screws, self.bears, unit)
        for one, body, part in self._between:
            weight = self._hung(unit[:, body, 0, 3:], one)
            torques[:, one, 4 * body] += part * work(self.screws[:, one], weight)
        return torques

    @cached_property
    def _between(self) -> list[tuple[slice, int, float]]:
        """Virtual joints of an effect, a body between carrier and `bears` from 0, its share."""
        return [
            (slice(a, b), e.carrier[0] - 1 + k, part)
            for e, (a, b) in zip(self._effects, pairwise(self._ends), strict=True)
            for k, part in enumerate(e.between)
        ]

    def _hung(self, force: Array, one: slice) -> Array:
        """Forces (m, 3) at the joint that an effect bears, as wrenches (m, 1, 6)."""
        at = self._loaded.configuration.frame(int(self.bears[one][0]))[1]
        return np.concatenate([np.cross(at, force), force], axis=1)[:, None]


_STEP = 1e-4
"""Relative step of a torque in the numerical slope of a law [1]."""


def _loaded(here: Configuration) -> Loaded:
    """A robot loaded by its weight only."""
    m = len(here.q)
    none = np.zeros((m, 3))
    return Loaded(
        Pulls.at(here.q, none), here, none, none, np.zeros((m, 0, 3)), np.array([], dtype=object)
    )


def carried_on(
    screws: Array, carrier: Ints, amounts: Array, at: Array, turn: Array
) -> tuple[Array, Array]:
    """Targets (m, t, 3) and orientations (m, t, 3, 3) moved by small motions of virtual joints.

    Those of one carrier move together, the outer carriers first.
    """
    for one in np.unique(carrier)[::-1]:
        mine = carrier == one
        step = np.einsum("mvi,mv->mi", screws[:, mine], amounts[:, mine])
        omega, v = step[:, :3], step[:, 3:]
        R = Rotation.from_rotvec(omega).as_matrix()[:, None]
        shift = v + 0.5 * np.cross(omega, v)
        at = (R @ at[..., None])[..., 0] + shift[:, None]
        turn = R @ turn
    return at, turn
