"""The model of a campaign of positions, as it is kept."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.base.arrays import Array, Bools, Locked, Strings
from pipeline.library.model_file import dumps as model_text
from pipeline.positions.mechanism import Mechanism, Payloads
from pipeline.prediction.model import IdentifiedModel

if TYPE_CHECKING:
    from pipeline.positions.calibrate import Calibration


@dataclass(frozen=True, eq=False)
class ByPulls(Locked):
    """Model of the robot estimated from pulls.

    Attributes:
        model: The model.
        joined: True if it was estimated jointly with the positions.
    """

    model: IdentifiedModel
    joined: bool


@dataclass(frozen=True, eq=False)
class KinematicModel(Locked):
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


def kinematic_model(
    campaign: str, found: Calibration, tip: Array | None = None, by_pulls: ByPulls | None = None
) -> KinematicModel:
    """Create the model of an estimate; `tip` and `by_pulls` as in `KinematicModel`."""
    return KinematicModel(
        campaign=campaign,
        mechanism=found.mechanism,
        six=found.readings.six,
        targets=found.readings.targets,
        cov=found.cov,
        joints=found.scatter.joints,
        bodies=found.weights.payloads,
        gravity=found.weights.gravity,
        series=int(np.argmax(np.bincount(found.readings.series))),
        tip=tip,
        by_pulls=by_pulls,
    )


def written(
    campaign: str,
    found: Calibration,
    tip: Array | None,
    pulls: IdentifiedModel | None,
    joined: bool,
) -> bytes:
    """Content of positions.npz for an estimate, as `model_file` of the answer asks for it."""
    by_pulls = None if pulls is None else ByPulls(pulls, joined)
    return dumps(kinematic_model(campaign, found, tip, by_pulls))


def dumps(model: KinematicModel) -> bytes:
    """Content of positions.npz: the whole model."""
    there = model.mechanism
    entries = {
        "format": 2,
        "campaign": model.campaign,
        "table": there.table.text,
        "name": there.table.name,
        "targets": model.targets.tolist(),
        "payloads": list(model.payloads),
        "laws": [vars(law) for law in there.laws],
        "curves": [vars(curve) for curve in there.curves],
        "loose": there.loose,
        "unknown": there.unknown,
        "series": model.series,
        "yields": [[one.label, one.form] for one in there.elements],
        "tip": None if model.tip is None else model.tip.tolist(),
        "pulls": model.by_pulls and model_text(model.by_pulls.model),
        "joined": bool(model.by_pulls and model.by_pulls.joined),
    }
    arrays: dict[str, Any] = {
        "said": np.frombuffer(json.dumps(entries).encode(), dtype=np.uint8),
        "cov": model.cov[np.triu_indices(len(model.cov))].astype(np.float32),
        "six": model.six,
        "joints": model.joints,
        "mass": model.bodies.mass,
        "centre": model.bodies.centre,
        "stated": model.bodies.std,
        "gravity": model.gravity,
    }
    arrays |= {name: getattr(there, name) for name in ARRAYS}
    sink = io.BytesIO()
    np.savez(sink, **arrays)
    return sink.getvalue()


ARRAYS = ("values", "tool", "frames", "compliance", "payload", "moments", "yields", "amplitudes",
           "knots")  # fmt: skip
