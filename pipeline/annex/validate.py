"""Uncertainty of deflections due to the uncertainty of x, Eqs. (22), (23)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.annex.promises import VALIDATION
from pipeline.answer.contract import Drawn, PerTarget
from pipeline.answer.recommended import ModelValues
from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints
from pipeline.base.linear import rms
from pipeline.diagnosis.average import Hypothesis
from pipeline.machine.cell import Cell, jacobian
from pipeline.machine.effect import Elastic, Pulls
from pipeline.prediction.model import NOTHING_M
from pipeline.reduction.measured import Measured
from pipeline.reduction.pose_of_interest import PoseOfInterest
from pipeline.reduction.settings import Settings
from pipeline.reduction.weights import PULL
from pipeline.system.estimate import solve
from pipeline.system.system import System
from pipeline.tables import frame

AROUND_M, AROUND_RAD = 0.25, np.deg2rad(10.0)
"""Half width of the box around the test pose [m] or [rad]; the paper does not state its own."""


_SEED = 20261103
"""Of its draws: another one moves numbers within what they say of their scatter."""


def validated(hypotheses: Sequence[Hypothesis], test: PoseOfInterest) -> pd.DataFrame:
    """Table VALIDATION of an answer, see `validate`."""
    return validate(hypotheses, test, np.random.default_rng(_SEED))


def means(checked: pd.DataFrame, values: ModelValues) -> dict[str, Any]:
    """Entries of `validation`: means of Eq. (22) per target, and held-out errors by payload.

    Args:
        checked: Table VALIDATION.
        values: The model's values, with the campaign from which they were estimated.
    """
    fitted = values.fitted
    loads = by_payload(fitted.case.settings, fitted.data, values.first.system)
    full = _drawn(checked, "covariance")
    return {
        "test_pose": full.test_pose,
        "global_": full.global_,
        "independent": _drawn(checked, "independent"),
        "poses": int(checked["index"].max()),
        "by_payload": {name: None if r is None else 1e3 * r for name, r in loads.items()},
    }


def _drawn(checked: pd.DataFrame, draw: str) -> Drawn:
    """Means for one distribution of the stiffnesses, `covariance` or `independent`."""
    drawn = checked[checked["draw"] == draw]
    near, far = (drawn[drawn["set"] == name] for name in ("test_pose", "global"))
    return Drawn(test_pose=_means(near), global_=_means(far))


def _means(rows: pd.DataFrame) -> PerTarget:
    """Mean relative error of each target, in their order."""
    means = rows.groupby("target", sort=False)["mu"].mean()
    return {str(target): float(mean) for target, mean in means.items()}


def validate(
    hypotheses: Sequence[Hypothesis],
    test: PoseOfInterest,
    rng: np.random.Generator,
    poses: int = 1000,
) -> pd.DataFrame:
    """Relative deflection errors mu of Eq. (22) around the test pose and in the workspace.

    mu_t = |A_t (x_drawn - x)| / |A_t x|, Eq. (22), A_t (3, k) [m per unit of x] at target t, F_b.
    Every pose has a draw of its own, once x_drawn ~ N(x, cov(x)) and once as in Eq. (23),
    x_i = 1 / k_i with k_i ~ N(1 / x_i, u(x_i)^2 / x_i^4), each stiffness independently (Monte Carlo
    as in JCGM 101:2008). Parameters that are not identifiable keep their values. If several
    hypotheses may be true, the prediction is their average, and each pose draws one of them by its
    weight; mu then includes its deviation from the average. Only elastic causes take part.

    Args:
        hypotheses: Possible sets of causes, weights sum to one.
        test: Test pose and force; the force is the same at all poses.
        rng: Random number generator.
        poses: Number of poses in each set.

    Returns:
        Table VALIDATION.
    """
    cell = hypotheses[0].cell
    sets = {
        "test_pose": _around(cell, test, rng, poses),
        "global": rng.uniform(*_limits(cell), (poses, cell.robot.n)),
    }
    drawn = {
        "covariance": [_full(one, rng, poses) for one in hypotheses],
        "independent": [_each(one, rng, poses) for one in hypotheses],
    }
    true = _true(hypotheses, rng, poses)
    out = []
    for name, q in sets.items():
        force = np.broadcast_to(test.force, (poses, 3))
        A = [deflections(one.cell, q, force) for one in hypotheses]
        own = [
            A_h @ one.estimate.value[_elastic(one.cell)]
            for A_h, one in zip(A, hypotheses, strict=True)
        ]
        mean = sum(one.weight * moved for one, moved in zip(hypotheses, own, strict=True))
        for kind, draws in drawn.items():
            moved = [
                np.einsum("mtik,mk->mti", A_h, off) + at
                for A_h, off, at in zip(A, draws, own, strict=True)
            ]
            wrong = np.stack(moved)[true, np.arange(poses)] - mean
            mu = np.linalg.norm(wrong, axis=2) / np.linalg.norm(mean, axis=2)
            rows = {
                "set": name,
                "draw": kind,
                "index": np.repeat(np.arange(1, poses + 1), mu.shape[1]),
                "target": list(cell.tool.targets) * poses,
                "mu": mu.ravel(),
            }
            out.append(pd.DataFrame(rows))
    return pd.concat(out, ignore_index=True)


def _true(hypotheses: Sequence[Hypothesis], rng: np.random.Generator, poses: int) -> Ints:
    """Index of the true hypothesis at each pose, shape (m,); drawn only if there are several."""
    weights = [one.weight for one in hypotheses]
    several = len(weights) > 1
    return rng.choice(len(weights), poses, p=weights) if several else np.zeros(poses, np.int64)


def _elastic(cell: Cell) -> Bools:
    """Mask of the parameters of elastic effects, shape (k,)."""
    counts = [len(effect.parameters) for effect in cell.effects]
    return np.repeat([isinstance(effect, Elastic) for effect in cell.effects], counts)


def deflections(cell: Cell, q: Array, force: Array) -> Array:
    """A_i of Eq. (7) at joint values q (m, n) under force (m, 3), shape (m, t, 3, k)."""
    yields = tuple(effect for effect in cell.effects if isinstance(effect, Elastic))
    tool = replace(cell.tool, six=False)  # of every target, also if measured as one pose
    elastic = replace(cell, tool=tool, effects=yields, equilibrium="undeformed")
    return jacobian(elastic, Pulls.at(q, force), np.zeros(len(elastic.parameters)))


def _limits(cell: Cell) -> tuple[Array, Array]:
    far = np.where(cell.robot.prismatic, 1.0, np.pi)
    lower, upper = cell.robot.lower, cell.robot.upper
    return np.where(np.isfinite(lower), lower, -far), np.where(np.isfinite(upper), upper, far)


def _around(cell: Cell, test: PoseOfInterest, rng: np.random.Generator, poses: int) -> Array:
    half = np.where(cell.robot.prismatic, AROUND_M, AROUND_RAD)
    return np.clip(test.q + rng.uniform(-half, half, (poses, len(half))), *_limits(cell))


def _full(one: Hypothesis, rng: np.random.Generator, poses: int) -> Array:
    """Deviations of elastic parameters drawn from their covariance, one per pose, shape (m, k)."""
    estimate, off = one.estimate, np.zeros((poses, len(one.estimate.value)))
    known = estimate.identifiable
    std = estimate.std[known]  # compliances differ by orders of magnitude: factor the correlations
    half = std[:, None] * linear.factor(estimate.cov[np.ix_(known, known)] / np.outer(std, std))
    off[:, known] = rng.standard_normal((poses, known.sum())) @ half.T
    return off[:, _elastic(one.cell)]


def _each(one: Hypothesis, rng: np.random.Generator, poses: int) -> Array:
    """Deviations as in Eq. (23): stiffnesses, independently normal, if they are positive."""
    value, off = one.estimate.value, np.zeros((poses, len(one.estimate.value)))
    known = one.estimate.identifiable & (value > 0) & (np.arange(len(value)) < one.cell.robot.n)
    k, std = 1 / value[known], one.estimate.std[known]
    off[:, known] = 1 / (k + rng.standard_normal((poses, len(k))) * std * k**2) - value[known]
    return off[:, _elastic(one.cell)]


def none() -> pd.DataFrame:
    """Empty table, for a campaign that determines nothing."""
    return frame(VALIDATION.empty_table())


def by_payload(settings: Settings, data: Measured, system: System) -> dict[str, float | None]:
    """Held-out rms error [m] per coordinate for each payload or weight; {} with one load.

    r = c_k - B_k x, with x estimated from the rows of all other loads with their own covariance;
    None if these leave a parameter undetermined that moves the rows of k.

    Args:
        settings: Settings with the names of the payloads.
        data: The measurements.
        system: Their linear system, for the model in question.
    """
    body = np.where(system.rows.pull < 0, PULL, data.body[system.rows.pull])
    bodies = np.unique(body)
    if len(bodies) < 2:
        return {}
    return {
        _name(settings, data, int(one)): _held_out(system, body == one)
        for one in bodies[bodies != PULL]
    }


def _name(settings: Settings, data: Measured, body: int) -> str:
    """Name of a payload; `120 kg` for a weight."""
    names = list(settings.payload)
    if body < len(names):
        return names[body]
    force = data.pulls.force[np.argmax(data.body == body)]
    return f"{np.linalg.norm(force) / settings.gravity.m_s2:.6g} kg"


def _held_out(system: System, mine: Bools) -> float | None:
    found = solve(system.part(~mine), np.zeros(len(system.parameters)))
    B = system.B[mine]
    dark = np.isinf(np.diag(found.cov))
    if (np.abs(B * system.typical)[:, dark].max(initial=0.0)) > NOTHING_M:
        return None
    return rms(system.c[mine] - B @ found.value)
