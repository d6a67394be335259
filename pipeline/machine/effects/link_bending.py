"""A link of the arm bends as a beam clamped at its near end, about two axes across it.

- beam: it turns about its middle by c = L / EI times the moment there, and its end is displaced
  across by c L^2 / 12 times the force there (Euler and Bernoulli, exact for any load at the end)
- hinge: it turns about its middle only (a rigid link with one compliant section)

Under the arm's own weight everything beyond its far end loads it in this way; a body at a fraction
a of its length counts as a^2 of its weight at the far end: the slope is c a^2 L F / 2.
"""

import numpy as np

from pipeline.base.arrays import Array, Parameter
from pipeline.machine.effect import Elastic, Loaded
from pipeline.machine.effects._anatomy import arm, compliance
from pipeline.machine.robot import Robot, configure
from pipeline.machine.robot.configuration import rotation_about, translation_along


def effects(robot: Robot) -> tuple[Elastic, ...]:
    """Upper arm (shoulder to elbow) and forearm (elbow to wrist centre) of a six-axis arm."""
    joints = arm(robot)
    if joints is None:
        return ()
    shoulder, elbow, wrist = joints
    links = (("upper_arm", "upper", shoulder, elbow), ("forearm", "fore", elbow, wrist))
    long = [link for link in links if _length(robot, *link[2:]) > _SHORTEST_M]
    return tuple(_effect(robot, *link, form) for link in long for form in ("beam", "hinge"))


_SHORTEST_M = 1e-3
"""Minimum distance of the next joint from a joint's axis [m]; physics: nearer ones have no link
between them that could bend."""


def _length(robot: Robot, near: int, far: int) -> float:
    """Distance of a joint from the axis of an earlier one [m]."""
    here = configure(robot, np.zeros((1, robot.n)))
    (axes, start), (_, end) = here.frame(near), here.frame(far)
    return float(np.linalg.norm(np.cross((end - start)[0], axes[0, :, 2])))


def _effect(robot: Robot, where: str, short: str, near: int, far: int, form: str) -> Elastic:
    c = compliance(robot, near)
    beam = form == "beam"

    def frame(loaded: Loaded) -> tuple[Array, Array, Array, Array]:
        """Hinge axis of the near joint, direction across, middle, vector along the link."""
        axes, start = loaded.configuration.frame(near)
        _, end = loaded.configuration.frame(far)
        axis = axes[:, :, 2]
        link = end - start - np.sum((end - start) * axis, axis=1, keepdims=True) * axis
        side = np.cross(axis, link / np.linalg.norm(link, axis=1, keepdims=True))
        return axis, side, (start + end) / 2, link

    def screws(loaded: Loaded) -> Array:
        axis, side, middle, _ = frame(loaded)
        turns = [rotation_about(middle, axis), rotation_about(middle, side)]
        shifts = [translation_along(side), translation_along(axis)]
        return np.stack([*turns, *shifts] if beam else turns, axis=1)

    def response(loaded: Loaded, tau: Array) -> Array:
        length2 = np.sum(frame(loaded)[3] ** 2, axis=1, keepdims=True)
        return np.concatenate([tau[:, :2], tau[:, 2:] * length2 / 12], axis=1)

    return Elastic(
        name="link_bending",
        noun="bending of the link",
        place="link",
        where=where,
        form=form,
        parameters=(
            Parameter(
                *(f"c_{short}_in_plane", "rad/(N m)", c / 5, 0.0, np.inf),
                f"bending compliance of the {short} arm in the arm's plane",
            ),
            Parameter(
                *(f"c_{short}_out_of_plane", "rad/(N m)", c / 5, 0.0, np.inf),
                f"bending compliance of the {short} arm across the arm's plane",
            ),
        ),
        signature=f"everything behind the {where.replace('_', ' ')} turns about its middle; "
        "hardly distinguishable from the tilt of the joint that carries it",
        needs="reflectors at the elbow",
        source="beam theory; 2e7 to 4e7 N m/rad per axis is an estimate",
        carrier=(near,) * (4 if beam else 2),
        twists=screws,
        response=response,
        shared=(0, 1, 0, 1) if beam else (),
        bears=far,
        between=_between(robot, near, far),
    )


def _between(robot: Robot, near: int, far: int) -> tuple[float, ...]:
    """a^2 of each body that the link carries between its ends, at its middle if not stated."""
    here = configure(robot, np.zeros((1, robot.n)))
    (_, start), (_, end) = here.frame(near), here.frame(far)
    link, out = (end - start)[0], []
    for number in range(near, far):
        axes, origin = here.frame(number)
        centre = robot.joints[number - 1].centre_of_mass_m
        middle = (start + end) / 2 if centre is None else origin + axes @ np.array(centre)
        out.append(float(np.clip((middle - start)[0] @ link / (link @ link), 0.0, 1.0)) ** 2)
    return tuple(out)
