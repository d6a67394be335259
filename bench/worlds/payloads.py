"""Bodies mounted on the flange, and the torques that hold the arm under them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bench.league.hidden_effect import Course, Setup
from pipeline.base.arrays import Array, Ints

GRAVITY = 9.81
"""Local gravity [m/s^2]."""

MASS_SIGMA_KG = 0.3
"""Standard uncertainty of a mass stated in campaign.toml [kg]: that of a crane's scale."""
CENTER_SIGMA_M = 2e-3
"""Standard uncertainty of a centre of mass, per axis [m]: from a drawing."""

WRONG_MASS = (0.03, 0.15)
"""Relative error of a wrongly stated mass [1], log-uniform: a plate that was not counted."""
WRONG_CENTER_M = (0.015, 0.08)
"""Error of a wrongly stated centre [m], log-uniform: measured from another face, other jaws."""

TORQUE_SHARE = 0.005
"""Noise of a torque reading relative to the largest torque of its joint in the campaign [1]."""
TORQUE_LEAST = 2.0
"""Smallest noise of such a reading [N m], of a sliding joint [N]."""

NUDGE = 1e-4
"""Step of the joints, in both directions, for the rise of a mass [m or rad]."""

CORNERS = np.vstack([np.zeros(3), np.eye(3)])
"""Points at which a kilogram is attached to find the effects of mass and centre, flange frame
[m]."""

ARM = {
    7: ((3, (0.6, 0.0, 0.0), 500.0), (5, (0.0, 0.0, -0.7), 400.0)),
    6: ((2, (0.5, 0.0, 0.0), 250.0), (4, (0.0, 0.0, -0.6), 200.0)),
}
"""Masses of an arm by its number of joints: joint, place in its frame [m], mass [kg]. Its balancer
and its controller compensate its sag; the torques include it with and without a payload."""


@dataclass(frozen=True)
class Body:
    """A mass and its centre.

    Attributes:
        mass_kg: [kg].
        center_m: Flange frame [m].
    """

    mass_kg: float
    center_m: tuple[float, float, float]

    @property
    def moments(self) -> Array:
        """Mass [kg], and mass times centre [kg m], shape (4,)."""
        return self.mass_kg * np.array([1, *self.center_m])


@dataclass(frozen=True)
class Payload:
    """A body on the flange.

    Attributes:
        name: Name in campaign.toml and loads.csv.
        stated: As stated in campaign.toml.
        true: The truth.
        wrong: What is deliberately stated wrong, `mass` or `center`; empty for nothing.
    """

    name: str
    stated: Body
    true: Body
    wrong: str = ""


@dataclass(frozen=True)
class Carrying:
    """Payloads of a campaign, and what is read of them.

    Attributes:
        masses_kg: Approximate masses [kg], in the order of mounting.
        further_kg: A payload that is not in the campaign: it hangs at the load point of the test
            pose, and its deflection is predicted [kg].
        torques: `states`: the log has a row for each state, with the whole motor torques; `load`:
            it has a row for each pose, with the torques due to the load alone; empty for none.
        wrong: `mass` or `center`: one payload differs from what is stated.
    """

    masses_kg: tuple[float, ...]
    further_kg: float
    torques: str = ""
    wrong: str = ""


def drawn_center(rng: np.random.Generator) -> tuple[float, float, float]:
    """Centre beside the flange and in front of it, to the millimetre [m]."""
    x, y = rng.uniform(-0.25, 0.25, 2)
    return round(float(x), 3), round(float(y), 3), round(float(rng.uniform(0.1, 0.4)), 3)


def mounted(carries: Carrying, rng: np.random.Generator) -> tuple[Payload, ...]:
    """The payloads; stated values err by the stated uncertainty, except one if `wrong`."""
    out = []
    for k, about in enumerate(carries.masses_kg):
        stated = Body(round(about * float(rng.uniform(0.9, 1.1)), 1), drawn_center(rng))
        true = Body(
            stated.mass_kg + MASS_SIGMA_KG * float(rng.standard_normal()),
            _moved(stated.center_m, CENTER_SIGMA_M * rng.standard_normal(3)),
        )
        out.append(Payload(f"ballast{k + 1}", stated, true))
    if carries.wrong:
        which = int(rng.integers(len(out)))
        out[which] = _wrong(out[which], carries.wrong, rng)
    return tuple(out)


def _wrong(one: Payload, what: str, rng: np.random.Generator) -> Payload:
    """The same payload with a wrong statement."""
    if what == "mass":
        part = float(np.exp(rng.uniform(*np.log(WRONG_MASS))) * rng.choice([-1, 1]))
        stated = replace(one.stated, mass_kg=round(one.stated.mass_kg * (1 + part), 1))
    else:
        way, size = rng.standard_normal(3), np.exp(rng.uniform(*np.log(WRONG_CENTER_M)))
        far = np.round(_moved(one.stated.center_m, size * way / np.linalg.norm(way)), 3)
        stated = replace(one.stated, center_m=(float(far[0]), float(far[1]), float(far[2])))
    return replace(one, stated=stated, wrong=what)


def _moved(center: tuple[float, float, float], by: Array) -> tuple[float, float, float]:
    x, y, z = (np.array(center) + by).tolist()
    return x, y, z


@dataclass(frozen=True, eq=False)
class Log:
    """Torques read by the controller, in its own sense.

    Attributes:
        unloaded: Before the first pull of each pose, for each pull, shape (m, n) [N m] or [N].
        loaded: Under every pull, shape (m, n).
        scatter: Noise of one reading, shape (n,).
        by_state: Whether the log has a row for each state, rather than one of their difference for
            each pose.
    """

    unloaded: Array
    loaded: Array
    scatter: Array
    by_state: bool


def read_torques(
    one: Setup,
    course: Course,
    mass: Array,
    center: Array,
    by_state: bool,
    rng: np.random.Generator,
) -> Log:
    """Readings of the controller before and under each payload.

    Args:
        one: The machine.
        course: Course of the measurement.
        mass: Masses of the payloads, shape (m,) [kg].
        center: Their centres, flange frame, shape (m, 3) [m].
        by_state: Whether the log has a row for each state.
        rng: Source of the noise of the readings, and of their sense.
    """
    rest = held(one, course, 0 * mass, center)
    under = held(one, course, mass, center)
    scatter = np.maximum(TORQUE_SHARE * np.abs([rest, under]).max(axis=(0, 1)), TORQUE_LEAST)
    sense = float(rng.choice([-1, 1]))
    first = np.searchsorted(course.pose, course.pose)  # one reading for all pulls of a pose
    return Log(
        sense * (rest + rng.normal(0, scatter, rest.shape))[first],
        sense * (under + rng.normal(0, scatter, under.shape)),
        scatter,
        by_state,
    )


def held(one: Setup, course: Course, mass: Array, center: Array, arm: bool = True) -> Array:
    """Torques that hold the arm at rest, dU/dq, by small motions of each joint.

    U is the potential energy of the payload and, optionally, of the arm; the springs keep their
    deflections.

    Returns:
        Shape (m, n) [N m], of a sliding joint [N].
    """
    q = course.q + one.joint_shift
    weight = mass[:, None] * np.array([0.0, 0.0, -GRAVITY])
    bent = one.machine.rest(q, center, weight)
    links = ARM[q.shape[1]] if arm else ()

    def energy(q: Array) -> Array:
        height = one.machine.carried(q, bent, center)[:, 2]
        own = [kg * one.machine.carried(q, bent, np.array(at), j)[:, 2] for j, at, kg in links]
        return np.asarray(GRAVITY * (mass * height + sum(own, np.zeros(len(q)))))

    steps = NUDGE * np.eye(q.shape[1])
    return np.stack([(energy(q + h) - energy(q - h)) / (2 * NUDGE) for h in steps], axis=1)


def rows_of(payloads: tuple[Payload, ...], which: Ints) -> tuple[Array, Array]:
    """True masses (m,) [kg] and centres (m, 3) [m] of the payload mounted for each pull."""
    mass = np.array([one.true.mass_kg for one in payloads])
    center = np.array([one.true.center_m for one in payloads])
    return mass[which], center[which]


def departs(
    one: Setup, course: Course, log: Log, payload: Payload, which: Ints
) -> tuple[float, Array]:
    """Distance of the stated payload from the true one, in terms of all that is known of it.

    The torques due to the load are linear in x = (m, m c), mass and mass times centre, which they
    determine with a covariance C; the statement has its own, S. The distance is sqrt(d' (C + S)^-1
    d), d = stated - true.

    Args:
        one: The machine.
        course: Course of the measurement.
        log: With the noise of the torques.
        payload: The payload.
        which: Indices of the pulls under it.

    Returns:
        The distance, and C, shape (4, 4) [kg], [kg m].
    """
    per_kg = np.ones(len(course.pose))
    at = [held(one, course, per_kg, np.tile(c, (len(per_kg), 1)), arm=False) for c in CORNERS]
    columns = np.stack([at[0], *(each - at[0] for each in at[1:])], axis=-1)[which]
    A = (columns / (np.sqrt(2) * log.scatter)[:, None]).reshape(-1, 4)
    C = np.linalg.inv(A.T @ A)
    m, c = payload.stated.mass_kg, payload.stated.center_m
    by_mass, by_center = MASS_SIGMA_KG * np.array([1, *c]), m * CENTER_SIGMA_M
    S = np.outer(by_mass, by_mass) + by_center**2 * np.diag([0, 1, 1, 1])
    d = payload.stated.moments - payload.true.moments
    return float(np.sqrt(d @ np.linalg.solve(C + S, d))), C
