"""Limits of a pose as slacks that must stay positive, with their derivatives.

Joint limits are not here: they are the box in which the search moves.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pipeline.base.arrays import Array, Bools
from pipeline.design.gaps import Gaps, gaps
from pipeline.design.information import PlannedPoses
from pipeline.design.room import Room
from pipeline.design.singular import dexterity
from pipeline.design.spec import Limits
from pipeline.machine.robot import Configuration
from pipeline.machine.robot.configuration import velocity

_MARGIN_M = 1e-3
"""Margin that the search keeps, so that its penalty cannot end on the wrong side [m or 1]."""
_AMPLE = 2 * _MARGIN_M
"""Slack above which its exact value does not matter [m] or [1]."""


@dataclass(frozen=True)
class _Slack:
    """Distance of poses from violating one limit.

    Attributes:
        rule: The limit in words.
        value: Positive where kept [m] or [1], shape (m,).
        by_q: Derivative by the joints, shape (n, m).
        by_anchor: Derivative by the anchor, shape (3, m).
    """

    rule: str
    value: Array
    by_q: Array
    by_anchor: Array


def slacks(limits: Limits, at: PlannedPoses) -> Iterator[_Slack]:
    """Slack of every limit that is set, at every pose."""
    yield from _chain_length(limits.chain_m, at)
    if limits.singular_margin:
        value, by_q = dexterity(at.configuration, limits.singular_margin + _AMPLE)
        rule = "the arm clear of singular poses, where its wrist, elbow or shoulder is stretched"
        yield _Slack(rule, value - limits.singular_margin, by_q, np.zeros((3, 1)))
    if limits.flange_above_m is not None:
        rule = f"the flange above {limits.flange_above_m:g} m"
        yield _height(rule, at, at.configuration.flange_origin.T, limits.flange_above_m)
    if limits.effector_above_m is not None:
        rule = f"the effector above {limits.effector_above_m:g} m"
        for point in (at.load_point, *at.points):
            yield _height(rule, at, point, limits.effector_above_m)
    if limits.chain_clearance_m is not None:
        yield from _clearance(limits.chain_clearance_m, at)
    if limits.pull_within_rad is not None:
        yield _fold(limits.pull_within_rad, at)


def narrow(room: Room | None, at: PlannedPoses, near: float = 0.0) -> list[Gaps]:
    """Every gap of the cell that is narrower than `near`, at every pose."""
    if room is None:
        return []
    points = np.concatenate([at.load_point[None], at.points])
    return gaps(room, at.configuration, points, at.load_point + at.chain_m * at.direction, near)


def kept(limits: Limits, at: PlannedPoses, room: Room | None = None) -> Bools:
    """Poses that violate no limit, shape (m,)."""
    out: Bools = np.all([slack.value >= 0 for slack in slacks(limits, at)], axis=0)
    for found in narrow(room, at):
        out[found.pose] = False
    return out


def penalty(
    limits: Limits, at: PlannedPoses, room: Room | None = None, margin: float = _MARGIN_M
) -> tuple[Array, Array, Array]:
    """Sum of squared violations with a margin, (m,); its slopes by joints (m, n), anchor (m, 3).

    Args:
        limits: Of the problem.
        at: The poses.
        room: Free space of the cell.
        margin: Slack below which the penalty sets in [m] or [1].
    """
    total, by_q, by_anchor = np.zeros_like(at.chain_m), np.zeros_like(at.tau), np.zeros((3, 1))
    for slack in slacks(limits, at):
        over = np.maximum(margin - slack.value, 0.0)
        if over.any():
            total = total + over**2
            by_q = by_q - 2 * over * slack.by_q
            by_anchor = by_anchor - 2 * over * slack.by_anchor
    if room is None:
        return total, by_q.T, np.broadcast_to(by_anchor, (3, len(total))).T
    broken = [(found, 2 * (found.value - margin)) for found in narrow(room, at, margin)]
    for found, weight in broken:
        total = total + np.bincount(found.pose, weight**2 / 4, len(total))
    more, more_anchor = _pushed(at.configuration, broken)
    return total, by_q.T + more, by_anchor.T + more_anchor


def _motion(at: PlannedPoses, point: Array, carrier: int | None = None) -> Array:
    """Velocity of a point (3, m) that joints 0..carrier move, shape (n, 3, m)."""
    moved = np.moveaxis(velocity(at.configuration.twists, point.T[:, None])[:, 0], 0, -1)
    if carrier is not None:
        moved[carrier + 1 :] = 0.0
    return moved


def _height(rule: str, at: PlannedPoses, point: Array, floor: float) -> _Slack:
    return _Slack(rule, point[2] - floor, _motion(at, point)[:, 2], np.zeros((3, 1)))


def _chain_length(bounds: tuple[float, float], at: PlannedPoses) -> Iterator[_Slack]:
    shortest, longest = bounds
    by_q = -np.einsum("im,nim->nm", at.direction, at.J_load)
    rule = f"a chain of {shortest:g} to {longest:g} m"
    yield _Slack(rule, at.chain_m - shortest, by_q, at.direction)
    yield _Slack(rule, longest - at.chain_m, -by_q, -at.direction)


def _fold(most: float, at: PlannedPoses) -> _Slack:
    """The chain leads away from the effector: cosine of the angle minus cosine of the limit."""
    flange = at.configuration.flange_origin.T
    arm = at.load_point - flange
    length = np.sqrt((arm * arm).sum(axis=0)).clip(1e-9)
    out = arm / length
    turned = _motion(at, at.load_point) - _motion(at, flange)
    cosine = (out * at.direction).sum(axis=0)
    across = (at.direction - cosine * out) / length
    along = (out - cosine * at.direction) / at.chain_m
    by_q = np.einsum("im,nim->nm", across, turned) - np.einsum("im,nim->nm", along, at.J_load)
    rule = f"the pull within {np.rad2deg(most):.0f} deg of the line from flange to load point"
    return _Slack(rule, cosine - np.cos(most), by_q, along)


def _clearance(distance: float, at: PlannedPoses) -> Iterator[_Slack]:
    """Distance of the chain from each link; its derivative is that of the two closest points."""
    joints = [*np.moveaxis(at.configuration.origin, 0, -1), at.configuration.flange_origin.T]
    rule = f"the chain {distance:g} m clear of the arm"
    anchor = at.load_point + at.chain_m * at.direction
    for link, (a, b) in enumerate(pairwise(joints)):
        if np.abs(b - a).max() < 1e-9:
            continue
        s, t = _closest(at.load_point, anchor, a, b)
        on_chain, on_link = at.load_point + s * (anchor - at.load_point), a + t * (b - a)
        apart = on_chain - on_link
        length = np.sqrt((apart * apart).sum(axis=0)).clip(1e-9)
        normal = apart / length
        moved = (1 - s) * at.J_load
        moved = moved - (1 - t) * _motion(at, a, link) - t * _motion(at, b, link + 1)
        yield _Slack(rule, length - distance, np.einsum("im,nim->nm", normal, moved), s * normal)


def _closest(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """Fractions along the segments ab and cd (3, m) at which they are closest."""
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = (u * u).sum(0).clip(1e-12), (v * v).sum(0).clip(1e-12), (u * v).sum(0)
    uw, vw = (u * w).sum(0), (v * w).sum(0)
    skew = uu * vv - uv * uv
    s = np.where(skew > 1e-12, (uv * vw - vv * uw) / np.where(skew > 1e-12, skew, 1.0), 0.0)
    t = np.clip((np.clip(s, 0, 1) * uv + vw) / vv, 0, 1)
    s = np.clip((t * uv - uw) / uu, 0, 1)
    return s, np.clip((s * uv + vw) / vv, 0, 1)


def _pushed(at: Configuration, every: Sequence[tuple[Gaps, Array]]) -> tuple[Array, Array]:
    """Derivative of a weighted sum of gaps in each pose, by joints (m, n) and by the anchor (m, 3).

    Args:
        at: The poses.
        every: Gaps, each with its weights, shape (k,).
    """
    m, n = at.q.shape
    wrench, by_anchor = _wrench(m, n, every), np.zeros((3, m))
    for found, weight in every:
        if found.by_anchor is not None:
            for part, values in zip(by_anchor, weight * found.by_anchor, strict=True):
                part += np.bincount(found.pose, values, m)
    by_q, beyond = np.empty((n, m)), np.zeros((6, m))
    twists = at.twists.transpose(1, 2, 0)
    for joint in range(n, 0, -1):
        beyond += wrench[:, joint]
        by_q[joint - 1] = (twists[joint - 1] * beyond).sum(axis=0)
    return by_q.T, by_anchor.T


def _wrench(m: int, n: int, every: Sequence[tuple[Gaps, Array]]) -> Array:
    """Wrench on each body from the derivatives of gaps, about the origin of F_b, (6, n + 1, m)."""
    wrench = np.zeros((6, n + 1, m))
    acting = [(p, f.pose, weight) for f, weight in every for p in f.points if len(f.pose)]
    if acting:
        place = np.concatenate([p.carrier * m + pose for p, pose, _ in acting])
        force = np.concatenate([weight * p.slope for p, _, weight in acting], axis=1)
        x, y, z = np.concatenate([p.at for p, _, _ in acting], axis=1)
        u, v, w = force
        for part, values in zip(
            wrench, (y * w - z * v, z * u - x * w, x * v - y * u, u, v, w), strict=True
        ):
            part += np.bincount(place, values, (n + 1) * m).reshape(n + 1, m)
    return wrench
