"""A data sheet's noise at a distance."""

import numpy as np
import pytest

from pipeline.machine.instrument import InstrumentNoise, beam_covariance


def test_both_parts_of_a_data_sheet_are_added_linearly():
    """10 um + 2 um/m along the beam at 5 m: 20 um; across it 5 um + 1 um/m: 10 um."""
    noise = InstrumentNoise(
        range_m=10e-6, range_per_m=2e-6, transverse_m=5e-6, transverse_per_m=1e-6
    )
    xx, xy, xz, yy, yz, zz = beam_covariance(np.array([[0.0, 5.0, 0.0]]), noise)[0]

    assert [xx, yy, zz] == pytest.approx([1e-10, 4e-10, 1e-10])
    assert [xy, xz, yz] == [0.0, 0.0, 0.0]
