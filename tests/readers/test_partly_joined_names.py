"""Names of which only some look joined."""

import numpy as np
import pyarrow as pa

from pipeline.readers._reader import Export, Meaning, split


def export(*names):
    """An export of targets at the origin, without groups."""
    n = len(names)
    return Export(
        file="a.txt",
        dialect="xyz",
        encoding="utf-8",
        meaning=Meaning("m"),
        group=None,
        target=pa.array(names, pa.string()).dictionary_encode(),
        position=np.zeros((n, 3)),
        covariance=None,
        covariance_kind=None,
        time=pa.nulls(n, pa.timestamp("us")),
        line=np.arange(1, n + 1),
        order=np.arange(1, n + 1),
        rows=n,
        unused=(),
        rejected=(),
    )


def test_names_that_are_not_all_joined_stay_as_they_are():
    """One `pose1::P1` among plain names is a name, and no other row is rejected for it."""
    some = export("pose1::P1", "P2", "P3")

    assert split(some, None) is some
    assert split(export("pose1::P1", "pose1::P2"), None).target.to_pylist() == ["P1", "P2"]
