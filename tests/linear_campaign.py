"""Linear campaigns for tests of the search, with drawn columns and known truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from pipeline.base.arrays import Parameter
from pipeline.diagnosis.cause_search import SearchTask
from pipeline.system.evidence import ROUNDING
from pipeline.system.system import RowIndex
from pipeline.system.whitened import Whitened

POSES, EACH, SPRINGS = 8, 9, 3
STD_M = 2e-5
"""Standard deviation of a row before whitening [m]; rows of one pose are correlated."""


class View(Whitened):
    """A whitened campaign in which the effector gives no estimate of the scatter."""

    tells_scatter = False


def suspect(label: str, *bounds: tuple[float, float], location: str = "", typical: float = 2e-8):
    """A cause with one parameter for each pair of bounds, in typical sizes."""
    parameters = tuple(
        Parameter(f"z{k}", "1", typical, low * typical, high * typical)
        for k, (low, high) in enumerate(bounds)
    )
    return SimpleNamespace(
        label=label,
        parameters=parameters,
        location=location or label,
        tolerance=0.0,
        called=label,
        odds=1.0,
        law=None,
        size=1.0,
    )


FREE = (-np.inf, np.inf)


@dataclass(frozen=True)
class Made:
    """Everything that is true of a linear campaign.

    Attributes:
        suspects: The causes.
        B: Columns of the springs, SI, shape (M, k).
        Z: Columns of each cause, SI.
        c: Rows [m], shape (M,).
        W: Inverse factor of the covariance of the rows without what is common, (M, M).
        shared: Error that all poses share [m], shape (M,).
    """

    suspects: tuple[Any, ...]
    B: np.ndarray
    Z: tuple[np.ndarray, ...]
    c: np.ndarray
    W: np.ndarray
    shared: np.ndarray

    def view(self, accepted: tuple[int, ...] = ()) -> View:
        """The campaign whitened, with some accepted causes."""
        M, k = self.B.shape
        x = np.array([3e-8] * k)
        z = np.array([p.typical for s in self.suspects for p in s.parameters])
        Z = np.column_stack(self.Z)
        top = np.column_stack([self.B * x, self.shared, Z * z, self.c])
        prior = np.zeros((1, top.shape[1]))
        prior[0, k] = 1.0
        A = np.vstack([self.W @ top, prior])
        pose = np.repeat(np.arange(POSES), EACH)
        owner = np.repeat(np.arange(len(self.Z)), [part.shape[1] for part in self.Z])
        none = np.zeros(M, np.int64)
        values = np.zeros(k + sum(len(self.suspects[i].parameters) for i in accepted))
        return View(
            model=SimpleNamespace(accepted=accepted, values=values, springs=k),
            suspects=self.suspects,
            owner=owner,
            typical=np.concatenate([x, [1.0], z]),
            rows=RowIndex(pose + 1, none, np.full(M, "", object), none, none),
            raw=np.column_stack([self.B, Z, self.c]),
            A=A,
            pose=np.append(pose, -1),
            M=A.T @ A,
            springs=k,
            common=1,
            spread=np.full(M, STD_M),
            noise=1.0,
            least=ROUNDING,
            seen=None,
            white=None,
        )

    def columns(self, *causes: int) -> np.ndarray:
        """Whitened columns of springs, the shared error with its prior, and some causes."""
        z = [part * [p.typical for p in s.parameters] for part, s in zip(self.Z, self.suspects,
                                                                         strict=True)]  # fmt: skip
        top = np.column_stack([self.B * 3e-8, self.shared, *(z[i] for i in causes)])
        prior = np.eye(top.shape[1])[SPRINGS]
        return np.vstack([self.W @ top, prior])

    @property
    def y(self) -> np.ndarray:
        """Whitened rows."""
        return np.append(self.W @ self.c, 0.0)


def made(
    rng: np.random.Generator,
    suspects: tuple[Any, ...],
    planted: dict[int, list[float]],
    mixed: dict[int, tuple[int, int]] | None = None,
    alike: dict[int, tuple[int, float]] | None = None,
) -> Made:
    """Draw a campaign.

    Args:
        rng: Of columns and scatter.
        suspects: The causes.
        planted: What is true of some of them, in typical sizes.
        mixed: Causes whose column is the sum of two others', and a little of its own.
        alike: Causes whose columns are another's, and so much of their own.
    """
    M = POSES * EACH
    B = rng.standard_normal((M, SPRINGS)) * 10 * STD_M / 3e-8
    Z = [rng.standard_normal((M, len(s.parameters))) * STD_M / s.parameters[0].typical
         for s in suspects]  # fmt: skip
    for i, (a, b) in (mixed or {}).items():
        Z[i] = (Z[a] + Z[b]) + 0.6 * Z[i]
    for i, (a, share) in (alike or {}).items():
        Z[i] = Z[a] + share * Z[i]
    blocks = np.tril(rng.standard_normal((POSES, EACH, EACH))) * 0.2 + np.eye(EACH)
    L = np.zeros((M, M))
    for p, block in enumerate(blocks):
        here = slice(p * EACH, (p + 1) * EACH)
        L[here, here] = STD_M * block
    shared = STD_M * rng.standard_normal(M)
    c = B @ (3e-8 * rng.uniform(0.5, 2, SPRINGS)) + L @ rng.standard_normal(M)
    c = c + shared * rng.standard_normal()
    for i, sizes in planted.items():
        c = c + Z[i] @ (np.array(sizes) * [p.typical for p in suspects[i].parameters])
    return Made(suspects, B, tuple(Z), c, np.linalg.inv(L), shared)


@dataclass(frozen=True, eq=False)
class Seen:
    """A linear campaign linearised at a model."""

    model: Any
    more: tuple[Any, ...] = ()

    def beside(self, more: tuple[Any, ...]) -> Seen:
        """The same with unnamed causes."""
        return replace(self, more=more)


@dataclass(frozen=True, eq=False)
class LinearTask(SearchTask):
    """A case with a linear model: the point of linearisation does not matter."""

    truth: Any = None
    wide: Any = None

    def fitted(self, accepted, start, near=None):
        """Linearised with some causes."""
        return Seen(SimpleNamespace(accepted=tuple(accepted)))

    def without(self, view, gone):
        """The same where some accepted causes do not act."""
        return view

    def whitened(self, seen, doubt=(), in_each=True):
        """Whitened, with unnamed causes if requested."""
        return (self.wide if seen.more else self.truth).view(seen.model.accepted)


def task_of(truth: Made, nameless: int = 0, **more: Any) -> LinearTask:
    """The case of a linear campaign, whose last causes are unnamed."""
    known = len(truth.suspects) - nameless
    named = replace(truth, suspects=truth.suspects[:known], Z=truth.Z[:known])
    return LinearTask(
        cell=None, data=None, suspects=truth.suspects[:known], noise=1.0,
        nameless=truth.suspects[known:], truth=named, wide=truth, **more,
    )  # fmt: skip


def left(X: np.ndarray, y: np.ndarray) -> float:
    """Residual sum of squares of numpy's least squares."""
    return float(np.sum((y - X @ np.linalg.lstsq(X, y, rcond=None)[0]) ** 2))
