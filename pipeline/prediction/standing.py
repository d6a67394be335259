"""Predicted positions of a robot, by the model of a campaign of positions."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pipeline.base.arrays import Array, Bools, Ints, Locked, Strings
from pipeline.base.errors import InputError
from pipeline.geometry.curves import Curve
from pipeline.geometry.estimate import between_knots
from pipeline.geometry.identify import Identified
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
from pipeline.machine.robot.mdh import parse
from pipeline.machine.robot.weight import link_moments
from pipeline.prediction.model import dumps as model_text
from pipeline.prediction.model import parse as model_of
from pipeline.prediction.under_force import ByPulls, under_force

LARGEST = 2**28
"""Maximum size of a model [byte]: the covariance of two thousand knots has 2^25."""

_ROWS = 2048
"""Number of poses predicted at a time, so that their arrays fit into the processor's cache."""


@dataclass(frozen=True, eq=False)
class Standing(Locked):
    """A model estimated from positions.

    Attributes:
        campaign: Campaign from which it was identified.
        mechanism: Table, tool, springs, laws.
        six: Targets whose orientation is known, shape (t,).
        targets: Their names, shape (t,).
        cov: Covariance of all parameters, shape (k, k).
        joints: Standard deviation of each joint's unmodelled error at a pose [m] or [rad], shape
            (n,).
        bodies: Payloads defined in campaign.toml.
        gravity: Acceleration of gravity [m/s^2], F_b, shape (3,).
        series: Series whose frame defines F_b: the one with most poses.
        tip: Point at which a force acts, flange frame [m], shape (3,); the first target if None.
        by_pulls: Model of the same robot estimated from pulls; None if there were none.
    """

    campaign: str
    mechanism: Mechanism
    six: Bools
    targets: Strings
    cov: Array
    joints: Array
    bodies: Payloads
    gravity: Array
    series: int
    tip: Array | None = None
    by_pulls: ByPulls | None = None

    @property
    def payloads(self) -> tuple[str, ...]:
        """Names of the payloads defined in campaign.toml."""
        return self.bodies.names

    def weights(self, payload: Ints) -> ArmWeights:
        """Weights with the payload of each pose: 0 for none, k + 1 for `payloads[k]`."""
        return ArmWeights(self.gravity, self.bodies, payload)

    def nominal(self) -> Standing:
        """The table as delivered, with its nominal stiffnesses; tool as estimated."""
        there, where = self.mechanism, layout(self.mechanism)
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
        return replace(self, mechanism=bare, cov=self.cov[kept, kept], by_pulls=None)

    def springs(self) -> Standing:
        """The table as delivered with the estimated springs, without letters and laws."""
        bare = self.nominal()
        return replace(
            bare,
            mechanism=replace(
                bare.mechanism,
                compliance=self.mechanism.compliance,
                moments=self.mechanism.moments,
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
    weights = model.weights(payload)
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


def standing(
    campaign: str, found: Identified, tip: Array | None = None, by_pulls: ByPulls | None = None
) -> Standing:
    """Create the model of an estimate; `tip` and `by_pulls` as in `Standing`."""
    return Standing(
        campaign=campaign,
        mechanism=found.mechanism,
        six=found.readings.six,
        targets=found.readings.targets,
        cov=found.solution.cov,
        joints=found.scatter.joints,
        bodies=found.weights.payloads,
        gravity=found.weights.gravity,
        series=int(np.argmax(np.bincount(found.readings.series))),
        tip=tip,
        by_pulls=by_pulls,
    )


def dumps(model: Standing) -> bytes:
    """Content of positions.npz: the whole model."""
    there = model.mechanism
    said = {
        "format": 2,
        "campaign": model.campaign,
        "table": there.table.text,
        "name": there.table.name,
        "targets": model.targets.tolist(),
        "payloads": list(model.payloads),
        "laws": [vars(law) for law in there.laws],
        "curves": [vars(curve) for curve in there.curves],
        "unknown": there.unknown,
        "series": model.series,
        "yields": [[one.label, one.form] for one in there.elements],
        "tip": None if model.tip is None else model.tip.tolist(),
        "pulls": model.by_pulls and model_text(model.by_pulls.model),
        "joined": bool(model.by_pulls and model.by_pulls.joined),
    }
    arrays: dict[str, Any] = {
        "said": np.frombuffer(json.dumps(said).encode(), dtype=np.uint8),
        "cov": model.cov[np.triu_indices(len(model.cov))].astype(np.float32),
        "six": model.six,
        "joints": model.joints,
        "mass": model.bodies.mass,
        "centre": model.bodies.centre,
        "stated": model.bodies.std,
        "gravity": model.gravity,
    }
    arrays |= {name: getattr(there, name) for name in _ARRAYS}
    sink = io.BytesIO()
    np.savez(sink, **arrays)
    return sink.getvalue()


_ARRAYS = ("values", "tool", "frames", "compliance", "payload", "moments", "yields", "amplitudes",
           "knots")  # fmt: skip


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
        **{name: kept[name] for name in _ARRAYS},
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
