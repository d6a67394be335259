"""The robot at one pose as a certificate draws it: bodies, and how load and causes move them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from pipeline.annex import bodies
from pipeline.annex.bodies import Bodies, arm_joints
from pipeline.base.arrays import Array, Ints
from pipeline.machine.cell import Tool, load
from pipeline.machine.effect import Elastic, Pulls
from pipeline.machine.robot import Configuration, Robot, configure
from pipeline.machine.robot.configuration import torque, velocity
from pipeline.prediction.model import ModelHypothesis
from pipeline.reduction.pose_of_interest import PoseOfInterest

_JOINT, _PLACE = "joint", "place"
"""Parts of POSTURE that are points: origins of joints, middles of links that a cause may be in."""

TOOL_RADIUS = 0.35
"""Radius of a rod of the effector over that of the last link."""


def posture(model: ModelHypothesis, where: PoseOfInterest) -> pd.DataFrame:
    """Table POSTURE of the test pose.

    A point p carried by joint j moves by the sum over the virtual joints v that j or one before it
    carries, xi_v(p) d_v, with d_v how far v gives way: its parameter times its response to the
    torque of the pull, as in `cell.predict` of an undeformed robot.

    Args:
        model: Joint springs with the causes beside them.
        where: Pose and force.
    """
    cell, pulls = model.cell, Pulls.at(where.q, where.force)
    table, ends, carrier = _drawn(cell.robot, cell.tool, where.q)
    causes = {id(one) for effect in model.beside_springs for one in effect.facets}
    loaded_by = [(effect, part) for effect, part in cell.split(model.value) if part.any()]
    loaded = load(cell, pulls, model.value)
    moved = {"moved": np.zeros_like(ends), "caused": np.zeros_like(ends)}
    for effect, part in loaded_by:
        if not isinstance(effect, Elastic):
            continue
        screws = effect.screws(loaded)
        tau = torque(screws, loaded.load_point, loaded.force)
        amount = (effect.response(loaded, tau) * part[list(effect.parameter_of)])[0]
        acts = np.asarray(effect.carrier)[None, :] <= carrier[:, None]
        by = np.einsum("tkx,k,tk->tx", velocity(screws, ends[None])[0], amount, acts)
        for name in ("moved", *(["caused"] if id(effect) in causes else [])):
            moved[name] += by
    for name, by in moved.items():
        table[_xyz(f"from_{name}")] = by[: len(table)]
        table[_xyz(f"to_{name}")] = by[len(table) :]
    return table


def standing_posture(robot: Robot, tool: Tool, q: Array) -> pd.DataFrame:
    """The same of a pose without a load."""
    table, _, _ = _drawn(robot, tool, q)
    still = [c for end in ("from", "to") for by in ("moved", "caused") for c in _xyz(f"{end}_{by}")]
    return table.assign(**dict.fromkeys(still, 0.0))


def _drawn(robot: Robot, tool: Tool, q: Array) -> tuple[pd.DataFrame, Array, Ints]:
    """What is drawn, all its ends [m] (2 c, 3), first those that it comes from, and who carries."""
    here = configure(robot, np.asarray(q, dtype=float)[None])
    rows = pd.concat([_rows(*one) for one in _parts(robot, here, tool)], ignore_index=True)
    ends = np.concatenate([rows[_xyz("from")], rows[_xyz("to")]]).astype(float)
    return rows, ends, np.tile(rows["joint"].to_numpy(), 2)


def _parts(robot: Robot, here: Configuration, tool: Tool) -> Iterator[tuple[Bodies, Ints]]:
    """Bodies, and the joint that carries each."""
    number = {joint.name: k for k, joint in enumerate(robot.joints, 1)}
    number |= {"base": 0, "flange": robot.n + 1}
    straight = not len(robot.capsules)  # a line that ends at a joint is carried by the one before
    for one in bodies.links(robot, here):
        at = np.array([number[name] for name in one.names], dtype=np.int64)
        yield one, np.maximum(at - straight, 0)
    thick = TOOL_RADIUS * (float(one.radius[-1]) if len(one.radius) else 0.05)
    last = np.full(len(tool.named), robot.n)
    yield bodies.effector(here, tool, thick), last
    own = dict(zip((joint.name for joint in robot.joints), here.origin[0], strict=True))
    yield bodies.points(_JOINT, own), np.arange(1, robot.n + 1)
    pair = arm_joints(robot, here.q[0])
    if pair is not None and pair[1] + 1 < robot.n:
        shoulder, elbow = pair
        a, b, c = here.origin[0, [shoulder, elbow, max(robot.n - 3, elbow + 1)]]
        middles = {"upper_arm": (a + b) / 2, "forearm": (b + c) / 2}
        yield bodies.points(_PLACE, middles), np.array([shoulder + 1, elbow + 1])


def _rows(one: Bodies, carrier: Ints) -> pd.DataFrame:
    ends = one.ends[0].reshape(len(one.names), 6)
    found = pd.DataFrame(ends, columns=[*_xyz("from"), *_xyz("to")])
    return found.assign(part=one.part, name=one.names, joint=carrier, radius_m=one.radius)


def _xyz(name: str) -> list[str]:
    return [f"{name}_{axis}_m" for axis in "xyz"]
