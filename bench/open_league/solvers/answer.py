"""Answer of a solver, as the part of result.json that the open league scores."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import stats

from bench.open_league.solvers.problem import Problem, Suspect
from pipeline.base.arrays import Array

Json = dict[str, Any]


def answer(
    given: Problem,
    verdict: str,
    x: Array,
    cov: Array,
    dof: int,
    named: Sequence[Suspect] = (),
    columns: Sequence[int] = (),
) -> Json:
    """result.json of an estimate of springs and some columns of Z.

    Args:
        given: The problem.
        verdict: `adequate`, `explained` or `unexplained`.
        x: Compliances, then parameters, shape (n + k,).
        cov: Their covariance.
        dof: Degrees of freedom of Student's t; 0 if the noise is stated.
        named: Causes that are named.
        columns: Columns of Z that were estimated, shape (k,).
    """
    half = float(stats.t.ppf(0.975, dof) if dof else stats.norm.ppf(0.975))
    n, std = len(given.springs), np.sqrt(np.diag(cov))
    springs = [_stiffness(*one, half) for one in zip(given.springs, x[:n], std[:n], strict=True)]
    J = np.hstack([given.B_there, given.Z_there[:, list(columns)]])
    found = {column: (x[n + k], std[n + k]) for k, column in enumerate(columns)}
    return {
        "format": 1,
        "stiffness": springs,
        "test_pose_deflection": _deflection(given, J, x, cov),
        "diagnosis": {
            "verdict": verdict,
            "causes": [_cause(one, found, half) for one in named],
        },
    }


def _stiffness(name: str, c: float, std: float, half: float) -> Json:
    """Value and interval of 1 / c; an end at which c is not positive is infinite, that is, null."""
    low, high = c - half * std, c + half * std
    return {
        "name": name,
        "value": 1 / c if c > 0 else None,
        "std": std / c**2 if c > 0 else None,
        "ci95": [1 / high if high > 0 else None, 1 / low if low > 0 else None],
    }


def _deflection(given: Problem, J: Array, x: Array, cov: Array) -> list[Json]:
    d, std = 1e3 * (J @ x), 1e3 * np.sqrt(np.einsum("ij,jk,ik->i", J, cov, J))
    return [
        {
            "target": target,
            **{f"d{a}_mm": float(v) for a, v in zip("xyz", d[3 * k : 3 * k + 3], strict=True)},
            "std_mm": std[3 * k : 3 * k + 3].tolist(),
        }
        for k, target in enumerate(given.targets if len(J) else ())
    ]


def _cause(one: Suspect, found: dict[int, tuple[float, float]], half: float) -> Json:
    parameters = [
        {"name": name, "value": v, "std": s, "ci95": [v - half * s, v + half * s]}
        for name, column in zip(one.parameters, one.columns.tolist(), strict=True)
        if column in found
        for v, s in [found[column]]
    ]
    return {"name": one.name, "where": one.where, "parameters": parameters}
