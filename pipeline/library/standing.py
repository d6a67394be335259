"""Predicted positions of a robot, by the model of a campaign of positions."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pipeline.base.arrays import Array, Ints, Locked
from pipeline.base.errors import InputError
from pipeline.geometry.curves import Curve
from pipeline.geometry.estimate import between_knots
from pipeline.geometry.laws import Inputs, JointLaw
from pipeline.geometry.mechanism import (
    ArmWeights,
    Mechanism,
    Payloads,
    by_frame,
    derivatives,
    frame_of,
    layout,
)
from pipeline.geometry.yielding import called
from pipeline.library.under_force import under_force
from pipeline.machine.robot.mdh import parse
from pipeline.machine.robot.weight import link_moments
from pipeline.prediction.model import parse as model_of
from pipeline.prediction.standing import ARRAYS, ByPulls, Standing

LARGEST = 2**28
"""Maximum size of a model [B]: the covariance of two thousand knots has 2^25."""

_ROWS = 2048
"""Number of poses predicted at a time, so that their arrays fit into the processor's cache."""


def nominal(model: Standing) -> Standing:
    """The table as delivered, with its nominal stiffnesses; tool as estimated."""
    there, where = model.mechanism, layout(model.mechanism)
    bare = replace(
        there,
        values=np.zeros_like(there.values),
        compliance=there.table.nominal_compliance,
        moments=link_moments(there.table),
        unknown=False,
        elements=(),
        yields=np.zeros(0),
        laws=(),
        amplitudes=np.zeros(0),
        curves=(),
        knots=np.zeros(0),
    )
    kept = slice(where.yields.start)
    return replace(model, mechanism=bare, cov=model.cov[kept, kept], by_pulls=None)


def springs(model: Standing) -> Standing:
    """The table as delivered with the estimated springs, without letters and laws."""
    bare = nominal(model)
    return replace(
        bare,
        mechanism=replace(
            bare.mechanism,
            compliance=model.mechanism.compliance,
            moments=model.mechanism.moments,
        ),
    )


@dataclass(frozen=True, eq=False)
class PredictedTargets(Locked):
    """Predicted poses of the targets.

    Attributes:
        at: Positions [m], F_b, shape (m, t, 3).
        turn: Orientation, shape (m, t, 3, 3).
        cov: Covariance of position [m^2] and of rotation about the axes of F_b [rad^2], (m, t, 6,
            6).
    """

    at: Array
    turn: Array
    cov: Array

    @property
    def std(self) -> Array:
        """Standard uncertainties, x, y, z [m] and about x, y, z [rad], (m, t, 6)."""
        return np.sqrt(np.maximum(np.einsum("mtii->mti", self.cov), 0.0))


def predict(
    model: Standing, q: Array, force: Array, payload: Ints, temperature: Array
) -> PredictedTargets:
    """Predict the targets at joint values, with the uncertainty of the true position.

    F_b is the frame realised by the instrument: a displacement of the whole robot relative to its
    base, which no reading resolves, is not an error. The uncertainty includes parameters, laws and
    the unmodelled error of each joint, but not the noise of a reading. Outside the range of its
    data a curve has an uncertainty of its own size.

    Args:
        model: Model of a campaign.
        q: Joint values [m] or [rad], shape (m, n).
        force: Force at the tip [N], F_b, shape (m, 3).
        payload: 0 for none, k + 1 for `payloads[k]`, shape (m,).
        temperature: Temperature of the air [degC], NaN unknown, shape (m,).
    """
    parts = []
    for start in range(0, len(q), _ROWS):
        rows = slice(start, start + _ROWS)
        parts.append(_predict(model, q[rows], force[rows], payload[rows], temperature[rows]))
    return PredictedTargets(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _predict(
    model: Standing, q: Array, force: Array, payload: Ints, temperature: Array
) -> tuple[Array, Array, Array]:
    mechanism = model.mechanism
    weights = ArmWeights(model.gravity, model.bodies, payload)
    never = np.full(len(q), np.nan)
    stand = mechanism.stand(q, weights, temperature, never, never, force, model.tip)
    D, Z = derivatives(mechanism, stand, weights)
    D[..., frame_of(mechanism, model.series)] = by_frame(stand.at)
    K, knots = between_knots(mechanism.curves, q, Z)
    at, cov = stand.at, _spread(model.cov, D, K, knots)
    pulled = np.flatnonzero(force.any(axis=1))
    if model.by_pulls is not None and len(pulled):
        rows = D[pulled], K[pulled], knots[pulled]
        moved = _under_force(model, q[pulled], force[pulled], *rows)
        at = at.copy()
        at[pulled] += moved.mean
        cov[pulled] = moved.cov
    loose = np.zeros(Z[:, 0].shape)
    loose[:, : q.shape[1]] = model.joints**2
    for curve in mechanism.curves:
        loose[:, curve.screw] += curve.beyond(q[:, curve.joint])
    for law in mechanism.laws:
        loose[:, law.joint - 1] += _unknown(law, mechanism, stand.inputs)
    cov += (Z * loose[:, None, :]) @ np.swapaxes(Z, 1, 2)
    m, t = at.shape[:2]
    each = cov.reshape(m, t, 6, t, 6)
    return at, stand.turn, np.stack([each[:, k, :, k] for k in range(t)], axis=1)


class _Moved(NamedTuple):
    """Displacement by pulls minus that by positions [m], (m, t, 3); covariance of both."""

    mean: Array
    cov: Array


def _under_force(
    model: Standing, q: Array, force: Array, D: Array, K: Array, knots: Ints
) -> _Moved:
    """Mean and covariance of the mixture of the pulls' hypotheses."""
    there, m = model.mechanism, len(q)
    tip = there.tool[0, :3, 3] if model.tip is None else model.tip
    assert model.by_pulls is not None
    every = under_force(model.by_pulls, there, tip, q, force)
    weights = np.array([one.weight for one in every])
    mean = np.einsum("h,hmti->mti", weights, [one.shift for one in every])
    cov = np.zeros((m, D.shape[1], D.shape[1]))
    for one in every:
        if one.weight > 0:
            more = _spread(model.cov, D + _of_points(one.by_positions), K, knots)
            own, off = _of_points(one.own), _of_points((one.shift - mean)[..., None])
            more += own @ np.swapaxes(own, 1, 2) + off @ np.swapaxes(off, 1, 2)
            pose, row = np.nonzero(_of_points(one.unknown[..., None])[..., 0])
            more[pose, row, row] = np.inf
            cov += one.weight * more
    return _Moved(mean, cov)


def _of_points(moved: Array) -> Array:
    """Pad rows (m, t, 3, k) of points with zeros for rotations, (m, 6 t, k)."""
    wide = np.pad(moved, ((0, 0), (0, 0), (0, 3), (0, 0)))
    return np.asarray(wide.reshape(len(moved), 6 * moved.shape[1], moved.shape[-1]))


def _spread(cov: Array, D: Array, K: Array, knots: Ints) -> Array:
    """[D K] cov [D K]' of each pose, (m, r, r)."""
    dense = D.shape[2]
    out = D @ cov[:dense, :dense] @ np.swapaxes(D, 1, 2)
    if K.shape[2]:
        beside = cov[:dense, dense:].T[knots]
        mixed = K @ (beside @ np.swapaxes(D, 1, 2))
        own = cov[dense:, dense:][knots[:, :, None], knots[:, None, :]]
        out += mixed + np.swapaxes(mixed, 1, 2) + K @ own @ np.swapaxes(K, 1, 2)
    return np.asarray(out)


def _unknown(law: JointLaw, mechanism: Mechanism, inputs: Inputs) -> Array:
    """Variance of a law if its variable is unknown, or outside the range of the data, (m,)."""
    v = (law.of(inputs) - law.middle) / law.scale
    if law.periodic or law.kind == "step":
        return np.zeros(len(v))
    at = sum(one.amplitudes for one in mechanism.laws[: mechanism.laws.index(law)])
    size = float(np.sum(mechanism.amplitudes[at : at + law.amplitudes] ** 2))
    beyond = np.maximum(np.abs(np.nan_to_num(v)) - 1.0, 0.0)
    return np.where(np.isfinite(v), size * beyond**2, size)


def loads(data: bytes, name: str) -> Standing:
    """Load the model from the content of a positions.npz of the given name.

    Raises:
        InputError: It is not a model.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as kept:
            return _loaded({name: kept[name] for name in kept.files})
    except (ValueError, KeyError, OSError, TypeError) as problem:
        raise InputError(
            "is no model of positions", "run the campaign again", file=name
        ) from problem


def _loaded(kept: dict[str, Any]) -> Standing:
    said = json.loads(kept["said"].tobytes())
    table = parse(said["table"], said["name"])
    mechanism = Mechanism(
        table=table,
        unknown=said["unknown"],
        elements=called(table, said["yields"]),
        laws=tuple(JointLaw(**one) for one in said["laws"]),
        curves=tuple(Curve(**one) for one in said["curves"]),
        **{name: kept[name] for name in ARRAYS},
    )
    size = layout(mechanism).size
    cov = np.zeros((size, size))
    cov[np.triu_indices(size)] = kept["cov"]
    cov = cov + np.triu(cov, 1).T
    return Standing(
        campaign=said["campaign"],
        mechanism=mechanism,
        six=kept["six"],
        targets=np.array(said["targets"], dtype=object),
        cov=cov,
        joints=kept["joints"],
        bodies=Payloads(tuple(said["payloads"]), kept["mass"], kept["centre"], kept["stated"]),
        gravity=kept["gravity"],
        series=said["series"],
        tip=None if said.get("tip") is None else np.array(said["tip"]),
        by_pulls=ByPulls(model_of(said["pulls"]), said["joined"]) if said.get("pulls") else None,
    )
