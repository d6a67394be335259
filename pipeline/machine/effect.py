"""Definition of an effect: something that acts on a cell at a defined stage of the forward model.

One definition yields the simulated data, the columns of B (derivative at the fitted baseline), the
score test, the extended model and the minimal detectable magnitude of a plan.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields

import numpy as np

from pipeline.base.arrays import Array, Ints, Locked, Parameter, Strings
from pipeline.machine.law import Law
from pipeline.machine.robot import Configuration, Robot
from pipeline.machine.robot.dh_parameters import DhParameter, changed

PULLED, HUNG, MOUNTED = 0, 1, 2
"""Codes of `Pulls.by`: load by a chain with a scale, by a weight at the load point, or by a payload
mounted on the flange."""


@dataclass(frozen=True, eq=False)
class Pulls(Locked):
    """One row per pull: commanded and measured inputs in F_b, SI. Weights count as pulls.

    Attributes:
        pose: Pose number, shape (m,).
        repeat: Pull number within the pose, shape (m,).
        q: Joint values of the controller [m] or [rad], shape (m, n).
        force: Measured force on the robot, |f| u of Eqs. (10), (11) [N], shape (m, 3).
        branch: Direction in which the turnbuckle was last turned, +1 up, -1 down, 0 unknown, (m,).
        approach: Direction in which the carriage came along the rail, +1, -1, 0 unknown, (m,).
        time: Time of the loaded readings since the first reading [s], NaN if unknown, (m,).
        time_zero: Time of the pose's unloaded readings [s], NaN if unknown, (m,).
        by: `PULLED`, `HUNG` or `MOUNTED`, shape (m,); `PULLED` by default.
        acts_at: Point of application in the flange frame [m], shape (m, 3); NaN for the tool's load
            point.
        body: Name of the payload, empty for other loads, shape (m,).
        zeros_after: Fraction of the pose's unloaded readings that were taken after the pull [1],
            shape (m,); 0 by default.
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
    zeros_after: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        """Fill in the defaults: pulls by a chain at the load point, without a payload."""
        if len(self.by) != len(self.pose):
            object.__setattr__(self, "by", np.full(len(self.pose), PULLED))
        if len(self.acts_at) != len(self.pose):
            object.__setattr__(self, "acts_at", np.full((len(self.pose), 3), np.nan))
        if len(self.body) != len(self.pose):
            object.__setattr__(self, "body", np.full(len(self.pose), "", dtype=object))
        if len(self.zeros_after) != len(self.pose):
            object.__setattr__(self, "zeros_after", np.zeros(len(self.pose)))
        super().__post_init__()

    def __len__(self) -> int:
        """Number of pulls m."""
        return len(self.pose)

    @classmethod
    def at(cls, q: Array, force: Array, branch: float = 0.0) -> Pulls:
        """Loads outside of any campaign; approach is unknown and all times are zero.

        Args:
            q: Joint values [m] or [rad], shape (m, n) or (n,).
            force: Force on the robot [N], F_b, shape (m, 3) or (3,).
            branch: Direction in which the turnbuckle was turned, 0 unknown.
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
    def weighed(self) -> bool:
        """Whether some loads are pulls and some are weights or payloads."""
        return bool(np.unique(self.by == PULLED).size > 1)

    @property
    def range_n(self) -> tuple[float, float]:
        """Smallest and largest force magnitude [N]."""
        size = np.linalg.norm(self.force, axis=1)
        return float(size.min()), float(size.max())

    def part(self, which: slice | Ints) -> Pulls:
        """Subset of the pulls."""
        return Pulls(**{one.name: getattr(self, one.name)[which] for one in fields(self)})

    def and_then(self, others: Pulls) -> Pulls:
        """These pulls followed by others."""
        pairs = {f.name: (getattr(self, f.name), getattr(others, f.name)) for f in fields(self)}
        return Pulls(**{name: np.concatenate(pair) for name, pair in pairs.items()})

    def under(self, forces: Array) -> Pulls:
        """The same pulls under n sets of forces, one set after the other.

        Pose numbers are shifted from set to set, so that effects with memory within a pose, such as
        hysteresis, do not carry over from one set to the next.

        Args:
            forces: Forces on the robot [N], F_b, shape (n, m, 3).
        """
        n = len(forces)
        tiled = {one.name: np.concatenate([getattr(self, one.name)] * n) for one in fields(self)}
        tiled["pose"] = tiled["pose"] + np.repeat(np.arange(n), len(self)) * (np.ptp(self.pose) + 1)
        return Pulls(**tiled | {"force": np.asarray(forces, float).reshape(-1, 3)})


@dataclass(frozen=True, eq=False)
class Loaded(Locked):
    """A robot with its kinematics computed and its wrench applied, in F_b.

    Attributes:
        pulls: Commanded and measured inputs.
        configuration: Frames of the unloaded robot.
        load_point: Point at which the force acts [m], shape (m, 3).
        force: Acting force [N], shape (m, 3).
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
"""Names of effects that belong to a thing, such as a payload, rather than to a place."""


_WHOLE = ("rail", "scale", "tracker")
"""Places other than joints at which an unlisted law can sit."""


def in_place(where: int | str | None, name: str = "", axis: str | None = None) -> str:
    """Place in words: ` in joint 3 (A2)`, ` in the forearm`, ` at P2`, ` of ballast`, or empty."""
    if where is None:
        return ""
    if isinstance(where, int):
        return f" in joint {where}{f' ({axis})' if axis else ''}"
    parts = {"upper_arm": " in the upper arm", "forearm": " in the forearm"}
    parts |= {name: f" at the {name}" for name in _WHOLE}
    return parts.get(where, f" {'of' if name in _OWNED else 'at'} {where}")


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Attributes common to all effects.

    A cause may be in the catalogue in several mathematical forms (a dead zone, a rounded step):
    they share name and place, and the diagnosis names the cause, not the form.

    Attributes:
        name: Identifier of the cause, such as `rail_roll`.
        where: Joint number, `upper_arm`, `forearm`, ..., or None if only one place is possible.
        noun: Engineering term for it, as a noun that fits into any sentence.
        place: Part of the cell it acts on: rail, base, joint, link, tool, shoulder, wrist, force,
            metrology, noise, or a new one.
        parameters: Its unknowns; the effect is absent if all are zero.
        signature: Observable behaviour, and what separates it from similar effects.
        needs: Measurement or sensor that would settle it.
        source: Source of the formula and of the typical magnitude.
        form: Mathematical form of the cause; empty if there is only one.
        tolerance: Model error of the formula, as a fraction of the displacement it causes.
        element: Machine element that the law describes: effects of one element at one place are
            alternative laws of the same thing. Empty if there are no others.
        shows_unloaded: It moves the unloaded reflectors far more than it changes displacements.
        of: Kinds of load on which it acts; without such a load it has no influence.
        odds: Prior odds relative to any other cause [1].
        size: Expected magnitude relative to the typical one of its parameters [1].
        axis: Name of the controller axis that moves the joint `where`, if there is one.
        law: The law of an unlisted effect; None for effects of the catalogue.
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
        """Catalogue entry of an effect that is the same on any robot."""
        return (self,)

    @property
    def facets(self) -> tuple[Effect, ...]:
        """Its effects on the individual stages of the model, all with the same parameters."""
        return (self,)

    @property
    def label(self) -> str:
        """`rail_roll`, or `joint_tilt:2` if it has several possible places."""
        return self.name if self.where is None else f"{self.name}:{self.where}"

    @property
    def called(self) -> str:
        """Description in words for use in a sentence: `tilt of the bearing in joint 2 (A1)`."""
        return self.noun + in_place(self.where, self.name, self.axis)

    @property
    def since(self) -> bool:
        """Whether it sets in at a pose of the campaign."""
        return self.form.startswith("since pose")

    @property
    def location(self) -> str:
        """Part of the cell: `rail`, `joint 3`, `upper_arm`, `force`, `metrology` ..."""
        if self.where is None or self.place == "metrology" or self.where in _WHOLE:
            return self.place
        return f"joint {self.where}" if self.place == "joint" else str(self.where)


def linear(loaded: Loaded, tau: Array) -> Array:
    """The law of a linear spring: deflection per unit compliance is the torque."""
    return tau


def same_element(one: Effect, other: Effect) -> bool:
    """True if both are laws of the same machine element, such as the torsion of one gear."""
    return bool(one.element) and (one.element, one.where) == (other.element, other.where)


@dataclass(frozen=True, kw_only=True)
class Elastic(Effect):
    """Virtual joints that deflect under load; parameter k is the compliance of virtual joint k.

    The deflection of virtual joint v is its parameter times `response(loaded, tau)[:, v]`, where
    tau is the torque (force) that the pull exerts about (along) each virtual joint.

    Attributes:
        carrier: Joint 0..n that carries each virtual joint (0 is the bed of the rail); virtual
            joints of one carrier come after its own motion.
        twists: loaded -> unit screws of the virtual joints in F_b, shape (m, v, 6); None if each
            has the screw of the joint that carries it.
        response: loaded, tau (m, v) -> deflection per unit parameter, shape (m, v); by default that
            of a linear spring.
        shared: Parameter index of each virtual joint if several share one; empty for one each.
        under_weight: tau (m, v) -> the same as a function of the total torque, weight and pull
            together; None if that is `response`.
        bears: Joint from which on the arm's own weight loads the virtual joints; 0 for the joint
            that carries each.
        between: For each body from the carrier up to before that joint, the fraction of its weight
            that loads them as if it were suspended at that joint [1].
        side: For a compliance that depends on the sign of the torque: loaded, tau (m, 1) -> 1 where
            its one parameter adds to the compliance of the joint that carries it, -1 where it is
            subtracted, shape (m, 1); None if the joint has one compliance.
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
        neighbours = (np.diff(at) == 1).all()  # a slice of an array is a view, not a copy
        return loaded.configuration.twists[:, slice(at[0], at[-1] + 1) if neighbours else at]

    @property
    def modulates(self) -> bool:
        """Whether its parameters are parts of compliances, all of either sign, of a pull alone."""
        units, signed = {p.unit for p in self.parameters}, all(p.lower < 0 for p in self.parameters)
        slips = self.law is not None and self.law.part == "slips"  # what slipped stays
        return signed and units <= {"m/N", "rad/(N m)"} and not slips

    @property
    def parameter_of(self) -> tuple[int, ...]:
        """Index of the parameter of each virtual joint."""
        return self.shared or tuple(range(len(self.carrier)))


@dataclass(frozen=True, kw_only=True)
class Wrench(Effect):
    """The acting force differs from the measured one.

    Attributes:
        wrench: loaded, values (k,) -> acting load point (m, 3) [m] and force (m, 3) [N].
        gain_std: values (k,) -> standard uncertainty of the scale's mean gain that the effect
            brings along [1], because no deflection shows which of its readings were right.
        zero_std: The same of its zero [N].
    """

    wrench: Callable[[Loaded, Array], tuple[Array, Array]]
    gain_std: Callable[[Array], float] = lambda values: 0.0
    zero_std: Callable[[Array], float] = lambda values: 0.0


@dataclass(frozen=True, kw_only=True)
class Reflectors(Effect):
    """The targets sit elsewhere on the tool than campaign.toml states.

    Attributes:
        points: loaded, values (k,) -> unloaded positions of the targets [m], shape (m, t, 3).
    """

    points: Callable[[Loaded, Array], Array]


@dataclass(frozen=True, kw_only=True)
class Geometry(Effect):
    """The configuration of the robot differs from its joint log.

    Attributes:
        geometry: robot, pulls, values (k,) -> true joint values [m] or [rad], shape (m, n).
    """

    geometry: Callable[[Robot, Pulls, Array], Array]


@dataclass(frozen=True, kw_only=True)
class Table(Effect):
    """An entry of the kinematic table deviates from the robot's true value.

    Attributes:
        letter: The entry.
        nominal: Its tabulated value [m] or [rad].
    """

    letter: DhParameter
    nominal: float = 0.0

    def true(self, robot: Robot, values: Array) -> Robot:
        """The true robot: values (1,) [m] or [rad] are added to the nominal entry."""
        return changed(robot, (self.letter,), values)


@dataclass(frozen=True, kw_only=True)
class Observation(Effect):
    """The measured position differs from the position of the point.

    Attributes:
        observe: loaded, points (m, t, 3) in F_b, time (m,) [s], values (k,) -> measured points.
        instrument: True if the base reflectors are affected in the same way (the tracker moves);
            False if only the robot is (F_b is not where the base reflectors define it).
    """

    observe: Callable[[Loaded, Array, Array, Array], Array]
    instrument: bool = False


@dataclass(frozen=True, kw_only=True)
class Noise(Effect):
    """The scatter of the readings differs from the stated one.

    Attributes:
        source_scaled: Sources of error (`tracker`, `force_reading`) whose standard uncertainty is
            multiplied by 1 + value.
    """

    source_scaled: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Compound(Effect):
    """One cause that acts at several stages of the model at once.

    Attributes:
        acts: Its facets; each takes all the parameters.
    """

    acts: tuple[Effect, ...]

    @property
    def facets(self) -> tuple[Effect, ...]:
        """Its effects on the individual stages of the model, all with the same parameters."""
        return self.acts
