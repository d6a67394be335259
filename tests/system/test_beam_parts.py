"""Range and transverse part of stated covariances."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.system.beam import _proportion


@pytest.mark.parametrize(("along_m", "across_m"), [(3e-5, 3e-5), (1e-5, 4e-5), (2e-5, 5e-6)])
def test_the_stated_proportion_is_that_of_one_axis_to_one_axis(along_m, across_m):
    """Frames along random beams: s_r along the first axis, s_t along each of the two others."""
    rng = np.random.default_rng(2)
    frames = np.linalg.qr(rng.standard_normal((20, 3, 3)))[0]
    size = np.diag([along_m, across_m, across_m]) ** 2
    data = SimpleNamespace(loaded_cov=frames @ size @ np.swapaxes(frames, 1, 2))

    assert _proportion(data, frames[:, :, 0]) == pytest.approx(along_m / across_m)
