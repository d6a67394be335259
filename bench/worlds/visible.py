"""Smallest detectable error of a reading: from the table, or by an independent adjustment."""

from __future__ import annotations

import numpy as np
import pandas as pd

from bench.league.hidden_effect import setup
from bench.league.play import pull_to, strained
from bench.worlds.cell import Cell
from bench.worlds.noise import SIGMA_M
from pipeline.base.arrays import Array

SHOWS = 17.0746
"""(z_0.9995 + z_0.80)^2 [1]: noncentrality at which a two-sided test at 0.001 has a power of
0.80."""

METRES = {"m": 1.0, "mm": 1e-3}


def from_table(table: pd.DataFrame, line: int, way: Array) -> float | None:
    """Smallest detectable size of an error in a direction [m], from table `reliability`.

    With v_k the smallest detectable errors along the axes, 1 / sqrt(sum (way_k / v_k)^2), which
    neglects what the axes share. A row of a zero is one of the mean of its readings, and one in
    radians of a direction: for these readings the table gives no value.

    Args:
        table: Its rows are error columns: source, file, line, axis, smallest_visible, unit.
        line: Line of the reading in tracker.csv.
        way: Unit vector in the axes of the table, shape (3,).
    """
    mine = table[(table["file"] == "tracker.csv") & (table["line"] == line)]
    mine = mine[mine["unit"].isin(METRES) & (mine["source"] != "zero")]
    axes = mine["axis"].astype(str)
    if mine.empty:
        return None
    size = (mine["smallest_visible"].astype(float) * mine["unit"].map(METRES)).to_numpy()
    if axes.isin(list("xyz")).all() and axes.is_unique:
        seen = float(np.linalg.norm(way[["xyz".index(axis) for axis in axes]] / size))
    else:  # along separate directions: a lower bound
        seen = float((1 / size).min())
    return 1 / seen if seen > 0 else None


class Adjustment:
    """All readings of a campaign in one adjustment, linear about the truth, in F_b.

    reading = point + t + w x point, where a base reflector is where the table says, an unloaded one
    is free, a loaded one differs from its zero by D x + F f (compliances x, force f), and the chain
    is a rod of one length along the force. Unknowns are t, w, x, the zeros, each pull's force and
    the position of its chain, and the rod's length; the scale's readings and 100 % of each
    compliance are prior information.

    Args:
        cell: What was measured.
        sigma_m: Standard uncertainty of a reading, per axis [m].
        scale_n: Standard uncertainty of the scale [N].

    Attributes:
        range: Orthonormal basis of the effects of the unknowns, rows of the readings, shape (3r,
            k).
        beforehand: Likewise, rows of the prior information.
    """

    def __init__(self, cell: Cell, sigma_m: float = SIGMA_M, scale_n: float = 2.0) -> None:
        self.sigma_m = sigma_m
        A, known = _design(cell, scale_n, sigma_m)
        scaled = np.vstack([A, known])
        norm = np.linalg.norm(scaled, axis=0)
        u, s, _ = np.linalg.svd(scaled / np.where(norm > 0, norm, 1.0), full_matrices=False)
        self.range, self.beforehand = np.split(u[:, s > 1e-10 * s[0]], [len(A)])

    def redundancy(self, reading: int, way: Array) -> float:
        """Redundancy w' (I - H_jj) w of an error in a direction, between 0 and 1."""
        rows = self.range[3 * reading : 3 * reading + 3]
        return float(1 - np.sum((way @ rows) ** 2))

    def smallest(self, reading: int, way: Array) -> float | None:
        """Smallest detectable size of an error in a direction, F_b [m]; None if undetectable."""
        r = self.redundancy(reading, way)
        return float(self.sigma_m * np.sqrt(SHOWS / r)) if r > 1e-9 else None


def _design(cell: Cell, scale_n: float, sigma_m: float) -> tuple[Array, Array]:
    """Derivatives of readings (3r, k) over sigma, and of the prior information, likewise."""
    n, m, t = cell.robot.n, len(cell.course.pose), cell.rules.targets
    zeros, pulls = 6 + n, 6 + n + 3 * t * len(cell.plan.q)
    total = pulls + 6 * m + 1
    D, F, unit = _compliant(cell)
    across = np.stack([_across(u) for u in unit])
    A = np.zeros((len(cell.slots), 3, total))
    A[:, :, :3] = np.eye(3)
    A[:, :, 3:6] = -_cross(cell.points)
    for row, slot in zip(A, cell.slots, strict=True):
        if slot.state == "base":
            continue
        i, k = slot.pull, slot.which
        mine = pulls + 6 * i
        if slot.state == "chain":
            row[:, mine : mine + 3] = np.eye(3)
            row[:, mine + 4 : mine + 6] = k * 0.4 * across[i]
            row[:, -1] = k * unit[i]
            continue
        zero = zeros + 3 * (t * int(cell.course.pose[i]) + k)
        row[:, zero : zero + 3] = np.eye(3)
        if slot.state == "loaded":
            row[:, 6:zeros] = D[i, k]
            row[:, mine + 3] = F[i, k] @ unit[i]
            row[:, mine + 4 : mine + 6] = F[i, k] @ across[i] * cell.scale[i]
    known = np.zeros((m + n, total))
    known[np.arange(m), pulls + 6 * np.arange(m) + 3] = 1 / scale_n
    known[m + np.arange(n), 6 + np.arange(n)] = cell.stiffness
    return A.reshape(-1, total) / sigma_m, known


def _compliant(cell: Cell) -> tuple[Array, Array, Array]:
    """By differences of the machine: dp/dx (m, t, 3, n), dp/df (m, t, 3, 3), directions (m, 3)."""
    along, n = pull_to(cell.plan.anchor[cell.course.pose]), cell.robot.n
    chain = strained(
        setup(cell.robot, cell.stiffness), cell.course, cell.tool, along, cell.scale
    ).chain
    unit = chain[:, 1] - chain[:, 0]
    unit = unit / np.linalg.norm(unit, axis=1, keepdims=True)
    force = cell.scale[:, None] * unit

    def stands(stiffness: Array, force: Array) -> Array:
        machine = setup(cell.robot, stiffness).machine
        return machine.settle(cell.course.q, cell.tool[1:], cell.tool[0], force)[0]

    here, small = stands(cell.stiffness, force), 1e-3
    softer = [
        (stands(cell.stiffness / (1 + small * e), force) - here) / (small / (cell.stiffness @ e))
        for e in np.eye(n)
    ]
    pushed = [stands(cell.stiffness, force + e) - here for e in np.eye(3)]
    return np.stack(softer, axis=-1), np.stack(pushed, axis=-1), unit


def _across(u: Array) -> Array:
    """Two unit vectors perpendicular to a given one, as columns, shape (3, 2)."""
    full, _, _ = np.linalg.svd(u[:, None])
    return np.asarray(full[:, 1:])


def _cross(p: Array) -> Array:
    """[p]x, shape (r, 3, 3)."""
    K = np.zeros((len(p), 3, 3))
    K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -p[:, 2], p[:, 1], -p[:, 0]
    return np.asarray(K - np.swapaxes(K, 1, 2))
