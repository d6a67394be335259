"""The files in which a campaign's identified model is handed over."""

from __future__ import annotations

from pipeline.prediction.mjcf import mjcf
from pipeline.prediction.model import Model, dumps
from pipeline.prediction.sdf import sdf
from pipeline.prediction.urdf import urdf


def files(handed: Model) -> dict[str, bytes]:
    """The files of a hand-over by name: all of the model, then its springs for other programs."""
    return {
        "model.toml": dumps(handed).encode(),
        "model.urdf": urdf(handed),
        "model.xml": mjcf(handed),
        "model.sdf": sdf(handed),
    }
