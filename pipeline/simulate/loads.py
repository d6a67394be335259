"""Loads of a virtual robot: a chain with a scale, dead weights, or payloads on its flange."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base.arrays import Array, Ints, Locked
from pipeline.base.strict import STANDARD_GRAVITY
from pipeline.design.pull import branches
from pipeline.machine.effect import HUNG, MOUNTED, PULLED
from pipeline.simulate.plan import Plan

DOWN = np.array([0.0, 0.0, -1.0])
"""Direction of gravity, F_b."""


@dataclass(frozen=True, eq=False)
class PullLoads(Locked):
    """Loads of all pulls, pose after pose.

    Attributes:
        count: Number of pulls of each pose, shape (p,).
        by: Kind of load, codes of `Pulls.by`, shape (m,).
        shown: Intended reading of the scale, or stated weight [N], shape (m,).
        heavier: True force over that, shape (m,); 1 for a scale, whose errors are drawn later.
        acts_at: True point of action, flange frame [m]; NaN at the load point, shape (m, 3).
        branch: Direction of the last change of the load, +1 up, -1 down, shape (m,).
        what: Name of the payload of each pull, empty for other loads.
    """

    count: Ints
    by: Ints
    shown: Array
    heavier: Array
    acts_at: Array
    branch: Array
    what: tuple[str, ...]


def run(plan: Plan, poses: int, rng: np.random.Generator) -> PullLoads:
    """The loads of a plan; errors of weights and payloads are drawn once for each body.

    Args:
        plan: The plan.
        poses: Number of poses.
        rng: Draws errors of masses [kg] and centres [m]; unused where a chain pulls.
    """
    if plan.pulls.load == "payloads":
        return _payloads(plan, poses, rng)
    each = plan.pulls.pose_steps_n or [_steps(plan)] * poses
    runs = [np.tile(np.array(steps, float), plan.pulls.repeats) for steps in each]
    signs = [np.tile(branches(np.array(steps, float)), plan.pulls.repeats) for steps in each]
    shown = np.abs(np.concatenate(runs))
    chain = plan.pulls.load == "chain"
    return PullLoads(
        count=np.array([len(one) for one in runs]),
        by=np.full(len(shown), PULLED if chain else HUNG),
        shown=shown,
        heavier=np.ones(len(shown)) if chain else _heavier(plan, shown, rng),
        acts_at=np.full((len(shown), 3), np.nan),
        branch=np.concatenate(signs),
        what=("",) * len(shown),
    )


def _steps(plan: Plan) -> list[float]:
    """Load steps [N]: those of the scale, or the weights of the masses."""
    if plan.pulls.load == "chain":
        return plan.pulls.steps_n
    return [STANDARD_GRAVITY * mass for mass in plan.pulls.masses_kg]


def _heavier(plan: Plan, shown: Array, rng: np.random.Generator) -> Array:
    """True over stated weight: one error for every mass, however often it hangs, shape (m,)."""
    masses, which = np.unique(shown / STANDARD_GRAVITY, return_inverse=True)
    off = plan.pulls.mass_sigma_kg * rng.standard_normal(len(masses))
    return np.asarray((1 + off / masses)[which.ravel()])


def _payloads(plan: Plan, poses: int, rng: np.random.Generator) -> PullLoads:
    """Each payload mounted in turn at every pose."""
    every = list(plan.payload.values())
    off = rng.standard_normal((len(every), 4))
    mass = np.array([one.mass_kg for one in every])
    true = mass + off[:, 0] * [one.mass_sigma_kg for one in every]
    center = np.array([one.center_m for one in every])
    center = center + off[:, 1:] * np.array([[one.center_sigma_m] for one in every])
    each = plan.pulls.repeats * poses
    return PullLoads(
        count=np.full(poses, plan.pulls.repeats * len(every)),
        by=np.full(each * len(every), MOUNTED),
        shown=np.tile(STANDARD_GRAVITY * mass, each),
        heavier=np.tile(true / mass, each),
        acts_at=np.tile(center, (each, 1)),
        branch=np.ones(each * len(every)),
        what=tuple(plan.payload) * each,
    )
