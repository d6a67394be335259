"""Predicted positions of a robot, by the model of a campaign of positions."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pipeline.base.arrays import Array, Ints
from pipeline.base.errors import InputError
from pipeline.library.kinematic_model import ARRAYS, ByPulls, KinematicModel
from pipeline.library.model_file import parse as model_of
from pipeline.library.targets import PredictedTargets
from pipeline.library.under_force import UnderForce, under_force
from pipeline.machine.robot.mdh import parse
from pipeline.machine.robot.weight import link_moments
from pipeline.positions.laws import Inputs, JointLaw
from pipeline.positions.mechanism import (
    ArmWeights,
    Mechanism,
    Payloads,
    PlacedRobot,
    by_frame,
    derivatives,
    frame_of,
    layout,
)
from pipeline.positions.random_curve import Curve, between_knots
from pipeline.positions.yielding import called

LARGEST_MODEL = 2**28
"""Maximum size of a model [B]: the covariance of two thousand knots has 2^25."""

_ROWS = 2048
"""Number of poses predicted at a time, so that their arrays fit into the processor's cache."""


def nominal(model: KinematicModel) -> KinematicModel:
    """The table as delivered, with its nominal stiffnesses; tool as estimated."""
    there, where = model.mechanism, layout(model.mechanism)
    bare = replace(
        there,
        values=np.zeros_like(there.values),
        compliance=there.table.nominal_compliance,
        moments=link_moments(there.table),
        loose=False,
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


def springs(model: KinematicModel) -> KinematicModel:
    """The table as delivered with the estimated springs, without DH corrections and laws."""
    bare = nominal(model)
    return replace(
        bare,
        mechanism=replace(
            bare.mechanism,
            compliance=model.mechanism.compliance,
            moments=model.mechanism.moments,
        ),
    )


def predict(
    model: KinematicModel, q: Array, force: Array, payload: Ints, temperature: Array
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
    model: KinematicModel, q: Array, force: Array, payload: Ints, temperature: Array
) -> tuple[Array, Array, Array, Array, Array]:
    mechanism = model.mechanism
    here = _at(model, q, force, payload, temperature)
    cov, pulled = _spread(model.cov, here.D, here.K, here.knots), np.flatnonzero(force.any(axis=1))
    at, (moved, moved_std) = here.stand.at.copy(), np.zeros((2, *here.stand.at.shape))
    if len(pulled):
        rest = _at(model, q[pulled], 0.0 * force[pulled], payload[pulled], temperature[pulled])
        one = _under_force(model, q[pulled], force[pulled], here.part(pulled), rest)
        at[pulled] += one.mean
        cov[pulled] = one.cov
        moved[pulled] = at[pulled] - rest.stand.at
        moved_std[pulled] = _std(one.moved, at.shape[1])[..., :3]
    loose, Z = np.zeros(here.Z[:, 0].shape), here.Z
    loose[:, : q.shape[1]] = model.joints**2
    for curve in mechanism.curves:
        loose[:, curve.screw] += curve.beyond(q[:, curve.joint])
    for law in mechanism.laws:
        loose[:, law.joint - 1] += _unknown(law, mechanism, here.stand.inputs)
    cov += (Z * loose[:, None, :]) @ np.swapaxes(Z, 1, 2)
    m, t = at.shape[:2]
    each = cov.reshape(m, t, 6, t, 6)
    own = np.stack([each[:, k, :, k] for k in range(t)], axis=1)
    return at, here.stand.turn, own, moved, moved_std


class _At(NamedTuple):
    """The robot at m poses; derivatives of its targets by dense parameters, knots and joints."""

    stand: PlacedRobot
    D: Array
    K: Array
    knots: Ints
    Z: Array

    def part(self, which: Ints) -> _At:
        """The derivatives at some of the poses."""
        D, K, knots, Z = self[1:]
        return _At(self.stand, D[which], K[which], knots[which], Z[which])


def _at(model: KinematicModel, q: Array, force: Array, payload: Ints, temperature: Array) -> _At:
    mechanism, weights, never = (
        model.mechanism,
        ArmWeights(model.gravity, model.bodies, payload),
        np.full(len(q), np.nan),
    )
    stand = mechanism.stand(q, weights, temperature, never, never, force, model.tip)
    D, Z = derivatives(mechanism, stand, weights)
    D[..., frame_of(mechanism, model.series)] = by_frame(stand.at)
    return _At(stand, D, *between_knots(mechanism.curves, q, Z), Z)


class _Moved(NamedTuple):
    """Effect of a force at m poses.

    Displacement by pulls minus that by positions [m], (m, t, 3); covariances of the targets and of
    their displacement by the force, (m, 6 t, 6 t).
    """

    mean: Array
    cov: Array
    moved: Array


def _under_force(model: KinematicModel, q: Array, force: Array, here: _At, rest: _At) -> _Moved:
    """The force as pulls have it, or positions where there are none, with its uncertainty."""
    there, m = model.mechanism, len(q)
    every = [UnderForce.of_positions(m, len(there.tool), here.D.shape[2])]
    if model.by_pulls is not None:
        tip = there.tool[0, :3, 3] if model.tip is None else model.tip
        every = under_force(model.by_pulls, there, tip, q, force)
    weights = np.array([one.weight for one in every])
    mean = np.einsum("h,hmti->mti", weights, [one.shift for one in every])
    cov, moved = (np.zeros((m, here.D.shape[1], here.D.shape[1])) for _ in range(2))
    for one in every:
        if one.weight > 0:
            D = here.D + _of_points(one.by_positions)
            own, off = _of_points(one.own), _of_points((one.shift - mean)[..., None])
            more = own @ np.swapaxes(own, 1, 2) + off @ np.swapaxes(off, 1, 2)
            pose, row = np.nonzero(_of_points(one.unknown[..., None])[..., 0])
            more[pose, row, row] = np.inf
            cov += one.weight * (more + _spread(model.cov, D, here.K, here.knots))
            moved += one.weight * (more + _spread(model.cov, D - rest.D, 0.0 * here.K, here.knots))
    return _Moved(mean, cov, moved)


def _std(cov: Array, t: int) -> Array:
    """Standard uncertainty of each row of t targets from their covariance, (m, t, 6)."""
    return np.sqrt(np.maximum(np.einsum("mrr->mr", cov), 0.0)).reshape(len(cov), t, 6)


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


def loads(data: bytes, name: str) -> KinematicModel:
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


def _loaded(kept: dict[str, Any]) -> KinematicModel:
    content = json.loads(kept["said"].tobytes())
    table = parse(content["table"], content["name"])
    mechanism = Mechanism(
        table=table,
        loose=content.get("loose", content["unknown"]),
        unknown=content["unknown"],
        elements=called(table, content["yields"]),
        laws=tuple(JointLaw(**one) for one in content["laws"]),
        curves=tuple(Curve(**one) for one in content["curves"]),
        **{name: kept[name] for name in ARRAYS},
    )
    size = layout(mechanism).size
    cov = np.zeros((size, size))
    cov[np.triu_indices(size)] = kept["cov"]
    cov = cov + np.triu(cov, 1).T
    return KinematicModel(
        campaign=content["campaign"],
        mechanism=mechanism,
        six=kept["six"],
        targets=np.array(content["targets"], dtype=object),
        cov=cov,
        joints=kept["joints"],
        bodies=Payloads(tuple(content["payloads"]), kept["mass"], kept["centre"], kept["stated"]),
        gravity=kept["gravity"],
        series=content["series"],
        tip=None if content.get("tip") is None else np.array(content["tip"]),
        by_pulls=ByPulls(model_of(content["pulls"]), content["joined"])
        if content.get("pulls")
        else None,
    )
