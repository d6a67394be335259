"""Detectability with a plan: sizes from which each cause is detected and separated from all rivals.

The columns of a cause are its derivative in the forward model, whitened by the plan's own scatter.
A cause is detected when the part of it that the joint springs cannot explain stands out of the
scatter, and it is named when no rival can explain it either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Bools, Ints, Locked
from pipeline.design.information import Experiment, station
from pipeline.design.problem import Problem, with_steps
from pipeline.design.schedule import pulls_at
from pipeline.design.separability import separation
from pipeline.diagnosis.blindspots import visible
from pipeline.diagnosis.facts import SEPARATED
from pipeline.diagnosis.isolability import Twins, twins
from pipeline.machine.cell import Cell, paper_cell, sensitivity
from pipeline.machine.effect import Effect, Noise
from pipeline.machine.effects import catalogue
from pipeline.system import alarms
from pipeline.system.score_tests import padded


@dataclass(frozen=True)
class Detectability:
    """Detectability of one cause with a plan, twins counted as one.

    Attributes:
        name: Label of the cause, or of its twins joined by " = ".
        detected_from: Minimal detectable magnitude (detected in 80 % of the cases), in typical
            sizes; inf if it is detected at no size. For its main mathematical form, the first in
            the catalogue.
        named_from: Size from which it is separated from every rival in any form, in typical sizes.
        rival: The cause it is hardest to separate from, empty when nothing hides it.
        needs: What would settle it.
    """

    name: str
    detected_from: float
    named_from: float
    rival: str
    needs: str


@dataclass(frozen=True, eq=False)
class CauseTests(Locked):
    """The causes a plan is tested for, with everything that does not depend on its poses.

    Attributes:
        problem: The problem.
        cell: The paper's cell of its robot.
        suspects: Causes that move something, each in each of its forms.
        at: Columns of each suspect in products, padded with -1, shape (n, k).
        typical: Typical size of each column's parameter, shape (K,).
        group: Number of the cause of each suspect; forms and twins share one.
        main: Suspects that are the main form of their cause, the first in the catalogue.
        names: Name of each group.
        twins: Causes that tip loading can never separate.
    """

    problem: Problem
    cell: Cell
    suspects: tuple[Effect, ...]
    at: Ints
    typical: Array
    group: Ints
    main: Bools
    names: tuple[str, ...]
    twins: Twins

    @property
    def springs(self) -> int:
        """Number of joint springs, the first columns of products."""
        return self.problem.robot.n


def cause_tests(problem: Problem) -> CauseTests:
    """Everything about the catalogue of a problem's robot that does not depend on poses."""
    robot = problem.robot
    hidden = twins(robot)
    never = {*hidden.of_stiffness, *hidden.unmoved}
    suspects = tuple(
        effect
        for effect in catalogue(robot)
        if not isinstance(effect, Noise) and effect.label not in never
    )
    names = _classes([effect.label for effect in suspects], hidden.pairs)
    order = list(dict.fromkeys(names.values()))
    sizes = [len(effect.parameters) for effect in suspects]
    return CauseTests(
        problem=problem,
        cell=paper_cell(robot, problem.tool),
        suspects=suspects,
        at=padded(np.split(robot.n + np.arange(sum(sizes)), np.cumsum(sizes)[:-1])),
        typical=np.array([p.typical for effect in suspects for p in effect.parameters]),
        group=np.array([order.index(names[effect.label]) for effect in suspects]),
        main=_first([effect.label for effect in suspects]),
        names=tuple(order),
        twins=hidden,
    )


def _first(labels: Sequence[str]) -> Bools:
    return np.array([label not in labels[:i] for i, label in enumerate(labels)])


def _classes(labels: Sequence[str], pairs: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Label -> name of its class of twins."""
    classes = [{label} for label in dict.fromkeys(labels)]
    for pair in pairs:
        joined = [c for c in classes if not c.isdisjoint(pair)]
        classes = [c for c in classes if c not in joined] + [set().union(*joined)]
    return {label: " = ".join(sorted(c)) for c in classes for label in c}


def rows(
    view: CauseTests, q: Array, anchor: Array, approach: Array, steps: Array, start_s: Array
) -> Array:
    """Whitened columns [springs | suspects] of poses with the same load steps, (m, R, W).

    Args:
        view: The causes.
        q: Joint values [m] or [rad], shape (m, n).
        anchor: Anchor [m], shape (3,) or (m, 3).
        approach: Direction from which the carriage came, +1 or -1, shape (m,).
        steps: Load steps [N]; negative where the turnbuckle was slackened to it, shape (s,).
        start_s: Time of each pose's first zero [s], shape (m,).
    """
    cell, x = view.cell, view.problem.experiment.scale
    made = with_steps(view.problem, steps)
    pulls = pulls_at(made, q, anchor, approach, steps, start_s)
    B = sensitivity(cell, pulls, x, cell.effects) * x
    Z = sensitivity(cell, pulls, x, view.suspects) * view.typical
    X = np.concatenate([B, Z], axis=-1).reshape(len(q), -1, view.springs + len(view.typical))
    return np.asarray(linear.whitening(_covariance(made, q, anchor)) @ X)


def _covariance(experiment: Experiment, q: Array, anchor: Array) -> Array:
    """Covariance of all displacements of each pose [m^2], pulls outermost, (m, R, R)."""
    scatter = experiment.scatter
    at = station(experiment, q, anchor)
    T = scatter.reading(at.points)
    size, m, s = T.shape[-1], len(q), len(scatter.force)
    d = at.A.sum(axis=1).reshape(size, m).T
    V = np.kron(np.eye(s) + scatter.zero, np.ones((size, size))) * np.tile(T, (1, s, s))
    for k, std in enumerate(scatter.force_std):
        block = slice(k * size, (k + 1) * size)
        V[:, block, block] += std**2 * d[:, :, None] * d[:, None]
    return np.asarray(V)


def detectabilities(view: CauseTests, M: Array) -> list[Detectability]:
    """Detectability of every cause of the catalogue with products of shape (W, W)."""
    detected, named, rival = _sizes(view, M)
    out = []
    for g, name in enumerate(view.names):
        members = np.flatnonzero((view.group == g) & view.main)
        worst = members[np.argmax(named[members])]
        other = view.names[view.group[rival[worst]]] if rival[worst] != worst else ""
        sizes = _size(detected[members].max()), _size(named[worst])
        out.append(Detectability(name, *sizes, other, view.suspects[worst].needs))
    return out + [Detectability(*never) for never in _never(view)]


def named_from(view: CauseTests, M: Array) -> Array:
    """Size from which each cause is named, in typical sizes, by plans (k, W, W), (k, g)."""
    named = _sizes(view, M)[1]
    members = [(view.group == g) & view.main for g in range(len(view.names))]
    return np.stack([named[:, of_cause].max(axis=1) for of_cause in members], axis=1)


def _sizes(view: CauseTests, M: Array) -> tuple[Array, Array, Ints]:
    """Sizes from which each suspect is detected and named, in typical sizes, and what hides it.

    Args:
        view: The causes, n suspects.
        M: Products of plans, shape (..., W, W).

    Returns:
        Two arrays of shape (..., n), and the number of the suspect that hides each best, (..., n),
        its own where none hides it by more than rounding.
    """
    base, n = np.arange(view.springs), np.arange(len(view.suspects))
    apart = separation(M, base, view.at)
    own = apart[..., n, n]
    apart = np.where(view.group[:, None] == view.group, np.inf, apart)
    rival = np.argmin(apart, axis=-1)
    closest = np.minimum(np.min(apart, axis=-1), own)
    detected = visible(M, base, view.at, alarms.PLANNED)
    named = np.maximum(detected, SEPARATED / np.maximum(closest, 1e-300))
    return detected, named, np.where(closest < 0.999 * own, rival, n)


def _size(times: float) -> float:
    return float(times) if times < 1e4 else np.inf


def _never(view: CauseTests) -> list[tuple[str, float, float, str, str]]:
    """Causes that no pull at the tip can show."""
    needs = {effect.label: effect.needs for effect in catalogue(view.problem.robot)}
    return [
        (name, np.inf, np.inf, "the joint springs", needs[name]) for name in view.twins.of_stiffness
    ]
