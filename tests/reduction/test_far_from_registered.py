"""The base reflectors read in a wrong unit: no registration fits, and one has to be found."""

import numpy as np

from pipeline.reduction.register import _fit

BASE = np.array([[0.6, -0.5, -0.3], [0.6, 18.5, -0.3], [-0.6, 18.5, -0.28], [-0.6, -0.5, -0.28]])
READ = np.array(
    [
        [-0.3518201, -0.0611601, -0.0448526],
        [-0.0422510, 0.6197849, -0.0391248],
        [-0.0852630, 0.6393339, -0.0385352],
        [-0.3948322, -0.0416119, -0.0442658],
    ]
)
"""The first base round of bench.compare's `unit_mixup:inch`, as given [m]."""


def beam(points):
    """Covariances of 8 um + 0.3 um/m along the beam, and 7.5 um + 3 um/m across it [m^2]."""
    far = np.linalg.norm(points, axis=1)[:, None, None]
    along = points[:, :, None] * points[:, None, :] / far**2
    across = (7.5e-6 + 3e-6 * far) ** 2
    return (8e-6 + 3e-7 * far) ** 2 * along + across * (np.eye(3) - along)


def test_where_the_search_ends_does_not_hang_on_the_last_digits():
    """Readings that differ by a femtometre: full steps go 20 m to and fro, and end anywhere."""
    near = READ * (1 + 1e-14 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, 1], [-1, -1, -1]]))

    R, t, *_ = _fit(READ, BASE, beam(READ))
    other, there, *_ = _fit(near, BASE, beam(READ))

    np.testing.assert_allclose(other, R, atol=1e-7)
    np.testing.assert_allclose(there, t, atol=1e-6)
