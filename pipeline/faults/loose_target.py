"""A target that gives way with the pull: a nest that rocks, or what holds it bends.

In a pull of force f (flange frame) it is displaced on the effector by a |f| + A f, twelve columns,
in all pulls alike. Any rigid motion of the effector in each pull is estimated in any case, so that
the distances between the targets alone tell, whatever the robot does.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array
from pipeline.faults.fault import Fault, Screening
from pipeline.faults.mistake import Mistake, apart, left_out, length, lines_of
from pipeline.faults.reading import Shifted, shifted_readings
from pipeline.machine.robot import configure
from pipeline.system import alarms, odds
from pipeline.system.contrasts import own_columns
from pipeline.system.score_tests import Base, ScoreTests
from pipeline.system.simultaneous import Suspects, active_suspects, cost

_NOTHING = 1e-30
"""Lower limit of a variance, below which it is rounding [1]."""


def loose_target(asked: Screening) -> list[Mistake]:
    """The one target that gives way with the pull, if nothing else explains the distances as well.

    Neither another target, nor bad readings, each by itself; and beside it no other target gives
    way, as all would on an effector that is soft. Of two of which only the distance changes,
    the springs tell which it is.
    """
    shifted = shifted_readings(asked.case, asked.reduced, asked.zeros, asked.system, asked.estimate)
    targets, stack = np.unique(asked.reduced.data.target), shifted.stack
    if asked.cell.tool.six or len(targets) < 3:
        return []
    ways, base = _ways(asked), shifted.pulls_free(asked.reduced.data)
    rows = np.where(stack.pull[:, None] < 0, 0.0, ways[stack.pull, stack.axis])
    each = [shifted.white.by_pose(rows * (stack.target == one)[:, None]) for one in targets]
    found = [base.beside_all(one) for one in each]
    least, springs = 1.0 if asked.system.noise_stated else _NOTHING, shifted.springs(asked.system)
    more = np.zeros((len(springs.blocks.index) - len(rows), rows.shape[1]))
    modelled = [springs.beside_all(np.vstack([one, more])) for one in each]
    left = _likeliest(_likeliest(range(len(each)), found, least), modelled, least)
    best, variance = left[0], float(found[left[0]].variance(least))
    p = len(each) * float(found[best].p())
    if p >= alarms.MOVED or len(left) > 1 or not _alone(shifted, base, each, best, least):
        return []
    off = float(np.linalg.norm(ways @ found[best].size, axis=1).max())
    return [_finding(asked, best, off, float(np.sqrt(found[best].drop / variance)), p)]


def _likeliest(some: Sequence[int], found: Sequence[ScoreTests], least: float) -> list[int]:
    """The best one, and those that are not less likely than it by `odds.DECIDES`."""
    first = max(some, key=lambda k: found[k].drop)
    near = found[first].drop - odds.DECIDES * float(found[first].variance(least))
    return [first, *(k for k in some if k != first and found[k].drop > near)]


def _alone(shifted: Shifted, base: Base, each: list[Array], best: int, least: float) -> bool:
    """Whether beside one target no other gives way, and bad readings explain less than it does."""
    wider = _wider(base, each[best], shifted.white.by_pose(shifted.stack.c))
    others = [float(wider.beside_all(one).p()) for k, one in enumerate(each) if k != best]
    suspects, found = Suspects(shifted.D, shifted.blocks), base.beside_all(each[best])
    own = float(cost(found.drop / found.variance(least), found.rank))
    yields, read = (active_suspects(one, suspects, least).loss(least) for one in (wider, base))
    return len(each) * min(others) >= alarms.MOVED and yields + own < read


def _ways(asked: Screening) -> Array:
    """Displacement by each unknown in every pull, axes of F_b, forces over the largest, (m, 3, 12).

    The unknowns are a, and A row by row [m].
    """
    pulls = asked.reduced.data.pulls
    axes = configure(asked.cell.robot, pulls.q).flange_axes
    size = np.linalg.norm(pulls.force, axis=1)
    own = np.einsum("mij,mi->mj", axes, pulls.force)
    along = np.einsum("mij,mk->mijk", axes, own).reshape(len(axes), 3, 9)
    return np.concatenate([axes * size[:, None, None], along], axis=2) / size.max()


def _wider(base: Base, columns: Array, y: Array) -> Base:
    """The base, whose columns each pose has its own of, with columns common to all poses."""
    own = own_columns(base.blocks.rows(base.Q), base.blocks.index)
    Q = np.hstack([own[:, own.any(axis=0)], linear.orthonormal(base.beyond(columns))])
    return Base.spanned(Q, y, base.blocks.index)


def _finding(asked: Screening, target: int, off_m: float, sigmas: float, p: float) -> Mistake:
    name, rows = asked.case.settings.measured[target], asked.case.readings
    at = lines_of(rows[(rows["target"] == name) & rows["pose"].notna()])
    return Mistake(
        name="loose_target",
        where=name,
        evidence=f"the target {name} gives way with the pull: it moves on the effector by up to "
        f"{length(off_m)} in proportion to the force, {apart(sigmas)}, and the others do not: its "
        "nest rocks, or what holds it bends",
        correction=f"recomputed without {name}",
        before=sigmas,
        unit="sigma",
        size=off_m,
        size_unit="m",
        p_value=min(p, 1.0),
        correct=partial(left_out, at=at),
    )


FAULT = Fault("loose_target", loose_target)
