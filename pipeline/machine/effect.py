"""The shape of an effect: what can act on a cell, at one of five places, written once.

From the one definition come the simulator's data, the columns of B (derivative at the fitted
baseline), the score that tests for it, the extended model and the smallest size a plan sees.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields

import numpy as np

from pipeline.base.arrays import Array, Ints, Locked, Parameter, Strings
from pipeline.machine.law import Law
from pipeline.machine.robot import Configuration, Robot
from pipeline.machine.robot.letters import Letter, changed

PULLED, HUNG, MOUNTED = 0, 1, 2
"""What loads the robot: a chain with a scale, a weight at the load point, a payload on the flange;
codes of `Pulls.by`."""


@dataclass(frozen=True, eq=False)
class Pulls(Locked):
    """One row per pull: what was set and read, in F_b, SI. A weight pulls, too.

    Attributes:
        pose: Pose number, shape (m,).
        repeat: Pull number within the pose, shape (m,).
        q: Joint values of the controller [m] or [rad], shape (m, n).
        force: Force on the robot as read, |f| u of Eqs. (10), (11) [N], shape (m, 3).
        branch: Which way the turnbuckle was last turned, +1 up, -1 down, 0 unknown, (m,).
        approach: Which way the carriage came along the rail, +1, -1, 0 unknown, (m,).
        time: Time of the loaded readings after the first reading [s], NaN unknown, (m,).
        time_zero: Time of the pose's unloaded readings [s], NaN unknown, (m,).
        by: `PULLED`, `HUNG` or `MOUNTED`, shape (m,); by a chain where nothing is said.
        acts_at: Where the force acts, flange frame [m]; NaN is the tool's load point, shape (m, 3).
        body: Name of the payload, empty for other loads, shape (m,).
    """

    pose: Ints
    repeat: Ints
    q: Array
    force: Array
    branch: Array
    approach: Array
    time: Array
    time_zero: Array
    by: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    acts_at: Array = field(default_factory=lambda: np.zeros((0, 3)))
    body: Strings = field(default_factory=lambda: np.zeros(0, dtype=object))

    def __post_init__(self) -> None:
        """Pulls of which nothing else is said are those of a chain at the load point."""
        if len(self.by) != len(self.pose):
            object.__setattr__(self, "by", np.full(len(self.pose), PULLED))
        if len(self.acts_at) != len(self.pose):
            object.__setattr__(self, "acts_at", np.full((len(self.pose), 3), np.nan))
        if len(self.body) != len(self.pose):
            object.__setattr__(self, "body", np.full(len(self.pose), "", dtype=object))
        super().__post_init__()

    def __len__(self) -> int:
        """Number of pulls m."""
        return len(self.pose)

    @classmethod
    def at(cls, q: Array, force: Array, branch: float = 0.0) -> Pulls:
        """Loads outside of any campaign: nothing is known of approach and time.

        Args:
            q: Joint values [m] or [rad], shape (m, n) or (n,).
            force: [N], F_b, shape (m, 3) or (3,).
            branch: Which way the turnbuckle was turned, 0 unknown.
        """
        q, force = np.atleast_2d(np.asarray(q, float)), np.atleast_2d(np.asarray(force, float))
        m = max(len(q), len(force))
        none = np.zeros(m)
        return cls(
            pose=np.arange(1, m + 1),
            repeat=np.ones(m, dtype=np.int64),
            q=np.broadcast_to(q, (m, q.shape[1])),
            force=np.broadcast_to(force, (m, 3)),
            branch=none + branch,
            approach=none,
            time=none,
            time_zero=none,
        )

    @property
    def pulled(self) -> Array:
        """1 for pulls by a chain with a scale, 0 for weights and payloads, shape (m, 1)."""
        return (self.by == PULLED)[:, None].astype(float)

    @property
    def range_n(self) -> tuple[float, float]:
        """The gentlest and the hardest of them [N]."""
        size = np.linalg.norm(self.force, axis=1)
        return float(size.min()), float(size.max())

    def part(self, which: slice | Ints) -> Pulls:
        """Some of the pulls."""
        return Pulls(**{one.name: getattr(self, one.name)[which] for one in fields(self)})

    def and_then(self, others: Pulls) -> Pulls:
        """These and others behind them."""
        pairs = {f.name: (getattr(self, f.name), getattr(others, f.name)) for f in fields(self)}
        return Pulls(**{name: np.concatenate(pair) for name, pair in pairs.items()})

    def under(self, forces: Array) -> Pulls:
        """The same pulls under n sets of forces, one set after the other.

        Poses are numbered on from set to set: what remembers the pulls of a pose, as hysteresis
        does, remembers none of another set.

        Args:
            forces: [N], F_b, shape (n, m, 3).
        """
        n = len(forces)
        tiled = {one.name: np.concatenate([getattr(self, one.name)] * n) for one in fields(self)}
        tiled["pose"] = tiled["pose"] + np.repeat(np.arange(n), len(self)) * (np.ptp(self.pose) + 1)
        return Pulls(**tiled | {"force": np.asarray(forces, float).reshape(-1, 3)})


def branches(steps: Array) -> Array:
    """Which way the turnbuckle is last turned before each step: +1 tightened, -1 slackened.

    Args:
        steps: Load steps [N]; negative where it is slackened to the first step from above.
    """
    out = np.sign(steps)
    for k in range(1, len(steps)):
        if steps[k] > 0:
            out[k] = np.sign(steps[k] - abs(steps[k - 1])) or out[k - 1]
    return out


@dataclass(frozen=True, eq=False)
class Loaded(Locked):
    """A robot with its kinematics computed and its wrench applied, in F_b.

    Attributes:
        pulls: What was set and read.
        configuration: Frames of the unloaded robot.
        load_point: Where the force acts [m], shape (m, 3).
        force: The force that acts [N], shape (m, 3).
        points: Unloaded positions of the targets [m], shape (m, t, 3).
        targets: Names of the targets, shape (t,).
    """

    pulls: Pulls
    configuration: Configuration
    load_point: Array
    force: Array
    points: Array
    targets: Strings


_OWNED = ("payload_mass", "payload_center")
"""Causes of a thing and not at a place."""


_WHOLE = ("rail", "scale", "tracker")
"""Where a law that nobody listed sits, if not in a joint."""


def in_place(where: int | str | None, name: str = "", axis: str | None = None) -> str:
    """` in joint 3 (A2)`, ` in the forearm`, ` at P2`, ` of ballast`, or nothing."""
    if where is None:
        return ""
    if isinstance(where, int):
        return f" in joint {where}{f' ({axis})' if axis else ''}"
    parts = {"upper_arm": " in the upper arm", "forearm": " in the forearm"}
    parts |= {name: f" at the {name}" for name in _WHOLE}
    return parts.get(where, f" {'of' if name in _OWNED else 'at'} {where}")


@dataclass(frozen=True, kw_only=True)
class Effect:
    """What every effect states of itself.

    One cause may be in the catalogue in several mathematical forms (a dead zone, a rounded
    step): they share name and place, and the diagnosis names the cause, not the form.

    Attributes:
        name: A word of the list of causes, `rail_roll`.
        where: Joint number, `upper_arm`, `forearm`, or None where it can act in one place only.
        noun: What an engineer calls it, as a noun, so that it fits into any sentence.
        place: Where in the cell it acts: rail, joint, link, tool, shoulder, wrist, force, metrology
            or noise.
        parameters: Its unknowns; zero of all of them means that the effect is absent.
        signature: What an engineer sees when it is there, and what separates it from similar ones.
        needs: The measurement or sensor that would settle it.
        source: Where formula and typical size come from.
        form: Which of several mathematical forms of this cause it is; empty for the only one.
        tolerance: How far the true law may lie from the formula, as a fraction of what it moves.
        element: What of the machine the law is of: effects of one element at one place are laws of
            one thing. Empty where it is alone.
        shows_unloaded: It moves the unloaded reflectors by far more than it changes displacements.
        of: Kinds of load that it takes part in; with no load of these it can act on nothing.
        odds: How likely it is before the data speak, over any other cause [1].
        size: Its expected size over the typical one of its parameters [1].
        axis: Axis of the controller that moves the joint of `where`, if one does.
        law: What it is of, where nobody listed it.
    """

    name: str
    where: int | str | None = None
    noun: str
    place: str
    parameters: tuple[Parameter, ...]
    signature: str
    needs: str
    source: str
    form: str = ""
    tolerance: float = 0.03
    element: str = ""
    shows_unloaded: bool = False
    of: tuple[int, ...] = (PULLED, HUNG, MOUNTED)
    odds: float = 1.0
    size: float = 1.0
    axis: str | None = field(default=None, compare=False)
    law: Law | None = None

    def everywhere(self, robot: Robot) -> tuple[Effect, ...]:
        """An entry of the catalogue: the effect, the same on any robot."""
        return (self,)

    @property
    def facets(self) -> tuple[Effect, ...]:
        """The places of the cell where it acts, all with the same parameters."""
        return (self,)

    @property
    def label(self) -> str:
        """`rail_roll`, or `joint_tilt:2` where it has a place."""
        return self.name if self.where is None else f"{self.name}:{self.where}"

    @property
    def called(self) -> str:
        """`tilt of the bearing in joint 2 (A1)`: in words, as it stands in any sentence."""
        return self.noun + in_place(self.where, self.name, self.axis)

    @property
    def location(self) -> str:
        """Where in the cell it sits: `rail`, `joint 3`, `upper_arm`, `force`, `metrology` ..."""
        if self.where is None or self.place == "metrology" or self.where in _WHOLE:
            return self.place
        return f"joint {self.where}" if self.place == "joint" else str(self.where)


def linear(loaded: Loaded, tau: Array) -> Array:
    """The law of a linear spring: deflection per unit compliance is the torque."""
    return tau


def same_element(one: Effect, other: Effect) -> bool:
    """True when both are laws of one thing of the machine, such as how one gear turns."""
    return bool(one.element) and (one.element, one.where) == (other.element, other.where)


@dataclass(frozen=True, kw_only=True)
class Elastic(Effect):
    """Virtual joints that yield under load: parameter k moves virtual joint k.

    The deflection of virtual joint v is its parameter times `response(loaded, tau)[:, v]`, where
    tau is the torque (force) that the pull exerts about (along) each of them.

    Attributes:
        carrier: The joint 0..n that carries each virtual joint (0 is the rail's bed);
            virtual joints of one carrier come after its own motion.
        twists: loaded -> unit screws of the virtual joints in F_b, shape (m, v, 6); None where
            each turns or slides as the joint that carries it.
        response: loaded, tau (m, v) -> deflection per unit parameter, shape (m, v); that of a
            linear spring where nothing else is said.
        shared: Parameter of each virtual joint where several have one; empty for one each.
        under_weight: tau (m, v) -> the same under whatever torque they bear, weight and pull alike;
            None where that is `response`.
        bears: The joint from which on the arm's own weight loads them; that which carries each
            where 0.
        between: Of each body from the carrier to before that joint, the part of its weight that
            loads them as if it hung where that joint sits [1].
        side: Of a law that is another one each way of the torque: loaded, tau (m, 1) -> 1 where its
            one parameter adds to the compliance of the joint that carries it, -1 where it takes
            from it, shape (m, 1); None where the joint has one compliance.
    """

    carrier: tuple[int, ...]
    twists: Callable[[Loaded], Array] | None = None
    response: Callable[[Loaded, Array], Array] = linear
    shared: tuple[int, ...] = ()
    side: Callable[[Loaded, Array], Array] | None = None
    under_weight: Callable[[Array], Array] | None = None
    bears: int = 0
    between: tuple[float, ...] = ()

    def screws(self, loaded: Loaded) -> Array:
        """Unit screws of the virtual joints in F_b, shape (m, v, 6)."""
        if self.twists is not None:
            return self.twists(loaded)
        at = np.array(self.carrier) - 1
        neighbours = (np.diff(at) == 1).all()  # a slice of an array is no copy
        return loaded.configuration.twists[:, slice(at[0], at[-1] + 1) if neighbours else at]

    @property
    def parameter_of(self) -> tuple[int, ...]:
        """Index of the parameter of each virtual joint."""
        return self.shared or tuple(range(len(self.carrier)))


@dataclass(frozen=True, kw_only=True)
class Wrench(Effect):
    """The force that acts is not the force that was read.

    Attributes:
        wrench: loaded, values (k,) -> load point (m, 3) [m] and force (m, 3) [N] that act.
    """

    wrench: Callable[[Loaded, Array], tuple[Array, Array]]


@dataclass(frozen=True, kw_only=True)
class Reflectors(Effect):
    """What is measured sits elsewhere on the tool than campaign.toml says.

    Attributes:
        points: loaded, values (k,) -> unloaded positions of the targets [m], shape (m, t, 3).
    """

    points: Callable[[Loaded, Array], Array]


@dataclass(frozen=True, kw_only=True)
class Geometry(Effect):
    """The robot is not where its joint log and table say.

    Attributes:
        geometry: robot, pulls, values (k,) -> joint values that are true, shape (m, n).
    """

    geometry: Callable[[Robot, Pulls, Array], Array]


@dataclass(frozen=True, kw_only=True)
class Table(Effect):
    """An entry of the robot's table is not that of the robot.

    Attributes:
        letter: Which.
        nominal: What the table has [m] or [rad].
    """

    letter: Letter
    nominal: float = 0.0

    def true(self, robot: Robot, values: Array) -> Robot:
        """The robot as it is, one value (1,) [m] or [rad] beside its table."""
        return changed(robot, (self.letter,), values)


@dataclass(frozen=True, kw_only=True)
class Observation(Effect):
    """What is read is not where the point is.

    Attributes:
        observe: loaded, points (m, t, 3) in F_b, time (m,) [s], values (k,) -> points as read.
        instrument: The base reflectors are read in the same way (the tracker moves); False when
            only the robot is concerned (F_b is not where the base reflectors say).
    """

    observe: Callable[[Loaded, Array, Array, Array], Array]
    instrument: bool = False


@dataclass(frozen=True, kw_only=True)
class Noise(Effect):
    """Readings scatter differently from what is stated.

    Attributes:
        source_scaled: The sources of error (`tracker`, `force_reading`) whose standard
            uncertainty is multiplied by 1 + value.
    """

    source_scaled: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Compound(Effect):
    """One cause that acts in several places of the cell at once.

    Attributes:
        acts: Its facets; each gets all the parameters.
    """

    acts: tuple[Effect, ...]

    @property
    def facets(self) -> tuple[Effect, ...]:
        """The places of the cell where it acts, all with the same parameters."""
        return self.acts
