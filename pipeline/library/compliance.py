"""Cartesian compliance and stiffness of an identified robot at a pose: 6 x 6, with covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.base import linear
from pipeline.base.arrays import Array, Locked
from pipeline.machine.cell import load
from pipeline.machine.effect import Elastic, Loaded, Pulls
from pipeline.machine.robot.configuration import torque, velocity
from pipeline.prediction.model import IdentifiedModel, ModelHypothesis

_KILO = 1e3
"""Scale of the wrench, 1 kN or 1 kN m [1]: displacements below a nanometre under it are treated as
zero."""
_STEP = 1e-3
"""Relative step for the tangent of a law [1]: the torque is changed by this times 1 + |torque| [N
m]."""


@dataclass(frozen=True, eq=False)
class CartesianStiffness(Locked):
    """Resistance of a tool to forces and moments at a point; for a single pose without axis m.

    Small motions d = (translation of the point [m], rotation [rad]) under a wrench
    w = (force [N], moment about the point [N m]), all in F_b: d = C w, w = K d.

    Attributes:
        compliance: C, shape (m, 6, 6): [m/N], [m/(N m)]; [rad/N], [rad/(N m)].
        compliance_cov: Covariance of its entries, row by row, shape (m, 36, 36); infinite on the
            diagonal where a spring acts that the campaign did not determine.
        stiffness: K = C^-1, shape (m, 6, 6): [N/m], [N/rad]; [N m/m], [N m/rad]. Its translational
            part applies with the orientation held. NaN if C is singular: fewer than six springs
            act, or the arm is at a singularity.
        stiffness_std: Standard uncertainty of each entry, by dK = -K dC K, shape (m, 6, 6).
        translational: Inverse of the upper left 3 x 3 of C [N/m], shape (m, 3, 3): force over
            translation while the tool is free to rotate, as measured by a dial gauge.
        translational_std: Standard uncertainty of each entry [N/m], shape (m, 3, 3).
    """

    compliance: Array
    compliance_cov: Array
    stiffness: Array
    stiffness_std: Array
    translational: Array
    translational_std: Array


def cartesian_stiffness(
    model: IdentifiedModel, q: Array, force: Array, point: Array | None = None
) -> CartesianStiffness:
    """C = sum_vw s_v D_vw s_w' over the virtual joints v, w of all elastic effects; inverse.

    s_v is the motion of the point per unit of virtual joint v, D the derivative of the deflections
    by the torques; with linear springs alone C = J diag(x) J', Eq. (7) with J for all six motions.
    Over several hypotheses C is their weighted mean, and their spread is part of its covariance.

    Args:
        model: The identified model.
        q: Joint values [m] or [rad], shape (m, n).
        force: Working load [N], F_b, about which nonlinear laws are linearised, (m, 3).
        point: Point in the flange frame [m], shape (3,); the campaign's load point when not given.
    """
    pulls = Pulls.at(q, force)
    points = None if point is None else np.atleast_2d(np.asarray(point, float))
    parts = [_tangent(one, pulls, points) for one in model.hypotheses]
    weights = [one.weight for one in model.hypotheses]
    each = [A @ one.value for A, one in zip(parts, model.hypotheses, strict=True)]
    C = np.asarray(np.einsum("h,hmi->mi", weights, np.stack(each)))
    cov = np.zeros((len(C), 36, 36))
    for one, A, own in zip(model.hypotheses, parts, each, strict=True):
        off = own - C
        if one.weight > 0:
            known = one.through(_KILO * A) / _KILO**2
            cov += one.weight * (known + off[:, :, None] * off[:, None, :])
    whole, block = C.reshape(-1, 6, 6), cov.reshape(-1, 6, 6, 6, 6)[:, :3, :3, :3, :3]
    return CartesianStiffness(
        whole, cov, *_inverse(whole, cov), *_inverse(whole[:, :3, :3], block.reshape(-1, 9, 9))
    )


def _tangent(one: ModelHypothesis, pulls: Pulls, points: Array | None) -> Array:
    """Derivative of the entries of C by each parameter, shape (m, 36, k)."""
    cell = one.at(points)
    loaded = load(cell, pulls, one.value)
    found, begin = np.zeros((len(pulls), 36, len(one.value))), 0
    for effect in cell.effects:
        for facet in effect.facets:
            if isinstance(facet, Elastic):
                s = _motions(facet, loaded)
                given = np.einsum("mvw,mwj->mvj", _law(facet, loaded), s)
                for v, k in enumerate(facet.parameter_of):
                    pair = s[:, v, :, None] * given[:, v, None, :]
                    found[:, :, begin + k] += pair.reshape(-1, 36)
        begin += len(effect.parameters)
    return found


def _motions(effect: Elastic, loaded: Loaded) -> Array:
    """Translation of the load point, and rotation, per unit of each virtual joint, (m, v, 6)."""
    twists = effect.screws(loaded)
    moved = velocity(twists, loaded.load_point[:, None])[:, 0]
    return np.concatenate([moved, twists[..., :3]], axis=-1)


def _law(effect: Elastic, loaded: Loaded) -> Array:
    """Derivative of each deflection (per unit parameter) by each torque, shape (m, v, v)."""
    tau = torque(effect.screws(loaded), loaded.load_point, loaded.force)
    out = np.empty((*tau.shape, tau.shape[1]))
    for w in range(tau.shape[1]):
        step = np.zeros_like(tau)
        step[:, w] = _STEP * (1 + np.abs(tau[:, w]))
        ahead, behind = (effect.response(loaded, tau + s) for s in (step, -step))
        out[:, :, w] = (ahead - behind) / (2 * step[:, w, None])
    return out


def _inverse(C: Array, cov: Array) -> tuple[Array, Array]:
    """K = C^-1 (m, j, j) and the standard uncertainty of its entries; NaN if C is singular."""
    K = np.stack([linear.regular_inverse(one[None])[0] if _regular(one) else one * np.nan
                  for one in C])  # fmt: skip
    known = np.isfinite(np.einsum("mii->mi", cov)).all(axis=1)
    A = np.einsum("mab,mdc->macbd", K, K).reshape(cov.shape)
    variance = np.einsum("mik,mkl,mil->mi", A, np.where(known[:, None, None], cov, 0.0), A)
    std = np.sqrt(np.where(known[:, None], variance, np.inf))
    return K, std.reshape(C.shape)


def _regular(C: Array) -> bool:
    return linear.rank((C + C.T) / 2) == len(C)
