"""Known reflectors of two bodies, one of which an answer contradicts."""

import numpy as np
import pyarrow as pa
import pytest

from pipeline.intake.by_reflectors import _off
from pipeline.readers._reader import Export, Meaning
from pipeline.readers.reflector_sets import ReflectorSet

TOOL = {"P1": (0.0, 0.0, 0.0), "P2": (0.2, 0.0, 0.0)}
BASE = {"B1": (0.0, 0.0, 0.0), "B2": (5.0, 0.0, 0.0)}


def test_an_answer_is_as_bad_as_its_worst_body():
    """The tool fits to rounding; two base reflectors are 40 mm farther apart, 20 mm off each."""
    names = [*TOOL, *BASE]
    at = np.array([[1.0, 0, 0], [1.2, 0, 0], [0.0, 2.0, 0], [5.04, 2.0, 0]])
    n = len(names)
    export = Export(
        file="t.csv",
        dialect="xyz",
        encoding="utf-8",
        meaning=Meaning("m"),
        group=pa.array(["pose1"] * n).dictionary_encode(),
        target=pa.array(names).dictionary_encode(),
        position=at,
        covariance=None,
        covariance_kind=None,
        time=pa.nulls(n, pa.timestamp("us")),
        line=np.arange(1, n + 1),
        order=np.arange(1, n + 1),
        rows=n,
        unused=(),
        rejected=(),
    )
    bodies = [ReflectorSet("[tool]", TOOL), ReflectorSet("[base_frame]", BASE)]

    assert _off(export, bodies[:1]) == pytest.approx(0.0, abs=1e-9)
    assert _off(export, bodies) == pytest.approx(0.02)
