"""Files of a finished campaign for other programs, by name."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from pipeline.answer.contract import Answer
from pipeline.exchange import workbook
from pipeline.exchange.to_mjcf import mjcf
from pipeline.exchange.to_sdf import sdf
from pipeline.exchange.to_urdf import urdf
from pipeline.prediction.model import IdentifiedModel


def files(
    answer: Answer, shown: Mapping[str, pd.DataFrame], handed: IdentifiedModel
) -> dict[str, bytes]:
    """Files of the springs for simulators, and of the answer for spreadsheets."""
    return {**simulators(handed), **workbook.files(answer, shown)}


def simulators(handed: IdentifiedModel) -> dict[str, bytes]:
    """Files of the springs of a model for simulators."""
    return {"model.urdf": urdf(handed), "model.xml": mjcf(handed), "model.sdf": sdf(handed)}
